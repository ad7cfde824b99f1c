"""What a log can tell of a fault at most: its likelihood, told scheme, habit, noise and candidates.

The scheme's own map with the model's equations takes each row to the next; its innovations, whitened by
Kalman's recursion with the noise of each number, are regressed on what a change of each candidate does to
them. N/τ rows count, τ the integrated autocorrelation time of what is left.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from judge.truth import Array

Map = Callable[[str, Array, Array], Array]
"""The rows after the steps k (N,), from rows x (N, n), with one candidate ("": none) a little off."""

OFFSET = 1e-5
"""Of a candidate, in its unit: a derivative's optimum for errors of rounding and of second order."""


def log_odds(
    step: Map, rows: Array, index: Array, sigma: Array, candidates: tuple[str, ...]
) -> dict[str, float]:
    """Log odds (nats) of each candidate against none, from rows (T, n) of the steps `index`, noise (T, n)."""
    n, count = rows.shape[1], len(rows) - 1

    def moved(name: str, x: Array) -> Array:
        x, gap = x.copy(), np.diff(index)
        for j in range(int(gap.max())):
            some = gap > j
            x[some] = step(name, index[:-1][some] + j, x[some])
        return x

    size = np.abs(rows).max(axis=0) + 1e-9
    after = moved("", rows[:-1])
    transition = np.stack(
        [
            (moved("", rows[:-1] + 1e-6 * size * e) - after) / (1e-6 * size[i])
            for i, e in enumerate(np.eye(n))
        ],
        -1,
    )
    columns = np.stack([(moved(name, rows[:-1]) - after) / OFFSET for name in candidates], -1)
    w = rows[1:] - after
    variance = sigma**2 + (4e-16 * size) ** 2
    P, mean, slope = np.diag(variance[0]), np.zeros(n), np.zeros((n, len(candidates)))
    r, D = np.empty((count, n)), np.empty((count, n, len(candidates)))
    for k in range(count):
        R = np.diag(variance[k + 1])
        S = R + transition[k] @ P @ transition[k].T
        rk, Dk = w[k] + transition[k] @ mean, columns[k] - transition[k] @ slope
        root = np.linalg.inv(np.linalg.cholesky(S))
        r[k], D[k] = root @ rk, root @ Dk
        gain = R @ np.linalg.inv(S)
        mean, slope, P = gain @ rk, -gain @ Dk, R - gain @ R
    total = max(float((r * r).sum()), float(r.size) * 1e-3)
    share, made = r.size / autocorrelation_time(r), {}
    for j, name in enumerate(candidates):
        d = D[:, :, j]
        gained = float((d * r).sum()) ** 2 / max(float((d * d).sum()), 1e-300)
        with_cause = max(total - gained, float(r.size) * 1e-3)
        rest = r - d * (float((d * r).sum()) / max(float((d * d).sum()), 1e-300))
        share = r.size / autocorrelation_time(rest)
        made[name] = (
            0.5 * share * np.log(total / with_cause) - 0.5 * np.log(share) - np.log(len(candidates))
        )
    return made


def autocorrelation_time(r: Array) -> float:
    """τ = 1 + 2 Σρ of rows (T, n) up to the first lag that is not correlated (Sokal)."""
    power, total = float((r * r).sum()), 1.0
    if power == 0.0:
        return total
    for lag in range(1, min(200, len(r) // 4)):
        rho = float((r[lag:] * r[:-lag]).sum()) / power
        if rho < 2 / np.sqrt(r.size):
            break
        total += 2 * rho
    return total
