"""Steps that can be taken in part: of fixed-step solvers on their grid, of SciPy's by dense output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from deltac.arrays import Array
from deltac.simulation.careful import CarefulStep
from deltac.simulation.equations import Controller
from deltac.simulation.fixed import FixedStepper
from deltac.simulation.flow import Flow
from deltac.simulation.projection import SMALLEST_PIVOT
from deltac.simulation.solvers import Solver
from deltac.simulation.stages import Settle, StageRate, numeric_masks


@dataclass(frozen=True)
class Step:
    """A step from (t0, x0) to (t1, x1); `near` gives states within by dense output, `exact` by the solver."""

    t0: float
    x0: Array
    t1: float
    x1: Array
    near: Callable[[float], Array]
    exact: Callable[[float], Array]


class Stepper(Protocol):
    """What takes steps: `attempt` one, then `accept` it, or `restart` from an event within."""

    rate: StageRate

    def attempt(self, t: float, x: Array) -> Step | str:
        """The next step, or words why there is none."""

    def accept(self, step: Step) -> None:
        """Go on from the end of the step."""

    def restart(self, t: float, x: Array, p: Array) -> None:
        """Go on from another state; `p` are the parameters, sides included."""

    def samples(self, after: float, until: float) -> list[float]:
        """Times of samples in (after, until]."""

    def inputs(self, t: float, x: Array) -> Array:
        """The motors' values at a sample."""

    def ahead(self, t: float, x: Array, most: int) -> tuple[Array, Array] | None:
        """Times (m + 1,) and states of the next steps, this one first; None if they go one by one."""

    def skip(self, steps: int) -> list[int]:
        """Accept so many of the steps ahead; which of them are samples."""


class FixedSteps:
    """Steps of a fixed-step solver, from grid point to grid point, and from events to the next one."""

    def __init__(
        self,
        flow: Flow,
        solver: Solver,
        controller: Controller | None,
        p: Array,
        grid: tuple[float, float, int, int],
    ) -> None:
        """`grid` is the start, the step, the number of steps, and how many of them make a sample."""
        self.rate = StageRate(flow, controller, p)
        self._start, self._h, self._steps, self._every = grid
        self._next, self._p, self._held = 1, p, -1
        self._flow = flow
        assert solver.step is not None
        stepper = FixedStepper(flow, solver)
        self._compiled = None
        if flow.traced and controller is None and stepper.fusible:
            self._compiled = stepper.one_step
        self._python, self._parts, self._settle = solver.step, numeric_masks(flow), Settle(flow, p)
        self._careful = None
        if flow.bound is not None and flow.equations is None and controller is None:
            self._careful = CarefulStep(flow, solver, self._parts, p)

    def attempt(self, t: float, x: Array) -> Step | str:
        """To the next point of the grid."""
        if self._held != self._next:  # a controller is asked once a step of the grid
            self.rate.hold(t, x)
            self._held = self._next
        t1 = self._start + self._next * self._h
        x0 = x.copy()

        def exact(time: float) -> Array:
            return self._advance(t, x0, time - t)

        x1 = exact(t1)
        if not np.isfinite(x1).all():
            return (
                f"stopped: the state is not finite at t = {t1:.9g} s; it was last finite at t = {t:.9g} s. "
                "A smaller step may help"
            )
        return Step(t, x0, t1, x1, exact, exact)

    def accept(self, step: Step) -> None:
        """The grid point is reached."""
        self._next += 1

    def restart(self, t: float, x: Array, p: Array) -> None:
        """Steps have no memory."""
        self._p = self.rate.parameters = p
        if t >= self._start + self._next * self._h:
            self._next += 1

    def samples(self, after: float, until: float) -> list[float]:
        """The grid point just reached, if it is a sample."""
        k = self._next - 1
        t = self._start + k * self._h
        return [t] if after < t <= until and k % self._every == 0 else []

    def inputs(self, t: float, x: Array) -> Array:
        """The values held from here on."""
        if self._held != self._next:
            self.rate.hold(t, x)
            self._held = self._next
        return self.rate.held.copy()

    def ahead(self, t: float, x: Array, most: int) -> tuple[Array, Array] | None:
        """From a point of the grid on, as long as the states are finite and constraints independent."""
        done = self._next - 1
        count = min(most, self._steps - done)
        if self._compiled is None or count < 2 or t != self._start + done * self._h:
            return None
        n = len(x)
        times: Array = self._start + (done + np.arange(count + 1.0)) * self._h
        states, worst = np.empty((count + 1, n)), np.empty(count)
        given, out = np.concatenate([x, self._p, [t, self._h]]), np.empty(n + 1)
        states[0], single = x, self._compiled.single
        for k in range(count):
            given[-2] = times[k]
            single(given, out)
            states[k + 1] = given[:n] = out[:n]
            worst[k] = out[n]
        bad = ~np.isfinite(states[1:]).all(axis=1)
        if self._careful is not None:
            bad |= ~(worst > SMALLEST_PIVOT)
        stop = int(np.argmax(bad)) if bad.any() else count
        return times[: stop + 1], states[: stop + 1]

    def skip(self, steps: int) -> list[int]:
        """Go on to a later point of the grid."""
        first = self._next
        self._next += steps
        return [k - first for k in range(first, self._next) if k % self._every == 0]

    def _advance(self, t: float, x: Array, h: float) -> Array:
        if self._compiled is not None:
            out = np.empty(len(x) + 1)
            self._compiled.single(np.concatenate([x, self._p, [t, h]]), out)
            after, worst = out[:-1], out[-1]
        else:
            with np.errstate(all="ignore"):
                stepped = self._python(self.rate, t, x, h, self._parts)
                after, worst = self._settle(t + h, stepped, self._p)
        if self._careful is not None and not worst > SMALLEST_PIVOT:
            return self._careful(t, x, h)
        return after


class AdaptiveSteps:
    """Steps of SciPy's solvers; within them their dense output, and for events the solver again."""

    def __init__(
        self,
        flow: Flow,
        solver: Solver,
        controller: Controller | None,
        p: Array,
        span: tuple[float, float],
        times: Array | None,
        options: dict[str, Any],
    ) -> None:
        """`times` of samples, None for the solver's own steps; `options` of the SciPy method."""
        from scipy import integrate

        self.rate = StageRate(flow, controller, p)
        self._make, self._options = getattr(integrate, solver.name), options
        self._end, self._times, self._following = span[1], times, 1
        self._settle, self._p, self._flow = Settle(flow, p), p, flow
        self._method: Any = None
        self._own: list[float] = []

    def attempt(self, t: float, x: Array) -> Step | str:
        """A step of the method's own length."""
        if self._method is None:
            self._method = self._fresh(t, x, self._end)
        method, x0 = self._method, x.copy()
        with np.errstate(all="ignore"):
            problem = method.step()
        stuck = method.status == "running" and method.t - t < 10 * np.spacing(t)
        if method.status == "failed" or stuck or not np.isfinite(method.y).all():
            reason = "the steps became too small" if stuck else "the state is not finite"
            return (
                f"stopped at t = {t:.9g} s: {problem or reason}; what was computed so far is kept"
            )
        dense, t1 = method.dense_output(), float(method.t)
        end, _ = self._settle(t1, method.y.copy(), self._p)
        if self._flow.projecting:
            method.y = end.copy()
            method.f = self.rate(t1, end)

        def near(time: float) -> Array:
            if time >= t1:
                return end.copy()
            return self._settle(time, np.array(dense(time)), self._p)[0]

        def exact(time: float) -> Array:
            return self._integrated(t, x0, time)

        return Step(t, x0, t1, end, near, exact)

    def accept(self, step: Step) -> None:
        """The method goes on by itself."""
        self._own = [step.t1]

    def restart(self, t: float, x: Array, p: Array) -> None:
        """A new method from here on: it must not remember what was before."""
        self._p = self.rate.parameters = p
        self._method, self._own = None, []

    def samples(self, after: float, until: float) -> list[float]:
        """Those of the grid, or the ends of the steps."""
        if self._times is None:
            return [t for t in self._own if after < t <= until]
        found = []
        while self._following < len(self._times) and self._times[self._following] <= until:
            found.append(float(self._times[self._following]))
            self._following += 1
        return found

    def inputs(self, t: float, x: Array) -> Array:
        """The controller's answer at a sample."""
        return self.rate.hold(t, x)

    def ahead(self, t: float, x: Array, most: int) -> tuple[Array, Array] | None:
        """Its steps are its own."""
        return None

    def skip(self, steps: int) -> list[int]:
        """There are none ahead."""
        return []

    def _fresh(self, t: float, x: Array, end: float) -> Any:
        def f(time: float, state: Array) -> Array:
            return self.rate(time, state)

        return self._make(f, t, x, end, **self._options)

    def _integrated(self, t: float, x: Array, until: float) -> Array:
        if until <= t:
            return x.copy()
        method = self._fresh(t, x, until)
        with np.errstate(all="ignore"):
            while method.status == "running":
                method.step()
        return self._settle(until, np.array(method.y), self._p)[0]
