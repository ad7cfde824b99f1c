"""PyBullet 3.2.7 sets an inertia that breaks the triangle inequality to zero; it warns."""

from __future__ import annotations

import tempfile

import pybullet

URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="0.5"/>
<inertia ixx="0.002" iyy="0.1" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge"
type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""
with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
    file.write(URDF)
    file.flush()
    pybullet.connect(pybullet.DIRECT)
    robot = pybullet.loadURDF(file.name, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
mass, _, moments = pybullet.getDynamicsInfo(robot, 0)[:3]
print(mass, "kg", moments, "kg·m²")
