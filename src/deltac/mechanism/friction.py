"""Friction: one law of the slip speed, in joints and at points. Its heat is the channel ``friction``.

Friction is regularised: it passes smoothly through zero within a `width` of slip speed, so that it is a
force like any other. Nothing sticks in full: below its strength the law creeps. The ledger books the
heat of the law as it is, so the balance closes whatever the width; what the width changes is the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeAlias

from deltac.arrays import ROOT_EPS
from deltac.errors import ModelError
from deltac.mechanism.channels import Channel
from deltac.mechanism.laws import LawsLike, as_law
from deltac.mechanism.parts import (
    AnyBody,
    Axis,
    Constant,
    Declared,
    FieldKind,
    JointName,
    Law,
    LawOfMotion,
    Point,
    Positive,
    constructor,
    require_apart,
    require_count,
)
from deltac.mechanism.quantities import ZERO, Quantity
from deltac.mechanism.scene import Element, Expr, Scene
from deltac.mechanism.scope import GROUND, Scope

SLIP_WIDTH = 1e-3
"""Width of the regularisation (m/s or rad/s), if none is given: Drake's default stiction tolerance."""

SOFTENING = ROOT_EPS
"""Slip speeds are softened by this part of the width: the direction of no slip is then no 0/0.

The force errs by less than 10⁻¹⁶ of itself above a hundred-millionth of the width.
"""


@constructor
@dataclass(frozen=True)
class FrictionLaw(Declared):
    """Friction f against the slip speed v >= 0: f = (c + (s − c) e^{−(v/v_S)²}) tanh(v/w) + b v.

    `coulomb` c is the strength in slip, `static` s that about rest, `stribeck` v_S the speed at which the
    excess has fallen to 1/e, `viscous` b the slope, `width` w that of the regularisation. In joints f is
    a force or moment, at points and in contacts a coefficient on the normal force. The excess after
    B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083-1138, equation (4).

    Compared with ideal Coulomb friction μ N (s = c, b = 0), the width w has these effects. In slip the force
    is less by the fraction 1 − tanh(v/w) < 2 e^{−2v/w}, equal in double precision beyond 19 w. Under a load
    F < μ N, instead of rest, it creeps at w artanh(F/μN). The heat over a time t is less by at most
    0.2785 w μ N t, since v (1 − tanh(v/w)) ≤ 0.2785 w. Slip decays within τ = m_eff w/(μ N), which limits an
    explicit step. Take w below a tenth of v_S, or the law never reaches s. By default s = c; `static` comes
    with `stribeck`.

    >>> steel = friction_law(0.15, static=0.2, stribeck=0.01, width=1e-4)
    """

    coulomb: Law
    static: Law = field(default=None, kw_only=True)
    stribeck: Positive = field(default=None, kw_only=True)
    viscous: Constant = field(default=0.0, kw_only=True)
    width: Positive = field(default=SLIP_WIDTH, kw_only=True)

    where = "friction law"

    def __post_init__(self) -> None:
        super().__post_init__()
        static = self.coulomb if self.static is None else self.static
        needless = self.static is None and self.stribeck is not None
        if needless or (self.stribeck is None and static != self.coulomb):
            raise ModelError(
                f"{self.where}: static friction needs the speed over which it falls to Coulomb's; give both "
                "static and stribeck, or neither"
            )
        object.__setattr__(self, "static", static)

    @property
    def strengths(self) -> tuple[Quantity, ...]:
        """What must not be negative, or friction would drive: c, s, b."""
        return (self.coulomb, self.static, self.viscous)

    def check(self, scope: Scope, where: str, allowed: Sequence[str], *, source: bool) -> None:
        """InputError for unknown symbols, and for friction that would drive unless `source` allows it.

        `allowed` are the symbols of the strengths. A strength that depends on t, q or u is not checked
        for its sign.
        """
        scope.laws((self.coulomb, self.static), allowed, f"friction of {where}")
        self.check_fields(scope, where)
        if source:
            return
        for strength in self.strengths:
            if scope.is_constant(strength):
                scope.takes_energy(strength, f"friction of {where}")
        if scope.is_constant(self.coulomb) and scope.is_constant(self.static):
            c, s = scope.number(self.coulomb), scope.number(self.static)
            if s < c:
                raise ModelError(
                    f"friction of {where}: static {s:g} is below coulomb {c:g}; friction near rest is at "
                    f"least that in slip"
                )

    def strength(self, scene: Scene, square: Expr) -> Expr:
        """The strength c + (s − c) e^{−(v/v_S)²} at the square of the slip speed."""
        c = scene.number(self.coulomb)
        if self.stribeck is None:
            return c
        excess = scene.number(self.static) - c
        return c + excess * scene.exp(-square / scene.number(self.stribeck) ** 2)

    def slip_force(self, scene: Scene, normal_force: Expr, n: Expr, velocity: Expr) -> Expr:
        """−N f(|v_t|) v_t/|v_t| (3,), v_t the part of the velocity across n."""
        slip = velocity - scene.dot(n, velocity) * n
        square = scene.dot(slip, slip)
        width = scene.number(self.width)
        speed = scene.sqrt(square + (SOFTENING * width) ** 2)
        per_speed = self.strength(scene, square) * scene.tanh(speed / width) / speed
        return -normal_force * (per_speed + scene.number(self.viscous)) * slip


friction_law = FrictionLaw


def as_friction(value: Any, where: str) -> FrictionLaw:
    """A friction law as it is, or Coulomb's of a number or law."""
    return value if isinstance(value, FrictionLaw) else FrictionLaw(as_law(value, where))


Friction: TypeAlias = Annotated[Any, FieldKind(as_friction)]
"""A friction law, or Coulomb's coefficient."""


@dataclass(frozen=True)
class JointFriction(Element):
    """Friction of a joint, one law for each speed: −f(|u|) sign u (N·m or N). Channel ``friction <name>``.

    `laws` act on the speeds one by one, in the joint's own directions; they do not depend on the joint's
    load. Power −f(|u|) |u| <= 0.
    """

    name: str
    joint: JointName
    laws: tuple[FrictionLaw, ...]
    allow_energy_source: bool = field(default=False, repr=False)

    noun = "joint friction"
    channel_kinds = ("friction",)

    def check(self, scope: Scope) -> None:
        """InputError for an unknown joint, and laws that do not fit; see `FrictionLaw.check`."""
        super().check(scope)
        _, speeds = scope.joint(self.joint, self.where)
        require_count(self.laws, len(speeds), f"laws of {self.where}")
        for law in self.laws:
            law.check(scope, self.where, scope.in_motion, source=self.allow_energy_source)

    def channels(self, scene: Scene) -> list[Channel]:
        """−f(|u|) sign u on each speed of the joint."""
        forces, speeds = [], scene.speeds(self.joint)
        for k, law in enumerate(self.laws):
            u = speeds[k]
            # Odd in u already: tanh changes sign, and the excess is even.
            dry = law.strength(scene, u**2) * scene.tanh(u / scene.number(law.width))
            forces.append(-dry - scene.number(law.viscous) * u)
        return [self.channel("friction", scene.on_joint(self.joint, forces))]


@constructor
@dataclass(frozen=True)
class PointFriction(Element):
    """Friction at a point of a body that slides along a plane. Channel ``friction <name>``.

    With the velocity v of the body's point relative to the material of `on` in the same place, and its
    part v_t across `normal` (fixed in `on`), the force on the body is −N f(|v_t|) v_t/|v_t| (N), its
    opposite acts on `on` there. N >= 0 is `normal_force` (N), a law of t, q, u and parameters; it is the
    strength of friction only: something else (a joint, a constraint) carries it. Where the law is
    negative it counts as zero. Power −N f |v_t| <= 0. `friction` is a coefficient or a `friction_law`.

    >>> block = point_friction("rub", "block", "m*9.81*cos(0.3)", 0.2, normal="y")
    """

    name: str
    body: AnyBody
    normal_force: LawOfMotion
    friction: Friction
    point: Point = field(default=ZERO, kw_only=True)
    on: AnyBody = field(default=GROUND, kw_only=True)
    normal: Axis = field(default="z", kw_only=True)
    allow_energy_source: bool = field(default=False, repr=False, kw_only=True)

    noun = "point friction"
    channel_kinds = ("friction",)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_apart(self.body, self.on, self.where)

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols, and a law that does not fit."""
        super().check(scope)
        self.friction.check(scope, self.where, scope.in_motion, source=self.allow_energy_source)

    def channels(self, scene: Scene) -> list[Channel]:
        """−N f(|v_t|) v_t/|v_t| at the body's point, its opposite on the body beneath."""
        touch = scene.sliding(self.body, self.point, self.on, self.normal)
        strength = scene.maximum(scene.number(self.normal_force), 0)
        force = self.friction.slip_force(scene, strength, touch.n, touch.relative_velocity)
        return [self.channel("friction", scene.generalized(touch.loads(force)))]


@constructor
def joint_friction(
    name: str,
    joint: str,
    coulomb: LawsLike = 0.0,
    *,
    static: LawsLike | None = None,
    stribeck: LawsLike | None = None,
    viscous: LawsLike = 0.0,
    width: LawsLike = SLIP_WIDTH,
    allow_energy_source: bool = False,
) -> JointFriction:
    """Friction of a joint; see `JointFriction` and `FrictionLaw`.

    Each of the numbers may be a sequence, one for each speed of the joint. `coulomb` and `static` may be
    laws of t, q, u and parameters (a clutch that closes); the others are numbers or parameters.
    A negative strength would drive the joint: InputError unless `allow_energy_source`, in which case
    what it gives is booked in the channel.
    """
    where = JointFriction.called(name)
    columns = [coulomb, static, stribeck, viscous, width]
    count = max((len(c) for c in columns if isinstance(c, list | tuple)), default=1)
    for c in columns:
        if isinstance(c, list | tuple) and len(c) != count:
            raise ModelError(f"{where}: expected {count} values, found {c!r}")
    rows = zip(*(list(c) if isinstance(c, list | tuple) else [c] * count for c in columns))
    laws = tuple(
        friction_law(c, static=s, stribeck=v, viscous=b, width=w) for c, s, v, b, w in rows
    )
    return JointFriction(name, joint, laws, allow_energy_source)


point_friction = PointFriction
