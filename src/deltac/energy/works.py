"""Works of channels, and how far each may be off.

There are four ways to a work, each with an error bar of its own:

- of a channel with a potential: what the potential lost, exact but for rounding;
- in the loop: integrated by the solver together with the motion;
- on samples: by quadrature of its power, with the bar of the quadrature;
- discrete: by definition of the scheme, exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array
from deltac.mechanism.channels import ByChannel, ChannelName

EPS = float(np.finfo(np.float64).eps)

RESOLVED = 0.1
"""A work is resolved if its bar is at most this part of it …"""

NEGLIGIBLE = 1e-6
"""… or this part of the energy exchanged."""


@dataclass(frozen=True, eq=False)
class Work:
    """The cumulated work of a channel at the samples (T,), J, and how far it may be off (T,)."""

    value: Array
    bar: Array

    @staticmethod
    def exact(value: Array, size: float = 0.0) -> Work:
        """A work known but for rounding; `size` is that of the numbers it is a difference of."""
        steps = 4.0 + np.sqrt(np.arange(len(value)))
        return Work(value, EPS * (float(np.abs(value).max()) + size) * steps)

    def __add__(self, other: Work) -> Work:
        return Work(self.value + other.value, self.bar + other.bar)

    def less(self, other: Work) -> Work:
        """The difference."""
        return Work(self.value - other.value, self.bar + other.bar)


def of_potential(V: Array, explicit: Work | None) -> Work:
    """V̇ = −(power of its force) + ∂V/∂t; `explicit` is the integral of the last, None if it is zero."""
    lost = Work.exact(V[0] - V, float(np.abs(V).max()))
    return lost if explicit is None else lost + explicit


def in_loop(value: Array, sampled: Work, unaccounted: Array) -> Work:
    """The work that the solver integrated, with the smaller of two bars.

    Where samples are dense, quadrature along them is an independent value: the two differ by the error of
    the solver's. Where they are not, the solver's error in this work is taken to be no larger than what it
    left of the whole balance so far: |ΔC|, `unaccounted` (T,).
    """
    apart = np.maximum.accumulate(np.abs(value - sampled.value)) + sampled.bar
    exact = Work.exact(value)
    return Work(value, exact.bar + np.minimum(apart, unaccounted))


def widened(
    works: Mapping[ChannelName, Work], sampled: frozenset[ChannelName], missing: Array
) -> dict[ChannelName, Work]:
    """The works, the bars of those `sampled` no smaller than what all together are `missing` (T,; J).

    Samples that are too far apart for a power can also be too far apart for the bar of its integral; what
    the balance lacks beyond the bars may then be in any of these works.
    """
    excess = missing - sum(work.bar for work in works.values())
    lacking = np.maximum.accumulate(np.where(excess > 0.0, missing, 0.0))
    return {
        name: Work(work.value, np.maximum(work.bar, lacking)) if name in sampled else work
        for name, work in works.items()
    }


def exchanged(work: Work, power: Array, t: Array) -> float:
    """∫|power| dt of a channel, as far as it is certain (J): noise and gaps must not add to a scale.

    In each interval between samples the smaller of two estimates: the amount of its work, which misses what
    goes to and fro within, and the trapezoid of |power|, which knows nothing of what is within. Less what
    the whole work may be off.
    """
    by_power = 0.5 * np.diff(t) * (np.abs(power[1:]) + np.abs(power[:-1]))
    certain = np.minimum(np.abs(np.diff(work.value)), by_power).sum()
    return max(0.0, float(certain) - float(np.ptp(work.bar)))


def unresolved(works: ByChannel, bars: ByChannel, energy: float) -> tuple[ChannelName, ...]:
    """The channels whose work is hardly known: its bar is large beside it and beside an `energy` (J)."""
    return tuple(
        name
        for name, work in works.items()
        if bars[name].max() > max(RESOLVED * np.abs(work - work[0]).max(), NEGLIGIBLE * energy)
    )
