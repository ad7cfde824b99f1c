"""Every solver shows what it promises, by being listed in the registry."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import combinations_with_replacement
from math import prod
from typing import Any

import mpmath
import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.simulation.solvers import SOLVERS, find_solver
from deltac.simulation.stepping.runge_kutta import tableau_of
from tests.support.slow import repeated
from tests.systems.machines import pendulum, robot

FIXED = [s.name for s in SOLVERS.values() if s.family == "fixed"]
STEPPING = [s.name for s in SOLVERS.values() if s.takes_steps]
ADAPTIVE = [s.name for s in SOLVERS.values() if s.family in ("scipy", "sundials")]

# --- Butcher's order conditions --------------------------------------------------------------------

Tree = tuple[Any, ...]


@cache
def trees(order: int) -> tuple[Tree, ...]:
    """All rooted trees with so many nodes, each the tuple of its subtrees."""
    return tuple(forest for forest in _forests(order - 1, order - 1))


def _forests(nodes: int, largest: int) -> Iterator[Tree]:
    if nodes == 0:
        yield ()
    for size in range(min(nodes, largest), 0, -1):
        for count in range(1, nodes // size + 1):
            for rest in _forests(nodes - size * count, size - 1):
                for some in combinations_with_replacement(trees(size), count):
                    yield (*some, *rest)


def nodes_of(tree: Tree) -> int:
    return 1 + sum(map(nodes_of, tree))


def density(tree: Tree) -> int:
    """γ: the product of the sizes of all subtrees."""
    return nodes_of(tree) * prod(map(density, tree))


def weight(a: Any, b: Any, tree: Tree) -> float:
    """The elementary weight Σ b_i Φ_i."""
    return float(b @ _stages(a, tree))


def _stages(a: Any, tree: Tree) -> Any:
    return prod((a @ _stages(a, child) for child in tree), start=np.ones(len(a)))


def coefficients(name: str) -> tuple[Any, Any, Any]:
    tableau = tableau_of(name)
    assert tableau is not None
    a = np.zeros((len(tableau.b), len(tableau.b)))
    for i, row in enumerate(tableau.a):
        a[i, : len(row)] = row
    return a, np.array(tableau.b), np.array(tableau.c)


def test_there_are_as_many_trees_as_cayley_counted() -> None:
    assert [len(trees(n)) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]


@pytest.mark.parametrize("name", [n for n in SOLVERS if tableau_of(n)])
def test_tableaus_meet_the_order_conditions_and_no_more(name: str) -> None:
    """Hairer, Nørsett, Wanner, theorem II.2.13; to rounding of the coefficients."""
    a, b, c = coefficients(name)
    order = SOLVERS[name].order
    assert order is not None
    np.testing.assert_allclose(a.sum(axis=1), c, atol=1e-14)
    for n in range(1, order + 1):
        for tree in trees(n):
            assert abs(weight(a, b, tree) - 1 / density(tree)) < 1e-13, tree
    assert max(abs(weight(a, b, tree) - 1 / density(tree)) for tree in trees(order + 1)) > 1e-7


@pytest.mark.parametrize("name", FIXED)
def test_stages_are_counted(name: str) -> None:
    calls: list[float] = []

    def f(t: float, x: Any) -> Any:
        calls.append(t)
        return -x

    solver = SOLVERS[name]
    assert solver.step is not None
    halves = (slice(0, 1), slice(1, 2), slice(2, 2))
    solver.step(f, 0.0, np.array([1.0, 2.0]), 0.1, halves)
    assert len(calls) == solver.stages


# --- observed order --------------------------------------------------------------------------------


CONSERVATIVE = ("discrete-gradient",)
"""Solvers that refuse what is driven in time."""


@cache
def reference(driven: bool) -> Any:
    """By another family of methods: Taylor's, and for those that conserve energy Runge and Kutta's."""
    mechanism, state = robot(driven)
    step, solver = (1.28, "taylor") if driven else (1.28 / 1024, "ode8")
    return dc.simulate(mechanism, state, 1.28, step, solver, record=())


@pytest.mark.heyoka
@pytest.mark.parametrize("name", STEPPING)
def test_order_by_slope(name: str) -> None:
    """log2 of the ratio of state errors, in the finest pair of steps that is clear of rounding."""
    driven = name not in CONSERVATIVE
    mechanism, state = robot(driven)
    end = reference(driven)
    errors, steps = [1.0], 32
    # Implicit steps cost the more; second order shows well before rounding.
    finest = 1024 if SOLVERS[name].family == "fixed" else 256
    while len(errors) < 3 or (errors[-1] > 1e-12 and steps <= finest):
        run = dc.simulate(mechanism, state, 1.28, 1.28 / steps, name, record=())
        found = np.concatenate([run.q[-1] - end.q[-1], run.u[-1] - end.u[-1]])
        errors.append(float(np.abs(found).max()))
        steps *= 2
    clear = [e for e in errors[1:] if e > 1e-13]
    slope = np.log2(clear[-2] / clear[-1])
    assert slope == pytest.approx(SOLVERS[name].order, abs=0.15), errors


# --- against Jacobi's elliptic functions -----------------------------------------------------------

AMPLITUDE = 2.0


def swing(t: float) -> tuple[float, float]:
    """Angle and rate of the pendulum released at rest, to 30 digits."""
    with mpmath.workdps(30):
        w = mpmath.sqrt(mpmath.mpf(9.81) / mpmath.mpf(0.5))
        k = mpmath.sin(mpmath.mpf(AMPLITUDE) / 2)
        m = k**2
        sine = k * mpmath.ellipfun("cd", w * mpmath.mpf(t), m=m)
        rate = -2 * w * k * mpmath.sqrt(1 - m) * mpmath.ellipfun("sd", w * mpmath.mpf(t), m=m)
        return float(2 * mpmath.asin(sine)), float(rate)


@pytest.mark.heyoka
@pytest.mark.parametrize(("name", "tolerance"), [("taylor", 1e-12), ("taylor-quad", 1e-14)])
def test_taylor_against_elliptic_functions(name: str, tolerance: float) -> None:
    mechanism = pendulum()
    run = dc.simulate(mechanism, mechanism.state({"hinge": AMPLITUDE}), 10.0, 0.5, name)
    expected = np.array([swing(t) for t in run.t])
    assert len(run) == 21
    assert np.abs(run.q[:, 0] - expected[:, 0]).max() < tolerance * AMPLITUDE
    assert np.abs(run.u[:, 0] - expected[:, 1]).max() < tolerance * 10.0
    assert run.udot is not None
    assert np.abs(run.udot[:, 0] + 9.81 / 0.5 * np.sin(run.q[:, 0])).max() < 1e-13 * 20


@pytest.mark.heyoka
def test_taylor_integrator_is_made_once_and_runs_in_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Runs do not disturb each other, whether they follow or overlap: bit for bit the same."""
    import heyoka

    made: list[Any] = []
    make = heyoka.taylor_adaptive

    def counted(*args: Any, **named: Any) -> Any:
        made.append(1)
        return make(*args, **named)

    monkeypatch.setattr(heyoka, "taylor_adaptive", counted)
    monkeypatch.setenv("DELTAC_CACHE", "off")
    mechanism = pendulum(damping=0.037)  # no other test's

    def end(angle: float) -> tuple[float, float]:
        run = dc.simulate(mechanism, mechanism.state({"hinge": angle}), 5.0, 0.5, "taylor")
        return float(run.q[-1, 0]), float(run.u[-1, 0])

    angles = [0.1 * k for k in range(1, 13)]
    alone = [end(angle) for angle in angles]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(end, angles))
    assert together == alone
    assert len(set(alone)) == len(alone)
    assert len(made) == 1


@pytest.mark.parametrize("name", ADAPTIVE)
def test_adaptive_solvers_follow_their_tolerance(name: str) -> None:
    """The global error falls with the tolerance, and stays within the growth factor of 2 s of motion."""
    mechanism = pendulum()
    start = mechanism.state({"hinge": AMPLITUDE})
    angle, rate = swing(2.0)
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        run = dc.simulate(mechanism, start, 2.0, None, dc.solvers.by_name(name, tolerance), ())
        errors.append(max(abs(run.q[-1, 0] - angle), abs(run.u[-1, 0] - rate)))
        assert run.t[-1] == 2.0
        assert errors[-1] < 1000 * tolerance  # multistep methods accumulate most
    # SUNDIALS changes the order as it goes: at loose tolerances its errors fall by fits and starts.
    least = 2 if SOLVERS[name].family == "sundials" else 10
    assert errors[0] > least * errors[1] and errors[1] > least * errors[2]
    assert errors[0] > 100 * errors[2]


@pytest.mark.parametrize(
    "name", repeated(["DOP853", "Radau", "CVODES", "IDAS"], "DOP853", "CVODES", "IDAS")
)
def test_adaptive_solvers_on_every_kind_of_joint(name: str) -> None:
    """Methods of different families agree where no closed form is known."""
    mechanism, state = robot()
    fine = dc.simulate(mechanism, state, 0.5, 0.5 / 512, "ode8", record=512)
    run = dc.simulate(mechanism, state, 0.5, 0.1, dc.solvers.by_name(name, 1e-8))
    np.testing.assert_allclose(run.t, np.linspace(0, 0.5, 6), atol=1e-15)
    assert np.abs(run.q[-1] - fine.q[-1]).max() < 1e-6
    assert np.abs(run.u[-1] - fine.u[-1]).max() < 1e-6
    for function, value in run.integrals.items():
        assert value[-1] == pytest.approx(fine.integrals[function][-1], abs=1e-6)


def test_samples_of_adaptive_solvers_are_where_they_were_asked() -> None:
    mechanism = pendulum()
    start = mechanism.state({"hinge": 1.0}, t=1.0)
    run = dc.simulate(mechanism, start, 1.0, 0.3, "RK45")
    np.testing.assert_allclose(run.t, [1.0, 1.3, 1.6, 1.9, 2.0], rtol=1e-15)
    own = dc.simulate(mechanism, start, 1.0, None, "RK45")
    assert len(own) > 5
    assert own.t[0] == 1.0 and own.t[-1] == 2.0


# --- exact facts -----------------------------------------------------------------------------------


@pytest.mark.parametrize("work", ["in-loop", "samples", "discrete"])
def test_semi_implicit_free_fall_loses_half_h_m_g_squared_t(work: str) -> None:
    """K + V − Q = −½ h m g² T (theory: −4.81180 J per kg), whichever way Q is taken: nothing flows."""
    m, g, h, T = 1.0, 9.81, 0.01, 10.0
    mechanism = dc.Mechanism(
        [dc.point_mass("stone", m)],
        [dc.prismatic("fall", "ground", "stone", "z")],
        gravity=[0, 0, -g],
    )
    run = dc.simulate(mechanism, mechanism.state(), T, h, "semi-implicit-euler")
    ledger = dc.balance(mechanism, run, work=work)
    scale = 0.5 * m * (g * T) ** 2  # energies that cancel
    np.testing.assert_allclose(
        ledger.delta_c["wang"], -0.5 * h * m * g**2 * run.t, atol=1e-13 * scale
    )
    assert ledger.delta_c["wang"][-1] == pytest.approx(-4.811805, abs=1e-6)


def test_euler_in_free_fall() -> None:
    """q_k = −½ g h² k(k−1), u_k = −g h k: by hand."""
    mechanism = dc.Mechanism(
        [dc.point_mass("stone", 3.0)],
        [dc.prismatic("fall", "ground", "stone", "z")],
        gravity=[0, 0, -9.81],
    )
    run = dc.simulate(mechanism, mechanism.state(), 1.0, 0.1, "euler")
    k = np.arange(11)
    np.testing.assert_allclose(run.q[:, 0], -0.5 * 9.81 * 0.01 * k * (k - 1), atol=1e-14)
    np.testing.assert_allclose(run.u[:, 0], -9.81 * 0.1 * k, atol=1e-14)


# --- names -----------------------------------------------------------------------------------------


def test_aliases_lead_to_their_solver_and_nowhere_else() -> None:
    for solver in SOLVERS.values():
        for name in (solver.name, *solver.aliases):
            assert find_solver(name) is solver
    assert set(dc.solver_names()) == set(SOLVERS)


def test_an_unknown_solver_lists_all() -> None:
    with pytest.raises(InputError) as caught:
        find_solver("ode45")
    assert "'ode45'" in str(caught.value)
    for solver in SOLVERS.values():
        for name in (solver.name, *solver.aliases):
            assert name in str(caught.value)
