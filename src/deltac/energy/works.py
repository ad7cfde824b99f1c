"""Works of channels, and how far each may be off.

There are four ways to a work, each with an error bar of its own:

- of a channel with a potential: what the potential lost, exact but for rounding;
- in the loop: integrated by the solver together with the motion;
- on samples: by quadrature of its power, with the bar of the quadrature;
- discrete: by definition of the scheme, exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, ROUGHLY, Array
from deltac.mechanism.channels import ByChannel, ChannelName

NEGLIGIBLE_WORK = 1e-6
"""A work whose bar is at most this share of the energy exchanged is resolved, however small it is."""

LIKELY = 2.0
"""Factor by which the trapezoid of a power may exceed the work between two samples."""


@dataclass(frozen=True, eq=False)
class Work:
    """The cumulated work of a channel at the samples (T,), J, and how far it may be off (T,).

    `way`: one of the four, "potential", "in-loop", "samples", "discrete"; "events" where impulses alone did
    it, "booked" for corrections.
    """

    value: Array
    bar: Array
    way: str = "samples"

    @staticmethod
    def exact(value: Array, way: str, size: float = 0.0, growth: Array | None = None) -> Work:
        """A work known but for rounding.

        `size` is that of the numbers it is a difference of; `growth` is `growth_of_rounding` at the samples,
        if they are not all of the run or it is known already.
        """
        if growth is None:
            growth = growth_of_rounding(np.arange(len(value)))
        return Work(value, growth * (EPS * (largest(value) + size)), way)

    def at(self, rows: slice) -> Work:
        """The same at some of the samples."""
        return Work(self.value[rows], self.bar[rows], self.way)

    def __add__(self, other: Work) -> Work:
        return Work(self.value + other.value, self.bar + other.bar, self.way)


def growth_of_rounding(rows: NDArray[np.intp]) -> Array:
    """Roundings at the samples (T,), at these `rows` of a run, that add up as a random walk does."""
    return 4.0 + np.sqrt(rows)


def largest(x: Array) -> float:
    """The largest |x|, without an array of sizes."""
    return max(float(x.max()), -float(x.min()))


def of_potential(V: Array, explicit: Work | None, growth: Array) -> Work:
    """V̇ = −(power of its force) + ∂V/∂t; `explicit` is the integral of the last, None if it is zero."""
    lost = Work.exact(V[0] - V, "potential", largest(V), growth)
    return lost if explicit is None else lost + explicit


def in_loop(value: Array, sampled: Work, unaccounted: Array) -> Work:
    """The work that the solver integrated, with the smaller of two bars.

    Where samples are dense, quadrature along them is an independent value: the two differ by the error of
    the solver's. Where they are not, the solver's error in this work is taken to be no larger than what it
    left of the whole balance so far: |ΔC|, `unaccounted` (T,).
    """
    difference = np.maximum.accumulate(np.abs(value - sampled.value)) + sampled.bar
    rounding = Work.exact(value, "in-loop").bar
    return Work(value, rounding + np.minimum(difference, unaccounted), "in-loop")


def widened(works: Mapping[ChannelName, Work], missing: Array) -> dict[ChannelName, Work]:
    """The works, the bars of those on samples no smaller than what all together are `missing` (T,; J).

    Samples that are too far apart for a power can also be too far apart for the bar of its integral; what
    the balance lacks beyond the bars may then be in any of these works.
    """
    excess = missing - sum(work.bar for work in works.values())
    deficit = np.maximum.accumulate(np.where(excess > 0.0, missing, 0.0))
    return {
        name: replace(work, bar=np.maximum(work.bar, deficit)) if work.way == "samples" else work
        for name, work in works.items()
    }


def exchanged(work: Work, power: Array, t: Array) -> float:
    """∫|P| dt of a channel, as far as it is certain (J): what no sample shows must not add to a scale.

    By trapezoids, less what the work may be off in the whole run. Where the work is known without the powers
    at the samples, an interval counts no more than `LIKELY` times the work that was done in it.
    """
    size = np.abs(power)
    flow = 0.5 * np.diff(t) * (size[1:] + size[:-1])
    if work.way in ("potential", "in-loop"):
        flow = np.minimum(flow, LIKELY * np.abs(np.diff(work.value)))
    return certain(float(flow.sum()), work)


def certain(flow: float, work: Work) -> float:
    """What of ∫|P| dt is certain (J): less what the work may be off in the whole run."""
    return max(0.0, flow - float(np.ptp(work.bar)))


def unresolved(works: ByChannel, bars: ByChannel, negligible: float) -> tuple[ChannelName, ...]:
    """The channels whose work is hardly known: its bar is large beside it, and not `negligible` (J)."""
    return tuple(
        name
        for name, work in works.items()
        if bars[name].max() > max(ROUGHLY * np.abs(work - work[0]).max(), negligible)
    )
