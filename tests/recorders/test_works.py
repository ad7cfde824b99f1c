"""Works that recorders take by the integrator's own stages: ΔC has the integrator's error and no other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import deltac as dc
from deltac.errors import InputError
from deltac.importers import read_mechanism
from deltac.mechanism.channels import ChannelName
from deltac.recorders import TrajectoryBuilder, run_mujoco
from deltac.trajectories import Trajectory
from tests.recorders import models
from tests.support.slow import crossed

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")

Array = NDArray[Any]
ROUNDING = 1e-13  # of the energy exchanged, for a bar in which nothing but rounding is left

BALL = """
<mujoco model="ball"><option timestep="0.002" integrator="RK4"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1" solref="0.05 0.6"/>
    <body name="ball" pos="0 0 0.3"><freejoint name="base"/>
      <geom name="ball" size="0.1" mass="0.5" solref="0.05 0.6"/></body>
  </worldbody>
</mujoco>"""


def drive(model: Any, data: Any) -> None:
    data.ctrl[:] = np.sin(9.0 * data.time + np.arange(model.nu))


def thrust(model: Any, data: Any) -> None:
    data.xfrc_applied[1] = [0.3 * np.sin(40.0 * data.time), 0.1, 1.0, 0.002, -0.001, 0.003]


@cache
def recorded(name: str, step: float, integrator: str = "rk4") -> Trajectory:
    model = models.compiled(BALL if name == "BALL" else getattr(models, name))
    driven = model.nu > 0
    return run_mujoco(
        model,
        0.48,
        data=models.started(model, 10.0 if name == "TUMBLER" else 0.5),
        step=step,
        integrator=integrator,
        controller=drive if driven else thrust,
    )


def mechanism_of(name: str) -> dc.Mechanism:
    return read_mechanism(models.compiled(BALL if name == "BALL" else getattr(models, name)))[0]


def error(mechanism: dc.Mechanism, run: Trajectory, function: str = "wang") -> tuple[float, float]:
    """The largest |ΔC| and its bar, as parts of the energies that they are differences of."""
    ledger = dc.balance(mechanism, run)
    assert ledger.method == "in-loop"
    size = ledger.energy_exchanged + float(np.max(ledger.kinetic + np.abs(ledger.potential_energy)))
    left = np.abs(ledger.delta_c[function]).max()
    return float(left) / size, float(ledger.error_bar[function].max()) / size


@pytest.mark.long
@pytest.mark.parametrize(
    ("function", "name"),
    crossed(("wang", "liu-huston", "kane-levinson-1990"), ("CARTS", "SWINGER", "TUMBLER", "ARM")),
)
def test_runge_kutta_is_of_fourth_order(name: str, function: str) -> None:
    """Motors held over each step, dampers, springs, a tendon, a floating base under a held wrench."""
    runs = [recorded(name, step) for step in (0.004, 0.002)]
    found = [error(mechanism_of(name), run, function) for run in runs]
    assert all(bar < ROUNDING for _, bar in found)
    assert 3.6 < np.log2(found[0][0] / found[1][0]) < 5.2


@pytest.mark.parametrize(
    ("name", "integrator"),
    crossed(("CARTS", "SWINGER", "TUMBLER", "ARM"), ("euler", "implicit", "implicitfast")),
)
def test_the_others_are_of_first_order(name: str, integrator: str) -> None:
    found = [error(mechanism_of(name), recorded(name, step, integrator)) for step in (0.004, 0.002)]
    assert all(bar < ROUNDING for _, bar in found)
    assert 0.8 < np.log2(found[0][0] / found[1][0]) < 2.2


def test_the_energy_error_of_semi_implicit_euler_in_closed_form() -> None:
    """A weight under a held force: every step adds m h g (u_{k+1} − u_k)/2, whatever the force."""
    model = models.compiled(
        '<mujoco><option integrator="Euler"/><worldbody><body><joint name="z" type="slide" axis="0 0 1"/>'
        '<geom size="0.1" mass="2"/></body></worldbody>'
        '<actuator><motor name="lift" joint="z"/></actuator></mujoco>'
    )
    run = run_mujoco(model, 0.5, step=0.005, controller=lambda m, d: d.ctrl.fill(30 * d.time))
    ledger = dc.balance(read_mechanism(model)[0], run)
    h, m, g = 0.005, 2.0, 9.81
    force = np.concatenate([[0.0], np.cumsum(30 * run.t[:-1] / m - g)])
    assert np.allclose(ledger.delta_c["wang"], 0.5 * m * g * h * h * force, atol=1e-12)
    moved = np.concatenate(
        [[0.0], np.cumsum(30 * run.t[:-1] * h * (run.u[1:] + run.u[:-1])[:, 0] / 2)]
    )
    assert np.allclose(ledger.work["actuator lift"], moved, atol=1e-12)


def test_works_agree_with_an_integration_by_another_program() -> None:
    """Of the cart's damper and motor, by SciPy from the equations written by hand, step by step."""
    run = recorded("CARTS", 0.002)
    h, y, works = 0.002, np.array([*run.q[0], *run.u[0], 0.0, 0.0]), [np.zeros(2)]
    for k in range(len(run) - 1):
        push = np.sin(9.0 * k * h)

        def rates(_: float, y: Array, push: float = push) -> list[float]:
            x, z, vx, vz = y[:4]
            ax = (push - 0.5 * vx - 20 * x + 3.0 * 0.3) / 3.0
            return [vx, vz, ax, -50 * z - 9.81, -0.5 * vx * vx, push * vx]

        y = solve_ivp(rates, (0.0, h), y, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        works.append(y[4:])
    expected = np.array(works).T
    for name, values in zip(("damper x", "actuator push"), expected):
        scale = np.abs(values).max()
        assert np.allclose(run.works[ChannelName.parse(name)], values, atol=1e-8 * scale)


@pytest.mark.long
def test_the_contact_of_a_ball() -> None:
    """The forces have kinks, so the order is lost; bars are still rounding, and ΔC is the integrator's."""
    mechanism = mechanism_of("BALL")
    found = [error(mechanism, recorded("BALL", step)) for step in (0.002, 0.0005)]
    assert found[1][0] < 0.2 * found[0][0] < 1e-3
    assert all(bar < ROUNDING for _, bar in found)
    work = dc.balance(mechanism, recorded("BALL", 0.0005)).work["contact floor:ball"]
    assert work[-1] < -0.01
    # MuJoCo's own energy says the same.
    model = models.compiled(BALL)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, run = mujoco.MjData(model), recorded("BALL", 0.002)
    data.qpos[:], data.qvel[:] = run.q[-1], run.u[-1]
    mujoco.mj_forward(model, data)
    end = data.energy.sum()
    data.qpos[:], data.qvel[:] = run.q[0], run.u[0]
    mujoco.mj_forward(model, data)
    gone = end - data.energy.sum() - sum(work[-1] for work in run.works.values())
    assert dc.balance(mechanism, run).delta_c["wang"][-1] == pytest.approx(gone, abs=1e-12)


@pytest.mark.parametrize("integrator", ["rk4", "implicitfast"])
def test_a_planted_fault_is_still_seen(integrator: str) -> None:
    """The works are the simulator's, the energies the model's: a mass 5 % off does not balance."""
    run, right = recorded("SWINGER", 0.002, integrator), mechanism_of("SWINGER")
    body = right.bodies[-1]
    wrong = replace(right, bodies=(*right.bodies[:-1], replace(body, mass=1.05 * body.mass)))
    ledgers = [dc.balance(model, run) for model in (right, wrong)]
    missing = np.abs(ledgers[1].delta_c["wang"] - ledgers[0].delta_c["wang"]).max()
    assert missing > 5e-4 * ledgers[0].energy_exchanged > 1e6 * ledgers[0].error_bar["wang"].max()
    if integrator == "rk4":
        assert missing > 1e4 * np.abs(ledgers[0].delta_c["wang"]).max()


def test_rows_may_be_left_out() -> None:
    """The works are known between the rows too."""
    run, mechanism = recorded("SWINGER", 0.002), mechanism_of("SWINGER")
    full, thin = dc.balance(mechanism, run), dc.balance(mechanism, run.every(20))
    assert np.allclose(thin.delta_c["wang"], full.delta_c["wang"][::20], atol=1e-13)


def test_what_a_run_declares(tmp_path: Path) -> None:
    run = recorded("SWINGER", 0.002)
    p = run.provenance
    assert (p.solver, p.step, p.order, p.held, p.inputs) == (
        "rk4",
        0.002,
        4,
        ("actuator turn",),
        "held",
    )
    assert run.works.keys() == run.forces.keys()
    run.write(tmp_path / "run.parquet")
    again = dc.read_trajectory(tmp_path / "run.parquet")
    assert (again.provenance.order, again.provenance.inputs) == (4, "held")
    assert all(np.array_equal(again.works[name], run.works[name]) for name in run.works)


def test_stages_of_a_loop_of_ones_own() -> None:
    """A pendulum with a held motor and a damper by the classical Runge–Kutta method."""
    pendulum = dc.Mechanism(
        bodies=[dc.point_mass("bob", mass=2.0, at=(0, -0.5, 0))],
        joints=[dc.revolute("pivot", "ground", "bob", "z")],
        forces=[dc.forces.joint_torque("motor", "pivot")],
        gravity=(0, -9.81, 0),
    )
    errors = []
    for h in (0.02, 0.01):
        rec = TrajectoryBuilder(("pivot",), ("pivot",))
        y = np.array([0.3, 0.0])
        for k in range(round(1.0 / h) + 1):
            torque = np.sin(20 * ((k * h + 1e-9) // 0.04) * 0.04)  # switched every 0.04 s

            def rates(y: Array, torque: float = torque) -> Array:
                return np.array([y[1], (torque - 0.1 * y[1]) / 0.5 - 9.81 / 0.5 * np.sin(y[0])])

            def forces(y: Array, torque: float = torque) -> dict[str, list[float]]:
                return {"actuator motor": [torque], "damper pivot": [-0.1 * y[1]]}

            rec.add(k * h, y[:1], y[1:], rates(y)[1:], forces(y))
            slope, mean = np.zeros(2), np.zeros(2)
            for ahead, weight in ((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)):
                at = y + ahead * h * slope
                slope = rates(at)
                mean += weight * slope
                rec.stage(weight * h, at[1:], forces(at))
            y = y + h * mean
        errors.append(error(pendulum, rec.trajectory(dc.Provenance("by hand", "rk4", h))))
    assert all(bar < ROUNDING for _, bar in errors)
    assert 3.6 < np.log2(errors[0][0] / errors[1][0]) < 5.0


def test_stages_that_are_missing() -> None:
    rec = TrajectoryBuilder(("x",), ("x",))
    with pytest.raises(InputError, match="add the row first"):
        rec.stage(0.1, [0.0], {})
    for k in range(4):
        rec.add(0.1 * k, [0.0], [1.0])
        if k != 1:
            rec.stage(0.1, [1.0], {"applied x": [2.0]})
    with pytest.raises(InputError, match="row 1, t = 0.1 s, has neither"):
        rec.trajectory(dc.Provenance("a test"))
    with pytest.raises(InputError, match=r"applied x.*\(2,\), expected \(1,\)"):
        rec.stage(0.1, [1.0], {"applied x": [2.0, 1.0]})


@pytest.mark.skipif(find_spec("dm_control") is None, reason="dm_control is not installed")
@pytest.mark.parametrize(
    "name", ["acrobot", "ball_in_cup", "cartpole", "fish", "pendulum", "walker"]
)
def test_the_suite_of_dm_control(name: str) -> None:
    """Its models with RK4 and small controls: the bar of ΔC is rounding, far below the integrator's error."""
    spec = find_spec("dm_control")
    assert spec is not None and spec.origin is not None
    model = mujoco.MjModel.from_xml_path(str(Path(spec.origin).parent / "suite" / f"{name}.xml"))
    run = run_mujoco(
        model,
        15 * model.opt.timestep,
        integrator="rk4",
        controller=lambda m, d: np.copyto(d.ctrl, 0.1 * np.sin(3 * d.time + np.arange(m.nu))),
    )
    assert run.provenance.completed
    _, bar = error(read_mechanism(model)[0], run)
    assert bar < ROUNDING
