"""What a study found: `Study`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import EPS, Array
from deltac.calls.deprecation import RenamedAttribute, renamed_keywords, warn_renamed
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis.audit.checks import assumed_zero, assumed_zero_finding, unresolved_works
from deltac.diagnosis.inputs.channels import not_simulated, told
from deltac.diagnosis.residuals.function import Caller
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import States, states_along
from deltac.diagnosis.study import findings as noticed
from deltac.diagnosis.study.convergence import Convergence, between_runs, order_text, towards_zero
from deltac.diagnosis.study.curves import FEWEST, Comparison, compare, disagreements
from deltac.diagnosis.study.extrapolation import Extrapolation, extrapolated
from deltac.diagnosis.study.measures import Residuals, StudyMeasures, residuals_of
from deltac.diagnosis.study.rules import judge_study
from deltac.diagnosis.study.runs import (
    Simulator,
    StudyRun,
    checked_steps,
    lasting,
    logged,
    simulated,
    unblinded,
)
from deltac.diagnosis.verdict import Finding, Judged, Verdict
from deltac.dynamics.system import trace
from deltac.errors import ArgumentsError, InputError, SolverError, SourceError, WrongType
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.models import Model, ModelLike, StateLike, load_model
from deltac.results import Section, Table, number, percent
from deltac.simulation.equations import Controller, Equations, as_equations, explicit
from deltac.simulation.flow import Keeping, stabilised
from deltac.simulation.simulate import simulate
from deltac.simulation.solvers import Options, find_solver, solver_options
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.importers.report import ImportReport


@dataclass(frozen=True, eq=False, repr=False)
class Study(
    Judged,
    omit=("mechanism", "runs", "comparison", "measures", "import_report"),
    also=("relative", "energy_exchanged", "horizon", "rows", "imported"),
):
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
        tolerance: accepted |ΔC| as a fraction of the energy exchanged.
        import_report: what the model's file held that the model does not, None for other models.
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
    import_report: ImportReport | None = None

    @property
    def imported(self) -> dict[str, tuple[str, ...]]:
        """What the import of the model left out, and what it assumed."""
        return told(self.import_report)

    @property
    def horizon(self) -> float:
        """The time (s) up to which motions at successive steps stay together."""
        return self.comparison.horizon

    turnover = RenamedAttribute("energy_exchanged")

    @property
    def energy_exchanged(self) -> float:
        """The energy exchanged at the finest step, J."""
        return self.measures.energy_exchanged

    @property
    def relative(self) -> float:
        """Largest |ΔC| at the finest step, as a fraction of the energy exchanged."""
        return (
            self.measures.left[-1] / self.energy_exchanged if self.energy_exchanged > 0.0 else 0.0
        )

    def extrapolate(self) -> Extrapolation:
        """The motion that the runs tend to, by the observed order, with an error estimate at every sample.

        Raises InputError (E-SOLVER) where the runs do not converge at an order, are fewer than three, or have
        impacts.
        """
        runs = [
            (h, _run(entry))
            for h, entry in ((r.step, r) for r in self.runs)
            if entry.run is not None and h in self.measures.steps
        ]
        state = self.observed_order["state"]
        return extrapolated(self.mechanism, self.solver, runs, self.comparison, state, self.nominal)

    def rows(self) -> tuple[dict[str, Any], ...]:
        """A line for each step: largest |ΔC| of each function (J), difference of the state to the next."""
        state = dict(zip(self.measures.steps, self.observed_order["state"].sizes))
        return tuple(
            {
                "step": entry.step,
                "delta_c": {
                    n: float(np.abs(c).max()) for n, c in (entry.energy_error or {}).items()
                },
                "error_bar": {n: float(b.max()) for n, b in (entry.bar or {}).items()},
                "energy_exchanged": entry.ledger.energy_exchanged if entry.ledger else None,
                "state_difference": state.get(entry.step),
                "failure": entry.failure,
            }
            for entry in self.runs
        )

    def summary(self) -> str:
        """Verdict, and the energy error at the finest step beside the tolerance."""
        m = self.measures
        runs = f"{len(self.runs)} {m.knob}s"
        if self.energy_exchanged < STILL * m.scale:  # a share of rounding would tell nothing
            return (
                f"{self.verdict.kind}: |ΔC| {m.left[-1]:.2g} J beside {m.scale:.4g} J, of which none is "
                f"exchanged, at the finest of {runs} of {self.solver} (confidence "
                f"{self.verdict.confidence})"
            )
        sign = ">" if self.relative > self.tolerance else "≤"
        state = self.observed_order["state"]
        order = "" if state.order is None else f", order {order_text(state)}"
        return (
            f"{self.verdict.kind}: |ΔC| {percent(self.relative)} {sign} {percent(self.tolerance)} of the "
            f"{self.energy_exchanged:.4g} J exchanged, at the finest of {runs} of "
            f"{self.solver}{order} (confidence {self.verdict.confidence})"
        )

    def sections(self) -> Iterator[Section]:
        """|ΔC| and the motion at each step, then the verdict."""
        names = [n for n in self.observed_order if n != "state"]
        knob = "step (s)" if self.measures.unit else "tolerance"
        rows: list[tuple[str, ...]] = []
        for row in self.rows():
            sizes = (
                number(row["delta_c"][n], digits=3) if n in row["delta_c"] else "" for n in names
            )
            difference = row["state_difference"]
            state = "no run" if row["failure"] else ""
            state = state if difference is None else number(difference, digits=3)
            rows.append((number(row["step"]), *sizes, state))
        orders = (str(self.observed_order[n]) for n in (*names, "state"))
        heads = (knob, *(f"|ΔC| {name} (J)" for name in names), "state, to the next")
        yield Table(heads, (*rows, (), ("", *orders)))
        yield from self.verdict.sections()
        if self.import_report is not None:
            yield from self.import_report.sections()


STILL = 1e-12
"""Share of the energies of a motion below which what is exchanged is rounding."""


# --- equations by hand in a study: what they raise, or cannot say, is told with the state --------


@dataclass(frozen=True, eq=False)
class _Careful:
    """The function as it is for symbols; for numbers, an InputError with the state where it raises."""

    caller: Caller
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]

    def __call__(self, t: Any, q: Any, u: Any) -> Any:
        if np.asarray(u).dtype == object or np.ndim(u) != 1:
            return self.caller.rhs(t, q, u)
        at = States(
            np.array([t], dtype=np.float64), q[:, None], u[:, None], self.coordinates, self.speeds
        )
        return self.caller(at)[:, 0]


def carefully(equations: Equations, mechanism: Mechanism, state: State) -> Equations:
    """The equations, called with care.

    Raises InputError if they raise at the start, or return there what is no u̇ or is not finite.
    """
    equations = explicit(trace(mechanism), equations)
    kane = Kane(mechanism, equations.coordinates)
    caller = Caller(equations.rhs, equations.name, kane, vectorised=False)
    start = _start(kane, state)
    if start is not None:
        udot = caller(start)[:, 0]
        if not np.isfinite(udot).all():
            at = ", ".join(f"{name} = {x:.6g}" for name, x in start.describe(0).items())
            raise SourceError(
                f"{equations.name} returned values that are not finite at the start: u̇ = "
                f"{udot.tolist()}. State: {at}"
            )
    return replace(equations, rhs=_Careful(caller, kane.told_names, tuple(kane.speed_names)))


def _start(kane: Kane, state: State) -> States | None:
    """The start in own coordinates; None where that cannot be said, which is for the simulation to tell."""
    try:
        run = Trajectory(
            t=np.array([state.t]),
            q=np.array([state.q]),
            u=np.array([state.u]),
            coordinates=kane.mechanism.coordinates.names,
            speeds=kane.mechanism.speeds.names,
        )
        return states_along(kane, run, np.zeros(1, dtype=np.intp))
    except InputError:
        return None


# --- from the runs of a study to what it found ---------------------------------------------------


NOISE = 1e-10
"""Share of the energy exchanged below which a ΔC that does not fall is what an iterative solution leaves."""


def studied(
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
    runs = lasting(unblinded(runs))
    places, found = disagreements(mechanism, runs)
    findings = [*findings, *found]
    kept = [runs[k] for k in places]
    motions = [_run(entry) for entry in kept]
    compared = compare(mechanism, motions)
    findings += noticed.of_comparison(compared, kept, "step" if unit else "tolerance")
    function = _function(kept)
    steps = np.array([entry.step for entry in kept])
    first = _first_together(compared)
    functions = [
        n for n in kept[-1].energy_error or {} if all(n in (e.energy_error or {}) for e in kept)
    ]
    energy_exchanged = kept[-1].ledger.energy_exchanged if kept[-1].ledger else 0.0
    energy = {
        n: _kept(_energy(kept, compared, first, steps, n), energy_exchanged) for n in functions
    }
    over_all = _over_all(kept, compared, first)
    state = _state(compared, first, steps, motions)
    momentum = _momentum(mechanism, kept, compared, first, steps)
    trusted = own_solver and equations is None
    if trusted and kept[-1].blown_up:  # what is left before that is no motion to have an order
        energy, state = {n: _none(c) for n, c in energy.items()}, _none(state)
    residuals = None
    if not trusted:
        by_step = [(entry.step, _run(entry)) for entry in kept]
        own = equations.coordinates if equations is not None else None
        residuals = residuals_of(
            mechanism, by_step, own, until=compared.horizon, trusted=own_solver
        )
    finest = kept[-1]
    ledger = finest.ledger
    assert ledger is not None
    left = tuple(_largest(entry.energy_error, function) for entry in kept)
    bars = tuple(_largest(entry.bar, function) for entry in kept)
    if residuals is not None:
        findings += residuals.findings
        if residuals.stays and max(residuals.by_step) > tolerance:
            findings.append(residuals.finding())
    lacking = not_simulated(loaded.import_report) if own_solver else []
    findings += lacking
    if not own_solver:
        missing = assumed_zero(motions[-1], loaded.import_report)
        findings += assumed_zero_finding(missing)
        findings += noticed.of_impacts(mechanism, motions[-1])
    findings += noticed.of_order(state, energy, nominal, solver)
    findings += noticed.of_growth(finest, function, ledger, solver, bars[-1])
    findings += unresolved_works(ledger)
    findings += noticed.of_corrections(ledger, function, tolerance * ledger.energy_exchanged)
    findings += noticed.of_constraints(kept, compared, tolerance, trusted=trusted)
    findings += noticed.of_momentum(momentum, ledger)
    ranked = sorted(findings, key=lambda f: ("cause", "doubt", "note").index(f.weight))
    measures = StudyMeasures(
        steps=tuple(map(float, steps)),
        left=left,
        bars=bars,
        energy_exchanged=ledger.energy_exchanged,
        scale=float(ledger.kinetic.max() + np.abs(ledger.potential_energy).max())
        + ledger.energy_exchanged,
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
        constrained=bool(mechanism.constraints),
        blown_up=finest.blown_up,
        until=None if over_all or compared.horizon >= compared.t[-1] else compared.horizon,
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
        verdict=_of_a_part(judge_study(measures), lacking),
        tolerance=tolerance,
        import_report=loaded.import_report,
    )


def _of_a_part(verdict: Verdict, lacking: list[Finding]) -> Verdict:
    """The verdict on a motion without all that moves the machine: not sure for the whole of it."""
    if verdict.kind != "consistent" or not lacking:
        return verdict
    return replace(
        verdict,
        confidence="low",
        evidence=(
            *verdict.evidence,
            f"Parts of the model's file were left out: {lacking[0].what}",
        ),
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
    curves = [(entry.energy_error or {})[name] for entry in kept]
    bars = [(entry.bar or {})[name] for entry in kept]
    within = compared.within
    if _over_all(kept, compared, first):
        y = np.array([[float(np.abs(c).max())] for c in curves])
        return towards_zero(steps, y, np.array([float(b.max()) for b in bars]))
    y = compared.sampled(curves)[first:, :within]
    floors = compared.sampled(bars)[first:, :within].max(axis=1)
    return towards_zero(steps[first:], y, floors)


def _over_all(kept: Sequence[StudyRun], compared: Comparison, first: int) -> bool:
    """Whether maxima of all of the time are all there is to compare."""
    return compared.within < FEWEST or first > len(kept) - 2


def _kept(found: Convergence, scale: float) -> Convergence:
    """Without an order where energy is kept at every step: what is left is the noise of the solver."""
    if found.trend == "does not settle" and max(found.sizes) <= NOISE * scale:
        return replace(found, trend="at its floor", order=None, order_error=None, end_order=None)
    return found


def _none(found: Convergence) -> Convergence:
    """The same without an order."""
    return replace(
        found, trend="does not settle", order=None, order_error=None, end_order=None, steps=()
    )


def _state(
    compared: Comparison, first: int, steps: Array, motions: Sequence[Trajectory]
) -> Convergence:
    within = compared.closely
    if within < min(FEWEST, len(compared.t)) or within < 2:
        return Convergence("does not settle" if len(steps) > 1 else "one run")
    states = compared.states[first:, 1:within]
    floors = np.array([8.0 * EPS * math.sqrt(len(run)) for run in motions])[first:]
    return between_runs(steps[first:], states, floors * max(1.0, float(np.abs(states).max())))


def _momentum(
    mechanism: Mechanism, kept: Sequence[StudyRun], compared: Comparison, first: int, steps: Array
) -> dict[str, Convergence]:
    within = compared.within
    if mechanism.constraints:  # whose reactions these balances leave out
        return {}
    ledgers = [entry.ledger for entry in kept if entry.ledger is not None]
    if within < FEWEST or first > len(kept) - 2:
        return {}
    found = {}
    for name in ledgers[-1].momentum:
        curves = [ledger.momentum[name] for ledger in ledgers]
        bars = [(entry.momentum_bar or {})[name] for entry in kept]
        y = compared.sampled(curves)[first:, :within]
        floors = compared.sampled(bars)[first:, :within].max(axis=1)
        found[name] = towards_zero(steps[first:], y, floors)
    return found


def _largest(curves: Mapping[str, Array] | None, name: str) -> float:
    assert curves is not None
    return float(np.abs(curves[name]).max())


def _function(kept: Sequence[StudyRun]) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    names = kept[-1].energy_error or {}
    return next(
        (n for n in ("wang", "liu-huston", "kane-levinson-1990") if n in names), next(iter(names))
    )


def _run(entry: StudyRun) -> Trajectory:
    assert entry.run is not None
    return entry.run


# --- `study`: the same motion at several steps: integration error or wrong equations? ------------

TOLERANCE = 1e-6
"""Energy error that is accepted by default, as a fraction of the energy exchanged."""

MUJOCO = "mujoco:"

SAMPLES = 200
"""Rows of a run of an adaptive solver, at the same times for every tolerance."""


@renamed_keywords(control="controller")
@interruptible()
def study(
    model: ModelLike,
    state: StateLike | Any = None,
    duration: float | None = None,
    steps: Sequence[float] | None = None,
    solver: str | Options = "",
    equations: Equations | Callable[..., Any] | None = None,
    testing: Sequence[str] = ("wang", "liu-huston"),
    *,
    simulator: Simulator | None = None,
    logs: Sequence[Any] = (),
    tolerances: Sequence[float] | None = None,
    tolerance: float = TOLERANCE,
    order: int | None = None,
    controller: Controller | Callable[[Any, Any], object] | None = None,
    constraints: str | Keeping = "projection",
    mapping: Any = None,
    progress: Progress | None = None,
    stabilisation: Any = None,
) -> Study:
    """Study a motion at several steps, and say whether its error is the integrator's or the equations'.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        state: where the motion starts; for a Problem its own by default, else at zero and at rest. With
            MuJoCo an mjData will do.
        duration: s; for a Problem its own by default.
        steps: s, three or more to tell most; for a Problem 4, 2 and 1 times its own step by
            default (where 4 of them do not divide its duration: 1, 1/2 and 1/4).
        solver: a name of `solver_names()` ("ode5" by default) or an object of `deltac.solvers`; or "mujoco:"
            and an integrator's name.
        equations: hand-written equations of motion in place of the mechanism's own, or their function.
        testing: testing functions that are integrated in the loop.
        simulator: a function of the step (s) that returns a Trajectory: any simulator at all.
        logs: logs of the same motion at several steps, in place of simulating it; paths or Trajectories.
        tolerances: in place of steps, for adaptive solvers.
        tolerance: accepted |ΔC| as a fraction of the energy exchanged.
        order: the nominal order of `simulator`, if it has one.
        controller: a Controller sets the motors that have no law; for MuJoCo a function, called as
            controller(model, data) before each step.
        constraints: how runs stay on their constraints, as for `simulate`.
        mapping: path of a mapping file, for `logs` whose columns have other names or units.
        progress: called with the fraction done.
        stabilisation: the old name of `constraints`.

    Returns:
        The study: verdict, observed orders, findings, runs.

    Raises:
        InputError: the arguments are unusable, or no run at all came about.
    """
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance is {tolerance!r}; expected a number between 0 and 1")
    if stabilisation is not None:
        warn_renamed("study(stabilisation=…)", "study(constraints=…)")
        constraints = stabilised(stabilisation)
    loaded = load_model(model)
    equations = None if equations is None else as_equations(equations)
    if logs:
        given = simulator is not None or steps is not None or tolerances is not None
        if given or solver:
            raise ArgumentsError(
                "logs= are finished runs: leave out steps, tolerances, solver and simulator"
            )
        runs = logged(loaded.mechanism, logs, mapping)
        maker = _of_logs(runs, order)
        findings: list[Finding] = []
    else:
        if tolerances is not None and steps is not None:
            raise ArgumentsError("give steps= or tolerances=, not both")
        adaptive = tolerances is not None
        wanted = tolerances if steps is None else steps
        if wanted is None:
            wanted = _default_steps(loaded)
        values, findings = checked_steps(wanted, "tolerance" if adaptive else "step")
        if simulator is not None:
            if solver or equations is not None or controller is not None:
                raise ArgumentsError(
                    "simulator= makes the runs itself: leave out solver, equations and controller"
                )
            maker = _of_user(simulator, order)
        else:
            duration = loaded.lasting(duration)
            solver = solver or ("DOP853" if adaptive else _default_solver(loaded))
            if isinstance(solver, str) and solver.startswith(MUJOCO):
                if equations is not None or isinstance(controller, Controller):
                    raise ArgumentsError(
                        "MuJoCo runs its own equations: leave out equations=; its inputs are set by "
                        "controller=, a function of (model, data)"
                    )
                from deltac.recorders import mujoco_simulator

                name = solver.removeprefix(MUJOCO)
                run = mujoco_simulator(
                    model,
                    duration,
                    integrator=name,
                    controller=controller,
                    state=_mujoco_start(loaded, state),
                )
                maker = _of_user(run, order)
            else:
                maker = _own(
                    loaded.mechanism,
                    _own_start(loaded, state),
                    duration,
                    solver,
                    testing,
                    equations,
                    _own_controller(controller),
                    constraints,
                    order,
                    adaptive=adaptive,
                )
        runs = simulated(loaded.mechanism, maker.simulator, values, progress, trusted=maker.own)
    _some(runs)
    return studied(
        loaded,
        tuple(runs),
        maker.name,
        maker.order,
        equations,
        findings,
        float(tolerance),
        own_solver=maker.own,
        unit="" if tolerances is not None else "s",
    )


# --- what is run ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Maker:
    """What makes the runs: its name, its nominal order if known, and whether it is one of our solvers."""

    simulator: Simulator
    name: str
    order: int | None
    own: bool = False


def _own(
    mechanism: Mechanism,
    state: State,
    duration: float,
    solver: str | Options,
    testing: Sequence[str],
    equations: Equations | None,
    controller: Controller | None,
    constraints: str | Keeping,
    order: int | None,
    *,
    adaptive: bool,
) -> _Maker:
    """One of our solvers as a function of its step, or of its tolerance."""
    if equations is not None:
        equations = carefully(equations, mechanism, state)
    options = solver_options(solver)
    found = options.solver
    if adaptive and found.takes_steps:
        raise SolverError(
            f"solver {found.name!r} takes fixed steps: give steps= in place of tolerances="
        )
    if not adaptive and not found.takes_steps:
        raise SolverError(
            f"solver {found.name!r} chooses its own steps: give tolerances= in place of steps="
        )

    def run(step: float) -> Trajectory:
        return simulate(
            mechanism,
            state,
            duration,
            duration / SAMPLES if adaptive else step,
            options.with_tolerance(step) if adaptive else options,
            testing,
            equations,
            controller=controller,
            constraints=constraints,
        )

    # The error of an adaptive solver follows its tolerance, not a power of a step.
    nominal = None if adaptive else found.order
    return _Maker(run, found.name, nominal if order is None else order, own=True)


def _of_user(simulator: Simulator, order: int | None) -> _Maker:
    """A simulator that is not ours; MuJoCo's know their name and order."""
    from deltac.recorders import MujocoSimulator

    if isinstance(simulator, MujocoSimulator):
        return _Maker(simulator, simulator.solver, simulator.order if order is None else order)
    return _Maker(simulator, getattr(simulator, "__name__", type(simulator).__name__), order)


def _default_steps(loaded: Model) -> tuple[float, ...]:
    if loaded.problem is None:
        raise ArgumentsError("give steps= (--steps), three or more, each half of the previous one")
    h, duration = loaded.problem.step, loaded.problem.duration
    coarser = abs(round(duration / (4 * h)) * 4 * h - duration) < 1e-9 * duration
    return (4 * h, 2 * h, h) if coarser else (h, h / 2, h / 4)


def _default_solver(loaded: Model) -> str:
    return loaded.problem.solver if loaded.problem is not None else "ode5"


def _own_start(loaded: Model, state: StateLike) -> State:
    """The model's own start by default, else at zero and at rest."""
    if state is None and not loaded.starts:
        return loaded.mechanism.state()
    return loaded.start(state)


def _mujoco_start(loaded: Model, state: Any) -> Any:
    """An mjData as it is; None where MuJoCo's own start is meant."""
    if type(state).__name__ == "MjData" or (state is None and not loaded.starts):
        return state
    return loaded.start(state)


def _own_controller(given: Controller | Callable[..., object] | None) -> Controller | None:
    if given is None or isinstance(given, Controller):
        return given
    raise WrongType(
        "controller: found a function; our solvers take a Controller(function of t, q, u), MuJoCo's a "
        "function of (model, data)"
    )


def _of_logs(runs: Sequence[StudyRun], order: int | None) -> _Maker:
    """Who made the logs, as the finest says itself."""

    def none(step: float) -> Trajectory:
        raise ArgumentsError("logs are runs already")

    source = next((r.run.provenance for r in reversed(runs) if r.run is not None), None)
    if source is None:
        return _Maker(none, "logs", order)
    name = f"{source.simulator} {source.solver}" if source.solver else source.simulator
    if order is None and source.simulator == "deltac" and source.solver:
        order = find_solver(source.solver).order
    return _Maker(none, name, order)


def _some(runs: Sequence[StudyRun]) -> None:
    """InputError unless there is a run to judge."""
    if not any(entry.usable for entry in runs):
        told = "; ".join(dict.fromkeys(entry.failure for entry in runs))
        raise SolverError(f"no step gave a run that can be judged: {told}")
