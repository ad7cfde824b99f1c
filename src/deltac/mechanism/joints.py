"""Joints: how a body moves relative to its parent, and the coordinates and speeds that say so.

A joint has a frame on its parent (at `position`, turned by `rotation`) and a frame on its child (at
`child_position`, turned by `child_rotation`); its coordinates place the second relative to the
first. The table `JOINT_KINDS` lists coordinates q, speeds u and their units for every kind. For all kinds
but spherical and free the speeds are the rates of the coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, TypedDict, Unpack

from deltac.calls.arguments import Target
from deltac.errors import ModelError
from deltac.mechanism.laws import LawLike, LawsLike, VectorLike, as_law
from deltac.mechanism.parts import (
    Constant,
    FieldKind,
    LawsOfTime,
    NonNegatives,
    Part,
    Point,
    Rotation,
    constructor,
    require_count,
)
from deltac.mechanism.quantities import IDENTITY, ZERO, AxisLike, RotationLike, unit_vector
from deltac.mechanism.scope import GROUND, require_name


@dataclass(frozen=True)
class JointKind:
    """What a kind of joint adds to q and u.

    `coordinates` and `speeds` are (suffix, unit) pairs; a joint's single coordinate has no suffix.
    `quaternion` is the offset of a unit quaternion (scalar first) in its coordinates, if it has one.
    """

    coordinates: tuple[tuple[str, str], ...]
    speeds: tuple[tuple[str, str], ...]
    axes: int = 0
    quaternion: int | None = None

    @property
    def rates(self) -> bool:
        """Whether the speeds are the time derivatives of the coordinates."""
        return self.quaternion is None


def _rates(*coordinates: tuple[str, str], axes: int = 0) -> JointKind:
    return JointKind(coordinates, tuple((s, f"{unit}/s") for s, unit in coordinates), axes)


_QUATERNION = (("qw", "1"), ("qx", "1"), ("qy", "1"), ("qz", "1"))
_ANGULAR = (("wx", "rad/s"), ("wy", "rad/s"), ("wz", "rad/s"))

JOINT_KINDS: dict[str, JointKind] = {
    "fixed": _rates(),
    "revolute": _rates(("", "rad"), axes=1),
    "prismatic": _rates(("", "m"), axes=1),
    "screw": _rates(("", "rad"), axes=1),
    "cylindrical": _rates(("angle", "rad"), ("slide", "m"), axes=1),
    "universal": _rates(("first", "rad"), ("second", "rad"), axes=2),
    "planar": _rates(("x", "m"), ("y", "m"), ("angle", "rad")),
    "spherical": JointKind(_QUATERNION, _ANGULAR, quaternion=0),
    "free": JointKind(
        (("x", "m"), ("y", "m"), ("z", "m"), *_QUATERNION),
        (("vx", "m/s"), ("vy", "m/s"), ("vz", "m/s"), *_ANGULAR),
        quaternion=3,
    ),
}
"""Every kind of joint by name."""


def _axes(value: Any, where: str) -> tuple[tuple[float, float, float], ...]:
    return tuple(unit_vector(axis, where) for axis in value)


@dataclass(frozen=True)
class Joint(Part):
    """A joint between `parent` (a body or "ground") and `child`; make it by `revolute`, `free`, ….

    `stiffness` and `rest` hold one law per coordinate (one for a quaternion), `damping` and
    `armature` (reflected rotor inertia, adds ½ a u² to the kinetic energy) one per speed; empty
    means none. `motion` holds one law of t per coordinate if the joint's motion is prescribed.
    """

    name: str
    kind: str
    parent: str
    child: str
    axes: Annotated[Any, FieldKind(_axes)] = ()
    position: Point = ZERO
    rotation: Rotation = IDENTITY
    child_position: Point = ZERO
    child_rotation: Rotation = IDENTITY
    pitch: Constant = 0.0
    stiffness: tuple[Any, ...] = ()
    rest: tuple[Any, ...] = ()
    damping: tuple[Any, ...] = ()
    armature: NonNegatives = ()
    motion: LawsOfTime = ()

    noun = "joint"

    @property
    def channel_kinds(self) -> tuple[str, ...]:
        """What drives a prescribed joint."""
        return ("prescribed",) if self.motion else ()

    @property
    def prescribed(self) -> bool:
        """Whether the motion of the joint is a given function of time."""
        return bool(self.motion)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates: the joint's own name, or ``<joint>.<part>``."""
        return tuple(_full(self.name, s) for s, _ in JOINT_KINDS[self.kind].coordinates)

    @property
    def speeds(self) -> tuple[str, ...]:
        """Names of its speeds."""
        return tuple(_full(self.name, s) for s, _ in JOINT_KINDS[self.kind].speeds)


def _full(joint: str, suffix: str) -> str:
    return f"{joint}.{suffix}" if suffix else joint


def _joint(
    kind: str,
    name: str,
    parent: str,
    child: str,
    *axes: AxisLike,
    position: VectorLike = ZERO,
    rotation: RotationLike = IDENTITY,
    child_position: VectorLike = ZERO,
    child_rotation: RotationLike = IDENTITY,
    stiffness: LawsLike | None = None,
    rest: LawsLike | None = None,
    damping: LawsLike | None = None,
    armature: LawsLike | None = None,
    motion: LawsLike | None = None,
) -> Joint:
    where = f"of {Joint.called(name)}"
    for end in (parent, child):
        require_name(end, "body", f"joint {name!r}")
    if parent == child:
        raise ModelError(f"joint {name!r} connects body {child!r} with itself")
    if child == GROUND:
        order = "free(name, child)" if kind == "free" else f"{kind}(name, parent, child)"
        raise ModelError(f"joint {name!r}: the ground cannot be a child; the order is {order}")
    shape = JOINT_KINDS[kind]
    # A quaternion turns as one: one stiffness, and no law of its own.
    springs = len(shape.coordinates) - (3 if shape.quaternion is not None else 0)
    if motion is not None and not shape.rates:
        raise ModelError(
            f"motion {where}: the motion of a {kind} joint cannot be prescribed; build it from revolute "
            f"and prismatic joints with massless frames between them"
        )
    if motion is not None and (stiffness is not None or damping is not None) and not shape.speeds:
        raise ModelError(f"joint {name!r} has no motion to prescribe")
    if rest is not None and shape.quaternion is not None and springs == 1:
        raise ModelError(
            f"rest {where}: the spring of a quaternion pulls to the identity; turn the joint's frame "
            "with rotation= to place its rest elsewhere"
        )
    stiff = _laws(stiffness, springs, f"stiffness {where}")
    if rest is not None and not stiff:
        raise ModelError(f"rest {where} is given without a stiffness")
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        axes=axes,
        position=position,
        rotation=rotation,
        child_position=child_position,
        child_rotation=child_rotation,
        stiffness=stiff,
        rest=_laws(0.0 if rest is None else rest, springs, f"rest {where}") if stiff else (),
        damping=_laws(damping, len(shape.speeds), f"damping {where}"),
        armature=_laws(armature, len(shape.speeds), f"armature {where}"),
        motion=_laws(motion, len(shape.coordinates), f"motion {where}"),
    )


class JointOptions(TypedDict, total=False):
    """What every joint takes by keyword; see `revolute`."""

    position: VectorLike
    rotation: RotationLike
    child_position: VectorLike
    child_rotation: RotationLike
    stiffness: LawsLike | None
    rest: LawsLike | None
    damping: LawsLike | None
    armature: LawsLike | None
    motion: LawsLike | None


def _joint_constructor(function: Target) -> Target:
    return constructor(function, options=_joint)


def _laws(value: Any, count: int, where: str) -> tuple[Any, ...]:
    """One law per slot: a single value goes to every slot, a sequence must have the right length."""
    if value is None:
        return ()
    if count == 0:
        raise ModelError(f"{where}: the joint has no motion, so it takes none")
    if isinstance(value, list | tuple):
        require_count(value, count, where)
        return tuple(as_law(entry, where) for entry in value)
    return (as_law(value, where),) * count


@_joint_constructor
def fixed(name: str, parent: str, child: str, **options: Unpack[JointOptions]) -> Joint:
    """A rigid connection; `options` are the placements of `revolute`."""
    return _joint("fixed", name, parent, child, **options)


@_joint_constructor
def revolute(
    name: str,
    parent: str,
    child: str,
    axis: AxisLike = "z",
    **options: Unpack[JointOptions],
) -> Joint:
    """A hinge: the child turns by the angle q (rad, right-handed) about `axis` of the joint frame.

    Options (of every joint): `position` and `rotation` of the joint frame in the parent's body frame,
    `child_position` and `child_rotation` in the child's (m; 3 by 3 or quaternion); `stiffness` and
    `rest`, `damping`, `armature`: a value for all coordinates or one for each; `motion`: a law of t,
    for example ``"A*sin(w*t)"``, that prescribes the coordinate (one for each).
    """
    return _joint("revolute", name, parent, child, axis, **options)


@_joint_constructor
def prismatic(
    name: str,
    parent: str,
    child: str,
    axis: AxisLike = "x",
    **options: Unpack[JointOptions],
) -> Joint:
    """A slide: the child moves by q (m) along `axis` of the joint frame."""
    return _joint("prismatic", name, parent, child, axis, **options)


@_joint_constructor
def screw(
    name: str,
    parent: str,
    child: str,
    axis: AxisLike = "z",
    *,
    pitch: LawLike,
    **options: Unpack[JointOptions],
) -> Joint:
    """A screw: turns by q (rad) about `axis` and advances by `pitch` q/(2π); `pitch` in m per turn."""
    return replace(_joint("screw", name, parent, child, axis, **options), pitch=pitch)


@_joint_constructor
def cylindrical(
    name: str,
    parent: str,
    child: str,
    axis: AxisLike = "z",
    **options: Unpack[JointOptions],
) -> Joint:
    """Turns by `.angle` (rad) about `axis` and slides by `.slide` (m) along it."""
    return _joint("cylindrical", name, parent, child, axis, **options)


@_joint_constructor
def universal(
    name: str,
    parent: str,
    child: str,
    first: AxisLike = "x",
    second: AxisLike = "y",
    **options: Unpack[JointOptions],
) -> Joint:
    """Turns by `.first` about the axis `first`, then by `.second` about the turned axis `second`."""
    joint = _joint("universal", name, parent, child, first, second, **options)
    a, b = joint.axes
    sine = sum((a[i] * b[j] - a[j] * b[i]) ** 2 for i, j in ((0, 1), (1, 2), (2, 0))) ** 0.5
    if sine < 1e-6:
        raise ModelError(f"joint {name!r}: the two axes of a universal joint must not be parallel")
    return joint


@_joint_constructor
def planar(name: str, parent: str, child: str, **options: Unpack[JointOptions]) -> Joint:
    """Moves by `.x`, `.y` (m) in the x–y plane of the joint frame and turns by `.angle` about its z."""
    return _joint("planar", name, parent, child, **options)


@_joint_constructor
def spherical(name: str, parent: str, child: str, **options: Unpack[JointOptions]) -> Joint:
    """A ball joint: a unit quaternion (scalar first); speeds: angular velocity, body components."""
    joint = _joint("spherical", name, parent, child, **options)
    _require_unturned_child(joint)
    return joint


@_joint_constructor
def free(name: str, child: str, parent: str = GROUND, **options: Unpack[JointOptions]) -> Joint:
    """Six degrees of freedom: position of the body frame's origin, then its orientation.

    Speeds: velocity of the origin in components of the parent's joint frame (the world's, for the
    ground), then angular velocity in body components.
    """
    joint = _joint("free", name, parent, child, **options)
    _require_unturned_child(joint)
    if joint.child_position != ZERO:
        raise ModelError(
            f"joint {name!r}: a free joint describes the body frame's own origin, so it takes no "
            "child_position; move the body's mass centre and points instead"
        )
    return joint


def _require_unturned_child(joint: Joint) -> None:
    if joint.child_rotation != IDENTITY:
        raise ModelError(
            f"joint {joint.name!r}: angular velocity is in body components, so a {joint.kind} joint "
            "takes no child_rotation; turn the parent's side with rotation instead"
        )
