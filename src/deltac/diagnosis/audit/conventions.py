"""Conventions in which log and model may differ: units, signs, zeros, the order of columns, absolute angles.

None of these shows in coordinates and speeds alone, which agree with each other in any of them; the equations
tell. Each is tried on some rows: one that is right takes nearly all away of what the equations leave. The
inference of the log, read so, must then leave less without any cause than that of the log as it is does with
its best causes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import SAME, SMALL_SHARE, Array
from deltac.diagnosis.inference.flow import runge_kutta
from deltac.diagnosis.inference.forces import FORCES
from deltac.diagnosis.inference.inference import infer, infer_alone
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.result import OF_THE_LOG, Inference
from deltac.diagnosis.residuals.at_samples import RunResidual, run_residual
from deltac.diagnosis.verdict import Finding, Weight
from deltac.energy.terms import LoggedForces
from deltac.errors import InputError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism
from deltac.results import percent
from deltac.simulation.stepping.runge_kutta import tableau_of
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import RateNames
from deltac.trajectories.lint import some_stretches

LARGE = 0.05
"""Share of the accelerations that the equations leave where conventions are asked for without a cause."""

LEFT_BY_RIGHT = 0.25
"""What the right one may leave of that: what the integrator did, and what forces did between the rows."""

STRETCHES_LOOKED_AT, ROWS_LOOKED_AT = 4, 100
"""Stretches of a log that are looked at, and their rows: fewer of many speeds."""

SHORTEST = 8
"""Rows of a log at least."""

READINGS = 3
"""Readings with the smallest residuals that are judged by all rows."""

MANY_COLUMNS = 8
"""Columns up to which any two may be exchanged; of more, neighbours."""

OTHER_UNITS = (
    ("degrees", "rad", 180.0 / np.pi),
    ("millimetres", "m", 1e3),
    ("centimetres", "m", 1e2),
)
"""Finding, unit of the model, how many of the other unit make one of it."""

PARALLEL = 1e-6
"""Sine of the angle between axes that are the same."""

OFFSETS = (np.pi, 0.5 * np.pi, -0.5 * np.pi)
"""Zeros of an angle that people choose: hanging, upright, along another axis."""

Forces: TypeAlias = Mapping[ChannelName, Array]


@dataclass(frozen=True, eq=False)
class Reading:
    """Another way to read a log.

    matrix  of the coordinates whose rates are speeds, of these, and of their rates (n, n): what is read of
            what is logged
    offset  what these coordinates are logged too large by (n,)
    forces  those that are read, by channel, of those that are logged
    weight  of the finding: whatever the log says of a joint, the model may be what is turned round
    """

    kind: str
    element: str
    what: str
    remedy: str
    matrix: Array | None = None
    offset: Array | float = 0.0
    forces: Callable[[Forces], Forces] = lambda forces: forces
    weight: Weight = "doubt"

    def changes(self, run: Trajectory) -> list[int]:
        """Speeds of a log that are read otherwise, or have coordinates that are; none for forces alone."""
        speeds = _rates(run)[:, 1]
        same = np.eye(len(speeds))
        matrix = same if self.matrix is None else self.matrix
        read = (matrix != same).any(axis=1) | (np.broadcast_to(self.offset, len(speeds)) != 0.0)
        return [int(k) for k in speeds[read]]

    def of(self, run: Trajectory) -> Trajectory:
        """The log, read so; its integrals are not."""
        places = _rates(run)

        def read(values: Array, at: NDArray[np.intp]) -> Array:
            columns = np.array(values)
            if self.matrix is not None:
                columns[:, at] = values[:, at] @ self.matrix.T
            return columns

        q, u = read(run.q, places[:, 0]), read(run.u, places[:, 1])
        q[:, places[:, 0]] -= self.offset
        udot = None if run.udot is None else read(run.udot, places[:, 1])
        forces = self.forces(run.forces)
        return replace(run, q=q, u=u, udot=udot, forces=forces, integrals={}, works={}, events=())


def _negated(forces: Forces) -> Forces:
    return {name: -force for name, force in forces.items()}


def _negated_at(speed: int, forces: Forces) -> Forces:
    """All forces with the other sign at one speed."""
    sign = np.where(np.arange(next(iter(forces.values())).shape[1]) == speed, -1.0, 1.0)
    return {name: sign * force for name, force in forces.items()}


def _exchanged(a: ChannelName, b: ChannelName, forces: Forces) -> Forces:
    """Two forces that act on a speed each, where the other one is logged."""

    def at(name: ChannelName, other: ChannelName) -> Array:
        return np.asarray((np.ptp(forces[name], axis=0) > 0.0) * forces[other].sum(axis=1)[:, None])

    return {**forces, a: at(a, b), b: at(b, a)}


def _rates(run: Trajectory) -> NDArray[np.intp]:
    """Places (n, 2) of coordinates and of the speeds that are their rates."""
    pairs = list(RateNames.of(run.coordinates, run.speeds).rates)
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Trial:
    """A log read by another convention, or a model with another axis.

    left  share of the accelerations that the equations then leave, in some of the rows
    """

    left: float
    mechanism: Mechanism
    run: Trajectory
    finding: Finding

    def without_causes(self) -> Inference | None:
        """The inference without causes."""
        return infer_alone(self.mechanism, self.run)

    def with_causes(self) -> Inference | None:
        """The inference with causes."""
        return infer(self.mechanism, self.run)


@dataclass(frozen=True, eq=False)
class Conventions:
    """The conventions in which a log and a model may differ.

    alone  the inference of the log as it is, without causes
    """

    mechanism: Mechanism
    run: Trajectory
    alone: Inference

    def without_causes(self) -> Finding | None:
        """The convention by which the residual all but vanishes without any cause; None for none."""
        if not _departs(self.alone):
            return None
        for trial in self._trials():
            other = trial.without_causes()
            if other is not None and _residual(other) <= SMALL_SHARE * _residual(self.alone):
                return trial.finding
        return None

    def rather_than(self, inference: Inference) -> Finding | None:
        """The convention that explains more than the causes of an inference, alone or beside others."""
        if not (_departs(inference) or inference.finds_something):
            return None
        built = any(c.edit is not None for c in inference.posterior.best.chosen)
        for trial in self._readings:
            if _closes(trial.without_causes(), inference):
                return trial.finding
        for trial in self._readings[:1]:  # a log that has a mistake too closes beside it
            if _closes(trial.with_causes(), inference):
                return trial.finding
        for trial in [] if built and inference.closes else self._axes:
            if _closes(trial.without_causes(), inference):
                return trial.finding
        return None

    def _trials(self) -> Iterator[Trial]:
        """Readings first: for each axis a model is built."""
        yield from self._readings
        yield from self._axes

    @cached_property
    def _part(self) -> Trajectory:
        """A few stretches of the log."""
        many = max(len(self.run.speeds), MANY_COLUMNS)
        rows = max(SHORTEST, ROWS_LOOKED_AT * MANY_COLUMNS // many)
        return some_stretches(self.run, STRETCHES_LOOKED_AT, rows)

    @cached_property
    def _was(self) -> float:
        """What the equations leave as logged."""
        return _left(LogModel(self.mechanism, self._part), self._part, self.alone)

    @cached_property
    def _readings(self) -> list[Trial]:
        """The readings that take nearly all away of what the equations leave, the best first."""
        mechanism, part, was = self.mechanism, self._part, self._was
        if len(self.run) < SHORTEST:
            return []
        readings = [*_units(mechanism, self.run), *_orders_and_signs(mechanism, self.run)]
        model = LogModel(mechanism, part)
        left = np.array(
            [
                _left(model, reading.of(part), self.alone, reading.changes(part))
                for reading in readings
            ]
        )
        # Of readings that explain as much, the model may be what is turned round: nothing contradicts itself.
        doubts = np.array([reading.weight == "doubt" for reading in readings])
        order = [
            int(k) for k in np.lexsort((doubts, _digits(left))) if left[k] < LEFT_BY_RIGHT * was
        ]
        trials = list[Trial]()
        for k in order[:READINGS]:
            alike = [readings[j] for j in order if j != k and left[j] < 2.0 * left[k]]
            told = _told(readings[k], alike, was, left[k])
            trials.append(Trial(float(left[k]), mechanism, readings[k].of(self.run), told))
        return trials

    @cached_property
    def _axes(self) -> list[Trial]:
        """The joint that turns or slides along another axis of its frame, if one takes as much away."""
        single = [j for j in self.mechanism.joints if len(j.axes) == 1]
        if len(single) > MANY_COLUMNS or len(self.run) < SHORTEST:
            return []
        trials = list[Trial]()
        for joint in single:
            for name, axis in zip("xyz", np.eye(3)):
                if np.linalg.norm(np.cross(axis, joint.axes[0])) < PARALLEL:
                    continue
                turned = replace(joint, axes=(tuple(axis.tolist()),))
                joints = tuple(turned if j is joint else j for j in self.mechanism.joints)
                with suppress(InputError):  # a body may have no inertia about that axis
                    other = replace(self.mechanism, joints=joints)
                    left = _left(LogModel(other, self._part), self._part, self.alone)
                    told = _along(joint, name, left, self._was)
                    trials.append(Trial(left, other, self.run, told))
        likely = (trial for trial in trials if trial.left < LEFT_BY_RIGHT * self._was)
        return sorted(likely, key=lambda trial: trial.left)[:1]


def _departs(inference: Inference) -> bool:
    return float(inference.relative[0].max()) > LARGE


def units(logged: RunResidual) -> list[Finding]:
    """Coordinates and their speeds both in another unit, in which the equations hold at the samples."""
    run, kane = logged.run, logged.test.kane
    readings = list(_units(kane.mechanism, run))
    closing = [r for r in readings if run_residual(kane, r.of(run)).largest == 0.0]
    return [_told(closing[0], closing[1:], logged.largest, 0.0)] if closing else []


def _digits(residuals: Array) -> Array:
    """Residuals to one digit and a half: of what is equal, rounding tells nothing."""
    return np.asarray(np.round(np.log10(np.maximum(residuals, SAME)), 1))


def _closes(other: Inference | None, inference: Inference) -> bool:
    """Whether a log read otherwise leaves as little without causes as with its best ones, or far less."""
    if other is None:
        return False
    right = not any(c.kind not in OF_THE_LOG for c in other.posterior.best.chosen)
    return _residual(other) <= (2.0 if right else 0.1) * _residual(inference)


def _residual(i: Inference) -> float:
    """Root mean square of the accelerations that are left."""
    return float(np.sqrt(np.mean((i.residual[:, i.model.n :] / i.log.intervals.h) ** 2)))


def _along(joint: Joint, name: str, left: float, was: float) -> Finding:
    return Finding(
        "joint-axis",
        f"in the run, joint {joint.name!r} moves along the {name} axis of its frame, not along "
        f"({', '.join(f'{x:.4g}' for x in joint.axes[0])})",
        f"with that axis, the equations leave {percent(left)} of the accelerations, else {percent(was)}",
        "Give the model the axis that the simulator used",
        "cause",
        joint.name,
    )


def _told(reading: Reading, alike: list[Reading], was: float, residual: float) -> Finding:
    others = "".join(f"; or {other.what}" for other in alike[:3])
    return Finding(
        reading.kind,
        f"in the log, {reading.what}{others}",
        f"read that way, the equations leave {percent(residual)} of the accelerations; as logged, "
        f"{percent(was)}",
        reading.remedy,
        reading.weight,
        reading.element,
        equals=tuple((other.kind, other.element) for other in alike),
    )


def _left(
    model: LogModel, run: Trajectory, inference: Inference, speeds: Sequence[int] = ()
) -> float:
    """What the equations leave of the accelerations, in the mass metric: by a step from row to row.

    Forces act as in the inference. The larger share of two: of all speeds, and of some `speeds` alone, which
    count little beside the others where they are read as small.
    """
    h = np.diff(run.t)
    next_to = np.flatnonzero(h < 1.5 * np.median(h))
    rows = model.rows(run)
    start, end, h = rows.take(next_to), rows.take(next_to + 1), h[next_to, None]
    tableau = tableau_of("ode4")
    assert tableau is not None
    # Those that act elsewhere only have no column here.
    known = dict(zip(_acting(inference.model.log), inference.forces, strict=True))
    kinds = [known.get(place, "smooth") for place in _acting(model.log)]
    at, slope = np.array([FORCES[kind][:2] for kind in kinds]).reshape(-1, 2).T

    def force(fraction: float, _: int = 0) -> Array:
        return np.asarray(start.F + (at + fraction * slope) * (end.F - start.F))

    sizes: Sequence[float] = (np.inf, 1.0, 0.0)  # where accelerations are not finite
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        u = runge_kutta(model, tableau, start, h, force)[1]
        M = model.matrices(start.t, start.q)[0]
        changes = ((end.u - u) / h, (end.u - start.u) / h, (u - start.u) / h)
        sizes = [np.sqrt(np.mean(np.einsum("ti,tij,tj->t", x, M, x))) for x in changes]
        some = np.isin(model.of_u, speeds)
        inertia = np.einsum("tii->ti", M)[:, some]
        own = [np.sqrt(np.sum(inertia * x[:, some] ** 2)) for x in changes]
        sizes = max((sizes, own), key=lambda x: x[0] / (x[1] + x[2] + 1e-300))
    share = float(sizes[0] / (sizes[1] + sizes[2] + 1e-300))
    return share if np.isfinite(share) else np.inf


def _acting(log: LoggedForces) -> list[tuple[str, int]]:
    """Channel and speed of each column of logged forces."""
    return [(str(name), k) for name, places in log.places.items() for k in places]


def _units(mechanism: Mechanism, run: Trajectory) -> Iterator[Reading]:
    names, units = _named(mechanism, run)
    for kind, ours, many in OTHER_UNITS:
        some = np.flatnonzero(units == ours)
        if not len(some) or (ours == "m" and mechanism.constraints):
            continue  # constraints tell lengths: at a thousandth of them there is no motion to compare
        remedy = f"Give the unit in a mapping, or multiply these columns by {1.0 / many:.6g}"
        factors = np.ones(len(names))
        factors[some] = 1.0 / many
        whose = f"coordinates and speeds in {ours} are in {kind}"
        yield Reading(kind, "", whose, remedy, np.diag(factors))
        for k in some if len(some) > 1 else ():
            whose = f"{names[k]!r} and its speed are in {kind}"
            alone = np.where(np.arange(len(names)) == k, 1.0 / many, 1.0)
            yield Reading(kind, names[k], whose, remedy, np.diag(alone))


def _orders_and_signs(mechanism: Mechanism, run: Trajectory) -> Iterator[Reading]:
    names, units = _named(mechanism, run)
    same, speeds = np.eye(len(names)), _rates(run)[:, 1]
    driven = [any(force[:, k].any() for force in run.forces.values()) for k in speeds]
    for name, own, speed, acted in zip(names, same, speeds, driven):
        what, turned = f"{name!r} has the opposite direction", same - 2.0 * np.diag(own)
        remedy = "Turn the axis of this joint in the model, or change the sign of its coordinate, speed and "
        remedy += "force in the log"
        if acted:
            negated = partial(_negated_at, int(speed))
            yield Reading(
                "axis-sign",
                name,
                what + ", its forces have not",
                "Change the sign of this coordinate and of its speed in the log, not that of its forces",
                turned,
            )
            yield Reading("axis-sign", name, what, remedy, turned, 0.0, negated, "cause")
            if sum(driven) > 1:
                yield Reading(
                    "force-sign",
                    name,
                    f"the forces on {name!r} have the opposite sign",
                    "Change their sign in the log, or that of the motor's gear in the model",
                    forces=negated,
                )
        else:
            yield Reading("axis-sign", name, what, remedy, turned, weight="cause")
    before = _before(mechanism, names)
    if before.any():
        yield Reading(
            "absolute-angles",
            "",
            "angles are relative to the ground, not to the parent body",
            'Read them so: coordinates="absolute" (--coordinates absolute); deltac\'s joints count from '
            "their parent",
            same - before,
        )
    for a, b in combinations(range(len(names)), 2):
        if units[a] == units[b] and (len(names) <= MANY_COLUMNS or b == a + 1):
            yield Reading(
                "swapped-joints",
                names[a],
                f"the columns of {names[a]!r} and {names[b]!r} are exchanged",
                "Exchange the names of these columns",
                same - np.outer(same[a] - same[b], same[a] - same[b]),
            )
    for name, own, unit in zip(names, same, units):
        for offset in OFFSETS if unit == "rad" else ():
            yield Reading(
                "zero-offset",
                name,
                f"{name!r} is measured from another zero and is {offset:.4g} rad too large",
                "Subtract the offset, or turn the joint's frame in the model",
                offset=offset * own,
            )
    acting = [n for n, f in run.forces.items() if np.count_nonzero(np.ptp(f, axis=0)) == 1]
    for k, other in combinations(range(len(acting)), 2):
        if len(acting) <= MANY_COLUMNS or other == k + 1:
            yield Reading(
                "swapped-forces",
                acting[k],
                f"the forces {acting[k]!r} and {acting[other]!r} are exchanged",
                "Exchange the names of these columns",
                forces=partial(_exchanged, acting[k], acting[other]),
            )
    if run.forces:
        yield Reading(
            "force-sign",
            "",
            "all forces have the opposite sign",
            "Log the forces that act on the machine, not those that it exerts",
            forces=_negated,
        )


def _named(mechanism: Mechanism, run: Trajectory) -> tuple[list[str], NDArray[np.str_]]:
    """Names and units of the coordinates whose rates are speeds."""
    names = [run.coordinates[k] for k in _rates(run)[:, 0]]
    unit = {entry.name: entry.unit for entry in mechanism.coordinates}
    return names, np.array([unit[name] for name in names])


def _before(mechanism: Mechanism, names: list[str]) -> Array:
    """1 where the second coordinate is of the hinge that carries the first one's, of the same axis (n, n)."""
    hinges = {j.name: j for j in mechanism.joints if j.kind == "revolute" and j.name in names}
    carries = {j.child: j for j in mechanism.joints if j.kind == "revolute"}
    carried = np.zeros((len(names), len(names)))
    for joint in hinges.values():
        parent = carries.get(joint.parent)
        if parent is not None and parent.name in hinges and parent.axes == joint.axes:
            carried[names.index(joint.name), names.index(parent.name)] = 1.0
    return carried
