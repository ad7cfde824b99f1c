"""The pytest plugin: a fixture `balanced` that asserts, and keeps the figures in the test report."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

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
        found = assert_balanced(*args, **options)  # type: ignore[arg-type]
        properties.append(("deltac_relative_energy_error", found.relative))
        properties.append(("deltac_verdict", found.verdict.kind))
        return found

    return check
