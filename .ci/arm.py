"""An arm.xml and a run.csv for the README's second command: the log has another damper than the model."""

from __future__ import annotations

from pathlib import Path

import mujoco

import deltac as dc

ARM = """
<mujoco model="arm"><option timestep="0.002" integrator="RK4"/><worldbody>
 <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="{damping}"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
  <body name="forearm" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" damping="0.02"/>
   <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/></body></body>
</worldbody></mujoco>"""

Path("arm.xml").write_text(ARM.format(damping=0.05))
machine = mujoco.MjModel.from_xml_string(ARM.format(damping=0.08))
dc.run_mujoco(machine, 2.0).write("run.csv")
