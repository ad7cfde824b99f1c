"""The mechanism: what the machine is. Immutable, declarative, validated when it is made."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.caching import FrozenDict
from deltac.errors import (
    ModelError,
    UnknownName,
    WrongType,
    check_names,
    closest,
    number_or_nan,
    shown,
)
from deltac.mechanism.addresses import ADDRESSED, numbers, opened
from deltac.mechanism.bodies import Body
from deltac.mechanism.coordinates import Entries, Entry, Free
from deltac.mechanism.events import Event, Happening
from deltac.mechanism.forces import JointDamper, JointSpring, JointTorque
from deltac.mechanism.joints import JOINT_KINDS, Joint
from deltac.mechanism.laws import VectorLike, evaluate
from deltac.mechanism.parts import Part
from deltac.mechanism.quantities import Quantity, vector
from deltac.mechanism.scene import Constraint, Element
from deltac.mechanism.scope import GROUND, Scope
from deltac.mechanism.shapes import Visual
from deltac.mechanism.state import State, make_state
from deltac.results import Section, Shown, Table, number

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

NO_GRAVITY = (0.0, 0.0, 0.0)


@checked
@dataclass(frozen=True, eq=False)
class Mechanism(Shown):
    """Bodies, the tree of joints that connects them to the ground, forces and constraints.

    `joints` may come in any order; they are kept with parents before children, which is also the
    order of q and u. `gravity` is the acceleration of free fall in world components (m/s²).
    `parameters` are named numbers that any quantity or law may use. `events` are impacts, joint stops
    and other instants that a run looks for. `visuals` are what bodies look like in pictures; nothing
    else depends on them. `varied` are the parameters that compiled code takes as inputs, see `varying`.

    Raises InputError, naming the part, for a mass or inertia that no rigid body can have, unknown or
    repeated names, bodies that no joint or more than one joint carries, cycles, laws with unknown
    symbols, and moving parts that carry no mass.
    """

    bodies: Sequence[Body]
    joints: Sequence[Joint]
    forces: Sequence[Element] = ()
    constraints: Sequence[Constraint] = ()
    gravity: VectorLike = NO_GRAVITY
    parameters: Mapping[str, float] = field(default_factory=dict)
    name: str = "mechanism"
    events: Sequence[Happening] = ()
    visuals: Sequence[Visual] = field(default=(), repr=False)
    varied: Sequence[str] = field(default=(), repr=False, kw_only=True)

    def __post_init__(self) -> None:
        def store(attribute: str, value: Any) -> None:
            object.__setattr__(self, attribute, value)

        if not isinstance(self.name, str) or not self.name:
            raise ModelError(f"name of the mechanism: expected a text, found {self.name!r}")
        for attribute, kind, example in (
            ("bodies", Body, "deltac.body(...)"),
            ("joints", Joint, "deltac.revolute(...)"),
            ("forces", Element, "deltac.forces.joint_torque(...)"),
            ("constraints", Constraint, "deltac.constraints.distance(...)"),
            (
                "events",
                Happening,
                "deltac.events.joint_stop(...), deltac.events.impact(...) or deltac.events.event(...)",
            ),
            ("visuals", Visual, "deltac.shapes.Visual(...)"),
        ):
            store(attribute, _of_kind(getattr(self, attribute), attribute, kind, example))
        store("joints", _tree_order(self.bodies, self.joints))
        gravity = vector(self.gravity, "gravity")
        store("gravity", gravity)
        store("parameters", FrozenDict(_parameters(self.parameters)))
        _distinct((e for e in self.events if isinstance(e, Event)), "events")
        _check_names_of_coordinates(self)
        self.scope.laws(gravity, self.scope.constants, "gravity")
        for part in self.parts:
            part.check(self.scope)
        for visual in self.visuals:
            self.scope.body(visual.body, "a visual")
        _check_channels(self.parts)
        _check_mass_carried(self)

    @property
    def parts(self) -> tuple[Part, ...]:
        """All that it is made of."""
        return (*self.bodies, *self.joints, *self.elements, *self.constraints, *self.events)

    @cached_property
    def scope(self) -> Scope:
        """The names that its parts may refer to, and the values of its parameters."""
        return Scope(
            tuple(body.name for body in self.bodies),
            tuple(joint.name for joint in self.joints),
            self.coordinates,
            self.speeds,
            self.parameters,
        )

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
    def quaternions(self) -> Mapping[str, slice]:
        """Places of the quaternions in q, by joint."""
        offsets = {joint.name: JOINT_KINDS[joint.kind].quaternion for joint in self.joints}
        starts = {
            name: self.coordinates.of(name).start + offset
            for name, offset in offsets.items()
            if offset is not None
        }
        return {name: slice(start, start + 4) for name, start in starts.items()}

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
        by_parent: dict[str, list[Joint]] = {GROUND: [], **{body.name: [] for body in self.bodies}}
        for joint in self.joints:
            by_parent[joint.parent].append(joint)
        return {name: tuple(joints) for name, joints in by_parent.items()}

    def body(self, name: str) -> Body:
        """The body of that name; InputError with the closest match otherwise."""
        part: Body = _named(self.bodies, name, "body")
        return part

    def joint(self, name: str) -> Joint:
        """The joint of that name; InputError with the closest match otherwise."""
        part: Joint = _named(self.joints, name, "joint")
        return part

    # --- numbers -------------------------------------------------------------------------------

    def number(self, quantity: Quantity) -> float:
        """The value of a quantity at the parameters' values."""
        return evaluate(quantity, self.parameters)

    @property
    def numbers(self) -> Mapping[str, float]:
        """Its parameters and plain numbers by name, such as ``body.thigh.mass``; see `addresses`."""
        return numbers(self)

    def opened(self, *names: str, where: str = "") -> Mechanism:
        """The same mechanism with some of its `numbers` as parameters of those names.

        Raises UnknownName, with near ones, for a name of no number; the message begins with `where`.
        """
        same: Mechanism = opened(self, names, where)
        return same

    def varying(self, *names: str) -> Mechanism:
        """The same mechanism, whose compiled code takes these parameters or `numbers` as inputs.

        `simulate` then compiles once for all of their values, which `with_parameters` changes; all other
        numbers are constants of the code. Raises UnknownName, with near ones, for a name of no number.
        """
        for name in names:
            if not isinstance(name, str):
                raise WrongType(
                    f"varying: found {shown(name)}; expected names of parameters, each a text"
                )
        return replace(self.opened(*names), varied=tuple(dict.fromkeys((*self.varied, *names))))

    def with_parameters(self, **values: float) -> Mechanism:
        """The same mechanism with other values of some parameters, or of other `numbers` of its."""
        same = self.opened(*values)
        return replace(same, parameters={**same.parameters, **values})

    def digest(self, without: Iterable[str] = ()) -> str:
        """A digest of the description, the values of some parameters left out."""
        left_out = set(without)
        return self._digest(left_out) if left_out else self.hash

    def _digest(self, left_out: set[str]) -> str:
        values = sorted((k, v) for k, v in self.parameters.items() if k not in left_out)
        description = (self.bodies, self.joints, self.forces, self.constraints, self.gravity)
        parts: tuple[object, ...] = (*description, values, sorted(left_out), *self.events)
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]

    @cached_property
    def hash(self) -> str:
        """The digest that tells whether a log belongs to this mechanism."""
        return self._digest(set())

    # --- states --------------------------------------------------------------------------------

    def state(
        self,
        coordinates: Mapping[str, ArrayLike] | Sequence[float] | Array | None = None,
        speeds: Mapping[str, ArrayLike] | Sequence[float] | Array | None = None,
        t: float = 0.0,
    ) -> State:
        """The state with the given coordinates and speeds; those not named are zero (or identity).

        Mappings go by the name of an entry, or of a joint with a sequence of all its entries; else
        all of q (nq,), all of u (nu,). Prescribed joints take the values of their law at `t`.

        Raises InputError for unknown names, wrong sizes, values that are not finite, a quaternion
        far from unit length, and a value of a prescribed joint that departs from its law.
        """
        return make_state(self.joints, self.scope, coordinates, speeds, t)

    # --- for people ----------------------------------------------------------------------------

    def summary(self) -> str:
        """Its name and how many parts it has, in one line."""
        counts = (
            f"{len(self.bodies)} bodies",
            f"{len(self.joints)} joints",
            f"{len(self.free.u)} free speeds",
            f"{len(self.elements)} force elements",
            f"{len(self.constraints)} constraints" if self.constraints else "",
            f"{len(self.events)} events" if self.events else "",
        )
        return f"{self.name!r}: {', '.join(filter(None, counts))}"

    def sections(self) -> Iterator[Section]:
        """Tables of joints with the bodies that they carry, of all other parts, and of parameters."""
        rows = []
        for joint in self.joints:
            body = self.body(joint.child)
            mass = "" if body.massless else number(self.number(body.mass), "kg")
            kind = f"{joint.kind}, prescribed" if joint.prescribed else joint.kind
            rows.append((joint.name, kind, joint.parent, joint.child, mass))
        yield Table(("joint", "kind", "from", "carries", "mass"), tuple(rows))
        others = (*self.elements, *self.constraints, *self.events)
        parts = tuple((part.noun, part.name, ", ".join(part.channel_kinds)) for part in others)
        yield Table(("part", "name", "channels"), parts)
        values = tuple((name, number(value)) for name, value in self.parameters.items())
        yield Table(("parameter", "value"), values)

    def __repr__(self) -> str:
        return f"Mechanism({self.summary()})"


def _entries(joints: Sequence[Joint], what: Literal["coordinates", "speeds"]) -> Entries:
    entries: list[Entry] = []
    for joint in joints:
        slots = getattr(JOINT_KINDS[joint.kind], what)
        for name, (suffix, unit) in zip(getattr(joint, what), slots):
            turns = suffix in ("qw", "qx", "qy", "qz")
            entries.append(Entry(name, joint.name, unit, len(entries), joint.prescribed, turns))
    return Entries(tuple(entries))


def _named(parts: Sequence[Any], name: str, what: str) -> Any:
    for part in parts:
        if part.name == name:
            return part
    raise UnknownName(f"unknown {what} {name!r}{closest(name, [part.name for part in parts])}")


def _of_kind(elements: Any, what: str, kind: Any, example: str) -> tuple[Any, ...]:
    """The parts as a tuple; InputError unless each is of its kind."""
    if not isinstance(elements, Iterable) or isinstance(elements, str):
        raise ModelError(
            f"{what} of the mechanism: found {_described(elements)}, expected a sequence of what {example} "
            "returns"
        )
    parts = tuple(elements)
    for part in parts:
        if not isinstance(part, kind):
            raise ModelError(
                f"{what} of the mechanism: found {_described(part)}, expected what {example} returns"
            )
    return parts


def _described(value: object) -> str:
    return value.where if isinstance(value, Part) else shown(value)


def _parameters(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters as floats; their names must be usable in laws."""
    if not isinstance(parameters, Mapping):
        raise ModelError(
            f"parameters: found {shown(parameters)}, expected values by name: {{'k': 2.0}}"
        )
    values: dict[str, float] = {}
    for name, value in parameters.items():
        reserved = ("t", "q", "u", "pi")
        address = isinstance(name, str) and name.partition(".")[0] in ADDRESSED
        if not address and (
            not isinstance(name, str) or not name.isidentifier() or name in reserved
        ):
            raise ModelError(
                f"parameter {name!r}: a name of letters, digits and underscores is expected, "
                "other than t, q, u and pi"
            )
        number = number_or_nan(value)
        if not math.isfinite(number):
            raise ModelError(f"parameter {name!r} is {value!r}; expected a finite number")
        values[name] = number
    return values


def _tree_order(bodies: Sequence[Body], joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The joints with parents before children; InputError unless they make a tree on the ground."""
    _distinct(bodies, "bodies")
    _distinct(joints, "joints")
    names = [body.name for body in bodies]
    carrier: dict[str, Joint] = {}
    for joint in joints:
        ends = joint.parent, joint.child
        check_names(ends, [*names, GROUND], f"joint {joint.name!r}: unknown body")
        if joint.child in carrier:
            raise ModelError(
                f"body {joint.child!r} is the child of two joints, "
                f"{carrier[joint.child].name!r} and {joint.name!r}; in a tree each body is carried by "
                "one joint. Close a loop by a constraint instead"
            )
        carrier[joint.child] = joint
    for name in names:
        if name not in carrier:
            raise ModelError(
                f"body {name!r} is carried by no joint; connect it, for example by "
                f"deltac.free('base', {name!r})"
            )
    ordered: list[Joint] = []
    reached = {GROUND}
    waiting = list(joints)
    while waiting:
        next_joints = [joint for joint in waiting if joint.parent in reached]
        if not next_joints:
            cycle = ", ".join(
                f"{joint.name!r} ({joint.parent} → {joint.child})" for joint in waiting
            )
            raise ModelError(
                f"the joints {cycle} form a cycle that is not connected to the ground; the joints of a "
                "mechanism must form a tree rooted at 'ground'"
            )
        # The first in the order given: an order that already has parents first is kept as it is.
        first = next_joints[0]
        ordered.append(first)
        reached.add(first.child)
        waiting.remove(first)
    return tuple(ordered)


def _distinct(parts: Iterable[Part], what: str) -> None:
    """InputError if two parts of one kind share a name."""
    names: set[str] = set()
    for part in parts:
        if part.name in names:
            raise ModelError(f"two {what} are called {part.name!r}; names must differ")
        names.add(part.name)


def _check_names_of_coordinates(mechanism: Mechanism) -> None:
    """A joint 'hip.x' beside a planar joint 'hip' would name two coordinates alike."""
    for entries in (mechanism.coordinates, mechanism.speeds):
        owner: dict[str, str] = {}
        for entry in entries:
            if entry.name in owner:
                raise ModelError(
                    f"joints {owner[entry.name]!r} and {entry.joint!r} both have a coordinate or speed "
                    f"{entry.name!r}; rename one of the joints"
                )
            owner[entry.name] = entry.joint


def _check_channels(parts: Iterable[Part]) -> None:
    """Every channel has one owner: a log could not tell the energies of two apart."""
    owners: dict[tuple[str, str], Part] = {}
    for part in parts:
        for kind in part.channel_kinds:
            if owner := owners.get((kind, part.name)):
                raise ModelError(
                    f"{owner.where} and {part.where} would both use the channel '{kind} {part.name}'; "
                    "give one of them another name"
                )
            owners[kind, part.name] = part


def _check_mass_carried(mechanism: Mechanism) -> None:
    """A joint that moves nothing with mass has no equation of motion, unless constraints determine it."""
    if (
        mechanism.constraints
    ):  # whether they do depends on the state: `dynamics.singular_inertia` tells
        return
    carried: dict[str, bool] = {}
    for joint in reversed(mechanism.joints):
        heavy = not mechanism.body(joint.child).massless or any(
            carried[below.name] for below in mechanism.children[joint.child]
        )
        carried[joint.name] = heavy
        moves = bool(joint.speeds) and not joint.prescribed
        if moves and not heavy and not any(mechanism.number(a) > 0.0 for a in joint.armature):
            raise ModelError(
                f"joint {joint.name!r} moves the massless frame {joint.child!r} and nothing else, so "
                "its motion is undetermined; give a body on it a mass, the joint an armature, or "
                "determine its coordinates by constraints"
            )
