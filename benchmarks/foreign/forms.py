"""Forms in which a log is handed over, and slips of logs: what users do to the rows they kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """The columns of a log. `rates` says that q̇ = u column by column."""

    t: Array
    q: Array
    u: Array
    udot: Array | None
    forces: dict[str, Array]
    step: float | None

    def taken(self, which: Array | slice) -> Rows:
        return Rows(
            self.t[which], self.q[which], self.u[which],
            None if self.udot is None else self.udot[which],
            {n: f[which] for n, f in self.forces.items()}, self.step,
        )  # fmt: skip


FORMS = (
    "full", "no-udot", "thinned", "float32", "decimals", "noise", "filtered", "filtered-udot",
    "non-uniform", "lost-rows", "stale-forces", "backward-udot", "forward-udot", "central-udot",
    "late-udot", "mean-udot", "half", "significant", "interpolated-linearly", "interpolated-cubically",
    "averaged", "encoder", "jittered", "spline-udot", "smoothed-udot", "mean-forces", "later-forces",
    "commands", "slow-speeds", "mixed-rates", "differenced-q", "savgol-q",
)  # fmt: skip

SLIPS = (
    "clock-1.01", "clock-0.999", "duplicated", "late-q", "late-u", "swapped", "clipped", "spiked", "gear-qu",
    "zero-offset",
)  # fmt: skip


def formed(rows: Rows, form: str, rng: np.random.Generator) -> Rows:
    """The log in one of the `FORMS`."""
    n = len(rows.t)
    if form == "no-udot":
        return replace(rows, udot=None)
    if form == "thinned":
        return rows.taken(slice(None, None, int(rng.choice([2, 4, 5]))))
    if form == "float32":
        return _each(rows, lambda x: x.astype(np.float32).astype(float))
    if form == "decimals":
        places = int(rng.integers(4, 7))
        return _each(rows, lambda x: np.round(x, places))
    if form == "noise":
        level = float(rng.choice([1e-5, 1e-4, 1e-3]))
        made = _each(rows, lambda x: x + level * np.std(x, axis=0) * rng.standard_normal(x.shape))
        return replace(made, udot=None if rng.random() < 0.5 else made.udot)
    if form == "filtered":
        return _each(rows, lambda x: _lowpass(x, rows.t, 60.0))
    if form == "filtered-udot":
        assert rows.udot is not None
        return replace(rows, udot=_lowpass(rows.udot, rows.t, 20.0))
    if form == "non-uniform":
        return rows.taken(np.sort(rng.choice(n, int(0.6 * n), replace=False)))
    if form == "lost-rows":
        start = int(0.4 * n)
        kept = np.concatenate([np.arange(start), np.arange(start + n // 10, n)])
        return rows.taken(kept)
    if form == "stale-forces":
        return replace(rows, forces={k: np.vstack([f[:1], f[:-1]]) for k, f in rows.forces.items()})
    if form in _HABITS:
        return _HABITS[form](rows, rng)
    h = np.diff(rows.t)[:, None]
    D = np.diff(rows.u, axis=0) / h
    if form == "backward-udot":
        return replace(rows, udot=np.vstack([D[:1], D]))
    if form == "forward-udot":
        return replace(rows, udot=np.vstack([D, D[-1:]]))
    if form == "central-udot":
        return replace(rows, udot=np.gradient(rows.u, rows.t, axis=0))
    if form == "late-udot":
        assert rows.udot is not None
        return replace(rows, udot=np.vstack([rows.udot[:1], rows.udot[:-1]]))
    if form == "mean-udot":
        made = np.gradient(rows.u, rows.t, axis=0)
        made = np.apply_along_axis(lambda x: np.convolve(x, np.ones(5) / 5, "same"), 0, made)
        return replace(rows, udot=made)
    return rows


def _interpolated(rows: Rows, rng: np.random.Generator, degree: int) -> Rows:
    """At times of another clock."""
    from scipy.interpolate import make_interp_spline

    spacing = float(rng.choice([0.7, 1.6, 3.3])) * float(np.median(np.diff(rows.t)))
    t = np.arange(rows.t[0], rows.t[-1], spacing)
    made = _each(rows, lambda x: make_interp_spline(rows.t, x, k=degree)(t))
    udot = None if rng.random() < 0.5 else made.udot
    forces = {
        k: f if len(f) == len(t) else np.zeros((len(t), f.shape[1])) for k, f in made.forces.items()
    }
    return replace(made, t=t, udot=udot, forces=forces, step=None)


def _averaged(rows: Rows, rng: np.random.Generator) -> Rows:
    """Means over four rows, as a data logger takes them."""
    n = len(rows.t) // 4 * 4

    def mean(x: Array) -> Array:
        return np.asarray(x[:n].reshape(-1, 4, x.shape[1]).mean(axis=1))

    made = _each(rows, mean)
    t = rows.t[:n].reshape(-1, 4).mean(axis=1)
    forces = {k: mean(f) for k, f in rows.forces.items()}
    return replace(made, t=t, forces=forces, step=None)


def _encoded(rows: Rows, rng: np.random.Generator) -> Rows:
    """Joint angles in counts of an encoder; coordinates of bodies in space are left."""
    q, count = rows.q.copy(), 2 * np.pi / 4096
    if q.shape[1] == rows.u.shape[1]:
        q = np.round(q / count) * count
    return replace(rows, q=q, udot=None if rng.random() < 0.5 else rows.udot)


def _spline_udot(rows: Rows, rng: np.random.Generator) -> Rows:
    from scipy.interpolate import make_interp_spline

    return replace(rows, udot=make_interp_spline(rows.t, rows.u, k=3).derivative()(rows.t))


def _smoothed_udot(rows: Rows, rng: np.random.Generator) -> Rows:
    from scipy.signal import savgol_filter

    h = float(np.median(np.diff(rows.t)))
    return replace(rows, udot=savgol_filter(rows.u, 11, 3, deriv=1, delta=h, axis=0))


def _mixed_rates(rows: Rows, rng: np.random.Generator) -> Rows:
    """Speeds of every second row, commands of every eighth, as they are until new ones come."""

    def slow(x: Array, every: int) -> Array:
        return np.asarray(np.repeat(x[::every], every, axis=0)[: len(x)])

    return replace(_forces(rows, lambda f: slow(f, 8)), u=slow(rows.u, 2), udot=None)


def _of_coordinates(rows: Rows, rng: np.random.Generator, smooth: bool) -> Rows:
    """Speeds that were made of the coordinates; those of bodies in space are left."""
    from scipy.signal import savgol_filter

    if rows.q.shape != rows.u.shape:
        return replace(rows, udot=None)
    h = float(np.median(np.diff(rows.t)))
    if smooth and np.ptp(np.diff(rows.t)) < 1e-6 * h:
        return replace(rows, u=savgol_filter(rows.q, 9, 3, deriv=1, delta=h, axis=0), udot=None)
    return replace(rows, u=np.gradient(rows.q, rows.t, axis=0), udot=None)


def _forces(rows: Rows, change: Callable[[Array], Array]) -> Rows:
    return replace(rows, forces={k: change(f) for k, f in rows.forces.items()})


_HABITS: dict[str, Callable[[Rows, np.random.Generator], Rows]] = {
    "half": lambda rows, _: _each(rows, lambda x: x.astype(np.float16).astype(float)),
    "significant": lambda rows, rng: _each(rows, _significant(int(rng.integers(4, 8)))),
    "interpolated-linearly": lambda rows, rng: _interpolated(rows, rng, 1),
    "interpolated-cubically": lambda rows, rng: _interpolated(rows, rng, 3),
    "averaged": _averaged,
    "encoder": _encoded,
    "jittered": lambda rows, rng: replace(
        rows, t=rows.t + 0.02 * np.median(np.diff(rows.t)) * rng.uniform(-1, 1, len(rows.t))
    ),
    "spline-udot": _spline_udot,
    "smoothed-udot": _smoothed_udot,
    "mean-forces": lambda rows, _: _forces(
        rows, lambda f: np.vstack([0.5 * (f[1:] + f[:-1]), f[-1:]])
    ),
    "later-forces": lambda rows, _: _forces(rows, lambda f: np.vstack([f[:1], f[:1], f[:-2]])),
    "commands": lambda rows, _: _forces(rows, lambda f: np.repeat(f[::4], 4, axis=0)[: len(f)]),
    "mixed-rates": _mixed_rates,
    "differenced-q": lambda rows, rng: _of_coordinates(rows, rng, False),
    "savgol-q": lambda rows, rng: _of_coordinates(rows, rng, True),
    "slow-speeds": lambda rows, _: replace(
        rows, u=np.repeat(rows.u[::2], 2, axis=0)[: len(rows.u)]
    ),
}
"""Habits beyond those of the first bench: digits, clocks, interpolation, means, derivatives, forces."""


def _significant(digits: int) -> Callable[[Array], Array]:
    return np.vectorize(lambda x: float(f"{x:.{digits - 1}e}"), otypes=[float])


def slipped(rows: Rows, slip: str, rng: np.random.Generator) -> Rows:
    """The log with one of the `SLIPS` in it."""
    q, u, t = rows.q.copy(), rows.u.copy(), rows.t.copy()
    k = int(np.argmax(np.ptp(q, axis=0)))
    if slip.startswith("clock-"):
        return replace(rows, t=t * float(slip.removeprefix("clock-")))
    if slip == "duplicated":
        for x in (q, u, *(() if rows.udot is None else (rows.udot,)), *rows.forces.values()):
            x[7::7] = x[6::7][: len(x[7::7])]
        return replace(rows, q=q, u=u)
    if slip == "late-q":
        return replace(rows, q=np.vstack([q[:1], q[:-1]]))
    if slip == "late-u":
        return replace(rows, u=np.vstack([u[:1], u[:-1]]))
    if slip == "swapped":
        u[:, [0, 1]] = u[:, [1, 0]]
        return replace(rows, u=u)
    if slip == "clipped":
        limit = 0.6 * np.abs(u[:, k]).max()
        u[:, k] = np.clip(u[:, k], -limit, limit)
        return replace(rows, u=u)
    if slip == "spiked":
        for row in rng.choice(len(t) - 20, 5, replace=False) + 10:
            u[row, k] += 3.0 * np.std(u[:, k])
        return replace(rows, u=u)
    if slip == "gear-qu":
        q[:, k] *= 0.7
        return replace(rows, q=q)
    if slip == "zero-offset":
        q[:, k] += 0.02
        return replace(rows, q=q)
    raise ValueError(slip)


def _each(rows: Rows, change: object) -> Rows:
    f = change
    assert callable(f)
    return replace(
        rows, q=f(rows.q), u=f(rows.u), udot=None if rows.udot is None else f(rows.udot),
        forces={k: f(x) if x.any() else x for k, x in rows.forces.items()},
    )  # fmt: skip


def _lowpass(x: Array, t: Array, hertz: float) -> Array:
    from scipy.signal import butter, filtfilt

    rate = 1.0 / np.median(np.diff(t))
    b, a = butter(2, min(0.9, hertz / (0.5 * rate)))
    return np.asarray(filtfilt(b, a, x, axis=0))
