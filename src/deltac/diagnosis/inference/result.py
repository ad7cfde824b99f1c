"""What was inferred of a log: its integrator, the causes, and what neither explains."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import TINY, Array
from deltac.diagnosis.causes.causes import Candidate
from deltac.diagnosis.causes.columns import ColumnKernels
from deltac.diagnosis.inference.hypotheses import CERTAIN, Block, Fit, Posterior, deviation
from deltac.diagnosis.inference.integrators import Integrator, IntegratorEstimate
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import Observations

KNOWN = 4.0
"""Variance of what is left, in units of noise, up to which it may be noise: that is known to half of it."""

UNNAMED, SLIGHT = 0.25, 0.1
"""Share of what the integrator leaves of the rows that causes may leave, beside noise: half of its amplitude;
and where they stand beside habits of the log, or do little."""

WHITE = 3.0
"""Autocorrelation time, intervals, up to which what is left is of each interval on its own."""

COLOURED = 0.1
"""Share of what forces did between rows that goes with the motion as a cause does."""

OF_DELAYS = ("late-forces", "actuator-delay")
"""Causes by which all forces, or those of one motor, act later than they were logged."""

OF_THE_LOG = (*OF_DELAYS, "late-laws", "zero-offset")
"""Causes that leave the equations as they are."""

OF_INERTIA = ("body-inertia", "body-mass", "body-moments", "body-moment", "body-tensor")
"""Causes that no controlled actuator looks like whose force is not in the log."""


@dataclass(frozen=True, eq=False)
class Share:
    """A part of ΔC, J: `energy` at the end with its standard `error`; `curve`s along the rows."""

    curve: Array
    curve_error: Array

    @property
    def energy(self) -> float:
        """At the end, J."""
        return float(self.curve[-1])

    @property
    def error(self) -> float:
        """Standard error at the end, J."""
        return float(self.curve_error[-1])

    @property
    def largest(self) -> tuple[float, float]:
        """The largest |curve| with its standard error, J."""
        k = int(np.argmax(np.abs(self.curve)))
        return float(abs(self.curve[k])), float(self.curve_error[k])


@dataclass(frozen=True, eq=False)
class Attribution:
    """ΔC in joules of the integrator, of mistakes in the equations, and of the log.

    Their sum is ΔC of the rows. `t` (T,) are the times of the curves.
    """

    t: Array
    integrator: Share
    equations: Share
    log: Share


@dataclass(frozen=True)
class Generic:
    """All columns of causes together against the best set: equations that are wrong in a way without a name.

    Attributes:
        log_odds: that what is left depends on the state as terms of a model do.
        exchanged: the energy that these exchange, J.
        explained: share of what is left that they explain.
        shift: by how much the integrator has other joules beside them, at most, J.
    """

    log_odds: float
    exchanged: float
    explained: float
    shift: float

    @property
    def share(self) -> float:
        """Of what is left, that of terms of a model; 0 where these have no odds."""
        return self.explained if self.log_odds > CERTAIN else 0.0


@dataclass(frozen=True)
class UnknownForce:
    """A force by which all rows depart that no cause explains, where no logged force acts.

    Attributes:
        speed: through which most of its energy flows.
        exchanged: that energy, J.
        share: of the changes of this speed from row to row that are of it (root mean square).
    """

    speed: str
    exchanged: float
    share: float


@dataclass(frozen=True, eq=False)
class Inference:
    """What was inferred of a log.

    Attributes:
        model, log: the equations and the rows.
        kernels: the columns of all causes.
        forces: how each logged force acts between rows, see `flow.FORCES`.
        filter: delay and deviation (s) of a filter of the forces, as of the states; None for none.
        methods: integrators whose own map closes the rows, if any.
        blocks: the whitened equations: prediction errors, and measured accelerations where these are known.
        measured: whether causes were compared by the latter.
        posterior: causes with their odds.
        candidates: all causes that were compared.
        integrator: its numbers or names.
        attribution: ΔC in joules of the rows that were looked at.
        tau: autocorrelation time of what is left, intervals.
        excess: variance of what is left, in units of what digits, noise and the flow's error explain.
        whole: time of the log over that of the intervals.
        exchanged: energy (J) that each cause of the best set exchanges; `exchanged_error` its standard error.
        energy: what each adds to ΔC by the end, J.
        generic: equations that are wrong in a way without a name.
        unexplained: energy (J) that no integrator, no cause and no noise of the rows explains.
        force: one without a name, by which all rows depart; None for none.
        intermittent: odds of a force that acts from time to time, and the intervals in which it does.
        disputed: energy (J) of the integrator's share that a mistake may have exchanged as well.
        unseen: energy (J) that a mistake of one number may add to ΔC at one standard error of that number,
            by its name.
        lost: whether forces between rows are not in the log.
        switching: whether some that are held change between two rows.
        scattered: whether most of what the rows depart by is of no force: errors of steps of many sizes.
        speeds_known: whether the steps of a method make the speeds, which the log lacks.
        between: standard error (J) of the integrator's energy by forces that may be held over a step or not.
        residual: what is left of the rows (N, 2n), in the units of the state.
        acceleration: u̇ (N, n) of the model at the starts of the intervals.
        w: prediction errors (N, 2n) of the flow.
        steps: what of these the integrator makes (N, 2n).
        gradient: ∂E/∂x (N, 2n) at the ends of the intervals.
        unbuilt: the inference to first order at the model itself, where causes were built into it.
        alone: sum of squares that the model without causes leaves, where causes were relinearised.
        by_filter: share (of squares) of the prediction errors that a filter explains, where one was tried.
        zero: one of a coordinate that may do what the cause does; None for none.
    """

    model: LogModel
    log: Observations
    kernels: tuple[ColumnKernels, ...]
    forces: tuple[str, ...]
    filter: tuple[float, float] | None
    methods: tuple[Integrator, ...]
    blocks: tuple[Block, ...]
    measured: bool
    posterior: Posterior
    candidates: tuple[Candidate, ...]
    integrator: IntegratorEstimate
    attribution: Attribution
    tau: float
    excess: float
    whole: float
    exchanged: Array
    exchanged_error: Array
    energy: Array
    generic: Generic
    unexplained: float
    intermittent: tuple[float, NDArray[np.bool_]]
    disputed: float
    unseen: dict[str, float]
    speeds_known: bool
    between: float
    lost: bool
    switching: bool
    scattered: bool
    residual: Array
    acceleration: Array
    w: Array
    steps: Array
    gradient: Array
    unbuilt: Inference | None = None
    force: UnknownForce | None = None
    alone: float = np.inf
    by_filter: float = 0.0
    zero: Fit | None = None

    @cached_property
    def relative(self) -> tuple[Array, Array]:
        """Prediction errors of each speed (n,) as a share of its changes; and what noise accounts for."""
        n, h, log = self.model.n, self.log.intervals.h, self.log
        change = np.abs(self.acceleration) + np.abs(log.intervals.end.u - log.intervals.start.u) / h
        size = np.sqrt(np.mean(change**2, axis=0)) + 1e-300
        error = np.sqrt(np.mean((self.w[:, n:] / h) ** 2, axis=0))
        noise = np.sqrt(2.0 * np.mean((log.noise[1][:, n:] / h) ** 2, axis=0))
        return error / size, noise / size

    @property
    def finds_something(self) -> bool:
        """Whether a cause has odds that is of the equations, or something that has no name."""
        wrong = any(c.kind not in OF_THE_LOG for c in self.posterior.best.chosen)
        odds = max(self.generic.log_odds, self.intermittent[0])
        return wrong or self.force is not None or odds > CERTAIN

    @property
    def kinds(self) -> list[str]:
        """Of the causes found."""
        return [c.kind for c in self.posterior.best.chosen]

    @property
    def numbers(self) -> int:
        """How many these have."""
        return sum(c.size for c in self.posterior.best.chosen)

    @property
    def late(self) -> bool:
        """Whether forces were found to act later or more smoothly than they were logged."""
        return self.filter is not None or any(
            c.kind in OF_DELAYS for c in self.posterior.best.chosen
        )

    @property
    def flow(self) -> float:
        """The largest energy that a cause in the equations exchanges, with or without a name, J."""
        if self.force is not None:
            return self.force.exchanged
        best, generic = self.posterior.best, self.generic
        named = [
            float(joules)
            for c, joules in zip(best.chosen, self.exchanged, strict=True)
            if c.kind not in OF_THE_LOG
        ]
        return max([*named, generic.exchanged if generic.log_odds > CERTAIN else 0.0])

    @property
    def explained(self) -> float:
        """Share of what the integrator leaves of the rows that the causes explain."""
        block, best = self.blocks[0], self.posterior.best.coefficients
        whole = block.projected.left(np.zeros_like(best))
        if self.excess < 1.0:  # where the model itself is within the noise, that is the same
            whole = min(whole, self.alone)
        return 1.0 - block.projected.left(best) / whole if whole > 0.0 else 0.0

    @property
    def unnamed(self) -> float:
        """Share of what the integrator leaves of the rows that is neither noise nor of the causes.

        A residual far below the noise is not noise either: that bounds errors of interpolated forces.
        """
        if self.scattered or self.force is not None:
            return 0.0
        ratio = max(self.excess, 1.0 / max(self.excess, TINY))
        beyond_noise = max(1.0 - KNOWN / max(ratio, KNOWN), self.generic.share)
        return (1.0 - self.explained) * beyond_noise

    @cached_property
    def misfit(self) -> float:
        """Share (of squares) of the prediction errors that neither integrator nor causes explain, 0 to 1.

        Zero unless the residual exceeds the noise and is correlated from row to row, as a filter leaves it:
        integrator and causes are then only what resembles the filter most.
        """
        if self.scattered or self.force is not None or self.excess <= KNOWN or self.tau <= WHITE:
            return 0.0
        unit = np.median(self.w**2, axis=0) + 1e-300
        left, whole = ((x**2 / unit).mean(axis=1) for x in (self.residual, self.w))
        return float(min(left.mean() / whole.mean(), np.median(left) / np.median(whole), 1.0))

    @property
    def incomplete(self) -> bool:
        """Whether too much is left of the rows that is no noise for the causes to be what is wrong.

        What a log does to its rows, as a filter does, is in part like any cause, the more so if one of its
        habits is found; so is what forces did between rows that were left out.
        """
        doubted = any(c.kind in OF_THE_LOG for c in self.posterior.best.chosen)
        terms = self.generic.explained if self.generic.log_odds > CERTAIN else 0.0
        return (
            self.unnamed > (SLIGHT if doubted else UNNAMED)
            or (self.misfit > UNNAMED and not self.measured)
            or self.by_filter > max(self.explained, terms)
            or (self.lost and self.explained < COLOURED)
        )

    @property
    def knows_stages(self) -> bool:
        """Whether the log holds the forces at all stages of the method that closes it."""
        later = len(self.log.intervals.stages)
        return bool(later) and any(m.stages == later + 1 for m in self.methods)

    @property
    def closes(self) -> bool:
        """Whether each row follows from the one before by a known step, within the noise of both."""
        return bool(self.methods) and self.excess <= 1.0

    def deviation(self, c: Candidate) -> float:
        """Standard error of the number of a cause of one, beside the best causes."""
        return deviation(self.blocks, c, self.posterior.best, self.tau)
