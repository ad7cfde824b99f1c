"""MuJoCo's motions: contacts, controls that are held, soft constraints; and models that were not run."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from verdict_runs import Case

import deltac as dc

ARM = """
<mujoco model="arm"><option gravity="0 0 -9.81"><flag contact="disable"/></option>
 <worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="0.05"/>
   <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
   <body name="lower" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/></body></body>
 </worldbody>
 <actuator><motor name="m1" joint="shoulder" gear="3"/><motor name="m2" joint="elbow"/></actuator>
</mujoco>"""

DROP = """
<mujoco model="drop"><option gravity="0 0 -9.81"/>
 <worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body name="brick" pos="0 0 0.5" euler="20 30 0"><freejoint name="brick"/>
   <geom name="brick" type="box" size=".1 .2 .05" mass="2"/></body>
 </worldbody>
</mujoco>"""

HOPPER = """
<mujoco model="hopper"><option gravity="0 0 -9.81"/>
 <default><geom contype="0" conaffinity="0"/></default>
 <worldbody>
  <geom name="floor" type="plane" size="5 5 .1" contype="1" conaffinity="1"/>
  <body name="base" pos="0 0 0.5"><freejoint name="base"/>
   <geom name="hull" type="box" size=".2 .1 .05"/>
   <body name="leg" pos="0 0 0">
    <joint name="hip" axis="0 1 0" damping="0.3" stiffness="20"/>
    <geom name="shin" type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>
    <geom name="foot" type="sphere" pos="0 0 -.3" size=".04" contype="1" conaffinity="1"/></body>
  </body>
 </worldbody>
</mujoco>"""

LOOP = """
<mujoco model="loop"><option gravity="0 0 -9.81"><flag contact="disable"/></option>
 <worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0" damping="0.01"/>
   <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/>
   <body name="coupler" pos="0 0 0.2"><joint name="pin" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02"/></body></body>
  <body name="rocker" pos="0.4 0 0"><joint name="rocker" axis="0 1 0" frictionloss="0.02"/>
   <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/></body>
 </worldbody>
 <equality><connect name="tip" body1="coupler" body2="rocker" anchor="0.4 0 0"/></equality>
</mujoco>"""

MODELS = {"arm": ARM, "drop": DROP, "hopper": HOPPER, "loop": LOOP}
PUSHED = {
    "arm": (0.0, 0.0),
    "drop": (1.0, 0.5, 0.0, 1.0, -2.0, 0.5),
    "hopper": (0.3,),
    "loop": (3.0,),
}
INTEGRATORS = ("euler", "rk4", "implicit", "implicitfast")


def mujoco_right(seed: int) -> Iterator[Case]:
    """Each model by each integrator, recorded with its forces, handed over with and without u̇."""
    draw = random.Random(f"MuJoCo {seed}")
    for name, xml in MODELS.items():
        for integrator in INTEGRATORS:
            for bare in (False, True):
                coarse = draw.choice((0.002, 0.004, 0.01))
                runs = _runs(name, xml, integrator, coarse, held=name == "arm")
                yield Case(
                    f"MuJoCo {name}, {integrator}, h = {coarse:g} s{', no accelerations' * bare}",
                    "right: MuJoCo",
                    True,
                    _model(xml),
                    _without_accelerations(runs) if bare else runs,
                    (coarse, coarse / 2, coarse / 4),
                )


def mujoco_wrong(seed: int) -> Iterator[Case]:
    """Logs of other models than the one they are judged against."""
    draw = random.Random(f"MuJoCo wrong {seed}")
    for name, xml in MODELS.items():
        for what, change in CHANGES.items():
            other = _model(xml)
            change(other)
            integrator, coarse = draw.choice(INTEGRATORS), draw.choice((0.002, 0.004))
            runs = _runs(name, xml, integrator, coarse, held=name == "arm")
            bare = draw.random() < 0.5
            yield Case(
                f"MuJoCo {name}: model with {what}, {integrator}, h = {coarse:g} s"
                f"{', no accelerations' * bare}",
                "wrong: MuJoCo",
                False,
                other,
                _without_accelerations(runs) if bare else runs,
                (coarse, coarse / 2, coarse / 4),
            )


def _heavier(model: Any) -> None:
    model.body_mass[-1] *= 1.02


def _lighter_world(model: Any) -> None:
    model.opt.gravity[2] *= 0.99


def _longer(model: Any) -> None:
    model.body_ipos[-1] += np.array([0.01, 0.0, 0.01])


CHANGES: dict[str, Callable[[Any], None]] = {
    "2 % more mass in one body": _heavier,
    "1 % less gravity": _lighter_world,
    "one mass centre 1 cm off": _longer,
}


def _model(xml: str) -> Any:
    import mujoco

    return mujoco.MjModel.from_xml_string(xml)


def _runs(
    name: str, xml: str, integrator: str, coarse: float, *, held: bool
) -> Callable[[float], dc.Trajectory]:
    import mujoco

    model = _model(xml)
    data = mujoco.MjData(model)
    data.qvel[: len(PUSHED[name])] = PUSHED[name]

    def control(_: Any, data: Any) -> None:
        data.ctrl[:] = [0.3 * np.sin(3 * data.time), 0.1 * np.cos(5 * data.time)]

    return dc.mujoco_simulator(
        copy.copy(model),
        200 * coarse,
        integrator=integrator,
        controller=control if held else None,
        state=data,
    )


def _without_accelerations(
    runs: Callable[[float], dc.Trajectory],
) -> Callable[[float], dc.Trajectory]:
    def run(step: float) -> dc.Trajectory:
        return replace(runs(step), udot=None)

    return run
