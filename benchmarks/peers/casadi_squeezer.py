"""Andrews' squeezer by SUNDIALS through CasADi's `integrator`, on deltac's own equations: x → ẋ in symbols.

Common subexpressions are taken out before, as deltac does. CasADi interprets the equations and their exact
Jacobians, or compiles them as C (its option `jit`) where there is a compiler.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.simulation.flow import StateFlow

Array = NDArray[np.float64]
METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    "IDA": ("idas", {}),
    "CVODES Adams": (
        "cvodes",
        {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"},
    ),
}
"""Name -> CasADi's plugin and its options. IDA uses Newton's method and Jacobians; Adams needs neither."""


@dataclass(frozen=True, eq=False)
class Sundials:
    """A method on the equations of a flow; `compiler` of its equations as C, None to interpret them."""

    method: str
    flow: StateFlow
    start: Array
    duration: float
    compiler: str | None = None

    @property
    def name(self) -> str:
        """The method, and what evaluates its equations."""
        how = "interpreted" if self.compiler is None else "compiled as C by cc -O3"
        return f"SUNDIALS {self.method}, {how}"

    def integrator(self, tolerance: float) -> ca.Function:
        """From x at the start to x at the end: `xf` of a call with `x0`."""
        plugin, options = METHODS[self.method]
        flow, within = self.flow, {"reltol": tolerance, "abstol": tolerance / 10}
        equations = {"t": flow.t, "x": flow.x, "ode": ca.cse(flow.xdot)}
        # The files of what is compiled go to the working folder; the library stays loaded without them.
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            return ca.integrator(
                "rival",
                plugin,
                equations,
                0.0,
                self.duration,
                {**options, **within, **self._compiling(), "max_num_steps": 10**6},
            )

    def end(self, integrator: ca.Function) -> Array:
        """The state at the end."""
        return np.array(integrator(x0=self.start)["xf"]).ravel()

    def _compiling(self) -> dict[str, Any]:
        """CasADi's options for it."""
        if self.compiler is None:
            return {}
        tools = {"compiler": self.compiler, "linker": self.compiler}
        how = {"flags": ["-O3", "-march=native"], "cleanup": False}
        return {
            "jit": True,
            "jit_cleanup": False,
            "compiler": "shell",
            "jit_options": {**tools, **how},
        }


def rivals(flow: StateFlow, start: Array, duration: float) -> Iterator[Sundials]:
    """Both methods; interpreted, and compiled where there is a compiler."""
    for compiler in dict.fromkeys((None, shutil.which("cc"))):
        for method in METHODS:
            yield Sundials(method, flow, start, duration, compiler)
