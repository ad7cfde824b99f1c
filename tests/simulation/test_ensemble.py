"""Ensembles: members equal single runs, and depend on themselves alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.simulation.ensemble import steps as ensemble_steps


def double_pendulum(**options: Any) -> dc.Mechanism:
    return dc.Mechanism(
        [dc.rod("upper", "m", 1.0, "-y"), dc.rod("lower", 0.5, 0.8, "-y")],
        [
            dc.revolute("shoulder", "ground", "upper", damping=0.05),
            dc.revolute("elbow", "upper", "lower", position=(0, -1, 0)),
        ],
        gravity=(0, -9.81, 0),
        parameters={"m": 1.0},
        **options,
    )


def starts(members: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    return rng.uniform(-1, 1, (members, 2)), rng.normal(size=(members, 2))


@pytest.mark.parametrize("fused", [4000, 0])
@pytest.mark.parametrize("solver", ["ode1", "ode4", "semi-implicit-euler"])
def test_members_equal_single_runs(
    fused: int, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole steps compiled, and stage by stage; to rounding, since code of other shape rounds otherwise."""
    monkeypatch.setattr(ensemble_steps, "FUSED_INSTRUCTIONS", fused)
    mechanism, (Q, U) = double_pendulum(), starts(5)
    runs = dc.simulate_ensemble(mechanism, (Q, U), 0.5, 0.01, solver, record=10)
    for k in range(5):
        one = dc.simulate(mechanism, mechanism.state(Q[k], U[k]), 0.5, 0.01, solver, record=10)
        np.testing.assert_allclose(runs.t, one.t, rtol=1e-15)
        np.testing.assert_allclose(runs.q[:, k], one.q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(runs.u[:, k], one.u, rtol=0, atol=1e-11)
        ledger = dc.balance(mechanism, one)
        for name, values in runs.delta_c.items():
            np.testing.assert_allclose(values[:, k], ledger.delta_c[name], rtol=0, atol=1e-11)


@pytest.mark.heyoka
@pytest.mark.parametrize("fused", [4000, 0])
def test_a_member_depends_on_itself_alone(fused: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit: other members, chunks and threads leave no trace."""
    monkeypatch.setattr(ensemble_steps, "FUSED_INSTRUCTIONS", fused)
    mechanism, (Q, U) = double_pendulum(), starts(70)
    whole = dc.simulate_ensemble(mechanism, (Q, U), 0.2, 0.01)
    part = dc.simulate_ensemble(mechanism, (Q[11:24], U[11:24]), 0.2, 0.01, threads=1)
    np.testing.assert_array_equal(part.q[-1], whole.q[-1, 11:24])
    monkeypatch.setattr(ensemble_steps, "CHUNKS", (8, 8))
    small = dc.simulate_ensemble(mechanism, (Q, U), 0.2, 0.01, threads=2)
    np.testing.assert_array_equal(small.q, whole.q)


def test_parameters_vary_between_members() -> None:
    mechanism, masses = double_pendulum(), np.array([0.5, 1.0, 2.0])
    state = mechanism.state({"shoulder": 1.0})
    runs = dc.simulate_ensemble(mechanism, state, 0.5, 0.01, "ode4", vary={"m": masses})
    for k, m in enumerate(masses):
        other = mechanism.with_parameters(m=float(m))
        one = dc.simulate(other, state, 0.5, 0.01, "ode4")
        np.testing.assert_allclose(runs.q[-1, k], one.q[-1], rtol=0, atol=1e-12)


def test_constraints_hold_in_every_member() -> None:
    rods = [dc.rod(name, 1.0, 1.0, "x") for name in ("crank", "coupler", "rocker")]
    mechanism = dc.Mechanism(
        rods,
        [
            dc.revolute("a", "ground", "crank"),
            dc.revolute("b", "crank", "coupler", position=(1, 0, 0)),
            dc.revolute("c", "ground", "rocker", position=(1, 0, 0)),
        ],
        constraints=[
            dc.constraints.loop_revolute(
                "close", "coupler", "rocker", point1=(1, 0, 0), point2=(1, 0, 0)
            )
        ],
        gravity=(0, -9.81, 0),
    )
    angles = np.array([0.5, 1.0, 1.5])
    Q = np.stack([angles, -angles, angles], axis=1)
    runs = dc.simulate_ensemble(mechanism, (Q, np.zeros((3, 3))), 1.0, 1e-3)
    np.testing.assert_allclose(runs.q[-1, :, 0] + runs.q[-1, :, 1], 0, atol=1e-10)  # parallelogram
    one = dc.simulate(mechanism, mechanism.state(Q[1]), 1.0, 1e-3, "ode4")
    np.testing.assert_allclose(runs.q[-1, 1], one.q[-1], rtol=0, atol=1e-10)


def test_a_member_that_blows_up_leaves_the_others_alone() -> None:
    """q̈ = q² runs to infinity from q > 0, and stays bounded from a start on the other side."""
    mechanism = dc.Mechanism(
        [dc.point_mass("bead", 1.0)],
        [dc.prismatic("x", "ground", "bead")],
        [dc.forces.joint_torque("push", "x", "q.x**3")],
    )
    runs = dc.simulate_ensemble(
        mechanism, (np.array([[5.0], [0.0]]), np.array([[50.0], [0.0]])), 4.0, 0.01, record=50
    )
    # From x = 5, ẋ = 50, the time to infinity is ∫dx/√(v² + (x⁴ − 5⁴)/2) = 0.217 s (by quadrature).
    assert 0.1 <= runs.stopped[0] <= 0.3  # known to five steps, and the last steps are rough
    assert np.isnan(runs.stopped[1])
    assert np.isnan(runs.q[-1, 0]).all() and runs.q[-1, 1] == 0.0
    kept = runs.member(0)
    assert kept.t[-1] <= runs.stopped[0] and np.isfinite(kept.q).all()


def test_steps_and_solvers_vary_between_members() -> None:
    """A study of orders in one call; members equal runs of their own."""
    mechanism = double_pendulum()
    state = mechanism.state({"shoulder": 1.0, "elbow": 0.5})
    steps, solvers = [0.02, 0.01, 0.005, 0.02], ["ode4", "ode4", "ode4", "ode2"]
    runs = dc.simulate_ensemble(mechanism, state, 1.0, steps, solvers, record=10)
    assert len(runs) == 4 and len(runs.t) == 6
    for k in range(4):
        one = dc.simulate(mechanism, state, 1.0, steps[k], solvers[k], record=1)
        np.testing.assert_allclose(runs.q[-1, k], one.q[-1], rtol=0, atol=1e-12)
        member = runs.member(k)
        assert member.provenance.step == steps[k] and member.provenance.solver == solvers[k]
    wang = np.abs(runs.delta_c["wang"][-1])
    assert (np.log2(wang[:2] / wang[1:3]) > 3.5).all()  # order 4, at least
    assert wang[3] > 10 * wang[0]


@pytest.mark.parametrize("solver", ["ode4", "semi-implicit-euler"])
def test_sensitivity_is_the_derivative_of_delta_c(solver: str) -> None:
    """Against central differences of other members: error of order δ², and rounding over δ."""
    mechanism = double_pendulum()
    state = mechanism.state({"shoulder": 1.0}, speeds={"elbow": 2.0})
    masses, delta = np.array([0.7, 1.0, 1.6]), 1e-4
    found = dc.simulate_ensemble(
        mechanism, state, 1.0, 0.02, solver, vary={"m": masses}, sensitivity=("m",), record=25
    )
    up, down = (
        dc.simulate_ensemble(mechanism, state, 1.0, 0.02, solver, vary={"m": m}, record=25)
        for m in (masses + delta, masses - delta)
    )
    for name, slopes in found.sensitivity.items():
        difference = (up.delta_c[name] - down.delta_c[name]) / (2 * delta)
        scale = np.abs(difference).max()
        assert scale > 1e-7
        np.testing.assert_allclose(slopes["m"], difference, rtol=0, atol=1e-5 * scale + 1e-10)


def test_sensitivity_needs_no_vary() -> None:
    mechanism = double_pendulum()
    state = mechanism.state({"shoulder": 1.0})
    runs = dc.simulate_ensemble(mechanism, state, 0.1, 0.01, sensitivity=("m",))
    assert runs.sensitivity["wang"]["m"].shape == (2, 1)
    assert runs.sensitivity["wang"]["m"][0, 0] == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"solver": "DOP853"}, "fixed steps"),
        ({"step": 0.3}, "does not divide"),
        ({"step": [0.1, 0.05]}, "Q has 3, step has 2"),
        ({"step": [0.1, 0.05, 0.04], "record": 1}, "time between records"),
        ({"step": -0.1}, "positive number"),
        ({"solver": ["ode4", "ode1"]}, "Q has 3, solver has 2"),
        ({"sensitivity": ("k",)}, "sensitivity: unknown parameter 'k'"),
        ({"sensitivity": "m"}, "names of parameters"),
        ({"record": 7}, "does not divide the number of steps"),
        ({"vary": {"n": [1.0]}}, "unknown parameter 'n'"),
        ({"vary": {"m": [1.0, np.inf, 2.0]}}, "finite"),
        ({"vary": {"m": [1.0, 2.0]}}, "Q has 3, vary has 2"),
        ({"states": (np.zeros((3, 1)), np.zeros((3, 2)))}, r"Q has shape \(3, 1\)"),
        ({"states": (np.zeros((3, 2)), np.full((3, 2), np.nan))}, "U: member 0, 'shoulder'"),
        ({"states": (np.zeros((3, 2)), np.zeros((2, 2)))}, "Q has 3 members, U has 2"),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], message: str) -> None:
    given = {"states": starts(3), "duration": 1.0, "step": 0.1, **change}
    with pytest.raises(dc.InputError, match=message):
        dc.simulate_ensemble(double_pendulum(), **given)


def test_the_number_of_threads_changes_no_bit() -> None:
    mechanism, (Q, U) = double_pendulum(), starts(20)
    found = [dc.simulate_ensemble(mechanism, (Q, U), 0.1, 0.01, threads=n).q[-1] for n in (1, 2, 5)]
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vary": {"m1": [1.0, -0.1]}}, r"member 1 \(m1 = -0.1\)"),
        ({"vary": {"m1": []}}, "expected finite numbers"),
        ({"vary": {"m1": "abc"}}, "'abc'; expected finite numbers"),
        ({"threads": 0}, "threads is 0"),
    ],
)
def test_members_that_are_no_mechanisms(options: dict[str, Any], message: str) -> None:
    problem = dc.problems.load("double-pendulum")
    with pytest.raises(dc.InputError, match=message):
        dc.simulate_ensemble(problem.mechanism, problem.state, 0.1, 0.01, **options)


@pytest.mark.parametrize("fused", [4000, 0])
@pytest.mark.parametrize("threads", [1, 2])
def test_progress_is_told_within_a_chunk(
    fused: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By default the end alone is recorded; a thousand times at most, rising to 1."""
    monkeypatch.setattr(ensemble_steps, "FUSED_INSTRUCTIONS", fused)
    monkeypatch.setattr(ensemble_steps, "CHUNKS", (8, 8))
    told: list[float] = []
    mechanism, given = double_pendulum(), starts(12)
    dc.simulate_ensemble(mechanism, given, 40.0, 0.01, threads=threads, progress=told.append)
    assert 500 <= len(told) <= 1000
    assert told == sorted(set(told)) and told[-1] == 1.0 and told[0] < 0.01


@pytest.mark.parametrize("threads", [1, 2])
def test_what_progress_raises_ends_the_run(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a KeyboardInterrupt does: long before its time, which here is 30 million steps."""
    monkeypatch.setattr(ensemble_steps, "CHUNKS", (8, 8))
    told: list[float] = []

    def progress(done: float) -> None:
        told.append(done)
        raise InterruptedError("enough")

    with pytest.raises(InterruptedError, match="enough"):
        dc.simulate_ensemble(
            double_pendulum(), starts(16), 3e4, 1e-3, threads=threads, progress=progress
        )
    assert len(told) <= threads and max(told) < 0.01


def test_a_member_that_blew_up_says_so() -> None:
    """Explicit steps far beyond the stability of a stiff spring."""
    mechanism = dc.Mechanism(
        [dc.point_mass("mass", 1.0)],
        [dc.prismatic("slide", "ground", "mass", "x", stiffness="k")],
        parameters={"k": 1.0},
    )
    state = mechanism.state({"slide": 1.0})
    ensemble = dc.simulate_ensemble(mechanism, state, 100.0, 0.1, vary={"k": [1.0, 1e9]}, record=10)
    assert ensemble.member(0).provenance.completed
    assert not ensemble.member(1).provenance.completed
    assert "not finite" in ensemble.member(1).provenance.message
    with pytest.raises(dc.InputError, match="there are 2"):
        ensemble.member(2)
