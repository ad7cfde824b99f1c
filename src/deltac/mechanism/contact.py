"""Compliant contact of two shapes: an elastic normal force with dissipation, and friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from deltac.errors import ModelError
from deltac.mechanism.channels import Channel
from deltac.mechanism.friction import Friction
from deltac.mechanism.parts import Constant, NonNegative, Positive, constructor
from deltac.mechanism.quantities import Quantity, is_zero
from deltac.mechanism.scene import Element, Expr, Load, Scene
from deltac.mechanism.scope import Scope
from deltac.mechanism.shapes import Box, Capsule, Shape, Sphere, check_pair

Model = Literal["hunt-crossley", "kelvin-voigt"]
"""Models of the dissipation in compliant contact."""


@constructor
@dataclass(frozen=True)
class Contact(Element):
    """Compliant contact. Channels ``spring <name>`` (potential), ``contact``, ``friction <name>``.

    At every contact point of the two shapes (`dynamics.gaps` lists them) with overlap x = −g > 0:

    - elastic force f_e = k xⁿ along n, potential V = k xⁿ⁺¹/(n + 1) (J), channel ``spring``;
    - dissipation, channel ``contact``: what makes f_e the normal force f_n = f_e (1 + d ẋ)₊
      (Hunt–Crossley) or f_n = (f_e + c ẋ)₊ (Kelvin–Voigt). (·)₊ is the positive part: the shapes never
      pull at each other. Power (f_e − f_n) ẋ <= 0;
    - friction, channel ``friction``: −f_n f(|v_t|) v_t/|v_t| on the first body, v_t the slip velocity.

    Hunt–Crossley: K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440-445. It is continuous. The
    speed after an impact follows from v − ln(1 + d v)/d, which is the same before and after, with v
    positive into the surface: a ball never leaves faster than 1/d. Kelvin–Voigt jumps by c ẋ as the shapes
    meet. Other programs write the same force as

    - Drake, "Modeling Dissipation": f = k x (1 − d v_n)₊, v_n the speed of parting: ``exponent=1``,
      ``dissipation=d``
    - Simbody, HuntCrossleyForce: f = 4/3 √R E x^{3/2} (1 + 3/2 c ẋ): ``exponent=1.5``, ``dissipation=1.5*c``
    - Chrono (SMC), Flores: f = k_n δ + g_n δ̇, k_n = 4/3 E √(R δ), g_n = 8 (1 − e) k_n δ/(5 e v):
      ``exponent=1.5``, ``dissipation=8*(1 - e)/(5*e*v)``

    MuJoCo's contacts are soft constraints, a different model. Contact points:

    - sphere or point with sphere, capsule, box, half-space: 1, the closest
    - capsule with capsule: 1, the closest; for parallel capsules one of many closest pairs
    - capsule with half-space: 2, its ends; with box: 10, its ends against the box and the box's corners
      against the capsule
    - box with half-space: 8, its corners; with box: 16, the corners of each against the other

    `stiffness` k (N/mⁿ) and all else is per contact point: a box that lies on a plane has four springs. Edges
    across edges of boxes, or across the side of a capsule, are not detected. Corner on corner, both push.
    Inside a box the normal jumps where the nearest face changes, so keep overlaps small.

    Args:
        name: of the element; its channels carry it.
        first: a shape, as `deltac.shapes` makes them.
        second: the other shape, of another body or the ground.
        stiffness: k of the elastic force k xⁿ at each contact point, N/mⁿ.
        exponent: n >= 1: 1 is linear, 1.5 is Hertz's contact of spheres, k = 4/3 E* √R.
        dissipation: d of Hunt and Crossley (s/m), or c of Kelvin and Voigt (N·s/m).
        model: "hunt-crossley" or "kelvin-voigt".
        friction: a coefficient or a `friction_law`; None for none.
        deepest: the overlap (m) at which a simulation may still start; by default a tenth of the
            smallest dimension of the two shapes.
        allow_energy_source: let dissipation and friction be negative; what they give is booked.

    Raises:
        InputError: shapes of one body or without a contact, an unknown model, a stiffness that is not
            positive, an exponent below 1, negative dissipation or friction.
    """

    name: str
    first: Shape
    second: Shape
    stiffness: Positive
    exponent: Constant = field(default=1.0, kw_only=True)
    model: Model = field(default="hunt-crossley", kw_only=True)
    dissipation: Constant = field(default=0.0, kw_only=True)
    friction: Friction = field(default=None, kw_only=True)
    deepest: NonNegative = field(default=None, kw_only=True)
    allow_energy_source: bool = field(default=False, repr=False, kw_only=True)

    noun = "contact"
    channel_kinds = ("spring", "contact", "friction")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pair(self.first, self.second, self.where)

    def check(self, scope: Scope) -> None:
        """InputError for shapes and numbers that do not fit, and for energy from nowhere."""
        super().check(scope)
        for shape in (self.first, self.second):
            shape.check(scope, self.where)
        exponent = scope.number(self.exponent)
        if exponent < 1.0:
            raise ModelError(
                f"exponent of {self.where}: found {exponent:g}, expected 1 or more; below 1 the stiffness "
                f"is unbounded as the shapes meet"
            )
        if not self.allow_energy_source:
            scope.takes_energy(self.dissipation, f"dissipation of {self.where}")
        if self.friction is not None:
            source = self.allow_energy_source
            self.friction.check(scope, self.where, scope.constants, source=source)

    def thickness(self, number: Callable[[Quantity], float]) -> float:
        """The smallest dimension of the two shapes (m); points and half-spaces have none."""
        sizes = [math.inf]
        for shape in (self.first, self.second):
            if isinstance(shape, Sphere | Capsule):
                sizes.append(2.0 * number(shape.radius) or math.inf)
            elif isinstance(shape, Box):
                sizes += map(number, shape.size)
        return min(sizes)

    def channels(self, scene: Scene) -> list[Channel]:
        """Elastic forces, dissipation and friction at every contact point of the two shapes."""
        elastic: list[Load] = []
        dissipative: list[Load] = []
        rubbing: list[Load] = []
        potential = scene.number(0.0)
        for touch in scene.touches(self.first, self.second):
            velocity = touch.relative_velocity
            closing = -scene.dot(touch.n, velocity)
            energy, f_e, f_n = self.normal_force(scene, touch.gap, closing)
            potential += energy
            elastic += touch.loads(f_e * touch.n)
            dissipative += touch.loads((f_n - f_e) * touch.n)
            if self.friction is not None:
                rubbing += touch.loads(self.friction.slip_force(scene, f_n, touch.n, velocity))
        channels = [self.channel("spring", scene.generalized(elastic), potential)]
        if not is_zero(self.dissipation):
            channels.append(self.channel("contact", scene.generalized(dissipative)))
        if self.friction is not None:
            channels.append(self.channel("friction", scene.generalized(rubbing)))
        return channels

    def normal_force(self, scene: Scene, gap: Expr, closing: Expr) -> tuple[Expr, Expr, Expr]:
        """V (J), the elastic force f_e and the normal force f_n >= 0 (N) of a gap that closes at a speed."""
        k, d, n = map(scene.number, (self.stiffness, self.dissipation, self.exponent))
        touching = gap < 0
        # Powers of an overlap of 0 have no derivative; apart, a value that has one stands in.
        x = scene.where(touching, -gap, 1)
        power = _power(scene, self.exponent, x)
        energy = scene.where(touching, k * power * x / (n + 1), 0)
        f_e = scene.where(touching, k * power, 0)
        if self.model == "hunt-crossley":
            return energy, f_e, f_e * scene.maximum(1 + d * closing, 0)
        return energy, f_e, scene.where(touching, scene.maximum(k * power + d * closing, 0), 0)


def _power(scene: Scene, exponent: Quantity, x: Any) -> Any:
    """xⁿ, continued to x < 0 as x |x|ⁿ⁻¹.

    A solver that looks for the instant of touch tries states beyond it. |x| is √(x² + tiny), which has no
    branch of its own and a derivative everywhere. Half integers go by roots, much faster than a power.
    """
    if isinstance(exponent, float) and exponent == 1.0:
        return x
    square = x * x + 1e-300
    if isinstance(exponent, float) and exponent in (1.5, 2.0):
        root = scene.sqrt(square)
        return x * (scene.sqrt(root) if exponent == 1.5 else root)
    return x * square ** (0.5 * (scene.number(exponent) - 1))


contact = Contact
