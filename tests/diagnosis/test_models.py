"""What a user may call a model."""

from __future__ import annotations

from pathlib import Path

import pytest

import deltac as dc
from deltac.diagnosis.inputs.models import load_model

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


def test_objects() -> None:
    problem = dc.problems.load("simple-pendulum")
    assert load_model(problem).problem is problem
    assert load_model(problem.mechanism).mechanism is problem.mechanism


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (":pendulm", "did you mean 'pendulum'"),
        (":nothing", "returned float; expected a Mechanism or a Problem"),
        (":broken", "ZeroDivisionError"),
        ("", "say which function"),
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
        ("no/such.py:f", "no file"),
    ],
)
def test_names_of_nothing(name: str, said: str) -> None:
    with pytest.raises(dc.InputError, match=said):
        load_model(name)


def test_a_file_that_does_not_run(tmp_path: Path) -> None:
    path = tmp_path / "bad.py"
    path.write_text("import no_such_package_at_all\n")
    with pytest.raises(dc.InputError, match="bad.py cannot be run: ModuleNotFoundError"):
        load_model(f"{path}:f")


@pytest.mark.parametrize("text", ["import sys; sys.exit(3)", "def make(): raise SystemExit('no')"])
def test_a_file_that_wants_to_exit(tmp_path: Path, text: str) -> None:
    (tmp_path / "quits.py").write_text(text)
    with pytest.raises(dc.InputError, match="quits.py.*(cannot be run|failed): SystemExit"):
        load_model(f"{tmp_path / 'quits.py'}:make")
