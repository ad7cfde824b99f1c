"""Machines of the benchmark of explanations, and the faults that are planted in their simulation."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import mujoco
import numpy as np

import deltac as dc

_HEAD = '<option timestep="0.002" gravity="0 0 -9.81"><flag contact="disable"/></option>'
_CAPSULE = '<geom type="capsule" fromto="0 0 0 {length} 0 0" size="{radius}"/>'


def _link(length: float, radius: float) -> str:
    return _CAPSULE.format(length=length, radius=radius)


MODELS = {
    "planar-arm": f"""
<mujoco model="planar-arm">{_HEAD}<worldbody>
 <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="0.05"/>{_link(0.3, 0.03)}
  <body name="lower" pos="0.3 0 0"><joint name="elbow" axis="0 1 0"/>{_link(0.3, 0.02)}</body></body>
 </worldbody><actuator><motor name="m1" joint="shoulder" gear="3"/><motor name="m2" joint="elbow"/>
 </actuator></mujoco>""",
    "cart-pole": f"""
<mujoco model="cart-pole">{_HEAD}<worldbody>
 <body name="cart"><joint name="slide" type="slide" axis="1 0 0" stiffness="20"/>
  <geom type="box" size=".1 .05 .05"/>
  <body name="pole"><joint name="hinge" axis="0 1 0" damping="0.01"/>
   <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02"/></body></body>
 </worldbody><actuator><motor name="drive" joint="slide" gear="20"/></actuator></mujoco>""",
    "arm-3d": f"""
<mujoco model="arm-3d">{_HEAD}<worldbody>
 <body name="base" pos="0 0 1"><joint name="yaw" axis="0 0 1" damping="0.1"/>
  <geom type="capsule" fromto="0 0 0 0.1 0 0.1" size="0.04"/>
  <body name="upper" pos="0.1 0 0.1"><joint name="pitch" axis="0 1 0"/>{_link(0.35, 0.03)}
   <body name="fore" pos="0.35 0 0"><joint name="roll" axis="1 0 0"/>
    <joint name="bend" axis="0 1 0" damping="0.02"/>
    <geom type="box" size=".12 .03 .02" pos=".12 .01 0"/>
    <body name="hand" pos="0.25 0 0"><joint name="wrist" axis="0 0 1"/>
     <geom type="box" size=".05 .03 .04" pos=".05 .02 .01"/></body></body></body></body>
 </worldbody><actuator><motor name="m1" joint="yaw" gear="4"/><motor name="m2" joint="pitch" gear="8"/>
  <motor name="m3" joint="roll" gear="0.2"/><motor name="m4" joint="bend" gear="2"/>
  <motor name="m5" joint="wrist" gear="0.2"/></actuator></mujoco>""",
    "floating": f"""
<mujoco model="floating">{_HEAD}<worldbody>
 <body name="hull"><freejoint name="hull"/><geom type="box" size=".2 .15 .1"/>
  <body name="wing" pos="0 .15 0"><joint name="flap" axis="1 0 0" stiffness="2" damping="0.02"/>
   <geom type="box" size=".08 .2 .02" pos="0 .2 0"/></body>
  <body name="tail" pos="-.2 0 0"><joint name="swing" axis="0 0 1" stiffness="1"/>
   <geom type="box" size=".15 .03 .05" pos="-.15 0 .01"/></body></body>
 </worldbody><actuator><motor name="flapper" joint="flap" gear="3"/>
  <motor name="rudder" joint="swing" gear="2"/></actuator></mujoco>""",
    "ball-chain": f"""
<mujoco model="ball-chain">{_HEAD}<worldbody>
 <body name="first" pos="0 0 1"><joint name="ball" type="ball" damping="0.01"/>
  <geom type="box" size=".2 .05 .03" pos=".2 0 0"/>
  <body name="second" pos=".4 0 0"><joint name="knee" axis="0 1 0"/>
   <geom type="box" size=".15 .04 .02" pos=".15 .02 0"/></body></body>
 </worldbody><actuator><motor name="knee" joint="knee" gear="1"/></actuator></mujoco>""",
}


@dataclass(frozen=True)
class Fault:
    """A fault planted in a simulation, and what an explanation must say of it."""

    model: str
    name: str
    element: str
    kinds: tuple[str, ...]
    truth: tuple[float, ...] | float
    plant: Callable[[Any], None]
    gear: tuple[str, float] | None = None
    second: tuple[str, float] | None = None
    """Kind and truth of another fault of the same element."""


def model_of(name: str) -> Any:
    return mujoco.MjModel.from_xml_string(MODELS[name])


def faults(seed: int = 0) -> Iterator[Fault]:
    """All faults, with sizes drawn from a generator."""
    rng, pairs = np.random.default_rng(seed), np.random.default_rng([seed, 2])
    for model_name in MODELS:
        model = model_of(model_name)
        bodies = [model.body(b).name for b in range(1, model.nbody)]
        hinges = [
            model.joint(j).name for j in range(model.njnt) if int(model.jnt_type[j]) in (2, 3)
        ]
        yield from _of_gravity(model_name, rng)
        for body in bodies:
            yield from _of_body(model_name, body, rng)
        for body in bodies[1:]:  # of a first one, hung on an axis, not both show
            yield from _of_body_twice(model_name, body, pairs)
        for joint in hinges:
            yield from _of_joint(model_name, model, joint, rng)
        for a in range(model.nu):
            name = model.actuator(a).name
            factor = float(rng.choice([0.5, 0.8, 0.9, 1.1, 2.0]))

            def strengthen(m: Any, a: int = a, factor: float = factor) -> None:
                m.actuator_gear[a] *= factor

            yield Fault(
                model_name, "gear", f"actuator {name}", ("actuator-gear",), factor, strengthen,
                (f"actuator {name}", factor),
            )  # fmt: skip


def _of_gravity(model: str, rng: np.random.Generator) -> Iterator[Fault]:
    factor = float(rng.choice([9.8 / 9.81, 1.01, 0.98]))

    def scale(m: Any) -> None:
        m.opt.gravity[:] *= factor

    yield Fault(model, "gravity", "gravity", ("gravity",), factor, scale)


def _of_body(model: str, body: str, rng: np.random.Generator) -> Iterator[Fault]:
    heavier = 1.0 + float(rng.choice([-0.05, 0.02, 0.05, 0.1]))
    rounder = 1.0 + float(rng.choice([-0.1, 0.1, 0.2]))
    axis = int(rng.integers(3))
    moved = float(rng.choice([-0.01, 0.005, 0.02]))

    def mass(m: Any) -> None:
        m.body(body).mass *= heavier

    def inertia(m: Any) -> None:
        m.body(body).inertia *= rounder

    def centre(m: Any) -> None:
        m.body(body).ipos[axis] += moved
        m.body_sameframe[m.body(body).id] = 0  # else MuJoCo takes the body's origin for its centre

    yield Fault(model, "mass", body, ("body-mass",), heavier, mass)
    yield Fault(model, "inertia", body, ("body-moments", "body-moment"), rounder, inertia)
    yield Fault(model, "com", body, ("body-centre",), moved, centre)


def _of_body_twice(model: str, body: str, rng: np.random.Generator) -> Iterator[Fault]:
    """A payload that is heavier and sits elsewhere."""
    heavier = 1.0 + float(rng.choice([-0.1, 0.02, 0.1, 0.3]))
    axis, moved = int(rng.integers(3)), float(rng.choice([-0.02, 0.01, 0.03]))

    def both(m: Any) -> None:
        m.body(body).mass *= heavier
        m.body(body).ipos[axis] += moved
        m.body_sameframe[m.body(body).id] = 0

    yield Fault(
        model, "mass+com", body, ("body-mass",), heavier, both, second=("body-centre", moved)
    )


def _of_joint(model: str, m: Any, joint: str, rng: np.random.Generator) -> Iterator[Fault]:
    dof, j = int(m.joint(joint).dofadr[0]), m.joint(joint).id
    size = float(np.sqrt(_typical(model)[dof]))
    damping, friction = 0.05 * size * rng.uniform(0.5, 2.0), 0.05 * size * rng.uniform(0.5, 2.0)
    rotor, spring = 0.02 * size * rng.uniform(0.5, 2.0), 0.5 * size * rng.uniform(0.5, 2.0)
    has = {
        "damping": float(m.dof_damping[dof]),
        "spring": float(m.jnt_stiffness[j]),
    }

    def damp(x: Any) -> None:
        x.dof_damping[dof] += damping

    def rub(x: Any) -> None:
        x.dof_frictionloss[dof] += friction

    def turn(x: Any) -> None:
        x.dof_armature[dof] += rotor

    def stiffen(x: Any) -> None:
        x.jnt_stiffness[j] += spring

    yield Fault(
        model, "damping", joint, ("damping" if has["damping"] else "missing-damper",),
        has["damping"] + damping, damp,
    )  # fmt: skip
    yield Fault(model, "friction", joint, ("missing-friction",), friction, rub)
    yield Fault(model, "armature", joint, ("missing-rotor-inertia",), rotor, turn)
    yield Fault(
        model, "spring", joint, ("stiffness" if has["spring"] else "missing-spring",),
        has["spring"] + spring, stiffen,
    )  # fmt: skip


@cache
def _typical(name: str) -> Any:
    """Diagonal of the mass matrix, by which the sizes of joints' faults are chosen."""
    model = model_of(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return np.diag(M).copy()


def simulate(fault: Fault | None, model_name: str, duration: float = 2.5) -> dc.Trajectory:
    """The log of a simulation with a fault (or none), without the forces that hide it."""
    model = copy.copy(model_of(model_name))
    if fault is not None:
        fault.plant(model)
    rng = np.random.default_rng(7)
    amplitude, rate = rng.uniform(0.3, 1.0, model.nu), rng.uniform(2.0, 9.0, model.nu)
    phase = rng.uniform(0.0, 6.0, model.nu)
    data = mujoco.MjData(model)
    data.qvel[:] = rng.uniform(-1.5, 1.5, model.nv)
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        data.qvel[2] = 0.5 * 9.81 * duration

    def control(m: Any, d: Any) -> None:
        d.ctrl[:] = amplitude * np.sin(rate * d.time + phase)

    run = dc.run_mujoco(model, duration, data=data, controller=control, integrator="rk4")
    forces = {n: f for n, f in run.forces.items() if not n.startswith("friction ")}
    if fault is not None and fault.gear is not None:
        name, factor = fault.gear
        forces[name] = forces[name] / factor  # what was commanded
    source = replace(run.provenance, strengths={})  # they tell gears
    return replace(run, forces=forces, provenance=source)


def noisy(run: dc.Trajectory, relative: float, seed: int) -> dc.Trajectory:
    """White noise on every column, as a fraction of its root mean square."""
    if not relative:
        return run
    rng = np.random.default_rng(seed)

    def shaken(x: Any) -> Any:
        return x + relative * np.sqrt(np.mean(x**2, axis=0)) * rng.standard_normal(x.shape)

    assert run.udot is not None
    forces = {n: shaken(f) for n, f in run.forces.items()}
    return replace(run, q=shaken(run.q), u=shaken(run.u), udot=shaken(run.udot), forces=forces)
