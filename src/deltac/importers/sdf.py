"""SDFormat files (Gazebo, Drake): links, joints and inertias, read from the XML itself.

Read is one model, of a file of its own or one of several: links with their inertias, joints of the
kinds revolute, continuous, prismatic, ball, universal, screw and fixed with damping, spring and poses in
any frame, joints that follow others, closed loops (SDFormat 1.4 to 1.11, http://sdformat.org/spec). The
body frame is the link's. What does work and has no counterpart here (contact, limits, dry friction,
plugins) is named in the report.

The first joint in the file with a link as its child carries that link. Every other joint, and one whose
parent is already carried by its child, closes a loop: it is an exact constraint, which the file's pose
satisfies.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from deltac import joints, rotations
from deltac.arrays import Array
from deltac.bodies import Body, body
from deltac.constraints import (
    gear,
    loop_prismatic,
    loop_revolute,
    loop_spherical,
    loop_universal,
    loop_weld,
)
from deltac.errors import ModelError, check_names, closest, shown
from deltac.importers.report import Findings, ImportReport
from deltac.importers.urdf import MOMENTS, inertia_tensor, xml_root
from deltac.joints import Joint
from deltac.mechanism import GROUND, Holonomic, JointOptions, Loop, Mechanism

DEFAULT_GRAVITY = (0.0, 0.0, -9.8)
"""Where no world says otherwise (m/s²); SDFormat's default."""

SDF_JOINTS = ("revolute", "continuous", "prismatic", "ball", "universal", "screw", "fixed")
LOOPS = ("revolute", "continuous", "prismatic", "ball", "universal", "fixed")
"""Kinds of joints that can close a loop."""

_WORLD, _MODEL = ("world", "__root__"), ("__model__", "")

Pose = tuple[Array, Array]
"""Rotation (3, 3) and place (3,) of a frame in another."""


def read_sdf(path: Path, model: str | None = None) -> tuple[Mechanism, ImportReport]:
    """The mechanism of an SDFormat file, and a report; `model` is the name of one of several.

    Raises InputError for a file that is none, has no or several models, or what cannot be read as a tree.
    """
    root = xml_root(path)
    models = [*root.findall("model"), *root.findall("world/model")]
    if root.tag != "sdf" or not models:
        raise ModelError(
            f"model file {path.name!r}: found <{root.tag}> with {len(models)} models, expected <sdf> with one"
        )
    by_name = {one.get("name", ""): one for one in models}
    if model is None and len(models) > 1:
        raise ModelError(
            f"model file {path.name!r}: it holds {len(models)} models; say which: "
            f"{', '.join(f'{path.name}:{name}' for name in by_name)}"
        )
    if model is None:
        model = next(iter(by_name))
    check_names([model], by_name, f"model file {path.name!r}: no model")
    chosen = by_name[model]
    return _SdfReader(path.name, chosen, root.find("world")).read()


@dataclass(frozen=True)
class _Seat:
    """A joint of a `kind` on its links: its frame's place and rotation in either, its axes in that frame."""

    kind: str
    parent: str
    child: str
    position: Array
    rotation: Array
    child_position: Array
    child_rotation: Array
    axes: tuple[list[float], list[float]]

    @property
    def aligned(self) -> Array:
        """The child's rotation in the parent in the file's pose."""
        return self.rotation @ self.child_rotation.T


class _SdfReader:
    """Reads one model."""

    def __init__(self, file: str, model: Element, world: Element | None) -> None:
        self.file, self.model, self.world = file, model, world
        for tag in ("include", "model"):
            if model.find(tag) is not None:
                raise ModelError(
                    f"{file}: <{tag}> within a model is not read; write one flat model"
                )
        self.links = self.named("link")
        self.joints = self.named("joint")
        self.frames = self.named("frame")
        if not self.links:
            raise ModelError(f"{file}: the model has no links")
        self.findings = Findings()
        self.poses: dict[str, Pose] = {}
        self.followers: dict[str, tuple[str, float, float]] = {}

    def named(self, tag: str) -> dict[str, Element]:
        """The elements of a kind by name."""
        elements: dict[str, Element] = {}
        for element in self.model.findall(tag):
            name = element.get("name", "")
            if not name or name in elements:
                raise ModelError(
                    f"{self.file}: <{tag}> {shown(name)} has no name, or stands there twice"
                )
            elements[name] = element
        return elements

    def read(self) -> tuple[Mechanism, ImportReport]:
        """The mechanism and what there is to say of it."""
        carriers = self.carriers()
        static = (self.model.findtext("static") or "").strip() in ("true", "1")
        joints: list[Joint] = []
        waiting = list(self.links)
        done = {GROUND}
        while waiting:
            for link in [link for link in waiting if self.parent(link, carriers) in done]:
                joints.append(self.carried(link, carriers.get(link), static))
                done.add(link)
                waiting.remove(link)
        tree = set(carriers.values())
        loops = [self.loop(name) for name in self.joints if name not in tree]
        self.left_out()
        gravity = DEFAULT_GRAVITY
        if self.world is not None and (gravity_text := self.world.findtext("gravity")) is not None:
            x, y, z = self.numbers(gravity_text, 3, "gravity")
            gravity = (x, y, z)
        else:
            self.findings.assume("world", "gravity is 9.8 m/s² downwards, SDFormat's default")
        mechanism = Mechanism(
            [self.body(name, link) for name, link in self.links.items()],
            joints,
            constraints=[*loops, *self.mimics(joints)],
            gravity=gravity,
            name=self.model.get("name") or self.file,
        )
        mobile = sum(bool(joint.speeds) for joint in joints)
        self.findings.note("tree", f"{len(self.links)} links, {mobile} moving joints")
        for loop in loops:
            self.findings.note(loop.name, "joint that closes a loop, an exact constraint")
        starts = {"model": mechanism.state(self.start(joints))}
        return mechanism, self.findings.report(self.file, starts=starts)

    def carriers(self) -> dict[str, str]:
        """The joint that carries each link: the first of the file that makes no circle with those before."""
        carriers: dict[str, str] = {}
        for name, joint in self.joints.items():
            child = self.end(joint, "child")
            ancestor = parent = self.end(joint, "parent")
            if child == parent:
                raise ModelError(f"{self.file}: joint {name!r} joins link {child!r} to itself")
            while ancestor in carriers:
                ancestor = self.parent(ancestor, carriers)
            if child not in carriers and child != ancestor:
                carriers[child] = name
        return carriers

    def parent(self, link: str, carriers: Mapping[str, str]) -> str:
        """The link that another hangs on; the ground for a root."""
        return self.end(self.joints[carriers[link]], "parent") if link in carriers else GROUND

    def end(self, joint: Element, tag: str) -> str:
        """The link at one end of a joint."""
        name = (joint.findtext(tag) or "").strip()
        if name in _WORLD and tag == "parent":
            return GROUND
        if name in self.frames:
            name = self.attached(name)
        if name not in self.links:
            raise ModelError(
                f"{self.file}: joint {joint.get('name')!r}: its {tag} {shown(name)} is no link"
                f"{closest(name, self.links)}"
            )
        return name

    def attached(self, frame: str) -> str:
        """The link that a frame is attached to."""
        children = set()
        while frame in self.frames and frame not in children:
            children.add(frame)
            frame = self.frames[frame].get("attached_to", "")
        return frame

    def body(self, name: str, link: Element) -> Body:
        inertial = link.find("inertial")
        where = f"link {name!r}"
        mass = 1.0 if inertial is None else self.number(inertial, "mass", 1.0, where)
        if mass == 0.0:
            raise ModelError(
                f"{self.file}: {where} has mass 0, expected a positive one; give it a mass, or move what it "
                "carries to its parent's link"
            )
        R, centre = (np.eye(3), np.zeros(3)) if inertial is None else self.pose(inertial, where)
        moments = inertial.find("inertia") if inertial is not None else None
        if inertial is None:
            self.findings.assume(name, "no <inertial>: 1 kg and 1 kg·m², SDFormat's default")
        default = dict.fromkeys(("ixx", "iyy", "izz"), 1.0)
        values = (
            default.get(key, 0.0)
            if moments is None
            else self.number(moments, key, default.get(key, 0.0), where)
            for key in MOMENTS
        )
        return body(name, mass=mass, inertia=inertia_tensor(values, R), mass_centre=centre.tolist())

    def carried(self, link: str, name: str | None, static: bool) -> Joint:
        """The joint that carries a link; a root floats freely, or stands if the model is static."""
        R_link, p_link = self.world_pose(link)
        if name is None:
            if static:
                return joints.fixed(
                    f"{link}_fixed",
                    GROUND,
                    link,
                    position=p_link.tolist(),
                    rotation=R_link.tolist(),
                )
            self.findings.assume(
                link,
                "no joint carries it: it floats freely",
                f"free joint {link!r}, its pose is the start",
            )
            return joints.free(link, link)
        seat = self.seat(name)
        place: JointOptions = {
            "position": seat.position,
            "rotation": seat.rotation,
            "child_position": seat.child_position,
            "child_rotation": seat.child_rotation,
        }
        options = self.dynamics(name, seat)
        match seat.kind:
            case "fixed":
                return joints.fixed(name, seat.parent, link, **place)
            case "ball":
                return joints.spherical(
                    name,
                    seat.parent,
                    link,
                    position=seat.position,
                    rotation=seat.aligned,
                    child_position=seat.child_position,
                )
            case "universal":
                return joints.universal(name, seat.parent, link, *seat.axes, **place)
            case "screw":
                pitch = self.screw_pitch(name, self.joints[name])
                return joints.screw(
                    name, seat.parent, link, seat.axes[0], pitch=pitch, **place, **options
                )
            case "prismatic":
                return joints.prismatic(name, seat.parent, link, seat.axes[0], **place, **options)
        return joints.revolute(name, seat.parent, link, seat.axes[0], **place, **options)

    def loop(self, name: str) -> Loop:
        """The constraint of a joint that closes a loop."""
        seat = self.seat(name)
        if seat.kind not in LOOPS:
            raise ModelError(
                f"{self.file}: joint {name!r} closes a loop, and its type {seat.kind!r} has no constraint; "
                f"expected one of {', '.join(LOOPS)}. Write it before the other joints of its loop, so that "
                "one of those closes it"
            )
        self.dynamics(name, seat, closing=True)
        ends: dict[str, Any] = {
            "body1": seat.parent,
            "body2": seat.child,
            "point1": seat.position,
            "point2": seat.child_position,
        }
        first = seat.rotation @ seat.axes[0]
        match seat.kind:
            case "fixed":
                return loop_weld(name, **ends, rotation=seat.aligned)
            case "ball":
                return loop_spherical(name, **ends)
            case "universal":
                second = seat.child_rotation @ seat.axes[1]
                return loop_universal(name, **ends, axis1=first, axis2=second)
            case "prismatic":
                return loop_prismatic(name, **ends, axis1=first, rotation=seat.aligned)
        return loop_revolute(name, **ends, axis1=first, axis2=seat.child_rotation @ seat.axes[0])

    def seat(self, name: str) -> _Seat:
        """Where a joint is on its links."""
        joint = self.joints[name]
        kind = joint.get("type", "")
        if kind not in SDF_JOINTS:
            raise ModelError(
                f"{self.file}: joint {name!r}: type {shown(kind)} is not read{closest(kind, SDF_JOINTS)}"
            )
        parent, child = self.end(joint, "parent"), self.end(joint, "child")
        R, p = self.world_pose(name)
        R_parent, p_parent = self.world_pose("world" if parent == GROUND else parent)
        R_child, p_child = self.world_pose(child)
        return _Seat(
            kind,
            parent,
            child,
            R_parent.T @ (p - p_parent),
            R_parent.T @ R,
            R_child.T @ (p - p_child),
            R_child.T @ R,
            (self.axis(name, joint, "axis", R), self.axis(name, joint, "axis2", R)),
        )

    def screw_pitch(self, name: str, joint: Element) -> float:
        """Metres a radian: `screw_thread_pitch` is metres a turn, the old `thread_pitch` radians a metre."""
        if joint.find("screw_thread_pitch") is not None:
            return self.number(joint, "screw_thread_pitch", 1.0, f"joint {name!r}") / (2 * np.pi)
        return -1.0 / self.number(joint, "thread_pitch", 1.0, f"joint {name!r}")

    def axis(self, name: str, joint: Element, tag: str, R_joint: Array) -> list[float]:
        """The unit vector of an axis, in the joint's frame."""
        element = joint.find(tag)
        where = f"joint {name!r}: {tag}"
        if element is None:
            return [0.0, 0.0, 1.0]
        xyz = element.find("xyz")
        direction = np.array(self.numbers(xyz.text if xyz is not None else "0 0 1", 3, where))
        frame = xyz.get("expressed_in", "") if xyz is not None else ""
        old = (element.findtext("use_parent_model_frame") or "").strip() in ("true", "1")
        if frame or old:
            R = np.eye(3) if old and not frame else self.world_pose(frame)[0]
            R = self.model_pose()[0] if frame in _MODEL and (frame or old) else R
            direction = R_joint.T @ R @ direction
        size = float(np.linalg.norm(direction))
        if not size > 0.0:
            raise ModelError(f"{self.file}: {where} is zero, expected a direction")
        values: list[float] = (direction / size).tolist()
        return values

    def dynamics(self, name: str, seat: _Seat, closing: bool = False) -> dict[str, float]:
        """Damping and spring of a joint of one axis.

        Limits, dry friction, and what acts in joints of several axes or that close a loop go into the report.
        """
        joint = self.joints[name]
        values: dict[str, float] = {}
        if seat.kind == "fixed":
            return values
        for axis in (*joint.findall("axis"), *joint.findall("axis2")):
            where = f"joint {name!r}"
            dynamics, limit = axis.find("dynamics"), axis.find("limit")
            if dynamics is not None:
                if damping := self.number(dynamics, "damping", 0.0, where):
                    values["damping"] = damping
                if stiffness := self.number(dynamics, "spring_stiffness", 0.0, where):
                    values |= {
                        "stiffness": stiffness,
                        "rest": self.number(dynamics, "spring_reference", 0.0, where),
                    }
                if self.number(dynamics, "friction", 0.0, where):
                    self.findings.leave_to_log(name, "dry friction", f"friction {name}")
            if limit is not None:
                low = self.number(limit, "lower", -1e16, where)
                high = self.number(limit, "upper", 1e16, where)
                if min(abs(low), abs(high)) < 1e15:
                    single = (low, high) if seat.kind in ("revolute", "prismatic") else None
                    self.findings.leave_to_log(name, "limits", f"limit {name}", single)
        if closing or seat.kind in ("ball", "universal"):
            which = "that closes a loop" if closing else "of several axes"
            for key, what in (("damping", "damper"), ("stiffness", "spring")):
                if key in values:
                    text = f"{what} of a joint {which}"
                    self.findings.leave_to_log(name, text, f"{what} {name}")
            return {}
        return values

    def mimics(self, joints: Sequence[Joint]) -> Iterator[Holonomic]:
        """Joints that follow others, q = multiplier (q_leader − reference) + offset, as exact constraints.

        Those of joints with several axes go into the report.
        """
        single = {joint.name for joint in joints if len(joint.speeds) == 1}
        for name, joint in self.joints.items():
            for axis in (*joint.findall("axis"), *joint.findall("axis2")):
                mimic = axis.find("mimic")
                if mimic is None:
                    continue
                leader = mimic.get("joint", "")
                if leader not in self.joints or leader == name:
                    raise ModelError(
                        f"{self.file}: joint {name!r} follows {shown(leader)}, which is not another joint"
                        f"{closest(leader, [n for n in self.joints if n != name])}"
                    )
                if name not in single or leader not in single:
                    self.findings.leave_to_log(name, "mimic joint", f"constraint {name}")
                    continue
                where = f"joint {name!r}: mimic"
                ratio, offset, reference = (
                    self.number(mimic, tag, default, where)
                    for tag, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
                )
                self.followers[name] = (leader, ratio, offset - ratio * reference)
                yield gear(f"{name}_mimic", name, leader, ratio, offset - ratio * reference)

    def left_out(self) -> None:
        """What else does work: contacts and plugins."""
        colliding = [n for n, link in self.links.items() if link.find("collision") is not None]
        if colliding:
            self.findings.leave_to_log(
                "collisions", f"contact of {len(colliding)} links", "contact <link1>:<link2>"
            )
        for plugin in self.model.iter("plugin"):
            name = plugin.get("name") or plugin.get("filename") or "plugin"
            self.findings.leave_to_log(name, "plugin", "applied <plugin>")

    def start(self, joints: list[Joint]) -> dict[str, float]:
        """The model's own pose: of links that float, and of joints that follow others."""
        values: dict[str, float] = {}
        for joint in joints:
            if joint.kind == "free":
                R, p = self.world_pose(joint.name)
                values |= {f"{joint.name}.{axis}": float(x) for axis, x in zip("xyz", p)}
                values |= {
                    f"{joint.name}.q{part}": x
                    for part, x in zip("wxyz", rotations.quaternion(R).tolist())
                }
        for name in self.followers:
            values[name] = self.following(name)
        return values

    def following(self, name: str, path: tuple[str, ...] = ()) -> float:
        """The coordinate of a joint where those that it follows are at zero."""
        if name in path:
            raise ModelError(f"{self.file}: joints {', '.join(path)} follow each other")
        if name not in self.followers:
            return 0.0
        leader, ratio, phase = self.followers[name]
        return ratio * self.following(leader, (*path, name)) + phase

    # -- poses ------------------------------------------------------------------------------------

    def model_pose(self) -> Pose:
        return self.pose(self.model, "model")

    def world_pose(self, name: str, path: tuple[str, ...] = ()) -> Pose:
        """Where a link, joint or frame is in the world."""
        if name in self.poses:
            return self.poses[name]
        if name in _WORLD:
            return np.eye(3), np.zeros(3)
        if name in _MODEL:
            return self.model_pose()
        if name in path:
            raise ModelError(f"{self.file}: the poses of {', '.join(path)} refer to each other")
        kinds = {"link": self.links, "joint": self.joints, "frame": self.frames}
        kind = next((tag for tag, names in kinds.items() if name in names), None)
        if kind is None:
            names = [n for group in kinds.values() for n in group]
            raise ModelError(f"{self.file}: unknown frame {shown(name)}{closest(name, names)}")
        element = kinds[kind][name]
        pose = element.find("pose")
        default = {
            "link": "__model__",
            "joint": (element.findtext("child") or "").strip(),
            "frame": element.get("attached_to", "__model__"),
        }[kind]
        base = pose.get("relative_to") or default if pose is not None else default
        R, p = self.world_pose(base, (*path, name))
        turned, moved = self.pose(element, name)
        self.poses[name] = R @ turned, p + R @ moved
        return self.poses[name]

    def pose(self, element: Element, where: str) -> Pose:
        """The pose that an element tells: x y z and roll, pitch, yaw, or a quaternion."""
        pose = element.find("pose")
        if pose is None or not (pose.text or "").strip():
            return np.eye(3), np.zeros(3)
        if pose.get("rotation_format") == "quat_xyzw":
            x, y, z, *quaternion = self.numbers(pose.text, 7, where)
            return rotations.matrices(np.roll(quaternion, 1)), np.array([x, y, z])
        x, y, z, *angles = self.numbers(pose.text, 6, where)
        if pose.get("degrees") in ("true", "1"):
            angles = [float(np.deg2rad(angle)) for angle in angles]
        roll, pitch, yaw = angles
        return rotations.roll_pitch_yaw(roll, pitch, yaw), np.array([x, y, z])

    def number(self, element: Element, tag: str, default: float, where: str) -> float:
        text = element.findtext(tag)
        return default if text is None else self.numbers(text, 1, f"{where}: {tag}")[0]

    def numbers(self, text: str | None, count: int, where: str) -> list[float]:
        """So many finite numbers; InputError for anything else."""
        try:
            values = [float(word) for word in (text or "").split()]
        except ValueError:
            values = []
        if len(values) != count or not np.isfinite(values).all():
            raise ModelError(
                f"{self.file}: {where} is {shown(text)}, expected {count} finite numbers"
            )
        return values
