"""`Report`: JSON of every result, text in any width, codes that are listed."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.calls.progress import Parts, counted
from deltac.codes import FINDINGS
from deltac.diagnosis.causes.causes import PREFERENCE
from deltac.errors import InputError, LogError, UnknownName
from deltac.results import SCHEMA, Finding, Report, Section, Serialisable, Table, Verbatim, as_text


@dataclass(frozen=True)
class Part(Serialisable, omit=("hidden",), also=("twice",)):
    x: float
    hidden: object = None

    @property
    def twice(self) -> float:
        return 2.0 * self.x


@dataclass(frozen=True, repr=False)
class Sample(Report):
    parts: tuple[Part, ...]
    values: Any
    names: dict[str, Any] = field(default_factory=dict)

    @property
    def findings(self) -> tuple[Finding, ...]:
        return (Finding("gravity", "a", "b", "c", "cause"),)

    @property
    def exit_code(self) -> int:
        return 3

    def summary(self) -> str:
        return "one <line>"

    def sections(self) -> Any:
        yield "a <paragraph> & more"
        yield Table(("name", "value | unit"), (("x", "1.5 J"), (), ("total", "-2 %")))
        yield Verbatim("-old\n+new")


SAMPLE = Sample(
    (Part(np.inf, hidden=object()), Part(2.0)),
    np.array([[1.0, np.nan], [np.inf, 4.0]]),
    {"path": Path("a"), "n": np.int64(3), "flag": np.bool_(True), "none": None},
)


def test_fields_make_the_json() -> None:
    told = json.loads(json.dumps(SAMPLE.to_dict(), allow_nan=False))
    assert list(told)[:4] == ["schema", "deltac", "report", "exit_code"]
    assert (told["schema"], told["report"], told["exit_code"]) == (SCHEMA, "Sample", 3)
    assert told["parts"] == [{"twice": None, "x": None}, {"twice": 4.0, "x": 2.0}]
    assert told["values"] == [[1.0, None], [None, 4.0]]
    assert told["names"] == {"path": "a", "n": 3, "flag": True, "none": None}
    assert told["findings"][0]["code"] == "F-GRAVITY"


def test_what_has_no_json_is_an_error_of_ours() -> None:
    with pytest.raises(TypeError, match="object has no form in JSON"):
        Sample((), object()).to_dict()


def test_sections_make_text_html_and_markdown() -> None:
    assert str(SAMPLE) == "one <line>" and repr(SAMPLE) == "Sample(one <line>)"
    assert SAMPLE.table() == "name   value | unit\n───────────────────\nx             1.5 J\n" + (
        "───────────────────\ntotal          -2 %"
    )
    shown = SAMPLE._repr_html_()
    assert "one &lt;line&gt;" in shown and "<paragraph>" not in shown
    assert ">1.5 J</td>" in shown and "<pre>-old\n+new</pre>" in shown
    told = SAMPLE.to_markdown()
    assert "| name | value \\| unit |\n| --- | ---: |" in told and "```\n-old\n+new\n```" in told


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_text_keeps_to_its_width_and_breaks_no_word(width: int) -> None:
    rows = tuple(
        (f"element-{k}", "a sentence of words that must be wrapped somewhere", f"{k}.5 J", "x" * 12)
        for k in range(3)
    )
    sections: tuple[Section, ...] = (
        "equation-error " * 12,
        Table(("name", "what it is", "energy", "code"), rows),
    )
    text = as_text(sections, width)
    assert max(map(len, text.splitlines())) <= width
    assert "a sentence of words" in " ".join(text.split()) or width < 60
    assert len(re.findall(r"\bequation-error\b", text)) == 12
    assert all(text.count(row[0]) >= 1 and text.count("x" * 12) == 3 for row in rows)


# --- codes ----------------------------------------------------------------------------------------


def test_every_cause_has_a_code_which_the_page_of_codes_lists() -> None:
    assert set(PREFERENCE) <= set(FINDINGS)
    with pytest.raises(AssertionError, match="codes.py"):
        Finding("no-such-kind", "a", "b", "c")


def test_an_error_that_adds_where_has_the_code_of_its_cause() -> None:
    try:
        try:
            raise LogError("no column 'time'")
        except InputError as error:
            raise InputError(f"run.csv: {error}") from error
    except InputError as error:
        assert error.code == "E-LOG"
    assert InputError("x").code == "E-VALUE" and issubclass(UnknownName, KeyError)
    assert str(UnknownName("unknown 'x'")) == "unknown 'x'"


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda: dc.audit("no-such-problem", "run.csv"), "E-NAME"),
        (lambda: dc.audit(3, "run.csv"), "E-TYPE"),  # type: ignore[arg-type]
        (lambda: dc.audit("simple-pendulum", "missing.csv"), "E-FILE"),
        (lambda: dc.problems.load("simple-pendulum").mechanism.state({"elbow": 1.0}), "E-NAME"),
        (lambda: dc.point_mass("ball", -1.0), "E-MODEL"),
        (lambda: dc.audit("simple-pendulum", 3), "E-TYPE"),  # type: ignore[arg-type]
        (lambda: dc.check_equations("simple-pendulum", lambda t, q, u: q[5]), "E-SOURCE"),
        (lambda: dc.study("simple-pendulum", steps=[1e-2, -1.0]), "E-VALUE"),
    ],
)
def test_errors_have_codes(call: Any, code: str) -> None:
    with pytest.raises(InputError) as stop:
        call()
    assert stop.value.code == code


def test_parts_tell_of_the_whole() -> None:
    told: list[float] = []
    parts = Parts(told.append, {"read": 0.25, "judge": 0.5, "write": 0.25})
    assert list(counted("ab", parts.part("read"))) == ["a", "b"]
    parts.part("write")(0.5)  # there was nothing to judge
    assert told == [0.0, 0.0, 0.125, 0.75, 0.875]


@pytest.mark.long
def test_checks_and_audits_tell_how_far_they_are() -> None:
    problem = dc.problems.load("double-pendulum")
    told: list[float] = []
    dc.check_equations(problem, lambda t, q, u: -q, progress=told.append)
    assert told == sorted(told) and told[0] == 0.0 and len(told) > 5
    run = replace(dc.simulate(problem, duration=0.5, step=0.01), udot=None, integrals={})
    weight = [0.9 * problem.mechanism.number(g) for g in problem.mechanism.gravity]
    other = replace(problem.mechanism, gravity=weight)
    told.clear()
    dc.audit(other, run, progress=told.append)
    assert told == sorted(told) and told[0] == 0.0 and len(told) > 4
