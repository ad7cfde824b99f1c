"""Energy balances as assertions, for the test-suites of robots and simulators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit

__all__ = ["assert_balanced"]


def assert_balanced(
    model: Any,
    run: Any,
    tolerance: float = 1e-3,
    *,
    work: str | None = None,
    mapping: Any = None,
) -> Audit:
    """Assert that a run's energy balance holds, and hand back its audit.

    Args:
        model: a Mechanism, a Problem or its name, a MuJoCo model, a file; see `deltac.audit`.
        run: a Trajectory, or the path of a log.
        tolerance: accepted |ΔC| as a fraction of the energy exchanged.
        work: how works are taken, as for `deltac.balance`.
        mapping: path of a mapping file, where the log's columns have other names or units.

    Raises:
        AssertionError: it does not hold, or the log does not tell; the message has the verdict, the
            table and what to change.
        InputError: model or run cannot be read.
    """
    __tracebackhide__ = True  # pytest shows the caller's line
    from deltac.diagnosis.audit.audit import audit

    found = audit(model, run, tolerance=tolerance, work=work, mapping=mapping)
    if found.exit_code:
        raise AssertionError(
            f"the energy balance does not hold: {found.verdict.explain()}\n\n{found.table()}"
        )
    return found
