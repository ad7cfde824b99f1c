"""What a study found: `Study`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from deltac.arrays import SAME
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis.inputs.channels import import_remarks, not_simulated
from deltac.diagnosis.inputs.omissions import (
    assumed_zero,
    assumed_zero_finding,
    unresolved_works,
)
from deltac.diagnosis.study import findings as noticed
from deltac.diagnosis.study.convergence import Convergence, order_text
from deltac.diagnosis.study.curves import ComparedRuns, compare, disagreements
from deltac.diagnosis.study.measures import SampleResiduals, StudyMeasures, residuals_of
from deltac.diagnosis.study.rules import judge_study
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
    Judged,
    Verdict,
    check_tolerance,
    function_of,
)
from deltac.errors import ArgumentsError, InputError, SolverError
from deltac.mechanism.coordinate_map import own_coordinates
from deltac.mechanism.mechanism import Mechanism
from deltac.models import Model, ModelLike, StateLike, load_model
from deltac.results import Section, Table, number, percent
from deltac.simulation.solvers import Options, solver_options
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from mujoco import MjData

    from deltac.diagnosis.explain.result import Explanation
    from deltac.importers.report import ImportReport


@dataclass(frozen=True, eq=False, repr=False)
class Study(
    Judged,
    omit=("mechanism", "runs", "comparison", "measures", "import_report"),
    also=("relative", "energy_exchanged", "reference_energy", "horizon", "rows", "imported"),
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
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).
        import_report: what the model's file held that the model does not, None for other models.
    """

    mechanism: Mechanism
    solver: str
    nominal: int | None
    runs: tuple[StudyRun, ...]
    observed_order: Mapping[str, Convergence]
    momentum: Mapping[str, Convergence]
    residuals: SampleResiduals | None
    comparison: ComparedRuns
    function: str
    measures: StudyMeasures
    verdict: Verdict
    tolerance: float
    import_report: ImportReport | None = None

    @property
    def imported(self) -> dict[str, tuple[str, ...]]:
        """What the import of the model left out, and what it assumed."""
        return import_remarks(self.import_report)

    @property
    def horizon(self) -> float:
        """The time (s) up to which motions at successive steps stay together."""
        return self.comparison.horizon

    @property
    def energy_exchanged(self) -> float:
        """The energy exchanged at the finest step, J."""
        return self.measures.ledger.energy_exchanged

    @property
    def relative(self) -> float:
        """Largest |ΔC| at the finest step, as a fraction of `reference_energy`."""
        return self.measures.relative

    @property
    def reference_energy(self) -> float:
        """The energy that the error is compared with, J: largest K plus range of V, at the finest step."""
        return self.measures.ledger.reference_energy

    def explanation(self) -> Explanation:
        """What is wrong with the equations of the runs: the causes that all steps share, with their odds.

        Each step has an integrator's error of its own, and the same mistake; their Gram matrices are added.
        It takes about as long as an audit of each run. Raises InputError for runs of too few rows.
        """
        # Here, since a study alone must not load SciPy.
        from deltac.diagnosis.audit.audit import explain_residual

        return explain_residual(
            self.mechanism, [entry.run for entry in self.runs if isinstance(entry, BalancedRun)]
        )

    def rows(self) -> tuple[dict[str, Any], ...]:
        """A line for each step: largest |ΔC| of each function (J), difference of the state to the next."""
        state = dict(zip(self.measures.steps, self.observed_order["state"].sizes))
        return tuple(
            {
                "step": entry.step,
                "delta_c": {n: float(np.abs(c).max()) for n, c in entry.energy_error.items()},
                "error_bar": {n: float(b.max()) for n, b in entry.bar.items()},
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
        sign = ">" if self.relative > self.tolerance else "≤"
        state = self.observed_order["state"]
        order = "" if state.order is None else f", order {order_text(state)}"
        return (
            f"{self.verdict.kind}: |ΔC| {percent(self.relative)} {sign} {percent(self.tolerance)} of the "
            f"{self.reference_energy:.4g} J that the system has, at the finest of {runs} of "
            f"{self.solver}{order}{self.verdict.certainty}"
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


# --- from the runs of a study to what it found ---------------------------------------------------


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
    mechanism, solver, nominal = loaded.mechanism, maker.name, maker.order
    runs = lasting(unblinded(runs))
    comparable, disagreeing = disagreements(mechanism, runs)
    findings = [*findings, *disagreeing]
    finest = comparable[-1]
    ledger = finest.ledger
    compared = compare(
        mechanism, [entry.run for entry in comparable], [entry.step for entry in comparable]
    )
    findings += noticed.of_comparison(compared, comparable, "step" if unit else "tolerance")
    function = function_of(ledger)
    energy = {
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
    state = compared.motion([len(entry.run) for entry in comparable])
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
        energy, state = {n: _none(c) for n, c in energy.items()}, _none(state)
    residuals = None
    if not trusted:
        by_step = [(entry.step, entry.run) for entry in comparable]
        by_hand = None if maker.equations is None else maker.equations.coordinates
        residuals = residuals_of(
            mechanism,
            by_step,
            own_coordinates(mechanism, by_hand),
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
        findings += noticed.of_impacts(mechanism, finest.run)
    findings += noticed.of_order(state, nominal, solver)
    findings += unresolved_works(finest.run, ledger)
    findings += noticed.of_corrections(ledger, function, tolerance * ledger.reference_energy)
    findings += noticed.of_constraints(comparable, compared, tolerance, trusted=trusted)
    findings += noticed.of_momentum(momentum, ledger)
    ranked = sorted(findings, key=lambda f: ("cause", "doubt", "note").index(f.weight))
    measures = StudyMeasures(
        runs=tuple(comparable),
        function=function,
        energy=energy[function],
        state=state,
        momentum=momentum,
        residuals=residuals,
        trusted=trusted,
        nominal=nominal,
        tolerance=tolerance,
        unit=unit,
        constrained=bool(mechanism.constraints),
        until=None if compared.apart or compared.horizon >= compared.t[-1] else compared.horizon,
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
        verdict=_of_a_part(judge_study(measures), omissions),
        tolerance=tolerance,
        import_report=loaded.import_report,
    )


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


# --- `study`: the same motion at several steps: integration error or wrong equations? ------------


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
    h, duration = loaded.problem.step, loaded.problem.duration
    coarser = abs(round(duration / (4 * h)) * 4 * h - duration) < 1e-9 * duration
    return (4 * h, 2 * h, h) if coarser else (h, h / 2, h / 4)


def _default_solver(loaded: Model) -> Options:
    if loaded.problem is None:
        return solver_options("ode5")
    return solver_options(loaded.problem.solver, getattr(loaded.problem, "tolerance", None))


def _tells_tolerance(run: Trajectory) -> bool:
    """Whether it is the tolerance, and not the step, that a run tells of itself."""
    return run.provenance.step is None and bool(run.provenance.tolerance)
