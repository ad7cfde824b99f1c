"""What happens at an instant: impacts between shapes, stops of joints, and events a user wants to see.

An impact changes speeds at once. Its law is Newton's restitution along the normal (Stronge's, with the
work in place of the speed, where there is friction) and Coulomb's friction in the impulses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from deltac.errors import ModelError, UnknownName, closest
from deltac.mechanism.laws import as_law
from deltac.mechanism.quantities import Quantity, positive
from deltac.mechanism.scope import Part, Scope, constructor, require_name
from deltac.mechanism.shapes import Shape, check_pair, check_shape

Direction: TypeAlias = Literal["both", "rising", "falling"]


@dataclass(frozen=True)
class JointStop(Part):
    """Hard limits of a coordinate: lower <= q <= upper (rad or m). Channel ``impact <name>``.

    A limit is a number or a law of t (a stop that moves), None where there is none. On reaching one the
    speed relative to it is reversed and multiplied by `restitution` e.
    """

    name: str
    coordinate: str
    lower: Any
    upper: Any
    restitution: Quantity
    allow_energy_source: bool = False

    noun = "joint stop"
    channel_kinds = ("impact",)
    impulsive = True

    def check(self, scope: Scope) -> None:
        """InputError for a coordinate that cannot be stopped, unknown symbols, a wrong restitution."""
        _check_coordinate(scope, self.coordinate, self.where)
        scope.laws((self.lower, self.upper), scope.in_time, f"a limit of {self.where}")
        _check_restitution(scope, self)


@dataclass(frozen=True)
class Impact(Part):
    """Two shapes that collide. Channel ``impact <name>``.

    `restitution` e is the square root of the part of the normal work of compression that comes back
    (without friction: the ratio of normal speeds, after to before); `friction` μ is Coulomb's.
    """

    name: str
    first: Shape
    second: Shape
    restitution: Quantity
    friction: Quantity
    allow_energy_source: bool = False

    noun = "impact"
    channel_kinds = ("impact",)
    impulsive = True

    def check(self, scope: Scope) -> None:
        """InputError for shapes that do not fit, unknown symbols, a wrong restitution or friction."""
        for shape in (self.first, self.second):
            check_shape(scope, shape, self.where)
        scope.laws([self.friction], scope.constants, f"friction of {self.where}")
        scope.positive(self.friction, f"friction of {self.where}", allow_zero=True)
        _check_restitution(scope, self)


@dataclass(frozen=True)
class Event(Part):
    """An instant of interest: `expression`, a law of t, q and u, passes zero.

    `direction` "rising", "falling" or "both"; a `terminal` event ends the run.
    """

    name: str
    expression: Any
    direction: Direction
    terminal: bool

    noun = "event"
    impulsive = False

    def check(self, scope: Scope) -> None:
        """InputError for unknown symbols."""
        scope.laws([self.expression], scope.in_motion, f"expression of {self.where}")


Happening: TypeAlias = JointStop | Impact | Event
"""What a mechanism's `events` are made of."""


@constructor
def joint_stop(
    name: str,
    joint: str,
    *,
    lower: Any = None,
    upper: Any = None,
    restitution: Any = 0.0,
    allow_energy_source: bool = False,
) -> JointStop:
    """A hard stop of a joint; see `JointStop`.

    Args:
        name: of the stop; its channel is ``impact <name>``.
        joint: a joint with a single coordinate, or a coordinate such as "base.x".
        lower: smallest value of the coordinate (rad or m), or a law of t; None: no limit.
        upper: largest value, likewise.
        restitution: e from 0 (no rebound) to 1 (no loss).
        allow_energy_source: accept e > 1, which makes energy at every impact; it is booked like a loss.

    Raises:
        InputError: no limit at all, limits in the wrong order, a restitution outside 0 … 1.
    """
    where = JointStop.called(name)
    if lower is None and upper is None:
        raise ModelError(f"{where} has no limit; give lower=, upper= or both")
    low = None if lower is None else as_law(lower, f"lower of {where}")
    high = None if upper is None else as_law(upper, f"upper of {where}")
    if isinstance(low, float) and isinstance(high, float) and low >= high:
        raise ModelError(f"{where}: lower is {low:g}, upper {high:g}; lower must be the smaller")
    e = _restitution(restitution, where, allow_energy_source)
    return JointStop(name, joint, low, high, e, allow_energy_source)


@constructor
def impact(
    name: str,
    first: Shape,
    second: Shape,
    *,
    restitution: Any = 0.0,
    friction: Any = 0.0,
    allow_energy_source: bool = False,
) -> Impact:
    """Two shapes that collide; see `Impact`.

    Args:
        name: of the impact; its channel is ``impact <name>``.
        first: a shape of `deltac.shapes`, fixed to a body.
        second: another one, of another body or the ground.
        restitution: e from 0 (no rebound) to 1 (no loss).
        friction: Coulomb's μ, 0 or more.
        allow_energy_source: accept e > 1, which makes energy at every impact; it is booked like a loss.

    Raises:
        InputError: a pair without a gap function, a restitution outside 0 … 1, a negative friction.
    """
    where = Impact.called(name)
    check_pair(first, second, where)
    e = _restitution(restitution, where, allow_energy_source)
    mu = positive(friction, f"friction of {where}", allow_zero=True)
    return Impact(name, first, second, e, mu, allow_energy_source)


@constructor
def event(
    name: str, expression: Any, *, direction: Direction = "both", terminal: bool = False
) -> Event:
    """An instant of interest, found to rounding and recorded; see `Event`.

    >>> apex = event("apex", "u.height", direction="falling")
    >>> enough = event("ten turns", "q.wheel - 20 * pi", terminal=True)
    """
    where = Event.called(name)
    if direction not in get_args(Direction):
        raise ModelError(
            f"direction of {where} is {direction!r}; expected {', '.join(get_args(Direction))}"
        )
    law = as_law(expression, f"expression of {where}")
    if isinstance(law, float):
        raise ModelError(f"{where}: the expression is the number {law:g}, which never crosses zero")
    return Event(name, law, direction, bool(terminal))


def _check_coordinate(scope: Scope, name: str, where: str) -> None:
    require_name(name, "joint", where)
    names = scope.coordinates.names
    if name not in names:
        several = names[scope.coordinates.of(name)]
        if several:
            raise ModelError(
                f"{where}: joint {name!r} has the coordinates {', '.join(map(repr, several))}; "
                "name one of them"
            )
        raise UnknownName(f"{where}: unknown joint or coordinate {name!r}{closest(name, names)}")
    entry = scope.coordinates[name]
    if not scope.rate_is_speed(name):
        raise ModelError(
            f"{where}: the rate of {name!r} is no speed of joint {entry.joint!r}, which has a quaternion; "
            "a stop limits a coordinate of a joint without one"
        )
    if entry.prescribed:
        raise ModelError(
            f"{where}: joint {entry.joint!r} follows its motion and cannot be stopped; free the joint"
        )


def _check_restitution(scope: Scope, part: JointStop | Impact) -> None:
    scope.laws([part.restitution], scope.constants, f"restitution of {part.where}")
    _require_restitution(scope.number(part.restitution), part.where, part.allow_energy_source)


def _restitution(value: Any, where: str, allowed: bool) -> Quantity:
    quantity = as_law(value, f"restitution of {where}")
    if isinstance(quantity, float):
        _require_restitution(quantity, where, allowed)
    return quantity


def _require_restitution(e: float, where: str, allowed: bool) -> None:
    if not math.isfinite(e) or e < 0.0:
        raise ModelError(f"restitution of {where} is {e:g}; expected a number from 0 to 1")
    if e > 1.0 and not allowed:
        raise ModelError(
            f"restitution of {where} is {e:g}: above 1 every impact creates energy. Give a number from 0 to "
            "1, or allow_energy_source=True if that is meant (the energy is booked)"
        )
