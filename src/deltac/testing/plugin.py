"""The pytest plugin: a fixture `balanced` that asserts, and keeps the figures in the test report.

Errors of ours say themselves what is wrong with an input, so a report shows the lines of the user's code
alone; ``--full-trace`` shows all.
"""

from __future__ import annotations

import sysconfig
from collections.abc import Callable
from pathlib import Path
from traceback import walk_tb
from types import TracebackType
from typing import TYPE_CHECKING

import pytest

from deltac.errors import DeltacError
from deltac.testing import assert_balanced

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit


@pytest.fixture
def balanced(request: pytest.FixtureRequest) -> Callable[..., Audit]:
    """`deltac.testing.assert_balanced`, which notes verdict and |ΔC| as properties of the test.

    >>> def test_my_robot(balanced):  # doctest: +SKIP
    ...     balanced("robot.xml", "run.parquet", tolerance=1e-3)
    """
    # What the fixture record_property does, without its warning where reports are of the family xunit2.
    properties = request.node.user_properties

    def check(*args: object, **options: object) -> Audit:
        __tracebackhide__ = True
        report = assert_balanced(*args, **options)  # type: ignore[arg-type]
        properties.append(("deltac_relative_energy_error", report.relative))
        properties.append(("deltac_verdict", report.verdict.kind))
        return report

    return check


PACKAGE = Path(__file__).parents[1]
LIBRARY_FOLDERS = {Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")}
"""Where Python and what is installed beside it have their files."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    """Leave the frames of deltac out of the report of an error about an input."""
    error = None if call.excinfo is None else call.excinfo.value
    if isinstance(error, DeltacError) and not item.config.getoption("fulltrace", False):
        traceback = users(error.__traceback__)
        if traceback is not None:
            _shorten(error)
            call.excinfo = pytest.ExceptionInfo.from_exception(error.with_traceback(traceback))


def users(traceback: TracebackType | None) -> TracebackType | None:
    """A traceback without the frames of deltac and of what it calls; None where there are no others.

    What a user's function does, which deltac calls back, is shown.
    """
    frames = list(walk_tb(traceback))
    files = [Path(frame.f_code.co_filename) for frame, _ in frames]
    ours = next((k for k, file in enumerate(files) if PACKAGE in file.parents), len(files))
    shown = None
    for k, (frame, line) in reversed(list(enumerate(frames))):
        if k < ours or not {PACKAGE, *LIBRARY_FOLDERS} & set(files[k].parents):
            shown = TracebackType(shown, frame, frame.f_lasti, line)
    return shown


def _shorten(error: BaseException) -> None:
    """Leave out the causes of an error that lie in deltac alone, and its frames of those that do not."""
    cause = error.__cause__
    while cause is not None and users(cause.__traceback__) is None:
        cause = cause.__cause__
    error.__cause__, error.__suppress_context__ = cause, True
    if cause is not None:
        cause.__traceback__ = users(cause.__traceback__)
        _shorten(cause)
