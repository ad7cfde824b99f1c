"""A candidate: a change of a mechanism that a person would name, one to six numbers θ.

A cause maps its numbers to coefficients of the columns, θ ↦ L θ + θᵀQθ: linear for almost all;
a mass centre that moves changes the moments of inertia about the joint by squares, and a delay has
f(t − τ) = f − τ ḟ + τ² f̈/2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.explain.columns import STOPS, UNIT_MOMENTS, Column, What, stops
from deltac.diagnosis.residuals.at_samples import Evaluator
from deltac.dynamics.system import Link
from deltac.mechanism.coordinates import Entry
from deltac.mechanism.forces import JointDamper, JointSpring
from deltac.mechanism.joints import Joint

Sign = Literal["any", "positive", "factor", "slip"]

PREFERENCE = (
    "gravity",
    "mass-scale",
    "actuator-gear",
    "channel-factor",
    "body-inertia",
    "body-mass",
    "damping",
    "stiffness",
    "missing-damper",
    "missing-rotor-inertia",
    "armature",
    "zero-offset",
    "body-centre",
    "body-moments",
    "body-moment",
    "missing-friction",
    "missing-drag",
    "missing-spring",
    "rest-angle",
    "actuator-delay",
    "late-rows",
    "constant-force",
    "missing-stop",
    "gravity-vector",
    "applied-force",
    "applied-moment",
    "thrust",
    "body-torque",
    "body-tensor",
    "velocity-terms",
    "gyroscopic-terms",
)
"""Of causes that explain the same by as many numbers, the one that comes first is named first."""


SLIPS, SLIPPED = (0.0, -1.0, 2.0, 0.5), 0.02
"""Factors of terms that were forgotten, or have another sign, or a 2 too many or too few; how near."""

UNITS = (3, 6, 7, 9)
"""Powers of ten between units of masses and inertias: g, kg·mm², g·cm², g·mm²."""

FREE = "free"
OF_JOINTS = ("missing-friction", "missing-rotor-inertia", "constant-force")
"""What acts in joints, and not on bodies that are free."""

_TELLS = {
    "mass-scale": "mJ",
    "body-inertia": "mJ",
    "body-mass": "m",
    "body-centre": "c",
    "body-moments": "J",
    "body-moment": "J",
    "body-tensor": "J",
}
"""Which of a body's mass, mass centre and central inertia a cause tells."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause that may be.

    kind, element   what it would be, and of which body, joint's speed or channel
    columns         places of its columns; coefficients are linear θ + θᵀ quadratic θ
    linear          (a, d); quadratic (a, d, d) or None
    names           of its d numbers
    base            what the model has of it (d,): values are base + θ
    units           of its d numbers
    sign            "positive": base + θ > 0; "factor": it is a factor between 0.1 and 10, or of units;
                    "slip": it is a factor that a slip in equations makes
    origin          "logged" or "computed" for channels; the kind of joint for what acts in joints
    limit           of |θ|
    touching        least and largest value of a coordinate, where θ is a stiffness with its force at zero,
                    which only pushes between them
    stop            a coordinate's place, and the two values of it between which a stop begins
    """

    kind: str
    element: str
    columns: tuple[int, ...]
    linear: Array
    names: tuple[str, ...]
    base: Array
    units: tuple[str, ...]
    sign: Sign = "any"
    quadratic: Array | None = None
    origin: str = ""
    limit: float = np.inf
    touching: tuple[float, float] | None = None
    stop: tuple[int, float, float] | None = None

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(self.linear.shape[1])

    def rank(self, theta: Array) -> int:
        """Order of preference of causes that explain the same; factors beyond two come late.

        So do friction, rotors and motors of free joints, which have nothing to rub or turn in.
        """
        size = np.abs(self.base + theta)
        far = "1" in self.units and bool(np.any((size > 2.0) | (size < 0.5)))
        far |= self.origin == FREE and self.kind in OF_JOINTS
        place: int = PREFERENCE.index(self.kind)
        return place + len(PREFERENCE) if far else place

    def coefficients(self, theta: Array) -> Array:
        """Coefficients (a,) of its columns."""
        made = self.linear @ theta
        if self.quadratic is not None:
            made = made + np.einsum("aij,i,j->a", self.quadratic, theta, theta)
        return np.asarray(made)

    def tangent(self, theta: Array) -> Array:
        """Their derivatives (a, d)."""
        if self.quadratic is None:
            return self.linear
        both = self.quadratic + self.quadratic.transpose(0, 2, 1)
        return np.asarray(self.linear + np.einsum("aij,j->ai", both, theta))

    def scales(self, other: Candidate) -> float:
        """By how much the coefficients of another cause grow with a unit of this one's number.

        A mass that is larger and moved has its product in the residual; so have gear and delay of a
        motor, stiffness and rest angle of a spring.
        """
        if other.kind == "body-centre" and (
            self.kind == "mass-scale"
            or (self.kind in ("body-mass", "body-inertia") and self.element == other.element)
        ):
            return 1.0
        if self.element != other.element:
            return 0.0
        if (self.kind, other.kind) == ("actuator-gear", "actuator-delay"):
            return 1.0
        if (self.kind, other.kind) == ("stiffness", "rest-angle"):
            return float(1.0 / self.base[0])
        return 0.0

    @property
    def of_a_body(self) -> bool:
        """Whether it tells a number of a body, and so may exclude others."""
        return self.kind in _TELLS

    def excludes(self, other: Candidate) -> bool:
        """Whether both together would tell one number of a body twice, in sentences that contradict."""
        here, there = _TELLS.get(self.kind, ""), _TELLS.get(other.kind, "")
        same = self.element == other.element or "mass-scale" in (self.kind, other.kind)
        if self.kind == other.kind == "body-moment":
            return self.names == other.names
        return same and any(told in there for told in here)

    def plausible(self, theta: Array) -> bool:
        """Whether the world could have it: dampers brake, masses stay within a decade."""
        value = self.base + theta
        if float(np.linalg.norm(theta)) > self.limit:
            return False
        if self.touching is not None:
            ends = [theta[1] - theta[0] * q for q in self.touching]
            return bool(theta[0] > 0.0 and (max(ends) <= 0.0 or min(ends) >= 0.0))
        if self.kind == "body-tensor":
            principal = np.linalg.eigvalsh(tensor(value))
            own, sum_of = float(np.sum(self.base[:3])), float(np.sum(principal))
            within = not own > 0.0 or 0.1 * own < sum_of < 10.0 * own
            triangle = principal[2] <= principal[0] + principal[1]
            return bool(principal[0] > 0.0 and triangle and within)
        if self.kind == "body-moment":  # of a body without inertia and forces any equation closes
            return bool(np.all((value > 0.1 * self.base) & (value < 10.0 * self.base)))
        if self.sign == "positive":
            return bool(np.all(value > 0.0))
        if self.sign == "slip":
            return any(abs(float(value[0]) - x) < SLIPPED for x in SLIPS)
        return (
            self.sign == "any" or bool(np.all((value > 0.1) & (value < 10.0))) or other_unit(value)
        )


@dataclass(frozen=True)
class Places:
    """Where columns are."""

    of: Mapping[Column, int]

    def __call__(self, *columns: Column) -> tuple[int, ...] | None:
        """The places of columns, None where one is missing."""
        found = [self.of.get(c) for c in columns]
        return None if None in found else tuple(p for p in found if p is not None)


def one(
    kind: str,
    element: str,
    columns: tuple[int, ...] | None,
    weights: Sequence[float],
    name: str,
    base: float,
    unit: str,
    sign: Sign = "any",
    origin: str = "",
) -> Iterator[Candidate]:
    """A cause of one number, if its columns are there and not all weights zero."""
    L = np.array(weights, dtype=float)[:, None]
    if columns is not None and L.any():
        yield Candidate(
            kind, element, columns, L, (name,), np.array([base]), (unit,), sign, origin=origin,
        )  # fmt: skip


def other_unit(factor: Array) -> bool:
    """Whether a factor is that between two units of a mass or an inertia."""
    if factor.size != 1 or float(factor.ravel()[0]) <= 0.0:
        return False
    power = abs(float(np.log10(factor.ravel()[0])))
    return any(abs(power - p) < 0.005 for p in UNITS)


def tensor(six: Array) -> Array:
    """The symmetric matrix of six moments and products of inertia."""
    J = np.zeros((3, 3))
    for value, (i, j) in zip(six, UNIT_MOMENTS):
        J[i, j] = J[j, i] = value
    return J


# --- causes that are a body's: its mass, its mass centre, its central inertia --------------------


@dataclass(frozen=True, eq=False)
class _Mass:
    """Numbers of a body: mass, mass centre and central inertia in the link frame, E: link to body."""

    name: str
    mass: float
    centre: Array
    central: Array
    E: Array
    columns: tuple[int, ...] = field(default=())

    @staticmethod
    def of(link: Link) -> _Mass:
        """Those of a link."""
        mass = float(ca.evalf(ca.SX(link.mass)))
        centre = np.array(ca.evalf(link.centre)).ravel()
        J = np.array(ca.evalf(ca.densify(ca.SX(link.inertia.J))))
        central = J - mass * _steiner(centre)
        E = np.array(ca.evalf(ca.densify(link.to_body.E)))
        return _Mass(link.joint.child, mass, centre, central, E)


def _steiner(c: Array) -> Array:
    """|c|² 1 − c cᵀ: the moments of inertia of a unit mass at c."""
    return np.asarray(float(c @ c) * np.eye(3) - np.outer(c, c))


def _six(J: Array) -> list[float]:
    return [float(J[i, j]) for i, j in UNIT_MOMENTS]


def of_bodies(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    """Masses, moments of inertia and mass centres of each body, and all masses together."""
    system = evaluator.symbols.system
    whole: list[tuple[tuple[int, ...], list[float]]] = []
    steady: list[int] = []
    for link in system.links:
        if evaluator.mechanism.body(link.joint.child).massless:
            continue
        b = _Mass.of(link)
        here = [places(Column("inertia", b.name, k)) for k in range(10)]
        kept = [k for k, p in enumerate(here) if p is not None]
        at = tuple(p[0] for p in here if p is not None)
        if not kept:
            continue

        def take(weights: list[float], kept: list[int] = kept) -> list[float]:
            return [weights[k] for k in kept]

        mass = [b.mass, *(b.mass * b.centre), *_six(b.mass * _steiner(b.centre))]
        moments = [0.0] * 4 + _six(b.central)
        every = [x + y for x, y in zip(mass, moments)]
        whole.append((at, take(every)))
        steady += places(Column("velocity", b.name)) or ()
        own = places(Column("gyroscopic", b.name))
        yield from one("gyroscopic-terms", b.name, own, [1.0], "factor", 1.0, "1", "slip")
        factor: Sign = "factor"
        yield from one("body-inertia", b.name, at, take(every), "factor", 1.0, "1", factor)
        yield from one("body-mass", b.name, at, take(mass), "factor", 1.0, "1", factor)
        yield from one("body-moments", b.name, at, take(moments), "factor", 1.0, "1", factor)
        yield from _centres(b, at, kept)
        yield from _moments(b, at, kept)
    if len(whole) > 1:
        columns = tuple(k for at, _ in whole for k in at)
        weights = [w for _, some in whole for w in some]
        yield from one("mass-scale", "all bodies", columns, weights, "factor", 1.0, "1", "factor")
        ones = [1.0] * len(steady)
        yield from one(
            "velocity-terms", "all bodies", tuple(steady), ones, "factor", 1.0, "1", "slip"
        )


def _centres(b: _Mass, at: tuple[int, ...], kept: list[int]) -> Iterator[Candidate]:
    """The mass centre moved along an axis of the body, or anywhere; in body components."""
    L, Q = np.zeros((10, 3)), np.zeros((10, 3, 3))
    axes = b.E.T  # columns: the body's axes in the link frame
    for k in range(3):
        d = axes[:, k]
        L[1:4, k] = b.mass * d
        turned = (
            2.0 * float(b.centre @ d) * np.eye(3) - np.outer(b.centre, d) - np.outer(d, b.centre)
        )
        L[4:, k] = _six(b.mass * turned)
        for l in range(3):
            e = axes[:, l]
            both = float(d @ e) * np.eye(3) - 0.5 * (np.outer(d, e) + np.outer(e, d))
            Q[4:, k, l] = _six(b.mass * both)
    L, Q = L[kept], Q[kept]
    gyration = np.sqrt(0.5 * float(np.trace(b.central)) / b.mass) if b.mass else 0.0
    limit = max(3.0 * gyration, float(np.linalg.norm(b.centre)))  # it stays within the body
    shown = [k for k in range(3) if L[:, k].any()]  # of planar motion, not the axis across
    for group in [*([k] for k in shown), shown] if len(shown) > 1 else [shown]:
        if group:
            yield Candidate(
                "body-centre", b.name, at, L[:, group], tuple("xyz"[k] for k in group),
                np.zeros(len(group)), ("m",) * len(group), "any", Q[:, group][:, :, group],
                limit=limit,
            )  # fmt: skip


def _moments(b: _Mass, at: tuple[int, ...], kept: list[int]) -> Iterator[Candidate]:
    """Central moments of inertia, in the axes of the body."""
    L = np.zeros((10, 6))
    own = b.E @ b.central @ b.E.T
    for n, (i, j) in enumerate(UNIT_MOMENTS):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        L[4:, n] = _six(b.E.T @ unit @ b.E)
    L, base, names = L[kept], np.array(_six(own)), ("xx", "yy", "zz", "xy", "xz", "yz")
    for n in range(3):
        yield from one(
            "body-moment", b.name, at, list(L[:, n]), names[n], float(base[n]), "kg·m²",
            "positive",
        )  # fmt: skip
    if L.any():
        yield Candidate("body-tensor", b.name, at, L, names, base, ("kg·m²",) * 6)


# --- all causes that a mechanism may have --------------------------------------------------------

MOST_LATE = 10.0
"""Rows by which coordinates may be late: columns are of first order."""

MOST_OFFSET = {"rad": 0.2, "m": 0.1}
"""Offsets of a coordinate's zero beyond which the equations have more than squares of it."""

_SQUARE = np.array([[[0.0]], [[1.0]]])
"""A number whose square is the coefficient of a second column."""

PUSHES: tuple[tuple[What, str, str], ...] = (
    ("force", "applied-force", "N"),
    ("moment", "applied-moment", "N·m"),
    ("body-force", "thrust", "N"),
    ("body-moment", "body-torque", "N·m"),
)
"""Forces and moments on a body that a model may lack: in world components, and turning with the body."""


def candidates(evaluator: Evaluator, columns: Sequence[Column]) -> tuple[Candidate, ...]:
    """All causes of a mechanism whose columns there are."""
    places = Places({column: k for k, column in enumerate(columns)})
    found: list[Candidate] = []
    for part in (_gravity, of_bodies, _speeds, _channels, _wrenches):
        found.extend(part(evaluator, places))
    late = places(Column("late", ""))
    if late is not None:
        found.append(
            Candidate(
                "late-rows", "", late, np.eye(1), ("delay",), np.zeros(1), ("s",),
                limit=MOST_LATE * evaluator.spacing,
            )
        )  # fmt: skip
    # Where columns are missing, since they are zero, several numbers may mean the same as one.
    return tuple(c for c in found if c.size == 1 or np.linalg.matrix_rank(c.linear) == c.size)


def _gravity(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    g = np.array([evaluator.mechanism.number(x) for x in evaluator.mechanism.gravity])
    axes = [places(Column("gravity", "", k)) for k in range(3)]
    columns = tuple(p[0] for p in axes if p is not None)
    active = [k for k, p in enumerate(axes) if p is not None]
    if not active:
        return
    if g[active].any():
        yield from one("gravity", "gravity", columns, list(g[active]), "factor", 1.0, "1")
    yield Candidate(
        "gravity-vector", "gravity", columns, np.eye(len(active)), tuple("xyz"[k] for k in active),
        g[active], ("m/s²",) * len(active),
    )  # fmt: skip


# --- joints, channels, forces -----------------------------------------------------------------------


def _speeds(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    """What may act on a joint: damper, dry friction, drag, rotor inertia, spring, stop, constant force."""
    mechanism = evaluator.mechanism
    number = mechanism.number
    acting = {c.element for c in places.of if c.what == "channel"}
    free = {int(place) for place in evaluator.symbols.system.free_u}
    for joint in mechanism.joints:
        span = mechanism.speeds.of(joint.name)
        entries = [
            mechanism.speeds[place] for place in range(span.start, span.stop) if place in free
        ]
        if len(entries) > 1:
            yield from _on_all_speeds(joint, entries, acting, places)
    for place in evaluator.symbols.system.free_u:
        entry = mechanism.speeds[place]
        joint = mechanism.joint(entry.joint)
        row = place - mechanism.speeds.of(joint.name).start
        single = len(joint.speeds) == 1
        force, per = _units(entry)
        own = {
            type(e): (e, f"{kind} {e.name}")
            for e in mechanism.elements
            for kind, cls in (("damper", JointDamper), ("spring", JointSpring))
            if isinstance(e, cls)
            and e.joint == joint.name
            and places(Column("channel", f"{kind} {e.name}")) is not None  # which is not zero
        }
        damper, spring = own.get(JointDamper), own.get(JointSpring)

        def at(what: What, name: str = entry.name) -> tuple[int, ...] | None:
            return places(Column(what, name))

        has_damper = single and (damper is not None or f"damper {joint.name}" in acting)
        if not has_damper:
            yield from one(
                "missing-damper", entry.name, at("damper"), [1.0], "damping", 0.0,
                f"{force}·s/{per}", "positive",
            )  # fmt: skip
        elif damper is not None and damper[1] not in evaluator.log.places:
            law = getattr(damper[0], "damping", (None,))[0]
            if isinstance(law, float):
                yield from one(
                    "damping", entry.name, at("damper"), [1.0], "damping", law, f"{force}·s/{per}"
                )
        first, second = (places(Column("offset", entry.name, k)) for k in range(2))
        if first is not None and second is not None:
            yield Candidate(
                "zero-offset", entry.name, (*first, *second), np.array([[1.0], [0.0]]), ("offset",),
                np.zeros(1), (per,), "any", _SQUARE, limit=MOST_OFFSET[per],
            )  # fmt: skip
        if f"friction {joint.name}" not in acting:
            yield from one(
                "missing-friction", entry.name, at("friction"), [1.0], "friction", 0.0, force,
                "positive", joint.kind,
            )  # fmt: skip
        yield from one(
            "missing-drag",
            entry.name,
            at("drag"),
            [1.0],
            "drag",
            0.0,
            f"{force}·s²/{per}²",
            "positive",
        )
        have = number(joint.armature[row]) if joint.armature else 0.0
        yield from one(
            "armature" if have else "missing-rotor-inertia", entry.name, at("armature"), [1.0],
            "rotor inertia", have, "kg·m²" if per == "rad" else "kg", "positive", joint.kind,
        )  # fmt: skip
        yield from _stops(evaluator, places, entry, row)
        stiffness = getattr(spring[0], "stiffness", ()) if spring else ()
        if spring is None and f"spring {joint.name}" not in acting:
            yield from one(
                "missing-spring", entry.name, at("spring"), [1.0], "stiffness", 0.0,
                f"{force}/{per}", "positive",
            )  # fmt: skip
            both = (*(at("spring") or ()), *(at("constant") or ()))
            if len(both) == 2:
                yield Candidate(
                    "missing-spring", entry.name, both, np.eye(2), ("stiffness", "force at zero"),
                    np.zeros(2), (f"{force}/{per}", force),
                )  # fmt: skip
                at_q = mechanism.coordinates.of(entry.joint).start + row
                low, high = (float(x[at_q]) for x in evaluator.reach)
                yield Candidate(
                    "missing-stop", entry.name, both, np.eye(2), ("stiffness", "force at zero"),
                    np.zeros(2), (f"{force}/{per}", force), touching=(low, high),
                )  # fmt: skip
        elif row < len(stiffness) and isinstance(stiffness[row], float) and spring is not None:
            rest = spring[0].rest[row] if isinstance(spring[0], JointSpring) else None
            if isinstance(rest, float) and stiffness[row]:
                yield from one(
                    "rest-angle", entry.name, at("constant"), [stiffness[row]], "rest", rest, per
                )
                continue  # a constant force would be the same
        yield from one(
            "constant-force",
            entry.name,
            at("constant"),
            [1.0],
            "force",
            0.0,
            force,
            "any",
            joint.kind,
        )


def _units(entry: Entry) -> tuple[str, str]:
    """The units of a speed's force and of its coordinate."""
    return ("N·m", "rad") if entry.unit == "rad/s" else ("N", "m")


def _on_all_speeds(
    joint: Joint, entries: Sequence[Entry], acting: set[str], places: Places
) -> Iterator[Candidate]:
    """One number for all speeds of a unit of a joint that has several."""
    for unit in dict.fromkeys(e.unit for e in entries):
        some = [e for e in entries if e.unit == unit]
        force, per = _units(some[0])
        kinds: list[tuple[str, What, str, str]] = [
            ("missing-damper", "damper", "damping", f"{force}·s/{per}"),
            ("missing-drag", "drag", "drag", f"{force}·s²/{per}²"),
        ]
        if not joint.armature:
            inertia = "kg·m²" if per == "rad" else "kg"
            kinds.append(("missing-rotor-inertia", "armature", "rotor inertia", inertia))
        if f"friction {joint.name}" not in acting:
            kinds.append(("missing-friction", "friction", "friction", force))
        for kind, what, name, of in kinds if len(some) > 1 else ():
            columns = places(*(Column(what, e.name) for e in some))
            ones = [1.0] * len(some)
            yield from one(kind, joint.name, columns, ones, name, 0.0, of, "positive", joint.kind)


def _stops(evaluator: Evaluator, places: Places, entry: Entry, row: int) -> Iterator[Candidate]:
    """A stop that pushes back above a place, or below it."""
    force, per = _units(entry)
    at = evaluator.mechanism.coordinates.of(entry.joint).start + row
    linear = places(Column("spring", entry.name), Column("constant", entry.name))
    columns = [places(Column("stop", entry.name, k)) for k in range(len(STOPS))]
    if linear is None or None in columns:
        return
    c = stops(evaluator, at)
    hinge = [k for found in columns if found is not None for k in found]
    # −k max(q − c, 0), with c between two places, is the sum of such forces at both.
    above = np.eye(2)
    for k in range(len(c) - 1):
        # max(c − q, 0) = max(q − c, 0) − q + c pushes up.
        below = np.vstack([-np.eye(2), [[1.0, 1.0], [c[k], c[k + 1]]]])
        for side, L, more in (("above", above, ()), ("below", below, linear)):
            names = tuple(f"stiffness {side} {place:.4g} {per}" for place in c[k : k + 2])
            yield Candidate(
                "missing-stop", entry.name, (*hinge[k : k + 2], *more), L, names, np.zeros(2),
                (f"{force}/{per}",) * 2, "positive", stop=(int(at), c[k], c[k + 1]),
            )  # fmt: skip


def _channels(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    mechanism = evaluator.mechanism
    constant = {
        f"damper {e.name}"
        for e in mechanism.elements
        if isinstance(e, JointDamper)
        and len(mechanism.joint(e.joint).speeds) == 1
        and isinstance(e.damping[0], float)
    }
    linear = {
        f"spring {e.name}": e
        for e in mechanism.elements
        if isinstance(e, JointSpring) and len(e.stiffness) == 1
    }
    for part in evaluator.symbols.parts:
        name = part.name
        at = places(Column("channel", name))
        logged = name in evaluator.log.places
        if at is None or (name in constant and not logged):
            continue
        origin = "logged" if logged else "computed"
        spring = linear.get(name)
        if spring is not None and not logged and isinstance(spring.stiffness[0], float):
            k = spring.stiffness[0]
            turning = mechanism.speeds[mechanism.speeds.of(spring.joint)][0].unit == "rad/s"
            unit = "N·m/rad" if turning else "N/m"
            yield from one("stiffness", spring.joint, at, [1.0 / k], "stiffness", k, unit)
            continue
        kind = "actuator-gear" if name.kind == "actuator" else "channel-factor"
        yield from one(kind, name, at, [1.0], "factor", 1.0, "1", origin=origin)
        first, second = (places(Column("delay", name, k)) for k in range(2))
        if first is not None and second is not None:
            yield Candidate(
                "actuator-delay", name, (*first, *second), np.array([[1.0], [0.0]]), ("delay",),
                np.zeros(1), ("s",), "any", _SQUARE, origin,
            )  # fmt: skip


def _wrenches(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    for link in evaluator.symbols.system.links:
        body = link.joint.child
        drag = places(Column("drag of a body", body))
        yield from one("missing-drag", body, drag, [1.0], "drag", 0.0, "N·s²/m²", "positive")
        for what, kind, unit in PUSHES:
            found = [
                (k, p[0]) for k in range(3) if (p := places(Column(what, body, k))) is not None
            ]
            groups = [[f] for f in found] + ([found] if len(found) > 1 else [])
            for group in groups:
                yield Candidate(
                    kind, body, tuple(p for _, p in group), np.eye(len(group)),
                    tuple("xyz"[k] for k, _ in group), np.zeros(len(group)), (unit,) * len(group),
                )  # fmt: skip
