"""A short run of the fuzzer, always the same, and what it once found; `make fuzz SECONDS=600` runs longer."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.__main__ import fuzz
from tests.fuzz.targets import TARGETS, run

REGRESSIONS = sorted((Path(__file__).parent / "regressions").iterdir())


SLOW = ("cli", "h5", "mat", "parquet", "txt", "tsv", "mcap", "bag", "ros2", "table")
"""Targets whose inputs take milliseconds each."""


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_but_input_errors(name: str) -> None:
    counts = fuzz(name, seconds=60.0, seed=1, most=40 if name in SLOW else 300)
    assert "broken" not in counts
    assert counts["InputError"] + counts["read"] > 30


@pytest.mark.parametrize("file", REGRESSIONS, ids=lambda file: file.name)
def test_what_was_found_stays_repaired(file: Path) -> None:
    run(file.name.partition("-")[0], file.read_bytes())
