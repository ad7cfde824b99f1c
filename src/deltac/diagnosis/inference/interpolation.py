"""How logged forces act between the rows, by likelihood: held, ramped or smooth, or through a filter.

What a force does otherwise between two rows is a column beside the integrator's fields and the best causes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.inference.comparison import LESS, HypothesisComparison, compared
from deltac.diagnosis.inference.forces import FORCES, HELD, InterpolatedForces, impulse
from deltac.diagnosis.inference.hypotheses import CERTAIN, Block, Fit, autocorrelation_time, nothing
from deltac.diagnosis.inference.linearisation import RELINEARISATIONS, Point, likelihood_of
from deltac.diagnosis.inference.methods import PARTS
from deltac.diagnosis.inference.result import OF_DELAYS

DELAYS, SPREADS = (-8, -4, -2, 0, 2, 4, 8), (0.5, 1, 2, 4)
"""Delays and deviations, in rows, of filters of forces that are compared: enough to linearise at."""

WITHIN_A_ROW = 1.0
"""Delays and deviations, in rows, up to which forces are held or ramped from row to row."""

BEYOND = 1.5
"""Delay, in that of a force that is held twice in each interval, beyond which it is the log's."""

MOST_LATE = 4
"""Rows by which forces may act later or earlier than they were logged, at most."""

SINGLY = 12
"""Columns of logged forces up to which each is asked on its own."""


def with_likeliest_forces(point: Point, best: Fit | None = None) -> Point:
    """The point at which forces act as is likeliest beside causes, or beside none; itself if they do so."""
    if point.forces.filter is not None or point.forces_known:
        return point
    best = best or nothing(len(point.coefficients))
    stairs = _with_stairs(point)
    if stairs is point:
        declared: Sequence[str] = point.forces.declared
    else:
        point, forces = stairs, stairs.forces
        own = zip(forces.stairs, forces.kinds, forces.declared, strict=True)
        declared = [kind if stair else before for stair, kind, before in own]
    if all(declared):
        return point
    for _ in range(RELINEARISATIONS):
        forces = _likeliest_forces(point, best, declared)
        same = forces.kinds == point.forces.kinds
        if same and np.array_equal(forces.logged.counts, point.forces.logged.counts):
            break
        # What forces do otherwise between rows looked like noise of the rows.
        point = point.with_flow(forces=forces).with_noise_of_rows().with_process_noise()
    return point


def _with_stairs(point: Point) -> Point:
    """The point at which forces are held that keep their values from most rows to the next.

    They change at rows, or else at any instant between two, of which they have the mean then. Itself where
    neither is likelier.
    """
    forces = point.forces
    if not any(forces.stairs):
        return point

    def likelihood(one: Point) -> float:
        Phi = one.tangent.Phi
        w = one.errors(one.flow.end, Phi)
        return likelihood_of(one.log, Phi, one.noise.total, w, one.tangent.effects)

    likeliest, most = point, likelihood(point) + CERTAIN
    for law in ("start", "mean"):
        kinds = [law if stair else kind for stair, kind in zip(forces.stairs, forces.kinds)]
        other = point.with_flow(forces=forces.of(kinds))
        if other.forces.kinds != forces.kinds:
            other = other.with_noise_of_rows().with_process_noise()
            if (now := likelihood(other)) > most:
                likeliest, most = other, now + CERTAIN
    return likeliest


def with_filter(point: Point, best: Fit) -> Point:
    """The point at which forces go through a filter that has odds beside causes; itself if none has.

    States that were filtered move as if the forces were.
    """
    if point.forces.filter is not None or point.forces_known:
        return point
    likeliest = _likeliest_filter(point, best)
    if likeliest is None:
        return point
    return point.filtered(*likeliest).with_columns().with_process_noise()


def closed_by_other_forces(
    comparison: HypothesisComparison, sample: int
) -> tuple[HypothesisComparison, list[HypothesisComparison]]:
    """The comparison with forces that are held, or straight between rows, if a method closes the rows then.

    With a mistake in the rows the likelihood without its cause does not tell how forces act: what it does
    is smooth, and kinks of forces are noise. Smooth ones that are half a step late may be held. What does not
    close a `sample` of the intervals closes no more of them. The second value are comparisons that were made
    from the same point as the first.
    """
    point, likeliest, others = comparison.point, comparison, list[HypothesisComparison]()
    if point.forces.filter is not None or point.forces_known:
        return comparison, others
    late = any(c.kind in OF_DELAYS for c in comparison.posterior.best.chosen)
    for kind in ("start", "ramp"):
        forces = point.forces.alike(kind)
        if forces.kinds == point.forces.kinds:
            continue
        moved = point.with_flow(forces=forces).with_noise_of_rows()
        if late or np.any(LESS * moved.log.noise[1] < point.log.noise[1]):
            moved = moved.with_process_noise()
            few = moved.sampled(sample)
            other = None if late else compared(few)
            if other is not None and not other.closing:
                continue
            if other is None or few is not moved:
                other = compared(moved)
            others.append(other)
            # How forces act is not known: what closes without a mistake in one way needs none in another.
            needless = other.accuses and likeliest.closing and not likeliest.accuses
            right = other.closing or (late and not other.accuses)
            if right and not needless and other.evidence > likeliest.evidence:
                likeliest = other
    return likeliest, others if likeliest is comparison else []


def acting_as_in(comparison: HypothesisComparison, function: str) -> Point:
    """The point with forces that act between the rows as the method implies; itself if they do already.

    Forces that are computed once a step are held over it, and so are those that keep their values over
    several rows. A method that evaluates forces after the step, at both ends, in between or at earlier rows
    needs them as a `function` of time, "smooth" or "ramp".
    """
    point, method, counts = comparison.point, comparison.methods[0], comparison.counts
    held = "step" if counts.max() > 1 else "start"
    holds = not method.later and (method.order == 1 or not (method.step or method.samples_once))
    of_rows = ("start",) if method.later else HELD if method.samples_once else ()
    # Nobody is asked more often than once a step.
    often = bool(np.any(point.forces.logged.counts > counts))

    def acting(kind: str, stair: bool) -> str:
        if stair and kind == "mean":
            return kind
        if (stair or (often and kind == "step")) and held == "start":
            return held
        if method.order == 1 and kind == "end":
            return "ramp"
        if holds:
            return held if FORCES[kind][0] == 0.0 and kind not in HELD else kind
        return function if method.order > 1 and kind in ("end", "mean", *of_rows) else kind

    forces = point.forces.of(list(map(acting, point.forces.kinds, point.forces.stairs)))
    in_steps = "step" in point.forces.kinds and not often
    if forces.filter is not None or (forces.kinds == point.forces.kinds and not often):
        return point
    return point.with_flow(forces=forces if in_steps else forces.held(counts))


def _likeliest_forces(point: Point, best: Fit, declared: Sequence[str]) -> InterpolatedForces:
    """How each logged force acts between two rows, by the likelihood beside the best causes.

    Those that are `declared` do so; others are "" there.
    """
    held, forces = _times_held(point), point.forces
    stairs = forces.held(held[0]) if held and "step" not in forces.kinds else forces
    kinds = [kind for kind in FORCES if kind != "step"]
    nodes = np.linspace(0.0, 1.0, 5)
    parts = [[stairs.logged.part(k, s) for k in range(4)] for s in nodes]
    of_parts, responses = np.moveaxis(np.array(parts), 1, 3), point.flow.force_responses
    columns = [
        column
        for k in range(len(responses))
        for column in impulse(
            responses[k : k + 1], of_parts[:, :, k : k + 1], point.log.intervals.h
        ).transpose(2, 0, 1)
    ]
    trial = _beside(point, _along(point, best), columns)
    p = trial.projected
    gram = np.block([[np.array([[p.rss]]), p.b[None]], [p.b[:, None], p.A]])
    tau = autocorrelation_time(trial.residual(np.linalg.pinv(p.A, rcond=1e-10) @ p.b))
    current = np.array([FORCES[kind] for kind in forces.kinds])
    laws = [FORCES[kind] for kind in kinds]
    laws += [(0.0, 1.0, 1.0, float(np.mean(stairs.logged.counts / counts))) for counts in held]
    own = [kinds.index(kind) if kind else -1 for kind in declared]
    chosen = _likeliest_laws(gram, trial.count / tau, own, current, np.array(laws), len(kinds))
    steps = [k - len(kinds) for k in chosen if k >= len(kinds)]
    if steps:
        forces = forces.held(held[steps[0]])
    return replace(forces, kinds=tuple("step" if k >= len(kinds) else kinds[k] for k in chosen))


def _times_held(point: Point) -> list[NDArray[np.intp]]:
    """How often (N,) forces may have been held in each interval, where rows are not all steps.

    A controller may be asked in every step, or in every few.
    """
    counts = point.log.counts
    ones = np.ones(len(point.log.intervals), dtype=np.intp)
    if counts is not None and counts.max() > 1:
        n = int(counts[0])
        return [counts] + [
            n // k * ones for k in PARTS if np.all(counts == n) and not n % k and n > k
        ]
    return [k * ones for k in PARTS] if point.run.provenance.step is None else []


def _likeliest_filter(point: Point, best: Fit) -> tuple[float, float] | None:
    """Delay and deviation (s) of a filter of all forces that has odds; None for none."""
    if not any(c.kind == "late-forces" for c in point.candidates):
        return None
    log, forces = point.log, point.forces
    h, nodes = float(np.median(log.intervals.h)), np.linspace(0.0, 1.0, 5)
    now = np.stack([forces.between(s) for s in nodes])
    filters = [(d * h, s * h) for d in DELAYS for s in SPREADS if max(abs(d), s) > WITHIN_A_ROW]
    columns = list[Array]()
    for filter_ in filters:
        other, _ = forces.filtered(log.intervals, log.pieces, *filter_)
        change = np.stack([other.between(s) for s in nodes]) - now
        columns.append(point.flow.moved_by_forces(change))
    trial = _beside(point, _along(point, best), columns)
    rss = _left(trial)
    k = int(np.argmin(rss))
    tau = autocorrelation_time(trial.residual(np.eye(len(rss))[k]))
    odds = 0.5 * trial.count / tau * np.log(trial.projected.rss / rss[k]) - np.log(len(rss))
    return filters[k] if odds > CERTAIN else None


def left_by_shifts(point: Point) -> dict[int, float]:
    """Variance of the prediction errors if forces act so many rows later than they were logged.

    By the number of rows, in units of the known noise, beside the columns of causes that the point has. A
    command may be logged steps before it acts, or after; between rows it is held or smooth. Empty where fewer
    numbers are left than the integrator's fields take: beside these any shift fits.
    """
    log, forces, nodes = point.log, point.forces, np.linspace(0.0, 1.0, 5)
    now = np.stack([forces.between(s) for s in nodes])
    whole = np.zeros(len(log.intervals), dtype=np.bool_)
    for a, b in log.pieces:
        whole[a + MOST_LATE : b - MOST_LATE] = True
    columns, late = list[Array](), list[int]()
    for m in range(-MOST_LATE, MOST_LATE + 1):
        for kind in ("smooth", "start") if m else [kind for kind in FORCES if kind != "step"]:
            other = forces.alike(kind)
            change = np.stack([np.roll(other.between(s), m, axis=0) for s in nodes]) - now
            columns.append(point.flow.moved_by_forces(change))
            late.append(m)
    of_causes = np.eye(len(point.coefficients))[:, point.of_equations]
    trial = _beside(point, np.column_stack([of_causes, point.coefficients]), columns, whole)
    left: dict[int, float] = {}
    if trial.count < len(trial.nuisance):
        return left
    for m, rss in zip(late, _left(trial).tolist(), strict=True):
        left[m] = min(rss / trial.count, left.get(m, np.inf))
    return left


def _left(trial: Block) -> Array:
    """RSS of prediction errors without each of the columns."""
    p = trial.projected
    return np.maximum(p.rss - 2.0 * p.b + np.diag(p.A), 1e-300)


def _along(point: Point, best: Fit) -> Array:
    """What coefficients do that are beside a fit, and in the last column those that there are."""
    return np.column_stack([best.tangent, point.coefficients])


def _beside(
    point: Point, along: Array, columns: list[Array], some: NDArray[np.bool_] | None = None
) -> Block:
    """Whitened prediction errors with columns (N, 2n), beside the integrator's fields and causes.

    Of the latter combinations (P, k), the last of which is there; of all or `some` intervals (N,).
    """
    tangent, prior = point.tangent, point.tangent.prior
    of_causes = tangent.transported([x @ along for x in point.columns])
    w = point.errors(point.flow.end, tangent.Phi)[:, :, None] + of_causes[:, :, -1:]
    B = np.concatenate([tangent.effects, of_causes[:, :, :-1]], axis=2)
    everything = np.concatenate([w, B, np.stack(columns, axis=2)], axis=2)
    innovations = point.log.innovations(tangent.Phi, point.noise.total)
    if some is None:
        white, _ = innovations(everything)
    else:  # other intervals must not act on these through the noise of the row that they share
        white, _ = innovations(np.where(some[:, None, None], everything, 0.0))
        white = white[some]
    count = B.shape[2]
    prior = np.concatenate([prior, np.full(count - len(prior), 1e6)])
    places = count + np.arange(len(columns))
    return Block(white[:, :, 0], white[:, :, 1:], np.arange(count), prior, places)


def _likeliest_laws(
    gram: Array, rows: float, declared: Sequence[int], current: Array, laws: Array, shared: int
) -> list[int]:
    """Which law each logged force follows between rows, by the Gram matrix of innovations and force columns.

    All the same one, which the likelihood chooses; one another where that has odds of its own. The laws from
    `shared` on hold for all or none: they are stairs, each of another delay. A `declared` law of −1 is not
    known, and stays what it is if nothing tells.
    """

    def rss(which: Sequence[int]) -> float:
        x = np.concatenate([[1.0], (current - laws[list(which)]).ravel()])
        return max(float(x @ gram @ x), 1e-14 * float(gram[0, 0]) + 1e-300)

    def alike(law: int) -> list[int]:
        return [law if d < 0 else d for d in declared]

    before = [int(np.argmin(np.abs(laws - own).sum(axis=1))) for own in current]
    best = min(map(alike, range(len(laws))), key=rss)
    if max(best, default=0) >= shared:
        # A delay beyond that of two steps is of the log, as that of a filter is.
        x = np.concatenate([[1.0], (current - laws[best]).ravel()])
        delay = np.zeros_like(laws[best])
        delay[:, 3] = np.array(declared) < 0
        y = gram @ np.concatenate([[0.0], delay.ravel()])
        further = float(x @ y) / max(float(y[1:] @ delay.ravel()), 1e-300)
        if laws[max(best), 3] + further > BEYOND * laws[shared:, 3].max():
            best = min(map(alike, range(shared)), key=rss)
    if 0.5 * rows * np.log(rss(before) / rss(best)) < CERTAIN:
        best = before
    for k in range(len(declared) if len(declared) <= SINGLY else 0):
        if declared[k] < 0:
            other = min(([*best[:k], law, *best[k + 1 :]] for law in range(shared)), key=rss)
            price = CERTAIN + np.log(len(laws) * len(declared))
            if 0.5 * rows * np.log(rss(best) / rss(other)) > price:
                best = other
    return best
