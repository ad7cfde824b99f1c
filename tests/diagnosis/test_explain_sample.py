"""A small sample of the benchmark of explanations: its faults are named rightly, with honest errors."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import deltac as dc

pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from explain import covered, outcome  # noqa: E402
from explain_models import faults, model_of, noisy, simulate  # noqa: E402

SAMPLE = (
    "planar-arm armature elbow",
    "cart-pole mass pole",
    "arm-3d gear actuator m4",
    "arm-3d com fore",
    "floating spring flap",
    "ball-chain inertia second",
)


@pytest.mark.parametrize("label", SAMPLE)
def test_a_fault_of_the_benchmark(label: str) -> None:
    (fault,) = (f for f in faults() if f"{f.model} {f.name} {f.element}" == label)
    run = simulate(fault, fault.model, duration=1.0)
    exact = dc.explain_residual(model_of(fault.model), run)
    assert outcome(fault, exact) == "right", str(exact)
    assert covered(fault, exact) is not False
    rough = dc.explain_residual(model_of(fault.model), noisy(run, 1e-6, 1))
    assert outcome(fault, rough) == "right", str(rough)


def test_there_are_faults_enough() -> None:
    names = [(f.model, f.name, f.element) for f in faults()]
    assert len(names) == len(set(names)) >= 60
    assert len({name for _, name, _ in names}) == 9
