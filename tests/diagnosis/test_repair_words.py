"""What is said of a repair: the likely edit first, the others, lines, states, and a patch that applies."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

import deltac as dc
from deltac.repair.outcome import Repair
from deltac.repair.repair import repair_source
from deltac.repair.tracing.samples import Target
from deltac.repair.tracing.source import Source, read_source

ROD = """\
import numpy as np

mass_a, len_a, len_b, spring, g0 = 1.3, 0.6, 0.45, 2.3, 9.81


def rhs(t, q, u):
    a = q[0]
    inertia = mass_a * len_a**2 / 3
    weight = mass_a * g0 * len_a / 2 * np.sin(a)
    return [(-weight - spring * a) / inertia]
"""


@pytest.fixture(scope="module")
def target() -> Target:
    """A rod with a spring at its hinge; its parameters have names of their own."""
    return Target(
        dc.Mechanism(
            bodies=[dc.rod("rod", "m", "l", along="-y")],
            joints=[dc.revolute("a", "ground", "rod", stiffness="k")],
            gravity=(0, "-g", 0),
            parameters={"m": 1.3, "l": 0.6, "k": 2.3, "g": 9.81},
        )
    )


def repaired(target: Target, old: str, new: str, text: str = ROD) -> Repair:
    assert text.count(old) == 1
    return repair_source(Source("eom.py", text.replace(old, new), "rhs"), target)


def spoken(found: Repair) -> str:
    return " ".join(found.explain().split())


def test_a_name_before_a_number(target: Target) -> None:
    found = repaired(target, "g0 * len_a", "g0 * len_b")
    assert found.fixes[0].words == ("len_b should be len_a",)
    assert not found.certain  # 2 could be 3 / 2 as well
    assert len(found.fixes) > 1


def test_a_small_whole_number_before_a_decimal_and_all_are_said(target: Target) -> None:
    inline = re.sub(r"mass_a, len_a.*\n\n\n", "\n", ROD)
    for name, value in (("mass_a", "1.3"), ("len_a", "0.6"), ("spring", "2.3"), ("g0", "9.81")):
        inline = inline.replace(name, value)
    found = repaired(target, "0.6 / 2 *", "0.6 / 3 *", inline)
    assert found.fixes[0].words == ("3 should be 2",)
    assert not found.certain
    assert any("0.6 should be 0.9" in other for other in found.fixes[0].others)
    for other in found.fixes[0].others:
        assert other in spoken(found)


def test_a_sign_before_a_negative_number(target: Target) -> None:
    text = ROD.replace("(-weight - spring * a)", "(0 - weight - spring * a)")
    found = repaired(target, "(0 - weight", "(0 + weight", text)
    assert found.fixes[0].kinds == ("sign",)
    assert "-2" not in found.fixes[0].words[0]


@pytest.mark.slow
def test_a_line_is_suspected_once_by_its_widest_expression(target: Target) -> None:
    # a formula that no single edit restores: the values it must have are known, how to write them is not
    found = repaired(target, "np.sin(a)", "np.tanh(np.exp(a) - a**4)")
    lines = [suspect.split(":")[1] for suspect in found.suspects]
    assert not found.fixes and lines and len(lines) == len(set(lines))
    weight = next(s for s in found.suspects if s.startswith("eom.py:9:"))
    assert weight == "eom.py:9: mass_a * g0 * len_a / 2 * np.tanh(np.exp(a) - a**4)"


@pytest.mark.parametrize("given", ["src/eom.py", "absolute"])
@pytest.mark.parametrize("repository", [True, False])
def test_the_patch_applies_from_the_root_of_a_project(
    repository: bool,
    given: str,
    target: Target,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "src" / "eom.py"
    path.parent.mkdir()
    path.write_text(ROD.replace("/ 3", "/ 12"), "utf-8")
    if repository:
        subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    monkeypatch.chdir(tmp_path)
    file = str(path) if given == "absolute" else given
    found = repair_source(read_source(f"{file}:rhs"), target)
    fixed = found.fixes[0]
    subprocess.run(
        ["git", "apply", "-p1", "-"], input=fixed.diff, text=True, cwd=tmp_path, check=True
    )
    assert path.read_text("utf-8") == fixed.text != ROD.replace("/ 3", "/ 12")
