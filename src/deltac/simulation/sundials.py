"""CVODES and IDAS of SUNDIALS, through CasADi: variable order and step, Newton with exact Jacobians."""

from __future__ import annotations

import contextlib
import io
import re
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.equations_of_motion import quaternions
from deltac.dynamics.forces import channels
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import forward
from deltac.errors import InputError
from deltac.simulation.course import Motion, Progress
from deltac.simulation.equations import Controller
from deltac.simulation.flow import Flow
from deltac.simulation.implicit.form import Form, Point, Settings
from deltac.simulation.solvers.solver import Solver
from deltac.simulation.stages import Settle

SUNDIALS = ("CVODES", "IDAS")
CHUNK = 64
"""Samples between reports of progress."""

FIRST_STEP = 1e-12
"""Length of the first step of IDAS after each start, s."""

MOST_STEPS = 100_000
"""Internal steps between two samples after which the run is given up."""


def run_sundials(
    flow: Flow,
    solver: Solver,
    controller: Controller | None,
    p: Array,
    x0: Array,
    times: Array,
    tolerance: float,
    progress: Progress | None,
) -> Motion:
    """Integrate and sample at `times`; projected runs start anew from each sample.

    CVODES takes ẋ = f(t, x). IDAS takes the equations of motion unsolved, with u̇ and λ as unknowns of their
    own: index 1, constraints on the level of accelerations.
    """
    if controller is not None or not flow.traced:
        raise InputError(
            f"solver {solver.name!r} needs equations in symbols; a function called from Python, or a "
            "controller, cannot be differentiated. Use 'Radau' or 'BDF'"
        )
    equations = _implicit(flow) if solver.name == "IDAS" else _explicit(flow)
    integrate = _Integration(equations, solver.name.lower(), tolerance, p)
    settle = Settle(flow, p)
    places = [] if flow.own is not None else quaternions(flow.system.mechanism)
    kept, message = [x0.copy()], ""
    while len(kept) < len(times) and not message:
        first = len(kept) - 1
        count = 1 if flow.projecting else min(CHUNK, len(times) - 1 - first)
        found, message = integrate(kept[-1], times[first : first + count + 1])
        for k, x in enumerate(found):
            if flow.projecting:
                x, _ = settle(times[first + 1 + k], x)
            for place in places:
                x[place] /= np.linalg.norm(x[place])
            if not np.isfinite(x).all():
                message = message or "the state is not finite"
                break
            kept.append(x)
        if progress is not None:
            progress((len(kept) - 1) / (len(times) - 1))
    if message:
        message = (
            f"stopped at t = {times[len(kept) - 1]:.9g} s: {message}{_speed(flow, kept[-1])}; what was "
            "computed so far is kept. Look at the laws there: one that grows without bound, jumps, or "
            "ceases to be defined; or try a larger tolerance="
        )
    return Motion(times[: len(kept)], np.array(kept), np.empty((len(kept), 0)), message)


def _speed(flow: Flow, x: Array) -> str:
    """The largest speed at a state, in words."""
    u = x[flow.parts[1]]
    if flow.own is not None or not u.size:
        return ""
    mechanism = flow.system.mechanism
    k = int(np.argmax(np.abs(u)))
    return f" (the largest speed is u.{mechanism.speeds.names[mechanism.free.u[k]]} = {u[k]:.4g})"


def _explicit(flow: Flow) -> dict[str, Any]:
    """ẋ = f, and no algebraic unknowns."""
    return {"t": flow.t, "x": flow.x, "p": flow.p, "ode": flow.xdot}


def _implicit(flow: Flow) -> dict[str, Any]:
    """q̇ = W u, u̇ = a, and the algebraic unknowns a, λ of r(t, q, u, a, λ) = 0, ψ̇ = 0.

    ψ̇ is with Baumgarte's terms where the run has them, as in forward dynamics: G a = −γ is read off it.
    """
    form = Form(flow)
    a, lam = ca.SX.sym("a", flow.u_size), ca.SX.sym("lambda", form.multipliers)
    at = Point(flow.t, form.q, form.u, a, lam)
    settings = Settings(flow.inputs, flow.p, ca.SX(0))
    still = ca.SX.zeros(flow.x.shape[0] - flow.q_size - flow.u_size - form.integrals)
    ode = ca.vertcat(flow.xdot[: flow.q_size], a, form.powers(at, settings), still)
    residual = form.dynamics(at, settings)
    udot = flow.xdot[flow.q_size : flow.q_size + flow.u_size]
    start = udot
    if form.multipliers:
        assert flow.bound is not None
        motion = forward(flow.system, channels(flow.system), flow.bound, flow.damping)
        rows = flow.bound.rows
        alpha, beta = flow.damping
        wanted = rows.gamma + 2 * alpha * rows.psi + beta**2 * rows.phi
        residual = ca.vertcat(residual, ca.mtimes(rows.G, a) + wanted)
        start = ca.vertcat(udot, motion.multipliers)
    dae = {"t": flow.t, "x": flow.x, "z": ca.vertcat(a, lam), "p": flow.p}
    return {**dae, "ode": ode, "alg": residual, "start": start}


class _Integration:
    """A CasADi integrator from one sample to the next ones."""

    def __init__(self, equations: dict[str, SX], plugin: str, tolerance: float, p: Array) -> None:
        dae = dict(equations)
        start = dae.pop("start", None)
        inputs = [dae["t"], dae["x"], dae["p"]]
        self._start = None if start is None else ca.Function("start", inputs, [start])
        self._dae, self._plugin, self._p = dae, plugin, p
        self._options: dict[str, Any] = {
            "reltol": max(tolerance, 1e-13),
            "abstol": 1e-3 * tolerance,
            "max_num_steps": MOST_STEPS,
            "show_eval_warnings": False,
            "disable_internal_warnings": True,  # what they say is said in the run's message
            "print_time": False,
        }
        if start is not None:
            # The start is exact but for ẋ, which IDAS takes as zero (IDACalcIC fails on states that are
            # right to rounding): its first step must be so short that this does not matter.
            self._options["calc_ic"] = False
            self._options["step0"] = FIRST_STEP
            # Accelerations follow from the state: testing their errors too asks stiff forces for more
            # digits than they have.
            states, others = dae["x"].shape[0], dae["z"].shape[0]
            self._options["suppress_algebraic"] = True
            self._options["abstolv"] = [1e-3 * tolerance] * states + [1e3 * tolerance] * others
        self._known: dict[int, Any] = {}

    def __call__(self, x: Array, times: Array) -> tuple[Array, str]:
        """States at times[1:], and why there are fewer than asked for."""
        try:
            return self._states(x, times), ""
        except RuntimeError as error:
            reason = _reason(str(error))
        if len(times) == 2:
            return np.empty((0, len(x))), reason
        found: list[Array] = []
        for k in range(len(times) - 1):  # how far does it get?
            states, reason_here = self(x, times[k : k + 2])
            if not len(states):
                return np.array(found).reshape(-1, len(x)), reason_here
            x = states[-1]
            found.append(x)
        return np.array(found), ""

    def _states(self, x: Array, times: Array) -> Array:
        # Time is counted from the first sample and scaled into the equations: one integrator serves all
        # intervals of a length.
        grid = np.round(times - times[0], 14)
        key = hash(grid.tobytes())
        if key not in self._known:
            self._known[key] = self._integrator(grid)
        given: dict[str, Any] = {"x0": x, "p": np.concatenate([self._p, [times[0]]])}
        if self._start is not None:
            given["z0"] = self._start(times[0], x, self._p)
        with contextlib.redirect_stderr(io.StringIO()):  # IDAS does not let itself be silenced
            return np.asarray(self._known[key](**given)["xf"]).T

    def _integrator(self, grid: Array) -> Any:
        dae = self._dae
        passed, origin = ca.SX.sym("passed"), ca.SX.sym("origin")
        moved: dict[str, Any] = {
            name: ca.substitute(dae[name], dae["t"], origin + passed)
            for name in ("ode", "alg")
            if name in dae
        }
        problem: dict[str, Any] = {**dae, **moved, "t": passed, "p": ca.vertcat(dae["p"], origin)}
        return ca.integrator(
            "run", self._plugin, problem, float(grid[0]), list(grid[1:]), self._options
        )


_WORDS = {
    "TOO_MUCH_WORK": f"more than {MOST_STEPS} internal steps between two samples",
    "TOO_MUCH_ACC": "the tolerance is beyond the precision of the numbers",
    "ERR_FAIL": "the error test failed again and again with ever smaller steps",
    "CONV_FAIL": "Newton's method did not converge with the smallest step",
    "LSETUP_FAIL": "the Jacobian cannot be factorised",
    "RHSFUNC_FAIL": "the equations are not defined at a state that was tried",
    "RHSFUNC_ERR": "the equations are not defined at states that were tried",
    "RES_FAIL": "the equations are not defined at a state that was tried",
    "RES_ERR": "the equations are not defined at states that were tried",
    "NO_RECOVERY": "no consistent start was found",
}
"""SUNDIALS' return codes in words."""


def _reason(text: str) -> str:
    for code, words in _WORDS.items():
        if code in text:
            return words
    found = re.search(r'returned "?(\w+)"?', text)
    return f"SUNDIALS returned {found[1]}" if found else text.splitlines()[-1][:200]
