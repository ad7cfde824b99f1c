"""Runs by implicit methods: a step's equations are compiled once and solved again and again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.errors import InputError
from deltac.kernels import Kernel
from deltac.simulation.course import Course, Motion
from deltac.simulation.equations import Controller
from deltac.simulation.flow import Flow
from deltac.simulation.implicit.form import Form, Settings
from deltac.simulation.implicit.newton import Newton, Outcome, StepSystem
from deltac.simulation.implicit.schemes import SCHEMES, Before, StepEquations
from deltac.simulation.solvers.solver import Solver
from deltac.simulation.stages import Settle, StageRate, march

DEFAULT_RADIUS = 0.8
"""Spectral radius of generalized-α at infinity, where none is asked for."""


def check_radius(solver: Solver, radius: float | None) -> float:
    """The spectral radius of a run; InputError for one out of [0, 1], or a solver that has none."""
    if radius is None:
        return DEFAULT_RADIUS
    if solver.name != "generalized-alpha":
        raise InputError(
            f"spectral_radius is {radius!r}, and solver {solver.name!r} has none; leave it out, or use "
            "'generalized-alpha'"
        )
    try:
        number = float(radius)
    except (TypeError, ValueError):
        number = np.nan
    if not 0.0 <= number <= 1.0:
        raise InputError(
            f"spectral_radius is {radius!r}; expected a number from 0 (what is fast is gone in a step) to "
            "1 (no numerical damping)"
        )
    return number


@dataclass(frozen=True)
class Taken:
    """A step that was taken: x and the method's memory after it, its rates (u̇, P) and multipliers λ."""

    x: Array
    memory: Array
    rates: Array
    multipliers: Array


class ImplicitStepper:
    """The steps of an implicit solver for a flow."""

    def __init__(self, flow: Flow, solver: Solver) -> None:
        """Write the step's equations out; InputError for what the solver cannot do."""
        self.flow, self.solver = flow, solver
        self.form = Form(flow)
        if solver.name == "discrete-gradient":
            _check_conservative(flow)

    @cached_property
    def _data(self) -> dict[str, ca.SX]:
        width = 2 * (self.flow.u_size + self.form.integrals)
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
    def _equations(self) -> StepEquations:
        d = self._data
        q, u, z = self.flow.parts
        before = Before(d["t"], d["h"], d["x"][q], d["x"][u], d["x"][z], d["memory"])
        settings = Settings(d["inputs"], d["p"], d["radius"])
        return SCHEMES[self.solver.name](self.form, before, settings)

    @cached_property
    def system(self) -> StepSystem:
        """The step's equations, compiled."""
        e = self._equations
        return StepSystem(e.unknowns, self._data, e.residual, e.speeds)

    @cached_property
    def _ending(self) -> Kernel:
        e = self._equations
        inputs = {"y": e.unknowns, **{n: c for n, c in self._data.items() if c.shape[0]}}
        outputs = {"after": e.after, "memory": e.memory, "rates": e.rates, "lam": e.multipliers}
        return Kernel(inputs, outputs, name=f"end of a step of {self.solver.name}")

    def run(
        self, controller: Controller | None, course: Course, radius: float = DEFAULT_RADIUS
    ) -> Motion:
        """Take the steps of a course; stop with words where Newton's method fails."""
        if controller is not None and not controller.hold:
            raise InputError(
                f"solver {self.solver.name!r} needs the derivatives of a controller that acts within "
                "steps, and they are unknown; use Controller(..., hold=True), or 'ode5'"
            )
        run = Run(self, course.p, course.h, radius)
        settle = Settle(self.flow, course.p)

        def advance(t: float, following: float, x: Array, held: Array) -> Array | str:
            taken, outcome = run.step(t, x, held)
            settled = None if taken is None else settle(following, taken.x)[0]
            if settled is None or not np.isfinite(settled).all():
                return self._stopped(t, following, course.h, outcome)
            return settled

        return march(course, StageRate(self.flow, controller, course.p), advance)

    def _stopped(self, t: float, following: float, h: float, outcome: Outcome) -> str:
        """In words, why a step could not be taken."""
        if outcome.solved:
            why = "the new state cannot be brought onto the constraints"
        elif not np.isfinite(outcome.residual).all():
            why = f"the equations of motion{self._worst(h, outcome)} are not defined at the states tried"
        else:
            why = (
                "the equations are singular"
                if outcome.singular
                else f"Newton's method found no solution in {outcome.iterations} iterations"
            )
            why += f"; what is left of the equations of motion is{self._worst(h, outcome)}"
        return (
            f"stopped at t = {t:.9g} s: in the step to {following:.9g} s {why}. The motion up to "
            f"t = {t:.9g} s is kept. Take a smaller step; if that does not help, look for a law that jumps "
            "or is not defined there, or for constraints that lock"
        )

    def _worst(self, h: float, outcome: Outcome) -> str:
        """The largest part of what is left of the equations of motion, and the speed it belongs to."""
        forces = np.abs(outcome.residual[: self.flow.u_size]) / h
        worst = int(np.argmax(np.where(np.isfinite(forces), forces, np.inf)))
        size = f" {forces[worst]:.3g} N or N·m" if np.isfinite(forces[worst]) else ""
        if self.flow.own is not None:
            return size
        mechanism = self.flow.system.mechanism
        return f"{size} for speed {mechanism.speeds[int(mechanism.free.u[worst])].name!r}"


class Run:
    """One run of a stepper: parameters and step length fixed, the method's memory carried along."""

    def __init__(self, stepper: ImplicitStepper, p: Array, h: float, radius: float) -> None:
        """Nothing is computed before the first step."""
        self._stepper, self._p, self._h, self._radius = stepper, p, h, radius
        self._newton, self._ending = Newton(stepper.system), stepper._ending
        ending = self._ending
        self._in, self._out = np.empty(ending.n_in), np.empty(ending.n_out)
        self._places = [ending.output_slices[n] for n in ("after", "memory", "rates", "lam")]
        self._memory: Array | None = None
        self._previous: tuple[Array, Array] | None = None  # unknowns and speeds of the last step
        self._fastest = 0.0

    def step(self, t: float, x: Array, held: Array) -> tuple[Taken | None, Outcome]:
        """One step from x at t, not yet settled; None if Newton's method failed."""
        if self._memory is None:
            self._memory = self._start(t, x, held)
        taken, outcome = self._taken(t, x, held, self._memory)
        if taken is not None:
            self._memory = taken.memory
        return taken, outcome

    def _taken(
        self, t: float, x: Array, held: Array, memory: Array
    ) -> tuple[Taken | None, Outcome]:
        _, u_part, _ = self._stepper.flow.parts
        u = x[u_part]
        data = np.concatenate([[t, self._h], x, memory, held, self._p, [self._radius]])
        self._fastest = max(self._fastest, float(np.abs(u).max()))
        outcome = Outcome(np.empty(0), False, 0, np.empty(0))
        for guess in self._guesses(u, memory):
            outcome = self._newton.solve(guess, data, self._fastest)
            if outcome.solved:
                break
            self._newton.forget()
        if not outcome.solved:
            return None, outcome
        self._in[: len(outcome.y)], self._in[len(outcome.y) :] = outcome.y, data
        out = self._ending.single(self._in, self._out).copy()
        taken = Taken(*(out[place] for place in self._places))
        self._previous = outcome.y, u.copy()
        return taken, outcome

    def _guesses(self, u: Array, memory: Array) -> list[Array]:
        """Where to start Newton's method: as in the last step, then from the present speeds."""
        n = len(u)
        unknowns = self._stepper._equations.unknowns.shape[0]
        now = np.zeros(unknowns)
        now[:n] = self._h * memory[:n] if len(memory) else u
        if self._previous is None:
            return [now]
        y, u_before = self._previous
        on = y.copy()
        if not len(memory):
            on[:n] = 2 * u - u_before
        return [on, now]

    def _start(self, t: float, x: Array, held: Array) -> Array:
        """The memory before the first step: rates of the motion, auxiliary ones by a trial step.

        The auxiliary rates belong to t + (α_m − α_f) h; with those of t itself, multipliers would begin
        with an error of first order.
        """
        if self._stepper.solver.name != "generalized-alpha":
            return np.empty(0)
        rates = self._rates(t, x, held)
        trial, _ = self._taken(t, x, held, np.concatenate([rates, rates]))
        self._previous = None
        if trial is None:
            return np.concatenate([rates, rates])
        following = self._rates(t + self._h, trial.x, held)
        offset = (self._radius - 1) / (self._radius + 1)  # α_m − α_f
        return np.concatenate([rates, rates + offset * (following - rates)])

    def _rates(self, t: float, x: Array, held: Array) -> Array:
        """Accelerations and powers of the equations of motion, solved."""
        flow = self._stepper.flow
        n = flow.q_size
        rates = flow.xdot[n : n + flow.u_size + self._stepper.form.integrals]
        f = ca.Function("rates", [flow.t, flow.x, flow.inputs, flow.p], [ca.densify(rates)])
        return np.asarray(f(t, x, held, self._p)).ravel()


def _check_conservative(flow: Flow) -> None:
    """InputError unless K + V is a function of the state alone, which the scheme can keep."""
    mechanism = flow.system.mechanism
    advice = "use 'implicit-midpoint' or 'generalized-alpha'"
    if flow.equations is not None:
        raise InputError(
            "solver 'discrete-gradient' keeps the energy of the mechanism, which equations by hand need "
            f"not have; {advice}"
        )
    for joint in mechanism.joints:
        if joint.prescribed:
            raise InputError(
                f"solver 'discrete-gradient' keeps the energy, and the prescribed joint {joint.name!r} "
                f"feeds it; {advice}"
            )
    if flow.bound is not None:
        rows = flow.bound.rows
        for k, name in enumerate(rows.names):
            if ca.sparsify(ca.simplify(rows.b[k])).nnz():
                raise InputError(
                    f"solver 'discrete-gradient' keeps the energy, and constraint {name!r}, which moves "
                    f"in time, feeds it; {advice}"
                )
    from deltac.dynamics.forces import channels

    for channel in channels(flow.system):
        if channel.explicit is not None:
            raise InputError(
                f"solver 'discrete-gradient' keeps the energy, and {channel.name!r}, whose law depends on "
                f"time, feeds it; {advice}"
            )
