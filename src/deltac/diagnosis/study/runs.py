"""Runs that blow up: rows before the blow-up are kept, those after it are not judged."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from deltac.arrays import EPS, PHYSICAL, ROUGHLY, SAME_STEP, SMALL_SHARE, Array, max_norm
from deltac.calls.progress import Progress, counted, no_progress
from deltac.diagnosis.inputs.logs import Log, read_log
from deltac.diagnosis.inputs.omissions import OF_RATES
from deltac.diagnosis.residuals.at_samples import within_digits
from deltac.diagnosis.study.convergence import order_of
from deltac.diagnosis.verdict import LEAST_ORDER, Finding
from deltac.energy import Ledger
from deltac.errors import ArgumentsError, DeltacError, InputError, WrongType, number_or_nan
from deltac.mechanism import Mechanism
from deltac.simulation import (
    EnergyErrorWarning,
    IllConditionedWarning,
    SimulationStoppedWarning,
    StiffStepWarning,
)
from deltac.trajectories import FEWEST_ROWS, Trajectory
from deltac.verbs import balance

FASTEST = 3e8
"""No speed of a mechanism reaches this (m/s: light's; rad/s): the integration has become unstable."""


def before_blow_up(run: Trajectory) -> Trajectory:
    """The rows before speeds run away; the run itself where they do not."""
    size = np.abs(run.u).max(axis=1, initial=0.0)
    away = ~(size < FASTEST)
    if not away.any():
        return run
    sane = int(np.argmax(away))
    usual = float(np.median(size[:sane])) if sane else 0.0
    early = SMALL_SHARE * size[:sane] > usual
    end = int(np.argmax(early)) if usual > 0.0 and early.any() else sane
    return run.between(run.t[0], run.t[max(end - 1, 0)])


# --- the runs of a study -------------------------------------------------------------------------

Simulator: TypeAlias = Callable[[float], Trajectory]


@dataclass(frozen=True, eq=False)
class StudyRun:
    """One run of a study.

    Attributes:
        step: the step (s), or the tolerance of an adaptive solver.
        run: the motion, in the model's order; `ledger` where its energy went.
        energy_error: ΔC of each testing function (T,), J, corrections counted so that they hide nothing.
        bar: how far each may be off for other reasons than the motion: rounding, quadrature, the digits
            of a log, forces held between its rows (T,), J.
        momentum_bar: likewise of the departure of each momentum balance (T,).
        blown_up: the integration became unstable; `run` are the rows before that.
        failure: why there is no run, or "".
        findings: what was noticed of this run by itself.
    """

    step: float
    run: Trajectory | None = None
    ledger: Ledger | None = None
    energy_error: Mapping[str, Array] = field(default_factory=dict)
    bar: Mapping[str, Array] = field(default_factory=dict)
    momentum_bar: Mapping[str, Array] = field(default_factory=dict)
    blown_up: bool = False
    failure: str = ""
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class BalancedRun(StudyRun):
    """A run of a study that can be judged: it has a motion and a ledger."""

    run: Trajectory
    ledger: Ledger


def checked_steps(steps: Sequence[float], what: str) -> tuple[tuple[float, ...], list[Finding]]:
    """Steps, coarsest first and each once; findings of what was mended. InputError for what is none."""
    values: list[float] = []
    for step in steps:
        number = number_or_nan(step)
        if not (math.isfinite(number) and number > 0.0):
            logs = "; runs that were made before are given as runs="
            raise InputError(
                f"{what} is {step!r}; expected a positive, finite number"
                f"{logs if hasattr(step, 'provenance') else ''}"
            )
        values.append(number)
    if not values:
        raise InputError(f"no {what} was given; give three, each half of the previous one")
    distinct: list[float] = []
    dropped: list[float] = []
    for number in sorted(values, reverse=True):
        close = distinct and distinct[-1] / number < 1.0 + ROUGHLY
        (dropped if close else distinct).append(number)
    all_steps, close_ones = (", ".join(f"{x:g}" for x in some) for some in (values, dropped))
    if dropped and len(distinct) == 1:
        raise InputError(
            f"{what}s {all_steps} do not refine each other: give three, each half of the previous one"
        )
    finding = Finding(
        "steps-do-not-refine",
        f"{close_ones}: too close to the {what} before, and left out",
        f"given: {all_steps}",
        "Make each half of the previous one",
    )
    return tuple(distinct), [finding] if dropped else []


def simulated(
    mechanism: Mechanism,
    simulator: Simulator,
    steps: Sequence[float],
    progress: Progress | None,
    *,
    trusted: bool,
) -> list[StudyRun]:
    """One run for each step; what fails is kept as a failure. `trusted`: the simulator is our own."""
    tell = progress or no_progress
    runs = [_simulated(mechanism, simulator, h, trusted=trusted) for h in counted(steps, tell)]
    tell(1.0)
    return runs


def logged(mechanism: Mechanism, sources: Sequence[Trajectory | str | Path]) -> list[StudyRun]:
    """Finished runs of one motion at several steps, the coarsest first."""
    runs = []
    several = list(sources) if isinstance(sources, list | tuple) else [sources]
    if not several:
        raise ArgumentsError("runs= is empty; give a run for each step, or a function of the step")
    for source in several:
        if isinstance(source, str | Path):
            from deltac.trajectories import read_trajectory

            run = read_trajectory(Path(source), None, mechanism)
        elif isinstance(source, Trajectory):
            run = source
        else:
            raise WrongType(
                f"runs: found {type(source).__name__}, expected Trajectories, paths of logs, or a function "
                "of the step"
            )
        runs.append(_balanced(mechanism, run, _step_of(run), trusted=False))
    return sorted(runs, key=lambda r: -r.step)


def _simulated(
    mechanism: Mechanism, simulator: Simulator, step: float, *, trusted: bool
) -> StudyRun:
    try:
        run, findings = _quietly(simulator, step)
    except KeyboardInterrupt:
        raise
    except DeltacError as error:
        return StudyRun(step, failure=str(error))
    except Exception as error:  # a user's simulator may raise anything
        if trusted:
            raise
        return StudyRun(step, failure=f"{type(error).__name__}: {error}")
    if not isinstance(run, Trajectory):
        return StudyRun(
            step,
            failure=f"the simulator returned {type(run).__name__}, expected a Trajectory "
            "(deltac.TrajectoryBuilder makes one)",
        )
    entry = _balanced(mechanism, run, step, trusted=trusted, simulated=True)
    own_step = run.provenance.step
    if not run.provenance.completed:
        findings.append(
            Finding(
                "stopped",
                f"the run at step {step:g} stopped at t = {run.t[-1]:.4g} s",
                (run.provenance.message or "it stopped before its end").rstrip("."),
                "Nothing after that is compared",
            )
        )
    if own_step is not None and not trusted and abs(own_step - step) > 1e-6 * step:
        findings.append(
            Finding(
                "step-differs",
                f"the simulator was asked for step {step:g} and says that it took {own_step:g}",
                "provenance of the run",
                "Make it use the step that it is given",
                "doubt",
            )
        )
    return replace(entry, findings=(*entry.findings, *findings))


def _quietly(simulator: Simulator, step: float) -> tuple[Trajectory, list[Finding]]:
    """The run, and what was warned first of its step and its digits, as findings. Others go on."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = simulator(step)
    findings: dict[type[Warning], Finding] = {}
    for warning in caught:
        why = str(warning.message).rstrip(".")
        if issubclass(warning.category, StiffStepWarning):
            finding = Finding(
                "stiff-step",
                f"the step {step:g} s is too large for the fast parts of the mechanism",
                why,
                "Convergence at such steps says little about the motion",
            )
        elif issubclass(warning.category, IllConditionedWarning):
            finding = Finding(
                "ill-conditioned",
                "the accelerations have few digits in double precision",
                why,
                "Masses or lengths differ by too many powers of ten: no step makes the runs better",
                "doubt",
            )
        else:
            if not issubclass(warning.category, SimulationStoppedWarning | EnergyErrorWarning):
                warnings.warn_explicit(
                    warning.message, warning.category, warning.filename, warning.lineno
                )
            continue
        findings.setdefault(warning.category, finding)
    return run, [*findings.values()]


def _balanced(
    mechanism: Mechanism, whole: Trajectory, step: float, *, trusted: bool, simulated: bool = False
) -> StudyRun:
    run = before_blow_up(whole)
    if len(run) < FEWEST_ROWS:
        few = f"{len(run)} rows; a balance needs {FEWEST_ROWS} or more"
        if run is whole:
            return StudyRun(step, failure=f"the run has {few}")
        return StudyRun(
            step,
            failure=f"the run blows up at once: before that it has {few}. Use smaller steps, or an "
            f"implicit method",
        )
    try:
        log = read_log(mechanism, run, None, None, measured=not trusted)
    except InputError as error:
        blow_up = _absurd(run) if simulated else ""
        return StudyRun(step, failure=blow_up or str(error))
    ledger = log.ledger
    errors = dict(ledger.delta_c)
    bars, momentum_bars = dict(ledger.error_bar), dict(ledger.momentum_bar)
    if not trusted:
        uncertain, silent = _held_between_rows(log, step if simulated else None)
        digits = _of_digits(mechanism, log)
        bars = {n: b + uncertain + digits.get(n, 0.0) for n, b in bars.items()}
        momentum_bars = {
            n: b
            + digits.get(n, 0.0)
            + (np.abs(ledger.momentum[n]) if silent and uncertain else 0.0)
            for n, b in momentum_bars.items()
        }
    findings = log.findings if run is whole else (*log.findings, _blown_up(whole, run, step))
    return BalancedRun(
        step, log.run, ledger, errors, bars, momentum_bars, run is not whole, findings=findings
    )


def _absurd(run: Trajectory) -> str:
    """A run that was just made is no damaged file: numbers beyond all bounds are a blow-up. "" for none."""
    for what, values in (("coordinates", run.q), ("speeds", run.u), ("accelerations", run.udot)):
        if values is not None and max_norm(values) > PHYSICAL:
            return (
                f"the run blows up: {what} reach {np.abs(values).max():.2g}. Use smaller steps, or an "
                f"implicit method"
            )
    return ""


def _blown_up(whole: Trajectory, run: Trajectory, step: float) -> Finding:
    return Finding(
        "blown-up",
        f"the run at step {step:g} blows up at t = {run.t[-1]:.4g} s",
        f"speeds reach {np.abs(whole.u).max():.2g}",
        "Later rows are left out; if the equations are right, use a smaller step",
    )


def unblinded(runs: Sequence[StudyRun]) -> tuple[StudyRun, ...]:
    """The runs with ΔC taken so that corrections do not hide an error, alike for all of them.

    A simulator that brings its state back to the right energy, or onto a constraint, books that as work of a
    channel "correction …". Counted as work, it shows the drift that was corrected; left out, what the
    corrections spoiled. The larger one at the finest step is the error.
    """
    finest = next((r.ledger for r in reversed(runs) if r.ledger is not None), None)
    if finest is None or not corrections(finest):
        return tuple(runs)
    hidden = [n for n, x in finest.delta_c.items() if max_norm(finest.uncorrected(n)) > max_norm(x)]

    def taken(entry: StudyRun) -> StudyRun:
        if entry.ledger is None:
            return entry
        errors = {n: entry.ledger.uncorrected(n) for n in hidden}
        return replace(entry, energy_error={**entry.ledger.delta_c, **errors})

    return tuple(taken(entry) for entry in runs)


def corrections(ledger: Ledger) -> dict[str, Array]:
    """Work (T,) of each channel by which a simulator corrected its own state, from zero on."""
    return {n: w - w[0] for n, w in ledger.work.items() if n.kind == "correction"}


def _step_of(run: Trajectory) -> float:
    if run.provenance.step is not None:
        return run.provenance.step
    if run.provenance.tolerance:
        return run.provenance.tolerance
    return float(np.median(np.diff(run.t))) if len(run) > 1 else 1.0


def _held_between_rows(log: Log, asked: float | None) -> tuple[float, bool]:
    """Energy (J) that is not known where forces were held between rows; whether nobody says that they were.

    Held over a time h, a force is on average h/2 older than one that is interpolated: ∫ (h/2) ḟᵀu dt. Engines
    hold over their step, of which some were not logged. Where nobody says, it may have been until the next
    row: but a log of every step has that error too, and there it falls with the step, which the run tells, or
    which it was `asked` to take.
    """
    run, channels = log.run, log.run.provenance.held
    silent = channels is None and run.provenance.simulator != "deltac"
    step = run.provenance.step or (asked if silent else None)
    spacing = float(np.median(np.diff(log.consecutive.t)))
    if (step is not None and spacing < (1.0 + SAME_STEP) * step) or not (
        silent or (step and not run.works)
    ):
        return 0.0, False
    forces = [f for name, f in run.forces.items() if silent or name in (channels or ())]
    mean = 0.5 * (run.u[1:] + run.u[:-1])
    late = sum(
        (np.einsum("ij,ij->i", np.diff(f, axis=0), mean) for f in forces), np.zeros(len(mean))
    )
    age = spacing if silent or step is None else step
    return float(0.5 * age * max_norm(np.cumsum(late))), silent


def _of_digits(mechanism: Mechanism, log: Log) -> dict[str, float]:
    """How much each ΔC and momentum balance moves when all numbers of a log move by half of its digits.

    Nothing for a log in double precision, whose rounding the ledger knows.
    """
    run, was = log.run, log.ledger
    moved = within_digits(run, np.arange(len(run)))
    if all(np.allclose(a, b, 4 * EPS, 0.0) for a, b in ((moved.q, run.q), (moved.u, run.u))):
        return {}
    now = balance(mechanism, moved, was.method)
    pairs = ((was.delta_c, now.delta_c), (was.momentum, now.momentum))
    return {n: max_norm(after[n] - x) for before, after in pairs for n, x in before.items()}


def lasting(runs: tuple[StudyRun, ...]) -> tuple[StudyRun, ...]:
    """Without those findings of rates that are not there, alike, in every run.

    A step that is projected onto constraints, or a scheme of low order, moves q by something else than its
    speed. That shrinks with the step; a wrong clock, gear or column does not.
    """
    successful = [run for run in runs if not run.failure]

    def alike(finding: Finding, run: StudyRun) -> Finding | None:
        same = (f for f in run.findings if (f.kind, f.element) == (finding.kind, finding.element))
        return next(same, None)

    def lasts(finding: Finding) -> bool:
        each = [alike(finding, run) for run in successful]
        if None in each:
            return False
        departures = [f.factor - 1.0 for f in each if f is not None and f.factor is not None]
        ends = successful[0].step, successful[-1].step
        return not departures or order_of(ends, 1.0, departures[-1] / departures[0]) < LEAST_ORDER

    return tuple(
        replace(run, findings=tuple(f for f in run.findings if f.kind not in OF_RATES or lasts(f)))
        for run in runs
    )
