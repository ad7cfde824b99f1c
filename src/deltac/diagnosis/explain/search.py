"""The search for few causes that explain much: matching pursuit with many paths.

Orthogonal matching pursuit adds the cause that explains most of what is left, and fits all anew. Its
first choice may be wrong when causes resemble each other, so a number of paths is kept (Kwon, Wang and
Shim 2014, *Multipath matching pursuit*, IEEE Trans. Inf. Theory 60). A cause more must earn its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from deltac.calls.progress import Deadline, Progress, untold
from deltac.diagnosis.explain.regression import Fit, Regression

MOST = 24
"""Causes together, such as a damper at every joint."""

MANY = 4
PATHS, TRIED = (12, 2), (40, 24)
"""Paths that are kept, and extensions that are fitted in full, up to `MANY` causes and beyond.

Of the extensions that promise most, many could not be: rotors and moments of inertia below nothing."""

PROGRESS = 0.98
"""A cause more that leaves more than this share of what was left is not worth going on."""

PRICE_OF_A_NUMBER = 0.2
PRICE_OF_A_CAUSE = 0.5
"""A number more must take so much of the logarithm of what is left; a cause more, so much besides."""

WHOLE = ("body-mass", "body-centre", "body-moments")
"""All of a body; it is tried together, since the search one by one may not get there."""

CLOSED = 1.5
SLIGHT = 1e-6
"""What is left is noise up to so many times its estimate; below that share no further cause is sought."""

ALIKE = 1e-9
"""Squared sine of the angle between directions below which they are one and the same."""


@dataclass(frozen=True)
class Found:
    """The fit that explains best by least, and others that the data do not tell from it."""

    best: Fit
    alternatives: tuple[Fit, ...]


def search(
    regression: Regression,
    most: int = MOST,
    deadline: Deadline | None = None,
    progress: Progress = untold,
) -> Found:
    """The best fit of at most `most` causes, and its equals.

    The search ends with what it has when the `deadline` has passed. `progress` is told the share of the
    causes that have been sought, or of the time, whichever is more.
    """
    deadline = deadline or Deadline()
    paths = [regression.nothing]
    every: list[Fit] = []
    best: Fit | None = None
    left = regression.total
    for count in range(1, most + 1):
        progress(min(1.0, max((count - 1) / most, deadline.spent)))
        if count > 1 and deadline.passed(f"{count} causes or more together"):
            break
        paths = _extended(regression, paths, count > MANY, deadline)
        if count == len(WHOLE):
            paths += _whole_bodies(regression, {fit.chosen for fit in paths})
        if count > MANY and not deadline.passed():
            paths += _exchanged(regression, paths, deadline)
        every += paths
        regression = regression.calmed([fit for fit in paths if plausible(regression, fit)])
        possible = sorted(
            (fit for fit in paths if plausible(regression, fit)),
            key=lambda fit: price(regression, fit),
        )
        if possible and _closed(regression, possible[0]):
            possible.insert(0, _pruned(regression, possible[0]))
        sure = (fit for fit in possible if count == 1 or regression.stands_out(fit))
        here = next(sure, None)
        if here is not None and (best is None or price(regression, here) < price(regression, best)):
            best = here
            if _closed(regression, best):
                break
        # What is implausible may close by annulling masses and motors alike: that is no progress.
        now = min((fit.left for fit in possible), default=left)
        if not possible or now > PROGRESS * left:
            break
        left = now
    if best is None:
        return Found(regression.nothing, ())
    return _with_equals(regression, best, [f for f in every if plausible(regression, f)])


def promise(regression: Regression) -> float:
    """The squares that the best single cause leaves which the world could have.

    Of causes not linear, the order in which they are looked at is by their tangent. Others promise nothing:
    masses that vanish close any equation without other forces.
    """
    nothing = regression.R[:, -1]
    left = _left(regression, np.zeros((len(nothing), 0)), nothing)
    for k in np.argsort(left):
        if not np.isfinite(left[k]):
            break
        if plausible(regression, fit := regression.fit((int(k),))):
            return fit.left
    return float("inf")


def _closed(regression: Regression, fit: Fit) -> bool:
    """Whether a fit leaves no more than noise and rounding, or next to nothing."""
    enough = max(CLOSED * regression.floor(fit), SLIGHT * regression.total)
    return fit.left <= enough or regression.left(fit) <= enough


def _pruned(regression: Regression, fit: Fit) -> Fit:
    """The fit without the causes that it can spare: what was chosen early may have become idle."""
    while len(fit.chosen) > 1:
        least = min(_fewer(regression, fit), key=lambda other: price(regression, other))
        if price(regression, least) >= price(regression, fit) or not plausible(regression, least):
            break
        fit = least
    return fit


def price(regression: Regression, fit: Fit) -> float:
    """What a fit leaves (a logarithm) and what it costs: smaller is better.

    What is left beyond noise counts; of fits down to the noise, the one that leaves less is before.
    """
    numbers = sum(regression.candidates[k].size for k in fit.chosen)
    noise = regression.noise(fit)
    left = max(fit.left - noise, 0.05 * noise) + regression.precision
    within = min(fit.left / max(noise + regression.precision, 1e-300), 2.0)
    return (
        math.log(left + 1e-300)
        + within
        + PRICE_OF_A_NUMBER * numbers
        + PRICE_OF_A_CAUSE * len(fit.chosen)
    )


def plausible(regression: Regression, fit: Fit) -> bool:
    """Whether the world could have all of its causes."""
    return all(regression.candidates[k].plausible(t) for k, t in zip(fit.chosen, fit.theta))


def _may_turn(regression: Regression, fit: Fit) -> bool:
    """Whether a further cause may make a fit plausible: a damper that drives may then brake."""
    parts = ((regression.candidates[k], theta) for k, theta in zip(fit.chosen, fit.theta))
    return all(c.sign in ("positive", "slip") or c.plausible(theta) for c, theta in parts)


def _extended(
    regression: Regression, paths: list[Fit], many: bool, deadline: Deadline
) -> list[Fit]:
    """The best fits of one cause more than those of `paths`, of the first ones where time is up."""
    most_paths, tried = PATHS[many], TRIED[many]
    promising: dict[tuple[int, ...], float] = {}
    sizes = np.array([c.size for c in regression.candidates])
    floor = regression.floor(regression.nothing)
    for path in paths:
        if promising and deadline.passed():
            break
        J, e = regression.tangents(path)
        Q = np.linalg.qr(J)[0] if J.shape[1] else J
        left = _left(regression, Q, e)
        cost = np.log(left + floor + 1e-300) + PRICE_OF_A_NUMBER * sizes
        able = (int(k) for k in np.argsort(cost) if _compatible(regression, path, int(k)))
        for k in islice(able, tried):
            if np.isfinite(cost[k]):
                key = tuple(sorted((*path.chosen, k)))
                promising[key] = min(promising.get(key, math.inf), float(cost[k]))
    chosen = sorted(promising, key=lambda key: promising[key])[:tried]
    fits = [regression.fit(key) for k, key in enumerate(chosen) if not k or not deadline.passed()]
    fits.sort(key=lambda fit: price(regression, fit))
    good = [fit for fit in fits if plausible(regression, fit)]
    # Masses that vanish close any equation, and rows that are late by seconds nearly any.
    other = [fit for fit in fits if not plausible(regression, fit) and _may_turn(regression, fit)]
    return good[:most_paths] + other[: most_paths // 3]


def _exchanged(regression: Regression, paths: list[Fit], deadline: Deadline) -> list[Fit]:
    """Better fits, in which another cause has the place of one of a path.

    What was chosen early may have become idle, such as a factor on all masses for dampers not yet
    found; or it keeps out what is right, as a number of a body must not be told twice (Jain, Tewari and
    Dhillon 2011, *Orthogonal matching pursuit with replacement*, NIPS 24).
    """
    best = min((price(regression, fit) for fit in paths), default=math.inf)
    stems: dict[tuple[int, ...], Fit] = {}
    for path in paths:
        fewer = _fewer(regression, path)
        idle = min(fewer, key=lambda other: price(regression, other))
        bodies = [f for k, f in zip(path.chosen, fewer) if regression.candidates[k].of_a_body]
        stems |= {fit.chosen: fit for fit in (idle, *bodies)}
    fits = _extended(regression, list(stems.values()), True, deadline)
    return [fit for fit in fits if price(regression, fit) < best]


def _fewer(regression: Regression, fit: Fit) -> list[Fit]:
    """The fits without one of the causes, in their order."""
    places = range(len(fit.chosen))
    return [regression.fit((*fit.chosen[:k], *fit.chosen[k + 1 :])) for k in places]


def _whole_bodies(regression: Regression, known: set[tuple[int, ...]]) -> list[Fit]:
    """Fits of another mass, mass centre and inertia of one body, which hide each other one by one."""
    of_body: dict[str, list[list[int]]] = {}
    for k, c in enumerate(regression.candidates):
        if c.kind in WHOLE:
            of_body.setdefault(c.element, [[] for _ in WHOLE])[WHOLE.index(c.kind)].append(k)
    keys = (tuple(sorted(key)) for parts in of_body.values() for key in product(*parts))
    return [regression.fit(key) for key in keys if key not in known]


def _compatible(regression: Regression, path: Fit, k: int) -> bool:
    """Whether a cause may join those of a path."""
    new = regression.candidates[k]
    return k not in path.chosen and not any(
        new.excludes(regression.candidates[j]) for j in path.chosen
    )


def _left(regression: Regression, Q: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Squares left of e by each candidate together with what Q spans; infinite where it adds nothing.

    So it is where a single number would be beyond its limit.
    """
    left = np.full(len(regression.candidates), np.inf)
    total = float(e @ e)
    smallest = 1e-12 * max(float(regression.sizes.max(initial=0.0)), 1e-300)
    single = [
        k
        for k, c in enumerate(regression.candidates)
        if c.size == 1 and regression.sizes[k] > smallest
    ]
    if single:
        Z = np.column_stack([regression.directions[k][:, 0] for k in single])
        size = np.sum(Z**2, axis=0)
        Z = Z - Q @ (Q.T @ Z)
        rest = np.sum(Z**2, axis=0)
        own = rest > ALIKE * size
        theta = np.divide(Z.T @ e, rest, out=np.zeros_like(rest), where=own)
        parts = [regression.candidates[k] for k in single]
        own &= np.abs(theta) <= [np.inf if c.quadratic is not None else c.limit for c in parts]
        left[single] = np.where(own, np.maximum(total - theta**2 * rest, 0.0), np.inf)
    for k, c in enumerate(regression.candidates):
        if c.size > 1 and regression.sizes[k] > smallest:
            Z = regression.directions[k]
            Z = Z - Q @ (Q.T @ Z)
            U, singular, _ = np.linalg.svd(Z, full_matrices=False)
            U = U[:, singular > 1e-6 * max(singular[0], smallest)]
            left[k] = max(total - float(np.sum((U.T @ e) ** 2)), 0.0)
    return left


def _with_equals(regression: Regression, best: Fit, every: list[Fit]) -> Found:
    """The preferred of all fits that the data do not tell from the best, and the others."""

    def numbers(fit: Fit) -> int:
        return sum(regression.candidates[k].size for k in fit.chosen)

    def rank(fit: Fit) -> tuple[int, tuple[int, ...]]:
        ranks = (regression.candidates[k].rank(t) for k, t in zip(fit.chosen, fit.theta))
        return numbers(fit), tuple(sorted(ranks, reverse=True))

    limit = numbers(best)
    equals = [
        f
        for f in every
        if len(f.chosen) == len(best.chosen)
        and numbers(f) <= limit
        and (len(f.chosen) == 1 or regression.stands_out(f))
        and f.chosen != best.chosen
        and (regression.same(best, f) if best.left <= f.left else regression.same(f, best))
    ]
    ranked = sorted([best, *equals], key=rank)
    return Found(ranked[0], tuple(ranked[1:]))
