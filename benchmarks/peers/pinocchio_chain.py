"""Chains of hinges in Pinocchio: articulated bodies, called from Python for a state, or for a batch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from measure import median_seconds
from numpy.typing import NDArray

import deltac as dc
from deltac.kernels.parallel import cores

Array = NDArray[np.float64]
CALLS = 200
AGREE = 1e-6
"""Of the accelerations, relative to the largest: long chains amplify rounding."""


def measured(mechanism: dc.Mechanism, x: Array, udot: Array, rounds: int) -> dict[str, Any]:
    """Nanoseconds a state, once the accelerations are ours; x = (q, u) and udot have a column a state.

    `pinocchio_batch_ns` is `abaInParallel` on all cores; only builds with OpenMP have it.
    """
    made = model(mechanism)
    data, (q, u) = made.createData(), np.split(x[:, 0].copy(), 2)
    tau = np.zeros(len(q))

    def repeat() -> None:
        for _ in range(CALLS):
            pin.aba(made, data, q, u, tau)

    off = _off(mechanism, pin.aba(made, data, q, u, tau), udot[:, 0])
    found = {"pinocchio_ns": 1e9 * median_seconds(repeat, rounds) / CALLS, "pinocchio_off": off}
    if not hasattr(pin, "abaInParallel"):
        return found
    pool = pin.ModelPool(made, cores())
    Q, U = (
        np.asfortranarray(part) for part in np.split(x, 2)
    )  # a state in a piece, as it wants them
    batch = (cores(), pool, Q, U, np.zeros(Q.shape, order="F"))
    _off(mechanism, pin.abaInParallel(*batch), udot)
    per_batch = median_seconds(lambda: pin.abaInParallel(*batch), rounds)
    return {**found, "pinocchio_batch_ns": 1e9 * per_batch / x.shape[1]}


def model(mechanism: dc.Mechanism) -> pin.Model:
    """A chain of hinges with numbers for parameters."""
    made, places = pin.Model(), {"ground": 0}
    for joint in mechanism.joints:
        body = mechanism.body(joint.child)
        kind = pin.JointModelRevoluteUnaligned(np.array(joint.axes[0]))
        place = pin.SE3(np.array(joint.rotation), np.array(joint.position, dtype=float))
        places[joint.child] = made.addJoint(places[joint.parent], kind, place, joint.name)
        inertia = pin.Inertia(
            float(body.mass), np.array(body.mass_centre, float), np.array(body.inertia, float)
        )
        made.appendBodyToJoint(places[joint.child], inertia, pin.SE3.Identity())
    made.gravity.linear = np.array(mechanism.gravity, dtype=float)
    return made


def _off(mechanism: dc.Mechanism, found: Array, udot: Array) -> float:
    off = float(np.abs(found - udot).max() / np.abs(udot).max())
    assert off < AGREE, f"{mechanism.name}: deltac and Pinocchio differ by {off:.1e}"
    return off
