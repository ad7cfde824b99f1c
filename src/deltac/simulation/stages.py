"""Steps taken from Python: ẋ stage by stage, what is done to a state after a step, the loop of it all."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TypeAlias

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.equations_of_motion import quaternions
from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.simulation.correction import energy_correction
from deltac.simulation.course import Course, Motion
from deltac.simulation.equations import Controller
from deltac.simulation.flow import Flow
from deltac.simulation.projection import pivot, projection
from deltac.simulation.solvers.solver import Parts


def settled(flow: Flow, t: SX, x: SX) -> tuple[SX, SX]:
    """The state back on its constraints, and the smallest pivot there (1 without constraints)."""
    if flow.projecting:
        projected, worst = projection(flow)(t, x, flow.p)
        return projected, worst
    if flow.bound is not None and flow.own is None:
        return x, pivot(flow)(t, x, flow.p)
    return x, ca.SX(1)


@lru_cache(maxsize=64)
def settle_kernel(flow: Flow) -> Kernel | None:
    """What is done to a state after each step: unit quaternions, and back on the constraints.

    (t, x, p) -> x and the smallest pivot; None where there is nothing to be done.
    """
    if flow.bound is None and (flow.own is not None or not quaternions(flow.system.mechanism)):
        return None
    x, worst = settled(flow, flow.t, flow.normalised(flow.x))
    inputs = {"t": flow.t, "x": flow.x, **({"p": flow.p} if flow.p.shape[0] else {})}
    return Kernel(inputs, {"x": x, "worst": worst}, name="projection")


class Settle:
    """`settle_kernel` for one state at a time."""

    def __init__(self, flow: Flow, p: Array) -> None:
        """Compile it; `p` are the values of the parameters."""
        self._kernel = settle_kernel(flow)
        self._in = np.concatenate([np.zeros(1 + flow.x.shape[0]), p])
        self._out = np.empty(flow.x.shape[0] + 1)

    def __call__(self, t: float, x: Array, p: Array | None = None) -> tuple[Array, float]:
        """The settled state, and the smallest pivot of its constraints; `p` if the parameters changed."""
        if self._kernel is None:
            return x, 1.0
        if p is not None:
            self._in[1 + len(x) :] = p
        self._in[0], self._in[1 : 1 + len(x)] = t, x
        self._kernel.single(self._in, self._out)
        return self._out[:-1].copy(), float(self._out[-1])


@lru_cache(maxsize=64)
def _correction_kernel(flow: Flow) -> Kernel:
    """(t, x; p, h) -> x with its energy as it should be."""
    h = ca.SX.sym("h")
    corrected = energy_correction(flow)(flow.t, flow.x, flow.p, h)
    inputs = {"t": flow.t, "x": flow.x, "constants": ca.vertcat(flow.p, h)}
    return Kernel(inputs, {"x": corrected}, name="energy correction")


class Correct:
    """`energy_correction` for one state at a time, where a run asks for it."""

    def __init__(self, flow: Flow, p: Array, h: float) -> None:
        """Compile it; `p` are the values of the parameters, `h` is the step."""
        self._kernel: Kernel | None = None
        if not flow.correcting:
            return
        self._kernel = _correction_kernel(flow)
        self._in = np.concatenate([np.zeros(1 + flow.x.shape[0]), p, [h]])
        self._out = np.empty(flow.x.shape[0])

    def __call__(self, t: float, x: Array) -> Array:
        """The state with its energy as it should be."""
        if self._kernel is None:
            return x
        self._in[0], self._in[1 : 1 + len(x)] = t, x
        return self._kernel.single(self._in, self._out).copy()


@lru_cache(maxsize=64)
def _rate_kernels(flow: Flow) -> tuple[Kernel, Kernel]:
    """ẋ, and the full state that a controller sees."""
    values = {"t": flow.t, "x": flow.x}
    extra = {"inputs": flow.inputs, "given": flow.given}
    inputs = {**values, **{name: e for name, e in extra.items() if e.shape[0]}}
    rate = Kernel(inputs, {"xdot": flow.xdot}, flow.p, name="rate")
    return rate, Kernel(values, {"q": flow.q_all, "u": flow.u_all}, flow.p, name="state")


class StageRate:
    """ẋ(t, x) with a controller, or with equations that are called from Python."""

    def __init__(self, flow: Flow, controller: Controller | None, p: Array) -> None:
        """Compile ẋ; `p` are the values of the parameters."""
        self._flow, self._controller = flow, controller
        self._rate, self._state = _rate_kernels(flow)
        self.parameters = p
        self._in, self._out = np.empty(self._rate.n_in), np.empty(self._rate.n_out)
        self._places = self._rate.input_slices
        self.held = np.zeros(flow.inputs.shape[0])

    def hold(self, t: float, x: Array) -> Array:
        """Ask the controller at the start of a step (and at samples); returns the motors' values."""
        if self._controller is not None:
            self.held = self._asked(t, x)
        return self.held.copy()

    def __call__(self, t: float, x: Array) -> Array:
        """ẋ."""
        flow, places = self._flow, self._places
        self._in[0], self._in[places["x"]] = t, x
        if "inputs" in places:
            asked = self._controller is not None and not self._controller.hold
            self._in[places["inputs"]] = self._asked(t, x) if asked else self.held
        if "given" in places:
            assert flow.equations is not None
            q, u, _ = flow.parts
            self._in[places["given"]] = flow.equations(t, x[q].copy(), x[u].copy())
        p = self.parameters if len(self.parameters) else None
        return self._rate.single(self._in, self._out, p).copy()

    def batch(self, t: Array, x: Array) -> Array:
        """ẋ (T, n) of many states (T, n), where nothing is called from Python."""
        p = self.parameters if len(self.parameters) else None
        return self._rate.flat(np.vstack([t, x.T]), p).T

    def _asked(self, t: float, x: Array) -> Array:
        """The controller's answer, checked, in the order of `System.inputs`."""
        from deltac.simulation.control import motor_values

        assert self._controller is not None
        state = self._state(t=t, x=x, parameters=self.parameters if len(self.parameters) else None)
        return motor_values(
            self._controller, self._flow.system, t, state["q"].ravel(), state["u"].ravel()
        )


def symbolic_masks(flow: Flow) -> Parts:
    """The masks of q, u and integrals as CasADi's columns."""
    masks = []
    for place in flow.parts:
        mask = ca.DM.zeros(flow.x.shape[0])
        mask[place] = 1
        masks.append(mask)
    return Parts(*masks)


def numeric_masks(flow: Flow) -> Parts:
    """The masks of q, u and integrals as arrays."""
    masks = symbolic_masks(flow)
    return Parts(*(np.array(mask).ravel() for mask in (masks.q, masks.u, masks.z)))


Advance: TypeAlias = Callable[[float, float, Array, Array], Array | str]
"""(t, t + h, x, motors' values) -> the state after the step, or in words why there is none."""


def march(course: Course, rate: StageRate, advance: Advance) -> Motion:
    """Take steps one by one from Python, the motors asked in between, until one cannot be taken."""
    x, held, message = course.x0.copy(), rate.hold(course.t0, course.x0), ""
    kept = [(course.t0, x.copy(), held)]
    for k in range(course.steps):
        t, following = course.t0 + k * course.h, course.t0 + (k + 1) * course.h
        after = advance(t, following, x, held)
        if isinstance(after, str):
            message = after
            if k % course.every:
                kept.append((t, x.copy(), held))
            break
        x, held = after, rate.hold(following, after)
        if (k + 1) % course.every == 0:
            kept.append((following, x.copy(), held))
        if course.progress is not None and k % 64 == 63:
            course.progress((k + 1) / course.steps)
    times, states, inputs = (np.array(column) for column in zip(*kept))
    return Motion(times, states, inputs, message)
