"""Integrals of powers at equidistant samples, and what their error bars are made of, from row to row.

Away from the ends of a log, `lagrange` sums every sample once, with weights that differ from one near either
end of an integral alone (as Gregory's rule does): with τ_i the tail sums of a window's weights,

    ∫ P dt / h from row a to row n = Σ P_m (a ≤ m < n) + g_n − g_a,   g_n = P_n/2 + Σ τ_i (P_{n+i} − P_{n−i}).

The differences between integrals over all, every second and every fourth row are such sums too, of alternating
signs. So a row costs a few sums whatever the order is, and the columns of a log go side by side through SIMD
vectors. All numbers here are in units of the interval h.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.energy.sampling.interpolation import lagrange_kernel
from deltac.kernels import Kernel
from deltac.kernels.kernel import SX
from deltac.kernels.transposing import aligned

SAMPLED = 8
"""Samples in a window of `lagrange`."""

TAPS = SAMPLED // 2 - 1
REACH = 4 * TAPS
"""Rows on either side that the sum over every fourth row reaches into."""

AHEAD = 4
"""Rows after one that windows on every second row see it through: its bar is that of these."""

PIECES = (128, 8)
"""Rows in a call: of most of a block, and of its rest."""

LANES = 8
"""Columns are made up to a multiple of this."""

STATE = ("sum", "odd", "half", "error", "coarse", "most", "least", "finer", "coarser", "size")


@lru_cache(maxsize=1)
def _tails() -> Array:
    """τ_1, τ_2, τ_3: of the weights of an interval's window those beyond its end."""
    places = np.arange(SAMPLED, dtype=float) - TAPS
    weights = lagrange_kernel(SAMPLED)(z=places, width=1.0)["weights"].ravel()
    return np.array([weights[SAMPLED - k :].sum() for k in range(TAPS, 0, -1)])


@lru_cache(maxsize=1)
def _at_row() -> Array:
    """Weights (3, 2 `REACH` + 1) of the rows around one in its g and in those of the two differences."""
    found = np.zeros((3, 2 * REACH + 1))
    for k, tau in enumerate(_tails(), start=1):
        for row, step, sign in ((0, 1, 1.0), (1, 1, 1.0), (1, 2, -2.0), (2, 2, 1.0), (2, 4, -2.0)):
            found[row, REACH + k * step] += sign * tau
            found[row, REACH - k * step] -= sign * tau
    found[:, REACH] = (0.5, -0.5, -0.5)
    return found


@lru_cache(maxsize=4)
def _running_kernel(rows: int) -> Kernel:
    """From row a on: integrals at each of so many `rows`, and the extremes of their errors so far.

    Inputs: the powers at rows a − `REACH` to a + rows + `REACH`, and the state that the piece before left.
    """
    P, given = ca.SX.sym("P", rows + 2 * REACH + 1), ca.SX.sym("state", len(STATE))
    s = dict(zip(STATE, ca.vertsplit(given)))
    tau = _tails()

    def apart(n: int, k: int) -> SX:
        return P[REACH + n + k] - P[REACH + n - k]

    def g(n: int) -> SX:
        return 0.5 * P[REACH + n] + sum(tau[k - 1] * apart(n, k) for k in range(1, TAPS + 1))

    def error(n: int, step: int) -> SX:
        """Of all against every second row of those `step` apart, without the sum of alternating signs."""
        weights: dict[int, float] = {}
        for k, each in enumerate(tau, start=1):
            weights[k] = weights.get(k, 0.0) + each
            weights[2 * k] = weights.get(2 * k, 0.0) - 2.0 * each
        near = sum(w * apart(n, step * k) for k, w in weights.items())
        return near - 0.5 * P[REACH + n]

    value, most, least = [], [], []
    last = s["error"]
    for n in range(rows + AHEAD + 1):
        if n % 2 == 0 and n:
            s["odd"] = s["odd"] + (P[REACH + n - 1] - P[REACH + n - 2])
            now = s["odd"] + error(n, 1)
            if n > rows:  # only looked ahead to
                high, low = ca.fmax(most[-1], now), ca.fmin(least[-1], now)
            else:
                s["finer"] += ca.fabs(now - last)
                high, low = s["most"], s["least"] = ca.fmax(s["most"], now), ca.fmin(s["least"], now)
                last = now
            if n >= AHEAD:
                most.append(high)
                least.append(low)
            if n == rows:
                ends = s["odd"]
        if n % 4 == 0 and 0 < n <= rows:
            s["half"] = s["half"] + (P[REACH + n - 2] - P[REACH + n - 4])
            coarse = 2.0 * (s["half"] + error(n, 2))
            s["coarser"] += ca.fabs(coarse - s["coarse"])
            s["coarse"] = coarse
        if n < rows:
            value.append(s["sum"] + g(n))
            s["sum"] = s["sum"] + P[REACH + n]
            s["size"] = s["size"] + ca.fabs(P[REACH + n])
    value.append(s["sum"] + g(rows))
    s |= {"odd": ends, "error": last}
    outputs = {"value": value, "most": most, "least": least, "state": [s[name] for name in STATE]}
    columns = {name: ca.vertcat(*entries) for name, entries in outputs.items()}
    return Kernel({"P": P}, columns, given, name="running integrals")


class Running:
    """Integrals within a block of rows, of several columns; it owns the memory that it works in.

    `powers` (rows + 2 `REACH` + 1, n) are to be written before each call of `run`, from row −`REACH` of the
    block on. A block begins at a multiple of four rows, and `rows` are a multiple of eight.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self.columns = columns
        lanes = -(-columns // LANES) * LANES
        self._powers = aligned(rows + 2 * REACH + 1, lanes)
        self.powers = self._powers[:, :columns]
        cuts = [0]
        for size in PIECES:
            cuts += range(cuts[-1] + size, rows + 1, size)
        kernels = [_running_kernel(b - a) for a, b in zip(cuts, cuts[1:])]
        self._start = aligned(len(STATE), lanes)
        self._found = aligned(sum(k.n_out for k in kernels), lanes)
        self._value, self._most, self._least = np.zeros((3, rows + 1), dtype=np.intp)
        self._calls, before, top = [], self._start, 0
        for a, b, kernel in zip(cuts, cuts[1:], kernels):
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
        self._end = before

    def run(self) -> None:
        """All rows of the block."""
        g = _at_row() @ self._powers[: 2 * REACH + 1]
        np.negative(g, out=self._start[:3])
        for call in self._calls:
            call()

    def value(self, rows: NDArray[np.intp] | slice) -> Array:
        """∫ from the block's first row to others (k, n); its last is that after the block."""
        return self._found[self._value[rows], : self.columns]

    def of(self, column: int) -> Array:
        """∫ of one column from the block's first row to each, and to the one after the block (rows + 1,)."""
        return self._found[self._value, column]

    def reached(self, rows: NDArray[np.intp] | slice) -> tuple[Array, Array]:
        """Largest and least error so far (k, n), and `AHEAD`, of the rows of a block."""
        return (
            self._found[self._most[rows], : self.columns],
            self._found[self._least[rows], : self.columns],
        )

    def end(self, name: str) -> Array:
        """A state (n,) after the block."""
        found: Array = self._end[STATE.index(name), : self.columns]
        return found.copy()


@lru_cache(maxsize=4)
def _flow_kernel(rows: int) -> Kernel:
    """Σ min(|P_n| + |P_{n+1}|, bound |W_{n+1} − W_n|) over so many intervals, added to what was before."""
    x, given = ca.SX.sym("x", 2 * (rows + 1)), ca.SX.sym("given", 2)
    P, W = ca.fabs(x[0::2]), x[1::2]
    total = given[0]
    for n in range(rows):
        total += ca.fmin(P[n] + P[n + 1], given[1] * ca.fabs(W[n + 1] - W[n]))
    return Kernel({"x": x}, {"total": ca.vertcat(total, given[1])}, given, name="flow")


class Flow:
    """∫|P| dt within a block of rows, of columns that come with the work W up to each row.

    An interval counts no more than `bound` |ΔW|, with W in units of the trapezoid of |P|. `powers` and `works`
    (rows + 1, n) are to be written before each call of `run`.
    """

    def __init__(self, rows: int, columns: int, bound: float) -> None:
        lanes = -(-columns // LANES) * LANES
        both = aligned(2 * (rows + 1), lanes)
        self.powers, self.works = both[0::2, :columns], both[1::2, :columns]
        self.columns = columns
        cuts = [0]
        for size in PIECES:
            cuts += range(cuts[-1] + size, rows + 1, size)
        found = aligned(len(cuts), 2, lanes)
        found[0, 1] = 2.0 * bound
        self._end = found[-1, 0]
        self._calls = [
            _flow_kernel(b - a).bound_batch(both[2 * a : 2 * b + 2], found[k + 1], found[k])
            for k, (a, b) in enumerate(zip(cuts, cuts[1:]))
        ]

    def run(self) -> Array:
        """The sums (n,)."""
        for call in self._calls:
            call()
        return 0.5 * self._end[: self.columns]
