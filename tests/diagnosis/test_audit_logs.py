"""What `audit` says of logs that cannot be judged, or are told in other names, digits and orders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac import Trajectory, audit

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from tests.support.audits import causes, cut, the_cause  # noqa: E402
from tests.support.slow import crossed, repeated  # noqa: E402
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

pytestmark = pytest.mark.case_study(
    "test_missing_rows_are_named_not_accused",
    "test_values_one_row_old_are_named",
    "test_quaternions_scalar_last_are_named",
    "test_columns_in_another_order_are_put_right",
    "test_a_log_of_another_model_is_refused_with_the_closest_names",
    "test_a_log_of_another_model_lists_names_once",
    "test_leaving_out_rows_acquits_nobody",
    "test_the_table_adds_up",
    "test_a_run_in_which_nothing_moves",
    "test_single_precision_logs_are_not_accused",
    "test_a_free_body_is_judged_by_its_kinetic_energy",
)

# --- logs that cannot be judged -------------------------------------------------------------------


def test_a_decimated_log_is_not_accused() -> None:
    run = of_rows_alone(arm_run())
    found = audit(model_of(ARM), run.every(30))  # 500 Hz to 17 Hz
    # Splines of its forces happen to tell the motion between the rows, but not their works.
    assert found.verdict.kind in ("consistent", "unresolved"), found.verdict.explain()
    assert found.verdict.confidence != "high"
    assert any(f.kind == "work-unresolved" for f in found.findings)
    assert not [f for f in found.findings if f.weight != "note"]
    # With every step the bar is below the tolerance.
    assert audit(model_of(ARM), run).verdict.kind == "consistent"


@pytest.mark.parametrize("n", repeated((5, 10, 20, 40), 10, 40))
def test_contacts_between_the_rows_are_not_accused(n: int) -> None:
    """1000 Hz to as little as 25 Hz: the integrator is blamed as with every row, or nobody."""
    run = of_rows_alone(hopper_run())
    found, whole = (audit(model_of(HOPPER), run.every(k)) for k in (n, 1))
    assert found.verdict.kind in ("unresolved", whole.verdict.kind), found.verdict.explain()
    if found.verdict.kind == whole.verdict.kind:
        assert found.attribution is not None and whole.attribution is not None
        told = found.attribution.integrator.largest
        true = whole.attribution.integrator.largest
        assert abs(told[0] - true[0]) <= max(3.0 * told[1], 0.1 * true[0])


def test_forces_held_over_a_step_are_not_held_from_row_to_row() -> None:
    """What interpolation leaves is then the lag of the hold, h/2, whatever rows are left out."""
    run = of_rows_alone(arm_run())
    each = [np.abs(audit(model_of(ARM), run.every(n)).energy_error).max() for n in (2, 5, 10)]
    np.testing.assert_allclose(each, each[0], rtol=0.02)
    found = audit(model_of(ARM), run.every(5), tolerance=1e-4)
    assert found.verdict.kind in ("unresolved", "consistent"), found.verdict.explain()


def test_leaving_out_rows_acquits_nobody() -> None:
    whole, half = (audit(model_of(ARM), arm_run("euler").every(n)) for n in (1, 2))
    assert [whole.verdict.kind, half.verdict.kind] == ["integration-error"] * 2


def test_a_decimated_log_of_a_wrong_model_still_is() -> None:
    found = audit(with_changes(ARM, gravity=9.6), arm_run().every(20))
    assert the_cause(found, "gravity").factor == pytest.approx(9.81 / 9.6, rel=1e-9)


def test_degrees_are_named() -> None:
    found = audit(model_of(ARM), replace(arm_run(), q=np.degrees(arm_run().q)))
    assert found.verdict.kind == "unresolved"
    assert {f.kind for f in found.findings if f.weight == "doubt"} == {"degrees"}
    assert not causes(found)


@pytest.mark.slow  # of a pendulum: tests/diagnosis/test_judgement.py
def test_degrees_in_all_columns_are_named() -> None:
    """Coordinates and speeds then agree with each other: only the equations tell."""
    run = arm_run().between(0.0, 0.4)
    turned = replace(run, q=np.degrees(run.q), u=np.degrees(run.u), udot=np.degrees(run.udot))  # type: ignore[arg-type]
    found = audit(model_of(ARM), turned)
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    assert {f.kind for f in found.findings if f.weight == "doubt"} == {"degrees"}
    assert not causes(found)


def test_quaternions_scalar_last_are_named() -> None:
    q = np.array(box_run().q)
    q[:, 3:] = box_run().q[:, [4, 5, 6, 3]]
    found = audit(model_of(BOX), replace(box_run(), q=q))
    assert found.verdict.kind == "unresolved"
    assert [f.kind for f in found.findings if f.weight == "doubt"] == ["quaternion-order"]
    assert not causes(found)


@pytest.mark.parametrize("what", ["forces", "accelerations", "forces and accelerations"])
def test_values_one_row_old_are_named(what: str) -> None:
    def late(x: np.ndarray) -> np.ndarray:
        return np.vstack([x[:1], x[:-1]])

    run = arm_run()
    assert run.udot is not None
    if "forces" in what:
        run = replace(run, forces={n: late(f) for n, f in run.forces.items()})
    if "accelerations" in what:
        run = replace(run, udot=late(arm_run().udot))  # type: ignore[arg-type]
    found = audit(model_of(ARM), run)
    assert found.verdict.kind == "unresolved"
    doubts = [f for f in found.findings if f.weight == "doubt"]
    assert [f.kind for f in doubts] == ["stale-stage"]
    assert f"the log's {what} are one row old" in doubts[0].what


def test_without_accelerations_a_mistake_is_seen_and_placed() -> None:
    """By the one-step test, which needs none."""
    wrong = scaled(replace(arm_run(), udot=None), "actuator m1", 1.1)
    found = audit(model_of(ARM), wrong)
    assert found.verdict.kind == "equation-error"
    assert the_cause(found, "actuator-gear").factor == pytest.approx(1 / 1.1, rel=1e-3)
    assert found.ledger.basis["u̇"] == "derived"
    right = audit(model_of(ARM), replace(arm_run(), udot=None))
    assert right.verdict.kind == "consistent" and not right.causes


def test_a_run_in_which_nothing_moves() -> None:
    still = dc.problems.load("simple-pendulum")
    state = still.mechanism.state()
    run = dc.simulate(still.mechanism, state, duration=0.1, step=1e-2, solver="ode4")
    found = audit(still, run)
    assert found.verdict.kind == "unresolved"
    assert found.odds["unresolved"] == 1.0


def test_missing_rows_are_named_not_accused() -> None:
    found = audit(model_of(ARM), cut(of_rows_alone(arm_run()), 300, 600))
    assert (found.verdict.kind, found.exit_code) == ("unresolved", 3), found.verdict.explain()
    (gap,) = (f for f in found.findings if f.code == "F-GAP")
    assert "0.602 s after row 299" in gap.evidence


def test_missing_rows_excuse_nothing() -> None:
    run = dc.run_mujoco(model_of(ARM), 2.0, step=0.01, integrator="euler")
    found = audit(model_of(ARM), cut(run, 150, 180))
    assert found.verdict.kind == "integration-error", found.verdict.explain()
    wrong = audit(with_changes(ARM, gravity=9.6), cut(arm_run(), 300, 600))
    assert the_cause(wrong, "gravity").factor == pytest.approx(9.81 / 9.6, rel=1e-9)


def test_a_free_body_is_judged_by_its_kinetic_energy() -> None:
    """Nothing flows in or out: what is exchanged is the integrator's error itself."""
    model = with_changes(BOX, gravity=0.0)
    data = mujoco.MjData(model)
    data.qvel[:] = [1, 0, 3, 0.1, 4, 0.2]
    found = audit(model, dc.run_mujoco(model, 1.0, data=data, step=0.005))
    assert (found.verdict.kind, found.exit_code) == ("consistent", 0), found.verdict.explain()
    assert found.reference_energy == pytest.approx(float(found.ledger.kinetic.max()), rel=1e-6)
    coarse = audit(model, dc.run_mujoco(model, 2.0, data=data, step=0.05, integrator="euler"))
    assert coarse.verdict.kind == "integration-error", coarse.verdict.explain()


# --- names, precision, tables ---------------------------------------------------------------------


def test_columns_in_another_order_are_put_right() -> None:
    run = box_run()
    turned = replace(
        run,
        q=run.q[:, ::-1],
        u=run.u[:, ::-1],
        udot=np.asarray(run.udot)[:, ::-1],
        coordinates=run.coordinates[::-1],
        speeds=run.speeds[::-1],
    )
    found = audit(model_of(BOX), turned)
    assert [f.kind for f in found.findings] == ["order"]
    np.testing.assert_array_equal(found.energy_error, audit(model_of(BOX), run).energy_error)


def test_a_log_of_another_model_is_refused_with_the_closest_names() -> None:
    run = replace(arm_run(), coordinates=("sholder", "elbow"), speeds=("sholder", "elbow"))
    with pytest.raises(dc.InputError, match=r"'sholder'; did you mean 'shoulder'\?"):
        audit(model_of(ARM), run)


def test_a_log_of_another_model_lists_names_once() -> None:
    run = replace(arm_run(), coordinates=("x1", "x2"), speeds=("x1", "x2"))
    with pytest.raises(dc.InputError) as told:
        audit(model_of(ARM), run)
    assert str(told.value).count("shoulder") == 1
    assert "in the log only: 'x1', 'x2'. in the model only: 'shoulder', 'elbow'" in str(told.value)


@pytest.mark.parametrize("decimals", repeated((5, 8), 5))
def test_rounded_logs_are_not_accused(decimals: int) -> None:
    """A log in text with few digits does not close its equations better than they allow."""
    run = arm_run()
    assert run.udot is not None
    rounded = replace(
        run,
        q=run.q.round(decimals),
        u=run.u.round(decimals),
        udot=run.udot.round(decimals),
        forces={n: f.round(decimals) for n, f in run.forces.items()},
    )
    assert not causes(audit(model_of(ARM), rounded))
    # The same digits do not hide two percent.
    wrong = audit(with_changes(ARM, body_mass=1.02, body_inertia=1.02), rounded)
    cause = the_cause(wrong, "mass-scale")
    assert cause.factor == pytest.approx(1.0 / 1.02, rel=1e-2 if decimals == 5 else 1e-4)


def test_single_precision_logs_are_not_accused() -> None:
    run = arm_run()
    assert run.udot is not None

    def single(x: np.ndarray) -> np.ndarray:
        return x.astype(np.float32).astype(np.float64)

    low = replace(
        run,
        q=single(run.q),
        u=single(run.u),
        udot=single(run.udot),
        forces={n: single(f) for n, f in run.forces.items()},
    )
    assert audit(model_of(ARM), low).verdict.kind == "consistent"


def test_the_table_adds_up() -> None:
    found = audit(model_of(ARM), arm_run())
    rows = {row.name: row for row in found.rows()}
    # Q is what flowed in through channels that are not potentials: summed here from the table itself.
    flowed = sum(
        row.energy for name, row in rows.items() if name.startswith(("actuator", "damper"))
    )
    assert rows["Q"].energy == pytest.approx(flowed, abs=1e-12)
    total = rows["ΔK"].energy + rows["ΔV"].energy - rows["Q"].energy
    assert rows["ΔC = ΔK + ΔV − Q"].energy == pytest.approx(total, abs=1e-12)
    assert rows["damper elbow"].basis == "measured"
    assert rows["gravity"].basis == "computed"


def test_channels_that_the_log_lacks_are_assumed_zero() -> None:
    found = audit(model_of(ARM), without(arm_run(), "actuator m2"))
    assert found.ledger.basis["actuator m2"] == "assumed zero"
    told = next(f for f in found.findings if f.kind == "assumed-zero")
    assert ("1 channel of" in told.what, told.element) == (True, "actuator m2")
    assert found.verdict.kind == "unresolved"  # it may be what is missing


def test_what_the_recorder_saw_not_acting_is_no_news() -> None:
    def assumed(run: Trajectory) -> list[str]:
        basis = audit(model_of(HOPPER), run, time_limit=1e-3).ledger.basis
        return [name for name, origin in basis.items() if origin == "assumed zero"]

    flight = hopper_run().between(0.0, 0.1)
    unacted = {n: f for n, f in flight.forces.items() if not n.startswith("contact")}
    recorded = replace(flight, forces=unacted, provenance=replace(flight.provenance, acted=()))
    assert assumed(recorded) == []
    assert assumed(replace(recorded, provenance=dc.Provenance("somebody"))) == ["contact all"]
    assert assumed(without(hopper_run(), "contact")) == ["contact all"]  # these acted
    floating = dc.run_mujoco(model_of(HOPPER), 0.05)
    assert floating.provenance.looked_for and assumed(floating) == []


NOISE = np.random.default_rng(1)
FORMS = {
    "as it is": lambda x, deviation: x,
    "half precision": lambda x, deviation: x.astype(np.float16).astype(float),
    "noisy": lambda x, deviation: x + deviation * NOISE.standard_normal(x.shape),
}


@pytest.mark.parametrize(
    ("form", "motion"), crossed(FORMS, [("bouncing-ball", 1e-2), ("struck-slider-crank", 5e-3)])
)
def test_impacts_that_the_log_does_not_tell_of_accuse_nobody(
    motion: tuple[str, float], form: str
) -> None:
    """The model has them, and the rows show them: those of its law lead from row to row."""
    name, step = motion
    problem = dc.problems.load(name)
    run = dc.simulate(problem.mechanism, problem.state, 2.0, step, "ode4")
    q, u = FORMS[form](run.q, 1e-5), FORMS[form](run.u, 1e-3)
    log = dc.Trajectory(t=run.t, q=q, u=u, coordinates=run.coordinates, speeds=run.speeds)
    found = audit(problem, log)
    assert found.verdict.kind == "consistent", found.verdict.explain()
    assert "F-IMPACTS-BY-LAW" in {f.code for f in found.findings}


LIMITED = """<robot name="pendulum"><link name="ground"/>
<link name="arm"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
  <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="revolute"><parent link="ground"/><child link="arm"/><axis xyz="0 1 0"/>
  <limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>"""


def test_a_urdf_file_tells_of_no_simulator(tmp_path: Path) -> None:
    """A log of another program than MuJoCo: that this does not reproduce it says nothing."""
    (tmp_path / "pendulum.urdf").write_text(LIMITED)
    h, q, u, rows = 0.01, 1.2, 0.0, []
    for k in range(400):
        rows.append([k * h, q, u])
        u -= h * 9.81 * 0.5 * np.sin(q) / 0.27  # the semi-implicit Euler method
        q += h * u
    t, q_, u_ = np.array(rows).T
    found = audit(tmp_path / "pendulum.urdf", {"t": t, "q.pivot": q_, "u.pivot": u_})
    assert found.verdict.kind == "integration-error"
    assert found.integrator is not None and found.attribution is not None
    assert "semi-implicit-euler" in found.integrator.names
    energy = 0.5 * 0.27 * u_**2 - 9.81 * 0.5 * np.cos(q_)
    assert found.attribution.integrator.energy == pytest.approx(energy[-1] - energy[0], rel=1e-4)
