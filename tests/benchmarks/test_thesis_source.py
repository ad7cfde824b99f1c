"""From the source to the code, docs/data/thesis/source.csv: what it names exists and is what a row says.

`SOURCE` was written from the thesis itself, not from the table: every equation of chapters 2 to 4, and words
of its subject, one of which a row that names the equation must have.
"""

from __future__ import annotations

import csv
import importlib
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]

SOURCE: dict[tuple[str, str], str] = {
    ("2.1.1", "2.1.2"): "q̇ = W u + X",
    ("2.1.3", "2.1.4"): "V and G_r",
    ("2.1.5", "2.1.6"): "K2 − K0",
    ("2.2.1", "2.2.4"): "Kane–Levinson 1990",
    ("2.3.1", "2.3.5"): "Liu–Huston",
    ("2.4.1", "2.4.2"): "Wang",
    ("2.5.1", "2.5.1"): "x, v | `x`",
    ("2.5.2", "2.5.2"): "x, v | `v`",
    ("2.5.3", "2.5.3"): "P1",
    ("2.5.4", "2.5.4"): "F + F* = 0",
    ("2.5.5", "2.5.7"): "F = F_V + F_D",
    ("2.5.8", "2.5.14"): "Ω | `M`",
    ("2.5.15", "2.5.19"): "J R = 0",
    ("2.5.20", "2.5.21"): "λ_c",
    ("2.5.22", "2.5.25"): "A v + b = 0",
    ("2.5.26", "2.5.26"): "v = R u + v_t",
    ("2.5.27", "2.5.27"): "R1, R2",
    ("2.5.28", "2.5.34"): "constrained system",
    ("2.5.35", "2.5.41"): "K2 + K1 + K0",
    ("2.5.42", "2.5.42"): "V̇ = −vᵀF_V",
    ("2.5.43", "2.5.50"): "power equation",
    ("2.5.51", "2.5.60"): "Wang",
    ("2.5.61", "2.5.64"): "multipliers",
    ("2.5.65", "2.5.71"): "equivalent",
    ("3.1.1", "3.1.16"): "K, V, non-potential forces",
    ("3.1.17", "3.1.17"): "equation",
    ("3.1.18", "3.1.19"): "equations of motion",
    ("3.1.20", "3.1.21"): "sum of the three equations",
    ("3.1.22", "3.1.28"): "K̇",
    ("3.2.1", "3.2.11"): "x, R, J, M, F",
    ("3.2.12", "3.2.19"): "Wang, free",
    ("3.2.20", "3.2.20"): "Wang, free | K̇",
    ("3.2.21", "3.2.23"): "Liu–Huston, free",
    ("3.2.24", "3.2.37"): "driven",
    ("3.2.38", "3.2.38"): "Wang, driven | K̇",
    ("3.2.39", "3.2.43"): "Liu–Huston, driven",
    ("3.2.44", "3.2.44"): "Liu–Huston, driven | K̇",
    ("4.1.1", "4.1.4"): "testing functions",
    ("4.3.1", "4.3.1"): "sign mistake",
}

LINES = 10887
"""Of the transcript to which "l." refers."""

EQUATION = r"[234]\.\d\.\d+"


def _numbers(first: str, last: str) -> list[str]:
    """The equations from one to another of the same section."""
    section, start = first.rsplit(".", 1)
    other, stop = last.rsplit(".", 1)
    assert section == other, (first, last)
    return [f"{section}.{k}" for k in range(int(start), int(stop) + 1)]


SUBJECTS = {n: words.split(" | ") for span, words in SOURCE.items() for n in _numbers(*span)}


def _equations(text: str) -> list[str]:
    """The equations that a text names, (2.5.1) or (2.5.1)–(2.5.3), those between included."""
    named: list[str] = []
    span = rf"\(({EQUATION})\)(?:\s*[–-]\s*\(({EQUATION})\))?"
    for first, last in re.findall(span, text):
        named += _numbers(first, last or first)
    return named


def _rows() -> list[tuple[str, list[str], list[str]]]:
    text = (ROOT / "docs" / "data" / "thesis" / "source.csv").read_text("utf-8")
    return [
        (what.replace("\\*", "*"), re.findall(r"`([^`]+)`", code), re.findall(r"`([^`]+)`", test))
        for what, code, test in list(csv.reader(text.splitlines()))[1:]
    ]


ROWS = _rows()


def _named(path: str) -> Any:
    """The object of a dotted name: a module, and attributes of it."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            value: Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            value = getattr(value, part)
        return value
    raise AssertionError(f"no module for {path}")


def test_the_table_is_read() -> None:
    assert len(ROWS) >= 20
    for equation, functions, tests in ROWS:
        assert equation and functions and tests, equation


@pytest.mark.parametrize("row", ROWS, ids=[row[0][:40] for row in ROWS])
def test_functions_and_tests_exist(row: tuple[str, list[str], list[str]]) -> None:
    _, functions, tests = row
    for function in functions:
        assert _named(function) is not None
    for test in tests:
        path, _, name = test.partition("::")
        source = (ROOT / path).read_text("utf-8")
        assert re.search(rf"^def {name}\(", source, re.MULTILINE), test


def test_equations_are_those_of_their_subject() -> None:
    named: set[str] = set()
    for text, _, _ in ROWS:
        for number in _equations(text):
            assert number in SUBJECTS, f"the thesis has no equation ({number}): {text}"
            assert any(w in text for w in SUBJECTS[number]), (number, SUBJECTS[number], text)
            named.add(number)
        assert _equations(text) or re.search(r"l\. \d|\(ours\)", text), f"no source: {text}"
    assert named == set(SUBJECTS)


def test_a_wrong_number_would_be_noticed() -> None:
    """The rows that this table once had, written without the source."""
    for text in (
        "constraints, J v + f_t = 0, A v + b = 0, J R = 0 (2.5.11)–(2.5.30)",
        "Newton–Euler and Kane's equations with multipliers (2.5.31)–(2.5.44)",
        "Kane–Levinson 1990 (2.5.49)–(2.5.50)",
        "driving torque (3.2.12)–(3.2.25)",
        "Wang (2.5.72)",
    ):
        wrong = [n for n in _equations(text) if not any(w in text for w in SUBJECTS.get(n, ()))]
        assert wrong, text


DOCUMENTS = [
    *(ROOT / "docs" / f"{name}.md" for name in ("thesis", "matrices", "derivation")),
    ROOT / "NOTATION.md",
    *sorted((ROOT / "benchmarks" / "thesis").rglob("*.*")),
    *sorted((ROOT / "src" / "deltac" / "problems").glob("*.py")),
]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_equation_and_line_exists(path: Path) -> None:
    if path.suffix not in (".md", ".py", ".toml"):
        return
    text = path.read_text("utf-8")
    for number in re.findall(rf"(?<![\d.])({EQUATION})(?![\d.]*\d)", text):
        assert number in SUBJECTS, f"{path.name}: the thesis has no equation ({number})"
    _equations(text)  # spans stay within their sections
    for first, last in re.findall(r"\bl\. (\d+)(?:–(\d+))?", text):
        assert 1 <= int(first) <= int(last or first) <= LINES, f"{path.name}: l. {first}"


def test_symbols_of_the_matrices_carry_their_equations() -> None:
    """The table of docs/matrices.md, docs/data/thesis/matrices.csv: the same subjects."""
    text = (
        (ROOT / "docs" / "data" / "thesis" / "matrices.csv").read_text("utf-8").replace("\\*", "*")
    )
    rows = [line for line in text.splitlines() if _equations(line)]
    assert len(rows) >= 12
    for row in rows:
        for number in _equations(row):
            assert any(w in row for w in SUBJECTS[number]), (number, row)


def test_statements_carry_their_lines() -> None:
    from thesis.experiments import EVERYTHING

    for claim in (claim for experiment in EVERYTHING for claim in experiment.claims):
        assert bool(claim.source) == (claim.thesis is not None), claim
        assert not claim.source or re.match(rf"l\. \d+|\({EQUATION}\)", claim.source), claim
