"""The columns of the geometry against mechanisms that are really built with the changed number.

Without constraints a column is the derivative of the residual; with constraints it is M ∂u̇/∂θ, and u̇ follows
from the least-squares solution of the changed mechanism's equations. Places, turns and numbers are changed at
random, all of a part at once; differences of fourth order with steps of 3e-4 have errors of some 1e-9.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.causes.causes import candidates
from deltac.diagnosis.causes.columns import ColumnKernels, LogEquations, column_kernels
from deltac.diagnosis.causes.geometry import displacements, geometry_columns
from deltac.dynamics.equations_of_motion import equations_of_motion, quaternions
from tests.support.rate_forms import without_forces

INERTIA = ((0.05, 0.01, -0.004), (0.01, 0.08, 0.002), (-0.004, 0.002, 0.06))
STEP = 3e-4
Build = Callable[[float], dc.Mechanism]


def derivative(f: Callable[[float], Array], h: float = STEP) -> Array:
    return np.asarray((8.0 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12.0 * h))


def body(name: str, mass: float = 1.2) -> Any:
    return dc.body(name, mass, INERTIA, (0.2, 0.05, -0.1))


def tree() -> dc.Mechanism:
    """A floating base with joints of most kinds, oblique axes, a cord, a tendon and a contact."""
    rng = np.random.default_rng(1)

    def placed() -> dict[str, Any]:
        axes, angles = rng.standard_normal((2, 3)), rng.uniform(0.0, 3.0, 2)
        here, there = (dc.rotation_matrix(tuple(a), x) for a, x in zip(axes, angles))
        places = rng.uniform(-0.4, 0.4, (2, 3)).tolist()
        return {
            "position": places[0], "child_position": places[1], "rotation": here, "child_rotation": there
        }  # fmt: skip

    return dc.Mechanism(
        bodies=[body(name) for name in ("hull", "thigh", "shin", "foot", "arm", "hand")],
        joints=[
            dc.free("root", "hull"),
            dc.revolute("hip", "hull", "thigh", axis=(1, 2, 2), damping=0.1, **placed()),
            dc.prismatic("slide", "thigh", "shin", axis=(0, 1, 1), **placed()),
            dc.joints.screw("drill", "shin", "foot", pitch=0.3, **placed()),
            dc.joints.universal("shoulder", "hull", "arm", **placed()),
            dc.joints.spherical("wrist", "arm", "hand", position=(0.1, 0.2, 0.3)),
        ],
        forces=[
            dc.forces.spring_damper(
                "cord", "foot", "hand", point1=(0.1, 0, 0.2), stiffness=3.0, damping=0.4, length=0.3
            ),
            dc.forces.tendon(
                "tendon", [("ground", (0, 0, 1)), ("arm", (0.1, 0, 0)), ("foot", (0, 0.1, 0))],
                coordinates={"hip": 0.2}, stiffness=5.0, damping=0.2, length=0.7,
            ),
            dc.forces.contact(
                "floor", dc.shapes.sphere("hand", 2.0, (0, 0.1, 0)), dc.shapes.half_space(),
                stiffness=100.0, dissipation=0.3, friction=0.4,
            ),
            dc.forces.point_force("jet", "shin", force=("1.0", "2*sin(t)", "q.hip"), frame="body"),
        ],
        gravity=(1, 2, -9.81),
    )  # fmt: skip


def samples(mechanism: dc.Mechanism, count: int = 4) -> dc.Trajectory:
    rng = np.random.default_rng(5)
    q = rng.standard_normal((count, len(mechanism.coordinates)))
    for place in quaternions(mechanism):
        q[:, place] /= np.linalg.norm(q[:, place], axis=1, keepdims=True)
    u, udot = rng.standard_normal((2, count, len(mechanism.speeds)))
    return trajectory(mechanism, q, u, udot)


def trajectory(mechanism: dc.Mechanism, q: Array, u: Array, udot: Array) -> dc.Trajectory:
    return dc.Trajectory(
        t=np.arange(len(q), dtype=float) + 0.3, q=q, u=u, udot=udot, coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names, provenance=dc.Provenance("states"),
    )  # fmt: skip


def evaluated(
    mechanism: dc.Mechanism, run: dc.Trajectory
) -> tuple[LogEquations, ColumnKernels, Array]:
    equations = LogEquations(mechanism, run)
    kernels = geometry_columns(equations)
    return equations, kernels, kernels(*without_forces(mechanism, run))


def placed_anew(joint: Any, side: str, xi: Array) -> dict[str, Any]:
    """Fields of a joint displaced in its parent, or with its child displaced on it: places, then turns."""
    d, angle = xi[:3], float(np.linalg.norm(xi[3:]))
    turn = np.array(dc.rotation_matrix(tuple(xi[3:]), angle)) if angle else np.eye(3)
    if side == "joint-place":
        place = tuple(x + float(y) for x, y in zip(joint.position, d))
        return {"position": place, "rotation": (turn @ np.array(joint.rotation)).tolist()}
    # The joint's place in the child moves the other way.
    there = np.array(joint.child_position) - turn.T @ d
    made: dict[str, Any] = {"child_position": tuple(there)}
    if joint.kind != "spherical":  # whose child has no frame of its own
        made["child_rotation"] = (turn.T @ np.array(joint.child_rotation)).tolist()
    return made


Displacements = dict[str, tuple[str, Array]]
"""By joint: a side, and what the place there is displaced by, per unit."""


def displaced(mechanism: dc.Mechanism, all_of: Displacements, h: float) -> dc.Mechanism:
    """The mechanism with its joints displaced by h."""
    joints = [
        replace(j, **placed_anew(j, side, h * xi)) if xi is not None else j
        for j in mechanism.joints
        for side, xi in [all_of.get(j.name, ("", None))]
    ]
    return replace(mechanism, joints=joints)


def composed(
    outer: Callable[[Any], Array], inner: Callable[[float], Any]
) -> Callable[[float], Array]:
    """Outer of inner."""
    return lambda h: outer(inner(h))


def changes(mechanism: dc.Mechanism, equations: LogEquations, kernels: ColumnKernels) -> Any:
    """(what, the mechanism with h of it, coefficients of the columns): places of all joints; all numbers."""
    rng = np.random.default_rng(7)
    for place, side in enumerate(("joint-place", "body-place")):
        all_of, x = Displacements(), np.zeros(len(kernels.columns))
        for joint in mechanism.joints:
            D = displacements(equations.symbols.system, joint)[place]
            at = [
                (k, c.index)
                for k, c in enumerate(kernels.columns)
                if (c.what, c.element) == (side, joint.name)
            ]
            if not at:
                continue
            xi = rng.standard_normal(6)
            if side == "body-place" and joint.kind == "spherical":
                xi[3:] = 0.0
            for k, index in at:
                x[k] = (D @ xi)[index]
            all_of[joint.name] = side, xi
        yield f"{side} of {', '.join(all_of)}", partial(displaced, mechanism, all_of), x
    x = np.zeros(len(kernels.columns))
    for k, c in enumerate(kernels.columns):
        if c.what in ("number", "parameter") and c.element in mechanism.numbers:
            x[k] = rng.standard_normal()
    names = {c.element: x[k] for k, c in enumerate(kernels.columns) if x[k]}

    def other(h: float) -> dc.Mechanism:
        return mechanism.with_parameters(
            **{n: mechanism.numbers[n] + h * y for n, y in names.items()}
        )

    yield "numbers", other, x


def test_columns_of_a_tree_are_derivatives_of_its_residual() -> None:
    mechanism = tree()
    run = samples(mechanism)
    equations, kernels, X = evaluated(mechanism, run)

    def residual(m: dc.Mechanism) -> Array:
        motion = equations_of_motion(m)
        terms = [motion.terms(t, q, u) for t, q, u in zip(run.t, run.q, run.u)]
        return np.array([x.force - x.bias - x.M @ a for x, a in zip(terms, run.udot)])  # type: ignore[arg-type]

    np.testing.assert_allclose(X[..., 0], residual(mechanism), rtol=0, atol=1e-11)
    assert {c.element for c in kernels.columns} >= {
        *("hip", "slide", "drill", "shoulder", "wrist", "force.cord.length"),
    }
    for what, build, x in changes(mechanism, equations, kernels):
        expected = derivative(composed(residual, build))
        scale = max(float(np.abs(expected).max()), 1e-3)
        np.testing.assert_allclose(
            X[..., 1:] @ x, expected, rtol=0, atol=1e-6 * scale, err_msg=what
        )


def four_bar(rod: float = 1.0) -> dc.Mechanism:
    """A spatial four-bar of crank, rod and rocker."""
    return dc.Mechanism(
        bodies=[body("crank"), body("rod"), body("rocker")],
        joints=[
            dc.revolute("a", "ground", "crank", axis=(0, 1, 3)),
            dc.joints.universal("b", "crank", "rod", position=(0.4, 0, 0.1)),
            dc.revolute("c", "ground", "rocker", axis=(1, 2, 3), position=(1.1, 0.1, 0.2)),
        ],
        constraints=[
            dc.constraints.loop_spherical("loop", "rod", "rocker", point1=(rod, 0, 0), point2=(0.7, 0, 0.1))
        ],
        gravity=(0, -9.81, 0),
    )  # fmt: skip


def string(ratio: float = 1.7) -> dc.Mechanism:
    """A pendulum of two links on a string, geared; its lengths are parameters."""
    return dc.Mechanism(
        bodies=[body("upper"), body("lower"), body("tip")],
        joints=[
            dc.revolute("a", "ground", "upper", axis=(0, 1, 3)),
            dc.joints.universal("b", "upper", "lower", position=("l", 0, "l/3")),
            dc.joints.cylindrical("c", "lower", "tip", axis=(1, 2, 3), position=(0.1, 0.1, 0.2)),
        ],
        constraints=[
            dc.constraints.distance(
                "string", "ground", "tip", length=1.3, point1=(0, 1, 0), point2=(0.2, "r", 0)
            ),
            dc.constraints.gear("gear", "b.first", "c.angle", ratio, 0.1),
        ],
        forces=[
            dc.forces.spring_damper(
                "cord", "ground", "lower", point1=(0, 1, 0), stiffness=20, length="l+r"
            )
        ],
        parameters={"l": 0.5, "r": 0.3},
        gravity=(0, -9.81, 0),
    )  # fmt: skip


def wheel() -> dc.Mechanism:
    """A wheel that rolls on the ground, and a trailing skate."""
    return dc.Mechanism(
        bodies=[body("frame"), body("fork"), body("wheel"), body("skate")],
        joints=[
            dc.joints.planar("plane", "ground", "frame"),
            dc.joints.universal("lean", "frame", "fork", first="x", second="z"),
            dc.joints.cylindrical("axle", "fork", "wheel", axis="y"),
            dc.revolute("tail", "frame", "skate", position=(-1.0, 0, 0)),
        ],
        constraints=[
            dc.constraints.rolling("roll", "wheel", radius=0.5, tube=0.05, axis="y", point=(0, 0, -0.5)),
            dc.constraints.skate("blade", "skate", point=(-0.1, 0.2, 0.3), lateral=(0, 1, 0.1)),
        ],
        gravity=(0, 0, -9.81),
    )  # fmt: skip


def consistent(mechanism: dc.Mechanism, q0: Array) -> tuple[Array, Array]:
    """A state on the constraints near some coordinates."""
    motion, rng = equations_of_motion(mechanism), np.random.default_rng(2)

    def gap(q: Array) -> Array:
        return np.concatenate([motion.violation(0.3, q, 0 * q)[0], 1e-6 * (q - q0)])

    q = least_squares(gap, q0, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    w = rng.standard_normal(len(q0))
    G = motion.terms(0.3, q, w).G
    return q, w - np.linalg.pinv(G) @ motion.violation(0.3, q, w)[1]


@pytest.mark.parametrize(
    "mechanism, q0",
    [
        (four_bar(), (0.5, 0.3, 0.2, 1.2)),
        pytest.param(string(), (0.5, 0.3, 0.2, 0.5, 0.2), marks=pytest.mark.slow),
        (wheel(), (0.1, 0.2, 0.3, 0.4, 0.3, 0.1, 0.2, 0.5)),
    ],
    ids=["four-bar", "string", "wheel"],
)  # fmt: skip
def test_columns_with_constraints_are_derivatives_of_accelerations(
    mechanism: dc.Mechanism, q0: tuple[float, ...]
) -> None:
    q, u = consistent(mechanism, np.array(q0))

    def udot(m: dc.Mechanism) -> Array:
        motion = equations_of_motion(m)
        return motion.solved(motion.terms(0.3, q, u))[0]

    run = trajectory(mechanism, np.array([q, q]), np.array([u, u]), np.array([udot(mechanism)] * 2))
    equations, kernels, X = evaluated(mechanism, run)
    np.testing.assert_allclose(X[0, :, 0], 0.0, atol=1e-10)
    M = equations_of_motion(mechanism).terms(0.3, q, u).M
    for what, build, x in changes(mechanism, equations, kernels):
        expected = M @ derivative(composed(udot, build))
        scale = max(float(np.abs(expected).max()), 1e-3)
        np.testing.assert_allclose(
            X[0, :, 1:] @ x, expected, rtol=0, atol=1e-6 * scale, err_msg=what
        )
    for k, c in enumerate(kernels.columns):
        if (
            c.element == "constraint.gear.law.1"
        ):  # the ratio; the phase is smaller, and so comes first
            expected = M @ derivative(lambda h: udot(string(1.7 + h)))
            np.testing.assert_allclose(X[0, :, 1 + k], expected, rtol=1e-6)
            break
    else:
        assert mechanism.constraints[-1].name != "gear"


def test_a_planar_machine_has_the_columns_of_its_plane() -> None:
    """Of a hinge across a plane: two places, no tilts; a bar's length is the next joint's place along it."""
    mechanism = dc.Mechanism(
        bodies=[dc.rod(name, 1.0, 0.8) for name in ("upper", "lower")],
        joints=[
            dc.revolute("shoulder", "ground", "upper"),
            dc.revolute("elbow", "upper", "lower", position=(0.8, 0, 0)),
        ],
        gravity=(0, -9.81, 0),
    )
    equations, kernels, _ = evaluated(mechanism, samples(mechanism))
    found = {(c.kind, c.element, c.names) for c in candidates(equations, kernels.columns)}
    assert ("link-length", "upper", ("length",)) in found
    assert ("joint-position", "elbow", ("y",)) in found
    assert ("joint-position", "elbow", ("x",)) not in found
    assert not any(kind == "joint-position" and element == "shoulder" for kind, element, _ in found)


def test_without_columns_of_the_geometry_there_are_no_causes_of_it() -> None:
    mechanism = tree()
    equations = LogEquations(mechanism, samples(mechanism))
    columns = column_kernels(equations).columns
    kinds = {c.kind for c in candidates(equations, columns)}
    more = {c.kind for c in candidates(equations, columns + geometry_columns(equations).columns)}
    assert more - kinds == {
        *(
            "body-size",
            "link-length",
            "joint-axis",
            "joint-position",
            "joint-pivot",
            "body-position",
        ),
        *("joint-orientation", "body-orientation", "element-length", "attachment", "contact-size"),
        *("contact-position", "law-number"),
    }


PLACES = [
    ((0.6, 0.01), "joint-position", "elbow", 0.01),
    ((0.606, 0.0), "link-length", "upper", 0.606),
]


@pytest.mark.slow  # without noise: tests/diagnosis/test_sizes_of_geometry.py
@pytest.mark.parametrize("wrong", PLACES)
@pytest.mark.parametrize("noise", (0.0, 1e-4))
def test_an_audit_names_a_place_that_is_wrong(
    wrong: tuple[tuple[float, float], str, str, float], noise: float
) -> None:
    """Without accelerations; masses, forces and centres alone would need three causes, all of them wrong."""
    place, kind, element, size = wrong

    def arm(x: float, y: float) -> dc.Mechanism:
        return dc.Mechanism(
            bodies=[dc.rod(name, 1.0, 0.8) for name in ("upper", "lower")],
            joints=[
                dc.revolute("shoulder", "ground", "upper", damping=0.02),
                dc.revolute("elbow", "upper", "lower", position=(x, y, 0), damping=0.01),
            ],
            gravity=(0, -9.81, 0),
        )

    start = arm(*place).state({"shoulder": 1.0, "elbow": 0.5}, {"shoulder": 2.0})
    run = dc.simulate(arm(*place), start, 2.0, 2e-3, "ode4")
    rng = np.random.default_rng(0)
    q, u = (x + noise * rng.standard_normal(x.shape) for x in (run.q, run.u))
    log = dc.Trajectory(t=run.t, q=q, u=u, coordinates=run.coordinates, speeds=run.speeds)
    audit = dc.audit(arm(0.6, 0.0), log)
    assert audit.verdict.kind == "equation-error"
    (cause,) = audit.causes
    assert (cause.kind, cause.element) == (kind, element)
    assert cause.values[-1] == pytest.approx(size, rel=0.01 if kind == "joint-position" else 1e-4)
