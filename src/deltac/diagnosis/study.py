"""`study`: the same motion at several steps: integration error or wrong equations?"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis import study_findings as notice
from deltac.diagnosis.checks import assumed_zero, assumed_zero_finding
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.models import Model, load_model
from deltac.diagnosis.study_convergence import Convergence, between_runs, order_text, towards_zero
from deltac.diagnosis.study_curves import FEWEST, Comparison, compare
from deltac.diagnosis.study_residuals import Residuals, residuals_of
from deltac.diagnosis.study_rules import StudyMeasures, judge_study
from deltac.diagnosis.study_runs import (
    Progress,
    Simulator,
    StudyRun,
    checked_steps,
    disagreements,
    logged,
    simulated,
)
from deltac.diagnosis.verdict import Verdict
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.recorders import MujocoSimulator, mujoco_simulator
from deltac.simulation import Controller, Equations, simulate
from deltac.simulation.flow import Stabilisation
from deltac.simulation.solvers import find_solver
from deltac.trajectories import Trajectory

Array: TypeAlias = NDArray[np.float64]

TOLERANCE = 1e-6
"""Energy error that is accepted by default, as a fraction of the energy turned over."""

MUJOCO = "mujoco:"
EPS = float(np.finfo(np.float64).eps)

SAMPLES = 200
"""Rows of a run of an adaptive solver, at the same times for every tolerance."""


@dataclass(frozen=True, eq=False)
class Study:
    """What a study of a motion at several steps found.

    Attributes:
        mechanism: the model that the runs were tested against.
        solver: what made the runs.
        nominal: its order, if known.
        runs: one entry for each step, coarsest first, failures included.
        observed_order: how each testing function's ΔC converges, by name, and the motion under "state";
            `str()` of an entry is "order 5.0 ± 0.1".
        momentum: how the departure of each momentum balance converges.
        residuals: of the equations of motion at the runs' own states; None without accelerations.
        comparison: the runs at their common times, and the horizon up to which they stay together.
        function: the testing function that the verdict rests on.
        measures: the numbers that the verdict rests on.
        verdict: what it means.
        tolerance: accepted |ΔC| as a fraction of the energy turned over.
    """

    mechanism: Mechanism
    solver: str
    nominal: int | None
    runs: tuple[StudyRun, ...]
    observed_order: Mapping[str, Convergence]
    momentum: Mapping[str, Convergence]
    residuals: Residuals | None
    comparison: Comparison
    function: str
    measures: StudyMeasures
    verdict: Verdict
    tolerance: float

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed, causes first."""
        return self.verdict.findings

    @property
    def horizon(self) -> float:
        """The time (s) up to which motions at successive steps stay together."""
        return self.comparison.horizon

    @property
    def relative(self) -> float:
        """Largest |ΔC| at the finest step, as a fraction of the energy turned over."""
        turnover = self.measures.turnover
        return self.measures.left[-1] / turnover if turnover > 0.0 else 0.0

    @property
    def status(self) -> int:
        """Exit status: 0 consistent, or |ΔC| within the tolerance; 1 not; 3 unresolved."""
        return {"consistent": 0, "unresolved": 3}.get(self.verdict.kind, 1)

    def rows(self) -> tuple[dict[str, Any], ...]:
        """A line for each step: largest |ΔC| of each function (J), difference of the state to the next."""
        state = dict(zip(self.measures.steps, self.observed_order["state"].sizes))
        return tuple(
            {
                "step": entry.step,
                "delta_c": {n: float(np.abs(c).max()) for n, c in (entry.left_over or {}).items()},
                "error_bar": {n: float(b.max()) for n, b in (entry.bar or {}).items()},
                "turnover": entry.ledger.turnover if entry.ledger else None,
                "state_difference": state.get(entry.step),
                "failure": entry.failure,
            }
            for entry in self.runs
        )

    def to_dict(self) -> dict[str, Any]:
        """All but the time histories, for JSON: what is not finite is None."""
        m = self.measures
        plain: dict[str, Any] = _finite(
            {
                "verdict": self.verdict.kind,
                "confidence": self.verdict.confidence,
                "meaning": self.verdict.meaning,
                "evidence": list(self.verdict.evidence),
                "findings": [vars(finding) for finding in self.findings],
                "limits": list(self.verdict.limits),
                "status": self.status,
                "tolerance": self.tolerance,
                "relative": self.relative,
                "turnover": m.turnover,
                "solver": self.solver,
                "nominal_order": self.nominal,
                "testing_function": self.function,
                "horizon": self.horizon,
                "observed_order": {n: vars(c) for n, c in self.observed_order.items()},
                "momentum": {n: vars(c) for n, c in self.momentum.items()},
                "residuals": None
                if self.residuals is None
                else {
                    "names": list(self.residuals.names),
                    "relative": self.residuals.relative.tolist(),
                    "by_step": list(self.residuals.by_step),
                },
                "runs": list(self.rows()),
            }
        )
        return plain

    def __repr__(self) -> str:
        orders = ", ".join(
            f"{n} {order_text(c)}" for n, c in self.observed_order.items() if c.order is not None
        )
        return (
            f"Study({self.verdict.kind}, confidence {self.verdict.confidence}; {self.solver}, "
            f"{len(self.runs)} steps; orders: {orders or 'none'})"
        )


def study(
    model: Any,
    state: State | Any = None,
    duration: float | None = None,
    steps: Sequence[float] = (),
    solver: str = "",
    equations: Equations | Callable[..., Any] | None = None,
    testing: Sequence[str] = ("wang", "liu-huston"),
    *,
    simulator: Simulator | None = None,
    logs: Sequence[Any] = (),
    tolerances: Sequence[float] = (),
    tolerance: float = TOLERANCE,
    order: int | None = None,
    controller: Controller | None = None,
    control: Callable[[Any, Any], object] | None = None,
    stabilisation: Stabilisation = "projection",
    mapping: Any = None,
    progress: Progress | None = None,
) -> Study:
    """Study a motion at several steps, and say whether its error is the integrator's or the equations'.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        state: where the motion starts; for a Problem its own by default, else at zero and at rest. With
            MuJoCo an mjData will do.
        duration: s; for a Problem its own by default.
        steps: s, three or more to tell most; for a Problem 4, 2 and 1 times its own step by default.
        solver: a name of `solver_names()` ("ode5" by default), or "mujoco:" and an integrator's name.
        equations: hand-written equations of motion in place of the mechanism's own, or their function.
        testing: testing functions that are integrated in the loop.
        simulator: a function of the step (s) that returns a Trajectory: any simulator at all.
        logs: logs of the same motion at several steps, in place of simulating it; paths or Trajectories.
        tolerances: in place of steps, for adaptive solvers.
        tolerance: accepted |ΔC| as a fraction of the energy turned over.
        order: the nominal order of `simulator`, if it has one.
        controller: sets the motors that have no law; for MuJoCo give `control`.
        control: called as control(model, data) before each step of MuJoCo.
        stabilisation: as for `simulate`.
        mapping: path of a mapping file, for `logs` whose columns have other names or units.
        progress: called with the fraction done and what is being done.

    Returns:
        The study: verdict, observed orders, findings, runs.

    Raises:
        InputError: the arguments are unusable, or no run at all came about.
    """
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance is {tolerance!r}; expected a number between 0 and 1")
    loaded = load_model(model)
    mechanism = loaded.mechanism
    if equations is not None and not isinstance(equations, Equations):
        equations = Equations(equations)
    findings: list[Finding] = []
    own_solver = False
    if logs:
        if simulator is not None or steps or tolerances or solver:
            raise InputError(
                "logs= are runs already: leave out steps, tolerances, solver and simulator"
            )
        runs = logged(mechanism, logs, mapping)
        solver, order = _of_logs(runs, order)
    else:
        if tolerances and steps:
            raise InputError("give steps= or tolerances=, not both")
        wanted = tolerances or steps or _default_steps(loaded)
        values, findings = checked_steps(wanted, "tolerance" if tolerances else "step")
        if simulator is None:
            state = _start(loaded, state)
            duration = _duration(loaded, duration)
            solver = solver or ("DOP853" if tolerances else _default_solver(loaded))
            if solver.startswith(MUJOCO):
                if equations is not None or controller is not None:
                    raise InputError(
                        "MuJoCo runs its own equations: leave out equations= and controller= (its inputs "
                        "are set by control=)"
                    )
                simulator = mujoco_simulator(
                    model,
                    duration,
                    integrator=solver.removeprefix(MUJOCO),
                    control=control,
                    state=state,
                )
            else:
                own_solver, order = True, find_solver(solver).order if order is None else order
                simulator = _own(
                    mechanism,
                    state if state is not None else mechanism.state(),
                    duration,
                    solver,
                    testing,
                    equations,
                    controller,
                    stabilisation,
                    adaptive=bool(tolerances),
                )
                order = None if tolerances else order
        elif solver or equations is not None or controller is not None:
            raise InputError(
                "simulator= makes the runs by itself: leave out solver, equations and controller"
            )
        if isinstance(simulator, MujocoSimulator):
            solver, order = simulator.solver, simulator.order if order is None else order
        solver = solver or getattr(simulator, "__name__", type(simulator).__name__)
        runs = simulated(mechanism, simulator, values, progress, trusted=own_solver)
    _some(runs)
    return _studied(
        loaded,
        tuple(runs),
        solver,
        order,
        equations,
        findings,
        float(tolerance),
        own_solver=own_solver,
        unit="" if tolerances else "s",
    )


def _studied(
    loaded: Model,
    runs: tuple[StudyRun, ...],
    solver: str,
    nominal: int | None,
    equations: Equations | None,
    findings: list[Finding],
    tolerance: float,
    *,
    own_solver: bool,
    unit: str,
) -> Study:
    """From runs to the study: compare, fit, look around, judge."""
    mechanism = loaded.mechanism
    places, found = disagreements(mechanism, runs)
    findings = [*findings, *found]
    kept = [runs[k] for k in places]
    motions = [_run(entry) for entry in kept]
    compared = compare(mechanism, motions)
    findings += notice.of_comparison(compared, kept)
    function = _function(kept)
    steps = np.array([entry.step for entry in kept])
    first = _first_together(compared)
    functions = [n for n in kept[-1].left_over or {} if all(n in (e.left_over or {}) for e in kept)]
    energy = {n: _energy(kept, compared, first, steps, n) for n in functions}
    state = _state(compared, first, steps, motions)
    momentum = _momentum(kept, compared, first, steps)
    trusted = own_solver and equations is None
    residuals = None
    if not trusted:
        by_step = [(entry.step, _run(entry)) for entry in kept]
        own = equations.coordinates if equations is not None else None
        residuals = residuals_of(mechanism, by_step, own, trusted=own_solver)
    finest = kept[-1]
    ledger = finest.ledger
    assert ledger is not None
    left = tuple(_largest(entry.left_over, function) for entry in kept)
    bars = tuple(_largest(entry.bar, function) for entry in kept)
    if residuals is not None:
        findings += residuals.findings
        if residuals.stays and max(residuals.by_step) > tolerance:
            findings.append(residuals.finding())
    if not own_solver:
        missing = assumed_zero(motions[-1], loaded.import_report)
        findings += assumed_zero_finding(missing)
        findings += notice.of_jumps(motions[-1])
    findings += notice.of_order(state, energy, nominal, solver)
    findings += notice.of_growth(finest, function, ledger, solver, bars[-1])
    findings += notice.of_corrections(kept, function, ledger.turnover, tolerance * ledger.turnover)
    findings += notice.of_constraints(kept, tolerance)
    findings += notice.of_momentum(momentum, ledger)
    ranked = sorted(findings, key=lambda f: ("cause", "doubt", "note").index(f.weight))
    measures = StudyMeasures(
        steps=tuple(map(float, steps)),
        left=left,
        bars=bars,
        turnover=ledger.turnover,
        scale=float(ledger.kinetic.max() + np.abs(ledger.potential_energy).max()) + ledger.turnover,
        kinetic=float(ledger.kinetic.max()),
        energy=energy[function],
        state=state,
        momentum=momentum,
        residuals=residuals,
        trusted=trusted,
        nominal=nominal,
        tolerance=tolerance,
        quadrature=ledger.method != "in-loop",
        unit=unit,
        findings=tuple(ranked),
    )
    return Study(
        mechanism=mechanism,
        solver=solver,
        nominal=nominal,
        runs=runs,
        observed_order={**energy, "state": state},
        momentum=momentum,
        residuals=residuals,
        comparison=compared,
        function=function,
        measures=measures,
        verdict=judge_study(measures),
        tolerance=tolerance,
    )


# --- measures -------------------------------------------------------------------------------------


def _first_together(compared: Comparison) -> int:
    """The coarsest run from which on all stay together up to the horizon."""
    first = len(compared.rows) - 1
    while first > 0 and compared.together[first - 1] >= compared.horizon:
        first -= 1
    return first


def _energy(
    kept: Sequence[StudyRun], compared: Comparison, first: int, steps: Array, name: str
) -> Convergence:
    """How ΔC of a function converges within the horizon; over all of the time where that is no time."""
    curves = [(entry.left_over or {})[name] for entry in kept]
    bars = [(entry.bar or {})[name] for entry in kept]
    within = compared.within
    if within < FEWEST or first > len(kept) - 2:  # maxima are all there is to compare
        y = np.array([[float(np.abs(c).max())] for c in curves])
        return towards_zero(steps, y, np.array([float(b.max()) for b in bars]))
    y = compared.sampled(curves)[first:, :within]
    floors = compared.sampled(bars)[first:, :within].max(axis=1)
    return towards_zero(steps[first:], y, floors)


def _state(
    compared: Comparison, first: int, steps: Array, motions: Sequence[Trajectory]
) -> Convergence:
    within = compared.within
    if within < min(FEWEST, len(compared.t)) or within < 2:
        return Convergence("does not settle" if len(steps) > 1 else "one run")
    states = compared.states[first:, 1:within]
    floors = np.array([8.0 * EPS * math.sqrt(len(run)) for run in motions])[first:]
    return between_runs(steps[first:], states, floors * max(1.0, float(np.abs(states).max())))


def _momentum(
    kept: Sequence[StudyRun], compared: Comparison, first: int, steps: Array
) -> dict[str, Convergence]:
    within = compared.within
    ledgers = [entry.ledger for entry in kept if entry.ledger is not None]
    if within < FEWEST or first > len(kept) - 2:
        return {}
    found = {}
    for name in ledgers[-1].momentum:
        curves = [ledger.momentum[name] for ledger in ledgers]
        bars = [ledger.momentum_bar[name] for ledger in ledgers]
        y = compared.sampled(curves)[first:, :within]
        floors = compared.sampled(bars)[first:, :within].max(axis=1)
        found[name] = towards_zero(steps[first:], y, floors)
    return found


def _largest(curves: Mapping[str, Array] | None, name: str) -> float:
    assert curves is not None
    return float(np.abs(curves[name]).max())


def _function(kept: Sequence[StudyRun]) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    names = kept[-1].left_over or {}
    return next(
        (n for n in ("wang", "liu-huston", "kane-levinson-1990") if n in names), next(iter(names))
    )


def _run(entry: StudyRun) -> Trajectory:
    assert entry.run is not None
    return entry.run


# --- what is run ----------------------------------------------------------------------------------


def _own(
    mechanism: Mechanism,
    state: State,
    duration: float,
    solver: str,
    testing: Sequence[str],
    equations: Equations | None,
    controller: Controller | None,
    stabilisation: Stabilisation,
    *,
    adaptive: bool,
) -> Simulator:
    """One of our solvers as a function of its step, or of its tolerance."""
    if not isinstance(state, State):
        raise InputError(
            f"state: found {type(state).__name__}, expected a State: make it by mechanism.state(...)"
        )
    family = find_solver(solver).family
    if adaptive and family == "fixed":
        raise InputError(
            f"solver {solver!r} takes fixed steps: give steps= in place of tolerances="
        )
    if not adaptive and family != "fixed":
        raise InputError(
            f"solver {solver!r} chooses its own steps: give tolerances= in place of steps="
        )

    def run(step: float) -> Trajectory:
        return simulate(
            mechanism,
            state,
            duration,
            duration / SAMPLES if adaptive else step,
            solver,
            testing,
            equations,
            controller=controller,
            tolerance=step if adaptive else None,
            stabilisation=stabilisation,
        )

    return run


def _default_steps(loaded: Model) -> tuple[float, ...]:
    if loaded.problem is None:
        raise InputError("give steps=, three or more, each half of the one before")
    h = loaded.problem.step
    return tuple(c * h for c in (4, 2, 1) if round(loaded.problem.duration / (c * h)) * c * h)


def _default_solver(loaded: Model) -> str:
    return loaded.problem.solver if loaded.problem is not None else "ode5"


def _start(loaded: Model, state: State | Any) -> State | Any:
    if state is not None or loaded.problem is None:
        return state
    return loaded.problem.state


def _duration(loaded: Model, duration: float | None) -> float:
    if duration is not None:
        return float(duration)
    if loaded.problem is None:
        raise InputError("say how long the motion lasts: duration= in seconds")
    return loaded.problem.duration


def _of_logs(runs: Sequence[StudyRun], order: int | None) -> tuple[str, int | None]:
    """Who made the logs, as they say themselves."""
    known = [entry.run.provenance for entry in runs if entry.run is not None]
    if not known:
        return "logs", order
    last = known[-1]
    name = f"{last.simulator} {last.solver}" if last.solver else last.simulator
    if order is None and last.simulator == "deltac" and last.solver:
        order = find_solver(last.solver).order
    return name, order


def _some(runs: Sequence[StudyRun]) -> None:
    """InputError unless there is a run to judge."""
    if not any(entry.usable for entry in runs):
        told = "; ".join(dict.fromkeys(entry.failure for entry in runs))
        raise InputError(f"no step gave a run that can be judged: {told}")


def _finite(value: Any) -> Any:
    """Nested containers with None for what no JSON can hold."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
