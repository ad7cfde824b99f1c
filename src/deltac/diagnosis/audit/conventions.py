"""Conventions in which log and model may differ: units, signs, zeros, the order of columns, absolute angles.

None of these shows in coordinates and speeds alone, which agree with each other in any of them; the equations
tell. Each is tried on some rows: one that is right takes nearly all away of what the equations leave. It is
then tested on the whole log from row to row.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.calls.progress import Deadline
from deltac.diagnosis.residuals.one_step import one_step
from deltac.diagnosis.residuals.rows import Model
from deltac.diagnosis.verdict import Finding
from deltac.errors import InputError
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism
from deltac.results import percent
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import Kinematics

LARGE = 0.05
"""Share of the accelerations that the equations leave where a convention is looked for."""

LEFT = 0.1
"""What the right one may leave of that: the mean of the accelerations at both ends of a step is not exact."""

PARTS, ROWS = 4, 100
"""Stretches of a log that are looked at, and their rows."""

MANY = 8
"""Columns up to which any two may be exchanged; of more, neighbours."""

UNITS = (("degrees", "rad", 180.0 / np.pi), ("millimetres", "m", 1e3), ("centimetres", "m", 1e2))
"""Finding, unit of the model, how many of the other unit make one of it."""

PARALLEL = 1e-6
"""Sine of the angle between axes that are the same."""

OFFSETS = (np.pi, 0.5 * np.pi, -0.5 * np.pi)
"""Zeros of an angle that people choose: hanging, upright, along another axis."""


Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Reading:
    """Another way to read a log, of the coordinates whose rates are speeds, and of the forces.

    factors    on each coordinate with its speed
    places     of the columns that take the place of each
    lessened   places of the columns that are subtracted from each, −1 for none
    offset     place of a coordinate, and what it is logged too large
    exchanged  two channels that take each other's forces; sign: of all forces
    """

    kind: str
    element: str
    what: str
    remedy: str
    factors: Array | None = None
    places: Places | None = None
    lessened: Places | None = None
    offset: tuple[int, float] | None = None
    exchanged: tuple[str, str] | None = None
    sign: float = 1.0

    def of(self, run: Trajectory) -> Trajectory:
        """The log, read so; its integrals are not."""
        q, u = np.array(run.q), np.array(run.u)
        udot = None if run.udot is None else np.array(run.udot)
        rates = _rates(run)
        moved = [(q, rates[:, 0]), (u, rates[:, 1])] + (
            [] if udot is None else [(udot, rates[:, 1])]
        )
        for values, at in moved:
            here = values[:, at]
            if self.factors is not None:
                here = here * self.factors
            if self.places is not None:
                here = here[:, self.places]
            if self.lessened is not None:
                here = here - np.where(self.lessened >= 0, here[:, self.lessened], 0.0)
            values[:, at] = here
        if self.offset is not None:
            q[:, self.offset[0]] -= self.offset[1]
        forces = {name: self.sign * force for name, force in run.forces.items()}
        if self.exchanged is not None:
            a, b = self.exchanged
            sums = [force.sum(axis=1) for force in (forces[a], forces[b])]
            for name, total in ((a, sums[1]), (b, sums[0])):
                at_speed = int(np.flatnonzero(np.ptp(forces[name], axis=0))[0])
                forces[name] = np.zeros_like(forces[name])
                forces[name][:, at_speed] = total
        return replace(run, q=q, u=u, udot=udot, forces=forces, integrals={}, works={}, events=())


def _rates(run: Trajectory) -> Places:
    """Places (n, 2) of coordinates and of the speeds that are their rates."""
    pairs = list(Kinematics.of(run.coordinates, run.speeds).rates)
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def units(mechanism: Mechanism, run: Trajectory) -> Finding | None:
    """Coordinates and their speeds both in another unit, all of them or those of one joint."""
    return _best(mechanism, run, list(_units(mechanism, run)), Deadline())


def orders_and_signs(mechanism: Mechanism, run: Trajectory, deadline: Deadline) -> Finding | None:
    """Directions, zeros and the order of columns and forces that are not the model's; absolute angles."""
    return _best(mechanism, run, list(_orders_and_signs(mechanism, run)), deadline)


def _best(
    mechanism: Mechanism, run: Trajectory, readings: list[Reading], deadline: Deadline
) -> Finding | None:
    """The reading that takes nearly all away of what the equations leave, if one does.

    Of those that come first, where the `deadline` passes.
    """
    if not readings or not len(mechanism.free.u) or len(run) < 8:
        return None
    part = _some(run)
    model = Model(mechanism, part)
    was = _left(model, part)
    if not was > LARGE:
        return None
    left = list[float]()
    for reading in readings:
        if deadline.passed("all conventions"):
            break
        left.append(_left(model, reading.of(part)))
    order = [int(k) for k in np.argsort(left) if left[int(k)] < LEFT * was]
    for k in order[:3]:
        tested = one_step(mechanism, readings[k].of(run))
        if tested is not None and (tested.closes or not tested.significant.any()):
            alike = [readings[j] for j in order if j != k and left[j] < 2.0 * left[k]]
            return _told(readings[k], alike, was, left[k])
    return None


def axes(mechanism: Mechanism, run: Trajectory, deadline: Deadline) -> Finding | None:
    """A joint that turns or slides along another axis of its frame than in the model."""
    single = [j for j in mechanism.joints if len(j.axes) == 1]
    if not single or len(single) > MANY or len(run) < 8:
        return None
    part = _some(run)
    was = _left(Model(mechanism, part), part)
    found: list[tuple[float, Joint, str, Mechanism]] = []
    for joint in single if was > LARGE else ():
        for name, axis in zip("xyz", np.eye(3)):
            if deadline.passed("joints about other axes"):
                return None
            if np.linalg.norm(np.cross(axis, joint.axes[0])) < PARALLEL:
                continue
            turned = replace(joint, axes=(tuple(axis.tolist()),))
            joints = tuple(turned if j is joint else j for j in mechanism.joints)
            with suppress(InputError):  # a body may have no inertia about that axis
                other = replace(mechanism, joints=joints)
                found.append((_left(Model(other, part), part), joint, name, other))
    if not found:
        return None
    left, joint, name, other = min(found, key=lambda item: item[0])
    tested = one_step(other, run) if left < LEFT * was else None
    if tested is None or not (tested.closes or not tested.significant.any()):
        return None
    return Finding(
        "joint-axis",
        f"joint {joint.name!r} moves along {name} of its frame in the run, and not along "
        f"({', '.join(f'{x:.4g}' for x in joint.axes[0])})",
        f"so, the equations leave {percent(left)} of the accelerations, else {percent(was)}",
        "Give the model the axis that the simulator used",
        "cause",
        joint.name,
    )


def _told(reading: Reading, alike: list[Reading], was: float, left: float) -> Finding:
    others = "".join(f"; or {other.what}" for other in alike[:3])
    return Finding(
        reading.kind,
        f"in the log, {reading.what}{others}",
        f"read so, the equations leave {percent(left)} of the accelerations, else {percent(was)}",
        reading.remedy,
        "doubt",
        reading.element,
        equals=tuple((other.kind, other.element) for other in alike),
    )


def _some(run: Trajectory) -> Trajectory:
    """A few stretches of a log."""
    if len(run) <= PARTS * ROWS:
        kept = np.arange(len(run))
    else:
        starts = np.linspace(0, len(run) - ROWS, PARTS).astype(np.intp)
        kept = np.unique((starts[:, None] + np.arange(ROWS)).ravel())
    return replace(run.take(kept), integrals={}, works={}, events=())


def _left(model: Model, run: Trajectory) -> float:
    """What the equations leave of the accelerations, in the mass metric."""
    free = model.mechanism.free
    q, u = run.q[:, free.q], run.u[:, free.u]
    values = list(model.log.values(run).values())
    F = np.concatenate(values, axis=1) if values else np.zeros((len(run), 0))
    h = np.diff(run.t)
    next_to = h < 1.5 * np.median(h)
    sizes: Sequence[float] = (np.inf, 1.0, 0.0)  # where accelerations are not finite
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        a = model.acceleration(run.t, q, u, F)
        M = model.inertia(run.t[:-1], q[:-1])[next_to]
        D = (np.diff(u, axis=0) / h[:, None])[next_to]
        mean = 0.5 * (a[:-1] + a[1:])[next_to]
        sizes = [np.sqrt(np.mean(np.einsum("ti,tij,tj->t", x, M, x))) for x in (D - mean, D, mean)]
    left = float(sizes[0] / (sizes[1] + sizes[2] + 1e-300))
    return left if np.isfinite(left) else np.inf


def _units(mechanism: Mechanism, run: Trajectory) -> Iterator[Reading]:
    rates = _rates(run)
    unit = {entry.name: entry.unit for entry in mechanism.coordinates}
    of = np.array([unit[run.coordinates[k]] for k in rates[:, 0]])
    for kind, ours, many in UNITS:
        if ours == "m" and mechanism.constraints:
            continue  # constraints tell lengths: at a thousandth of them there is no motion to compare
        some = np.flatnonzero(of == ours)
        alone = [some[k : k + 1] for k in range(len(some))] if len(some) > 1 else []
        for group in [some, *alone] if len(some) else ():
            factors = np.ones(len(rates))
            factors[group] = 1.0 / many
            element = "" if group is some else run.coordinates[rates[int(group[0]), 0]]
            whose = (
                f"{element!r} and its speed are"
                if element
                else f"coordinates and speeds in {ours} are"
            )
            yield Reading(
                kind,
                element,
                f"{whose} in {kind}",
                f"Give the unit in a mapping, or multiply these columns by {1.0 / many:.6g}",
                factors=factors,
            )


def _orders_and_signs(mechanism: Mechanism, run: Trajectory) -> Iterator[Reading]:
    rates = _rates(run)
    names = [run.coordinates[k] for k in rates[:, 0]]
    unit = {entry.name: entry.unit for entry in mechanism.coordinates}
    same = np.arange(len(names), dtype=np.intp)
    for k, name in enumerate(names):
        factors = np.ones(len(names))
        factors[k] = -1.0
        yield Reading(
            "axis-sign", name, f"{name!r} is counted the other way round",
            "Turn the axis of this joint in the model, or the sign of its coordinate, speed and force in the "
            "log", factors=factors,
        )  # fmt: skip
    before = _before(mechanism, names)
    if np.any(before >= 0):
        yield Reading(
            "absolute-angles", "", "angles are counted from the ground, and not from the body before",
            "Subtract the angle and the speed of the joint before; deltac's joints count from their parent",
            lessened=before,
        )  # fmt: skip
    for a, b in combinations(same, 2):
        if unit[names[a]] == unit[names[b]] and (len(names) <= MANY or b == a + 1):
            places = same.copy()
            places[[a, b]] = b, a
            yield Reading(
                "swapped-joints", names[a], f"the columns of {names[a]!r} and {names[b]!r} are exchanged",
                "Exchange the names of these columns", places=places,
            )  # fmt: skip
    for k, name in enumerate(names):
        for offset in OFFSETS if unit[name] == "rad" else ():
            yield Reading(
                "zero-offset", name, f"{name!r} is counted from another zero, {offset:.4g} rad too large",
                "Subtract that, or turn the joint's frame in the model",
                offset=(int(rates[k, 0]), offset),
            )  # fmt: skip
    acting = [n for n, f in run.forces.items() if np.count_nonzero(np.ptp(f, axis=0)) == 1]
    for x, y in combinations(range(len(acting)), 2):
        if len(acting) <= MANY or y == x + 1:
            a, b = acting[x], acting[y]
            yield Reading(
                "swapped-forces", a, f"the forces {a!r} and {b!r} are exchanged",
                "Exchange the names of these columns", exchanged=(a, b),
            )  # fmt: skip
    if run.forces:
        yield Reading(
            "force-sign", "", "all forces are of the other sign",
            "Log the forces that act on the machine, not those that it exerts", sign=-1.0,
        )  # fmt: skip


def _before(mechanism: Mechanism, names: list[str]) -> Places:
    """Of each hinge the place of the hinge of the same axis that carries its parent; −1 if there is none."""
    hinges = {j.name: j for j in mechanism.joints if j.kind == "revolute"}
    carries = {j.child: j for j in hinges.values()}

    def place(name: str) -> int:
        joint = hinges.get(name)
        parent = carries.get(joint.parent) if joint is not None else None
        if joint is None or parent is None or parent.axes != joint.axes:
            return -1
        return names.index(parent.name) if parent.name in names else -1

    return np.array([place(name) for name in names], dtype=np.intp)
