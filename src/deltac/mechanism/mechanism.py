"""The mechanism: what the machine is. Immutable, declarative, validated when it is made."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from deltac.errors import InputError, closest
from deltac.mechanism import validation
from deltac.mechanism.bodies import GROUND, Body
from deltac.mechanism.constraints import Constraint
from deltac.mechanism.coordinates import Entries, Entry, Free
from deltac.mechanism.events import Happening, check_events
from deltac.mechanism.forces import Element, JointDamper, JointSpring, JointTorque
from deltac.mechanism.joints import KINDS, Joint
from deltac.mechanism.laws import evaluate, rate
from deltac.mechanism.quantities import Quantity, Vector, vector
from deltac.mechanism.state import State

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

NO_GRAVITY = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, the tree of joints that connects them to the ground, forces and constraints.

    `joints` may come in any order; they are kept with parents before children, which is also the
    order of q and u. `gravity` is the acceleration of free fall in world components (m/s²).
    `parameters` are named numbers that any quantity or law may use. `events` are impacts, joint stops
    and other instants that a run looks for.

    Raises InputError, naming the part, for a mass or inertia that no rigid body can have, unknown or
    repeated names, bodies that no joint or more than one joint carries, cycles, laws with unknown
    symbols, and moving parts that carry no mass.
    """

    bodies: Sequence[Body]
    joints: Sequence[Joint]
    forces: Sequence[Element] = ()
    constraints: Sequence[Constraint] = ()
    gravity: Vector = NO_GRAVITY
    parameters: Mapping[str, float] = field(default_factory=dict)
    name: str = "mechanism"
    events: Sequence[Happening] = ()

    def __post_init__(self) -> None:
        def store(attribute: str, value: Any) -> None:
            object.__setattr__(self, attribute, value)

        store("bodies", tuple(self.bodies))
        store("joints", validation.tree_order(self.bodies, self.joints))
        store("forces", tuple(self.forces))
        store("constraints", tuple(self.constraints))
        store("gravity", vector(self.gravity, "gravity"))
        store("parameters", validation.parameters(self.parameters))
        store("events", tuple(self.events))
        validation.check(self)
        check_events(self, self.events)

    # --- coordinates ---------------------------------------------------------------------------

    @cached_property
    def coordinates(self) -> Entries:
        """The entries of q: name, joint, unit, place."""
        return _entries(self.joints, "coordinates")

    @cached_property
    def speeds(self) -> Entries:
        """The entries of u: name, joint, unit, place."""
        return _entries(self.joints, "speeds")

    @cached_property
    def free(self) -> Free:
        """Indices of the entries of q and u that are not prescribed."""
        import numpy as np

        def indices(entries: Entries) -> NDArray[np.intp]:
            return np.array([e.index for e in entries if not e.prescribed], dtype=np.intp)

        return Free(indices(self.coordinates), indices(self.speeds))

    @cached_property
    def elements(self) -> tuple[Element, ...]:
        """All force elements: those of the joints' own stiffness and damping, then `forces`."""
        own: list[Element] = []
        for joint in self.joints:
            if joint.stiffness:
                own.append(JointSpring(joint.name, joint.name, joint.stiffness, joint.rest))
            if joint.damping:
                own.append(JointDamper(joint.name, joint.name, joint.damping))
        return (*own, *self.forces)

    @cached_property
    def motors(self) -> tuple[JointTorque, ...]:
        """The joint torques without a law, whose values come from a controller or a log."""
        return tuple(e for e in self.elements if isinstance(e, JointTorque) and e.torque is None)

    @cached_property
    def children(self) -> Mapping[str, tuple[Joint, ...]]:
        """The joints that start at each body (and at the ground)."""
        found: dict[str, list[Joint]] = {GROUND: [], **{body.name: [] for body in self.bodies}}
        for joint in self.joints:
            found[joint.parent].append(joint)
        return {name: tuple(joints) for name, joints in found.items()}

    def body(self, name: str) -> Body:
        """The body of that name; InputError with the closest match otherwise."""
        found: Body = _named(self.bodies, name, "body")
        return found

    def joint(self, name: str) -> Joint:
        """The joint of that name; InputError with the closest match otherwise."""
        found: Joint = _named(self.joints, name, "joint")
        return found

    # --- numbers -------------------------------------------------------------------------------

    def number(self, quantity: Quantity) -> float:
        """The value of a quantity at the parameters' values."""
        return evaluate(quantity, self.parameters)

    def with_parameters(self, **values: float) -> Mechanism:
        """The same mechanism with other values of some parameters."""
        for name in values:
            if name not in self.parameters:
                raise InputError(f"unknown parameter {name!r}{closest(name, self.parameters)}")
        return replace(self, parameters={**self.parameters, **values})

    def digest(self, without: Iterable[str] = ()) -> str:
        """A digest of the description, the values of some parameters left out."""
        left_out = set(without)
        return self._digest(left_out) if left_out else self.hash

    def _digest(self, left_out: set[str]) -> str:
        values = sorted((k, v) for k, v in self.parameters.items() if k not in left_out)
        description = (self.bodies, self.joints, self.forces, self.constraints, self.gravity)
        parts = (*description, values, sorted(left_out), *self.events)
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]

    @cached_property
    def hash(self) -> str:
        """The digest that tells whether a log belongs to this mechanism."""
        return self._digest(set())

    # --- states --------------------------------------------------------------------------------

    def state(
        self,
        coordinates: Mapping[str, Any] | Iterable[float] | None = None,
        speeds: Mapping[str, Any] | Iterable[float] | None = None,
        t: float = 0.0,
    ) -> State:
        """The state with the given coordinates and speeds; those not named are zero (or identity).

        Mappings go by the name of an entry, or of a joint with a sequence of all its entries; else
        all of q (nq,), all of u (nu,). Prescribed joints take the values of their law at `t`.

        Raises InputError for unknown names, wrong sizes, values that are not finite, a quaternion
        far from unit length, and a value of a prescribed joint that departs from its law.
        """
        t = _scalar(t, "t", "time")
        if not math.isfinite(t):
            raise InputError(f"time of the state is {t}; expected a finite number of seconds")
        q, named_q = _fill(self.coordinates, coordinates, "coordinate")
        u, named_u = _fill(self.speeds, speeds, "speed")
        for joint in self.joints:
            place = self.coordinates.of(joint.name)
            quaternion = KINDS[joint.kind].quaternion
            if quaternion is not None:
                start = place.start + quaternion
                q[start : start + 4] = _unit(q[start : start + 4], joint.name, named_q)
            for k, law in enumerate(joint.motion):
                known = {**self.parameters, "t": t}
                value, derivative = evaluate(law, known), evaluate(rate(law), known)
                _settle(q, place.start + k, value, joint.coordinates[k], named_q, t)
                _settle(
                    u, self.speeds.of(joint.name).start + k, derivative, joint.speeds[k], named_u, t
                )
        q.flags.writeable = u.flags.writeable = False
        return State(t, q, u)

    def __repr__(self) -> str:
        return (
            f"Mechanism({self.name!r}: {len(self.bodies)} bodies, {len(self.joints)} joints, "
            f"{len(self.free.u)} free speeds, {len(self.elements)} force elements)"
        )


def require_mechanism(given: object) -> None:
    """InputError unless it is a mechanism; tells where the one that was meant is."""
    if isinstance(given, Mechanism):
        return
    remedy = ""
    if isinstance(getattr(given, "mechanism", None), Mechanism):
        remedy = "; use problem.mechanism"
    elif isinstance(given, str):
        remedy = "; of a problem by its name, use deltac.problems.load(name).mechanism"
    found = repr(given) if isinstance(given, str) else type(given).__name__
    raise InputError(f"mechanism: expected a Mechanism, found {found}{remedy}")


def _entries(joints: Sequence[Joint], what: str) -> Entries:
    made: list[Entry] = []
    for joint in joints:
        slots = KINDS[joint.kind].coordinates if what == "coordinates" else KINDS[joint.kind].speeds
        names = joint.coordinates if what == "coordinates" else joint.speeds
        for name, (_, unit) in zip(names, slots):
            made.append(Entry(name, joint.name, unit, len(made), joint.prescribed))
    return Entries(tuple(made))


def _named(parts: Sequence[Any], name: str, what: str) -> Any:
    for part in parts:
        if part.name == name:
            return part
    raise InputError(f"unknown {what} {name!r}{closest(name, [part.name for part in parts])}")


def _fill(
    entries: Entries, given: Mapping[str, Any] | Iterable[float] | None, what: str
) -> tuple[NDArray[np.float64], set[str]]:
    """The full vector, zero where nothing is given, and the names of what was given."""
    import numpy as np

    values = np.zeros(len(entries))
    if given is None:
        return _checked_finite(values, entries, what), set()
    if not isinstance(given, Mapping):
        entire = list(given) if isinstance(given, Iterable) else given
        array = _array(entire, f"{what}s of the state")
        if array.shape != values.shape:
            raise InputError(
                f"{what}s of the state: expected {len(entries)} values "
                f"({', '.join(entries.names)}), found an array of shape {array.shape}"
            )
        return _checked_finite(array, entries, what), set(entries.names)
    named: set[str] = set()
    joints = {entry.joint for entry in entries}
    for name, value in given.items():
        if name in entries.names:
            values[entries[name].index] = _scalar(value, name, what)
            named.add(name)
        elif name in joints:
            place = entries.of(name)
            array = _array(value, f"{what}s of joint {name!r}")
            if array.shape != (place.stop - place.start,):
                raise InputError(
                    f"{what}s of joint {name!r}: expected {place.stop - place.start} values "
                    f"({', '.join(entries.names[place])}), found {value!r}"
                )
            values[place] = array
            named.update(entries.names[place])
        else:
            options = list(dict.fromkeys([*entries.names, *sorted(joints)]))
            raise InputError(f"unknown {what} {name!r} of the state{closest(name, options)}")
    return _checked_finite(values, entries, what), named


def _array(value: Any, where: str) -> NDArray[np.float64]:
    import numpy as np

    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{where}: expected numbers, found {value!r}") from None


def _scalar(value: Any, name: str, what: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(
            f"{what} {name!r} of the state: expected a number, found {value!r}"
        ) from None


def _checked_finite(
    values: NDArray[np.float64], entries: Entries, what: str
) -> NDArray[np.float64]:
    for entry, value in zip(entries, values):
        if not math.isfinite(value):
            raise InputError(
                f"{what} {entry.name!r} of the state is {value}; expected a finite number"
            )
    return values


def _unit(q: NDArray[np.float64], joint: str, named: set[str]) -> NDArray[np.float64]:
    norm = math.hypot(*q)
    if norm == 0.0 and not any(f"{joint}.q{c}" in named for c in "wxyz"):
        q[0] = 1.0
        return q
    if abs(norm - 1.0) > 1e-3:
        raise InputError(
            f"the quaternion of joint {joint!r}, {tuple(map(float, q))}, has length {norm:.6g}; "
            "expected a unit quaternion, scalar first. Divide it by its length"
        )
    return q / norm


def _settle(
    vector: NDArray[np.float64], index: int, value: float, name: str, named: set[str], t: float
) -> None:
    """Put the law's value in place; a given value must agree with it."""
    if name in named and abs(vector[index] - value) > 1e-6 * max(1.0, abs(value)):
        raise InputError(
            f"{name!r} is prescribed: its law gives {value:.9g} at t = {t:g}, the state says "
            f"{vector[index]:.9g}. Leave it out of the state"
        )
    vector[index] = value
