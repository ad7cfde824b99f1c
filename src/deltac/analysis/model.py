"""What every verb of this package is given: a model, and a state or the samples of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.errors import ArgumentsError, InputError, StateError, check_names
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.models import ModelLike, StateLike, load_model
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class Instants:
    """Instants of a mechanism: t (T,), q (T, nq), u (T, nu) of all joints, motors' values (T, inputs).

    `udot` (T, nu) are the accelerations of a run that has them. `single` tells that a state was given, whose
    results have no sample axis.
    """

    mechanism: Mechanism
    t: Array
    q: Array
    u: Array
    inputs: Array
    udot: Array | None
    single: bool


def instants(
    model: ModelLike, at: StateLike | Trajectory, inputs: Mapping[str, Any] | None = None
) -> Instants:
    """A model and where it is looked at; without `at` the model's own start.

    `inputs` are values of motors without a law by name, zero by default; a run has its own.
    """
    loaded = load_model(model)
    mechanism = loaded.mechanism
    if not isinstance(at, Trajectory):
        at = loaded.start(at)
    single = isinstance(at, State)
    t, q, u = np.atleast_1d(at.t), np.atleast_2d(at.q), np.atleast_2d(at.u)
    nq, nu = len(mechanism.coordinates), len(mechanism.speeds)
    if q.shape[1] != nq or u.shape[1] != nu:
        raise StateError(
            f"state: it has {q.shape[1]} coordinates and {u.shape[1]} speeds; the mechanism "
            f"{mechanism.name!r} has {nq} and {nu}"
        )
    if isinstance(at, Trajectory):
        if inputs is not None:
            raise ArgumentsError("inputs: a run has its motors' values itself; leave them out")
        return Instants(mechanism, t, q, u, _logged(mechanism, at), at.udot, single)
    values = _motor_values(mechanism, inputs or {})[None, :]
    return Instants(mechanism, t, q, u, values, None, single)


def _motor_values(mechanism: Mechanism, inputs: Mapping[str, Any]) -> Array:
    """Values of all motors without a law (inputs,), zero by default."""
    names = [motor.name for motor in mechanism.motors]
    check_names(inputs, names, "inputs: no joint torque without a law is called")
    values: list[Array] = [np.zeros(0)]
    for motor in mechanism.motors:
        size = len(mechanism.joint(motor.joint).speeds)
        value = np.atleast_1d(np.asarray(inputs.get(motor.name, np.zeros(size)), dtype=float))
        if value.shape != (size,) or not np.isfinite(value).all():
            raise InputError(
                f"inputs: {inputs[motor.name]!r} for joint torque {motor.name!r}; expected {size} finite "
                "value(s), N·m or N"
            )
        values.append(value)
    return np.concatenate(values)


def _logged(mechanism: Mechanism, run: Trajectory) -> Array:
    columns = [np.zeros((len(run.t), 0))]
    for motor in mechanism.motors:
        where = mechanism.speeds.of(motor.joint)
        force = run.forces.get(f"actuator {motor.name}")
        if force is None:
            columns.append(np.zeros((len(run.t), where.stop - where.start)))
        else:
            columns.append(force[:, where])
    return np.hstack(columns)
