"""From the runs of a study to what it found: compare them, see what converges, look around, judge."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.checks import assumed_zero, assumed_zero_finding
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.models import Model
from deltac.diagnosis.resolution import EPS
from deltac.diagnosis.study import noticed
from deltac.diagnosis.study.comparable import disagreements
from deltac.diagnosis.study.convergence import Convergence, between_runs, towards_zero
from deltac.diagnosis.study.curves import FEWEST, Comparison, compare
from deltac.diagnosis.study.measures import StudyMeasures
from deltac.diagnosis.study.residuals import residuals_of
from deltac.diagnosis.study.result import Study
from deltac.diagnosis.study.rules import judge_study
from deltac.diagnosis.study.runs import StudyRun, unblinded
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.equations import Equations
from deltac.trajectories import Trajectory

Array: TypeAlias = NDArray[np.float64]

NOISE = 1e-10
"""Share of the turnover below which a ΔC that does not fall is what equations solved by iteration leave."""


def studied(
    loaded: Model,
    runs: tuple[StudyRun, ...],
    solver: str,
    nominal: int | None,
    equations: Equations | None,
    findings: list[Finding],
    tolerance: float,
    *,
    own_solver: bool,
    unit: str,
) -> Study:
    """From runs to the study: compare, fit, look around, judge."""
    mechanism = loaded.mechanism
    runs = unblinded(runs)
    places, found = disagreements(mechanism, runs)
    findings = [*findings, *found]
    kept = [runs[k] for k in places]
    motions = [_run(entry) for entry in kept]
    compared = compare(mechanism, motions)
    findings += noticed.of_comparison(compared, kept)
    function = _function(kept)
    steps = np.array([entry.step for entry in kept])
    first = _first_together(compared)
    functions = [n for n in kept[-1].left_over or {} if all(n in (e.left_over or {}) for e in kept)]
    turnover = kept[-1].ledger.energy_exchanged if kept[-1].ledger else 0.0
    energy = {n: _kept(_energy(kept, compared, first, steps, n), turnover) for n in functions}
    over_all = _over_all(kept, compared, first)
    state = _state(compared, first, steps, motions)
    momentum = _momentum(mechanism, kept, compared, first, steps)
    trusted = own_solver and equations is None
    if trusted and kept[-1].blown_up:  # what is left before that is no motion to have an order
        energy, state = {n: _none(c) for n, c in energy.items()}, _none(state)
    residuals = None
    if not trusted:
        by_step = [(entry.step, _run(entry)) for entry in kept]
        own = equations.coordinates if equations is not None else None
        residuals = residuals_of(
            mechanism, by_step, own, until=compared.horizon, trusted=own_solver
        )
    finest = kept[-1]
    ledger = finest.ledger
    assert ledger is not None
    left = tuple(_largest(entry.left_over, function) for entry in kept)
    bars = tuple(_largest(entry.bar, function) for entry in kept)
    if residuals is not None:
        findings += residuals.findings
        if residuals.stays and max(residuals.by_step) > tolerance:
            findings.append(residuals.finding())
    if not own_solver:
        missing = assumed_zero(motions[-1], loaded.import_report)
        findings += assumed_zero_finding(missing)
        findings += noticed.of_impacts(mechanism, motions[-1])
    findings += noticed.of_order(state, energy, nominal, solver)
    findings += noticed.of_growth(finest, function, ledger, solver, bars[-1])
    findings += noticed.of_corrections(ledger, function, tolerance * ledger.energy_exchanged)
    findings += noticed.of_constraints(kept, compared, tolerance, trusted=trusted)
    findings += noticed.of_momentum(momentum, ledger)
    ranked = sorted(findings, key=lambda f: ("cause", "doubt", "note").index(f.weight))
    measures = StudyMeasures(
        steps=tuple(map(float, steps)),
        left=left,
        bars=bars,
        turnover=ledger.energy_exchanged,
        scale=float(ledger.kinetic.max() + np.abs(ledger.potential_energy).max())
        + ledger.energy_exchanged,
        kinetic=float(ledger.kinetic.max()),
        energy=energy[function],
        state=state,
        momentum=momentum,
        residuals=residuals,
        trusted=trusted,
        nominal=nominal,
        tolerance=tolerance,
        quadrature=ledger.method != "in-loop",
        unit=unit,
        constrained=bool(mechanism.constraints),
        blown_up=finest.blown_up,
        until=None if over_all or compared.horizon >= compared.t[-1] else compared.horizon,
        findings=tuple(ranked),
    )
    return Study(
        mechanism=mechanism,
        solver=solver,
        nominal=nominal,
        runs=runs,
        observed_order={**energy, "state": state},
        momentum=momentum,
        residuals=residuals,
        comparison=compared,
        function=function,
        measures=measures,
        verdict=judge_study(measures),
        tolerance=tolerance,
    )


# --- measures -------------------------------------------------------------------------------------


def _first_together(compared: Comparison) -> int:
    """The coarsest run from which on all stay together up to the horizon."""
    first = len(compared.rows) - 1
    while first > 0 and compared.together[first - 1] >= compared.horizon:
        first -= 1
    return first


def _energy(
    kept: Sequence[StudyRun], compared: Comparison, first: int, steps: Array, name: str
) -> Convergence:
    """How ΔC of a function converges within the horizon; over all of the time where that is no time."""
    curves = [(entry.left_over or {})[name] for entry in kept]
    bars = [(entry.bar or {})[name] for entry in kept]
    within = compared.within
    if _over_all(kept, compared, first):
        y = np.array([[float(np.abs(c).max())] for c in curves])
        return towards_zero(steps, y, np.array([float(b.max()) for b in bars]))
    y = compared.sampled(curves)[first:, :within]
    floors = compared.sampled(bars)[first:, :within].max(axis=1)
    return towards_zero(steps[first:], y, floors)


def _over_all(kept: Sequence[StudyRun], compared: Comparison, first: int) -> bool:
    """Whether maxima of all of the time are all there is to compare."""
    return compared.within < FEWEST or first > len(kept) - 2


def _kept(found: Convergence, scale: float) -> Convergence:
    """Without an order where energy is kept at every step: what is left is the noise of the solver."""
    if found.trend == "does not settle" and max(found.sizes) <= NOISE * scale:
        return replace(found, trend="at its floor", order=None, order_error=None, end_order=None)
    return found


def _none(found: Convergence) -> Convergence:
    """The same without an order."""
    return replace(
        found, trend="does not settle", order=None, order_error=None, end_order=None, steps=()
    )


def _state(
    compared: Comparison, first: int, steps: Array, motions: Sequence[Trajectory]
) -> Convergence:
    within = compared.closely
    if within < min(FEWEST, len(compared.t)) or within < 2:
        return Convergence("does not settle" if len(steps) > 1 else "one run")
    states = compared.states[first:, 1:within]
    floors = np.array([8.0 * EPS * math.sqrt(len(run)) for run in motions])[first:]
    return between_runs(steps[first:], states, floors * max(1.0, float(np.abs(states).max())))


def _momentum(
    mechanism: Mechanism, kept: Sequence[StudyRun], compared: Comparison, first: int, steps: Array
) -> dict[str, Convergence]:
    within = compared.within
    if mechanism.constraints:  # whose reactions these balances leave out
        return {}
    ledgers = [entry.ledger for entry in kept if entry.ledger is not None]
    if within < FEWEST or first > len(kept) - 2:
        return {}
    found = {}
    for name in ledgers[-1].momentum:
        curves = [ledger.momentum[name] for ledger in ledgers]
        bars = [(entry.momentum_bar or {})[name] for entry in kept]
        y = compared.sampled(curves)[first:, :within]
        floors = compared.sampled(bars)[first:, :within].max(axis=1)
        found[name] = towards_zero(steps[first:], y, floors)
    return found


def _largest(curves: Mapping[str, Array] | None, name: str) -> float:
    assert curves is not None
    return float(np.abs(curves[name]).max())


def _function(kept: Sequence[StudyRun]) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    names = kept[-1].left_over or {}
    return next(
        (n for n in ("wang", "liu-huston", "kane-levinson-1990") if n in names), next(iter(names))
    )


def _run(entry: StudyRun) -> Trajectory:
    assert entry.run is not None
    return entry.run
