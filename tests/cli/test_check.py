"""`deltac check`: what it prints, and its exit status."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

from tests.support.commands import command
from tests.support.slow import crossed

EOM = '''
import numpy as np
import deltac as dc

def pendulum():
    return dc.Mechanism(
        bodies=[dc.rod("a", "m", "l", along="-y"), dc.rod("b", "m", "l", along="-y")],
        joints=[dc.revolute("one", "ground", "a"),
                dc.revolute("two", "a", "b", position=(0, "-l", 0))],
        gravity=(0, "-g", 0), parameters={"m": 1.2, "l": 0.7, "g": 9.81}, name="two rods")

m, l, g = 1.2, 0.7, 9.81

def rhs(t, q, u, sign=1.0):
    """Absolute angles; Lagrange's equations of two equal rods."""
    c, s = np.cos(q[0] - q[1]), np.sin(q[0] - q[1])
    a, b, d = 4/3*m*l**2, 0.5*m*l**2*c, 1/3*m*l**2
    f1 = -0.5*m*l**2*s*u[1]**2 - 1.5*m*g*l*np.sin(q[0])
    f2 = sign*0.5*m*l**2*s*u[0]**2 - 0.5*m*g*l*np.sin(q[1])
    D = a*d - b*b
    return np.array([(d*f1 - b*f2)/D, (a*f2 - b*f1)/D])

def wrong(t, q, u):
    return rhs(t, q, u, -1.0)

absolute = dc.CoordinateMap(("th1", "th2"), q={"one": "q.th1", "two": "q.th2 - q.th1"})
equations = dc.Equations(rhs, absolute)

def make():
    return dc.Equations(wrong, absolute)

def fails(t, q, u):
    return q[5]
'''


@pytest.fixture
def eom(tmp_path: Path) -> str:
    path = tmp_path / "eom.py"
    path.write_text(EOM, "utf-8")
    return str(path)


run = partial(command, "check")


@pytest.mark.parametrize(
    ("name", "options", "status", "said"),
    [
        ("rhs", ["--coordinates", "absolute"], 0, "consistent"),
        ("equations", [], 0, "consistent"),  # it brings its own map
        ("wrong", ["--coordinates", "absolute"], 1, "equation 2 (two)"),
        ("make", ["--seed", "3", "--count", "20"], 1, "at 20 random states"),
        ("rhs", [], 1, "right in absolute coordinates"),
    ],
)
def test_status_and_words(
    eom: str,
    name: str,
    options: list[str],
    status: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    found, out, err = run(f"{eom}:pendulum", f"{eom}:{name}", *options, capsys=capsys)
    assert (found, err) == (status, ""), out
    assert said in " ".join(out.split())
    assert "liu-huston" in out  # the table


def test_a_map_from_a_file_and_json(eom: str, capsys: pytest.CaptureFixture[str]) -> None:
    map_option = ["--coordinates", f"{eom}:absolute", "--json"]
    status, out, _ = run(f"{eom}:pendulum", f"{eom}:wrong", *map_option, capsys=capsys)
    told = json.loads(out)
    assert status == 1 and told["verdict"] == "equation-error"
    (blame,) = told["blame"]
    assert (blame["number"], blame["speed"]) == (2, "th2")
    assert blame["degrees"] == [2]
    assert "wrong sign" in blame["terms"][0]["words"]


def test_a_problem_offers_its_own_coordinates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from deltac import problems\n"
        "rhs = problems.load('triple-pendulum', mistake=True).equations.rhs\n",
        "utf-8",
    )
    status, out, _ = run("triple-pendulum", f"{path}:rhs", capsys=capsys)
    assert status == 1
    assert "equation 2 (theta2) is off" in " ".join(out.split())
    assert "sin(theta2)/2, enters with the wrong sign" in " ".join(out.split())


@pytest.mark.parametrize(
    ("equations", "options", "said"),
    [
        ("eom.py", [], "expected FILE.py:FUNCTION"),
        ("{eom}:nothing", [], "no function 'nothing'"),
        ("{eom}:m", [], "found float, expected a function of (t, q, u)"),
        ("{eom}:fails", [], "raised IndexError"),
        ("{eom}:fails", [], ": return q[5])"),
        ("nowhere.py:rhs", [], "nowhere.py: no such file"),
        ("{eom}:rhs", ["--coordinates", "polar"], "coordinates is 'polar'"),
        ("{eom}:rhs", ["--coordinates", "{eom}:m"], "found float, expected CoordinateMap"),
        ("states.csv", ["--repair"], "a table has none"),
    ],
)
def test_bad_input(
    eom: str, equations: str, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [equations.format(eom=eom), *(o.format(eom=eom) for o in options)]
    status, out, err = run(f"{eom}:pendulum", *given, capsys=capsys)
    assert (status, out) == (2, "")
    assert said in err


@pytest.mark.parametrize(
    ("more", "kept"),
    crossed(
        [(), ("--repair",)], ["pass", "try:\n            x = 1\n        except:\n            pass"]
    ),
)
def test_a_function_that_never_ends_is_ended(
    tmp_path: Path, more: tuple[str, ...], kept: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where the function is tried in one form after another, or keeps every exception."""
    path = tmp_path / "turning.py"
    path.write_text(f"def rhs(t, q, u):\n    while True:\n        {kept}\n", "utf-8")
    limit = ("--time-limit", "0.3")
    status, _, said = run("double-pendulum", f"{path}:rhs", *limit, *more, capsys=capsys)
    assert status == 2
    assert "E-LIMIT" in said
    assert "at " in said and f"{path}:" in said.split("at ", 1)[1]
