"""A driven arm of two links as a URDF text and as a mechanism."""

from __future__ import annotations

import deltac as dc

ARM = """
<robot name="arm"><link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0.05"/><mass value="1.5"/>
    <inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="0.8"/>
    <inertia ixx="0.005" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-10" upper="LIMIT" effort="100" velocity="100"/><dynamics damping="0.1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><dynamics damping="0.05"/></joint>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type>
    <joint name="shoulder"/><actuator name="lift"/></transmission>
</robot>"""


def mechanism(mass: float = 0.8) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[
            dc.body("upper", 1.5, (0.01, 0.05, 0.05), (0.2, 0, 0.05)),
            dc.body("fore", mass, (0.005, 0.02, 0.02), (0.15, 0, 0)),
        ],
        joints=[
            dc.revolute("shoulder", "ground", "upper", "y", damping=0.1),
            dc.revolute("elbow", "upper", "fore", "y", position=(0.4, 0, 0), damping=0.05),
        ],
        forces=[dc.forces.joint_torque("lift", "shoulder")],
        gravity=(0, 0, -9.81),
    )
