"""Equations by hand in a study: what they raise, or cannot say, is told with the state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deltac.diagnosis.check_rhs import Caller
from deltac.diagnosis.kane import Kane
from deltac.diagnosis.states import States, states_along
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.equations import Equations
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class _Careful:
    """The function as it is for symbols; for numbers, an InputError with the state where it raises."""

    caller: Caller
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]

    def __call__(self, t: Any, q: Any, u: Any) -> Any:
        if np.asarray(u).dtype == object or np.ndim(u) != 1:
            return self.caller.rhs(t, q, u)
        at = States(
            np.array([t], dtype=np.float64), q[:, None], u[:, None], self.coordinates, self.speeds
        )
        return self.caller(at)[:, 0]


def carefully(equations: Equations, mechanism: Mechanism, state: State) -> Equations:
    """The equations, called with care.

    Raises InputError if they raise at the start, or return there what is no u̇ or is not finite.
    """
    kane = Kane(mechanism, equations.coordinates)
    caller = Caller(equations.rhs, equations.name, vectorised=False)
    start = _start(kane, state)
    if start is not None:
        udot = caller(start)[:, 0]
        if not np.isfinite(udot).all():
            at = ", ".join(f"{name} = {x:.6g}" for name, x in start.describe(0).items())
            raise InputError(
                f"{equations.name} returned values that are not finite at the start: u̇ = "
                f"{udot.tolist()}. State: {at}"
            )
    return replace(
        equations, rhs=_Careful(caller, tuple(kane.coordinate_names), tuple(kane.speed_names))
    )


def _start(kane: Kane, state: State) -> States | None:
    """The start in own coordinates; None where that cannot be said, which is for the simulation to tell."""
    try:
        run = Trajectory(
            t=np.array([state.t]),
            q=np.array([state.q]),
            u=np.array([state.u]),
            coordinates=kane.mechanism.coordinates.names,
            speeds=kane.mechanism.speeds.names,
        )
        return states_along(kane, run, np.zeros(1, dtype=np.intp))
    except InputError:
        return None
