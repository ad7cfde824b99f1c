"""Momentum balances: what no force touches is kept, what a force touches changes by its impulse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from tests.systems import four_bar


def quaternion_to_matrix(q: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix())


def test_a_body_in_free_flight() -> None:
    """Linear and angular momentum about the world's origin, both zero departures at exact motion."""
    inertia = np.array([1.0, 2.0, 2.5])
    mechanism = dc.Mechanism(
        [dc.body("box", 2.0, inertia.tolist(), [0.1, -0.2, 0.3])], [dc.free("base", "box")]
    )
    start = mechanism.state({"base.x": 1.0}, {"base": [1, 2, 3, 0.5, 3, -0.2]})
    run = dc.simulate(mechanism, start, 2.0, 0.005, "ode8")
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    names = [f"{kind} {axis} base" for kind in ("linear", "angular") for axis in "xyz"]
    assert set(ledger.momentum) == set(names)
    for name in names:
        assert np.abs(ledger.momentum[name]).max() < 1e-11, name
    # The motion really has the momenta: by Newton and Euler on the samples.
    R = quaternion_to_matrix(run.q[:, 3:])
    lever = R @ np.array([0.1, -0.2, 0.3])
    w = np.einsum("tij,tj->ti", R, run.u[:, 3:])
    v = run.u[:, :3] + np.cross(w, lever)
    p = 2.0 * v
    L = np.cross(run.q[:, :3] + lever, p) + np.einsum("tij,tj->ti", R, inertia * run.u[:, 3:])
    assert np.ptp(p, axis=0).max() < 1e-11
    assert np.ptp(L, axis=0).max() < 1e-10
    assert np.ptp(run.u[:, 3:], axis=0).min() > 0.1


def test_an_uneven_step_shows_in_the_momentum() -> None:
    mechanism = dc.Mechanism([dc.body("box", 2.0, [1, 2, 2.5])], [dc.free("base", "box")])
    start = mechanism.state(speeds={"base": [1, 2, 3, 0.5, 3, -0.2]})
    coarse = dc.balance(mechanism, dc.simulate(mechanism, start, 2.0, 0.02, "ode1"))
    assert max(np.abs(coarse.momentum[f"angular {a} base"]).max() for a in "xyz") > 1e-2
    assert max(np.abs(coarse.momentum[f"linear {a} base"]).max() for a in "xyz") < 1e-12


def test_gravity_gives_its_impulse() -> None:
    mechanism = dc.Mechanism(
        [dc.body("box", 2.0, [1, 2, 2.5])], [dc.free("base", "box")], gravity=[0, 0, -9.81]
    )
    start = mechanism.state(speeds={"base": [1, 0, 0, 0, 1, 0]})
    run = dc.simulate(mechanism, start, 1.0, 0.01, "ode4")
    ledger = dc.balance(mechanism, run)
    np.testing.assert_allclose(run.u[:, 2], -9.81 * run.t, atol=1e-12)
    assert np.abs(ledger.momentum["linear z base"]).max() < 1e-12
    bare = dc.Mechanism(mechanism.bodies, mechanism.joints)
    np.testing.assert_allclose(
        dc.balance(bare, run, "samples").momentum["linear z base"], -2 * 9.81 * run.t, atol=1e-11
    )


def test_the_heavy_top_keeps_its_momentum_about_the_vertical() -> None:
    mechanism = dc.Mechanism(
        [dc.body("top", 1.0, [0.1, 0.1, 0.02], [0, 0, 0.5])],
        [dc.joints.spherical("tip", "ground", "top")],
        gravity=[0, 0, -9.81],
    )
    tilt = [np.cos(0.3), np.sin(0.3), 0, 0]
    run = dc.simulate(
        mechanism, mechanism.state({"tip": tilt}, {"tip": [0, 0, 30]}), 1.0, 1e-3, "ode8"
    )
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    for axis in "xyz":
        bar = ledger.momentum_bar[f"angular {axis} tip"] + 1e-11
        assert (np.abs(ledger.momentum[f"angular {axis} tip"]) <= bar).all()
    R = quaternion_to_matrix(run.q)
    L = np.einsum("tij,tj->ti", R, np.array([0.35, 0.35, 0.02]) * run.u)
    assert np.ptp(L[:, 2]) < 1e-11
    assert np.ptp(L[:, 0]) > 0.1  # gravity turns it about the others


def test_a_planar_chain_in_space() -> None:
    """Two bars, joined and floating: linear momentum and the angular one about the origin."""
    mechanism = dc.Mechanism(
        [dc.rod("a", 1.0, 1.0), dc.rod("b", 2.0, 0.7)],
        [
            dc.joints.planar("base", "ground", "a"),
            dc.revolute("elbow", "a", "b", "z", position=[1, 0, 0], stiffness=3.0, damping=0.1),
        ],
    )
    start = mechanism.state({"elbow": 0.5}, {"base": [0.2, -0.1, 1.0], "elbow": -2.0})
    run = dc.simulate(mechanism, start, 2.0, 0.005, "ode8")
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    assert set(ledger.momentum) == {"linear x base", "linear y base", "angular z base"}
    for name, values in ledger.momentum.items():
        assert np.abs(values).max() < 1e-11, name
    q, u = run.q, run.u
    a, w = q[:, 2], u[:, 2]
    b, wb = a + q[:, 3], w + u[:, 3]
    elbow = u[:, :2] + w[:, None] * np.stack([-np.sin(a), np.cos(a)], 1)
    va = u[:, :2] + 0.5 * w[:, None] * np.stack([-np.sin(a), np.cos(a)], 1)
    vb = elbow + 0.35 * wb[:, None] * np.stack([-np.sin(b), np.cos(b)], 1)
    p = 1.0 * va + 2.0 * vb
    assert np.ptp(p, axis=0).max() < 1e-12
    assert np.ptp(u[:, 3]) > 0.1


def test_a_force_on_part_of_a_chain_gives_its_impulse_to_the_whole() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("a", 1.0, [1, 1, 1]), dc.bodies.box("b", 2.0, [1, 1, 1])],
        [dc.free("base", "a"), dc.revolute("elbow", "a", "b", "y", position=[1, 0, 0])],
        [dc.forces.point_force("jet", "b", [0.3, "sin(t)", 0], [0.2, 0.1, 0])],
    )
    run = dc.simulate(mechanism, mechanism.state(), 2.0, 0.005, "ode8")
    ledger = dc.balance(mechanism, run, "samples", ("wang",))
    for name, values in ledger.momentum.items():
        assert np.abs(values).max() < 1e-10, name
    bare = dc.Mechanism(mechanism.bodies, mechanism.joints)
    impulse = dc.balance(bare, run, "samples", ("wang",)).momentum
    np.testing.assert_allclose(impulse["linear x base"], 0.3 * run.t, atol=1e-10)
    np.testing.assert_allclose(impulse["linear y base"], 1 - np.cos(run.t), atol=1e-10)


def test_a_hinge_on_the_ground_has_its_axis() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("door", 3.0, [1, 0.1, 2], [0.5, 0, 0])],
        [dc.revolute("hinge", "ground", "door", "z", damping=0.4)],
    )
    run = dc.simulate(mechanism, mechanism.state(speeds={"hinge": 2.0}), 1.0, 0.01, "ode8")
    inertia = 3 * (1 + 0.01) / 12 + 3 * 0.25
    np.testing.assert_allclose(run.u[:, 0], 2 * np.exp(-0.4 / inertia * run.t), rtol=1e-12)
    ledger = dc.balance(mechanism, run)
    assert np.abs(ledger.momentum["angular hinge"]).max() == pytest.approx(0.0, abs=1e-11)


# --- momentum testing functions ΔP_r, one for each speed ---------------------------------------------

RECORD = ("wang", "liu-huston", "momentum")


def largest(values: Mapping[str, np.ndarray]) -> dict[str, float]:
    return {name: float(np.abs(v).max()) for name, v in values.items()}


def test_they_name_the_equation_with_the_mistake_of_the_thesis() -> None:
    """ΔP of the second equation alone: −2 (m2 r2 + m3 l2) g ∫ sin θ2 dt, by Simpson's rule."""
    from scipy.integrate import cumulative_simpson

    problem = dc.problems.load("triple-pendulum", mistake=True)
    assert problem.equations is not None
    own = problem.equations.coordinates
    run = dc.simulate(
        problem.mechanism,
        problem.state,
        2.0,
        1e-3,
        "ode5",
        record=dc.Record(RECORD, coordinates=own),
        equations=problem.equations,
    )
    theta = np.cumsum(run.q, axis=1)
    g2 = 30 * 0.125 + 20 * 0.25
    expected = 2 * g2 * cumulative_simpson(np.sin(theta[:, 1]), x=run.t, initial=0.0)
    bare = replace(run, udot=None)  # no accelerations are needed
    for ledger in (
        dc.balance(problem.mechanism, run),
        dc.balance(problem.mechanism, run, "samples", coordinates=own),
        dc.balance(problem.mechanism, bare, "samples", ("momentum",), coordinates=own),
    ):
        sizes = largest(ledger.delta_p)
        assert tuple(sizes) == ("theta1", "theta2", "theta3")
        assert np.abs(ledger.delta_p["theta2"] - expected).max() < 1e-6 * g2
        assert max(sizes["theta1"], sizes["theta3"]) < 1e-9
        assert sizes["theta2"] > 100 * ledger.delta_p_bar["theta2"].max()
        assert ledger.momenta()["theta2"]["relative"] > 0.05


@pytest.mark.parametrize("solver", ["ode4", "implicit-midpoint", "DOP853"])
@pytest.mark.parametrize("name", ["heavy-top", "chaplygin-sleigh", "driven-pendulum"])
def test_in_the_loop_they_fall_with_the_order(name: str, solver: str) -> None:
    problem = dc.problems.load(name)
    step = 2e-3 if name == "heavy-top" else 1e-2
    scales = []
    for h in (step, step / 2):
        adaptive = dc.solvers.Scipy("DOP853", 1e-6 if h == step else 1e-9)
        run = dc.simulate(
            problem, None, 0.2, h, adaptive if solver == "DOP853" else solver, record=RECORD
        )
        assert all(f"momentum {name}" in run.integrals for name in dc.balance(problem, run).delta_p)
        momenta = dc.balance(problem, run).momenta()
        scales.append(
            max(m["relative"] for m in momenta.values() if m["delta_p"] > 10 * m["error_bar"])
            if any(m["delta_p"] > 10 * m["error_bar"] for m in momenta.values())
            else 0.0
        )
    assert scales[0] < 0.1
    assert scales[1] <= scales[0] / 3 or scales[1] < 1e-12


def test_the_rate_form_is_the_residual_of_the_equations() -> None:
    """Without constraints ṗ − rate = −(F + F*), here of accelerations that are wrong by a constant."""
    problem = dc.problems.load("heavy-top")
    run = dc.simulate(problem, None, 0.1, 1e-3, "ode5")
    assert run.udot is not None
    wrong = replace(run, udot=run.udot + 0.3)
    residuals = dc.residuals(problem, wrong)
    np.testing.assert_allclose(
        residuals["momentum"], -residuals["coordinates"], atol=1e-9 * np.abs(run.udot).max()
    )
    assert np.abs(dc.residuals(problem, run)["momentum"]).max() < 1e-9


def test_kanes_form_for_own_speeds_needs_no_multipliers() -> None:
    """A four-bar in the speed of its crank: the forces of the loop drop out, wrong as they may be."""
    bar = four_bar.mechanism()
    run = dc.simulate(bar, four_bar.start(), 0.5, 1e-3, "ode8")
    forged = replace(run, forces={name: 3.0 * f for name, f in run.forces.items()})
    ledger = dc.balance(bar, forged, "samples", coordinates=dc.CoordinateMap(("crank",)))
    assert set(ledger.delta_p) == {"crank"}
    assert max(largest(ledger.delta_p).values()) < 1e-10
    with_forces = dc.balance(bar, forged, "samples")
    assert max(m["relative"] for m in with_forces.momenta().values()) > 0.1
    own_forces = dc.balance(bar, replace(run, forces={}), "samples")
    assert max(largest(own_forces.delta_p).values()) < 1e-9


def test_across_an_impact_they_take_its_impulse() -> None:
    problem = dc.problems.load("bouncing-ball")
    run = dc.simulate(problem, None, None, 1e-2, "ode4", record=RECORD)
    assert run.events
    for work in ("in-loop", "samples"):
        ledger = dc.balance(problem, run, work)
        assert max(largest(ledger.delta_p).values()) < 1e-10
    quiet = replace(run, events=tuple(replace(e, impulses={}) for e in run.events))
    assert max(largest(dc.balance(problem, quiet, "samples").delta_p).values()) > 0.1


def test_a_workless_mistake_that_no_energy_sees() -> None:
    """A gyroscopic force, perpendicular to the velocity: ΔC is rounding, ΔP names both equations."""
    particle = dc.Mechanism(
        [dc.bodies.frame("slider"), dc.point_mass("bead", 2.0)],
        [dc.prismatic("x", "ground", "slider", "x"), dc.prismatic("y", "slider", "bead", "y")],
    )
    rate, t = 1.5, np.linspace(0.0, 2.0, 401)
    u = np.stack([np.cos(rate * t), np.sin(rate * t)], axis=1)  # it should move straight on
    q = np.stack([np.sin(rate * t), 1.0 - np.cos(rate * t)], axis=1) / rate
    run = dc.Trajectory(t=t, q=q, u=u, coordinates=("x", "y"), speeds=("x", "y"))
    ledger = dc.balance(particle, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-9
    np.testing.assert_allclose(ledger.delta_p["x"], 2.0 * (np.cos(rate * t) - 1.0), atol=1e-12)
    np.testing.assert_allclose(ledger.delta_p["y"], 2.0 * np.sin(rate * t), atol=1e-12)


def test_long_logs_and_a_few_rows_of_them() -> None:
    """All rows in one pass, and a few that are kept, say the same as blocks of rows do."""
    problem = dc.problems.load("double-pendulum")
    run = dc.simulate(problem, None, 10.0, 1e-3, "ode4")
    whole = dc.balance(problem, run, "samples")
    few = dc.balance(problem, run, "samples", keep=50)
    rows = np.searchsorted(run.t, few.t)
    for name, values in whole.delta_p.items():
        np.testing.assert_allclose(few.delta_p[name], values[rows], atol=1e-11)
        size = whole.momentum_exchanged[name]
        assert few.momentum_exchanged[name] == pytest.approx(size, rel=1e-2)


def test_ensembles_refuse_them() -> None:
    with pytest.raises(dc.InputError, match="momentum functions"):
        dc.simulate_ensemble("double-pendulum", None, 0.1, 0.01, record=RECORD)


def pushed(rows: int = 400, step: float = 5e-3) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A slider under a sine that is held over each step; its motion, parabolas, in closed form."""
    mechanism = dc.Mechanism(
        [dc.point_mass("mass", 2.0)],
        [dc.prismatic("slide", "ground", "mass", axis="x")],
        forces=[dc.forces.joint_torque("motor", "slide")],
    )
    t = step * np.arange(rows)
    force = 3.0 * np.sin(4.0 * t)
    u = 0.3 + np.concatenate([[0.0], np.cumsum(force[:-1] / 2.0 * step)])
    q = np.concatenate([[0.0], np.cumsum(u[:-1] * step + force[:-1] / 4.0 * step**2)])
    log = dc.Trajectory(
        t=t, q=q[:, None], u=u[:, None], forces={"actuator motor": force[:, None]},  # type: ignore[arg-type]
        coordinates=("slide",), speeds=("slide",), provenance=dc.Provenance("own loop", step=step),
    )  # fmt: skip
    return mechanism, log


@pytest.mark.parametrize("declared", [True, False])
def test_the_impulse_of_a_held_force_is_known_without_quadrature(declared: bool) -> None:
    """As the log declares, or as the audit finds: ΔP is rounding, and so is its error bar."""
    mechanism, log = pushed()
    if declared:
        held = replace(log, provenance=replace(log.provenance, held=("actuator motor",)))
        found = dc.balance(mechanism, held).momenta()["slide"]
    else:
        smooth = dc.balance(mechanism, log).momenta()["slide"]
        assert smooth["relative"] > 1e-4  # a curve through the values is half a step late
        found = dc.audit(mechanism, log).momenta()["slide"]
    assert found["relative"] < 1e-11
    assert found["error_bar"] < 1e-11
