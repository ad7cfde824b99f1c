"""CVODES and IDAS of SUNDIALS, through CasADi: variable order and step, Newton with exact Jacobians."""

from __future__ import annotations

import io
import re
import sys
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import ENDLESS, ROUNDED, SMALL_SHARE, Array
from deltac.calls.interrupts import check_interrupted
from deltac.dynamics.forces import channels
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import forward, stabilised
from deltac.simulation.flow import StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.implicit.form import ImplicitForm, StagePoint
from deltac.simulation.stepping.protocol import (
    CHUNK,
    FinishedStates,
    Step,
    StepFailed,
    StepGrid,
    Stepper,
)

NEAR_EVENT = CHUNK // 8
"""Samples of one call near an event."""


class SundialsSteps(Stepper):
    """CVODES or IDAS from sample to sample, their own steps within; each call starts anew.

    CVODES takes ẋ = f(t, x). IDAS takes the equations of motion unsolved, with u̇ and λ as unknowns of their
    own: index 1, constraints on the level of accelerations.
    """

    def __init__(
        self, flow: StateFlow, solver: Solver, p: Array, tolerance: float, sizes: Array
    ) -> None:
        """Of a run with parameters p, whose states have `sizes` (n,)."""
        self._flow, self._p, self._failed = flow, p, False
        equations = _implicit(flow) if solver.name == "IDAS" else _explicit(flow)
        self._integrate = _Integration(equations, solver.name.lower(), tolerance, sizes)

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """To the next sample."""

        def exact(time: float) -> Array:
            return x if time <= t else self._integrate(x, t, time - t, 1, self._p)[-1]

        try:
            return Step(t, x, until, exact(until), exact)
        except RuntimeError as error:
            check_interrupted()
            raise StepFailed(
                f"{_reason(error)}{_speed(self._flow, x)}; the run up to here is kept. Look at the "
                "laws there: one that grows without bound, jumps, or ceases to be defined; or try a larger "
                "tolerance="
            ) from None

    def ahead(self, grid: StepGrid, k: int, x: Array, most: int) -> FinishedStates | None:
        """Samples of one call, which keeps the methods' order; none of a run that is changed at each."""
        rest = grid.count - k
        if grid.end - grid.time(grid.count - 1) < (1 - 1e-9) * grid.step:
            rest -= 1  # the last interval is shorter
        if self._flow.projecting or self._failed or rest < 2:
            return None
        # Each number of parts needs an integrator of its own: there are four at most.
        count = -(-rest // -(-rest // CHUNK))
        if count > most:
            count = CHUNK if most >= CHUNK else min(NEAR_EVENT, count)
        try:
            values = self._integrate(x, grid.time(k), count * grid.step, count, self._p)
        except RuntimeError:
            check_interrupted()
            self._failed = True  # from here one by one: how far does it get?
            return None
        for place in self._flow.quaternions:
            values[:, place] /= np.linalg.norm(values[:, place], axis=1, keepdims=True)
        return FinishedStates(values)


def _speed(flow: StateFlow, x: Array) -> str:
    """The largest speed at a state, in words."""
    u = x[flow.parts[1]]
    if flow.own is not None or not u.size:
        return ""
    mechanism = flow.system.mechanism
    k = int(np.argmax(np.abs(u)))
    return f" (the largest speed is u.{mechanism.speeds.names[mechanism.free.u[k]]} = {u[k]:.4g})"


def _explicit(flow: StateFlow) -> dict[str, Any]:
    """ẋ = f, and no algebraic unknowns."""
    return {"t": flow.t, "x": flow.x, "p": flow.p, "ode": flow.xdot}


def _implicit(flow: StateFlow) -> dict[str, Any]:
    """q̇ = W u, u̇ = a, and the algebraic unknowns a, λ of r(t, q, u, a, λ) = 0, ψ̇ = 0.

    ψ̇ is with Baumgarte's terms where the run has them, as in forward dynamics: G a = −γ is read off it.
    """
    form = ImplicitForm(flow)
    a, lam = ca.SX.sym("a", flow.u_size), ca.SX.sym("lambda", form.multipliers)
    at = StagePoint(flow.t, form.q, form.u, a, lam)
    ode = ca.vertcat(flow.xdot[: flow.q_size], a, form.powers(at))
    residual = form.dynamics(at)
    udot = flow.xdot[flow.q_size : flow.q_size + flow.u_size]
    start = udot
    if form.multipliers:
        assert flow.bound is not None
        motion = forward(flow.system, channels(flow.system), flow.bound, flow.damping)
        rows = flow.bound.rows
        tied = ca.mtimes(rows.G, a) + stabilised(rows, flow.damping)
        residual = ca.vertcat(residual, tied)
        start = ca.vertcat(udot, motion.multipliers)
    dae = {"t": flow.t, "x": flow.x, "z": ca.vertcat(a, lam), "p": flow.p}
    return {**dae, "ode": ode, "alg": residual, "start": start}


class _Silence:
    """What IDAS writes to the error stream, where it does not let itself be silenced, goes nowhere.

    The stream is one for all threads: the first that comes turns it aside, the last that goes puts it back.
    """

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                self._before, sys.stderr = sys.stderr, io.StringIO()
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                sys.stderr = self._before


_SILENCE = _Silence()


class _Integration:
    """CasADi's integrators from one instant to another, in equal parts; time is scaled into the equations.

    So one integrator serves intervals of every length, those that end at an event too. States are scaled by
    their sizes, since the methods have one absolute tolerance.
    """

    def __init__(
        self, equations: dict[str, SX], plugin: str, tolerance: float, sizes: Array
    ) -> None:
        dae = dict(equations)
        self._sizes = sizes
        start = dae.pop("start", None)
        inputs = [dae["t"], dae["x"], dae["p"]]
        self._start = None if start is None else ca.Function("start", inputs, [start])
        self._dae, self._plugin = dae, plugin
        self._options: dict[str, Any] = {
            "reltol": max(tolerance, 1e-13),
            "abstol": SMALL_SHARE * tolerance,
            "max_num_steps": ENDLESS,
            "show_eval_warnings": False,
            "disable_internal_warnings": True,  # what they say is said in the run's message
            "print_time": False,
        }
        if start is not None:
            # The start is exact but for ẋ, which IDAS takes as zero (IDACalcIC fails on states that are
            # right to rounding): its first step must be so short that this does not matter.
            self._options["calc_ic"] = False
            self._options["step0"] = ROUNDED
            # Accelerations follow from the state: testing their errors too asks stiff forces for more
            # digits than they have.
            states, others = dae["x"].shape[0], dae["z"].shape[0]
            self._options["suppress_algebraic"] = True
            self._options["abstolv"] = [SMALL_SHARE * tolerance] * states + [
                1e3 * tolerance
            ] * others
        self._known: dict[int, Any] = {}

    def __call__(self, x: Array, t: float, length: float, parts: int, p: Array) -> Array:
        """States (parts, n) at the ends of equal parts of [t, t + length]; RuntimeError where it fails."""
        if parts not in self._known:
            self._known[parts] = self._integrator(parts)
        arguments: dict[str, Any] = {"x0": x / self._sizes, "p": np.concatenate([p, [t, length]])}
        if self._start is not None:
            arguments["z0"] = self._start(t, x, p)
        with _SILENCE:
            return np.array(self._known[parts](**arguments)["xf"]).T * self._sizes

    def _integrator(self, parts: int) -> Any:
        dae = self._dae
        passed, origin, length = ca.SX.sym("passed"), ca.SX.sym("origin"), ca.SX.sym("length")
        old, new = [dae["t"], dae["x"]], [origin + length * passed, self._sizes * dae["x"]]
        moved: dict[str, Any] = {
            name: ca.substitute([dae[name]], old, new)[0] for name in ("ode", "alg") if name in dae
        }
        moved["ode"] = length * moved["ode"] / self._sizes
        p = ca.vertcat(dae["p"], origin, length)
        problem: dict[str, Any] = {**dae, **moved, "t": passed, "p": p}
        grid = [k / parts for k in range(1, parts + 1)]
        return ca.integrator("run", self._plugin, problem, 0.0, grid, self._options)


_WORDS = {
    "TOO_MUCH_WORK": f"more than {ENDLESS} internal steps between two samples",
    "TOO_MUCH_ACC": "the tolerance is below what double precision can reach",
    "ERR_FAIL": "the error test failed repeatedly with ever smaller steps",
    "CONV_FAIL": "Newton's method did not converge with the smallest step",
    "LSETUP_FAIL": "the Jacobian cannot be factorised",
    "RHSFUNC_FAIL": "the equations are not defined at a state that was tried",
    "RHSFUNC_ERR": "the equations are not defined at states that were tried",
    "RES_FAIL": "the equations are not defined at a state that was tried",
    "RES_ERR": "the equations are not defined at states that were tried",
    "NO_RECOVERY": "no consistent start was found",
}
"""SUNDIALS' return codes in words."""


def _reason(error: RuntimeError) -> str:
    text = str(error)
    for code, words in _WORDS.items():
        if code in text:
            return words
    match = re.search(r'returned "?(\w+)"?', text)
    return f"SUNDIALS returned {match[1]}" if match else text.splitlines()[-1][:200]
