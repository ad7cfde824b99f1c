"""What a monitor costs beside MuJoCo's step: the ratio of their times, for 3 and 27 degrees of freedom.

Step and update are timed in turn, in short rounds; the ratio is that of the quickest rounds.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import mujoco
import numpy as np

import deltac as dc

LINK = """<body pos="{at} 0 0"><joint axis="{axis}" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="0.7"/>{rest}</body>"""


def chain(hinges: int) -> str:
    """An MJCF chain of hinges about changing axes, with a motor on the first."""
    rest = ""
    for k in reversed(range(hinges)):
        axis = ("0 1 0", "0 0 1", "1 0 0")[k % 3] if hinges > 3 else "0 1 0"
        rest = LINK.format(at=0.4 if k else 0, axis=axis, rest=rest)
    rest = rest.replace("<joint ", '<joint name="first" ', 1)
    motor = '<actuator><motor joint="first"/></actuator>'
    return (
        f'<mujoco><option timestep="0.001"><flag contact="disable"/></option>'
        f"<worldbody>{rest}</worldbody>{motor}</mujoco>"
    )


def ratio(xml: str, integrator: str, rounds: int) -> tuple[float, float]:
    """Microseconds of a step and of an update."""
    model: Any = mujoco.MjModel.from_xml_string(xml)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    data = mujoco.MjData(model)
    watch = dc.Monitor(model, on_exceed=None).mujoco(model, data)
    best = np.full(2, np.inf)
    for _ in range(rounds):
        spent = np.zeros(2)
        for _ in range(50):
            a = time.perf_counter()
            mujoco.mj_step(model, data)
            b = time.perf_counter()
            watch.update()
            spent += b - a, time.perf_counter() - b
        best = np.minimum(best, spent / 50)
    return float(1e6 * best[0]), float(1e6 * best[1])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=100)
    rounds = parser.parse_args().rounds
    print(
        "| degrees of freedom | integrator | mj_step, µs | update, µs | ratio |\n|---|---|---|---|---|"
    )
    for hinges in (3, 27):
        for integrator in ("euler", "implicitfast", "rk4"):
            step, update = ratio(chain(hinges), integrator, rounds)
            print(f"| {hinges} | {integrator} | {step:.1f} | {update:.1f} | {update / step:.2f} |")
