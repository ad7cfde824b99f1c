"""Own generalized speeds u = Y(q, t) u′ + Z(q, t): what they change, and where the 1988 form is wrong.

ε_1988 − ε_exact = p·[(∂W/∂t + (X·∇)W) u′ − (W u′)·∇X] for q̇ = W u′ + X over all coordinates and
p = ∂K/∂q̇ of the unconstrained kinetic energy: the commutator of the moving frame's velocity field with the
partial velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from deltac.dynamics.coordinates import trace_map
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.forces import channels
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward, terms
from deltac.mechanism.bodies import frame, point_mass
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from tests.oracles.textbook.kinematics import along, coordinate_rates
from tests.support.rate_forms import NAMES, ROUNDING, rate_forms, scale_of
from tests.systems.random_mechanisms import Options, Sample, assert_close, samples, scalar

Array = NDArray[Any]

# A rotor on a component of an angular velocity turns by no coordinate: it is not holonomic, and the
# commutator, which comes from Lagrange's equations, says nothing of it.
DRIVEN = samples(Options(one_prescribed=True, bodies=4, armature_on_quaternions=False))


@dataclass(frozen=True)
class OwnSpeeds:
    """Laws of u = Y u′ + Z: as a CoordinateMap, and as functions of all q (nq,) and t."""

    map: CoordinateMap
    Y: Callable[[Array, Any], Array]
    Z: Callable[[Array, Any], Array]


def own_speeds(sample: Sample, rng: np.random.Generator) -> OwnSpeeds:
    """Smooth, invertible, random; of time and all free coordinates."""
    mechanism = sample.mechanism
    t = sympy.Symbol("t", real=True)
    q_all = [sympy.Symbol(f"q.{name}", real=True) for name in mechanism.coordinates.names]
    q = [q_all[i] for i in mechanism.free.q]
    n = len(mechanism.free.u)
    own = [sympy.Symbol(f"u.s{k}", real=True) for k in range(n)]

    def law() -> Any:
        one, other = rng.integers(len(q), size=2)
        angle = rng.normal() * t + rng.normal() * q[one] + rng.normal() * q[other]
        return round(rng.uniform(-1, 1), 3) * sympy.sin(angle)

    # Each speed with the next: diagonally dominant, hence invertible.
    Y = sympy.Matrix(n, n, lambda i, j: 2 * (i == j) + (law() if j == (i + 1) % n else 0))
    Z = sympy.Matrix(n, 1, lambda i, _: law())
    u = Y * sympy.Matrix(n, 1, own) + Z
    names = [mechanism.speeds[i].name for i in mechanism.free.u]
    given_map = CoordinateMap(
        speeds=tuple(f"s{k}" for k in range(n)), u=dict(zip(names, u, strict=True))
    )
    values_Y, values_Z = (sympy.lambdify([q_all, t], matrix, "numpy") for matrix in (Y, Z))
    return OwnSpeeds(given_map, values_Y, lambda q, t: values_Z(q, t)[:, 0])


def commutator(sample: Sample, own: OwnSpeeds) -> float:
    """p·[(∂W/∂t + (X·∇)W) u′ − (W u′)·∇X] by complex steps, from the textbook's kinematics."""
    mechanism, book = sample.mechanism, sample.book
    free = book.free
    Y, Z = own.Y(sample.q, sample.t), own.Z(sample.q, sample.t)
    own_u = np.linalg.solve(Y, sample.u[free] - Z)
    nq = len(sample.q)

    def W(place: Array) -> Array:
        return coordinate_rates(mechanism, place[:nq])[:, free] @ own.Y(place[:nq], place[nq])

    def X(place: Array) -> Array:
        speeds = book.u_t.astype(place.dtype)
        speeds[free] = own.Z(place[:nq], place[nq])
        return np.asarray(coordinate_rates(mechanism, place[:nq]) @ speeds)

    now = np.append(sample.q, sample.t)
    bracket = along(W, now, np.append(X(now), 1.0)) @ own_u
    bracket = bracket - along(X, now, np.append(W(now) @ own_u, 0.0))
    # p = ∂K/∂q̇, with u = W⁺ q̇; ∂K/∂u = Pᵀ M v.
    p = np.linalg.pinv(coordinate_rates(mechanism, sample.q)).T @ (book.P.T @ book.M @ book.v)
    return float(p @ bracket)


assert settings.default is not None
FEW = 4 if settings.default.max_examples < 50 else settings.default.max_examples
"""SymPy takes a second for the speeds of each example."""


@settings(max_examples=FEW)
@given(DRIVEN, st.integers(0, 2**32 - 1))
def test_the_1988_form_misses_a_commutator(sample: Sample, seed: int) -> None:
    assume(len(sample.mechanism.free.u) > 0)
    own = own_speeds(sample, np.random.default_rng(seed))
    system, book = trace(sample.mechanism), sample.book
    parts = channels(system)
    traced = trace_map(system, own.map, equations_of(system).rows)
    (udot,) = sample.evaluate(system, forward(system, parts).udot)
    k = terms(system, system.udot_all, parts, traced)
    found = sample.evaluate(system, *rate_forms(system, k), k.K2, k.K1, k.K0, udot=udot[:, 0])
    epsilon = dict(zip(NAMES, map(scalar, found), strict=False))

    Z, Y = own.Z(sample.q, sample.t), own.Y(sample.q, sample.t)
    own_u = np.linalg.solve(Y, sample.u[book.free] - Z)
    R, v_t = book.R @ Y, book.v_t + book.R @ Z
    energies = np.array([own_u @ R.T @ book.M @ R @ own_u / 2, v_t @ book.M @ R @ own_u])
    kinetic = [*energies, v_t @ book.M @ v_t / 2]
    assert_close([scalar(value) for value in found[-3:]], kinetic)

    missed = commutator(sample, own)
    momentum = float(np.abs(book.M) @ np.abs(book.v) @ (np.abs(book.P) @ np.ones(len(book.u))))
    scale = scale_of(book, udot[:, 0]) * max(1.0, np.abs(udot).max() / 10)
    scale += momentum * (1 + np.abs(own_u).sum())
    assert abs(epsilon["kane-levinson-1988"] - epsilon["kane-levinson-1990"] - missed) < (
        10 * ROUNDING * scale
    )
    for name in ("kane-levinson-1990", "liu-huston", "wang"):
        assert abs(epsilon[name]) < 10 * ROUNDING * scale, name


@given(DRIVEN)
def test_no_commutator_with_the_joints_own_speeds(sample: Sample) -> None:
    system, book = trace(sample.mechanism), sample.book
    k = terms(system, system.udot_all, channels(system))
    found = sample.evaluate(system, k.rate_1988 - k.rate_1990)
    assert abs(scalar(found[0])) < ROUNDING * scale_of(book, sample.udot)


def test_free_particle_in_turning_coordinates() -> None:
    """The smallest counter-example: u = q̇ − ΩJq gives ε_1988 = −mΩ² q·u, and the others nothing."""
    mass, turning = 1.3, 0.7
    mechanism = Mechanism(
        [frame("along"), point_mass("particle", mass)],
        [prismatic("x", "ground", "along", "x"), prismatic("y", "along", "particle", "y")],
    )
    own = CoordinateMap(
        speeds=("ux", "uy"),
        u={"x": f"u.ux - {turning}*q.y", "y": f"u.uy + {turning}*q.x"},
    )
    system = trace(mechanism)
    traced = trace_map(system, own, equations_of(system).rows)
    k = terms(system, system.udot_all, channels(system), traced)
    forms = rate_forms(system, k)
    q0, q_dot = np.array([1.0, 0.2]), np.array([0.3, -0.5])
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    missed = []
    for t in np.linspace(0, 3, 61):
        q = q0 + q_dot * t
        expected = -mass * turning**2 * q @ (q_dot - turning * J @ q)
        found = Sample(mechanism, t, q, q_dot, np.zeros(2)).evaluate(system, *forms)
        epsilon = dict(zip(NAMES, map(scalar, found), strict=True))
        assert_close(epsilon.pop("kane-levinson-1988"), expected, 1e-14)
        assert_close(list(epsilon.values()), np.zeros(3), 1e-14)
        missed.append(expected)
    # q·Jq = 0 leaves a linear function of t, which the trapezoidal rule integrates exactly.
    total = np.append(0.0, np.cumsum(0.5 * (np.array(missed)[1:] + missed[:-1]) * 0.05))
    t = np.linspace(0, 3, 61)
    exact = -mass * turning**2 * (q0 @ q_dot * t + q_dot @ q_dot * t**2 / 2)
    assert_close(total, exact, 1e-14)
    assert abs(np.ptp(exact) - 1.3568) < 5e-5
