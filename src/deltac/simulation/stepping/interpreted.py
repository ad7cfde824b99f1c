"""Steps taken from Python: ẋ, with controllers and equations of users, and what follows each step."""

from __future__ import annotations

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.calls.caching import derived
from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.simulation.constraints.energy import energy_correction
from deltac.simulation.constraints.projection import pivot, projection
from deltac.simulation.equations import Controller, motor_values
from deltac.simulation.flow import StateFlow


def settled(flow: StateFlow, t: SX, x: SX) -> tuple[SX, SX]:
    """The state back on its constraints, and the smallest pivot there (1 without constraints)."""
    if flow.projecting:
        projected, worst = projection(flow)(t, x, flow.p)
        return projected, worst
    if flow.bound is not None and flow.own is None:
        return x, pivot(flow)(t, x, flow.p)
    return x, ca.SX(1)


@derived
def settle_kernel(flow: StateFlow) -> Kernel | None:
    """What is done to a state after each step: unit quaternions, and back on the constraints.

    (t, x, p) -> x and the smallest pivot; None where there is nothing to be done.
    """
    if flow.bound is None and not flow.quaternions:
        return None
    x, worst = settled(flow, flow.t, flow.normalised(flow.x))
    return flow.kernel("projection", {"x": x, "worst": worst})


@derived
def _correction_kernel(flow: StateFlow) -> Kernel:
    """(t, x; p, h) -> x with its energy as it should be."""
    h = ca.SX.sym("h")
    corrected = energy_correction(flow)(flow.t, flow.x, flow.p, h)
    return flow.kernel("energy correction", {"x": corrected}, h=h)


class Finish:
    """What a run does to a state after each step: unit quaternions, projection, the energy corrected.

    Nothing is compiled before the first call: steps that are compiled as a whole hold all this themselves.
    """

    def __init__(self, flow: StateFlow, p: Array) -> None:
        """`p` are the values of the parameters."""
        self._flow, self._p = flow, p
        self._ready = False

    def restart(self, p: Array) -> None:
        """Other values of the parameters from here on."""
        self._p, self._ready = p, False

    def __call__(self, t: float, x: Array, h: float) -> tuple[Array, float]:
        """The state after a step of length h, finished, and the smallest pivot of its constraints."""
        if not self._ready:
            self._prepare()
        worst, n = 1.0, len(x)
        if self._settle is not None:
            self._in[0], self._in[1 : 1 + n] = t, x
            self._settle.single(self._in, self._out)
            x, worst = self._out[:-1].copy(), float(self._out[-1])
        if self._correct is not None:
            inputs = self._corrected_in
            inputs[0], inputs[-1], inputs[1 : 1 + n] = t, h, x
            x = self._correct.single(inputs, self._corrected_out).copy()
        return x, worst

    def _prepare(self) -> None:
        flow, p, n = self._flow, self._p, self._flow.x.shape[0]
        self._settle = settle_kernel(flow)
        self._correct = _correction_kernel(flow) if flow.correcting else None
        self._in, self._out = np.concatenate([np.zeros(1 + n), p]), np.empty(n + 1)
        self._corrected_in = np.concatenate([np.zeros(1 + n), p, [0.0]])
        self._corrected_out, self._ready = np.empty(n), True


@derived
def _rate_kernels(flow: StateFlow) -> tuple[Kernel, Kernel]:
    """ẋ, and the full state that a controller sees."""
    values = {"t": flow.t, "x": flow.x}
    extra = {"inputs": flow.inputs, "accelerations": flow.accelerations}
    inputs = {**values, **{name: e for name, e in extra.items() if e.shape[0]}}
    rate = Kernel(inputs, {"xdot": flow.xdot}, flow.p, name="rate")
    return rate, Kernel(values, {"q": flow.q_all, "u": flow.u_all}, flow.p, name="state")


class StageRate:
    """ẋ(t, x) with a controller, or with equations that are called from Python; compiled when first asked."""

    def __init__(self, flow: StateFlow, controller: Controller | None, p: Array) -> None:
        """`p` are the values of the parameters, which may change along the run."""
        self._flow, self._controller = flow, controller
        self._in: Array | None = None
        self.parameters = p
        self.held = np.zeros(flow.inputs.shape[0])

    def hold(self, t: float, x: Array) -> Array:
        """Ask the controller at the start of a step (and at samples); returns the motors' values."""
        if self._controller is not None:
            self.held = self._asked(t, x)
        return self.held

    def motors(self, t: float, x: Array) -> Array:
        """The motors' values at a state: those held, or the answer of a controller that acts within steps."""
        if self._controller is None or self._controller.hold:
            return self.held
        return self._asked(t, x)

    def __call__(self, t: float, x: Array) -> Array:
        """ẋ."""
        if self._in is None:
            self._prepare()
        flow, places, inputs = self._flow, self._places, self._in
        assert inputs is not None
        inputs[0], inputs[places["x"]] = t, x
        if "inputs" in places:
            inputs[places["inputs"]] = self.motors(t, x)
        if "accelerations" in places:
            inputs[places["accelerations"]] = flow.by_hand(t, x, self.parameters)
        p = self.parameters if len(self.parameters) else None
        return self._rate.single(inputs, self._out, p).copy()

    def batch(self, t: Array, x: Array) -> Array:
        """ẋ (T, n) of many states (T, n); one by one where something is called from Python."""
        if self._in is None:
            self._prepare()
        if len(self._places) > 2:
            return np.array([self(float(time), state) for time, state in zip(t, x)])
        p = self.parameters if len(self.parameters) else None
        return self._rate.flat(np.vstack([t, x.T]), p).T

    def _prepare(self) -> None:
        self._rate, _ = _rate_kernels(self._flow)
        self._places = self._rate.input_slices
        self._in, self._out = np.empty(self._rate.n_in), np.empty(self._rate.n_out)

    def _asked(self, t: float, x: Array) -> Array:
        """The controller's answer, checked, in the order of `System.inputs`."""
        assert self._controller is not None
        _, full = _rate_kernels(self._flow)
        state = full(t=t, x=x, parameters=self.parameters if len(self.parameters) else None)
        return motor_values(
            self._controller, self._flow.system, t, state["q"].ravel(), state["u"].ravel()
        )
