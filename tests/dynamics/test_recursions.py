"""The recursions against the textbook's dense matrices, which share no line with them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given

from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.recursions import accelerations, crba, rnea, velocities
from deltac.dynamics.system import trace
from deltac.dynamics.terms import (
    Reactions,
    channel_powers,
    driving_forces,
    forward,
    reaction_powers,
    terms,
)
from deltac.mechanism.bodies import body, rod
from deltac.mechanism.joints import fixed, prismatic, revolute
from deltac.mechanism.mechanism import Mechanism
from tests.systems.random_mechanisms import Sample, assert_close, largest, samples, scalar


@given(samples())
def test_kinematics(sample: Sample) -> None:
    system, book = trace(sample.mechanism), sample.book
    V = velocities(system, system.u_all)
    A = accelerations(system, V, system.udot_all)
    V_t = velocities(system, ca.SX(ca.DM(book.u_t)))
    at_bodies = []
    for k, link in enumerate(system.links):
        to_centre = link.to_body.E, link.centre
        for motion in (V[k], V_t[k], A[k]):
            w, v = motion[:3], motion[3:]
            v_centre = v + ca.cross(w, to_centre[1])
            at_bodies.append(
                ca.vertcat(ca.mtimes(system.poses[k].E.T, v_centre), ca.mtimes(to_centre[0], w))
            )
    values = [value[:, 0] for value in sample.evaluate(system, *at_bodies)]
    q_dot = sample.evaluate(system, system.qdot_all)[0]
    assert_close(q_dot, book.q_dot)
    v_dot = book.v_dot(sample.udot)
    names = [part.name for part in sample.mechanism.bodies]
    for k, link in enumerate(system.links):
        rows = slice(6 * names.index(link.joint.child), 6 * names.index(link.joint.child) + 6)
        v, v_t, a = values[3 * k : 3 * k + 3]
        assert_close(v, book.v[rows])
        assert_close(v_t, book.v_t[rows])
        # A spatial acceleration is v̇ − ω × v of the point in the body's own components.
        pose = book.turned[names.index(link.joint.child)]
        turned = np.cross(pose @ book.v[rows][3:], book.v[rows][:3])
        expected = v_dot[rows] - np.concatenate([turned, np.zeros(3)])
        assert_close(a, expected, scale=largest(turned))


@given(samples())
def test_dynamics(sample: Sample) -> None:
    system, book = trace(sample.mechanism), sample.book
    parts = channels(system)
    motion = forward(system, parts)
    M, udot, driving, inverse, from_udot = sample.evaluate(
        system,
        crba(system),
        motion.udot,
        motion.driving,
        rnea(system, system.udot_all),
        driving_forces(system, system.udot_all, parts),
    )
    assert_close(M, book.P.T @ book.M @ book.P)
    assert_close(M[np.ix_(book.free, book.free)], book.mass_matrix)
    assert_close(inverse, -book.P.T @ book.F_star(sample.udot))
    assert_close(from_udot, book.driving(sample.udot), scale=largest(inverse))
    # Both routes solve a linear system, so its condition bounds what they can agree to.
    condition = float(np.linalg.cond(book.mass_matrix)) if len(book.free) else 1.0
    assert_close(udot, book.udot, tolerance=1e-13 * max(10.0, condition))
    assert_close(driving, book.driving(book.udot), tolerance=1e-13 * max(10.0, condition))
    residual = book.F_r + book.F_r_star(udot[:, 0])
    assert_close(residual, np.zeros_like(residual), scale=float(np.abs(book.F).sum() + 1))


@given(samples())
def test_channels(sample: Sample) -> None:
    system, book = trace(sample.mechanism), sample.book
    parts = channels(system)
    expected = {channel.name: channel for channel in book.channels}
    assert {part.name for part in parts} >= set(expected)
    powers = channel_powers(system, parts)
    for part in parts:
        if part.name not in expected:
            # At an instant where ∂V/∂t happens to vanish the textbook lists no channel.
            assert part.name.startswith("prescribed")
            continue
        force, power = sample.evaluate(system, part.force, powers[part.name])
        channel = expected[part.name]
        assert_close(force, book.P.T @ channel.F)
        scale = float(np.abs(channel.F) @ np.abs(book.v))
        assert_close(power, channel.F @ book.v + channel.explicit, scale=scale)
        assert (part.potential is None) == (channel.potential is None)
        if part.potential is not None:
            assert_close(sample.evaluate(system, part.potential), channel.potential)
    assert_close(sample.evaluate(system, total_force(system, parts)), book.P.T @ book.F)


@given(samples())
def test_terms(sample: Sample) -> None:
    system, book = trace(sample.mechanism), sample.book
    parts = channels(system)
    k = terms(system, system.udot_all, parts)
    udot = sample.udot
    expected: dict[str, Any] = {
        "K2": book.K2,
        "K1": book.K1,
        "K0": book.K0,
        "K": book.K,
        "V": book.V,
        "force_power": book.v @ book.F,
        "nonpotential_power": book.v @ book.F_D + book.V_t,
        "transport_power": book.v_t @ book.F,
        "inertia_transport": book.F_0(udot),
        "prescribed_power": book.v_t @ book.F_prime(udot),
        "rate_1990": book.rate_1990,
        "rate_1988": book.rate_1988,
    }
    values = sample.evaluate(system, *(getattr(k, name) for name in expected))
    work = np.abs(book.F) + np.abs(book.M @ book.v_dot(udot)) + np.abs(book.beta)
    scale = float(work @ (np.abs(book.v) + np.abs(book.v_t))) + 1.0
    for (name, value), found in zip(expected.items(), values, strict=True):
        np.testing.assert_allclose(
            scalar(found), value, rtol=1e-12, atol=1e-12 * scale, err_msg=name
        )
    assert_close(scalar(values[3]), sum(map(scalar, values[:3])))
    driving = driving_forces(system, system.udot_all, parts)
    driven = reaction_powers(system, Reactions(driving, ca.SX(0, 1)), None)
    assert set(driven) == {f"prescribed {j.name}" for j in sample.mechanism.joints if j.prescribed}
    total = sum(scalar(power) for power in sample.evaluate(system, *driven.values()))
    assert_close(total, expected["prescribed_power"], scale=scale)


@pytest.mark.parametrize("moving", [revolute, prismatic])
def test_fixed_joints_beside_a_single_speed(moving: object) -> None:
    """A fixed joint adds no entry, also where the full vectors have just one."""
    mechanism = Mechanism(
        [rod("arm", 2.0, 0.6), body("tip", 1.0, [0.01] * 3)],
        [
            moving("joint", "ground", "arm", "z"),  # type: ignore[operator]
            fixed("weld", "arm", "tip", position=(0.6, 0, 0)),
        ],
    )
    system = trace(mechanism)
    sample = Sample(mechanism, 0.0, np.zeros(1), np.zeros(1), np.zeros(1))
    (M,) = sample.evaluate(system, crba(system))
    expected = 2.0 * 0.6**2 / 3 + 0.01 + 0.6**2 if moving is revolute else 3.0
    assert_close(M, [[expected]])
