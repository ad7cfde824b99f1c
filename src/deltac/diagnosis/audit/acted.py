"""Forces as they acted: a log may hold the command, before an actuator delayed or limited it.

Where one force alone acts on a speed and is logged, the motion tells what acted: the logged force and what
the equations miss. Set beside the logged one, row by row, it shows a delay (the same, some rows later) and a
limit (the same, up to a largest value). Either is believed where it takes off nearly all that was missing; a
wrong parameter of the model is no such function of the logged force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.residuals.rows import UNEVEN, Model
from deltac.diagnosis.verdict import Finding
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

LEFT = 0.02
"""What a delay or a limit may leave of what is missing."""

FARTHEST = 0.05
"""The longest delay that is looked for, as a share of the log."""

MOST_ROWS = 4000
"""Rows that are looked at."""

ALIKE = 1.1
"""Ratio of what two limits leave up to which one is as good as the other."""

LEAST_ROWS = 50
"""Rows of the shortest log in which a delay or a limit is looked for."""


@dataclass(frozen=True)
class Acted:
    """How a channel's force followed its logged one: `rows` later, between `least` and `most` (N, N·m)."""

    channel: ChannelName
    rows: int = 0
    least: float = -np.inf
    most: float = np.inf


def as_acted(mechanism: Mechanism, run: Trajectory) -> tuple[Trajectory, list[Finding]] | None:
    """The log with forces as they acted, and what they are; None where they are as logged.

    `run` has consecutive rows. Nothing is put right where it has works or integrals, which are of the forces
    that acted.
    """
    alone = _alone(mechanism, run)
    if not alone or len(run) < LEAST_ROWS or run.works or run.integrals:
        return None
    required = _required(mechanism, run)
    found = []
    for name, speed, place in alone:
        found += _compared(name, run.forces[name][: len(required) + 1, speed], required[:, place])
    if not found:
        return None
    late = max(0, max(a.rows for a in found))
    early = max(0, max(-a.rows for a in found))
    forces = dict(run.forces)
    for a in found:
        forces[a.channel] = np.clip(np.roll(run.forces[a.channel], a.rows, axis=0), a.least, a.most)
    kept = slice(late, len(run) - early)
    part = run.between(run.t[kept][0], run.t[kept][-1])
    part = replace(part, forces={name: values[kept] for name, values in forces.items()})
    h = np.diff(run.t)
    step = float(np.median(h)) if np.ptp(h) < UNEVEN * np.median(h) else None
    return part, [_told(a, step) for a in found]


def _alone(mechanism: Mechanism, run: Trajectory) -> list[tuple[ChannelName, int, int]]:
    """Channels that alone act on one free speed: name, the speed's place among all and among free ones."""
    free = {int(k): i for i, k in enumerate(mechanism.free.u)}
    acting = {name: np.flatnonzero(np.ptp(force, axis=0)) for name, force in run.forces.items()}
    counts = np.bincount(np.concatenate([*acting.values(), []]).astype(int), minlength=1)
    return [
        (name, int(k[0]), free[int(k[0])])
        for name, k in acting.items()
        if len(k) == 1 and int(k[0]) in free and counts[k[0]] == 1
    ]


def _required(mechanism: Mechanism, run: Trajectory) -> Array:
    """What the motion misses in each interval (T − 1, n), N or N·m, by the accelerations at its ends."""
    model = Model(mechanism, run)
    free, rows = mechanism.free, slice(0, min(len(run), MOST_ROWS))
    t, q, u = run.t[rows], run.q[rows][:, free.q], run.u[rows][:, free.u]
    values = list(model.log.values(run).values())
    F = np.concatenate(values, axis=1)[rows] if values else np.zeros((len(t), 0))
    mean = 0.5 * (
        model.acceleration(t[:-1], q[:-1], u[:-1], F[:-1])
        + model.acceleration(t[1:], q[1:], u[1:], F[:-1])
    )
    missing = np.diff(u, axis=0) / np.diff(t)[:, None] - mean
    M = model.inertia(t, q)
    return np.asarray(np.einsum("tij,tj->ti", 0.5 * (M[:-1] + M[1:]), missing))


def _compared(name: ChannelName, logged: Array, missing: Array) -> list[Acted]:
    """The delay or limit that takes off nearly all that is missing (T − 1,) beside one logged force (T,)."""
    from scipy.optimize import brute

    required = logged[:-1] + missing

    def left(acted: Array, rows: slice = slice(None)) -> float:
        """Held over a step, or changing along it, whichever leaves less."""
        over_steps = acted[:-1], 0.5 * (acted[:-1] + acted[1:])
        return min(float(np.sqrt(np.mean((required - F)[rows] ** 2))) for F in over_steps)

    was = left(logged)
    farthest = max(1, int(FARTHEST * len(required)))
    inner = slice(farthest, len(required) - farthest)
    delays = {k: left(np.roll(logged, k), inner) for k in range(-farthest, farthest + 1)}
    k = min(delays, key=delays.__getitem__)
    if delays[k] < LEFT * delays[0]:
        return [Acted(name, rows=k)]
    low, high = float(logged.min()), float(logged.max())
    ranges = (low, max(low, 0.0)), (min(high, 0.0), high)

    def leaves(bounds: Sequence[float]) -> float:
        return left(np.clip(logged, bounds[0], bounds[1]))

    found = brute(leaves, ranges)
    limits = [[float(f"{x:.{digits}g}") for x in found] for digits in (1, 2, 3, 4)]
    limits.append(found.tolist())
    left_by = [leaves(bounds) for bounds in limits]
    # Limits are round numbers: the roundest that leave hardly more are the ones.
    limited, (least, most) = next(
        (x, bounds) for x, bounds in zip(left_by, limits) if x <= ALIKE * left_by[-1]
    )
    # Of a force of few values a wrong factor or offset is a limit as well: then nothing is told.
    line = np.column_stack([logged, np.ones_like(logged)])
    fitted = np.linalg.lstsq(line[:-1], required)[0]
    if limited >= LEFT * was or left(line @ fitted) < LEFT * was:
        return []
    # A bound that takes off nothing is none.
    if left(np.clip(logged, least, np.inf)) <= ALIKE * limited:
        most = np.inf
    if left(np.clip(logged, -np.inf, most)) <= ALIKE * limited:
        least = -np.inf
    return [Acted(name, least=least, most=most)]


def _told(a: Acted, step: float | None) -> Finding:
    if a.rows:
        when = "later" if a.rows > 0 else "earlier"
        many = f"{abs(a.rows)} rows" if abs(a.rows) > 1 else "a row"
        time = "" if step is None else f" ({abs(a.rows) * step:.4g} s)"
        return Finding(
            "force-delayed",
            f"the force of {a.channel!r} acted {many}{time} {when} than the log says",
            "shifted by that, it leaves less than 2 % of the residual",
            "It was shifted. Log the force that acts, after all delays of actuators and communication",
            element=a.channel,
            factor=None if step is None else a.rows * step,
        )
    within = f"between {a.least:.3g} and {a.most:.3g}"
    if np.isinf(a.least):
        within = f"up to {a.most:.3g}"
    elif np.isinf(a.most):
        within = f"from {a.least:.3g} up"
    return Finding(
        "force-limited",
        f"the force of {a.channel!r} acted only {within}; the logged force exceeds that",
        "clipped to that, it leaves less than 2 % of the residual",
        "It was clipped. Log the force that acts, after the limits of the actuator, not the command",
        element=a.channel,
    )
