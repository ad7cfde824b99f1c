"""Energy balances as assertions, for the test suites of robots and simulators.

Each assertion hands back its report, so that a test may ask for more. The first line of a failure is the
report's summary, for the short summary of a test run; the whole report follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit
    from deltac.diagnosis.check.check import EquationCheck
    from deltac.diagnosis.study.result import Study
    from deltac.models import ModelLike
    from deltac.results import Report
    from deltac.simulation.equations import Equations, RightHandSide
    from deltac.trajectories import Trajectory

__all__ = ["assert_balanced", "assert_converges", "assert_equations"]

Found = TypeVar("Found", bound="Report")


def assert_balanced(
    model: ModelLike,
    run: Trajectory | str | Path,
    tolerance: float | None = None,
    **options: Any,
) -> Audit:
    """Assert that a run's energy balance holds, and hand back its audit.

    Args:
        model: a Mechanism, a Problem or its name, a MuJoCo model, a file; see `deltac.audit`.
        run: a Trajectory, or the path of a log.
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V);
            by default that of `deltac.audit`.
        options: further arguments of `deltac.audit`: work, mapping, coordinates, …

    Raises:
        AssertionError: it does not hold, or the log does not decide; the message has the verdict, the
            table and what to change.
        InputError: model or run cannot be read.
    """
    __tracebackhide__ = True  # pytest shows the caller's line
    from deltac.diagnosis.audit.audit import audit

    return _passing(audit(model, run, **_given(tolerance), **options))


def assert_equations(
    model: ModelLike,
    equations: str | Path | RightHandSide | Equations,
    tolerance: float | None = None,
    **options: Any,
) -> EquationCheck:
    """Assert that equations of motion written by hand are the model's, and hand back the check.

    Nothing is integrated: the equations are tested at random states.

    Args:
        model: a Mechanism, a Problem or its name, a MuJoCo model, a file.
        equations: a function of (t, q, u) that returns u̇, ``"FILE.py:FUNCTION"``, or `deltac.Equations`.
        tolerance: accepted residual as a fraction of each equation's terms; by default that of
            `deltac.check_equations`.
        options: further arguments of `deltac.check_equations`: coordinates, states, count, seed.

    Raises:
        AssertionError: they are not, or that cannot be told; the message says which equation, and by which
            term.
        InputError: the function raises, or returns no u̇.
    """
    __tracebackhide__ = True
    from deltac.diagnosis.check.check import check_equations

    return _passing(check_equations(model, equations, **_given(tolerance), **options))


def assert_converges(
    model: ModelLike,
    steps: Sequence[float] | None = None,
    tolerance: float | None = None,
    *,
    order: float | None = None,
    **options: Any,
) -> Study:
    """Assert that a motion's energy error falls within a tolerance as the step is refined.

    Args:
        model: a Mechanism, a Problem or its name, a MuJoCo model, a file.
        steps: three or more, each half of the previous one; see `deltac.study`.
        tolerance: accepted |ΔC| at the finest step, as a fraction of the energy that the system has; by
            default that of `deltac.study`.
        order: if given, the motion must converge at this order, within its error and half an order.
        options: further arguments of `deltac.study`: state, duration, solver, equations, runs, …

    Raises:
        AssertionError: it does not, or that cannot be told, or the order is lower.
        InputError: the study cannot be made.
    """
    __tracebackhide__ = True
    from deltac.diagnosis.study.study import study

    report = _passing(study(model, steps=steps, **_given(tolerance), **options))
    if order is not None:
        observed = report.observed_order["state"]
        if observed.order is None or observed.order + (observed.order_error or 0.0) < order - 0.5:
            raise AssertionError(
                f"the motion converges at {observed}, expected order {order:g}\n\n{report.explain()}"
            )
    return report


def _given(tolerance: float | None) -> dict[str, Any]:
    """A tolerance as an argument of a verb, which has its own default."""
    return {} if tolerance is None else {"tolerance": tolerance}


def _passing(report: Found) -> Found:
    """The report, if its exit code is 0."""
    __tracebackhide__ = True
    if report.exit_code:
        raise AssertionError(f"{report.summary()}\n\n{report.explain()}")
    return report
