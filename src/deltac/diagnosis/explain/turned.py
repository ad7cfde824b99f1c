"""A mass centre that is turned about its joint, which an encoder's zero looks exactly like.

A joint that is logged α too large, and that carries but one body, leaves what a mass centre leaves that is
turned by −α. The first is one number and a slip of the log, the second up to three; so it comes first. The
regression knows zeros to second order in α only, and finds the second closer to an exact log.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.explain.causes import KINDS
from deltac.diagnosis.explain.result import Cause, Explanation
from deltac.mechanism.forces import JointDamper, JointTorque
from deltac.mechanism.friction import JointFriction
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism

ROUND = 3e-4
"""Share of a displacement by which it may miss the circle about the joint."""

LARGEST = 0.6
"""Angles beyond this are no calibration, rad."""


def turned(mechanism: Mechanism, found: Explanation) -> Explanation:
    """The explanation, by a joint's zero where a mass centre that is turned about it is the only cause."""
    if found.kind not in ("explained", "ambiguous") or len(found.causes) != 1:
        return found
    (cause,) = found.causes
    zero = _zero(mechanism, cause) if cause.kind == "body-centre" else None
    if zero is None:
        return found
    others = tuple(a for a in found.alternatives if [c.kind for c in a] != ["zero-offset"])
    separating = "" if found.kind == "explained" else found.separating
    return replace(
        found,
        kind="ambiguous",
        causes=(zero,),
        alternatives=((cause,), *others),
        separating=separating,
    )


def _zero(mechanism: Mechanism, cause: Cause) -> Cause | None:
    """The offset of the joint of a last body that has the same effect as its displaced mass centre."""
    joint = next((j for j in mechanism.joints if j.child == cause.element), None)
    if joint is None or joint.kind != "revolute" or joint.prescribed or _held(mechanism, joint):
        return None
    body = next(b for b in mechanism.bodies if b.name == cause.element)
    axis = _numbers(mechanism, joint.child_rotation) @ np.asarray(joint.axes[0], dtype=float)
    axis = axis / np.linalg.norm(axis)
    arm = _numbers(mechanism, body.mass_centre) - _numbers(mechanism, joint.child_position)
    moved, error = np.zeros(3), np.zeros(3)
    for name, value, bar in zip(cause.names, cause.values, cause.errors):
        place = "xyz".find(name[-1:])
        if place < 0:
            return None
        moved[place], error[place] = value, bar
    there = arm + moved
    arm, there = arm - axis * (axis @ arm), there - axis * (axis @ there)
    long, short = float(np.linalg.norm(there)), float(np.linalg.norm(arm))
    may = ROUND * float(np.linalg.norm(moved)) + 3.0 * float(np.linalg.norm(error))
    if short == 0.0 or abs(long - short) > may or abs(float(axis @ moved)) > may:
        return None
    angle = -float(np.arctan2(axis @ np.cross(arm, there), arm @ there))
    if abs(angle) > LARGEST:
        return None
    bar = float(np.linalg.norm(error)) / short
    speed = mechanism.speeds[mechanism.speeds.of(joint.name).start].name
    return Cause(
        "zero-offset", speed, (angle,), (bar,), ("offset",), ("rad",), (0.0,), cause.share,
        KINDS["zero-offset"].words.format(element=f"`{speed}`", shown=f"{angle:.6g}", unit="rad"),
    )  # fmt: skip


def _held(mechanism: Mechanism, joint: Joint) -> bool:
    """Whether anything but gravity would feel another zero: springs, what the body carries or is tied to."""
    if mechanism.constraints or any(j.parent == joint.child for j in mechanism.joints):
        return True
    if any(joint.stiffness):
        return True
    of_speeds = (JointDamper, JointFriction)
    return any(
        f"'{name}'" in repr(element)
        for name in (joint.name, joint.child)
        for element in mechanism.forces
        if not isinstance(element, of_speeds)
        and not (isinstance(element, JointTorque) and element.torque is None)
    )


def _numbers(mechanism: Mechanism, values: object) -> Array:
    table = np.asarray(values, dtype=object)
    return np.array([mechanism.number(x) for x in table.ravel()]).reshape(table.shape)
