"""Implicit fixed steps: a step's equations are compiled once and solved again and again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array, max_norm
from deltac.dynamics.forces import channels
from deltac.errors import SolverError
from deltac.kernels import Kernel
from deltac.simulation.flow import StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.implicit.form import ImplicitForm
from deltac.simulation.stepping.implicit.newton import Newton, NewtonOutcome, StepSystem
from deltac.simulation.stepping.implicit.schemes import SCHEMES, Before, StepEquations
from deltac.simulation.stepping.interpreted import StageRate
from deltac.simulation.stepping.protocol import Step, StepFailed, Stepper


@dataclass(frozen=True)
class Taken:
    """A step that was taken: its unknowns y; x and memory after it."""

    y: Array
    x: Array
    memory: Array


class ImplicitMethod:
    """An implicit solver on a flow, in symbols and compiled: kept between runs, and without numbers."""

    def __init__(self, flow: StateFlow, solver: Solver) -> None:
        """Write the step's equations out; InputError for what the solver cannot do."""
        self.flow, self.solver = flow, solver
        self.form = ImplicitForm(flow)
        if solver.name == "discrete-gradient":
            _check_conservative(flow)

    @cached_property
    def _data(self) -> dict[str, ca.SX]:
        width = 2 * (self.flow.x.shape[0] - self.flow.q_size)
        memory = width if self.solver.name == "generalized-alpha" else 0
        return {
            "t": ca.SX.sym("t0"),
            "h": ca.SX.sym("h"),
            "x": ca.SX.sym("x0", self.flow.x.shape[0]),
            "memory": ca.SX.sym("memory", memory),
            "inputs": self.flow.inputs,
            "p": self.flow.p,
            "radius": ca.SX.sym("radius"),
        }

    @cached_property
    def equations(self) -> StepEquations:
        """The step in symbols."""
        d = self._data
        q, u, z = self.flow.parts
        x, memory, radius = d["x"], d["memory"], d["radius"]
        before = Before(d["t"], d["h"], x[q], x[u], x[z], memory, radius)
        return SCHEMES[self.solver.name](self.form, before)

    @cached_property
    def system(self) -> StepSystem:
        """The step's equations, compiled."""
        e = self.equations
        # Speeds that the constraints determine say nothing of the convergence of the multipliers.
        telling = e.unknowns.shape[0] if self.flow.driven else e.speeds
        return StepSystem(e.unknowns, self._data, e.residual, telling)

    @cached_property
    def ending(self) -> Kernel:
        """What follows from the unknowns: the state and the memory after the step."""
        e = self.equations
        inputs = {"y": e.unknowns, **{n: c for n, c in self._data.items() if c.shape[0]}}
        outputs = {"after": e.after, "memory": e.memory}
        return Kernel(inputs, outputs, name=f"end of a step of {self.solver.name}")

    @cached_property
    def rates(self) -> Any:
        """(t, x, inputs, p) -> accelerations and rates of integrals, of the equations of motion solved."""
        flow = self.flow
        rates = flow.xdot[flow.q_size :]
        return ca.Function("rates", [flow.t, flow.x, flow.inputs, flow.p], [ca.densify(rates)])


class ImplicitSteps(Stepper):
    """The steps of an implicit method in one run: Newton's factors, the method's memory, the last step."""

    def __init__(self, method: ImplicitMethod, rate: StageRate, p: Array, radius: float) -> None:
        """Nothing is computed before the first step; `rate` holds what motors are set to."""
        self._method, self._motors, self._p, self._radius = method, rate, p, radius
        self._newton, ending = Newton(method.system), method.ending
        self._in, self._out = np.empty(ending.n_in), np.empty(ending.n_out)
        self._places = [ending.output_slices[n] for n in ("after", "memory")]
        self._memory: tuple[Array, float] | None = None  # and the length of the steps it is of
        self._previous: tuple[Array, Array, float] | None = None  # unknowns, speeds before, length
        self._tried: tuple[Taken, Array, float] | None = None
        self._fastest = 0.0

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """Solve a step's equations; StepFailed in words where Newton's method does not."""
        h = until - t
        if self._memory is None or abs(self._memory[1] - h) > 1e-6 * h:  # beyond rounding of times
            self._memory = self._start(t, x, h), h
        memory = self._memory[0]
        solved = self._solved(t, x, h, memory)
        self._tried = solved, x[self._method.flow.parts[1]], h

        def exact(time: float) -> Array:
            if time <= t:
                return x
            share, n = (time - t) / h, len(memory) // 2
            rates, aux = memory[:n], memory[n:]  # auxiliary rates are ahead by a share of the step
            part = np.concatenate([rates, rates + share * (aux - rates)])
            return self._solved(t, x, time - t, part).x

        return Step(t, x, until, solved.x, exact)

    def accept(self, t: float, x: Array) -> None:
        """The method's memory goes on from the end of the step."""
        assert self._tried is not None
        state, u, h = self._tried
        self._memory, self._previous = (state.memory, h), (state.y, u, h)

    @property
    def taken(self) -> Taken:
        """What the last attempt came to."""
        assert self._tried is not None
        return self._tried[0]

    def restart(self, t: float, x: Array, p: Array) -> None:
        """From rates of the motion there, and a new Jacobian."""
        self._p, self._memory, self._previous = p, None, None
        self._newton.forget()

    def _solved(self, t: float, x: Array, h: float, memory: Array) -> Taken:
        u = x[self._method.flow.parts[1]]
        data = np.concatenate([[t, h], x, memory, self._motors.held, self._p, [self._radius]])
        self._fastest = max(self._fastest, max_norm(u))
        outcome = NewtonOutcome(np.empty(0), False, 0, np.empty(0))
        for guess in self._guesses(u, h, memory):
            outcome = self._newton.solve(guess, data, self._fastest)
            if outcome.solved:
                break
            self._newton.forget()
        if not outcome.solved:
            raise StepFailed(_stopped(self._method, t, h, outcome))
        self._in[: len(outcome.y)], self._in[len(outcome.y) :] = outcome.y, data
        out = self._method.ending.single(self._in, self._out).copy()
        return Taken(outcome.y, *(out[place] for place in self._places))

    def _guesses(self, u: Array, h: float, memory: Array) -> list[Array]:
        """Where to start Newton's method: as in the last step, then from the present speeds."""
        n = len(u)
        now = np.zeros(self._method.system.size)
        now[:n] = h * memory[:n] if len(memory) else u
        if self._previous is None:
            return [now]
        y, u_before, before = self._previous
        on = (h / before) * y
        if not len(memory):
            on[:n] = u + (h / before) * (u - u_before)
        return [on, now]

    def _start(self, t: float, x: Array, h: float) -> Array:
        """The memory before the first step: rates of the motion, auxiliary ones by a trial step.

        The auxiliary rates belong to t + (α_m − α_f) h; with those of t itself, multipliers would begin
        with an error of first order.
        """
        if self._method.solver.name != "generalized-alpha":
            return np.empty(0)
        rates = self._rates(t, x)
        self._previous = None
        try:
            trial = self._solved(t, x, h, np.concatenate([rates, rates]))
        except StepFailed:
            return np.concatenate([rates, rates])
        following = self._rates(t + h, trial.x)
        offset = (self._radius - 1) / (self._radius + 1)  # α_m − α_f
        return np.concatenate([rates, rates + offset * (following - rates)])

    def _rates(self, t: float, x: Array) -> Array:
        """Accelerations and powers of the equations of motion, solved."""
        return np.asarray(self._method.rates(t, x, self._motors.held, self._p)).ravel()


def _stopped(method: ImplicitMethod, t: float, h: float, outcome: NewtonOutcome) -> str:
    """In words, why a step could not be taken."""
    if not np.isfinite(outcome.residual).all():
        why = f"the equations of motion{_worst(method, h, outcome)} are not defined at the states tried"
    else:
        why = (
            "the equations are singular"
            if outcome.singular
            else f"Newton's method found no solution in {outcome.iterations} iterations"
        )
        why += f"; the residual of the equations of motion is{_worst(method, h, outcome)}"
    return (
        f"in the step to {t + h:.9g} s {why}. The motion up to t = {t:.9g} s is kept. Take a smaller step; "
        "if that does not help, look for a law that jumps or is not defined there, or for constraints "
        "that lock up"
    )


def _worst(method: ImplicitMethod, h: float, outcome: NewtonOutcome) -> str:
    """The largest part of what is left of the equations of motion, and the speed it belongs to."""
    flow = method.flow
    forces = np.abs(outcome.residual[: flow.u_size]) / h
    worst = int(np.argmax(np.where(np.isfinite(forces), forces, np.inf)))
    size = f" {forces[worst]:.3g} N or N·m" if np.isfinite(forces[worst]) else ""
    if flow.own is not None:
        return size
    mechanism = flow.system.mechanism
    return f"{size} for speed {mechanism.speeds[int(mechanism.free.u[worst])].name!r}"


def _check_conservative(flow: StateFlow) -> None:
    """InputError unless K + V is a function of the state alone, which the scheme can keep."""
    mechanism = flow.system.mechanism
    advice = "use 'implicit-midpoint' or 'generalized-alpha'"
    if flow.equations is not None:
        raise SolverError(
            "solver 'discrete-gradient' conserves the energy of the mechanism, which equations by hand need "
            f"not have; {advice}"
        )
    for joint in mechanism.joints:
        if joint.prescribed:
            raise SolverError(
                f"solver 'discrete-gradient' conserves the energy, and the prescribed joint {joint.name!r} "
                f"feeds it; {advice}"
            )
    if flow.bound is not None:
        rows = flow.bound.rows
        for k, name in enumerate(rows.names):
            if ca.sparsify(ca.simplify(rows.b[k])).nnz():
                raise SolverError(
                    f"solver 'discrete-gradient' conserves the energy, and constraint {name!r}, which moves "
                    f"in time, feeds it; {advice}"
                )
    for channel in channels(flow.system):
        if channel.explicit is not None:
            raise SolverError(
                f"solver 'discrete-gradient' conserves the energy, and {channel.name!r}, whose law "
                f"depends on time, feeds it; {advice}"
            )
