"""The four testing functions in rate form, ε = Ė − P, on random mechanisms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given

from deltac.dynamics.forces import channels
from deltac.dynamics.system import trace
from deltac.dynamics.terms import Reactions, forward, terms
from deltac.dynamics.testing_functions import TESTING_FUNCTIONS
from tests.support.rate_forms import NAMES, ROUNDING, rate_forms, scale_of
from tests.systems.random_mechanisms import Sample, samples, scalar


@given(samples())
def test_exact_motion_closes(sample: Sample) -> None:
    system, book = trace(sample.mechanism), sample.book
    parts = channels(system)
    (udot,) = sample.evaluate(system, forward(system, parts).udot)
    udot = udot[:, 0]
    k = terms(system, system.udot_all, parts)
    found = sample.evaluate(system, *rate_forms(system, k), udot=udot)
    scale = scale_of(book, udot) * max(1.0, np.abs(udot).max(initial=0.0) / 10)
    for name, epsilon in zip(NAMES, found, strict=True):
        assert abs(scalar(epsilon)) < ROUNDING * scale, name


@given(samples())
def test_wrong_accelerations_show_as_the_missing_power(sample: Sample) -> None:
    """ε = −Σ u_r (F_r + F*_r) in the inertial forms, by the textbook's Kane equations."""
    system, book = trace(sample.mechanism), sample.book
    k = terms(system, system.udot_all, channels(system))
    found = sample.evaluate(system, *rate_forms(system, k))
    expected = -book.u[book.free] @ (book.F_r + book.F_r_star(sample.udot))
    scale = scale_of(book, sample.udot)
    for name, epsilon in zip(NAMES, found, strict=True):
        assert abs(scalar(epsilon) - expected) < ROUNDING * scale, name


@given(samples())
def test_wang_with_a_measured_driving_force_sees_errors_along_v_t(sample: Sample) -> None:
    """With F′ known independently of wrong accelerations, ε = −vᵀ(F + F* + F′)."""
    system, book = trace(sample.mechanism), sample.book
    measured = book.driving(book.udot)
    reactions = Reactions(ca.SX(ca.DM(measured)), ca.SX(0, 1))
    k = terms(system, system.udot_all, channels(system), reactions=reactions)
    epsilon = sample.evaluate(system, *rate_forms(system, k))[NAMES.index("wang")]
    F_prime = book.F_prime(book.udot)
    expected = -book.v @ (book.F + book.F_star(sample.udot) + F_prime)
    scale = scale_of(book, sample.udot) + float(np.abs(F_prime) @ np.abs(book.v))
    assert abs(scalar(epsilon) - expected) < ROUNDING * scale


@given(samples())
def test_the_textbook_closes_by_itself(sample: Sample) -> None:
    """K̇ + V̇ = Q̇ and K̇ = Σ F_r u_r + F_0 in the dense matrices (2.5.67-2.5.71 of the thesis)."""
    book = sample.book
    udot = book.udot
    scale = scale_of(book, udot) * max(1.0, np.abs(udot).max(initial=0.0) / 10)
    assert abs(book.K_dot(udot) + book.V_dot() - book.Q_dot(udot)) < ROUNDING * scale
    power = book.u[book.free] @ book.F_r + book.F_0(udot)
    assert abs(book.K_dot(udot) - power) < ROUNDING * scale


@pytest.mark.parametrize("name", NAMES)
def test_every_function_names_its_paper(name: str) -> None:
    assert TESTING_FUNCTIONS[name].name == name
    assert any(year in TESTING_FUNCTIONS[name].source for year in ("1988", "1990", "1993", "1995"))
