"""Small MuJoCo models: what a simulation of robots has, in few lines each."""

from __future__ import annotations

from typing import Any

import numpy as np

TUMBLER = """
<mujoco model="tumbler">
  <option gravity="0 0 0" timestep="0.002"/>
  <worldbody>
    <body><freejoint name="base"/>
      <inertial pos="0 0 0" mass="1.3" diaginertia="0.01 0.02 0.025"/></body>
  </worldbody>
</mujoco>"""

CARTS = """
<mujoco model="carts">
  <option gravity="0.3 0 -9.81" timestep="0.002"/>
  <worldbody>
    <body><joint name="x" type="slide" axis="1 0 0" damping="0.5" stiffness="20"/>
      <geom size="0.1" mass="2"/>
      <body><joint name="z" type="slide" axis="0 0 1" stiffness="50"/>
        <geom size="0.1" mass="1"/></body></body>
  </worldbody>
  <actuator><motor name="push" joint="x"/></actuator>
</mujoco>"""
"""Its mass matrix is constant."""

SWINGER = """
<mujoco model="swinger">
  <option timestep="0.002"/>
  <worldbody>
    <body><joint name="a" axis="0 1 0" damping="0.05" stiffness="1" springref="0.3"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/>
      <body pos="0.5 0 0"><joint name="b" axis="0 0 1" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="0.7"/></body></body>
  </worldbody>
  <actuator><motor name="turn" joint="b"/></actuator>
</mujoco>"""
"""Smooth, without contact: its integrators show their order."""

ARM = """
<mujoco model="arm">
  <option timestep="0.002"/>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.1" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
      <site name="origin" pos="0.1 0 0.05"/>
      <body name="fore" pos="0.4 0 0"><joint name="elbow" axis="0 1 0" damping="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="0.7"/>
        <site name="insertion" pos="0.1 0 0.05"/></body></body>
    <body name="crank" pos="0.8 0 -0.3"><joint name="crank" axis="0 1 0" frictionloss="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="0.4"/></body>
  </worldbody>
  <tendon>
    <spatial name="biceps" stiffness="40" damping="2" springlength="0.2">
      <site site="origin"/><site site="insertion"/></spatial>
  </tendon>
  <actuator>
    <motor name="lift" joint="shoulder" gear="2"/>
    <motor name="pull" tendon="biceps" gear="5"/>
  </actuator>
  <equality><connect name="tip" body1="fore" body2="crank" anchor="0.4 0 0"/></equality>
  <contact><exclude body1="fore" body2="crank"/></contact>
</mujoco>"""
"""A loop closed by an equality constraint, a tendon with a spring and a motor."""

WALKER = """
<mujoco model="walker">
  <option timestep="0.002"/>
  <default>
    <joint axis="0 -1 0" damping="0.5" armature="0.01" limited="true"/>
    <geom type="capsule" friction="0.9"/>
    <motor ctrllimited="true" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.1"/>
    <body name="torso" pos="0 0 1.15">
      <joint name="rootx" type="slide" axis="1 0 0" damping="0" armature="0" limited="false"/>
      <joint name="rootz" type="slide" axis="0 0 1" damping="0" armature="0" limited="false"/>
      <joint name="rooty" type="hinge" axis="0 1 0" damping="0" armature="0" limited="false"/>
      <geom name="torso" fromto="0 0 -0.1 0 0 0.3" size="0.07" mass="6"/>
      LEGS
    </body>
  </worldbody>
  <actuator>MOTORS</actuator>
</mujoco>"""

_LEG = """
      <body name="{s}_thigh" pos="0 {y} -0.15"><joint name="{s}_hip" range="-30 100"/>
        <geom name="{s}_thigh" fromto="0 0 0 0 0 -0.4" size="0.05" mass="3"/>
        <body name="{s}_shin" pos="0 0 -0.45"><joint name="{s}_knee" range="-140 0"/>
          <geom name="{s}_shin" fromto="0 0 0 0 0 -0.4" size="0.04" mass="2"/>
          <body name="{s}_foot" pos="0 0 -0.45">
            <joint name="{s}_ankle" range="-45 45" stiffness="5"/>
            <geom name="{s}_foot" fromto="-0.05 0 0 0.15 0 0" size="0.05" mass="1"/></body></body></body>"""
_LEGS = "".join(_LEG.format(s=s, y=y) for s, y in (("left", 0.1), ("right", -0.1)))
_MOTORS = "".join(
    f'<motor name="{s}_{j}" joint="{s}_{j}" gear="{gear}"/>'
    for s in ("left", "right")
    for j, gear in (("hip", 60), ("knee", 40), ("ankle", 20))
)
WALKER = WALKER.replace("LEGS", _LEGS).replace("MOTORS", _MOTORS)
"""Planar, driven, in contact with the floor."""

_ARM = """
      <body name="{s}_upper_arm" pos="0 {y} 0.25"><joint name="{s}_shoulder" type="ball" damping="0.2"/>
        <geom fromto="0 0 0 0 0 -0.28" size="0.04" mass="2"/>
        <body name="{s}_lower_arm" pos="0 0 -0.3"><joint name="{s}_elbow" axis="0 1 0" range="-150 0"/>
          <geom fromto="0 0 0 0 0 -0.25" size="0.03" mass="1.2"/></body></body>"""
_LEG3 = """
      <body name="{s}_thigh" pos="0 {y} -0.2"><joint name="{s}_hip" type="ball" damping="1"/>
        <geom fromto="0 0 0 0 0 -0.35" size="0.06" mass="5"/>
        <body name="{s}_shin" pos="0 0 -0.4"><joint name="{s}_knee" axis="0 1 0" range="0 150"/>
          <geom fromto="0 0 0 0 0 -0.35" size="0.05" mass="3"/>
          <body name="{s}_foot" pos="0 0 -0.4">
            <joint name="{s}_ankle" axis="0 1 0" range="-40 40" stiffness="10"/>
            <geom name="{s}_foot" fromto="-0.06 0 0 0.16 0 0" size="0.04" mass="1"/></body></body></body>"""
HUMANOID = f"""
<mujoco model="humanoid">
  <option timestep="0.002"/>
  <default><joint damping="0.5" armature="0.005"/><geom type="capsule"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.1"/>
    <body name="pelvis" pos="0 0 1.2"><freejoint name="root"/>
      <geom name="trunk" fromto="0 0 -0.1 0 0 0.3" size="0.1" mass="20"/>
      <body name="head" pos="0 0 0.45"><joint name="neck" axis="0 1 0" range="-40 40"/>
        <geom name="head" type="sphere" size="0.09" mass="4"/></body>
      {"".join(_ARM.format(s=s, y=y) for s, y in (("left", 0.2), ("right", -0.2)))}
      {"".join(_LEG3.format(s=s, y=y) for s, y in (("left", 0.1), ("right", -0.1)))}
    </body>
  </worldbody>
</mujoco>"""
"""Passive; it falls to the floor from a small height."""

EVERYTHING = """
<mujoco model="everything">
  <option density="1.2" viscosity="0.001" timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="A" pos="0 0 1" gravcomp="0.3"><freejoint name="base"/>
      <geom size="0.1" pos="0.01 0 0" mass="1"/>
      <body name="B" pos="0.3 0 0" gravcomp="0.5">
        <joint name="a" type="hinge" axis="0 1 0" stiffness="3 0.5 0.2" damping="1 0.3 0.1"
               frictionloss="0.1" limited="true" range="-20 20" actuatorgravcomp="true"
               actuatorfrcrange="-1 1"/>
        <geom size="0.1" pos="0.3 0 0" mass="1"/><site name="s1" pos="0.1 0 0.1"/>
        <body name="C" pos="0.3 0 0"><joint name="b" type="ball" stiffness="2" damping="0.5"/>
          <geom name="tip" size="0.1" pos="0.3 0 0" mass="1"/><site name="s2" pos="0.3 0 0"/>
          <body pos="0.3 0 0"><joint type="slide" axis="1 0 0" armature="0.1"/>
            <geom type="capsule" fromto="0 0 0 0.2 0 0.1" size="0.05" mass="0.4"/></body>
        </body></body></body>
  </worldbody>
  <tendon>
    <fixed name="t" stiffness="7 1 0.2" damping="2 0.2 0.3" springlength="0.1 0.2" frictionloss="0.05">
      <joint joint="a" coef="2"/><joint joint="joint3" coef="1"/></fixed>
    <fixed name="putty" stiffness="7" springyield="0.01"><joint joint="joint3" coef="1"/></fixed>
    <spatial name="sp" stiffness="10" damping="1" springlength="0.1" limited="true"
             range="0 0.5" armature="0.02"><site site="s1"/><site site="s2"/></spatial>
  </tendon>
  <actuator>
    <motor name="m" joint="a" gear="3" damping="0.3" armature="0.01"/>
    <position name="servo" joint="b" gear="1 0 0" kp="3" dampratio="1"/>
    <motor tendon="t" gear="2" damping="0.2 0.1 0.3"/>
    <general joint="a" dyntype="filter" dynprm="0.1"/>
  </actuator>
  <equality><connect name="tie" body1="B" body2="world" anchor="0.1 0 0"/></equality>
</mujoco>""".replace(
    'joint type="slide" axis="1 0 0"', 'joint name="joint3" type="slide" axis="1 0 0"'
)

MOST = EVERYTHING.replace(' armature="0.02"', "")
"""Without the inertia of a tendon, which mechanisms do not have."""


def compiled(xml: str) -> Any:
    """The model of an MJCF text."""
    import mujoco

    return mujoco.MjModel.from_xml_string(xml)


def started(model: Any, speed: float) -> Any:
    """A state with reproducible speeds of the given size."""
    import mujoco

    data = mujoco.MjData(model)
    data.qvel[:] = speed * np.sin(1.0 + np.arange(model.nv))
    return data


def mass_matrix(model: Any, q: Any) -> Any:
    """M(q), by MuJoCo."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_fwdPosition(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M


def sine(model: Any, data: Any) -> None:
    """A control that differs from step to step."""
    data.ctrl[:] = 0.5 * np.sin(5.0 * data.time + np.arange(model.nu))
