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

from deltac.arrays import Array, medians
from deltac.calls.arguments import checked
from deltac.errors import InputError

Trend = Literal[
    "falls to zero", "tends to a limit", "at its floor", "does not settle", "one run", "two runs"
]

CLEAR = 4.0
"""A curve, or a difference of two, counts from so many floors (rounding, quadrature) on."""

WELL_CLEAR = 30.0
"""An order is taken where rounding is less than a thirtieth: it is then off by 0.05 at most."""

SAFETY = 1.25
"""Roache's factor on the extrapolated correction, for its uncertainty with three or more steps."""

SURE_LIMIT = 10.0
"""A limit counts as not zero from so many of its uncertainties on."""

LEAST_ORDER = 0.5
"""What falls more slowly with the step is not seen to fall: non-smooth motions show 0.5 to 1."""

AGREE = 0.1
"""Orders at neighbouring steps that differ by less are averaged: the digits of the data limit them."""

UNVERIFIED = 0.05
"""Share of an order by which it may be off where no neighbouring steps confirm it: terms of higher order."""

EARLY = 8
"""The first so many parts of the time tell truncation from rounding, before either is amplified."""

LARGEST_ORDER = 20.0


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
    return _told(_to_zero(h, y, sizes, floors), sizes, floors)


def _to_zero(h: Array, y: Array, sizes: Array, floors: Array) -> Convergence:
    clear = sizes / CLEAR > floors
    if not clear.any():
        return Convergence("at its floor", limit=0.0, limit_error=float(floors.min()))
    if len(h) == 1:
        return Convergence("one run")
    # Quadrature on coarse samples may be worse than the motion; finer samples mend that.
    first = int(np.argmax(clear))
    h, y, sizes, floors = (x[first:] for x in (h, y, sizes, floors))
    clear = clear[first:]
    count = len(h) if clear.all() else int(np.argmin(clear))
    limit, limit_error, three = _limit(h, y, floors)
    if three is not None and abs(limit) > SURE_LIMIT * limit_error:
        return Convergence(
            "tends to a limit", *three, limit, limit_error, tuple(map(float, h[-3:]))
        )
    pairs = [
        (i, _estimates(h[i : i + 2], y[i : i + 2])) for i in range(len(h) - 1) if i + 1 < count
    ]
    if not pairs:
        # All finer runs are at the floor: they fell as far as can be seen.
        falls = count < len(h)
        rate = _pair_order(h[count - 1 : count + 1], sizes[count - 1 : count + 1]) if falls else 0.0
        trend: Trend = "falls to zero" if rate >= LEAST_ORDER else "does not settle"
        return Convergence(trend, limit=limit, limit_error=limit_error)
    well_clear = [pair for pair in pairs if sizes[pair[0] + 1] > WELL_CLEAR * floors[pair[0] + 1]]
    last, estimates = (well_clear or pairs)[-1]
    falling = float(medians(np.array(pairs[-1][1]))) >= LEAST_ORDER
    order, error = _with_neighbours(last, estimates, pairs, of_maximum=True)
    certain = falling and order > 0.0
    return Convergence(
        "falls to zero" if falling else "does not settle",
        order if certain else None,
        error if certain else None,
        limit,
        limit_error,
        (float(h[last]), float(h[last + 1])),
    )


def between_runs(h: Array, x: Array, floors: Array) -> Convergence:
    """Convergence of states x (n, T, m) to a limit that is not known, by differences of successive runs."""
    steps = np.diff(x, axis=0)
    rms = np.sqrt(np.mean(steps**2, axis=2))  # (n - 1, T)
    sizes = rms.max(axis=1) if len(rms) else np.zeros(0)
    return _told(_to_a_limit(h, steps, rms, sizes, floors), sizes, floors)


def _to_a_limit(h: Array, steps: Array, rms: Array, sizes: Array, floors: Array) -> Convergence:
    if len(h) == 1:
        return Convergence("one run")
    # A motion may amplify rounding as it amplifies truncation: they are told apart by how they begin.
    early = rms[:, : max(2, rms.shape[1] // EARLY)].max(axis=1) if len(rms) else sizes
    clear = early > WELL_CLEAR * floors[1:]
    if not clear.any():
        return Convergence("at its floor", limit_error=float(floors.min()))
    triples = []
    for i in range(len(h) - 2):
        if clear[i] and clear[i + 1]:
            orders = _difference_orders(h[i : i + 3], rms[i], rms[i + 1])
            if orders:
                triples.append((i, orders))
    if not triples:
        if clear[-1]:
            return Convergence("does not settle" if len(h) > 2 else "two runs")
        return Convergence("at its floor", limit_error=float(floors.min()))
    first, estimates = triples[-1]
    order, error = _with_neighbours(first, estimates, triples)
    trend: Trend = "tends to a limit" if order >= LEAST_ORDER else "does not settle"
    settles = trend == "tends to a limit"
    return Convergence(
        trend,
        order if settles else None,
        error if settles else None,
        steps=tuple(float(s) for s in h[first : first + 3]),
    )


def _told(convergence: Convergence, sizes: Array, floors: Array) -> Convergence:
    return replace(convergence, sizes=tuple(map(float, sizes)), floors=tuple(map(float, floors)))


# --- parts ---------------------------------------------------------------------------------------


def _limit(
    h: Array, y: Array, floors: Array
) -> tuple[float, float, tuple[float | None, float | None] | None]:
    """Largest |L| and its uncertainty; with (order, error) where the last three runs tell.

    The uncertainty takes the correction that first order would ask for, where the observed order is
    higher: an order that was hit by chance must not make a limit certain.
    """
    size = float(np.abs(y[-1]).max())
    if len(h) < 3:
        return size, math.inf, None
    coarse, fine = y[-3] - y[-2], y[-2] - y[-1]
    largest = float(np.abs(fine).max())
    noise = float(floors[-2:].max())
    if largest <= CLEAR * noise and size > CLEAR * noise:
        # The curves coincide as far as can be seen.
        return size, SAFETY * max(largest, CLEAR * noise), (None, None)
    estimates = _difference_orders(h[-3:], np.abs(coarse), np.abs(fine))
    order, error = _centre(estimates) if estimates else (0.0, 0.0)
    if order < LEAST_ORDER:
        # They differ at no order that could be told: as far as that goes, they are the limit themselves.
        largest = max(largest, float(np.abs(coarse).max()))
        slowly = _weight(h[-2], h[-1], LEAST_ORDER)
        return size, SAFETY * slowly * largest + noise, (None, None)
    extrapolated = y[-1] - _weight(h[-2], h[-1], order) * fine
    careful = _weight(h[-2], h[-1], min(order, 1.0))
    uncertainty = SAFETY * careful * largest + noise
    return float(np.abs(extrapolated).max()), uncertainty, (order, error)


def _weight(coarse: float, fine: float, order: float) -> float:
    """Richardson's: L = y_fine − weight (y_coarse − y_fine)."""
    ratio = (coarse / fine) ** order
    return float(1.0 / (ratio - 1.0))


def _estimates(h: Array, y: Array) -> list[float]:
    """Orders of a pair of curves (2, T) that fall to zero: by maximum and mean square."""
    return [_pair_order(h, np.array(pair)) for pair in _measures(np.abs(y[0]), np.abs(y[1]))]


def _pair_order(h: Array, sizes: Array) -> float:
    return float(np.log(sizes[0] / sizes[1]) / np.log(h[0] / h[1])) if sizes[1] > 0.0 else math.inf


def _difference_orders(h: Array, coarse: Array, fine: Array) -> list[float]:
    """Orders by which two successive differences (T,) of three runs fall."""
    orders = [_richardson_order(h, a / b) for a, b in _measures(coarse, fine)]
    return [r for r in orders if r is not None]


def _measures(a: Array, b: Array) -> list[tuple[float, float]]:
    """Sizes of two curves, largest and in the mean; only where both are there."""
    pairs = [(float(a.max()), float(b.max())), (_rms(a), _rms(b))]
    return [(p, q) for p, q in pairs if p > 0.0 and q > 0.0]


def _rms(values: Array) -> float:
    top = float(np.abs(values).max(initial=0.0))
    return top * float(np.sqrt(np.mean((values / top) ** 2))) if top > 0.0 else 0.0


def _richardson_order(h: Array, ratio: float) -> float | None:
    """The r with (h0ʳ − h1ʳ) / (h1ʳ − h2ʳ) = ratio, by bisection; it grows with r.

    None where there is none between 0 and `LARGEST_ORDER`.
    """
    a, b = math.log(h[0] / h[1]), math.log(h[1] / h[2])

    def excess(r: float) -> float:
        return math.expm1(r * a) / -math.expm1(-r * b) - ratio

    low, high = 1e-9, LARGEST_ORDER
    if excess(low) > 0.0:
        return 0.0  # the differences do not fall
    if excess(high) < 0.0:
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return round(0.5 * (low + high), 12)


def _centre(estimates: Sequence[float], *, of_maximum: bool = False) -> tuple[float, float]:
    """Median, or the order of the maximum, and half of the spread; of what is not finite there is none."""
    if of_maximum and math.isfinite(estimates[0]):
        _, spread = _centre(estimates)
        return round(estimates[0], 12), spread
    finite = [x for x in estimates if math.isfinite(x)]
    if len(finite) < len(estimates):
        return round(float(medians(np.array(finite or [0.0]))), 12), math.inf
    return round(float(medians(np.array(estimates))), 12), 0.5 * float(np.ptp(estimates))


def _with_neighbours(
    chosen: int,
    estimates: Sequence[float],
    pairs: Sequence[tuple[int, list[float]]],
    *,
    of_maximum: bool = False,
) -> tuple[float, float]:
    """Order and error with what the next coarser steps say: their mean where they agree."""
    order, error = _centre(estimates, of_maximum=of_maximum)
    coarser = [_centre(e, of_maximum=of_maximum)[0] for i, e in pairs if i == chosen - 1]
    if not coarser:
        error = max(error, UNVERIFIED * abs(order))
    for other in coarser:
        error = max(error, 0.5 * abs(order - other))
        if abs(order - other) <= AGREE:
            order = round(0.5 * (order + other), 12)
    return order, error
