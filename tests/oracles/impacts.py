"""Impacts by other derivations than the library's: ballistics flight by flight, and quadratures."""

from __future__ import annotations

import mpmath

from tests.oracles.common import Values


def bouncing_ball(e: float = 0.8) -> Values:
    """Flight after flight, each from the speed that the impact before it left."""
    with mpmath.workdps(30):
        g, h, e = mpmath.mpf("9.81"), mpmath.mpf(1), mpmath.mpf(repr(e))
        values, t, fall = {}, mpmath.sqrt(2 * h / g), mpmath.mpf(0)
        v = g * t
        for k in range(1, 11):
            values[f"time of impact {k}"] = float(t)
            values[f"loss of impact {k}"] = float((v**2 - (e * v) ** 2) / 2)
            v = e * v
            values[f"height of bounce {k}"] = float(v**2 / (2 * g))
            t += 2 * v / g
        while v > mpmath.mpf(10) ** -25:  # the rest, until it is lost in 25 digits
            v = e * v
            fall += 2 * v / g
        values["time of rest"] = float(t + fall)
        return values


def struck_slider_crank() -> Values:
    """Between impacts √A(θ) θ̇ is constant; each multiplies it by −e, and the crank goes the other way."""
    with mpmath.workdps(30):
        r, l, stop, e = (mpmath.mpf(x) for x in ("0.1", "0.3", "0.38", "0.7"))

        def inertia(theta: mpmath.mpf) -> mpmath.mpf:
            """A of K = ½ A θ̇²: the crank, the rod by its mass centre and turn, the slider."""
            s, c = mpmath.sin(theta), mpmath.cos(theta)
            cosine = mpmath.sqrt(1 - (r * s / l) ** 2)
            turn = -r * c / (l * cosine)
            slider = -r * s + r * s / l * l * turn
            centre = ((-r * s + slider) / 2) ** 2 + (r * c / 2) ** 2
            return r**2 / 3 + 2 * (centre + l**2 * turn**2 / 12) + slider**2 * 3 / 2

        def root(theta: mpmath.mpf) -> mpmath.mpf:
            return mpmath.sqrt(inertia(theta))

        half = mpmath.pi / 2
        struck = mpmath.findroot(
            lambda x: r * mpmath.cos(x) + mpmath.sqrt(l**2 - (r * mpmath.sin(x)) ** 2) - stop, 0.6
        )
        speed = 10 * root(half)
        t = mpmath.quad(root, [struck, half]) / speed
        around = mpmath.quad(root, [struck, mpmath.pi, 2 * mpmath.pi - struck])
        values = {}
        for k in range(1, 5):
            values[f"time of impact {k}"] = float(t)
            values[f"loss of impact {k}"] = float((1 - e**2) * speed**2 / 2)
            speed *= e
            t += around / speed
        return values
