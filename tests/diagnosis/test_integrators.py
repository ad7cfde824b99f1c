"""Maps of integrators against steps that are written by hand, and the integrators that logs tell.

The oracle is a cart-pole with its own equations and integrators, which share no code with deltac.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.inference.flow import predict
from deltac.diagnosis.inference.forces import ForceBetween, LoggedForce
from deltac.diagnosis.inference.integrators import (
    by_causes,
    maps,
    steps_between,
    transition,
)
from deltac.diagnosis.inference.methods import alike, likeliest_of
from deltac.diagnosis.inference.model import Intervals, LogModel
from tests.support.slow import repeated
from tests.systems.cart_pole import SCHEMES, CartPole, log

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()
STEP = 0.004

Off = dict[str, float]


def between_rows(
    run: dc.Trajectory, kind: str = "smooth"
) -> tuple[LogModel, Intervals, ForceBetween]:
    """The intervals of a log, with all forces of a kind."""
    model = LogModel(MECHANISM, run)
    rows = model.rows(run)
    intervals = Intervals(rows.take(slice(0, -1)), rows.take(slice(1, None)))
    kinds = (kind,) * rows.F.shape[1]
    return model, intervals, LoggedForce.of(intervals, [(0, len(intervals))])(kinds)


def off_by(run: dc.Trajectory, kind: str, step: float = STEP) -> Off:
    """How far the rows of each method's map are from the next rows of a log, the largest."""
    model, intervals, force = between_rows(run, kind)
    gaps: Off = {}
    for of in maps(model, intervals, force, steps_between(intervals.h, step)):
        gap = float(np.abs(model.difference(of.end, intervals.end)).max())
        gaps[of.method.name] = min(gap, gaps.get(of.method.name, np.inf))
    return gaps


@pytest.mark.parametrize(
    ("scheme", "held", "kind"),
    [
        ("explicit-euler", True, "start"),
        ("semi-implicit-euler", True, "start"),
        ("heun", True, "start"),
        ("heun", False, "ramp"),
        ("rk4", True, "start"),
        ("trapezoidal", False, "smooth"),
        ("implicit-euler", False, "smooth"),
    ],
)
def test_a_map_makes_the_rows_of_a_loop_written_by_hand(scheme: str, held: bool, kind: str) -> None:
    """To rounding, or to what a fixed-point iteration leaves; all others miss by far."""
    gaps = off_by(log(RIGHT, scheme, held=held, duration=0.8), kind)
    assert gaps.pop(scheme) < 1e-12
    gaps.pop("implicit-damping-euler", None)  # which differs by the dampers alone
    assert min(gaps.values()) > 1e-9


@pytest.mark.parametrize("scheme", ["explicit-euler", "semi-implicit-euler", "heun", "rk4"])
def test_steps_between_two_rows_are_repeated(scheme: str) -> None:
    """Two rows in three are left out of a motion without a motor."""
    run = log(CartPole(drive=0.0), scheme, duration=0.8)
    gaps = off_by(run.every(3), "smooth")
    assert gaps.pop(scheme) < 1e-12
    uneven = run.take(np.delete(np.arange(len(run)), [3, 4, 8, 20, 21, 22]))
    assert off_by(uneven, "smooth")[scheme] < 1e-12


def test_rows_between_the_steps_have_no_map() -> None:
    run = log(CartPole(drive=0.0), "heun", duration=0.8)
    assert not off_by(replace(run, t=1.37 * run.t), "smooth")


def test_derivatives_of_a_map_are_those_of_steps_from_other_rows() -> None:
    """Semi-implicit Euler written by hand, from states that are moved by central differences."""
    system = CartPole(drive=0.0)
    run = log(system, "semi-implicit-euler", duration=0.2)
    model, intervals, force = between_rows(run)
    counts = steps_between(intervals.h, STEP)
    assert counts is not None
    (of,) = (
        x for x in maps(model, intervals, force, counts) if x.method.name == "semi-implicit-euler"
    )
    Phi = transition(model, of, intervals, force)
    assert Phi is not None
    for k in (0, 20):
        for i, e in enumerate(np.eye(4)):
            moved = []
            for d in (1e-5, -1e-5):
                q, u = run.q[k] + d * e[:2], run.u[k] + d * e[2:]
                moved.append(
                    np.concatenate(
                        SCHEMES["semi-implicit-euler"](
                            lambda t, q, u: system.acceleration(t, q, u), 0.0, q, u, STEP
                        )
                    )
                )
            assert Phi[k, :, i] == pytest.approx((moved[0] - moved[1]) / 2e-5, abs=1e-6)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_cause_moves_rows_as_steps_of_other_equations(scheme: str) -> None:
    """Steps by hand with the cart's damper a little off, against the map's derivative."""
    system, d = CartPole(drive=0.0), 1e-5
    run = log(system, scheme, duration=0.2)
    model, intervals, force = between_rows(run)
    counts = steps_between(intervals.h, STEP)
    assert counts is not None
    (of,) = (
        x
        for x in maps(model, intervals, force, counts)
        if x.method.name == scheme and not x.method.later and not x.method.rotations
    )
    nodes = predict(model, intervals, force, np.zeros((1, 4)), 2).nodes
    J = [model.jacobian(at) for at in nodes]
    braking = [np.column_stack([-at.u[:, 0], 0.0 * at.u[:, 0]])[:, :, None] for at in nodes]
    G = [model.response(at.t, at.q, f) for at, f in zip(nodes, braking, strict=True)]
    told = by_causes(of, J, G, intervals)
    assert told is not None
    for k in (3, 20):
        q, u = run.q[k], run.u[k]
        ends = []
        for sign in (1.0, -1.0):
            other = replace(system, slide=system.slide + sign * d)
            f = lambda t, q, u, other=other: other.acceleration(t, q, u)  # noqa: E731
            ends.append(np.concatenate(SCHEMES[scheme](f, 0.0, q, u, STEP)))
        expected = (ends[0] - ends[1]) / (2.0 * d)
        # J and G are of the flow, which departs from the stages by h²: to some (ω h)² of the speeds' change.
        # What a method leaves as it is stays so.
        size = np.abs(expected[2:]).max() * np.array([STEP, STEP, 1.0, 1.0])
        assert np.all(np.abs(told[k, :, 0] - expected) <= 2e-3 * size)
        assert np.all(told[k, :2, 0][np.abs(expected[:2]) < 1e-12] == 0.0)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_log_tells_its_integrator(scheme: str) -> None:
    audit = dc.audit(MECHANISM, log(RIGHT, scheme, accelerations=False))
    assert audit.integrator is not None and scheme in audit.integrator.names
    assert len(audit.integrator.names) <= 3  # what the rows do not tell apart
    assert audit.verdict.kind in ("consistent", "integration-error")
    assert not audit.causes


@pytest.mark.parametrize(
    "scheme", repeated(("explicit-euler", "heun", "implicit-euler"), "explicit-euler", "heun")
)
def test_a_log_that_lacks_rows_tells_its_integrator(scheme: str) -> None:
    """Six rows in ten, at random."""
    run = log(RIGHT, scheme, accelerations=False)
    kept = np.sort(np.random.default_rng(1).choice(len(run), int(0.6 * len(run)), replace=False))
    audit = dc.audit(MECHANISM, run.take(kept))
    assert audit.integrator is not None and scheme in audit.integrator.names
    assert audit.verdict.kind != "equation-error"
    assert not [f for f in audit.findings if f.weight == "cause"]


def test_numbers_that_were_fitted_to_the_memory_of_a_method_have_a_price() -> None:
    """Of N = 12000 numbers, 1e-3 less in squares gains ½ N·1e-3 = 6; seven numbers cost 7·½ ln N = 33."""
    r = np.random.default_rng(0).standard_normal((1000, 12))
    both = np.stack([r, np.sqrt(1.0 - 1e-3) * r], axis=2)
    assert likeliest_of(both, np.array([0, 0])) == 1
    assert likeliest_of(both, np.array([0, 7])) == 0
    assert list(alike(both, 0, 0.0, np.array([0, 7]))) == [0]
    # A method that closes the rows is worth its numbers.
    assert likeliest_of(np.stack([r, 1e-3 * r], axis=2), np.array([0, 7])) == 1


SERVO = """<mujoco><option timestep="2e-3" integrator="{}"/><worldbody><body><joint name="upper" axis="0 1 0"
    damping="0.05"/><inertial pos="0 0 -0.2" mass="0.8" diaginertia="0.01 0.01 0.01"/><body pos="0 0 -0.4">
    <joint name="lower" axis="0 1 0"/><inertial pos="0 0 -0.15" mass="0.3" diaginertia="0.003 0.003 0.001"/>
    </body></body></worldbody><actuator>
    <position joint="lower" kp="6" kv="0.1" gear="2"/></actuator></mujoco>"""


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize(
    ("integrator", "name"),
    [
        ("implicitfast", "implicit-all-damping-euler"),
        ("implicit", "implicit-speed-euler"),
        ("Euler", "implicit-damping-euler"),
    ],
)
def test_mujocos_implicit_methods_take_the_damping_of_servos_too(
    integrator: str, name: str, every: int
) -> None:
    """Their force is logged; its damping at the end of a step looks like a rotor of inertia h·kv·gear²."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    model = mujoco.MjModel.from_xml_string(SERVO.format(integrator))
    data, rows = mujoco.MjData(model), list[tuple[float, Array, Array, float]]()
    data.qpos[:] = 0.9, -0.4
    for k in range(1200):
        data.ctrl[0] = np.sin(7e-3 * k)
        q, u = data.qpos.copy(), data.qvel.copy()
        mujoco.mj_step(model, data)
        rows.append((k * 2e-3, q, u, float(data.qfrc_actuator[1])))
    t, states, speeds, force = (np.array(x)[::every] for x in zip(*rows, strict=True))
    log = {"time": t, "qpos": states, "qvel": speeds, "tau": np.outer(force, [0.0, 1.0])}
    audit = dc.audit(model, log)
    assert audit.verdict.kind != "equation-error" and not audit.causes
    if every == 1:
        assert audit.verdict.kind == "integration-error"
        assert audit.integrator is not None and audit.integrator.names == (name,)


@pytest.mark.parametrize(
    ("integrator", "name"),
    [("Euler", "implicit-damping-euler"), ("implicitfast", "implicit-all-damping-euler")],
)
def test_dampers_at_the_end_of_mujocos_step(integrator: str, name: str) -> None:
    """Its Euler method takes the damper of a cord as a force at the row, `implicitfast` does not.

    The true joules are those of each step beyond the flow of a pendulum that is written out here.
    """
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    h, mass, length, moment, pin, cord = 2e-3, 1.0, 0.5, 0.05, 0.2, 0.3
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{h}" integrator="{integrator}"/><worldbody><body>
        <joint name="pin" axis="0 1 0" damping="{pin}"/><inertial pos="0 0 -{length}" mass="{mass}"
        diaginertia="{moment} {moment} {moment}"/></body></worldbody><tendon><fixed name="cord"
        damping="{cord}"><joint joint="pin" coef="1"/></fixed></tendon></mujoco>"""
    )
    data, rows = mujoco.MjData(model), list[tuple[float, float, float]]()
    data.qpos[0] = 2.0
    for _ in range(800):
        rows.append((data.time, data.qpos[0], data.qvel[0]))
        mujoco.mj_step(model, data)
    t, q, u = np.array(rows).T
    run = dc.Trajectory(t=t, q=q[:, None], u=u[:, None], coordinates=("pin",), speeds=("pin",))
    audit = dc.audit(model, run)
    assert not audit.causes and audit.integrator is not None
    assert audit.integrator.names == (name,)

    inertia = moment + mass * length**2

    def rate(_: float, x: Array) -> Array:
        weight = mass * 9.81 * length * np.sin(x[0])
        return np.array([x[1], -(weight + (pin + cord) * x[1]) / inertia])

    def energy(x: Array) -> float:
        return float(0.5 * inertia * x[1] ** 2 - mass * 9.81 * length * np.cos(x[0]))

    joules = 0.0
    for start, end in zip(np.column_stack([q, u])[:-1], np.column_stack([q, u])[1:], strict=True):
        exact = solve_ivp(rate, (0.0, h), start, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        joules += energy(end) - energy(exact)
    share = audit.attribution.integrator  # type: ignore[union-attr]
    assert share.energy == pytest.approx(joules, abs=2.0 * share.error + 1e-9)
