"""Drake 1.51.1: a URDF link of mass 0 with an inertia becomes a ball of 1 kg; the log has a warning."""

from __future__ import annotations

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

URDF = """<robot name="r"><link name="base"/><link name="foot"><inertial><mass value="0"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="fixed" type="fixed"><parent link="base"/><child link="foot"/></joint></robot>"""
plant = MultibodyPlant(0.0)
Parser(plant).AddModelsFromString(URDF, "urdf")
plant.Finalize()
print(plant.GetBodyByName("foot").default_mass(), "kg")
