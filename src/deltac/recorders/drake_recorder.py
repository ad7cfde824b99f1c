"""Recording Drake: a MultibodyPlant, continuous or discrete, through the simulator's monitor function.

In either mode the sum of all forces is known without asking for each: M v̇ + C v, with the plant's own v̇.
What gravity, force elements, joint dampers, actuators and contacts leave of it is recorded too, under the
name of what it can only be. So the channels add up, whatever the plant contains.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from deltac import rotations
from deltac.arrays import ENDLESS, SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.errors import ModelError, RecordingError
from deltac.models import ModelLike
from deltac.recorders.monitor import Monitor
from deltac.recorders.recorder import (
    ENGINE,
    HELD_FORCES,
    INSTANT,
    OCCASIONAL,
    Columns,
    Forces,
    JointColumns,
    Recorder,
    simulator,
)
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator

Plant: TypeAlias = Any
Context: TypeAlias = Any

DRAKE_JOINTS = {
    "revolute": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "quaternion_floating": "free",
}
"""Drake's kind of a joint -> ours. Its Euler angles of ball and floating joints have no counterpart."""

DRAKE_ORDERS = {
    "ExplicitEuler": 1,
    "SemiExplicitEuler": 1,
    "ImplicitEuler": 1,
    "VelocityImplicitEuler": 1,
    "RungeKutta2": 2,
    "RungeKutta3": 3,
    "BogackiShampine3": 3,
    "Radau": 3,
    "RungeKutta5": 5,
}
"""Order of Drake's integrators in the state."""

GAUSS = np.polynomial.legendre.leggauss(3)
"""Nodes in (−1, 1) and weights of Gauss's quadrature."""

WORK_ACCURACY = SAME
"""Works of a part of a step are found when halving it changes them by less, relative to all work so far."""

LEAST_PART = 2.0**-20
"""Parts of a step that are smaller are not halved: there is a jump in them."""


class DrakeRecorder(Recorder):
    """Record a MultibodyPlant, after every step of the simulator.

    A continuous plant gives states, v̇ and forces of the same instant. For a discrete plant (TAMSI, SAP,
    similar, lagged) a row is the state before a step, with the forces held over it and
    `udot` = (u_{k+1} − u_k)/h: balance it with ``work="discrete"``. Floating bases are converted; joints
    with Euler angles are refused. The channels add up to M v̇ + C v − τ_g, by the plant's own inverse
    dynamics:

    - ``actuator <actuator>``: its column of the actuation matrix times the net actuation, limits and PD
      controllers included
    - ``damper <joint>``, ``spring elements``: joint damping; all other force elements together
    - ``contact all``: generalized contact forces
    - ``limit <joint>``: the remainder of a discrete step on joints with position limits
    - ``applied external``: the port of applied generalized forces, and the remainder of other input ports
    - ``constraint all``: the remainder of couplers, balls and welds
    - ``correction implicit``: dampers evaluated at the end of the step (SAP and similar)
    - ``correction solver``: the residual of the contact solver, up to 1e-4 of the forces

    >>> with record_drake(simulator, plant, mechanism) as rec:  # doctest: +SKIP
    ...     simulator.AdvanceTo(2.0)
    >>> run = rec.trajectory()  # doctest: +SKIP

    Args:
        simulation: the pydrake Simulator. Its monitor function, if any, is replaced until the end.
        plant: the MultibodyPlant, finalised; alone or part of the diagram.
        model: the mechanism, for the order of its joints; by default the order is the plant's.
        names: Drake's name of a joint -> the mechanism's, where they differ; a floating base's joint is
            called after its body.
        monitor: a monitor that takes the rows, which are then not kept.

    Raises:
        InputError: Drake is missing, a joint is of a kind that is not known here, or the mechanism has other
            joints.
    """

    def __init__(
        self,
        simulation: Simulator,
        plant: Plant,
        model: ModelLike | None = None,
        *,
        names: Mapping[str, str] | None = None,
        monitor: Monitor | None = None,
    ) -> None:
        simulator("pydrake", "drake")
        from pydrake.multibody.tree import MultibodyForces

        self._simulator, self._plant = simulation, plant
        self._here = plant.CreateDefaultContext()
        self._forces, self._none = MultibodyForces(plant), MultibodyForces(plant)
        self._none.SetZero()
        joints, self._dampers, self._limited = [], [], np.zeros(plant.num_velocities(), dtype=bool)
        for index in plant.GetJointIndices():
            joint = plant.get_joint(index)
            if not joint.num_velocities():
                continue
            if joint.type_name() not in DRAKE_JOINTS:
                raise ModelError(
                    f"joint {joint.name()!r} of the plant is a {joint.type_name()} joint; known: "
                    f"{', '.join(DRAKE_JOINTS)}"
                )
            q = slice(joint.position_start(), joint.position_start() + joint.num_positions())
            v = slice(joint.velocity_start(), joint.velocity_start() + joint.num_velocities())
            joints.append(JointColumns(joint.name(), DRAKE_JOINTS[joint.type_name()], q, v))
            self._dampers.append((joint, v))
            if joint.num_positions() == joint.num_velocities():
                bounds = np.array([joint.position_lower_limits(), joint.position_upper_limits()])
                self._limited[v] = np.isfinite(bounds).any(axis=0)
        self._names = names or {}
        self._columns = Columns.of(joints, model if monitor is None else monitor.mechanism, names)
        self._actuation = np.array(plant.MakeActuationMatrix())
        self._actuators = [
            (plant.get_joint_actuator(index).name(), plant.get_joint_actuator(index).input_start())
            for index in plant.GetJointActuatorIndices()
        ]
        # TAMSI takes dampers at the start of a step, the convex solvers at its end.
        self._implicit = "Tamsi" not in str(plant.get_discrete_contact_approximation())
        self._period = float(plant.time_step()) or None
        self._before: tuple[float, Array, Array] | None = None
        self._state, self._exchanged = np.zeros(0), 0.0
        self._external = np.zeros(plant.num_velocities())
        system = simulation.get_system()
        links = system.connection_map() if hasattr(system, "connection_map") else {}
        port = plant.get_applied_generalized_force_input_port().get_index()
        self._connected = any(to is plant and index == port for to, index in links)
        self._live: Forces = {}
        super().__init__(self._columns.coordinates, self._columns.speeds, monitor)

    def __enter__(self) -> DrakeRecorder:
        self._simulator.set_monitor(self._after_step)
        context = self._simulator.get_context()
        # Initialize() calls the monitor; a simulator that was initialised before will not.
        self._after_step(context)
        return self

    def __exit__(self, *_: object) -> None:
        """Take the monitor function away; the trajectory stays available."""
        self._simulator.clear_monitor()

    def trajectory(self) -> Trajectory:
        """The rows so far."""
        plant, discrete = self._plant, self._period is not None
        if discrete:
            solver = str(plant.get_discrete_contact_approximation()).rpartition(".k")[2].lower()
        else:
            solver = type(self._simulator.get_integrator()).__name__.partition("[")[0]
        integrator = self._simulator.get_integrator()
        fixed = not discrete and integrator.get_fixed_step_mode()
        return self._trajectory(
            Provenance(
                simulator=f"Drake {version('drake')}",
                solver=solver,
                step=self._period or (integrator.get_maximum_step_size() if fixed else None),
                order=1 if discrete else DRAKE_ORDERS.get(solver.removesuffix("Integrator")),
                tolerance=None if discrete or fixed else integrator.get_target_accuracy(),
                stage=HELD_FORCES if discrete else INSTANT,
                held=self._builder.channels if discrete else (),
                inputs="held" if discrete else "",
                looked_for=OCCASIONAL,
                acted=self._acted,
            )
        )

    # --- rows ------------------------------------------------------------------------------------

    def _after_step(self, root: Context) -> None:
        """What the simulator calls after Initialize and after each of its steps."""
        context = self._plant.GetMyContextFromRoot(root)
        t = float(context.get_time())
        if self._period is None:
            if self._before is not None and t <= self._before[0]:
                return  # initialised anew, or a pending event: the same row
            self._continuous(t, root)
        else:
            self._discrete(t, context)

    def _continuous(self, t: float, root: Context) -> None:
        state = np.array(root.get_continuous_state_vector().CopyToVector())
        if self._before is not None and self.monitor is None:
            self._stages((self._before[0], self._state), (t, state), root)
        q, v, vdot, forces = self._present(root)
        self._before, self._state = (t, q, v), state
        ours = {name: self._turned(f, q) for name, f in forces.items()}
        self._instant(t, *self._converted(q, v), self._turned(vdot, q), ours)

    def _stages(self, start: tuple[float, Array], end: tuple[float, Array], root: Context) -> None:
        """Works of the last step, along the cubic of its states and their rates, Drake's own dense output.

        Gauss's quadrature in parts of the step, smaller ones where contacts open or close. Whatever is
        discrete in the diagram has been kept since the step began.
        """
        inner = root.Clone()

        def rates(t: float, state: Array) -> Array:
            inner.SetTime(t)
            inner.SetContinuousState(state)
            return np.array(self._simulator.get_system().EvalTimeDerivatives(inner).CopyToVector())

        (t0, y0), (t1, y1) = start, end
        h, dy = t1 - t0, y1 - y0
        a, b = h * rates(t0, y0) - dy, h * rates(t1, y1) - dy

        def works(first: float, last: float) -> dict[str, float]:
            """Between two parts of the step."""
            sums: dict[str, float] = {}
            for node, weight in zip(*GAUSS):
                x = first + 0.5 * (1.0 + node) * (last - first)
                inner.SetTime(t0 + x * h)
                inner.SetContinuousState(y0 + x * dy + x * (1 - x) * ((1 - x) * a - x * b))
                _, v, _, forces = self._present(inner)
                for name, force in forces.items():
                    work = 0.5 * weight * (last - first) * h * float(force @ v)
                    sums[name] = sums.get(name, 0.0) + work
            return sums

        parts, count = [(0.0, 1.0, works(0.0, 1.0))], 0
        while parts:
            first, last, whole = parts.pop()
            count += 1
            middle = 0.5 * (first + last)
            halves = works(first, middle), works(middle, last)
            names = whole.keys() | halves[0].keys() | halves[1].keys()
            finer = {n: halves[0].get(n, 0.0) + halves[1].get(n, 0.0) for n in names}
            self._exchanged += sum(map(abs, finer.values())) if last - first == 1.0 else 0.0
            change = max((abs(finer[n] - whole.get(n, 0.0)) for n in names), default=0.0)
            fine = change <= WORK_ACCURACY * self._exchanged or last - first < LEAST_PART
            if fine or count > ENDLESS:
                self._builder.work(finer)
            else:
                parts += [(first, middle, halves[0]), (middle, last, halves[1])]

    def _present(self, root: Context) -> tuple[Array, Array, Array, Forces]:
        """q, v, v̇ and all forces of a continuous plant, in Drake's conventions."""
        plant, context = self._plant, self._plant.GetMyContextFromRoot(root)
        q, v = np.array(plant.GetPositions(context)), np.array(plant.GetVelocities(context))
        vdot = np.array(plant.get_generalized_acceleration_output_port().Eval(context))
        forces = self._outputs(context)
        plant.SetPositionsAndVelocities(self._here, np.concatenate([q, v]))
        applied, rest = self._known(vdot, v, forces)
        if max_norm(rest) > SAME * applied:
            forces["applied external"] = rest
        return q, v, vdot, forces

    def _discrete(self, t: float, context: Context) -> None:
        plant, h = self._plant, self._period
        assert h is not None
        q, v = np.array(plant.GetPositions(context)), np.array(plant.GetVelocities(context))
        external = self._applied(context)
        if self._before is not None:
            gone = (t - self._before[0]) / h
            if gone < 1.0 - 1e-6:
                return  # a step of something else in the diagram
            if gone > 1.0 + 1e-6:
                raise RecordingError(f"Drake's plant made {gone:g} steps at once at t = {t:g} s")
            forces = self._outputs(context) if plant.has_sampled_output_ports() else self._live
            before, q0, v0 = self._before[0], self._before[1], self._before[2]
            plant.SetPositionsAndVelocities(self._here, np.concatenate([q0, v0]))
            forces = dict(forces)
            if external.any():
                forces["applied external"] = external
            applied, rest = self._known((v - v0) / h, v0, forces)
            forces |= self._of_the_step(rest, v - v0, applied)
            ours = {name: self._turned(f, q0) for name, f in forces.items()}
            self._step((before, *self._converted(q0, v0)), (t, *self._converted(q, v)), ours)
        if not plant.has_sampled_output_ports():
            self._live = self._outputs(context)
        self._before = (t, q, v)

    def _known(self, vdot: Array, v: Array, forces: Forces) -> tuple[float, Array]:
        """Add springs and dampers; the size of the forces and what is left of their sum, M v̇ + C v."""
        plant, context = self._plant, self._here
        total = np.array(plant.CalcInverseDynamics(context, vdot, self._none))
        gravity = np.array(plant.CalcGravityGeneralizedForces(context))
        plant.CalcForceElementsContribution(context, self._forces)
        elements = np.array(plant.CalcGeneralizedForces(context, self._forces)) - gravity
        for joint, place in self._dampers:
            c = np.array(joint.GetDampingVector(context))
            if c.any():
                damping = np.zeros_like(v)
                damping[place] = -c * v[place]
                forces[f"damper {self._names.get(joint.name(), joint.name())}"] = damping
                elements = elements - damping
        size = max_norm(gravity) + max_norm(total)
        size += max((max_norm(f) for f in forces.values()), default=0.0)
        rest = total - gravity - np.sum([np.zeros_like(v), elements, *forces.values()], axis=0)
        if max_norm(elements) > SAME * size:
            forces["spring elements"] = elements
        return float(size), rest

    def _of_the_step(self, rest: Array, change: Array, size: float) -> Forces:
        """The residual force of a discrete step, sorted: dampers taken at its end, joint limits, the rest."""
        least = SAME * size
        implicit = np.zeros_like(rest)
        for joint, place in self._dampers if self._implicit else ():
            implicit[place] -= np.array(joint.GetDampingVector(self._here)) * change[place]
        forces = self._columns.of_limits(rest - implicit, self._limited, least)
        residual = rest - implicit - sum(forces.values())
        if max_norm(implicit) > least:
            forces["correction implicit"] = implicit
        largest = max_norm(residual)
        if self._plant.num_constraints() and largest > least:
            forces["constraint all"] = residual
        elif largest > ENGINE * size:
            forces["applied external"] = residual
        elif largest > least:
            forces["correction solver"] = residual
        return forces

    def _applied(self, context: Context) -> Array:
        """Of the step that ends now, what its port of generalized forces applied (nv,).

        A fixed value holds until another is set, so it is read now; a connected port was read by the step
        when it began.
        """
        port = self._plant.get_applied_generalized_force_input_port()
        before = self._external
        if port.HasValue(context):
            self._external = np.array(port.Eval(context))
        return before if self._connected else self._external

    def _outputs(self, context: Context) -> Forces:
        """Actuators and contacts, as the plant's output ports have them."""
        from pydrake.multibody.tree import ModelInstanceIndex

        plant, forces = self._plant, Forces()
        if self._actuators:
            values = np.array(plant.get_net_actuation_output_port().Eval(context))
            for name, place in self._actuators:
                forces[f"actuator {name}"] = self._actuation[:, place] * values[place]
        if not plant.geometry_source_is_registered() or not plant.num_collision_geometries():
            return forces
        total = np.zeros(plant.num_velocities())
        for k in range(plant.num_model_instances()):
            index = ModelInstanceIndex(k)
            if plant.num_velocities(index):
                port = plant.get_generalized_contact_forces_output_port(index)
                plant.SetVelocitiesInArray(index, np.array(port.Eval(context)), total)
        return {**forces, "contact all": total}

    # --- conventions: floating joints have the quaternion and the angular velocity first ------------

    def _converted(self, q: Array, v: Array) -> tuple[Array, Array]:
        placed = self._columns.joined(
            lambda joint: np.roll(q[joint.q], -4 if joint.kind == "free" else 0)
        )
        return placed, self._turned(v, q)

    def _turned(self, values: Array, q: Array) -> Array:
        """Velocities, accelerations or forces; angular components of free joints in the body's frame.

        d/dt (Rᵀω) = Rᵀω̇, since ω × ω = 0; and turning is orthogonal, so that forces turn alike.
        """

        def in_body(own: Array, joint: JointColumns) -> Array:
            return np.concatenate([own[3:], rotations.matrices(q[joint.q][:4]).T @ own[:3]])

        return self._columns.turned(values, in_body)


record_drake = checked(DrakeRecorder, name="record_drake")
