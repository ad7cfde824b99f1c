"""What the testing functions of a run say of its own steps, once it has ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deltac.arrays import EPS, PHYSICAL, ROUGHLY, Array, max_norm
from deltac.errors import warn_user
from deltac.mechanism.channels import BOOKED
from deltac.simulation.flow import StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.step_size.stiffness import fastest_rate, longest_step
from deltac.simulation.stepping.protocol import Motion
from deltac.trajectories import Provenance

ACCURATE = 1e-3
"""The energy error that a recommended step aims at."""


class EnergyErrorWarning(UserWarning):
    """A run's own testing functions refute it: |ΔC| exceeds a tenth of the energy that took part."""


@dataclass(frozen=True, eq=False)
class EnergyError:
    """Energy error of a run by its own testing functions; what is of single rows is computed when asked for.

    Attributes:
        delta_c: (T, n) ΔC of the exact testing functions, J.
        corrected: (T,) what corrections did to the energy, J; None without any.
        kinetic, potential: (T,) K and V, J.
        works: (T, m) works of the channels without a potential, J.
    """

    delta_c: Array
    corrected: Array | None
    kinetic: Array
    potential: Array
    works: Array

    @cached_property
    def total(self) -> float:
        """The energy that took part, J: the largest K, the range of V, and what those channels moved."""
        flow = float(np.abs(np.diff(self.works, axis=0)).sum())
        return flow + float(self.kinetic.max() + self.potential.max() - self.potential.min())

    @cached_property
    def largest(self) -> float:
        """The largest |ΔC|, with what corrections did besides, J; zero where it is rounding."""
        return float(self.error.max())

    @cached_property
    def error(self) -> Array:
        """The same row by row (T,), J."""
        size = np.abs(self.delta_c).max(axis=1)
        if self.corrected is not None:
            size = size + np.abs(self.corrected)
        rounding = EPS * len(self.kinetic) * (self.total + max_norm(self.potential))
        return np.where(size > rounding, size, 0.0)

    @cached_property
    def scale(self) -> Array:
        """The energy that took part up to each row (T,), J."""
        flow = np.cumsum(np.abs(np.diff(self.works, axis=0)).sum(axis=1))
        highest, lowest = (f.accumulate(self.potential) for f in (np.maximum, np.minimum))
        return np.asarray(
            np.maximum.accumulate(self.kinetic) + np.append(0.0, flow) + highest - lowest
        )

    @property
    def relative(self) -> float:
        """The largest error as a fraction of the energy that took part."""
        return self.largest / self.total if self.total > 0.0 else 0.0


def energy_error(
    flow: StateFlow, columns: Mapping[str, Array], motion: Motion
) -> EnergyError | None:
    """The energy error of a run.

    Args:
        flow: what was integrated.
        columns: what was observed at the rows: of each testing function E, then K and V, "energies".
        motion: the rows.

    Returns:
        None where no testing function was recorded that must close (the form of 1988 need not), or where
        nothing is finite.
    """
    exact = [k for k, name in enumerate(flow.testing) if name != "kane-levinson-1988"]
    if not exact:
        return None
    x = motion.x
    energies = columns["energies"][: len(x)].reshape(len(x), -1)
    # NaN compares as false.
    if not (x.max() < PHYSICAL and x.min() > -PHYSICAL and np.isfinite(energies.sum())):
        good = np.isfinite(energies).all(axis=1) & (np.abs(x) < PHYSICAL).all(axis=1)
        rows = len(x) if good.all() else int(np.argmin(good))
        if not rows:
            return None
        x, energies = x[:rows], energies[:rows]
    sums = x[:, flow.parts[2]] - x[0, flow.parts[2]]
    works, integrals = sums[:, : len(flow.works)], sums[:, len(flow.works) :]
    booked = [flow.integrals.index(name) for name in BOOKED if name in flow.integrals]
    return EnergyError(
        energies[:, exact] - energies[0, exact] - integrals[:, exact],
        integrals[:, booked].sum(axis=1) if booked else None,
        energies[:, -2],
        energies[:, -1],
        works,
    )


def refuted(
    flow: StateFlow, solver: Solver, error: EnergyError, motion: Motion, p: Array, run: Provenance
) -> Motion:
    """A motion that its testing functions refute: warns `EnergyErrorWarning` with the step that would do.

    Of one that was stopped, the message says so, beside why it was.
    """
    if not error.relative > ROUGHLY:
        return motion
    if motion.message:
        doubt = "Do not trust the rows before: |ΔC| exceeds a tenth of the energy that took part"
        return replace(motion, message=f"{motion.message}. {doubt}")
    share = f"{error.relative:.0%} of" if error.relative < 10 else f"{error.relative:.2g} times"
    if run.equations:
        remedy = (
            "The equations by hand are not those of the model, or the step is too large: "
            "deltac.check_equations tells which"
        )
    elif run.step is None:
        tolerance = (run.tolerance or 1.0) * ACCURATE / error.relative
        remedy = f"Take a tolerance of {tolerance:.1g} or less, or fixed steps; deltac.recommend finds both"
    else:
        step = sufficient_step(flow, solver, error, motion, p, run.step)
        remedy = f"Take steps of {step:.1g} s or less; deltac.recommend finds a step and a solver"
    warn_user(
        f"the run cannot be trusted: its energy error |ΔC| reaches {error.largest:.3g} J, {share} the "
        f"{error.total:.3g} J that took part. {remedy}",
        EnergyErrorWarning,
    )
    return motion


def sufficient_step(
    flow: StateFlow, solver: Solver, error: EnergyError, motion: Motion, p: Array, step: float
) -> float:
    """A step (s) that would do, by the row from which on the run is wrong: later ones show another motion.

    It is accurate by the solver's order, for an error that grows on as it did until then, and stable there.
    """
    assert solver.order is not None
    wrong = (error.error > ROUGHLY * error.scale)[int(np.argmax(error.error)) :: -1]
    k = max(1, len(wrong) - int(np.argmin(wrong)))  # `wrong` goes back from the largest error
    until = float(motion.t[k] - motion.t[0]) / float(motion.t[-1] - motion.t[0])
    allowed = ACCURATE * until * error.scale[k] / error.error[k]
    accurate = float(step * allowed ** (1.0 / solver.order))
    if not flow.traced:
        return accurate
    rate = fastest_rate(flow, float(motion.t[k - 1]), motion.x[k - 1], p)
    return min(accurate, longest_step(solver, rate)) if np.isfinite(rate) and rate else accurate
