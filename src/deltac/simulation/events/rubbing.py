"""The impact of one contact with friction, after Routh, Keller and Stronge.

The normal impulse grows from zero while the configuration stays (J. B. Keller, Impact with friction, J.
Appl. Mech. 53 (1986) 1-4, after E. J. Routh): slip decelerates, stops, sticks or turns on the way. The
impact ends by the energetic restitution of W. J. Stronge (Rigid body collisions with friction, Proc. R.
Soc. A 431 (1990) 169-181): restitution gives back e² of the normal work of compression. A ratio of normal
speeds in its place may make energy where the slip reverses (T. R. Kane, D. A. Levinson, Dynamics: Theory
and Applications, 1985); this law never does for e <= 1, since friction opposes the slip at every moment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deltac.errors import DeltacError

Array = NDArray[np.float64]
REST = 1e-13
"""Speeds below this fraction of the first approach are rounding."""

TURN = 0.02
"""Largest turn (rad) of a slip that changes its direction, in one piece of an impact."""

MOST_PIECES = 20_000
CORRECTIONS = 6


def collide(W: Array, v: Array, e: float, mu: float) -> Array:
    """The impulse of one contact: normal first, then along two tangents if there is friction.

    Args:
        W: (1, 1) or (3, 3), relative velocity gained by unit impulses.
        v: relative velocity before; the approach v[0] is negative.
        e: restitution; mu: Coulomb's friction.
    """
    if len(v) == 1:
        return np.array([-(1.0 + e) * v[0] / W[0, 0]])
    tiny = REST * float(np.abs(v).max())
    v, impulse = v.copy(), np.zeros(3)
    compressing, work = True, 0.0  # done against the contact; later: what it has to give back
    for _ in range(MOST_PIECES):
        force, straight = _force(W, v, mu, tiny)
        rate = W @ force
        if not compressing:
            length = _until(v[0], rate[0], work)
        else:
            length = -v[0] / rate[0] if rate[0] > 0.0 else np.inf
        limit = _limit(W, v, rate, straight, tiny)
        whole = length <= limit
        length = min(length, limit)
        if not np.isfinite(length):
            raise DeltacError(
                "an impact with friction jams: the slip keeps pressing the bodies together without end. "
                "Lower the friction"
            )
        after, force, gained = _piece(W, v, mu, tiny, length, straight)
        if whole and not straight:  # the piece that ends at a mark: corrected until it does
            for _ in range(CORRECTIONS):
                push = float(W[0] @ _force(W, after, mu, tiny)[0])
                length += -after[0] / push if compressing else (work - gained) / after[0]
                after, force, gained = _piece(W, v, mu, tiny, length, straight)
        v, impulse, work = after, impulse + length * force, work - gained
        if straight and not whole:
            v[1:] = 0.0  # the slip has come to rest
        if compressing and (whole or v[0] >= -tiny):
            compressing, v[0], work = False, 0.0, e * e * work
            if e == 0.0:
                return impulse
        elif not compressing and whole:
            return impulse
    raise DeltacError("an impact with friction comes to no end: its slip turns too often")


def _piece(
    W: Array, v: Array, mu: float, tiny: float, length: float, straight: bool
) -> tuple[Array, Array, float]:
    """Velocity after a piece of an impact, its mean force, and its normal work."""
    first = _force(W, v, mu, tiny)[0]
    force = first if straight else _mean_force(W, v, mu, tiny, length)
    after = v + length * (W @ force)
    mean = 0.5 * (v[0] + after[0])
    if not straight:  # by the rates at both ends
        mean += length / 12.0 * float(W[0] @ (first - _force(W, after, mu, tiny)[0]))
    return after, force, length * mean


def _mean_force(W: Array, v: Array, mu: float, tiny: float, length: float) -> Array:
    """The mean force of a piece in which the slip turns, by Kutta's method of order four."""
    forces: list[Array] = []
    for fraction in (0.0, 0.5, 0.5, 1.0):
        moved = v + fraction * length * (W @ forces[-1]) if forces else v
        forces.append(_force(W, moved, mu, tiny)[0])
    first, second, third, fourth = forces
    return (first + 2.0 * second + 2.0 * third + fourth) / 6.0


def _until(v: float, rate: float, work: float) -> float:
    """The impulse that does `work` at the normal speed v + rate p, or brings that speed to zero."""
    square = v * v + 2.0 * rate * work
    if square > 0.0:
        return 2.0 * work / (v + float(np.sqrt(square)))
    return -v / rate if rate < 0.0 else 0.0


def _limit(W: Array, v: Array, rate: Array, straight: bool, tiny: float) -> float:
    """The impulse until the slip has come to rest, or has turned as far as one piece may go."""
    slip = float(np.hypot(v[1], v[2]))
    if slip <= tiny:
        return np.inf
    along = float(rate[1:] @ v[1:]) / slip
    if straight:
        return -slip / along if along < 0.0 else np.inf
    return TURN * slip / float(np.hypot(rate[1], rate[2]))


def _force(W: Array, v: Array, mu: float, tiny: float) -> tuple[Array, bool]:
    """Impulse for unit normal impulse, and whether the slip keeps its direction under it."""
    slip = float(np.hypot(v[1], v[2]))
    if slip > tiny:
        d = v[1:] / slip
        force = np.array([1.0, -mu * d[0], -mu * d[1]])
        rate = (W @ force)[1:]
        across = rate - (rate @ d) * d
        return force, bool(np.hypot(*across) <= 1e-12 * float(np.abs(W).max()))
    stick = np.linalg.solve(W[1:, 1:], -W[1:, 0])
    grip = float(np.hypot(*stick))
    if grip <= mu:
        return np.array([1.0, *stick]), True
    # More than friction can hold: slip begins against what would hold it, along what it then keeps.
    d = -stick / grip
    for _ in range(100):
        pulled = W[1:, 0] - mu * W[1:, 1:] @ d
        d = pulled / float(np.hypot(*pulled))
    return np.array([1.0, -mu * d[0], -mu * d[1]]), True
