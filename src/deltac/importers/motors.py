"""The strengths of MuJoCo's simple actuators: what tells whether two models have the same gears."""

from __future__ import annotations

from typing import Any

import numpy as np

from deltac.importers.names import actuator_names

Strengths = dict[str, tuple[float, ...]]


def motor_strengths(model: Any) -> Strengths:
    """Actuator -> gain × gear (6,): force per unit of control, where that is all of its law.

    These are the actuators of fixed gain without a bias; servos and muscles are not among them. A motor
    of several outputs has six numbers for each.
    """
    import mujoco

    found: Strengths = {}
    names = actuator_names(model)
    first = getattr(model, "actuator_outadr", np.arange(len(names)))
    count = getattr(model, "actuator_outnum", np.ones(len(names), dtype=int))
    for k, name in enumerate(names):
        fixed = int(model.actuator_gaintype[k]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        biased = int(model.actuator_biastype[k]) != int(mujoco.mjtBias.mjBIAS_NONE)
        if fixed and not biased:
            gear = np.asarray(model.actuator_gear)[first[k] : first[k] + count[k]].ravel()
            found[name] = tuple(float(x) for x in model.actuator_gainprm[k, 0] * gear)
    return found
