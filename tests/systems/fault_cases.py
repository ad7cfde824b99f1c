"""Faults that were published in trackers and papers, rebuilt in small form.

Each function returns what a user would have: the right model, and the equations or the log with the
fault in it. The threads that are named tell the story; sentences and code here are our own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

import deltac as dc


@dataclass(frozen=True)
class LogCase:
    """A fault in a simulator: the right model, a log with the fault, and one without."""

    source: str
    model: Any
    log: dc.Trajectory
    right: dc.Trajectory


@dataclass(frozen=True)
class EquationsCase:
    """A fault in equations: the model, the equations with the fault and without, their coordinates."""

    source: str
    mechanism: dc.Mechanism
    wrong: Callable[..., Any]
    right: Callable[..., Any]
    coordinates: dc.CoordinateMap | None = None


def bare(run: dc.Trajectory) -> dc.Trajectory:
    """A log as a foreign simulator writes it: states and accelerations, no forces."""
    return replace(run, forces={}, works={}, integrals={})


# --- logs ---------------------------------------------------------------------------------------------


@cache
def missing_lever_arm(damping: tuple[float, float, float] = (0.4, 0.4, 0.4)) -> LogCase:
    """A pendulum on a ball joint in which fuel sloshes: the force −D l′ is added to the moment l × m g.

    With l′ = ω × l its power −ω·(D l′) is zero for isotropic D, and of either sign otherwise.
    """
    m, l = 1.3, 0.5
    slosh = dc.body("slosh", m, (0.02, 0.03, 0.025), mass_centre=(0, 0, -l))
    along = (f"-{l}*u.ball.wy", f"{l}*u.ball.wx", "0")  # ω × l with l = (0, 0, −l)
    drag = tuple(f"-({d})*({v})" for d, v in zip(damping, along))

    def machine(**where: Any) -> dc.Mechanism:
        return dc.Mechanism(
            bodies=[slosh],
            joints=[dc.joints.spherical("ball", "ground", "slosh")],
            forces=[dc.forces.point_force("drag", "slosh", frame="body", **where)],
            gravity=(0, 0, -9.81),
            name="sloshing fuel",
        )

    def simulated(mechanism: dc.Mechanism) -> dc.Trajectory:
        start = mechanism.state({"ball": [0.8, 0.36, 0.48, 0.0]}, {"ball": [1.0, 2.0, 0.5]})
        return bare(dc.simulate(mechanism, start, 3.0, 2e-3, solver="ode5"))

    right = machine(force=drag, point=(0, 0, -l))
    return LogCase(
        "AVSLab/basilisk issue 1484, pull request 1485",
        right, simulated(machine(moment=drag)), simulated(right),
    )  # fmt: skip


@cache
def force_without_its_potential() -> LogCase:
    """A spring with the energy ½ k r² whose force has the size k, however long it is."""
    k, m = 2.0, 0.7
    bead = dc.Mechanism(
        bodies=[dc.bodies.frame("slider"), dc.point_mass("bead", m)],
        joints=[
            dc.prismatic("x", "ground", "slider", axis="x"),
            dc.prismatic("y", "slider", "bead", axis="y"),
        ],
        forces=[dc.forces.spring_damper("tether", "ground", "bead", stiffness=k)],
        name="tethered bead",
    )

    def size_k(t: Any, q: Any, u: Any) -> Any:
        return -k / m * q / np.sqrt(q[0] ** 2 + q[1] ** 2)

    start = bead.state({"x": 0.8, "y": 0.3}, {"x": 0.0, "y": 0.9})
    wrong, right = (
        bare(dc.simulate(bead, start, 4.0, 2e-3, solver="ode5", equations=e))
        for e in (dc.Equations(size_k), None)
    )
    return LogCase("lammps issue 5119", bead, wrong, right)


URDF = """
<robot name="arm"><link name="world"/>
 <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <link name="forearm"><inertial><origin xyz="0.15 0 0.02" rpy="0 0 1.5707963267948966"/><mass value="1"/>
  <inertia ixx="0.004" iyy="0.012" izz="0.014" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <joint name="shoulder" type="continuous"><parent link="world"/><child link="upper"/>
  <axis xyz="0 1 0"/><dynamics damping="0.2"/></joint>
 <joint name="elbow" type="continuous"><parent link="upper"/><child link="forearm"/>
  <origin xyz="0.4 0 0"/><axis xyz="1 0 0"/><dynamics damping="0.131"/></joint>
</robot>"""


def _urdf_run(model: Any) -> dc.Trajectory:
    import mujoco

    data = mujoco.MjData(model)
    data.qvel[:] = [1.0, 6.0]
    return bare(dc.run_mujoco(model, 2.0, data=data, step=2e-3, integrator="rk4"))


@cache
def damping_dropped_by_an_importer() -> LogCase:
    """`<dynamics damping="…">` of a URDF is lost on the way into the simulator, silently."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(URDF)
    lossy = mujoco.MjModel.from_xml_string(URDF)
    lossy.dof_damping[:] = 0.0
    return LogCase("isaac-sim/IsaacSim issue 841", model, _urdf_run(lossy), _urdf_run(model))


@cache
def inertia_made_from_a_shape() -> LogCase:
    """The inertia in the file is passed over; a box's of the same mass is taken in its place."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(URDF)
    boxed = mujoco.MjModel.from_xml_string(URDF)
    forearm = boxed.body("forearm")
    forearm.inertia[:] *= 1.4
    return LogCase(
        "o3de-ros2-gem issue 166; Bullet's default, told in RobotLocomotion/drake issue 18773",
        model, _urdf_run(boxed), _urdf_run(model),
    )  # fmt: skip


BOB = """
<mujoco><option timestep="0.002"/><worldbody><body name="bob" pos="0 0 1"><joint name="ball" type="ball"/>
 <inertial pos="0.1 0 -0.2" mass="2" diaginertia="0.1 0.2 0.25" {turn}/></body></worldbody></mujoco>"""


@cache
def inertia_axes_lost() -> LogCase:
    """The orientation of the principal axes in a URDF's `<inertial>` is lost, the moments are kept."""
    import mujoco

    def simulated(model: Any) -> dc.Trajectory:
        data = mujoco.MjData(model)
        data.qvel[:] = [2.0, 1.0, 3.0]
        return bare(dc.run_mujoco(model, 2.0, data=data, integrator="rk4"))

    turn = 'quat="0.7071067811865476 0 0 0.7071067811865476"'
    model, lost = (mujoco.MjModel.from_xml_string(BOB.format(turn=t)) for t in (turn, ""))
    return LogCase("google-deepmind/mujoco issue 3559", model, simulated(lost), simulated(model))


@cache
def solver_residual_integrated() -> LogCase:
    """A solve ends with a force residual r, and M⁻¹ r is integrated with the motion.

    A stick of 10 g on a damped hinge: the smallest residual moves it.
    """
    stick = dc.Mechanism(
        bodies=[dc.rod("stick", 0.01, 0.2, along="-y")],
        joints=[dc.revolute("hinge", "ground", "stick", damping=2e-4)],
        gravity=(0, -9.81, 0),
        name="light stick",
    )
    inertia, weight = 0.01 * 0.2**2 / 3, 0.01 * 9.81 * 0.1
    h = 1e-3

    def solved(size: float) -> dc.Trajectory:
        rng = np.random.default_rng(0)
        t = h * np.arange(2001)
        q, u, a = np.zeros((len(t), 1)), np.zeros((len(t), 1)), np.zeros((len(t), 1))
        q[0] = 0.4
        for k in range(len(t)):
            residual = size * rng.standard_normal()
            a[k] = (-weight * np.sin(q[k]) - 2e-4 * u[k] + residual) / inertia
            if k + 1 < len(t):
                u[k + 1] = u[k] + h * a[k]
                q[k + 1] = q[k] + h * u[k + 1]
        return dc.Trajectory(t=t, q=q, u=u, coordinates=("hinge",), speeds=("hinge",), udot=a,  # type: ignore[arg-type]
            provenance=dc.Provenance("a solver that stops early", step=h),
        )  # fmt: skip

    return LogCase(
        "Genesis-Embodied-AI/genesis-world pull request 3375", stick, solved(1e-3), solved(0.0)
    )


# --- equations ----------------------------------------------------------------------------------------


@cache
def wrong_velocity() -> EquationsCase:
    """A disc rolls on a round hill; the speed of its centre is taken for that on flat ground.

    The contact point travels R φ̇ along the hill, the centre (R + r) φ̇; on flat ground both are the same.
    """
    m, R, r, g = 1.0, 2.0, 0.5, 9.81
    turning = 0.5 * m * r**2 * ((R + r) / r) ** 2  # the disc turns by (R + r)/r as it rolls
    hill = dc.Mechanism(
        bodies=[dc.point_mass("disc", m, (0, R + r, 0))],
        joints=[dc.revolute("place", "ground", "disc", armature=turning)],
        gravity=(0, -g, 0),
        name="disc on a hill",
    )

    def rolling(centre: float) -> Callable[..., Any]:
        inertia = m * centre**2 + turning
        return lambda t, q, u: np.array([m * g * (R + r) * np.sin(q[0]) / inertia])

    return EquationsCase("sympy issue 24669", hill, rolling(R), rolling(R + r))


@cache
def sign_in_the_thesis() -> EquationsCase:
    """The weight term of the second equation of the triple pendulum with the wrong sign."""
    right = dc.problems.load("triple-pendulum")
    wrong = dc.problems.load("triple-pendulum", mistake=True)
    assert right.equations is not None and wrong.equations is not None
    return EquationsCase(
        "Gugaratshan 2008, fig. 4.7",
        right.mechanism,
        wrong.equations.rhs,
        right.equations.rhs,
        right.equations.coordinates,  # type: ignore[arg-type]
    )


# --- a getter that answers with the step before -------------------------------------------------------


def stale_getters() -> tuple[Any, dc.Trajectory, np.ndarray]:
    """A MuJoCo loop that writes its log after each `mj_step`: new positions, old accelerations.

    Returns the model, that log, and the kinetic energies that MuJoCo gave at the same moments.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        BOB.format(turn="")
        .replace("<option ", '<option integrator="Euler" ')
        .replace("<worldbody>", '<option><flag energy="enable"/></option><worldbody>')
    )
    data = mujoco.MjData(model)
    data.qvel[:] = [2.0, 1.0, 3.0]
    rows, energy = [], []
    for _ in range(500):
        mujoco.mj_step(model, data)
        rows.append((data.time, data.qpos.copy(), data.qvel.copy(), data.qacc.copy()))
        energy.append(data.energy[1])
    t, q, u, udot = (np.array(x) for x in zip(*rows))
    mechanism, _ = dc.read_mechanism(model)
    log = dc.Trajectory(
        t=t, q=q, u=u, udot=udot, coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names, provenance=dc.Provenance("MuJoCo, by hand", step=0.002),
    )  # fmt: skip
    return model, log, np.array(energy)
