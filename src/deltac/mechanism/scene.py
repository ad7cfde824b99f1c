"""The mechanism in motion, as the laws of its parts see it.

Force elements and constraints state their laws on a `Scene` in plain operators: they ask where points are and
how fast they move, and say which forces act there, or what is kept at zero. `dynamics.scene` answers in
symbols, so that a law is written once and traced for simulation, ledgers and residuals alike, while this
package needs no symbolic engine.

Scalars, columns (3,) and generalized forces (nu,) are expressions that take ``+ - * / **``, comparisons, and
indices; vectors are world components unless said otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol, TypeAlias

from deltac.mechanism.channels import Channel, ChannelName
from deltac.mechanism.parts import Part, require_apart
from deltac.mechanism.shapes import Shape

Expr: TypeAlias = Any
"""A scalar or a column of a traced mechanism."""


class BodyPoint(Protocol):
    """A material point of a body or of the ground."""

    @property
    def place(self) -> Expr:
        """Where it is (3,), m."""

    @property
    def velocity(self) -> Expr:
        """Its velocity (3,), m/s."""


Load: TypeAlias = tuple[BodyPoint, Expr] | tuple[BodyPoint, Expr, Expr]
"""A force (3,; N) at a point, and perhaps a moment (3,; N·m) on its body."""


class Touch(Protocol):
    """A place where two bodies touch or may touch: the gap g, the normal n from the second to the first."""

    @property
    def gap(self) -> Expr:
        """The gap (m), negative where they overlap."""

    @property
    def n(self) -> Expr:
        """The unit normal (3,)."""

    @property
    def relative_velocity(self) -> Expr:
        """Velocity (3,) of the first body's material point there relative to the second's, m/s."""

    def loads(self, force: Expr) -> Sequence[Load]:
        """A force (3,) on the first body there, and its opposite on the second."""


class Scene(Protocol):
    """What a law may ask of the mechanism in motion, and what it may do to it."""

    def number(self, law: Any) -> Expr:
        """A law or quantity as a scalar."""

    def vector(self, laws: Sequence[Any], extra: dict[str, Expr] | None = None) -> Expr:
        """Several laws as a column; `extra` are values of further symbols."""

    def matrix(self, rows: Sequence[Sequence[float]]) -> Expr:
        """A matrix of numbers."""

    def time_rate(self, law: Any) -> Expr:
        """∂/∂t of a law of time."""

    def coordinates(self, joint: str) -> tuple[list[Expr], Expr | None]:
        """The plain coordinates of a joint, and its quaternion (4,; scalar first), if it has one."""

    def speeds(self, joint: str) -> Expr:
        """The speeds of a joint."""

    def inputs(self, motor: str) -> Expr:
        """The values that a controller or a log gives a motor."""

    def coordinate(self, name: str) -> tuple[Expr, Expr]:
        """A coordinate, and the unit generalized force (nu,) along the speed that is its rate."""

    def point(self, body: str, point: Sequence[Any]) -> BodyPoint:
        """A point given in the frame of a body."""

    def mass_centre(self, body: str) -> BodyPoint:
        """The mass centre of a body."""

    def weight(self, body: str) -> Expr:
        """The weight (3,) of a body, N."""

    def point_at(self, body: str, place: Expr) -> BodyPoint:
        """The body's material point that is at a place in the world now."""

    def place(self, body: str, point: Sequence[Any]) -> Expr:
        """Where a point given in the frame of a body is (3,), m."""

    def velocity(self, body: str, place: Expr) -> Expr:
        """The velocity (3,) of the body's material point that is at a place in the world, m/s."""

    def rotation(self, body: str) -> Expr:
        """The matrix from components in a body's frame to world components."""

    def axis(self, body: str, axis: Sequence[float]) -> Expr:
        """World components of a direction fixed in a body."""

    def local(self, body: str, place: Expr) -> Expr:
        """Coordinates in the frame of a body of a place in the world."""

    def touches(self, first: Shape, second: Shape) -> Sequence[Touch]:
        """The contact points of two shapes."""

    def sliding(
        self, body: str, point: Sequence[Any], on: str, normal: tuple[float, float, float]
    ) -> Touch:
        """Where a point of a body slides on a plane of another, of whose frame the normal is."""

    def on_joint(self, joint: str, values: Expr) -> Expr:
        """The generalized force (nu,) of values (a column or a list) on the speeds of a joint."""

    def generalized(self, loads: Sequence[Load]) -> Expr:
        """The generalized force (nu,) of loads."""

    def power(self, force: Expr) -> Expr:
        """The power of a generalized force, W."""

    def from_potential(self, joint: str, potential: Any) -> tuple[Expr, Expr, Expr]:
        """Of a law V(q, t) of a joint's coordinates: V, −∂V/∂q along the joint's speeds, ∂V/∂t."""

    def field(self, potential: Any, place: Expr) -> tuple[Expr, Expr, Expr]:
        """Of a law V(x, y, z, t) at a place (3,): V, −∂V/∂(x, y, z), ∂V/∂t."""

    # Functions of expressions.

    def sqrt(self, x: Expr) -> Expr:
        """√x."""

    def exp(self, x: Expr) -> Expr:
        """eˣ."""

    def tanh(self, x: Expr) -> Expr:
        """The hyperbolic tangent."""

    def atan2(self, y: Expr, x: Expr) -> Expr:
        """The angle of (x, y)."""

    def abs(self, x: Expr) -> Expr:
        """|x|."""

    def maximum(self, x: Expr, y: Expr) -> Expr:
        """The larger one."""

    def minimum(self, x: Expr, y: Expr) -> Expr:
        """The smaller one."""

    def where(self, condition: Expr, x: Expr, y: Expr) -> Expr:
        """X where the condition holds, else y; both must be finite, and so their derivatives."""

    def dot(self, x: Expr, y: Expr) -> Expr:
        """The scalar product."""

    def cross(self, x: Expr, y: Expr) -> Expr:
        """The vector product."""


class Element(Part):
    """A force element: what flows through it is in its channels."""

    def channels(self, scene: Scene) -> list[Channel]:
        """The forces of the element, and its potential, by channel."""
        raise NotImplementedError

    def channel(
        self, kind: str, force: Expr, potential: Expr | None = None, *, logged: bool = False
    ) -> Channel:
        """The channel of a kind that is named after the element."""
        return Channel(ChannelName(kind, self.name), force, potential, logged=logged)

    def spring_channels(self, force: Expr, potential: Expr, explicit: Expr) -> list[Channel]:
        """``spring``, and ``prescribed`` for the power ∂V/∂t of a potential that depends on time."""
        channels = [self.channel("spring", force, potential)]
        if not explicit.is_zero():
            channels.append(
                Channel(ChannelName("prescribed", self.name), 0 * force, explicit=explicit)
            )
        return channels


class Constraint(Part):
    """A constraint: rows that it keeps at zero. Its forces do their work in the channel ``constraint``.

    A row is of the size of a length or an angle (its rate: of a speed), so that tolerances mean the same
    for all, and its multiplier is a force or moment. `bodies` names the fields with the two bodies that it
    connects, if it does.
    """

    bodies: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        """Read every field; InputError for a body that is connected with itself."""
        super().__post_init__()
        if self.bodies:
            first, second = (getattr(self, name) for name in self.bodies)
            require_apart(first, second, self.where)

    @property
    def channel_kinds(self) -> tuple[str, ...]:
        """``constraint``."""
        return ("constraint",)

    def positions(self, scene: Scene) -> Sequence[Expr]:
        """The rows φ(q, t) = 0 of a holonomic constraint."""
        return ()

    def motions(self, scene: Scene) -> Sequence[Expr]:
        """The rows ψ(q, u, t) = 0, linear in the speeds, of a motion constraint."""
        return ()
