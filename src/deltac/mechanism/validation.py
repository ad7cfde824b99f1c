"""Checks of a mechanism's description; every error names the part and the remedy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from deltac.errors import InputError, closest
from deltac.mechanism.bodies import GROUND, Body
from deltac.mechanism.constraint_checks import check_constraint
from deltac.mechanism.constraints import Constraint
from deltac.mechanism.contact import Contact
from deltac.mechanism.contact_checks import check_contact, check_friction, no_source
from deltac.mechanism.forces import (
    Element,
    GravityCompensation,
    JointDamper,
    JointSpring,
    JointTorque,
    PointForce,
    SpringDamper,
    Tendon,
)
from deltac.mechanism.friction import JointFriction, PointFriction
from deltac.mechanism.joints import KINDS, Joint
from deltac.mechanism.laws import check_symbols, symbol_names
from deltac.mechanism.quantities import require_positive

if TYPE_CHECKING:
    from deltac.mechanism.mechanism import Mechanism


def parameters(given: Mapping[str, float]) -> dict[str, float]:
    """The parameters as floats; their names must be usable in laws."""
    values: dict[str, float] = {}
    for name, value in given.items():
        if not isinstance(name, str) or not name.isidentifier() or name in ("t", "q", "u", "pi"):
            raise InputError(
                f"parameter {name!r}: a name of letters, digits and underscores is expected, "
                "other than t, q, u and pi"
            )
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number):
            raise InputError(f"parameter {name!r} is {value!r}; expected a finite number")
        values[name] = number
    return values


def unique(parts: Iterable[Any], what: str) -> None:
    """InputError if two parts of one kind share a name."""
    seen: set[str] = set()
    for part in parts:
        if part.name in seen:
            raise InputError(f"two {what} are called {part.name!r}; names must differ")
        seen.add(part.name)


def tree_order(bodies: Sequence[Body], joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The joints with parents before children; InputError unless they make a tree on the ground."""
    _of_type(bodies, Body, "bodies", "deltac.body(...)")
    _of_type(joints, Joint, "joints", "deltac.revolute(...)")
    unique(bodies, "bodies")
    unique(joints, "joints")
    names = [body.name for body in bodies]
    carrier: dict[str, Joint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end != GROUND and end not in names:
                raise InputError(
                    f"joint {joint.name!r}: unknown body {end!r}{closest(end, [*names, GROUND])}"
                )
        if joint.child in carrier:
            raise InputError(
                f"body {joint.child!r} is the child of two joints, "
                f"{carrier[joint.child].name!r} and {joint.name!r}; in a tree each body is carried by "
                "one joint. Close a loop by a constraint instead"
            )
        carrier[joint.child] = joint
    for name in names:
        if name not in carrier:
            raise InputError(
                f"body {name!r} is carried by no joint; connect it, for example by "
                f"deltac.free('base', {name!r})"
            )
    ordered: list[Joint] = []
    reached = {GROUND}
    waiting = list(joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in reached]
        if not ready:
            cycle = ", ".join(
                f"{joint.name!r} ({joint.parent} → {joint.child})" for joint in waiting
            )
            raise InputError(
                f"the joints {cycle} form a cycle that is not connected to the ground; the joints of a "
                "mechanism must form a tree rooted at 'ground'"
            )
        # The first in the order given: an order that already has parents first is kept as it is.
        first = ready[0]
        ordered.append(first)
        reached.add(first.child)
        waiting.remove(first)
    return tuple(ordered)


def check(mechanism: Mechanism) -> None:
    """All checks that need the whole mechanism."""
    if not isinstance(mechanism.name, str) or not mechanism.name:
        raise InputError(f"name of the mechanism: expected a text, found {mechanism.name!r}")
    _of_type(mechanism.forces, Element, "forces", "deltac.joint_torque(...)")
    _check_names_of_coordinates(mechanism)
    _check_symbols_of_quantities(mechanism)
    for body in mechanism.bodies:
        body.check(mechanism.number)
    # Elements that share a channel's name could not be told apart.
    for kinds, what in (
        (JointSpring | SpringDamper | Tendon | Contact, "springs and contacts"),
        (JointDamper | SpringDamper | Tendon, "dampers"),
        (JointFriction | PointFriction | Contact, "frictions and contacts"),
        (JointTorque, "joint torques"),
        (PointForce | GravityCompensation, "applied forces"),
    ):
        unique((e for e in mechanism.elements if isinstance(e, kinds)), what)
    for element in mechanism.elements:
        _check_element(mechanism, element)
    _check_driven_springs(mechanism)
    _of_type(mechanism.constraints, Constraint, "constraints", "deltac.distance(...)")
    unique(mechanism.constraints, "constraints")
    for constraint in mechanism.constraints:
        check_constraint(mechanism, constraint)
    for joint in mechanism.joints:
        for a in joint.armature:
            require_positive(
                mechanism.number(a), f"armature of joint {joint.name!r}", allow_zero=True
            )
        for law in joint.motion:
            check_symbols(law, ["t", *mechanism.parameters], f"motion of joint {joint.name!r}")
    _check_mass_carried(mechanism)


def _of_type(parts: Iterable[Any], kind: Any, what: str, example: str) -> None:
    for part in parts:
        if not isinstance(part, kind):
            raise InputError(
                f"{what} of the mechanism: found {part!r}, expected what {example} returns"
            )


def _check_names_of_coordinates(mechanism: Mechanism) -> None:
    """A joint 'hip.x' beside a planar joint 'hip' would name two coordinates alike."""
    for entries in (mechanism.coordinates, mechanism.speeds):
        owner: dict[str, str] = {}
        for entry in entries:
            if entry.name in owner:
                raise InputError(
                    f"joints {owner[entry.name]!r} and {entry.joint!r} both have a coordinate or speed "
                    f"{entry.name!r}; rename one of the joints"
                )
            owner[entry.name] = entry.joint


def _check_driven_springs(mechanism: Mechanism) -> None:
    """Both would flow through the channel 'prescribed <name>', which a log could not tell apart."""
    prescribed = {joint.name for joint in mechanism.joints if joint.prescribed}
    for element in mechanism.elements:
        match element:
            case JointSpring():
                laws: tuple[Any, ...] = (*element.stiffness, *element.rest, element.potential)
            case SpringDamper():
                laws = (element.stiffness, element.length)
            case _:
                continue
        in_time = any("t" in symbol_names(law) for law in laws if law is not None)
        if in_time and element.name in prescribed:
            raise InputError(
                f"spring {element.name!r} depends on time and has the name of a joint whose motion is "
                f"prescribed, so that both would use the channel 'prescribed {element.name}'; make it by "
                "joint_spring or spring_damper with another name"
            )


def _check_symbols_of_quantities(mechanism: Mechanism) -> None:
    known = tuple(mechanism.parameters)
    for body in mechanism.bodies:
        for quantity in (body.mass, *body.mass_centre, *(e for row in body.inertia for e in row)):
            check_symbols(quantity, known, f"a quantity of body {body.name!r}")
    for joint in mechanism.joints:
        quantities = (*joint.position, *joint.child_position, joint.pitch, *joint.armature)
        for quantity in quantities:
            check_symbols(quantity, known, f"a quantity of joint {joint.name!r}")
    for component in mechanism.gravity:
        check_symbols(component, known, "gravity")


def _check_element(mechanism: Mechanism, element: Element) -> None:
    parameters = tuple(mechanism.parameters)
    in_time = ["t", *parameters]
    every = [
        *in_time,
        *(f"q.{name}" for name in mechanism.coordinates.names),
        *(f"u.{name}" for name in mechanism.speeds.names),
    ]
    match element:
        case JointSpring():
            where = f"joint spring {element.name!r}"
            joint = _joint_of(mechanism, element.joint, where)
            kind = KINDS[joint.kind]
            slots = len(kind.coordinates) - (3 if kind.quaternion is not None else 0)
            if element.potential is not None:
                allowed = [*in_time, *(f"q.{name}" for name in joint.coordinates)]
                check_symbols(element.potential, allowed, f"potential of {where}")
            else:
                _check_count(element.stiffness, slots, f"stiffness of {where}")
                _check_count(element.rest, slots, f"rest of {where}")
                for law in (*element.stiffness, *element.rest):
                    check_symbols(law, in_time, where)
        case JointDamper():
            where = f"joint damper {element.name!r}"
            joint = _joint_of(mechanism, element.joint, where)
            _check_count(element.damping, len(joint.speeds), f"damping of {where}")
            for law in element.damping:
                check_symbols(law, every, where)
                if not element.allow_energy_source and symbol_names(law) <= set(parameters):
                    no_source(mechanism, law, f"damping of {where}")
        case JointTorque():
            where = f"joint torque {element.name!r}"
            joint = _joint_of(mechanism, element.joint, where)
            if element.torque is not None:
                _check_count(element.torque, len(joint.speeds), f"law of {where}")
                for law in element.torque:
                    check_symbols(law, every, f"law of {where}")
        case PointForce():
            where = f"point force {element.name!r}"
            _require_body(mechanism, element.body, where, ground=False)
            for quantity in element.point:
                check_symbols(quantity, parameters, f"point of {where}")
            for law in (*element.force, *element.moment):
                check_symbols(law, every, f"law of {where}")
        case SpringDamper():
            where = f"spring-damper {element.name!r}"
            _require_body(mechanism, element.body1, where)
            _require_body(mechanism, element.body2, where)
            for quantity in (*element.point1, *element.point2):
                check_symbols(quantity, parameters, f"a point of {where}")
            for law in (element.stiffness, element.length):
                check_symbols(law, in_time, where)
            check_symbols(element.damping, parameters, f"damping of {where}")
        case Tendon():
            _check_tendon(mechanism, element, parameters)
        case GravityCompensation():
            where = f"gravity compensation {element.name!r}"
            for name, fraction in element.fractions:
                _require_body(mechanism, name, where, ground=False)
                check_symbols(fraction, parameters, f"fraction of {name!r} in {where}")
        case JointFriction():
            where = f"joint friction {element.name!r}"
            joint = _joint_of(mechanism, element.joint, where)
            _check_count(element.laws, len(joint.speeds), f"laws of {where}")
            for friction in element.laws:
                source = element.allow_energy_source
                check_friction(mechanism, friction, where, every, source=source)
        case PointFriction():
            where = f"point friction {element.name!r}"
            for body in (element.body, element.on):
                _require_body(mechanism, body, where)
            for quantity in element.point:
                check_symbols(quantity, parameters, f"point of {where}")
            check_symbols(element.normal_force, every, f"normal force of {where}")
            source = element.allow_energy_source
            check_friction(mechanism, element.law, where, every, source=source)
        case Contact():
            check_contact(mechanism, element)


def _check_tendon(mechanism: Mechanism, element: Tendon, parameters: Sequence[str]) -> None:
    where = f"tendon {element.name!r}"
    for name, factor in element.coordinates:
        if name not in mechanism.coordinates.names:
            raise InputError(
                f"{where}: unknown coordinate {name!r}{closest(name, mechanism.coordinates.names)}"
            )
        joint = mechanism.joint(mechanism.coordinates[name].joint)
        if not KINDS[joint.kind].rates:
            raise InputError(
                f"{where}: the rate of {name!r} is no speed of the {joint.kind} joint {joint.name!r}; "
                "a tendon takes coordinates of joints without quaternions"
            )
        check_symbols(factor, parameters, f"coefficient of {name!r} in {where}")
    for branch in element.branches:
        check_symbols(branch.factor, parameters, f"factor of a branch of {where}")
        for body, point in branch.points:
            _require_body(mechanism, body, where)
            for quantity in point:
                check_symbols(quantity, parameters, f"a point of {where}")
    for quantity in (*element.stiffness, *element.damping, *element.length):
        check_symbols(quantity, parameters, where)
    low, high = (mechanism.number(end) for end in element.length)
    if low > high:
        raise InputError(
            f"length of {where}: the band from {low:g} to {high:g} is empty; swap them"
        )


def _joint_of(mechanism: Mechanism, name: str, where: str) -> Joint:
    names = [joint.name for joint in mechanism.joints]
    if name not in names:
        raise InputError(f"{where}: unknown joint {name!r}{closest(name, names)}")
    joint = mechanism.joint(name)
    if not joint.speeds:
        raise InputError(f"{where}: joint {name!r} is fixed, so no force of a joint acts there")
    return joint


def _require_body(mechanism: Mechanism, name: str, where: str, *, ground: bool = True) -> None:
    names = [body.name for body in mechanism.bodies]
    if name not in names and not (ground and name == GROUND):
        raise InputError(f"{where}: unknown body {name!r}{closest(name, names)}")


def _check_count(values: Sequence[Any], expected: int, where: str) -> None:
    if len(values) != expected:
        raise InputError(f"{where}: expected {expected} values, found {len(values)}")


def _check_mass_carried(mechanism: Mechanism) -> None:
    """A joint that moves nothing with mass has no equation of motion."""
    carried: dict[str, bool] = {}
    for joint in reversed(mechanism.joints):
        heavy = not mechanism.body(joint.child).massless or any(
            carried[below.name] for below in mechanism.children[joint.child]
        )
        carried[joint.name] = heavy
        moves = bool(joint.speeds) and not joint.prescribed
        if moves and not heavy and not any(mechanism.number(a) > 0.0 for a in joint.armature):
            raise InputError(
                f"joint {joint.name!r} moves the massless frame {joint.child!r} and nothing else, so "
                "its motion is undetermined; give a body on it a mass, or the joint an armature"
            )
