"""Force elements. Each states its law, potential, sign, units and channels in its docstring.

The power of a force is positive when it adds energy to the system. A potential V(q, t) obeys
P = −V̇ + ∂V/∂t: an element whose potential depends on time (a spring whose rest length is driven) has
a second channel of kind ``prescribed``, through which ∂V/∂t flows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeAlias

from deltac.errors import ModelError, WrongType, check_names, shown
from deltac.mechanism.channels import Channel
from deltac.mechanism.laws import LawLike, LawsLike, VectorLike, as_law, symbol_names
from deltac.mechanism.parts import (
    AnyBody,
    Constants,
    FieldKind,
    JointName,
    Law,
    LawsOfMotion,
    LawsOfTime,
    MovingBody,
    NonNegative,
    NonNegativeOfTime,
    Point,
    VectorInField,
    VectorOfMotion,
    constructor,
    require_apart,
    require_count,
)
from deltac.mechanism.quantities import ZERO, Quantity, Vector, is_zero, positive, vector
from deltac.mechanism.scene import Element, Load, Scene
from deltac.mechanism.scope import Scope


@dataclass(frozen=True)
class JointSpring(Element):
    """Elastic force of a joint. Channel ``spring <name>`` (potential).

    Linear: V = ½ k (q − q0)² for each coordinate (J), generalized force −k (q − q0) (N·m or N); for a
    quaternion V = ½ k φ², φ the angle of rotation from the identity, moment −k φ n. Or any
    `potential` V(q, t) in J, a law of the joint's coordinates; the force is −∂V/∂q, exactly.
    `stiffness` k >= 0 and `rest` q0 may depend on t (then ∂V/∂t is the channel ``prescribed <name>``).
    """

    name: str
    joint: JointName
    stiffness: LawsOfTime = ()
    rest: LawsOfTime = ()
    potential: Law = None

    noun = "joint spring"

    @property
    def channel_kinds(self) -> tuple[str, ...]:
        """``spring``; ``prescribed`` too if it depends on time."""
        return _spring_kinds(*self.stiffness, *self.rest, self.potential)

    def check(self, scope: Scope) -> None:
        """InputError for an unknown joint, unknown symbols, too few or too many laws."""
        super().check(scope)
        coordinates, _ = scope.joint(self.joint, self.where)
        if self.potential is not None:
            allowed = (*scope.in_time, *(f"q.{entry.name}" for entry in coordinates))
            scope.laws([self.potential], allowed, f"potential of {self.where}")
            return
        # A quaternion turns as one: one spring for its four components.
        plain = [entry for entry in coordinates if not entry.quaternion]
        springs = len(plain) + (len(plain) < len(coordinates))
        require_count(self.stiffness, springs, f"stiffness of {self.where}")
        require_count(self.rest, springs, f"rest of {self.where}")

    def channels(self, scene: Scene) -> list[Channel]:
        """The spring; ∂V/∂t too where it depends on time."""
        if self.potential is not None:
            V, force, explicit = scene.from_potential(self.joint, self.potential)
            return self.spring_channels(scene.on_joint(self.joint, force), V, explicit)
        plain, quaternion = scene.coordinates(self.joint)
        stiffness = [scene.number(law) for law in self.stiffness]
        stretches = [q - scene.number(rest) for q, rest in zip(plain, self.rest)]
        forces = [-k * x for k, x in zip(stiffness, stretches)]
        if quaternion is not None:
            # Rotation vector φ n by the half angle; of q and −q the shorter turn is meant.
            w, v = quaternion[0], quaternion[1:]
            sine = scene.sqrt(scene.dot(v, v))
            turn = 2 * scene.atan2(sine, scene.abs(w))
            turned = sine > 1e-12 * scene.abs(w)
            per_sine = scene.where(turned, turn / scene.where(turned, sine, 1), 2 / scene.abs(w))
            forces.append(-stiffness[-1] * per_sine * scene.where(w < 0, -1, 1) * v)
            stretches.append(turn)
        V = sum(0.5 * k * x**2 for k, x in zip(stiffness, stretches))
        explicit = sum(0.5 * scene.time_rate(k) * x**2 for k, x in zip(self.stiffness, stretches))
        for k, x, rest in zip(stiffness, stretches[: len(plain)], self.rest):
            explicit -= k * x * scene.time_rate(rest)
        return self.spring_channels(scene.on_joint(self.joint, forces), V, explicit)


@constructor
@dataclass(frozen=True)
class JointDamper(Element):
    """Viscous force of a joint: −c u for each speed (N·m or N). Channel ``damper <name>``.

    `damping` c (N·m·s/rad or N·s/m) is a law, one for each speed; c >= 0 takes energy out. A number below
    zero is refused unless `allow_energy_source`.
    """

    name: str
    joint: JointName
    damping: LawsOfMotion
    allow_energy_source: bool = field(default=False, repr=False, kw_only=True)

    noun = "joint damper"
    channel_kinds = ("damper",)

    def check(self, scope: Scope) -> None:
        """InputError for an unknown joint, unknown symbols, a damping that would create energy."""
        super().check(scope)
        _, speeds = scope.joint(self.joint, self.where)
        require_count(self.damping, len(speeds), f"damping of {self.where}")
        for law in self.damping:
            if not self.allow_energy_source and scope.is_constant(law):
                scope.takes_energy(law, f"damping of {self.where}")

    def channels(self, scene: Scene) -> list[Channel]:
        """−c u for each speed."""
        force = -scene.vector(self.damping) * scene.speeds(self.joint)
        return [self.channel("damper", scene.on_joint(self.joint, force))]


@constructor
@dataclass(frozen=True)
class JointTorque(Element):
    """Generalized force of a motor on a joint's speeds (N·m or N). Channel ``actuator <name>``.

    `torque` holds a law of t, q, u for each speed, positive in the direction of the speed, acting on
    the child (and in reverse on the parent); None when a controller or a log supplies it.
    """

    name: str
    joint: JointName
    torque: LawsOfMotion = None

    noun = "joint torque"
    channel_kinds = ("actuator",)

    def check(self, scope: Scope) -> None:
        """InputError for an unknown joint, unknown symbols, too few or too many laws."""
        super().check(scope)
        _, speeds = scope.joint(self.joint, self.where)
        if self.torque is not None:
            require_count(self.torque, len(speeds), f"torque of {self.where}")

    def channels(self, scene: Scene) -> list[Channel]:
        """The law, or what a controller or a log gives."""
        logged = self.torque is None
        force = scene.inputs(self.name) if self.torque is None else scene.vector(self.torque)
        return [self.channel("actuator", scene.on_joint(self.joint, force), logged=logged)]


@constructor
@dataclass(frozen=True)
class PointForce(Element):
    """A force at a point of a body and a moment on it. Channel ``applied <name>``.

    `force` (N) and `moment` (N·m) are three laws of t, q, u each; components in the world frame, or
    in the body frame if `frame` is "body". `point` (m) in body components.
    """

    name: str
    body: MovingBody
    force: VectorOfMotion = ZERO
    point: Point = ZERO
    moment: VectorOfMotion = field(default=ZERO, kw_only=True)
    frame: Literal["world", "body"] = field(default="world", kw_only=True)

    noun = "point force"
    channel_kinds = ("applied",)

    def channels(self, scene: Scene) -> list[Channel]:
        """The force at the point and the moment on the body."""
        force, moment = scene.vector(self.force), scene.vector(self.moment)
        if self.frame == "body":
            R = scene.rotation(self.body)
            force, moment = R @ force, R @ moment
        load = (scene.point(self.body, self.point), force, moment)
        return [self.channel("applied", scene.generalized([load]))]


@constructor
@dataclass(frozen=True)
class ForceField(Element):
    """A field that acts at a point of a body: gravity of a distant mass, magnetic, drag of a stream.

    `force` (N) are three laws of the place x, y, z (m) and the velocity vx, vy, vz (m/s) of the `point`,
    relative to the frame of the body `on` and in its components, and of t, q, u. Or `potential` V(x, y, z, t)
    (J), whose force is −∂V/∂(x, y, z), exactly. The opposite force acts on `on`, at the same place. Channels
    ``applied <name>``; ``spring <name>`` of a potential, with ∂V/∂t in ``prescribed <name>``.

    Raises:
        InputError: both or none of `force` and `potential`; unknown symbols; a body that acts on itself.
    """

    name: str
    body: MovingBody
    force: VectorInField = ZERO
    point: Point = ZERO
    potential: Law = field(default=None, kw_only=True)
    on: AnyBody = field(default="ground", kw_only=True)

    noun = "force field"

    @property
    def channel_kinds(self) -> tuple[str, ...]:
        """``applied``, or the kinds of a potential."""
        return ("applied",) if self.potential is None else _spring_kinds(self.potential)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_apart(self.body, self.on, self.where)
        if (self.potential is None) == all(is_zero(law) for law in self.force):
            raise ModelError(
                f"{self.where}: give force=, three laws of x, y, z, vx, vy, vz, or potential=, one of x, y, z"
            )

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        super().check(scope)
        scope.laws([self.potential], scope.on_surface, f"potential of {self.where}")

    def channels(self, scene: Scene) -> list[Channel]:
        """The force at the point, and the opposite one on the body of the field."""
        point = scene.point(self.body, self.point)
        R, x = scene.rotation(self.on), scene.local(self.on, point.place)
        opposite = scene.point_at(self.on, point.place)

        def acting(force: Any) -> Any:
            return scene.generalized([(point, R @ force), (opposite, -(R @ force))])

        if self.potential is not None:
            V, force, explicit = scene.field(self.potential, x)
            return self.spring_channels(acting(force), V, explicit)
        v = R.T @ (point.velocity - opposite.velocity)
        at = {axis: x[k] for k, axis in enumerate("xyz")}
        at |= {f"v{axis}": v[k] for k, axis in enumerate("xyz")}
        return [self.channel("applied", acting(scene.vector(self.force, at)))]


@constructor
@dataclass(frozen=True)
class SpringDamper(Element):
    """Spring and damper between two points. Channels ``spring <name>`` (potential), ``damper <name>``.

    With the distance d of the points, V = ½ k (d − d0)² (J) and the tension is k (d − d0) + c ḋ (N),
    positive when it pulls the points together. `stiffness` k and `length` d0 may depend on t (then
    ∂V/∂t is the channel ``prescribed <name>``). The direction is undefined at d = 0 unless d0 = c = 0.
    """

    name: str
    body1: AnyBody
    point1: Point = field(default=ZERO, kw_only=True)
    body2: AnyBody
    point2: Point = field(default=ZERO, kw_only=True)
    stiffness: NonNegativeOfTime = field(default=0.0, kw_only=True)
    damping: NonNegative = field(default=0.0, kw_only=True)
    length: NonNegativeOfTime = field(default=0.0, kw_only=True)

    noun = "spring-damper"

    @property
    def channel_kinds(self) -> tuple[str, ...]:
        """``spring`` and ``damper``; ``prescribed`` too if the spring depends on time."""
        return ("damper", *_spring_kinds(self.stiffness, self.length))

    def __post_init__(self) -> None:
        super().__post_init__()
        require_apart(self.body1, self.body2, self.where)

    def channels(self, scene: Scene) -> list[Channel]:
        """The spring, ∂V/∂t too where it depends on time, and the damper."""
        first = scene.point(self.body1, self.point1)
        second = scene.point(self.body2, self.point2)
        between = second.place - first.place
        channels: list[Channel] = []
        if not is_zero(self.stiffness):
            k, rest = scene.number(self.stiffness), scene.number(self.length)
            k_rate, rest_rate = scene.time_rate(self.stiffness), scene.time_rate(self.length)
            if is_zero(self.length):
                # Without a rest length the force is −k times the vector: smooth through coincident points.
                square, pull = scene.dot(between, between), k * between
                V, explicit = 0.5 * k * square, 0.5 * k_rate * square
            else:
                distance = scene.sqrt(scene.dot(between, between))
                stretch = distance - rest
                pull = k * stretch * (between / distance)
                V = 0.5 * k * stretch**2
                explicit = 0.5 * k_rate * stretch**2 - k * stretch * rest_rate
            force = scene.generalized([(first, pull), (second, -pull)])
            channels += self.spring_channels(force, V, explicit)
        if not is_zero(self.damping):
            along = between / scene.sqrt(scene.dot(between, between))
            parting = scene.dot(along, second.velocity - first.velocity)
            pull = scene.number(self.damping) * parting * along
            force = scene.generalized([(first, pull), (second, -pull)])
            channels.append(self.channel("damper", force))
        return channels


@dataclass(frozen=True)
class Branch:
    """A polyline through points of bodies: (body, point in its frame) each, in order.

    Its length counts `factor` times in that of its tendon: 1, or 1/divisor behind a pulley.
    """

    points: tuple[tuple[str, Vector], ...]
    factor: Quantity


@dataclass(frozen=True)
class Tendon(Element):
    """A cord with spring and damper. Channels ``spring <name>`` (potential), ``damper <name>``.

    Its length is l = Σ c_i q_i over `coordinates` (of joints whose speeds are their rates) plus the
    lengths of its `branches`. The stretch x is l − l1 above the band [l0, l1] = `length`, l − l0 below
    it, and 0 within. With `stiffness` (a, b, c, …), V = ½ a x² + ⅓ b x³ + ¼ c x⁴ + … (J) and the tension
    is a x + b x² + c x³ + …; `damping` (a, b, c, …) adds a l̇ + b l̇|l̇| + c l̇³ + …. Tension is positive
    when it shortens the cord: the generalized force is −(∂l/∂q) times it (N or N·m). Smooth if l0 = l1
    and there is no even power of l̇; a segment whose ends coincide has no direction.
    """

    name: str
    coordinates: tuple[tuple[str, Quantity], ...]
    branches: tuple[Branch, ...]
    stiffness: Constants
    damping: Constants
    length: Constants

    noun = "tendon"
    channel_kinds = ("spring", "damper")

    def check(self, scope: Scope) -> None:
        """InputError for unknown names, coordinates whose rates are no speeds, an empty band."""
        for name, factor in self.coordinates:
            self._check_coordinate(scope, name)
            scope.laws([factor], scope.constants, f"coefficient of {name!r} in {self.where}")
        for branch in self.branches:
            scope.laws([branch.factor], scope.constants, f"factor of a branch of {self.where}")
            for body, point in branch.points:
                scope.body(body, self.where)
                scope.laws(point, scope.constants, f"a point of {self.where}")
        super().check(scope)
        low, high = (scope.number(end) for end in self.length)
        if low > high:
            raise ModelError(
                f"length of {self.where}: the band from {low:g} to {high:g} is empty; swap them"
            )

    def _check_coordinate(self, scope: Scope, name: str) -> None:
        check_names([name], scope.coordinates.names, f"{self.where}: unknown coordinate")
        if not scope.rate_is_speed(name):
            raise ModelError(
                f"{self.where}: the rate of {name!r} is no speed of joint "
                f"{scope.coordinates[name].joint!r}; a tendon takes coordinates of joints without "
                "quaternions"
            )

    def channels(self, scene: Scene) -> list[Channel]:
        """The cord's spring and damper, along the gradient of its length."""
        length, J = self._length(scene)
        low, high = (scene.number(end) for end in self.length)
        stretch = length - low
        if self.length[0] != self.length[1]:
            stretch = scene.maximum(length - high, 0) + scene.minimum(stretch, 0)
        channels: list[Channel] = []
        if not all(is_zero(a) for a in self.stiffness):
            a = [scene.number(law) for law in self.stiffness]
            potential = sum(a[k] * stretch ** (k + 2) / (k + 2) for k in range(len(a)))
            tension = sum(a[k] * stretch ** (k + 1) for k in range(len(a)))
            channels.append(self.channel("spring", -tension * J, potential))
        if not all(is_zero(a) for a in self.damping):
            rate = scene.power(J)
            # Even powers with the sign of the rate: v |v|.
            powers = [
                rate ** (k + 1) if k % 2 == 0 else rate**k * scene.abs(rate)
                for k in range(len(self.damping))
            ]
            tension = sum(scene.number(c) * power for c, power in zip(self.damping, powers))
            channels.append(self.channel("damper", -tension * J))
        return channels

    def _length(self, scene: Scene) -> tuple[Any, Any]:
        """The length and its gradient J (nu,) along the speeds: l̇ = J·u."""
        length, J = scene.number(0.0), scene.generalized([])
        for name, law in self.coordinates:
            q, along = scene.coordinate(name)
            factor = scene.number(law)
            length += factor * q
            J += factor * along
        for branch in self.branches:
            factor = scene.number(branch.factor)
            for (body, point), (next_body, next_point) in pairwise(branch.points):
                first, second = scene.point(body, point), scene.point(next_body, next_point)
                between = second.place - first.place
                distance = scene.sqrt(scene.dot(between, between))
                length += factor * distance
                if body != next_body:  # within one body nothing changes
                    pull = factor * between / distance
                    J -= scene.generalized([(first, pull), (second, -pull)])
        return length, J


def _fractions(value: Any, where: str) -> tuple[tuple[str, Quantity], ...]:
    if not isinstance(value, Mapping | tuple):  # a tuple: as they are kept
        raise WrongType(f"{where}: found {shown(value)}, expected a mapping of bodies to fractions")
    pairs = value.items() if isinstance(value, Mapping) else value
    return tuple((body, as_law(c, f"{where}, {body!r}")) for body, c in pairs)


Fractions: TypeAlias = Annotated[Any, FieldKind(_fractions)]
"""Fractions by the names of bodies."""


@constructor
@dataclass(frozen=True)
class GravityCompensation(Element):
    """Upward forces that carry a fraction of bodies' weights. Channel ``applied <name>``.

    `fractions` are c by the names of bodies: the force −c m g acts at the body's mass centre (N; c = 1
    carries all of it). It takes energy out of a body that sinks; its potential is not told apart.
    """

    name: str
    fractions: Fractions

    noun = "gravity compensation"
    channel_kinds = ("applied",)

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        for name, fraction in self.fractions:
            scope.body(name, self.where, ground=False)
            scope.laws([fraction], scope.constants, f"fraction of {name!r} in {self.where}")

    def channels(self, scene: Scene) -> list[Channel]:
        """−c m g at the mass centres."""
        loads: list[Load] = [
            (scene.mass_centre(body), -scene.number(c) * scene.weight(body))
            for body, c in self.fractions
        ]
        return [self.channel("applied", scene.generalized(loads))]


def _spring_kinds(*laws: Any) -> tuple[str, ...]:
    """Kinds of a spring's channels: ∂V/∂t of laws of time flows through ``prescribed``."""
    in_time = any("t" in symbol_names(law) for law in laws if law is not None)
    return ("spring", "prescribed") if in_time else ("spring",)


@constructor
def joint_spring(
    name: str,
    joint: str,
    stiffness: LawsLike | None = None,
    rest: LawsLike = 0.0,
    *,
    torque: LawLike | None = None,
    potential: LawLike | None = None,
) -> JointSpring:
    """A spring on a joint's coordinates; see `JointSpring`.

    Give exactly one of: `stiffness` (with `rest`), `potential` (a law of the joint's coordinates), or
    `torque`, a stiffness curve: the moment as a law of the joint's single coordinate, whose
    potential −∫ torque dq is found in closed form (InputError if it has none).
    """
    where = JointSpring.called(name)
    choices = [stiffness is not None, torque is not None, potential is not None]
    if sum(choices) != 1:
        raise ModelError(f"{where}: give exactly one of stiffness, torque and potential")
    if stiffness is not None:
        return JointSpring(name, joint, stiffness=stiffness, rest=rest)
    if torque is not None:
        potential = _integral(as_law(torque, f"torque of {where}"), joint, where)
    return JointSpring(name, joint, potential=potential)


@constructor
def tendon(
    name: str,
    path: Sequence[tuple[str, VectorLike]] = (),
    *,
    coordinates: Mapping[str, LawLike] | None = None,
    branches: Sequence[tuple[Sequence[tuple[str, VectorLike]], LawLike]] = (),
    stiffness: LawsLike = 0.0,
    damping: LawsLike = 0.0,
    length: LawsLike = 0.0,
) -> Tendon:
    """A cord through points of bodies, or a linear combination of coordinates; see `Tendon`.

    `path` lists (body, point) in order; `coordinates` maps names of coordinates to coefficients;
    `branches` lists (path, factor) for pulleys. `stiffness` and `damping` are a number or the
    coefficients of a polynomial; `length` is the length at rest (m), or a band (low, high) without force.

    >>> cable = tendon(
    ...     "cable", [("ground", (0, 0, 1)), ("arm", (0.2, 0, 0))], stiffness=80.0, length=0.9
    ... )
    >>> coupling = tendon("coupling", coordinates={"hip": 1.0, "knee": -0.5}, damping=0.1)
    """
    where = Tendon.called(name)
    paths = [*([(path, 1.0)] if len(path) else []), *branches]
    ends = length if isinstance(length, list | tuple) else (length, length)
    if len(ends) != 2:
        raise ModelError(f"length of {where}: expected one length or two, found {length!r}")
    element = Tendon(
        name,
        tuple(
            (coordinate, as_law(factor, f"coefficient of {coordinate!r} in {where}"))
            for coordinate, factor in (coordinates or {}).items()
        ),
        tuple(_branch(points, factor, where) for points, factor in paths),
        stiffness,
        damping,
        ends,
    )
    if not element.coordinates and not element.branches:
        raise ModelError(f"{where} has no length; give a path of points, or coordinates")
    return element


def _branch(points: Sequence[tuple[str, VectorLike]], factor: Any, where: str) -> Branch:
    if len(points) < 2:
        raise ModelError(f"{where}: a path needs two points or more, found {len(points)}")
    try:
        pairs = [(body, point) for body, point in points]
    except (TypeError, ValueError):
        raise ModelError(
            f"{where}: a path is made of (body, point) pairs, found {points!r}"
        ) from None
    return Branch(
        tuple((body, vector(point, f"a point of {where}")) for body, point in pairs),
        positive(factor, f"factor of a branch of {where}"),
    )


def _integral(torque: LawLike, joint: str, where: str) -> Any:
    """−∫ torque dq from 0 to q, in closed form."""
    import sympy

    coordinate = sympy.Symbol(f"q.{joint}", real=True)
    potential = -sympy.integrate(torque, (coordinate, 0, coordinate))
    if potential.has(sympy.Integral):
        raise ModelError(
            f"{where}: no closed form was found for the potential of the stiffness curve {torque}; "
            "give potential= instead of torque="
        )
    return potential


gravity_compensation = GravityCompensation
joint_damper = JointDamper
joint_torque = JointTorque
force_field = ForceField
point_force = PointForce
spring_damper = SpringDamper
