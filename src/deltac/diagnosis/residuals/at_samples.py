"""The equations of motion, and constraints on acceleration level, at rows of a run that has accelerations.

Kane's equations say F_r + F*_r = 0 for every free speed. What is left of them at logged states, accelerations
and forces is a mistake in the model, in a force, or a missing channel; not the integrator's, which only moves
from one state to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, NEGLIGIBLE, SOLVED, Array
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.residuals.at_states import EquationTest, rms
from deltac.diagnosis.residuals.kane import Kane, times
from deltac.diagnosis.residuals.states import some_rows, states_along
from deltac.diagnosis.verdict import Finding
from deltac.energy.terms import LoggedForces
from deltac.trajectories import Trajectory
from deltac.trajectories.rates import derived_error

MOST_SAMPLES = 3000
"""Samples that are looked at, evenly over the log: enough for every statistic that is made of them."""

CLEAR_OF_ROUNDING = 50.0
"""A residual this many times above what digits allow is no rounding: terms are sums of some tens
of products."""


@dataclass(frozen=True, eq=False)
class RunResidual:
    """Residuals of the equations at B rows of a run, for n (own) speeds and c constraint rows.

    Attributes:
        run: the run; `rows` of it; `test` the equations there, with the forces of the run.
        residual: F_r + F*_r (n, B), N or N·m; `rates`: ψ̇ = G u̇ + γ of the constraints (c, B).
        udot: the accelerations of the run (n, B).
        scale: typical size of the terms that are added up, for each speed (n,).
    """

    run: Trajectory
    rows: NDArray[np.intp]
    test: EquationTest
    udot: Array
    residual: Array
    rates: Array
    scale: Array

    @cached_property
    def precision(self) -> tuple[Array, Array]:
        """Residual (n,) that the run's number of digits, or rounding, explains, and rates (c,) likewise.

        And the error of accelerations that were derived from speeds.
        """
        test = self.test
        rounded, moved = _tested(test.kane, within_digits(self.run, self.rows))
        error = np.zeros_like(self.udot)
        if (derived := derived_error(self.run, "udot")) is not None:
            free = np.repeat(derived[test.kane.mechanism.free.u, None], len(self.rows), axis=1)
            error = times(np.abs(np.linalg.pinv(test.point.Y)), free)
        return (
            rms(rounded.residual(moved) - self.residual)
            + rms(times(np.abs(test.M), error))
            + 4.0 * EPS * self.scale,
            rms(rounded.violation(moved) - self.rates) + rms(times(np.abs(test.G), error)),
        )

    @property
    def relative(self) -> Array:
        """Root mean square as a fraction of `scale` (n,); zero where digits or rounding explain it."""
        size = rms(self.residual)
        relative = size / self.scale
        large = relative > SOLVED
        if large.any():  # else it is no matter what digits explain
            large &= size > CLEAR_OF_ROUNDING * self.precision[0]
        return np.where(large, relative, 0.0)

    @property
    def constraints(self) -> dict[str, float]:
        """ψ̇ of each constraint as a share of its terms; 0 where digits or a stabilisation explain it.

        Projections after each step mend what wrong equations do across the constraints: states and energies
        then look right. The accelerations still tell. Kane's equations do not: their multipliers take up
        every error along Gᵀ. Baumgarte asks for ψ̇ = −2αψ − β²φ in place of zero, and soft constraints
        likewise. Their α and β are not known, but at a step h they are `STIFFEST`/h at most.
        """
        test = self.test
        if not len(test.gamma):
            return {}
        G = np.abs(test.G)
        scale = rms(np.abs(test.gamma) + times(G, np.abs(self.udot)))
        scale = scale + rms(times(G, np.abs(test.states.u))) / float(np.ptp(self.run.t))
        # What a row has no terms of, such as the height of a ball on a table, has no size of its own.
        scale = np.maximum(scale, SOLVED * scale.max())
        decay = STIFFEST / (self.run.provenance.step or float(np.median(np.diff(self.run.t))))
        restoring = 2.0 * decay * np.abs(test.terms.psi) + decay**2 * np.abs(test.terms.phi)
        size = rms(self.rates)
        large = size > np.maximum(SOLVED * scale, rms(restoring))
        if large.any():
            explained = CLEAR_OF_ROUNDING * (self.precision[1] + 4.0 * EPS * scale) + rms(restoring)
            large &= size > explained
        shares = np.where(large, size / scale, 0.0)
        names = test.kane.rows.names
        return {n: float(max(s for s, m in zip(shares, names) if m == n)) for n in names}

    @property
    def largest(self) -> float:
        """The largest relative residual, of equations and constraints."""
        return max(float(self.relative.max(initial=0.0)), *self.constraints.values(), 0.0)


STIFFEST = 3.0
"""Largest decay rate, or spectral radius, times the step: explicit methods are unstable beyond it."""


def run_residual(kane: Kane, run: Trajectory) -> RunResidual:
    """The residual of a run with u̇ at (at most `MOST_SAMPLES`) of its rows.

    Raises InputError for own coordinates whose inverse is not known.
    """
    rows = some_rows(run, MOST_SAMPLES)
    test, udot = _tested(kane, run.take(rows))
    residual, rates = test.residual(udot), test.violation(udot)
    return RunResidual(run, rows, test, udot, residual, rates, test.typical(udot))


def _tested(kane: Kane, run: Trajectory) -> tuple[EquationTest, Array]:
    """The equations at all rows of a run, with its forces in place of the model's; and its own u̇ (n, B)."""
    assert run.udot is not None
    free = kane.mechanism.free.u
    forces = {name: force[:, free].T for name, force in run.forces.items()}
    states = states_along(kane, run, np.arange(len(run)))
    test = EquationTest(kane, states, strict=False, forces=forces)
    udot = run.udot[:, free].T - test.point.rest
    if kane.own is not None:  # else own speeds are the mechanism's
        udot = times(np.asarray(np.linalg.pinv(test.point.Y), dtype=float), udot)
    return test, udot


def within_digits(run: Trajectory, rows: NDArray[np.intp]) -> Trajectory:
    """Rows of a run, every number moved at random by up to half its last digit."""
    rng, digits, some = np.random.default_rng(0), digits_of(run), run.take(rows)
    places = LoggedForces.of(run).places

    def moved(values: Array, name: str, columns: Sequence[int] | slice = slice(None)) -> Array:
        half, other = digits[name].half(rows), np.array(values)
        other[:, columns] += rng.uniform(-1.0, 1.0, half.shape) * half
        return other

    return replace(
        some,
        q=moved(some.q, "q"),
        u=moved(some.u, "u"),
        udot=None if some.udot is None else moved(some.udot, "udot"),
        forces={n: moved(f, f"force {n}", places[n]) for n, f in some.forces.items()},
    )


def stale_stage(original: RunResidual) -> list[Finding]:
    """Forces or accelerations that belong to the row before: then shifting them closes the equations."""
    run = original.run
    inner = original.rows < len(run) - 1
    rows = original.rows[inner]
    if not original.relative.any() or len(rows) < 4:
        return []
    current, after = run.take(rows), run.take(rows + 1)

    def size(residual: Array) -> float:
        return float(np.sqrt(np.mean((residual / original.scale[:, None]) ** 2)))

    # Of the same rows: where a motion runs away, the last one alone outweighs all others.
    unshifted = size(original.residual[:, inner])
    for what, shifted in (
        ("forces", {"forces": after.forces}),
        ("accelerations", {"udot": after.udot}),
        ("forces and accelerations", {"forces": after.forces, "udot": after.udot}),
    ):
        test, udot = _tested(original.test.kane, replace(current, **shifted))
        remainder = size(test.residual(udot))
        if remainder < NEGLIGIBLE * unshifted:
            return [
                Finding(
                    "stale-stage",
                    f"the log's {what} are one row old: each belongs to the state of the row before",
                    f"shifted by one row, they leave {remainder / unshifted:.2g} of the equations' residual",
                    "Log them with the state that they belong to: after a step most engines hold new "
                    "positions beside old forces. deltac.record_mujoco takes care of that",
                    "doubt",
                    what,
                )
            ]
    return []
