"""Momentum balances: what no force touches is kept, what a force touches changes by its impulse."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc


def quaternion_to_matrix(q: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()


def test_a_body_in_free_flight() -> None:
    """Linear and angular momentum about the world's origin, both zero departures at exact motion."""
    inertia = np.array([1.0, 2.0, 2.5])
    mechanism = dc.Mechanism(
        [dc.body("box", 2.0, inertia.tolist(), [0.1, -0.2, 0.3])], [dc.free("base", "box")]
    )
    start = mechanism.state({"base.x": 1.0}, {"base": [1, 2, 3, 0.5, 3, -0.2]})
    run = dc.simulate(mechanism, start, 2.0, 0.005, "ode8")
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    names = [f"{kind} {axis} base" for kind in ("linear", "angular") for axis in "xyz"]
    assert set(ledger.momentum) == set(names)
    for name in names:
        assert np.abs(ledger.momentum[name]).max() < 1e-11, name
    # The motion really has the momenta: by Newton and Euler on the samples.
    R = quaternion_to_matrix(run.q[:, 3:])
    lever = R @ np.array([0.1, -0.2, 0.3])
    w = np.einsum("tij,tj->ti", R, run.u[:, 3:])
    v = run.u[:, :3] + np.cross(w, lever)
    p = 2.0 * v
    L = np.cross(run.q[:, :3] + lever, p) + np.einsum("tij,tj->ti", R, inertia * run.u[:, 3:])
    assert np.ptp(p, axis=0).max() < 1e-11
    assert np.ptp(L, axis=0).max() < 1e-10
    assert np.ptp(run.u[:, 3:], axis=0).min() > 0.1


def test_an_uneven_step_shows_in_the_momentum() -> None:
    mechanism = dc.Mechanism([dc.body("box", 2.0, [1, 2, 2.5])], [dc.free("base", "box")])
    start = mechanism.state(speeds={"base": [1, 2, 3, 0.5, 3, -0.2]})
    coarse = dc.balance(mechanism, dc.simulate(mechanism, start, 2.0, 0.02, "ode1"))
    assert max(np.abs(coarse.momentum[f"angular {a} base"]).max() for a in "xyz") > 1e-2
    assert max(np.abs(coarse.momentum[f"linear {a} base"]).max() for a in "xyz") < 1e-12


def test_gravity_gives_its_impulse() -> None:
    mechanism = dc.Mechanism(
        [dc.body("box", 2.0, [1, 2, 2.5])], [dc.free("base", "box")], gravity=[0, 0, -9.81]
    )
    start = mechanism.state(speeds={"base": [1, 0, 0, 0, 1, 0]})
    run = dc.simulate(mechanism, start, 1.0, 0.01, "ode4")
    ledger = dc.balance(mechanism, run)
    np.testing.assert_allclose(run.u[:, 2], -9.81 * run.t, atol=1e-12)
    assert np.abs(ledger.momentum["linear z base"]).max() < 1e-12
    bare = dc.Mechanism(mechanism.bodies, mechanism.joints)
    np.testing.assert_allclose(
        dc.balance(bare, run, "samples").momentum["linear z base"], -2 * 9.81 * run.t, atol=1e-11
    )


def test_the_heavy_top_keeps_its_momentum_about_the_vertical() -> None:
    mechanism = dc.Mechanism(
        [dc.body("top", 1.0, [0.1, 0.1, 0.02], [0, 0, 0.5])],
        [dc.joints.spherical("tip", "ground", "top")],
        gravity=[0, 0, -9.81],
    )
    tilt = [np.cos(0.3), np.sin(0.3), 0, 0]
    run = dc.simulate(
        mechanism, mechanism.state({"tip": tilt}, {"tip": [0, 0, 30]}), 1.0, 1e-3, "ode8"
    )
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    for axis in "xyz":
        bar = ledger.momentum_bar[f"angular {axis} tip"] + 1e-11
        assert (np.abs(ledger.momentum[f"angular {axis} tip"]) <= bar).all()
    R = quaternion_to_matrix(run.q)
    L = np.einsum("tij,tj->ti", R, np.array([0.35, 0.35, 0.02]) * run.u)
    assert np.ptp(L[:, 2]) < 1e-11
    assert np.ptp(L[:, 0]) > 0.1  # gravity turns it about the others


def test_a_planar_chain_in_space() -> None:
    """Two bars, joined and floating: linear momentum and the angular one about the origin."""
    mechanism = dc.Mechanism(
        [dc.rod("a", 1.0, 1.0), dc.rod("b", 2.0, 0.7)],
        [
            dc.joints.planar("base", "ground", "a"),
            dc.revolute("elbow", "a", "b", "z", position=[1, 0, 0], stiffness=3.0, damping=0.1),
        ],
    )
    start = mechanism.state({"elbow": 0.5}, {"base": [0.2, -0.1, 1.0], "elbow": -2.0})
    run = dc.simulate(mechanism, start, 2.0, 0.005, "ode8")
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    assert set(ledger.momentum) == {"linear x base", "linear y base", "angular z base"}
    for name, values in ledger.momentum.items():
        assert np.abs(values).max() < 1e-11, name
    q, u = run.q, run.u
    a, w = q[:, 2], u[:, 2]
    b, wb = a + q[:, 3], w + u[:, 3]
    elbow = u[:, :2] + w[:, None] * np.stack([-np.sin(a), np.cos(a)], 1)
    va = u[:, :2] + 0.5 * w[:, None] * np.stack([-np.sin(a), np.cos(a)], 1)
    vb = elbow + 0.35 * wb[:, None] * np.stack([-np.sin(b), np.cos(b)], 1)
    p = 1.0 * va + 2.0 * vb
    assert np.ptp(p, axis=0).max() < 1e-12
    assert np.ptp(u[:, 3]) > 0.1


def test_a_force_on_part_of_a_chain_gives_its_impulse_to_the_whole() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("a", 1.0, [1, 1, 1]), dc.bodies.box("b", 2.0, [1, 1, 1])],
        [dc.free("base", "a"), dc.revolute("elbow", "a", "b", "y", position=[1, 0, 0])],
        [dc.forces.point_force("jet", "b", [0.3, "sin(t)", 0], [0.2, 0.1, 0])],
    )
    run = dc.simulate(mechanism, mechanism.state(), 2.0, 0.005, "ode8")
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    for name, values in ledger.momentum.items():
        assert np.abs(values).max() < 1e-10, name
    bare = dc.Mechanism(mechanism.bodies, mechanism.joints)
    impulse = dc.balance(bare, run, "samples", ("wang",)).momentum
    np.testing.assert_allclose(impulse["linear x base"], 0.3 * run.t, atol=1e-10)
    np.testing.assert_allclose(impulse["linear y base"], 1 - np.cos(run.t), atol=1e-10)


def test_a_hinge_on_the_ground_has_its_axis() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("door", 3.0, [1, 0.1, 2], [0.5, 0, 0])],
        [dc.revolute("hinge", "ground", "door", "z", damping=0.4)],
    )
    run = dc.simulate(mechanism, mechanism.state(speeds={"hinge": 2.0}), 1.0, 0.01, "ode8")
    inertia = 3 * (1 + 0.01) / 12 + 3 * 0.25
    np.testing.assert_allclose(run.u[:, 0], 2 * np.exp(-0.4 / inertia * run.t), rtol=1e-12)
    ledger = dc.balance(mechanism, run)
    assert np.abs(ledger.momentum["angular hinge"]).max() == pytest.approx(0.0, abs=1e-11)
