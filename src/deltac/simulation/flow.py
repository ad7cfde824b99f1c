"""What a solver integrates: ẋ = f(t, x) with x = (q, u, ∫P), in symbols.

q and u are the free coordinates and speeds, or the user's own ones where equations are written by
hand; behind them stands one integral of the power P for each testing function, so that solver and step
treat P as they treat the motion (theory: the integral "in the loop").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.dynamics.coordinates import OwnCoordinates, trace_map
from deltac.dynamics.forces import channels
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.dynamics.terms import driving_forces, forward, terms
from deltac.dynamics.testing_functions import testing_functions
from deltac.mechanism.coordinates import CoordinateMap
from deltac.mechanism.joints import KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.equations import Equations, trace_rhs


@dataclass(frozen=True)
class Flow:
    """ẋ in symbols, and what is observed of a motion.

    Inputs: `t`, the state `x`, values of motors `inputs`, parameters `p`; and `given`, the
    accelerations of a hand-written function that could not be traced (else empty). `q_size`, `u_size`
    divide x. The outputs `q_all`, `u_all`, `udot_all` and the `driving` forces are full vectors of the
    mechanism.
    """

    system: System
    testing: tuple[str, ...]
    equations: Equations | None
    own: OwnCoordinates | None
    t: SX
    x: SX
    inputs: SX
    given: SX
    p: SX
    xdot: SX
    q_size: int
    u_size: int
    q_all: SX
    u_all: SX
    udot_all: SX
    driving: SX

    @property
    def traced(self) -> bool:
        """Whether ẋ is known in symbols entirely, so that steps can be compiled."""
        return bool(self.given.shape[0] == 0)

    @property
    def parts(self) -> tuple[slice, slice, slice]:
        """Where q, u and the integrals lie in x."""
        n = self.q_size + self.u_size
        return slice(0, self.q_size), slice(self.q_size, n), slice(n, self.x.shape[0])

    def normalised(self, x: SX) -> SX:
        """X with its quaternions brought back to unit length."""
        if self.own is not None:
            return x
        result = ca.SX(x)
        for place in quaternions(self.system.mechanism):
            result[place] = x[place] / ca.sqrt(ca.dot(x[place], x[place]))
        return result

    def start(self, state: State, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """X at the initial state, with integrals zero; `p` are the values of the parameters."""
        free = self.system.mechanism.free
        q, u = state.q[free.q], state.u[free.u]
        if self.own is not None:
            system = self.system
            own_q, own_u = self.own.own_state(system)
            inputs = [system.t, system.q, system.u, system.p]
            values = ca.Function("own", inputs, [own_q, own_u])
            found = values(state.t, q, u, p)
            q, u = (np.array(part).ravel() for part in found)
        return np.concatenate([q, u, np.zeros(len(self.testing))])


def quaternions(mechanism: Mechanism) -> list[slice]:
    """Places of unit quaternions in the free coordinates."""
    places = []
    free = {int(index): k for k, index in enumerate(mechanism.free.q)}
    for joint in mechanism.joints:
        offset = KINDS[joint.kind].quaternion
        if offset is not None:
            start = free[mechanism.coordinates.of(joint.name).start + offset]
            places.append(slice(start, start + 4))
    return places


def build_flow(
    mechanism: Mechanism,
    testing: Sequence[str] = (),
    equations: Equations | None = None,
    split: CoordinateMap | None = None,
    vary: Sequence[str] = (),
) -> Flow:
    """Write out ẋ for a mechanism; `split` chooses the generalized speeds of the testing functions."""
    system = trace(mechanism, vary)
    functions = testing_functions(testing)
    parts = channels(system)
    split_own = trace_map(system, split) if split is not None else None
    own: OwnCoordinates | None = None
    given = ca.SX(0, 1)
    if equations is None:
        motion = forward(system, parts)
        udot_all, driving = motion.udot, motion.driving
        q, u, qdot, udot = system.q, system.u, system.qdot, udot_all[system.free_u]
    else:
        if equations.coordinates is not None:
            own = trace_map(system, equations.coordinates)
            q, u, qdot = own.own_q, own.own_u, own.own_qdot
        else:
            q, u, qdot = system.q, system.u, system.qdot
        traced = trace_rhs(equations, system.t, q, u)
        if traced is None:
            given = ca.SX.sym("given", u.shape[0])
        udot = given if traced is None else traced
        udot_all = ca.SX(system.udot_all)
        driving = driving_forces(system, udot_all, parts)

    known = terms(system, udot_all, parts, split_own)
    powers = [function.P(known) for function in functions]
    outputs = [ca.SX(system.q_all), ca.SX(system.u_all), udot_all, driving, *powers]
    if equations is not None:
        # The mechanism's symbols give way to what the hand-written equations say of them.
        free_udot = own.udot(system, udot) if own is not None else udot
        outputs = ca.substitute(outputs, [system.udot], [free_udot])
        if own is not None:
            outputs = ca.substitute(outputs, [system.q, system.u], [own.q, own.u])
    q_all, u_all, udot_all, driving, *powers = outputs
    x = ca.vertcat(q, u, ca.SX.sym("z", len(functions)))
    return Flow(
        system=system,
        testing=tuple(function.name for function in functions),
        equations=equations,
        own=own,
        t=system.t,
        x=x,
        inputs=system.inputs,
        given=given,
        p=system.p,
        xdot=ca.vertcat(qdot, udot, *powers),
        q_size=q.shape[0],
        u_size=u.shape[0],
        q_all=q_all,
        u_all=u_all,
        udot_all=udot_all,
        driving=driving,
    )
