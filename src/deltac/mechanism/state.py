"""The state of a mechanism: (t, q, u) at an instant, and how names make one."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deltac.arrays import PHYSICAL
from deltac.calls.arguments import checked
from deltac.errors import NO_NUMBER, StateError, SuspicionWarning, UnknownName, closest
from deltac.mechanism.coordinates import Entries, Entry
from deltac.mechanism.joints import Joint
from deltac.mechanism.laws import evaluate, rate
from deltac.mechanism.scope import Scope

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@checked
@dataclass(frozen=True, eq=False)
class State:
    """Time t (s), coordinates q (nq,) and speeds u (nu,) of all joints; made by `Mechanism.state`.

    The arrays are read-only; prescribed joints are included, at the values of their law.
    """

    t: float
    q: NDArray[np.float64]
    u: NDArray[np.float64]


def make_state(
    joints: Sequence[Joint],
    scope: Scope,
    coordinates: Mapping[str, Any] | Iterable[float] | None,
    speeds: Mapping[str, Any] | Iterable[float] | None,
    t: float,
) -> State:
    """The state of a mechanism's joints; see `Mechanism.state`."""
    t = _scalar(t, "t", "time")
    if not math.isfinite(t):
        raise StateError(f"time of the state is {t}; expected a finite number of seconds")
    q, named_q = _fill(scope.coordinates, coordinates, "coordinate")
    u, named_u = _fill(scope.speeds, speeds, "speed")
    for joint in joints:
        place = scope.coordinates.of(joint.name)
        quaternion = [e.index for e in scope.coordinates[place] if e.quaternion]
        if quaternion:
            q[quaternion] = _unit(q[quaternion], joint.name, named_q)
        for k, law in enumerate(joint.motion):
            values = {**scope.parameters, "t": t}
            value, derivative = evaluate(law, values), evaluate(rate(law), values)
            _settle(q, place.start + k, value, joint.coordinates[k], named_q, t)
            start = scope.speeds.of(joint.name).start
            _settle(u, start + k, derivative, joint.speeds[k], named_u, t)
    q.flags.writeable = u.flags.writeable = False
    return State(t, q, u)


def _fill(
    entries: Entries, source: Mapping[str, Any] | Iterable[float] | None, what: str
) -> tuple[NDArray[np.float64], set[str]]:
    """The full vector, zero where nothing is given, and the names of what was given."""
    import numpy as np

    values = np.zeros(len(entries))
    if source is None:
        return _checked_finite(values, entries, what), set()
    if not isinstance(source, Mapping):
        single = getattr(source, "ndim", 1) == 0 or not isinstance(source, Iterable)
        entire = source if single else list(source)
        array = _array(entire, f"{what}s of the state")
        if array.shape != values.shape:
            raise StateError(
                f"{what}s of the state: expected {len(entries)} values "
                f"({', '.join(entries.names)}), found an array of shape {array.shape}"
            )
        return _checked_finite(array, entries, what), set(entries.names)
    named: set[str] = set()
    joints = {entry.joint for entry in entries}
    for name, value in source.items():
        if name in entries.names:
            values[entries[name].index] = _scalar(value, name, what)
            named.add(name)
            _suspect_degrees(entries[name], values[entries[name].index])
        elif name in joints:
            place = entries.of(name)
            array = _array(value, f"{what}s of joint {name!r}")
            if array.shape != (place.stop - place.start,):
                raise StateError(
                    f"{what}s of joint {name!r}: expected {place.stop - place.start} values "
                    f"({', '.join(entries.names[place])}), found {value!r}"
                )
            values[place] = array
            named.update(entries.names[place])
        else:
            options = list(dict.fromkeys([*entries.names, *sorted(joints)]))
            raise UnknownName(f"unknown {what} {name!r} of the state{closest(name, options)}")
    return _checked_finite(values, entries, what), named


def _suspect_degrees(entry: Entry, value: float) -> None:
    """Warn of an angle beyond a turn that is a round number: 60 rad is seldom meant, 60° often."""
    if entry.unit == "rad" and abs(value) > 2 * math.pi and math.isfinite(value) and value % 5 == 0:
        warnings.warn(
            f"coordinate {entry.name!r} of the state is {value:g} rad, {value / (2 * math.pi):.3g} turns; if "
            f"degrees were meant, write math.radians({value:g})",
            SuspicionWarning,
            stacklevel=5,
        )


def _array(value: Any, where: str) -> NDArray[np.float64]:
    import numpy as np

    try:
        return np.array(value, dtype=float)
    except NO_NUMBER:
        raise StateError(f"{where}: expected numbers, found {value!r}") from None


def _scalar(value: Any, name: str, what: str) -> float:
    try:
        return float(value)
    except NO_NUMBER:
        raise StateError(
            f"{what} {name!r} of the state: expected a number, found {value!r}"
        ) from None


def _checked_finite(
    values: NDArray[np.float64], entries: Entries, what: str
) -> NDArray[np.float64]:
    for entry, value in zip(entries, values):
        if not math.isfinite(value):
            raise StateError(
                f"{what} {entry.name!r} of the state is {value}; expected a finite number"
            )
        if abs(value) > PHYSICAL:
            raise StateError(
                f"{what} {entry.name!r} of the state is {value:g}; expected at most {PHYSICAL:.0e} in "
                "size, whose energies are within double precision"
            )
    return values


def _unit(q: NDArray[np.float64], joint: str, named: set[str]) -> NDArray[np.float64]:
    norm = math.hypot(*q)
    if norm == 0.0 and not any(f"{joint}.q{c}" in named for c in "wxyz"):
        q[0] = 1.0
        return q
    if abs(norm - 1.0) > 1e-3:
        raise StateError(
            f"the quaternion of joint {joint!r}, {tuple(map(float, q))}, has length {norm:.6g}; "
            "expected a unit quaternion, scalar first. Divide it by its length"
        )
    return q / norm


def _settle(
    vector: NDArray[np.float64], index: int, value: float, name: str, named: set[str], t: float
) -> None:
    """Put the law's value in place; a given value must agree with it."""
    if name in named and abs(vector[index] - value) > 1e-6 * max(1.0, abs(value)):
        raise StateError(
            f"{name!r} is prescribed: its law gives {value:.9g} at t = {t:g}, the state says "
            f"{vector[index]:.9g}. Leave it out of the state"
        )
    vector[index] = value
