"""What happens at an instant: impacts between shapes, stops of joints, and events a user wants to see.

An impact changes speeds at once. Its law is Newton's restitution along the normal (Stronge's, with the
work in place of the speed, where there is friction) and Coulomb's friction in the impulses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from deltac.errors import InputError, closest
from deltac.mechanism.joints import KINDS
from deltac.mechanism.laws import as_law, check_symbols
from deltac.mechanism.quantities import Quantity, part_name, positive, require_positive
from deltac.mechanism.shapes import Shape, check_pair, check_shape

if TYPE_CHECKING:
    from deltac.mechanism.mechanism import Mechanism

Direction: TypeAlias = Literal["both", "rising", "falling"]


@dataclass(frozen=True)
class JointStop:
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

    impulsive = True


@dataclass(frozen=True)
class Impact:
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

    impulsive = True


@dataclass(frozen=True)
class Event:
    """An instant of interest: `expression`, a law of t, q and u, passes zero.

    `direction` "rising", "falling" or "both"; a `terminal` event ends the run.
    """

    name: str
    expression: Any
    direction: Direction
    terminal: bool

    impulsive = False


Happening: TypeAlias = JointStop | Impact | Event
"""What a mechanism's `events` are made of."""


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
    where = f"joint stop {part_name(name, 'a joint stop')!r}"
    if lower is None and upper is None:
        raise InputError(f"{where} has no limit; give lower=, upper= or both")
    low = None if lower is None else as_law(lower, f"lower of {where}")
    high = None if upper is None else as_law(upper, f"upper of {where}")
    if isinstance(low, float) and isinstance(high, float) and low >= high:
        raise InputError(f"{where}: lower is {low:g}, upper {high:g}; lower must be the smaller")
    e = _restitution(restitution, where, allow_energy_source)
    return JointStop(name, joint, low, high, e, allow_energy_source)


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
    where = f"impact {part_name(name, 'an impact')!r}"
    check_pair(first, second, where)
    e = _restitution(restitution, where, allow_energy_source)
    mu = positive(friction, f"friction of {where}", allow_zero=True)
    return Impact(name, first, second, e, mu, allow_energy_source)


def event(
    name: str, expression: Any, *, direction: Direction = "both", terminal: bool = False
) -> Event:
    """An instant of interest, found to rounding and recorded; see `Event`.

    >>> apex = event("apex", "u.height", direction="falling")
    >>> enough = event("ten turns", "q.wheel - 20 * pi", terminal=True)
    """
    where = f"event {part_name(name, 'an event')!r}"
    if direction not in get_args(Direction):
        raise InputError(
            f"direction of {where} is {direction!r}; expected {', '.join(get_args(Direction))}"
        )
    law = as_law(expression, f"expression of {where}")
    if isinstance(law, float):
        raise InputError(f"{where}: the expression is the number {law:g}, which never passes zero")
    return Event(name, law, direction, bool(terminal))


def check_events(mechanism: Mechanism, events: Sequence[Happening]) -> None:
    """InputError for an event that does not fit its mechanism."""
    seen: set[tuple[bool, str]] = set()
    for happening in events:
        if not isinstance(happening, Happening):
            raise InputError(
                f"events of the mechanism: found {happening!r}, expected what deltac.joint_stop(...), "
                "deltac.impact(...) or deltac.event(...) returns"
            )
        key = (isinstance(happening, Event), happening.name)
        if key in seen:
            what = "events" if key[0] else "impacts or stops"
            raise InputError(f"two {what} are called {happening.name!r}; names must differ")
        seen.add(key)
        _check(mechanism, happening)


def _check(mechanism: Mechanism, happening: Happening) -> None:
    parameters = tuple(mechanism.parameters)
    match happening:
        case JointStop(name=name):
            where = f"joint stop {name!r}"
            _check_coordinate(mechanism, happening.coordinate, where)
            for limit in (happening.lower, happening.upper):
                if limit is not None:
                    check_symbols(limit, ["t", *parameters], f"a limit of {where}")
        case Impact(name=name):
            where = f"impact {name!r}"
            for shape in (happening.first, happening.second):
                check_shape(mechanism, shape, where)
            check_symbols(happening.friction, parameters, f"friction of {where}")
            mu = mechanism.number(happening.friction)
            require_positive(mu, f"friction of {where}", allow_zero=True)
        case Event(name=name):
            allowed = [
                "t",
                *parameters,
                *(f"q.{entry.name}" for entry in mechanism.coordinates),
                *(f"u.{entry.name}" for entry in mechanism.speeds),
            ]
            check_symbols(happening.expression, allowed, f"expression of event {name!r}")
            return
    check_symbols(happening.restitution, parameters, f"restitution of {where}")
    e = mechanism.number(happening.restitution)
    _require_restitution(e, where, happening.allow_energy_source)


def _check_coordinate(mechanism: Mechanism, name: str, where: str) -> None:
    names = mechanism.coordinates.names
    if name not in names:
        several = [c for c in names if mechanism.coordinates[c].joint == name]
        if several:
            raise InputError(
                f"{where}: joint {name!r} has the coordinates {', '.join(map(repr, several))}; "
                "name one of them"
            )
        raise InputError(f"{where}: unknown joint or coordinate {name!r}{closest(name, names)}")
    entry = mechanism.coordinates[name]
    if not KINDS[mechanism.joint(entry.joint).kind].rates:
        raise InputError(
            f"{where}: the rate of {name!r} is no speed of joint {entry.joint!r}, which has a quaternion; "
            "a stop limits a coordinate of a joint without one"
        )
    if entry.prescribed:
        raise InputError(
            f"{where}: joint {entry.joint!r} follows its motion and cannot be stopped; free the joint"
        )


def _restitution(value: Any, where: str, allowed: bool) -> Quantity:
    quantity = as_law(value, f"restitution of {where}")
    if isinstance(quantity, float):
        _require_restitution(quantity, where, allowed)
    return quantity


def _require_restitution(e: float, where: str, allowed: bool) -> None:
    if not math.isfinite(e) or e < 0.0:
        raise InputError(f"restitution of {where} is {e:g}; expected a number from 0 to 1")
    if e > 1.0 and not allowed:
        raise InputError(
            f"restitution of {where} is {e:g}: above 1 every impact makes energy. Give a number from 0 to "
            "1, or allow_energy_source=True if that is meant (the energy is booked)"
        )
