"""How large the states of a run are: what an absolute tolerance is a share of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, SMALL_SHARE, Array, max_norm
from deltac.dynamics.digits import NEARBY
from deltac.dynamics.equations_of_motion import evaluate_at
from deltac.dynamics.testing_functions import MOMENTUM
from deltac.simulation.flow import StateFlow


def state_sizes(
    flow: StateFlow,
    rate: Callable[[float, Array], Array],
    t: float,
    x: Array,
    p: Array,
    duration: float,
    tolerance: float,
) -> Array:
    """Size (n,) of each state of a run, estimated at its start, in the state's own unit.

    An angle has the size 1. A length has that of the largest one at the start; where all are zero, of the way
    that can be covered in the time of the run, at most 1 m. A speed has the size that it has, or that it
    reaches by its acceleration over the size of its coordinate, or by which that is passed in the run's time.
    All energies and works have the size of the kinetic energy at these speeds. No state is so small that its
    tolerance is below what rounding makes of it.

    Args:
        flow: what is integrated.
        rate: ẋ (n,) at (t, x).
        t: time of the start.
        x: the start (n,).
        p: values of the parameters (np,).
        duration: of the run, s.
        tolerance: relative.
    """
    xdot = rate(t, x)
    q_part, u_part, z_part = flow.parts
    q, u, udot = x[q_part], x[u_part], xdot[u_part]
    turning_q, turning_u = _angles(flow)
    length = max_norm(q[~turning_q])
    if length <= EPS:
        way = (np.abs(u) + np.abs(udot) * duration) * duration
        length = min(1.0, float(way[~turning_u].max(initial=0.0))) or 1.0
    travel = np.where(turning_u, 1.0, length)
    reached = np.maximum(np.abs(u), np.sqrt(2.0 * np.abs(udot) * travel))
    reached = np.maximum(reached, travel / duration)
    speeds = np.where(
        turning_u, reached[turning_u].max(initial=0.0), reached[~turning_u].max(initial=0.0)
    )
    state = x.copy()
    state[u_part] = reached
    (energies,) = evaluate_at(flow.energy, t, state, p)
    sums = np.full(x[z_part].shape, max(float(energies[-2]), EPS * abs(float(energies[-1]))))
    for k, name in enumerate(flow.integrals, len(flow.works)):
        if name.startswith(MOMENTUM):
            sums[k] /= speeds.min()
    sizes = np.concatenate([np.where(turning_q, 1.0, length), speeds, sums])
    # A satellite at kilometres a second: m v × v is not quite zero, and turns it.
    time = float((travel / speeds).min(initial=duration))
    rounding = _scatter(rate, t, x, sizes) * time
    for turning, at_q in ((turning_u, turning_q), (~turning_u, ~turning_q)):
        drift = rounding[u_part][turning].max(initial=0.0) * time
        rounding[q_part][at_q] = np.maximum(rounding[q_part][at_q], drift)
    return np.asarray(np.maximum(sizes, rounding / (SMALL_SHARE * tolerance)))


def _scatter(rate: Callable[[float, Array], Array], t: float, x: Array, sizes: Array) -> Array:
    """How far ẋ (n,) scatters when the last bits of the state change, near the start."""
    rng = np.random.default_rng(1)
    near = x + NEARBY * rng.uniform(-1.0, 1.0, len(x)) * sizes
    shaken = [near * (1.0 + EPS * rng.integers(-2, 3, len(x))) for _ in range(3)]
    with np.errstate(all="ignore"):
        rate_at_x = rate(t, near)
        scatter = np.abs([rate(t, other) - rate_at_x for other in shaken]).max(axis=0)
    return np.where(np.isfinite(scatter), scatter, 0.0)


def _angles(flow: StateFlow) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which coordinates and which speeds of x are of angles; of the user's own the unit is not known."""
    mechanism, free = flow.system.mechanism, flow.system.mechanism.free
    if flow.own is not None:
        return np.zeros(flow.q_size, bool), np.zeros(flow.u_size, bool)
    return (
        np.array([mechanism.coordinates[int(k)].unit != "m" for k in free.q], bool),
        np.array([mechanism.speeds[int(k)].unit != "m/s" for k in free.u], bool),
    )
