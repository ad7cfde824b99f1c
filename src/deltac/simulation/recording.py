"""What is recorded of a run: the solver's states as a trajectory of the whole mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import Array
from deltac.dynamics.kkt import LEAST_PIVOT
from deltac.errors import DeltacError, InputError
from deltac.kernels import Kernel
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.constraints.projection import (
    NEARLY_DEPENDENT,
    smallest_pivot,
)
from deltac.simulation.flow import OFF_CONSTRAINTS, StateFlow
from deltac.simulation.stepping.protocol import Motion
from deltac.trajectories import Occurrence, Provenance, Trajectory

if TYPE_CHECKING:
    from deltac.simulation.events.run import Happened


@dataclass(frozen=True)
class Record:
    """What a run records.

    Attributes:
        testing: names of the testing functions whose power is integrated by the same solver and step; the
            integrals (J) are in the trajectory's `integrals`. "momentum" adds those of the momentum functions
            ΔP_r, as ``"momentum <speed>"`` (kg·m/s, kg·m²/s).
        every: keep every so many steps of a fixed-step solver. By default `simulate` keeps each step, and
            `simulate_ensemble` the start and the end.
        coordinates: own generalized speeds in which the Kane–Levinson functions divide the kinetic energy, or
            "absolute" for the rates of absolute angles. Of a mechanism with constraints they may be as many
            as there are independent ones, or more: the constraints give the others. The trajectory's
            provenance holds them.
    """

    testing: Sequence[str] = ("wang", "liu-huston")
    every: int | None = None
    coordinates: CoordinateMap | str | None = None

    @staticmethod
    def of(record: Record | Sequence[str] | int) -> Record:
        """What the argument `record` says: names of testing functions alone, or every how many steps."""
        if isinstance(record, Record):
            return record
        if isinstance(record, int | np.integer) and not isinstance(record, bool):
            return Record(every=int(record))
        if isinstance(record, list | tuple) and all(isinstance(name, str) for name in record):
            return Record(testing=tuple(record))
        raise InputError(
            f"record is {record!r}; expected names of testing functions, a whole number (every so many "
            "steps), or deltac.Record(testing=..., every=...)"
        )


RECORD = Record()


def observer(flow: StateFlow) -> Kernel:
    """What is recorded of a state: q, u, u̇ of all joints and the driving forces."""
    inputs = {"t": flow.t, "x": flow.x, "inputs": flow.inputs, "accelerations": flow.accelerations}
    return Kernel(
        {name: column for name, column in inputs.items() if column.shape[0]},
        {
            "q": flow.q_all,
            "u": flow.u_all,
            "udot": flow.udot_all,
            "driving": flow.driving,
            **({"energies": flow.energies} if flow.testing else {}),
            **{str(name): force for name, force in flow.reactions.items()},
            **({} if flow.bound is None else {"pivot": smallest_pivot(flow)}),
            **({"departures": flow.departures[1]} if flow.departures[0] else {}),
        },
        flow.p,
        name="observation",
    )


def observed(flow: StateFlow, observe: Kernel, motion: Motion, p: Array) -> dict[str, Array]:
    """What the observer sees of the samples of a motion, time first; p (np,), or (T, np) where it varies."""
    arrays: dict[str, Array] = {"t": motion.t}
    if flow.x.shape[0]:
        arrays["x"] = motion.x
    if flow.inputs.shape[0]:
        arrays["inputs"] = motion.inputs
    if flow.accelerations.shape[0]:
        values = np.broadcast_to(p, (len(motion.t), p.shape[-1]))
        arrays["accelerations"] = np.array(
            [flow.by_hand(*at) for at in zip(motion.t, motion.x, values)]
        )
    return observe(parameters=p, **arrays)


def recorded(
    mechanism: Mechanism,
    flow: StateFlow,
    columns: dict[str, Array],
    motion: Motion,
    p: Array,
    provenance: Provenance,
    *,
    guarded: bool,
) -> Trajectory:
    """The samples of a motion, and what was seen of them, as a trajectory of the mechanism.

    `guarded` tells that steps near dependent constraints were taken with care.
    """
    rows, (_, _, summed) = len(motion.t), flow.parts
    columns = {name: values[:rows] for name, values in columns.items()}
    singular = _singular(flow, columns, motion, p)
    note = ""
    if singular.size:
        note = _where(singular)
    elif not guarded and provenance.step is None:
        note = _near(columns, motion, provenance)
    q, u, udot, driving = (
        columns[name].reshape(rows, -1) for name in ("q", "u", "udot", "driving")
    )
    if not np.isfinite(udot.sum() + driving.sum()):  # no sum hides what is not finite
        # The last state before a run broke down may have no acceleration.
        good = np.isfinite(udot).all(axis=1) & np.isfinite(driving).all(axis=1)
        rows = rows if good.all() else int(np.argmin(good))
        if rows == 0:
            raise DeltacError(
                f"the accelerations are not finite at the start; {provenance.message}"
            )
    forces = {
        name: force[:rows] for name, force in logged_forces(flow, columns, motion.inputs).items()
    }
    if note:
        provenance = replace(provenance, singular=note)
    table = (motion.x[:rows, summed] - motion.x[0, summed]).T
    return Trajectory(
        t=motion.t[:rows],
        q=q[:rows],
        u=u[:rows],
        udot=udot[:rows],
        forces=forces,
        works=dict(zip(flow.works, table)),
        integrals=dict(zip(flow.integrals, table[len(flow.works) :])),
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        provenance=provenance,
        mechanism=mechanism,
    )


def logged_forces(
    flow: StateFlow, columns: dict[str, Array], inputs: Array
) -> dict[ChannelName, Array]:
    """Forces (T, nu) that a run records: of prescribed joints, constraints, and motors without a law."""
    mechanism = flow.system.mechanism
    rows, nu = len(inputs), len(mechanism.speeds)
    forces: dict[ChannelName, Array] = {}
    driving = columns["driving"].reshape(rows, -1)
    for joint in mechanism.joints:
        if joint.prescribed:
            place = mechanism.speeds.of(joint.name)
            force = np.zeros((rows, nu))
            force[:, place] = driving[:, place]
            forces[ChannelName("prescribed", joint.name)] = force
    forces.update({name: columns[name].reshape(rows, -1) for name in flow.reactions})
    for name, place_in in flow.system.input_places.items():
        element = next(e for e in mechanism.motors if e.name == name)
        force = np.zeros((rows, nu))
        force[:, mechanism.speeds.of(element.joint)] = inputs[:, place_in]
        forces[ChannelName("actuator", name)] = force
    return forces


def while_assembled(flow: StateFlow, motion: Motion, columns: dict[str, Array]) -> Motion:
    """The motion up to where its constraints can no longer be met, and words for it.

    A mechanism at the end of its reach cannot follow a constraint that moves on: projection fails, and
    what comes after is no motion. Motion constraints that were redundant at the start may cease to be so.
    """
    if "departures" not in columns:
        return motion
    violation = np.abs(columns["departures"].reshape(len(motion.t), -1))
    if violation.max(initial=0.0) <= OFF_CONSTRAINTS:  # no NaN is
        if not motion.message or not flow.projecting:
            return motion
        locked = "; or the mechanism is locked, and its constraints cannot be met any further"
        return replace(motion, message=motion.message + locked)
    first = max(1, int(np.argmax(~(violation <= OFF_CONSTRAINTS).all(axis=1))))
    worst = int(np.nanargmax(violation[first]))
    if worst < len(flow.slipping):
        unit = "m/s"
        why = "it followed from the other constraints at the start, and does not any more"
        remedy = "use fewer constraints, or let something slip"
    else:
        unit, why = "m or rad", "the mechanism is locked or at the end of its reach"
        remedy = "let the motion end earlier, or change the constraint"
    name, t = flow.departures[0][worst], motion.t[first]
    message = (
        f"stopped: constraint {name!r} can no longer be met at t = {t:.9g} s (off by "
        f"{violation[first, worst]:.2g} {unit}): {why}. What was computed until then is kept; {remedy}"
    )
    return Motion(motion.t[:first], motion.x[:first], motion.inputs[:first], message)


def _singular(flow: StateFlow, columns: dict[str, Array], motion: Motion, p: Array) -> Array:
    """Times of samples at which the constraints are dependent; there, what was seen is seen anew.

    The factorisation fails at such a sample, but least squares tell what the mechanism does.
    """
    if (
        "pivot" not in columns
        or flow.equations is not None
        or columns["pivot"].min(initial=1.0) > LEAST_PIVOT
    ):
        return np.empty(0)
    flagged = np.flatnonzero(~(columns["pivot"] > LEAST_PIVOT) & np.isfinite(motion.x).all(axis=1))
    if flagged.size and not flow.inputs.shape[0]:
        from deltac.simulation.constraints.singular import SingularMotion

        again = SingularMotion(flow, p)
        for k in flagged:
            for name, value in again.observed(float(motion.t[k]), motion.x[k]).items():
                columns[name][k] = value
    return motion.t[flagged]


def _near(columns: dict[str, Array], motion: Motion, provenance: Provenance) -> str:
    """What a run whose steps pass singular configurations unguarded has to know, or an empty text."""
    if "pivot" not in columns:
        return ""
    nearest = int(np.argmin(columns["pivot"]))
    if columns["pivot"][nearest] > NEARLY_DEPENDENT:
        return ""
    return (
        f"the constraints are nearly dependent at t = {motion.t[nearest]:.9g} s, where {provenance.solver} "
        "may change to another branch of the motion; compare with a fixed-step solver"
    )


def _where(times: Array) -> str:
    """In words, when a run was at a singular configuration."""
    shown = ", ".join(f"{t:.9g}" for t in times[:5])
    return f"the constraints are dependent at t = {shown}{' s, …' if len(times) > 5 else ' s'}"


def with_occurrences(
    flow: StateFlow, observe: Kernel, happened: Sequence[Happened], run: Trajectory
) -> Trajectory:
    """The trajectory with what happened, as far as its rows go; `flow` may have its branches held."""
    events = [e for e in happened if run.t[0] <= e.t <= run.t[-1]]
    if not events:
        return run
    occurrences = []
    t, inputs = np.array([e.t for e in events]), np.array([e.inputs for e in events])
    for state, sides in (("before", "p_before"), ("after", "p_after")):
        x, p = (np.array([getattr(e, name) for e in events]) for name in (state, sides))
        values = observed(flow, observe, Motion(t, x, inputs), p)
        shaped = {name: value.reshape(len(events), -1) for name, value in values.items()}
        occurrences.append((shaped, logged_forces(flow, shaped, inputs)))
    (before, forces_before), (after, forces_after) = occurrences
    record = tuple(
        Occurrence(
            t=e.t,
            names=e.names,
            q=before["q"][k],
            u_before=before["u"][k],
            u_after=after["u"][k],
            udot_before=before["udot"][k],
            udot_after=after["udot"][k],
            forces_before={name: force[k] for name, force in forces_before.items()},
            forces_after={name: force[k] for name, force in forces_after.items()},
            impulses=e.impulses,
        )
        for k, e in enumerate(events)
    )
    return replace(run, events=record)
