"""What `audit` says of MuJoCo runs that are right, and of logs and models with a planted mistake."""

from __future__ import annotations

import copy
import importlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import audit

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from tests.support.audits import causes, the_cause  # noqa: E402
from tests.support.slow import repeated  # noqa: E402
from tests.systems.mujoco_models import (  # noqa: E402
    ARM,
    BOX,
    HOPPER,
    arm_run,
    box_run,
    hopper_run,
    model_of,
    of_rows_alone,
    scaled,
    with_changes,
    without,
)

# --- right logs are not accused -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("xml", "run", "tolerance"),
    [
        (ARM, arm_run, 1e-3),
        (HOPPER, hopper_run, 3e-3),
        pytest.param(BOX, box_run, 1e-3, marks=pytest.mark.slow),
    ],
    ids=["arm", "hopper", "box"],
)
def test_right_runs_are_consistent(xml: str, run: Any, tolerance: float) -> None:
    """The hopper's soft contacts lose 0.21 % of the energy that it has, 0.1 % of what it exchanges."""
    found = audit(model_of(xml), run(), tolerance=tolerance)
    assert found.verdict.kind == "consistent", found.verdict.explain()
    assert found.exit_code == 0
    assert not [f for f in found.findings if f.weight != "note"]
    assert "Not visible to this test" in found.verdict.explain()


def test_a_coarse_step_is_the_integrators_fault() -> None:
    from deltac.recorders import run_mujoco

    run = run_mujoco(model_of(ARM), 2.0, step=0.01, integrator="euler")
    found = audit(model_of(ARM), run)
    assert found.verdict.kind == "integration-error", found.verdict.explain()
    assert found.exit_code == 1
    assert not causes(found)
    assert "0.01 s" in found.verdict.explain()


def test_corrections_count_as_error_not_as_force() -> None:
    found = audit(model_of(ARM), arm_run("euler"))
    delta_c = found.ledger.delta_c[found.function]
    correction = found.ledger.work["correction implicit"]
    assert np.ptp(correction) > 0.0
    np.testing.assert_allclose(found.energy_error, delta_c + correction, rtol=0, atol=1e-15)
    assert "ΔC with corrections" in found.table()


def test_work_is_discrete_where_an_engine_held_its_forces() -> None:
    hopper, arm = of_rows_alone(hopper_run()), of_rows_alone(arm_run())
    assert audit(model_of(HOPPER), hopper).ledger.method == "discrete"
    assert audit(model_of(HOPPER), hopper.every(2)).ledger.method == "samples"
    assert audit(model_of(ARM), arm).ledger.method == "samples"
    # A recorder takes the works by the stages of the steps, rows left out or not.
    assert audit(model_of(ARM), arm_run().every(2)).ledger.method == "in-loop"


# --- planted mistakes -----------------------------------------------------------------------------


def test_damping_missing_in_the_model_but_logged() -> None:
    found = audit(with_changes(ARM, damping=0.0), arm_run())
    assert found.verdict.kind == "equation-error"
    assert found.exit_code == 1
    assert {f.element for f in causes(found)} == {"damper shoulder", "damper elbow"}
    assert {f.kind for f in causes(found)} == {"channel-not-in-model"}
    # Within a tolerance that allows what flows through them, they are told all the same.
    tolerant = audit(with_changes(ARM, damping=0.0), arm_run(), tolerance=0.9)
    assert tolerant.verdict.kind != "equation-error"
    noted = [f for f in tolerant.findings if f.kind == "channel-not-in-model"]
    assert {f.element for f in noted} == {"damper shoulder", "damper elbow"}
    assert {f.weight for f in noted} == {"note"}


@pytest.mark.long
def test_damping_that_nobody_mentions_is_measured() -> None:
    found = audit(with_changes(ARM, damping=0.0), without(arm_run(), "damper"))
    assert found.verdict.kind == "equation-error"
    measured = {f.element: f.factor for f in causes(found) if f.kind == "missing-damper"}
    assert measured == pytest.approx({"shoulder": 0.05, "elbow": 0.02}, rel=1e-9)  # as in ARM


def test_other_damping_than_the_models() -> None:
    found = audit(with_changes(ARM, dof_damping=[2.0, 1.0]), arm_run())
    cause = the_cause(found, "channel-differs")
    assert cause.element == "damper shoulder"
    assert cause.factor == pytest.approx(0.5, rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("factor", repeated((1.02, 0.98), 1.02))
def test_masses_off_by_two_percent(factor: float) -> None:
    model = with_changes(ARM, body_mass=factor, body_inertia=factor)
    cause = the_cause(audit(model, arm_run()), "mass-scale")
    assert cause.factor == pytest.approx(1.0 / factor, rel=1e-9)


@pytest.mark.long
def test_one_body_heavier_by_two_percent() -> None:
    model = with_changes(ARM, body_mass=[1.0, 1.0, 1.02])
    cause = the_cause(audit(model, arm_run()), "body-mass")
    assert cause.element == "lower"
    assert cause.factor == pytest.approx(1.0 / 1.02, rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("xml", "run"),
    [(ARM, arm_run), pytest.param(BOX, box_run, marks=pytest.mark.slow)],
    ids=["arm", "box"],
)
def test_gravity_of_two_countries(xml: str, run: Any) -> None:
    """A thousandth of gravity is real, and within the tolerance."""
    found = audit(with_changes(xml, gravity=9.8), run(), strict=True)
    assert (found.verdict.kind, found.exit_code) == ("consistent", 1)
    assert replace(found, strict=False).exit_code == 0
    (note,) = (f for f in found.findings if f.kind == "gravity")
    assert note.factor == pytest.approx(9.81 / 9.8, rel=1e-9)
    assert "gravity-vector" not in {kind for kind, _ in note.equals}  # which is the same
    assert "small-but-real" in {f.kind for f in found.findings}


def test_gravity_two_percent_off() -> None:
    found = audit(with_changes(ARM, gravity=9.6), arm_run())
    assert the_cause(found, "gravity").factor == pytest.approx(9.81 / 9.6, rel=1e-9)
    values = json.loads(json.dumps(found.to_dict(), allow_nan=False))  # plain ones
    assert values["verdict"] == "equation-error"
    assert values["findings"][0]["kind"] == "gravity"


@pytest.mark.long
def test_a_wrong_gear() -> None:
    found = audit(model_of(ARM), scaled(arm_run(), "actuator m1", 1.1))
    cause = the_cause(found, "actuator-gear")
    assert found.exit_code == 1
    assert cause.element == "actuator m1"
    assert cause.factor == pytest.approx(1.0 / 1.1, rel=1e-9)


def test_a_wrong_gear_in_the_model() -> None:
    """The ledger takes the logged force and closes; what was recorded of the motors tells."""
    found = audit(with_changes(ARM, actuator_gear=[4.0 / 3.0, 1.0]), arm_run())
    cause = the_cause(found, "channel-differs")
    assert (cause.element, found.exit_code) == ("actuator m1", 1)
    assert cause.factor == pytest.approx(3.0 / 4.0, rel=1e-12)
    assert "log 3, model 4" in cause.evidence
    # A log of somebody else's says nothing of gears, and the audit says so.
    bare = replace(
        arm_run(),
        provenance=replace(
            arm_run().provenance, held=None, stage="", looked_for=(), acted=(), strengths={}
        ),
    )
    unseen = audit(with_changes(ARM, actuator_gear=[4.0 / 3.0, 1.0]), bare)
    assert not causes(unseen)
    assert "wrong gear" in " ".join(unseen.verdict.limits)
    assert "wrong gear" not in " ".join(audit(model_of(ARM), arm_run()).verdict.limits)


def test_an_equality_force_that_is_withheld() -> None:
    """The force of a geared pair of joints points along (1, -1/2) at every instant."""
    equality = """<equality><joint name="geared" joint1="elbow" joint2="shoulder"
        polycoef="0 0.5 0 0 0"/></equality></mujoco>"""
    model = model_of(ARM.replace("</mujoco>", equality))
    run = dc.run_mujoco(model, 0.5, integrator="rk4")
    assert not causes(audit(model, run))
    cause = the_cause(audit(model, without(run, "constraint")), "missing-equality")
    assert cause.element == "constraint geared"
    heavier = copy.copy(model)
    heavier.opt.gravity[2] = -9.8
    assert the_cause(audit(heavier, run), "gravity").element == "gravity"


@pytest.mark.long
def test_a_log_that_is_off_its_constraints() -> None:
    problem = dc.problems.load("n-four-bar")
    run = dc.simulate(problem.mechanism, problem.state, duration=0.5, step=4e-3, solver="ode8")
    assert not causes(audit(problem, run))
    q = np.array(run.q)
    q[:, 1] += 0.01
    found = audit(problem, replace(run, q=q))
    assert found.exit_code == 1
    assert "constraint-violation" in {f.kind for f in causes(found)}, found.verdict.explain()
    drifting = np.array(run.q)
    drifting[:, 1] += 0.01 * run.t
    assert "constraint-drift" in {f.kind for f in causes(audit(problem, replace(run, q=drifting)))}


@pytest.mark.parametrize("withheld", ["contact floor:foot1", "contact"])
def test_a_contact_that_is_withheld(withheld: str) -> None:
    found = audit(model_of(HOPPER), without(hopper_run(), withheld))
    cause = the_cause(found, "missing-contact")
    assert found.exit_code == 1
    assert "pushes upward" in cause.evidence
    touch = hopper_run().forces["contact floor:foot1"].any(axis=1)
    first = hopper_run().t[np.flatnonzero(touch)[0]]
    assert f"({first:.4g} to" in cause.evidence  # the moment the feet touch


# --- our own runs, models by name -----------------------------------------------------------------


def test_problems_by_name_and_logs_by_path(tmp_path: Path) -> None:
    problem = dc.problems.load("triple-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, duration=1.0, step=1e-3, solver="ode5")
    run.write(tmp_path / "run.parquet")
    found = audit("triple-pendulum", tmp_path / "run.parquet")
    assert (found.verdict.kind, found.ledger.method) == ("consistent", "in-loop")
    euler = dc.simulate(problem.mechanism, problem.state, duration=1.0, step=1e-3, solver="ode1")
    assert audit(problem, euler).verdict.kind == "integration-error"


def test_the_ledger_of_a_large_log_keeps_some_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    from deltac.diagnosis.inputs import logs

    run = hopper_run()
    whole = audit(model_of(HOPPER), run)
    monkeypatch.setattr(logs, "LARGE_LOG", 1000)
    monkeypatch.setattr(importlib.import_module("deltac.diagnosis.audit.audit"), "LONG_LOG", 20)
    few = audit(model_of(HOPPER), run)
    assert len(few.ledger.t) <= 0.1 * len(run) < len(whole.ledger.t) == len(run)
    assert few.verdict.kind == whole.verdict.kind
    assert [f.kind for f in few.findings] == [f.kind for f in whole.findings]
    assert few.relative == pytest.approx(whole.relative, rel=1e-9)


def test_a_log_read_in_parts_has_the_same_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deltac.diagnosis.inputs import logs

    hopper_run().write(tmp_path / "run.parquet")
    whole = audit(model_of(HOPPER), tmp_path / "run.parquet")
    monkeypatch.setattr(logs, "LARGE_LOG", 800 * len(hopper_run().to_frame().columns))
    parts = audit(model_of(HOPPER), tmp_path / "run.parquet")
    assert "read-in-parts" in [f.kind for f in parts.findings]
    assert parts.verdict.kind == whole.verdict.kind
    assert parts.relative == pytest.approx(whole.relative, rel=1e-9)
    for a, b in zip(parts.rows(), whole.rows(), strict=True):
        assert (a.name, a.basis[:4]) == (b.name, b.basis[:4])
        assert a.energy == pytest.approx(b.energy, abs=1e-12 * whole.ledger.energy_exchanged)


def test_prescribed_motion_that_was_not_followed() -> None:
    problem = dc.problems.load("driven-triple-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, duration=1.0, step=1e-3, solver="ode5")
    q = np.array(run.q)
    driven = next(e.index for e in problem.mechanism.coordinates if e.prescribed)
    q[:, driven] *= 1.05
    found = audit(problem, replace(run, q=q))
    assert found.verdict.kind == "equation-error"
    assert "prescribed-departs" in [f.kind for f in causes(found)]
    assert audit(problem, run).verdict.kind == "consistent"


def test_arguments_that_make_no_sense() -> None:
    with pytest.raises(dc.InputError, match="tolerance is 2"):
        audit(model_of(ARM), arm_run(), tolerance=2)
    with pytest.raises(dc.InputError, match="expected a Trajectory"):
        audit(model_of(ARM), 3)  # type: ignore[arg-type]
    with pytest.raises(dc.InputError, match="mapping= is for log files"):
        audit(model_of(ARM), arm_run(), mapping="map.toml")
    with pytest.raises(dc.InputError, match="model: found int"):
        audit(3, arm_run())  # type: ignore[arg-type]


def test_a_force_without_a_law_is_left_to_the_log() -> None:
    """A point mass under a thrust of time, by its closed form: the log alone has the force."""
    t = 0.01 * np.arange(301, dtype=float)
    force, w = 2.0 * np.cos(3.0 * t), 3.0
    q, u = 2.0 * (1.0 - np.cos(w * t)) / w**2, 2.0 * np.sin(w * t) / w
    model = dc.Mechanism(
        [dc.point_mass("sled", 1.0)],
        [dc.prismatic("rail", "ground", "sled", "x")],
        forces=[dc.forces.point_force("thruster", "sled")],
    )
    run = dc.Trajectory(
        t=t, q=q[:, None], u=u[:, None], coordinates=("rail",), speeds=("rail",),
        forces={"applied thruster": force[:, None]}, provenance=dc.Provenance("by hand"),
    )  # fmt: skip
    audit = dc.audit(model, run)
    assert audit.verdict.kind == "consistent", audit.verdict.explain()
    assert not [f for f in audit.findings if f.weight == "cause"]
