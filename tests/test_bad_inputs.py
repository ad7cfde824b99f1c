"""Sixty slips of users: each is an InputError of its kind, never a raw exception, never a wrong answer."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.trajectories import draft_mapping, read_mapping

T = np.linspace(0.0, 0.2, 21)


def bob(*joint: Any, **mechanism: Any) -> dc.Mechanism:
    hinge = joint[0] if joint else dc.revolute("hinge", "ground", "bob")
    return dc.Mechanism([dc.point_mass("bob", 1.0, at=(0, -1, 0))], [hinge], **mechanism)


M = bob(gravity=(0, -9.81, 0))
S = M.state({"hinge": 0.5})
TWO = dc.State(0.0, np.zeros(2), np.zeros(2))
MISNAMED = dc.Equations(lambda t, y: y, order=("hinge", "u.hing"))


def run(**changed: Any) -> dc.Trajectory:
    given: dict[str, Any] = {
        "t": T,
        "q": 0.1 * np.cos(3 * T)[:, None],
        "u": -0.3 * np.sin(3 * T)[:, None],
        "coordinates": ("hinge",),
        "speeds": ("hinge",),
    }
    return dc.Trajectory(**{**given, **changed})


def _at(verb: str, value: float) -> Any:
    return getattr(dc, verb)(M, dc.State(0.0, np.array([value]), np.zeros(1)))


PYTHON: dict[str, tuple[str, Callable[[], Any]]] = {
    # states that were not made by the mechanism
    **{
        f"{verb} at {value}": (
            "E-STATE",
            partial(_at, verb, value),
        )
        for verb in ("evaluate", "matrices", "linearise", "equilibrium", "assemble")
        for value in (np.nan, np.inf)
    },
    # descriptions
    "pos for position": ("E-NAME", lambda: dc.revolute("h", "ground", "b", pos=(0, 0, 0))),  # type: ignore
    "centre": ("E-NAME", lambda: dc.body("b", mass=1.0, inertia=(1, 1, 1), centre=(0, 0, 0))),  # type: ignore
    "position of a particle": ("E-NAME", lambda: dc.point_mass("b", 1.0, position=(0, 0, 0))),  # type: ignore
    "grav": ("E-NAME", lambda: bob(grav=(0, 0, 0))),
    "stifness": ("E-NAME", lambda: dc.forces.joint_spring("s", "h", stifness=1.0)),  # type: ignore
    "unknown body": ("E-NAME", lambda: bob(dc.revolute("h", "ground", "bib"))),
    "unknown axis": ("E-NAME", lambda: dc.revolute("h", "ground", "b", "w")),
    "axis of length zero": ("E-MODEL", lambda: dc.revolute("h", "ground", "b", (0, 0, 0))),
    "unknown function": ("E-MODEL", lambda: dc.revolute("h", "ground", "b", motion="sinn(t)")),
    "negative mass": ("E-MODEL", lambda: dc.point_mass("b", -1.0)),
    # states
    "misspelt coordinate": ("E-NAME", lambda: dc.simulate(M, {"hing": 0.3}, 0.1, 0.01)),
    "list as a state": ("E-TYPE", lambda: dc.simulate(M, [0.3, 0.1], 0.1, 0.01)),  # type: ignore
    "state not finite": ("E-STATE", lambda: M.state({"hinge": float("nan")})),
    "state of another": ("E-STATE", lambda: dc.simulate(M, TWO, 1.0, 0.1)),
    "text as a state": ("E-VALUE", lambda: dc.simulate(M, "hinge", 0.1, 0.01)),
    "number in a text": ("E-VALUE", lambda: dc.simulate(M, "hinge=a", 0.1, 0.01)),
    # runs
    "trillion steps": ("E-LIMIT", lambda: dc.simulate(M, S, 1e6, 1e-6)),
    "negative duration": ("E-VALUE", lambda: dc.simulate(M, S, -1, 0.01)),
    "no duration": ("E-ARGUMENTS", lambda: dc.simulate(M, S)),
    "step of zero": ("E-VALUE", lambda: dc.simulate(M, S, 1, 0)),
    "no step": ("E-SOLVER", lambda: dc.simulate(M, S, 1.0)),
    "step that does not divide": ("E-SOLVER", lambda: dc.simulate(M, S, 1.0, 0.3)),
    "ode45": ("E-NAME", lambda: dc.simulate(M, S, 0.1, 0.01, "ode45")),
    "ode6": ("E-NAME", lambda: dc.simulate(M, S, 0.1, 0.01, "ode6")),
    "record as text": ("E-VALUE", lambda: dc.simulate(M, S, 0.1, 0.01, record="wang")),  # type: ignore
    "unknown testing function": ("E-NAME", lambda: dc.simulate(M, S, 0.1, 0.01, record=("wong",))),
    "equal steps": ("E-VALUE", lambda: dc.study(M, S, 0.2, steps=(0.01, 0.01, 0.01))),
    "logs and steps": ("E-ARGUMENTS", lambda: dc.study(M, runs=[run(), run()], steps=(0.1, 0.05))),
    "h for step": ("E-NAME", lambda: dc.simulate(M, S, 0.1, h=0.01)),  # type: ignore
    "solvers of a study": ("E-NAME", lambda: dc.study(M, S, 0.2, solvers="ode4")),  # type: ignore
    "record of an ensemble": ("E-NAME", lambda: dc.simulate_ensemble(M, [S], 0.1, 0.01, recrd=())),  # type: ignore
    "solver twice": ("E-TYPE", lambda: dc.simulate(M, S, 0.1, 0.01, "ode4", solver="ode4")),  # type: ignore
    "solver of letters": ("E-NAME", lambda: dc.recommend(M, S, 0.2, solvers="odee4")),
    "option of a sweep": ("E-NAME", lambda: dc.sweep(M, stepp=0.1)),
    # equations
    "scalar right-hand side": ("E-SOURCE", lambda: dc.check_equations(M, lambda t, q, u: 9.81)),
    "scalar in a run": ("E-SOURCE", lambda: dc.simulate(M, S, 0.1, 0.01, equations=lambda t, q, u: 9.81)),
    "scalar of (t, y)": ("E-SOURCE", lambda: dc.simulate(M, S, 0.1, 0.01, equations=lambda t, y: 9.81)),
    "no function": ("E-TYPE", lambda: dc.Equations(1)),  # type: ignore
    "unknown form": ("E-VALUE", lambda: dc.Equations(lambda t, y: y, form="pde")),
    "unknown order": ("E-NAME", lambda: dc.simulate(M, S, 0.1, 0.01, equations=MISNAMED)),
    # models
    "misspelt problem": ("E-NAME", lambda: dc.problems.load("triple-pendulm")),
    "list as a model": ("E-TYPE", lambda: dc.simulate([1, 2], S, 1, 0.01)),  # type: ignore
    "function as a model": ("E-TYPE", lambda: dc.simulate(bob, S, 1, 0.01)),  # type: ignore
    "missing model file": ("E-FILE", lambda: dc.audit("arm_that_is_not.xml", run())),
    "file without function": ("E-FILE", lambda: dc.load_model("model.py")),
    "xacro": ("E-MODEL", lambda: dc.load_model("arm.urdf.xacro")),
    "OpenSim's model": ("E-MODEL", lambda: dc.load_model("leg.osim")),
    # audits
    "log and model swapped": ("E-ARGUMENTS", lambda: dc.audit("run.csv", "arm.xml")),
    "run and model swapped": ("E-TYPE", lambda: dc.audit(run(), M)),  # type: ignore
    "number as a log": ("E-TYPE", lambda: dc.audit(M, 5)),  # type: ignore[arg-type]
    "missing log": ("E-FILE", lambda: dc.audit(M, "no.csv")),
    "tolerance of 5": ("E-VALUE", lambda: dc.audit(M, run(), tolerance=5)),
    "log of another model": ("E-LOG", lambda: dc.audit(M, run(coordinates=("knee",), speeds=("knee",)))),
    "misspelt channel": ("E-NAME", lambda: dc.balance(M, run()).work["gravty"]),
    "unknown parameter": ("E-NAME", lambda: bob(parameters={"mass": 1.0}).parameters["mas"]),
    "misspelt column": ("E-NAME", lambda: run().coordinate("hing")),
    "time that stands": ("E-LOG", lambda: run(t=np.zeros(21))),
    "row not finite": ("E-LOG", lambda: run(q=np.full((21, 1), np.nan))),
    "beyond physics": ("E-LOG", lambda: dc.audit(M, run(q=np.full((21, 1), 1e60)))),
    "replay of a run": ("E-ARGUMENTS", lambda: dc.audit(M, run(), replay=True)),
}  # fmt: skip


@pytest.mark.parametrize("slip", PYTHON)
def test_slips_in_python(slip: str) -> None:
    code, call = PYTHON[slip]
    with pytest.raises(dc.InputError) as refused:
        call()
    assert refused.value.code == code


FUNCTIONS = [n for n in dc.__all__ if inspect.isfunction(getattr(dc, n)) and n != "sweep"]
"""The public functions; those of a sweep are options of its plan."""


@pytest.mark.parametrize("name", [*FUNCTIONS, "Trajectory", "State", "Equations", "Monitor"])
def test_arguments_are_named(name: str) -> None:
    with pytest.raises(dc.InputError) as refused:
        getattr(dc, name)(no_such_argument=1)
    assert refused.value.code == "E-NAME"


def test_a_type_error_inside_stays_one() -> None:
    def broken(t: float, q: Any, u: Any) -> Any:
        return 1.0 + None  # type: ignore[operator]

    with pytest.raises(dc.InputError) as refused:
        dc.check_equations(M, broken)
    assert refused.value.code == "E-SOURCE"


def test_a_study_of_tolerances_speaks_of_tolerances() -> None:
    found = dc.study(M, S, 1.0, solver=dc.solvers.Scipy("RK45", tolerance=1e-5))
    assert found.knob == "tolerance"
    assert "steps" not in str(found)


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("run.pkl", b"\x80\x04N.", "E-FILE"),
        ("run.xlsx", b"PK", "E-FILE"),
        ("bag.db3", b"SQLite", "E-FILE"),
        ("run.npy", b"\x93NUMPY", "E-FILE"),
        ("run.cvs", b"time\n0\n", "E-NAME"),
        ("run.csv", b"", "E-FILE"),
        ("run.csv", b"time,q.hinge,u.hinge\n0,1,x\n1,2,3\n", "E-LOG"),
        ("run.csv", b"time,knee,ankle\n0,1,2\n1,2,3\n", "E-LOG"),
        ("run.json", b"[1, 2]", "E-LOG"),
        ("run.json", b"{", "E-FILE"),
        ("run.jsonl", b'{"t": 0}\n{"t": \n', "E-FILE"),
        ("run.mcap", b"no magic", "E-FILE"),
        ("run.npz", b"PK", "E-FILE"),
    ],
)
def test_slips_in_files(name: str, content: bytes, code: str, tmp_path: Path) -> None:
    if name.endswith(".mcap"):
        pytest.importorskip("mcap_ros2", reason="deltac[ros] is not installed")
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(dc.InputError) as refused:
        dc.audit(M, path)
    assert refused.value.code == code


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('[coordinates]\nhinge = "hing"\n', "line 2"),
        ('[coordinate]\nhinge = "a"\n', "line 1"),
        ('[log]\ntime = { step = -1 }\n', "line 2"),
        ('[speeds]\nhinge = { step = 0.1 }\n', "line 2"),
        ('[log]\ntime = { step = 0.1, column = "t" }\n', "line 2"),
    ],
)  # fmt: skip
def test_slips_in_mappings_name_the_line(text: str, where: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(text)
    (tmp_path / "run.json").write_text(json.dumps({"t": T.tolist(), "a": T.tolist()}))
    with pytest.raises(dc.InputError, match=where):
        dc.audit(M, tmp_path / "run.json", mapping=tmp_path / "map.toml")


def test_a_log_of_deltac_needs_no_draft(tmp_path: Path) -> None:
    run().write(tmp_path / "run.csv")
    with pytest.raises(dc.InputError):
        draft_mapping(tmp_path / "run.csv", M)
    with pytest.raises(dc.InputError):
        read_mapping(tmp_path / "none.toml")


def test_a_column_of_texts_is_named_with_its_first_value() -> None:
    log = {"time": T, "q.hinge": ["up"] * len(T), "u.hinge": 0.0 * T}
    with pytest.raises(dc.InputError, match=r"'q\.hinge'.*'up'"):
        dc.audit(M, log)


def test_degrees_for_radians_are_suspected() -> None:
    with pytest.warns(dc.SuspicionWarning, match="radians"):
        M.state({"hinge": 60})


def test_solvers_as_one_name() -> None:
    found = dc.recommend(M, S, 0.2, solvers="ode4")
    assert {trial.solver for trial in found.trials} == {"ode4"}
