"""LDLᵀ, the Schur complement and the rank study against NumPy's dense linear algebra."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import deltac as dc
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.independence import independence, row_names
from deltac.dynamics.kkt import LEAST_PIVOT, factorise, schur
from deltac.mechanism.mechanism import Mechanism
from tests.systems.constrained_mechanisms import Tied, four_bar, parallelogram
from tests.systems.random_mechanisms import Sample, assert_close

Array = NDArray[Any]

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 9)


def spd(rng: np.random.Generator, n: int, density: float) -> Array:
    """A sparse symmetric positive definite matrix with a condition of some tens."""
    lower = np.tril(rng.normal(size=(n, n)) * (rng.random((n, n)) < density), -1) / np.sqrt(n)
    unit = lower + np.eye(n)
    return np.asarray(unit @ np.diag(rng.uniform(0.5, 2, n)) @ unit.T)


def sparse(A: Array) -> Any:
    """Symbols at the entries that are not zero, and the function that puts numbers in."""
    return ca.SX.sym("A", ca.DM(A).sparsity() if A.all() else ca.sparsify(ca.DM(A)).sparsity())


def column(entries: list[Any]) -> Any:
    return ca.vertcat(*(ca.SX(0) if e is None else e for e in entries))


@given(seeds, sizes, st.sampled_from([0.2, 0.5, 1.0]))
def test_factors_multiply_to_the_matrix(seed: int, n: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    A = spd(rng, n, density)
    symbols = sparse(A)
    factor = factorise(symbols)
    L = ca.SX.eye(n)
    for i, row in enumerate(factor.L):
        for j, entry in row.items():
            L[i, j] = entry
    b = rng.normal(size=n)
    x = column(factor.solve([ca.SX(float(e)) for e in b]))
    f = ca.Function(
        "f", [symbols], [ca.densify(L), ca.vertcat(*factor.d), x, factor.smallest_pivot]
    )
    lower, d, x_found, pivot = (np.array(v) for v in f(ca.sparsify(ca.DM(A))))
    accuracy = 1e-15 * n * np.linalg.cond(A)
    assert_close(lower @ np.diag(d[:, 0]) @ lower.T, A, accuracy)
    assert_close(x_found[:, 0], np.linalg.solve(A, b), accuracy)
    # d_i/A_ii is what the rows before leave of row i: 1 − R², by NumPy.
    left = [1 / (A[i, i] * np.linalg.inv(A[: i + 1, : i + 1])[i, i]) for i in range(n)]
    assert_close(pivot.item(), min(1.0, *left), accuracy)


@given(seeds, st.integers(2, 8), st.sampled_from([0.3, 1.0]))
def test_constrained_systems_against_the_dense_matrix(seed: int, n: int, density: float) -> None:
    """[[M, −Gᵀ], [G, 0]] (u̇, λ) = (r, −γ) in one piece."""
    rng = np.random.default_rng(seed)
    rows = int(rng.integers(1, n))
    M, G = spd(rng, n, density), rng.normal(size=(rows, n)) * (rng.random((rows, n)) < 0.7)
    G[np.arange(rows), np.arange(rows)] += 2.0
    r, gamma = rng.normal(size=n), rng.normal(size=rows)
    whole = np.block([[M, -G.T], [G, np.zeros((rows, rows))]])
    expected = np.linalg.solve(whole, np.concatenate([r, -gamma]))
    found = schur(sparse_numbers(M), sparse_numbers(G))
    r_, gamma_ = ca.SX(ca.DM(r)), ca.SX(ca.DM(gamma))
    lam = found.multipliers(r_, gamma_)
    udot = found.free_response(r_) + found.response(lam)
    accuracy = 1e-14 * np.linalg.cond(whole)
    assert_close(numbers(udot)[:, 0], expected[:n], accuracy)
    assert_close(numbers(lam)[:, 0], expected[n:], accuracy)
    # Projection: G Δ = −violation, with nothing in the metric's complement of the rows.
    least = numbers(found.least(gamma_))[:, 0]
    assert_close(G @ least, -gamma, accuracy)
    null = np.linalg.svd(G)[2][np.linalg.matrix_rank(G) :]
    assert_close(null @ M @ least, np.zeros(len(null)), accuracy, np.abs(least).max() + 1)


def sparse_numbers(A: Array) -> Any:
    return ca.SX(ca.sparsify(ca.DM(A)))


def numbers(expression: Any) -> Array:
    return np.array(ca.DM(expression))


@pytest.mark.parametrize("nearly", [1e-1, 1e-3, 1e-6])
def test_the_pivot_falls_with_the_square_of_the_distance_to_dependence(nearly: float) -> None:
    """Two unit rows at a small angle ε leave 1 − cos² ε of the second."""
    G = np.array([[1.0, 0, 0], [np.cos(nearly), np.sin(nearly), 0]])
    pivot = numbers(schur(ca.SX.eye(3), ca.SX(ca.DM(G))).smallest_pivot).item()
    assert pivot == pytest.approx(np.sin(nearly) ** 2, rel=1e-3, abs=1e-15)


def test_the_pivot_of_dependent_rows_is_at_rounding() -> None:
    rng = np.random.default_rng(2)
    G = rng.normal(size=(3, 5))
    G = np.vstack([G, G[0] - 2 * G[2]])
    M = spd(rng, 5, 1.0)
    pivot = numbers(schur(ca.SX(ca.DM(M)), ca.SX(ca.DM(G))).smallest_pivot).item()
    assert abs(pivot) < 1e-13


@pytest.mark.parametrize(
    ("size", "flagged"), [(1.0, False), (1e-3, False), (1e-6, True), (0, True)]
)
def test_a_row_that_vanishes_is_flagged_though_it_keeps_its_direction(
    size: float, flagged: bool
) -> None:
    """At 1e-6 of the other row, the errors of a step turn it about; at 1e-3 it may be a matter of units."""
    G = np.array([[size, 0, 0], [0, 1.0, 0]])
    pivot = numbers(schur(ca.SX.eye(3), ca.SX(ca.DM(G))).smallest_pivot).item()
    assert (not pivot > LEAST_PIVOT) == flagged


def test_structural_zeros_stay_zero() -> None:
    """An arrow matrix with its head last fills nothing in: L has the arrow's entries only."""
    n = 6
    A = np.eye(n) * 3
    A[-1, :] = A[:, -1] = 1.0
    A[-1, -1] = 9
    factor = factorise(ca.SX.sym("A", ca.sparsify(ca.DM(A)).sparsity()))
    assert [len(row) for row in factor.L] == [0] * (n - 1) + [n - 1]


# --- independence -------------------------------------------------------------------------------------


def study(mechanism: Mechanism, q: Any) -> Any:
    """The rank study of a mechanism at free coordinates q, at t = 0."""
    tied = Tied(Sample(mechanism, 0.0, np.asarray(q, float), np.zeros(0), np.zeros(0)))
    free = np.asarray(q, float)
    return tied.all_rows, independence(equations_of(tied.system), 0.0, free)


def test_a_four_bar_has_one_freedom() -> None:
    rows, found = study(four_bar(), parallelogram(np.pi / 2))
    assert (found.freedom, found.redundant, found.singular) == (1, (), False)
    assert len(found.independent) == len(rows) == 2


def test_a_four_bar_in_space_has_redundant_rows() -> None:
    """In a frame turned anyhow the third coordinate of the closure does not vanish by itself."""
    rows, found = study(four_bar(spatial=True), parallelogram(np.pi / 2))
    assert len(rows) > 2
    assert (len(found.independent), found.freedom) == (2, 1)
    assert row_names(rows, found.redundant) == f"{len(rows) - 2} of 'closure'"


@pytest.mark.parametrize("crank", [0.0, np.pi])
def test_a_flat_parallelogram_is_singular(crank: float) -> None:
    """All bars on a line: the two rows are parallel there, the generic rank is 2, and so it says."""
    _, found = study(four_bar(), parallelogram(crank))
    assert found.singular
    assert (found.freedom, len(found.independent)) == (1, 2)


@given(seeds)
def test_parallelograms_elsewhere_are_not(seed: int) -> None:
    crank = np.random.default_rng(seed).uniform(0.1, np.pi - 0.1)
    _, found = study(four_bar(), parallelogram(crank))
    assert not found.singular and found.freedom == 1


@given(seeds, st.integers(1, 3))
def test_repeated_and_implied_constraints_are_redundant(seed: int, copies: int) -> None:
    """Copies of gears between three axes, and the gear that follows from two of them."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.5, 2, 2)
    gears = [dc.constraints.gear("first", "x", "y", a), dc.constraints.gear("second", "y", "z", b)]
    gears += [dc.constraints.gear(f"copy{k}", "x", "z", a * b) for k in range(copies)]
    order = rng.permutation(len(gears))
    mechanism = Mechanism(
        [dc.bodies.sphere(n, float(rng.uniform(1, 2)), 0.1) for n in "xyz"],
        [dc.revolute(n, "ground", n) for n in "xyz"],
        constraints=[gears[k] for k in order],
    )
    rows, found = study(mechanism, [a * b * 0.3, b * 0.3, 0.3])
    assert len(found.independent) == 2 and len(found.redundant) == copies
    assert found.freedom == 1 and not found.singular
    named = {rows.names[k] for k in (*found.independent, *found.redundant)}
    assert named == {g.name for g in gears}


def test_redundant_rows_in_words() -> None:
    rows, found = study(
        Mechanism(
            [dc.bodies.sphere(n, 1.0, 0.1) for n in "xy"],
            [dc.revolute(n, "ground", n) for n in "xy"],
            constraints=[
                dc.constraints.gear("mesh", "x", "y", 2.0),
                dc.constraints.gear("again", "x", "y", 2.0),
            ],
        ),
        [0.2, 0.1],
    )
    assert row_names(rows, found.redundant) in ("1 of 'mesh'", "1 of 'again'")
    assert row_names(rows, (0, 1)) == "1 of 'mesh', 1 of 'again'"


def test_a_row_at_rounding_level_asks_for_nothing() -> None:
    """A point of a body on the axis of its own hinge cannot move, however the axis is turned."""
    axis = np.array([0.3, -0.7, 0.2]) / np.linalg.norm([0.3, -0.7, 0.2])
    mechanism = Mechanism(
        [dc.bodies.sphere("wheel", 1.0, 0.1)],
        [dc.revolute("hinge", "ground", "wheel", tuple(axis))],
        constraints=[
            dc.constraints.skate("edge", "wheel", point=0.4 * axis, lateral=[1, 0.4, 0.9])
        ],
    )
    _, found = study(mechanism, [0.3])
    assert found.independent == () and found.freedom == 1


@pytest.mark.parametrize(
    ("tilt", "accepted"), [(0.0, True), (1e-7, False), (3e-6, False), (1e-3, True)]
)
def test_nearly_dependent_constraints_are_refused(tilt: float, accepted: bool) -> None:
    """Two gears of which the second differs by `tilt` in a third axis: it locks that, or says nothing."""
    wheels = Mechanism(
        [dc.bodies.sphere(n, 1.0, 0.1) for n in "xyz"],
        [dc.revolute(n, "ground", n) for n in "xyz"],
        forces=[dc.forces.joint_torque(f"torque {n}", n, 1.0) for n in "xyz"],
        constraints=[
            dc.constraints.holonomic("mesh", "q.x - q.y"),
            dc.constraints.holonomic("again", f"q.x - q.y + {tilt!r}*q.z"),
        ],
    )
    if not accepted:
        with pytest.raises(dc.InputError, match="nearly dependent.*assemble"):
            dc.simulate(wheels, wheels.state(), 0.1, 0.01)
        return
    run = dc.simulate(wheels, wheels.state(), 0.1, 0.01)
    # I q̈ = 1 at each wheel; z is free without the tilt and locked with it.
    inertia = 0.4 * 1.0 * 0.1**2
    expected = [1 / inertia, 1 / inertia, 1 / inertia if tilt == 0.0 else 0.0]
    assert run.udot is not None
    np.testing.assert_allclose(run.udot[-1], expected, atol=1e-6 / inertia)
