"""`inverse_dynamics`: the forces of the drives that make a recorded motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltac.analysis.model import instants
from deltac.arrays import SAME, Array
from deltac.calls.arguments import checked
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import ArgumentsError, LogError, ModelError, check_names
from deltac.mechanism.channels import ByChannel, ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, load_model
from deltac.results import Serialisable
from deltac.trajectories import Trajectory
from deltac.trajectories.rates import with_accelerations


@dataclass(frozen=True, eq=False, kw_only=True)
class InverseDynamics(Serialisable, omit=("run",)):
    """M u̇ + h = f + τ + Gᵀλ, solved for the drives' forces τ and the multipliers λ.

    T samples, nu speeds of all joints; N at translations, N·m at rotations, positive along the speed.

    Attributes:
        speeds: names of all speeds.
        forces: generalized force (T, nu) of each drive, by channel: ``prescribed <joint>``,
            ``actuator <motor>``, or ``actuator <joint>`` of a joint without a motor.
        constraints: generalized force Gᵀλ (T, nu) of each constraint, by channel. Of redundant constraints it
            is the one of least norm.
        residual: force (T, nu) that the motion needs and neither drives nor constraints can give.
        singular: times (s) at which the motion does not determine the drives' forces, or determines them
            badly: there they are those of least norm.
        run: the recorded run with these forces in place of its own, for `balance` and `audit`.
    """

    speeds: tuple[str, ...]
    forces: ByChannel
    constraints: ByChannel
    residual: Array
    singular: Array
    run: Trajectory


@checked
def inverse_dynamics(
    model: ModelLike, run: Trajectory, drives: Sequence[str] | None = None
) -> InverseDynamics:
    """What the drives of a model must have done in a recorded motion.

    All joints follow the run, prescribed ones too: their laws are not consulted. Forces of the model and
    those that the run holds for other channels (a contact, a measured load) act as they are.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        run: the motion. Accelerations that it lacks are derived from the speeds by splines; the run of the
            result says so and estimates their error (``provenance.derived``).
        drives: joints that are driven; by default those that are prescribed or have a motor without a law,
            and all joints where there are none.

    Returns:
        The forces, what they leave unexplained, and the run that holds them.

    Raises:
        InputError: an unknown joint, or more drives than the constraints leave degrees of freedom.
    """
    mechanism = load_model(model).mechanism
    run = with_accelerations(run)
    released = replace(
        mechanism, joints=tuple(replace(joint, motion=()) for joint in mechanism.joints)
    )
    at = instants(released, replace(run, forces={}))
    if at.udot is None:
        raise LogError(
            "inverse dynamics needs the accelerations u̇, and no spline goes across the events of this run; "
            "give a run that holds u̇, or a part of it without events"
        )
    channels = _channels(mechanism, drives)
    motion = equations_of_motion(released)
    terms = motion.terms(at.t[None, :], at.q.T, at.u.T)
    tied = {ChannelName("constraint", constraint.name) for constraint in mechanism.constraints}
    applied = {n: f for n, f in run.forces.items() if n not in tied and n not in channels}
    acting = {name: force.T for name, force in terms.forces.items()} | applied
    needed = np.einsum("tij,tj->ti", terms.M, at.udot) + terms.bias.T
    needed = needed - sum(acting.values(), start=np.zeros_like(needed))
    driven = [k for place in channels.values() for k in range(place.start, place.stop)]
    unit = np.eye(needed.shape[1])[:, driven]
    columns = np.concatenate(
        [np.broadcast_to(unit, (len(needed), *unit.shape)), terms.G.transpose(0, 2, 1)], axis=2
    )
    solved, singular = _solved(columns, needed, len(driven))
    if len(singular) == len(at.t):
        raise ModelError(
            f"the forces of {', '.join(map(repr, channels))} are not determined by the motion: the "
            f"constraints of {mechanism.name!r} leave fewer degrees of freedom than these {len(driven)} "
            "drives have; name those that did drive it, drives=[…]"
        )
    pushed = np.zeros_like(needed)
    pushed[:, driven] = solved[:, : len(driven)]
    forces = {name: np.zeros_like(needed) for name in channels}
    for name, place in channels.items():
        forces[name][:, place] = pushed[:, place]
    multipliers = solved[:, len(driven) :]
    constraints = {}
    for row in dict.fromkeys(motion.rows.names):
        rows = motion.rows.places(row)
        pull = np.einsum("tcj,tc->tj", terms.G[:, rows], multipliers[:, rows])
        constraints[ChannelName("constraint", row)] = pull
    explained = pushed + sum(constraints.values(), start=np.zeros_like(needed))
    return InverseDynamics(
        speeds=mechanism.speeds.names,
        forces=forces,
        constraints=constraints,
        residual=needed - explained,
        singular=at.t[singular],
        run=replace(
            run,
            forces={**applied, **forces, **constraints},
            mechanism=mechanism,
            # They are functions of time, held over no step.
            provenance=replace(run.provenance, held=()),
        ),
    )


def _channels(mechanism: Mechanism, drives: Sequence[str] | None) -> dict[ChannelName, slice]:
    """The channels of the drives, and where the speeds are on which they act."""
    motors = {motor.joint: motor.name for motor in mechanism.motors}
    movable = {joint.name: joint for joint in mechanism.joints if joint.speeds}
    if drives is None:
        drives = [n for n, joint in movable.items() if joint.prescribed or n in motors]
        drives = drives or list(movable)
    elif isinstance(drives, str):
        drives = [drives]
    check_names(drives, movable, "drives: no joint that moves is called")
    if not drives:
        raise ArgumentsError("drives: no joint is named; leave it out to have all that are driven")
    named = {}
    for name in dict.fromkeys(drives):
        kind = "prescribed" if movable[name].prescribed else "actuator"
        named[ChannelName(kind, motors.get(name, name))] = mechanism.speeds.of(name)
    return named


def _solved(columns: Array, needed: Array, drives: int) -> tuple[Array, NDArray[np.intp]]:
    """Least solutions x (T, n) of A x = b, and samples at which the first entries are not determined."""
    basis, values, right = np.linalg.svd(columns, full_matrices=False)
    largest = values.max(axis=1, initial=1e-300)[:, None]
    present = values > SAME * largest
    inverse = np.where(present, 1.0 / np.where(present, values, 1.0), 0.0)
    x = np.einsum("tkn,tk->tn", right, inverse * np.einsum("tmk,tm->tk", basis, needed))
    # What the kept directions leave of a unit force of a drive is not determined.
    coefficients = right[:, :, :drives] * present[:, :, None]
    share = 1.0 - np.square(coefficients).sum(axis=1)
    return x, np.flatnonzero((share > 1e-6).any(axis=1))
