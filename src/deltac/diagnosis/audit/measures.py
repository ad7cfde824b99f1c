"""The energy of a log in numbers: what was exchanged, what ΔC is, and how well either is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.audit.reading import Reference
from deltac.diagnosis.inputs.logs import Log, held_between_rows, work_of
from deltac.diagnosis.measurements.digits import Digits, digits_of, least_of_forces
from deltac.energy import Ledger, balance
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.lint import gap_rows

if TYPE_CHECKING:
    from deltac.diagnosis.residuals.one_step import OneStep

NOTHING = 1e-12
"""Energy exchanged below this share of the energies themselves is their rounding."""

IDLE = 2.0
"""Energy exchanged that is less than so many times the energy error is that error: nothing was exchanged."""

DOMINATES = 4.0
"""ΔC counts from this many error bars on, once the bar is above the tolerance."""

BEYOND = 30.0
"""The same where the bar does not converge."""

SMOOTH = 2.0
"""Order of convergence from which on an error bar above the tolerance is believed."""

STRETCH = 16
"""Rows that a part of a log has at least to be balanced on its own."""

DRAWS = 3
"""How often the log is perturbed at random to find what its digits and noise do to ΔC."""

MOST_ROWS = 4000
"""Rows of a long log that are perturbed: the noise of its first and its last row is what counts."""

COARSE = 1e-9
"""Share of a column's size from which on its digits and noise are looked at."""


@dataclass(frozen=True, eq=False)
class Measures:
    """What is known of the energy of a log, J.

    Attributes:
        mechanism, run, function: whose, of which consecutive rows, by which testing function.
        energy_exchanged: the energy exchanged.
        stored: the energy that the system has at a time, as far as it changes.
        scale: all of that, and the energies themselves.
        kinetic: the largest kinetic energy.
        left: largest |ΔC|, corrections included.
        bar: its error bar, `held` and `noise` included.
        held: what of the bar comes from forces held over steps that were not all logged.
        noise: what of it comes from the digits of the log and the noise on it.
        tolerance: accepted share of the energy stored.
        step: of the simulator (s), if known.
        method: how the work was taken.
    """

    mechanism: Mechanism
    run: Trajectory
    function: str
    energy_exchanged: float
    stored: float
    scale: float
    kinetic: float
    left: float
    bar: float
    held: float
    noise: float
    tolerance: float
    step: float | None
    method: str

    @property
    def beside(self) -> float:
        """The energy that the error is compared with."""
        return self.stored

    @property
    def allowed(self) -> float:
        """The energy error that is accepted."""
        return self.tolerance * self.beside

    @property
    def within(self) -> bool:
        """Whether the energy error is accepted."""
        return self.left <= self.allowed

    @property
    def may_be_within(self) -> bool:
        """Whether it would be accepted if it were less by its bar."""
        return self.left <= self.allowed + self.bar

    @property
    def fine(self) -> bool:
        """Whether the samples tell the energy to the tolerance; their error grows with what is exchanged."""
        return self.bar <= self.tolerance * self.energy_exchanged

    @property
    def nothing_moves(self) -> bool:
        """Whether the energy exchanged is rounding."""
        return self.energy_exchanged <= NOTHING * self.scale

    @property
    def idles(self) -> bool:
        """Whether a body moves without exchanging energy, with an error small beside its kinetic energy."""
        exchanged = not self.nothing_moves and self.energy_exchanged > IDLE * self.left
        small = max(self.left, self.bar) <= self.tolerance * self.kinetic
        return not exchanged and self.kinetic > 0.0 and small

    @property
    def spacing(self) -> float:
        """Of the samples, s."""
        return float(np.median(np.diff(self.run.t)))

    @cached_property
    def order(self) -> float:
        """Order of convergence that the error bar shows when every second sample is left out."""
        fine, coarse = (
            balance(self.mechanism, rows, "samples", testing=(self.function,))
            .error_bar[self.function]
            .max()
            for rows in (self.run, self.run.every(2))
        )
        return math.log2(max(float(coarse / fine), 1.0)) if fine > 0.0 else 0.0

    @property
    def clear(self) -> bool:
        """Whether ΔC is no error of the samples, where their bar exceeds the tolerance."""
        return self.left > (BEYOND if self.order < SMOOTH else DOMINATES) * self.bar

    @cached_property
    def gaps(self) -> bool:
        """Whether rows are missing and the whole log does not balance for that."""
        whole = self.method == "in-loop" or max(self.left, self.bar) <= self.allowed
        return not whole and bool(len(gap_rows(self.run.t)))

    @cached_property
    def between_gaps(self) -> Measures:
        """The same of that part between gaps whose |ΔC| is largest; of few rows there is no part."""
        run = self.run
        edges = [0, *(gap_rows(run.t) + 1), len(run)]
        left, bar = 0.0, 0.0
        for a, b in pairwise(edges):
            if b - a >= STRETCH:
                part = run.between(run.t[a], run.t[b - 1])
                ledger = balance(self.mechanism, part, work_of(part) or "samples")
                error = float(np.abs(ledger.uncorrected(self.function)).max())
                if error > left:
                    left, bar = error, float(ledger.error_bar[self.function].max())
        return replace(self, left=left, bar=bar, held=min(self.held, bar))


def measures_of(
    reference: Reference, log: Log, test: OneStep | None, step: float | None
) -> Measures:
    """The measures of a log by its ledger and its one-step test; `step` is that of its simulator (s)."""
    ledger = log.ledger
    function = function_of(ledger)
    held, noise = held_between_rows(log), energy_of_noise(reference, log, function, test)
    kinetic = float(ledger.kinetic.max())
    return Measures(
        mechanism=reference.mechanism,
        run=log.consecutive,
        function=function,
        energy_exchanged=ledger.energy_exchanged,
        stored=ledger.reference_energy,
        scale=kinetic + float(np.abs(ledger.potential_energy).max()) + ledger.energy_exchanged,
        kinetic=kinetic,
        left=float(np.abs(ledger.uncorrected(function)).max()),
        bar=float(ledger.error_bar[function].max()) + held + noise,
        held=held,
        noise=noise,
        tolerance=reference.tolerance,
        step=step,
        method=ledger.method,
    )


def function_of(ledger: Ledger) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    known = ("wang", "liu-huston", "kane-levinson-1990", *ledger.delta_c)
    return next(name for name in known if name in ledger.delta_c)


def energy_of_noise(reference: Reference, log: Log, function: str, test: OneStep | None) -> float:
    """Error bar (J) of the largest |ΔC| that comes from digits and noise of q, u and the forces.

    ΔC is taken of the log and of the log with every number moved at random by as much as it is uncertain. Of
    noise nothing is known without the one-step test.
    """
    run = log.consecutive
    if run.integrals or len(run) < 16:
        return 0.0
    if len(run) > MOST_ROWS:
        run = run.between(run.t[0], run.t[MOST_ROWS - 1])
    # What looks like noise may be kinks of forces, or a motion that the rows hardly resolve.
    real = test.residual.noisy if test is not None and not test.closes else 0.0
    columns = {"q": run.q, "u": run.u, **run.forces}
    of_run = digits_of(run)
    least = least_of_forces(of_run)
    uncertain: dict[str, tuple[Array, Array]] = {}
    coarse = False
    for name, values in columns.items():
        digits = of_run[name] if name in of_run else Digits(values, least)
        half, noise = digits.half(), real * digits.noise if real else np.zeros(values.shape[1])
        uncertain[name] = half, noise
        size = np.sqrt(np.mean(half**2, axis=0)) + noise
        coarse |= bool(np.any(size > COARSE * np.sqrt(np.mean(values**2, axis=0))))
    if not coarse:
        return 0.0
    rng = np.random.default_rng(11)

    def moved(name: str) -> Array:
        half, noise = uncertain[name]
        shape = half.shape
        return np.asarray(
            columns[name]
            + half * rng.uniform(-1.0, 1.0, shape)
            + noise * rng.standard_normal(shape)
        )

    mechanism, work = reference.mechanism, reference.work
    told = balance(mechanism, run, work).delta_c[function]
    most = 0.0
    for _ in range(DRAWS):
        forces = {n: moved(n) for n in run.forces}
        other = replace(run, q=moved("q"), u=moved("u"), forces=forces)
        change = balance(mechanism, other, work).delta_c[function] - told
        most = max(most, float(np.abs(change - np.mean(change)).max()))
    return 2.0 * most  # the first row, from which ΔC is counted, errs as much as any other
