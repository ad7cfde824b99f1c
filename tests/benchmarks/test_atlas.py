"""The atlas: the same motion in every simulator, a row for whatever goes wrong, resumed after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atlas import experiments
from atlas.experiments import MOTIONS, SIMULATORS, Experiment
from atlas.fleet import Size, atlas, model_files, model_sizes, plan_atlas

import deltac as dc
from deltac.errors import InputError
from deltac.fleets.spec import Execution
from deltac.foreign.isolation import Failure
from deltac.recorders.mujoco_recorder import compiled_model
from tests.support.slow import repeated

pytest.importorskip("mujoco", reason="URDF files are read by MuJoCo")

pytestmark = pytest.mark.case_study(
    "test_a_model_that_is_too_large_says_so",
    "test_every_simulator_makes_the_same_motion[deltac-ode4]",
    "test_models_that_cannot_be_run_are_rows_with_their_reason",
)

LINK = """
 <link name="{name}"><inertial><origin xyz="0.02 0.01 -{half}" rpy="0.1 0 0"/><mass value="{mass}"/>
  <inertia ixx="{I}" iyy="{J}" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial></link>"""

ARM = (
    '<robot name="arm"><link name="base"/>'
    + LINK.format(name="upper", half=0.2, mass=1.5, I=0.05, J=0.045)
    + LINK.format(name="fore", half=0.15, mass=0.8, I=0.02, J=0.03)
    + """
 <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
  <origin xyz="0 0 1" rpy="0 0.7 0"/><axis xyz="0 1 0"/><dynamics damping="0.05"/>
  <limit lower="-9" upper="9" effort="100" velocity="100"/></joint>
 <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/>
  <origin xyz="0 0 -0.4" rpy="0.3 0 0.2"/><axis xyz="0.6 0.8 0"/><dynamics damping="0.02"/></joint>
</robot>"""
)
"""An oblique axis, offset centres, dampers: what drivers may get wrong."""

PLAN = """
name = "arms"
duration = 0.1
step = 0.005
rows = 1
motions = ["fall", "hold"]
[execution]
workers = 1
[simulators]
deltac = ["ode2", "ode4"]
[models]
"." = ["*.urdf"]
"""

RUNS = [(name, solver) for name, one in SIMULATORS.items() for solver in one.orders]


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def reference(experiment: Experiment) -> Any:
    """q at the end under torques of each instant, by SciPy at a tight tolerance."""
    from scipy.integrate import solve_ivp

    mechanism = experiment.model.mechanism
    motors = [dc.forces.joint_torque(j, j) for j in experiment.joints]
    driven = replace(mechanism, forces=(*mechanism.forces, *motors))

    def rates(t: float, y: Any) -> Any:
        q, u = y[:2], y[2:]
        loads = dict(zip(experiment.joints, experiment.torque(t, q, u).tolist()))
        return np.concatenate([u, dc.evaluate(driven, driven.state(q, u), inputs=loads).udot])

    start = [*experiment.start.q, *experiment.start.u]
    return solve_ivp(rates, (0.0, 0.2), start, rtol=1e-7, atol=1e-8).y[:2, -1]


@pytest.mark.parametrize(("name", "solver"), RUNS, ids=[f"{n}-{s}" for n, s in RUNS])
def test_every_simulator_makes_the_same_motion(name: str, solver: str, arm: Path) -> None:
    """Ends come together as the order says; without a torque that is held, which is of order 1."""
    simulator = SIMULATORS[name]
    if not simulator.installed:
        pytest.skip(f"{name} is not installed")
    experiment = Experiment.of(arm, "fall", 0.2)
    ours = SIMULATORS["deltac"].run(experiment, 0.001, "ode5").q[-1]
    names = experiment.joints
    missed = []
    for step in (0.01, 0.005):
        run = simulator.run(experiment, step, solver)
        row = int(np.argmin(np.abs(run.t - 0.2)))
        if abs(run.t[row] - 0.2) > 1e-9:  # the last state of steps with held forces is no row
            assert run.udot is not None
            end = run.q[-1] + step * (run.u[-1] + step * run.udot[-1])
        else:
            end = run.q[row]
        missed.append(np.abs(end[[run.coordinates.index(n) for n in names]] - ours).max())
        assert missed[-1] < 0.02
        report = dc.audit(experiment.model, run)
        assert report.verdict.kind in ("consistent", "integration-error"), report.summary()
        if name == "exudyn" and solver == "velocity-verlet":
            # Semi-implicit Euler makes the same coordinates with other speeds, and 0.037 J.
            assert report.integrator is not None and report.attribution is not None
            assert report.integrator.names == ("leapfrog",)
            assert abs(report.attribution.integrator.energy) < 3e-4
    order = simulator.orders[solver]
    assert missed[1] < 1e-10 or np.log2(missed[0] / missed[1]) > order - 0.4


@pytest.mark.parametrize("motion", repeated(MOTIONS, "sway"))
def test_torques_are_those_of_the_motion(motion: str, arm: Path) -> None:
    """Every simulator goes where the torques drive the arm; held torques lag by half a step."""
    experiment = Experiment.of(arm, motion, 0.2)
    ends = {}
    for name, simulator in SIMULATORS.items():
        if simulator.installed:
            run = simulator.run(experiment, 0.001, list(simulator.orders)[-1])
            row = run.q[-1] if run.t[-1] > 0.1995 else run.q[-1] + 0.001 * run.u[-1]
            assert not any(channel.startswith("limit") for channel in run.forces), name
            ends[name] = row[[run.coordinates.index(n) for n in experiment.joints]]
    expected = ends.pop("deltac")
    assert np.abs(expected - reference(experiment)).max() < 2e-3
    for name, end in ends.items():
        assert np.abs(end - expected).max() < 2e-3, name
    assert len(ends) >= 1


def test_rows_of_a_plan(tmp_path: Path, arm: Path) -> None:
    (tmp_path / "broken.urdf").write_text("<robot>")
    (tmp_path / "stone.urdf").write_text('<robot name="stone"><link name="stone"/></robot>')
    (tmp_path / "plan.toml").write_text(PLAN)
    fleet = atlas(tmp_path / "plan.toml", tmp_path / "out", workers=1)
    frame = fleet.frame
    assert len(frame) == fleet.total == 2 * 2 * 3 + 2
    assert fleet.verdicts == {"consistent": 12, "failed": 2}
    failed = {row["model"]: row for row in frame.iter_rows(named=True) if row["code"]}
    assert set(failed) == {"broken.urdf", "stone.urdf"}
    assert all(row["message"] for row in failed.values())
    own = frame.filter((frame["solver"] == "deltac:ode4") & (frame["motion"] == "fall")).sort(
        "step"
    )
    assert own["step"].to_list() == [0.0025, 0.005, 0.01]
    errors = own["energy_error"].to_numpy()
    assert 3.5 < np.log2(errors[2] / errors[1]) < 5.5
    assert np.allclose(own["integrator_largest"][:2], errors[:2], rtol=0.1)
    again = atlas(tmp_path / "plan.toml", tmp_path / "out", workers=1)
    assert again.frame.equals(frame)  # even the seconds: nothing was run again


def test_a_model_that_is_too_large_says_so(tmp_path: Path, arm: Path) -> None:
    (tmp_path / "plan.toml").write_text("speeds = 1\n" + PLAN)
    (row,) = atlas(tmp_path / "plan.toml", tmp_path / "out", workers=1).frame.iter_rows(named=True)
    assert row["verdict"] == "failed" and "2 speeds" in row["message"]


def test_a_killed_atlas_goes_on(tmp_path: Path, arm: Path) -> None:
    plan, out = tmp_path / "plan.toml", tmp_path / "out"
    plan.write_text(PLAN)
    command = [sys.executable, "benchmarks/atlas/run.py", str(plan), "--out", str(out)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    until = time.monotonic() + 120.0
    while not list(out.glob("pieces/*.parquet")) and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = {path: path.read_bytes() for path in out.glob("pieces/*.parquet")}
    assert before
    fleet = atlas(plan, out, workers=1)
    assert fleet.done == fleet.total == 12 and fleet.verdicts == {"consistent": 12}
    assert all(path.read_bytes() == content for path, content in before.items())


def test_what_is_not_installed_is_skipped_by_name(
    tmp_path: Path, arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = replace(SIMULATORS["pybullet"], module="no_such_module")
    monkeypatch.setitem(experiments.SIMULATORS, "pybullet", missing)
    text = PLAN.replace("[models]", 'pybullet = ["semi-implicit euler"]\n[models]\nno-such = ["*"]')
    (tmp_path / "plan.toml").write_text(text)
    plan = plan_atlas(tmp_path / "plan.toml")
    assert plan.skipped == ("package no-such", "simulator pybullet")
    assert {run.setting.simulator for run in plan.rows} == {"deltac"}


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('"fall"', '"fly"', "fly"),
        ("deltac =", "delta =", "delta"),
        ('"ode4"', '"ode99"', "ode99"),
        ("duration = 0.1", "duration = -1", "duration"),
        ("rows = 1", "row = 1", "row"),
        ('"*.urdf"', '"*.none"', "model"),
        ("[models]", "[models", "plan.toml"),
    ],
)
def test_bad_plans(tmp_path: Path, arm: Path, old: str, new: str, named: str) -> None:
    (tmp_path / "plan.toml").write_text(PLAN.replace(old, new))
    with pytest.raises(InputError, match=named):
        plan_atlas(tmp_path / "plan.toml")


def test_only_what_others_read_is_given_to_them(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    experiment = Experiment.of(path, "fall", 0.1)
    for name, simulator in SIMULATORS.items():
        if simulator.installed and not simulator.mjcf:
            with pytest.raises(InputError, match="MJCF"):
                simulator.run(experiment, 0.01, next(iter(simulator.orders)))
        assert name


# --- what the atlas' own runs taught -----------------------------------------------------------------


def test_models_that_cannot_be_run_are_rows_with_their_reason(tmp_path: Path) -> None:
    body = '<body><joint name="j"/>{}</body>'
    for name, inside in {
        "massless": '<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>',
        "stiff": '<geom size="0.1"/>',
    }.items():
        text = f"<mujoco><worldbody>{body.format(inside)}</worldbody></mujoco>"
        if (
            name == "stiff"
        ):  # a time scale of microseconds: every explicit step of milliseconds blows up
            text = text.replace('name="j"', 'name="j" damping="1e5"')
        (tmp_path / f"{name}.xml").write_text(text)
    (tmp_path / "plan.toml").write_text(PLAN.replace("*.urdf", "*.xml"))
    frame = atlas(tmp_path / "plan.toml", tmp_path / "out", workers=1).frame
    rows = list(frame.filter(frame["model"] == "massless.xml").iter_rows(named=True))
    assert len(rows) == 1 and rows[0]["code"] == "E-MODEL" and "mass" in rows[0]["message"]
    stiff = frame.filter(frame["model"] == "stiff.xml")
    assert len(stiff) == 12 and stiff["message"].null_count() == 0
    assert set(stiff["verdict"]) <= {"failed", "unresolved", "integration-error"}
    assert all(build.startswith(dc.__version__) for build in frame["build"])


@pytest.mark.slow
def test_a_model_that_brings_mujoco_down_is_a_row(tmp_path: Path) -> None:
    """A few lines that ask for more bodies than there is memory for."""
    grid = '<replicate count="4000" offset="1 0 0">' * 3 + "{}" + "</replicate>" * 3
    text = grid.format('<body><joint/><geom size=".1"/></body>')
    (tmp_path / "bomb.xml").write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    (tmp_path / "good.xml").write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    (tmp_path / "plan.toml").write_text(PLAN.replace("*.urdf", "*.xml"))
    sizes = model_sizes(
        {name: tmp_path / name for name in ("bomb.xml", "good.xml")}, Execution(workers=1), 10.0
    )
    assert isinstance(sizes["bomb.xml"], Failure) and sizes["bomb.xml"].message
    assert sizes["good.xml"] == Size(1, 0.002)


def test_an_atlas_that_was_stopped_is_a_sample_of_all(tmp_path: Path, arm: Path) -> None:
    (tmp_path / "other.urdf").write_text(ARM.replace("1.5", "1.4"))
    (tmp_path / "plan.toml").write_text(PLAN)
    rows = plan_atlas(tmp_path / "plan.toml").rows
    assert sorted(run.setting.label for run in rows[:2]) == ["arm.urdf", "other.urdf"]
    assert {run.factor for run in rows[:2]} == {1.0}
    assert {run.factor for run in rows[2:6]} == {2.0, 0.5}
    one = {(run.setting.label, run.setting.solver, run.setting.motion) for run in rows[:2]}
    assert one == {(r.setting.label, r.setting.solver, r.setting.motion) for r in rows[2:6]}
    runs = {(r.setting.label, r.setting.solver, r.setting.motion) for r in rows[:12]}
    assert len(runs) == 4 and len({(label, motion) for label, _, motion in runs}) == 2


def test_models_are_read_once(tmp_path: Path, arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("DELTAC_CACHE", "on")
    (tmp_path / "plan.toml").write_text(PLAN)
    first = plan_atlas(tmp_path / "plan.toml")

    def refuse(*_: Any) -> None:
        raise AssertionError("read again")

    with monkeypatch.context() as patch:
        patch.setattr("atlas.fleet.ModelReading", refuse)
        assert plan_atlas(tmp_path / "plan.toml").addresses == first.addresses
    arm.write_text(ARM.replace("1.5", "1.4"))
    assert plan_atlas(tmp_path / "plan.toml").addresses != first.addresses


def kutta(step: float) -> dc.Trajectory:
    """The arm's pendulum by Kutta's method of third order, in a loop of our own, its damper logged."""
    rows = [np.array([1.0, 0.3])]

    def rate(x: Any) -> Any:
        return np.array([x[1], (-9.81 * 0.8 * np.sin(x[0]) - 0.3 * x[1]) / 0.64])

    for _ in range(round(3.0 / step)):
        x = rows[-1]
        k1 = rate(x)
        k2 = rate(x + step / 2 * k1)
        rows.append(x + step / 6 * (k1 + 4 * k2 + rate(x - step * k1 + 2 * step * k2)))
    y = np.array(rows)
    return dc.Trajectory(
        t=np.arange(len(y), dtype=float) * step, q=y[:, :1], u=y[:, 1:], coordinates=("j",), speeds=("j",),
        forces={"damper j": -0.3 * y[:, 1:]},
        provenance=dc.Provenance("own loop", solver="kutta", step=step, order=3),
    )  # fmt: skip


def test_a_force_that_the_model_has_too_is_the_models_between_rows() -> None:
    """Rows then follow from each other by the method itself, to their digits."""
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 1.0)],
        [dc.revolute("j", "ground", "bob", child_position=(0, 0.8, 0), damping=0.3)],
        gravity=(0, -9.81, 0),
    )
    for step, kind in ((0.02, "consistent"), (0.15, "integration-error")):
        report = dc.audit(mechanism, kutta(step))
        assert report.verdict.kind == kind, report.explain()
        assert report.integrator is not None and report.integrator.names == ("kutta-3",)


LIMITED = """<mujoco><option timestep="0.004" integrator="{}"/><worldbody>
 <body><joint name="j" axis="0 1 0" range="-30 30" limited="true"/><geom type="capsule" fromto="0 0 0 0.4 0 0"
  size="0.03"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("integrator", repeated(("Euler", "implicitfast"), "implicitfast"))
def test_in_the_loop_the_works_of_the_steps_decide(tmp_path: Path, integrator: str) -> None:
    """Against a stop the works of a step's force and of the flow differ: ΔC is of the former, and known."""
    path = tmp_path / "limited.xml"
    path.write_text(LIMITED.format(integrator))
    experiment = Experiment.of(path, "fall", 0.6)
    reports = [
        dc.audit(experiment.model, SIMULATORS["mujoco"].run(experiment, step, integrator.lower()))
        for step in (4e-3, 1e-4)
    ]
    assert [r.verdict.kind for r in reports] == ["integration-error", "consistent"]
    assert reports[0].integrator is not None
    assert "semi-implicit-euler" in reports[0].integrator.names


def test_stages_over_a_contact_leave_a_balanced_run_consistent(tmp_path: Path) -> None:
    """Forces of the stages are in no row; their works are in the balance."""
    path = tmp_path / "limited.xml"
    path.write_text(LIMITED.format("RK4"))
    experiment = Experiment.of(path, "fall", 0.6)
    report = dc.audit(experiment.model, SIMULATORS["mujoco"].run(experiment, 5e-4, "rk4"))
    assert report.relative < 1e-3 and report.verdict.kind == "consistent", report.explain()


def test_forces_of_constraints_that_cancel_add_up(tmp_path: Path) -> None:
    """A slider wedged deep between two balls across its axis: forces 10⁸ times what it feels of them."""
    path = tmp_path / "wedge.xml"
    path.write_text(
        """<mujoco><option timestep="0.002"/><worldbody><geom pos="0 0.5 0" size="0.6"/>
        <geom pos="1e-9 -0.5 0" size="0.6"/><body><joint name="j" type="slide" axis="1 0 0"/>
        <geom size="0.3" mass="0.1"/></body></worldbody></mujoco>"""
    )
    experiment = Experiment.of(path, "fall", 0.1)
    run = SIMULATORS["mujoco"].run(experiment, 0.002, "euler")
    total = sum(force[:, 0] for force in run.forces.values())
    mass = compiled_model(path).body_mass[1]
    size = np.abs(total).max()
    assert (
        run.udot is not None and np.abs(mass * run.udot[:, 0] - total).max() < 1e-11 * size + 1e-12
    )
    assert dc.audit(experiment.model, run).verdict.kind != "equation-error"


def test_a_recording_ends_where_the_run_blew_up() -> None:
    from deltac.recorders.recorder import Recorder

    class Own(Recorder):
        def row(self, t: float, u: float) -> None:
            self._instant(
                t, np.array([0.1]), np.array([u]), np.array([0.0]), {"actuator m": np.array([u])}
            )

        def trajectory(self) -> dc.Trajectory:
            return self._trajectory(dc.Provenance("own loop"))

    recorder = Own(("j",), ("j",))
    for k, u in enumerate([1.0, 2.0, 1e60, np.nan]):
        recorder.row(0.1 * k, u)
    run = recorder.trajectory()
    assert run.u[:, 0].tolist() == [1.0, 2.0] and "0.2 s" in run.provenance.message
    with pytest.raises(InputError, match="blew up"):
        recorder = Own(("j",), ("j",))
        recorder.row(0.0, np.inf)
        recorder.trajectory()


def test_differences_in_the_last_digits_are_no_mistake() -> None:
    """PyBullet's masses differ from the file's by 10⁻¹⁰; by Pinocchio's inverse dynamics it moves right."""
    pin = pytest.importorskip("pinocchio")
    pytest.importorskip("pybullet")
    files, missing = model_files({"example-robot-data": ["*/go1.urdf"]}, Path())
    if missing:
        pytest.skip("example-robot-data is not installed")
    experiment = Experiment.of(*files.values(), "sway", 0.3)  # type: ignore[call-arg]
    run = SIMULATORS["pybullet"].run(experiment, 0.004, "semi-implicit euler")
    model = pin.buildModelFromXML(experiment.text)
    data = model.createData()
    places = [model.joints[model.getJointId(name)].idx_v for name in run.speeds]
    assert run.udot is not None
    total, rows = np.sum(list(run.forces.values()), axis=0), (run.q, run.u, run.udot)
    for k in range(len(run)):
        state = [np.zeros(model.nv) for _ in rows]
        for column, values in zip(state, rows):
            column[places] = values[k]
        assert np.abs(pin.rnea(model, data, *state)[places] - total[k]).max() < 1e-6
    assert dc.audit(experiment.model, run).verdict.kind == "integration-error"


def test_a_simulator_that_ends_the_process_is_a_row(
    tmp_path: Path, arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(*_: Any) -> dc.Trajectory:
        raise SystemExit(1)

    (tmp_path / "plan.toml").write_text(PLAN)
    plan = plan_atlas(tmp_path / "plan.toml")
    monkeypatch.setitem(experiments.SIMULATORS, "deltac", replace(SIMULATORS["deltac"], run=end))
    outcome = plan.piece_at(plan.addresses[0]).outcome()
    assert outcome["verdict"] == ["failed"] and "ends the process" in outcome["message"][0]
