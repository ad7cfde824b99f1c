"""SciPy's adaptive solvers on the compiled ẋ."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import SMALL_SHARE, Array
from deltac.kernels import Kernel
from deltac.simulation.flow import StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.interpreted import StageRate
from deltac.simulation.stepping.protocol import Step, StepFailed, Stepper

IMPLICIT = ("Radau", "BDF", "LSODA")


class ScipySteps(Stepper):
    """Steps of a SciPy method's own length; within them its dense output, and for events the method again."""

    on_grid = False

    def __init__(
        self,
        flow: StateFlow,
        solver: Solver,
        rate: StageRate,
        p: Array,
        tolerance: float,
        sizes: Array,
        *,
        compiled: bool,
    ) -> None:
        """Of states with `sizes` (n,).

        `compiled` unless users' functions are called in between, whose derivatives are unknown.
        """
        from scipy import integrate

        self._flow, self._rate, self._p = flow, rate, p
        self._make: Any = getattr(integrate, solver.name)
        self._options: dict[str, Any] = {
            "rtol": max(tolerance, 1e-13),
            "atol": SMALL_SHARE * tolerance * sizes,
        }
        if compiled and solver.name in IMPLICIT:
            self._options["jac"] = self._jacobian()
        self._method: Any = None

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """A step of the method's own length; StepFailed where it gives up."""
        if self._method is None:
            self._method = self._fresh(t, x, until)
        method = self._method
        with np.errstate(all="ignore"):
            problem = method.step()
        # LSODA goes on with steps of no length for ever where the others give up.
        stuck = method.status == "running" and method.t - t < 10 * np.spacing(t)
        if method.status == "failed" or stuck:
            reason = problem or "the steps became too small"
            raise StepFailed(f"{reason}; the run up to here is kept")
        dense = method.dense_output()

        def near(time: float) -> Array:
            return np.array(dense(time))

        def exact(time: float) -> Array:
            return self._integrated(t, x, time)

        return Step(t, x, float(method.t), method.y.copy(), exact, near)

    def accept(self, t: float, x: Array) -> None:
        """The method goes on by itself; from the finished state where a run is projected or corrected."""
        if self._flow.projecting or self._flow.correcting:
            self._method.y, self._method.f = x.copy(), self._rate(t, x)

    def restart(self, t: float, x: Array, p: Array) -> None:
        """A new method from here on: it must not remember what was before."""
        self._p, self._method = p, None

    def _fresh(self, t: float, x: Array, end: float) -> Any:
        return self._make(self._rate, t, x, end, **self._options)

    def _integrated(self, t: float, x: Array, until: float) -> Array:
        if until <= t:
            return x
        method = self._fresh(t, x, until)
        with np.errstate(all="ignore"):
            while method.status == "running":
                method.step()
        if method.status == "failed":
            raise StepFailed(
                "an event within the step could not be met; the run up to here is kept"
            )
        return np.array(method.y)

    def _jacobian(self) -> Any:
        """∂ẋ/∂x, exact and compiled, for implicit methods."""
        flow = self._flow
        inputs = {"t": flow.t, "x": flow.x}
        kernel = Kernel(inputs, {"J": ca.jacobian(flow.xdot, flow.x)}, flow.p, name="jacobian")
        return lambda t, x: kernel(t=t, x=x, parameters=self._p)["J"][0]
