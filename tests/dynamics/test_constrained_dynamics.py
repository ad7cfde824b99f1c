"""Multipliers by two routes, and the energy theorem on random constrained mechanisms.

One route eliminates by LDLᵀ (`deltac.dynamics.kkt`); the other reduces the generalized speeds by an
orthogonal complement from singular values (`tests.oracles.textbook.constrained`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings

from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.recursions import rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import Reactions, Terms, forward, terms
from deltac.dynamics.testing_functions import TESTING_FUNCTIONS, applicable
from tests.support.rate_forms import ROUNDING, scale_of
from tests.systems.constrained_mechanisms import EXAMPLES, Tied, condition, playing, tied
from tests.systems.random_mechanisms import MAKERS, Options, assert_close, largest, scalar

NAMES = applicable(constrained=True)
MOVING = tuple(kind for kind in MAKERS if kind != "fixed")  # constraints need something to hold
TREES = Options(joints=MOVING, bodies=4, massless=False, thin=False)
AT_REST = replace(TREES, prescribed=False)

# An example takes some tenths of a second, so half as many as elsewhere.
fewer = settings(max_examples=settings().max_examples // 2)


def rate_forms(system: Any, k: Terms) -> list[SX]:
    """ε = Ė − P of every function that constrained mechanisms can be tested by."""
    along = ca.vertcat(system.q, system.u, system.t)
    direction = ca.vertcat(system.qdot, system.udot, 1)
    functions = [TESTING_FUNCTIONS[name] for name in NAMES]
    return [ca.jtimes(f.E(k), along, direction) - f.P(k) for f in functions]


def size(tied: Tied, udot: Any, multipliers: Any) -> float:
    """The size (W) of what cancels in ε, reactions included."""
    ties, k = tied.ties, list(tied.independent)
    reactions = np.abs(multipliers) @ np.abs(ties.G_all[k])
    motion = 1 + np.abs(tied.sample.u) + np.abs(ties.u_t if len(k) == len(ties.names) else 0)
    drift = np.abs(multipliers) @ np.abs(ties.c[k])
    return scale_of(tied.book, udot) * (1 + largest(udot)) + float(reactions @ motion + drift)


@fewer
@given(tied(TREES))
def test_multipliers_by_elimination_equal_those_by_complement(tied: Tied) -> None:
    """1e-9 relative is asked for; what is reached is rounding times the condition of the system."""
    ties, system = tied.ties, tied.system
    motion = forward(system, channels(system), tied.bound)
    udot, driving, lam = (
        v[:, 0] for v in tied.evaluate(motion.udot, motion.driving, motion.multipliers)
    )
    accuracy = min(1e-9, 1e-13 * condition(tied))
    scale = 10 + largest(tied.book.F) + largest(udot)
    assert_close(udot, ties.udot, accuracy, scale)
    k = list(tied.independent)
    if len(k) == len(ties.names):
        assert_close(lam, ties.multipliers(ties.udot), accuracy, scale)
        assert_close(driving, ties.driving(ties.udot), accuracy, scale + largest(lam))
    # Of redundant rows only the force is unique, not the multipliers.
    force = ties.G.T @ ties.multipliers(ties.udot)
    assert_close(ties.G[k].T @ lam, force, accuracy, scale + largest(lam))


@fewer
@given(tied(TREES))
def test_exact_motion_closes(tied: Tied) -> None:
    """Every testing function, with u̇ and reactions of the mechanism's own dynamics."""
    system = tied.system
    parts = channels(system)
    motion = forward(system, parts, tied.bound)
    udot, lam = (v[:, 0] for v in tied.evaluate(motion.udot, motion.multipliers))
    scale = size(tied, udot, lam) * max(1.0, condition(tied) / 100)
    for reactions in (None, Reactions(motion.driving, motion.multipliers)):
        k = terms(system, system.udot_all, parts, None, tied.bound, reactions)
        for name, found in zip(NAMES, tied.evaluate(*rate_forms(system, k), udot=udot)):
            assert abs(scalar(found)) < ROUNDING * scale, name


@pytest.mark.long
@fewer
@given(tied(TREES))
def test_wrong_accelerations_show_as_the_missing_power(tied: Tied) -> None:
    """The inertial forms: all give −Σ s_r (F_r + F*_r) of the reduced speeds, those of the textbook.

    The motion relative to v_t is u − u_t, and what the multipliers can explain of F + F* has no power in
    it.
    """
    system, ties, book, s = tied.system, tied.ties, tied.book, tied.sample
    if len(tied.independent) < len(ties.names):
        return  # the textbook's v_t is for independent rows
    k = terms(system, system.udot_all, channels(system), None, tied.bound)
    found = tied.evaluate(*rate_forms(system, k))
    energy_error = book.F + book.F_star(s.udot)
    expected = -(book.v - ties.v_t) @ energy_error
    lam = ties.multipliers(s.udot)
    scale = size(tied, s.udot, lam) * max(1.0, condition(tied) / 100)
    for name, epsilon in zip(NAMES, found, strict=True):
        assert abs(scalar(epsilon) - expected) < ROUNDING * scale, name
    # Not zero: a test that sees nothing would pass as well.
    assert ties.R_hat.shape[1] == 0 or abs(expected) > 1e-9 * scale or largest(s.u) == 0
    # With F′ measured Wang's function sees errors along v_t too: ε = −vᵀ(F + F* + F′).
    right = ties.udot
    lam, driving = ties.multipliers(right), ties.driving(right)
    reactions = Reactions(ca.SX(ca.DM(driving)), ca.SX(ca.DM(lam)))
    k = terms(system, system.udot_all, channels(system), None, tied.bound, reactions)
    (epsilon,) = tied.evaluate(rate_forms(system, k)[NAMES.index("wang")])
    # In speeds: u·(F + F*) of all joints, and F′ = driving + Gᵀλ.
    energy_error = book.P.T @ (book.F + book.F_star(s.udot)) + driving + ties.G_all.T @ lam
    scale = size(tied, s.udot, lam) * max(1.0, condition(tied) / 100)
    assert abs(scalar(epsilon) + s.u @ energy_error) < ROUNDING * scale


@pytest.mark.long
@fewer
@given(tied(AT_REST, moving=False))
def test_ideal_fixed_constraints_have_no_power(tied: Tied) -> None:
    """−bᵀλ and ψᵀλ, and the force Gᵀλ on the motion itself."""
    system, ties = tied.system, tied.ties
    motion = forward(system, channels(system), tied.bound)
    rows = tied.bound.rows
    power, given_b, lam = tied.evaluate(
        ca.dot(ca.mtimes(rows.G_all.T, motion.multipliers), system.u_all),
        rows.b,
        motion.multipliers,
    )
    assert largest(given_b) == 0.0
    scale = 1 + float(
        np.abs(lam[:, 0]) @ np.abs(ties.G_all[list(tied.independent)]) @ np.abs(tied.sample.u)
    )
    assert abs(scalar(power)) < ROUNDING * scale


@pytest.mark.long
@fewer
@given(tied(TREES))
def test_the_parts_of_the_kinetic_energy(tied: Tied) -> None:
    """K2, K1, K0, Q̇ and the bracket of 1990, with v_t least in the mass metric, by the textbook."""
    system, ties = tied.system, tied.ties
    if len(tied.independent) < len(ties.names):
        return
    motion = forward(system, channels(system), tied.bound)
    udot = ties.udot
    k = terms(system, system.udot_all, channels(system), None, tied.bound)
    flow = k.nonpotential_power + k.prescribed_power + k.correction_power
    found = tied.evaluate(k.K2, k.K1, k.K0, k.rate_1990, flow, motion.multipliers, udot=udot)
    accuracy = min(1e-9, 1e-13 * condition(tied))
    scale = size(tied, udot, ties.multipliers(udot))
    for value, expected in zip(found, (*ties.K_parts, ties.rate_1990, ties.Q_dot(udot))):
        assert_close(value, expected, accuracy, scale)


@cache
def off(name: str) -> Tied:
    return playing(name, seed=8)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_kind_closes_and_so_does_motion_off_its_constraints(name: str) -> None:
    """The playground's state violates its constraint: the power ψᵀλ of the drift is then in P."""
    tied = off(name)
    system, ties = tied.system, tied.ties
    parts = channels(system)
    motion = forward(system, parts, tied.bound)
    udot, lam = (v[:, 0] for v in tied.evaluate(motion.udot, motion.multipliers))
    accuracy = min(1e-9, 1e-13 * condition(tied))
    assert_close(udot, ties.udot, accuracy, 100.0)
    assert_close(lam, ties.multipliers(ties.udot), accuracy, 100.0)
    k = terms(system, system.udot_all, parts, None, tied.bound)
    *found, drift = tied.evaluate(*rate_forms(system, k), k.correction_power, udot=udot)
    scale = size(tied, udot, lam) * max(1.0, condition(tied) / 100)
    for function, epsilon in zip(NAMES, found, strict=True):
        assert abs(scalar(epsilon)) < ROUNDING * scale, function
    assert_close(drift, ties.psi @ lam, accuracy, scale)
    assert abs(scalar(drift)) > 1e-6  # and it is not that nothing drifted


@pytest.mark.parametrize("name", EXAMPLES)
def test_complement_of_every_kind(name: str) -> None:
    """J R = 0, A R = 0, J v_t = −f_t, A v_t = −b."""
    ties = off(name).ties
    h = ties.holonomic
    assert largest(ties.J @ ties.R) < 1e-13 * 10 and largest(ties.A @ ties.R) < 1e-13 * 10
    assert_close(ties.J @ ties.v_t, -ties.c[h], 1e-13, 10.0)
    assert_close(ties.A @ ties.v_t, -ties.c[~h], 1e-13, 10.0)
    assert ties.R_hat.shape[1] == len(off(name).book.free) - len(ties.names)


@pytest.mark.parametrize("alpha_beta", [(3.0, 0.0), (0.0, 5.0), (10.0, 20.0)])
def test_baumgarte_adds_its_terms(alpha_beta: tuple[float, float]) -> None:
    """G u̇ + γ = −2αψ − β²φ off the constraints."""
    tied = off("weld")
    alpha, beta = alpha_beta
    rows = tied.bound.rows
    motion = forward(tied.system, channels(tied.system), tied.bound, alpha_beta)
    free = [int(i) for i in tied.sample.mechanism.free.u]
    phi_ddot = ca.mtimes(rows.G, motion.udot[free]) + rows.gamma
    found, phi, psi = tied.evaluate(phi_ddot, rows.phi, rows.psi)
    assert_close(found, -2 * alpha * psi - beta**2 * phi, 1e-11, 100.0)


def test_reactions_balance_newton_and_euler() -> None:
    """M u̇ + h = τ + driving + Gᵀλ at every speed, driven ones too."""
    tied = off("gear on a driven shaft")
    system = tied.system
    parts = channels(system)
    motion = forward(system, parts, tied.bound)
    missing = rnea(system, motion.udot) - total_force(system, parts) - motion.driving
    left = missing - ca.mtimes(tied.bound.rows.G_all.T, motion.multipliers)
    (energy_error,) = tied.evaluate(left)
    assert largest(energy_error) < 1e-12 * 100
