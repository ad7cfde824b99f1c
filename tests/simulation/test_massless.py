"""Coordinates without inertia that constraints determine: a curve's parameter, of a bead on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array

G = 9.81


def bead(
    a: float = 0.5, mass: float = 1.0, rows: tuple[str, ...] = ("across", "up")
) -> dc.Mechanism:
    """A bead on x = a(s + sin s), y = a(1 − cos s); s slides on a frame without mass."""
    laws = {
        "across": "q.x - a*(q.s + sin(q.s))",
        "up": "q.y - a*(1 - cos(q.s))",
        "curve": "q.y - q.x**2",
    }
    return dc.Mechanism(
        [dc.bodies.frame("carriage"), dc.point_mass("bead", mass), dc.bodies.frame("mark")],
        [
            dc.prismatic("x", "ground", "carriage", "x"),
            dc.prismatic("y", "carriage", "bead", "y"),
            dc.prismatic("s", "ground", "mark", "x"),
        ],
        constraints=[dc.constraints.holonomic(n, laws[n]) for n in rows],
        gravity=(0, -G, 0),
        parameters={"a": a},
        name="cycloid",
    )


def at(mechanism: dc.Mechanism, s: float, rate: float = 0.0) -> dc.State:
    """The bead where the parameter is s and moves with ṡ."""
    a = mechanism.parameters["a"]
    x, y = a * (s + np.sin(s)), a * (1 - np.cos(s))
    return mechanism.state(
        {"x": x, "y": y, "s": s},
        {"x": a * (1 + np.cos(s)) * rate, "y": a * np.sin(s) * rate, "s": rate},
    )


def acceleration(a: float, s: Array, rate: Array) -> Array:
    """(ẍ, ÿ, s̈) by Lagrange's equation of s: σ = 4a sin(s/2), σ̈ = −g/(4a) σ."""
    sigma_slope, sigma = 2 * a * np.cos(s / 2), 4 * a * np.sin(s / 2)
    s_dd = (-G / (4 * a) * sigma + 0.25 * sigma * rate**2) / sigma_slope
    return np.array(
        [
            a * ((1 + np.cos(s)) * s_dd - np.sin(s) * rate**2),
            a * (np.sin(s) * s_dd + np.cos(s) * rate**2),
            s_dd,
        ]
    )


SOLVERS = {
    "ode4": 1e-10,
    "DOP853": 1e-10,
    "Radau": 1e-9,
    "IDAS": 1e-5,
    "ode1be": 0.03,
    "implicit-midpoint": 1e-4,
    "generalized-alpha": 1e-4,
    "discrete-gradient": 1e-4,
    "taylor": 1e-13,
}


@pytest.mark.parametrize(
    "solver", [pytest.param(n, marks=pytest.mark.heyoka if n == "taylor" else ()) for n in SOLVERS]
)
def test_the_cycloid_is_a_tautochrone_by_every_kind_of_solver(solver: str) -> None:
    """Huygens 1673: 4a sin(s/2) swings with √(g/4a) at any amplitude."""
    m, a, s0 = bead(), 0.5, 2.0
    run = dc.simulate(m, at(m, s0), 2.0, 2e-3, solver=solver)
    exact = 2 * np.arcsin(np.sin(s0 / 2) * np.cos(np.sqrt(G / (4 * a)) * run.t))
    assert np.abs(run.q[:, m.coordinates["s"].index] - exact).max() < SOLVERS[solver]
    ledger = dc.balance(m, run)
    order = {"ode1be": 0.5, "IDAS": 1e-4, "generalized-alpha": 1e-4, "discrete-gradient": 1e-4}.get(
        solver, 1e-9
    )
    assert max(np.abs(delta).max() for delta in ledger.delta_c.values()) < order


@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("a", [1e-4, 1.0, 1e4])
def test_no_scale_of_mass_or_length_costs_digits(a: float, mass: float) -> None:
    m, s, rate = bead(a, mass), 1.3, 0.7 * np.sqrt(G / a)
    here = dc.evaluate(m, at(m, s, rate))
    exact = acceleration(a, s, rate)  # type: ignore[arg-type]
    np.testing.assert_allclose(here.udot, exact, rtol=1e-12)
    force = mass * (exact[:2] + [0.0, G])
    np.testing.assert_allclose(here.multipliers, force, rtol=1e-11)
    np.testing.assert_array_equal(here.M, np.diag([mass, mass, 0.0]))
    run = dc.simulate(m, at(m, s, rate), 2e-3 * np.sqrt(a), 1e-3 * np.sqrt(a))
    assert run.udot is not None
    np.testing.assert_allclose(run.udot[0], exact, rtol=1e-11)
    np.testing.assert_allclose(run.forces["constraint across"][0, 0], force[0], rtol=1e-10)


@pytest.mark.long
def test_all_verbs_take_them() -> None:
    m, s0 = bead(), 1.2
    state, twin = at(m, s0), bead()
    assert dc.assemble(twin, twin.state({"s": s0}), pinned=["s"]).state.q == pytest.approx(state.q)
    small = dc.linearise(m, m.state())
    assert sorted(small.eigenvalues.imag) == pytest.approx([-np.sqrt(G / 2), np.sqrt(G / 2)])

    def equations(t: Array, q: Array, u: Array) -> Array:
        return acceleration(0.5, q[2], u[2])

    assert dc.check_equations(m, equations).verdict.kind == "consistent"
    wrong = dc.check_equations(m, lambda t, q, u: equations(t, q, u) + [[1e-3], [0], [0]])
    assert wrong.verdict.kind == "equation-error"
    own = dc.Equations(
        lambda t, q, u: equations(t, np.array([0, 0, *q]), np.array([0, 0, *u]))[2:],
        dc.CoordinateMap(("s",)),
    )
    assert dc.check_equations(m, own).verdict.kind == "consistent"
    run = dc.simulate(m, state, 1.0, 1e-3, solver="DOP853")
    by_hand = dc.simulate(m, state, 1.0, 1e-3, solver="DOP853", equations=own)
    np.testing.assert_allclose(by_hand.q, run.q, atol=1e-9)
    many = dc.simulate_ensemble(m.varying("a"), [state, state], 1.0, 1e-3)
    alone = dc.simulate(m, state, 1.0, 1e-3)
    np.testing.assert_allclose(many.q[-1], np.tile(alone.q[-1], (2, 1)), atol=1e-12)
    assert dc.audit(m, run).verdict.kind == "consistent"
    assert dc.study(m, state, 1.0, steps=[0.04, 0.02, 0.01]).verdict.kind == "consistent"


def test_a_row_that_only_records_a_motion_does_nothing() -> None:
    """x = a(s + sin s) alone determines s by x; the bead falls freely, and the row pulls at nothing."""
    m = bead(rows=("across",))
    run = dc.simulate(m, at(m, 1.0, 2.0), 0.3, 1e-3)
    x, y = run.q[:, 0], run.q[:, 1]
    np.testing.assert_allclose(x, x[0] + run.u[0, 0] * run.t, atol=1e-12)
    np.testing.assert_allclose(y, y[0] + run.u[0, 1] * run.t - 0.5 * G * run.t**2, atol=1e-12)
    assert np.abs(run.forces["constraint across"]).max() < 1e-10


def test_what_constraints_do_not_determine_is_refused_by_name() -> None:
    m = bead(rows=("curve",))
    for verb in (dc.evaluate, lambda m, state: dc.simulate(m, state, 0.1, 0.01)):
        with pytest.raises(
            dc.InputError, match=r"'s' moves no inertia.*no constraint determines"
        ) as refused:
            verb(m, m.state())
        assert refused.value.code == "E-MODEL"
    with pytest.raises(dc.InputError, match="'x'.*massless|massless.*'mark'"):
        dc.Mechanism([dc.bodies.frame("mark")], [dc.prismatic("s", "ground", "mark", "x")])


def test_a_stop_on_a_massless_coordinate_throws_the_bead_back() -> None:
    """σ̇ = 2a cos(s/2) ṡ turns round with the coefficient of restitution."""
    smooth, s0, stop, e = bead(), 1.2, -0.5, 0.7
    m = replace(smooth, events=[dc.events.joint_stop("stop", "s", lower=stop, restitution=e)])
    a, omega = m.parameters["a"], np.sqrt(G / 2)
    first = np.arccos(np.sin(stop / 2) / np.sin(s0 / 2)) / omega
    run = dc.simulate(m, at(m, s0), 1.4, 1e-3)
    assert run.events[0].t == pytest.approx(first, abs=1e-9)
    sigma = 4 * a * np.sin(stop / 2), 4 * a * np.sin(s0 / 2) * omega * np.sin(omega * first) * e
    since = omega * (run.t - run.events[0].t)
    back = sigma[0] * np.cos(since) + sigma[1] / omega * np.sin(since)
    after = since > 1e-3
    np.testing.assert_allclose(4 * a * np.sin(run.q[after, 2] / 2), back[after], atol=1e-8)
    ledger = dc.balance(m, run)
    assert max(np.abs(delta).max() for delta in ledger.delta_c.values()) < 1e-9
