"""Testing functions in rate form, and the size of the powers that cancel in them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.dynamics.terms import Terms
from deltac.dynamics.testing_functions import TESTING_FUNCTIONS
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from tests.oracles.textbook.tree import Textbook

# Rounding of ε against the powers that cancel in it: some hundred operations deep.
ROUNDING = 1e-12
NAMES = tuple(TESTING_FUNCTIONS)


def rate_forms(system: System, k: Terms) -> list[SX]:
    """ε of every testing function; Ė by the chain rule along (q̇, u̇, 1)."""
    along = ca.vertcat(system.q, system.u, system.t)
    direction = ca.vertcat(system.qdot, system.udot, 1)
    return [ca.jtimes(f.E(k), along, direction) - f.P(k) for f in TESTING_FUNCTIONS.values()]


def scale_of(book: Textbook, udot: Any) -> float:
    """The size (W) of the powers that cancel in ε: every force with every velocity, each by its size."""
    forces = np.abs(book.M) @ (np.abs(book.P) @ np.abs(udot) + np.abs(book.P_dot) @ np.abs(book.u))
    for channel in book.channels:
        forces = forces + np.abs(channel.F)
    return 1.0 + float((forces + np.abs(book.beta)) @ (np.abs(book.P) @ np.abs(book.u)))


def without_forces(mechanism: Mechanism, run: Trajectory) -> tuple[np.ndarray, ...]:
    """Inputs of column kernels: t, free q, u and u̇ of a run; no logged forces, nor rates of such."""
    free = mechanism.free
    assert run.udot is not None and not run.forces
    states = run.q[:, free.q], run.u[:, free.u], run.udot[:, free.u]
    return run.t, *states, *([np.zeros((len(run), 0))] * 3)
