"""Results of general ODE solvers as trajectories, and functions of (t, y) as equations."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import odeint, solve_ivp

import deltac as dc

L, G = 0.8, 9.81


@pytest.fixture(scope="module")
def chain() -> dc.Mechanism:
    """Two particles on rods without mass, of length L; relative angles a, b."""
    return dc.Mechanism(
        [dc.point_mass("upper", 1.0, at=(0, -L, 0)), dc.point_mass("lower", 1.0, at=(0, -L, 0))],
        [dc.revolute("a", "ground", "upper"), dc.revolute("b", "upper", "lower", position=(0, -L, 0))],
        gravity=(0, -G, 0),
    )  # fmt: skip


def relative(t: float, y: Any) -> Any:
    """Lagrange's equations in relative angles."""
    a, b, u, v = y
    s, c = np.sin(b), np.cos(b)
    M = np.array([[3 + 2 * c, 1 + c], [1 + c, 1.0]])
    h = np.array([-s * (2 * u * v + v * v), s * u * u])
    g = G / L * np.array([2 * np.sin(a) + np.sin(a + b), np.sin(a + b)])
    return np.array([u, v, *np.linalg.solve(M, -h - g)])


def absolute(t: float, y: Any) -> Any:
    """The same in absolute angles."""
    first, second, u, v = y
    rates = relative(t, [first, second - first, u, v - u])
    return np.array([u, v, rates[2], rates[2] + rates[3]])


def in_order(order: tuple[int, ...]) -> Any:
    def f(t: float, y: Any) -> Any:
        state = np.empty(4, dtype=np.asarray(y).dtype)
        state[list(order)] = y
        return relative(t, state)[list(order)]

    return f


ORDERS: dict[tuple[int, ...], Any] = {
    (0, 1, 2, 3): None,
    (2, 3, 0, 1): None,
    (0, 2, 1, 3): "interleaved",
    (1, 2, 0, 3): ("b", "u.a", "q.a", "u.b"),
}
START = np.array([1.5, 1.0, 0.0, 0.0])


@pytest.mark.parametrize("order", ORDERS)
def test_orders_are_found_or_told(order: tuple[int, ...], chain: dc.Mechanism) -> None:
    f, told = in_order(order), ORDERS[order]
    result = solve_ivp(f, (0, 2), START[list(order)], rtol=1e-9, atol=1e-9)
    usual = solve_ivp(relative, (0, 2), START, rtol=1e-9, atol=1e-9)
    run = dc.Trajectory.from_scipy(result, chain, equations=f, order=told)
    assert run.q[-1] == pytest.approx(usual.y[:2, -1], abs=1e-6)
    assert run.u[-1] == pytest.approx(usual.y[2:, -1], abs=1e-6)
    assert run.udot is not None
    assert run.udot[0] == pytest.approx(relative(0.0, START)[2:], rel=1e-12)
    audited = dc.audit(chain, run)
    assert (audited.verdict.kind, audited.relative < 1e-7) == ("consistent", True)
    # The same function in our own solver, with the order told or found out.
    own = dc.simulate(
        chain,
        chain.state({"a": 1.5, "b": 1.0}),
        2.0,
        0.01,
        equations=dc.Equations(f, form="ode", order=told),
    )
    assert own.q[-1] == pytest.approx(usual.y[:2, -1], abs=1e-6)


def test_coarse_tolerances_are_the_solvers(chain: dc.Mechanism) -> None:
    result = solve_ivp(relative, (0, 10), START)
    assert dc.audit(chain, result).verdict.kind == "integration-error"
    run = dc.Trajectory.from_scipy(result, chain, equations=relative)
    assert dc.audit(chain, run).verdict.kind == "integration-error"


@pytest.mark.long
def test_rows_between_steps_accuse_nobody(chain: dc.Mechanism) -> None:
    times = np.linspace(0, 10, 1001)
    result = solve_ivp(relative, (0, 10), START, t_eval=times)
    found = dc.audit(chain, result)
    assert found.verdict.kind == "unresolved"
    dense = solve_ivp(relative, (0, 10), START, t_eval=times, dense_output=True)
    assert dc.audit(chain, dense).verdict.kind == "integration-error"


def test_wrong_equations_are_the_equations(chain: dc.Mechanism) -> None:
    def wrong(t: float, y: Any) -> Any:
        rates = relative(t, y)
        rates[3] += 0.1 * np.sin(y[0] + y[1])
        return rates

    result = solve_ivp(wrong, (0, 5), START, rtol=1e-9, atol=1e-9)
    run = dc.Trajectory.from_scipy(result, chain, equations=wrong)
    assert dc.audit(chain, run).verdict.kind == "equation-error"


def test_absolute_angles(chain: dc.Mechanism) -> None:
    result = solve_ivp(absolute, (0, 2), [1.5, 2.5, 0.1, 0.3], rtol=1e-9, atol=1e-9)
    for equations in (absolute, None):
        run = dc.Trajectory.from_scipy(result, chain, coordinates="absolute", equations=equations)
        assert run.q[0] == pytest.approx([1.5, 1.0])
        assert run.u[0] == pytest.approx([0.1, 0.2])
        assert dc.audit(chain, run).verdict.kind == "consistent"


@pytest.mark.long
def test_pairs_of_arrays_and_other_results(chain: dc.Mechanism) -> None:
    t = np.linspace(0, 2, 401)
    y = odeint(relative, START, t, tfirst=True, rtol=1e-10, atol=1e-10)
    diffrax = SimpleNamespace(ts=t, ys=y)
    for source in ((t, y), (t, y.T), [t[::-1], y[::-1]], diffrax):
        run = dc.Trajectory.from_scipy(source, chain)  # type: ignore[arg-type]
        assert run.q == pytest.approx(y[:, :2])
        found = dc.audit(chain, source, time_limit=1e-3)  # type: ignore[arg-type]
        assert found.relative < 1e-6


def test_prescribed_joints_follow_their_laws() -> None:
    arm = dc.Mechanism(
        [dc.body("crank", 1.0, inertia=(1, 1, 1)), dc.point_mass("bob", 1.0, at=(0, -L, 0))],
        [
            dc.revolute("drive", "ground", "crank", motion="2*t"),
            dc.revolute("hinge", "crank", "bob", position=(0.5, 0, 0)),
        ],
        gravity=(0, -G, 0),
    )
    model = dc.simulate(arm, arm.state({"hinge": 0.3}), 1.0, 0.01)
    udot = np.interp(0.5, model.t, model.udot[:, 1]) if model.udot is not None else 0.0
    run = dc.Trajectory.from_scipy((model.t, np.c_[model.q[:, 1], model.u[:, 1]]), arm)
    assert run.q == pytest.approx(model.q)
    assert run.u == pytest.approx(model.u)
    assert np.isfinite(udot)


@pytest.mark.parametrize(
    ("f", "expected"),
    [
        (lambda t, y: [2 * y[2], y[3], *relative(t, y)[2:]], "E-SOURCE"),  # wrong rates
        (lambda t, y: relative(t, y)[2], "E-SOURCE"),  # one number
        (lambda t, y: relative(t, y)[:3], "E-SOURCE"),  # three
        (lambda t, y, extra: relative(t, y), None),  # too many arguments: its own error
        (dc.Equations(relative, order=("a", "b", "u.a", "u.c")), "E-NAME"),
        (dc.Equations(relative, order=("a", "b", "u.a", "a")), "E-SOURCE"),
        (dc.Equations(relative, order="a,b"), "E-SOURCE"),
        (dc.Equations(relative, order=("b", "a", "u.a", "u.b")), "E-SOURCE"),  # a wrong order
    ],
)
def test_functions_that_do_not_fit(f: Any, expected: str | None, chain: dc.Mechanism) -> None:
    start = chain.state({"a": 0.3})
    with pytest.raises(Exception) as raised:
        dc.simulate(chain, start, 1.0, 0.1, equations=f)
    if expected is not None:
        assert isinstance(raised.value, dc.InputError)
        assert raised.value.code == expected


def test_states_that_do_not_fit(chain: dc.Mechanism) -> None:
    t = np.linspace(0, 1, 20)
    with pytest.raises(dc.InputError, match="entries: a, b, u.a, u.b") as raised:
        dc.Trajectory.from_scipy((t, np.zeros((20, 6))), chain)
    assert raised.value.code == "E-LOG"
    rng = np.random.default_rng(1)
    with pytest.raises(dc.InputError, match="order=") as raised:
        dc.audit(chain, (t, rng.standard_normal((20, 4))))
    assert raised.value.code == "E-LOG"
    with pytest.raises(dc.InputError) as raised:
        dc.Trajectory.from_scipy(3.0, chain)  # type: ignore[arg-type]
    assert raised.value.code == "E-TYPE"
    with pytest.raises(dc.InputError, match="ode"):
        dc.Equations(relative, form="dae")
