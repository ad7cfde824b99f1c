"""Checks of a log against a model, one function each; each returns its findings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import SAME, SIX_DIGITS, Array
from deltac.calls.progress import TimeLimit
from deltac.codes import FINDINGS
from deltac.diagnosis.inference.hypotheses import autocorrelation_time
from deltac.diagnosis.inputs.channels import intolerable, through_difference
from deltac.diagnosis.inputs.logs import Log
from deltac.diagnosis.inputs.omissions import OF_RATES
from deltac.diagnosis.measurements.digits import scatter
from deltac.diagnosis.measurements.kinematics import trusted
from deltac.diagnosis.residuals.at_samples import MOST_SAMPLES, run_residual, stale_stage
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import some_rows
from deltac.diagnosis.verdict import Finding, Weight
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.energy import Ledger
from deltac.errors import InputError
from deltac.mechanism.channels import PASSIVE, ChannelName
from deltac.mechanism.laws import at_times
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scene import Constraint
from deltac.trajectories import Trajectory, suspicions
from deltac.trajectories.columns import MechanismNames

if TYPE_CHECKING:
    from deltac.diagnosis.inference.result import Inference
    from deltac.importers import ImportReport


def violations(
    mechanism: Mechanism, run: Trajectory, ledger: Ledger, tolerance: float
) -> list[Finding]:
    """Prescribed joints that departed from their laws, constraints and quaternions that were violated."""
    findings: list[Finding] = []
    for name, values in ledger.violation.items():
        what, _, element = name.partition(" ")
        k = int(values.argmax())
        worst, evidence = float(values[k]), f"by up to {values[k]:.3g}, at t = {ledger.t[k]:.4g} s"
        if what in ("coordinate", "speed"):
            findings += _departure(mechanism, run, what, element, worst, evidence, tolerance)
        elif what in ("position", "velocity") and worst > 1e-6 + (digits := _digits(run, what)):
            along = _follows(run, ledger.t, values) if what == "position" else ""
            moved = np.ptp(run.q, axis=0) if what == "position" else np.abs(run.u)
            large = worst > tolerance * float(moved.max(initial=0.0)) + 4.0 * digits
            drifted = float(values[0]) < 0.5 * worst and not along
            how = "; it grows along the log" if drifted else "; it is there from the start"
            if along:
                how = f"; in proportion to {along!r}, as with a wrong ratio and unlike drift"
            remedy = (
                "Check the constraint's geometry in the model, and offsets of logged coordinates"
            )
            if drifted:
                remedy = "Use a projection or a smaller step, or log the constraint's force if it is soft"
            kind = "constraint-drift" if drifted else "constraint-violation"
            sentence = f"constraint {element!r} is violated at {what} level"
            weight: Weight = "cause" if large else "note"
            findings.append(Finding(kind, sentence, evidence + how, remedy, weight, element))
        elif what == "quaternion" and worst > 1e-6:
            findings.append(
                Finding(
                    "quaternion-norm",
                    f"the quaternion of joint {element!r} is not of unit length",
                    evidence,
                    "Normalise it; orientations are read from q/|q|",
                    "doubt" if worst > 0.05 else "note",
                    element,
                )
            )
    return findings


def _departure(
    mechanism: Mechanism,
    run: Trajectory,
    what: str,
    element: str,
    worst: float,
    evidence: str,
    tolerance: float,
) -> list[Finding]:
    """A prescribed joint that departs from its law; it may follow it by times counted from the first row."""
    position = what == "coordinate"
    entries = mechanism.coordinates if position else mechanism.speeds
    places = entries.of(element)
    own = (run.q if position else run.u)[:, places]
    span = float(np.abs(own).max(initial=0.0))
    digits = 2.0 * float(scatter(own).max(initial=0.0))  # which the log may depart by
    allowed = tolerance * span + 4.0 * digits
    if worst <= 1e-9 * max(span, 1.0) + digits:
        return []
    remedy, start = "Give the model the motion that was actually imposed", float(run.t[0])
    weight: Weight = "cause" if worst > allowed else "note"
    laws = MechanismNames.of(mechanism).laws
    names = [f"{'q' if position else 'u'}.{entry.name}" for entry in entries[places]]
    series = [partial(at_times, laws[name]) for name in names if name in laws]
    if worst > allowed and len(series) == own.shape[1]:
        shifted = np.column_stack([law(run.t - start) for law in series])
        if start and np.abs(shifted - own).max() <= allowed:
            evidence += f"; it follows the law at t − {start:.9g} s"
            remedy = f"The times of the log are not those of the model: subtract {start:.9g} s"
        elif (filtered := _filtered_law(run, series, own, allowed)) is not None:
            evidence += (
                "; it follows the law through a filter, {:.3g} s late and {:.3g} s wide".format(
                    *filtered
                )
            )
            remedy, weight = "Log it unfiltered", "note"
    return [
        Finding(
            "prescribed-departs",
            f"the {what} of prescribed joint {element!r} departs from its law",
            evidence,
            remedy,
            weight,
            element,
        )
    ]


def _filtered_law(
    run: Trajectory, series: Sequence[Callable[[Array], Array]], own: Array, allowed: float
) -> tuple[float, float] | None:
    """Delay and width (s) of a filter by which columns follow their laws; None where they follow by none.

    A filter of unit gain makes x + c₁ẋ + c₂ẍ + … of a law x, −c₁ its delay and 2c₂ − c₁² the square of its
    width: one that sharpens has another gain. One wider than `WIDEST_FILTER` rows is none of a log; its
    start and end are of their own.
    """
    step = float(np.median(np.diff(run.t)))
    inside = slice(len(run) // EDGE, len(run) - len(run) // EDGE)
    nodes = step * np.arange(-FILTER_MOMENTS, FILTER_MOMENTS + 1)
    inverse = np.linalg.inv(np.vander(nodes / step, increasing=True))
    derivatives = [
        np.tensordot(inverse, np.stack([law(run.t + s) for s in nodes]), 1) for law in series
    ]
    x = np.concatenate([d[: FILTER_MOMENTS + 1, inside] for d in derivatives], axis=1)
    gap = np.concatenate([y[inside] for y in own.T]) - x[0]
    moments, *_ = np.linalg.lstsq(x[1:].T, gap, rcond=1e-12)
    delay, square = -float(moments[0]), float(2.0 * moments[1] - moments[0] ** 2)
    width = float(np.sqrt(max(square, 0.0)))
    rest = (gap - moments @ x[1:]).reshape(own.shape[1], -1).T
    # Noise that went through the filter keeps no time with the law.
    noise = autocorrelation_time(rest) < SOON * autocorrelation_time(own[inside])
    followed = np.abs(rest).max() <= (NOISE * np.abs(own).max() if noise else allowed)
    smooths = square > -1.0 and max(abs(delay), width) < WIDEST_FILTER
    return (delay * step, width * step) if followed and smooths else None


FILTER_MOMENTS, WIDEST_FILTER, EDGE = 4, 10.0, 20
"""Moments of a filter that are looked for, its largest delay and width, rows, and the share of a log at
either end in which it starts and ends: one in so many rows."""

SOON, NOISE = 0.25, 0.1
"""Autocorrelation time of noise in that of a law, and its size as a share of that, at most."""


def _digits(run: Trajectory, what: str) -> float:
    """What digits and noise of the log may violate a constraint by, about; m, rad or per second."""
    of_q, of_u = (float(scatter(x).max(initial=0.0)) for x in (run.q, run.u))
    fastest = float(np.abs(run.u).max(initial=0.0))
    return 4.0 * (of_q if what == "position" else of_u + of_q * fastest)


def _follows(run: Trajectory, t: Array, values: Array) -> str:
    """The coordinate that a violation is proportional to, where time explains it far less; "" if none is.

    `values` (k,) are those at `t`: all rows of the run, or those that the ledger kept.
    """
    rows = slice(None) if len(t) == len(run) else np.searchsorted(run.t, t)

    def left(x: Array) -> float:
        size = float(x @ x)
        rest = values - x * (float(x @ values) / size) if size > 0.0 else values
        return float(np.linalg.norm(rest))

    total, passed = float(np.linalg.norm(values)), t - t[0]
    by_time = min(left(passed), left(passed**2))
    for name, column in zip(run.coordinates, run.q[rows].T):
        by_column = min(left(np.abs(column)), left(np.abs(column - column[0])))
        if by_column < 0.05 * total and by_column < 0.2 * by_time:
            return name
    return ""


def with_conventions(
    mechanism: Mechanism, run: Trajectory, known: Sequence[Finding]
) -> list[Finding]:
    """What is known of a log, and what it betrays of units and conventions: degrees, quaternions, gaps.

    Of runs whose origin is known only what is certain is told. What a unit explains is taken out, and what
    is known already is not told again.
    """
    kinds, findings = {f.kind for f in known}, list(known)
    for s in suspicions(run, mechanism):
        gap = s.kind == "gap"
        explained = not gap and kinds & {"swapped-columns", "clipped-column"}
        if s.kind == "rate" or (trusted(run) and not s.certain) or explained:
            continue
        doubtful = s.certain and not gap
        if doubtful:
            findings = [f for f in findings if f.kind not in OF_RATES]
        kind, remedy = s.kind.replace(" ", "-"), s.remedy[:1].upper() + s.remedy[1:]
        weight: Weight = "doubt" if doubtful else "note"
        findings.append(Finding(kind, FINDINGS[kind], s.evidence, remedy, weight))
    return findings


# --- forces of the log against the model's -------------------------------------------------------


def own_laws(
    mechanism: Mechanism, run: Trajectory
) -> tuple[NDArray[np.intp], dict[ChannelName, Array]]:
    """Some rows of a run, and there the generalized forces (T, n) of the channels that the model computes."""
    rows, free, motion = (
        some_rows(run, MOST_SAMPLES),
        mechanism.free,
        equations_of_motion(mechanism),
    )
    columns = (run.q[np.ix_(rows, free.q)], run.u[np.ix_(rows, free.u)])
    lawless = {part.name for part in motion.channels if part.logged}
    forces = motion.forces(run.t[rows], *columns)
    return rows, {name: force for name, force in forces.items() if name not in lawless}


def differing_channels(
    mechanism: Mechanism, log: Log, report: ImportReport | None, tolerance: float
) -> list[Finding]:
    """Logged forces that are not the model's own, where that moves more energy than the tolerance.

    What a force adds to ΔC counts where the model lacks the channel or differs by a factor: other differences
    may be noise of the column, or a filter. What moves less is a note there.
    """
    run, ledger = log.run, log.ledger
    if not run.forces or not len(mechanism.free.u) or len(run) < 3:
        return []
    rows, of_model = own_laws(mechanism, run)
    t, u = run.t[rows], run.u[np.ix_(rows, mechanism.free.u)]
    findings: list[Finding] = []
    left_to_log = " ".join(str(r) for r in report.ignored) if report else ""
    for name, force in run.forces.items():
        logged = force[np.ix_(rows, mechanism.free.u)]
        own = of_model.get(name)
        passive = name.kind in PASSIVE and f"'{name}'" not in left_to_log
        # A force without a law is left to the log.
        lawless = own is None or not own.any()
        if ledger.basis.get(name) != "measured" or (lawless and not passive):
            continue
        power = np.einsum("ij,ij->i", u, logged - (0.0 if own is None else own))
        energy = float(np.trapezoid(np.abs(power), t))
        found = _difference(name, own, logged, energy, ledger.energy_exchanged)
        simple = own is None or found.factor is not None
        if energy > tolerance * ledger.energy_exchanged or (
            simple and intolerable(power, t, ledger, tolerance)
        ):
            findings.append(found)
        elif simple and energy > SIX_DIGITS * ledger.energy_exchanged:
            findings.append(replace(found, weight="note"))
    return findings


def stale_rows(mechanism: Mechanism, run: Trajectory) -> list[Finding]:
    """Forces or accelerations of the row before, in runs whose accelerations are the equations' own."""
    measured = trusted(run) and run.udot is not None and "udot" not in run.provenance.derived
    if not measured or not len(mechanism.free.u) or len(run) < 3:
        return []
    return stale_stage(run_residual(Kane(mechanism), run))


def _difference(
    name: ChannelName, own: Array | None, logged: Array, energy: float, energy_exchanged: float
) -> Finding:
    moved = through_difference(energy, energy_exchanged)
    if own is None or not own.any():
        return Finding(
            "channel-not-in-model",
            f"the log has an active channel {name!r} that the model does not have",
            moved,
            "Add it to the model: the ledger uses the logged force, but the model on its own would move "
            "differently",
            "cause",
            name,
        )
    size = np.sum(own**2)
    factor = float(np.sum(own * logged) / size)
    rest = float(np.sum((logged - factor * own) ** 2))
    simple = rest < 0.1 * float(np.sum((logged - own) ** 2))
    return Finding(
        "channel-differs",
        f"the logged force of {name!r} is "
        + (f"{factor:.5g} times the model's" if simple else "not the model's"),
        moved,
        "Give the model the parameters that the simulator used",
        "cause",
        name,
        factor if simple else None,
        float(np.sqrt(rest / size / len(own))) if simple else None,
    )


# --- equality constraints whose force the log does not hold ----------------------------------------------

LEFT = 1e-4
"""Share of a squared residual that forces of constraints leave of it, to first order in the step."""


def missing_equalities(
    mechanism: Mechanism, report: ImportReport | None, run: Trajectory, inference: Inference
) -> list[Finding]:
    """Equality constraints left to the log whose forces would explain the residual.

    A force of constraint is Gᵀλ. Where the rows G span all speeds anything is such a force: nothing is told.
    """
    absent = (
        [c for c in report.equalities if f"constraint {c.name}" not in run.forces] if report else []
    )
    groups = [[c] for c in absent] + ([absent] if len(absent) > 1 else [])
    whole = inference.model.n == len(mechanism.free.u)
    for group in groups if whole else ():
        G = _jacobians(mechanism, group, inference)
        if G is None:
            continue
        residual, rank = _unexplained(G, inference)
        if residual <= LEFT and rank < inference.model.n:
            return [_equality(c, residual, len(group)) for c in group]
    return []


def _jacobians(
    mechanism: Mechanism, constraints: Sequence[Constraint], inference: Inference
) -> Array | None:
    """G (T, rows, n) at the samples; None where the model cannot have these constraints."""
    try:
        tied = replace(mechanism, constraints=(*mechanism.constraints, *constraints))
    except InputError:
        return None
    motion = equations_of_motion(tied)
    system, rows = motion.system, motion.rows
    names = {c.name for c in constraints}
    G = rows.G[[k for k, name in enumerate(rows.names) if name in names], :]
    function = ca.Function("G", [system.t, system.q], [ca.densify(ca.vec(G.T))])
    at = inference.log.intervals.start
    values = np.array(function.map(len(at.t))(at.t[None, :], at.q.T)).T
    return values.reshape(len(at.t), G.shape[0], G.shape[1])


def _unexplained(G: Array, inference: Inference) -> tuple[float, int]:
    """Share of the squared residual forces that none along G explain, and the rank of G."""
    at, n = inference.log.intervals.start, inference.model.n
    M, _ = inference.model.matrices(at.t, at.q)
    force = np.einsum("tij,tj->ti", M, inference.w[:, n:] / inference.log.intervals.h)
    weight = 1.0 / np.sqrt(np.einsum("tii->ti", M).mean(axis=0))
    r = force * weight
    U, singular, _ = np.linalg.svd(np.swapaxes(G * weight, 1, 2), full_matrices=False)
    real = singular > SAME * singular.max(initial=0.0)
    U = U * real[:, None, :]
    along = np.einsum("tij,tj->ti", U, np.einsum("tij,ti->tj", U, r))
    share = float(np.sum((r - along) ** 2) / max(np.sum(r**2), 1e-300))
    return share, int(real.sum(axis=1).max(initial=0))


def _equality(constraint: Constraint, residual: float, together: int) -> Finding:
    name = constraint.name
    return Finding(
        "missing-equality",
        f"the force of equality constraint {name!r} is missing: the model's file has it, the log does not",
        f"forces along its Jacobian{' and the others' if together > 1 else ''} explain all but "
        f"{residual:.1g} of the squared residual of the equations of motion",
        f"Log its force in channel 'constraint {name}', or read the model with equality=\"constraints\"",
        "cause",
        f"constraint {name}",
    )


def left_out(limit: TimeLimit) -> list[Finding]:
    """What the audit could do without and did not begin, since its time had passed."""
    if not limit.skipped:
        return []
    return [
        Finding(
            "time-limit",
            f"the audit ended early and left out: {', '.join(limit.skipped)}",
            f"time limit {limit.seconds:g} s",
            "Raise time_limit (--time-limit), or audit a part of the log",
            "note",
        )
    ]
