"""Recording OpenSim: states with their accelerations, and every force of the model by itself.

OpenSim's inverse dynamics takes the model's own forces into account. So with all of them switched off it
gives their sum, and with one switched on the sum without it, whatever element that is, a muscle around
wrapping surfaces too. What is left of the sum is of constraints.

OpenSim brings a CasADi of its own that cannot be in one process with another one. So nothing here loads it:
record, write the trajectory, and audit the file in another process.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from deltac import rotations
from deltac.arrays import SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.errors import ModelError, PackageError
from deltac.models import ModelLike, load_model
from deltac.recorders.recorder import (
    INSTANT,
    OCCASIONAL,
    Columns,
    Forces,
    JointColumns,
    Recorder,
)
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from opensim import TimeSeriesTable

Model: TypeAlias = Any
State: TypeAlias = Any
Joint: TypeAlias = Any

MOTIONS = {1: "revolute", 2: "prismatic"}
"""OpenSim's type of a joint's only coordinate -> the kind of the joint."""

FREE_JOINT = "FreeJoint"

FORCE_KINDS = {
    "CoordinateLimitForce": "limit",
    "PrescribedForce": "applied",
    "ExternalForce": "applied",
    "HuntCrossleyForce": "contact",
    "ElasticFoundationForce": "contact",
    "SmoothSphereHalfSpaceForce": "contact",
    "ExponentialContactForce": "contact",
    "MeyerFregly2016Force": "contact",
}
"""OpenSim's class of a force that is no actuator -> the kind of its channel; others are springs."""


class OpensimRecorder(Recorder):
    """Record a simulation of OpenSim: call `sample` with its states, or `states` with a table of them.

    OpenSim's states hold everything that its forces depend on, so a run is recorded after it has ended. Each
    force of the force set is determined by inverse dynamics with all others switched off. Channels:
    ``actuator <name>`` (muscles too), ``contact <name>``, ``limit <name>`` (coordinate limit forces),
    ``applied <name>`` (prescribed and external forces), ``spring <name>`` (all other elements of the force
    set), and ``constraint all``, what constraints add. Joints of one angle or one length, and FreeJoint to
    ground, are recorded; others are refused.

    OpenSim's package contains a CasADi of its own, which cannot be loaded together with another one: record
    in one process, and audit in another.

    >>> with record_opensim(opensim_model) as rec:  # doctest: +SKIP
    ...     manager.integrate(2.0)
    ...     rec.states(manager.getStatesTable())  # every step that its integrator made
    >>> rec.trajectory().write("run.parquet")  # doctest: +SKIP

    Args:
        opensim_model: the opensim.Model, after initSystem.
        model: the mechanism, for the order of its joints; by default the order is OpenSim's.
        names: OpenSim's name of a joint, or of its only coordinate -> the mechanism's, where they differ.

    Raises:
        InputError: OpenSim is missing or cannot be loaded, a joint is of a kind that is not known here, or
            the mechanism has other joints.
    """

    def __init__(
        self,
        opensim_model: Model,
        model: ModelLike | None = None,
        *,
        names: Mapping[str, str] | None = None,
    ) -> None:
        self._opensim = _opensim()
        self._model = opensim_model
        state = opensim_model.getWorkingState()
        own = set(names or {})
        if model is not None:
            own |= {joint.name for joint in load_model(model).mechanism.joints}
        self._joints: dict[str, Joint] = {}
        columns, place = [], 0
        for joint in _each(opensim_model.getJointSet()):
            if not joint.numCoordinates():
                continue
            kind, name = self._kind(joint), joint.getName()
            if joint.numCoordinates() == 1 and joint.get_coordinates(0).getName() in own - {name}:
                name = joint.get_coordinates(0).getName()
            at = slice(place, place + joint.numCoordinates())
            columns.append(JointColumns(name, kind, at, at))
            self._joints[(names or {}).get(name, name)] = joint
            place = at.stop
        self._columns = Columns.of(columns, model, names)
        super().__init__(self._columns.coordinates, self._columns.speeds)
        self._inverse = self._opensim.InverseDynamicsSolver(opensim_model)
        self._forces = [f for f in _each(opensim_model.getForceSet()) if f.appliesForce(state)]
        self._places = {name: self._speeds_of(joint, state) for name, joint in self._joints.items()}

    def sample(self, state: State) -> None:
        """Record a state: what `manager.integrate` returns, or one of a StatesTrajectory."""
        opensim, model = self._opensim, self._model
        model.realizeAcceleration(state)
        udot, copy = state.getUDot(), opensim.State(state)
        for force in self._forces:
            force.setAppliesForce(copy, False)

        def lacking(rates: Any) -> Array:
            """M u̇ + c less gravity and the forces that are on."""
            return np.array(self._inverse.solve(copy, rates).to_numpy())

        rest = total = lacking(udot)
        weight = lacking(opensim.Vector(copy.getNU(), 0.0))
        forces: Forces = {}
        for force in self._forces:
            force.setAppliesForce(copy, True)
            forces[self._channel(force)] = total - lacking(udot)
            force.setAppliesForce(copy, False)
            rest = rest - forces[self._channel(force)]
        size = sum(max_norm(f) for f in (total, weight, *forces.values()))
        if max_norm(rest) > SAME * size:
            forces["constraint all"] = rest
        rows: list[tuple[Array, Array, Array]] = []
        turns = []
        for column in self._columns.joints:
            joint = self._joints[column.name]
            if column.kind == "free":
                rows.append(_motion(joint, state))
                turns.append(np.linalg.inv(self._jacobian(column.name, copy)).T)
            else:
                rows.append(_value(joint.get_coordinates(0), state))
                turns.append(np.eye(1))
        ours = {
            name: np.concatenate(
                [T @ f[self._places[c.name]] for T, c in zip(turns, self._columns.joints)]
            )
            for name, f in forces.items()
        }
        q, u, udot = (np.concatenate(parts) for parts in zip(*rows))
        self._instant(state.getTime(), q, u, udot, ours)

    def states(self, table: TimeSeriesTable) -> None:
        """Record all states of a table; `manager.getStatesTable()` has the integrator's own steps."""
        trajectory = self._opensim.StatesTrajectory.createFromStatesTable(self._model, table)
        for k in range(trajectory.getSize()):
            self.sample(trajectory.get(k))

    def trajectory(self, solver: str | None = None, step: float | None = None) -> Trajectory:
        """The samples so far, with what the caller says of the integrator and of its step."""
        return self._trajectory(
            Provenance(
                simulator=f"OpenSim {self._opensim.GetVersion().partition('-')[0]}",
                solver=solver,
                step=step,
                model=self._model.getName() or None,
                stage=INSTANT,
                looked_for=OCCASIONAL,
                acted=self._acted,
            )
        )

    # --- what OpenSim says -----------------------------------------------------------------------

    def _kind(self, joint: Joint) -> str:
        if joint.getConcreteClassName() == FREE_JOINT:
            if joint.getParentFrame().findBaseFrame().getName() != "ground":
                raise ModelError(
                    f"joint {joint.getName()!r} is a FreeJoint between two bodies; known: to ground"
                )
            return "free"
        motion = joint.get_coordinates(0).getMotionType() if joint.numCoordinates() == 1 else 0
        if motion not in MOTIONS:
            raise ModelError(
                f"joint {joint.getName()!r} is a {joint.getConcreteClassName()} of "
                f"{joint.numCoordinates()} coordinates; known: one angle or one length, and FreeJoint"
            )
        return MOTIONS[motion]

    def _channel(self, force: Any) -> str:
        acts = self._opensim.Actuator.safeDownCast(force) is not None
        kind = "actuator" if acts else FORCE_KINDS.get(force.getConcreteClassName(), "spring")
        return f"{kind} {force.getName()}"

    def _speeds_of(self, joint: Joint, state: State) -> list[int]:
        """Where the speeds of a joint are in Simbody's u: those that change with its coordinates' speeds."""
        copy = self._opensim.State(state)
        places = []
        for k in range(joint.numCoordinates()):
            copy.setU(self._opensim.Vector(copy.getNU(), 0.0))
            joint.get_coordinates(k).setSpeedValue(copy, 1.0)
            places.append(int(np.flatnonzero(copy.getU().to_numpy())[0]))
        return places

    def _jacobian(self, name: str, state: State) -> Array:
        """A free body's speeds by those of Simbody's joint (6, 6); the speeds of the state are lost."""
        columns = []
        for place in self._places[name]:
            u = self._opensim.Vector(state.getNU(), 0.0)
            u.set(place, 1.0)
            state.setU(u)
            self._model.realizeAcceleration(state)
            columns.append(_motion(self._joints[name], state)[1])
        return np.column_stack(columns)


record_opensim = checked(OpensimRecorder, name="record_opensim")


def _value(coordinate: Any, state: State) -> tuple[Array, Array, Array]:
    """A coordinate, its speed and its acceleration."""
    q, u = coordinate.getValue(state), coordinate.getSpeedValue(state)
    return np.array([q]), np.array([u]), np.array([coordinate.getAccelerationValue(state)])


def _motion(joint: Joint, state: State) -> tuple[Array, Array, Array]:
    """The pose, speeds and accelerations of a free body, in a mechanism's conventions."""
    frame = joint.getChildFrame()
    place = frame.getTransformInGround(state)
    R = np.array([[place.R().get(i, j) for j in range(3)] for i in range(3)])
    rates = [
        np.concatenate([pair.get(1).to_numpy(), R.T @ pair.get(0).to_numpy()])
        for pair in (frame.getVelocityInGround(state), frame.getAccelerationInGround(state))
    ]
    return np.concatenate([place.p().to_numpy(), rotations.quaternion(R)]), rates[0], rates[1]


def _each(of_opensim: Any) -> list[Any]:
    """The elements of one of OpenSim's sets."""
    return [of_opensim.get(k) for k in range(of_opensim.getSize())]


def _opensim() -> Any:
    try:
        import opensim
    except ImportError as error:
        if "casadi" in sys.modules:
            raise PackageError(
                "OpenSim cannot be loaded beside CasADi, of which it brings a version of its own: record in "
                "a process that calls nothing else of deltac, write the trajectory (run.write), and audit "
                "the file in another one"
            ) from error
        raise PackageError(
            f"recording OpenSim runs needs the Python module 'opensim', which is not installed ({error}); "
            "run: pip install opensim"
        ) from None
    return opensim
