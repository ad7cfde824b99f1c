"""Machines written once and handed to every simulator in its own format."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import deltac as dc

Array: TypeAlias = NDArray[np.float64]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Link:
    """A body with the joint that carries it; `offset` places the joint in the parent, SI units."""

    name: str
    parent: int
    kind: str
    axis: str
    offset: tuple[float, float, float]
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]
    damping: float = 0.0
    armature: float = 0.0
    stiffness: float = 0.0

    @property
    def joint(self) -> str:
        return f"j_{self.name}"


@dataclass(frozen=True)
class Machine:
    """A tree of hinges and sliders with a torque on each joint of `motors`."""

    name: str
    links: tuple[Link, ...]
    motors: tuple[int, ...]
    gravity: float = 9.81

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(link.joint for link in self.links)

    def mechanism(self) -> dc.Mechanism:
        """The model that logs are judged against."""
        bodies, joints = [], []
        for link in self.links:
            bodies.append(
                dc.body(link.name, mass=link.mass, inertia=link.inertia, mass_centre=link.centre)
            )
            parent = "ground" if link.parent < 0 else self.links[link.parent].name
            made = dc.revolute if link.kind == "revolute" else dc.prismatic
            options: dict[str, Any] = {"position": link.offset}
            if link.damping:
                options["damping"] = link.damping
            if link.stiffness:
                options["stiffness"] = link.stiffness
            if link.armature:
                options["armature"] = link.armature
            joints.append(made(link.joint, parent, link.name, link.axis, **options))
        motors = [dc.forces.joint_torque(f"m{k}", self.links[k].joint) for k in self.motors]
        return dc.Mechanism(
            bodies=bodies, joints=joints, forces=motors, gravity=(0, 0, -self.gravity),
            name=self.name,
        )  # fmt: skip

    def mjcf(self, step: float, integrator: str = "Euler") -> str:
        """The machine as MuJoCo reads it."""

        def body(k: int) -> str:
            link = self.links[k]
            kind = "hinge" if link.kind == "revolute" else "slide"
            inside = "".join(body(j) for j, other in enumerate(self.links) if other.parent == k)
            return (
                f'<body name="{link.name}" pos="{_text(link.offset)}">'
                f'<inertial pos="{_text(link.centre)}" mass="{link.mass!r}" '
                f'diaginertia="{_text(link.inertia)}"/>'
                f'<joint name="{link.joint}" type="{kind}" axis="{_text(AXES[link.axis])}" '
                f'damping="{link.damping!r}" armature="{link.armature!r}" '
                f'stiffness="{link.stiffness!r}"/>{inside}</body>'
            )

        roots = "".join(body(k) for k, link in enumerate(self.links) if link.parent < 0)
        motors = "".join(f'<motor joint="{self.links[k].joint}"/>' for k in self.motors)
        return (
            f'<mujoco model="{self.name}"><compiler autolimits="true"/>'
            f'<option timestep="{step!r}" integrator="{integrator}" gravity="0 0 {-self.gravity!r}"/>'
            f"<worldbody>{roots}</worldbody><actuator>{motors}</actuator></mujoco>"
        )

    def urdf(self) -> str:
        """The machine as Bullet and Drake read it; without springs."""
        parts = ['<link name="base"/>']
        for link in self.links:
            ixx, iyy, izz = link.inertia
            parent = "base" if link.parent < 0 else self.links[link.parent].name
            kind = "continuous" if link.kind == "revolute" else "prismatic"
            limit = '<limit lower="-1e3" upper="1e3" effort="1e9" velocity="1e9"/>'
            parts.append(
                f'<link name="{link.name}"><inertial><origin xyz="{_text(link.centre)}"/>'
                f'<mass value="{link.mass!r}"/><inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" '
                f'ixy="0" ixz="0" iyz="0"/></inertial></link>'
                f'<joint name="{link.joint}" type="{kind}"><parent link="{parent}"/>'
                f'<child link="{link.name}"/><origin xyz="{_text(link.offset)}"/>'
                f'<axis xyz="{_text(AXES[link.axis])}"/>'
                f'<dynamics damping="{link.damping!r}" friction="0"/>'
                f"{limit if kind == 'prismatic' else ''}</joint>"
            )
        moved = "".join(
            f'<transmission name="t{k}"><type>transmission_interface/SimpleTransmission</type>'
            f'<joint name="{self.links[k].joint}"><hardwareInterface>EffortJointInterface'
            f'</hardwareInterface></joint><actuator name="m{k}"/></transmission>'
            for k in self.motors
        )
        return f'<?xml version="1.0"?><robot name="{self.name}">{"".join(parts)}{moved}</robot>'

    def with_link(self, k: int, **changes: Any) -> Machine:
        links = list(self.links)
        links[k] = replace(links[k], **changes)
        return replace(self, links=tuple(links))


def _text(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)


def draw(rng: np.random.Generator, *, light: bool = False) -> Machine:
    """A machine of one of six families, with numbers of its own."""

    def rod(
        name: str, parent: int, axis: str, offset: tuple[float, float, float], length: float,
        mass: float, **more: float,
    ) -> Link:  # fmt: skip
        across, along = mass * length**2 / 12 + 1e-4 * mass, 2e-3 * mass * length
        centre = (length / 2, 0.0, 0.0)
        inertia = (along, across, across)
        return Link(name, parent, "revolute", axis, offset, mass, centre, inertia, **more)

    def size(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    family = str(
        rng.choice(["pendulum", "double", "cart-pole", "arm", "spring-slider", "branched"])
    )
    damp = float(rng.choice([0.0, 0.02, 0.1])) * (0.1 if light else 1.0)
    scale = size(0.2, 3.0)
    if family == "pendulum":
        links = [rod("rod", -1, "y", (0, 0, 0), size(0.3, 1.2), scale, damping=damp)]
    elif family == "double":
        a = size(0.3, 1.0)
        links = [
            rod("upper", -1, "y", (0, 0, 0), a, scale, damping=damp),
            rod("lower", 0, "y", (a, 0, 0), size(0.3, 1.0), scale * size(0.3, 1.5), damping=damp),
        ]
    elif family == "cart-pole":
        cart = Link(
            "cart", -1, "prismatic", "x", (0, 0, 0), 2 * scale, (0, 0, 0), (0.01,) * 3, 5 * damp
        )
        links = [
            cart,
            rod("pole", 0, "y", (0, 0, 0), size(0.3, 1.0), scale * 0.3, damping=0.1 * damp),
        ]
    elif family == "spring-slider":
        block = Link(
            "block", -1, "prismatic", "z", (0, 0, 0), scale, (0, 0, 0), (0.01,) * 3, damp,
            0.0, size(10.0, 200.0),
        )  # fmt: skip
        links = [
            block,
            rod("bob", 0, "y", (0, 0, 0), size(0.2, 0.6), scale * 0.5, damping=damp * 0.2),
        ]
    elif family == "arm":
        a, b = size(0.2, 0.5), size(0.2, 0.5)
        base = Link(
            "base", -1, "revolute", "z", (0, 0, 0.1), scale, (0, 0, 0.05), (0.01,) * 3, damp
        )
        links = [
            base,
            rod(
                "upper", 0, "y", (0.05, 0, 0.1), a, 0.8 * scale, damping=damp, armature=0.01 * scale
            ),
            rod("fore", 1, "y", (a, 0, 0), b, 0.5 * scale, damping=damp),
            rod("hand", 2, "x", (b, 0, 0), 0.15, 0.2 * scale, damping=0.02 * damp),
        ]
        links[3] = replace(links[3], centre=(0.05, 0.02, 0.01))
    else:
        trunk = Link(
            "trunk", -1, "revolute", "z", (0, 0, 0), scale, (0.02, 0, 0.1), (0.02,) * 3, damp
        )
        links = [
            trunk,
            rod("left", 0, "y", (0, 0.1, 0.2), size(0.2, 0.5), 0.4 * scale, damping=damp),
            rod("right", 0, "x", (0, -0.1, 0.2), size(0.2, 0.5), 0.5 * scale, damping=damp),
        ]
        links[2] = replace(links[2], centre=(0, -0.15, 0), inertia=(0.012, 0.002, 0.012))
    n = len(links)
    motors = tuple(sorted(rng.choice(n, int(rng.integers(0, n + 1)), replace=False).tolist()))
    gravity = float(rng.choice([9.81, 9.81, 9.80665, 1.62]))
    return Machine(family, tuple(links), motors, gravity)
