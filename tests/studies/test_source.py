"""The table in docs/thesis.md from the source to the code: what it names is there."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


def _rows() -> list[tuple[str, list[str], list[str]]]:
    text = (ROOT / "docs" / "thesis.md").read_text("utf-8")
    table = text.split("## From the source to the code")[1].split("## ")[0]
    found = []
    for line in table.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 3 and "`" in cells[1]:
            names = [re.findall(r"`([^`]+)`", cell) for cell in cells[1:]]
            found.append((cells[0], *names))
    return found


ROWS = _rows()


def _named(path: str) -> Any:
    """The object of a dotted name: a module, and attributes of it."""
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return found
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
