"""What a log does not tell apart is told as a set, and slips of hand-written equations by their name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import deltac as dc

pytestmark = pytest.mark.case_study("test_a_mass_and_a_damper_of_a_pendulum_are_one_of_two")

G = 9.81


def pendulum(**changes: float) -> dc.Mechanism:
    """A point mass on a rod with a damper."""
    p = {"mass": 1.0, "damping": 0.1} | changes
    return dc.Mechanism(
        bodies=[dc.point_mass("bob", p["mass"], at=(0, -1.0, 0))],
        joints=[dc.revolute("pivot", "ground", "bob")],
        forces=[dc.forces.joint_damper("drag", "pivot", p["damping"])],
        gravity=(0, -G, 0),
    )


def logged(model: dc.Mechanism, **start: float) -> dc.Trajectory:
    """A run as another program would write it: without the works and forces of the model."""
    run = dc.simulate(model, model.state(start), duration=2.0, step=2e-3, solver="rk4")
    return replace(run, forces={}, works={}, integrals={}, provenance=dc.Provenance("other"))


def test_a_mass_and_a_damper_of_a_pendulum_are_one_of_two() -> None:
    """m l² α + m g l sin q + d ω = 0 tells d/m alone."""
    run = logged(pendulum(mass=1.25), pivot=1.0)
    first = dc.audit(pendulum(), run).findings[0]
    told = {(first.kind, first.element), *first.equals}
    assert {"body-mass", "damping"} <= {kind for kind, _ in told}
    assert first.what.startswith("one of these: ")


def test_beside_a_spring_that_is_known_the_damper_is_told() -> None:
    spring = dc.forces.joint_spring("spring", "pivot", 3.0)
    sprung = [
        replace(model, forces=(*model.forces, spring))
        for model in (pendulum(), pendulum(damping=0.2))
    ]
    first = dc.audit(sprung[0], logged(sprung[1], pivot=1.0)).findings[0]
    assert (first.kind, first.equals) == ("damping", ())
    assert first.factor == pytest.approx(0.2, rel=1e-4)


def test_gyroscopic_terms_that_are_missing_have_a_name() -> None:
    """ω is constant without a moment in the equations of whoever forgot ω × Jω."""
    body = dc.body("top", 1.0, inertia=(0.1, 0.2, 0.25))
    model = dc.Mechanism(bodies=[body], joints=[dc.free("root", "top")])
    t = np.linspace(0.0, 2.0, 401)
    w = np.array([0.7, -1.1, 0.9])
    half = 0.5 * np.linalg.norm(w) * t[:, None]
    turned = [np.cos(half), w / np.linalg.norm(w) * np.sin(half)]
    q = {f"root.{c}": x for c, x in zip(("qw", "qx", "qy", "qz"), np.hstack(turned).T)}
    u = {f"root.w{c}": x for c, x in zip("xyz", w)}
    run = dc.Trajectory(
        t=t,
        q=np.column_stack([q.get(n, np.zeros_like(t)) for n in model.coordinates.names]),
        u=np.column_stack([np.full_like(t, u.get(n, 0.0)) for n in model.speeds.names]),
        udot=np.zeros((len(t), 6)),
        coordinates=model.coordinates.names,
        speeds=model.speeds.names,
        provenance=dc.Provenance("by hand"),
    )
    first = dc.audit(model, run).findings[0]
    assert (first.kind, first.element) == ("gyroscopic-terms", "top")
    assert first.factor == pytest.approx(0.0, abs=1e-6)


def test_gyroscopic_terms_that_no_body_has_are_one_mistake() -> None:
    """Of a rotor in gimbals: Σ Aᵀ J ω̇ = 0, A the partial angular velocities, where ω × Jω was forgotten."""
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    moments = np.array([[0.03, 0.02, 0.04], [0.01, 0.02, 0.015], [0.008, 0.012, 0.01]])
    names = ("outer", "inner", "rotor")

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        R, w, bias, M, f = np.eye(3), np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
        A = np.zeros((3, 3))
        for k, axis in enumerate(axes):
            A[:, k] = R @ axis
            bias = bias + np.cross(w, A[:, k] * y[3 + k])
            w = w + A[:, k] * y[3 + k]
            R = R @ Rotation.from_rotvec(axis * y[k]).as_matrix()
            J = R @ np.diag(moments[k]) @ R.T
            own = A * (np.arange(3) <= k)
            M, f = M + own.T @ J @ own, f - own.T @ J @ bias
        return np.concatenate([y[3:], np.linalg.solve(M, f)])

    t = np.linspace(0.0, 2.0, 401)
    start = [0.2, 0.3, 0.0, 0.4, -0.2, 30.0]
    rows = solve_ivp(rate, (0.0, 2.0), start, "DOP853", t, rtol=1e-12, atol=1e-12).y.T
    parents = ("ground", "outer", "inner")
    model = dc.Mechanism(
        bodies=[dc.body(n, 1.0, inertia=tuple(J)) for n, J in zip(names, moments)],
        joints=[
            dc.revolute(f"of {n}", p, n, axis=tuple(axis))
            for n, p, axis in zip(names, parents, axes)
        ],
    )  # fmt: skip
    run = dc.Trajectory(
        t=t, q=rows[:, :3], u=rows[:, 3:], coordinates=model.coordinates.names,
        speeds=model.speeds.names, provenance=dc.Provenance("by hand"),
    )  # fmt: skip
    first = dc.audit(model, run).findings[0]
    assert (first.kind, first.element) == ("gyroscopic-terms", "all bodies")
    assert first.factor == pytest.approx(0.0, abs=1e-6)
