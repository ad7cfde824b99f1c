"""Integrals of powers at equidistant samples, and what their error bars are made of, from row to row.

Away from the ends of a log, `EvenSums` sums every sample once. The differences between integrals over all,
every second and every fourth row are such sums too, of alternating signs. So a row costs a few sums whatever
the order is, and the columns of a log go side by side through SIMD vectors. All numbers here are in units of
the interval h.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.energy.sampling.quadrature import SAMPLED, TAPS, EvenSums
from deltac.kernels import Kernel
from deltac.kernels.kernel import SX
from deltac.kernels.simd import LINE, aligned

REACH = 4 * TAPS
"""Rows on either side that the sum over every fourth row reaches into."""

ROWS_AHEAD = SAMPLED // 2
"""Rows after one that windows on every second row see it through: its bar is that of these."""

CALL_ROWS = (128, 8)
"""Rows in a call: of most of a block, and of its rest."""

LANES = LINE // np.dtype(np.float64).itemsize
"""Columns are made up to a multiple of this, a line of the cache."""

STATE = ("sum", "odd", "half", "error", "coarse", "most", "least", "finer", "coarser", "size")


class _Around:
    """What windows around a row add to the sums before it, by symbols of the powers from row −`REACH` on."""

    def __init__(self, powers: SX) -> None:
        self._P, self._tau = powers, EvenSums(1.0).tails

    def apart(self, n: int, k: int) -> SX:
        return self[n + k] - self[n - k]

    def __getitem__(self, n: int) -> SX:
        return self._P[REACH + n]

    def g(self, n: int) -> SX:
        """Of an integral over all rows."""
        return 0.5 * self[n] + sum(t * self.apart(n, k) for k, t in enumerate(self._tau, start=1))

    def error(self, n: int, step: int) -> SX:
        """Of that over rows `step` apart, less the one over every second of these; over `step`."""
        weights = np.zeros(2 * TAPS + 1)
        weights[1 : TAPS + 1] += self._tau
        weights[2::2] -= 2.0 * self._tau
        near = sum(w * self.apart(n, step * k) for k, w in enumerate(weights) if w)
        return near - 0.5 * self[n]


@lru_cache(maxsize=1)
def _start_kernel() -> Kernel:
    """The first numbers of the state before a row, with which the integrals there are zero."""
    P = ca.SX.sym("P", 2 * REACH + 1)
    at = _Around(P)
    start = ca.vertcat(at.g(0), at.error(0, 1), at.error(0, 2))
    return Kernel({"P": P}, {"state": -start}, name="start of running integrals")


@lru_cache(maxsize=4)
def _running_kernel(rows: int) -> Kernel:
    """From row a on: integrals at each of so many `rows`, and the extremes of their errors so far.

    Inputs: the powers at rows a − `REACH` to a + rows + `REACH`, and the state that the piece before left.
    """
    P, state = ca.SX.sym("P", rows + 2 * REACH + 1), ca.SX.sym("state", len(STATE))
    s = dict(zip(STATE, ca.vertsplit(state)))
    at = _Around(P)
    value: list[SX] = []
    most: list[SX] = []
    least: list[SX] = []
    last = s["error"]
    for n in range(rows + ROWS_AHEAD + 1):
        if n % 2 == 0 and n:
            s["odd"] = s["odd"] + (at[n - 1] - at[n - 2])
            now = s["odd"] + at.error(n, 1)
            if n > rows:  # only looked ahead to
                high, low = ca.fmax(most[-1], now), ca.fmin(least[-1], now)
            else:
                s["finer"] += ca.fabs(now - last)
                high, low = s["most"], s["least"] = (
                    ca.fmax(s["most"], now),
                    ca.fmin(s["least"], now),
                )
                last = now
            if n >= ROWS_AHEAD:
                most.append(high)
                least.append(low)
            if n == rows:
                ends = s["odd"]
        if n % 4 == 0 and 0 < n <= rows:
            s["half"] = s["half"] + (at[n - 2] - at[n - 4])
            coarse = 2.0 * (s["half"] + at.error(n, 2))
            s["coarser"] += ca.fabs(coarse - s["coarse"])
            s["coarse"] = coarse
        if n < rows:
            value.append(s["sum"] + at.g(n))
            s["sum"] = s["sum"] + at[n]
            s["size"] = s["size"] + ca.fabs(at[n])
    value.append(s["sum"] + at.g(rows))
    s |= {"odd": ends, "error": last}
    outputs = {"value": value, "most": most, "least": least, "state": [s[name] for name in STATE]}
    columns = {name: ca.vertcat(*entries) for name, entries in outputs.items()}
    return Kernel({"P": P}, columns, state, name="running integrals")


class Running:
    """Integrals within a block of rows, of several columns; it owns the memory that it works in.

    `powers` (rows + 2 `REACH` + 1, n) are to be written, from row −`REACH` of the block on, before it is
    called. A block begins at a multiple of four rows, and `rows` are a multiple of eight.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self.columns = columns
        lanes = -(-columns // LANES) * LANES
        self._powers = aligned(rows + 2 * REACH + 1, lanes)
        self.powers = self._powers[:, :columns]
        cuts = [0]
        for size in CALL_ROWS:
            cuts += range(cuts[-1] + size, rows + 1, size)
        kernels = [_running_kernel(b - a) for a, b in pairwise(cuts)]
        self._found = aligned(sum(k.n_out for k in kernels), lanes)
        self._value, self._most, self._least = np.zeros((3, rows + 1), dtype=np.intp)
        before = aligned(len(STATE), lanes)
        around = self._powers[: 2 * REACH + 1]
        start = _start_kernel()
        self._calls = [start.bound_batch(around, before[: start.n_out])]
        top = 0
        for (a, b), kernel in zip(pairwise(cuts), kernels):
            out = self._found[top : top + kernel.n_out]
            x = self._powers[a : b + 2 * REACH + 1]
            self._calls.append(kernel.bound_batch(x, out, before))
            places = {name: top + where.start for name, where in kernel.output_slices.items()}
            self._value[a : b + 1] = places["value"] + np.arange(b - a + 1)
            looked = (np.arange(b - a + 1) + 1) // 2
            self._most[a : b + 1], self._least[a : b + 1] = (
                places[name] + looked for name in ("most", "least")
            )
            before = out[kernel.output_slices["state"]]
            top += kernel.n_out
        self._end = before[:, :columns]

    def __call__(self) -> dict[str, Array]:
        """Sum the block: the `STATE` after it (n,), and ∫ over all of it, ``value``."""
        for call in self._calls:
            call()
        whole = self._found[self._value[-1], : self.columns]
        return {**dict(zip(STATE, self._end.copy())), "value": whole.copy()}

    def value(self, rows: NDArray[np.intp]) -> Array:
        """∫ from the block's first row to others, and to the one after it (k, n)."""
        return self._found[self._value[rows], : self.columns]

    def column(self, k: int) -> Array:
        """∫ of one column from the block's first row to every row, and to the one after the block."""
        values: Array = self._found[self._value, k]
        return values

    def reached(self, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Largest and least error so far (k, n), and `ROWS_AHEAD`, of the rows of a block."""
        return (
            self._found[self._most[rows], : self.columns],
            self._found[self._least[rows], : self.columns],
        )
