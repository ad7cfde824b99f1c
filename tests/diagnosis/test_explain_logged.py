"""What a log's forces hide: they close the equations, so it must be said that the model has others."""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import pytest

import deltac as dc

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from tests.systems.mujoco_models import ARM, arm_run, model_of, with_changes  # noqa: E402


@cache
def rubbed_run() -> dc.Trajectory:
    """A log with dry friction of 0.02 N·m at the elbow, in the channel `friction elbow`."""
    model = copy.copy(model_of(ARM))
    model.dof_frictionloss[1] = 0.02
    data = mujoco.MjData(model)
    data.qvel[:] = [2.0, -3.0]
    return dc.run_mujoco(model, 1.0, data=data, integrator="rk4")


def work(run: dc.Trajectory, channel: str) -> float:
    """∫ u·f dt by Simpson's rule."""
    from scipy.integrate import simpson

    return float(simpson(np.sum(run.u * run.forces[channel], axis=1), x=run.t))


@pytest.mark.long
def test_friction_that_only_the_log_has_is_noted_with_its_work() -> None:
    run = rubbed_run()
    done = work(run, "friction elbow")
    assert done < -1e-3
    found = dc.audit(model_of(ARM), run)
    assert found.verdict.kind == "consistent"
    (note,) = (f for f in found.findings if f.kind == "channel-not-in-model")
    assert (note.weight, note.element) == ("note", "friction elbow")
    assert f"did {done:.2g}" in note.what  # Simpson and trapezoids agree to a hundredth
    told = dc.explain_residual(model_of(ARM), run)
    assert told.kind == "nothing"
    assert "'friction elbow' that the model does not have" in str(told)
    assert told.notes[0] in told.to_dict()["notes"]


def test_nothing_is_noted_of_what_the_models_file_has() -> None:
    model = copy.copy(model_of(ARM))
    model.dof_frictionloss[1] = 0.02
    assert dc.explain_residual(model, rubbed_run()).notes == ()
    kinds = {f.kind for f in dc.audit(model, rubbed_run()).findings}
    assert "channel-not-in-model" not in kinds
    assert dc.explain_residual(model_of(ARM), arm_run()).notes == ()


def test_another_gear_is_the_same_cause_to_audit_and_explanation() -> None:
    """The logged force is what acted: the equations close, and only the strengths tell."""
    model = with_changes(ARM, actuator_gear=[2.0, 1.0])
    audited, told = dc.audit(model, arm_run()), dc.explain_residual(model, arm_run())
    assert audited.verdict.kind == "equation-error"
    assert told.kind == "explained"
    (cause,) = told.causes
    assert (cause.kind, cause.element, cause.values) == ("actuator-gear", "actuator m1", (0.5,))
    assert cause.sentence in [f.what for f in audited.findings]
    assert "With the forces as logged, the equations hold" in str(told)


@pytest.mark.long
def test_another_gear_beside_another_cause() -> None:
    model = with_changes(ARM, actuator_gear=[2.0, 1.0], body_mass=[1, 1, 1 / 1.02])
    causes = {
        (c.kind, c.element): c.values[0] for c in dc.explain_residual(model, arm_run()).causes
    }
    planted: dict[Any, float] = {
        ("body-mass", "lower"): 1.02,
        ("actuator-gear", "actuator m1"): 0.5,
    }
    assert causes == pytest.approx(planted, rel=1e-6)


@pytest.mark.long
def test_an_explanation_says_itself_in_full() -> None:
    found = dc.explain_residual(with_changes(ARM, body_mass=[1, 1, 1 / 1.02]), rubbed_run())
    said = found.explain()
    assert said.startswith("explained. ")
    assert "Note: the log has a channel 'friction elbow'" in said
    assert found.table() in said


def test_an_arm_whose_torques_are_all_logged_is_noted_once() -> None:
    driven = dc.Mechanism(
        bodies=[dc.rod(f"bar{k}", 1.0, 0.5, along="-y") for k in range(3)],
        joints=[
            dc.revolute(
                f"j{k}",
                f"bar{k - 1}" if k else "ground",
                f"bar{k}",
                axis="z",
                position=(0.0, -0.5 if k else 0.0, 0.0),
            )
            for k in range(3)
        ],
        forces=[
            dc.forces.joint_torque(f"m{k}", f"j{k}", f"{k + 1}*sin({k + 2}*t)") for k in range(3)
        ],
        gravity=(0.0, -9.81, 0.0),
    )
    run = dc.simulate(driven, driven.state({"j0": 0.3}), 2.0, step=0.005)
    bare = dc.Mechanism(driven.bodies, driven.joints, gravity=driven.gravity)
    torques = np.sin(run.t[:, None] * [2.0, 3.0, 4.0]) * [1.0, 2.0, 3.0]
    forces = {f"actuator m{k}": torques * (np.arange(3) == k) for k in range(3)}
    names: dict[str, Any] = {"coordinates": run.coordinates, "speeds": run.speeds}
    logged = dc.Trajectory(t=run.t, q=run.q, u=run.u, forces=forces, **names)
    found = dc.audit(bare, logged)
    assert found.verdict.kind == "consistent"
    (note,) = (f for f in found.findings if f.kind == "channel-not-in-model")
    assert set(note.element.split(", ")) == set(forces)
    total = sum(work(logged, name) for name in forces)
    assert float(note.what.split(" did ")[1].split(" J")[0]) == pytest.approx(total, rel=0.01)
