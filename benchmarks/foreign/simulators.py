"""Simulators, each with the way its users record it: a log holds what they would have written."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foreign.machines import AXES, Machine

Array: TypeAlias = NDArray[np.float64]
Extra = Callable[[float, Array, Array], Array]
"""A force that nobody logs: of t, q, u."""


@dataclass(frozen=True)
class Drive:
    """Torques of the motors: sines of time, or a controller that is sampled and held."""

    amplitude: Array
    rate: Array
    phase: Array
    gain: float
    period: float

    def __call__(self, t: float, q: Array, u: Array, motors: list[int]) -> Array:
        tau = np.zeros(len(q))
        tau[motors] = self.amplitude * np.sin(self.rate * t + self.phase)
        tau[motors] -= self.gain * (q[motors] + 0.3 * u[motors])
        return tau

    @property
    def of_time(self) -> bool:
        return self.gain == 0.0


@dataclass
class Recording:
    """Rows as they were kept: t, q, u, u̇ or None, generalized forces of the motors (T, n)."""

    t: Array
    q: Array
    u: Array
    udot: Array | None
    tau: Array
    step: float
    scheme: str
    simulator: str
    exact_udot: bool = True
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Run:
    """What is simulated: a machine with its drive from a state, for a time."""

    machine: Machine
    drive: Drive
    q: Array
    u: Array
    duration: float
    gear: float = 1.0
    extra: Extra | None = None

    @property
    def motors(self) -> list[int]:
        return list(self.machine.motors)

    def unlogged(self, t: float, q: Array, u: Array) -> Array:
        return np.zeros_like(u) if self.extra is None else self.extra(t, q, u)


# --- accelerations by Pinocchio ------------------------------------------------------------------------


class Oracle:
    """u̇ by Pinocchio's articulated-body algorithm, with dampers and springs by hand."""

    def __init__(self, run: Run) -> None:
        import pinocchio as pin

        self.run, self.pin = run, pin
        model = pin.Model()
        model.gravity.linear = np.array([0.0, 0.0, -run.machine.gravity])
        places: list[int] = []
        for link in run.machine.links:
            axis = np.array(AXES[link.axis])
            kind = (
                pin.JointModelRevoluteUnaligned(axis)
                if link.kind == "revolute"
                else pin.JointModelPrismaticUnaligned(axis)
            )
            parent = 0 if link.parent < 0 else places[link.parent]
            place = model.addJoint(
                parent, kind, pin.SE3(np.eye(3), np.array(link.offset)), link.joint
            )
            inertia = pin.Inertia(link.mass, np.array(link.centre), np.diag(link.inertia))
            model.appendBodyToJoint(place, inertia, pin.SE3.Identity())
            places.append(place)
        model.armature = np.array([link.armature for link in run.machine.links])
        self.model, self.data = model, model.createData()
        self.damping = np.array([link.damping for link in run.machine.links])
        self.stiffness = np.array([link.stiffness for link in run.machine.links])

    def tau(self, t: float, q: Array, u: Array) -> Array:
        return self.run.drive(t, q, u, self.run.motors)

    def acceleration(self, t: float, q: Array, u: Array, tau: Array) -> Array:
        force = self.run.gear * tau - self.damping * u - self.stiffness * q
        force = force + self.run.unlogged(t, q, u)
        return np.array(self.pin.aba(self.model, self.data, q, u, force))

    def mass(self, q: Array) -> Array:
        M = np.array(self.pin.crba(self.model, self.data, q))
        return np.triu(M) + np.triu(M, 1).T


def own_integrator(run: Run, step: float, scheme: str, rng: np.random.Generator) -> Recording:
    """A loop that users write themselves around a dynamics library."""
    oracle = Oracle(run)
    f = oracle.acceleration
    held = not run.drive.of_time
    count = round(run.duration / step)
    t, q, u = 0.0, run.q.copy(), run.u.copy()
    rows: list[tuple[float, Array, Array, Array, Array]] = []
    tau = oracle.tau(t, q, u)
    a = f(t, q, u, tau)
    algorithmic = a.copy()
    rho = float(rng.choice([0.5, 0.8, 0.9]))
    every = max(1, round(run.drive.period / step))
    for k in range(count + 1):
        t = k * step
        if not held or k % every == 0:
            tau = oracle.tau(t, q, u)

        def force(s: float, x: Array, v: Array, tau: Array = tau) -> Array:
            return tau if held else oracle.tau(s, x, v)

        a = f(t, q, u, tau)
        kept = algorithmic if scheme in ("generalized-alpha", "newmark") else a
        rows.append((t, q.copy(), u.copy(), kept.copy(), tau.copy()))
        h = step

        def slope(s: float, x: Array, v: Array, force: Any = force) -> Array:
            return f(s, x, v, force(s, x, v))

        if scheme == "explicit-euler":
            q, u = q + h * u, u + h * a
        elif scheme == "semi-implicit-euler":
            u = u + h * a
            q = q + h * u
        elif scheme == "implicit-damping":
            M = oracle.mass(q)
            u = u + np.linalg.solve(M + h * np.diag(oracle.damping), h * (M @ a))
            q = q + h * u
        elif scheme == "midpoint":
            half = slope(t + h / 2, q + h / 2 * u, u + h / 2 * a)
            q, u = q + h * (u + h / 2 * a), u + h * half
        elif scheme == "heun":
            q1, u1 = q + h * u, u + h * a
            a1 = slope(t + h, q1, u1)
            q, u = q + h / 2 * (u + u1), u + h / 2 * (a + a1)
        elif scheme == "rk4":
            k1q, k1 = u, a
            k2q, k2 = u + h / 2 * k1, slope(t + h / 2, q + h / 2 * k1q, u + h / 2 * k1)
            k3q, k3 = u + h / 2 * k2, slope(t + h / 2, q + h / 2 * k2q, u + h / 2 * k2)
            k4q, k4 = u + h * k3, slope(t + h, q + h * k3q, u + h * k3)
            q = q + h / 6 * (k1q + 2 * k2q + 2 * k3q + k4q)
            u = u + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        elif scheme == "verlet":
            half = u + h / 2 * a
            q = q + h * half
            u = half + h / 2 * slope(t + h, q, half)
        elif scheme in ("implicit-euler", "trapezoidal", "implicit-midpoint"):
            q0, u0, a0 = q.copy(), u.copy(), a
            v, x = u + h * a, q + h * u
            for _ in range(60):
                if scheme == "implicit-euler":
                    new = u0 + h * slope(t + h, x, v)
                    place = q0 + h * new
                elif scheme == "trapezoidal":
                    new = u0 + h / 2 * (a0 + slope(t + h, x, v))
                    place = q0 + h / 2 * (u0 + new)
                else:
                    new = u0 + h * slope(t + h / 2, (q0 + x) / 2, (u0 + v) / 2)
                    place = q0 + h / 2 * (u0 + new)
                moved = np.abs(new - v).max()
                v, x = new, place
                if moved < 1e-13 * (1 + np.abs(v).max()):
                    break
            q, u = x, v
        else:  # generalized-α and Newmark (ρ∞ = 1 without damping: the trapezoidal rule in a)
            if scheme == "newmark":
                am = af = 0.0
                gamma, beta = 0.5, 0.25
            else:
                am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
                gamma = 0.5 + af - am
                beta = 0.25 * (gamma + 0.5) ** 2
            q0, u0, old, a0 = q.copy(), u.copy(), algorithmic.copy(), a
            exact = a.copy()
            for _ in range(80):
                new = ((1 - af) * exact + af * a0 - am * old) / (1 - am)
                x = q0 + h * u0 + h * h * ((0.5 - beta) * old + beta * new)
                v = u0 + h * ((1 - gamma) * old + gamma * new)
                after = slope(t + h, x, v)
                moved = np.abs(after - exact).max()
                exact = after
                if moved < 1e-12 * (1 + np.abs(exact).max()):
                    break
            algorithmic = ((1 - af) * exact + af * a0 - am * old) / (1 - am)
            q, u = x, v
        if not np.isfinite(q).all() or np.abs(u).max() > 1e3:
            break
    return _recording(rows, step, scheme, "own loop on Pinocchio")


def _recording(rows: list[Any], step: float, scheme: str, simulator: str) -> Recording:
    t, q, u, a, tau = (np.array([row[k] for row in rows]) for k in range(5))
    return Recording(t, q, u, a, tau, step, scheme, simulator)


def scipy_solver(run: Run, spacing: float, method: str, tolerance: float) -> Recording:
    """`solve_ivp` of hand-made equations, sampled where the user likes."""
    from scipy.integrate import solve_ivp

    oracle = Oracle(run)
    n = len(run.q)

    def right(t: float, y: Array) -> Array:
        q, u = y[:n], y[n:]
        return np.concatenate([u, oracle.acceleration(t, q, u, oracle.tau(t, q, u))])

    t = np.arange(round(run.duration / spacing) + 1) * spacing
    found = solve_ivp(
        right,
        (0.0, t[-1]),
        np.concatenate([run.q, run.u]),
        method,
        t,
        rtol=tolerance,
        atol=tolerance,
    )
    rows = []
    for s, y in zip(found.t, found.y.T):
        tau = oracle.tau(s, y[:n], y[n:])
        rows.append((s, y[:n], y[n:], oracle.acceleration(s, y[:n], y[n:], tau), tau))
    made = _recording(rows, spacing, f"scipy-{method}", "SciPy")
    return made


# --- MuJoCo ---------------------------------------------------------------------------------------------


def mujoco_loop(run: Run, step: float, integrator: str, habit: str, every: int) -> Recording:
    """MuJoCo, recorded as people do it.

    habit: "before" the step, after `mj_forward`; "after" `mj_step`, with what it left in memory; "refreshed":
    `mj_forward` after the step; every row or each `every`-th.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(run.machine.mjcf(step, integrator))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = run.q, run.u
    rows = []
    motors = run.motors
    count = round(run.duration / step)
    period = max(1, round(run.drive.period / step))

    def keep() -> None:
        tau = np.array(data.qfrc_actuator) / run.gear
        rows.append((data.time, data.qpos.copy(), data.qvel.copy(), data.qacc.copy(), tau))

    for k in range(count):
        if k % period == 0 or run.drive.of_time:
            tau = run.drive(data.time, data.qpos.copy(), data.qvel.copy(), motors)
        data.ctrl[:] = run.gear * tau[motors]
        data.qfrc_applied[:] = run.unlogged(data.time, data.qpos, data.qvel)
        if habit == "before":
            mujoco.mj_forward(model, data)
            if k % every == 0:
                keep()
        mujoco.mj_step(model, data)
        if habit == "refreshed":
            mujoco.mj_forward(model, data)
        if habit != "before" and k % every == 0:
            keep()
        if np.abs(data.qvel).max() > 1e3:
            break
    made = _recording(rows, step * every, f"mujoco-{integrator}", "MuJoCo")
    made.exact_udot = habit != "after"
    made.notes.append(habit)
    return made


# --- PyBullet, Drake, Exudyn ----------------------------------------------------------------------------


@contextlib.contextmanager
def _file(text: str, suffix: str) -> Iterator[str]:
    handle, path = tempfile.mkstemp(suffix)
    with os.fdopen(handle, "w") as file:
        file.write(text)
    try:
        yield path
    finally:
        os.unlink(path)


def bullet(run: Run, step: float) -> Recording:
    """PyBullet by torque control; its joints' dampers act in its own way."""
    import pybullet as p

    client = p.connect(p.DIRECT)
    try:
        p.setGravity(0, 0, -run.machine.gravity, physicsClientId=client)
        p.setTimeStep(step, physicsClientId=client)
        with _file(run.machine.urdf(), ".urdf") as path:
            robot = p.loadURDF(
                path, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE | p.URDF_MAINTAIN_LINK_ORDER,
                physicsClientId=client,
            )  # fmt: skip
        names = {
            p.getJointInfo(robot, j, physicsClientId=client)[1].decode(): j
            for j in range(p.getNumJoints(robot, physicsClientId=client))
        }
        places = [names[joint] for joint in run.machine.joints]
        for k, j in enumerate(places):
            p.resetJointState(robot, j, run.q[k], run.u[k], physicsClientId=client)
            p.setJointMotorControl2(robot, j, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
            p.changeDynamics(
                robot, j, linearDamping=0, angularDamping=0, jointDamping=run.machine.links[k].damping,
                maxJointVelocity=1e6, physicsClientId=client,
            )  # fmt: skip
        p.changeDynamics(robot, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
        rows = []
        n = len(places)
        period = max(1, round(run.drive.period / step))
        for k in range(round(run.duration / step)):
            states = [p.getJointState(robot, j, physicsClientId=client) for j in places]
            q, u = np.array([s[0] for s in states]), np.array([s[1] for s in states])
            t = k * step
            if k % period == 0 or run.drive.of_time:
                tau = run.drive(t, q, u, run.motors)
            rows.append((t, q, u, np.zeros(n), tau))
            total = run.gear * tau + run.unlogged(t, q, u)
            p.setJointMotorControlArray(
                robot, places, p.TORQUE_CONTROL, forces=total.tolist(), physicsClientId=client
            )
            p.stepSimulation(physicsClientId=client)
    finally:
        p.disconnect(client)
    made = _recording(rows, step, "bullet", "PyBullet")
    made.udot = None
    return made


def drake(run: Run, step: float, solver: str, port: str) -> Recording:
    """Drake's discrete plant (TAMSI or SAP), or a continuous one with Runge–Kutta; u̇ from its port."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    discrete = solver in ("tamsi", "sap")
    plant = MultibodyPlant(step if discrete else 0.0)
    Parser(plant).AddModelsFromString(run.machine.urdf(), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -run.machine.gravity])
    if discrete:
        plant.set_discrete_contact_approximation(
            DiscreteContactApproximation.kTamsi
            if solver == "tamsi"
            else DiscreteContactApproximation.kSap
        )
        if port == "sampled":
            plant.SetUseSampledOutputPorts(True)
        else:
            plant.SetUseSampledOutputPorts(False)
    plant.Finalize()
    simulator = Simulator(plant)
    if not discrete:
        ResetIntegratorFromFlags(simulator, solver, step).set_fixed_step_mode(True)
    context = simulator.get_mutable_context()
    order = [plant.GetJointByName(joint).position_start() for joint in run.machine.joints]
    q0, u0 = np.zeros(len(order)), np.zeros(len(order))
    q0[order], u0[order] = run.q, run.u
    plant.SetPositions(context, q0)
    plant.SetVelocities(context, u0)
    actuators = [plant.GetJointActuatorByName(f"m{k}") for k in run.motors]
    acceleration = plant.get_generalized_acceleration_output_port()
    rows = []
    if actuators:
        plant.get_actuation_input_port().FixValue(context, np.zeros(len(actuators)))
    applied = plant.get_applied_generalized_force_input_port()
    applied.FixValue(context, np.zeros(len(order)))
    simulator.Initialize()
    period = max(1, round(run.drive.period / step))
    for k in range(round(run.duration / step)):
        q, u = plant.GetPositions(context)[order], plant.GetVelocities(context)[order]
        t = k * step
        if k % period == 0 or run.drive.of_time:
            tau = run.drive(t, q, u, run.motors)
        if actuators:
            values = np.zeros(len(actuators))
            for actuator, joint in zip(actuators, run.motors):
                values[actuator.input_start()] = run.gear * tau[joint]
            plant.get_actuation_input_port().FixValue(context, values)
        total = np.zeros(len(order))
        total[order] = run.unlogged(t, q, u)
        applied.FixValue(context, total)
        rows.append((t, q.copy(), u.copy(), acceleration.Eval(context)[order].copy(), tau.copy()))
        simulator.AdvanceTo((k + 1) * step)
        if np.abs(plant.GetVelocities(context)).max() > 1e3:
            break
    made = _recording(rows, step, f"drake-{solver}", "Drake")
    made.exact_udot = not discrete or port != "sampled"
    return made


def exudyn_tree(run: Run, step: float, solver: str, rho: float) -> Recording:
    """Exudyn's kinematic tree by its implicit or explicit solvers; sensors keep q, u and u̇."""
    import exudyn
    from exudyn.itemInterface import (
        LoadCoordinate,
        MarkerNodeCoordinate,
        NodeGenericODE2,
        ObjectKinematicTree,
        SensorNode,
    )

    machine, n = run.machine, len(run.q)
    mbs = exudyn.SystemContainer().AddSystem()
    node = mbs.AddNode(
        NodeGenericODE2(
            numberOfODE2Coordinates=n, referenceCoordinates=[0.0] * n,
            initialCoordinates=run.q.tolist(), initialCoordinates_t=run.u.tolist(),
        )
    )  # fmt: skip
    kinds = {
        (kind, axis): getattr(exudyn.JointType, f"{kind.capitalize()}{axis.upper()}")
        for kind in ("revolute", "prismatic")
        for axis in "xyz"
    }
    mbs.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[kinds[link.kind, link.axis] for link in machine.links],
            linkParents=[link.parent for link in machine.links],
            jointTransformations=exudyn.Matrix3DList([np.eye(3)] * n),
            jointOffsets=exudyn.Vector3DList([list(link.offset) for link in machine.links]),
            linkInertiasCOM=exudyn.Matrix3DList([np.diag(link.inertia) for link in machine.links]),
            linkCOMs=exudyn.Vector3DList([list(link.centre) for link in machine.links]),
            linkMasses=[link.mass for link in machine.links],
            gravity=[0, 0, -machine.gravity],
            jointPControlVector=[link.stiffness for link in machine.links],
            jointDControlVector=[link.damping for link in machine.links],
            jointPositionOffsetVector=[0.0] * n,
            jointVelocityOffsetVector=[0.0] * n,
        )
    )

    def load(k: int) -> Callable[[Any, float, float], float]:
        def value(_: Any, t: float, load: float) -> float:
            return float(run.gear * run.drive(t, np.zeros(n), np.zeros(n), run.motors)[k])

        return value

    for k in run.motors:
        marker = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
        mbs.AddLoad(LoadCoordinate(markerNumber=marker, load=1.0, loadUserFunction=load(k)))
    V = exudyn.OutputVariableType
    sensors = [
        mbs.AddSensor(
            SensorNode(
                nodeNumber=node, storeInternal=True, writeToFile=False, outputVariableType=kind
            )
        )
        for kind in (V.Coordinates, V.Coordinates_t, V.Coordinates_tt)
    ]
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime = round(run.duration / step), run.duration
    time.verboseMode = 0
    time.newton.relativeTolerance = 1e-12
    time.newton.absoluteTolerance = 1e-14
    time.generalizedAlpha.spectralRadius = rho
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = step
    mbs.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, solver))
    q, u, a = (np.asarray(mbs.GetSensorStoredData(s)) for s in sensors)
    t = q[:, 0]
    tau = np.array([run.drive(s, np.zeros(n), np.zeros(n), run.motors) for s in t])
    return Recording(
        t, q[:, 1:], u[:, 1:], a[:, 1:], tau, step, f"exudyn-{solver}", "Exudyn", False
    )
