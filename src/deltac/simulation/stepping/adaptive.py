"""Our explicit methods with steps of their own choice, by the local error and by ΔC.

A step is accepted where both are within the tolerance. The local error, from an embedded method, is relative
to the state. ΔC is known at no cost, since the powers of testing functions are integrated with the motion;
what it may change in a step is the step's share of the run. So |ΔC| at the end is within the tolerance, as a
fraction of the energy that takes part: the largest kinetic energy so far and the range of the potential one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import EPS, Array
from deltac.kernels import Kernel
from deltac.simulation.flow import Flow
from deltac.simulation.solvers import Solver
from deltac.simulation.step_size.sizes import NEAR_ZERO
from deltac.simulation.stepping.interpreted import StageRate
from deltac.simulation.stepping.protocol import Step, StepFailed, Stepper
from deltac.simulation.stepping.runge_kutta import EMBEDDED, Rate, embedded_step

SAFETY, LEAST, MOST = 0.9, 0.2, 5.0
"""Factors on the step that would just do, and between one step and the next (Hairer, Nørsett, Wanner)."""

ROUNDED = 64 * EPS
"""Change of ΔC, as a share of the energies, that rounding makes."""

MOST_INSTRUCTIONS = 6_000
"""A step larger than this is not compiled as one: ẋ is, and the step goes stage by stage."""

FIRST = 1e-3
"""The first step that is tried, as a share of the run."""

SHORTER = 0.05
"""A step so much shorter at which ΔC's rate is still the same shows that it is not the step's."""

MOST_REJECTED = 60
"""Times that one step is tried again, each at least a tenth shorter."""


@dataclass
class StepControl:
    """What is accepted of a step, by the energies that a run has shown so far.

    `tolerance` is that of `solvers.Adaptive`, `duration` the run's (s); `order` is the method's, `embedded`
    that of the embedded one; `sizes` are those of coordinates and speeds. `kinetic` is the largest K, `low`
    and `high` the range of V, J.
    """

    tolerance: float
    duration: float
    order: int
    embedded: int
    sizes: Array
    kinetic: float = 0.0
    low: float = np.inf
    high: float = -np.inf

    def see(self, K: float, V: float) -> None:
        """Energies of a state that a step ended at."""
        self.kinetic = max(self.kinetic, K)
        self.low, self.high = min(self.low, V), max(self.high, V)

    def local(self, x0: Array, x1: Array, errors: Array) -> float:
        """The local error of coordinates and speeds by its estimates (m, n), 1 where it is just accepted.

        Two estimates count together as in DOP853 (Hairer, Nørsett, Wanner, II.10).
        """
        size = np.maximum(np.abs(x0), np.abs(x1))
        allowed = self.tolerance * (NEAR_ZERO * self.sizes + size)
        sizes = [float(np.linalg.norm(error / allowed)) for error in errors]
        if len(sizes) == 2 and sizes[0] > 0.0:
            sizes[0] *= sizes[0] / math.hypot(sizes[0], 0.1 * sizes[1])
        return sizes[0] / math.sqrt(max(len(x0), 1))

    def energy(self, change: float, K: float, V: float, h: float) -> float:
        """The change of ΔC in a step, 1 where it is just accepted."""
        low, high = min(self.low, V), max(self.high, V)
        taking_part = max(self.kinetic, K) + high - low
        allowed = self.tolerance * taking_part * h / self.duration
        rounding = ROUNDED * (abs(K) + max(abs(low), abs(high)))
        return float(abs(change) / (allowed + rounding + 1e-300))

    def next(self, h: float, local: float, energy: float) -> float:
        """The length of the next step, or of the same one again."""
        factors = [
            SAFETY * max(error, 1e-10) ** (-1.0 / power)
            # ΔC over a step is of order p + 1, and what it may be is in proportion to the step.
            for error, power in ((local, self.embedded + 1), (energy, self.order))
        ]
        return float(h * min(MOST, max(LEAST, min(factors))))


@dataclass(frozen=True)
class AdaptiveMethod:
    """A pair of embedded methods on a flow, compiled as one step; kept between runs."""

    flow: Flow
    solver: Solver

    @property
    def base(self) -> str:
        """The method of fixed steps, such as "ode5"."""
        return self.solver.name.removesuffix("-adaptive")

    @cached_property
    def kernel(self) -> Kernel:
        """(t, x, p, h) -> x one step later and the estimates of its local error."""
        flow = self.flow
        h = ca.SX.sym("h")

        def rate(t: Any, x: Any) -> Any:
            return flow.rate(t, x, flow.p)

        after, errors = embedded_step(self.base, rate, flow.t, flow.x, h)
        outputs = {"x": after, "errors": ca.densify(ca.vertcat(*errors))}
        return flow.kernel(f"{self.solver.name} step", outputs, h=h)

    @cached_property
    def energies(self) -> Kernel:
        """(t, x, p) -> each testing function's E, K, V."""
        return self.flow.kernel("energies", {"E": ca.densify(self.flow.energies)})


class AdaptiveSteps(Stepper):
    """The steps of one run, each as long as local error and ΔC allow."""

    on_grid = False

    tried: int
    """Steps that were tried so far, those within them to samples not counted."""

    def __init__(
        self,
        method: AdaptiveMethod,
        rate: StageRate,
        p: Array,
        tolerance: float,
        sizes: Array,
        duration: float,
        *,
        compiled: bool,
    ) -> None:
        """`sizes` (n,) of the states; `compiled` unless users' functions are called in between."""
        self._method, self._p = method, p
        self._compiled = compiled and method.kernel.instructions <= MOST_INSTRUCTIONS
        self._rate: Rate = rate
        order = method.solver.order
        assert order is not None
        self._moving = n = method.flow.parts[2].start
        embedded = EMBEDDED[method.base].order
        self._control = StepControl(tolerance, duration, order, embedded, sizes[:n])
        self._h = FIRST * duration
        self._before: tuple[float, Array] | None = None
        self.tried = 0

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """A step as long as is allowed; StepFailed where it would have no length."""
        control, n = self._control, self._moving
        if self._before is None or self._before[0] != t:
            self._before = (t, self._delta_c(t, x, seen=True)[0])
        before, refused = self._before[1], (0.0, 0.0)
        for _ in range(MOST_REJECTED):
            h = min(self._h, until - t)
            last = h == until - t
            if h < 16 * np.spacing(abs(t)):
                break
            self.tried += 1
            x1, errors = self._step(t, x, h)
            if not (np.isfinite(x1).all() and np.isfinite(errors).all()):
                self._h = 0.1 * h
                continue
            end = until if last else t + h
            after, K, V = self._delta_c(end, x1)
            local = control.local(x[:n], x1[:n], errors[:, :n])
            change = float(np.abs(after - before).max(initial=0.0))
            energy = control.energy(change, K, V, h)
            following = control.next(h, local, energy)
            if max(local, energy) <= 1.0:
                self._h = following if not last else max(following, self._h)

                def exact(time: float) -> Array:
                    return self._step(t, x, time - t)[0] if time > t else x

                return Step(t, x, end, x1, exact, exact)
            self._h = min(following, 0.9 * h)
            if local <= 1.0:
                refused = refused if refused[0] else (h, energy)
                if h < SHORTER * refused[0] and energy > 0.5 * refused[1]:
                    raise StepFailed(
                        f"ΔC changes by {change / h:.3g} W however short the step is, so the step is not "
                        f"the cause: the equations are not those of the model, or a force that does work "
                        f"is in no channel. deltac.check_equations finds out which; record=() takes ΔC "
                        f"out of the step control"
                    )
        raise StepFailed(
            f"the step became too small ({self._h:.3g} s) for the tolerance {control.tolerance:g}; the "
            f"run up to here is kept. Where a law jumps, use Adaptive(switches=True); or allow more"
        )

    def accept(self, t: float, x: Array) -> None:
        """Go on from a state, after it was finished: ΔC there counts corrections."""
        self._before = (t, self._delta_c(t, x, seen=True)[0])

    def restart(self, t: float, x: Array, p: Array) -> None:
        """Go on from another state, with a first step as short as at the start."""
        self._p, self._before = p, None
        self._h = min(self._h, FIRST * self._control.duration)

    def _delta_c(self, t: float, x: Array, *, seen: bool = False) -> tuple[Array, float, float]:
        """E − ∫P of each testing function at a state, K and V there."""
        kernel = self._method.energies
        given = np.concatenate([[t], x, self._p])
        E = kernel.single(given, np.empty(kernel.n_out))
        if seen:
            self._control.see(float(E[-2]), float(E[-1]))
        return E[:-2] - x[self._method.flow.tested], float(E[-2]), float(E[-1])

    def _step(self, t: float, x: Array, h: float) -> tuple[Array, Array]:
        """X one step later, and error estimates (m, n)."""
        if not self._compiled:
            with np.errstate(all="ignore"):
                x1, errors = embedded_step(self._method.base, self._rate, t, x, h)
            return x1, np.array(errors)
        kernel = self._method.kernel
        out = kernel.single(np.concatenate([[t], x, self._p, [h]]), np.empty(kernel.n_out))
        return out[: len(x)].copy(), out[len(x) :].reshape(-1, len(x))
