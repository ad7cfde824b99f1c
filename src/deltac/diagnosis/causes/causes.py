"""Causes: the changes of a mechanism that a person would name, of one to six numbers θ.

`KINDS` says what there is, in words; `candidates` where a mechanism may have it. A cause maps its numbers to
coefficients of the columns, θ ↦ L θ + θᵀQθ: linear for almost all; a mass centre that moves changes the
moments of inertia about the joint by squares, and a delay has f(t − τ) = f − τ ḟ + τ² f̈/2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from deltac.arrays import NEGLIGIBLE, Array
from deltac.diagnosis.causes.columns import (
    MOMENTS,
    OF_GEOMETRY,
    STOPS,
    UNIT_MOMENTS,
    Column,
    LogEquations,
    What,
    stops,
)
from deltac.diagnosis.causes.edits import (
    Displaced,
    Edit,
    Renumbered,
    Reparametrised,
    Stretched,
    bar_of,
)
from deltac.diagnosis.causes.geometry import Number, geometry_numbers
from deltac.diagnosis.causes.masses import BodyMass, six, steiner
from deltac.mechanism.constraints import perpendiculars
from deltac.mechanism.coordinates import Entry
from deltac.mechanism.forces import JointDamper, JointSpring
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND

Sign = Literal["any", "positive", "factor", "forgotten", "slip", "passive"]

SAME_VALUE = "Give the model the value that the simulator used"
MASSES = "Check masses and inertias of the model against those that the simulator used"
TERMS = "Check the terms in products of speeds in the equations of the run, or its frames"
FORGOTTEN = "Check this term in the equations of the run"
GRAVITY = "Give model and simulator the same gravity"
ADD = "Add it to the model, or log its force"
LAYOUT = "Compare the places and lengths of the model with those of the machine or of the simulator's model"
TILTS = "Compare the axes and frames of the model's joints with those of the machine or the simulator's model"


@dataclass(frozen=True)
class CauseKind:
    """A kind of cause, in words.

    words   the cause in a sentence, of what `result.sentence` fills in
    remedy  what to do about it
    number  name of its number
    unit    of its number; {F}, {q} and {J} are those of a joint's force, coordinate and inertia
    sign    "positive": base + θ > 0; "factor": it is a factor between 0.1 and 10, or of units;
            "forgotten": at least 0, and no factor above 10; "slip": a factor that a slip in equations makes;
            "passive": a factor of at least 0, or −1
    tells   which of a body's mass m, mass centre c and central inertia J it tells
    like    kinds of channels whose forces do the same on its joint, or anywhere
    """

    words: str
    remedy: str = ADD
    number: str = ""
    unit: str = ""
    sign: Sign = "any"
    tells: str = ""
    like: tuple[str, ...] = ()


def _factor(words: str, remedy: str, sign: Sign = "any", tells: str = "") -> CauseKind:
    return CauseKind(words, remedy, "factor", "1", sign, tells)


def _mass(words: str, tells: str) -> CauseKind:
    return _factor(f"{words}{{more}}", MASSES, "factor", tells)


def _lacking(what: str, number: str, unit: str, like: tuple[str, ...] = ()) -> CauseKind:
    words = f"a {what} of {{shown}} {{unit}} at joint {{element}} that the model does not have"
    return CauseKind(words, ADD, number, unit, "positive", like=like)


def _other(what: str, number: str, unit: str, sign: Sign = "any") -> CauseKind:
    words = f"the {what} of joint {{element}} in the run is {{shown}}, not {{base}} {{unit}}"
    return CauseKind(words, SAME_VALUE, number, unit, sign)


def _push(what: str, frame: str, unit: str) -> CauseKind:
    words = (
        f"a constant {what} of {{several}} {unit} along {{axes}} of the {frame} acts on {{element}}"
    )
    return CauseKind(words, unit=unit)


def _geometry(words: str, remedy: str, unit: str) -> CauseKind:
    return CauseKind(words, remedy, unit=unit)


KINDS = {
    "gravity": _factor("gravity in the run is {shown} m/s² instead of {base} m/s²", GRAVITY),
    "mass-scale": _mass(
        "all masses and inertias in the run are {shown} times those of the model", "mJ"
    ),
    "actuator-gear": _factor(
        "{element} delivers {shown} of its {origin} force (gear, unit or scale of the actuator)",
        "Check the gear ratio and the unit of this actuator's logged force",
    ),
    "channel-factor": _factor(
        "{element} {acts} {shown} of its {origin} force",
        "Check this element's parameters in the model, or the unit of its logged force",
    ),
    "body-inertia": _mass(
        "mass and inertia of {element} in the run are {shown} times the model's", "mJ"
    ),
    "body-mass": _mass("the mass of {element} in the run is {shown} times the model's", "m"),
    "damping": _other("damping", "damping", "{F}·s/{q}"),
    "stiffness": _other("stiffness", "stiffness", "{F}/{q}"),
    "missing-damper": _lacking("viscous damping", "damping", "{F}·s/{q}"),
    "missing-rotor-inertia": _lacking("rotor inertia", "rotor inertia", "{J}"),
    "armature": _other("rotor inertia", "rotor inertia", "{J}", "forgotten"),
    "zero-offset": CauseKind(
        "the zero of joint {element} is off: it is logged {shown} {unit} too large",
        "Calibrate the zero of this coordinate, or subtract the offset",
        "offset",
        "{q}",
    ),
    "body-centre": CauseKind(
        "the mass centre of {element} in the run is displaced by {several} m along {axes} of the body",
        MASSES,
        unit="m",
        tells="c",
    ),
    "body-moments": _mass(
        "the central moments of inertia of {element} in the run are {shown} times the model's", "J"
    ),
    "body-moment": CauseKind(
        "the central moment of inertia {axes} of {element} in the run is {shown}, not {base} kg·m²",
        MASSES,
        unit="kg·m²",
        sign="positive",
        tells="J",
    ),
    "missing-friction": _lacking("dry friction", "friction", "{F}", ("friction",)),
    "missing-drag": _lacking("drag by the square of the speed", "drag", "{F}·s²/{q}²"),
    "body-damping": CauseKind(
        "a viscous drag of {shown} {unit} acts on {element} at its mass centre",
        ADD,
        "damping",
        "N·s/m",
        "positive",
    ),
    "velocity-decay": CauseKind(
        "all bodies lose momentum at a rate of {shown} {unit}, as under {origin}",
        "Switch this damping of the engine off, or give the model a force like it",
        "decay",
        "1/s",
        "positive",
    ),
    "missing-spring": _lacking("spring stiffness", "stiffness", "{F}/{q}"),
    "rest-angle": CauseKind(
        "the spring of joint {element} rests at {shown}, not {base} {unit}",
        SAME_VALUE,
        "rest",
        "{q}",
    ),
    "actuator-delay": CauseKind(
        "{element} acts {shown} s later than logged",
        "Log the force that acted, not the one that was commanded",
        "delay",
        "s",
    ),
    "late-forces": CauseKind(
        "the forces act {numbers[0]} s later than logged, smoothed by {numbers[1]} s²: states that were "
        "filtered are late beside forces that were not",
        "Log states and forces of the same instant, both filtered or neither",
        "delay",
        "s",
    ),
    "late-laws": CauseKind(
        "laws of time act {numbers[0]} s later than in the model: they are late, or the log, as by a filter",
        "Subtract the delay from the times of the log, or give the model's laws that phase",
        "delay",
        "s",
    ),
    "constant-force": CauseKind(
        "a constant force of {shown} {unit} acts on joint {element}", ADD, "force", "{F}"
    ),
    "missing-stop": CauseKind(
        "joint {element} has a stop that the model does not have: a stiffness of {several} {unit} {where}",
        unit="{F}/{q}",
        sign="positive",
        like=("limit", "contact"),
    ),
    "gravity-vector": CauseKind(
        "gravity in the run is {several} m/s², not {bases}", GRAVITY, unit="m/s²"
    ),
    "applied-force": _push("force", "world", "N"),
    "applied-moment": _push("moment", "world", "N·m"),
    "thrust": _push("force", "body", "N"),
    "body-torque": _push("moment", "body", "N·m"),
    "body-tensor": CauseKind(
        "the central inertia of {element} in the run is ({shown}) kg·m² (xx, yy, zz, xy, xz, yz)",
        MASSES,
        unit="kg·m²",
        tells="J",
    ),
    "link-length": CauseKind(
        "{element} in the run is {shown} m long {origin}, not {base} m",
        LAYOUT,
        "length",
        "m",
        "positive",
    ),
    "body-size": _factor(
        "{element} in the run is {shown} times as long as in the model, with its joints, mass centre and "
        "inertia{more}",
        LAYOUT,
        "factor",
        "cJ",
    ),
    "joint-axis": _geometry(
        "the axis of joint {element} in the run is tilted by {several} rad about {axes} of its frame",
        TILTS,
        "rad",
    ),
    "joint-position": _geometry(
        "joint {element}, with all that it carries, sits {several} m further along {axes} of {origin}",
        LAYOUT,
        "m",
    ),
    "joint-pivot": _geometry(
        "the pivot of joint {element} in the run is displaced by {several} m along {axes} of {origin}; the "
        "bodies are where they are",
        LAYOUT,
        "m",
    ),
    "body-position": _geometry(
        "{origin} sits {several} m further along its {axes} on joint {element} than in the model",
        LAYOUT,
        "m",
    ),
    "joint-orientation": _geometry(
        "joint {element}, with all that it carries, is turned by {several} rad about {axes} of its frame",
        TILTS,
        "rad",
    ),
    "body-orientation": _geometry(
        "{origin} is turned by {several} rad about {axes} of its frame at joint {element}",
        TILTS,
        "rad",
    ),
    "element-length": CauseKind(
        "{origin} in the run is {shown} m, not {base} m", SAME_VALUE, "length", "m", "positive"
    ),
    "contact-size": CauseKind(
        "{origin} in the run is {shown} m, not {base} m", SAME_VALUE, "size", "m", "positive"
    ),
    "attachment": _geometry(
        "{origin} is displaced by {several} m along {axes} of the body", LAYOUT, "m"
    ),
    "contact-position": _geometry(
        "{origin} is displaced by {several} m along {axes} of the body", LAYOUT, "m"
    ),
    "law-number": CauseKind(
        "a number of {origin} in the run is {shown}, not {base}", SAME_VALUE, "number"
    ),
    "parameter": CauseKind(
        "parameter {element} in the run is {shown}, not {base}", SAME_VALUE, "value"
    ),
    "gyroscopic-terms": _factor("the gyroscopic terms of {element} are {times}", TERMS, "slip"),
    "velocity-terms": _factor(
        "the centrifugal, Coriolis and gyroscopic terms of all bodies are {times}",
        TERMS,
        sign="slip",
    ),
    "gravity-term": _factor("gravity in the equation of {element} is {times}", FORGOTTEN, "slip"),
    "velocity-term": _factor(
        "the terms in products of speeds in the equation of {element} are {times}", TERMS, "slip"
    ),
}
"""All kinds of causes. Of those that explain the same by as many numbers, the first is named first."""

PREFERENCE = tuple(KINDS)

OF_TURNING = "a viscous moment of {shown} {unit} resists the turning of {element} in space"
OF_A_BODY = "a drag of {shown} {unit} times the square of its speed acts on {element}"
WITH_A_FORCE = (
    "a spring of {numbers[0]} {unit} that the model does not have acts on joint {element}, with {numbers[1]} "
    "{units[1]} at zero"
)
TOUCHING = (
    "joint {element} touches a stop that the model does not have all the time: a stiffness of {numbers[0]} "
    "{unit} {side}"
)
"""What resists a body's turning, its drag, a spring whose force at zero is told, a stop that is always
touched."""

SLIPS, SLIPPED = (0.0, -1.0, 2.0, 0.5), 0.02
"""Factors of terms that were forgotten, or have another sign, or a 2 too many or too few; how near."""

POWERS_OF_TEN = (3, 6, 7, 9)
"""Powers of ten between units of masses and inertias: g, kg·mm², g·cm², g·mm²."""

FREE = "free"
OF_JOINTS = ("missing-friction", "missing-rotor-inertia", "constant-force")
"""What acts in joints, and not on bodies that are free."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause that may be.

    kind, element   what it would be, and of which body, joint's speed or channel
    columns         places of its columns; coefficients are linear θ + θᵀ quadratic θ
    linear          (a, d); quadratic (a, d, d) or None
    names           of its d numbers
    base            what the model has of it (d,): values are base + θ
    units           of its d numbers
    words           the sentence that tells it, of what `result.sentence` fills in
    sign            what its numbers must be, as of its `CauseKind`
    origin          "logged" or "computed" for channels; the kind of joint for what acts in joints
    limit           of |θ|
    edit            builds the mechanism with its numbers, for causes of the geometry
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
    words: str = ""
    sign: Sign = "any"
    quadratic: Array | None = None
    origin: str = ""
    limit: float = np.inf
    edit: Edit | None = None
    touching: tuple[float, float] | None = None
    stop: tuple[int, float, float] | None = None

    @property
    def name(self) -> tuple[str, str, str, tuple[str, ...], tuple[str, ...]]:
        """What it is of a mechanism: a free joint may have dampers of two units."""
        return (*self.what, self.names, self.units)

    @property
    def what(self) -> tuple[str, str, str]:
        """The same, whichever of its numbers are other ones."""
        return self.kind, self.element, self.origin

    @cached_property
    def size(self) -> int:
        """How many numbers it has."""
        return int(self.linear.shape[1])

    def rank(self, theta: Array) -> int:
        """Order of preference of causes that explain the same; factors beyond two come late.

        So do friction, rotors and motors of free joints, which have nothing to rub or turn in.
        """
        size = np.abs(self.base + theta)
        far = "1" in self.units and bool(np.any((size > 2.0) | (size < 0.5)))
        far &= self.sign != "forgotten" or bool(size[0] > SLIPPED)
        far |= self.origin == FREE and self.kind in OF_JOINTS
        place: int = PREFERENCE.index(self.kind)
        return place + len(PREFERENCE) if far else place

    def coefficients(self, theta: Array) -> Array:
        """Coefficients (a,) of its columns."""
        coefficients = self.linear @ theta
        if self.quadratic is not None:
            coefficients = coefficients + np.einsum("aij,i,j->a", self.quadratic, theta, theta)
        return np.asarray(coefficients)

    def squares(self, theta: Array) -> float:
        """Share of its effect that is of second order in its numbers, roughly; 0 where it is linear in them.

        It is their size relative to the lengths, angles or values of the model that they change.
        """
        if self.edit is None and self.quadratic is None:
            return 0.0
        whole = self.limit if np.isfinite(self.limit) else float(np.linalg.norm(self.base)) or 1.0
        return float(np.linalg.norm(theta)) / whole

    def tangent(self, theta: Array) -> Array:
        """Their derivatives (a, d)."""
        if self.quadratic is None:
            return self.linear
        both = self.quadratic + self.quadratic.transpose(0, 2, 1)
        return np.asarray(self.linear + np.einsum("aij,j->ai", both, theta))

    def scales(self, other: Candidate) -> float:
        """By how much the coefficients of another cause grow with a unit of this one's number.

        The product of a mass that is larger and a mass centre that is elsewhere is in the residual.
        """
        product = self.kind in ("body-mass", "body-inertia") and other.kind == "body-centre"
        return float(product and self.element == other.element)

    def excludes(self, other: Candidate) -> bool:
        """Whether both together would tell one number of a body twice, in sentences that contradict."""
        own, others = KINDS[self.kind].tells, KINDS[other.kind].tells
        same = self.element == other.element or "mass-scale" in (self.kind, other.kind)
        if self.kind == other.kind == "body-moment":
            return self.names == other.names
        return same and any(fact in others for fact in own)

    def possible(self, theta: Array) -> bool:
        """Whether numbers that have settled are possible: what may be forgotten is nothing or more."""
        if self.sign not in ("forgotten", "passive") or theta[0] > -(1.0 + SLIPPED) * self.base[0]:
            return True
        return self.sign == "passive" and abs(float(self.base[0] + theta[0]) + 1.0) < SLIPPED

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
        if self.kind == "late-laws" and len(theta) > 1:
            # The variance of a kernel: an exponential's, the widest in use, is the square of its delay.
            delay, square = theta[:2]
            return bool(0.5 * delay**2 <= square <= 2.0 * delay**2)
        if self.kind == "late-forces":
            # A filter has no negative variance; half of that of its delay is left to the linearisation.
            delay, square = theta
            return bool(square >= 0.5 * delay**2)
        if self.kind == "body-moment":  # of a body without inertia and forces any equation closes
            return bool(np.all((value > 0.1 * self.base) & (value < 10.0 * self.base)))
        if self.sign == "positive":
            return bool(np.all(value > 0.0))
        if self.sign == "slip":
            return any(abs(float(value[0]) - x) < SLIPPED for x in SLIPS)
        if self.sign == "forgotten":  # to first order less than nothing
            most = value[0] < 10.0 or "1" not in self.units or other_unit(value)
            return bool(most and value[0] > -self.base[0])
        return (
            self.sign in ("any", "passive")
            or bool(np.all((value > 0.1) & (value < 10.0)))
            or other_unit(value)
        )


@dataclass(frozen=True)
class Places:
    """Where columns are."""

    of: Mapping[Column, int]

    def __call__(self, *columns: Column) -> tuple[int, ...]:
        """The places of columns, none where one is missing."""
        places = [self.of.get(c) for c in columns]
        return () if None in places else tuple(p for p in places if p is not None)


def cause(
    kind: str,
    element: str,
    columns: tuple[int, ...],
    weights: Sequence[float] | Array,
    base: float | Array | Sequence[float] = 0.0,
    names: tuple[str, ...] = (),
    entry: Entry | None = None,
    **more: Any,
) -> Iterator[Candidate]:
    """A cause, if its columns are there and not all weights (a,) or (a, d) zero.

    `entry` tells a joint's units; `more` are further fields of `Candidate`.
    """
    if not columns or not np.any(weights):
        return
    kind_of_cause = KINDS[kind]
    L = np.array(weights, dtype=float).reshape(len(columns), -1)
    d = L.shape[1]
    fields = {
        "words": kind_of_cause.words,
        "sign": kind_of_cause.sign,
        "units": (of_joint(kind_of_cause.unit, entry),) * d,
        **more,
    }
    numbers = np.broadcast_to(np.asarray(base, dtype=float), d)
    yield Candidate(kind, element, columns, L, names or (kind_of_cause.number,), numbers, **fields)


def of_joint(unit: str, entry: Entry | None) -> str:
    """A unit with those of a joint's speed filled in."""
    if entry is None:
        return unit
    turning = entry.unit == "rad/s"
    F, q, J = ("N·m", "rad", "kg·m²") if turning else ("N", "m", "kg")
    return unit.format(F=F, q=q, J=J)


def other_unit(factor: Array) -> bool:
    """Whether a factor is that between two units of a mass or an inertia."""
    if factor.size != 1 or float(factor.ravel()[0]) <= 0.0:
        return False
    power = abs(float(np.log10(factor.ravel()[0])))
    return any(abs(power - p) < 0.005 for p in POWERS_OF_TEN)


def tensor(six: Array) -> Array:
    """The symmetric matrix of six moments and products of inertia."""
    J = np.zeros((3, 3))
    for value, (i, j) in zip(six, UNIT_MOMENTS):
        J[i, j] = J[j, i] = value
    return J


# --- causes that are a body's: its mass, its mass centre, its central inertia --------------------


def of_bodies(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    """Masses, moments of inertia and mass centres of each body, and all masses together."""
    system = equations.symbols.system
    whole = list[tuple[tuple[int, ...], Array]]()
    steady, gyroscopic = list[int](), list[int]()
    for link in system.links:
        if equations.mechanism.body(link.joint.child).massless:
            continue
        b = BodyMass.of(link)
        indices = [k for k in range(10) if Column("inertia", b.name, k) in places.of]
        at = places(*(Column("inertia", b.name, k) for k in indices))
        if not indices:
            continue
        mass = np.array([b.mass, *(b.mass * b.centre), *six(b.mass * steiner(b.centre))])[indices]
        moments = np.array([0.0] * 4 + six(b.central))[indices]
        whole.append((at, mass + moments))
        steady += places(Column("velocity", b.name))
        own = places(Column("gyroscopic", b.name))
        gyroscopic += own
        yield from cause("gyroscopic-terms", b.name, own, [1.0], 1.0)
        yield from cause("body-inertia", b.name, at, mass + moments, 1.0)
        yield from cause("body-mass", b.name, at, mass, 1.0)
        # Of a body without any inertia every equation closes.
        turning = [n for n, k in enumerate(indices) if 4 <= k < 7]
        still = np.all((NEGLIGIBLE * moments < mass)[turning])
        sign = "forgotten" if still else "factor"
        yield from cause("body-moments", b.name, at, moments, 1.0, sign=sign)
        yield from _centres(b, at, indices)
        yield from _moments(b, at, indices)
    if len(whole) > 1:
        columns = tuple(k for at, _ in whole for k in at)
        weights = np.concatenate([w for _, w in whole])
        yield from cause("mass-scale", "all bodies", columns, weights, 1.0)
    yield from cause("velocity-terms", "all bodies", tuple(steady), [1.0] * len(steady), 1.0)
    if len(gyroscopic) > 1:
        words = "the gyroscopic terms of all bodies are {times}"
        each = tuple(gyroscopic), [1.0] * len(gyroscopic)
        yield from cause("gyroscopic-terms", "all bodies", *each, 1.0, words=words)


def _centres(b: BodyMass, at: tuple[int, ...], indices: list[int]) -> Iterator[Candidate]:
    """The mass centre moved along an axis of the body, or anywhere; in body components."""
    L, Q = np.zeros((10, 3)), np.zeros((10, 3, 3))
    axes = b.E.T  # columns: the body's axes in the link frame
    for k in range(3):
        d = axes[:, k]
        L[1:4, k] = b.mass * d
        turned = (
            2.0 * float(b.centre @ d) * np.eye(3) - np.outer(b.centre, d) - np.outer(d, b.centre)
        )
        L[4:, k] = six(b.mass * turned)
        for l in range(3):
            e = axes[:, l]
            both = float(d @ e) * np.eye(3) - 0.5 * (np.outer(d, e) + np.outer(e, d))
            Q[4:, k, l] = six(b.mass * both)
    L, Q = L[indices], Q[indices]
    gyration = np.sqrt(0.5 * float(np.trace(b.central)) / b.mass) if b.mass else 0.0
    # It stays within the body; of a point at its own origin no size is known.
    limit = max(3.0 * gyration, float(np.linalg.norm(b.centre))) or np.inf
    shown = [k for k in range(3) if L[:, k].any()]  # of planar motion, not the axis across
    for group in [*([k] for k in shown), shown] if len(shown) > 1 else [shown]:
        if group:
            axes_of = tuple("xyz"[k] for k in group)
            curved = Q[:, group][:, :, group]
            yield from cause(
                "body-centre", b.name, at, L[:, group], names=axes_of, quadratic=curved, limit=limit
            )


def _moments(b: BodyMass, at: tuple[int, ...], indices: list[int]) -> Iterator[Candidate]:
    """Central moments of inertia, in the axes of the body."""
    L = np.zeros((10, 6))
    own = b.E @ b.central @ b.E.T
    for n, (i, j) in enumerate(UNIT_MOMENTS):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        L[4:, n] = six(b.E.T @ unit @ b.E)
    L, base, names = L[indices], np.array(six(own)), ("xx", "yy", "zz", "xy", "xz", "yz")
    for n in range(3):
        yield from cause("body-moment", b.name, at, L[:, n], base[n], (names[n],))
    yield from cause("body-tensor", b.name, at, L, base, names)


# --- all causes that a mechanism may have --------------------------------------------------------


MOST_OFFSET = {"rad": 0.2, "m": 0.1}
"""Offsets of a coordinate's zero beyond which the equations have more than squares of it."""

_FIRST, _SQUARE = np.array([1.0, 0.0]), np.array([[[0.0]], [[1.0]]])
"""A number that is the coefficient of a column, and its square that of a second one."""

PUSHES: tuple[tuple[What, str], ...] = (
    ("force", "applied-force"), ("moment", "applied-moment"), ("body-force", "thrust"),
    ("body-moment", "body-torque"),
)  # fmt: skip
"""Forces and moments on a body that a model may lack: in world components, and turning with the body."""

ON_A_SPEED: tuple[tuple[str, What], ...] = (
    ("missing-damper", "damper"), ("missing-drag", "drag"), ("missing-rotor-inertia", "armature"),
    ("missing-friction", "friction"),
)  # fmt: skip
"""What may act on a joint's speed, or alike on all of them."""


DECAYS = {
    "the linear and angular damping of Bullet": (1.0, 1.0, 1.0, 1.0),
    "the linear damping of Bullet": (1.0, 1.0, 0.0, 0.0),
    "the angular damping of Bullet": (0.0, 0.0, 1.0, 1.0),
    "a linear and angular damping of velocities": (1.0, 0.0, 1.0, 0.0),
    "a linear damping of velocities": (1.0, 0.0, 0.0, 0.0),
    "an angular damping of velocities": (0.0, 0.0, 1.0, 0.0),
}
"""What engines take from all bodies, as factors of the columns "decay". Bullet's multibodies have the forces
−k m (1 + |v|) v and the moments −k J (1 + |ω|) ω, with k = 0.04 /s unless it is switched off; ODE and PhysX
multiply velocities by 1 − k h."""


TERMS_OF_AN_EQUATION: tuple[tuple[str, What], ...] = (
    ("gravity-term", "weight term"), ("velocity-term", "velocity term"),
)  # fmt: skip
"""What equations that are written by hand may lack one of."""


def candidates(equations: LogEquations, columns: Sequence[Column]) -> tuple[Candidate, ...]:
    """All causes of a mechanism whose columns there are."""
    places = Places({column: k for k, column in enumerate(columns)})
    causes: list[Candidate] = []
    parts = [_gravity, of_bodies, _joints, _channels, _laws, _wrenches]
    if any(c.what in OF_GEOMETRY for c in columns):
        parts += [_sizes, _places_of_joints, _numbers]
    for part in parts:
        causes.extend(part(equations, places))
    # Where columns are missing, since they are zero, several numbers may mean the same as one.
    return tuple(c for c in causes if c.size == 1 or np.linalg.matrix_rank(c.linear) == c.size)


def bends(count: int) -> tuple[Column, ...]:
    """Columns of what is not linear in so many causes that are built into a model."""
    return tuple(Column("bend", "", k) for k in range(count))


def candidates_at(
    equations: LogEquations,
    columns: Sequence[Column],
    own: Sequence[Candidate],
    built: Sequence[Candidate],
    theta: Sequence[Array],
) -> tuple[Candidate, ...]:
    """All causes at a mechanism into which some of its `own` are built, with the numbers of these.

    What is built counts from the mechanism without it, as do others of that kind there: along one axis, or
    several. At a share s of it they have the column of its bend s² − 2 s times, see `linearisation.Built`.
    """
    places = Places({column: k for k, column in enumerate(columns)})
    known = {c.what: dict(zip(c.names, x, strict=True)) for c, x in zip(built, theta, strict=True)}
    place = {c.what: k for k, c in enumerate(built)}
    bases = {c.name: c.base for c in own}
    causes = [
        replace(c, base=bases.get(c.name, c.base))
        for c in candidates(equations, columns)
        if c.what not in known
    ]
    for c in own:
        if c.what not in known or c.edit is None:
            continue
        at = np.array([known[c.what].get(name, 0.0) for name in c.names])
        there = edited(equations, places, c.kind, c.element, c.edit, 0.0, c.names, at)
        bend = places(Column("bend", "", place[c.what]))
        for one in there:
            L, Q, some = one.linear, None, one.columns
            if at.any():
                share = at / float(at @ at)
                L, some = np.vstack([L, -2.0 * share]), (*some, *bend)
                Q = np.zeros((len(some), c.size, c.size))
                Q[-1] = np.outer(share, share)
            causes.append(replace(c, columns=some, linear=L, quadratic=Q, limit=np.inf))
    return tuple(causes)


def alike(candidates: Sequence[Candidate], others: Sequence[Candidate]) -> list[Candidate | None]:
    """Of some candidates those that are the same causes as others, of an equal mechanism."""
    own = {c.name: c for c in candidates}
    return [own.get(c.name) for c in others]


def _gravity(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    g = np.array([equations.mechanism.number(x) for x in equations.mechanism.gravity])
    active = [k for k in range(3) if Column("gravity", "", k) in places.of]
    columns = places(*(Column("gravity", "", k) for k in active))
    axes = tuple("xyz"[k] for k in active)
    yield from cause("gravity", "gravity", columns, g[active], 1.0)
    yield from cause("gravity-vector", "gravity", columns, np.eye(len(active)), g[active], axes)


# --- joints, channels, forces -----------------------------------------------------------------------


def _joints(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    """What may act on a joint: damper, dry friction, drag, rotor inertia, spring, stop, constant force."""
    mechanism = equations.mechanism
    acting = {c.element for c in places.of if c.what == "channel"}
    speeds = [mechanism.speeds[place] for place in equations.symbols.system.free_u]
    for joint in mechanism.joints:
        free_speeds = [
            (kind, what)
            for kind, what in ON_A_SPEED
            if not (kind == "missing-rotor-inertia" and joint.armature)
            and not (kind == "missing-friction" and f"friction {joint.name}" in acting)
        ]
        own = [entry for entry in speeds if entry.joint == joint.name]
        for unit in dict.fromkeys(e.unit for e in own):
            some = [e for e in own if e.unit == unit]
            for kind, what in free_speeds if len(some) > 1 else ():
                columns = places(*(Column(what, e.name) for e in some))
                ones = [1.0] * len(some)
                yield from cause(kind, joint.name, columns, ones, entry=some[0], origin=joint.kind)
    for entry in speeds:
        yield from _on_a_speed(equations, places, entry, acting)
        for kind, what in TERMS_OF_AN_EQUATION:
            yield from cause(kind, entry.name, places(Column(what, entry.name)), [1.0], 1.0)


def _on_a_speed(
    equations: LogEquations, places: Places, entry: Entry, acting: set[str]
) -> Iterator[Candidate]:
    """What may act on one speed of a joint."""
    mechanism, log = equations.mechanism, equations.log.places
    joint = mechanism.joint(entry.joint)
    row = entry.index - mechanism.speeds.of(joint.name).start
    of_joints = reversed(_of_joints(mechanism).items())
    own = [e for name, e in of_joints if e.joint == joint.name and name in acting]
    damper = next((e for e in own if isinstance(e, JointDamper)), None)
    spring = next((e for e in own if isinstance(e, JointSpring)), None)

    def one(kind: str, what: What, weight: float = 1.0, base: float = 0.0) -> Iterator[Candidate]:
        at = places(Column(what, entry.name))
        yield from cause(kind, entry.name, at, [weight], base, entry=entry, origin=joint.kind)

    if len(joint.speeds) > 1 or (damper is None and f"damper {joint.name}" not in acting):
        yield from one("missing-damper", "damper")
    elif damper is not None and f"damper {damper.name}" not in log:
        law = damper.damping[0]
        if isinstance(law, float):
            yield from one("damping", "damper", base=law)
    offset = places(*(Column("offset", entry.name, k) for k in range(2)))
    limit = MOST_OFFSET[of_joint("{q}", entry)]
    yield from cause(
        "zero-offset", entry.name, offset, _FIRST, entry=entry, quadratic=_SQUARE, limit=limit
    )
    if f"friction {joint.name}" not in acting:
        yield from one("missing-friction", "friction")
    yield from one("missing-drag", "drag")
    have = mechanism.number(joint.armature[row]) if joint.armature else 0.0
    yield from one("armature" if have else "missing-rotor-inertia", "armature", base=have)
    yield from _stops(equations, places, entry, row)
    if spring is None and f"spring {joint.name}" not in acting:
        yield from one("missing-spring", "spring")
        both = places(Column("spring", entry.name), Column("constant", entry.name))
        at_q = mechanism.coordinates.of(entry.joint).start + row
        reach = tuple(float(x[at_q]) for x in equations.reach)
        units = of_joint("{F}/{q}", entry), of_joint("{F}", entry)
        names = ("stiffness", "force at zero")
        for kind, words, touching in (
            ("missing-spring", WITH_A_FORCE, None), ("missing-stop", TOUCHING, reach),
        ):  # fmt: skip
            yield from cause(
                kind, entry.name, both, np.eye(2), names=names, units=units, sign="any", words=words,
                touching=touching,
            )  # fmt: skip
    elif spring is not None and row < len(spring.stiffness):
        k, rest = spring.stiffness[row], spring.rest[row]
        if isinstance(k, float) and isinstance(rest, float) and k:
            yield from one("rest-angle", "constant", k, rest)
            return  # a constant force would be the same
    yield from one("constant-force", "constant")


def _of_joints(mechanism: Mechanism) -> dict[str, JointDamper | JointSpring]:
    """Dampers and springs of joints by their channels."""
    of = {JointDamper: "damper", JointSpring: "spring"}
    elements = (e for e in mechanism.elements if isinstance(e, JointDamper | JointSpring))
    return {f"{of[type(e)]} {e.name}": e for e in elements}


def _stops(equations: LogEquations, places: Places, entry: Entry, row: int) -> Iterator[Candidate]:
    """A stop that pushes back above a place, or below it."""
    at = equations.mechanism.coordinates.of(entry.joint).start + row
    linear = places(Column("spring", entry.name), Column("constant", entry.name))
    hinge = places(*(Column("stop", entry.name, k) for k in range(len(STOPS))))
    if not linear or not hinge:
        return
    c = stops(equations, at)
    # −k max(q − c, 0), with c between two places, is the sum of such forces at both.
    above = np.eye(2)
    for k in range(len(c) - 1):
        # max(c − q, 0) = max(q − c, 0) − q + c pushes up.
        below = np.vstack([-np.eye(2), [[1.0, 1.0], [c[k], c[k + 1]]]])
        for side, L, more in (("above", above, ()), ("below", below, linear)):
            unit = of_joint("{q}", entry)
            names = tuple(f"stiffness {side} {place:.4g} {unit}" for place in c[k : k + 2])
            yield from cause(
                "missing-stop", entry.name, (*hinge[k : k + 2], *more), L, names=names, entry=entry,
                stop=(int(at), c[k], c[k + 1]),
            )  # fmt: skip


def _channels(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    mechanism = equations.mechanism
    of_joints = _of_joints(mechanism)
    for part in equations.symbols.parts:
        name = part.name
        at = places(Column("channel", name))
        logged = name in equations.log.places
        own = None if logged else of_joints.get(name)
        law = own.stiffness if isinstance(own, JointSpring) else own.damping if own else ()
        if own is not None and len(law) == 1 and isinstance(k := next(iter(law)), float) and k:
            if isinstance(own, JointSpring):  # dampers: `_on_a_speed`
                entry = mechanism.speeds[mechanism.speeds.of(own.joint)][0]
                yield from cause("stiffness", own.joint, at, [1.0 / k], k, entry=entry)
            continue
        origin = "logged" if logged else "computed"
        kind = "actuator-gear" if name.kind == "actuator" else "channel-factor"
        sign = "any" if logged or name.kind not in ("spring", "damper") else "passive"
        yield from cause(kind, name, at, [1.0], 1.0, origin=origin, sign=sign)
        delay = places(*(Column("delay", name, k) for k in range(2)))
        yield from cause("actuator-delay", name, delay, _FIRST, quadratic=_SQUARE, origin=origin)
    late = [places.of[c] for c in places.of if c.what == "delay"]
    if late:  # states that were filtered are late, and smooth, beside forces that were not
        both = np.array([[1.0 - c.index, c.index] for c in places.of if c.what == "delay"])
        yield from cause(
            "late-forces", "", tuple(late), both, names=("delay", "smoothing"), units=("s", "s²")
        )


def _laws(_: LogEquations, places: Places) -> Iterator[Candidate]:
    """Laws of time that are late, or a log that is: as many moments of its filter as the laws tell apart."""
    moments = [places.of[c] for c in places.of if c.what == "law"]
    names, units = tuple(MOMENTS), tuple(MOMENTS.values())
    for k in range(1, len(moments) + 1):
        yield from cause(
            "late-laws", "", tuple(moments[:k]), np.eye(k), names=names[:k], units=units[:k]
        )


def _wrenches(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    for link in equations.symbols.system.links:
        body = link.joint.child
        drag = places(Column("drag of a body", body))
        unit = ("N·s²/m²",)
        yield from cause("missing-drag", body, drag, [1.0], units=unit, words=OF_A_BODY)
        yield from cause("body-damping", body, places(Column("damper of a body", body, 0)), [1.0])
        turning = places(Column("damper of a body", body, 1))
        unit = ("N·m·s/rad",)
        yield from cause(
            "body-damping", body, turning, [1.0], units=unit, words=OF_TURNING, origin="turning"
        )
        for what, kind in PUSHES:
            directions = [k for k in range(3) if Column(what, body, k) in places.of]
            for group in [[k] for k in directions] + ([directions] if len(directions) > 1 else []):
                columns = places(*(Column(what, body, k) for k in group))
                axes = tuple("xyz"[k] for k in group)
                yield from cause(kind, body, columns, np.eye(len(group)), names=axes)
    for origin, factors in DECAYS.items():
        some = [(Column("decay", "", k), x) for k, x in enumerate(factors) if x]
        at = places(*(c for c, _ in some))
        yield from cause("velocity-decay", "all bodies", at, [x for _, x in some], origin=origin)


# --- geometry: places and axes of joints, lengths, points, sizes ---------------------------------------

LARGEST_CHANGE = 0.3
"""Angles (rad), and shares of a length, up to which a cause is recognised by its first order."""

ABOUT_AN_AXIS = ("revolute", "screw", "cylindrical")
"""Joints in which a turn about the axis is another zero of the coordinate."""


def edited(
    equations: LogEquations,
    places: Places,
    kind: str,
    element: str,
    edit: Edit,
    base: float = 0.0,
    names: tuple[str, ...] = (),
    theta: Array | None = None,
    **more: Any,
) -> Iterator[Candidate]:
    """A cause that is an edit of the mechanism, at equations that have it with numbers θ, none at first."""
    theta = np.zeros(max(len(names), 1)) if theta is None else theta
    weights = {c: w for c, w in edit.weights(equations, theta).items() if c in places.of}
    if weights:
        rows = np.array(list(weights.values()))
        yield from cause(kind, element, places(*weights), rows, base, names, edit=edit, **more)


def _displaced(
    equations: LogEquations,
    places: Places,
    kind: str,
    joint: Joint,
    parent: Array | None,
    child: Array | None,
    names: Sequence[str],
    element: str = "",
    **more: Any,
) -> Iterator[Candidate]:
    """A cause of each of d displacements (6, d) of a joint and of its child, and of all together."""
    whole, of = Displaced(joint.name, parent, child), element or joint.name
    rows = [w for c, w in whole.weights(equations, np.zeros(len(names))).items() if c in places.of]
    shown = [k for k in range(len(names)) if any(row[k] for row in rows)]
    for group in [[k] for k in shown] + ([shown] if len(shown) > 1 else []):
        own = tuple(names[k] for k in group)
        yield from edited(equations, places, kind, of, whole.only(group), names=own, **more)


def _directions(axis: Array | None) -> tuple[Array, tuple[str, ...]]:
    """Columns of directions (3, d) across an axis, or all three; coordinate axes where it is one."""
    if axis is None:
        return np.eye(3), tuple("xyz")
    k = int(np.argmax(np.abs(axis)))
    if abs(axis[k]) > 1.0 - 1e-12:
        others = [n for n in range(3) if n != k]
        return np.eye(3)[:, others], tuple("xyz"[n] for n in others)
    basis = np.array(perpendiculars((float(axis[0]), float(axis[1]), float(axis[2])))).T
    return basis, tuple(f"({', '.join(f'{x:.3g}' for x in d.round(9) + 0.0)})" for d in basis.T)


def _places_of_joints(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    mechanism = equations.mechanism
    carriers = {joint.child: joint for joint in mechanism.joints}

    def shifted(x: Array) -> Array:
        return np.vstack([x, np.zeros_like(x)])

    def turned(x: Array) -> Array:
        return np.vstack([np.zeros_like(x), x])

    movable = {c.element for c in places.of if c.what in ("joint-place", "body-place")}
    for joint in (j for j in mechanism.joints if j.name in movable):
        # Turns from the joint's frame into those of the parent and of the child; the direction, in the
        # joint's frame, about which a turn is another zero.
        frame, own = np.array(joint.rotation), np.array(joint.child_rotation)
        axis = np.array(joint.axes[0]) if joint.kind in ABOUT_AN_AXIS else None
        causes = partial(_displaced, equations, places, joint=joint)
        bar = bar_of(mechanism, joint)
        length = 0.0 if bar is None else float(np.linalg.norm(bar))
        if bar is not None and length:
            first = carriers[joint.parent]
            start = "its origin" if first.kind == "free" else f"joint `{first.name}`"
            yield from causes(
                "link-length", parent=shifted(bar[:, None] / length), child=None, names=["length"],
                element=joint.parent, base=length, origin=f"from {start} to joint `{joint.name}`",
                limit=LARGEST_CHANGE * length,
            )  # fmt: skip
        for c in causes(
            "joint-position",
            parent=shifted(np.eye(3)),
            child=None,
            names="xyz",
            origin=_of(joint.parent),
        ):
            along = bar is not None and c.size == 1 and abs(bar["xyz".index(c.names[0])]) == length
            if not along:  # which is the bar's length
                yield c
        across, names = _directions(None if axis is None else own @ axis)
        if joint.kind != "prismatic":
            yield from causes(
                "body-position", parent=None, child=shifted(across), names=names, origin=_of(joint.child)
            )  # fmt: skip
        if joint.kind in (*ABOUT_AN_AXIS, "universal", "spherical"):
            pivot, names = _directions(None if axis is None else frame @ axis)
            yield from causes(
                "joint-pivot", parent=shifted(pivot), child=-shifted(own @ frame.T @ pivot),
                names=names, origin=_of(joint.parent),
            )  # fmt: skip
        if joint.kind in (*ABOUT_AN_AXIS, "prismatic"):
            tilts, names = _directions(np.array(joint.axes[0]))
            yield from causes(
                "joint-axis", parent=turned(frame @ tilts), child=-turned(own @ tilts), names=names,
                limit=LARGEST_CHANGE,
            )  # fmt: skip
        if joint.kind != "free":
            turns, names = _directions(axis)
            yield from causes(
                "joint-orientation", parent=turned(frame @ turns), child=None, names=names,
                limit=LARGEST_CHANGE,
            )  # fmt: skip
            yield from causes(
                "body-orientation", parent=None, child=turned(own @ turns), names=names,
                limit=LARGEST_CHANGE, origin=_of(joint.child),
            )  # fmt: skip


def _of(body: str) -> str:
    return "the ground" if body == GROUND else f"`{body}`"


def _sizes(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    """Each body stretched about its joint: with the joints on it, its mass centre and moments of inertia."""
    for link in equations.symbols.system.links:
        name = link.joint.child
        if not equations.mechanism.body(name).massless and link.joint.kind != "free":
            yield from edited(equations, places, "body-size", name, Stretched(name), 1.0)


def _numbers(equations: LogEquations, places: Places) -> Iterator[Candidate]:
    """Lengths, points, sizes and numbers in laws, of force elements and constraints; parameters."""
    mechanism = equations.mechanism
    points: dict[str, list[Number]] = {}
    for n in geometry_numbers(mechanism)[0]:
        if Column("number", n.address) not in places.of:
            continue
        if n.axis:
            points.setdefault(n.address.removesuffix(f".{n.axis}"), []).append(n)
            continue
        limit = LARGEST_CHANGE * n.value if n.kind in ("element-length", "contact-size") else np.inf
        own = Renumbered((n.address,))
        yield from edited(
            equations, places, n.kind, n.part, own, n.value, limit=limit, origin=n.what
        )
    for numbers in points.values():
        for some in [*([n] for n in numbers), numbers] if len(numbers) > 1 else [numbers]:
            own = Renumbered(tuple(n.address for n in some))
            first, axes = some[0], tuple(n.axis for n in some)
            yield from edited(
                equations, places, first.kind, first.part, own, names=axes, origin=first.what
            )
    for name, value in mechanism.parameters.items():
        yield from edited(equations, places, "parameter", name, Reparametrised(name), value)
