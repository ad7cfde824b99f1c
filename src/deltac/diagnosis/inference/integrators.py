"""Integrators: by the numbers c of their modified equations, and by their own map from row to row.

What a step of length h adds to the exact flow is told in terms of the fields of `fields.FIELDS`. With
f′f = (a, a_q u + a_u a), a method whose expansion has the fraction φ of h² f′f differs from the flow by
c = φ − ½ (Hairer, Lubich, Wanner, ch. IX). MuJoCo's implicit methods treat the dampers, or all of ∂a/∂u, at
the end of the step. Where a log holds every step, or every so many, a method's own map takes the place of
the flow: the prediction errors of the right one are rounding. Methods with a memory, of several steps or of
accelerations of their own, have it from the rows before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from deltac.arrays import EPS, TINY, Array
from deltac.diagnosis.inference.fields import FIELDS
from deltac.diagnosis.inference.flow import repeated, runge_kutta
from deltac.diagnosis.inference.forces import ForceBetween, ForceInStep, LoggedForce, restricted
from deltac.diagnosis.inference.model import AT_ONCE, Intervals, LogModel, Rows
from deltac.results import SHOWN
from deltac.simulation.stepping.runge_kutta import Tableau, tableau_of

PLACES = {f.name: k for k, f in enumerate(FIELDS)}


def _first(q_a: float, aq_u: float, au_a: float, damping: float = 0.0) -> dict[str, float]:
    return {"q: a": q_a, "u: a_q u": aq_u, "u: a_u a": au_a, "u: damping a": damping}


def _second(twice: float, chain: float) -> dict[str, float]:
    """Of a Runge–Kutta method: its coefficients of h³ f″(f, f) and h³ f′f′f less one sixth each."""
    a, b = twice, chain
    return {
        "q: a_q u": b, "q: a_u a": b, "u: a_q a": b, "u: a_u a_q u": b, "u: a_u a_u a": b,
        "u: a_qq u u": a, "u: a_qu u a": 2.0 * a, "u: a_uu a a": a,
    }  # fmt: skip


Step: TypeAlias = Callable[[LogModel, Rows, Array, ForceInStep], tuple[Array, Array]]
"""q and u after a step of length h (N, 1) from rows."""

Defect: TypeAlias = Callable[[LogModel, Rows, Rows, Array, Array], tuple[Array, Array]]
"""What an implicit method would have for q and u at the end of the step h (N, 1), given both rows and the
forces (N, m) in the middle."""


@dataclass(frozen=True, eq=False)
class Remembered:
    """What a method with a memory makes of many steps that follow each other.

    q, u      at the ends of the steps, as in `Defect` for an implicit one
    columns   what it makes of accelerations (N, k) added at the starts and at the ends of the steps: q and u
    fitted    how many numbers were fitted to the rows: a parameter, and the state before the first rows
    numbers   c of its leading terms, if a parameter was fitted; else empty
    """

    q: Array
    u: Array
    columns: Callable[[Array, Array], tuple[Array, Array]]
    fitted: int
    numbers: dict[str, float]


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of accelerations that causes may add; the parameter of a method is fitted beside them.

    scale   factors (n,) that make accelerations comparable
    every   of so many intervals one counts
    basis   orthonormal basis (N · n, P) of what causes add to the scaled accelerations
    """

    scale: Array
    every: int
    basis: Array

    @staticmethod
    def of(a: Array, causes: Array | None) -> Directions:
        """Of accelerations (N, n) and those (N, n, P) of causes, if there are any."""
        scale = 1.0 / (np.sqrt(np.mean(a**2, axis=0)) + EPS)
        if causes is None:
            return Directions(scale, 1, np.zeros((a.size, 0)))
        every = max(1, a.size // max(AT_MOST, PER_CAUSE * causes.shape[2]))
        scaled = (scale[:, None] * causes)[::every]
        return Directions(scale, every, np.linalg.qr(scaled.reshape(-1, causes.shape[2]))[0])

    def left(self, a: Array) -> Array:
        """What is left of accelerations (N, n)."""
        x = (self.scale * a)[:: self.every].ravel()
        return np.asarray(x - self.basis @ (self.basis.T @ x))


Memory: TypeAlias = Callable[[LogModel, Intervals, Directions], Remembered | None]
"""Of a model and intervals; None for rows of no method of the family."""


MIDPOINT = Tableau(((), (0.5,)), (0.0, 1.0), (0.0, 0.5), "Runge 1895")
RALSTON = Tableau(((), (2 / 3,)), (0.25, 0.75), (0.0, 2 / 3), "Ralston 1962")
KUTTA = Tableau(((), (0.5,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6), (0.0, 0.5, 1.0), "Kutta 1901")


def _explicit(tableau: Tableau | str, on_group: bool = False) -> Step:
    """A Runge–Kutta method; `on_group`: rotations are moved by exponentials."""

    def step(model: LogModel, at: Rows, h: Array, force: ForceInStep) -> tuple[Array, Array]:
        own = tableau_of(tableau) if isinstance(tableau, str) else tableau
        assert own is not None
        return runge_kutta(model, own, at, h, force, on_group)

    return step


def _kick_first(model: LogModel, at: Rows, h: Array, force: ForceInStep) -> tuple[Array, Array]:
    u = at.u + h * model.acceleration(at.t, at.q, at.u, force(0.0))
    return model.moved(at.q, u, h), u


def _constant_acceleration(
    model: LogModel, at: Rows, h: Array, force: ForceInStep
) -> tuple[Array, Array]:
    a = model.acceleration(at.t, at.q, at.u, force(0.0))
    return model.moved(at.q, at.u + 0.5 * h * a, h), at.u + h * a


def _drift_first(time: float) -> Step:
    """The place after the step, then the acceleration there, of forces at a time: 0 before it, 1 after it."""

    def step(model: LogModel, at: Rows, h: Array, force: ForceInStep) -> tuple[Array, Array]:
        q = model.moved(at.q, at.u, h)
        return q, at.u + h * model.acceleration(at.t + time * h[:, 0], q, at.u, force(time))

    return step


def _kick_drift_kick(
    model: LogModel, at: Rows, h: Array, force: ForceInStep
) -> tuple[Array, Array]:
    half = at.u + 0.5 * h * model.acceleration(at.t, at.q, at.u, force(0.0))
    q = model.moved(at.q, half, h)
    return q, half + 0.5 * h * model.acceleration(at.t + h[:, 0], q, half, force(1.0))


def _kicks_of_one_acceleration(
    model: LogModel, at: Rows, h: Array, force: ForceInStep
) -> tuple[Array, Array]:
    """Leapfrog that evaluates once a step: it begins with the acceleration that ended the step before.

    That was taken at the speeds u − ½ h a in the middle of that step, and depends on itself through them.
    """
    a = model.acceleration(at.t, at.q, at.u, force(0.0))
    for _ in range(ITERATIONS):
        before, a = a, model.acceleration(at.t, at.q, at.u - 0.5 * h * a, force(0.0))
        if np.allclose(a, before, 16.0 * EPS, 16.0 * EPS):
            break
    half = at.u + 0.5 * h * a
    q = model.moved(at.q, half, h)
    return q, half + 0.5 * h * model.acceleration(at.t + h[:, 0], q, half, force(1.0))


def _velocity_verlet(
    model: LogModel, at: Rows, h: Array, force: ForceInStep
) -> tuple[Array, Array]:
    a = model.acceleration(at.t, at.q, at.u, force(0.0))
    q = model.moved(at.q, at.u + 0.5 * h * a, h)
    after = model.acceleration(at.t + h[:, 0], q, at.u + h * a, force(1.0))
    return q, at.u + 0.5 * h * (a + after)


def _drift_kick_drift(
    model: LogModel, at: Rows, h: Array, force: ForceInStep
) -> tuple[Array, Array]:
    q = model.moved(at.q, at.u, 0.5 * h)
    u = at.u + h * model.acceleration(at.t + 0.5 * h[:, 0], q, at.u, force(0.5))
    return model.moved(q, u, 0.5 * h), u


def _by_quaternions(step: Step) -> Step:
    """A method in which rotations are moved as quaternions are added, not by exponentials."""

    def other(model: LogModel, at: Rows, h: Array, force: ForceInStep) -> tuple[Array, Array]:
        return step(model.by_quaternions(), at, h, force)

    return other


def _implicit_in(what: str) -> Step:
    """Semi-implicit Euler with dampers of joints, all dampers or all of ∂a/∂u at the end of the step."""

    def step(model: LogModel, at: Rows, h: Array, force: ForceInStep) -> tuple[Array, Array]:
        F = force(0.0)
        a = model.acceleration(at.t, at.q, at.u, F)
        units = np.eye(model.n)[:, None]
        if what == "speeds":
            d = 1e-6 * (1.0 + np.abs(at.u).max())
            ends = (
                [model.acceleration(at.t, at.q, at.u + s * d * e, F) for s in (1.0, -1.0)]
                for e in units
            )
            slopes = np.stack([(x - y) / (2.0 * d) for x, y in ends], axis=2)
            if model.servos.any():
                still = model.servo_damping(at.t, at.q, at.u)
                change = [model.servo_damping(at.t, at.q, at.u + e) - still for e in units]
                slopes += model.response(at.t, at.q, np.stack(change, axis=2))
        else:
            own = (F, what == "dampers")
            still = model.damping(at.t, at.q, at.u, *own)
            change = [model.damping(at.t, at.q, at.u + e, *own) - still for e in units]
            slopes = model.response(at.t, at.q, np.stack(change, axis=2))
        A = np.eye(model.n) - h[:, :, None] * slopes
        u = at.u + np.linalg.solve(A, (h * a)[:, :, None])[:, :, 0]
        return model.moved(at.q, u, h), u

    return step


def _implicit_euler(held: bool) -> Defect:
    """The acceleration is that after the step, of forces as if held or of those there."""

    def defect(model: LogModel, at: Rows, end: Rows, h: Array, _: Array) -> tuple[Array, Array]:
        F = at.F if held else end.F
        return model.moved(at.q, end.u, h), at.u + h * model.acceleration(end.t, end.q, end.u, F)

    return defect


def _trapezoidal(held: bool) -> Defect:
    """The mean of the accelerations at both ends, of forces as if held or of those at each."""

    def defect(model: LogModel, at: Rows, end: Rows, h: Array, _: Array) -> tuple[Array, Array]:
        F = at.F if held else end.F
        u = at.u + 0.5 * h * (model.at(at) + model.acceleration(end.t, end.q, end.u, F))
        return model.moved(at.q, 0.5 * (at.u + end.u), h), u

    return defect


def _implicit_midpoint(held: bool) -> Defect:
    """The acceleration at the mean state, of forces as if held or of those in the middle."""

    def defect(
        model: LogModel, at: Rows, end: Rows, h: Array, middle: Array
    ) -> tuple[Array, Array]:
        mean, F = 0.5 * (at.u + end.u), at.F if held else middle
        q = model.moved(at.q, mean, 0.5 * h)
        a = model.acceleration(0.5 * (at.t + end.t), q, mean, F)
        return model.moved(at.q, mean, h), at.u + h * a

    return defect


def _first_of_stretches(intervals: Intervals) -> NDArray[np.intp]:
    """The first interval (N,) of those that each follows without a gap."""
    first = np.concatenate([[True], intervals.start.t[1:] != intervals.end.t[:-1]])
    return np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))


def _adams_bashforth(model: LogModel, intervals: Intervals, _: Directions) -> Remembered:
    """The explicit method of two steps; of what was before the first row, the next one tells."""
    at, end, h, places = intervals.start, intervals.end, intervals.h, np.arange(len(intervals))
    first = places == _first_of_stretches(intervals)
    before = np.where(first, places, places - 1)

    def mean(x: Array) -> Array:
        return np.asarray(1.5 * x - 0.5 * x[before], dtype=float)

    def columns(at_start: Array, _: Array) -> tuple[Array, Array]:
        of_u = np.where(first[:, None], 0.0, h * mean(at_start))
        return np.zeros_like(of_u), of_u

    q, u = model.moved(at.q, mean(at.u), h), at.u + h * mean(model.at(at))
    q[first], u[first] = end.q[first], end.u[first]
    return Remembered(q, u, columns, 2 * model.n * len(np.unique(places[first])), {})


def _chung_hulbert(radius: float) -> tuple[float, float]:
    """α_m and α_f by the spectral radius at infinity (J. Appl. Mech. 60, 1993)."""
    return (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)


def _hilber_hughes_taylor(alpha: float) -> tuple[float, float]:
    """The same by the α of Hilber, Hughes and Taylor (Earthq. Eng. Struct. Dyn. 5, 1977), −⅓ to 0."""
    return 0.0, -alpha


def _generalized_alpha(
    family: Callable[[float], tuple[float, float]], bounds: tuple[float, float], later: bool
) -> Memory:
    """The method with accelerations a of its own, (1 − α_m) a₁ + α_m a₀ = (1 − α_f) u̇₁ + α_f u̇₀.

    With q₁ = q₀ + h u₀ + h² ((½ − β) a₀ + β a₁) and u₁ = u₀ + h ((1 − γ) a₀ + γ a₁). The parameter of the
    family, and a at the first row, are those by which the speeds follow most closely beside all causes.
    """

    def after(model: LogModel, intervals: Intervals, directions: Directions) -> Remembered | None:
        at, end, h = intervals.start, intervals.end, intervals.h
        F = end.F if later else at.F  # as if held
        before, behind = model.at(at), model.acceleration(end.t, end.q, end.u, F)
        mean = (end.u - at.u) / h
        mean_of_q = (model.difference(at, end)[:, : mean.shape[1]] / h - at.u) / h
        stretches = np.split(np.arange(len(h)), np.unique(_first_of_stretches(intervals))[1:])

        def means(x: float, before: Array, behind: Array, mean: Array) -> tuple[Array, Array]:
            """Means (½ − β) a₀ + β a₁ and (1 − γ) a₀ + γ a₁, the latter as near to a `mean` as can be."""
            m, f = family(x)
            gamma = 0.5 + f - m
            beta = 0.25 * (gamma + 0.5) ** 2
            a = np.empty((2, *mean.shape))
            for some in stretches:
                mixed = (1.0 - f) * behind[some] + f * before[some]
                mixed[0] -= m * before[some[0]]
                bands = np.array([np.full(len(some), 1.0 - m), np.full(len(some), m)])
                a[1, some], _ = lapack.dtbtrs(bands, mixed, uplo="L")
                a[0, some] = np.concatenate([before[some[:1]], a[1, some[:-1]]])
                # Another value at the first row fades.
                fading = (-m / (1.0 - m)) ** np.arange(len(some) + 1.0)[:, None]
                of_u = (1.0 - gamma) * fading[:-1] + gamma * fading[1:]
                rest = mean[some] - (1.0 - gamma) * a[0, some] - gamma * a[1, some]
                other = np.sum(of_u * rest, axis=0) / (np.sum(of_u**2) + EPS)
                a[:, some] += np.stack([fading[:-1], fading[1:]]) * other
            return (0.5 - beta) * a[0] + beta * a[1], (1.0 - gamma) * a[0] + gamma * a[1]

        def gap(x: float) -> Array:
            return directions.left(mean - means(x, before, behind, mean)[1])

        def misfit(x: float) -> float:
            return float(np.sum(gap(x) ** 2))

        def misfit_of_q(x: float) -> float:
            of_q = means(x, before, behind, mean)[0]
            return float(np.sum(directions.left(mean_of_q - of_q) ** 2))

        def polished(x: float) -> float:
            """The nearest minimum, by Gauss and Newton; beyond the bounds where there is none."""
            for _ in range(POLISHING):
                here, ahead = gap(x), gap(x + SLIGHTLY)
                slope = (ahead - here) / SLIGHTLY
                step = float(np.sum(slope * here) / (np.sum(slope**2) + EPS))
                x -= step
                if abs(step) < SLIGHTLY or not low - SLIGHTLY < x < high + SLIGHTLY:
                    break
            return x

        low, high = bounds
        grid = np.linspace(low, high, COARSE if high > low else 1)
        size = np.array([np.inf, *map(misfit, grid), np.inf])
        # Two parameters may do the same to the speeds, to second order in the step: coordinates tell them.
        minima = (size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:])
        found = list(grid) if low == high else list(map(polished, grid[minima]))
        found = [y for y in found if low - SLIGHTLY < y < high + SLIGHTLY]
        if not found:
            return None
        gaps = np.array([[misfit(y), misfit_of_q(y)] for y in found]) + TINY
        x = found[int(np.argmin(np.sum(gaps / gaps.min(axis=0), axis=1)))]
        m, f = family(x)
        if abs(f - m) < SLIGHTLY:  # the trapezoidal rule, which has no memory
            return None

        def columns(at_start: Array, at_end: Array) -> tuple[Array, Array]:
            of_q, of_u = means(x, at_start, at_end, np.zeros_like(at_end))
            return h * h * of_q, h * of_u

        of_q, of_u = means(x, before, behind, mean)
        q = model.moved(at.q, at.u + h * of_q, h)
        fitted = mean.shape[1] * len(stretches) + int(high > low)
        return Remembered(q, at.u + h * of_u, columns, fitted, _alpha_numbers(*family(x)))

    return after


def _alpha_numbers(m: float, f: float) -> dict[str, float]:
    """Numbers of a method with accelerations of its own: these are those of the time δ = (α_m − α_f) h later.

    Its filter of u̇ is 1 + δ hD + δ (α_m − ½) (hD)² + …, D = d/dt.
    """
    gamma, shift = 0.5 + f - m, m - f
    of_q = 0.25 * (gamma + 0.5) ** 2 + 0.5 * shift - 1 / 6
    of_u = 0.5 * gamma + gamma * shift + shift * (m - 0.5) - 1 / 6
    return _second(of_u, of_u) | {"q: a_q u": of_q, "q: a_u a": of_q}


AT_MOST, PER_CAUSE = 1000, 5
"""Numbers of the speeds to which a family's parameter is fitted; or as many for each column of causes."""

SLIGHTLY = 1e-6
"""Change of a parameter of a family of methods by which its derivative is taken, and beyond its bounds."""

COARSE, POLISHING = 8, 6
"""Values of the parameter of a family of methods among which the likeliest is looked for first; steps from
there, of which each doubles the digits."""


@dataclass(frozen=True, eq=False)
class Integrator:
    """A method: its name, its order, the numbers c of its leading error terms, and its map.

    `stages` of it whose forces logs may hold; `later` if it takes forces at the end of the step; `holding` if
    it is one of engines that hold controls over each step, as MuJoCo and Drake's discrete systems do;
    `rotations` if by these alone it differs from another of its name.
    """

    name: str
    order: int
    numbers: dict[str, float]
    step: Step | None = None
    defect: Defect | None = None
    memory: Memory | None = None
    stages: int = 0
    later: bool = False
    holding: bool = False
    rotations: bool = False

    @property
    def samples_once(self) -> bool:
        """Whether it evaluates forces once a step: its rows do not show what they do in between."""
        return self.order == 1 or self.memory is _adams_bashforth


EXACT = Integrator("higher-order", 3, {})
"""All of order three and more whose error is smaller than the fields: their map is the flow."""

VERLET = {"u: a_q a": 1 / 12, "u: a_qq u u": 1 / 12, "q: a_q u": -1 / 6}

SPLIT = (
    Integrator("semi-implicit-euler", 1, _first(0.5, -0.5, -0.5), _kick_first),
    Integrator("semi-implicit-euler-qu", 1, _first(-0.5, 0.5, -0.5), _drift_first(0.0)),
    Integrator("semi-implicit-euler-qu", 1, _first(-0.5, 0.5, -0.5), _drift_first(1.0), later=True),
    Integrator("constant-acceleration", 1, _first(0.0, -0.5, -0.5), _constant_acceleration),
    Integrator("verlet", 2, VERLET, _velocity_verlet),
    Integrator("leapfrog", 2, _first(0.0, 0.0, -0.25), _kick_drift_kick),
    Integrator("leapfrog", 2, _first(0.0, 0.0, -0.5), _kicks_of_one_acceleration),
    Integrator("position-verlet", 2, _first(0.0, 0.0, -0.5), _drift_kick_drift),
)
"""Methods that move coordinates along constant speeds."""

Family: TypeAlias = Callable[[float], tuple[float, float]]
"""α_m and α_f of generalized-α by a parameter."""


def _of_families(*families: tuple[Family, tuple[float, float]]) -> tuple[Integrator, ...]:
    """Methods of families between bounds of their parameters, by forces of either end of a step."""
    return tuple(
        Integrator(
            "generalized-alpha",
            2,
            {},
            memory=_generalized_alpha(family, bounds, later),
            later=later,
        )
        for family, bounds in families
        for later in (True, False)
    )


USUAL = _of_families(
    *((_chung_hulbert, (radius, radius)) for radius in (0.5, 0.8, 0.9)),
    *((_hilber_hughes_taylor, (alpha, alpha)) for alpha in (-0.3, -0.1, -0.05)),
)
"""Generalized-α as programs have it: what rows with noise tell a parameter from is no single method."""


def _implicit(
    name: str, order: int, numbers: dict[str, float], of: Callable[[bool], Defect]
) -> tuple[Integrator, ...]:
    """A method of forces as if held over the step, and of those at both ends."""
    return tuple(
        Integrator(name, order, numbers, defect=of(held), later=not held) for held in (True, False)
    )


def _runge_kutta(
    name: str, order: int, numbers: dict[str, float], tableau: Tableau | str, stages: int = 0
) -> tuple[Integrator, ...]:
    """An explicit method by the rates of quaternions, and by exponentials of rotations, as MuJoCo's."""
    return tuple(
        Integrator(
            name, order, numbers, _explicit(tableau, on_group), stages=stages, rotations=on_group
        )
        for on_group in (False, True)
    )


BY_ALL_DAMPERS = "implicit-all-damping-euler"
"""All dampers are at the end of its step, as in MuJoCo's "implicitfast", those of cords and bodies too.
What these do is no field of its own. Rows show the method by its map alone."""

INTEGRATORS = (
    *_runge_kutta("explicit-euler", 1, _first(-0.5, -0.5, -0.5), "ode1"),
    *SPLIT,
    *(
        Integrator(name, 1, _first(0.5, -0.5, *numbers), _implicit_in(what), holding=True)
        for name, what, numbers in (
            ("implicit-damping-euler", "joints", (-0.5, 1.0)),
            (BY_ALL_DAMPERS, "dampers", (-0.5, 1.0)),
            ("implicit-speed-euler", "speeds", (0.5,)),
        )
    ),
    *_implicit("implicit-euler", 1, _first(0.5, 0.5, 0.5), _implicit_euler),
    *_runge_kutta("heun", 2, _second(1 / 12, -1 / 6), "ode2"),
    *_runge_kutta("explicit-midpoint", 2, _second(-1 / 24, -1 / 6), MIDPOINT),
    *_runge_kutta("ralston", 2, _second(0.0, -1 / 6), RALSTON),
    *_implicit("implicit-midpoint", 2, _second(-1 / 24, 1 / 12), _implicit_midpoint),
    *_implicit("trapezoidal", 2, _second(1 / 12, 1 / 12), _trapezoidal),
    Integrator("adams-bashforth-2", 2, _second(-5 / 12, -5 / 12), memory=_adams_bashforth),
    *_of_families((_chung_hulbert, (0.0, 1.0)), (_hilber_hughes_taylor, (-1 / 3, 0.0))),
    *_runge_kutta("bogacki-shampine", 3, {}, "ode3"),
    *_runge_kutta("kutta-3", 3, {}, KUTTA),
    *_runge_kutta("rk4", 4, {}, "ode4", stages=4),
    *_runge_kutta("dormand-prince", 5, {}, "ode5"),
    *(
        replace(method, step=_by_quaternions(method.step), rotations=True)
        for method in SPLIT
        if method.step is not None
    ),
    EXACT,
)
"""Methods in use. "leapfrog" takes its last half step with the speeds of the middle, and begins the next step
with the same acceleration or with a new one; "verlet" takes it with those of a step of Euler's. The former is
of order one with dampers."""

ITERATIONS = 12
"""Iterations of an acceleration that depends on itself. Each reduces the error by ½ h |∂a/∂u|, the share of a
speed that dampers take in half a step: rounding is reached up to a twentieth."""

MOST_STEPS = 12
"""Steps between two rows up to which a method is repeated: what takes longer is left to the series."""


def step_of(h: Array) -> float:
    """The step of a log that does not say its own, of intervals h (N, 1).

    The shortest of them if all are a whole number of it, else a typical one.
    """
    shortest = float(h.min())
    ratio = h / shortest
    whole = bool(np.all(np.abs(ratio - np.rint(ratio)) <= WHOLE))
    return shortest if whole else float(np.median(h))


WHOLE = 1e-3
"""How near to a whole number of steps intervals are, in steps: clocks are rounded."""


def steps_between(h: Array, step: float | None) -> NDArray[np.intp] | None:
    """Steps (N,) between rows that lie h (N, 1) apart; None where they are no whole number of steps.

    Rows that are no whole number of some unknown step apart are the steps of a solver that chooses them.
    """
    ratio = h[:, 0] / (step or step_of(h))
    counts = np.rint(ratio).astype(np.intp)
    if np.all(np.abs(ratio - counts) <= WHOLE) and counts.min() >= 1:
        return counts
    return np.ones(len(h), dtype=np.intp) if step is None else None


@dataclass(frozen=True, eq=False)
class Map:
    """A method with the rows that it makes of those before, by so many steps (N,) in each interval.

    `columns` and `fitted` as of `Remembered`, of a method with a memory.
    """

    method: Integrator
    counts: NDArray[np.intp]
    end: Rows
    columns: Callable[[Array, Array], tuple[Array, Array]] | None = None
    fitted: int = 0


def maps(
    model: LogModel,
    intervals: Intervals,
    force: ForceBetween,
    counts: NDArray[np.intp] | None,
    parts: int = 1,
    methods: Sequence[Integrator] = (),
    causes: Array | None = None,
    J: Array | None = None,
    projected: Callable[[Rows], Iterator[Rows]] | None = None,
) -> Iterator[Map]:
    """The maps of `methods`, or all; of those of low order alone where steps are `parts` of what is known.

    Parameters of methods are fitted beside accelerations (N, n, P) of `causes`. J (N, 2n, 2n) is ∂ẋ/∂x near
    the ends of the intervals, where it is known. Where `projected` is given, each is followed by
    the same with its ends projected onto the constraints.
    """
    for of in _maps(model, intervals, force, counts, parts, methods, causes, J):
        yield of
        if projected is not None:
            yield from (replace(of, end=end) for end in projected(of.end))


def _maps(
    model: LogModel,
    intervals: Intervals,
    force: ForceBetween,
    counts: NDArray[np.intp] | None,
    parts: int,
    methods: Sequence[Integrator],
    causes: Array | None,
    J: Array | None,
) -> Iterator[Map]:
    """The maps of the methods alone."""
    if counts is None or counts.max() * parts > MOST_STEPS:
        return
    counts, at, end, h = counts * parts, intervals.start, intervals.end, intervals.h
    slopes = cache(lambda: model.jacobian(end) if J is None else J)
    directions = cache(lambda: Directions.of(model.at(at), causes))
    for method in methods or INTEGRATORS:
        if parts > 1 and (method.step is None or method.order > 2):
            continue
        if method.name == "implicit-damping-euler" and not model.damped:
            continue
        if method.name == BY_ALL_DAMPERS and not model.damped_elsewhere:
            continue
        if method.rotations and not model.quaternions:
            continue
        if method.defect is not None and counts.max() == 1:
            q, u = method.defect(model, at, end, intervals.h, force(0.5))
            # One of Newton's steps, from the row and the right-hand side there.
            gap = model.difference(end, Rows(end.t, q, u, end.F))[:, :, None]
            step = _newton(method, slopes(), intervals.h, gap)[:, :, 0]
            yield Map(method, counts, model.displaced(end, step))
        elif method.memory is not None and counts.max() == 1 and np.ptp(h) <= WHOLE * h[0, 0]:
            own = method.memory(model, intervals, directions())
            if own is None:
                continue
            gap = model.difference(end, Rows(end.t, own.q, own.u, end.F))[:, :, None]
            if own.numbers:
                gap = _newton(method, slopes(), h, gap)
                method = replace(method, numbers=own.numbers)
            end_of_step = model.displaced(end, gap[:, :, 0])
            yield Map(method, counts, end_of_step, own.columns, own.fitted)
        elif method.step is not None:
            yield Map(method, counts, _repeated(model, method, intervals, force, counts))


def transition(model: LogModel, of: Map, intervals: Intervals, force: ForceBetween) -> Array | None:
    """Derivatives (N, 2n, 2n) of a method's map by differences; None for an implicit one, or many speeds."""
    if of.method.step is None or model.n > MOST_SPEEDS:
        return None
    at = intervals.start
    starts, sizes = model.neighbours(at, 1e-6)
    Phi, each = np.empty((len(at.t), 2 * model.n, 2 * model.n)), max(1, AT_ONCE // len(at.t))
    for first in range(0, len(starts), each):
        some = starts[first : first + each]
        many = np.tile(np.arange(len(at.t)), len(some))
        moved = replace(intervals.take(many), start=Rows.join(some))
        ends = _repeated(model, of.method, moved, restricted(force, many), of.counts[many])
        change = model.difference(of.end.take(many), ends).reshape(len(some), len(at.t), -1)
        for k, (one, d) in enumerate(zip(change, sizes[first:], strict=False), first):
            Phi[:, :, k] = one / d
    return Phi


NODES = 3
"""Start, middle and end of an interval: a parabola through these is what causes do within it."""


class _Variation:
    """Small changes y of a motion, ẏ = J y + (0, g): methods make steps of it as of a model.

    J (N, 2n, 2n) is given at the nodes of each interval, and lies on a parabola through three of them. Rows
    of the changes are those by units of g at these, for each of the n speeds, interval by interval.
    """

    quaternions = ()
    servos = np.zeros(0)

    def __init__(self, J: Sequence[Array], intervals: Intervals) -> None:
        nodes = [0, len(J) // 2, len(J) - 1]
        self.n = J[0].shape[1] // 2
        self.J = np.stack([J[k][:, self.n :].transpose(0, 2, 1) for k in nodes])
        self.start, self.h = float(intervals.start.t[0]), float(intervals.h[0, 0])
        self.units = NODES * self.n

    def rows(self, t: Array) -> Rows:
        """No changes, at times t (N,)."""
        none = np.zeros((len(t) * self.units, self.n))
        return Rows(np.repeat(t, self.units), none, none, none[:, :0])

    def acceleration(self, t: Array, q: Array, u: Array, _: Array) -> Array:
        """By J and g there."""
        c = (float(t[0]) - self.start) / self.h
        weights = ((2.0 * c - 1.0) * (c - 1.0), 4.0 * c * (1.0 - c), c * (2.0 * c - 1.0))
        J = np.tensordot(weights, self.J, axes=1)
        y = np.concatenate([q, u], axis=1).reshape(-1, self.units, 2 * self.n)
        a = y @ J + np.concatenate([w * np.eye(self.n) for w in weights])
        return np.asarray(a.reshape(-1, self.n))

    def at(self, rows: Rows) -> Array:
        """The same at rows."""
        return self.acceleration(rows.t, rows.q, rows.u, rows.F)

    def rate(self, t: Array, q: Array, u: Array) -> Array:
        """Of coordinates."""
        return u

    def moved(self, q: Array, u: Array, h: Array) -> Array:
        """Along constant speeds."""
        return q + h * u

    def by_quaternions(self) -> _Variation:
        """Small changes are vectors."""
        return self


def by_causes(
    of: Map, J: Sequence[Array], G: Sequence[Array], intervals: Intervals
) -> Array | None:
    """What causes do to the rows of a map (N, 2n, P), by the method's own steps; None where it is not told.

    J (N, 2n, 2n) and G (N, n, P) are ∂ẋ/∂x and the causes' accelerations at the nodes of the flow. Steps are
    linear in these: they are made for units of them alone.
    """
    method, N = of.method, len(intervals)
    if np.ptp(of.counts) or "damping" in method.name or not G[0].shape[2]:
        return None
    if of.columns is not None:
        shape = (N, -1, G[0].shape[2])
        both = of.columns(*(x.reshape(N, -1) for x in (G[0], G[-1])))
        columns = np.concatenate([x.reshape(shape) for x in both], axis=1)
        return _newton(method, J[-1], intervals.h, columns) if method.later else columns
    variation: Any = _Variation(J, intervals)  # has what of a model steps ask for
    units, n = variation.units, variation.n
    start, end = (variation.rows(at.t) for at in (intervals.start, intervals.end))
    if method.step is not None:
        still = Intervals(start, end)
        counts = np.repeat(of.counts, units)
        none = LoggedForce.of(still, [])(())
        moved = _repeated(variation, method, still, none, counts)
        q, u = moved.q, moved.u
    elif method.defect is not None:
        q, u = method.defect(variation, start, end, np.repeat(intervals.h, units, axis=0), start.F)
    else:
        return None
    response = np.concatenate([q, u], axis=1).reshape(N, units, 2 * n).transpose(0, 2, 1)
    if method.defect is not None:
        response = _newton(method, J[-1], intervals.h, response)
    at_nodes = np.concatenate([G[0], G[len(G) // 2], G[-1]], axis=1)
    return np.asarray(response @ at_nodes)


def _newton(method: Integrator, J: Array, h: Array, gap: Array) -> Array:
    """The change (N, 2n, k) of the end of an implicit step that closes a gap."""
    share = 1.0 if method.order == 1 else 0.5
    A = np.eye(J.shape[1]) - share * h[:, :, None] * J
    return np.asarray(np.linalg.solve(A, gap))


MOST_SPEEDS = 12
"""Speeds up to which a method's map is differentiated; of more the flow's derivatives stand for it."""


def _repeated(
    model: LogModel,
    method: Integrator,
    intervals: Intervals,
    force: ForceBetween,
    counts: NDArray[np.intp],
) -> Rows:
    """The states after `counts` (N,) steps in each interval."""
    make, h = method.step, intervals.h / counts[:, None]
    assert make is not None
    # Stages are those of single steps.
    known = counts.max() == 1 and method.stages == len(intervals.stages) + 1
    stages = intervals.stages if known else ()

    def step(
        at: Rows, k: int, some: slice | NDArray[np.intp], counts: int | Array, force: ForceBetween
    ) -> Rows:
        def within(c: float, stage: int = 0) -> Array:
            return stages[stage - 1] if stages and stage else force((k + c) / counts, k / counts)

        q, u = make(model, at, h[some], within)
        return Rows(at.t + h[some, 0], q, u, within(1.0))

    return repeated(intervals.start, counts, force, step)


TRIED = 6
"""Methods that are tried by parts of an interval at most."""

NEAR = 3.0
"""Standard errors within which the numbers of a method agree with those of a log, beside `CLOSE`."""

CLOSE = {1: 0.05, 2: 0.01}
"""What terms of higher order may add to the numbers c of each order."""


@dataclass(frozen=True, eq=False)
class IntegratorEstimate:
    """The integrator of a log, as its error tells.

    Attributes:
        names: methods whose own map closes the rows; else those whose numbers agree with those of the log.
            "higher-order" stands for all of order three and more, whose error is smaller than the fields,
            "adaptive" for a solver that chooses its steps, or whose rows lie between these.
        coefficients: numbers c of the elementary differentials, by their names.
        errors: their standard errors; 0 for a method that closes.
        order: of the error; that of the methods named, else of the lowest field that is seen.
        step: of the integrator, s.
    """

    names: tuple[str, ...]
    coefficients: dict[str, float]
    errors: dict[str, float]
    order: int
    step: float

    @property
    def sentence(self) -> str:
        """In words."""
        if not self.names:
            return "the integrator is none of those known"
        if self.names == ("higher-order",):
            return "the integrator is of order 3 or more"
        if len(self.names) > SHOWN:
            return f"the integrator is of order {self.order} or more"
        return f"the integrator is {' or '.join(self.names)}"


def estimate(c: Array, covariance: Array, damped: bool, step: float) -> IntegratorEstimate:
    """The integrators whose numbers agree with those of a log."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    names, orders = list[str](), list[int]()
    close = np.array([CLOSE[f.order] for f in FIELDS])
    for method in INTEGRATORS:
        if (method.order > 2 and method.name != "higher-order") or method.memory is not None:
            continue
        if method.name == BY_ALL_DAMPERS:
            continue
        own = numbers_of(method)
        if not damped and own[PLACES["u: damping a"]]:
            continue
        compared = [k for k, f in enumerate(FIELDS) if f.order == 1 or method.order > 1]
        if not damped:
            compared = [k for k in compared if "damping" not in FIELDS[k].name]
        if _agrees(c, own, covariance, close, compared):
            names.append(method.name)
            orders.append(method.order)
    first = [k for k, f in enumerate(FIELDS) if f.order == 1]
    seen = bool(np.any(np.abs(c[first]) > NEAR * sigma[first] + CLOSE[1]))
    order = min(orders) if orders else (1 if seen else 2)
    return _estimate(names, c, sigma, order, step)


def identified(methods: tuple[Integrator, ...], step: float) -> IntegratorEstimate:
    """The estimate of a log that is closed by methods' own maps."""
    names, order, c = (
        [m.name for m in methods],
        min(m.order for m in methods),
        numbers_of(methods[0]),
    )
    return _estimate(names, c, np.zeros_like(c), order, step)


def _estimate(
    names: list[str], c: Array, sigma: Array, order: int, step: float
) -> IntegratorEstimate:
    numbers, errors = (dict(zip(PLACES, x.tolist(), strict=True)) for x in (c, sigma))
    return IntegratorEstimate(tuple(dict.fromkeys(names)), numbers, errors, order, step)


def parted(
    c: Array, covariance: Array, parts: Sequence[int], damped: bool
) -> list[tuple[Integrator, int]]:
    """Methods of low order with so many steps in each interval whose leading numbers are nearest to those c.

    The numbers c are of fields with the power of an interval, of which a step is a part.
    """
    orders = np.array([f.order for f in FIELDS])
    of_dampers = np.array(["damping" in f.name for f in FIELDS])
    gaps = list[tuple[float, Integrator, int]]()
    for method in INTEGRATORS:
        if method.step is None or method.order > 2 or method.name == BY_ALL_DAMPERS:
            continue
        if not damped and "damping" in method.name:
            continue
        own = numbers_of(method)
        leading = (orders == orders[np.flatnonzero(own)].min()) | (orders < method.order)
        compared = np.flatnonzero(leading & (damped | ~of_dampers))
        for k in parts:
            scale = float(k) ** -orders[compared]
            gap = c[compared] - own[compared] * scale
            close = np.array([CLOSE[order] for order in orders[compared]]) * scale
            C = covariance[np.ix_(compared, compared)] + np.diag(close**2)
            gaps.append((float(gap @ np.linalg.solve(C, gap)) / len(compared), method, k))
    return [(method, k) for _, method, k in sorted(gaps, key=lambda item: item[0])[:TRIED]]


def numbers_of(method: Integrator) -> Array:
    """Its numbers c in the order of `FIELDS`."""
    own = np.zeros(len(FIELDS))
    for name, value in method.numbers.items():
        own[PLACES[name]] = value
    return own


def _agrees(c: Array, own: Array, covariance: Array, close: Array, compared: list[int]) -> bool:
    """Whether numbers differ by no more than their errors, along directions that the log tells."""
    gap = (c - own)[compared]
    C = covariance[np.ix_(compared, compared)] + np.diag(close[compared] ** 2)
    return bool(gap @ np.linalg.solve(C, gap) <= NEAR**2 * max(1.0, len(compared) / 3.0))
