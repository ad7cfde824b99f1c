"""Checks of a log against a model, one function each; each returns its findings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.measurements.digits import scatter
from deltac.diagnosis.measurements.kinematics import trusted
from deltac.diagnosis.residuals.at_samples import (
    CLEAR,
    EquationTerms,
    Sampled,
    total,
)
from deltac.diagnosis.residuals.rows import ramped
from deltac.diagnosis.verdict import Finding, Weight, percent
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.energy import Ledger
from deltac.errors import InputError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.laws import at_times
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scene import Constraint
from deltac.trajectories import Trajectory, suspicions
from deltac.trajectories.columns import MechanismNames

if TYPE_CHECKING:
    from deltac.importers import ImportReport


PASSIVE = ("spring", "damper")
"""Kinds that a simulator takes from its model alone: active there, they belong in ours."""


def differing_channels(
    terms: EquationTerms, ledger: Ledger, tolerance: float, import_report: ImportReport | None
) -> list[Finding]:
    """Logged forces that are not the model's own, where that moves more energy than the tolerance."""
    found: list[Finding] = []
    told = " ".join(str(r) for r in import_report.ignored) if import_report else ""
    for name, logged in terms.forces.items():
        kind = name.kind
        own = terms.own.get(name)
        if ledger.basis.get(name) != "measured" or (own is None and kind not in PASSIVE):
            continue
        if own is None and f"'{name}'" in told:
            continue  # the importer said that it left this to the log
        difference = logged - (own if own is not None else 0.0)
        energy = _moved(terms, difference)
        if energy <= tolerance * ledger.energy_exchanged:
            continue
        found.append(_difference(name, own, logged, energy, ledger.energy_exchanged))
    return found


def _difference(
    name: str, own: Array | None, logged: Array, energy: float, energy_exchanged: float
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
    factor = float(np.sum(own * logged) / np.sum(own * own))
    rest = float(np.sum((logged - factor * own) ** 2) / np.sum((logged - own) ** 2))
    error = float(np.sqrt(np.sum((logged - factor * own) ** 2) / np.sum(own * own) / len(own)))
    simple = rest < 0.1
    return Finding(
        "channel-differs",
        f"the logged force of {name!r} is "
        + (f"{factor:.5g} times the model's" if simple else "not the model's"),
        moved,
        "Give the model the parameters that the simulator used",
        "cause",
        name,
        factor if simple else None,
        error if simple else None,
    )


def _moved(terms: EquationTerms, force: Array) -> float:
    """∫|power| dt of a generalized force of the free speeds, J."""
    power = np.einsum("ij,ij->i", terms.u, force)
    return float(np.trapezoid(np.abs(power), terms.t)) if len(terms.t) > 1 else 0.0


EXPLAINED = 0.05
"""What other rows' forces or accelerations may leave of a residual that they explain."""


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


REACH, SHARE = 3, 1.5
"""Rows from which a logged force may be, and the largest share that each may have in it."""


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
    if not terms.significant.any():
        return []
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
    logged = [name for name in run.forces if name.kind in ("contact", "limit")]
    return [
        Finding(
            "missing-contact",
            (
                "a force is missing from time to time, such as that of a contact, a joint limit or an impact,"
                if share <= 0.95
                else "a force that only pushes against gravity is missing, such as that of a contact,"
            )
            + " which is not in the log",
            f"the equations of motion do not hold in {100 * share:.3g} % of the samples ({when})"
            + ("; what is missing pushes upward on the floating base" if upward else ""),
            "Log the forces of all contacts and limits"
            + (f"; the log has {', '.join(map(repr, logged[:5]))}" if logged else "; it has none"),
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


def _by_law(
    mechanism: Mechanism,
    run: Trajectory,
    what: str,
    element: str,
    own: Array,
    allowed: float,
) -> bool:
    """Whether a prescribed joint follows its law by times that are counted from the first row."""
    entries = mechanism.coordinates if what == "coordinate" else mechanism.speeds
    kind = "q" if what == "coordinate" else "u"
    laws = MechanismNames.of(mechanism).laws
    names = [f"{kind}.{entry.name}" for entry in entries[entries.of(element)]]
    told = [at_times(laws[name], run.t - run.t[0]) for name in names if name in laws]
    return len(told) == own.shape[1] and bool(
        np.all(np.abs(np.column_stack(told) - own) <= allowed)
    )


def violations(
    mechanism: Mechanism, run: Trajectory, ledger: Ledger, tolerance: float
) -> list[Finding]:
    """Prescribed joints that departed from their laws, constraints and quaternions that were violated."""
    found: list[Finding] = []
    for name, values in ledger.violation.items():
        what, _, element = name.partition(" ")
        worst, when = float(values.max()), float(ledger.t[int(values.argmax())])
        evidence = f"by up to {worst:.3g}, at t = {when:.4g} s"
        if what in ("coordinate", "speed"):
            column = run.q if what == "coordinate" else run.u
            entries = mechanism.coordinates if what == "coordinate" else mechanism.speeds
            own = column[:, entries.of(element)]
            span = float(np.abs(own).max(initial=0.0))
            digits = 2.0 * float(scatter(own).max(initial=0.0))  # which the log may depart by
            if worst > 1e-9 * max(span, 1.0) + digits:
                allowed = tolerance * span + 4.0 * digits
                grave: Weight = "cause" if worst > allowed else "note"
                remedy = "Give the model the motion that was actually imposed"
                start = float(run.t[0])
                if (
                    grave == "cause"
                    and start
                    and _by_law(mechanism, run, what, element, own, allowed)
                ):
                    evidence += f"; it follows it at t − {start:.9g} s"
                    remedy = (
                        f"The times of the log are not those of the model: subtract {start:.9g} s"
                    )
                found.append(
                    Finding(
                        "prescribed-departs",
                        f"the {what} of prescribed joint {element!r} departs from its law",
                        evidence,
                        remedy,
                        grave,
                        element,
                    )
                )
        elif what == "quaternion" and worst > 1e-6:
            found.append(
                Finding(
                    "quaternion-norm",
                    f"the quaternion of joint {element!r} is not of unit length",
                    evidence,
                    "Normalise it; orientations are read from q/|q|",
                    "doubt" if worst > 0.05 else "note",
                    element,
                )
            )
        elif what in ("position", "velocity") and worst > 1e-6 + _digits(run, what):
            moved = np.ptp(run.q, axis=0) if what == "position" else np.abs(run.u)
            large = worst > tolerance * float(moved.max(initial=0.0)) + 4.0 * _digits(run, what)
            along = _follows(run, ledger.t, values) if what == "position" else ""
            drifted = float(values[0]) < 0.5 * worst and not along
            how = ", increasingly" if drifted else ", from the start"
            if along:
                evidence += f"; in proportion to {along!r}, as with a wrong ratio and unlike drift"
            found.append(
                Finding(
                    "constraint-drift" if drifted else "constraint-violation",
                    f"constraint {element!r} is violated at {what} level{'' if along else how}",
                    evidence,
                    "Use a projection or a smaller step, or log the constraint's force if it is soft"
                    if drifted
                    else "Check the constraint's geometry in the model, and offsets of logged coordinates",
                    "cause" if large else "note",
                    element,
                )
            )
    return found


def _digits(run: Trajectory, what: str) -> float:
    """What digits and noise of the log may violate a constraint by, about; m, rad or per second."""
    of_q = float(scatter(run.q).max(initial=0.0))
    if what == "position":
        return 4.0 * of_q
    return 4.0 * (
        float(scatter(run.u).max(initial=0.0)) + of_q * float(np.abs(run.u).max(initial=0.0))
    )


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


def assumed_zero(run: Trajectory, import_report: ImportReport | None) -> list[str]:
    """Channels that the importer left to the log and the log does not have.

    A recorder that tells which kinds of forces it looked for, and which of them acted, is believed.
    """
    if import_report is None:
        return []
    channels = re.findall(r"channel '([^']+)'", " ".join(str(r) for r in import_report.ignored))
    looked_for, acted = run.provenance.looked_for, run.provenance.acted
    missing: list[str] = []
    for name in dict.fromkeys(channels):
        generic = name.partition("<")[0]
        if ChannelName.parse(name).kind in looked_for and not any(
            a.startswith(generic) for a in acted
        ):
            continue
        if _by_speeds(run, ChannelName.parse(name).kind):
            continue
        if name not in run.forces and not (
            "<" in name and any(f.startswith(generic) for f in run.forces)
        ):
            missing.append("contact all" if name.startswith("contact <") else name)
    return missing


def _by_speeds(run: Trajectory, kind: str) -> bool:
    """Whether the log has the forces of a kind on each speed: then nothing of that kind is missing."""
    return all(f"{kind} {speed}" in run.forces for speed in run.speeds)


def assumed_zero_finding(missing: Sequence[str]) -> list[Finding]:
    """One finding for all, of the first actuator or equality, if there is one; the others are its equals.

    Contacts, limits and friction that never acted need not be logged.
    """
    if not missing:
        return []
    motors, equalities = (
        [name for name in missing if ChannelName.parse(name).kind == kind]
        for kind in ("actuator", "constraint")
    )
    number = "1 channel" if len(missing) == 1 else f"{len(missing)} channels"
    return [
        Finding(
            "assumed-zero",
            f"the log has no force for {number} of the model's file; taken as zero",
            ", ".join(map(repr, missing[:6])) + (", …" if len(missing) > 6 else ""),
            "If one of them acted, log it"
            + ("; of a MuJoCo model `replay` finds it from the controls" if motors else ""),
            "note",
            next(iter([*motors, *equalities]), ""),
            equals=tuple(("assumed-zero", name) for name in [*motors, *equalities][1:]),
        )
    ]


def unresolved_works(ledger: Ledger) -> list[Finding]:
    """One finding for all channels whose work is hardly known, with the error of the largest."""
    unknown = ledger.unresolved
    if not unknown:
        return []
    errors = {name: float(ledger.work_error[name].max()) for name in unknown}
    worst = max(unknown, key=lambda name: errors[name])
    number = "1 channel is" if len(unknown) == 1 else f"{len(unknown)} channels are"
    return [
        Finding(
            "work-unresolved",
            f"the work of {number} not resolved by the samples",
            ", ".join(f"{name!r} ± {errors[name]:.2g} J" for name in unknown[:6])
            + (", …" if len(unknown) > 6 else ""),
            "Log more samples; runs of deltac integrate the works together with the testing functions "
            "that they record (simulate(..., record=...))",
            "note",
            element=worst,
            error=errors[worst],
        )
    ]


def impacts_not_held(mechanism: Mechanism, run: Trajectory) -> list[Finding]:
    """A run of another program without events, of a model in which things hit each other."""
    names = [event.name for event in mechanism.events if event.impulsive]
    held = run.events or any(name.kind == "impact" for name in (*run.forces, *run.works))
    if not names or held or run.provenance.simulator == "deltac":
        return []
    return [
        Finding(
            "impacts",
            "the model has impacts, and the run does not say whether there were any",
            f"{', '.join(map(repr, names))} in the model; no events, no channel 'impact …' in the run",
            "Hand over the run with its events, or leave the impacts out of the model if nothing was hit",
            element=names[0],
        )
    ]


def suspicious_conventions(
    mechanism: Mechanism, run: Trajectory, known: list[Finding]
) -> list[Finding]:
    """What the log betrays of units and conventions: degrees, the order of quaternions, gaps.

    Of runs whose origin is known only what is certain is told. What a unit explains is taken out of
    `known`, and what `known` tells already is not told again.
    """
    found: list[Finding] = []
    told = {f.kind for f in known}
    for s in suspicions(run, mechanism):
        if s.kind == "rate" or (trusted(run) and not s.certain):
            continue
        if told & {"swapped-columns", "clipped-column"} and s.kind != "gap":
            continue
        doubtful = s.certain and s.kind != "gap"
        if doubtful:
            known[:] = [f for f in known if f.kind not in OF_RATES]
        found.append(
            Finding(
                s.kind.replace(" ", "-"),
                f"the log seems to contain {_SLIPS.get(s.kind, 'a slip: ' + s.kind)}",
                s.evidence,
                s.remedy[:1].upper() + s.remedy[1:],
                "doubt" if doubtful else "note",
            )
        )
    return found


OF_RATES = ("clock-scale", "gear-between-q-and-u", "speed-not-rate", "late-rows")
"""Findings of the kinematic test that a wrong unit or order makes too."""

_SLIPS = {
    "degrees": "degrees in place of radians",
    "turns": "turns in place of radians",
    "rpm": "turns per minute in place of radians per second",
    "millimetres": "millimetres in place of metres",
    "centimetres": "centimetres in place of metres",
    "time": "times in another unit than seconds",
    "sign": "a coordinate and its speed of opposite signs",
    "quaternion order": "quaternions stored scalar last (xyzw); scalar first (wxyz) is expected",
    "quaternion conjugate": "conjugated quaternions",
    "angular velocity frame": "an angular velocity in the parent's components",
    "velocity frame": "a velocity in body components",
    "gap": "a gap in time",
}


# --- equality constraints whose force the log does not hold --------------------------------------

LEFT = 1e-6
"""Share of the squared residual that forces along the rows may leave."""

RANK = 1e-9


def withheld_equalities(
    mechanism: Mechanism, run: Trajectory, terms: EquationTerms, import_report: ImportReport | None
) -> tuple[list[Finding], list[Finding]]:
    """Findings (certain, possible) of equalities left to the log that would explain the residual.

    A force of constraint is Gᵀλ. Where the rows G span all speeds anything is such a force, and the
    finding is a mere possibility.
    """
    if import_report is None or not terms.significant.any():
        return [], []
    absent = [c for c in import_report.equalities if f"constraint {c.name}" not in run.forces]
    groups = [[c] for c in absent] + ([absent] if len(absent) > 1 else [])
    for group in groups:
        G = _jacobians(mechanism, group, terms)
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
