"""The evidence of an audit beyond energy: which columns are believed, what they say of the equations.

Two tests speak of the equations. The one-step test rests on states and forces alone; the rate form on
measured accelerations, which are believed as far as the speeds bear them out. A log whose rows follow from
each other by a known integrator has right equations, whatever else its columns seem to say.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.calls.progress import Deadline, Parts, Progress, untold
from deltac.diagnosis.audit import checks, conventions
from deltac.diagnosis.audit.acted import as_acted
from deltac.diagnosis.audit.checks import withheld_equalities
from deltac.diagnosis.explain.by_integrator import known_but_for_one
from deltac.diagnosis.explain.causes import PREFERENCE
from deltac.diagnosis.explain.explain import EXPLAINS, explanation
from deltac.diagnosis.explain.regression import LEAST_ROWS
from deltac.diagnosis.explain.result import Explanation
from deltac.diagnosis.explain.search import MOST
from deltac.diagnosis.inputs.logs import Log, balanced
from deltac.diagnosis.measurements.digits import LEVELS
from deltac.diagnosis.measurements.kinematics import (
    Accelerations,
    accelerations,
    trusted,
    unsteadiness,
)
from deltac.diagnosis.residuals.at_samples import EquationTerms, Sampled, equation_terms, total
from deltac.diagnosis.residuals.one_step import LEAST, MATERIAL, NAMED, OneStep, one_step, one_steps
from deltac.diagnosis.residuals.rows import rms, stairs, trimmed
from deltac.diagnosis.residuals.schemes import EXPLICIT
from deltac.diagnosis.verdict import Finding, Weight, percent
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import Kinematics
from deltac.trajectories.lint import gap_rows
from deltac.trajectories.trajectory import INTERPOLATED, ROWS

if TYPE_CHECKING:
    from deltac.importers import ImportReport

EXACT = 1.0 - 1e-6
"""Share of the squared residual that an explanation must reach where the residual comes and goes."""

FEW = 3
"""Causes together that such a residual may have."""

FIRST = 0.4
"""Share of the time left that a search for causes may take before others get theirs."""

CONVENTIONS = 10.0
"""Seconds that conventions may take beside the search: a log misread accuses nobody however long"""

AGREE = 4.0
"""How many times its disagreement with the speeds a residual of measured accelerations must be."""

STEP_BARS = 2.5
"""How many error bars of the one-step test it must be besides."""

REPRODUCED = 0.75
"""Share of what is left that parts of a log must predict of the others for a mistake without a name."""

ALONE, PREDICTED = 0.97, 0.9
"""Shares of what is within ten error bars that one cause must explain, and parts of the log predict."""

EARLY = 0.02
"""Share of its changes that a force may act before its row and still counts as held over the step."""

OF_THE_LOG = ("actuator-delay", "late-rows", "zero-offset")
"""Causes that leave the equations as they are."""

ENDS, BEYOND_OTHERS = 0.02, 3.0
"""Share of a log at each end that may be left out, where it leaves so many times more than all others."""

SHORT = 0.5
"""Share of the windows up to which a residual is one of now and then."""

FEWEST = 3
"""Windows that must stand out."""

MOSTLY, QUIET = 0.6, 0.1
"""Share of the windows that stand out in a part of a log, and of the log where none does."""

NOT_OF_FORCES = 3.0
"""How many times the largest change of a force must be missing beside one of its changes to be none of it."""

SWITCHED = 10.0
"""How many times more than usual a force changes where it is switched."""

TOUCHING = ("contact", "limit", "friction", "impact")
"""Kinds of forces that begin and end between two rows."""

BESIDE = 2.5
"""Steps from a change of a held force within which a window is beside it."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the columns of a log say of the equations.

    log       as it is judged: forces that were one row late are put right
    terms     the equations at the samples, where measured accelerations are believed
    step      the one-step test, where it was made
    findings  of both
    """

    log: Log
    terms: EquationTerms | None
    step: OneStep | None
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class Known:
    """A log and what its columns say before the equations are looked at.

    log       the log with its ledger
    findings  of conventions, violations, rates
    measured  whether it has accelerations of its own
    """

    log: Log
    findings: tuple[Finding, ...]
    measured: bool

    @property
    def doubted(self) -> bool:
        """Whether the log contradicts itself."""
        return any(f.weight == "doubt" for f in self.findings)

    @property
    def given(self) -> bool:
        """Whether its accelerations are known to be those of the rows."""
        return self.measured and trusted(self.log.run)

    @property
    def between(self) -> bool:
        """Whether its rows lie between the solver's steps."""
        return self.log.run.provenance.notes.get(ROWS) == INTERPOLATED


def first_tests(mechanism: Mechanism, logs: Sequence[Known]) -> list[OneStep | None]:
    """The one-step test of the rows of logs as they are, all at once; None where it is not made."""
    if not len(mechanism.free.u):
        return [None] * len(logs)
    tested = [not (k.doubted or k.given or k.between) for k in logs]
    runs = [
        (k.log.consecutive, _late(k.log), unsteadiness(k.log.comparisons))
        for k, wanted in zip(logs, tested)
        if wanted
    ]
    made = iter(one_steps(mechanism, runs))
    return [next(made) if wanted else None for wanted in tested]


def gather(
    mechanism: Mechanism,
    known: Known,
    step: OneStep | None,
    work: str | None,
    tolerance: float,
    import_report: ImportReport | None,
    *,
    deadline: Deadline,
    progress: Progress = untold,
) -> Evidence:
    """All evidence on the equations; `step` is the first one-step test of the log, see `first_tests`.

    A log that is doubted explains nothing: its residual is shown, and no cause is sought. `progress` is told
    how far the search for causes has come; it ends with what it has when the `deadline` has passed.
    """
    log, measured, doubted, between = known.log, known.measured, known.doubted, known.between
    if not len(mechanism.free.u):
        return Evidence(log, None, None, ())
    given = trusted(log.run)
    found: list[Finding] = []
    whole = log.consecutive is log.run
    foreign = step is not None and not step.closes and not given and whole
    other = conventions.units(mechanism, log.run) if foreign else None
    if other is not None:
        return Evidence(log, None, None, (other,))

    def of_part(run: Trajectory) -> tuple[Log, OneStep | None]:
        """The log that consists of some of the rows, and its test."""
        comparisons = {n: c.between(log.run.t, run.t) for n, c in log.comparisons.items()}
        part = balanced(mechanism, run, work, log.findings, comparisons)
        return part, one_step(mechanism, run, _late(part), unsteadiness(comparisons))

    if step is not None and not step.closes and whole:
        acted = as_acted(mechanism, log.run)
        if acted is not None:
            run, found = acted
            log, step = of_part(run)
    if step is not None and not step.closes and whole:
        within = _without_ends(mechanism, log.run, step)
        if within is not None:
            run, spoiled = within
            found.append(spoiled)
            log, step = of_part(run)
    if between and not (given and measured):
        found.append(_interpolated())
    if step is not None and step.scheme is not None and step.closes and step.scheme.late_forces:
        log, finding = _forces_put_right(mechanism, log, work)
        found.append(finding)
    if step is not None:
        log = _held(mechanism, log, work, step)
    terms = None
    if measured:
        terms, more = _believed(mechanism, log, step, given=given)
        found += more
    if terms is not None:
        told = _of_samples(
            mechanism, log, terms, tolerance, import_report, doubted, deadline, progress
        )
        if any(f.kind == "forces-not-of-this-row" for f in told):
            terms = None
        found += told
    elif not doubted:
        found += _differing(mechanism, log, tolerance, import_report)
    if step is not None and not any(f.weight == "cause" for f in found):
        parts = Parts(progress, {"one cause": 0.5, "several": 0.5})
        local = _now_and_then(log, step)
        pair = None
        if not local:
            pair = known_but_for_one(
                mechanism, log.consecutive, step, deadline.part(FIRST), parts.part("one cause")
            )
        found = [
            f for f in found if f.kind != "not-reproducible"
        ]  # of the samples: the steps say more
        if local:
            more = local
        elif pair is not None:
            step, alone = pair
            more = _weighed(alone, step, tolerance)
        else:
            several = parts.part("several")
            step, more = _of_steps(mechanism, log, step, tolerance, deadline, several)
        if terms is not None and _hold(terms) and not _isolated(step):
            # A force that lasts longer than a step shows in the accelerations.
            more = [f for f in more if f.kind != "missing-contact"]
        if not any(f.weight == "cause" and f.kind != "missing-contact" for f in more):
            more = _in_a_part(mechanism, log, step, tolerance, deadline) or more
        again = {(f.kind, f.element) for f in more}
        found = [f for f in found if (f.kind, f.element) not in again] + more
    if foreign:
        found = _or_conventions(mechanism, log.run, found, deadline.beside(CONVENTIONS))
    return Evidence(log, terms, step, (*_of_the_log(found), *_left_out(deadline)))


def _or_conventions(
    mechanism: Mechanism, run: Trajectory, found: list[Finding], deadline: Deadline
) -> list[Finding]:
    """The findings, with a convention in which log and model differ, where that explains as much.

    It has no number that was fitted, so that it comes before several causes; beside a single one it is told
    as its equal.
    """
    causes = [f for f in found if f.weight == "cause"]
    other = conventions.orders_and_signs(mechanism, run, deadline)
    if other is None:
        axis = None if causes else conventions.axes(mechanism, run, deadline)
        return found if axis is None else [axis, *found]
    if len(causes) != 1 or causes[0].kind == "missing-contact":
        return [other, *(replace(f, weight="note") if f in causes else f for f in found)]
    (cause,) = causes
    equals = (*cause.equals, (other.kind, other.element), *other.equals)
    first = cause.what if cause.equals else f"one of these: {cause.what}"
    told = replace(cause, what=f"{first}; or {other.what}", equals=equals)
    return [told if f is cause else f for f in found]


def _of_the_log(found: list[Finding]) -> list[Finding]:
    """Findings of which causes in the log are doubts of it.

    Where one of these comes first, it explains the most. What else would explain the rest is of a log
    that is not yet right, and accuses nothing.
    """
    causes = [f for f in found if f.weight == "cause"]
    if not causes or causes[0].kind not in OF_THE_LOG:
        return found
    return [
        replace(f, weight="doubt" if f.kind in OF_THE_LOG else "note") if f in causes else f
        for f in found
    ]


def _left_out(deadline: Deadline) -> list[Finding]:
    """What was not looked at, since time was up."""
    if not deadline.left_out:
        return []
    return [
        Finding(
            "search-ended",
            "the search for causes ended when its time was up",
            f"not tried: {'; '.join(deadline.left_out)}",
            "The causes named are those found until then. A shorter log, or a part of the model, is searched "
            "faster; `deltac explain` searches without end",
            "note",
        )
    ]


def _interpolated() -> Finding:
    return Finding(
        "interpolated-rows",
        "the rows lie between the solver's steps, on its interpolant, and obey the equations only "
        "approximately",
        "equally spaced times from a solver that adapts its steps",
        "Leave t_eval out or set dense_output=True, so that the solver's own steps are tested; or pass "
        "the equations: Trajectory.from_scipy(result, model, equations=f)",
    )


def _late(log: Log) -> float:
    """By how many rows coordinates are ahead of their speeds, over all of them."""
    lates = [c.late for c in log.comparisons.values() if c.off < 0.1 and c.instant]
    return float(np.median(lates)) if lates else 0.0


def _without_ends(
    mechanism: Mechanism, run: Trajectory, step: OneStep
) -> tuple[Trajectory, Finding] | None:
    """The log without what differences and filters leave in its first and last rows; None if nothing is.

    Rows at an end leave more than any others by far: energies that are counted from the first of them are off
    all along the log. Only speeds are spoiled so: with speeds that follow from the coordinates, the ends must
    leave no more. An impact or another motion is still there then, and stays.
    """
    left = _left(step)
    count = int(ENDS * len(left))
    if count < 1 or run.works or run.integrals:
        return None
    most = BEYOND_OTHERS * float(left[count:-count].max())
    first = np.flatnonzero(left[:count] > most)
    last = np.flatnonzero(left[-count:] > most)
    start = float(step.residual.t[first[-1]]) if len(first) else run.t[0]
    end = float(step.residual.t[len(left) - count + last[0]]) if len(last) else run.t[-1]
    if not len(first) and not len(last) or _is_motion(mechanism, run, start, end, most):
        return None
    part = run.between(start, end)
    if len(part) == len(run):
        return None
    rows = len(run) - len(part)
    finding = Finding(
        "spoiled-ends",
        "the first or last rows obey the equations far less than all others do, as filters and differences "
        "leave them",
        f"{rows} {'rows were' if rows > 1 else 'row was'} left out: those from t = {part.t[0]:.6g} to "
        f"{part.t[-1]:.6g} s are judged",
        "Cut the ends of what was filtered or differenced",
    )
    return part, finding


def _left(step: OneStep) -> Array:
    """What each window leaves, as a share of the terms: of the equation that leaves most."""
    return np.asarray(
        np.max(np.abs(step.residual.forces) / np.maximum(step.residual.scale, 1e-300), axis=1)
    )


def _is_motion(
    mechanism: Mechanism, run: Trajectory, start: float, end: float, most: float
) -> bool:
    """Whether what lies before `start` and after `end` leaves more than `most` by its coordinates, too."""
    from scipy.interpolate import make_interp_spline

    pairs = Kinematics.of(run.coordinates, run.speeds).rates
    if len(pairs) < len(run.speeds) or len(run) < LEAST_ROWS:
        return True  # turns in space have no such rates: nothing is known
    places, speeds = (list(of) for of in zip(*pairs))
    u = np.empty_like(run.u)
    u[:, speeds] = make_interp_spline(run.t, run.q[:, places], 5).derivative()(run.t)
    step = one_step(mechanism, replace(run, u=u))
    if step is None:
        return True
    left, inside = _left(step), (step.residual.t > start) & (step.residual.t < end)
    most = max(most, LEAST, BEYOND_OTHERS * float(left[inside].max(initial=0.0)))
    return bool(np.any(left[~inside] > most))


def _held(mechanism: Mechanism, log: Log, work: str | None, step: OneStep) -> Log:
    """The log with its work taken as its forces acted: held over each step.

    So an identified integrator took them, or the rows show it where forces rest over several. Methods of
    first order take other forces from the start of a step too; of better ones these change along it.
    """
    run, scheme = log.run, step.scheme
    moving = [n for n, f in run.forces.items() if np.any(f[1:] != f[:-1])]
    known = work or run.integrals or run.events or run.provenance.held is not None
    if not moving or known or log.consecutive is not run or len(gap_rows(run.t)):
        return log
    order = 2
    if step.closes and scheme is not None:
        order = scheme.order
        if scheme.forces == "smooth" or scheme.name not in EXPLICIT:
            return log
    elif not _resting_until_told(step) and not (step.steps is not None and step.steps.held):
        return log
    width = float(np.median(np.diff(run.t)))
    held = tuple(n for n in run.forces if n.kind not in ("prescribed", "constraint"))
    told = replace(run.provenance, step=width, held=held)
    way = "discrete" if order < 2 else "samples"
    return balanced(mechanism, replace(run, provenance=told), way, log.findings, log.comparisons)


def _resting_until_told(step: OneStep) -> bool:
    """Whether forces are held over several rows, and change with the row that tells it."""
    intervals = step.residual.intervals
    return intervals.held and abs(intervals.early) <= EARLY


def _forces_put_right(mechanism: Mechanism, log: Log, work: str | None) -> tuple[Log, Finding]:
    """The log with its forces one row earlier, where those of a row belong to the step that led to it."""
    run = log.run
    moved = replace(run.every(1).between(run.t[0], run.t[-2]), integrals={}, works={})
    moved = replace(moved, forces={n: f[1:] for n, f in run.forces.items()})
    finding = Finding(
        "forces-one-row-late",
        "the logged forces belong to the step that led to their row: they are one row older than the state",
        "shifted by one row, they satisfy the equations",
        "They were shifted by one row. Log forces with the state in which they act",
    )
    return balanced(mechanism, moved, work, log.findings, log.comparisons), finding


# --- measured accelerations ------------------------------------------------------------------------------


def _believed(
    mechanism: Mechanism, log: Log, step: OneStep | None, *, given: bool
) -> tuple[EquationTerms | None, list[Finding]]:
    """The equations at the samples, if the accelerations are the rates of the speeds; else None."""
    terms = equation_terms(mechanism, log.run)
    if given:
        return terms, []
    told = accelerations(log.run)
    if told.difference:
        return None, [
            Finding(
                "udot-differenced",
                f"the accelerations are the {told.difference} difference quotient of the logged speeds",
                "to their digits",
                "They carry no information beyond the speeds and were left out. Log the simulator's own",
            )
        ]
    disagreement = _disagreement(terms, told)
    doubt = AGREE * disagreement
    if step is not None:
        # Rates made of the logged speeds hold what the integrator did to these.
        doubt = np.maximum(doubt, np.maximum(STEP_BARS * step.residual.bar, step.residual.taken))
    # What filters leave at the ends of a log is not all along it.
    doubt = np.where(trimmed(terms.residual) <= doubt, np.inf, doubt)
    terms = replace(terms, doubt=doubt)
    proven = step is not None and step.closes
    if proven and (terms.significant.any() or terms.doubtful.any()):
        return None, [_not_of_this_row(terms, told, disagreement)]
    if terms.doubtful.any():
        return (terms if terms.significant.any() else None), [
            _not_of_this_row(terms, told, disagreement)
        ]
    return terms, []


def _disagreement(terms: EquationTerms, told: Accelerations) -> Array:
    """What the equations would leave more or less if u̇ were the rate of the speeds (n,), N or N·m."""
    evaluator = terms.evaluator
    free = evaluator.mechanism.free
    rates = told.at(terms.rows)[:, free.u]
    known = np.isfinite(rates).all(axis=1)
    if not known.any():
        return np.full(len(terms.speeds), np.inf)
    nothing = np.zeros((int(known.sum()), evaluator.log.size))
    here = Sampled(terms.t[known], terms.q[known], terms.u[known], terms.udot[known], nothing)
    there = replace(here, udot=rates[known])
    change = total(evaluator(here)) - total(evaluator(there))
    return np.asarray(np.sqrt(np.mean(change**2, axis=0)))


def _not_of_this_row(terms: EquationTerms, told: Accelerations, disagreement: Array) -> Finding:
    k = int(np.argmax(disagreement / np.maximum(terms.scale, 1e-300)))
    share = disagreement[k] / max(float(terms.scale[k]), 1e-300)
    late = f"; they fit the speeds best {abs(told.late):.2g} rows " + (
        "earlier" if told.late > 0 else "later"
    )
    return Finding(
        "udot-not-of-this-row",
        "the logged accelerations are not the rates of the logged speeds in the same rows",
        f"the difference means {percent(share)} of the terms of {terms.speeds[k]!r}"
        + (late if abs(told.late) > 0.05 else ""),
        "The speeds are used instead to test the equations. Log accelerations of the same state, unfiltered",
        element=terms.speeds[k],
    )


def _of_samples(
    mechanism: Mechanism,
    log: Log,
    terms: EquationTerms,
    tolerance: float,
    import_report: ImportReport | None,
    doubted: bool,
    deadline: Deadline,
    progress: Progress,
) -> list[Finding]:
    """Findings of the equations of motion at the samples; a stale or misread log explains nothing."""
    if doubted:
        return checks.blame(terms)
    whole = log.consecutive is log.run
    nearby = terms if whole else equation_terms(mechanism, log.consecutive)
    stale = checks.stale_stage(mechanism, log.consecutive, nearby)
    if stale:
        return stale + checks.blame(terms)
    if terms.significant.any() and (other := conventions.units(mechanism, log.consecutive)):
        return [other, *checks.blame(terms)]
    if not trusted(log.run):
        elsewhere = checks.forces_of_other_rows(mechanism, log.consecutive, nearby)
        if elsewhere:
            return elsewhere
    found = checks.differing_channels(terms, log.ledger, tolerance, import_report)
    now_and_then = checks.intermittent(terms, log.run, tolerance)
    simple: list[Finding] = []
    unknown: list[Finding] = []
    if terms.significant.any():
        told = _explained(
            mechanism,
            log.consecutive,
            deadline.part(FIRST),
            progress,
            now_and_then=bool(now_and_then),
        )
        simple = list(told.findings) if told else []
        if not trusted(log.run):
            if terms.relative[terms.significant].max() <= tolerance:
                simple = [replace(f, weight="note") for f in simple]  # real, but small
            unknown = _unknown(told)
    certain, possible = withheld_equalities(mechanism, log.run, terms, import_report)
    known = certain or simple or now_and_then or possible
    return found + (known or unknown) + checks.blame(terms)


def _explained(
    mechanism: Mechanism,
    run: Trajectory,
    deadline: Deadline,
    progress: Progress,
    *,
    now_and_then: bool,
) -> Explanation | None:
    """The few causes that explain the residual of consecutive samples; None where these are too few.

    What is silent for a while can be fitted roughly by many things: then only an exact fit counts, and
    several causes only where they leave nothing but noise.
    """
    if len(run) < LEAST_ROWS:
        return None
    told = None
    for least, most in ((EXACT, 1), (1.0, FEW)) if now_and_then else ((EXPLAINS, MOST),):
        with contextlib.suppress(InputError):  # gaps leave too few rows in a row
            told = explanation(
                mechanism, run, None, least, most=most, deadline=deadline, progress=progress
            )
        if told is not None and told.findings:
            break
    return told


def _differing(
    mechanism: Mechanism, log: Log, tolerance: float, import_report: ImportReport | None
) -> list[Finding]:
    """Channels that are not the model's need no accelerations to be seen."""
    run = log.run
    if not run.forces:
        return []
    terms = equation_terms(mechanism, replace(run, udot=np.zeros_like(run.u), events=()))
    return checks.differing_channels(terms, log.ledger, tolerance, import_report)


# --- the one-step test -------------------------------------------------------------------------------------


def _of_steps(
    mechanism: Mechanism,
    log: Log,
    step: OneStep,
    tolerance: float,
    deadline: Deadline,
    progress: Progress,
) -> tuple[OneStep, list[Finding]]:
    """The test, and causes of what it leaves: local in time first, then those of the dictionary.

    What one cause explains all along the log is significant from fewer error bars on.
    """
    if step.closes:
        return step, []
    local = _at_times(log, step)
    share = float(local.mean()) if len(local) else 0.0
    now_and_then = local.sum() >= FEWEST and share <= SHORT
    clear = bool(step.significant.any())
    told: Explanation | None = None
    outside = float((rms(step.residual.forces) / step.residual.bar).max())
    enough = (clear or outside > NAMED) and len(log.consecutive) >= LEAST_ROWS
    if enough and not deadline.passed("several causes together"):
        with contextlib.suppress(InputError):
            told = explanation(
                mechanism,
                log.consecutive,
                step.residual,
                EXPLAINS if outside > step.clear else ALONE,
                most=MOST if clear else 1,
                deadline=deadline,
                progress=progress,
            )
    if told is not None and told.findings and (clear or _alone(told)):
        known = _known_by(step, told)
        return known, _weighed(told.findings, known, tolerance)
    if now_and_then:
        return step, _missing(step, share)
    if not clear:
        return step, []
    out = step.standing_out
    # A body that rests on something is pushed all the time: by what it falls onto, and never down.
    stands_out = np.where(out[:, None], -step.local.forces, 0.0)  # like F_r + F*_r
    if out.sum() >= FEWEST and checks.upward_push(mechanism, step.speeds, stands_out):
        return step, _missing(step, float(out.mean()))
    return step, _unknown(told)


def _alone(told: Explanation) -> bool:
    """Whether one cause does all that is left, and the same all along the log, though that is little."""
    return told.predicted >= PREDICTED and max(told.effect) > LEAST


def _known_by(step: OneStep, told: Explanation) -> OneStep:
    """The test with causes that are known: what they make of the equations is what these leave.

    Part of that is like what an integrator leaves, and was taken off with it.
    """
    left = step.residual
    there = replace(left, size=np.array(told.effect) * left.scale, spent=told.work)
    return replace(step, found=lambda: there, clear=step.clear if step.significant.any() else NAMED)


def _in_a_part(
    mechanism: Mechanism, log: Log, step: OneStep, tolerance: float, deadline: Deadline
) -> list[Finding]:
    """Causes of what begins at some time of a log, or ends there: a load that drops, a motor that fails."""
    if step.closes:  # before its residual is asked for
        return []
    out = np.flatnonzero(step.standing_out)
    if not len(out) or deadline.passed("a cause in a part of the log"):
        return []
    t = step.local.t
    first, last, count = int(out[0]), int(out[-1]), len(t)
    if len(out) < MOSTLY * (last - first + 1) or (last - first + 1) > (1.0 - QUIET) * count:
        return []
    begins, ends = first >= QUIET * count, last < (1.0 - QUIET) * count
    if begins == ends:
        return []
    edge = float(t[first if begins else last])
    run = log.consecutive
    beside = BESIDE * float(np.median(np.diff(run.t)))
    part = run.between(edge + beside, run.t[-1]) if begins else run.between(run.t[0], edge - beside)
    there = one_step(mechanism, part, _late(log)) if len(part) >= LEAST_ROWS else None
    if there is None or not there.significant.any():
        return []
    pair = known_but_for_one(mechanism, part, there, deadline.part(FIRST))
    if pair is not None:
        causes = _weighed(pair[1], pair[0], tolerance)
    else:
        whole = replace(log, run=part, consecutive=part)
        causes = _of_steps(mechanism, whole, there, tolerance, deadline, untold)[1]
    when = f"from t = {edge:.4g} s on" if begins else f"until t = {edge:.4g} s"
    rest = "before" if begins else "afterwards"
    return [
        replace(f, what=f"{when}: {f.what}", evidence=f"{f.evidence}; {rest}, the equations hold")
        for f in causes
        if f.kind in PREFERENCE
    ]


def _now_and_then(log: Log, step: OneStep) -> list[Finding]:
    """A force that is missing in a few steps, where a known integrator closes most of the others to rounding.

    Those in which coordinates jump as well are not such.
    """
    if not step.closes_mostly:
        return []
    t, times = log.consecutive.t, step.local.t
    out = times[_at_times(log, step)]
    jumped = np.unique(
        np.concatenate([t[c.start[c.outliers]] for c in log.comparisons.values()] or [t[:0]])
    )
    beside = 2.0 * float(np.median(np.diff(t)))
    near = np.abs(out[:, None] - jumped[None, :]).min(axis=1, initial=np.inf) < beside
    share = len(out) / max(len(times), 1)
    if (~near).sum() < FEWEST or share > SHORT or near.mean() > SHORT:
        return []
    return _missing(step, share)


def _hold(terms: EquationTerms) -> bool:
    """Whether measured accelerations close the equations at every sample."""
    return not terms.significant.any() and float(terms.relative.max(initial=0.0)) <= LEAST


def _isolated(step: OneStep) -> bool:
    """Whether the windows that stand out are single steps, as of impacts."""
    out = step.standing_out
    return bool(out.any() and not (out[1:] & out[:-1]).any())


def _at_times(log: Log, step: OneStep) -> NDArray[np.bool_]:
    """Windows that stand out now and then, but for those beside a change of forces that are held.

    What stands out there may be that force, which the log may hold a few rows early or late; but not if it is
    far more than forces ever change by.
    """
    run, local = log.consecutive, step.now_and_then
    columns = [np.asarray(force).reshape(len(run), -1) for force in run.forces.values()]
    forces = stairs(np.hstack([np.zeros((len(run), 0)), *columns]))
    if forces.held:
        near = BESIDE * float(np.median(np.diff(run.t)))
        changes = run.t[1:][~forces.known]
        away = np.abs(step.local.t[:, None] - changes).min(axis=1) > near
        most = np.abs(np.diff(sum(run.forces.values()), axis=0)).max(axis=0)
        speeds = [run.speeds.index(name) for name in step.speeds]
        far = np.abs(step.local.forces) > NOT_OF_FORCES * most[speeds]
        local = local & (away | np.any(far, axis=1))
    if not run.forces or not local.any():
        return local
    # Within a step a contact may begin, end, or slip the other way, and a motor may be switched.
    speeds = [run.speeds.index(name) for name in step.speeds]
    touching = (np.abs(f) for name, f in run.forces.items() if name.kind in TOUCHING)
    acting = sum(touching, start=np.zeros_like(run.u))[:, speeds]
    total = sum(run.forces.values(), start=np.zeros_like(run.u))[:, speeds]
    changes = np.abs(np.diff(total, axis=0, prepend=total[:1]))
    switched = np.where(changes > SWITCHED * np.median(changes, axis=0), changes, 0.0)
    of_few = [len(np.unique(column)) <= LEVELS for column in total.T]  # on and off, at any time
    switched = np.where(of_few, np.ptp(total, axis=0), switched)
    at = np.clip(np.searchsorted(run.t, step.local.t), 1, len(run) - 1)
    nearby = np.clip(at[:, None] + np.arange(-2, 2), 0, len(run) - 1)
    most = np.maximum(acting, switched)[nearby].max(axis=1)
    left = np.abs(step.local.forces)
    share = left / np.maximum(step.residual.scale, 1e-300)
    far = left > NOT_OF_FORCES * most + step.local.allowed
    far &= share > MATERIAL * share.max(
        axis=1, keepdims=True
    )  # and no trace of it in another equation
    return np.asarray(local & np.any(far, axis=1))


def _unknown(told: Explanation | None) -> list[Finding]:
    """Whether what no known cause explains is like a mistake: it does the same in all parts of a log."""
    predicted = told.predicted if told is not None else 0.0
    if predicted >= REPRODUCED:
        return []
    return [
        Finding(
            "not-reproducible",
            "what the equations leave in one part of the log does not tell what they leave in another",
            f"three quarters of the log predict {percent(predicted)} of what the rest leaves, by all terms "
            "that the equations may have",
            "Look for noise, filters, delays and forces that the log does not hold, and log without them",
        )
    ]


def _weighed(causes: Iterable[Finding], step: OneStep, tolerance: float) -> list[Finding]:
    """Causes of a mistake below the tolerance, which is real but small, are told as notes."""
    weight: Weight = "cause" if beyond(step, tolerance) else "note"
    return [replace(f, weight=weight) for f in causes]


def beyond(step: OneStep, tolerance: float) -> bool:
    """Whether what the one-step test leaves of an equation is more than the tolerance allows."""
    return bool(
        step.significant.any() and step.residual.relative[step.significant].max() > tolerance
    )


def _missing(step: OneStep, share: float) -> list[Finding]:
    active, left = step.standing_out, step.local
    worst = np.abs(left.forces[active]).max(axis=0)
    k = int(np.argmax(worst / np.maximum(step.residual.scale, 1e-300)))
    when = ", ".join(f"{t:.4g}" for t in left.t[active][:3])
    return [
        Finding(
            "missing-contact",
            "a force is missing from time to time, such as that of a contact, a joint limit or an impact, "
            "which is not in the log",
            f"in {percent(share)} of the steps the next row does not follow from the previous one (near t = "
            f"{when} s): up to {worst[k]:.3g} at {step.speeds[k]!r} are missing",
            "Log the forces of all contacts and limits",
            "cause",
            step.speeds[k],
        )
    ]
