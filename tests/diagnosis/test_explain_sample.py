"""A small sample of the benchmark of explanations: its faults are named rightly, with honest errors."""

from __future__ import annotations

import pytest

import deltac as dc

pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from explain import covered, outcome  # noqa: E402
from explain_models import faults, model_of, noisy, simulate  # noqa: E402

SAMPLE = (
    pytest.param("planar-arm armature elbow", marks=pytest.mark.slow),
    pytest.param("cart-pole mass pole", marks=pytest.mark.slow),
    pytest.param("arm-3d gear actuator m4", marks=pytest.mark.slow),
    pytest.param("arm-3d com fore", marks=pytest.mark.slow),
    pytest.param("floating spring flap", marks=pytest.mark.slow),
    "ball-chain inertia second",
    pytest.param("planar-arm mass+com lower", marks=pytest.mark.slow),
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
    assert len({name for _, name, _ in names}) == 10


@pytest.mark.slow
def test_a_humanoid_without_dampers_and_with_another_shin() -> None:
    """Twenty-two causes at once, each to a millionth: 27 degrees of freedom tell them apart."""
    import humanoid
    import mujoco

    right, wrong = (mujoco.MjModel.from_xml_string(humanoid.mjcf()) for _ in range(2))
    wrong.dof_damping[:] = 0.0
    wrong.body("shin_r").mass *= 1.05
    data = mujoco.MjData(right)
    data.qvel[:] = 0.3
    run = dc.run_mujoco(right, 0.5, data=data, integrator="rk4")
    found = dc.explain_residual(wrong, run)
    values = {(c.kind, c.element): c.values[0] for c in found.causes}
    assert values.pop(("body-mass", "shin_r")) == pytest.approx(1.0 / 1.05, rel=1e-6)
    assert len(values) == 21 and {kind for kind, _ in values} == {"missing-damper"}
    assert list(values.values()) == pytest.approx([2.0] * 21, rel=1e-6)
