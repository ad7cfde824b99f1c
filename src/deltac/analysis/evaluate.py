"""`evaluate`: the equations of motion and the energies of a model at a state, or along a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.analysis.model import Instants, instants
from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.dynamics.equations_of_motion import (
    EquationsOfMotion,
    equations_of_motion,
    evaluate_at,
    matrices,
)
from deltac.dynamics.recursions import rnea
from deltac.models import ModelLike, StateLike
from deltac.results import Serialisable
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False, kw_only=True)
class Evaluation(Serialisable):
    """M u̇ + h = f + Gᵀλ, G u̇ + γ = 0 at an instant; of a run, samples are the first axis of arrays.

    p free speeds, nu of all joints, c rows of constraints; SI units.

    Attributes:
        t: time (s).
        speeds: names of the free speeds, the rows and columns of M.
        all_speeds: names of all speeds.
        rows: the constraint of each row.
        udot: accelerations (nu,) of all joints.
        M: mass matrix (p, p).
        bias: h (p,), inertia forces at u̇ = 0, N or N·m.
        forces: generalized force (nu,) of each channel.
        potential: potential energy of each channel that has one, J.
        kinetic: kinetic energy, J.
        phi, psi, gamma: constraints at the levels of position, velocity and (at u̇ = 0) acceleration (c,).
        G: their Jacobian (c, p), ψ̇ = G u̇ + γ.
        multipliers: λ (c,); those of least norm where rows are redundant.
        driving: forces (nu,) that drive the prescribed joints, zero at free ones.
    """

    t: float | Array
    speeds: tuple[str, ...]
    all_speeds: tuple[str, ...]
    rows: tuple[str, ...]
    udot: Array
    M: Array
    bias: Array
    forces: dict[str, Array]
    potential: dict[str, float | Array]
    kinetic: float | Array
    phi: Array
    psi: Array
    gamma: Array
    G: Array
    multipliers: Array
    driving: Array


@checked
def evaluate(
    model: ModelLike,
    state: StateLike | Trajectory = None,
    *,
    inputs: Mapping[str, ArrayLike] | None = None,
) -> Evaluation:
    """Accelerations, mass matrix, bias, forces, energies, constraints and multipliers at a state.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        state: a State; or a Trajectory, whose samples are then the first axis of every array. By default a
            problem's start.
        inputs: values (N·m or N) of the motors without a law, by name; zero where not given. A run has its
            own.

    Raises:
        InputError: a state that does not fit the model, or at which the mass matrix is singular.
    """
    at = instants(model, state, inputs)
    motion = equations_of_motion(at.mechanism)
    return evaluated(motion, at)


def evaluated(motion: EquationsOfMotion, at: Instants) -> Evaluation:
    """All of it at some instants."""
    mechanism, system, rows = at.mechanism, motion.system, motion.rows
    free = mechanism.free
    q, u = at.q[:, free.q].T, at.u[:, free.u].T
    T, nu = len(at.t), len(mechanism.speeds)
    inputs = np.broadcast_to(at.inputs, (T, at.inputs.shape[1])).T
    terms = motion.terms(at.t[None, :], q, u, inputs=inputs)
    free_udot, multipliers = motion.solved(terms)
    f = system.once("energies", lambda: _energies(motion))
    forces, potential, kinetic, M, bias = evaluate_at(f, at.t[None, :], q, u, inputs)
    forces = forces.reshape(len(motion.channels), nu, T).transpose(0, 2, 1)
    after = system.once("driving", lambda: _driving(motion))
    udot, driving = evaluate_at(after, at.t[None, :], q, u, inputs, free_udot.T, multipliers.T)
    first = 0 if at.single else slice(None)
    with_potential = [part.name for part in motion.channels if part.potential is not None]
    return Evaluation(
        t=float(at.t[0]) if at.single else at.t,
        speeds=mechanism.speeds.free_names,
        all_speeds=mechanism.speeds.names,
        rows=rows.names,
        udot=udot.T[first],
        M=matrices(M, len(free.u), len(free.u))[first],
        bias=bias.T[first],
        forces={part.name: forces[k][first] for k, part in enumerate(motion.channels)},
        potential={name: _scalar(potential[k], at) for k, name in enumerate(with_potential)},
        kinetic=_scalar(kinetic[0], at),
        phi=terms.phi.T[first],
        psi=terms.psi.T[first],
        gamma=terms.gamma.T[first],
        G=terms.G[first],
        multipliers=multipliers[first],
        driving=driving.T[first],
    )


def _scalar(values: Array, at: Instants) -> Any:
    return float(values[0]) if at.single else values


def _energies(motion: EquationsOfMotion) -> Any:
    """(t, q, u, inputs) -> forces of the channels on all speeds, potentials, kinetic energy, M and h."""
    s = motion.system
    forces = ca.horzcat(ca.SX(len(s.mechanism.speeds), 0), *(c.force for c in motion.channels))
    potentials = [c.potential for c in motion.channels if c.potential is not None]
    kinetic = 0.5 * ca.dot(s.u_all, ca.mtimes(motion.M_all, s.u_all))
    inertia = [motion.M, motion.bias[s.free_u, :]]
    columns = [forces, ca.vertcat(ca.SX(0, 1), *potentials), kinetic, *inertia]
    arguments = [s.t, s.q, s.u, s.inputs]
    return ca.Function(
        "energies", arguments, [ca.densify(ca.vec(x)) for x in columns], {"cse": True}
    )


def _driving(motion: EquationsOfMotion) -> Any:
    """(t, q, u, inputs, u̇, λ) -> all accelerations, and the driving forces −(F* + F + Gᵀλ)."""
    s, lam = motion.system, ca.SX.sym("lambda", len(motion.rows))
    needed = rnea(s, s.udot_all) - motion.force - ca.mtimes(motion.rows.G_all.T, lam)
    driving = ca.SX.zeros(len(s.mechanism.speeds))
    if s.driven_u:
        driving[s.driven_u] = needed[s.driven_u]
    arguments = [s.t, s.q, s.u, s.inputs, s.udot, lam]
    return ca.Function("driving", arguments, [ca.densify(s.udot_all), ca.densify(driving)])
