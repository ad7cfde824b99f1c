"""Kernels do not grow unnoticed, and their size is linear in the mechanism's."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SNAPSHOT = BENCHMARKS / "instructions.json"


@pytest.fixture(scope="module")
def counted() -> dict[str, dict[str, int]]:
    if not BENCHMARKS.exists():
        pytest.skip("the benchmarks are not part of an installed package")
    sys.path.insert(0, str(BENCHMARKS))
    try:
        from counts import counts

        return dict(counts())
    finally:
        sys.path.remove(str(BENCHMARKS))


def test_instruction_counts_are_those_of_the_snapshot(counted: dict[str, dict[str, int]]) -> None:
    """Counts depend on CasADi's simplifications, hence two per cent of play between its versions."""
    kept = json.loads(SNAPSHOT.read_text(encoding="utf-8"))
    assert kept.keys() == counted.keys()
    told = []
    for name, kernels in kept.items():
        for kernel, before in kernels.items():
            now = counted[name][kernel]
            if abs(now - before) > 0.02 * before:
                told.append(f"{name}, {kernel}: {before} instructions before, {now} now")
    assert not told, (
        "\n".join(told) + "\nIf that is meant: python benchmarks/counts.py writes the new counts."
    )


def test_accelerations_cost_the_same_per_degree_of_freedom(
    counted: dict[str, dict[str, int]],
) -> None:
    """Articulated bodies: from 10 to 30 hinges, but for the ends of the chain."""
    each = [counted[f"random chain of {n}"]["accelerations"] / n for n in (10, 30)]
    assert each[1] / each[0] < 1.15
