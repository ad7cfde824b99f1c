"""Runs with friction and contact: exact impacts, the ledger, MuJoCo where the models coincide, advice."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import beta

from deltac import (
    InputError,
    Mechanism,
    StiffStepWarning,
    assemble,
    balance,
    free,
    point_mass,
    prismatic,
    problems,
    revolute,
    shapes,
    simulate,
    time_scales,
)
from deltac.bodies import box, disc, frame, sphere
from deltac.forces import contact, friction_law, joint_friction, joint_torque, point_friction
from deltac.solvers import FixedStep, Scipy, by_name
from tests.support.slow import repeated

MASS = 0.7


def ball_at_a_wall(**given: Any) -> Mechanism:
    """A point that runs into a wall at x = 0 from x > 0, without gravity."""
    stiffness = given.pop("stiffness", 4e3)
    return Mechanism(
        [sphere("ball", MASS, 0.1)],
        [prismatic("x", "ground", "ball", "x", position=(0.1, 0, 0))],
        [
            contact(
                "wall",
                shapes.sphere("ball", 0.1),
                shapes.half_space(normal="x"),
                stiffness,
                **given,
            )
        ],
    )


def bounce(machine: Mechanism, speed: float, step: float | None = 1e-4) -> Any:
    state = machine.state({"x": 0.01}, {"x": -speed})
    return simulate(machine, state, 0.4, step, Scipy("DOP853", 1e-11))


@pytest.mark.parametrize("speed", [0.3, 2.0])
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_restitution_of_hunt_and_crossley_is_exact(exponent: float, speed: float) -> None:
    """m v dv/dx = −k xⁿ (1 + d v): ∫ v dv/(1 + d v) is as large on the way out as on the way in.

    So v − ln(1 + d v)/d is equal at both ends, whatever k and n.
    """
    d = 0.6
    run = bounce(ball_at_a_wall(exponent=exponent, dissipation=d), speed)

    def level(v: float) -> float:
        return v - math.log1p(d * v) / d

    out = brentq(lambda v: level(-v) - level(speed), 1e-9, min(speed, 1 / d - 1e-12), xtol=1e-14)
    assert run.speed("x")[-1] == pytest.approx(out, rel=1e-9)
    assert run.speed("x")[-1] < 1 / d


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_elastic_impacts_last_as_long_as_hertz_says(exponent: float) -> None:
    """T = 2 x_m/v ∫ dz/√(1 − zⁿ⁺¹) = 2 x_m/v B(1/(n+1), ½)/(n + 1), ½ m v² = k x_mⁿ⁺¹/(n + 1)."""
    v, k = 1.3, 4e3
    run = bounce(ball_at_a_wall(exponent=exponent), v)
    n1 = exponent + 1
    x_m = (n1 * MASS * v**2 / (2 * k)) ** (1 / n1)
    duration = 2 * x_m / v * beta(1 / n1, 0.5) / n1
    # It comes back at −v: the time at which the surfaces part, from the last position.
    parted = run.t[-1] - run.coordinate("x")[-1] / run.speed("x")[-1]
    assert parted - 0.01 / v == pytest.approx(duration, rel=1e-8)
    assert run.speed("x")[-1] == pytest.approx(v, rel=1e-9)


def test_kelvin_and_voigt_lose_what_a_damped_oscillator_does_until_the_clamp() -> None:
    """Until f = k x + c ẋ falls to zero the motion is a damped oscillator's."""
    k, c, v = 4e3, 20.0, 1.5
    run = bounce(ball_at_a_wall(model="kelvin-voigt", dissipation=c, stiffness=k), v)
    delta = c / (2 * MASS)
    w = math.sqrt(k / MASS - delta**2)

    def speed(t: float) -> float:
        return v * math.exp(-delta * t) * (math.cos(w * t) - delta / w * math.sin(w * t))

    def force(t: float) -> float:
        x = v / w * math.exp(-delta * t) * math.sin(w * t)
        return k * x + c * speed(t)

    end = brentq(force, 1e-3, math.pi / w)
    assert run.speed("x")[-1] == pytest.approx(-speed(end), rel=1e-8)


LEDGERS: dict[str, dict[str, Any]] = {
    "elastic": {"exponent": 1.5},
    "hunt-crossley": {"dissipation": 0.5},
    "kelvin-voigt": {"dissipation": 15.0, "model": "kelvin-voigt"},
}


@pytest.mark.parametrize("case", LEDGERS)
def test_the_balance_closes_in_the_loop_and_on_samples(case: str) -> None:
    """K + V − Q: to the solver's accuracy in the loop; on samples as finely as they are spaced."""
    machine = ball_at_a_wall(**LEDGERS[case])
    run = bounce(machine, 1.0)
    ledger = balance(machine, run)
    assert np.abs(ledger.delta_c["wang"]).max() <= 1e-8 * ledger.energy_exchanged
    missed = []
    for step in (4e-4, 1e-4):
        sampled = balance(machine, bounce(machine, 1.0, step), work="samples")
        missed.append(float(np.abs(sampled.delta_c["wang"]).max()))
    assert missed[1] <= max(0.35 * missed[0], 1e-9)
    lost = 0.5 * MASS * (1.0 - run.speed("x")[-1] ** 2)
    booked = -sum(sampled.work[n][-1] for n in sampled.work if n.startswith("contact"))
    assert booked == pytest.approx(lost, abs=10 * missed[1] + 1e-9)
    assert 0.2 < sampled.potential["spring wall"].max() < 0.35 + 1e-9
    assert sampled.potential["spring wall"][-1] == 0.0


def test_fixed_steps_keep_their_order_if_none_goes_across_a_touch() -> None:
    """With switches=True the instants of touch are found; without, a kink inside a step costs the order."""
    problem = problems.load("ball-on-compliant-floor")
    errors = {True: [], False: []}  # type: dict[bool, list[float]]
    for switches, found in errors.items():
        for step in (2e-3, 1e-3):
            solver = FixedStep("ode5", switches=switches)
            run = simulate(problem.mechanism, problem.state, 2.0, step, solver)
            delta_c = balance(problem.mechanism, run).delta_c["wang"]
            found.append(float(np.abs(delta_c).max()))
    assert errors[True][0] / errors[True][1] >= 0.8 * 2**5
    assert errors[True][1] <= 1e-4 * errors[False][1]


@pytest.mark.parametrize("solver", ["CVODES", "Radau"])
def test_implicit_solvers_take_contact_with_stiff_friction(solver: str) -> None:
    """Steps are not held down by the width, and the balance closes to the tolerance."""
    machine = ball_at_a_wall(dissipation=0.4)
    wall: Any = machine.forces[0]
    rough = Mechanism(
        machine.bodies,
        [prismatic("x", "ground", "ball", (1, 1, 0), position=(0.1, 0, 0))],
        [replace(wall, friction=friction_law(0.4, static=0.6, stribeck=0.01))],
    )
    run = simulate(rough, rough.state({"x": 0.01}, {"x": -1.0}), 0.2, 1e-3, by_name(solver, 1e-9))
    ledger = balance(rough, run)
    assert ledger.work["friction wall"][-1] < -1e-2
    assert np.abs(ledger.delta_c["wang"]).max() <= 1e-6 * ledger.energy_exchanged


def two_balls() -> tuple[Mechanism, Any]:
    """An oblique impact of two balls in space, with friction."""
    machine = Mechanism(
        [sphere("a", 1.0, 0.1), sphere("b", 0.5, 0.08)],
        [free("fa", "a"), free("fb", "b")],
        [
            contact(
                "pair",
                shapes.sphere("a", 0.1),
                shapes.sphere("b", 0.08),
                2e4,
                exponent=1.5,
                dissipation=0.3,
                friction=friction_law(0.3, width=0.05),
            )
        ],
    )
    state = machine.state(
        {"fb.x": 0.25, "fb.y": 0.05}, {"fa.vx": 1.0, "fb.vx": -1.0, "fb.wz": 5.0, "fa.wx": 2.0}
    )
    return machine, state


def test_an_oblique_impact_keeps_the_momentum() -> None:
    machine, state = two_balls()
    run = simulate(machine, state, 0.5, 1e-3, Scipy("DOP853", 1e-11))
    assert np.abs(run.u[-1] - run.u[0]).max() > 0.3

    def momenta(k: int) -> tuple[Any, Any]:
        p = L = np.zeros(3)
        for name, m, r in (("fa", 1.0, 0.1), ("fb", 0.5, 0.08)):
            q = run.q[k][machine.coordinates.of(name)]
            u = run.u[k][machine.speeds.of(name)]
            w, v = q[3], q[4:]
            spin = u[3:] + 2 * np.cross(v, np.cross(v, u[3:]) + w * u[3:])  # world components
            p = p + m * u[:3]
            L = L + m * np.cross(q[:3], u[:3]) + 0.4 * m * r**2 * spin
        return p, L

    for before, after in zip(momenta(0), momenta(-1), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-10)  # the solver's tolerance
    ledger = balance(machine, run)
    assert np.abs(ledger.delta_c["wang"]).max() <= 1e-8 * ledger.energy_exchanged
    assert ledger.work["friction pair"][-1] < -1e-3 and ledger.work["contact pair"][-1] < -1e-3


def test_constant_torque_against_frictionloss_of_mujoco() -> None:
    """In slip MuJoCo's frictionloss is a constant torque, as ours: the motion and the heat agree.

    The models differ about rest: MuJoCo's is a constraint that holds up to a softness, ours creeps.
    """
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.001" integrator="RK4" gravity="0 0 0"/><worldbody><body>
        <joint name="j" type="hinge" axis="0 0 1" frictionloss="0.3"/>
        <inertial pos="0 0 0" mass="1" diaginertia="0.2 0.2 0.2"/></body></worldbody>
        <actuator><motor joint="j"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[0], data.ctrl[0] = 0.5, 1.0
    mujoco.mj_step(model, data, 1000)
    machine = Mechanism(
        [disc("d", 0.4, 1.0, "z")],
        [revolute("j", "ground", "d", "z")],
        [joint_friction("rub", "j", 0.3), joint_torque("motor", "j", 1.0)],
    )
    run = simulate(machine, machine.state(None, {"j": 0.5}), 1.0, 1e-3)
    assert run.speed("j")[-1] == pytest.approx(data.qvel[0], rel=1e-9)
    heat = -balance(machine, run, work="samples").work["friction rub"][-1]
    dissipated = 1.0 * data.qpos[0] - 0.1 * (data.qvel[0] ** 2 - 0.5**2)  # of MuJoCo: work − ΔK
    assert heat == pytest.approx(0.3 * run.coordinate("j")[-1], rel=1e-12)
    assert heat == pytest.approx(dissipated, rel=1e-5)


def test_a_moving_plane_does_work_on_what_lies_on_it() -> None:
    """A lift accelerates a block that lies on it: the work comes in through the drive of the lift."""
    k = 5e3
    sunk = 9.81 / k
    machine = Mechanism(
        [frame("lift"), point_mass("block", 1.0)],
        [
            prismatic("lift", "ground", "lift", "z", motion="0.1*(1 - cos(3*t))"),
            prismatic("z", "ground", "block", "z"),
        ],
        [contact("on", shapes.point("block"), shapes.half_space("lift"), k, dissipation=2.0)],
        gravity=(0, 0, -9.81),
    )
    state = machine.state({"z": -sunk})
    run = simulate(machine, state, 1.0, 1e-3, Scipy("DOP853", 1e-11))
    rise = run.coordinate("z") - run.coordinate("lift")
    assert rise.max() < 0, "it never leaves the lift"
    ledger = balance(machine, run)
    assert np.abs(ledger.delta_c["wang"]).max() <= 1e-8 * ledger.energy_exchanged
    assert ledger.work["prescribed lift"].max() > 0.5


# --- energy from nowhere ------------------------------------------------------------------------------


def test_a_source_that_was_asked_for_is_booked() -> None:
    machine = ball_at_a_wall(dissipation=-0.2, allow_energy_source=True)
    run = bounce(machine, 1.0)
    assert run.speed("x")[-1] > 1.05
    ledger = balance(machine, run)
    gained = 0.5 * MASS * (run.speed("x")[-1] ** 2 - 1.0)
    assert ledger.work["contact wall"][-1] == pytest.approx(gained, rel=1e-2)
    assert np.abs(ledger.delta_c["wang"]).max() <= 1e-8 * ledger.energy_exchanged


# --- starts and steps ---------------------------------------------------------------------------------


def crate(**given: Any) -> Mechanism:
    size = (0.3, 0.2, 0.1)
    return Mechanism(
        [box("crate", 2.0, size)],
        [free("base", "crate")],
        [contact("floor", shapes.box("crate", size), shapes.half_space(), 1e4, **given)],
        gravity=(0, 0, -9.81),
    )


def test_deep_overlaps_at_the_start_are_refused() -> None:
    machine = crate()
    with pytest.raises(
        InputError, match=r"'crate' and 'ground' of contact 'floor' overlap by 0.02 m"
    ):
        simulate(machine, machine.state({"base.z": 0.03}), 0.1, 1e-4)
    simulate(machine, machine.state({"base.z": 0.0401}), 0.1, 1e-4)  # a tenth of the least edge
    deep = crate(deepest=0.05)
    simulate(deep, deep.state({"base.z": 0.03}), 0.1, 1e-4)


def test_a_step_too_large_is_told_with_the_time_scale() -> None:
    """A corner of the crate alone: 1/m_eff = (1 + 3 (l1² + …)/…)/m, by hand."""
    machine = crate()
    state = machine.state({"base.z": 0.05})
    a, b, c = 0.3, 0.2, 0.1
    mobility = (1 + (b / 2) ** 2 / ((b**2 + c**2) / 12) + (a / 2) ** 2 / ((a**2 + c**2) / 12)) / 2.0
    expected = math.sqrt(1 / mobility / 1e4)
    first = time_scales(machine, state)[0]
    assert (first.element, first.kind) == ("contact 'floor'", "oscillation")
    assert first.value == pytest.approx(expected, rel=1e-12)
    with pytest.warns(StiffStepWarning, match=rf"contact 'floor'.*time scale {expected:.3g} s"):
        simulate(machine, state, 0.1, 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error", StiffStepWarning)
        simulate(machine, state, 0.1, 1e-4)
        simulate(machine, state, 0.1, 1e-2, "DOP853")  # the step is only that of the samples


@pytest.mark.parametrize(
    "solver", repeated(["generalized-alpha", "implicit-midpoint", "ode1be"], "generalized-alpha")
)
def test_implicit_steps_too_must_resolve_a_touch(solver: str) -> None:
    """A ball that falls on hard ground; one that lies there asks for nothing."""
    machine = crate(dissipation=0.3)
    falling = machine.state({"base.z": 0.3})
    with pytest.warns(StiffStepWarning, match=r"contact 'floor'.*must resolve every touch"):
        simulate(machine, falling, 0.02, 0.02, solver)
    lying = machine.state({"base.z": 0.05 - 2.0 * 9.81 / (4 * 1e4)})
    with warnings.catch_warnings():
        warnings.simplefilter("error", StiffStepWarning)
        simulate(machine, lying, 0.02, 0.02, solver)
        simulate(machine, falling, 0.001, 1e-4, solver)


def test_time_scales_of_friction() -> None:
    """m w/(μ N) at a point, I w/T in a joint; and a rougher step is indeed unstable there."""
    machine = Mechanism(
        [point_mass("block", 2.0)],
        [prismatic("s", "ground", "block", "x")],
        [point_friction("rub", "block", 10.0, friction_law(0.5, width=0.01))],
    )
    (scale,) = time_scales(machine, machine.state())
    assert scale.value == pytest.approx(2.0 * 0.01 / (0.5 * 10.0), rel=1e-12)
    joint = Mechanism(
        [disc("d", 2.0, 0.5, "z")],
        [revolute("j", "ground", "d", "z")],
        [joint_friction("rub", "j", 3.0, viscous=1.0, width=0.1)],
    )
    (scale,) = time_scales(joint, joint.state())
    assert scale.value == pytest.approx(0.25 / (3.0 / 0.1 + 1.0), rel=1e-12)
    state = machine.state(None, {"s": 0.05})
    end = {}
    for step in (4e-3, 2e-2):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StiffStepWarning)
            end[step] = abs(simulate(machine, state, 0.4, step, "ode4").speed("s")[-1])
    assert end[4e-3] < 1e-8 < 1e-3 < end[2e-2]


def test_the_taylor_solver_refuses_contact() -> None:
    machine = crate()
    with pytest.raises(InputError, match=r"Taylor solver needs smooth equations"):
        simulate(machine, machine.state({"base.z": 0.05}), 0.1, solver="taylor")


def test_a_mechanism_at_rest_on_its_contacts_stays() -> None:
    """Four corners carry the weight; assembly knows nothing of contact."""
    machine = crate(dissipation=1.0, friction=friction_law(0.5, width=0.05))
    rest = 0.05 - 2.0 * 9.81 / (4 * 1e4)
    state = assemble(machine, machine.state({"base.z": rest})).state
    run = simulate(machine, state, 0.5, 1e-3)
    assert np.abs(run.u).max() <= 1e-12
