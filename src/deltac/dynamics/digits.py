"""How many digits accelerations have: compared, where the condition gives reason to, with many more digits.

Accelerations solve M u̇ = f, with constraints G u̇ = −γ too. Double precision loses as many digits as the
condition numbers of M and of G M⁻¹ Gᵀ have, both scaled to a unit diagonal (van der Sluis 1969): a body of a
milligram that carries one of a thousand tons leaves none. The condition is only a bound, and a solution may
be better. Digits are lost in sums as well, whatever the condition: for a grain of sand that moves at
kilometres a second, m v × v is not quite zero, and turns the grain. That shows where the last bits of the
state are changed (`noise`). So from `SUSPECT` or `NOISY` on every instruction is done again in
`DECIMAL_DIGITS`, and what is reported is the error itself.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import HALF_DIGITS, SMALL_SHARE, Array
from deltac.dynamics.equations_of_motion import EquationsOfMotion
from deltac.dynamics.singular_inertia import unit_diagonal
from deltac.kernels import to_mpmath

DECIMAL_DIGITS = 4 * sys.float_info.dig
"""Decimal digits of the comparison: conditions of 10³⁵ occur, where no double has a digit."""

SUSPECT = 1.0 / HALF_DIGITS
"""Condition number, scaled to a unit diagonal, from which the digits are counted: 10⁻⁹ may be lost there."""

NOISY = HALF_DIGITS
"""Scatter of the accelerations, from which the digits are counted: a tenth of what is reported."""

NEARBY = 1e-2
"""How far away accelerations are looked at where they vanish, to know what is small."""


def condition(M: Array, G: Array) -> float:
    """The larger of the condition numbers of M (p, p) and of G M⁻¹ Gᵀ, each scaled to a unit diagonal."""
    scaled, size = unit_diagonal(M)
    values, vectors = np.linalg.eigh(scaled)
    worst = _ratio(values)
    if len(G):
        rows = (G / size) @ vectors / np.sqrt(np.maximum(values, values[-1] * 1e-300))
        worst = max(worst, _ratio(np.linalg.eigvalsh(unit_diagonal(rows @ rows.T)[0])))
    return worst


def _ratio(values: Any) -> float:
    """Of the largest eigenvalue to the smallest; without bound where that is lost in rounding."""
    if not len(values):
        return 1.0
    return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf


def noise(accelerations: Callable[[Array], Array], M: Array, x: Array) -> float:
    """How far accelerations (p,) scatter when the last bits of the state x change.

    Relative as in `acceleration_error`; NaN where they are not finite.
    """
    rng = np.random.default_rng(1)

    def norm(a: Array) -> float:
        return float(np.sqrt(abs(a @ M @ a)))

    with np.errstate(all="ignore"):
        reference = accelerations(x)
        ulp = np.finfo(float).eps
        shaken = [accelerations(x * (1.0 + ulp * rng.integers(-2, 3, len(x)))) for _ in range(4)]
        difference, size = max(norm(a - reference) for a in shaken), norm(reference)
        if difference > NOISY * size:  # perhaps an equilibrium
            near = accelerations(x + NEARBY * rng.uniform(-1.0, 1.0, len(x)))
            size = max(size, SMALL_SHARE * norm(near))
        return difference / size if size > 0.0 else 0.0


def acceleration_error(
    motion: EquationsOfMotion,
    rows: Sequence[int],
    t: float,
    q: Array,
    u: Array,
    p: ArrayLike = (),
    *,
    suspect: bool = False,
) -> float:
    """The error that double precision makes of the accelerations, of independent rows of constraints.

    It is in the energy norm, √(eᵀM e), which knows no units, and relative to the accelerations or, where
    these nearly vanish, to a `SMALL_SHARE` of those `NEARBY`; in free motion, to the speeds, per second. Zero
    where the condition gives no reason to look, and nothing else makes it `suspect`; NaN where it cannot be
    told: a law is not defined there, or knows no more digits.
    """
    M = motion.mass_matrix(t, q, p)
    G = motion.ties(t, q, u, p)[3] if len(rows) else np.zeros((0, len(M)))
    if not np.isfinite(M).all() or not (suspect or condition(M, G[list(rows)]) >= SUSPECT):
        return 0.0
    system = motion.system
    udot = system.once(("digits", tuple(rows)), lambda: _accelerations(motion, rows))
    return _relative_error(udot, motion.inertia_force, [t, q, u, p])


def _accelerations(motion: EquationsOfMotion, rows: Sequence[int]) -> Any:
    """(t, q, u, p) -> u̇ of the free speeds."""
    s = motion.system
    accelerations = motion.motion(rows).udot[s.free_u]
    still = ca.DM.zeros(s.inputs.shape[0])  # motors without a law
    arguments = [s.t, s.q, s.u, s.p]
    return ca.Function(
        "udot", arguments, [ca.densify(ca.substitute(accelerations, s.inputs, still))]
    )


def _relative_error(udot: Any, inertia_force: Any, arguments: list[Any]) -> float:
    import mpmath

    with mpmath.workdps(DECIMAL_DIGITS):
        try:
            t, q, u, p = arguments

            def norm(a: Any) -> Any:
                [force] = to_mpmath(inertia_force, [t, q, p, a])
                return mpmath.sqrt(abs(a @ force))

            [right] = to_mpmath(udot, arguments)
            error, size = norm(np.array(udot(*arguments)).ravel() - right), norm(right)
            if error > SMALL_SHARE * size:  # perhaps an equilibrium
                rng = np.random.default_rng(1)
                q, u = (x + NEARBY * rng.uniform(-1.0, 1.0, len(x)) for x in (q, u))
                [near] = to_mpmath(udot, [t, q, u, p])
                q = arguments[1]
                size = max(size, SMALL_SHARE * norm(near))
            if size < VANISHING * error:  # free motion: no acceleration here, nor nearby
                size = norm(np.array([mpmath.mpf(float(x)) for x in arguments[2]]))
            return float(error / size) if size else 0.0
        except (ArithmeticError, ValueError, TypeError):
            return float("nan")


VANISHING = 10.0 ** (-DECIMAL_DIGITS / 2)
"""Accelerations this small beside their error are zero, and `DECIMAL_DIGITS` show their rounding."""
