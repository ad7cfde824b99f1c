"""`study`: the same motion at several steps: integration error or wrong equations?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from deltac.arrays import SAME
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis.inputs.channels import not_simulated
from deltac.diagnosis.inputs.omissions import (
    assumed_zero,
    assumed_zero_finding,
    unresolved_works,
)
from deltac.diagnosis.study import rules
from deltac.diagnosis.study.convergence import Convergence
from deltac.diagnosis.study.curves import compare, disagreements
from deltac.diagnosis.study.result import Study
from deltac.diagnosis.study.runs import (
    BalancedRun,
    Simulator,
    StudyRun,
    checked_steps,
    lasting,
    logged,
    simulated,
    unblinded,
)
from deltac.diagnosis.study.sample_residuals import residuals_of
from deltac.diagnosis.study.simulators import (
    COARSER,
    MUJOCO,
    Maker,
    SimulationOptions,
    handed_on,
    in_mujoco,
    of_logs,
    other_program,
    own_solver,
)
from deltac.diagnosis.verdict import (
    REFINED_TOLERANCE,
    Finding,
    Verdict,
    check_tolerance,
    function_of,
)
from deltac.errors import ArgumentsError, InputError, SolverError
from deltac.models import Model, ModelLike, StateLike, load_model
from deltac.simulation import Options, solver_options, three_steps
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from mujoco import MjData


def studied(
    loaded: Model,
    runs: tuple[StudyRun, ...],
    maker: Maker,
    findings: list[Finding],
    tolerance: float,
    *,
    unit: str,
) -> Study:
    """From runs to the study: compare, fit, look around, judge."""
    mechanism = loaded.mechanism
    runs = lasting(unblinded(runs))
    comparable, disagreeing = disagreements(mechanism, runs)
    findings = [*findings, *disagreeing]
    finest = comparable[-1]
    ledger = finest.ledger
    compared = compare(mechanism, comparable)
    findings += rules.of_comparison(compared, "step" if unit else "tolerance")
    function = function_of(ledger)
    orders = {
        name: _kept(
            compared.towards_zero(
                [entry.energy_error[name] for entry in comparable],
                [entry.bar[name] for entry in comparable],
            ),
            ledger.energy_exchanged,
        )
        for name in finest.energy_error
        if all(name in entry.energy_error for entry in comparable)
    }
    orders["state"] = compared.motion()
    momentum = {}
    if not mechanism.constraints and not compared.apart:  # whose reactions these balances leave out
        momentum = {
            name: compared.towards_zero(
                [entry.ledger.momentum[name] for entry in comparable],
                [entry.momentum_bar[name] for entry in comparable],
            )
            for name in ledger.momentum
        }
    trusted = maker.trusted and maker.equations is None
    if trusted and finest.blown_up:  # what is left before that is no motion to have an order
        orders = {name: _none(convergence) for name, convergence in orders.items()}
    residuals = None
    if not trusted:
        by_hand = maker.equations
        residuals = residuals_of(
            mechanism,
            [(entry.step, entry.run) for entry in comparable],
            None if by_hand is None else loaded.coordinate_map(None, by_hand),
            until=compared.horizon,
            trusted=maker.trusted,
        )
    if residuals is not None:
        findings += residuals.findings
        if residuals.stays and max(residuals.by_step) > tolerance:
            findings.append(residuals.finding())
    omissions = not_simulated(loaded.import_report) if maker.trusted else []
    findings += omissions
    if not maker.trusted:
        missing = assumed_zero(finest.run, loaded.import_report)
        findings += assumed_zero_finding(missing)
        findings += rules.of_impacts(mechanism, finest.run)
    findings += rules.of_order(orders["state"], maker.order, maker.name)
    findings += unresolved_works(finest.run, ledger)
    findings += rules.of_corrections(ledger, function, tolerance * ledger.reference_energy)
    findings += rules.of_constraints(compared, tolerance, trusted=trusted)
    findings += rules.of_momentum(momentum, ledger)
    ranked = sorted(findings, key=lambda f: ("cause", "doubt", "note").index(f.weight))
    result = Study(
        mechanism=mechanism,
        solver=maker.name,
        nominal=maker.order,
        runs=runs,
        observed_order=orders,
        momentum=momentum,
        residuals=residuals,
        comparison=compared,
        function=function,
        verdict=Verdict("unresolved", "low", (), tuple(ranked)),
        tolerance=tolerance,
        trusted=trusted,
        unit=unit,
        import_report=loaded.import_report,
    )
    return replace(result, verdict=_of_a_part(rules.judge_study(result), omissions))


def _of_a_part(verdict: Verdict, omissions: list[Finding]) -> Verdict:
    """The verdict on a motion without all that moves the machine: not sure for the whole of it."""
    if verdict.kind != "consistent" or not omissions:
        return verdict
    return replace(
        verdict,
        confidence="low",
        evidence=(
            *verdict.evidence,
            f"Parts of the model's file were left out: {omissions[0].what}",
        ),
    )


# --- measures -------------------------------------------------------------------------------------


def _kept(convergence: Convergence, scale: float) -> Convergence:
    """Without an order where energy is kept at every step: what is left is the noise of the solver."""
    if convergence.trend == "does not settle" and max(convergence.sizes) <= SAME * scale:
        return replace(convergence, trend="at its floor", order=None, order_error=None)
    return convergence


def _none(convergence: Convergence) -> Convergence:
    """The same without an order."""
    return replace(convergence, trend="does not settle", order=None, order_error=None, steps=())


@checked
@interruptible()
def study(
    model: ModelLike,
    state: StateLike | MjData = None,
    duration: float | None = None,
    steps: Sequence[float] | None = None,
    solver: str | Options | Sequence[Options] | None = None,
    *,
    runs: Simulator | Sequence[Trajectory | str | Path] | None = None,
    order: int | None = None,
    tolerance: float = REFINED_TOLERANCE,
    progress: Progress | None = None,
    **simulation: Unpack[SimulationOptions],
) -> Study:
    """Study a motion at several steps, and say whether its error is the integrator's or the equations'.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        state: where the motion starts; for a Problem its own by default, else at zero and at rest. With
            MuJoCo an mjData will do.
        duration: s; for a Problem its own by default.
        steps: s; three or more confirm an order. For a Problem 4, 2 and 1 times its own step by default
            (where 4 of them do not divide its duration: 1, 1/2 and 1/4).
        solver: a name of `solver_names()` ("ode5" by default) or an object of `deltac.solvers`; or "mujoco:"
            and an integrator's name. A solver that chooses its steps is run at 100, 10 and 1 times its
            tolerance, or with the tolerances of a list of such objects.
        runs: runs of another program, in place of simulating: a function of the step (s) that returns a
            Trajectory; or finished runs of the same motion at several steps, Trajectories or paths of logs.
        order: the nominal order of the method that made the runs, if they do not state it.
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).
        progress: called with the fraction done.
        **simulation: `record`, `equations`, `controller` and `constraints`, as for `simulate`. For MuJoCo
            the controller is a function, called as controller(model, data) before each step.

    Returns:
        The study: verdict, observed orders, findings, runs.

    Raises:
        InputError: the arguments are unusable, or no run at all came about.
    """
    check_tolerance(tolerance)
    loaded = load_model(model)
    options = handed_on(study, simulation)
    findings: list[Finding] = []
    unit = "s"
    if runs is not None and (solver is not None or options):
        raise ArgumentsError(
            "runs= come from another program: leave out solver and "
            f"{', '.join(SimulationOptions.__annotations__)}"
        )
    if runs is not None and not callable(runs):
        if steps is not None:
            raise ArgumentsError("runs= are finished: leave out steps")
        entries = logged(loaded.mechanism, runs)
        maker = of_logs(entries, order)
        if all(r.run is None or _tells_tolerance(r.run) for r in entries):
            unit = ""
    else:
        if callable(runs):
            maker = other_program(runs, order)
        else:
            duration = loaded.lasting(duration)
            solver = _default_solver(loaded) if solver is None else solver
            if isinstance(solver, str) and solver.startswith(MUJOCO):
                name = solver.removeprefix(MUJOCO)
                maker = in_mujoco(model, loaded, state, duration, name, options, order)
            else:
                chosen, tolerances = _refined(solver)
                maker = own_solver(loaded, state, duration, chosen, options, order)
                if tolerances:
                    if steps is not None:
                        raise SolverError(
                            f"solver {maker.name!r} chooses its own steps: leave out steps=; its tolerances "
                            "are 100, 10 and 1 times its own, or those of a list of solvers"
                        )
                    steps, unit = tolerances, ""
        what = "step" if unit else "tolerance"
        values, findings = checked_steps(_default_steps(loaded) if steps is None else steps, what)
        assert maker.simulator is not None
        trusted = maker.trusted
        entries = simulated(loaded.mechanism, maker.simulator, values, progress, trusted=trusted)
    if not any(isinstance(entry, BalancedRun) for entry in entries):
        failures = "; ".join(dict.fromkeys(entry.failure for entry in entries))
        raise SolverError(f"no step gave a run that can be judged: {failures}")
    return studied(loaded, tuple(entries), maker, findings, float(tolerance), unit=unit)


def _refined(solver: str | Options | Sequence[Options]) -> tuple[Options, tuple[float, ...]]:
    """A solver, and the tolerances at which it is run; none of them for one that takes steps."""
    several: list[Any] = list(solver) if isinstance(solver, list | tuple) else [solver]
    options = [solver_options(one) for one in several]
    if not options:
        raise InputError(
            "no solver was given; give three, each with a tenth of the tolerance before"
        )
    first = options[0]
    if first.solver.takes_steps and len(options) == 1:
        return first, ()
    tolerances = [t for one in options if (t := getattr(one, "tolerance", None)) is not None]
    if len(tolerances) < len(options) or len({one.with_tolerance(1.0) for one in options}) > 1:
        raise SolverError(
            "solver: expected one solver that chooses its steps, with several tolerances, such as "
            "[deltac.solvers.Scipy('DOP853', tolerance=t) for t in (1e-6, 1e-8, 1e-10)]; found "
            + ", ".join(map(repr, several))
        )
    if len(options) > 1:
        return first, tuple(tolerances)
    return first, tuple(factor * tolerances[0] for factor in COARSER)


def _default_steps(loaded: Model) -> tuple[float, ...]:
    if loaded.problem is None:
        raise ArgumentsError("give steps= (--steps), three or more, each half of the previous one")
    return three_steps(loaded.problem.duration, loaded.problem.step)


def _default_solver(loaded: Model) -> Options:
    if loaded.problem is None:
        return solver_options("ode5")
    return solver_options(loaded.problem.solver, getattr(loaded.problem, "tolerance", None))


def _tells_tolerance(run: Trajectory) -> bool:
    """Whether it is the tolerance, and not the step, that a run tells of itself."""
    return run.provenance.step is None and bool(run.provenance.tolerance)
