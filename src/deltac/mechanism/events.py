"""What happens at an instant: impacts between shapes, stops of joints, and events a user wants to see.

An impact changes speeds at once. Its law is Newton's restitution along the normal (Stronge's, with the
work in place of the speed, where there is friction) and Coulomb's friction in the impulses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from deltac.errors import ModelError, UnknownName, closest
from deltac.mechanism.laws import LawLike
from deltac.mechanism.parts import Constant, LawOfMotion, LawOfTime, NonNegative, Part, constructor
from deltac.mechanism.scope import Scope, require_name
from deltac.mechanism.shapes import Shape, check_pair

Direction: TypeAlias = Literal["both", "rising", "falling"]

Simultaneous: TypeAlias = Literal["moreau", "sequential"]
"""Laws of several impacts at one instant: as one complementarity problem, or one after the other."""


class _Impulsive(Part):
    """What reverses speeds by a `restitution` e from 0 (no rebound) to 1 (no loss).

    With `allow_energy_source` e may be above 1: it makes energy at every impact, which is booked like a loss.
    Where several are hit at one instant, `simultaneous` chooses the law; "sequential" prevails.
    """

    restitution: Any
    simultaneous: Simultaneous
    allow_energy_source: bool
    channel_kinds = ("impact",)
    impulsive = True

    def __post_init__(self) -> None:
        """Read every field; InputError for a number that is no restitution."""
        super().__post_init__()
        if isinstance(self.restitution, float):
            self._check_restitution(self.restitution)

    def check(self, scope: Scope) -> None:
        """InputError for fields that do not fit, and a value that is no restitution."""
        super().check(scope)
        self._check_restitution(scope.number(self.restitution))

    def _check_restitution(self, e: float) -> None:
        if not math.isfinite(e) or e < 0.0:
            raise ModelError(f"restitution of {self.where} is {e:g}; expected a number from 0 to 1")
        if e > 1.0 and not self.allow_energy_source:
            raise ModelError(
                f"restitution of {self.where} is {e:g}: above 1 every impact creates energy. Give a number "
                "from 0 to 1, or allow_energy_source=True if that is meant (the energy is booked)"
            )


@dataclass(frozen=True)
class JointStop(_Impulsive):
    """Hard limits of a coordinate: lower <= q <= upper (rad or m). Channel ``impact <name>``.

    A limit is a number or a law of t (a stop that moves), None where there is none. On reaching one the
    speed relative to it is reversed and multiplied by `restitution` e.
    """

    name: str
    coordinate: str
    lower: LawOfTime = None
    upper: LawOfTime = None
    restitution: Constant = 0.0
    allow_energy_source: bool = False
    simultaneous: Simultaneous = "moreau"

    noun = "joint stop"

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.lower, self.upper
        if low is None and high is None:
            raise ModelError(f"{self.where} has no limit; give lower=, upper= or both")
        if isinstance(low, float) and isinstance(high, float) and low >= high:
            raise ModelError(
                f"{self.where}: lower is {low:g}, upper {high:g}; lower must be the smaller"
            )

    def check(self, scope: Scope) -> None:
        """InputError for a coordinate that cannot be stopped, unknown symbols, a wrong restitution."""
        super().check(scope)
        _check_coordinate(scope, self.coordinate, self.where)


@constructor
@dataclass(frozen=True)
class Impact(_Impulsive):
    """Two shapes that collide. Channel ``impact <name>``.

    `restitution` e is the square root of the part of the normal work of compression that comes back
    (without friction: the ratio of normal speeds, after to before); `friction` μ is Coulomb's.

    Args:
        name: of the impact; its channel is ``impact <name>``.
        first: a shape of `deltac.shapes`, fixed to a body.
        second: another one, of another body or the ground.
        restitution: e from 0 (no rebound) to 1 (no loss).
        friction: Coulomb's μ, 0 or more.
        allow_energy_source: accept e > 1, which makes energy at every impact; it is booked like a loss.
        simultaneous: the law where several contacts are hit at one instant, which rigid-body mechanics does
            not determine: "moreau", Newton's restitution at all of them at once, or "sequential", one after
            the other, the fastest approach first (Newton's cradle).

    Raises:
        InputError: a pair without a gap function, a restitution outside 0 … 1, a negative friction.
    """

    name: str
    first: Shape
    second: Shape
    restitution: Constant = field(default=0.0, kw_only=True)
    friction: NonNegative = field(default=0.0, kw_only=True)
    allow_energy_source: bool = field(default=False, kw_only=True)
    simultaneous: Simultaneous = field(default="moreau", kw_only=True)

    noun = "impact"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pair(self.first, self.second, self.where)

    def check(self, scope: Scope) -> None:
        """InputError for shapes that do not fit, unknown symbols, a wrong restitution or friction."""
        super().check(scope)
        for shape in (self.first, self.second):
            shape.check(scope, self.where)


@constructor
@dataclass(frozen=True)
class Event(Part):
    """An instant of interest: `expression`, a law of t, q and u, passes zero.

    It is found to rounding and recorded. `direction` "rising", "falling" or "both"; a `terminal` event ends
    the run.

    >>> apex = event("apex", "u.height", direction="falling")
    >>> enough = event("ten turns", "q.wheel - 20 * pi", terminal=True)
    """

    name: str
    expression: LawOfMotion
    direction: Direction = field(default="both", kw_only=True)
    terminal: bool = field(default=False, kw_only=True)

    noun = "event"
    impulsive = False

    def __post_init__(self) -> None:
        super().__post_init__()
        law = self.expression
        if isinstance(law, float):
            raise ModelError(
                f"{self.where}: the expression is the number {law:g}, which never crosses zero"
            )


Happening: TypeAlias = JointStop | Impact | Event
"""What a mechanism's `events` are made of."""


@constructor
def joint_stop(
    name: str,
    joint: str,
    *,
    lower: LawLike | None = None,
    upper: LawLike | None = None,
    restitution: LawLike = 0.0,
    allow_energy_source: bool = False,
    simultaneous: Simultaneous = "moreau",
) -> JointStop:
    """A hard stop of a joint; see `JointStop`.

    Args:
        name: of the stop; its channel is ``impact <name>``.
        joint: a joint with a single coordinate, or a coordinate such as "base.x".
        lower: smallest value of the coordinate (rad or m), or a law of t; None: no limit.
        upper: largest value, likewise.
        restitution: e from 0 (no rebound) to 1 (no loss).
        allow_energy_source: accept e > 1, which makes energy at every impact; it is booked like a loss.
        simultaneous: the law where several contacts are hit at one instant; see `Impact`.

    Raises:
        InputError: no limit at all, limits in the wrong order, a restitution outside 0 … 1.
    """
    return JointStop(name, joint, lower, upper, restitution, allow_energy_source, simultaneous)


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


event = Event
impact = Impact
