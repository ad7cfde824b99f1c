"""Ledgers of long logs in one pass: integrals over all rows, columns at a few of them.

A ledger of a million rows has a thousand columns of bytes for every one that is ever looked at, and writing
them takes several times as long as evaluating the equations. Here rows go in blocks through what stays in a
core's cache: the powers, their integrals by `lagrange` on all, every second and every fourth row, and what
these differ by. Kept are, of equal parts of the log, the rows with the largest |ΔC|.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.dynamics.terms import Energies
from deltac.dynamics.testing_functions import TestingFunction
from deltac.energy.sampling.interpolation import equidistant
from deltac.energy.sampling.quadrature import (
    SAMPLED,
    EvenSums,
    Integral,
    exact_to_rounding,
    observed_order,
    reduction,
)
from deltac.energy.sampling.samples import Powers, Samples
from deltac.energy.terms import LedgerKernels, LedgerSymbols, variants
from deltac.energy.works import flowed
from deltac.kernels.parallel import cores, spread
from deltac.mechanism.channels import ChannelName

ROWS = 2048
"""Rows in a block, about: with their halo they stay in a core's second cache."""

PART = 512
"""Rows of which one is kept at least: a divisor of blocks."""

LEAST = 1000
"""Rows of a log from which on there is something to gain."""

MANY = 8
"""Rows of a log for each that is kept from which on this is faster than all columns."""

HALO = 4 * SAMPLED // 2
"""Rows on either side of a block that windows on every fourth row reach into."""


@dataclass(frozen=True)
class OnePass:
    """What a pass keeps.

    `known` are the outputs of the kernel at the `rows` that are kept (n, k), `integral` those of its last
    outputs; over all rows were taken: `flow`, ∫|P| dt of each channel (J), and the `least` and `largest`
    K2, K1, K0, V and K.
    """

    rows: NDArray[np.intp]
    known: Array
    integral: Integral
    flow: dict[ChannelName, float]
    least: Array
    largest: Array


class _Flows:
    """Rows of a kernel's outputs, and what a block of them comes to."""

    def __init__(
        self,
        symbols: LedgerSymbols,
        kernels: LedgerKernels,
        functions: Sequence[TestingFunction],
    ) -> None:
        self._at = kernels.at_samples.output_slices
        own = kernels.between.output_slices
        self.channels = (*kernels.conservative, *kernels.channels)
        first = self._at["potential"].start
        self._potential = [first + kernels.potential.index(n) for n in kernels.conservative]
        self._quadrature = own["channels"]
        places = {name: k for k, name in enumerate(kernels.channels)}
        self._driven = [
            (k, places[ChannelName("prescribed", name.element)])
            for k, name in enumerate(kernels.conservative)
            if name in symbols.driven
        ]
        start = own["functions"].start
        self.functions = [
            (function, start + kernels.functions.index(name))
            for function in functions
            for name in variants(symbols, function.name)
        ]
        self.n_between = kernels.between.n_out
        self.leading = slice(len(kernels.channels), None)

    def delta_c(self, known: Array, value: Array) -> Array:
        """E of each testing function without its integral (f, B)."""
        parts = Energies(*known[self._at["energies"]])
        return np.array([function.E(parts) - value[k] for function, k in self.functions])

    def integrals(self, value: Array) -> Array:
        """The integrals that belong to `delta_c` (f, …)."""
        return value[[k for _, k in self.functions]]

    def exchanged(self, known: Array, value: Array, width: float) -> Array:
        """∫|P| dt of all channels in a block (c,), J."""
        lost = -np.diff(known[self._potential], axis=1)
        for k, driven in self._driven:
            lost[k] += np.diff(value[driven])
        conservative = flowed(known[self._at["conservative"]], width, lost)
        return np.concatenate([conservative, flowed(known[self._at["channels"]], width)])

    def energies(self, known: Array) -> Array:
        """K2, K1, K0, V and K (5, B)."""
        parts = known[self._at["energies"]]
        return np.vstack([parts, parts[:3].sum(axis=0)])


@dataclass(frozen=True)
class _Block:
    """Outputs at neighbouring rows, integrals from the first of them on, and what these come to."""

    known: Array
    value: Array
    error: Array  # on every second row, on to those that the bars of the block's own look ahead to
    delta_c: Array  # without its integrals before the block
    sums: tuple[
        Array, ...
    ]  # ∫|P| dt of channels, of the leading integrands; what `reduction` compares
    least: Array
    largest: Array


def in_one_pass(
    samples: Samples,
    powers: Powers,
    rated: Collection[str],
    symbols: LedgerSymbols,
    kernels: LedgerKernels,
    functions: Sequence[TestingFunction],
    keep: int,
) -> OnePass | None:
    """One pass over equidistant samples without events; `powers` gives a new array at every call.

    Of the samples about `keep` rows are kept, one of `PART` at least. None where samples are of another kind,
    or powers at the samples do not suffice for integrals that are exact to rounding.
    """
    count = len(samples.t)
    aside = samples.inward is not None or samples.held or samples.derived
    if aside or count < max(LEAST, MANY * keep) or not equidistant(samples.t):
        return None
    part = min(max(-(-count // max(keep, 1)), 1), PART)
    size = 4 * part * max(1, ROWS // (4 * part))
    sums = EvenSums((samples.t[-1] - samples.t[0]) / (count - 1))
    flows = _Flows(symbols, kernels, functions)

    def evaluated(first: int) -> _Block:
        last = min(first + size, count - 1)
        high = min(last + HALO, count - 1)
        low = max(min(first - HALO, (high - 4 * HALO) // 4 * 4), 0)
        rows = slice(low, high + 1)
        found = powers(*samples.at(rows, rows, rated)).T
        between = found[-flows.n_between :]
        fine, half, quarter = (
            sums.sums(np.ascontiguousarray(between[:, ::n]), n) for n in (1, 2, 4)
        )
        core = slice(first - low, last - low + 1)
        known, value = found[:, core], fine[:, core] - fine[:, core.start, None]
        ahead = (min(last + SAMPLED // 2 + 1, high) - low) // 2 + 1
        error = fine[:, : 2 * ahead : 2] - half[:, :ahead]
        error = error[:, core.start // 2 :] - error[:, core.start // 2, None]
        within = slice(core.start // 4, (last - low) // 4 + 1)
        coarse = half[:, ::2][:, within] - quarter[:, within]
        energies = flows.energies(known)
        return _Block(
            known,
            value,
            error,
            flows.delta_c(known, value),
            (
                flows.exchanged(known, value, sums.width),
                flowed(known[-flows.n_between :][flows.leading], sums.width),
                np.abs(np.diff(error[:, : (last - first) // 2 + 1], axis=1)).sum(axis=1),
                np.abs(np.diff(coarse, axis=1)).sum(axis=1),
            ),
            energies.min(axis=1),
            energies.max(axis=1),
        )

    def in_order(firsts: Sequence[int]) -> list[tuple[int, _Block]]:
        found: dict[int, _Block] = {}
        spread(lambda first: found.update({first: evaluated(first)}), firsts)
        return sorted(found.items())

    rows: list[tuple[NDArray[np.intp], Array, Array, Array]] = []
    sums_of, extremes = [], []
    value, error, worst = np.zeros((3, flows.n_between, 1))
    starts, at_once = range(0, count - 1, size), 2 * cores()
    zero = np.zeros((len(flows.functions), 1))
    for k in range(0, len(starts), at_once):
        for first, block in in_order(starts[k : k + at_once]):
            if not first:
                zero = block.delta_c[:, :1]
            off = np.abs(block.delta_c - zero - flows.integrals(value)).max(axis=0)
            steps = len(off) - 1
            chosen = _picked(off, part, first == 0, first + steps == count - 1)
            bars = np.maximum.accumulate(np.abs(block.error + error), axis=1)
            np.maximum(bars, worst, out=bars)
            # A bar is that of the next row but one that windows on every second row see.
            seen = np.minimum((chosen + SAMPLED // 2 + 1) // 2, bars.shape[1] - 1)
            rows.append((
                chosen + first, block.known[:, chosen], block.value[:, chosen] + value, bars[:, seen]
            ))  # fmt: skip
            sums_of.append(block.sums)
            extremes.append((block.least, block.largest))
            value = value + block.value[:, -1:]
            error, worst = error + block.error[:, [steps // 2]], bars[:, [steps // 2]]
    flow, leading, finer, coarser = (np.sum(x, axis=0) for x in zip(*sums_of))
    least, largest = zip(*extremes)
    places, known, values, running = zip(*rows)
    bar = np.hstack(running) / reduction(finer, coarser, SAMPLED)[:, None]
    if not exact_to_rounding(bar[flows.leading, -1].max(), leading.max(), count):
        return None
    order = observed_order(finer[flows.leading], coarser[flows.leading])
    return OnePass(
        np.concatenate(places),
        np.hstack(known),
        Integral(np.hstack(values).T, bar.T, "samples", order),
        dict(zip(flows.channels, flow.tolist())),
        np.min(least, axis=0),
        np.max(largest, axis=0),
    )


def _picked(off: Array, part: int, first: bool, last: bool) -> NDArray[np.intp]:
    """Of each part of a block (B,) the row that is furthest `off`; the ends of the log too."""
    whole = (len(off) - 1) // part * part  # the last row is the next block's first
    rows = [off[:whole].reshape(-1, part).argmax(axis=1) + np.arange(0, whole, part)]
    rest = off[whole : None if last else -1]
    if len(rest):
        rows.append(np.array([whole + rest.argmax()]))
    ends = [0] * first + [len(off) - 1] * last
    return np.unique(np.concatenate([*rows, np.array(ends, dtype=np.intp)]))
