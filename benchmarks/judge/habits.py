"""How logs are kept: rows thinned, rounded, filtered, late; and what that leaves known of each number."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from judge.truth import Array

HABITS = (
    "full",
    "thinned",
    "uneven",
    "half",
    "decimals",
    "noise",
    "thinned+noise",
    "zero-phase",
    "causal",
    "jittered",
    "differenced",
    "q-alone",
    "udot",
    "udot-gaps",
    "wrapped",
)

KNOWN = (
    "full",
    "thinned",
    "uneven",
    "half",
    "decimals",
    "noise",
    "thinned+noise",
    "udot",
    "udot-gaps",
)
"""Habits that the oracle can be told of: each row is a state with errors of a known size."""


@dataclass(frozen=True)
class Rows:
    """Columns of a log; `index` is the step of each row, `sigma` (T, nq + nu) the size of its errors."""

    t: Array
    q: Array
    u: Array | None
    udot: Array | None
    forces: dict[str, Array]
    index: Array
    sigma: Array | None = None
    notes: list[str] = field(default_factory=list)

    def take(self, which: Array | slice) -> Rows:
        def some(x: Array | None) -> Array | None:
            return None if x is None else x[which]

        return replace(
            self,
            t=self.t[which],
            q=self.q[which],
            u=some(self.u),
            udot=some(self.udot),
            sigma=some(self.sigma),
            index=self.index[which],
            forces={n: f[which] for n, f in self.forces.items()},
        )


def kept(
    rows: Rows, habit: str, rng: np.random.Generator, stride: int = 1, angles: Array | None = None
) -> Rows:
    """The rows as somebody keeps them; `stride`: steps that a force is held, `angles`: what wraps."""
    assert rows.u is not None
    n, x = len(rows.t), np.hstack([rows.q, rows.u])
    nq, deviation = rows.q.shape[1], x.std(axis=0) + 1e-12
    h = float(np.median(np.diff(rows.t)))
    if habit not in ("udot", "udot-gaps"):
        rows = replace(rows, udot=None)
    rows = replace(rows, sigma=np.zeros_like(x))

    def with_states(y: Array, sigma: Array | None) -> Rows:
        return replace(rows, q=y[:, :nq], u=y[:, nq:], sigma=sigma)

    def filtered(y: Array, back: bool) -> Array:
        from scipy.signal import butter, filtfilt, lfilter

        b, a = butter(2, min(0.8, 60.0 * 2 * h))
        return np.asarray(
            filtfilt(b, a, y, axis=0) if back else lfilter(b, a, y - y[0], axis=0) + y[0]
        )

    if habit.startswith("thinned"):
        rows = rows.take(slice(None, None, stride * int(rng.choice([2, 4, 5]))))
        assert rows.u is not None
        x = np.hstack([rows.q, rows.u])
    if habit.endswith("noise"):
        level = float(rng.choice([1e-5, 1e-4, 1e-3]))
        rows.notes.append(f"noise {level:g}")
        return with_states(
            x + level * deviation * rng.standard_normal(x.shape),
            np.tile(level * deviation, (len(x), 1)),
        )
    if habit == "uneven":
        return rows.take(np.sort(rng.choice(n, n // 2, replace=False)))
    if habit == "half":
        y = x.astype(np.float16).astype(float)
        return with_states(y, np.spacing(np.abs(y).astype(np.float16)).astype(float) / np.sqrt(12))
    if habit == "decimals":
        places = int(rng.integers(3, 6))
        rows.notes.append(f"{places} decimals")
        return with_states(np.round(x, places), np.full_like(x, 10.0**-places / np.sqrt(12)))
    if habit in ("zero-phase", "causal"):
        edge = max(2, n // 20)
        return with_states(filtered(x, habit == "zero-phase"), None).take(slice(edge, -edge))
    if habit == "jittered":
        read = rows.t + 0.02 * h * rng.standard_normal(n)
        return with_states(np.stack([np.interp(read, rows.t, c) for c in x.T], -1), None).take(
            slice(1, -1)
        )
    if habit == "differenced":
        return replace(rows, u=np.gradient(rows.q, rows.t, axis=0), sigma=None).take(slice(1, -1))
    if habit == "q-alone":
        return replace(rows, u=None, sigma=None)
    if habit == "udot-gaps":
        assert rows.udot is not None
        udot = rows.udot.copy()
        udot[rng.integers(0, 20) :: 20] = np.nan
        return replace(rows, udot=udot)
    if habit == "wrapped" and angles is not None:
        q = rows.q.copy()
        q[:, angles] = (q[:, angles] + np.pi) % (2 * np.pi) - np.pi
        return replace(rows, q=q, sigma=None)
    return rows
