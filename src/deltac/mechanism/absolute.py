"""Absolute angles: the coordinates in which textbooks write planar chains of hinges."""

from __future__ import annotations

from typing import Any

from deltac.errors import InputError
from deltac.mechanism.bodies import GROUND
from deltac.mechanism.coordinates import CoordinateMap
from deltac.mechanism.joints import Joint
from deltac.mechanism.laws import q as symbol
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import IDENTITY

PARALLEL = 1e-12


def absolute_angles(mechanism: Mechanism) -> CoordinateMap:
    """Own coordinates in which hinges in series with parallel axes are told by absolute angles.

    The coordinate of such a hinge (named as the joint) is the angle of its child against the ground (or
    against the first body that does not turn about that axis), rad; all other coordinates stay as
    they are. The speeds are the rates.

    Raises InputError where no two hinges follow each other with parallel axes and unturned frames, and
    for joints whose speeds are no rates.
    """
    carrier = {joint.child: joint for joint in mechanism.joints}
    laws: dict[str, Any] = {}
    names = [mechanism.coordinates[int(k)].name for k in mechanism.free.q]
    for name in names:
        joint = mechanism.joint(mechanism.coordinates[name].joint)
        before = _hinge_before(joint, carrier)
        if joint.kind != "revolute" or before is None:
            laws[name] = symbol(name)
        elif before.prescribed:
            laws[name] = symbol(name) - _angle(before, carrier)
        else:
            laws[name] = symbol(name) - symbol(before.name)
    if all(law == symbol(name) for name, law in laws.items()):
        raise InputError(
            f"mechanism {mechanism.name!r} has no two hinges with parallel axes in series, so absolute "
            "angles are its joints' own; leave coordinates out"
        )
    if len(names) != len(mechanism.free.u):
        raise InputError(
            f"mechanism {mechanism.name!r} has joints whose speeds are not rates of coordinates; write a "
            "CoordinateMap with u="
        )
    return CoordinateMap(tuple(names), q=laws)


def _hinge_before(joint: Joint, carrier: dict[str, Joint]) -> Joint | None:
    """The hinge that turns the joint's parent about the same axis, over rigid connections."""
    if joint.kind != "revolute" or joint.rotation != IDENTITY:
        return None
    body = joint.parent
    while body != GROUND:
        before = carrier[body]
        unturned = before.child_rotation == IDENTITY
        if before.kind == "fixed" and unturned and before.rotation == IDENTITY:
            body = before.parent
            continue
        if before.kind != "revolute" or not unturned:
            return None
        same = all(abs(a - b) < PARALLEL for a, b in zip(before.axes[0], joint.axes[0]))
        return before if same else None
    return None


def _angle(joint: Joint, carrier: dict[str, Joint]) -> Any:
    """The absolute angle of a hinge as a law: the sum of prescribed ones, up to a free one's symbol."""
    if not joint.prescribed:
        return symbol(joint.name)
    before = _hinge_before(joint, carrier)
    own = joint.motion[0]
    return own if before is None else own + _angle(before, carrier)
