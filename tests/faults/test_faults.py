"""Published faults: each is found, and what is said of it is what docs/data/faults.csv says.

The same case without the fault is consistent: what is found is the fault.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import deltac as dc

pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from tests.support.slow import repeated  # noqa: E402
from tests.systems import fault_cases as cases  # noqa: E402

pytestmark = pytest.mark.case_study(
    "test_a_right_log_of_coarse_steps_is_an_integration_error",
    "test_equations_with_a_fault_fail_the_check",
    "test_the_missing_lever_arm_does_no_work",
    "test_stale_accelerations_and_stale_energies_do_no_harm",
)

LOGS = (
    cases.missing_lever_arm,
    cases.force_without_its_potential,
    cases.damping_dropped_by_an_importer,
    cases.inertia_made_from_a_shape,
    cases.inertia_axes_lost,
)
EQUATIONS = (cases.wrong_velocity, cases.sign_in_the_thesis)


@cache
def audited(case: Callable[[], cases.LogCase]) -> dc.Audit:
    """The audit of the faulty log, whose explanation is that of `explain_residual`."""
    given = case()
    return dc.audit(given.model, given.log)


def explained(case: Callable[[], cases.LogCase]) -> dc.Explanation:
    explanation = audited(case).explanation
    assert explanation is not None
    return explanation


@pytest.mark.parametrize(
    "case",
    # The others are looked at more closely below.
    repeated(LOGS, cases.force_without_its_potential, cases.damping_dropped_by_an_importer),
    ids=lambda case: case.__name__,
)
def test_logs_with_a_fault_are_equation_errors(case: Callable[[], cases.LogCase]) -> None:
    given = case()
    assert dc.audit(given.model, given.right).verdict.kind == "consistent"
    found = audited(case)
    assert (found.verdict.kind, found.exit_code) == ("equation-error", 1), found.verdict.explain()


def test_a_right_log_of_coarse_steps_is_an_integration_error() -> None:
    """Symplectic Euler with ω h = 0.0086 leaves 0.2 % of the energy that the stick has, above 0.1 %."""
    given = cases.solver_residual_integrated()
    found = dc.audit(given.model, given.right)
    assert found.inference is not None and found.inference.methods  # whose map closes the rows
    assert found.verdict.kind == "integration-error"
    assert 1e-3 < found.relative < 0.0043  # ω h/2 at most


def test_an_integrated_solver_residual_is_not_excused() -> None:
    """Its accelerations are differences of its speeds; what is left looks like their noise, and is none."""
    found = audited(cases.solver_residual_integrated)
    assert (found.verdict.kind, found.exit_code) == ("unresolved", 3), found.verdict.explain()
    assert found.relative > 0.05


@pytest.mark.parametrize("case", EQUATIONS, ids=lambda case: case.__name__)
def test_equations_with_a_fault_fail_the_check(case: Callable[[], cases.EquationsCase]) -> None:
    given = case()
    for rhs, kind in ((given.right, "consistent"), (given.wrong, "equation-error")):
        check = dc.check_equations(given.mechanism, rhs, coordinates=given.coordinates)
        assert check.verdict.kind == kind


def test_the_missing_lever_arm_does_no_work() -> None:
    """Isotropic D: the power −ω·(D (ω × l)) vanishes, so the damper of the faulty run damps nothing."""
    given = cases.missing_lever_arm()
    bare = replace(given.model, forces=())
    assert dc.balance(bare, given.log).work.keys() == {"gravity"}
    energy = dc.balance(bare, given.log)
    total = energy.kinetic + energy.potential_energy
    assert np.ptp(total) < 1e-9 * energy.energy_exchanged  # order 5 at 2 ms
    right = dc.balance(bare, given.right)
    assert (right.kinetic + right.potential_energy)[-1] < total[-1] - 0.05 * right.energy_exchanged


def test_an_anisotropic_drag_without_lever_arm_adds_energy() -> None:
    given = cases.missing_lever_arm((0.4, 4.0, 0.4))
    ledger = dc.balance(replace(given.model, forces=()), given.log)
    total = ledger.kinetic + ledger.potential_energy
    assert total.max() > total[0] + 0.01 * ledger.energy_exchanged


def test_dropped_damping_is_named_joint_by_joint() -> None:
    found = explained(cases.damping_dropped_by_an_importer)
    assert found.kind == "explained"
    assert {(c.kind, c.element): c.model[0] for c in found.causes} == pytest.approx(
        {("damping", "shoulder"): 0.2, ("damping", "elbow"): 0.131}
    )
    assert [c.values[0] for c in found.causes] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_an_inertia_made_from_a_shape_is_named() -> None:
    given = cases.inertia_made_from_a_shape()
    (cause,) = dc.explain_residual(given.model, given.log).causes
    assert (cause.kind, cause.element) == ("body-moments", "forearm")
    assert cause.values[0] == pytest.approx(1.4, rel=1e-6)


def test_lost_axes_of_inertia_are_named_with_both_tensors() -> None:
    given = cases.inertia_axes_lost()
    (cause,) = dc.explain_residual(given.model, given.log).causes
    assert cause.kind == "body-tensor"
    assert cause.values == pytest.approx((0.1, 0.2, 0.25, 0, 0, 0), abs=1e-6)
    assert cause.model == pytest.approx((0.2, 0.1, 0.25, 0, 0, 0), abs=1e-6)


def test_what_no_cause_explains_is_not_explained_away() -> None:
    given = cases.missing_lever_arm()
    assert dc.explain_residual(given.model, given.log).kind == "unexplained"
    assert explained(cases.force_without_its_potential).kind == "unexplained"
    # White forces, which add up over windows as noise on speeds does not: something is left.
    found = explained(cases.solver_residual_integrated)
    assert found.kind == "unexplained" and found.residual > 10.0 * found.noise


def test_the_wrong_velocity_is_a_factor_on_gravity() -> None:
    given = cases.wrong_velocity()
    check = dc.check_equations(given.mechanism, given.wrong)
    # (m (R + r)² + I) / (m R² + I) with I = 3.125, R = 2, r = 0.5
    assert "enters with the factor 1.31579" in str(check.blame[0])
    assert pytest.approx(1.31579, rel=1e-5) == (6.25 + 3.125) / (4.0 + 3.125)


def test_the_thesis_mistake_is_named() -> None:
    given = cases.sign_in_the_thesis()
    check = dc.check_equations(given.mechanism, given.wrong, coordinates=given.coordinates)
    assert "enters with the wrong sign" in str(check.blame[0])
    assert "equation 2 (theta2)" in str(check.blame[0])


def test_stale_accelerations_and_stale_energies_do_no_harm() -> None:
    """deltac reads no energies from logs: it computes them of each row's own state.

    Euler's accelerations of the row before are the backward difference of the speeds, to rounding. They are
    not asked; the speeds alone show that each step is Euler's, so the equations hold.
    """
    model, log, energy = cases.stale_getters()
    found = dc.audit(model, log)
    assert found.inference is not None and found.inference.methods
    assert found.verdict.kind == "integration-error"
    ours = dc.balance(found.mechanism, log, "samples").kinetic
    assert np.allclose(energy[1:], ours[:-1], rtol=1e-9)  # MuJoCo's are one row late
    assert np.abs(energy - ours).max() > 1e-3 * ours.max()
