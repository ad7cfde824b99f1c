"""Random mechanisms and motions for tests, as Hypothesis strategies that shrink in structure.

Structure (how many bodies, which joints, what forces) is drawn; numbers come from a generator with a
drawn seed. `Options` narrow what may occur, for oracles that know fewer joints or forces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy
from numpy.typing import NDArray

from deltac.dynamics.system import System
from deltac.mechanism.bodies import Body, body, box, disc, frame, point_mass, rod, sphere
from deltac.mechanism.joints import (
    JOINT_KINDS,
    Joint,
    cylindrical,
    fixed,
    free,
    planar,
    prismatic,
    revolute,
    screw,
    spherical,
    universal,
)
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND
from tests.oracles.textbook.kinematics import prescribed
from tests.oracles.textbook.tree import Textbook
from tests.systems.random_forces import drawn_forces
from tests.systems.random_geometry import random_direction, random_rotation

Array = NDArray[Any]

SIMPLE = ("revolute", "prismatic", "screw")
"""Joints of one degree of freedom: those that a massless frame or a point mass may hang on."""

PRESCRIBABLE = (*SIMPLE, "cylindrical", "universal", "planar")

MAKERS: dict[str, Callable[..., Joint]] = {
    "fixed": fixed,
    "revolute": revolute,
    "prismatic": prismatic,
    "screw": screw,
    "cylindrical": cylindrical,
    "universal": universal,
    "planar": planar,
    "spherical": spherical,
    "free": lambda name, parent, child, **options: free(name, child, parent, **options),
}


@dataclass(frozen=True)
class Options:
    """What random mechanisms may hold."""

    joints: tuple[str, ...] = tuple(MAKERS)
    first: str | None = None  # the first joint, which stands on the ground
    bodies: int = 6
    prescribed: bool = True
    one_prescribed: bool = False
    forces: bool = True
    time_in_potentials: bool = True
    armature: bool = True
    armature_on_quaternions: bool = True
    massless: bool = True
    thin: bool = True
    child_placement: bool = True


@dataclass(frozen=True, eq=False)
class Sample:
    """A mechanism at a random state: full q, u and accelerations that are not those of its motion.

    The accelerations of prescribed joints are those of their laws.
    """

    mechanism: Mechanism
    t: float
    q: Array
    u: Array
    udot: Array

    def evaluate(self, system: System, *expressions: Any, udot: Array | None = None) -> list[Array]:
        """Values of CasADi expressions of the system's symbols; `udot` replaces the accelerations."""
        free = self.mechanism.free
        udot = (self.udot if udot is None else udot)[free.u]
        inputs = np.zeros(system.inputs.shape[0])
        function = ca.Function(
            "f",
            [system.t, system.q, system.u, system.udot, system.inputs],
            [ca.densify(ca.SX(e)) for e in expressions],
        )
        values = function.call([self.t, self.q[free.q], self.u[free.u], udot, inputs])
        return [np.array(value) for value in values]

    def __repr__(self) -> str:
        joints = ", ".join(
            f"{j.parent}-{j.kind}{'*' if j.prescribed else ''}-{j.child}"
            for j in self.mechanism.joints
        )
        elements = ", ".join(type(element).__name__ for element in self.mechanism.elements)
        return f"Sample({joints}; {elements}; t={self.t}, q={self.q}, u={self.u})"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(repr(self))

    @property
    def book(self) -> Textbook:
        """The textbook's matrices at this state."""
        return Textbook(self.mechanism, self.t, self.q, self.u)


def assert_close(found: Any, expected: Any, tolerance: float = 1e-12, scale: float = 1.0) -> None:
    """Relative to the largest entry expected, or to `scale`, the size of the terms that cancel."""
    expected = np.asarray(expected, dtype=float)
    found = np.asarray(found, dtype=float).reshape(expected.shape)
    if expected.size:
        bound = tolerance * max(scale, largest(expected))
        np.testing.assert_allclose(found, expected, rtol=0, atol=bound)


def largest(values: Any) -> float:
    """The largest absolute entry, zero where there is none."""
    return float(np.abs(values).max(initial=0.0))


def scalar(value: Any) -> float:
    """A 1 by 1 array as a float."""
    return float(np.asarray(value).item())


def samples(options: Options = Options()) -> SearchStrategy[Sample]:
    """Random mechanisms at random states."""
    return st.composite(_sample)(options)


def _sample(draw: DrawFn, options: Options) -> Sample:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="seed"))
    count = draw(st.integers(1, options.bodies), label="bodies")
    parents = [draw(st.integers(-1, k - 1), label=f"parent {k}") for k in range(count)]
    joints = tree_joints(draw, rng, parents, options)
    parameters = {"m_p": 1.7, "l_p": 0.4, "k_p": 3.0, "w_p": 1.3}
    bodies = _bodies(draw, rng, parents, joints, options)
    mechanism = Mechanism(bodies, joints, gravity=rng.normal(0, 5, 3), parameters=parameters)
    if options.forces:
        mechanism = replace(
            mechanism, forces=drawn_forces(draw, rng, mechanism, options.time_in_potentials)
        )
    return random_state(mechanism, rng)


def random_state(mechanism: Mechanism, rng: np.random.Generator) -> Sample:
    """A random state of a mechanism, prescribed joints on their laws."""
    t = float(rng.uniform(0, 2))
    q = rng.uniform(-1.2, 1.2, len(mechanism.coordinates))
    for joint in mechanism.joints:
        quaternion = JOINT_KINDS[joint.kind].quaternion
        if quaternion is not None:
            start = mechanism.coordinates.of(joint.name).start + quaternion
            turned = rng.normal(size=4)
            q[start : start + 4] = turned / np.linalg.norm(turned)
    u = rng.normal(0, 1, len(mechanism.speeds))
    free_q = {mechanism.coordinates[i].name: q[i] for i in mechanism.free.q}
    free_u = {mechanism.speeds[i].name: u[i] for i in mechanism.free.u}
    state = mechanism.state(free_q, free_u, t)
    udot = rng.normal(0, 2, len(u))
    driven = [entry.index for entry in mechanism.speeds if entry.prescribed]
    udot[driven] = prescribed(mechanism, t)[2][driven]
    return Sample(mechanism, t, state.q.copy(), state.u.copy(), udot)


def name_of(k: int) -> str:
    """The name of body k."""
    return GROUND if k < 0 else f"b{k}"


def tree_joints(
    draw: DrawFn, rng: np.random.Generator, parents: Sequence[int], options: Options
) -> list[Joint]:
    kinds = [draw(st.sampled_from(options.joints), label=f"joint {k}") for k in range(len(parents))]
    if options.first is not None:
        kinds[0] = options.first
    chosen = -1
    if options.one_prescribed:
        chosen = draw(st.integers(0, len(parents) - 1), label="prescribed")
        kinds[chosen] = draw(st.sampled_from(PRESCRIBABLE), label="its joint")
    made: list[Joint] = []
    for k, (parent, kind) in enumerate(zip(parents, kinds, strict=True)):
        given: dict[str, Any] = {
            "position": [float(rng.normal(0, 0.5)), "l_p/2", float(rng.normal(0, 0.5))],
        }
        if rng.random() < 0.6:
            given["rotation"] = random_rotation(rng)
        if options.child_placement and kind != "free" and rng.random() < 0.6:
            given["child_position"] = rng.normal(0, 0.5, 3)
            if kind != "spherical":
                given["child_rotation"] = random_rotation(rng)
        match kind:
            case "revolute" | "prismatic" | "cylindrical":
                given["axis"] = random_direction(rng)
            case "screw":
                given.update(axis=random_direction(rng), pitch=float(rng.normal()))
            case "universal":
                given.update(first=random_direction(rng), second=tuple(rng.normal(size=3)))
        shape = JOINT_KINDS[kind]
        may_be_driven = options.prescribed and kind in PRESCRIBABLE
        drawn = may_be_driven and draw(st.integers(0, 3), label=f"driven {k}") == 0
        if shape.speeds and (k == chosen or (drawn and not options.one_prescribed)):
            given["motion"] = [
                f"{rng.normal():.3f} + {rng.normal():.3f}*sin(w_p*t + {rng.normal():.3f})"
                f" + {rng.normal():.3f}*t**2"
                for _ in shape.coordinates
            ]
        may_have_rotors = shape.rates or options.armature_on_quaternions
        if options.armature and shape.speeds and may_have_rotors and rng.random() < 0.3:
            given["armature"] = [float(a) for a in rng.uniform(0, 0.5, len(shape.speeds))]
        if options.forces and shape.speeds and rng.random() < 0.3:
            springs = len(shape.coordinates) - (0 if shape.rates else 3)
            given["stiffness"] = [float(a) for a in rng.uniform(0, 5, springs)]
            if shape.rates:
                given["rest"] = [float(a) for a in rng.normal(size=springs)]
        if options.forces and shape.speeds and rng.random() < 0.3:
            given["damping"] = ["0.1*k_p", *rng.uniform(0, 1, 5)][: len(shape.speeds)]
        made.append(MAKERS[kind](f"j{k}", name_of(parent), name_of(k), **given))
    return made


def _bodies(
    draw: DrawFn,
    rng: np.random.Generator,
    parents: Sequence[int],
    joints: Sequence[Joint],
    options: Options,
) -> list[Body]:
    """Solid bodies; thin ones and massless frames only where no speed is left without inertia."""
    made: list[Body] = []
    massless = False
    for k, joint in enumerate(joints):
        below = [joints[i].kind for i, parent in enumerate(parents) if parent == k]
        carries = bool(below) and all(kind in SIMPLE for kind in below)
        fits = options.massless and joint.kind in (*SIMPLE, "fixed") and carries and not massless
        thin = options.thin and joint.kind in SIMPLE
        shapes = ["body", "box", "sphere", "disc"]
        shapes += ["rod", "point"] if thin and not massless else []
        shapes += ["frame"] if fits else []
        shape = draw(st.sampled_from(shapes), label=f"shape {k}")
        made.append(_shape(rng, shape, name_of(k)))
        massless = massless or shape == "frame"
    return made


def _shape(rng: np.random.Generator, shape: str, name: str) -> Body:
    size, mass = rng.uniform(0.3, 1.2, 3), float(rng.uniform(0.5, 3))
    centre = rng.normal(0, 0.4, 3)
    match shape:
        case "frame":
            return frame(name)
        case "point":
            return point_mass(name, "m_p", centre)
        case "rod":
            return rod(name, mass, "l_p", along=tuple(rng.normal(size=3)), start=centre)
        case "box":
            return box(name, "2*m_p", size, centre)
        case "sphere":
            return sphere(name, mass, "l_p", centre)
        case "disc":
            return disc(name, mass, size[0], "y", size[1], centre)
    turned = np.array(random_rotation(rng))
    a, b, c = size
    inertia = turned @ np.diag([b + c, a + c, a + b]) @ turned.T  # any a, b, c > 0 can be a body
    return body(name, mass, ((inertia + inertia.T) / 2).tolist(), centre)
