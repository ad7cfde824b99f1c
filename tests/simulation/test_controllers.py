"""Controllers: Python functions that set motors, held over a step or asked at every stage."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError

LAW = "-2*q.hinge - 0.5*u.hinge + sin(3*t)"


def machine(law: Any = None) -> dc.Mechanism:
    return dc.Mechanism(
        [
            dc.bodies.box("arm", 1.0, [0.2, 0.3, 0.5], [0.1, 0, -0.4]),
            dc.bodies.box("tip", 0.5, [0.2, 0.1, 0.3]),
        ],
        [
            dc.revolute("hinge", "ground", "arm", "y"),
            dc.joints.universal("wrist", "arm", "tip", position=[0, 0, -0.6]),
        ],
        [
            dc.forces.joint_torque("motor", "hinge", law),
            dc.forces.joint_torque(
                "fingers", "wrist", None if law is None else [0.1, "-0.2*u.wrist.second"]
            ),
        ],
        gravity=[0, 0, -9.81],
    )


def answer(t: float, q: Any, u: Any) -> dict[str, Any]:
    return {"motor": -2 * q[0] - 0.5 * u[0] + np.sin(3 * t), "fingers": [0.1, -0.2 * u[2]]}


START = {"hinge": 0.4, "wrist.first": 0.2}


@pytest.mark.parametrize("solver", ["ode4", "DOP853"])
def test_a_continuous_controller_is_a_law(solver: str) -> None:
    free, ruled = machine(), machine(LAW)
    run = dc.simulate(
        free, free.state(START), 1.0, 0.01, solver, controller=dc.Controller(answer, hold=False)
    )
    law = dc.simulate(ruled, ruled.state(START), 1.0, 0.01, solver)
    tolerance = 1e-12 if solver == "ode4" else 1e-7
    np.testing.assert_allclose(run.q, law.q, atol=tolerance)
    np.testing.assert_allclose(run.udot, law.udot, atol=100 * tolerance)  # type: ignore[arg-type]
    for name, values in law.integrals.items():
        np.testing.assert_allclose(run.integrals[name], values, atol=20 * tolerance)
    expected = [list(np.hstack(list(answer(*row).values()))) for row in zip(run.t, run.q, run.u)]
    np.testing.assert_allclose(run.forces["actuator motor"][:, 0], np.array(expected)[:, 0])
    np.testing.assert_allclose(run.forces["actuator fingers"][:, 1:], np.array(expected)[:, 1:])
    assert not run.forces["actuator motor"][:, 1:].any()
    assert run.provenance.held is None


def constant(value: Any, t: float, q: Any, u: Any) -> Any:
    """The same at every instant."""
    return value


def test_a_held_controller_is_a_constant_over_each_step() -> None:
    """Against a run of many short runs, each with a constant torque."""
    free = machine()
    controller = dc.Controller(answer)
    run = dc.simulate(free, free.state(START), 0.2, 0.02, "ode4", controller=controller)
    state = free.state(START)
    for k in range(10):
        held = answer(k * 0.02, state.q, state.u)
        step = dc.simulate(
            *(free, state, 0.02, 0.02, "ode4"),
            controller=dc.Controller(partial(constant, held), hold=False),
        )
        np.testing.assert_allclose(run.q[k + 1], step.q[-1], atol=1e-14)
        np.testing.assert_allclose(run.u[k + 1], step.u[-1], atol=1e-13)
        assert run.forces["actuator motor"][k, 0] == pytest.approx(held["motor"], abs=1e-13)
        state = free.state(run.q[k + 1], run.u[k + 1], (k + 1) * 0.02)
    assert set(run.provenance.held) == {"actuator motor", "actuator fingers"}  # type: ignore[arg-type]


def test_a_held_controller_is_asked_once_a_step() -> None:
    free, calls = machine(), []

    def counting(t: float, q: Any, u: Any) -> dict[str, Any]:
        calls.append(t)
        return answer(t, q, u)

    dc.simulate(
        *(free, free.state(START), 0.2, 0.02, "ode5", ()), controller=dc.Controller(counting)
    )
    times = sorted({round(t, 9) for t in calls})
    np.testing.assert_allclose(times, np.arange(11) * 0.02, atol=1e-9)


def driven(h: float, *, hold: bool, solver: str = "ode4") -> dc.Trajectory:
    free = machine()
    controller = dc.Controller(answer, hold=hold)
    return dc.simulate(free, free.state(START), 1.0, h, solver, controller=controller)


@pytest.mark.parametrize("hold", [False, True])
def test_the_ledger_closes_in_the_loop_to_the_order_of_the_solver(hold: bool) -> None:
    sizes = []
    for h in (0.01, 0.005):
        run = driven(h, hold=hold)
        loop = dc.balance(machine(), run)
        sizes.append(np.abs(loop.delta_c["wang"]).max())
        samples = dc.balance(machine(), run, work="samples")
        assert samples.basis["actuator motor"] == "measured"
        apart = np.abs(samples.work["actuator motor"] - loop.work["actuator motor"])
        bars = samples.work_error["actuator motor"] + loop.work_error["actuator motor"]
        assert (apart <= bars).all() and loop.work_from["actuator motor"] == "in-loop"
    assert 3.5 < np.log2(sizes[0] / sizes[1]) < 5.5


def test_the_ledger_closes_on_samples_of_a_logged_motor() -> None:
    """A motion exact to rounding, every tenth row of it: what is left is the quadrature's, in its bar."""
    run = driven(0.001, hold=False, solver="ode8")
    exact = dc.balance(machine(), run)
    samples = dc.balance(machine(), run.every(10), work="samples")
    for name, left in exact.delta_c.items():
        error = np.abs(samples.delta_c[name] - left[::10])
        assert (error <= samples.error_bar[name]).all(), name
        assert samples.error_bar[name].max() < 1e-6  # J, of some 10 J exchanged


def refused(function: Any, words: str, **options: Any) -> None:
    free = machine()
    with pytest.raises(InputError, match=words):
        dc.simulate(
            *(free, free.state(START), 0.1, 0.01), controller=dc.Controller(function), **options
        )


def test_answers_that_make_no_sense() -> None:
    refused(lambda t, q, u: 3.0, "returned float, expected a mapping .*motor, fingers")
    refused(lambda t, q, u: {"moter": 1.0}, "unknown joint torque 'moter'; did you mean 'motor'")
    refused(lambda t, q, u: {"motor": 1.0}, "no value for joint torque 'fingers'")
    refused(lambda t, q, u: {"motor": 1.0, "fingers": 1.0}, "'fingers' at t = 0; expected 2 finite")
    refused(lambda t, q, u: {"motor": np.nan, "fingers": [0, 0]}, "nan.*'motor'.*finite")
    refused(answer, "cannot be held.*'ode5'.*hold=False", solver="DOP853")


def test_motors_and_controllers_need_each_other() -> None:
    free, ruled = machine(), machine(LAW)
    with pytest.raises(
        InputError, match="joint torque 'motor' has no law; give simulate a controller"
    ):
        dc.simulate(free, free.state(START), 0.1, 0.01)
    with pytest.raises(InputError, match="no joint torque is without a law"):
        dc.simulate(ruled, ruled.state(START), 0.1, 0.01, controller=dc.Controller(answer))
    with pytest.raises(InputError, match="equations by hand and a controller"):
        dc.simulate(
            *(free, free.state(START), 0.1, 0.01),
            controller=dc.Controller(answer),
            equations=dc.Equations(lambda t, q, u: -u),
        )
    with pytest.raises(InputError, match="'taylor' needs equations in symbols"):
        dc.simulate(
            *(free, free.state(START), 0.1, 0.01, "taylor"),
            controller=dc.Controller(answer, hold=False),
        )
