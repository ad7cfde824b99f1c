"""The same motion of a model's file in any simulator, recorded step by step.

An `Experiment` is what all of them share: the file, where the motion starts, and torques at its joints.
MuJoCo runs a file with its contacts, motors and passive forces. The others read URDF without shapes, so
nothing touches there: joints, inertias, dampers, and what drives the joints.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics import crba, trace
from deltac.errors import ModelError, UnknownName, closest
from deltac.forces import joint_torque
from deltac.importers.urdf import read_urdf
from deltac.mechanism import State
from deltac.models import Model, load_model
from deltac.recorders.drake_recorder import record_drake
from deltac.recorders.exudyn_recorder import record_exudyn
from deltac.recorders.mujoco_recorder import compiled_model, run_mujoco
from deltac.recorders.pinocchio_recorder import record_pinocchio
from deltac.recorders.pybullet_recorder import record_pybullet
from deltac.recorders.recorder import simulator
from deltac.simulation import Controller
from deltac.trajectories import Trajectory
from deltac.verbs import simulate

GRAVITY = 9.81
"""What URDF files fall with in every simulator, m/s²: they name none."""

SPEED = 0.3
"""Speeds at the start, rad/s or m/s, with alternating signs: a model in equilibrium would not move."""

SWAY = (2.0, 5.0)
"""Of driven joints: frequency, Hz, and the acceleration, rad/s² or m/s², by one torque alone."""

HOLD = (1.5, 0.7)
"""Of held joints: frequency, Hz, and damping ratio of one that is held alone."""

DIVERGED = 1e6
"""Coordinates and speeds beyond which a run blew up, in SI units."""

MOTIONS = ("fall", "sway", "hold")
"""No motor acts; small controls that are functions of time; springs and dampers hold the joints."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A motion that every simulator can make.

    path        of the model's file, MJCF or URDF
    model       the file as a mechanism
    motion      one of `MOTIONS`
    duration    s
    """

    path: Path
    model: Model
    motion: str
    duration: float

    @staticmethod
    def of(path: Path, motion: str, duration: float) -> Experiment:
        """Read the file; InputError where it cannot be read, or nothing in it moves."""
        if motion not in MOTIONS:
            raise UnknownName(f"unknown motion {motion!r}{closest(motion, MOTIONS)}")
        model = load_model(path)
        if not model.mechanism.speeds.names:
            raise ModelError(f"{path.name}: nothing moves: the model has no joint")
        return Experiment(path, model, motion, duration)

    @property
    def is_urdf(self) -> bool:
        """Whether the file is URDF, which more simulators than MuJoCo read."""
        return self.path.suffix.lower() == ".urdf"

    @property
    def own_step(self) -> float | None:
        """The step that the file names, s; URDF names none."""
        return None if self.is_urdf else float(compiled_model(self.path).opt.timestep)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Joints with one speed: those that are driven."""
        joints = self.model.mechanism.joints
        return tuple(j.name for j in joints if len(j.speeds) == 1 and not j.motion)

    @cached_property
    def places(self) -> tuple[Array, Array]:
        """Where they stand in q and u."""
        mechanism = self.model.mechanism
        q, u = (
            np.array([list(names).index(joint) for joint in self.joints], dtype=int)
            for names in (mechanism.coordinates.names, mechanism.speeds.names)
        )
        return q, u

    @cached_property
    def start(self) -> State:
        """The model's own start, its joints at speeds of `SPEED`, unless they are coupled."""
        start = self.model.first or self.model.mechanism.state()
        u = np.array(start.u)
        if self.model.mechanism.constraints:
            return start
        u[self.places[1]] += SPEED * np.cos(np.pi * np.arange(len(self.joints)))
        return State(start.t, start.q, u)

    @cached_property
    def inertia(self) -> Array:
        """Of each driven joint while the others give way, at the start: 1/(M⁻¹)ₖₖ, kg·m² or kg."""
        system = trace(self.model.mechanism)
        mass = ca.Function("M", [system.q], [ca.densify(crba(system))])
        inverse: Array = np.linalg.inv(np.asarray(mass(self.start.q)))
        return np.asarray(1.0 / np.diag(inverse)[self.places[1]])

    def torque(self, t: float, q: Array, u: Array) -> Array:
        """Torques, N·m or N, of the driven joints at t (s), of their own q and u."""
        phase = np.arange(len(self.joints))
        if self.motion == "sway":
            frequency, acceleration = SWAY
            wave = np.sin(2.0 * math.pi * frequency * t + phase)
            return np.asarray(acceleration * self.inertia * wave)
        if self.motion == "hold":
            frequency, ratio = HOLD
            rate = 2.0 * math.pi * frequency
            stiff = rate * rate * (q - self.start.q[self.places[0]])
            return np.asarray(-self.inertia * (stiff + 2.0 * ratio * rate * u))
        return np.zeros(len(self.joints))

    def steps(self, step: float) -> int:
        """How many steps the motion takes."""
        return max(1, round(self.duration / step))

    @cached_property
    def text(self) -> str:
        """The URDF document without shapes; InputError for MJCF, and for what only deltac reads."""
        if not self.is_urdf:
            raise ModelError(f"{self.path.name}: only MuJoCo and deltac run MJCF here")
        urdf = read_urdf(self.path)
        if urdf.floating:
            raise ModelError(f"{self.path.name}: joint {[*urdf.floating.values()][0]!r} floats")
        mimics = [
            j.get("name") for j in urdf.document.findall("joint") if j.find("mimic") is not None
        ]
        if mimics:
            raise ModelError(f"{self.path.name}: joint {mimics[0]!r} mimics another")
        return urdf.text(placeholders=False, shapes=False)

    @cached_property
    def dampers(self) -> Array:
        """Coefficients of the driven joints' dampers, N·m·s/rad or N·s/m, as the URDF file gives them."""
        laws = {
            j.get("name"): j.find("dynamics")
            for j in read_urdf(self.path).document.findall("joint")
        }
        own = [laws.get(name) for name in self.joints]
        return np.array([0.0 if law is None else float(law.get("damping", 0.0)) for law in own])


# --- simulators ----------------------------------------------------------------------------------------


def run_deltac(experiment: Experiment, step: float, solver: str) -> Trajectory:
    """Of deltac itself: the mechanism, without contacts."""
    mechanism = experiment.model.mechanism
    controller = None
    if experiment.motion != "fall" and experiment.joints:
        own = [joint_torque(name, name) for name in experiment.joints]
        mechanism = replace(mechanism, forces=(*mechanism.forces, *own))
        q, u = experiment.places

        def drive(t: float, Q: Array, U: Array) -> dict[str, float]:
            return dict(zip(experiment.joints, experiment.torque(t, Q[q], U[u]).tolist()))

        controller = Controller(drive)
    return simulate(
        mechanism,
        experiment.start,
        experiment.steps(step) * step,
        step,
        solver,
        controller=controller,
    )


def run_in_mujoco(experiment: Experiment, step: float, integrator: str) -> Trajectory:
    """MuJoCo with its contacts; a model with motors of its own sways by a tenth of their range."""
    mujoco = simulator("mujoco", "mujoco")
    model = compiled_model(experiment.path)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = experiment.start.q, experiment.start.u
    places, speeds = experiment.places
    limited = model.actuator_ctrllimited.astype(bool)
    reach = np.where(limited, 0.05 * np.ptp(model.actuator_ctrlrange, axis=1), 0.1)
    middle = np.where(limited, model.actuator_ctrlrange.mean(axis=1), 0.0)

    def control(_: Any, data: Any) -> None:
        if experiment.motion == "sway" and model.nu:
            wave = np.sin(2.0 * math.pi * SWAY[0] * data.time + np.arange(model.nu))
            data.ctrl[:] = middle + reach * wave
        else:
            torque = experiment.torque(data.time, data.qpos[places], data.qvel[speeds])
            data.qfrc_applied[speeds] = torque

    return run_mujoco(
        model,
        experiment.steps(step) * step,
        data=data,
        controller=None if experiment.motion == "fall" else control,
        step=step,
        integrator=integrator,
    )


def run_drake(experiment: Experiment, step: float, solver: str) -> Trajectory:
    """Drake: a discrete plant ("tamsi", "sap") or a continuous one by one of its integrators."""
    simulator("pydrake", "drake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
    from pydrake.multibody.tree import BodyIndex
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    discrete = {"tamsi": "kTamsi", "sap": "kSap"}.get(solver)
    plant = MultibodyPlant(step if discrete else 0.0)
    Parser(plant).AddModelsFromString(experiment.text, "urdf")
    children = {plant.get_joint(k).child_body().index() for k in plant.GetJointIndices()}
    for index in map(BodyIndex, range(1, plant.num_bodies())):
        if index not in children:
            plant.WeldFrames(plant.world_frame(), plant.get_body(index).body_frame())
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    if discrete:
        plant.set_discrete_contact_approximation(getattr(DiscreteContactApproximation, discrete))
    plant.Finalize()
    simulation = Simulator(plant)
    if not discrete:
        ResetIntegratorFromFlags(simulation, solver, step).set_fixed_step_mode(True)
    context = simulation.get_mutable_context()
    joints = [plant.GetJointByName(name) for name in experiment.joints]
    q = np.array([joint.position_start() for joint in joints], dtype=np.intp)
    u = np.array([joint.velocity_start() for joint in joints], dtype=np.intp)
    positions, speeds = (
        np.array(plant.GetPositions(context)),
        np.array(plant.GetVelocities(context)),
    )
    positions[q] = experiment.start.q[experiment.places[0]]
    speeds[u] = experiment.start.u[experiment.places[1]]
    plant.SetPositions(context, positions)
    plant.SetVelocities(context, speeds)
    applied = plant.get_applied_generalized_force_input_port()
    total = np.zeros(plant.num_velocities())

    def drive(t: float) -> None:
        here = plant.GetPositions(context)[q], plant.GetVelocities(context)[u]
        total[u] = experiment.torque(t, *here)
        applied.FixValue(context, total)

    drive(0.0)
    simulation.Initialize()
    with record_drake(simulation, plant, experiment.model.mechanism) as recorder:
        for k in range(experiment.steps(step)):
            if k:
                drive(k * step)
            simulation.AdvanceTo((k + 1) * step)
            if not np.abs(plant.GetPositionsAndVelocities(context)).max() <= DIVERGED:
                break  # Drake does not come back from states that are not finite
    return recorder.trajectory()


def run_pybullet(experiment: Experiment, step: float, solver: str) -> Trajectory:
    """PyBullet by torque control, its damping of links off; its one integrator is "semi-implicit euler"."""
    p = simulator("pybullet", "pybullet")
    mechanism = experiment.model.mechanism
    client = p.connect(p.DIRECT)
    of = {"physicsClientId": client}
    try:
        p.setGravity(0, 0, -GRAVITY, **of)
        p.setTimeStep(step, **of)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.urdf"
            path.write_text(experiment.text, encoding="utf-8")
            flags = p.URDF_USE_INERTIA_FROM_FILE
            robot = p.loadURDF(str(path), useFixedBase=True, flags=flags, **of)
        names = {
            p.getJointInfo(robot, j, **of)[1].decode(): j
            for j in range(p.getNumJoints(robot, **of))
        }
        places = [names[name] for name in experiment.joints]
        for j in range(-1, p.getNumJoints(robot, **of)):
            p.changeDynamics(
                robot, j, linearDamping=0, angularDamping=0, maxJointVelocity=1e6, **of
            )
        q, u = (
            part[where]
            for part, where in zip((experiment.start.q, experiment.start.u), experiment.places)
        )
        for j, angle, speed in zip(places, q, u):
            p.resetJointState(robot, j, angle, speed, **of)
            p.setJointMotorControl2(robot, j, p.VELOCITY_CONTROL, force=0, **of)
        with record_pybullet(robot, mechanism, client=client) as recorder:
            for k in range(experiment.steps(step)):
                states = p.getJointStates(robot, places, **of)
                q, u = (np.array([state[k] for state in states]) for k in (0, 1))
                torque = experiment.torque(k * step, q, u)
                p.setJointMotorControlArray(
                    robot, places, p.TORQUE_CONTROL, forces=torque.tolist(), **of
                )
                p.stepSimulation(**of)
                acting = (
                    {}
                    if experiment.motion == "fall"
                    else dict(zip(experiment.joints, torque.tolist()))
                )
                recorder.sample(acting)
            return recorder.trajectory()
    finally:
        p.disconnect(client)


def _pinocchio(experiment: Experiment) -> tuple[Any, Any, Array, Array]:
    """Pinocchio's module, its model of the file, and the start in its conventions."""
    pin = simulator("pinocchio", "pin")
    model = pin.buildModelFromXML(experiment.text)
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    q, v = pin.neutral(model), np.zeros(model.nv)
    places = dict(zip(experiment.joints, zip(*experiment.places)))
    for name, joint in zip(model.names[1:], model.joints[1:]):
        of_q, of_u = places[name]
        angle = experiment.start.q[of_q]
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        )
        v[joint.idx_v] = experiment.start.u[of_u]
    return pin, model, q, v


def run_pinocchio(experiment: Experiment, step: float, solver: str) -> Trajectory:
    """Pinocchio's forward dynamics in a loop of "rk4" or "semi-implicit euler", its torques held."""
    pin, model, q, v = _pinocchio(experiment)
    data = model.createData()
    order = [experiment.joints.index(name) for name in model.names[1:]]
    damping = experiment.dampers[order]

    def angles(q: Array) -> Array:
        return np.array(
            [
                math.atan2(q[j.idx_q + 1], q[j.idx_q]) if j.nq == 2 else q[j.idx_q]
                for j in model.joints[1:]
            ]
        )

    channels = {f"damper {name}" for name, c in zip(model.names[1:], damping) if c}

    def dampers(v: Array) -> dict[str, Array]:
        acting = {}
        for k, name in enumerate(model.names[1:]):
            if f"damper {name}" in channels:
                acting[f"damper {name}"] = np.zeros(model.nv)
                acting[f"damper {name}"][k] = -damping[k] * v[k]
        return acting

    with record_pinocchio(model, experiment.model.mechanism) as recorder:
        for k in range(experiment.steps(step) + 1):
            # In the order of Pinocchio's joints, all with one speed.
            own = np.empty(model.nv)
            here = np.empty(model.nv), np.empty(model.nv)
            here[0][order], here[1][order] = angles(q), v
            own[:] = experiment.torque(k * step, *here)[order]
            tau = None if experiment.motion == "fall" else own
            recorder.sample(k * step, q, v, tau=tau, forces=dampers(v))

            def slope(q: Array, v: Array, own: Array = own) -> Array:
                return np.array(pin.aba(model, data, q, v, own - damping * v))

            h = step
            if solver == "rk4":
                k1, v1 = slope(q, v), v
                q2, v2 = pin.integrate(model, q, h / 2 * v1), v + h / 2 * k1
                k2 = slope(q2, v2)
                q3, v3 = pin.integrate(model, q, h / 2 * v2), v + h / 2 * k2
                k3 = slope(q3, v3)
                q4, v4 = pin.integrate(model, q, h * v3), v + h * k3
                k4 = slope(q4, v4)
                for weight, at, speed in ((1, q, v1), (2, q2, v2), (2, q3, v3), (1, q4, v4)):
                    recorder.stage(weight * h / 6, at, speed, tau=tau, forces=dampers(speed))
                q = pin.integrate(model, q, h / 6 * (v1 + 2 * v2 + 2 * v3 + v4))
                v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            else:
                new = v + h * slope(q, v)
                # Held over the step, in which speeds are linear: the dampers' at its start.
                recorder.stage(h, q, 0.5 * (v + new), tau=tau, forces=dampers(v))
                q, v = pin.integrate(model, q, h * new), new
    held = () if experiment.motion == "fall" else [f"actuator {name}" for name in model.names[1:]]
    return recorder.trajectory(solver, step, held, order={"rk4": 4}.get(solver, 1))


EXUDYN = {
    "generalized-alpha": ("GeneralizedAlpha", 2),
    "trapezoidal": ("TrapezoidalIndex2", 2),
    "rk4": ("RK44", 4),
    "velocity-verlet": ("VelocityVerlet", 1),
}
"""Exudyn's solvers: names there, and orders; Verlet's is 2 if no force depends on speeds."""


def run_exudyn(experiment: Experiment, step: float, solver: str) -> Trajectory:
    """Exudyn's kinematic tree, from the file as Pinocchio reads it.

    Explicit solvers hold the torques over each step. Implicit ones go on from the accelerations at the end of
    the step before, so theirs are functions of the instant.
    """
    exudyn = simulator("exudyn", "exudyn")
    items: Any = import_module("exudyn.itemInterface")

    pin, model, _, _ = _pinocchio(experiment)
    joints, names = list(model.joints)[1:], list(model.names)[1:]
    order = [experiment.joints.index(name) for name in names]
    turns, kinds = [np.eye(3)], []
    for joint in joints:
        short = joint.shortname()
        kinds.append(
            exudyn.JointType.PrismaticZ if short[10] == "P" else exudyn.JointType.RevoluteZ
        )
        axis = np.eye(3)["XYZ".index(short[-1])] if short[-1] in "XYZ" else _axis(pin, joint)
        turns.append(_onto(axis))
    placed = [
        turns[model.parents[k]].T @ model.jointPlacements[k].translation
        for k in range(1, model.njoints)
    ]
    rotated = [
        turns[model.parents[k]].T @ model.jointPlacements[k].rotation @ turns[k]
        for k in range(1, model.njoints)
    ]
    inertias = list(model.inertias)[1:]
    damping = experiment.dampers[order]
    q0, u0 = (
        part[where][order]
        for part, where in zip((experiment.start.q, experiment.start.u), experiment.places)
    )
    mbs = exudyn.SystemContainer().AddSystem()
    n = len(joints)
    node = mbs.AddNode(
        items.NodeGenericODE2(
            numberOfODE2Coordinates=n, referenceCoordinates=[0.0] * n,
            initialCoordinates=q0.tolist(), initialCoordinates_t=u0.tolist(),
        )
    )  # fmt: skip
    inverse = np.argsort(order)

    def torque(t: float, q: Array, u: Array) -> Array:
        values = experiment.torque(t, np.asarray(q)[inverse], np.asarray(u)[inverse])
        return np.asarray(values[order])

    options: dict[str, Any] = {}
    name, power = EXUDYN[solver]
    holds = name in ("RK44", "VelocityVerlet")
    present = np.zeros(n)
    if experiment.motion != "fall":
        options["forceUserFunction"] = lambda _, t, item, q, u: (
            present if holds else torque(t, q, u)
        )
    mbs.AddObject(
        items.ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=kinds,
            linkParents=[int(k) - 1 for k in list(model.parents)[1:]],
            jointTransformations=exudyn.Matrix3DList(rotated),
            jointOffsets=exudyn.Vector3DList(placed),
            linkInertiasCOM=exudyn.Matrix3DList(
                [turn.T @ body.inertia @ turn for turn, body in zip(turns[1:], inertias)]
            ),
            linkCOMs=exudyn.Vector3DList(
                [turn.T @ body.lever for turn, body in zip(turns[1:], inertias)]
            ),
            linkMasses=[float(body.mass) for body in inertias],
            gravity=[0.0, 0.0, -GRAVITY],
            jointPControlVector=[0.0] * n,
            jointDControlVector=damping.tolist(),
            jointPositionOffsetVector=[0.0] * n,
            jointVelocityOffsetVector=[0.0] * n,
            **options,
        )
    )
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime = experiment.steps(step), experiment.steps(step) * step
    time.verboseMode = 0
    time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-12, 1e-14
    settings.solution.file.write = False

    def of_joint(k: int) -> Callable[[float, Array, Array], Array]:
        return lambda t, q, u: np.eye(n)[k] * torque(t, q, u)[k]

    driven = (
        {}
        if experiment.motion == "fall"
        else {f"actuator {x}": of_joint(k) for k, x in enumerate(names)}
    )

    def before_step(mbs: Any, t: float) -> bool:
        # Called with the time at the end of the step.
        q, u = (
            np.atleast_1d(mbs.GetNodeOutput(node, kind))
            for kind in (
                exudyn.OutputVariableType.CoordinatesTotal,
                exudyn.OutputVariableType.Coordinates_t,
            )
        )
        present[:] = torque(t - step, q, u)
        return True

    if driven and holds:
        mbs.SetPreStepUserFunction(before_step)
    with record_exudyn(
        mbs,
        node,
        names,
        forces=driven,
        accelerations=name in ("GeneralizedAlpha", "TrapezoidalIndex2"),
    ) as recorder:
        mbs.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, name))
    return recorder.trajectory(solver, step, order=power, held=list(driven) if holds else None)


def _axis(pin: Any, joint: Any) -> Array:
    """The axis of a joint that no coordinate axis is."""
    data = joint.createData()
    joint.calc(data, np.array([1.0, 0.0]) if joint.nq == 2 else np.zeros(1))
    S = np.asarray(data.S.matrix() if hasattr(data.S, "matrix") else data.S).ravel()
    return S[:3] if "P" in joint.shortname()[10:12] else S[3:]


def _onto(axis: Array) -> Array:
    """A rotation that takes z onto an axis."""
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


@dataclass(frozen=True)
class Simulator:
    """A simulator: the module that it needs, whether it reads MJCF, its integrators and their orders."""

    run: Callable[[Experiment, float, str], Trajectory]
    module: str
    mjcf: bool
    orders: dict[str, int]

    @property
    def installed(self) -> bool:
        """Whether its module is there."""
        return find_spec(self.module) is not None


SIMULATORS = {
    "deltac": Simulator(run_deltac, "deltac", True, {"ode1": 1, "ode2": 2, "ode4": 4, "ode5": 5}),
    "mujoco": Simulator(
        run_in_mujoco, "mujoco", True, {"euler": 1, "implicitfast": 1, "implicit": 1, "rk4": 4}
    ),
    "drake": Simulator(
        run_drake,
        "pydrake",
        False,
        {"tamsi": 1, "sap": 1, "implicit_euler": 1, "runge_kutta2": 2, "runge_kutta3": 3},
    ),
    "pybullet": Simulator(run_pybullet, "pybullet", False, {"semi-implicit euler": 1}),
    "pinocchio": Simulator(run_pinocchio, "pinocchio", False, {"rk4": 4, "semi-implicit euler": 1}),
    "exudyn": Simulator(
        run_exudyn, "exudyn", False, {n: order for n, (_, order) in EXUDYN.items()}
    ),
}
"""Whatever can make an `Experiment`, by name."""
