"""ΔC in joules of the integrator, of mistakes in the equations, and of the log.

Along the rows each field does the work ∫(∂E/∂x)·F dt. What the integrator's fields and the mistakes' do not
make of ΔC is of the log: noise and digits of its rows, and what forces did between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inference.observations import Observations


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


UNEXPLAINED = 4.0
"""Standard errors beyond which joules are more than the noise of two rows."""


def joules(
    log: Observations,
    Q: Array,
    gradient: Array,
    jump: Array,
    integrator: Share,
    equations: Share,
    of_log: Array,
    tau: float,
) -> tuple[Attribution, float]:
    """The attribution, and the joules that nothing explains.

    Args:
        log: the rows.
        Q: covariance (N, 2n, 2n) of what the flow does not know.
        gradient: ∂E/∂x (N, 2n) at the ends of the intervals.
        jump: energy (N,) of each row beyond that of its prediction, J.
        integrator: its share.
        equations: theirs.
        of_log: joules (N,) of delays and zeros of the log.
        tau: autocorrelation time of that, intervals.
    """
    of_rows = np.einsum("km,km->k", gradient**2, log.noise[1] ** 2)
    rows = np.sqrt(of_rows + of_rows[0])
    unknown = np.einsum("km,kmn,kn->k", gradient, Q, gradient)
    rest = log.running(jump) - integrator.curve - equations.curve
    error = np.hypot(rows, np.sqrt(np.cumsum(unknown) * tau))
    # What nothing explains may be the integrator's.
    unexplained = np.maximum(np.abs(rest - of_log) - UNEXPLAINED * error, 0.0)
    integrator = Share(integrator.curve, np.hypot(integrator.curve_error, unexplained))
    parts = Attribution(log.intervals.end.t, integrator, equations, Share(rest, error))
    return parts, float(unexplained.max(initial=0.0))
