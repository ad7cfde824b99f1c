"""Small MuJoCo models for audits, and what is done to their logs."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from deltac import Trajectory

ARM = """
<mujoco model="arm"><option timestep="0.002" gravity="0 0 -9.81"><flag contact="disable"/></option>
 <worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="0.05"/>
   <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
   <body name="lower" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/></body></body>
 </worldbody>
 <actuator><motor name="m1" joint="shoulder" gear="3"/><motor name="m2" joint="elbow"/></actuator>
</mujoco>"""

HOPPER = """
<mujoco model="hopper"><option timestep="0.001" gravity="0 0 -9.81" integrator="implicitfast"/>
 <default><geom contype="0" conaffinity="0"/></default>
 <worldbody>
  <geom name="floor" type="plane" size="5 5 .1" contype="1" conaffinity="1"/>
  <body name="base" pos="0 0 0.6"><freejoint name="base"/>
   <geom name="hull" type="box" size=".2 .1 .05"/>
   <body name="leg1" pos=".15 0 0">
    <joint name="hip1" axis="0 1 0" damping="0.3" stiffness="20"/>
    <geom name="shin1" type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>
    <geom name="foot1" type="sphere" pos="0 0 -.3" size=".04" contype="1" conaffinity="1"/></body>
   <body name="leg2" pos="-.15 0 0">
    <joint name="hip2" axis="0 1 0" damping="0.3" stiffness="20"/>
    <geom name="shin2" type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>
    <geom name="foot2" type="sphere" pos="0 0 -.3" size=".04" contype="1" conaffinity="1"/></body>
  </body>
 </worldbody>
</mujoco>"""

BOX = """
<mujoco model="box"><option timestep="0.002" gravity="0 0 -9.81" integrator="RK4"/>
 <worldbody><body name="box" pos="0 0 1"><freejoint name="box"/>
  <geom type="box" size=".1 .2 .3"/></body></worldbody>
</mujoco>"""


def model_of(xml: str) -> Any:
    import mujoco

    return mujoco.MjModel.from_xml_string(xml)


def with_changes(xml: str, **changes: Any) -> Any:
    """The model with factors on its arrays; `gravity` and `damping` are values."""
    model = copy.copy(model_of(xml))
    for name, value in changes.items():
        if name == "gravity":
            model.opt.gravity[2] = -value
        elif name == "damping":
            model.dof_damping[:] = value
        else:
            array = getattr(model, name)
            array[:] = array * np.reshape(value, (-1,) + (1,) * (array.ndim - 1))
    return model


@cache
def arm_run(integrator: str = "rk4") -> Trajectory:
    """Two seconds of the arm under smooth torques."""
    from deltac.recorders import run_mujoco

    def control(_: Any, data: Any) -> None:
        data.ctrl[:] = [0.3 * np.sin(3 * data.time), 0.1 * np.cos(5 * data.time)]

    return run_mujoco(model_of(ARM), 2.0, controller=control, integrator=integrator)


@cache
def hopper_run() -> Trajectory:
    """A second of falling onto two springy legs."""
    from deltac.recorders import run_mujoco

    return run_mujoco(model_of(HOPPER), 1.0)


@cache
def box_run() -> Trajectory:
    """Two seconds of a tumbling box in free fall."""
    import mujoco

    from deltac.recorders import run_mujoco

    model = model_of(BOX)
    data = mujoco.MjData(model)
    data.qvel[:] = [1, 0, 3, 0.1, 4, 0.2]
    return run_mujoco(model, 2.0, data=data)


def without(run: Trajectory, *starts: str) -> Trajectory:
    """The run without the channels whose names begin so."""
    kept = {n: f for n, f in run.forces.items() if not n.startswith(starts)}
    assert len(kept) < len(run.forces)
    return replace(run, forces=kept, works={n: run.works[n] for n in kept if n in run.works})


def of_rows_alone(run: Trajectory) -> Trajectory:
    """The run as a log that does not hold the works of the steps."""
    return replace(run, works={})


def scaled(run: Trajectory, channel: str, factor: float) -> Trajectory:
    """The run with one channel's logged force, and its work, multiplied."""
    works = {**run.works}
    if channel in works:
        works[channel] = factor * works[channel]
    return replace(run, forces={**run.forces, channel: factor * run.forces[channel]}, works=works)
