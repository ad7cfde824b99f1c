"""Drake 1.51.1: a URDF joint whose lower limit is above the upper one ends the process by SystemExit."""

from __future__ import annotations

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

URDF = """<robot name="r"><link name="base"/><link name="cart"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="1" upper="-1" effort="0" velocity="0"/></joint></robot>"""
plant = MultibodyPlant(0.0)
Parser(plant).AddModelsFromString(URDF, "urdf")
print(plant.GetJointByName("rail").position_lower_limits())
