"""The pytest plugin: a fixture `balanced` that asserts, and keeps the figures in the test report."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from deltac.testing import assert_balanced

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit


@pytest.fixture
def balanced(record_property: Callable[[str, object], None]) -> Callable[..., Audit]:
    """`deltac.testing.assert_balanced`, which notes |ΔC| of the energy exchanged as a property of the test.

    >>> def test_my_robot(balanced):  # doctest: +SKIP
    ...     balanced("robot.xml", "run.parquet", tolerance=1e-3)
    """

    def check(*args: object, **options: object) -> Audit:
        __tracebackhide__ = True
        found = assert_balanced(*args, **options)  # type: ignore[arg-type]
        record_property("deltac_relative_energy_error", found.relative)
        record_property("deltac_verdict", found.verdict.kind)
        return found

    return check
