"""Ledgers of long logs in one pass: integrals over all rows, columns at all or at a few of them.

Rows go in blocks through what stays in a core's cache: into columns, through the equations, the powers back
into rows, and through `Running`, which sums them and what their error bars are made of. Nothing is written
but what is kept: all rows, or of equal parts of the log those with the largest |ΔC|.

Blocks are summed by themselves, by whatever thread, and put together in their order, so that the result is
the same to the last bit on any number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Condition
from typing import TypeAlias

import casadi as ca
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
from deltac.energy.sampling.running import LANES, REACH, ROWS_AHEAD, Running
from deltac.energy.sampling.samples import Samples
from deltac.energy.terms import LedgerKernels, LedgerSymbols, LoggedForces, variants
from deltac.energy.works import LIKELY
from deltac.kernels import Kernel
from deltac.kernels.kernel import BLOCK_STATES
from deltac.kernels.parallel import check_cancelled, cores, spread
from deltac.kernels.simd import aligned
from deltac.mechanism.channels import ChannelName

ROWS_A_BLOCK = BLOCK_STATES
"""Rows in a block, about."""

PART = ROWS_A_BLOCK // 2
"""Rows of which one is kept at least."""

ROWS_A_KEPT = 8
"""Rows per row that is kept, above which one pass is faster than all columns."""

LONG_RUN = ROWS_A_KEPT * ROWS_A_BLOCK
"""Rows from which on all columns are found so."""

HALO = 4 * (SAMPLED // 2)
"""Rows on either side of a block at an end of the log: windows on every fourth row reach no further."""


@dataclass(frozen=True, eq=False)
class RowValues:
    """What kernels and quadrature say of the rows of a ledger, whichever way they were taken.

    `outputs` are those of the kernel at the `rows` (n, k), places in the run, `integral` the integrals of
    its last outputs. Over all rows of the run were taken: the `least` and `largest` K2, K1, K0, V and K; in
    one pass also `flow`, ∫|P| dt of each channel (J), and `size`, ∫|·| dt of each of those last outputs.
    """

    rows: NDArray[np.intp]
    outputs: Array
    integral: Integral
    least: Array
    largest: Array
    flow: Mapping[ChannelName, float] | None = None
    size: Array | None = None


class _Layout:
    """Where things lie among a kernel's outputs, and what is made of them row by row.

    Columns of a block are the outputs, then integrals over h: of the powers of the testing functions, and of
    what drives channels with a potential; then the interval h itself.
    """

    def __init__(
        self,
        symbols: LedgerSymbols,
        kernels: LedgerKernels,
        functions: Sequence[TestingFunction],
    ) -> None:
        at, own = kernels.at_samples.output_slices, kernels.between.output_slices
        self.energies = at["energies"]
        self.n_between, self.n_out = kernels.between.n_out, kernels.at_samples.n_out
        self.between = slice(self.n_out - self.n_between, self.n_out)
        self.channels = own["channels"]
        self.leading = slice(len(kernels.channels), None)
        self._functions = [(f, n) for f in functions for n in variants(symbols, f.name)]
        first = own["functions"].start
        integrated = [first + kernels.functions.index(name) for _, name in self._functions]
        places = {name: k for k, name in enumerate(kernels.channels)}
        driven = {
            k: places[ChannelName("prescribed", name.element)]
            for k, name in enumerate(kernels.conservative)
            if name in symbols.driven
        }
        self.integrated = [*integrated, *driven.values()]
        self.n_columns = self.n_out + len(self.integrated) + 1
        self.n_functions = len(integrated)
        names = tuple(name for _, name in self._functions)
        self.rows = symbols.once(("rows", names, kernels), lambda: self._rows(kernels, driven))
        self.flow, self.gain, self.kinetic = self.rows.output_slices.values()

    def _rows(self, kernels: LedgerKernels, driven: Mapping[int, int]) -> Kernel:
        """Of a row, its columns and those of the next one.

        ``flow``: ∫|P| dt between the two of each channel with a potential, as `exchanged` takes it; ``gain``:
        E − ∫ of each testing function; ``kinetic`` energy. All in J.
        """
        now, then = (ca.SX.sym(name, self.n_columns) for name in ("now", "then"))
        at = kernels.at_samples.output_slices
        h, potential = now[-1], at["potential"].start
        flow = []
        for k, name in enumerate(kernels.conservative):
            place, power = potential + kernels.potential.index(name), at["conservative"].start + k
            lost = now[place] - then[place]
            if k in driven:
                integral = self.n_out + self.n_functions + [*driven].index(k)
                lost += h * (then[integral] - now[integral])
            trapezoid = 0.5 * h * (ca.fabs(now[power]) + ca.fabs(then[power]))
            flow.append(ca.fmin(trapezoid, LIKELY * ca.fabs(lost)))
        energies = Energies(*ca.vertsplit(now[self.energies]))
        gain = [f.E(energies) - h * now[self.n_out + k] for k, (f, _) in enumerate(self._functions)]
        columns = {"flow": flow, "gain": gain, "kinetic": [energies.K]}
        outputs = {name: ca.vertcat(ca.SX(0, 1), *entries) for name, entries in columns.items()}
        return Kernel({"now": now}, outputs, then, name="rows of a ledger")


@dataclass(frozen=True)
class _Sums:
    """What the rows of a block come to, the first included and the one after the last not; over h."""

    value: Array  # ∫P
    error: Array  # the same on all less that on every second row, at the end,
    most: Array  # and its extremes
    least: Array
    finer: Array  # what `reduction` compares
    coarser: Array
    size: Array  # Σ|P|
    flow: Array  # ∫|P| dt of channels that have a potential, J
    lowest: Array  # energies
    highest: Array
    delta_c: Array  # what each testing function gains, J


_SUMMED = ("value", "error", "most", "least", "finer", "coarser", "size")


@dataclass(frozen=True)
class _Before:
    """What the blocks before one come to: integrals, errors and the largest of these; over h."""

    value: Array
    error: Array
    worst: Array
    delta_c: Array  # of each testing function, J
    lowest: Array  # energies, J
    highest: Array

    def after(self, block: _Sums) -> _Before:
        """With one more block."""
        return _Before(
            self.value + block.value,
            self.error + block.error,
            self.reached(block.most, block.least),
            self.delta_c + block.delta_c,
            np.minimum(self.lowest, block.lowest),
            np.maximum(self.highest, block.highest),
        )

    def reached(self, most: Array, least: Array) -> Array:
        """The largest |error| so far, by the extremes within a block."""
        return np.maximum(np.maximum(most + self.error, -(least + self.error)), self.worst)


class _BlockWorker:
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
        room = _whole(max(size, 2 * HALO)) + 2 * HALO + LANES
        kernel = kernels.at_samples
        self._x, self._y = aligned(kernel.n_in, room), aligned(layout.n_columns, room)
        self._y[-1] = self.width
        outputs, self._integrals = self._y[: layout.n_out], self._y[layout.n_out : -1]
        self._columns = [(a, self._x[where]) for a, where in _inputs(samples, log, kernels)]
        self._kernel = kernel.bound_batch(self._x, outputs)
        self._running, self._rows = Running(size, layout.n_between), size + 2 * REACH + 1
        whole = slice(_whole(self._rows))
        self._inside = kernel.bound_batch(self._x[:, whole], outputs[:, whole])
        self._found = aligned(layout.rows.n_out, room)
        block, ahead = (self._y[:, k : k + _whole(size + 1)] for k in (REACH, REACH + 1))
        out = self._found[:, : _whole(size + 1)]
        self._compared = layout.rows.bound_batch(block, out, ahead)
        self._ends = EvenSums(1.0)
        self._fine: Array | None = None

    def evaluate(self, first: int) -> tuple[int, _Sums]:
        """The block from that row on: how many rows it has, but for the last, and what they come to."""
        last = min(first + self._size, self._last)
        start = first - REACH
        if start >= 0 and start + _whole(self._rows) <= self._last + 1:
            sums = self._in_the_middle(start)
        else:
            sums = self._at_an_end(first, last)
        layout, rows = self._layout, last - first
        core = slice(REACH, REACH + rows + 1)
        self.known = self._y[: layout.n_out, core]
        self.delta_c = self._found[layout.gain, : rows + 1]
        self.delta_c -= self.delta_c[:, :1].copy()
        own = rows + (last == self._last)  # the row after the last is the next block's
        self.V, self.K = self.known[layout.energies][-1, :own], self._found[layout.kinetic][0, :own]
        energies = (self.known[layout.energies, :own], self.K[None])
        self.sums = _Sums(
            **{name: sums[name] for name in _SUMMED},
            flow=self._found[layout.flow, :rows].sum(axis=1),
            lowest=np.concatenate([e.min(axis=1) for e in energies]),
            highest=np.concatenate([e.max(axis=1) for e in energies]),
            delta_c=self.delta_c[:, -1].copy(),
        )
        return rows, self.sums

    def _in_the_middle(self, start: int) -> dict[str, Array]:
        """What `Running` gives of a block, whose surroundings begin at row `start`."""
        layout, running = self._layout, self._running
        for a, x in self._columns:
            x[:, : _whole(self._rows)] = a[start : start + _whole(self._rows)].T
        self._inside()
        running.powers[:] = self._y[: layout.n_out][layout.between, : self._rows].T
        sums = running()
        block = slice(REACH, REACH + self._size + 1)
        for integral, k in zip(self._integrals, layout.integrated):
            integral[block] = running.column(k)
        self._compared()
        self._fine = None
        return sums

    def _at_an_end(self, first: int, last: int) -> dict[str, Array]:
        """What `Running` gives, by windows that lie aside where the log begins or ends."""
        layout, high = self._layout, min(last + HALO, self._last)
        low = max(min(first - HALO, (high - 4 * HALO) // 4 * 4), 0)
        for a, x in self._columns:
            x[:, : high - low + 1] = a[low : high + 1].T
        self._kernel()
        outputs = self._y[: layout.n_out, : high - low + 1]
        between = outputs[layout.between]
        fine, half, quarter = (
            self._ends.sums(np.ascontiguousarray(between[:, ::n]), n) for n in (1, 2, 4)
        )
        core = slice(first - low, last - low + 1)
        size = np.abs(between[:, core][:, :-1]).sum(axis=1)
        block = slice(REACH, REACH + last - first + 1)
        self._y[: layout.n_out, block] = outputs[:, core].copy()
        self._fine = fine[:, core] - fine[:, core.start, None]
        self._integrals[:, block] = self._fine[layout.integrated]
        self._compared()
        ahead = (min(last + ROWS_AHEAD + 1, high) - low) // 2 + 1
        error = fine[:, : 2 * ahead : 2] - half[:, :ahead]
        error = error[:, core.start // 2 :] - error[:, core.start // 2, None]
        self._most, self._least = (f.accumulate(error, axis=1) for f in (np.maximum, np.minimum))
        within = slice(core.start // 4, (last - low) // 4 + 1)
        coarse = half[:, ::2][:, within] - quarter[:, within]
        end = (last - first) // 2
        return {
            "value": self._fine[:, -1],
            "error": error[:, end],
            "most": self._most[:, end],
            "least": self._least[:, end],
            "finer": np.abs(np.diff(error[:, : end + 1], axis=1)).sum(axis=1),
            "coarser": np.abs(np.diff(coarse, axis=1)).sum(axis=1),
            "size": size,
        }

    def value(self, rows: NDArray[np.intp]) -> Array:
        """∫P from the block's first row to others (k, n), over h."""
        return self._running.value(rows) if self._fine is None else self._fine[:, rows].T

    def reached(self, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """The largest and the least error up to rows (k, n), over h."""
        if self._fine is None:
            return self._running.reached(rows)
        # A bar is that of the next row but one that windows on every second row see.
        second = np.minimum((rows + ROWS_AHEAD + 1) // 2, self._most.shape[1] - 1)
        return self._most[:, second].T, self._least[:, second].T


def _whole(rows: int) -> int:
    """So many rows, and those that complete a `LANES`."""
    return -(-rows // LANES) * LANES


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
) -> RowValues | None:
    """One pass over equidistant samples without events.

    Of the samples about `keep` rows are kept, one of `PART` at least; all if None. None where samples are of
    another kind, or powers at the samples do not suffice for integrals that are exact to rounding.
    """
    count = len(samples.t)
    aside = samples.inward is not None or samples.steady or samples.derived
    enough = LONG_RUN if keep is None else max(ROWS_A_BLOCK, ROWS_A_KEPT * keep)
    if aside or count < enough or not equidistant(samples.t):
        return None
    part = 1 if keep is None else min(max(count // keep, 1), PART)
    if part > 8 * LANES:
        part -= part % LANES
    unit = math.lcm(part, LANES)
    size = unit * max(1, ROWS_A_BLOCK // unit)
    layout = _Layout(symbols, kernels, functions)
    starts = range(0, count - 1, size)
    rows_kept = _All(layout, count) if keep is None else _Some(layout, part, count)
    turns, sums = _Turns(), list[_Sums]()
    nothing = np.zeros(layout.n_between)
    gained, unbounded = np.zeros(layout.n_functions), np.full(5, np.inf)
    before = _Before(nothing, nothing, nothing, gained, unbounded, -unbounded)
    workers = min(cores(), len(starts))

    def work(number: int) -> None:
        nonlocal before
        worker = _BlockWorker(samples, log, kernels, layout, size)
        for k in range(number, len(starts), workers):
            check_cancelled()
            steps, block = worker.evaluate(starts[k])
            with turns.turn(k):
                start, before = before, before.after(block)
                sums.append(block)
            rows_kept.keep(worker, starts[k], steps, start)

    kernels.at_samples.compile()
    spread(work, range(workers), workers)
    rows, outputs, value, worst = rows_kept.joined()
    width = float(samples.t[-1] - samples.t[0]) / (count - 1)
    finer, coarser = (np.sum([getattr(s, n) for s in sums], axis=0) for n in ("finer", "coarser"))
    bar = worst
    bar *= (width / reduction(finer, coarser, SAMPLED))[:, None]
    value *= width
    first, last = np.abs(outputs[layout.between][:, [0, -1]]).T
    size_of = width * (np.sum([s.size for s in sums], axis=0) + 0.5 * (last - first))
    leading = layout.leading
    if not exact_to_rounding(bar[leading, -1].max(), size_of[leading].max(), count):
        return None
    flow = np.append(np.sum([s.flow for s in sums], axis=0), size_of[layout.channels])
    return RowValues(
        rows,
        outputs,
        Integral(value.T, bar.T, "samples", observed_order(finer[leading], coarser[leading])),
        np.min([s.lowest for s in sums], axis=0),
        np.max([s.highest for s in sums], axis=0),
        dict(zip(kernels.powers, flow.tolist())),
        size_of,
    )


Joined: TypeAlias = tuple[NDArray[np.intp], Array, Array, Array]
"""Rows (K,), outputs at these (n, K), integrals and largest errors up to them (m, K), over h."""


class _All:
    """Keeps all rows."""

    def __init__(self, layout: _Layout, count: int) -> None:
        self._known = np.empty((layout.n_out, count))
        self._value, self._worst = np.empty((2, layout.n_between, count))

    def keep(self, worker: _BlockWorker, first: int, steps: int, before: _Before) -> None:
        """The rows of a block; the one after it too, where it is the last of all."""
        count = steps + (first + steps == self._known.shape[1] - 1)
        rows, block = np.arange(count), slice(first, first + count)
        self._known[:, block] = worker.known[:, :count]
        self._value[:, block] = (worker.value(rows) + before.value).T
        self._worst[:, block] = before.reached(*worker.reached(rows)).T

    def joined(self) -> Joined:
        """Everything that was kept."""
        return np.arange(self._known.shape[1]), self._known, self._value, self._worst


class _Some:
    """Keeps of each `part` of the rows the one where |ΔC| is largest, the log's ends, extremes of V, K."""

    def __init__(self, layout: _Layout, part: int, count: int) -> None:
        self._layout, self._part, self._last = layout, part, count - 1
        self._found: dict[int, Joined] = {}

    def keep(self, worker: _BlockWorker, first: int, steps: int, before: _Before) -> None:
        """Some rows of a block."""
        error = np.abs(worker.delta_c + before.delta_c[:, None]).max(axis=0)
        rows = _picked(error, self._part, first == 0, first + steps == self._last)
        if more := _extremes(worker, before):
            rows = np.unique(np.append(rows, more))
        self._found[first] = (
            rows + first,
            worker.known[:, rows],
            (worker.value(rows) + before.value).T,
            before.reached(*worker.reached(rows)).T,
        )

    def joined(self) -> Joined:
        """Everything that was kept, in order."""
        parts = zip(*(self._found[first] for first in sorted(self._found)))
        rows, outputs, value, worst = (np.concatenate(part, axis=-1) for part in parts)
        return rows, outputs, value, worst


def _extremes(worker: _BlockWorker, before: _Before) -> list[int]:
    """Rows of a block at which V or K is larger or smaller than ever before."""
    rows, sums = list[int](), worker.sums
    for k, energy in ((-2, worker.V), (-1, worker.K)):
        if sums.highest[k] > before.highest[k]:
            rows.append(int(energy.argmax()))
        if sums.lowest[k] < before.lowest[k]:
            rows.append(int(energy.argmin()))
    return rows


def _picked(error: Array, part: int, first: bool, last: bool) -> NDArray[np.intp]:
    """Of each part of a block (B,) the row that is furthest `off`; the ends of the log too."""
    whole = (len(error) - 1) // part * part  # the last row is the next block's first
    rows = error[:whole].reshape(-1, part).argmax(axis=1) + np.arange(0, whole, part)
    rest = error[whole : None if last else -1]
    more = [0] * first + [len(error) - 1] * last
    if len(rest):
        more.append(whole + int(rest.argmax()))
    return np.unique(np.append(rows, more)) if more else rows
