"""Checks of a log against a model, one function each; each returns its findings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.measurements.digits import scatter
from deltac.diagnosis.measurements.kinematics import trusted
from deltac.diagnosis.verdict import Finding, Weight
from deltac.energy import Ledger
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.laws import at_times
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory, suspicions
from deltac.trajectories.columns import MechanismNames

if TYPE_CHECKING:
    from deltac.importers import ImportReport


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
