"""examine: each part answers as it does by itself, and the worst of them is the outcome."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import deltac as dc
from tests.support.slow import repeated


def right(t: float, q: Any, u: Any) -> Any:
    return np.array([-9.81 * np.sin(q[0])])


def wrong(t: float, q: Any, u: Any) -> Any:
    return np.array([9.81 * np.sin(q[0])])


def test_right_equations_can_be_trusted_and_wrong_ones_cannot() -> None:
    told: list[float] = []
    found = dc.examine(
        "simple-pendulum",
        duration=1.0,
        equations=right,
        progress=told.append,
    )
    assert found.exit_code == 0
    assert set(found.results) == {"check", "recommend", "study"}
    assert told == sorted(told) and told[-1] <= 1.0
    found = dc.examine("simple-pendulum", duration=1.0, equations=wrong)
    assert found.exit_code == 1
    assert found.check is not None and found.check.verdict.kind == "equation-error"
    assert found.study is not None and found.study.verdict.kind == "equation-error"
    assert "F-COORDINATE-RESIDUAL" in {f.code for f in found.findings}
    json.dumps(found.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    "name",
    repeated(
        ["elastic-pendulum", "bead-on-hoop", "andrews-squeezer", "chaplygin-sleigh"], "bead-on-hoop"
    ),
)
def test_published_problems_can_be_trusted(name: str) -> None:
    problem = dc.problems.load(name)
    found = dc.examine(problem, duration=min(problem.duration, 1.0), tolerance=1e-5)
    assert found.exit_code == 0, found.explain()
    assert found.recommendation is not None and found.recommendation.verified


def test_a_log_alone_is_audited(tmp_path: Any) -> None:
    problem = dc.problems.load("simple-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, 1.0, 1e-3, "ode4")
    run.write(tmp_path / "run.csv")
    found = dc.examine(problem.mechanism, log=tmp_path / "run.csv")
    assert set(found.results) == {"audit"}
    assert found.exit_code == 0 and found.skipped
    coarse = dc.simulate(problem.mechanism, problem.state, 1.0, 1e-2, "ode1")
    assert dc.examine(problem.mechanism, log=coarse).exit_code == 1


def test_a_model_of_which_a_part_is_not_simulated_is_not_trusted() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
      <body pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size=".02"/></body></worldbody>
     <actuator><motor name="drive" joint="hinge"/></actuator></mujoco>""")
    found = dc.examine(model, duration=0.5)
    assert found.exit_code == 3
    assert {f.element for f in found.missing} >= {"drive"}


def test_nothing_to_examine_says_what_to_give() -> None:
    mechanism = dc.problems.load("simple-pendulum").mechanism
    with pytest.raises(dc.InputError, match="duration=") as error:
        dc.examine(mechanism)
    assert error.value.code.startswith("E-")
