"""What a row of a MuJoCo recording holds: one instant, all forces, named; and what is refused."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.recorders import integrator_names, mujoco_simulator, record_mujoco, run_mujoco
from tests.recorders import models

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
INTEGRATORS = [*integrator_names()]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo writes its warnings to a file in the working directory."""
    monkeypatch.chdir(tmp_path)


def test_every_integrator_of_this_mujoco_is_known() -> None:
    assert {"euler", "rk4", "implicit", "implicitfast"} <= set(INTEGRATORS)
    assert len(INTEGRATORS) == len(mujoco.mjtIntegrator.__members__)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_row_is_one_instant(integrator: str) -> None:
    """State before the step; accelerations and forces of a forward pass in that state."""
    model = models.compiled(models.SWINGER)
    model.opt.integrator = integrator_names()[integrator]
    data = models.started(model, 1.0)
    states, accelerations = [], []
    with record_mujoco(model, data) as rec:
        for _ in range(20):
            models.sine(model, data)
            alone = mujoco.MjData(model)
            mujoco.mj_copyData(alone, model, data)
            mujoco.mj_forward(model, alone)
            states.append((data.time, data.qpos.copy(), data.qvel.copy()))
            accelerations.append(alone.qacc.copy())
            mujoco.mj_step(model, data)
            if integrator == "rk4":  # what stands in mjData is of another stage
                assert np.abs(data.qacc - accelerations[-1]).max() > 1e-4
            rec.sample()
    run = rec.trajectory()
    assert len(rec) == 20
    assert len(run) == 21
    t, q, u = zip(*states)
    assert np.array_equal(run.t[:-1], t)
    assert np.array_equal(run.q[:-1], q)
    assert np.array_equal(run.u[:-1], u)
    assert np.array_equal(run.q[-1], data.qpos)
    assert run.udot is not None
    if integrator == "rk4":
        assert np.array_equal(run.udot[:-1], accelerations)
        assert "correction implicit" not in run.forces
    else:  # implicit in the damping, so the acceleration is the step's
        step = np.diff(run.u, axis=0) / model.opt.timestep
        assert np.allclose(run.udot[:-1], step, rtol=1e-9, atol=1e-11)
        # The discrete integrator has no other acceleration than the step's.
        assert np.allclose(step, accelerations, rtol=1e-5) == (integrator == "discrete")
        assert "correction implicit" in run.forces


def test_without_anything_implicit_there_is_no_correction() -> None:
    model = models.compiled(models.SWINGER)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    run = run_mujoco(model, 0.1, data=models.started(model, 1.0), integrator="euler")
    assert "correction implicit" not in run.forces
    assert run.udot is not None
    assert np.allclose(run.udot[:-1], np.diff(run.u, axis=0) / 0.002, rtol=1e-9)


def test_a_loop_and_the_single_call_are_bitwise_the_same() -> None:
    model = models.compiled(models.WALKER)
    data = models.started(model, 0.3)
    whole = run_mujoco(model, 0.1, data=data, controller=models.sine)
    with record_mujoco(model, data) as rec:
        for _ in range(50):
            models.sine(model, data)
            mujoco.mj_step(model, data)
            rec.sample()
        models.sine(model, data)
    run = rec.trajectory()
    assert np.array_equal(whole.q, run.q)
    assert {*whole.forces} == {*run.forces}
    for channel, force in whole.forces.items():
        assert np.array_equal(force, run.forces[channel])


def test_recording_does_not_disturb_the_simulation() -> None:
    model = models.compiled(models.HUMANOID)
    plain, recorded = models.started(model, 0.3), models.started(model, 0.3)
    with record_mujoco(model, recorded) as rec:
        for _ in range(30):
            mujoco.mj_step(model, plain)
            mujoco.mj_step(model, recorded)
            rec.sample()
        rec.trajectory()
    assert np.array_equal(plain.qpos, recorded.qpos)
    assert np.array_equal(plain.qacc_warmstart, recorded.qacc_warmstart)


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_all_kinds_of_forces(integrator: str, jacobian: str) -> None:
    """Each channel against its own formula, or against MuJoCo's sum for its kind."""
    model = models.compiled(
        models.EVERYTHING.replace("<option ", f'<option jacobian="{jacobian}" ')
    )

    def control(model: Any, data: Any) -> None:
        models.sine(model, data)
        data.xfrc_applied[2] = [1.0, 0.0, np.cos(data.time), 0.0, 0.1, 0.0]
        data.qfrc_applied[0] = 0.3

    start = models.started(model, 0.3)
    run = run_mujoco(model, 0.5, data=start, controller=control, integrator=integrator)
    expected = {
        *("actuator m", "actuator servo", "actuator actuator2", "actuator actuator3"),
        *("spring a", "spring b", "spring t", "spring putty", "spring sp"),
        *("damper a", "damper b", "damper t", "damper sp"),
        *("applied gravcomp", "applied fluid", "applied qfrc", "applied B"),
        *("constraint tie", "friction a", "friction t", "limit sp"),
    }
    assert expected <= {*run.forces}
    assert {*run.forces} - expected <= {"correction implicit", "correction solver"} | {
        name for name in run.forces if name.startswith("contact floor:")
    }
    a, slide = run.speeds.index("a"), run.speeds.index("joint3")
    x, v = run.coordinate("a"), run.u[:, a]
    assert np.allclose(run.forces["spring a"][:, a], -(3 + 0.5 * x + 0.2 * x**2) * x)
    # The joint's own, and the viscosity of motor m through its gear of 3.
    b = 1 + 9 * 0.3 + 0.3 * np.abs(v) + 0.1 * v**2
    assert np.allclose(run.forces["damper a"][:, a], -b * v)
    length = 2 * x + run.coordinate("joint3")
    over = length - np.clip(length, 0.1, 0.2)
    tension = -(7 + over + 0.2 * over**2) * over
    assert np.allclose(run.forces["spring t"][:, [a, slide]], np.outer(tension, [2, 1]))
    rate = 2 * v + run.u[:, slide]
    b = 2 + 4 * 0.2 + (0.2 + 4 * 0.1) * np.abs(rate) + (0.3 + 4 * 0.3) * rate**2
    assert np.allclose(run.forces["damper t"][:, [a, slide]], np.outer(-b * rate, [2, 1]))
    assert np.allclose(run.forces["applied qfrc"], 0.3 * (np.arange(model.nv) == 0))
    # Joint a limits what its actuators do together.
    on_a = np.sum(
        [force for name, force in run.forces.items() if name.startswith("actuator")], axis=0
    )
    gravcomp = run.forces["applied gravcomp"]
    # The tendon's motor acts on it, too, and gravity compensation counts as actuation.
    assert np.abs(on_a[:, a] + gravcomp[:, a]).max() <= 1.0 + 1e-12


def test_plastic_springs_slip() -> None:
    model = models.compiled(models.EVERYTHING)
    run = run_mujoco(model, 0.5, data=models.started(model, 0.3))
    slide = run.speeds.index("joint3")
    force = run.forces["spring putty"][:, slide]
    assert np.abs(run.coordinate("joint3")).max() > 0.02
    # Elastic it would be proportional to the coordinate; it yields at 0.01 m, a step later.
    travelled = np.abs(np.diff(run.coordinate("joint3"))).max()
    assert np.abs(force).max() <= 7 * (0.01 + travelled) * (1 + 1e-12)


def test_contacts_by_pair_or_together() -> None:
    model = models.compiled(models.WALKER)
    data = models.started(model, 0.3)
    pairs = run_mujoco(model, 0.4, data=data)
    together = run_mujoco(model, 0.4, data=data, channels="grouped")
    names = [name for name in pairs.forces if name.startswith("contact")]
    assert {"contact floor:left_foot", "contact floor:right_foot"} <= {*names}
    assert [n for n in together.forces if n.startswith("contact")] == ["contact all"]
    total = np.sum([pairs.forces[name] for name in names], axis=0)
    assert np.allclose(total, together.forces["contact all"], rtol=1e-12, atol=1e-9)


def test_held_channels() -> None:
    model = models.compiled(models.SWINGER)

    def held(integrator: str, control: Any) -> set[str]:
        run = run_mujoco(model, 0.1, integrator=integrator, controller=control)
        return set(run.provenance.held)  # type: ignore[arg-type]

    assert held("rk4", models.sine) == {"actuator turn"}
    assert held("rk4", lambda model, data: data.ctrl.fill(0.3)) == {"actuator turn"}
    everything = {"actuator turn", "spring a", "damper a", "damper b", "correction implicit"}
    assert held("euler", None) == everything


def test_provenance() -> None:
    model = models.compiled(models.SWINGER)
    run = run_mujoco(model, 0.1, step=0.005, integrator="implicit")
    p = run.provenance
    assert p.simulator == f"MuJoCo {mujoco.mj_versionString()}"
    assert (p.solver, p.step, p.model, p.completed) == ("implicit", 0.005, "swinger", True)
    assert "correction implicit" in p.stage
    assert model.opt.timestep == 0.002  # the caller's model is left alone
    first_stage = run_mujoco(model, 0.1, integrator="rk4").provenance.stage
    assert "first stage" in first_stage


def test_a_run_that_blows_up_keeps_what_it_has() -> None:
    xml = models.CARTS.replace('stiffness="50"', 'stiffness="1e9"')
    model = models.compiled(xml)
    run = run_mujoco(model, 1.0, data=models.started(model, 1.0), integrator="euler")
    assert not run.provenance.completed
    assert "too large or not a number in the step from t = " in run.provenance.message
    assert 1 < len(run) < 500


def test_progress() -> None:
    seen: list[float] = []
    run_mujoco(models.compiled(models.CARTS), 0.01, progress=seen.append)
    assert seen == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


def test_files_and_specs(tmp_path: Any) -> None:
    path = tmp_path / "carts.xml"
    path.write_text(models.CARTS, encoding="utf-8")
    spec = mujoco.MjSpec.from_string(models.CARTS)
    assert np.array_equal(run_mujoco(path, 0.01).q, run_mujoco(spec, 0.01).q)
    with pytest.raises(InputError, match="cannot read the model"):
        run_mujoco(tmp_path / "absent.xml", 0.01)
    with pytest.raises(InputError, match="expected an mjModel"):
        run_mujoco(3, 0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration": -1.0}, "duration is -1.0; expected a positive"),
        ({"duration": float("nan")}, "duration is nan"),
        ({"duration": 0.1, "step": 0.0}, "step is 0.0"),
        ({"duration": 0.1, "integrator": "eular"}, "did you mean 'euler'"),
        ({"duration": 0.1, "channels": "some"}, "unknown channels 'some'"),
    ],
)
def test_bad_arguments(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_mujoco(models.compiled(models.CARTS), **options)


def test_a_duration_that_is_no_whole_number_of_steps() -> None:
    model = models.compiled(models.CARTS)
    run = run_mujoco(model, 0.5, step=0.003)
    assert (len(run), run.t[-1]) == (168, pytest.approx(0.501, rel=1e-12))
    assert run.provenance.notes["duration"] in run.summary()
    assert "0.5 s is no whole number of steps of 0.003 s: ran 167 of them, 0.501 s" in run.summary()
    assert len(run_mujoco(model, 1e-4, step=0.003)) == 2
    for duration, step in ((0.6, 0.003), (0.1, 0.1 / 3), (0.3, 0.1), (0.1, 0.03333333333)):
        assert "duration" not in run_mujoco(model, duration, step=step).provenance.notes
    simulator = mujoco_simulator(model, 0.5)
    with pytest.raises(InputError, match=r"step 0.003 does not divide .*step=0.00299401"):
        simulator(0.003)


def test_a_run_that_blows_up_in_its_first_step_is_told_as_such() -> None:
    model = models.compiled(models.SWINGER)
    model.dof_damping[:] = 1e12
    data = models.started(model, 1e4)
    run = run_mujoco(model, 1.0, data=data, integrator="rk4", step=0.5)
    assert len(run) == 1 and not run.provenance.completed
    with pytest.raises(InputError, match="ended in its first step: .* from t = 0 s"):
        dc.audit(model, run)


def test_steps_that_were_missed() -> None:
    model = models.compiled(models.CARTS)
    data = mujoco.MjData(model)
    rec = record_mujoco(model, data)
    with pytest.raises(InputError, match="0 steps were taken"):
        rec.sample()
    mujoco.mj_step(model, data, 3)  # with the same inputs: all three are recorded
    rec.sample()
    assert len(rec) == 3
    data.time += 0.3 * model.opt.timestep
    with pytest.raises(InputError, match="0.3 steps were taken"):
        rec.sample()


@pytest.mark.parametrize("change", ["state", "control"])
def test_changes_between_step_and_sample(change: str) -> None:
    model = models.compiled(models.CARTS)
    data = mujoco.MjData(model)
    rec = record_mujoco(model, data)
    mujoco.mj_step(model, data)
    if change == "state":
        data.qvel[0] += 0.1
    else:
        data.ctrl[0] = 5.0
    with pytest.raises(InputError, match="qvel that is off by|qpos that is off by"):
        rec.sample()


def test_a_reset_of_mujoco_itself() -> None:
    model = models.compiled(models.CARTS)
    data = mujoco.MjData(model)
    rec = record_mujoco(model, data)
    mujoco.mj_step(model, data)
    rec.sample()
    data.qvel[0] = np.nan
    mujoco.mj_step(model, data)
    with pytest.raises(InputError, match="a speed became too large or not a number"):
        rec.sample()


def test_sleeping_bodies_are_refused() -> None:
    model = models.compiled(models.CARTS)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    with pytest.raises(InputError, match="fall asleep.*mjENBL_SLEEP"):
        run_mujoco(model, 0.1)


def test_a_force_that_is_not_known_is_named() -> None:
    """A damper that appears in the middle of a run, behind the recorder's back."""
    model = models.compiled(models.CARTS)
    data = models.started(model, 1.0)
    rec = record_mujoco(model, data)
    model.dof_damping[1] = 3.0
    mujoco.mj_step(model, data)
    with pytest.raises(InputError, match="damper forces of MuJoCo do not add up.*joint 'z'"):
        rec.sample()


def test_passive_forces_of_a_callback() -> None:
    model = models.compiled(models.CARTS)

    def push(model: Any, data: Any) -> None:
        data.qfrc_passive[1] += 0.25

    mujoco.set_mjcb_passive(push)
    try:
        run = run_mujoco(model, 0.02)
    finally:
        mujoco.set_mjcb_passive(None)
    assert np.allclose(run.forces["applied passive"], [0.0, 0.25])


def test_without_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    model = models.compiled(models.CARTS)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r'pip install "deltac\[mujoco\]"'):
        run_mujoco(model, 0.1)


def test_forces_that_are_nothing_beside_the_weight_need_not_add_up() -> None:
    """What the solver leaves of a contact that does not act has no digits: 1e-26 N beside 10 N."""
    from deltac.recorders.mujoco_forces import Elements, generalized_forces, plastic_state

    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='j' axis='0 1 0'/>"
        "<geom type='capsule' fromto='0 0 0 1 0 0' size='0.05' mass='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    elements = Elements.of(model, grouped=False)
    data.qfrc_constraint[:] = 1e-26
    generalized_forces(model, data, elements, plastic_state(data))
    data.qfrc_constraint[:] = 1e-5
    with pytest.raises(InputError, match="constraint forces of MuJoCo do not add up"):
        generalized_forces(model, data, elements, plastic_state(data))
