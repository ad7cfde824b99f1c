"""Runs with constraints: they stay on them, keep their order, pass singular places, and book it all."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deltac as dc
from deltac.energy import balance
from deltac.errors import InputError
from deltac.simulation.solvers import SOLVERS
from tests.support.slow import ONE_OF_A_KIND, crossed, repeated
from tests.systems.linkages import ALL, disc, four_bars, linkage, worst

STEPPING = [s.name for s in SOLVERS.values() if s.takes_steps]
PROJECTABLE = ["RK45", "DOP853", "Radau"]
Make = Callable[[], tuple[dc.Mechanism, dc.State]]


def pendulum_of(count: int, t: Any) -> Any:
    """Crank angle and rate of A02's parallelograms: I q̈ = −Mc cos q, by SciPy at 1e-13."""
    inertia, moment = (count + 1) / 3 + count, ((count + 1) / 2 + count) * 9.81
    found = solve_ivp(
        lambda _, y: [y[1], -moment / inertia * np.cos(y[0])],
        (0, float(np.max(t))),
        [np.pi / 2, -1.0],
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
        t_eval=np.atleast_1d(t),
    )
    return found.y


# --- projection ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [linkage, disc])
def test_projected_runs_stay_on_their_constraints(make: Make) -> None:
    """Ten seconds at a coarse step: φ and ψ at rounding of the lengths and speeds at every sample."""
    mechanism, state = make()
    ledger = balance(mechanism, dc.simulate(mechanism, state, 10.0, 0.005, "ode4"))
    assert worst(ledger, "position") < 1e-14
    assert worst(ledger, "velocity") < 1e-12
    assert ledger.energy_exchanged > 1.0


def test_ideal_constraints_do_no_work_in_a_run() -> None:
    mechanism, state = linkage()
    ledger = balance(mechanism, dc.simulate(mechanism, state, 1.0, 0.005, "ode5"))
    assert np.abs(ledger.power["constraint closure"]).max() == 0.0


def test_what_projection_does_is_booked() -> None:
    """The functions close to the solver's order though projection moves the energy by more."""
    mechanism, state = linkage()
    ledger = balance(mechanism, dc.simulate(mechanism, state, 4.0, 0.02, "ode3", ALL))
    moved = np.abs(ledger.work["correction projection"]).max()
    without = np.abs(ledger.delta_c["wang"] + ledger.work["correction projection"]).max()
    assert moved > 1e-3
    assert abs(without - np.abs(ledger.delta_c["wang"]).max()) > 0.1 * moved


# --- order --------------------------------------------------------------------------------------------


@cache
def exact(make: Make, T: float) -> np.ndarray:
    """The end of the motion by the Taylor method, which is not projected and needs no projection."""
    mechanism, state = make()
    run = dc.simulate(mechanism, state, T, T, "taylor", ())
    return np.concatenate([run.q[-1], run.u[-1]])


def one_four_bar() -> tuple[dc.Mechanism, dc.State]:
    return four_bars(1)


@pytest.mark.heyoka
@pytest.mark.parametrize("name", repeated(STEPPING, *ONE_OF_A_KIND))
@pytest.mark.parametrize(
    ("make", "T"),
    [(one_four_bar, 0.6), pytest.param(disc, 0.4, marks=pytest.mark.slow)],
    ids=["four-bar", "rolling"],
)
def test_order_with_projection(name: str, make: Make, T: float) -> None:
    """log2 of the ratio of state errors, in the finest pair of steps that is clear of rounding."""
    mechanism, state = make()
    order = SOLVERS[name].order
    assert order is not None
    steps = 4 if order > 3 else 64
    errors: list[float] = []
    while not errors or (errors[-1] > 1e-13 and steps <= 1024):
        run = dc.simulate(mechanism, state, T, T / steps, name, ())
        found = np.concatenate([run.q[-1], run.u[-1]])
        errors.append(float(np.abs(found - exact(make, T)).max()))
        steps *= 2
    clear = [e for e in errors if e > 1e-13]
    assert np.log2(clear[-2] / clear[-1]) == pytest.approx(order, abs=0.15), errors


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("name", "first"),
    [("ode2", 128), pytest.param("ode4", 32, marks=pytest.mark.slow), ("ode5", 32)],
)
@pytest.mark.parametrize(
    "constraints",
    ["projection", pytest.param(None, marks=pytest.mark.slow), dc.Baumgarte(20.0, 20.0)],
)
def test_delta_c_falls_with_the_order(name: str, first: int, constraints: Any) -> None:
    """ΔC under step halving: between p and p + 1."""
    mechanism, state = disc()
    order = SOLVERS[name].order or 0
    found = []
    for steps in (first, 2 * first):
        run = dc.simulate(mechanism, state, 0.4, 0.4 / steps, name, ALL, constraints=constraints)
        delta = balance(mechanism, run).delta_c
        found.append([np.abs(delta[function]).max() for function in ALL])
    slopes = np.log2(np.divide(found[0], found[1]))
    assert (slopes > order - 0.2).all() and (slopes < order + 1.2).all(), slopes


# --- Baumgarte, and nothing at all --------------------------------------------------------------------


def nudged() -> tuple[dc.Mechanism, dc.State]:
    """The crank-rocker, its speeds off the constraint by as much as a start may be."""
    mechanism, state = linkage()
    u = state.u + np.array([0.0, 0.0, 8e-7])
    return mechanism, mechanism.state(state.q, u)


@pytest.mark.parametrize("constraints", [None, dc.Baumgarte(4.0, 4.0)])
def test_drift_is_explained_by_its_channel(constraints: Any) -> None:
    """ψᵀλ of a motion that violates its constraints feeds the energy; P holds it, so ΔC closes.

    Left out, it would pass for a wrong model: no step size makes it fall.
    """
    mechanism, state = nudged()
    missing = []
    for h in (0.004, 0.002):
        run = dc.simulate(mechanism, state, 1.0, h, "ode8", ALL, constraints=constraints)
        ledger = balance(mechanism, run)
        for function in ALL:
            assert np.abs(ledger.delta_c[function]).max() < 5 * ledger.error_bar[function].max()
        without = ledger.delta_c["wang"] + ledger.work["correction drift"]
        missing.append(np.abs(without).max())
        assert missing[-1] > 1e4 * ledger.error_bar["wang"].max()
    assert missing[0] == pytest.approx(missing[1], rel=1e-2)


def test_baumgarte_calms_and_none_drifts() -> None:
    """φ and ψ of the nudged start: they grow without stabilisation, and die out with it."""
    mechanism, state = nudged()
    position = {}
    for constraints in (None, dc.Baumgarte(10.0, 10.0), "projection"):
        run = dc.simulate(mechanism, state, 3.0, 0.002, "ode5", (), constraints=constraints)
        ledger = balance(mechanism, run, testing=("wang",))
        position[constraints] = ledger.violation["position closure"][-1]
    assert position[None] > 1e-6  # the velocity's error, integrated
    assert position[dc.Baumgarte(10.0, 10.0)] < 1e-9
    assert position["projection"] < 1e-15


# --- adaptive -----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.heyoka
@pytest.mark.parametrize("name", repeated(PROJECTABLE, "Radau"))
def test_adaptive_solvers_with_projection(name: str) -> None:
    mechanism, state = disc()
    run = dc.simulate(mechanism, state, 0.4, 0.1, dc.solvers.by_name(name, 1e-8), ALL)
    ledger = balance(mechanism, run)
    assert worst(ledger, "position") < 1e-14 and worst(ledger, "velocity") < 1e-12
    found = np.concatenate([run.q[-1], run.u[-1]])
    assert np.abs(found - exact(disc, 0.4)).max() < 1e-5  # growth of some hundreds over the run
    assert max(np.abs(v).max() for v in ledger.delta_c.values()) < 1e-4


@pytest.mark.heyoka
@pytest.mark.parametrize("make", repeated((linkage, disc), linkage))
def test_taylor_stays_by_itself(make: Make) -> None:
    mechanism, state = make()
    run = dc.simulate(mechanism, state, 0.5, 0.1, "taylor", ALL)
    ledger = balance(mechanism, run)
    assert worst(ledger, "position") < 1e-13 and worst(ledger, "velocity") < 1e-12
    for function in ALL:
        assert np.abs(ledger.delta_c[function]).max() < 5 * ledger.error_bar[function].max()


# --- singular configurations --------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2])
def test_four_bars_through_their_singular_positions(count: int) -> None:
    """A02: the parallelogram passes flat positions, where its constraints are dependent, some times."""
    mechanism, state = four_bars(count)
    run = dc.simulate(mechanism, state, 3.0, 0.002, "ode5", ALL)
    angle, rate = pendulum_of(count, run.t)
    passed = np.count_nonzero(np.diff(np.sign(np.sin(angle))))
    assert passed >= 3
    # 1500 steps of ode5; near a singularity the projection divides rounding by the distance to it.
    # Speeds are off by that twice over, since they are projected by the same matrix.
    assert np.abs(run.q[:, 0] - angle).max() < 1e-9
    assert np.abs(run.u[:, 0] - rate).max() < 4e-9
    ledger = balance(mechanism, run)
    assert worst(ledger, "position") < 1e-13
    for function in ALL:
        assert np.abs(ledger.delta_c[function]).max() < 1e-9


@pytest.mark.parametrize("name", ["ode1", "ode4", "ode5"])
@pytest.mark.parametrize("steps", [60, 65])
def test_steps_and_stages_that_land_on_a_singular_position(name: str, steps: int) -> None:
    """Without gravity the cranks turn evenly, and at 1 s they are flat: a row of G vanishes to rounding.

    With 65 steps in 2 s it is the stage in mid-step that meets it. The speeds are known to what the
    distance to the place, some 1e-4 to 1e-2, leaves of rounding.
    """
    plain, start = four_bars(1)
    mechanism = replace(plain, gravity=[0.0, 0.0, 0.0])
    omega = -np.pi / 2
    state = mechanism.state(start.q, {"foot0": omega, "foot1": omega, "tip0": -omega})
    run = dc.simulate(
        mechanism, state, 2.0, 2.0 / steps, name, dc.Record(testing=("wang",), every=steps // 5)
    )
    np.testing.assert_allclose(run.q[:, 0], np.pi / 2 + omega * run.t, atol=1e-12)
    np.testing.assert_allclose(run.u[:, 1], omega, atol=1e-11)


def test_a_start_in_a_singular_position_is_refused_in_words() -> None:
    mechanism, _ = four_bars(1)
    state = mechanism.state({}, {"foot0": 2.0, "foot1": 2.0, "tip0": -2.0})
    with pytest.raises(InputError, match="'1 four-bars' is a singular configuration.*nearby state"):
        dc.simulate(mechanism, state, 0.1, 0.001, "ode5")


# --- what cannot be run -------------------------------------------------------------------------------


def test_a_start_off_the_constraints_is_refused_with_the_remedy() -> None:
    mechanism, state = linkage()
    off = mechanism.state(state.q + [0, 0.1, 0], state.u)
    with pytest.raises(
        InputError, match="violates constraint 'closure' at position level by 0.0"
    ) as e:
        dc.simulate(mechanism, off, 0.1, 0.01, "ode4")
    assert "deltac.assemble(mechanism, state)" in str(e.value)
    off = mechanism.state(state.q, state.u + [0.1, 0, 0])
    with pytest.raises(InputError, match="'closure' at velocity level by 0.104 m/s"):
        dc.simulate(mechanism, off, 0.1, 0.01, "ode4")


def test_no_degree_of_freedom_is_refused() -> None:
    mechanism, state = linkage()
    held = dc.constraints.holonomic("held", f"q.input - {float(state.q[0])!r}")
    stiff = replace(mechanism, constraints=[*mechanism.constraints, held])
    with pytest.raises(
        InputError, match="'crank-rocker' no degree of freedom, and nothing drives it"
    ):
        dc.simulate(stiff, stiff.state(state.q), 0.1, 0.01, "ode4")


@pytest.mark.parametrize("bad", ["baumgarte", "none", (1.0,), (1.0, 2.0)])
def test_an_unknown_stabilisation_is_refused(bad: Any) -> None:
    mechanism, state = linkage()
    with pytest.raises(InputError, match="expected 'projection', .*deltac.Baumgarte"):
        dc.simulate(mechanism, state, 0.1, 0.01, "ode4", constraints=bad)


@pytest.mark.parametrize("bad", [-2.0, np.nan, "1"])
def test_baumgarte_is_of_numbers(bad: Any) -> None:
    with pytest.raises(InputError, match="Baumgarte: beta is"):
        dc.Baumgarte(1.0, bad)


@pytest.mark.parametrize("name", ["LSODA", "BDF"])
def test_solvers_with_a_memory_cannot_be_projected(name: str) -> None:
    mechanism, state = linkage()
    with pytest.raises(
        InputError, match=f"'{name}' remembers earlier steps.*use 'Radau' or 'DOP853'"
    ):
        dc.simulate(mechanism, state, 0.1, None, name)
    run = dc.simulate(mechanism, state, 0.1, None, name, constraints=dc.Baumgarte(20.0, 20.0))
    assert worst(balance(mechanism, run), "position") < 1e-7


def test_the_1988_form_is_refused_on_constrained_mechanisms() -> None:
    mechanism, state = linkage()
    with pytest.raises(InputError, match="not independent.*use 'kane-levinson-1990'"):
        dc.simulate(mechanism, state, 0.1, 0.01, "ode4", ("kane-levinson-1988",))


def test_redundant_constraints_run_and_agree() -> None:
    """The closure told twice: the same motion, the second set of rows left to follow."""
    mechanism, state = linkage()
    closure: Any = mechanism.constraints[0]
    twice = replace(mechanism, constraints=[closure, replace(closure, name="again")])
    once = dc.simulate(mechanism, state, 0.5, 0.005, "ode4")
    again = dc.simulate(twice, state, 0.5, 0.005, "ode4")
    np.testing.assert_allclose(again.q, once.q, atol=1e-12)
    assert worst(balance(twice, again), "position") < 1e-13


def test_a_run_that_blows_up_keeps_what_it_had() -> None:
    """Euler steps too long for the disc: no traceback of linear algebra, a warning and a trajectory."""
    mechanism, state = disc()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = dc.simulate(mechanism, state, 200.0, 0.5, "ode5", ())
    assert np.isfinite(run.q).all() and len(run) >= 1
    if not run.provenance.completed:
        assert any(issubclass(w.category, dc.SimulationStoppedWarning) for w in caught)


def test_a_mechanism_at_the_end_of_its_reach_stops_with_words() -> None:
    """Two unit links from the ground to a point that moves away: reach 2, of which 0.5 at the start."""
    mechanism = dc.Mechanism(
        [dc.rod("upper", 1.0, 1.0), dc.rod("lower", 1.0, 1.0)],
        [
            dc.revolute("shoulder", "ground", "upper"),
            dc.revolute("elbow", "upper", "lower", position=(1, 0, 0)),
        ],
        constraints=[
            dc.constraints.distance("winch", "ground", "lower", "0.5+t", point2=(1, 0, 0))
        ],
    )
    start = dc.assemble(mechanism, mechanism.state({"shoulder": 1.0, "elbow": -2.6})).state
    with pytest.warns(
        dc.SimulationStoppedWarning, match=r"'winch' can no longer be met at t = 1\.[45]"
    ):
        run = dc.simulate(mechanism, start, 3.0, 1e-3, "ode4")
    assert not run.provenance.completed
    assert 1.45 < run.t[-1] < 1.55
    tip = np.abs(np.exp(1j * run.q[:, 0]) + np.exp(1j * (run.q[:, 0] + run.q[:, 1])))
    np.testing.assert_allclose(tip, 0.5 + run.t, rtol=0, atol=1e-3)


# --- rolling on four wheels -----------------------------------------------------------------------

WHEEL = 0.3


def car(*, sprung: bool, torque: float = 20.0, aside: Any = 0.0, **options: Any) -> dc.Mechanism:
    """500 kg on four wheels of 10 kg that roll; the rear ones are driven. Sprung, it may lean and pitch."""
    bodies = [dc.bodies.box("body", 500.0, (2.0, 1.0, 0.4))]
    joints, constraints = [dc.free("base", "body")], []
    for k, (x, y) in enumerate([(1.0, 0.6), (1.0, -0.6), (-1.0, 0.6), (-1.0, -0.6)]):
        bodies += [dc.bodies.box(f"hub {k}", 5.0, (0.1, 0.1, 0.1))]
        place = (x, y, -0.1)
        if sprung:
            spring: dict[str, Any] = {"stiffness": 2e4, "damping": 1.5e3}
            joints.append(
                dc.prismatic(f"strut {k}", "body", f"hub {k}", "z", position=place, **spring)
            )
        else:
            joints.append(dc.joints.fixed(f"strut {k}", "body", f"hub {k}", position=place))
        bodies.append(dc.bodies.disc(f"wheel {k}", 10.0, WHEEL, axis="y"))
        joints.append(dc.revolute(f"axle {k}", f"hub {k}", f"wheel {k}", "y"))
        constraints.append(dc.constraints.rolling(f"tyre {k}", f"wheel {k}", WHEEL))
    motors = [dc.forces.joint_torque(f"motor {k}", f"axle {k}", torque) for k in (2, 3)]
    gravity = (0, aside, -9.81)
    return dc.Mechanism(bodies, joints, motors, constraints=constraints, gravity=gravity, **options)


def rolling(mechanism: dc.Mechanism, speed: float) -> dc.State:
    turning = {f"axle {k}": speed / WHEEL for k in range(4)}
    return mechanism.state({"base.z": WHEEL + 0.1}, {"base.vx": speed, **turning})


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "sprung"), crossed(("ode4", "DOP853", "generalized-alpha"), (False, True))
)
def test_a_car_on_four_wheels(solver: str, sprung: bool) -> None:  # noqa: FBT001
    """By hand: a = (2 M/R) / (m + 4 I/R²), I = m_w R²/2; the springs carry 520 kg.

    Twelve rows, of which four depend on others: sprung, some do so only as long as the body does not lean.
    """
    mechanism = car(sprung=sprung)
    run = dc.simulate(mechanism, rolling(mechanism, 2.0), 2.0, 0.005, solver)
    assert run.provenance.completed
    acceleration = 2 * 20.0 / WHEEL / (500 + 4 * 15 + 4 * 5)
    assert run.u[-1, 0] == pytest.approx(2.0 + 2.0 * acceleration, rel=1e-6)
    assert run.q[-1, 0] == pytest.approx(4.0 + 2.0 * acceleration, rel=1e-6)
    sunk = 500 * 9.81 / (4 * 2e4) if sprung else 0.0
    assert run.q[-1, 2] == pytest.approx(WHEEL + 0.1 - sunk, abs=1e-4)
    height = mechanism.speeds.of("base").start + 2
    carried = sum(run.forces[f"constraint tyre {k}"][-1, height] for k in range(4))
    assert carried == pytest.approx(560 * 9.81, rel=1e-3)
    assert run.provenance.energy_error is not None
    assert run.provenance.energy_error < (0.5 if solver == "generalized-alpha" else 1e-3)  # J


@pytest.mark.long
def test_a_car_that_leans_cannot_roll_on_four_wheels() -> None:
    """Pushed aside, the body leans, the wheels' tracks part, and one of them would have to slip."""
    mechanism = car(sprung=True, aside=2.0)
    with pytest.warns(dc.SimulationStoppedWarning, match="'tyre [0-9]' can no longer be met"):
        run = dc.simulate(mechanism, rolling(mechanism, 2.0), 2.0, 0.005)
    assert 0.01 < run.t[-1] < 0.5


@pytest.mark.long
@pytest.mark.parametrize("every", [1, 100])
def test_members_of_an_ensemble_end_where_their_constraints_do(every: int) -> None:
    """The car that leans ends as it does alone, whenever records are taken; the other goes on."""
    mechanism = car(sprung=True, aside="g", parameters={"g": 0.0})
    states = [rolling(mechanism, 2.0)] * 2
    many = dc.simulate_ensemble(mechanism, states, 0.5, 0.005, vary={"g": [0.0, 2.0]}, record=every)
    with pytest.warns(dc.SimulationStoppedWarning):
        alone = dc.simulate(mechanism.with_parameters(g=2.0), states[1], 0.5, 0.005)
    assert math.isnan(many.stopped[0]) and alone.t[-1] - many.stopped[1] == pytest.approx(
        0, abs=0.005 + 1e-9
    )
    assert not many.member(1).provenance.completed and many.member(0).provenance.completed
    assert np.isfinite(many.delta_c["wang"][:, 0]).all()
    assert np.isnan(many.delta_c["wang"][-1, 1])
