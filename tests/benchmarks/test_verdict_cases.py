"""The verdict's bench draws cases of every kind."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(autouse=True)
def benchmarks() -> Iterator[None]:
    if not BENCHMARKS.exists():
        pytest.skip("the benchmarks are not part of an installed package")
    sys.path.insert(0, str(BENCHMARKS))
    yield
    sys.path.remove(str(BENCHMARKS))


def test_every_hand_written_case_has_a_motion() -> None:
    import equations
    from verdict_wrong import start_of

    for case in equations.CASES:
        mechanism, _ = equations.load(case)
        state, duration, step = start_of(case, mechanism)
        assert len(state.q) == len(mechanism.coordinates)
        assert duration > step > 0


def test_every_group_has_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_EVALUATOR", "casadi")
    from verdict_cases import all_cases

    for group, cases in all_cases(seed=1, scale=0.02):
        if "MuJoCo" in group:
            pytest.importorskip("mujoco")
        case = next(cases())
        assert case.group == group
        assert case.right == group.startswith("right")
