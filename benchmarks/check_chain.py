"""Chains of hinges and their equations in one function: what `deltac check` is timed on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import deltac as dc
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward

Array = NDArray[np.float64]


def chain(dof: int) -> dc.Mechanism:
    """Damped hinges about x, y and z in turn, a box hanging from each."""
    bodies, joints = [], []
    for k in range(dof):
        bodies.append(dc.bodies.box(f"b{k}", 1 + 0.1 * k, (0.1, 0.3, 0.2), (0, -0.15, 0)))
        above, place = (f"b{k - 1}", (0, -0.3, 0)) if k else ("ground", (0, 0, 0))
        joints.append(
            dc.revolute(f"j{k}", above, f"b{k}", "xyz"[k % 3], position=place, damping=0.01)
        )
    return dc.Mechanism(bodies, joints, gravity=(0, -9.81, 0))


def equations(dof: int) -> dc.Equations:
    """The chain's accelerations, as a function of Python's that CasADi's evaluator computes."""
    system = trace(chain(dof))
    rate: Callable[..., ca.DM] = ca.Function(
        "rate", [system.t, system.q, system.u], [forward(system).udot[system.free_u]]
    )

    def rhs(t: float, q: Array, u: Array) -> Array:
        return np.array(rate(t, q, u)).ravel()

    return dc.Equations(rhs)


chain_3, equations_3 = partial(chain, 3), partial(equations, 3)
chain_30, equations_30 = partial(chain, 30), partial(equations, 30)
