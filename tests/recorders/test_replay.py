"""Logs of a policy stepped again between their rows, and recorders inside environments."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.codes import finding_code

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")

pytestmark = pytest.mark.case_study(
    "test_the_first_row_that_departs_is_named",
    "test_forms_of_logs_are_no_departures[float32]",
    "test_logs_that_cannot_be_replayed",
    "test_models_that_cannot_be_replayed",
    "test_forces_that_a_model_lacks_are_not_stepped",
    "test_what_a_passive_body_touched_is_replayed_without_controls",
    "test_frame_skip_is_recorded_step_by_step",
    "test_gymnasium_environments_are_recorded",
    "test_dm_control_environments_are_recorded",
)

HERE = Path(__file__).parents[1] / "natural_logs"
MODEL, LOG = HERE / "arm_motors.xml", HERE / "logs" / "mujoco_policy_50hz.npz"


def codes(audit: dc.Audit) -> list[str]:
    return [finding.code for finding in audit.findings]


ROWS = 16


def arrays() -> dict[str, Any]:
    """The first rows of the log."""
    return {name: column[:ROWS] for name, column in np.load(LOG).items()}


def test_a_log_of_the_model_is_reproduced_to_the_last_bit() -> None:
    found = dc.audit(str(MODEL), LOG)  # unasked, for it lacks forces
    assert (found.verdict.kind, len(found.run)) == ("consistent", 601)
    assert codes(found) == [finding_code("replayed")]
    assert found.run.provenance.reading
    log = dict(np.load(LOG))
    assert np.array_equal(found.run.q[::10], log["qpos"])
    # MuJoCo itself, without a recorder, from the first row on.
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    data.qpos[:] = log["qpos"][0]
    for ctrl in log["ctrl"][:-1]:
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data, nstep=10)
    assert found.run.q[-1] == pytest.approx(data.qpos, abs=1e-12)


@pytest.mark.parametrize("form", ["late", "float32", "csv"])
def test_forms_of_logs_are_no_departures(form: str, tmp_path: Path) -> None:
    log = arrays()
    path = tmp_path / "log.npz"
    if form == "late":  # a row has the controls of the steps that led to it
        log["ctrl"] = np.vstack([np.zeros(2), log["ctrl"][:-1]])
    if form == "float32":
        log |= {name: log[name].astype(np.float32) for name in ("qpos", "qvel", "ctrl")}
    if form == "csv":
        path = tmp_path / "log.csv"
        names = ("qpos", "qvel", "ctrl")
        head = ",".join(["time", *(f"{name}_{k}" for name in names for k in range(2))])
        table = np.column_stack([log["time"], *(log[name] for name in names)])
        np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.6g")
    else:
        np.savez(path, **log)
    found = dc.audit(str(MODEL), path, replay=True)
    assert codes(found) == [finding_code("replayed")]


def test_the_first_row_that_departs_is_named(tmp_path: Path) -> None:
    log = arrays()
    log["qvel"][10:, 0] += 0.2
    np.savez(tmp_path / "log.npz", **log)
    found = dc.audit(str(MODEL), tmp_path / "log.npz", replay=True)
    assert found.verdict.kind == "equation-error"
    assert codes(found)[0] == finding_code("replay-departs")
    assert "row 10" in found.findings[0].what


def test_what_keeps_a_model_from_reproducing_a_log_is_named() -> None:
    text = MODEL.read_text("utf-8").replace('gear="2"', 'gear="2.05"')
    found = dc.audit(mujoco.MjModel.from_xml_string(text), LOG, replay=True)
    assert (found.verdict.kind, found.exit_code) == ("equation-error", 1)
    assert finding_code("replay-departs") in codes(found)
    (cause,) = found.causes
    assert (cause.kind, cause.element) == ("actuator-gear", "actuator m1")
    assert cause.size == pytest.approx(2.0 / 2.05, abs=1e-8)


def random_actions() -> tuple[Any, dict[str, Any]]:
    """An arm of which the joints would stop if the solver of constraints were not switched off, and its log.

    Each action acts for five steps of RK4.
    """
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><option integrator="RK4" timestep="0.01"><flag constraint="disable"/></option>
          <default><joint type="hinge" axis="0 0 1" limited="true" range="-10 10"/></default>
          <worldbody><body><joint name="shoulder" armature="1" damping="1"/>
            <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/>
            <body pos=".1 0 0"><joint name="elbow" armature="1" damping="1"/>
              <geom type="capsule" fromto="0 0 0 .11 0 0" size=".01"/></body></body></worldbody>
          <actuator><motor joint="shoulder" gear="200"/><motor joint="elbow" gear="200"/></actuator>
        </mujoco>""")
    data, actions = mujoco.MjData(model), np.random.default_rng(3).uniform(-0.06, 0.06, (120, 2))
    rows = list[Any]()
    for k in range(600):
        data.ctrl[:] = actions[k // 5]
        rows.append([data.time, *data.qpos, *data.qvel, *data.ctrl])
        mujoco.mj_step(model, data)
    t, *columns = np.array(rows).T
    q, u, ctrl = (np.column_stack(columns[k : k + 2]) for k in (0, 2, 4))
    assert np.abs(q).max() > np.deg2rad(10.0)
    return model, {"time": t, "qpos": q, "qvel": u, "ctrl": ctrl}


def test_random_actions_beside_a_mistake_are_no_noise() -> None:
    model, log = random_actions()
    model.dof_armature[1] *= 1.1
    found = dc.audit(model, log)
    assert found.verdict.kind == "equation-error"
    (cause,) = found.causes
    assert (cause.kind, cause.element) == ("armature", "elbow")
    assert cause.values == pytest.approx([1.0], abs=1e-6)


@pytest.mark.slow
def test_a_gear_is_named_beside_controls_that_are_no_policys_outputs() -> None:
    """What they do is known without a replay that nobody asked for. Actions may be scaled before they act."""
    model, log = random_actions()
    model.actuator_gear[1, 0] = 220.0
    found = dc.audit(model, log)
    assert [c.kind for c in found.causes] == ["actuator-gear"]
    assert found.causes[0].values == pytest.approx([200.0 / 220.0], abs=1e-6)
    log["action"] = log.pop("ctrl")
    assert dc.audit(model, log).verdict.kind == "unresolved"


@pytest.mark.parametrize("name", ["{}_ctrl", "ctrl.{}", "action_{}"])
def test_a_column_names_an_actuator_and_its_control(name: str, tmp_path: Path) -> None:
    log = arrays()
    names = [f"{joint}_{what}" for what in ("pos", "vel") for joint in ("shoulder", "elbow")]
    head = ",".join(["time", *names, name.format("m1"), name.format("m2")])
    table = np.column_stack([log["time"], *(log[n] for n in ("qpos", "qvel", "ctrl"))])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.17g")
    assert codes(dc.audit(str(MODEL), path)) == [finding_code("replayed")]


def test_the_torque_at_a_joint_is_that_of_its_only_actuator() -> None:
    log = arrays()
    table = {"time": log["time"]}
    for k, (joint, gear) in enumerate((("shoulder", 2.0), ("elbow", 1.0))):
        table |= {f"{joint}_pos": log["qpos"][:, k], f"{joint}_vel": log["qvel"][:, k]}
        table[f"{joint}_torque"] = gear * log["ctrl"][:, k]
    found = dc.audit(str(MODEL), table)
    lacking = {finding_code(kind) for kind in ("assumed-zero", "channel-not-in-model")}
    assert found.verdict.kind == "consistent" and not lacking & set(codes(found))


def pushed(by: float, at: int = 300, noise: float = 0.0) -> dict[str, Any]:
    """Every step of the arm, the shoulder of which gains speed (rad/s) at one row."""
    model, rng = mujoco.MjModel.from_xml_path(str(MODEL)), np.random.default_rng(0)
    data, rows = mujoco.MjData(model), []
    data.qpos[:] = 1.0, 0.4
    for k in range(600):
        data.ctrl[:] = np.sin(0.02 * k), 0.3 * np.cos(0.03 * k)
        data.qvel[0] += by * (k == at)
        states = [x + noise * rng.standard_normal(2) for x in (data.qpos, data.qvel)]
        rows.append((data.time, *states, data.ctrl.copy()))
        mujoco.mj_step(model, data)
    return dict(zip(("time", "qpos", "qvel", "ctrl"), map(np.array, zip(*rows)), strict=True))


@pytest.mark.parametrize("asked", [None, True])
def test_a_push_in_one_of_many_rows_is_no_noise(asked: bool | None) -> None:
    """All other rows follow by the forces of the motors: these alone would pass over it."""
    found = dc.audit(str(MODEL), pushed(0.02), replay=asked)
    assert found.verdict.kind == "equation-error"
    (departs,) = [f for f in found.findings if f.weight == "cause"]
    assert departs.kind == "replay-departs" and "misses row 300" in departs.what


def test_noise_accuses_nobody_where_a_replay_was_asked_for() -> None:
    found = dc.audit(str(MODEL), pushed(0.0, noise=1e-5), replay=True)
    assert found.verdict.kind == "consistent"
    assert codes(found) == [finding_code("not-replayed")]


SERVOS = """<mujoco><option timestep="0.002" integrator="{}"/><worldbody>
    <body><joint name="shoulder" axis="0 1 0" damping="0.2"/><inertial pos="0 0 -0.3" mass="1.5"
      diaginertia="0.03 0.03 0.001"/>
      <body pos="0 0 -0.6"><joint name="elbow" axis="0 1 0" damping="0.1"/><inertial pos="0 0 -0.25" mass="1"
        diaginertia="0.02 0.02 0.001"/></body></body></worldbody>
    <actuator><position name="p1" joint="shoulder" kp="60"/>
      <position name="p2" joint="elbow" kp="{}"/></actuator>
    </mujoco>"""


def servos(integrator: str, gain: float) -> Any:
    """An arm on position servos, the second of this gain."""
    return mujoco.MjModel.from_xml_string(SERVOS.format(integrator, gain))


def with_noise(log: dict[str, Any]) -> dict[str, Any]:
    """The log with noise of 1e-6 in states."""
    rng = np.random.default_rng(0)
    states = {n: log[n] + 1e-6 * rng.standard_normal(log[n].shape) for n in ("qpos", "qvel")}
    return log | states


def servo_log(
    integrator: str, rows: int = 500, every: int = 1, model: Any = None
) -> dict[str, Any]:
    """Rows of MuJoCo's steps of the arm, so many steps apart; controls change at rows."""
    model = model or servos(integrator, 20)
    data, log = mujoco.MjData(model), []
    for k in range(rows):
        data.ctrl[:] = 0.6 * np.sin(0.01 * k), 0.8 * np.cos(0.014 * k)
        log.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
        mujoco.mj_step(model, data, every)
    return dict(zip(("time", "qpos", "qvel", "ctrl"), map(np.array, zip(*log)), strict=True))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_servos_push_as_their_law_says_beside_noise(integrator: str) -> None:
    """No row is reproduced, and each servo's force is that of its control and its joint."""
    clean, model = servo_log(integrator), servos(integrator, 20)
    truth = dc.audit(model, clean)  # stepped again: works to rounding
    found = dc.audit(model, with_noise(clean))
    assert found.verdict.kind == truth.verdict.kind == "integration-error"
    assert {"actuator p1", "actuator p2"} <= set(map(str, found.run.forces))
    assert not any(f.weight == "cause" for f in found.findings)
    assert found.attribution is not None and truth.attribution is not None
    told, true = found.attribution.integrator, truth.attribution.integrator
    assert abs(told.energy - true.energy) <= 2.0 * told.error


def test_the_bar_of_a_replay_covers_what_works_within_a_step_are_off_by() -> None:
    """Dampers are stiff beside the step: the work of RK4's own stages is not that of the exact motion.

    The true joules are those of each step beyond fifty short ones under the same control.
    """
    source = """<mujoco><option timestep="{}" integrator="RK4"/><worldbody><body>
        <joint name="arm" axis="0 1 0" damping="0.6"/>
        <inertial pos="0 0 -0.3" mass="0.5" diaginertia="0.01 0.01 0.01"/><body pos="0 0 -0.6">
        <joint name="wrist" axis="0 1 0" damping="0.1"/>
        <inertial pos="0 0 -0.02" mass="0.1" diaginertia="1e-3 1e-3 1e-3"/></body></body></worldbody>
        <actuator><motor joint="wrist"/></actuator>
        </mujoco>"""
    model, fine = (mujoco.MjModel.from_xml_string(source.format(h)) for h in (4e-3, 4e-3 / 50))
    fine.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, other, rows, joules = mujoco.MjData(model), mujoco.MjData(fine), [], 0.0

    def energy(q: Any, u: Any) -> float:
        other.qpos[:], other.qvel[:] = q, u
        mujoco.mj_forward(fine, other)
        return float(other.energy.sum())

    data.qpos[0] = 1.0
    for k in range(500):
        data.ctrl[0] = 0.8 * np.sign(np.sin(0.15 * (k // 5)))
        rows.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
        other.qpos[:], other.qvel[:], other.ctrl[:] = data.qpos, data.qvel, data.ctrl
        for _ in range(50):
            mujoco.mj_step(fine, other)
        exact = energy(other.qpos.copy(), other.qvel.copy())
        mujoco.mj_step(model, data)
        joules += energy(data.qpos, data.qvel) - exact if k < 499 else 0.0
    names = ("time", "qpos", "qvel", "ctrl")
    log = dict(zip(names, (np.round(x, 4) for x in map(np.array, zip(*rows))), strict=True))
    found = dc.audit(model, log)
    assert finding_code("replayed") in codes(found) and found.attribution is not None
    told = found.attribution.integrator
    assert told.energy == pytest.approx(joules, abs=2.0 * told.error)


def test_noise_is_no_departure_from_the_model() -> None:
    """Servos vary within a step of RK4: their controls are held, the rest is by the state."""
    found = dc.audit(servos("RK4", 20), with_noise(servo_log("RK4")))
    assert found.verdict.kind == "consistent" and not found.causes
    assert found.integrator is not None and found.integrator.names == ("rk4",)


@pytest.mark.parametrize(("integrator", "every"), [("RK4", 1), ("RK4", 4), ("Euler", 4)])
def test_the_gain_of_a_servo_that_acts_by_the_state_between_rows(
    integrator: str, every: int
) -> None:
    """Of RK4 at each stage, of others at each of several steps; what is commanded is held from row to row."""
    log = servo_log(integrator, 400, every)
    found = dc.audit(servos(integrator, 21), log)
    assert found.verdict.kind == "equation-error" and found.attribution is not None
    assert {c.element for c in found.causes} == {"actuator p2", "actuator p2 by position"}
    # RK4's maps close the rows; what one of Euler's leaves of four steps is of the order of h.
    close = 1e-5 if integrator == "RK4" else 5e-4
    assert [c.size for c in found.causes] == pytest.approx([20.0 / 21.0] * 2, abs=close)
    if integrator == "RK4":
        # Its errors are some 1e-5 J: the work of the missing part of the gain is that along the rows.
        q, held = log["qpos"][:, 1], log["ctrl"][:-1, 1]
        joules = (20.0 - 21.0) * (held @ np.diff(q) - 0.5 * (q[-1] ** 2 - q[0] ** 2))
        assert found.attribution.equations.energy == pytest.approx(joules, abs=2e-4)


@pytest.mark.parametrize(("integrator", "every"), [("RK4", 4), ("Euler", 4), ("implicitfast", 4)])
def test_servos_of_noisy_rows_several_steps_apart(integrator: str, every: int) -> None:
    found = dc.audit(servos(integrator, 20), with_noise(servo_log(integrator, 400, every)))
    assert found.verdict.kind in ("consistent", "integration-error") and not found.causes


def test_a_servo_at_its_limit_is_no_law_of_the_state() -> None:
    """A force that is cut is neither held nor linear: nobody is accused of what it does between rows."""
    model = servos("RK4", 20)
    model.actuator_forcelimited[:], model.actuator_forcerange[:] = 1, (-4.0, 4.0)
    found = dc.audit(model, with_noise(servo_log("RK4", model=model)))
    assert found.verdict.kind != "equation-error"


def test_the_gain_of_a_servo_keeps_a_model_from_reproducing_a_log() -> None:
    found = dc.audit(servos("Euler", 21), servo_log("Euler"), replay=True)
    assert (found.verdict.kind, found.exit_code) == ("equation-error", 1)
    (cause,) = found.causes
    assert (cause.kind, cause.element) == ("actuator-gear", "actuator p2")
    assert cause.size == pytest.approx(20.0 / 21.0, abs=1e-4)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda log: log.pop("ctrl"), "E-LOG"),
        (lambda log: log.update(ctrl=log["ctrl"][:, :1]), "E-LOG"),
        (lambda log: log.update(ctrl=log["ctrl"][:-1]), "E-LOG"),  # one control fewer than states
        (lambda log: log.update(ctrl=log["ctrl"] * np.nan), "E-LOG"),
        (lambda log: log.update(time=log["time"] * 1.05), "E-LOG"),
        (lambda log: log.update(time=log["time"] ** 2 + log["time"]), "E-LOG"),
    ],
)
def test_logs_that_cannot_be_replayed(change: Any, code: str, tmp_path: Path) -> None:
    log = arrays()
    change(log)
    np.savez(tmp_path / "log.npz", **log)
    with pytest.raises(dc.InputError) as refused:
        dc.audit(str(MODEL), tmp_path / "log.npz", replay=True)
    assert refused.value.code == code


def test_a_log_that_lacks_forces_is_replayed_unasked() -> None:
    log = arrays()
    found = dc.audit(str(MODEL), log)
    assert (len(found.run), codes(found)) == (10 * ROWS - 9, [finding_code("replayed")])
    assert np.array_equal(found.run.q, dc.audit(str(MODEL), log, replay=True).run.q)
    assert len(dc.audit(str(MODEL), log, replay=False, time_limit=1e-9).run) == ROWS


def test_contacts_that_never_touch_are_no_reason_to_ask_for_controls() -> None:
    """The forces of all motors are logged, and controls would tell no more."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 -2"/><body>
        <joint name="arm" axis="0 1 0"/><geom type="sphere" size="0.05" pos="0 0 -0.4" mass="1"/></body>
        </worldbody><actuator><motor name="motor" joint="arm"/></actuator></mujoco>"""
    )
    data, rows = mujoco.MjData(model), []
    for k in range(300):
        data.ctrl[0] = np.sin(0.02 * k)
        rows.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl[0]))
        mujoco.mj_step(model, data)
    t, q, u, force = map(np.array, zip(*rows))
    log = {"time": t, "qpos": q, "qvel": u, "force.actuator motor.arm": force}
    assert finding_code("not-replayed") not in codes(dc.audit(model, log))


def test_a_time_limit_leaves_out_what_nobody_asked_for_and_says_so() -> None:
    late = dc.audit(str(MODEL), arrays(), time_limit=1e-9)
    assert len(late.run) == ROWS and finding_code("time-limit") in codes(late)
    with pytest.raises(dc.InputError, match="time_limit"):
        dc.audit(str(MODEL), arrays(), time_limit=0.0)


def test_forces_that_a_model_lacks_are_not_stepped(tmp_path: Path) -> None:
    """A log with torques that no motor of the model has: MuJoCo would step without them."""
    path = tmp_path / "arm.xml"
    path.write_text(
        """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body>
        <joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03"/>
        <body pos="0.4 0 0"><joint name="b" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/></body></body></worldbody></mujoco>"""
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data, rows = mujoco.MjData(model), list[np.ndarray]()
    for _ in range(200):
        data.qfrc_applied[:] = 0.3 * np.sin(9.0 * data.time), 0.1 * np.cos(4.0 * data.time)
        rows.append(np.concatenate([[data.time], data.qpos, data.qvel, data.qfrc_applied]))
        mujoco.mj_step(model, data)
    names = "time q_a q_b dq_a dq_b tau_a tau_b".split()
    found = dc.audit(str(path), dict(zip(names, np.array(rows).T)))
    kinds = {f.kind for f in found.findings}
    assert found.verdict.kind == "consistent"
    assert {"channel-not-in-model", "assumed-zero"} <= kinds and "not-replayed" not in kinds


@pytest.mark.parametrize(
    "change",
    [
        lambda log: log.pop("ctrl"),
        lambda log: log.update(ctrl=log["ctrl"][:-1]),
        lambda log: log.update(ctrl=log["ctrl"] * np.nan),
        lambda log: log.update(ctrl=log["ctrl"][::-1]),  # of another run
        pytest.param(  # not yet scaled, as policies put them out
            lambda log: log.update(action=10.0 * log.pop("ctrl")), marks=pytest.mark.slow
        ),
        lambda log: log.update({n: x[1:] for n, x in log.items()}, time=log["time"][1:] * 1.05),
    ],
)
def test_a_replay_that_nobody_asked_for_accuses_nobody(change: Any) -> None:
    log = arrays()
    change(log)
    found = dc.audit(str(MODEL), log)
    assert len(found.run) == len(log["time"])
    assert finding_code("not-replayed") in codes(found)
    assert all(f.weight == "note" for f in found.findings if f.kind == "not-replayed")


def test_a_push_among_rows_that_are_reproduced_is_named_unasked() -> None:
    log = arrays()
    log["qvel"][10:, 0] += 0.2
    found = dc.audit(str(MODEL), log)
    assert codes(found)[0] == finding_code("replay-departs")


def test_wrapped_angles_are_reproduced() -> None:
    """A pendulum that a motor turns several times round, with its angle between −π and π."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body>
        <joint name="pin" axis="0 1 0" damping="0.1"/><inertial pos="0 0 -0.5" mass="1"
        diaginertia="0.02 0.02 0.02"/></body></worldbody><actuator><motor name="m" joint="pin"/></actuator>
        </mujoco>"""
    )
    data, rows = mujoco.MjData(model), list[tuple[float, float, float, float]]()
    for k in range(400):
        data.ctrl[0] = 6.0 + 2.0 * np.sin(0.03 * k)
        rows.append((data.time, data.qpos[0], data.qvel[0], data.ctrl[0]))
        mujoco.mj_step(model, data)
    t, q, u, tau = np.array(rows).T
    assert q.max() > 4.0 * np.pi
    wrapped = (q + np.pi) % (2.0 * np.pi) - np.pi
    log = {"time": t, "qpos": wrapped[:, None], "qvel": u[:, None], "ctrl": tau[:, None]}
    found = dc.audit(model, log)
    assert found.verdict.kind == "consistent"
    assert {"replayed", "wrapped-angle"} == {f.kind for f in found.findings}


AXIS = 'axis="0 0 {}"/>\n        <inertial'


@pytest.mark.parametrize(
    ("old", "new", "kind", "element"),
    [
        pytest.param("", "", "", "", id="noise"),
        # With both axes turned round the plane is seen from behind: the other one explains the same.
        pytest.param(AXIS.format(1), AXIS.format(-1), "axis-sign", "shoulder", id="axis"),
        pytest.param("0 -9.81 0", "0 -9.6 0", "gravity", "gravity", id="gravity"),
    ],
)
def test_motors_hold_the_controls_of_rows_that_are_not_reproduced(
    old: str, new: str, kind: str, element: str
) -> None:
    """Rows with noise, or of another model: what moved them is known all the same."""
    log, rng = dict(np.load(LOG)), np.random.default_rng(0)
    if not kind:
        log |= {n: log[n] + 1e-5 * rng.standard_normal(log[n].shape) for n in ("qpos", "qvel")}
    text = MODEL.read_text("utf-8")
    assert old in text
    found = dc.audit(mujoco.MjModel.from_xml_string(text.replace(old, new)), log)
    assert found.verdict.kind == ("equation-error" if kind else "consistent")
    causes = [(f.kind, f.element) for f in found.findings if f.weight == "cause"]
    assert (kind, element) in causes if kind else not causes
    assert {"actuator m1", "actuator m2"} <= set(map(str, found.run.forces))


def test_what_a_passive_body_touched_is_replayed_without_controls() -> None:
    text = """<mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="1 1 1"/>
        <body pos="0 0 0.3"><freejoint/><geom type="sphere" size="0.1" mass="1"/></body>
        </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data, rows = mujoco.MjData(model), []
    for _ in range(40):
        rows.append((data.time, data.qpos.copy(), data.qvel.copy()))
        mujoco.mj_step(model, data, nstep=10)
    t, q, u = (np.array(x) for x in zip(*rows))
    found = dc.audit(model, {"time": t, "qpos": q, "qvel": u})
    assert finding_code("replayed") in codes(found) and len(found.run) == 391
    assert any(name.startswith("contact") for name in found.run.forces)


def test_models_that_cannot_be_replayed() -> None:
    with pytest.raises(dc.InputError):
        dc.audit("double-pendulum", LOG, replay=True)
    with pytest.raises(dc.InputError, match="finished run"):
        dc.audit(str(MODEL), dc.run_mujoco(str(MODEL), 0.02), replay=True)


def test_frame_skip_is_recorded_step_by_step() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    runs = []
    for skip in (1, 5):
        data = mujoco.MjData(model)
        data.qpos[:] = 1.1, 0.6
        recorder = dc.record_mujoco(model, data)
        for k in range(0, 100, skip):
            data.ctrl[:] = np.sin(k // 5), 0.1
            mujoco.mj_step(model, data, nstep=skip)
            recorder.sample()
        runs.append(recorder.trajectory())
    assert np.array_equal(runs[0].t, runs[1].t) and np.array_equal(runs[0].u, runs[1].u)
    assert all(np.array_equal(runs[0].forces[n], runs[1].forces[n]) for n in runs[0].forces)


def test_gymnasium_environments_are_recorded() -> None:
    gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
    pytest.importorskip("imageio", reason="Gymnasium's MuJoCo environments need imageio")
    env = dc.recorders.gymnasium(gymnasium.make("InvertedDoublePendulum-v5"))
    for seed in (0, 1):
        env.reset(seed=seed)
        env.action_space.seed(seed)
        for _ in range(10):
            env.step(env.action_space.sample())
    run = env.trajectory()
    assert (len(run), len(env.episodes)) == (10 * env.unwrapped.frame_skip + 1, 1)
    data = env.unwrapped.data
    assert np.array_equal(run.q[-1], data.qpos)
    with pytest.raises(dc.InputError):
        dc.recorders.gymnasium(object())


def test_dm_control_environments_are_recorded() -> None:
    """By an environment of its interface: dm_control 1.0.50 does not run on MuJoCo 4."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)

    class Environment:
        physics = SimpleNamespace(model=SimpleNamespace(ptr=model), data=SimpleNamespace(ptr=data))

        def reset(self) -> None:
            mujoco.mj_resetData(model, data)
            data.qpos[:] = 1.0, 0.2

        def step(self, action: Any) -> None:
            data.ctrl[:] = action
            mujoco.mj_step1(model, data)  # dm_control's legacy order
            mujoco.mj_step2(model, data)
            for _ in range(4):
                mujoco.mj_step(model, data)

    env = dc.recorders.dm_control(Environment())
    with pytest.raises(dc.InputError):
        env.step((0.0, 0.0))
    env.reset()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    for k in range(5):
        env.step((0.1 * k, -0.2))
    assert len(env.trajectory()) == 26
    with pytest.raises(dc.InputError):
        dc.recorders.dm_control(object())
