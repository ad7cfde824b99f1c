"""PyBullet 3.2.7: a moving URDF link without <inertial> weighs 1 kg, with moments of 1 kg·m²; it warns."""

from __future__ import annotations

import tempfile

import pybullet

URDF = """<robot name="r"><link name="base"/><link name="frame"/><joint name="hinge" type="continuous">
<parent link="base"/><child link="frame"/><axis xyz="0 1 0"/></joint></robot>"""
with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
    file.write(URDF)
    file.flush()
    pybullet.connect(pybullet.DIRECT)
    robot = pybullet.loadURDF(file.name, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
mass, _, moments = pybullet.getDynamicsInfo(robot, 0)[:3]
print(mass, "kg", moments, "kg·m²")
