"""Every problem of the library against its own invariants and references: tested by being listed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from deltac import assemble, balance, problems, simulate
from deltac.energy import TESTING_FUNCTIONS, Ledger
from deltac.mechanism.contact import Contact
from deltac.mechanism.friction import PointFriction
from deltac.problems import Problem
from deltac.references import solved
from deltac.trajectories import Trajectory

#: every problem, and variants that have references of their own or show more
CASES: dict[str, tuple[str, dict[str, Any]]] = {name: (name, {}) for name in problems.names()} | {
    "triple-pendulum, fig. 4.3": ("triple-pendulum", {"rates": (10.0, 0.0, 0.0)}),
    "triple-pendulum, damped": ("triple-pendulum", {"damping": 1e-3}),
    "ball-on-table, the table a body": ("ball-on-table", {"table": "body"}),
    "ball-on-rising-table, the table a body": ("ball-on-rising-table", {"table": "body"}),
    "disc-on-moving-plane, upright": ("disc-on-moving-plane", {"lean": 0.0}),
    "bicycle, tipped over hard": ("bicycle", {"speed": 4.6, "nudge": 0.5}),
    "bouncing-ball, from 3 m": ("bouncing-ball", {"height": 3.0}),
    "ball-on-compliant-floor, Hertz": ("ball-on-compliant-floor", {"exponent": 1.5}),
}

# Halving the step shows the error of a run: by the order p at least (1 − 2⁻ᵖ) of it is gone. Where
# only rounding is left, both runs are off by a like amount, hence the margin.
MARGIN = 10.0
ROUNDING = 1e-12  # 10⁴ steps that are each right to machine precision, relative


class Case(NamedTuple):
    problem: Problem
    run: Trajectory  # at the problem's own step
    fine: Trajectory  # at half of it; of an adaptive solver, at a hundredth of the tolerance too
    ledger: Ledger


@cache
def case_of(case: str) -> Case:
    name, options = CASES[case]
    p = problems.load(name, **options)
    # Kane and Levinson's form of 1988 is for independent coordinates alone.
    tied = bool(p.mechanism.constraints)
    functions = [name for name in TESTING_FUNCTIONS if not (tied and name == "kane-levinson-1988")]
    # Forces that come and go between two samples are integrated in the loop.
    abrupt = any(isinstance(e, Contact | PointFriction) for e in p.mechanism.elements)
    run = solved(p, testing=functions if abrupt else ())
    fine = solved(p, finer=True)
    work = "in-loop" if abrupt else "samples"
    ledger = balance(p.mechanism, run, work=work, testing=functions, coordinates=p.coordinates)
    return Case(p, run, fine, ledger)


#: variants that test again what another case does, by other means
SLOW = ("the table a body", "tipped over hard", "Hertz", "upright")


LIKE_OTHERS = (
    *("ball-on-rising-table", "bicycle", "tumbling-box", "disc-on-moving-plane"),
    *("block-on-incline", "struck-slider-crank", "torque-free-box"),
)
"""Problems whose class another fast case shows, and whose motion takes long."""


LONG = ("andrews-squeezer", "ball-on-table", "bricard", "rolling-disc", "stiff-governor")
"""Problems whose motion takes seconds, and which no other case is like."""


def cases(slow: tuple[str, ...], long: tuple[str, ...] = ()) -> pytest.MarkDecorator:
    """Every case; those that end like one of `slow` are slow, those of `long` long."""

    def marks(case: str) -> list[pytest.MarkDecorator]:
        if case.endswith(slow):
            return [pytest.mark.slow]
        return [pytest.mark.long] if case in long else []

    return pytest.mark.parametrize("case", [pytest.param(c, marks=marks(c)) for c in CASES])


every_case, every_motion = cases(SLOW), cases((*SLOW, *LIKE_OTHERS), LONG)


@every_case
def test_it_says_what_it_is(case: str) -> None:
    name, options = CASES[case]
    problem = problems.load(name, **options)
    assert problem.name == name
    assert problem.title and problem.source
    assert problem.mechanism.state(problem.state.q, problem.state.u, problem.state.t) is not None
    if not options:
        assert problem.reference, "a problem of the library brings numbers that must come out"
    quantities = [reference.quantity for reference in problem.reference]
    assert len(set(quantities)) == len(quantities)


@every_case
def test_its_degrees_of_freedom(case: str) -> None:
    name, options = CASES[case]
    problem = problems.load(name, **options)
    found = assemble(problem.mechanism, problem.state)
    assert found.freedom == problem.freedom
    assert found.residual <= ROUNDING, "the start is consistent as it stands"


@every_motion
def test_invariants_stay_constant(case: str) -> None:
    problem, run, fine, _ = case_of(case)
    assert problem.conserved == tuple(problem.invariants)
    for name, invariant in problem.invariants.items():
        values, refined = invariant(run), invariant(fine)[::2]
        scale = max(1.0, float(np.abs(values).max()))
        error = float(np.abs(values - refined).max())
        assert error <= 1e-7 * scale, f"{name}: the step does not resolve it"
        drift = float(np.abs(values - values[0]).max())
        assert drift <= MARGIN * error + ROUNDING * scale, name


@every_motion
def test_references_are_met(case: str) -> None:
    problem, run, fine, _ = case_of(case)
    for reference in problem.reference:
        value, refined = reference.measure(run), reference.measure(fine)
        scale = max(1.0, abs(reference.value))
        error = abs(value - refined)
        assert error <= reference.accuracy + 1e-7 * scale, f"{reference.quantity}: not resolved"
        tolerance = reference.accuracy + MARGIN * error + ROUNDING * scale
        assert abs(value - reference.value) <= tolerance, reference.quantity


@every_motion
def test_the_energy_theorem_closes(case: str) -> None:
    problem, _, _, ledger = case_of(case)
    proper = set(ledger.delta_c)
    if problem.coordinates is not None:
        proper -= {"kane-levinson-1988"}
    assert {"wang", "liu-huston", "kane-levinson-1990"} <= proper
    rounding = ROUNDING * sum(np.abs(part).max() for part in (ledger.K2, ledger.K1, ledger.K0))
    for name in proper:
        # ode5 at the thesis's step leaves some 1e-10 of the energy exchanged; ode8 rounding.
        tolerance = 1e-9 * ledger.energy_exchanged + ledger.error_bar[name] + rounding
        assert (np.abs(ledger.delta_c[name]) <= tolerance).all(), name


@every_motion
def test_energy_alone_is_conserved_only_where_the_problem_says_so(case: str) -> None:
    problem, run, _, ledger = case_of(case)
    energy = ledger.kinetic + ledger.potential_energy
    size = float(np.abs(ledger.kinetic).max() + np.abs(ledger.potential_energy).max())
    # What hardly moves, or moves steadily, has only rounding to show.
    change = (
        float(np.ptp(energy)) / ledger.energy_exchanged
        if ledger.energy_exchanged > 1e-9 * size
        else 0.0
    )
    if "energy" in problem.conserved:
        assert change <= 1e-9
        by_hand = problem.invariants["energy"](run)
        np.testing.assert_allclose(by_hand, energy, rtol=0, atol=ROUNDING * size)
    else:
        # Stiff couplers lose a few millionths; three decades lie between that and what is conserved.
        assert change >= 1e-6


@every_motion
def test_hand_written_equations_give_the_same_motion(case: str) -> None:
    problem, run, _, _ = case_of(case)
    if problem.equations is None:
        pytest.skip("the source writes no equations down")
    state, how = problem.state, (problem.duration, problem.step, problem.solver)
    by_hand = simulate(problem.mechanism, state, *how, equations=problem.equations)
    moved = simulate(problem.mechanism, replace(state, u=state.u + ROUNDING), *how)
    # The same solver and step: what differs is rounding, and grows along the motion as at its start.
    assert np.abs(by_hand.q - run.q).max() <= np.abs(moved.q - run.q).max()
