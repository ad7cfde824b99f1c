"""Mutants, and which tests see them."""

from __future__ import annotations

import ast
import itertools
import json
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

import deltac as dc
from deltac.cli import main
from deltac.repair.mutate.operators import MUTANT_KINDS, mutants

EULER = """\
import numpy as np

A, B, C = 2.1, 3.3, 4.7


def rhs(t, q, u):
    # torque-free: Euler's equations
    x, y, z = u
    a = (B - C) * y * z
    b = (C - A) * z * x
    c = (A - B) * x * y
    return np.array([a / A, b / B, c / C])
"""


@pytest.fixture(scope="module")
def body() -> dc.Mechanism:
    """A body on a ball joint at its mass centre, without gravity."""
    return dc.Mechanism(
        bodies=[dc.body("top", 1.0, ("A", "B", "C"))],
        joints=[dc.joints.spherical("ball", "ground", "top")],
        parameters={"A": 2.1, "B": 3.3, "C": 4.7},
    )


def test_each_mutant_is_one_change_of_its_kind() -> None:
    made = mutants(EULER, "rhs")
    original = ast.dump(ast.parse(EULER))
    assert len({m.text for m in made}) == len(made) > 100
    for m in made:
        assert m.kind in MUTANT_KINDS and m.before != m.after
        assert ast.dump(ast.parse(m.text)) != original
        differing = [
            k
            for k, (x, y) in enumerate(
                zip(EULER.splitlines(), m.text.splitlines(), strict=True), start=1
            )
            if x != y
        ]
        assert differing == [m.line]


def test_the_operators_are_those_of_the_literature() -> None:
    """Counted by hand for one statement: a = b * c, with names b, c known before."""
    text = "b, c = 2.0, 3.0\n\n\ndef rhs(t, q, u):\n    a = b * c\n    return [a]\n"
    counts = Counter(m.kind for m in mutants(text, "rhs", names=1) if m.line == 5)
    assert counts == {
        "operator": 3,  # + - /
        "dropped factor": 2,
        "sign": 2,
        "name": 1 + 1,  # one other name for each use
        "power": 2,  # a square at each use
    }


def test_what_energy_does_not_see_the_residual_does(body: dc.Mechanism, tmp_path: Path) -> None:
    path = tmp_path / "euler.py"
    path.write_text(EULER, "utf-8")
    found = dc.mutate_equations(body, f"{path}:rhs", names=1)
    assert found.residual < 1e-12  # rounding of some tens of operations
    assert found.varied == ("A", "B", "C") and found.exit_code == 0
    table = found.counts()["all"]
    wrong = table["mutants"] - table["equivalent"]
    assert table["coordinate residual"] == wrong > 80


@pytest.mark.long
def test_workless_mistakes_of_a_sleigh_are_listed() -> None:
    """Its blade's force does no work; with m = I = 1, some mistakes are right by chance."""
    path = Path(__file__).parents[2] / "benchmarks/equations/chaplygin_sleigh.py"
    found = dc.mutate_equations("chaplygin-sleigh", f"{path}:rhs", names=0)
    reasons = Counter(t.reason for t in found.trials)
    assert reasons["workless"] > 10 and reasons["coincidence"] > 0 and found.exit_code == 0
    for t in found.trials:
        if t.reason == "workless":
            assert t.detected("coordinate residual") and not t.detected("liu-huston")
        elif t.reason in ("coincidence", "equivalent"):
            assert not t.detected("coordinate residual")
    table = found.counts()["all"]
    wrong = table["mutants"] - table["equivalent"]
    assert table["coordinate residual"] == wrong - reasons["coincidence"]
    assert "workless" in found.explain()


def test_wrong_equations_are_said_to_be_wrong_first(body: dc.Mechanism, tmp_path: Path) -> None:
    path = tmp_path / "euler.py"
    path.write_text(EULER.replace("(B - C) * y", "(B + C) * y"), "utf-8")
    found = dc.mutate_equations(body, f"{path}:rhs", names=0)
    assert found.exit_code == 1 and "repair it first" in found.explain()


def test_the_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    wrong = (
        "from math import sin\n\ng, l = 9.81, 2.0\n\n\n"
        "def rhs(t, q, u):\n    return [g * sin(q[0]) / l]\n"
    )
    Path("eom.py").write_text(wrong, "utf-8")
    Path("model.py").write_text(
        "import deltac as dc\n\n\ndef pendulum():\n"
        "    return dc.Mechanism(\n"
        "        bodies=[dc.point_mass('bob', 1.0, at=(0.0, '-l', 0.0))],\n"
        "        joints=[dc.revolute('pin', 'ground', 'bob')],\n"
        "        gravity=(0.0, '-g', 0.0),\n"
        "        parameters={'g': 9.81, 'l': 2.0},\n    )\n",
        "utf-8",
    )
    with pytest.raises(SystemExit) as left:
        main(["check", "model.py:pendulum", "eom.py:rhs", "--repair", "--write", "fix.patch"])
    assert left.value.code == 1
    printed = capsys.readouterr().out
    assert "eom.py:7: " in printed and "should be −" in printed
    assert "+    return [" in Path("fix.patch").read_text("utf-8")
    assert Path("eom.py").read_text("utf-8") == wrong
    with pytest.raises(SystemExit):
        main(["check", "model.py:pendulum", "eom.py:rhs", "--repair", "--json"])
    repair = json.loads(capsys.readouterr().out)["repair"]
    assert repair["certain"] and repair["fixes"][0]["lines"] == [7]
    Path("eom.py").write_text(wrong.replace("[g", "[-g"), "utf-8")
    with pytest.raises(SystemExit) as left:
        main(["mutate", "model.py:pendulum", "eom.py:rhs", "--json"])
    outcome = json.loads(capsys.readouterr().out)
    assert left.value.code == 0
    assert outcome["counts"]["all"]["mutants"] == len(outcome["trials"])
    with pytest.raises(SystemExit) as left:
        main(["mutate", "model.py:pendulum", "eom.py:other"])
    assert left.value.code == 2


def test_the_heads_of_the_table_differ_at_80_columns() -> None:
    from deltac.dynamics.testing_functions import TESTING_FUNCTIONS
    from deltac.repair.mutate.operators import Mutant
    from deltac.repair.mutate.report import (
        CONSTRAINTS,
        MOMENTUM_TEST,
        RESIDUAL,
        MutantTrial,
        MutationReport,
    )

    tests = (*TESTING_FUNCTIONS, MOMENTUM_TEST, CONSTRAINTS, RESIDUAL)
    trials = tuple(
        MutantTrial(Mutant("dropped factor", 1, "a", "b", ""), dict.fromkeys(tests, 1.0))
        for _ in range(1000)
    )
    found = MutationReport("eom.py", "rhs", tests, trials, 0.0, ())
    printed = found.table(width=80)
    head = printed.split("─")[0].splitlines()
    assert "…" not in printed and len(max(head, key=len)) <= 80
    # what stands in a column over all lines of the head, the columns' ends being those of the numbers
    row = next(line for line in printed.splitlines() if line.startswith("dropped factor"))
    ends = [m.end() for m in re.finditer(r"\b\d+\b", row)]
    columns = [
        " ".join(line[a:b].strip() for line in head).strip() for a, b in itertools.pairwise(ends)
    ]
    assert len(set(columns)) == len(columns) == len(tests) + 1
    assert {"kane 1988", "kane 1990"} <= set(columns)


ROD = """\
from math import sin

m, l, g = 1.3, 0.6, 9.81


class Rod:
    def rates(self, t, y):
        inertia = m * l**2 / 3
        return [y[1], -m * g * l / 2 * sin(y[0]) / inertia]
"""

WEAK = """\
from rod import Rod


def test_rest():
    assert Rod().rates(0.0, [0.0, 0.3]) == [0.3, 0.0]
"""


@pytest.fixture
def rod(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dc.Mechanism:
    """A rod at a hinge, and a project with its equations and a test that looks at rest alone."""
    (tmp_path / "pyproject.toml").write_text("", "utf-8")
    (tmp_path / "rod.py").write_text(ROD, "utf-8")
    (tmp_path / "test_rod.py").write_text(WEAK, "utf-8")
    monkeypatch.chdir(tmp_path)
    return dc.Mechanism(
        bodies=[dc.rod("rod", "m", "l", along="-y")],
        joints=[dc.revolute("a", "ground", "rod")],
        gravity=(0, "-g", 0),
        parameters={"m": 1.3, "l": 0.6, "g": 9.81},
    )


@pytest.mark.slow
def test_what_the_users_own_tests_miss(rod: dc.Mechanism, tmp_path: Path) -> None:
    """Of a method; a test at rest cannot see gravity's factor, and sees a rate that is wrong."""
    command = f"{sys.executable} -m pytest -q -p no:cacheprovider test_rod.py"
    found = dc.mutate_equations(rod, "rod.py:Rod.rates", tests=command, most=12, names=1)
    looked = [t for t in found.trials if "your tests" in t.seen]
    assert len(looked) == 12 and found.exit_code == 1
    missed = {t.mutant.before for t in found.escaped}
    assert missed and len(found.escaped) < 12
    assert (tmp_path / "rod.py").read_text("utf-8") == ROD


@pytest.mark.long
def test_tests_that_do_not_load_the_equations_are_refused(
    rod: dc.Mechanism, tmp_path: Path
) -> None:
    (tmp_path / "test_rod.py").write_text("def test_nothing():\n    pass\n", "utf-8")
    command = f"{sys.executable} -m pytest -q -p no:cacheprovider test_rod.py"
    with pytest.raises(dc.InputError, match=r"do not use it"):
        dc.mutate_equations(rod, "rod.py:Rod.rates", tests=command)
    with pytest.raises(dc.InputError, match="no such command"):
        dc.mutate_equations(rod, "rod.py:Rod.rates", tests="no-such-program-here")


@pytest.mark.parametrize("options", [{"names": -1}, {"most": 0}])
def test_numbers_of_mutants_that_cannot_be_are_refused(
    rod: dc.Mechanism, options: dict[str, int]
) -> None:
    with pytest.raises(dc.InputError, match=next(iter(options))) as refused:
        dc.mutate_equations(rod, "rod.py:Rod.rates", **options)  # type: ignore[arg-type]
    assert refused.value.code == "E-VALUE"
