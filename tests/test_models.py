"""What a user may call a model."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.models import Model, load_model

PENDULUM = """
import deltac as dc
from lengths import LENGTH

def pendulum():
    return dc.problems.load("simple-pendulum")

def mechanism():
    return pendulum().mechanism

def nothing():
    return LENGTH

def broken():
    return 1 / 0

def pair():
    machine = mechanism()
    return machine, machine.state({machine.coordinates[0].name: 0.25})

def itself():
    return __file__ + ":itself"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "lengths.py").write_text("LENGTH = 2.0\n")
    path = tmp_path / "machine.py"
    path.write_text(PENDULUM)
    return path


def test_functions_of_a_file(file: Path) -> None:
    assert load_model(f"{file}:pendulum").problem is not None
    assert (
        load_model(f"{file}:mechanism").mechanism.hash
        == load_model("simple-pendulum").mechanism.hash
    )


@pytest.mark.parametrize(
    "text",
    [
        "import deltac as dc\narm = dc.problems.load('simple-pendulum').mechanism\n",
        "import deltac as dc\ndef arm(length=1.0):\n    return dc.problems.load('simple-pendulum')\n",
    ],
)
def test_the_one_model_of_a_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "machine.py"
    path.write_text(text)
    expected = load_model("simple-pendulum").mechanism.hash
    for source in (str(path), f"{path}:arm"):
        assert load_model(source).mechanism.hash == expected
    path.write_text(text + "leg = arm\n")
    assert load_model(str(path)).mechanism.hash == expected  # another name of the same


def test_objects() -> None:
    problem = dc.problems.load("simple-pendulum")
    assert load_model(problem).problem is problem
    assert load_model(problem.mechanism).mechanism is problem.mechanism


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (":pendulm", "did you mean 'pendulum'"),
        (":nothing", "is float: model: found float; expected a Mechanism, a Problem"),
        (":broken", "line 15: ZeroDivisionError"),
        ("", "machine.py:pendulum"),
    ],
)
def test_functions_that_do_not_serve(file: Path, name: str, said: str) -> None:
    with pytest.raises(dc.InputError, match="machine.py") as error:
        load_model(f"{file}{name}")
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("simple-pendulm", "did you mean 'simple-pendulum'"),
        ("no/such.xml", "no such file"),
        ("no/such.py:f", "no such file"),
    ],
)
def test_names_of_nothing(name: str, said: str) -> None:
    with pytest.raises(dc.InputError, match=said):
        load_model(name)


def test_a_file_that_does_not_run(tmp_path: Path) -> None:
    path = tmp_path / "bad.py"
    path.write_text("import no_such_package_at_all\n")
    with pytest.raises(dc.InputError, match="bad.py cannot be run, line 1: ModuleNotFoundError"):
        load_model(f"{path}:f")


@pytest.mark.parametrize("text", ["import sys; sys.exit(3)", "def make(): raise SystemExit('no')"])
def test_a_file_that_wants_to_exit(tmp_path: Path, text: str) -> None:
    (tmp_path / "quits.py").write_text(text)
    with pytest.raises(dc.InputError, match="quits.py.*line 1: SystemExit"):
        load_model(f"{tmp_path / 'quits.py'}:make")


ARM = """<mujoco model="arm"><worldbody><body><joint name="hip" axis="0 1 0" ref="10"/>
<geom size=".1" pos="0 0 -1"/><body pos="0 0 -1"><joint name="knee" axis="0 1 0"/>
<geom size=".1" pos="0 0 -1"/></body></body></worldbody>{keys}</mujoco>"""
KEYS = """<keyframe><key name="bent" qpos=".3 -.6" qvel="0 2" time="1.5"/><key qpos="1 1"/></keyframe>"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(keys=KEYS))
    return path


def test_a_pair_of_a_file_has_a_start(file: Path) -> None:
    assert load_model(f"{file}:pair").start().q.tolist() == [0.25]


def test_a_function_that_names_itself_is_refused(file: Path) -> None:
    with pytest.raises(dc.InputError, match="name that function itself"):
        load_model(f"{file}:itself")


def test_the_first_keyframe_is_the_start(arm: Path, tmp_path: Path) -> None:
    """MuJoCo's own numbers: its compiled key, and qpos0 = ref (10 degrees) where there is none."""
    loaded = load_model(arm)
    start = loaded.start()
    assert (start.t, start.q.tolist(), start.u.tolist()) == (1.5, [0.3, -0.6], [0.0, 2.0])
    assert loaded.start("key1").q.tolist() == [1.0, 1.0]
    plain = tmp_path / "plain.xml"
    plain.write_text(ARM.format(keys=""))
    assert load_model(plain).start().q.tolist() == pytest.approx([math.radians(10.0), 0.0])


def test_states_by_name(arm: Path) -> None:
    told = load_model(arm).start("hip=30deg, u.knee=-1, t=2, q.knee=0.5")
    assert told.q.tolist() == pytest.approx([math.pi / 6, 0.5])
    assert (told.t, told.u.tolist()) == (2.0, [0.0, -1.0])
    assert load_model(arm).start({"knee": 0.5}).q.tolist() == [0.0, 0.5]


def test_states_of_files(arm: Path, tmp_path: Path) -> None:
    model = load_model(arm)
    (tmp_path / "s.json").write_text('{"t": 1, "q": {"hip": 0.5}, "u": [1, 2]}')
    (tmp_path / "s.toml").write_text("q = [0.1, 0.2]\n[u]\nknee = 3\n")
    one, two = model.start(tmp_path / "s.json"), model.start(str(tmp_path / "s.toml"))
    assert (one.t, one.q.tolist(), one.u.tolist()) == (1.0, [0.5, 0.0], [1.0, 2.0])
    assert (two.q.tolist(), two.u.tolist()) == ([0.1, 0.2], [0.0, 3.0])
    (tmp_path / "log.csv").write_text(
        "time,q.hip,q.knee,u.hip,u.knee\n0.5,0.1,0.2,0.3,0.4\n1,0,0,0,0\n"
    )
    row = model.start(tmp_path / "log.csv")
    assert (row.t, row.q.tolist(), row.u.tolist()) == (0.5, [0.1, 0.2], [0.3, 0.4])


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ("pivot=1,q.pivot=2", "given twice"),
        (None, "does not say where its motion starts"),
        ("hip:0.3", "expected name=value"),
        ("pivot=fast", "such as hip=0.3"),
        ("pivt=1", "did you mean 'pivot'"),
        ({"pivt": 1.0}, "did you mean 'pivot'"),
        ([0.1], "expected a State"),
        ("no.json", "no such file"),
        (dc.problems.load("double-pendulum").state, "has 2 coordinates and 2 speeds"),
    ],
)
def test_states_that_are_none(state: Any, said: str) -> None:
    model = Model(load_model("simple-pendulum").mechanism, {})
    pivot = model.mechanism.coordinates[0].name
    if isinstance(state, str):
        state = state.replace("pivot", pivot)
    with pytest.raises(dc.InputError) as error:
        model.start(state)
    assert said.replace("pivot", pivot) in str(error.value)


def _verbs() -> dict[str, Callable[[Any], object]]:
    """Every verb that takes a model, with all else as it should be."""
    problem = dc.problems.load("simple-pendulum")
    run = dc.simulate(problem, duration=0.4, step=0.01)
    rhs = lambda t, q, u: u  # noqa: E731
    return {
        "simulate": lambda m: dc.simulate(m, problem.state, 0.1, 0.01),
        "simulate_ensemble": lambda m: dc.simulate_ensemble(m, problem.state, 0.1, 0.01),
        "balance": lambda m: dc.balance(m, run),
        "residuals": lambda m: dc.residuals(m, run),
        "audit": lambda m: dc.audit(m, run),
        "explain_residual": lambda m: dc.explain_residual(m, run),
        "study": lambda m: dc.study(m, problem.state, 0.1, (0.04, 0.02, 0.01)),
        "recommend": lambda m: dc.recommend(m, problem.state, 0.1, solvers=["ode4"]),
        "check_equations": lambda m: dc.check_equations(m, rhs, count=4),
        "repair_equations": lambda m: dc.repair_equations(m, rhs),
        "mutate_equations": lambda m: dc.mutate_equations(m, rhs),
        "localise": lambda m: dc.localise(m, run),
        "assemble": lambda m: dc.assemble(m, problem.state),
        "time_scales": lambda m: dc.time_scales(m, problem.state),
        "random_states": lambda m: dc.random_states(m, count=2),
        "symbolic_equations": lambda m: dc.symbolic_equations(m, simplify=False),
    }


VERBS = _verbs()


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("given", [3.0, None, dict, "simple-pendulm", [1, 2]])
def test_every_door_says_what_it_takes(verb: str, given: Any) -> None:
    with pytest.raises(dc.InputError) as error:
        VERBS[verb](given)
    assert "a Mechanism, a Problem, the name of a problem" in str(error.value)


SAME = {"repair_equations", "mutate_equations", "check_equations"}  # these want real equations


@pytest.mark.parametrize("verb", sorted(VERBS.keys() - SAME))
def test_every_door_takes_a_problem_by_its_name_and_by_a_file(verb: str, file: Path) -> None:
    VERBS[verb]("simple-pendulum")
    VERBS[verb](f"{file}:mechanism")


def test_a_problem_needs_neither_state_nor_duration() -> None:
    problem = dc.problems.load("simple-pendulum")
    run = dc.simulate("simple-pendulum", step=problem.step, solver=problem.solver)
    assert run.t[-1] == pytest.approx(problem.duration)
    np.testing.assert_array_equal(run.q[0], problem.state.q)


def test_a_log_in_the_place_of_a_model() -> None:
    with pytest.raises(dc.InputError, match="the model comes first, then the log"):
        dc.audit("run.parquet", "simple-pendulum")
