"""Methods by whose own maps the rows of a log follow from each other, beside what causes do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.inference.hypotheses import (
    EQUAL,
    Block,
    Fit,
    autocorrelation_time,
    least_squares,
)
from deltac.diagnosis.inference.integrators import Map

FAR = 1e4
"""Ratio of sums of squares beyond which a method at its likeliest states is not tried any further, and an
interval is none of those of an integrator's errors."""


@dataclass(frozen=True, eq=False)
class Methods:
    """Methods whose own maps close the rows best and alike, the best first; `others` next to them."""

    ends: list[Map]
    others: list[Map]
    floor: float
    floors: Array
    alone: float

    @staticmethod
    def of(ends: list[Map], r: Array, D: Array, rounding: float) -> Methods | None:
        """The best by what all causes leave of their prediction errors r (N, m, methods), whitened."""
        finite = [k for k in range(len(ends)) if np.isfinite(r[:, :, k]).all()]
        every = np.full(len(ends), np.inf)
        if not finite:
            return None
        y = r[:, :, finite].reshape(-1, len(finite))
        X = D.reshape(len(y), D.shape[2])
        x = least_squares(X.T @ X, X.T @ y)
        residual = y - X @ x
        floors = np.maximum((residual**2).sum(axis=0), 1e-300)
        every[finite] = floors
        best = int(np.argmin(floors))
        first = alike(residual.reshape(*r.shape[:2], -1), best, rounding)
        # Those that need no causes come first.
        first = first[np.argsort((y[:, first] ** 2).sum(axis=0), kind="stable")]
        order = [finite[k] for k in first]
        alone = float((y[:, best] ** 2).sum())
        near = [k for k in np.argsort(floors) if k not in first and floors[k] <= FAR * floors[best]]
        others = [ends[finite[k]] for k in near]
        return Methods([ends[k] for k in order], others, float(floors[best]), every, alone)

    def may_close(self, series: Block, best: Fit) -> bool:
        """Whether the best method with all causes leaves about as little as the series with its best ones."""
        return self.floor < SERIES * series.misfit(best.coefficients)


def alike(r: Array, best: int, rounding: float) -> NDArray[np.intp]:
    """Which of several residuals (N, m, k) are as likely as the best."""
    floors = np.maximum((r**2).sum(axis=(0, 1)), 1e-300)
    count = r.shape[0] * r.shape[1]
    odds = 0.5 * count / autocorrelation_time(r[:, :, best]) * np.log(floors / floors[best])
    # What is below the rounding of the rows is alike, and rounding is no more than about what is left.
    low = min(rounding * count, ROUNDED * floors[best])
    return np.flatnonzero((odds < EQUAL) | (floors <= low))


ROUNDED = 4.0
"""Ratio of sums of squares of rounding up to which they are alike."""

SERIES = 4.0
"""Ratio of sums of squares from which on a method's map is not compared any more with the series."""


def log_evidence(a: Block, fit_a: Fit, b: Block, fit_b: Fit) -> float:
    """Log evidence of one block with its causes against another with its own, at the larger of their τ."""
    tau = max(
        autocorrelation_time(x.residual(fit.coefficients)) for x, fit in ((a, fit_a), (b, fit_b))
    )
    return a.evidence(fit_a, tau) - b.evidence(fit_b, tau)
