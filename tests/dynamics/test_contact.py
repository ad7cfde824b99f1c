"""Friction and compliant contact: against the textbook, against published formulas, and their limits."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from deltac.dynamics.forces import channels
from deltac.dynamics.scene import TracedScene
from deltac.dynamics.system import trace
from deltac.dynamics.terms import channel_powers
from deltac.mechanism import shapes
from deltac.mechanism.bodies import body, box, point_mass, sphere
from deltac.mechanism.contact import Contact, contact
from deltac.mechanism.friction import (
    JointFriction,
    PointFriction,
    friction_law,
    joint_friction,
    point_friction,
)
from deltac.mechanism.joints import free, prismatic, spherical
from deltac.mechanism.mechanism import Mechanism
from tests.systems.random_forces import ELEMENTS, random_contact, random_force
from tests.systems.random_geometry import random_rotation
from tests.systems.random_mechanisms import Options, Sample, assert_close, samples

NEW = [what for kind in (JointFriction, PointFriction, Contact) for what in ELEMENTS[kind]]


@pytest.mark.parametrize("what", NEW)
@given(bare=samples(Options(forces=False, bodies=3)), seed=st.integers(0, 2**32 - 1))
def test_channels_against_the_textbook(what: str, bare: Sample, seed: int) -> None:
    element = random_force(np.random.default_rng(seed), bare.mechanism, what, "tested")
    assume(element is not None)
    mechanism = replace(bare.mechanism, forces=[element], gravity=(0.0, 0.0, 0.0))
    sample = Sample(mechanism, bare.t, bare.q, bare.u, bare.udot)
    system, book = trace(mechanism), sample.book
    expected = {channel.name: channel for channel in book.channels}
    parts = channels(system)
    assert {part.name for part in parts} == set(expected)
    for part in parts:
        (force,) = sample.evaluate(system, part.force)
        other = expected[part.name]
        assert_close(force, book.P.T @ other.F, 1e-10)  # cancellation in normals of short lengths
        if part.potential is not None:
            assert_close(sample.evaluate(system, part.potential)[0], other.potential, 1e-11)


@pytest.mark.parametrize("what", ELEMENTS[Contact])
def test_two_bodies_that_move_as_one_feel_no_power(what: str) -> None:
    """Action equals reaction at one place: in a common rigid motion no channel has power."""
    rng = np.random.default_rng(3)
    bodies = [body("a", 1.0, [1, 1, 1]), body("b", 2.0, [1, 1, 1])]
    bare = Mechanism(
        bodies, [free("fa", "a"), free("fb", "b")], parameters={"k_p": 3.0, "l_p": 0.4}
    )
    touched = 0
    for _ in range(4):
        mechanism = replace(bare, forces=[random_contact(rng, what, "pair", "a", "b")])
        system = trace(mechanism)
        parts = channels(system)
        powers = ca.vertcat(*channel_powers(system, parts).values())
        sizes = ca.vertcat(*(ca.norm_inf(part.force) for part in parts))
        f = ca.Function("f", [system.q, system.u], [powers, sizes])
        for _ in range(10):
            q, u = np.zeros(14), np.zeros(12)
            w, v = rng.normal(size=(2, 3))
            for k in (0, 1):
                turned = np.array(random_rotation(rng))
                x = rng.normal(0, 0.5, 3)
                q[7 * k : 7 * k + 7] = [*x, *_quaternion(turned)]
                u[6 * k : 6 * k + 6] = [*(v + np.cross(w, x)), *(turned.T @ w)]
            power, size = (np.array(value) for value in f(q, u))
            assert (np.abs(power) <= 1e-11 * (1 + size)).all()  # rounding
            touched += bool(size.max() > 0)
    assert touched >= 10


def _quaternion(R: Any) -> Any:
    w = math.sqrt(max(1 + np.trace(R), 1e-12)) / 2
    return [w, *(np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * w))]


# --- published formulas ------------------------------------------------------------------------------


def law(gap: float, closing: float, **given: Any) -> tuple[float, float, float]:
    """V, elastic and normal force of a contact of a sphere on the ground."""
    stiffness = given.pop("stiffness", 1e4)
    element = contact("c", shapes.sphere("ball", 0.05), shapes.half_space(), stiffness, **given)
    machine = Mechanism([sphere("ball", 1.0, 0.05)], [free("f", "ball")], [element])
    found = element.normal_force(TracedScene(trace(machine)), ca.SX(gap), ca.SX(closing))
    return tuple(float(value) for value in found)  # type: ignore[return-value]


@pytest.mark.parametrize("parting", [-3.0, -0.2, 0.0, 0.3, 2.0])
def test_drake(parting: float) -> None:
    """f = k x (1 − d v_n)₊ with v_n the speed of parting (Drake, "Modeling Dissipation")."""
    k, d, x = 1e4, 0.8, 2e-3
    _, _, f = law(-x, -parting, dissipation=d)
    assert f == pytest.approx(k * x * max(1 - d * parting, 0), rel=1e-14, abs=1e-300)


@pytest.mark.parametrize("speed", [-1.0, 0.0, 1.5])
def test_simbody(speed: float) -> None:
    """f = 4/3 √R E x^{3/2} (1 + 3/2 c ẋ) (Simbody, HuntCrossleyForce; Hunt and Crossley 1975)."""
    R, E, c, x = 0.05, 1e6, 0.2, 1e-3
    k = 4 / 3 * math.sqrt(R) * E
    _, _, f = law(-x, speed, stiffness=k, exponent=1.5, dissipation=1.5 * c)
    assert f == pytest.approx(k * x**1.5 * max(1 + 1.5 * c * speed, 0), rel=1e-13)


@pytest.mark.parametrize("speed", [-0.4, 0.0, 0.4])
def test_chrono(speed: float) -> None:
    """Chrono's model Flores: F = k_n δ + g_n δ̇ with k_n = 4/3 E √(R δ), g_n = 8 (1 − e) k_n δ/(5 e v)."""
    E, R, e, v, x = 2e6, 0.05, 0.6, 0.5, 5e-4
    k_n = 2 / 3 * 2 * E * math.sqrt(R * x)
    g_n = 8 * (1 - e) * k_n * x / (5 * e * v)
    _, _, f = law(
        -x,
        speed,
        stiffness=4 / 3 * E * math.sqrt(R),
        exponent=1.5,
        dissipation=8 * (1 - e) / (5 * e * v),
    )
    assert f == pytest.approx(max(k_n * x + g_n * speed, 0.0), rel=1e-13)


@pytest.mark.parametrize(
    ("closing", "expected"), [(1.0, 20.0 + 50.0), (-0.2, 20.0 - 10.0), (-0.5, 0.0)]
)
def test_kelvin_voigt_never_pulls(closing: float, expected: float) -> None:
    _, elastic, f = law(-2e-3, closing, model="kelvin-voigt", dissipation=50.0)
    assert elastic == pytest.approx(20.0) and f == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("model", ["hunt-crossley", "kelvin-voigt"])
@pytest.mark.parametrize("exponent", [1.0, 1.25, 1.5, 2.0])
def test_apart_nothing_acts_and_derivatives_are_finite(model: Any, exponent: float) -> None:
    """At a gap of zero too, where x^1.5 has no second derivative: implicit solvers need Jacobians."""
    element = contact(
        "c",
        shapes.sphere("ball", 0.1),
        shapes.half_space(),
        1e4,
        exponent=exponent,
        model=model,
        dissipation=0.3,
        friction=friction_law(0.4, static=0.6, stribeck=0.01),
    )
    machine = Mechanism([sphere("ball", 1.0, 0.1)], [free("f", "ball")], [element])
    system = trace(machine)
    total = sum((part.force for part in channels(system)), start=ca.SX.zeros(6))
    J = ca.jacobian(total, ca.vertcat(system.q, system.u))
    f = ca.Function("f", [system.q, system.u], [total, ca.densify(J)])
    for z in (0.3, 0.1, 0.0999):
        for speed in (0.0, 1.0):
            force, slopes = f([0, 0, z, 1, 0, 0, 0], [speed, 0, 0, 0, 0, 0])
            assert np.isfinite(np.array(slopes)).all()
            assert (np.abs(np.array(force)).max() > 0) == (z < 0.1)


# --- friction ----------------------------------------------------------------------------------------


def slipping(speed: float, **given: Any) -> float:
    """Force of a joint's friction at a speed."""
    machine = Mechanism(
        [point_mass("m", 1.0)],
        [prismatic("x", "ground", "m", "x")],
        [joint_friction("f", "x", **given)],
    )
    system = trace(machine)
    (part,) = channels(system)
    return float(ca.Function("f", [system.u], [part.force])(speed))


def test_the_regularisation_is_as_wide_as_it_says() -> None:
    """Beyond 19 widths Coulomb's friction is exact in double precision; within, 2 e^{−2v/w} is missing."""
    for width in (1e-3, 0.1):
        assert slipping(-19.1 * width, coulomb=3.0, width=width) == 3.0
        for y in (1.0, 3.0, 8.0):
            missing = 1 + slipping(y * width, coulomb=1.0, width=width)
            assert 0 < missing < 2 * math.exp(-2 * y)
    assert slipping(0.0, coulomb=3.0, static=4.0, stribeck=0.1) == 0.0


def test_stribeck_and_viscous_friction() -> None:
    """The excess at the Stribeck speed is 1/e, far above it nothing (Armstrong-Hélouvry 1994, eq. 4)."""
    given: dict[str, Any] = {"coulomb": 2.0, "static": 3.0, "stribeck": 0.1, "width": 1e-4}
    assert -slipping(0.1, **given) == pytest.approx(2.0 + math.exp(-1), rel=1e-14)
    assert -slipping(2.0, **given, viscous=0.5) == pytest.approx(2.0 + 1.0, rel=1e-14)
    assert slipping(-2.0, **given, viscous=0.5) == pytest.approx(2.0 + 1.0, rel=1e-14)


def test_friction_at_a_point_opposes_the_slip_along_the_plane_only() -> None:
    """μ N against the slip, whatever the speed across the plane; equal and opposite on the other body."""
    machine = Mechanism(
        [box("a", 1.0, [1, 1, 1]), box("b", 1.0, [1, 1, 1])],
        [free("fa", "a"), free("fb", "b")],
        [point_friction("rub", "a", 10.0, 0.3, on="b", normal="z", point=(0, 0, -0.5))],
    )
    system = trace(machine)
    (part,) = channels(system)
    f = ca.Function("f", [system.q, system.u], [part.force])
    still = [0, 0, 0, 1, 0, 0, 0]
    u = [3.0, 4.0, 7.0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    force = np.array(f([0, 0, 1.0, 1, 0, 0, 0, *still], u)).ravel()
    np.testing.assert_allclose(force[:3], [-1.8, -2.4, 0.0], atol=1e-13)
    np.testing.assert_allclose(force[6:9], [1.8, 2.4, 0.0], atol=1e-13)
    np.testing.assert_allclose(force[3:6], np.cross([0, 0, -0.5], force[:3]), atol=1e-13)
    np.testing.assert_allclose(force[9:], np.cross([0, 0, 0.5], force[6:9]), atol=1e-13)


def test_a_pull_instead_of_a_normal_force_gives_no_friction() -> None:
    machine = Mechanism(
        [point_mass("m", 1.0)],
        [prismatic("x", "ground", "m", "x")],
        [point_friction("rub", "m", "-5 + 0*t", 0.3)],
    )
    system = trace(machine)
    (part,) = channels(system)
    assert float(ca.Function("f", [system.t, system.u], [part.force])(0.0, 2.0)) == 0.0


def test_every_speed_of_a_joint_has_its_friction() -> None:
    machine = Mechanism(
        [box("m", 1.0, [1, 1, 1])],
        [spherical("ball", "ground", "m")],
        [joint_friction("f", "ball", [0.1, 0.2, "0.3"], viscous=[0, 0, 1.0])],
    )
    system = trace(machine)
    (part,) = channels(system)
    force = np.array(ca.Function("f", [system.u], [part.force])([1.0, -1.0, 2.0])).ravel()
    np.testing.assert_allclose(force, [-0.1, 0.2, -2.3], rtol=1e-14)
