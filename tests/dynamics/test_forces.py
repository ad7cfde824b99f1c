"""Force and potential of every element: P = −V̇ + ∂V/∂t, over the registry."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.dynamics.forces import channels
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.dynamics.terms import channel_powers
from deltac.mechanism.bodies import body, point_mass
from deltac.mechanism.channels import Channel
from deltac.mechanism.forces import joint_spring, joint_torque, spring_damper
from deltac.mechanism.joints import prismatic, spherical
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scene import Element
from tests.systems.random_forces import ELEMENTS, random_force
from tests.systems.random_mechanisms import Options, Sample, assert_close, largest, samples, scalar


def rate(system: System, expression: SX) -> SX:
    """Its rate in the motion, by the chain rule along (q̇, 1)."""
    return ca.jtimes(expression, ca.vertcat(system.q, system.t), ca.vertcat(system.qdot, 1))


def explicit(parts: tuple[Channel, ...], name: str) -> SX:
    """∂V/∂t of a spring: the power of its channel of kind `prescribed`, if it has one."""
    wanted = "prescribed " + name.removeprefix("spring ")
    found = [part.explicit for part in parts if part.name == wanted]
    return found[0] if found else ca.SX(0)


KINDS = [kind for kind in Element.__subclasses__() if kind.__module__.startswith("deltac.")]


def test_every_element_has_an_example() -> None:
    assert set(ELEMENTS) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(bare=samples(Options(forces=False, bodies=4)), seed=st.integers(0, 2**32 - 1))
def test_power_is_the_loss_of_potential(kind: type[Element], bare: Sample, seed: int) -> None:
    rng = np.random.default_rng(seed)
    what = str(rng.choice(ELEMENTS[kind]))
    element = random_force(rng, bare.mechanism, what, "tested")
    assume(element is not None)
    assert isinstance(element, kind)
    mechanism = replace(bare.mechanism, forces=[element])
    system = trace(mechanism)
    parts = channels(system)
    powers = channel_powers(system, parts)
    sample = Sample(mechanism, bare.t, bare.q, bare.u, bare.udot)
    for part in parts:
        power, force = sample.evaluate(system, powers[part.name], part.force)
        scale = 1.0 + float(np.abs(force[:, 0]) @ np.abs(bare.u))
        if part.potential is not None:
            V_dot, V_t = sample.evaluate(
                system, rate(system, part.potential), explicit(parts, part.name)
            )
            # Rounding of the terms of V̇, in which a pose's many factors cancel.
            scale += abs(scalar(V_dot)) + abs(scalar(V_t))
            assert_close(power, scalar(V_t) - scalar(V_dot), scale=scale)
        if part.name.startswith(("damper", "friction", "contact")):
            assert scalar(power) <= 1e-12 * scale


@given(samples(Options(forces=False, prescribed=False, bodies=3)))
def test_gravity_is_the_weight(sample: Sample) -> None:
    """V̇ of gravity is −Σ m g·v_G, with mass centres of the textbook."""
    system, book = trace(sample.mechanism), sample.book
    (part,) = channels(system)
    N = len(sample.mechanism.bodies)
    masses = [sample.mechanism.number(b.mass) for b in sample.mechanism.bodies]
    g = np.array(sample.mechanism.gravity, dtype=float)
    loss = sum(m * g @ book.v[6 * k : 6 * k + 3] for k, m in zip(range(N), masses, strict=True))
    (V_dot,) = sample.evaluate(system, rate(system, part.potential))
    assert_close(V_dot, -loss, scale=largest(g) * sum(masses) * (1 + largest(book.v)))


def test_forces_at_rows_of_an_oscillator() -> None:
    """−k x and −c v of each row, and nothing by a motor without a law."""
    slide = prismatic("slide", "ground", "mass", "x", stiffness=100.0, damping=0.4)
    push = joint_torque("push", "slide")
    equations = equations_of_motion(Mechanism([point_mass("mass", 2.0)], [slide], [push]))
    t = np.linspace(0.0, 1.0, 5)
    q, u = np.sin(t)[:, None], np.cos(t)[:, None]
    forces = {name.kind: force for name, force in equations.forces(t, q, u).items()}
    assert_close(forces["spring"], -100.0 * q)
    assert_close(forces["damper"], -0.4 * u)
    assert not forces["actuator"].any()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("angle", [0.0, 1e-14, 1e-5, 0.7, 3.0])
def test_ball_joint_spring_pulls_along_the_rotation_vector(sign: int, angle: float) -> None:
    """Moment −k φ n, at the identity too and for both signs of the quaternion."""
    mechanism = Mechanism(
        [body("ball", 1.0, [0.1, 0.2, 0.25])], [spherical("joint", "ground", "ball", stiffness=2.5)]
    )
    system = trace(mechanism)
    (part,) = channels(system)
    n = np.array([2.0, -1.0, 2.0]) / 3
    q = sign * np.array([np.cos(angle / 2), *(np.sin(angle / 2) * n)])
    sample = Sample(mechanism, 0.0, q, np.zeros(3), np.zeros(3))
    force, potential = sample.evaluate(system, part.force, part.potential)
    np.testing.assert_allclose(force[:, 0], -2.5 * angle * n, rtol=1e-12, atol=1e-28)
    np.testing.assert_allclose(scalar(potential), 0.5 * 2.5 * angle**2, rtol=1e-12, atol=1e-28)


def test_stiffness_curve_gives_back_its_torque() -> None:
    mechanism = Mechanism(
        [point_mass("slider", 1.0)],
        [prismatic("slide", "ground", "slider", "x")],
        [joint_spring("curve", "slide", torque="-3*q.slide**3 - sin(q.slide)")],
    )
    system = trace(mechanism)
    (part,) = channels(system)
    for s in (-0.8, 0.0, 1.3):
        sample = Sample(mechanism, 0.0, np.array([s]), np.ones(1), np.zeros(1))
        force, V = sample.evaluate(system, part.force, part.potential)
        assert_close(scalar(force), -3 * s**3 - np.sin(s), 1e-14)
        assert_close(scalar(V), 0.75 * s**4 + 1 - np.cos(s), 1e-14)


def test_spring_without_length_is_smooth_where_its_ends_meet() -> None:
    mechanism = Mechanism(
        [point_mass("slider", 1.0)],
        [prismatic("slide", "ground", "slider", "x")],
        [spring_damper("spring", "ground", "slider", stiffness=4.0)],
    )
    system = trace(mechanism)
    (part,) = channels(system)
    sample = Sample(mechanism, 0.0, np.zeros(1), np.ones(1), np.zeros(1))
    force, slope, V = sample.evaluate(
        system, part.force, ca.jacobian(part.force, system.q), part.potential
    )
    assert (scalar(force), scalar(slope), scalar(V)) == (0.0, -4.0, 0.0)
