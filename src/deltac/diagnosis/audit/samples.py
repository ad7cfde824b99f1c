"""The equations of motion at the samples of a log, by the accelerations that it holds.

Measured accelerations are believed as far as the speeds bear them out. What the equations leave with them is
a mistake of the model, a force that the log lacks, or columns that belong to other rows.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.calls.progress import Deadline, Progress
from deltac.diagnosis.audit import conventions
from deltac.diagnosis.audit.reading import Known, Reference
from deltac.diagnosis.explain.explain import EXPLAINS, explanation
from deltac.diagnosis.explain.regression import LEAST_ROWS
from deltac.diagnosis.explain.result import Explanation
from deltac.diagnosis.explain.search import MOST
from deltac.diagnosis.inputs.logs import Log
from deltac.diagnosis.measurements.kinematics import Accelerations, accelerations, trusted
from deltac.diagnosis.residuals.at_samples import (
    CLEAR,
    EquationTerms,
    Sampled,
    equation_terms,
    total,
)
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.residuals.rows import ramped, trimmed
from deltac.diagnosis.verdict import Finding, percent
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError, listed
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scene import Constraint
from deltac.trajectories import Trajectory

AGREE = 4.0
"""How many times its disagreement with the speeds a residual of measured accelerations must be."""

STEP_BARS = 2.5
"""How many error bars of the one-step test it must be besides."""

EXACT = 1.0 - 1e-6
"""Share of the squared residual that an explanation must reach where the residual comes and goes."""

FEW = 3
"""Causes together that such a residual may have."""

FIRST = 0.4
"""Share of the time left that a search for causes may take before others get theirs."""

REPRODUCED = 0.75
"""Share of what is left that parts of a log must predict of the others for a mistake without a name."""

EXPLAINED = 0.05
"""What other rows' forces or accelerations may leave of a residual that they explain."""

REACH, SHARE = 3, 1.5
"""Rows from which a logged force may be, and the largest share that each may have in it."""

PASSIVE = ("spring", "damper")
"""Kinds that a simulator takes from its model alone: active there, they belong in ours."""

LEFT = 1e-6
"""Share of the squared residual that forces along the rows of equalities may leave."""

RANK = 1e-9
"""Smallest singular value of these rows that counts, as a share of the largest."""

MISSING_NOW_AND_THEN = (
    "a force that acts from time to time, such as a contact, a joint limit or an impact, is missing from the "
    "log"
)

# --- which accelerations are believed --------------------------------------------------------------------


def believed(
    reference: Reference, known: Known, log: Log, step: OneStep | None
) -> tuple[EquationTerms | None, list[Finding]]:
    """The equations at the samples, where accelerations are the rates of the speeds; else None, and why."""
    terms = equation_terms(reference.mechanism, log.run)
    if known.given:
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
    left, proven = bool(terms.significant.any()), step is not None and step.closes
    if not (terms.doubtful.any() or (proven and left)):
        return terms, []
    kept = terms if left and not proven else None
    return kept, [_not_of_this_row(terms, told, disagreement)]


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
        f"the difference amounts to {percent(share)} of the terms of {terms.speeds[k]!r}"
        + (late if abs(told.late) > 0.05 else ""),
        "The speeds are used instead to test the equations. Log accelerations of the same state, unfiltered",
        element=terms.speeds[k],
    )


# --- what they say ---------------------------------------------------------------------------------------


def at_samples(
    reference: Reference,
    log: Log,
    terms: EquationTerms,
    *,
    doubted: bool,
    deadline: Deadline,
    progress: Progress,
) -> list[Finding]:
    """Findings of the equations of motion at the samples; a stale or misread log explains nothing."""
    mechanism, run = reference.mechanism, log.consecutive
    if doubted:
        return blame(terms)
    if not terms.significant.any():
        return differing_channels(reference, log, terms)
    nearby = terms if run is log.run else equation_terms(mechanism, run)
    stale = stale_stage(mechanism, run, nearby)
    if not stale and (other := conventions.units(mechanism, run)):
        stale = [other]
    if stale:
        return stale + blame(terms)
    if not trusted(run) and (elsewhere := forces_of_other_rows(mechanism, run, nearby)):
        return elsewhere
    now_and_then = intermittent(terms, run, reference.tolerance)
    told = _explained(mechanism, run, deadline.part(FIRST), progress, bool(now_and_then))
    simple = list(told.findings) if told else []
    if not trusted(run) and terms.relative[terms.significant].max() <= reference.tolerance:
        simple = [replace(f, weight="note") for f in simple]  # real, but small
    certain, possible = withheld_equalities(reference, log.run, terms)
    known = certain or simple or now_and_then or possible
    unknown = [] if known or trusted(run) else not_reproducible(told)
    return differing_channels(reference, log, terms) + (known or unknown) + blame(terms)


def _explained(
    mechanism: Mechanism,
    run: Trajectory,
    deadline: Deadline,
    progress: Progress,
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


def not_reproducible(told: Explanation | None) -> list[Finding]:
    """Whether what no known cause explains is unlike a mistake, which does the same in all parts of a log."""
    predicted = told.predicted if told is not None else 0.0
    if predicted >= REPRODUCED:
        return []
    return [
        Finding(
            "not-reproducible",
            "what the equations leave in one part of the log does not predict what they leave in another",
            f"with all terms that equations may have, three quarters of the log predict {percent(predicted)} "
            "of what the rest leaves",
            "Look for noise, filters, delays and forces that the log does not hold, and log without them",
        )
    ]


def blame(terms: EquationTerms) -> list[Finding]:
    """The speeds whose equations do not close, largest first."""
    order = [int(k) for k in np.argsort(-terms.relative) if terms.significant[k]]
    if not order:
        return []
    units = {e.name: e.unit for e in terms.evaluator.mechanism.speeds}
    shown = ", ".join(
        f"{terms.speeds[k]} {terms.size[k]:.3g} {'N' if units[terms.speeds[k]] == 'm/s' else 'N·m'} "
        f"({percent(terms.relative[k])} of its terms)"
        for k in order[:4]
    )
    return [
        Finding(
            "residual",
            f"the equations of motion do not hold for {len(order)} of {len(terms.speeds)} speeds",
            f"root mean square of F_r + F*_r: {shown}{', …' if len(order) > 4 else ''}",
            "Look for the error at these joints and the bodies that they carry",
            "note",
            terms.speeds[order[0]],
        )
    ]


# --- columns of other rows, forces that are missing now and then -----------------------------------------


def stale_stage(mechanism: Mechanism, run: Trajectory, terms: EquationTerms) -> list[Finding]:
    """Forces or accelerations that belong to the row before: then shifting them closes the equations."""
    rows = terms.rows[terms.rows < len(run) - 1]
    if not terms.significant.any() or len(rows) < 4:
        return []
    evaluator = terms.evaluator
    everything = Sampled.of(mechanism, run, evaluator.log)
    here, after = everything.take(rows), everything.take(rows + 1)
    # Of the same rows: where a motion runs away, the last one alone outweighs all others.
    size = _size(terms, terms.residual[terms.rows < len(run) - 1])
    for what, udot, logged in (
        ("forces", here.udot, after.logged),
        ("accelerations", after.udot, here.logged),
        ("forces and accelerations", after.udot, after.logged),
    ):
        moved = Sampled(here.t, here.q, here.u, udot, logged)
        left = _size(terms, total(evaluator(moved)))
        if left < EXPLAINED * size:
            return [
                Finding(
                    "stale-stage",
                    f"the log's {what} are one row old: each belongs to the state of the row before",
                    f"shifted by one row, they leave {left / size:.2g} of the residual of the equations",
                    "Log them with the state that they belong to: after a step most engines hold new "
                    "positions beside old forces. deltac.record_mujoco takes care of that",
                    "doubt",
                    what,
                )
            ]
    return []


def forces_of_other_rows(
    mechanism: Mechanism, run: Trajectory, terms: EquationTerms
) -> list[Finding]:
    """Forces averaged, interpolated, held or delayed: those of rows nearby close the equations.

    One combination of rows for all forces, with shares no larger than `SHARE`: what is proportional to a
    force itself, as a wrong gear is, cannot be put together from its changes so.
    """
    rows = terms.rows[(terms.rows >= REACH) & (terms.rows < len(run) - REACH)]
    if not terms.significant.any() or not run.forces or len(rows) < 8 * REACH:
        return []
    from scipy.optimize import lsq_linear

    evaluator = terms.evaluator
    everything = Sampled.of(mechanism, run, evaluator.log)
    here = everything.take(rows)
    residual = total(evaluator(here))
    others = [everything.logged[rows + k] for k in range(-REACH, REACH + 1) if k]
    others.append(ramped(everything.logged)[rows])
    columns = [total(evaluator(replace(here, logged=f))) - residual for f in others]
    X = np.column_stack([terms.weighted(c).ravel() for c in columns])
    r = terms.weighted(residual).ravel()
    shares = lsq_linear(X, -r, (-SHARE, SHARE)).x
    left = float(np.linalg.norm(X @ shares + r) / np.linalg.norm(r))
    if left > EXPLAINED:
        return []
    late = float(shares[:-1] @ [-k for k in range(-REACH, REACH + 1) if k])
    return [
        Finding(
            "forces-not-of-this-row",
            "the logged forces belong to neighbouring rows: they were averaged, interpolated, held or "
            "delayed",
            f"a combination of up to {REACH} rows on either side leaves {left:.2g} of the residual; the "
            f"forces acted about {abs(late):.2g} rows {'later' if late > 0 else 'earlier'}",
            "The equations are judged from row to row. Log the force that acts in each state",
        )
    ]


def _size(terms: EquationTerms, residual: Array) -> float:
    return float(np.sqrt(np.mean(terms.weighted(residual) ** 2)))


def intermittent(terms: EquationTerms, run: Trajectory, tolerance: float) -> list[Finding]:
    """A residual that is there only now and then: a contact, limit or impact that nobody logged.

    One below the tolerance is a note: constraint solvers leave that much.
    """
    each = np.abs(terms.weighted(terms.residual)).max(axis=1)
    quiet_below = max(
        1e-4 * float(each.max()), CLEAR * float(terms.weighted(terms.precision).max())
    )
    active = each > quiet_below
    share = float(active.mean())
    upward = upward_push(terms.evaluator.mechanism, terms.speeds, terms.residual)
    if (share > 0.95 or (~active).sum() < 5) and not upward:
        return []
    when = _intervals(terms.t, active)
    logged = listed(repr(name) for name in run.forces if name.kind in ("contact", "limit"))
    return [
        Finding(
            "missing-contact",
            MISSING_NOW_AND_THEN
            if share <= 0.95
            else "a force that only pushes against gravity, such as a contact, is missing from the log",
            f"the equations of motion do not hold in {100 * share:.3g} % of the samples ({when})"
            + ("; what is missing pushes upward on the floating base" if upward else ""),
            f"Log the forces of all contacts and limits; the log has {logged or 'none'}",
            "cause" if float(terms.relative.max()) > tolerance else "note",
        )
    ]


def upward_push(mechanism: Mechanism, speeds: Sequence[str], residual: Array) -> bool:
    """Whether what is missing of a free root body (T, n) always pushes against gravity."""
    g = np.array([mechanism.number(x) for x in mechanism.gravity])
    if not g.any():
        return False
    for joint in mechanism.joints:
        if joint.kind != "free" or joint.parent != "ground" or joint.prescribed:
            continue
        places = [speeds.index(f"{joint.name}.v{c}") for c in "xyz"]
        push = residual[:, places] @ (g / np.linalg.norm(g))  # the missing force is −residual
        if np.sum(push > 0) and float(np.sum(push[push < 0] ** 2)) < 1e-3 * float(np.sum(push**2)):
            side = residual[:, places] - push[:, None] * g / np.linalg.norm(g)
            if float(np.sum(side**2)) < 2.0 * float(np.sum(push**2)):
                return True
    return False


def _intervals(t: Array, active: NDArray[np.bool_]) -> str:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(int)))
    spans = [(t[a], t[b - 1]) for a, b in zip(edges[::2], edges[1::2])]
    shown = ", ".join(f"{a:.4g} to {b:.4g} s" for a, b in spans[:3])
    return shown + (f", and {len(spans) - 3} more times" if len(spans) > 3 else "")


# --- channels --------------------------------------------------------------------------------------------


def differing_channels(reference: Reference, log: Log, terms: EquationTerms) -> list[Finding]:
    """Logged forces that are not the model's own, where that moves more energy than the tolerance."""
    found: list[Finding] = []
    report, ledger = reference.import_report, log.ledger
    left_to_log = " ".join(str(r) for r in report.ignored) if report else ""
    for name, logged in terms.forces.items():
        own = terms.own.get(name)
        passive = name.kind in PASSIVE and f"'{name}'" not in left_to_log
        if ledger.basis.get(name) != "measured" or (own is None and not passive):
            continue
        power = np.einsum("ij,ij->i", terms.u, logged - (0.0 if own is None else own))
        energy = float(np.trapezoid(np.abs(power), terms.t))
        if energy > reference.tolerance * ledger.energy_exchanged:
            found.append(_difference(name, own, logged, energy, ledger.energy_exchanged))
    return found


def unaccelerated_terms(mechanism: Mechanism, run: Trajectory) -> EquationTerms:
    """The terms of a log without accelerations: forces that are not the model's need none to be seen."""
    return equation_terms(mechanism, replace(run, udot=np.zeros_like(run.u), events=()))


def _difference(
    name: ChannelName, own: Array | None, logged: Array, energy: float, energy_exchanged: float
) -> Finding:
    share = percent(energy / energy_exchanged)
    moved = f"{energy:.3g} J flowed through the difference, {share} of the energy exchanged"
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


def withheld_equalities(
    reference: Reference, run: Trajectory, terms: EquationTerms
) -> tuple[list[Finding], list[Finding]]:
    """Findings (certain, possible) of equalities left to the log that would explain the residual.

    A force of constraint is Gᵀλ. Where the rows G span all speeds anything is such a force, and the
    finding is a mere possibility.
    """
    report = reference.import_report
    absent = (
        [c for c in report.equalities if f"constraint {c.name}" not in run.forces] if report else []
    )
    groups = [[c] for c in absent] + ([absent] if len(absent) > 1 else [])
    for group in groups:
        G = _jacobians(reference.mechanism, group, terms)
        if G is None:
            continue
        left, rank = _unexplained(G, terms)
        if left <= LEFT:
            found = [_finding(c, left, len(group)) for c in group]
            return (found, []) if rank < len(terms.speeds) else ([], found)
    return [], []


def _jacobians(
    mechanism: Mechanism, constraints: Sequence[Constraint], terms: EquationTerms
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
    values = np.array(function.map(len(terms.t))(terms.t[None, :], terms.q.T)).T
    return values.reshape(len(terms.t), G.shape[0], G.shape[1])


def _unexplained(G: Array, terms: EquationTerms) -> tuple[float, int]:
    """Share of the squared residual that no forces along G explain, and the rank of G."""
    weight = np.divide(1.0, terms.scale, out=np.zeros_like(terms.scale), where=terms.scale > 0)
    r = terms.weighted(terms.residual)
    U, singular, _ = np.linalg.svd(np.swapaxes(G * weight, 1, 2), full_matrices=False)
    real = singular > RANK * singular.max(initial=0.0)
    U = U * real[:, None, :]
    along = np.einsum("tij,tj->ti", U, np.einsum("tij,ti->tj", U, r))
    share = float(np.sum((r - along) ** 2) / np.sum(r**2))
    return share, int(real.sum(axis=1).max(initial=0))


def _finding(constraint: Constraint, left: float, together: int) -> Finding:
    name = constraint.name
    return Finding(
        "missing-equality",
        f"the force of equality constraint {name!r} is missing: the model's file has it, the log does not",
        f"forces along its Jacobian{' and the others' if together > 1 else ''} explain all but {left:.1g} "
        "of the squared residual of the equations of motion",
        f"Log its force in channel 'constraint {name}', or read the model with equality=\"constraints\"",
        "cause",
        f"constraint {name}",
    )
