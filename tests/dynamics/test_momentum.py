"""Momentum balances: their rates against the forces, their values against Σ m v_G and Σ r × m v_G + Iω."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.momentum import momentum_balances, momentum_functions
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward
from tests.systems.random_mechanisms import Options, Sample, assert_close, largest, samples, scalar

GROUND_JOINTS = (
    "revolute",
    "prismatic",
    "screw",
    "cylindrical",
    "universal",
    "planar",
    "spherical",
    "free",
)


def beyond(sample: Sample, joint: str) -> list[int]:
    """Places of the bodies that hang on a joint."""
    mechanism = sample.mechanism
    names, found = [mechanism.joint(joint).child], []
    while names:
        name = names.pop()
        found.append([body.name for body in mechanism.bodies].index(name))
        names += [below.child for below in mechanism.children[name]]
    return found


def expected_momentum(sample: Sample, joint_name: str, label: str) -> float | None:
    """h·s by summing over bodies, for directions that are plain in the joint's frame on the ground."""
    book, joint = sample.book, sample.mechanism.joint(joint_name)
    at = np.array([sample.mechanism.number(p) for p in joint.position])
    linear, angular = np.zeros(3), np.zeros(3)
    for k in beyond(sample, joint_name):
        momentum = (book.M @ book.v)[6 * k : 6 * k + 6]
        linear += momentum[:3]
        angular += np.cross(book.x[k] - at, momentum[:3]) + book.turned[k] @ momentum[3:]
    axes = np.array(joint.rotation)
    if " " in label:
        direction = axes[:, "xyz".index(label[-1])]
    elif joint.kind == "screw":
        return None  # along a screw both momenta count
    else:
        direction = axes @ np.array(joint.axes[0])
    return float(direction @ (linear if label.startswith("linear") else angular))


@pytest.mark.parametrize("kind", GROUND_JOINTS)
@given(data=st.data())
def test_balances(kind: str, data: Any) -> None:
    sample = data.draw(samples(Options(bodies=3, first=kind)))
    system, book = trace(sample.mechanism), sample.book
    parts = channels(system)
    balances = momentum_balances(system)
    (udot,) = sample.evaluate(system, forward(system, parts).udot)
    udot = udot[:, 0]
    along = ca.vertcat(system.q, system.u, system.t)
    direction = ca.vertcat(system.qdot, system.udot, 1)
    size = 1.0 + largest(book.M) * (1 + largest(book.P)) ** 2 * (1 + largest(udot))
    for balance in balances:
        momentum, rate, force = sample.evaluate(
            system,
            balance.momentum,
            ca.jtimes(balance.momentum, along, direction),
            balance.force(parts),
            udot=udot,
        )
        assert_close(scalar(rate), scalar(force), scale=size)
        label, joint = balance.name.rsplit(" ", 1)
        expected = expected_momentum(sample, joint, label)
        if expected is not None:
            assert_close(scalar(momentum), expected, scale=largest(book.M @ book.v))
    on_ground = sample.mechanism.joint("j0")
    if not on_ground.prescribed and not on_ground.armature:
        assert any(balance.name.endswith(" j0") for balance in balances)


@given(samples())
def test_rates_of_generalized_momenta(sample: Sample) -> None:
    """ṗ_r by the chain rule less the recursion's rate is −(F_r + F*_r) of the textbook, at any u̇."""
    system, book = trace(sample.mechanism), sample.book
    known = momentum_functions(system, total_force(system, channels(system)))
    along = ca.vertcat(system.q, system.u, system.t)
    motion = ca.vertcat(system.qdot, system.udot, 1)
    p, epsilon = sample.evaluate(
        system, known.momentum, ca.jtimes(known.momentum, along, motion) - known.rate
    )
    expected = -(book.F_r + book.F_r_star(sample.udot))
    size = 1.0 + largest(book.M) * (1 + largest(book.P)) ** 2 * (1 + largest(sample.udot)) ** 2
    size += sum(largest(channel.F) for channel in book.channels) * (1 + largest(book.P))
    assert_close(epsilon.ravel(), expected, scale=size)
    assert known.names == tuple(system.mechanism.speeds[k].name for k in system.free_u)
    if not any(link.armature.nnz() for link in system.links):
        assert_close(p.ravel(), (book.P.T @ book.M @ book.v)[book.free], scale=size)
