"""Programs that are read or, where that is impossible, run: as the command line meets them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

import deltac as dc
from deltac.diagnosis.inputs.equations import load_equations
from deltac.errors import InputError
from deltac.repair.outcome import Repair

SPRING = dc.Mechanism(
    bodies=[dc.bodies.frame("arm"), dc.point_mass("bob", "m")],
    joints=[
        dc.revolute("a", "ground", "arm"),
        dc.prismatic("r", "arm", "bob", "-y", stiffness="k", rest="l0"),
    ],
    gravity=(0, "-g", 0),
    parameters={"m": 0.9, "g": 9.81, "k": 70.0, "l0": 0.45},
)
POLAR = dc.CoordinateMap(("r", "a"), q={"a": "q.a", "r": "q.r"})

MATCH = """
from enum import Enum, auto
from typing import NamedTuple
import numpy as np
class Law(Enum):
    NONE = auto()
    HOOKE = auto()
LAW = Law.HOOKE
class Rates(NamedTuple):
    r: float
    a: float
    vr: float
    va: float
m, g, k, l0 = 0.9, 9.81, 70.0, 0.45
def pull(r):
    match LAW:
        case Law.NONE:
            return 0.0
        case Law.HOOKE:
            return -k * (r - l0)
def rhs(t, y):
    both = np.concatenate((y[:1], y[1:]))
    r, a, vr, va = both
    out = r * va**2 + g * np.cos(a) + pull(r) / m
    return Rates(r=vr, a=va, vr=out, va=-(2 * vr * va + g * np.sin(a)) / r)
"""

COMPLEX = """
from cmath import exp
m, g, k, l0 = 0.9, 9.81, 70.0, 0.45
def rhs(t, y):
    r, a, vr, va = y
    along = exp(1j * a)
    acc = complex(g * along.real - k * (r - l0) / m + r * va**2, -g * along.imag - 2 * vr * va)
    return [vr, va, acc.real, acc.imag / r]
"""

LIVE = """
import argparse
from math import cos, sin
parser = argparse.ArgumentParser()
parser.add_argument("--m", type=float, default=0.9)
parser.add_argument("--k", type=float, default=70.0)
parser.add_argument("--l0", type=float, default=0.45)
parser.add_argument("--g", type=float, default=9.81)
CONFIG = {"physics": vars(parser.parse_args([]))}
def rhs(t, y):
    r, a, vr, va = y
    c = CONFIG["physics"]
    out = r * va**2 + c["g"] * cos(a) - c["k"] * (r - c["l0"]) / c["m"]
    return [vr, va, out, -(2 * vr * va + c["g"] * sin(a)) / r]
"""


def repaired(tmp_path: Path, text: str, old: str, new: str) -> Repair:
    assert text.count(old) == 1
    path = tmp_path / "eom.py"
    path.write_text(text.replace(old, new))
    target = f"{path}:rhs"
    return dc.repair_equations(SPRING, target, function=load_equations(target), coordinates=POLAR)


def test_a_right_program_is_left_alone(tmp_path: Path) -> None:
    assert repaired(tmp_path, COMPLEX, "m, g, k", "m, g, k").right


def test_match_enumerations_and_named_tuples_are_read(tmp_path: Path) -> None:
    found = repaired(tmp_path, MATCH, "2 * vr * va", "vr * va")
    assert found.certain and found.fixes[0].text == MATCH.replace("2 * vr * va", "vr * va * 2")


def test_live_values_of_one_name_are_told_apart(tmp_path: Path) -> None:
    """argparse is not read; what it made is: every constant by its own name."""
    found = repaired(tmp_path, LIVE, "sin(a)) / r", "cos(a)) / r")
    assert found.certain and found.fixes[0].text == LIVE
    assert set(found.varied) == {"m", "k", "l0", "g"}


def test_what_cannot_be_read_is_run(tmp_path: Path) -> None:
    found = repaired(tmp_path, COMPLEX, "- 2 * vr * va", "+ 2 * vr * va")
    assert "1j" in found.unread and not found.certain
    assert found.fixes[0].text == COMPLEX and found.fixes[0].ran


C = """
#include <math.h>
void rhs(double t, const double *q, const double *u, double *udot)
{
    double m = 0.9, g = 9.81, k = 70.0, l0 = 0.45;
    udot[0] = q[0] * u[1] * u[1] + g * cos(q[1]) - k * (q[0] - l0) / m;
    udot[1] = -(2.0 * u[0] * u[1] - g * sin(q[1])) / q[0];
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_of_a_function_without_a_text_the_wrong_term_is_named(tmp_path: Path) -> None:
    """Gravity's moment with the wrong sign, in a shared library."""
    (tmp_path / "rhs.c").write_text(C)
    library = tmp_path / "librhs.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-o", str(library), str(tmp_path / "rhs.c"), "-lm"], check=True
    )
    target = f"{library}:rhs"
    found = dc.repair_equations(SPRING, target, function=load_equations(target), coordinates=POLAR)
    assert found.exit_code == 1 and not found.fixes and "librhs.so:rhs" in found.unread
    assert found.equations == ("a",)
    assert len(found.terms) == 1 and "gravity" in found.terms[0]
    assert "wrong sign" in found.terms[0]


CTYPES = """
import ctypes
import pathlib

import numpy as np

ROW = np.ctypeslib.ndpointer(float, 1)
library = ctypes.CDLL(str(pathlib.Path(__file__).with_name("librhs.so")))
library.rhs.argtypes, library.rhs.restype = [ctypes.c_double, ROW, ROW, ROW], None


def rhs(t, q, u):
    udot = np.empty(2)
    library.rhs(t, np.array([q[1], q[0]]), np.array([u[1], u[0]]), udot)
    return udot[::-1]
"""
"""In the order of the mechanism: the angle, then the length."""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_of_a_call_by_ctypes_the_wrong_term_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside its library, as a file whose folder is where deltac is called, and as a live function."""
    (tmp_path / "rhs.c").write_text(C)
    command = ["cc", "-shared", "-fPIC", "-o", "librhs.so", "rhs.c", "-lm"]
    subprocess.run(command, check=True, cwd=tmp_path)
    (tmp_path / "eom.py").write_text(CTYPES)
    monkeypatch.chdir(tmp_path)
    equations = load_equations("eom.py:rhs")
    read, live = (
        dc.repair_equations(SPRING, "eom.py:rhs", function=equations),
        dc.repair_equations(SPRING, equations),
    )
    for found in (read, live):
        assert found.exit_code == 1 and not found.fixes and "ctypes" in found.unread
        assert found.equations == ("a",)
        assert len(found.terms) == 1 and "gravity" in found.terms[0]
    with pytest.raises(InputError) as refused:  # the text alone is read and not run
        dc.repair_equations(SPRING, "eom.py:rhs")
    assert refused.value.code == "E-SOURCE"
