"""Drake 1.51.1: limits of a URDF joint of type "continuous", which has none, are enforced."""

from __future__ import annotations

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

URDF = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0" effort="0" velocity="0"/></joint></robot>"""
plant = MultibodyPlant(1e-3)
Parser(plant).AddModelsFromString(URDF, "urdf")
plant.Finalize()
joint = plant.GetJointByName("hinge")
print(joint.position_lower_limits(), joint.position_upper_limits(), "rad")
