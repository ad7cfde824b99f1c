"""What a check says, where the error is small or is none of the equations'."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

import deltac as dc
from deltac.diagnosis.check.location import Example

PENDULUM = dc.problems.load("simple-pendulum").mechanism


def test_a_small_error_is_shown_with_the_digits_that_show_it() -> None:
    """g = 9.810001 in place of 9.81: a factor of 1 + 1.02e-7 in front of the weight."""
    found = dc.check_equations(PENDULUM, lambda t, q, u: -9.810001 * np.sin(q))
    assert found.verdict.kind == "equation-error"
    given, right = map(float, re.findall(r"(?:give|model) (-?\d+\.\d+)", str(found.example)))
    assert abs(given / right - 1.0 - 1e-6 / 9.81) < 1e-8  # three digits of the difference
    said = " ".join(found.explain().split())
    assert "enters with the factor 1 + 1.0e-07" in said
    assert "e-06 %" not in said and "is off by 5.1e-8 of its terms" in said


def test_only_what_differs_is_shown_but_the_worst_always() -> None:
    def shown(*given: float) -> list[tuple[str, str]]:
        example = Example(
            {"t": 0.0}, dict(zip("abc", given)), {"a": 0.0, "b": 2.0, "c": 3.0}, "b", 0.1
        )
        return re.findall(r"u̇\.(\w): the equations give (\S+),", str(example))

    assert shown(0.0, 2.0002, 3.0) == [("b", "2.0002")]
    assert shown(1e-15, 2.0 + 2e-9, 3.0 + 6e-9) == [("c", "3.000000006")]
    assert shown(1e-3, 2.0, 3.3) == [("a", "0.001"), ("c", "3.3")]


def test_overwriting_an_argument_is_told_first() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        q[0] = 0.0
        return -9.81 * np.sin(q)

    found = dc.check_equations(PENDULUM, rhs)
    assert found.verdict.kind == "equation-error"
    first = found.verdict.evidence[0]
    assert first.startswith("rhs overwrites its arguments (q.pivot from ") and " to 0)" in first
    assert "overwrites" in found.verdict.evidence[0]


def test_overwriting_after_use_is_a_doubt_and_no_error() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        value = -9.81 * np.sin(q)
        u += 1.0
        return value

    found = dc.check_equations(PENDULUM, rhs)
    assert found.verdict.kind == "consistent"
    assert [f.weight for f in found.verdict.findings] == ["doubt"]
    assert "overwrites" not in " ".join(found.verdict.evidence)
