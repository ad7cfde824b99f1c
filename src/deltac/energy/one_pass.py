"""Ledgers of long logs in one pass: integrals over all rows, columns at all or at a few of them.

Rows go in blocks through what stays in a core's cache: into columns, through the equations, the powers back
into rows, and through `Running`, which sums them and what their error bars are made of. Nothing is written
but what is kept: all rows, or of equal parts of the log those with the largest |ΔC|.

Blocks are summed by themselves, by whatever thread, and put together in their order, so that the result is
the same to the last bit on any number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from threading import Condition
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.dynamics.terms import Energies
from deltac.dynamics.testing_functions import TestingFunction
from deltac.energy.sampling.interpolation import equidistant
from deltac.energy.sampling.quadrature import (
    EvenSums,
    Integral,
    exact_to_rounding,
    observed_order,
    reduction,
)
from deltac.energy.sampling.running import AHEAD, REACH, SAMPLED, Flow, Running
from deltac.energy.sampling.samples import Samples
from deltac.energy.terms import LedgerKernels, LedgerSymbols, LoggedForces, variants
from deltac.energy.works import LIKELY, flowed
from deltac.kernels.parallel import check_cancelled, cores, spread
from deltac.kernels.transposing import aligned, transposing
from deltac.mechanism.channels import ChannelName

ROWS = 1024
"""Rows in a block, about: what is made of them stays in a core's second cache."""

PART = 512
"""Rows of which one is kept at least."""

LEAST = 1000
"""Rows of a log from which on there is something to gain, where a few are kept."""

MANY = 8
"""Rows of a log for each that is kept from which on this is faster than all columns."""

LONG = 8192
"""Rows from which on all columns are found so."""

HALO = 16
"""Rows on either side of a block at an end of the log: windows on every fourth row reach no further."""

MULTIPLE = 8
"""Rows of a block are a multiple of this."""


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


class _Layout:
    """Where things lie among a kernel's outputs, and what is made of them."""

    def __init__(
        self,
        symbols: LedgerSymbols,
        kernels: LedgerKernels,
        functions: Sequence[TestingFunction],
    ) -> None:
        at, own = kernels.at_samples.output_slices, kernels.between.output_slices
        self.energies, self.conservative = at["energies"], at["conservative"]
        first = at["potential"].start
        self.potential = [first + kernels.potential.index(n) for n in kernels.conservative]
        places = {name: k for k, name in enumerate(kernels.channels)}
        self.driven = [
            (k, places[ChannelName("prescribed", name.element)])
            for k, name in enumerate(kernels.conservative)
            if name in symbols.driven
        ]
        start = own["functions"].start
        pairs = [
            (function, start + kernels.functions.index(name))
            for function in functions
            for name in variants(symbols, function.name)
        ]
        self.functions = [k for _, k in pairs]
        energies = Energies(*np.eye(4))
        parts = (*np.eye(4), energies.K)
        self._weights = np.array([*parts, *(f.E(energies) for f, _ in pairs)])  # E is linear
        self.n_between, self.n_out = kernels.between.n_out, kernels.at_samples.n_out
        self.between = slice(self.n_out - self.n_between, self.n_out)
        self.channels = own["channels"]
        self.leading = slice(len(kernels.channels), None)

    def of_energies(self, known: Array) -> tuple[Array, Array]:
        """K2, K1, K0, V and K (5, B), and E of each testing function (f, B)."""
        found = self._weights @ known[self.energies]
        return found[:5], found[5:]


@dataclass(frozen=True)
class _Sums:
    """What the rows of a block come to, the first included and the one after the last not; over h."""

    value: Array  # ∫P
    error: Array  # the same on all less that on every second row, at the end,
    most: Array  # and its extremes
    least: Array
    finer: Array  # what `reduction` compares
    coarser: Array
    flow: Array  # ∫|P| of channels that have a potential,
    size: Array  # and Σ|P| of the others
    lowest: Array  # energies
    highest: Array
    delta_c: Array  # what each testing function gains, J


@dataclass(frozen=True)
class _Before:
    """What the blocks before one come to: integrals, errors and the largest of these; over h."""

    value: Array
    error: Array
    worst: Array
    delta_c: Array  # of each testing function, J

    def after(self, block: _Sums) -> _Before:
        """With one more block."""
        return _Before(
            self.value + block.value,
            self.error + block.error,
            self.reached(block.most, block.least),
            self.delta_c + block.delta_c,
        )

    def reached(self, most: Array, least: Array) -> Array:
        """The largest |error| so far, by the extremes within a block."""
        return np.maximum(np.maximum(most + self.error, -(least + self.error)), self.worst)


class _Worker:
    """Evaluates blocks, one after the other, in memory of its own.

    After `evaluate` the block is at hand: `known` (n, rows + 1), `delta_c`, what each testing function gained
    since its first row (f, rows + 1; J), and by `value` and `reached` the integrals and the extremes of
    errors (k, n) at some of its rows.
    """

    def __init__(
        self,
        samples: Samples,
        log: LoggedForces,
        kernels: LedgerKernels,
        layout: _Layout,
        size: int,
    ) -> None:
        self._last, self._size, self._layout = len(samples.t) - 1, size, layout
        self.width = float(samples.t[-1] - samples.t[0]) / self._last
        kernel = kernels.at_samples
        room = -(-max(size, 2 * HALO) // 8) * 8 + 2 * HALO + 8
        x, self._y = aligned(kernel.n_in, room), aligned(kernel.n_out, room)
        self._kernel = kernel.bound_batch(x, self._y)
        self._read = [transposing(a, x[where]) for a, where in _inputs(samples, log, kernels)]
        self._running = running = Running(size, layout.n_between)
        self._flow = flow = Flow(size, len(layout.potential), LIKELY / self.width)
        around, core = self._y[:, : size + 2 * REACH + 1], self._y[:, REACH : REACH + size + 1]
        pairs = [(around[layout.between], running.powers), (core[layout.conservative], flow.powers)]
        for k, run in _runs(layout.potential):
            pairs.append((core[run], flow.works[:, k : k + run.stop - run.start]))
        self._back = [(transposing(a, b), len(a)) for a, b in pairs if len(a)]
        self._ends = EvenSums(1.0)
        self._fine: Array | None = None
        self.known = self._y
        self.delta_c = np.empty((len(layout.functions), size + 1))

    def evaluate(self, first: int) -> tuple[int, _Sums]:
        """The block from that row on: how many rows it has, but for the last, and what they come to."""
        last = min(first + self._size, self._last)
        inside = first >= REACH and first + self._size + REACH <= self._last
        return last - first, self._inside(first) if inside else self._at_an_end(first, last)

    def _evaluated(self, low: int, count: int) -> None:
        for read in self._read:
            read(low, count, 0)
        self._kernel()

    def _inside(self, first: int) -> _Sums:
        layout, running, flow = self._layout, self._running, self._flow
        self._evaluated(first - REACH, self._size + 2 * REACH + 1)
        for back, count in self._back:
            back(0, count, 0)
        self._fine, self.known = None, self._y[:, REACH : REACH + self._size + 1]
        running.run()
        for k, driven in layout.driven:
            flow.works[:, k] -= self.width * running.of([driven])[0]
        lowest, highest, delta_c = self._compared(running.of(layout.functions))
        return _Sums(
            value=running.whole(),
            error=running.end("error"),
            most=running.end("most"),
            least=running.end("least"),
            finer=running.end("finer"),
            coarser=running.end("coarser"),
            flow=flow.run(),
            size=running.end("size"),
            lowest=lowest,
            highest=highest,
            delta_c=delta_c,
        )

    def _at_an_end(self, first: int, last: int) -> _Sums:
        """By windows that lie aside where the log begins or ends."""
        layout, high = self._layout, min(last + HALO, self._last)
        low = max(min(first - HALO, (high - 4 * HALO) // 4 * 4), 0)
        self._evaluated(low, high - low + 1)
        found = self._y[:, : high - low + 1]
        between = found[layout.between]
        fine, half, quarter = (
            self._ends.sums(np.ascontiguousarray(between[:, ::n]), n) for n in (1, 2, 4)
        )
        core = slice(first - low, last - low + 1)
        self.known, self._fine = found[:, core], fine[:, core] - fine[:, core.start, None]
        ahead = (min(last + AHEAD + 1, high) - low) // 2 + 1
        error = fine[:, : 2 * ahead : 2] - half[:, :ahead]
        error = error[:, core.start // 2 :] - error[:, core.start // 2, None]
        self._most, self._least = (f.accumulate(error, axis=1) for f in (np.maximum, np.minimum))
        within = slice(core.start // 4, (last - low) // 4 + 1)
        coarse = half[:, ::2][:, within] - quarter[:, within]
        end = (last - first) // 2
        lost = -np.diff(self.known[layout.potential], axis=1)
        for k, driven in layout.driven:
            lost[k] += self.width * np.diff(self._fine[driven])
        lowest, highest, delta_c = self._compared(self._fine[layout.functions])
        return _Sums(
            value=self._fine[:, -1],
            error=error[:, end],
            most=self._most[:, end],
            least=self._least[:, end],
            finer=np.abs(np.diff(error[:, : end + 1], axis=1)).sum(axis=1),
            coarser=np.abs(np.diff(coarse, axis=1)).sum(axis=1),
            flow=flowed(self.known[layout.conservative], self.width, lost) / self.width,
            size=np.abs(between[:, core][:, :-1]).sum(axis=1),
            lowest=lowest,
            highest=highest,
            delta_c=delta_c,
        )

    def _compared(self, integrals: Array) -> tuple[Array, Array, Array]:
        """Least and largest energies (5,), what each testing function gains; keeps that at all rows."""
        energies, E = self._layout.of_energies(self.known)
        integrals *= self.width
        E -= E[:, :1].copy()
        E -= integrals
        self.delta_c = E
        return energies.min(axis=1), energies.max(axis=1), E[:, -1]

    def value(self, rows: NDArray[np.intp]) -> Array:
        """∫P from the block's first row to others (k, n), over h."""
        return self._running.value(rows) if self._fine is None else self._fine[:, rows].T

    def reached(self, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """The largest and the least error up to rows (k, n), over h."""
        if self._fine is None:
            return self._running.reached(rows)
        # A bar is that of the next row but one that windows on every second row see.
        seen = np.minimum((rows + AHEAD + 1) // 2, self._most.shape[1] - 1)
        return self._most[:, seen].T, self._least[:, seen].T


def _runs(places: Sequence[int]) -> Iterator[tuple[int, slice]]:
    """Neighbouring places together: the number of the first, and where they are."""
    starts = [k for k, place in enumerate(places) if not k or place != places[k - 1] + 1]
    for a, b in pairwise((*starts, len(places))):
        yield a, slice(places[a], places[a] + b - a)


def _inputs(
    samples: Samples, log: LoggedForces, kernels: LedgerKernels
) -> Iterator[tuple[Array, slice]]:
    """Columns of a log (T, n), and their places among the kernel's inputs."""
    for name, where in kernels.at_samples.input_slices.items():
        if name == "t":
            yield samples.t[:, None], where
        elif name == "udot":
            yield samples.smooth["u"].rates, where
        elif name == "logged":
            for channel, at in log.columns.items():
                if at.stop > at.start:
                    place = slice(where.start + at.start, where.start + at.stop)
                    yield samples.plain[f"force {channel}"], place
        else:
            yield samples.smooth[name].values, where


class _Turns:
    """Lets threads do something one after the other, in the order of their items."""

    def __init__(self) -> None:
        self._changed, self._next = Condition(), 0

    @contextmanager
    def turn(self, item: int) -> Iterator[None]:
        """What is done within waits for the items before."""
        with self._changed:
            while self._next != item:
                self._changed.wait(0.1)
                check_cancelled()
            yield
            self._next += 1
            self._changed.notify_all()


def in_one_pass(
    samples: Samples,
    log: LoggedForces,
    symbols: LedgerSymbols,
    kernels: LedgerKernels,
    functions: Sequence[TestingFunction],
    keep: int | None,
) -> OnePass | None:
    """One pass over equidistant samples without events.

    Of the samples about `keep` rows are kept, one of `PART` at least; all if None. None where samples are of
    another kind, or powers at the samples do not suffice for integrals that are exact to rounding.
    """
    count = len(samples.t)
    aside = samples.inward is not None or samples.held or samples.derived
    enough = LONG if keep is None else max(LEAST, MANY * keep)
    if aside or count < enough or not equidistant(samples.t):
        return None
    part = 1 if keep is None else min(max(count // keep, 1), PART)
    if part > 8 * MULTIPLE:
        part -= part % MULTIPLE
    unit = math.lcm(part, MULTIPLE)
    size = unit * max(1, ROWS // unit)
    layout = _Layout(symbols, kernels, functions)
    starts = range(0, count - 1, size)
    kept = _All(layout, count) if keep is None else _Some(layout, part, count)
    turns, sums = _Turns(), list[_Sums]()
    nothing = np.zeros(layout.n_between)
    before = _Before(nothing, nothing, nothing, np.zeros(len(layout.functions)))
    workers = min(cores(), len(starts))

    def work(number: int) -> None:
        nonlocal before
        worker = _Worker(samples, log, kernels, layout, size)
        for k in range(number, len(starts), workers):
            check_cancelled()
            steps, found = worker.evaluate(starts[k])
            with turns.turn(k):
                here, before = before, before.after(found)
                sums.append(found)
            kept.keep(worker, starts[k], steps, here)

    kernels.at_samples.compile()
    spread(work, range(workers), workers)
    rows, known, value, worst = kept.joined()
    width = float(samples.t[-1] - samples.t[0]) / (count - 1)
    finer, coarser = (np.sum([getattr(s, n) for s in sums], axis=0) for n in ("finer", "coarser"))
    bar = worst
    bar *= (width / reduction(finer, coarser, SAMPLED))[:, None]
    value *= width
    first, last = np.abs(known[layout.between][:, [0, -1]]).T
    size_of = width * (np.sum([s.size for s in sums], axis=0) + 0.5 * (last - first))
    leading = layout.leading
    if not exact_to_rounding(bar[leading, -1].max(), size_of[leading].max(), count):
        return None
    flow = np.append(width * np.sum([s.flow for s in sums], axis=0), size_of[layout.channels])
    return OnePass(
        rows,
        known,
        Integral(value.T, bar.T, "samples", observed_order(finer[leading], coarser[leading])),
        dict(zip((*kernels.conservative, *kernels.channels), flow.tolist())),
        np.min([s.lowest for s in sums], axis=0),
        np.max([s.highest for s in sums], axis=0),
    )


Joined: TypeAlias = tuple[NDArray[np.intp], Array, Array, Array]
"""Rows (K,), outputs at these (n, K), integrals and largest errors up to them (m, K), over h."""


class _All:
    """Keeps all rows."""

    def __init__(self, layout: _Layout, count: int) -> None:
        self._known = np.empty((layout.n_out, count))
        self._value, self._worst = np.empty((2, layout.n_between, count))

    def keep(self, worker: _Worker, first: int, steps: int, before: _Before) -> None:
        """The rows of a block; the one after it too, where it is the last of all."""
        count = steps + (first + steps == self._known.shape[1] - 1)
        rows, here = np.arange(count), slice(first, first + count)
        self._known[:, here] = worker.known[:, :count]
        self._value[:, here] = (worker.value(rows) + before.value).T
        self._worst[:, here] = before.reached(*worker.reached(rows)).T

    def joined(self) -> Joined:
        """Everything that was kept."""
        return np.arange(self._known.shape[1]), self._known, self._value, self._worst


class _Some:
    """Keeps of each `part` of the rows the one where |ΔC| is largest, and the ends of the log."""

    def __init__(self, layout: _Layout, part: int, count: int) -> None:
        self._layout, self._part, self._last = layout, part, count - 1
        self._found: dict[int, Joined] = {}

    def keep(self, worker: _Worker, first: int, steps: int, before: _Before) -> None:
        """Some rows of a block."""
        off = np.abs(worker.delta_c + before.delta_c[:, None]).max(axis=0)
        rows = _picked(off, self._part, first == 0, first + steps == self._last)
        self._found[first] = (
            rows + first,
            worker.known[:, rows],
            (worker.value(rows) + before.value).T,
            before.reached(*worker.reached(rows)).T,
        )

    def joined(self) -> Joined:
        """Everything that was kept, in order."""
        parts = zip(*(self._found[first] for first in sorted(self._found)))
        rows, known, value, worst = (np.concatenate(part, axis=-1) for part in parts)
        return rows, known, value, worst


def _picked(off: Array, part: int, first: bool, last: bool) -> NDArray[np.intp]:
    """Of each part of a block (B,) the row that is furthest `off`; the ends of the log too."""
    whole = (len(off) - 1) // part * part  # the last row is the next block's first
    rows = off[:whole].reshape(-1, part).argmax(axis=1) + np.arange(0, whole, part)
    rest = off[whole : None if last else -1]
    more = [0] * first + [len(off) - 1] * last
    if len(rest):
        more.append(whole + int(rest.argmax()))
    return np.unique(np.append(rows, more)) if more else rows
