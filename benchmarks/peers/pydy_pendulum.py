"""The triple pendulum in PyDy: SymPy's equations through PyDy's code generator, a loop in Python."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec

import numpy as np
import sympy as sp
from pydy.codegen.ode_function_generators import generate_ode_function

from peers.python_loop import LASTING, runge_kutta4
from peers.rival import Array, Pendulum, Rival
from peers.sympy_pendulum import kane, values


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """Its faster generator, where Cython, setuptools and a C compiler are there; else the other."""
    compiled = all(find_spec(name) for name in ("Cython", "setuptools")) and shutil.which("cc")
    generator = "cython" if compiled else "lambdify"
    short, constants, rates = pendulum.lasting(LASTING), values(pendulum), _generated(generator)

    def rate(x: Array) -> Array:
        return rates(x, 0.0, constants).copy()  # it hands out the same array each time

    def run() -> Array:
        start = np.concatenate([short.q, short.u])
        return runge_kutta4(rate, start, short.step, short.steps)[:, :3]

    note = f"generator '{generator}', RK4 in Python, {short.duration:g} s"
    yield Rival("PyDy", run, short.steps, 4, 4, note)


@cache
def _generated(generator: str) -> Callable[[Array, float, Array], Array]:
    """(x, t, constants) -> ẋ; compiled in seconds."""
    equations = kane()
    function: Callable[[Array, float, Array], Array] = generate_ode_function(
        equations.f,
        equations.q,
        equations.u,
        equations.constants,
        mass_matrix=equations.M,
        coordinate_derivatives=sp.Matrix(equations.u),
        generator=generator,
        linear_sys_solver="numpy",
        constants_arg_type="array",
    )
    return function
