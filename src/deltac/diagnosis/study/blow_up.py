"""Runs that blow up: what comes before is a motion, what comes after is none."""

from __future__ import annotations

import numpy as np

from deltac.trajectories import Trajectory

FASTEST = 3e8
"""No speed of a mechanism reaches this (m/s: light's; rad/s): the integration has become unstable."""

GROWN = 1e3
"""Speeds so many times the usual ones belong to the blow-up already."""


def before_blow_up(run: Trajectory) -> Trajectory:
    """The rows before speeds run away; the run itself where they do not."""
    size = np.abs(run.u).max(axis=1, initial=0.0)
    away = ~(size < FASTEST)
    if not away.any():
        return run
    sane = int(np.argmax(away))
    usual = float(np.median(size[:sane])) if sane else 0.0
    early = size[:sane] > GROWN * usual
    end = int(np.argmax(early)) if usual > 0.0 and early.any() else sane
    return run.between(run.t[0], run.t[max(end - 1, 0)])
