"""How curves y(t; h) depend on the step h: y ≈ L(t) + C(t) hʳ, with uncertainties.

Richardson's extrapolation on whole curves. Differences of successive curves are free of the limit L and
give the order r; where the limit is zero, the curves themselves give it too, with one run less.
References: L. F. Richardson, Phil. Trans. R. Soc. A 210 (1911) 307-357; P. J. Roache, J. Fluids Eng. 116
(1994) 405-413, for the uncertainty of an extrapolated limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from deltac.arrays import NEGLIGIBLE, Array, max_norm
from deltac.calls.arguments import checked
from deltac.diagnosis.verdict import LEAST_ORDER
from deltac.errors import InputError

Trend = Literal[
    "falls to zero", "tends to a limit", "at its floor", "does not settle", "one run", "two runs"
]

CLEAR = 4.0
"""A curve, a difference or a limit counts beyond this multiple of its uncertainty (rounding, quadrature,
terms of higher order)."""

EARLY = 32
"""The first of so many parts of the time tells truncation from rounding, before either is amplified."""

FEWEST_TIMES = 8
"""Common times below which curves are not compared over time."""


@dataclass(frozen=True)
class Convergence:
    """What became of a quantity as the step was refined.

    Attributes:
        trend: "falls to zero"; "tends to a limit" that is not zero; "at its floor": no more than rounding
            and quadrature at every step; "does not settle": what is there falls at no order; "one run"; "two
            runs": too few for what tends to a limit that is not known.
        order: observed order r; None where it cannot be told.
        order_error: half of the spread of its estimates: by maximum, mean square, and neighbouring steps. Of
            curves that fall to zero the order itself is that of the maximum.
        limit: largest |L(t)|, extrapolated to h = 0, in the unit of the quantity.
        limit_error: its uncertainty.
        steps: of the runs that gave the order, coarsest first.
        sizes: largest |y| for each step of the study (of the differences, for a state).
        floors: what rounding and quadrature explain of each.
    """

    trend: Trend
    order: float | None = None
    order_error: float | None = None
    limit: float = math.nan
    limit_error: float = math.nan
    steps: tuple[float, ...] = ()
    sizes: tuple[float, ...] = ()
    floors: tuple[float, ...] = ()

    def __str__(self) -> str:
        if self.order is None:
            return self.trend
        return f"order {order_text(self)}"


def order_text(convergence: Convergence) -> str:
    """The order with its error: "5.0 ± 0.1"."""
    assert convergence.order is not None
    error = max(convergence.order_error or 0.0, 0.01)
    digits = 1 if error >= 0.05 else 2
    return f"{convergence.order:.{digits}f} ± {error:.{digits}f}"


@checked
def observed_order(
    steps: Sequence[float] | Array,
    values: Array | Sequence[float],
    floor: float | Sequence[float] | Array = 0.0,
) -> Convergence:
    """Order at which a quantity whose limit may be zero falls with the step.

    Args:
        steps: of the runs, s (or tolerances); decreasing.
        values: for each step its error, a number, or a curve of T of them: shape (n,) or (n, T).
        floor: rounding or other error of the values themselves, one for all or one for each step.

    Returns:
        What the values tend to, and how fast.

    Raises:
        InputError: steps do not decrease, or shapes do not fit.

    >>> observed_order([4e-3, 2e-3, 1e-3], [1.6e-1, 4e-2, 1e-2]).order
    2.0
    """
    h = np.asarray(steps, dtype=np.float64)
    y = np.asarray(values, dtype=np.float64)
    if h.ndim != 1 or not y.ndim or len(y) != len(h) or not len(h):
        raise InputError(f"found {h.size} steps and values of shape {y.shape}; expected one each")
    if not (np.isfinite(h).all() and (h > 0.0).all() and (np.diff(h) < 0.0).all()):
        raise InputError(f"steps are {list(h)}; expected positive numbers, the coarsest first")
    if not np.isfinite(y).all():
        raise InputError("the values are not all finite; leave out the runs that failed")
    floors = np.asarray(floor, dtype=np.float64)
    if floors.ndim and floors.shape != h.shape:
        raise InputError(f"floor has the shape {floors.shape}; expected a number, or one a step")
    return towards_zero(h, y.reshape(len(h), -1), np.broadcast_to(floors, h.shape))


def towards_zero(h: Array, y: Array, floors: Array) -> Convergence:
    """Convergence of curves (n, T) that are zero when all is right."""
    sizes = np.abs(y).max(axis=1)
    return _with_sizes(_to_zero(h, y, sizes, floors), sizes, floors)


def _to_zero(h: Array, y: Array, sizes: Array, floors: Array) -> Convergence:
    clear = sizes > CLEAR * floors
    if not clear.any():
        return Convergence("at its floor", limit=0.0, limit_error=float(floors.min()))
    # Quadrature on coarse samples may be worse than the motion; finer samples mend that.
    first = int(np.argmax(clear))
    h, y, sizes, floors = (x[first:] for x in (h, y, sizes, floors))
    clear = clear[first:]
    if len(h) == 1:
        return Convergence("does not settle" if first else "one run")
    limit, limit_error, three = _limit(h, y, floors)
    if limit > CLEAR * limit_error:
        steps = tuple(map(float, h[-3:]))
        return Convergence("tends to a limit", *three, limit, limit_error, steps)
    # The finest pair that is clear; where only one run is, the next one shows whether it fell to its floor.
    count = len(h) if clear.all() else int(np.argmin(clear))
    orders = [_orders(h[i : i + 2], *np.abs(y[i : i + 2])) for i in range(max(count - 1, 1))]
    falls = max(orders[-1]) >= LEAST_ORDER
    trend: Trend = "falls to zero" if falls else "does not settle"
    if count < 2 or not falls:
        return Convergence(trend, limit=limit, limit_error=limit_error)
    steps = tuple(map(float, h[count - 2 : count]))
    order = _with_error(orders, float(floors[count - 1] / sizes[count - 1]))
    return Convergence(trend, *order, limit, limit_error, steps)


def between_runs(h: Array, x: Array, floors: Array) -> Convergence:
    """Convergence of states x (n, T, m) to a limit that is not known, by differences of successive runs."""
    rms = np.sqrt(np.mean(np.diff(x, axis=0) ** 2, axis=2))  # (n - 1, T)
    return _with_sizes(_to_a_limit(h, rms, floors), rms.max(axis=1, initial=0.0), floors)


def _to_a_limit(h: Array, rms: Array, floors: Array) -> Convergence:
    if len(h) == 1:
        return Convergence("one run")
    # A motion may amplify rounding as it amplifies truncation: they are told apart by how they begin.
    early = rms[:, : max(2, rms.shape[1] // EARLY)].max(axis=1)
    clear = early > CLEAR * floors[1:]
    triples = [i for i in range(len(h) - 2) if clear[i] and clear[i + 1]]
    if not triples and not clear[-1]:
        return Convergence("at its floor", limit_error=float(floors.min()))
    if not triples:
        return Convergence("does not settle" if len(h) > 2 else "two runs")
    orders = [_orders(h[i : i + 3], rms[i], rms[i + 1]) for i in triples]
    if orders[-1][0] < LEAST_ORDER:
        return Convergence("does not settle")
    last = triples[-1]
    order = _with_error(orders, float(floors[last + 2] / early[last + 1]))
    return Convergence("tends to a limit", *order, steps=tuple(map(float, h[last : last + 3])))


def _with_sizes(convergence: Convergence, sizes: Array, floors: Array) -> Convergence:
    return replace(convergence, sizes=tuple(map(float, sizes)), floors=tuple(map(float, floors)))


# --- parts ---------------------------------------------------------------------------------------


def _limit(
    h: Array, y: Array, floors: Array
) -> tuple[float, float, tuple[float | None, float | None]]:
    """Largest |L| of the last three runs and its uncertainty; the order at which they tend to it, if any.

    The uncertainty is the correction that first order would ask for, where the observed order is higher: an
    order that was hit by chance must not make a limit certain. Curves that differ at no order, or by rounding
    alone, are the limit themselves, as far as that goes.
    """
    if len(h) < 3:
        return max_norm(y[-1]), math.inf, (None, None)
    coarse, fine = np.abs(np.diff(y[-3:], axis=0))
    noise, largest = float(floors[-2:].max()), float(fine.max())
    orders = [_orders(h[-3:], coarse, fine)]
    settles = largest > CLEAR * noise and orders[0][0] >= LEAST_ORDER
    if not settles and largest > CLEAR * noise:
        largest = max(largest, float(coarse.max()))
    slowest = min(orders[0][0], 1.0) if settles else LEAST_ORDER
    uncertainty = _weight(h, slowest) * largest + noise
    correction = _weight(h, orders[0][0]) * (y[-2] - y[-1]) if settles else 0.0
    order = _with_error(orders, noise / largest) if settles else (None, None)
    return max_norm(y[-1] - correction), uncertainty, order


def _weight(h: Array, order: float) -> float:
    """Richardson's: L = y_fine − weight (y_coarse − y_fine)."""
    return float(1.0 / ((h[-2] / h[-1]) ** order - 1.0))


def _orders(h: Array, coarse: Array, fine: Array) -> tuple[float, float]:
    """The order at which curves (T,) fall, by maximum and by mean square."""
    squares = (float(np.sqrt(np.mean(x**2))) for x in (coarse, fine))
    return order_of(h, float(coarse.max()), float(fine.max())), order_of(h, *squares)


def order_of(h: Array | Sequence[float], coarse: float, fine: float) -> float:
    """The order r of errors C hʳ at two steps, or of their differences at three; 0 where they do not fall.

    Of differences, r = ln(1 + ratio (1 − e^(−r b)))/a, with a and b the logarithms of the steps' ratios: a
    contraction, from above.
    """
    if not min(coarse, fine) > 0.0:
        return math.inf if coarse > 0.0 else 0.0
    a, ratio = math.log(h[0] / h[1]), coarse / fine
    if len(h) < 3:
        return round(math.log(ratio) / a, 12)
    b, order = math.log(h[1] / h[2]), math.log1p(ratio) / a
    for _ in range(200):
        order = math.log1p(-ratio * math.expm1(-order * b)) / a
    return round(order, 12)


def _with_error(orders: Sequence[tuple[float, float]], blur: float) -> tuple[float, float]:
    """The order of the finest steps by maximum, and its error.

    Half of the spread by maximum, by mean square, and at the next coarser steps; where there are none, terms
    of higher order may be in it. And `blur`, what else there is of the finest errors, as a share.
    """
    order, squares = orders[-1]
    if len(orders) < 2:
        return order, blur + max(0.5 * abs(order - squares), NEGLIGIBLE * order)
    return order, blur + 0.5 * max(abs(order - squares), abs(order - orders[-2][0]))
