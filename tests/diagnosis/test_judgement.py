"""One judgement speaks everywhere: verdict, joules, findings, explanation and JSON agree.

Over logs of all kinds: as programs write them, with planted faults, replayed, in doubt.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from tests.natural_logs.cases import AS_IS, CASES, Case
from tests.support.slow import repeated

pytestmark = pytest.mark.case_study(
    "test_a_pendulums_logs_are_judged_by_one_judgement[right]",
    "test_a_pendulums_logs_are_judged_by_one_judgement[coarse]",
    "test_a_pendulums_logs_are_judged_by_one_judgement[at rest]",
    "test_a_pendulums_logs_are_judged_by_one_judgement[three rows]",
    "test_natural_logs_are_judged_by_one_judgement[timetable.csv]",
)

PROBLEM = dc.problems.load("double-pendulum")
PENDULUM = PROBLEM.mechanism
START = PENDULUM.state({"joint1": 0.9, "joint2": 0.4}, {"joint1": 0.3, "joint2": -0.2})


def codes(audit: dc.Audit, weight: str | None = None) -> set[str]:
    """Codes of the findings, of all or of one weight."""
    return {f.code for f in audit.findings if weight in (None, f.weight)}


def assert_consistent(audit: dc.Audit, explanation: dc.Explanation) -> None:
    """What one judgement says in one place contradicts nothing that it says in another."""
    kind, causes = audit.verdict.kind, codes(audit, "cause")
    allowed = audit.tolerance * audit.reference_energy
    # An error of the equations has a cause; what is consistent has none that the equations could have.
    if kind == "equation-error":
        assert causes
    # Where nothing is to be explained nothing was found, and the model arrived wherever it was stepped.
    missed = any(
        f.kind in ("not-replayed", "replay-departs") and f.factor is not None
        for f in audit.findings
    )
    for told in (audit.explanation, explanation):
        assert told is not None
        if told.kind == "nothing":
            assert kind != "equation-error" and not missed and not told.causes
            assert "F-SMALL-BUT-REAL" not in codes(audit)
        if told.kind == "unexplained":
            assert not told.causes and not told.explained
    # Every undecided log is told what would decide, and only those.
    assert ("F-UNDECIDED" in codes(audit)) == (kind == "unresolved")
    assert all(f.remedy for f in audit.findings if f.code == "F-UNDECIDED")
    # Joules add up to ΔC, and none are told of a log that is in doubt.
    if audit.attribution is not None:
        assert "doubt" not in {f.weight for f in audit.findings if f.kind not in OF_THE_LOG}
        parts = audit.attribution
        total = parts.integrator.curve + parts.equations.curve + parts.log.curve
        scale = max(audit.energy_exchanged, 1e-12)
        np.testing.assert_allclose(total, audit.energy_error, atol=1e-9 * scale)
        if kind == "consistent":
            assert parts.integrator.largest[0] <= allowed + 3.0 * parts.integrator.largest[1]
        if kind == "integration-error":
            assert parts.integrator.largest[0] > 0.5 * allowed
    # Odds are probabilities, and the verdict is the likeliest, unless it is left open.
    assert sum(audit.odds.values()) == pytest.approx(1.0)
    assert kind == "unresolved" or audit.odds[kind] == max(audit.odds.values())
    # The line, the sections, the page and the JSON say the same.
    told_json: dict[str, Any] = json.loads(json.dumps(audit.to_dict()))
    assert told_json["verdict"] == kind and audit.summary().startswith(kind)
    assert {f["code"] for f in told_json["findings"]} == codes(audit)
    words = audit.explain()
    assert all(f"[{code}]" in words for code in codes(audit))


OF_THE_LOG = ("late-forces", "actuator-delay", "zero-offset")
"""Doubts that are numbers of the inference, whose joules it tells apart."""


def pendulum_logs() -> dict[str, tuple[Any, Any, dict[str, Any]]]:
    """Logs of a double pendulum by name: model, log, options; right, wrong, coarse and in doubt."""
    run = dc.simulate(PENDULUM, START, 2.0, 0.01, "ode4")
    coarse = dc.simulate(PENDULUM, START, 2.0, 0.02, "semi-implicit-euler")
    rng = np.random.default_rng(5)
    noise = [rng.normal(0.0, 1e-3, x.shape) for x in (run.q, run.u)]
    rounded = replace(run, q=np.round(run.q, 2), u=np.round(run.u, 2), udot=None, integrals={})
    plain: dict[str, Any] = {"udot": None, "integrals": {}, "works": {}}
    lighter = replace(PENDULUM, parameters={**PENDULUM.parameters, "g": 9.0})
    nearly = replace(PENDULUM, parameters={**PENDULUM.parameters, "m2": 1.0001})
    noisy = replace(run, q=run.q + noise[0], u=run.u + noise[1], **plain)
    absolute = replace(run, q=np.cumsum(run.q, axis=1), u=np.cumsum(run.u, axis=1), **plain)
    degrees = {"t": run.t, "q": np.degrees(run.q), "u": np.degrees(run.u)}
    return {
        "right": (PENDULUM, run, {}),
        "coarse": (PENDULUM, coarse, {}),
        "noisy": (PENDULUM, noisy, {}),
        "two decimals": (PENDULUM, rounded, {}),
        "strict tolerance": (PENDULUM, noisy, {"tolerance": 1e-9}),
        "another gravity": (lighter, run, {}),
        "another gravity, noisy": (lighter, noisy, {}),
        "nearly right": (nearly, run, {}),
        "absolute angles": (PENDULUM, absolute, {}),
        "degrees": (PENDULUM, degrees, {}),
        "at rest": (PENDULUM, replace(run, q=0.0 * run.q, u=0.0 * run.u, **plain), {}),
        "three rows": (PENDULUM, run.take(np.arange(3)), {}),
    }


PENDULUMS = pendulum_logs()


COMBINED = ("another gravity, noisy", "strict tolerance", "absolute angles")
"""Logs of which each property is that of another one; what degrees are told as, absolute angles are."""


@pytest.mark.parametrize("name", repeated(PENDULUMS, *(PENDULUMS.keys() - set(COMBINED))))
def test_a_pendulums_logs_are_judged_by_one_judgement(name: str) -> None:
    model, log, options = PENDULUMS[name]
    audit = dc.audit(model, log, **options)
    try:
        explanation = dc.explain_residual(model, log)
    except dc.InputError as error:  # too few rows to explain anything
        assert name == "three rows" and error.code == "E-LOG"
        assert audit.explanation is not None
        explanation = audit.explanation
    assert_consistent(audit, explanation)
    if name == "degrees":
        assert "F-DEGREES" in codes(audit, "doubt") and audit.verdict.kind == "unresolved"
    if name in ("absolute angles", "degrees"):
        assert audit.attribution is None and explanation.kind == "doubtful"
    if name in ("another gravity", "another gravity, noisy"):
        assert (audit.verdict.kind, explanation.causes[0].kind) == ("equation-error", "gravity")
    if name == "right":
        assert (audit.verdict.kind, explanation.kind) == ("consistent", "nothing")


NATURAL = [case for case in CASES if case.outcome == AS_IS and case.machine != "walker"]


@pytest.mark.parametrize("case", [pytest.param(c, id=c.file) for c in NATURAL[::6]])
def test_natural_logs_are_judged_by_one_judgement(case: Case) -> None:
    if not case.path.suffix or case.path.suffix in (".mcap", ".bag", ".hdf5"):
        pytest.skip("an optional reader")
    audit = dc.audit(case.model, case.path)  # type: ignore[arg-type]
    assert audit.explanation is not None
    assert_consistent(audit, audit.explanation)


@pytest.mark.slow  # what is found in them: tests/faults
@pytest.mark.parametrize("name", ("missing_lever_arm", "inertia_axes_lost"))
def test_published_faults_are_judged_by_one_judgement(name: str) -> None:
    pytest.importorskip("mujoco")
    from tests.systems import fault_cases

    given = getattr(fault_cases, name)()
    for log in (given.right, given.log):
        audit = dc.audit(given.model, log)
        assert audit.explanation is not None
        assert_consistent(audit, audit.explanation)


# --- a policy's log, whose model has another damper ------------------------------------------------

HOPPER = """<mujoco model="leg"><option timestep="0.002"/><worldbody>
 <geom type="plane" size="5 5 .1"/>
 <body name="shank" pos="0 0 1.2"><joint name="slide" type="slide" axis="0 0 1"/>
  <joint name="hip" axis="0 1 0" damping="{damping}"/>
  <geom type="capsule" fromto="0 0 0.2 0 0 -0.2" size="0.05" mass="3"/>
  <body name="foot" pos="0 0 -0.2"><joint name="knee" axis="0 1 0" damping="{damping}"/>
   <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.05" mass="2"/></body></body></worldbody>
 <actuator><motor joint="hip" gear="20"/><motor joint="knee" gear="10"/></actuator></mujoco>"""
SKIP, ROWS = 5, 40


def policy(damping: float) -> dict[str, np.ndarray]:
    """Rows at every fifth step, as Gymnasium has them."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(HOPPER.format(damping=damping))
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    log: dict[str, list[Any]] = {name: [] for name in ("time", "qpos", "qvel", "ctrl")}
    for _ in range(ROWS):
        data.ctrl[:] = rng.uniform(-1.0, 1.0, model.nu)
        for name, column in log.items():
            column.append(np.copy(getattr(data, name)))
        mujoco.mj_step(model, data, SKIP)
    return {name: np.array(column) for name, column in log.items()}


def missed_energy(log: dict[str, np.ndarray], damping: float) -> float:
    """The energy (J) of all rows beyond where MuJoCo arrives from the rows before, as MuJoCo counts it."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(HOPPER.format(damping=damping))
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, total = mujoco.MjData(model), 0.0

    def energy_of(k: int) -> float:
        data.qpos[:], data.qvel[:], data.ctrl[:] = log["qpos"][k], log["qvel"][k], log["ctrl"][k]
        mujoco.mj_forward(model, data)
        return float(data.energy.sum())

    for k in range(1, ROWS):
        row = energy_of(k)
        energy_of(k - 1)
        mujoco.mj_step(model, data, SKIP)
        mujoco.mj_forward(model, data)
        total += row - float(data.energy.sum())
    return total


def test_a_policys_log_whose_model_has_another_damper(tmp_path: Path) -> None:
    log = policy(damping=0.3)
    model = tmp_path / "leg.xml"
    model.write_text(HOPPER.format(damping=0.36), "utf-8")
    audit = dc.audit(str(model), log)
    # By which damper the simulator arrives at all rows is found; the model's own is known to be another.
    assert {"F-IDENTIFIED", "F-REPLAYED"} <= codes(audit)
    assert audit.verdict.kind == "equation-error" and "F-CHANNEL-DIFFERS" in codes(audit, "cause")
    differ = [f.factor for f in audit.findings if f.code == "F-CHANNEL-DIFFERS"]
    assert differ == pytest.approx([0.3 / 0.36] * len(differ), rel=1e-6)

    again = dc.audit(str(model), log, replay=True)
    assert again.verdict.kind == "equation-error" and "F-REPLAY-DEPARTS" in codes(again, "cause")
    assert "F-IDENTIFIED" in codes(again)
    assert again.explanation is not None and again.attribution is not None
    assert_consistent(again, again.explanation)
    expected = missed_energy(log, damping=0.36)
    assert expected > 20.0 * again.tolerance * again.reference_energy
    assert again.attribution.equations.energy == pytest.approx(expected, rel=1e-3)
    remedies = {f.remedy for f in again.findings if f.code == "F-WORK-UNRESOLVED"}
    assert not any(remedy.startswith("Log more") for remedy in remedies)


def test_forces_by_controls_do_not_depend_on_what_memory_held(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mujoco = pytest.importorskip("mujoco")
    from deltac.recorders.mujoco_forces import actuator_forces

    positions = mujoco.mj_fwdPosition

    def with_memory_as_others_left_it(model: Any, data: Any) -> None:
        positions(model, data)
        data.efc_force[:] = np.nan

    monkeypatch.setattr(mujoco, "mj_fwdPosition", with_memory_as_others_left_it)
    model = mujoco.MjModel.from_xml_string(HOPPER.format(damping=0.3))
    on_the_floor, at_rest = np.array([[-1.0, 0.0, 0.0]]), np.zeros((1, model.nv))
    forces = actuator_forces(model, on_the_floor, at_rest, np.array([[0.5, -0.25]]))
    assert forces is not None
    assert [list(f[0]) for f in forces.values()] == [[0.0, 10.0, 0.0], [0.0, 0.0, -2.5]]


def test_a_policys_log_of_this_model_has_no_joules_of_mistakes(tmp_path: Path) -> None:
    log = policy(damping=0.3)
    model = tmp_path / "leg.xml"
    model.write_text(HOPPER.format(damping=0.3), "utf-8")
    audit = dc.audit(str(model), {**log, "qpos": np.round(log["qpos"], 6)})
    assert "F-REPLAYED" in codes(audit) and audit.attribution is not None
    assert audit.attribution.equations.energy == 0.0
    # What the digits of the log add is the log's, not the integrator's.
    exact = dc.audit(str(model), log).attribution
    assert exact is not None and exact.log.energy == pytest.approx(0.0, abs=1e-9)
    assert audit.attribution.log.energy != 0.0
    assert audit.attribution.integrator.energy == pytest.approx(exact.integrator.energy, rel=1e-2)


ARM = """<mujoco model="arm"><option timestep="0.002" integrator="{integrator}"/><worldbody>
 <body><joint name="shoulder" axis="0 1 0" damping="{damping}"/>
  <inertial pos="0 0 -.35" mass="2" diaginertia=".03 .03 .01"/>
  <body pos="0 0 -.7"><joint name="elbow" axis="0 1 0" damping=".1"/>
   <inertial pos="0 0 -.3" mass="1" diaginertia=".02 .02 .008"/></body></body></worldbody>
 <actuator><motor name="A" joint="shoulder" gear="{gear}"/><motor name="B" joint="elbow"/></actuator>
</mujoco>"""
RIGHT = {"damping": 0.2, "gear": 1.0, "integrator": "RK4"}


def arm_log(
    controls: Callable[[float], Any],
    acting: Callable[[Any, Any], Any],
    rows: int,
    skip: int,
    **model: Any,
) -> dict[str, np.ndarray]:
    """Rows of the arm by MuJoCo with these controls; of them and the speeds, what acts."""
    mujoco = pytest.importorskip("mujoco")
    compiled = mujoco.MjModel.from_xml_string(ARM.format(**{**RIGHT, **model}))
    data = mujoco.MjData(compiled)
    data.qpos[:] = 0.7, -0.3
    log: dict[str, list[Any]] = {name: [] for name in ("time", "qpos", "qvel", "ctrl")}
    for _ in range(rows):
        data.ctrl[:] = controls(data.time)
        for name, column in log.items():
            column.append(np.copy(getattr(data, name)))
        data.ctrl[:] = acting(np.copy(data.ctrl), data.qvel)
        mujoco.mj_step(compiled, data, skip)
    return {name: np.array(column) for name, column in log.items()}


def arm(folder: Path, **wrong: Any) -> str:
    """The file of the arm."""
    (folder / "arm.xml").write_text(ARM.format(**{**RIGHT, **wrong}), "utf-8")
    return str(folder / "arm.xml")


@pytest.mark.parametrize(
    ("wrong", "kind", "true"),
    [({"damping": 0.3}, "damping", 0.2), ({"gear": 1.1}, "actuator-gear", 1 / 1.1)],
    ids=["damper", "gear"],
)
def test_mistakes_beside_torques_that_are_new_at_each_row(
    wrong: dict[str, float], kind: str, true: float, tmp_path: Path
) -> None:
    """A policy's torques look like noise, until it is told that they are held from row to row."""
    rng = np.random.default_rng(0)
    log = arm_log(lambda t: rng.uniform(-4.0, 4.0, 2), lambda ctrl, _: ctrl, 400, SKIP)
    audit = dc.audit(arm(tmp_path, **wrong), log)
    assert audit.verdict.kind == "equation-error"
    [cause] = audit.causes
    assert cause.kind == kind and cause.values[0] == pytest.approx(true, rel=1e-6)


def waves(t: float) -> tuple[float, float]:
    return 4.0 * np.sin(5.0 * t), 2.0 * np.cos(7.0 * t)


def test_friction_that_the_model_lacks_is_named_by_its_controls(tmp_path: Path) -> None:
    """It is smoothed at reversals, so that the law of Coulomb leaves more than a millionth of the misses."""
    log = arm_log(waves, lambda ctrl, u: ctrl - 0.2 * np.tanh(20.0 * u), 600, 1, integrator="Euler")
    audit = dc.audit(arm(tmp_path, integrator="Euler"), log)
    assert audit.verdict.kind == "equation-error"
    told = {(c.kind, c.element): c.values[0] for c in audit.causes}
    for joint in ("shoulder", "elbow"):
        assert told["missing-friction", joint] == pytest.approx(0.2, rel=0.1)


def test_noise_on_the_controls_accuses_no_model(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    log = arm_log(waves, lambda ctrl, _: ctrl + 0.2 * rng.standard_normal(2), 600, 1)
    audit = dc.audit(arm(tmp_path), log)
    assert audit.verdict.kind == "unresolved" and "F-NOT-REPLAYED" in codes(audit)


# --- the same numbers in other containers -----------------------------------------------------------


def test_confidence_does_not_depend_on_the_container() -> None:
    run = dc.simulate(PENDULUM, START, 2.0, 0.01, "ode4")
    tables: list[Any] = [
        {"t": run.t, "q": run.q, "u": run.u},
        np.column_stack([run.t, run.q, run.u]),
        {"t": run.t, "state": np.column_stack([run.q, run.u])},
        {"t": run.t, "state": np.stack([run.q, run.u], axis=2).reshape(len(run), -1)},
    ]
    verdicts = [dc.audit(PENDULUM, table).verdict for table in tables]
    assert {(v.kind, v.confidence) for v in verdicts} == {("consistent", "high")}


def test_a_part_of_a_long_log_is_said_to_be_one() -> None:
    run = dc.simulate(PENDULUM, START, 9.0, 0.001, "ode4")
    audit = dc.audit(PENDULUM, run)
    assert audit.inference is not None and len(audit.inference.w) < len(run) - 1
    assert any(
        f"{len(audit.inference.w)} intervals of {len(run) - 1}" in e for e in audit.verdict.evidence
    )
