"""The impact of one contact with friction, after Routh, Keller and Stronge.

The normal impulse grows from zero while the configuration stays (J. B. Keller, Impact with friction, J.
Appl. Mech. 53 (1986) 1-4, after E. J. Routh): slip decelerates, stops, sticks or turns on the way. The
impact ends by the energetic restitution of W. J. Stronge (Rigid body collisions with friction, Proc. R.
Soc. A 431 (1990) 169-181): restitution gives back e² of the normal work of compression. A ratio of normal
speeds in its place may make energy where the slip reverses (T. R. Kane, D. A. Levinson, Dynamics: Theory
and Applications, 1985); this law never does for e <= 1, since friction opposes the slip at every moment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deltac.arrays import ENDLESS, EPS, SAME, SMALL_SHARE, Array
from deltac.errors import DeltacError

REST = 512 * EPS
"""Speeds below this fraction of the first approach are rounding."""

TURN = 0.03
"""Largest turn (rad) of a slip that changes its direction, in one piece of an impact.

So far apart are the directions among which that of a beginning slip is looked for.
"""

SLIPLESS = 1.0 / SMALL_SHARE
"""So many times `REST` is the slip that is taken for none: it dies away in a spiral."""

IMMOBILE = SAME
"""A tangent whose mobility is this share of the other's has none."""


def collide(W: Array, v: Array, e: float, mu: float) -> Array:
    """The impulse of one contact: normal first, then along two tangents if there is friction.

    Args:
        W: (1, 1) or (3, 3), relative velocity gained by unit impulses.
        v: relative velocity before; the approach v[0] is negative.
        e: restitution.
        mu: Coulomb's friction.
    """
    if len(v) == 1:
        return np.array([-(1.0 + e) * v[0] / W[0, 0]])
    from scipy.optimize import brentq

    rub = _Rub(W, mu, REST * float(np.abs(v).max()))
    v, impulse = v.copy(), np.zeros(3)
    compressing, work, floor = (
        True,
        0.0,
        0.0,
    )  # done against the contact; later what it has to give back
    for _ in range(ENDLESS):
        force, straight = rub.force(v)
        rate = W @ force
        if not compressing:
            length = _until(v[0], rate[0], work)
        else:
            length = -v[0] / rate[0] if rate[0] > 0.0 else np.inf
        limit = rub.limit(v, rate, straight)
        whole = length <= limit
        length = min(length, limit)
        if not np.isfinite(length):
            raise DeltacError(
                "an impact with friction jams: the slip keeps pressing the bodies together without end; "
                "lower the friction"
            )
        if not straight:  # a piece that goes beyond the mark it is to end at is cut there
            mark = (v, compressing, work)
            whole = rub.beyond(length, *mark) > 0.0
            if whole:
                length = brentq(rub.beyond, 0.0, length, args=mark, xtol=1e-300, rtol=1e-14)
        v, force, gained = rub.piece(v, length, straight)
        impulse, work = impulse + length * force, work - gained
        if straight and not whole:
            v[1:] = 0.0  # the slip has come to rest
        if compressing and (whole or v[0] >= -rub.tiny):
            compressing, v[0], work = False, 0.0, e * e * work
            if e == 0.0:
                return impulse
            floor = 1e-13 * work
        elif not compressing and (whole or work <= floor or v[0] <= rub.tiny):
            return impulse
    raise DeltacError("an impact with friction does not end: its slip reverses too often")


@dataclass(frozen=True)
class _Rub:
    """An impact under way: relative velocity by unit impulse `W`, friction `mu`, speeds `tiny` to it."""

    W: Array
    mu: float
    tiny: float

    def force(self, v: Array) -> tuple[Array, bool]:
        """Impulse for unit normal impulse, and whether the slip keeps its direction under it."""
        slip = float(np.hypot(v[1], v[2]))
        if slip > SLIPLESS * self.tiny:
            d = v[1:] / slip
            force = np.array([1.0, -self.mu * d[0], -self.mu * d[1]])
            rate = (self.W @ force)[1:]
            across = rate - (rate @ d) * d
            return force, bool(np.hypot(*across) <= 1e-12 * float(np.abs(self.W).max()))
        # A tangent without mobility (out of the plane of a planar mechanism) needs no impulse to stick.
        stick = np.linalg.lstsq(self.W[1:, 1:], -self.W[1:, 0], rcond=IMMOBILE)[0]
        if float(np.hypot(*stick)) <= self.mu:
            return np.array([1.0, *stick]), True
        d = self.escape()
        return np.array([1.0, -self.mu * d[0], -self.mu * d[1]]), True

    def limit(self, v: Array, rate: Array, straight: bool) -> float:
        """The impulse until the slip has come to rest, or has turned as far as one piece may go."""
        slip = float(np.hypot(v[1], v[2]))
        if slip <= SLIPLESS * self.tiny:
            return np.inf
        if not straight:
            return TURN * slip / float(np.hypot(rate[1], rate[2]))
        along = float(rate[1:] @ v[1:]) / slip
        return -slip / along if along < 0.0 else np.inf

    def piece(self, v: Array, length: float, straight: bool) -> tuple[Array, Array, float]:
        """Velocity after a piece of the impact, its mean force, and its normal work."""
        first = self.force(v)[0]
        force = first if straight else self.mean_force(v, length)
        after = v + length * (self.W @ force)
        mean = 0.5 * (v[0] + after[0])
        if not straight:  # by the rates at both ends
            mean += length / 12.0 * float(self.W[0] @ (first - self.force(after)[0]))
        return after, force, length * mean

    def mean_force(self, v: Array, length: float) -> Array:
        """The mean force of a piece in which the slip turns, by Kutta's method of order four."""
        forces: list[Array] = []
        for fraction in (0.0, 0.5, 0.5, 1.0):
            moved = v + fraction * length * (self.W @ forces[-1]) if forces else v
            forces.append(self.force(moved)[0])
        first, second, third, fourth = forces
        return np.asarray((first + 2.0 * second + 2.0 * third + fourth) / 6.0)

    def beyond(self, length: float, v: Array, compressing: bool, work: float) -> float:
        """How far a piece with turning slip goes beyond its mark: no approach left, or the work done."""
        after, _, gained = self.piece(v, length, False)
        return float(after[0]) if compressing else gained - work

    def escape(self) -> Array:
        """The direction in which a slip begins that friction cannot hold: the one that it then keeps."""
        from scipy.optimize import brentq

        angles = np.arange(0.0, 2.0 * np.pi + TURN, TURN)
        across = [self.pulled(angle)[0] for angle in angles]
        roots = [
            brentq(lambda angle: self.pulled(angle)[0], a, b, xtol=1e-15)
            for a, b, f_a, f_b in zip(angles, angles[1:], across, across[1:])
            if f_a * f_b <= 0.0
        ]
        best = max(roots, key=lambda angle: self.pulled(angle)[1])
        return np.array([np.cos(best), np.sin(best)])

    def pulled(self, angle: float) -> tuple[float, float]:
        """What a slip in a direction gains across it, and along it."""
        d = np.array([np.cos(angle), np.sin(angle)])
        pull = self.W[1:, 0] - self.mu * self.W[1:, 1:] @ d
        return float(d[0] * pull[1] - d[1] * pull[0]), float(d @ pull)


def _until(v: float, rate: float, work: float) -> float:
    """The impulse that does `work` at the normal speed v + rate p, or brings that speed to zero."""
    square = v * v + 2.0 * rate * work
    if square > 0.0:
        return 2.0 * work / (v + float(np.sqrt(square)))
    return -v / rate if rate < 0.0 else 0.0
