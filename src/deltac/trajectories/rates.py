"""Speeds and accelerations that a log lacks, from splines, with an estimate of the error.

Coordinates are interpolated by splines of degree 5 (Dierckx; de Boor, *A Practical Guide to Splines*),
so that the derivative at a sample errs by O(h⁵) in smooth motion of spacing h. A quaternion p is
interpolated in its components, with signs that do not jump; p/|p| turns with the angular velocity
ω = 2 Im(p* ṗ)/|p|², body components, exactly. The error is estimated by deriving from every second
sample: far above the error where that falls with h, and of its size where noise makes it grow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.errors import LogError
from deltac.trajectories.columns import MechanismNames, RateNames, speeds_of
from deltac.trajectories.splines import smooth_rates
from deltac.trajectories.trajectory import Trajectory, check_times, row_name

GAP = 5.0
"""Ratio of an interval to those around it above which it is a gap."""

FEWEST_ROWS = 4
"""Rows without which a motion cannot be differentiated."""


def derived_speeds(
    columns: Mapping[str, Array], names: MechanismNames | None
) -> tuple[dict[str, Array], dict[str, float]]:
    """The columns ``u.<speed>`` that belong to the columns ``q.<coordinate>``, and the error of each.

    Raises InputError for too few rows, or times that do not increase.
    """
    coordinates = [name.removeprefix("q.") for name in columns if name.startswith("q.")]
    speeds = list(names.speeds) if names is not None else list(speeds_of(coordinates))
    t = columns["time"]
    q = np.column_stack([columns[f"q.{name}"] for name in coordinates])
    _check(t, q, "u.<speed>", [f"q.{name}" for name in coordinates])
    kinematics = _complete(coordinates, speeds)
    u = _speeds(t, q, kinematics, len(speeds))
    error = _error(t, u, lambda s: _speeds(t[s], q[s], kinematics, len(speeds)))
    speed_columns = {f"u.{name}": u[:, index] for index, name in enumerate(speeds)}
    return speed_columns, {name: float(e) for name, e in zip(speeds, error, strict=True)}


def with_speeds(run: Trajectory, names: MechanismNames) -> Trajectory:
    """The run with those speeds derived anew that were derived from coordinates."""
    columns = {"time": run.t} | {f"q.{n}": x for n, x in zip(run.coordinates, run.q.T, strict=True)}
    speeds, errors = derived_speeds(columns, names)
    own = run.provenance.derived["u"]
    u = np.array(run.u)
    for k, name in enumerate(run.speeds):
        if name in own:
            u[:, k] = speeds[f"u.{name}"]
    derived = {**run.provenance.derived, "u": {name: errors[name] for name in own}}
    return replace(run, u=u, provenance=replace(run.provenance, derived=derived))


def with_accelerations(run: Trajectory) -> Trajectory:
    """The run with u̇ derived from u, marked in ``provenance.derived``; as it is if it has u̇.

    ``provenance.derived["udot"]`` has an estimate of the largest error of every speed's (m/s², rad/s²).

    Raises InputError for fewer than four rows.
    """
    if (
        run.udot is not None or run.events
    ):  # no spline goes across an event; ledgers derive by pieces
        return run
    _check(run.t, run.u, "udot.<speed>", [f"u.{name}" for name in run.speeds])
    udot = _rate(run.t, run.u)
    error = _error(run.t, udot, lambda s: _rate(run.t[s], run.u[s]))
    errors = {name: float(e) for name, e in zip(run.speeds, error, strict=True)}
    derived = {**run.provenance.derived, "udot": errors}
    return replace(run, udot=udot, provenance=replace(run.provenance, derived=derived))


def derived_error(run: Trajectory, what: str = "u") -> Array | None:
    """The estimated largest errors (nu,) of derived "u" or "udot", zero where measured; None if all are."""
    errors = run.provenance.derived.get(what)
    return None if not errors else np.array([errors.get(name, 0.0) for name in run.speeds])


def angular_velocity(p: Array, pdot: Array) -> Array:
    """ω (T, 3), body components, of p/|p| for quaternions p (T, 4), scalar first, of any length."""
    w, v = p[:, :1], p[:, 1:]
    imaginary = w * pdot[:, 1:] - pdot[:, :1] * v - np.cross(v, pdot[:, 1:])
    omega: Array = 2.0 * imaginary / np.sum(p * p, axis=1, keepdims=True)
    return omega


def continuous(p: Array) -> Array:
    """Quaternions (T, 4) with signs chosen so that neighbours do not jump: p and −p are one turn."""
    jumps = np.sum(p[1:] * p[:-1], axis=1) < 0.0
    sign = np.concatenate([[1.0], np.cumprod(np.where(jumps, -1.0, 1.0))])
    result: Array = p * sign[:, None]
    return result


def rotation_vectors(p: Array, frame: str) -> Array:
    """Rotation vectors (T−1, 3) from each quaternion (T, 4) to the next, "body" or "world" components."""
    a, b = p[:-1], p[1:]
    w = np.sum(a * b, axis=1)
    sign = -1.0 if frame == "body" else 1.0
    v = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] + sign * np.cross(a[:, 1:], b[:, 1:])
    v, w = v * np.where(w < 0.0, -1.0, 1.0)[:, None], np.abs(w)
    length = np.linalg.norm(v, axis=1)
    scale = np.divide(2.0 * np.arctan2(length, w), length, out=np.zeros_like(w), where=length > 0.0)
    result: Array = v * scale[:, None]
    return result


def _speeds(t: Array, q: Array, kinematics: RateNames, count: int) -> Array:
    u = np.zeros((len(t), count))
    if kinematics.rates:
        places = np.array(kinematics.rates)
        u[:, places[:, 1]] = _rate(t, q[:, places[:, 0]])
    for _, i, j in kinematics.quaternions:
        p = continuous(q[:, i : i + 4])
        u[:, j : j + 3] = angular_velocity(p, _rate(t, p))
    return u


def _rate(t: Array, values: Array) -> Array:
    if not values.shape[1]:
        return np.zeros_like(values)
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            rates = smooth_rates(t, values)
    except np.linalg.LinAlgError:
        rates = np.full_like(values, np.nan)
    if not np.isfinite(rates).all():
        raise LogError(
            "rates cannot be derived: values or gaps between rows differ by too many powers of ten; "
            "look for a wrong number, or log the rates"
        )
    return rates


def _error(t: Array, fine: Array, derive: Callable[[slice], Array]) -> list[float]:
    """The largest difference, in each column, to what every second sample alone gives."""
    halves = [slice(0, None, 2), slice(1, None, 2)]
    if len(t[halves[1]]) < 2:
        return [float("inf")] * fine.shape[1]
    differences = [np.abs(derive(half) - fine[half]).max(axis=0) for half in halves]
    return [float(d) for d in np.maximum(*differences)]


def _complete(coordinates: Sequence[str], speeds: Sequence[str]) -> RateNames:
    kinematics = RateNames.of(coordinates, speeds)
    covered = {j for _, j in kinematics.rates}
    covered |= {j + k for _, _, j in kinematics.quaternions for k in range(3)}
    for index, name in enumerate(speeds):
        if index not in covered:
            raise LogError(
                f"no column 'u.{name}', and it cannot be derived: no logged coordinate changes with it. "
                "Log the speed."
            )
    return kinematics


def _check(t: Array, values: Array, what: str, columns: Sequence[str]) -> None:
    if len(t) < FEWEST_ROWS:
        raise LogError(
            f"no column '{what}', and {len(t)} rows are too few to derive it (at least {FEWEST_ROWS}); "
            "log it"
        )
    check_times(t)
    # Named by its column when the trajectory is made, but a spline needs finite numbers before.
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        column = columns[int(np.argmin(np.isfinite(values[row])))]
        raise LogError(
            f"no column '{what}', and it cannot be derived: column {column!r} has no finite number in "
            f"{row_name(row, len(t))}, t = {t[row]} s; correct or remove that row, or log the column that is "
            "missing"
        )
