"""heyoka's adaptive Taylor method, in double and quadruple precision: the reference."""

from __future__ import annotations

import copy
import math
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array, max_norm
from deltac.calls.interrupts import waiting
from deltac.dynamics.forces import channels
from deltac.errors import SolverError, requirement
from deltac.simulation.flow import StateFlow
from deltac.simulation.stepping.protocol import CHUNK, FinishedStates, Step, StepGrid, Stepper

KINKED = (
    "FABS",
    "SIGN",
    "FMIN",
    "FMAX",
    "LT",
    "LE",
    "EQ",
    "NE",
    "NOT",
    "AND",
    "OR",
    "FLOOR",
    "CEIL",
    "FMOD",
    "COPYSIGN",
    "IF_ELSE_ZERO",
)


class TaylorSteps(Stepper):
    """Taylor's method from sample to sample; its own steps within, and its state, are its own.

    The state is kept in the method's precision, and only what is recorded is rounded. Each is a share of
    its size, since the method goes by the largest of all; sizes are powers of two, so that scaling rounds
    nothing.
    """

    def __init__(
        self, flow: StateFlow, p: Array, tolerance: float | None, sizes: Array, *, quad: bool
    ) -> None:
        """Its order follows from the tolerance, whose default is the precision of the numbers.

        Raises InputError where heyoka is not installed.
        """
        with requirement(
            "solver 'taylor' needs heyoka, which is not installed: pip install 'deltac[taylor]' (Linux), "
            "or use 'DOP853' with tolerance=1e-13"
        ):
            import heyoka as hy
        self._flow, self._tolerance = flow, tolerance
        self._real: Any = hy.real128 if quad else float
        self._quaternions = flow.quaternions
        self._sizes = np.exp2(np.round(np.log2(sizes)))
        self._p, self._at, self._pair = p, math.nan, dict[tuple[float, ...], tuple[Any, Any]]()

    @property
    def _methods(self) -> tuple[Any, Any]:
        """The integrator of the run, and one for parts of its steps; others where a law switches.

        Copies: threads may run the same mechanism at once. Raises InputError for laws that are not smooth.
        """
        key = tuple(self._p.tolist())
        if key not in self._pair:
            template = _taylor_method(self._flow, key, self._tolerance, self._real)
            self._pair[key] = copy.copy(template), copy.copy(template)
            for method in self._pair[key]:
                used = len(method.pars)  # those of states that neither change nor act are left out
                method.pars[:] = self._sizes[:used].astype(self._real)
        return self._pair[key]

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """Steps up to `until`; for events the method again, from the start."""
        method, probe = self._methods

        def exact(time: float) -> Array:
            if time <= t:
                return x
            self._place(probe, t, x)
            probe.propagate_until(self._real(time))
            return self._state(probe.state)

        if self._at != t:
            self._place(method, t, x)
            method.propagate_until(self._real(t + self._first(method, until - t)))
        method.propagate_until(self._real(until))
        self._at = until
        return Step(t, x, until, self._state(method.state), exact)

    def accept(self, t: float, x: Array) -> None:
        """The method goes on by itself, unless it is ahead of what is accepted."""
        if self._at != t:
            self._at = math.nan

    def restart(self, t: float, x: Array, p: Array) -> None:
        """From another state, and with other parameters."""
        self._p, self._at = p, math.nan

    def ahead(self, grid: StepGrid, k: int, x: Array, most: int) -> FinishedStates | None:
        """The next samples."""
        count = min(most, CHUNK, grid.count - k)
        times, (method, _), limit = grid.times(k, count + 1), self._methods, {}
        if self._at != times[0]:
            self._place(method, times[0], x)
            times = times[:2]
            limit = {"max_delta_t": self._real(self._first(method, times[1] - times[0]))}
        outcome = method.propagate_grid(times.astype(self._real), **limit)
        values = self._state(outcome[-1])[1:]
        # What was not reached is not finite.
        states = np.full((len(times) - 1, len(x)), np.nan)
        states[: len(values)] = values
        self._at = float(times[-1])
        for place in self._quaternions:
            states[:, place] /= np.linalg.norm(states[:, place], axis=1, keepdims=True)
        return FinishedStates(states)

    def _place(self, method: Any, t: float, x: Array) -> None:
        method.time = self._real(t)
        method.state[:] = (x / self._sizes).astype(self._real)

    def _state(self, shares: Any) -> Array:
        """States in their units."""
        return np.asarray(shares).astype(np.float64) * self._sizes

    def _first(self, method: Any, most: float) -> float:
        """A safe length of the first step, from all Taylor coefficients at the start.

        The method goes by the last two orders only, and at a start from rest these may vanish by symmetry.
        """
        t, x = method.time, np.array(method.state)
        method.step(max_delta_t=self._real(0.0), write_tc=True)
        coefficients = np.abs(np.asarray(method.tc).astype(np.float64))
        method.state[:] = x
        method.time = t
        size = max(1.0, max_norm(x.astype(np.float64)))
        orders = np.arange(1, coefficients.shape[1])
        largest = coefficients[:, 1:].max(axis=0)
        with np.errstate(divide="ignore"):
            radius = float(np.min((size / largest) ** (1.0 / orders)))
        return min(most, radius / math.e**2)


@lru_cache(maxsize=32)
def _taylor_method(
    flow: StateFlow, p: tuple[float, ...], tolerance: float | None, real: type[Any]
) -> Any:
    """Heyoka's integrator of the flow, at no state in particular: made once, or from the disk cache.

    Its states are shares of their sizes, which are its parameters.
    """
    import heyoka as hy

    from deltac.kernels import compiled, prepare_heyoka, to_heyoka

    # With numbers for the parameters, a law whose branches are held is one of its branches.
    xdot = ca.densify(ca.substitute(flow.xdot, flow.p, ca.DM(p))) if p else ca.densify(flow.xdot)
    function = ca.Function("xdot", [flow.t, flow.x], [ca.cse(xdot)])
    _require_smooth(flow, function)
    source = ("shares of sizes", prepare_heyoka(), real.__name__, tolerance, function.serialize())

    def made() -> Any:
        names = [hy.expression(f"x{k}") for k in range(flow.x.shape[0])]
        states = [hy.par[k] * x for k, x in enumerate(names)]
        (rates,) = to_heyoka(function, [[hy.time], states])
        rates = [rate / hy.par[k] for k, rate in enumerate(rates)]
        options: dict[str, Any] = {"tol": real(tolerance)} if tolerance is not None else {}
        nowhere = np.zeros(len(names)).astype(real)
        return hy.taylor_adaptive(
            list(zip(names, rates)), nowhere, fp_type=real, compact_mode=True, **options
        )

    return compiled(repr(source), lambda: waiting(made))


def _require_smooth(flow: StateFlow, function: Any) -> None:
    """InputError if ẋ, as a function, has a kink anywhere, naming the law where one is to blame."""
    if not _has_kink(function):
        return
    system, where = flow.system, "the equations of motion"
    laws = {f"the force of channel {str(c.name)!r}": c.force for c in channels(system)}
    for joint in system.mechanism.joints:
        laws[f"the motion of joint {joint.name!r}"] = ca.SX(system.vector(joint.motion))
    for name, law in laws.items():
        if _has_kink(ca.Function("law", ca.symvar(law), [law])):
            where = name
    raise SolverError(
        f"the Taylor solver needs smooth equations; {where} may have a kink or jump (abs, sign, min, max, "
        "where, a comparison; the spring of a quaternion). Use Taylor(switches=True), 'ode5' or 'DOP853'"
    )


def _has_kink(function: Any) -> bool:
    """Whether a function has an operation with a kink or a jump."""
    kinked = {getattr(ca, f"OP_{name}") for name in KINKED}
    return any(function.instruction_id(k) in kinked for k in range(function.n_instructions()))
