"""Recording Exudyn: a kinematic tree's joint coordinates after each step, by the recorder protocol."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.errors import ModelError
from deltac.mechanism import ChannelName
from deltac.recorders.monitor import Monitor
from deltac.recorders.recorder import INSTANT, Recorder, simulator
from deltac.trajectories import Provenance, Trajectory

System: TypeAlias = Any
Force: TypeAlias = Callable[[float, Array, Array], Sequence[float] | Array]


class ExudynRecorder(Recorder):
    """Record the coordinates of an Exudyn node through the system's post-step function.

    Kinematic trees are recorded. With an implicit solver, set `accelerations` and name the objects whose
    multipliers are to be logged.

    >>> with record_exudyn(mbs, node, ("shoulder", "elbow")) as rec:  # doctest: +SKIP
    ...     mbs.SolveDynamic(settings)
    >>> run = rec.trajectory()  # doctest: +SKIP

    Args:
        mbs: the assembled Exudyn system. Its own post-step function, if any, is replaced.
        node: number of the node that holds the coordinates (of an ObjectKinematicTree: one coordinate
            a joint, revolute in rad or prismatic in m; SI units are the caller's duty).
        joints: names of the joints in the order of the tree; the mechanism's must be the same.
        forces: channel -> generalized force of (t, q, u), of what the mechanism does not know: Exudyn
            does not report the forces in a tree by their source.
        accelerations: whether the node's accelerations belong to the same instant as its coordinates. They do
            with the implicit solvers (generalized-α, trapezoidal). The explicit Runge–Kutta solvers have none
            in the first row, and velocity Verlet has those of another instant. If False, the accelerations
            are derived from the speeds.
        constraints: name -> number of an Exudyn object with algebraic equations (a joint, a coordinate
            constraint): its forces −C_qᵀλ on the tree become the channel ``constraint <name>``. Only the
            implicit solvers have multipliers. Exudyn computes C_q row by row when `trajectory` is called.
        monitor: a monitor that takes the rows, which are then not kept; without forces of constraints.

    Raises:
        InputError: Exudyn is missing, the node does not have a coordinate for each joint, or an object has no
            algebraic equations.
    """

    def __init__(
        self,
        mbs: System,
        node: int,
        joints: Iterable[str],
        *,
        forces: Mapping[str, Force] | None = None,
        accelerations: bool = False,
        constraints: Mapping[str, int] | None = None,
        monitor: Monitor | None = None,
    ) -> None:
        self._exudyn = simulator("exudyn", "exudyn")
        self._mbs, self._node = mbs, node
        joints, constraints = tuple(joints), constraints or {}
        self._forces, self._accelerations = dict(forces or {}), accelerations
        count = np.size(self._output("CoordinatesTotal"))
        if count != len(joints):
            raise ModelError(
                f"node {node} of the Exudyn system has {count} coordinates, for {len(joints)} joints: "
                f"{', '.join(joints)}"
            )
        self._columns = list(mbs.systemData.GetNodeLTGODE2(node))
        self._rows_of = {
            ChannelName("constraint", name): list(mbs.systemData.GetObjectLTGAE(number))
            for name, number in constraints.items()
        }
        for name, rows in self._rows_of.items():
            if not rows:
                raise ModelError(
                    f"{name}: object {constraints[name.element]} of the Exudyn system has no algebraic "
                    "equations"
                )
        self._multipliers: list[tuple[Array, Array]] = []
        super().__init__(joints, joints, monitor)

    def __enter__(self) -> ExudynRecorder:
        def after_step(mbs: System, t: float) -> bool:
            self.sample(t)
            return True

        self._mbs.SetPostStepUserFunction(after_step)
        return self

    def __exit__(self, *_: object) -> None:
        """Take the post-step function away; the trajectory stays available."""
        self._mbs.SetPostStepUserFunction(0)

    def sample(self, t: float) -> None:
        """Record the present state; for a post-step function of your own."""
        q, u = self._output("CoordinatesTotal"), self._output("Coordinates_t")
        udot = self._output("Coordinates_tt") if self._accelerations else None
        forces = {channel: force(t, q, u) for channel, force in self._forces.items()}
        self._instant(t, q, u, udot, {n: np.asarray(f, dtype=float) for n, f in forces.items()})
        if self._rows_of:
            data = self._mbs.systemData
            self._multipliers.append(
                (np.array(data.GetODE2Coordinates()), np.array(data.GetAECoordinates()))
            )

    def trajectory(
        self,
        solver: str | None = None,
        step: float | None = None,
        model: str | None = None,
        order: int | None = None,
        held: Sequence[str] | None = None,
    ) -> Trajectory:
        """The samples so far, with what the caller says of the solver: name, step, order, what it held.

        `held` are channels whose force at a row is that of the whole step from it.
        """
        version = getattr(self._exudyn, "__version__", "")
        provenance = Provenance(
            simulator=f"Exudyn {version}".strip(),
            solver=solver,
            step=step,
            order=order,
            model=model,
            stage=INSTANT,
            held=None if held is None else tuple(held),
        )
        run = self._trajectory(provenance)
        return replace(run, forces={**run.forces, **self._constraint_forces()})

    def _constraint_forces(self) -> dict[ChannelName, Array]:
        """−C_qᵀλ of each constraint on the node's coordinates (T, n)."""
        if not self._rows_of:
            return {}
        data = self._mbs.systemData
        present = np.array(data.GetODE2Coordinates())
        forces: dict[ChannelName, list[Array]] = {name: [] for name in self._rows_of}
        try:
            for q, multipliers in self._multipliers:
                data.SetODE2Coordinates(q)
                # Its fourth result is the block of C_qᵀ, coordinates by equations.
                C = self._mbs.ComputeLinearizedSystem(returnConstraintJacobian=True)[3]
                for name, rows in self._rows_of.items():
                    forces[name].append(-C[np.ix_(self._columns, rows)] @ multipliers[rows])
        finally:
            data.SetODE2Coordinates(present)
        return {name: np.array(rows) for name, rows in forces.items()}

    def _output(self, name: str) -> Array:
        kind = getattr(self._exudyn.OutputVariableType, name)
        return np.atleast_1d(np.array(self._mbs.GetNodeOutput(self._node, kind), dtype=float))


record_exudyn = checked(ExudynRecorder, name="record_exudyn")
