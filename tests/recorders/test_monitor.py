"""The live monitor: the same ΔC as the ledger's, stops and vetoes in time, in constant memory."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError, UnknownName
from deltac.recorders import BoundExceeded, record_mujoco
from tests.recorders import models
from tests.support.slow import crossed, repeated

PENDULUM = dc.Mechanism(
    bodies=[
        dc.point_mass("upper", mass=2.0, at=(0, -0.5, 0)),
        dc.point_mass("lower", mass=1.0, at=(0, -0.5, 0)),
    ],
    joints=[
        dc.revolute("a", "ground", "upper", "z", damping=0.1),
        dc.revolute("b", "upper", "lower", "z", position=(0, -0.5, 0)),
    ],
    gravity=(0, -9.81, 0),
)


def driven(step: float, torque: float = 0.3) -> tuple[dc.Mechanism, Any]:
    """A double pendulum driven by a motor, by our own solver, its force recorded."""
    motor = dc.forces.joint_torque("motor", "a", [f"{torque}*cos(5*t)"])
    mechanism = dc.Mechanism(
        bodies=PENDULUM.bodies,
        joints=PENDULUM.joints,
        forces=[motor],
        gravity=PENDULUM.gravity,
    )
    run = dc.simulate(
        mechanism, mechanism.state({"a": 1.0}), duration=1.0, step=step, solver="ode3"
    )
    return mechanism, run


def fed(monitor: dc.Monitor, run: Any, *, rated: bool = True, forces: Any = None) -> dc.Monitor:
    for k, t in enumerate(run.t):
        here = {name: force[k] for name, force in (forces or {}).items()}
        monitor.update(t, run.q[k], run.u[k], run.udot[k] if rated else None, here)
    return monitor


# --- against the ledger ---------------------------------------------------------------------------


@pytest.mark.parametrize("rated", [True, False])
@pytest.mark.parametrize("testing", ["wang", "liu-huston"])
def test_delta_c_is_that_of_the_ledger(testing: str, rated: bool) -> None:
    mechanism, run = driven(0.01)
    ledger = dc.balance(mechanism, run, work="samples", testing=(testing,))
    monitor = fed(dc.Monitor(mechanism, on_exceed=None, testing=testing), run, rated=rated)
    apart = abs(monitor.delta_c - ledger.delta_c[testing][-1])
    assert apart <= monitor.error_bar + ledger.error_bar[testing][-1]
    assert monitor.error_bar < (1e-5 if rated else 1e-2) * monitor.energy_exchanged
    assert monitor.energy_exchanged == pytest.approx(ledger.energy_exchanged, rel=1e-3)
    assert set(monitor.work) == set(ledger.work)
    for name, work in monitor.work.items():
        assert work == pytest.approx(ledger.work[name][-1], abs=2 * monitor.error_bar + 1e-12)


@pytest.mark.parametrize(
    ("name", "rated"),
    crossed(("driven-triple-pendulum", "andrews-squeezer", "torque-free-box"), (True, False)),
)
def test_delta_p_is_that_of_the_ledger(name: str, rated: bool) -> None:
    model = dc.load_model(name)
    assert model.problem is not None
    step = model.problem.step
    run = dc.simulate(model, duration=100 * step, step=step, solver="ode2")
    ledger = dc.balance(model, run, work="samples")
    plain, monitor = (
        fed(dc.Monitor(model, on_exceed=None, testing=names), run, rated=rated)
        for names in ("wang", ("wang", "momentum"))
    )
    assert monitor.delta_c == pytest.approx(plain.delta_c, abs=0.1 * plain.error_bar)
    assert monitor.error_bar == pytest.approx(plain.error_bar, rel=1e-3)
    assert plain.delta_p == {} and set(monitor.delta_p) == set(ledger.delta_p)
    for speed, delta_p in monitor.delta_p.items():
        bar = monitor.delta_p_bar[speed]
        exchanged = ledger.momentum_exchanged[speed]
        apart = abs(delta_p - ledger.delta_p[speed][-1])
        assert apart <= bar + ledger.delta_p_bar[speed][-1]
        assert bar <= 1e-4 * exchanged + 1e-12
        assert monitor.momentum_exchanged[speed] == pytest.approx(exchanged, rel=1e-3, abs=1e-12)


def test_delta_p_names_the_equation_and_forgets_steps_taken_back() -> None:
    """A force on one joint that the model lacks: ΔP of that speed is its impulse, that of the other 0."""
    mechanism, _ = driven(0.01)
    motor = dc.forces.joint_torque("hand", "b", ["0.2*sin(3*t)"])
    other = dc.Mechanism(
        bodies=PENDULUM.bodies,
        joints=PENDULUM.joints,
        forces=[*mechanism.forces, motor],
        gravity=PENDULUM.gravity,
    )
    run = dc.simulate(other, other.state({"a": 1.0}), duration=1.0, step=0.01, solver="ode5")
    monitor = dc.Monitor(mechanism, on_exceed=None, testing="momentum")
    for k, t in enumerate(run.t):
        if k:
            assert run.udot is not None
            monitor.update(t, run.q[k] + 0.1, run.u[k] - 3.0, run.udot[k])
            monitor.reject()
        assert run.udot is not None
        monitor.update(t, run.q[k], run.u[k], run.udot[k])
    impulse = 0.2 / 3.0 * (1.0 - np.cos(3.0 * run.t[-1]))
    assert monitor.delta_p["b"] == pytest.approx(impulse, abs=1e-6)
    assert abs(monitor.delta_p["a"]) <= monitor.delta_p_bar["a"] < 1e-6


def test_measured_forces_take_the_place_of_the_models() -> None:
    mechanism, run = driven(0.01)
    torque = np.column_stack([0.3 * np.cos(5 * run.t), 0.0 * run.t])
    by_law = fed(dc.Monitor(mechanism, on_exceed=None), run)
    measured = fed(dc.Monitor(mechanism, on_exceed=None), run, forces={"actuator motor": torque})
    further = fed(dc.Monitor(PENDULUM, on_exceed=None), run, forces={"applied hand": torque})
    # A measured force is interpolated linearly: h²/12 of its second derivative's work.
    most = 0.01**2 / 12 * 5**2 * by_law.energy_exchanged
    assert abs(measured.delta_c - by_law.delta_c) <= measured.error_bar + most
    assert further.delta_c == pytest.approx(measured.delta_c, abs=1e-12)
    assert further.work["applied hand"] == pytest.approx(measured.work["actuator motor"], abs=1e-12)


def test_constraints_and_prescribed_joints() -> None:
    for name in ("andrews-squeezer", "driven-triple-pendulum"):
        model = dc.load_model(name)
        assert model.problem is not None
        step = model.problem.step
        run = dc.simulate(model, duration=100 * step, step=step, solver="ode5")
        monitor = fed(dc.Monitor(model, on_exceed=None), run)
        assert abs(monitor.delta_c) <= monitor.error_bar
        assert monitor.error_bar <= 1e-6 * monitor.energy_exchanged


def test_a_wrong_model_leaves_the_bound() -> None:
    _, run = driven(0.01, torque=0.0)
    heavier = dc.Mechanism(
        bodies=[PENDULUM.bodies[0], dc.point_mass("lower", mass=1.05, at=(0, -0.5, 0))],
        joints=PENDULUM.joints,
        gravity=PENDULUM.gravity,
    )
    fed(dc.Monitor(PENDULUM, tolerance=1e-3), run)
    with pytest.raises(BoundExceeded) as caught:
        fed(dc.Monitor(heavier, tolerance=1e-3), run)
    monitor = caught.value.monitor
    assert not monitor.inside and abs(monitor.delta_c) > monitor.limit


# --- rows -----------------------------------------------------------------------------------------


def test_a_step_taken_back_leaves_no_trace() -> None:
    mechanism, run = driven(0.01)
    plain = fed(dc.Monitor(mechanism, on_exceed=None), run)
    monitor = dc.Monitor(mechanism, on_exceed=None)
    for k, t in enumerate(run.t):
        if k:
            monitor.update(t, run.q[k] + 0.1, run.u[k] - 3.0, run.udot[k])
            monitor.reject()
        monitor.update(t, run.q[k], run.u[k], run.udot[k])
    assert (monitor.delta_c, monitor.error_bar, monitor.rows) == (
        plain.delta_c,
        plain.error_bar,
        plain.rows,
    )
    assert monitor.work == plain.work


def test_a_force_that_jumps_between_rows() -> None:
    """A motor switched every fifth row: told of the jumps, the work is exact; else it is not."""
    mechanism = dc.Mechanism(
        bodies=[dc.point_mass("cart", mass=2.0)], joints=[dc.prismatic("x", "ground", "cart", "x")]
    )
    told, untold = (dc.Monitor(mechanism, on_exceed=None) for _ in range(2))
    h, q, u, force = 0.01, 0.0, 0.0, 1.0
    for k in range(101):
        row = (k * h, [q], [u], [force / 2.0])
        for monitor in (told, untold):
            monitor.update(*row, {"applied hand": [force]})
        if k % 5 == 4:
            force = -force if k % 10 == 4 else 1.5
            told.update(k * h, [q], [u], [force / 2.0], {"applied hand": [force]})
        q, u = q + h * u + 0.25 * h * h * force, u + 0.5 * h * force
    assert abs(told.delta_c) <= 1e-13
    assert abs(untold.delta_c) > 1e-5
    assert abs(untold.delta_c) <= 2 * untold.error_bar  # half of the jumps lie between two pairs


@pytest.mark.parametrize("rated", [True, False])
def test_a_channel_that_appears_later(rated: bool) -> None:
    mechanism, run = driven(0.01)
    early, late = (dc.Monitor(mechanism, on_exceed=None) for _ in range(2))
    for k, t in enumerate(run.t):
        row = (t, run.q[k], run.u[k], run.udot[k] if rated else None)
        hand = {"applied hand": [np.sin(t - 0.5), 0.0]} if t > 0.5 else {}
        early.update(*row, {"applied hand": [0.0, 0.0], **hand})
        late.update(*row, hand)
    assert late.delta_c == pytest.approx(early.delta_c, abs=1e-12)
    assert late.work == {n: pytest.approx(w, abs=1e-12) for n, w in early.work.items()}
    assert late.energy_exchanged == pytest.approx(early.energy_exchanged)
    assert 0.1 < late.error_bar / early.error_bar < 10.0


def test_memory_stays_constant() -> None:
    mechanism, run = driven(0.002)
    monitor = dc.Monitor(mechanism, on_exceed=None)
    fed(monitor, run)
    monitor.reset()
    tracemalloc.start()
    fed(monitor, run)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert monitor.rows == len(run) and grown < 20_000


def test_what_happens_beyond_the_bound() -> None:
    told: list[dc.Monitor] = []
    monitor = dc.Monitor(PENDULUM, bound=1e-3, on_exceed=told.append)
    monitor.update(0.0, [0.0, 0.0], [0.0, 0.0])
    assert monitor.update(0.1, [0.0, 0.0], [0.0, 0.0])
    assert not monitor.update(0.2, [0.0, 0.0], [1.0, 0.0])
    assert told == [monitor]
    with pytest.raises(BoundExceeded):
        monitor = dc.Monitor(PENDULUM, bound=1e-3)
        monitor.update(0.0, [0.0, 0.0], [0.0, 0.0])
        monitor.update(0.1, [0.0, 0.0], [np.nan, 0.0])


@pytest.mark.parametrize(
    ("row", "code"),
    [
        ((0.1, [0.0], [0.0, 0.0]), "E-VALUE"),
        ((0.1, [0.0, 0.0], [0.0, 0.0, 0.0]), "E-VALUE"),
        ((-0.1, [0.0, 0.0], [0.0, 0.0]), "E-RECORDING"),
        ((float("nan"), [0.0, 0.0], [0.0, 0.0]), "E-RECORDING"),
        ((0.1, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]), "E-RECORDING"),
        ((0.1, [0.0, 0.0], [0.0, 0.0], None, {"damper a": [0.0, 0.0]}), "E-NAME"),
        ((0.1, [0.0, 0.0], [0.0, 0.0], None, {"hand": [0.0, 0.0]}), "E-NAME"),
        ((0.1, [0.0, 0.0], [0.0, 0.0], None, {"applied hand": [0.0]}), "E-VALUE"),
        ((0.1, [0.0, 0.0], [0.0, 0.0], None, [1.0, 2.0]), "E-TYPE"),
        (("0.1", [0.0, 0.0], [0.0, 0.0]), "E-TYPE"),
    ],
)
def test_rows_that_cannot_be(row: Any, code: str) -> None:
    monitor = dc.Monitor(PENDULUM, on_exceed=None)
    monitor.update(0.0, [0.0, 0.0], [0.0, 0.0], None, {"applied hand": [0.0, 0.0]})
    with pytest.raises(InputError) as caught:
        monitor.update(*row)
    assert caught.value.code == code
    assert monitor.update(0.1, [0.0, 0.0], [0.0, 0.0]) and monitor.rows == 2


def test_without_bounds_it_only_watches() -> None:
    monitor = dc.Monitor(PENDULUM)
    monitor.update(0.0, [0.0, 0.0], [0.0, 0.0])
    assert monitor.update(0.1, [0.0, 0.0], [5.0, 0.0]) and monitor.delta_c > 1.0
    with pytest.raises(BoundExceeded):
        monitor.update(0.2, [0.0, 0.0], [np.nan, 0.0])


def test_arguments_that_cannot_be() -> None:
    for options in (
        {"bound": -1.0},
        {"rate": float("nan")},
        {"on_exceed": "stop"},
        {"testing": ("wang", "liu-huston")},
    ):
        with pytest.raises(InputError):
            dc.Monitor(PENDULUM, **options)
    with pytest.raises(InputError):
        dc.Monitor(PENDULUM).reject()
    monitor = dc.Monitor(PENDULUM)
    with pytest.raises(UnknownName):
        monitor.update(0.0, [0.0, 0.0], [0.0, 0.0], None, {"motor a": [0.0, 0.0]})


# --- beside MuJoCo --------------------------------------------------------------------------------

UNDAMPED = models.WALKER.replace('damping="0.5"', "")


@pytest.mark.parametrize("integrator", repeated(["euler", "implicitfast", "implicit"], "euler"))
def test_held_forces_do_discrete_work(integrator: str) -> None:
    """With contact, limits and motors: the numbers are those of the recorder's log in the ledger."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    model = models.compiled(UNDAMPED)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    data = models.started(model, 0.5)
    watch = dc.Monitor(model, on_exceed=None, testing=("wang", "momentum")).mujoco(model, data)
    with record_mujoco(model, data) as rec:
        for _ in range(200):
            models.sine(model, data)
            mujoco.mj_step(model, data)
            rec.sample()
            watch.update()
    monitor = watch.monitor
    ledger = dc.balance(monitor.mechanism, rec.trajectory(), work="discrete", testing=("wang",))
    ours = ledger.uncorrected("wang")[-1]
    assert monitor.delta_c == pytest.approx(ours, abs=1e-11 * ledger.energy_exchanged)
    touching = sum(w[-1] for n, w in ledger.work.items() if n.kind in ("contact", "limit"))
    assert touching != 0.0
    assert monitor.work["constraint all"] == pytest.approx(touching, rel=1e-9)
    # The impulse of held forces is exact: what contacts did leaves no trace in ΔP of the vertical.
    for speed, exchanged in monitor.momentum_exchanged.items():
        assert abs(monitor.delta_p[speed]) < 0.02 * exchanged


def test_all_that_mujoco_can_do_is_accounted_for() -> None:
    """Springs that yield, fluid, compensation, adhesion: ΔC falls with the step, so nothing is lost."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        model = models.compiled(models.MOST)
        model.opt.timestep = step
        data = models.started(model, 0.5)
        watch = dc.Monitor(model, on_exceed=None).mujoco(model, data)
        for _ in range(round(0.2 / step)):
            data.ctrl[:] = 0.2
            mujoco.mj_step(model, data)
            watch.update()
        errors.append(abs(watch.monitor.delta_c) / watch.monitor.energy_exchanged)
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]


@pytest.mark.parametrize("switched", [False, True])
def test_stages_of_rk4(switched: bool) -> None:
    """Of fourth order, though the control jumps from step to step."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    errors = []
    for step in (8e-3, 4e-3):
        model = models.compiled(models.SWINGER)
        model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4
        data = models.started(model, 0.5)
        watch = dc.Monitor(model, on_exceed=None).mujoco(model, data)
        for k in range(round(0.8 / step)):
            data.ctrl[0] = 0.3 * (-1) ** (int(k * step / 8e-3 + 1e-9)) if switched else 0.3
            mujoco.mj_step(model, data)
            watch.update()
        errors.append(abs(watch.monitor.delta_c))
        assert watch.monitor.error_bar < 1e-3 * watch.monitor.energy_exchanged
    assert 3.5 < np.log2(errors[0] / errors[1]) < 6.0, errors


TRIPLE = """
<mujoco model="triple"><option timestep="0.01"/>
  <worldbody>
    <body><joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1"/>
      <body pos=".5 0 0"><joint name="b" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass=".7"/>
        <body pos=".4 0 0"><joint name="c" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass=".7"/></body></body></body>
  </worldbody>
</mujoco>"""


def mujoco_energy(model: Any, data: Any) -> float:
    """K + V, by MuJoCo itself."""
    import mujoco

    here = mujoco.MjData(model)
    mujoco.mj_copyData(here, model, data)
    mujoco.mj_forward(model, here)
    mujoco.mj_energyPos(model, here)
    mujoco.mj_energyVel(model, here)
    return float(sum(here.energy))


def test_a_run_with_too_large_a_step_is_stopped_before_it_has_lost_the_bound() -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    bound = 0.05
    model = models.compiled(TRIPLE)
    data = mujoco.MjData(model)
    for _ in range(300):
        mujoco.mj_step(model, data)
    left_alone = abs(mujoco_energy(model, data))  # it starts at rest at the height zero
    data = mujoco.MjData(model)
    start = mujoco_energy(model, data)
    watch = dc.Monitor(model, bound=bound).mujoco(model, data)
    with pytest.raises(BoundExceeded) as caught:
        for _ in range(300):
            watch.step(halvings=0)
    assert left_alone > 4 * bound
    assert 0.0 < data.time < 3.0
    assert abs(mujoco_energy(model, data) - start) <= bound
    assert watch.monitor.t == data.time
    # It told the truth: one step more and MuJoCo's own energy is off by more than the bound.
    mujoco.mj_step(model, data)
    assert abs(mujoco_energy(model, data) - start) > bound
    assert caught.value.monitor is watch.monitor


def test_vetoed_steps_reduce_the_error() -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    errors, steps = {}, {}
    for rate in (None, 1.0, 0.3):
        model = models.compiled(TRIPLE)
        data = mujoco.MjData(model)
        start = mujoco_energy(model, data)
        watch = dc.Monitor(model, bound=10.0, rate=rate).mujoco(model, data)
        steps[rate] = sum(watch.step() for _ in range(40))
        assert model.opt.timestep == 0.01 and data.time == pytest.approx(0.4, abs=1e-12)
        errors[rate] = abs(mujoco_energy(model, data) - start)
        assert watch.monitor.delta_c == pytest.approx(mujoco_energy(model, data) - start, abs=1e-9)
        if rate is not None:
            assert errors[rate] <= rate * 0.4 * (1 + 1e-9)
    assert steps[None] == 40 < steps[1.0] < steps[0.3]
    assert errors[0.3] < errors[1.0] < errors[None]


def test_a_missed_step_and_another_model_are_refused() -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    model = models.compiled(TRIPLE)
    data = mujoco.MjData(model)
    watch = dc.Monitor(model, on_exceed=None).mujoco(model, data)
    mujoco.mj_step(model, data, 2)
    with pytest.raises(InputError, match="2 steps were made"):
        watch.update()
    watch.restart()
    mujoco.mj_step(model, data)
    watch.update()
    assert watch.monitor.rows == 2
    with pytest.raises(InputError, match="Monitor"):
        dc.Monitor(PENDULUM).mujoco(model, data)
    with pytest.raises(InputError, match=r"mujoco\.MjData"):
        dc.Monitor(model).mujoco(model, model)


@pytest.mark.filterwarnings("ignore")
def test_a_gymnasium_environment() -> None:
    """With a frame skip: the numbers are those of the same physics steps in a loop."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (deltac[models]) is missing")
    pytest.importorskip("gymnasium.envs.mujoco", reason="its MuJoCo environments do not load")
    env = gymnasium.make("InvertedDoublePendulum-v5")
    base = env.unwrapped
    assert base.frame_skip > 1
    monitored = dc.Monitor(base.model, on_exceed=None).gymnasium(env)
    for _ in range(2):
        monitored.reset(seed=7)
        start = mujoco.MjData(base.model)
        mujoco.mj_copyData(start, base.model, base.data)
        for _ in range(4):
            *_, info = monitored.step(np.array([0.2]))
        watch = dc.Monitor(base.model, on_exceed=None).mujoco(base.model, start)
        start.ctrl[:] = 0.2
        for _ in range(4 * base.frame_skip):
            mujoco.mj_step(base.model, start)
            watch.update()
        assert info["delta_c"] == watch.monitor.delta_c
        assert monitored.monitor.rows == 4 * base.frame_skip + 1
    with pytest.raises(InputError, match="no gymnasium.envs.mujoco.MujocoEnv"):
        dc.Monitor(base.model).gymnasium(gymnasium.make("CartPole-v1"))
