"""The triple pendulum in Pinocchio: articulated bodies in C++, called from a Runge–Kutta loop in Python."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from peers.python_loop import LASTING, runge_kutta4
from peers.rival import ALONG, Array, Pendulum, Rival


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """Pinocchio has no integrator of its own for this."""
    short, model = pendulum.lasting(LASTING), _model(pendulum)
    data, tau, rates = model.createData(), np.zeros(3), np.empty(6)

    def rate(x: Array) -> Array:
        rates[:3] = x[3:]
        rates[3:] = pin.aba(model, data, x[:3], x[3:], tau)
        return rates.copy()

    def run() -> Array:
        start = np.concatenate([short.q, short.u])
        return runge_kutta4(rate, start, short.step, short.steps)[:, :3]

    yield Rival("Pinocchio aba", run, short.steps, 4, 4, f"RK4 in Python, {short.duration:g} s")


def _model(pendulum: Pendulum) -> pin.Model:
    model, above = pin.Model(), 0
    bars = zip(pendulum.masses, pendulum.lengths, pendulum.inertias, pendulum.offsets)
    for n, (m, l, I, offset) in enumerate(bars, 1):
        place = pin.SE3(np.eye(3), np.array([0.0, -offset, 0.0]))
        above = model.addJoint(above, pin.JointModelRZ(), place, f"joint{n}")
        inertia = pin.Inertia(m, np.array([0.0, -l / 2, 0.0]), np.diag([I, ALONG, I]))
        model.appendBodyToJoint(above, inertia, pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, -pendulum.gravity, 0.0])
    return model
