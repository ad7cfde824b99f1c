"""Causes that concern a function as a whole: other coordinates, another model, a linearised version.

Each is a hypothesis that is tested: the function is called at the states as it would see them, or the model
is given other parameters, masses or forces, and all accelerations must agree.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, islice, permutations
from math import factorial

import numpy as np

from deltac.arrays import HALF_DIGITS, Array, max_norm
from deltac.diagnosis.causes.causes import Candidate, candidates
from deltac.diagnosis.causes.columns import LogEquations, column_kernels
from deltac.diagnosis.explain.result import sentence
from deltac.diagnosis.inference.hypotheses import Block, Fit, search
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.function import MOST_HYPOTHESES, Caller
from deltac.diagnosis.residuals.kane import Kane, times
from deltac.diagnosis.residuals.states import TRIAL_STATES, States
from deltac.diagnosis.verdict import Finding
from deltac.dynamics.equations_of_motion import quaternions
from deltac.errors import InputError
from deltac.trajectories import Provenance, Trajectory

SMALL = (1e-2, 1e-3)
"""Angles are made this small to see how an error goes to zero."""


@dataclass(frozen=True)
class Convention:
    """Coordinates A q + c, speeds B u and accelerations B u̇ that a function may mean, in words."""

    words: str
    remedy: str
    A: Array
    c: Array
    B: Array

    def seen(self, states: States) -> States:
        """The states as the function would see them."""
        return replace(states, q=self.A @ states.q + self.c[:, None], u=self.B @ states.u)


def whole_causes(caller: Caller, test: EquationTest, *, explained: bool) -> tuple[Finding, ...]:
    """What explains all errors of a function at once.

    Where the terms that are wrong are `told`, one to an equation, only other coordinates are tried.
    """
    causes = _coordinates(caller, test)
    if causes or explained:
        return causes
    udot = _called(caller, test.states)
    return (
        _parameters(caller, test)
        or (() if udot is None else causes_of_model(test, udot))
        or _linear(caller, test)
    )


# --- coordinates ------------------------------------------------------------------------------------


def _coordinates(caller: Caller, test: EquationTest) -> tuple[Finding, ...]:
    if not _simple(test):
        return ()
    some = _some(test.states)
    right = test.acceleration[:, : len(some)]
    # One state refutes nearly every hypothesis, and functions may be slow.
    k = int(np.argmax(np.abs(right).max(axis=0)))
    one = some.take(np.array([k]))
    for frame in islice(_frames(test), MOST_HYPOTHESES):
        if _agree(_called(caller, frame.seen(one)), frame.B @ right[:, [k]]) and _agree(
            _called(caller, frame.seen(some)), frame.B @ right
        ):
            return (
                Finding(
                    "coordinates",
                    f"the function is right {frame.words}",
                    f"all accelerations agree then, at {len(some)} states",
                    frame.remedy,
                    "cause",
                ),
            )
    return ()


def _frames(test: EquationTest) -> Iterator[Convention]:
    """Coordinates and speeds that a function may mean, the likeliest first."""
    names = test.states.coordinates
    n = len(names)
    one, zero = np.eye(n), np.zeros(n)
    check = "Measure it as the model does, or check with a dc.CoordinateMap that says so"
    groups: list[tuple[str, list[int]]] = [(f"{name} is", [k]) for k, name in enumerate(names)]
    if n > 1:
        groups.append(("all coordinates are", list(range(n))))
    for subject, members in groups:
        chosen = np.isin(np.arange(n), members)
        flipped = np.diag(np.where(chosen, -1.0, 1.0))
        yield Convention(f"if {subject} counted the other way", check, flipped, zero, flipped)
        for angle, text in ((np.pi, "π"), (np.pi / 2, "π/2"), (-np.pi / 2, "−π/2")):
            shift = np.where(chosen, angle, 0.0)
            words = f"if {subject} measured from elsewhere, {text} more"
            yield Convention(words, check, one, shift, one)
            yield Convention(f"{words}, and the other way", check, flipped, shift, flipped)
    degrees = np.degrees(1.0)
    for subject, members in groups:
        chosen = np.isin(np.arange(n), members)
        D = np.diag(np.where(chosen, degrees, 1.0))
        remedy = "Convert them with np.radians"
        yield Convention(f"if {subject} in degrees, with rates in degrees", remedy, D, zero, D)
        yield Convention(f"if {subject} in degrees", remedy, D, zero, one)
    orders = permutations(range(n)) if factorial(n) <= MOST_HYPOTHESES else _exchanges(n)
    for order in orders:
        if order != tuple(range(n)):
            P = one[list(order)]
            listed = ", ".join(names[k] for k in order)
            yield Convention(
                f"if its coordinates are in the order {listed}", "Order them", P, zero, P
            )


def _exchanges(n: int) -> Iterator[tuple[int, ...]]:
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield tuple(order)


# --- parameters -------------------------------------------------------------------------------------


def _parameters(caller: Caller, test: EquationTest) -> tuple[Finding, ...]:
    """One parameter of another value, or two exchanged."""
    if len(test.gamma):
        return ()
    some = _some(test.states)
    udot = _called(caller, some)
    if udot is None:
        return ()
    model = _Varied(test, some)
    values = model.known
    for name, value in islice(values.items(), MOST_HYPOTHESES):
        factor = _factor(model, udot, name, value)
        if factor is not None:
            right, remedy = f"{name} = {factor * value:.6g}", f"Give {name} the same value in both"
            return (_value(right, f"{name} = {value:.6g}", remedy, name),)
    for a, b in islice(combinations(values, 2), MOST_HYPOTHESES):
        if values[a] == values[b]:
            continue
        exchanged = model.changed({a: values[b], b: values[a]})
        if exchanged is not None and _agree(udot, exchanged.acceleration):
            has = f"{a} = {values[a]:.6g} and {b} = {values[b]:.6g}"
            return (_value(f"{a} and {b} exchanged", has, f"Exchange {a} and {b}", a),)
    return ()


def _value(right: str, has: str, remedy: str, name: str) -> Finding:
    what = f"the function is right with {right}"
    return Finding("parameter-value", what, f"the model has {has}", remedy, "cause", name)


@dataclass(frozen=True, eq=False)
class _Varied:
    """The model of a test at some states, with other values of its parameters: traced once for all."""

    test: EquationTest
    states: States

    @cached_property
    def known(self) -> Mapping[str, float]:
        """The parameters that are not zero."""
        return {n: x for n, x in self.test.kane.mechanism.parameters.items() if x != 0.0}

    @cached_property
    def _kane(self) -> Kane:
        own = self.test.kane
        varied = Kane(own.mechanism, own.coordinates, vary=tuple(self.known))
        varied.scales = own.scales  # symbols have no size
        return varied

    def changed(self, values: Mapping[str, float]) -> EquationTest | None:
        """The equations with other values of some parameters; None where the mechanism allows no such.

        A mechanism that has no inertia left with them has no accelerations to compare.
        """
        try:
            self.test.kane.mechanism.with_parameters(**values)
            p = [*{**self.known, **values}.values()]
            test = EquationTest(self._kane, self.states, p=p, strict=False)
            return test if np.isfinite(test.acceleration).all() else None
        except (InputError, np.linalg.LinAlgError):
            return None


def _factor(model: _Varied, udot: Array, name: str, value: float) -> float | None:
    """The factor of a parameter with which the model has these accelerations; None if there is none.

    Terms are polynomials of the second degree in most parameters; then three values of one tell its residual
    at all others, and where it is zero.
    """
    at = (1.0, 1.5, 2.0)
    rows = []
    for factor in at:
        changed = model.changed({name: factor * value})
        if changed is None:
            return None
        rows.append(changed.residual(udot))
    a, b, c = np.linalg.solve(np.vander(np.array(at)), np.array([x.ravel() for x in rows]))
    place = int(np.argmax(np.abs(a) + np.abs(b)))
    for root in np.roots([float(x[place]) for x in (a, b, c)]):
        factor = float(np.real(root))
        if abs(np.imag(root)) > 1e-6 * abs(root) or abs(factor - 1.0) < 1e-6 or factor <= 0.0:
            continue
        changed = model.changed({name: factor * value})
        if changed is not None and _agree(udot, changed.acceleration):
            return factor
    return None


# --- another mass, force or element -----------------------------------------------------------------


def causes_of_model(test: EquationTest, udot: Array) -> tuple[Finding, ...]:
    """The few changes of the model that make its accelerations those of a function, u̇ (n, B).

    F_r + F*_r at the states is regressed on the columns of all causes, as for a log: states drawn at random
    know no integrator and no noise. A change is only told where all equations hold with it.
    """
    block, causes = _regression(test, udot)

    def sizes(fit: Fit) -> Array:
        """How much each cause of a fit changes the equations."""
        effects = [block.D[..., list(c.columns)] @ fit.of(k) for k, c in enumerate(fit.chosen)]
        return np.array([float(np.linalg.norm(effect)) for effect in effects])

    posterior = search([block], causes, sizes, 0.0)
    best = posterior.best
    if np.linalg.norm(block.residual(best.coefficients)) > HALF_DIGITS * np.linalg.norm(block.r):
        return ()
    mechanism = test.kane.mechanism

    def words(fit: Fit, k: int) -> str:
        text = sentence(mechanism, fit.chosen[k], fit.theta[k], fit.deviation(k))
        return text.replace("the run", "the function")

    others = [
        " and ".join(words(f, k) for k in range(len(f.chosen))) for f in posterior.alternatives
    ]
    holds = f"all equations hold then, at {len(test.states)} states"
    evidence = "; or ".join((holds, *others))
    return tuple(
        Finding(c.kind, words(best, k), evidence, SAME_IN_BOTH, "cause", c.element)
        for k, c in enumerate(best.chosen)
    )


def _regression(test: EquationTest, udot: Array) -> tuple[Block, tuple[Candidate, ...]]:
    """The equations at accelerations u̇ (n, B) on the columns of all causes, each by the size of its terms."""
    mechanism, point, count = test.kane.mechanism, test.point, len(test.states)
    free = mechanism.free
    q, u = (
        np.zeros((count, len(mechanism.coordinates))),
        np.zeros((count, len(mechanism.speeds))),
    )
    q[:, free.q], u[:, free.u] = point.q.T, point.u.T
    drawn = Trajectory(
        t=np.arange(float(count)), q=q, u=u, coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names, provenance=Provenance("states"),
    )  # fmt: skip
    evaluator = LogEquations(mechanism, drawn)
    kernels = column_kernels(evaluator)
    rates = np.zeros((count, 0))
    accelerations = (times(point.Y, udot) + point.rest).T
    values = kernels(test.states.t, point.q.T, point.u.T, accelerations, rates, rates, rates)
    values = np.einsum("tij,tik->tjk", point.Y, values) / test.typical(udot)[:, None]
    places = np.arange(values.shape[2] - 1)
    empty = np.arange(0), np.zeros(0)
    block = Block(values[..., 0], -values[..., 1:], *empty, places, HALF_DIGITS**2)
    every_cause = candidates(evaluator, kernels.columns)
    return block, tuple(c for c in every_cause if c.kind not in OF_A_LOG)


SAME_IN_BOTH = "Give model and function the same"

OF_A_LOG = ("zero-offset", "missing-stop")
"""Causes of a log, and of places that a motion reaches; another zero is one of the coordinates."""


# --- linearised -------------------------------------------------------------------------------------


def _linear(caller: Caller, test: EquationTest) -> tuple[Finding, ...]:
    """Whether the function is linear in the state, or right for small coordinates alone."""
    if not _simple(test) or len(test.gamma):
        return ()
    some = _some(test.states)
    other = replace(some, q=np.roll(some.q, 1, axis=1), u=np.roll(some.u, 1, axis=1))
    middle = replace(some, q=0.5 * (some.q + other.q), u=0.5 * (some.u + other.u))
    values = [_called(caller, replace(s, t=some.t)) for s in (some, other, middle)]
    a, b, c = values
    linear = a is not None and b is not None and c is not None and _agree(c, 0.5 * (a + b))
    power = _order(caller, test, some)
    near = power is not None and power >= 1.5
    if not (linear or near):
        return ()
    what = "right for small coordinates: a small-angle version"
    evidence = f"its error goes to zero as the power {power:.1f} of the coordinates" if near else ""
    if linear:
        about = "" if near else ", and not"
        what = f"linear in the state: a linearised version{about} of the model about zero"
        evidence = "its accelerations are means of those at two states in the middle between them"
    remedy = "Compare it with dc.linearise, or keep the sines and cosines"
    return (Finding("linearised", f"the function is {what}", evidence, remedy, "cause"),)


def _order(caller: Caller, test: EquationTest, some: States) -> float | None:
    """The power of small coordinates with which the error goes to zero; None if it does not."""
    errors = []
    for small in SMALL:
        near = replace(some, q=small * some.q)
        udot = _called(caller, near)
        if udot is None:
            return None
        right = EquationTest(test.kane, near, strict=False).acceleration
        errors.append(max_norm(udot - right))
    size = max_norm(test.acceleration)
    if not 0.0 < errors[1] < errors[0] < size:
        return None
    return float(np.log(errors[0] / errors[1]) / np.log(SMALL[0] / SMALL[1]))


# --- helpers ----------------------------------------------------------------------------------------


def _simple(test: EquationTest) -> bool:
    """Whether speeds are the rates of the coordinates, one by one."""
    kane = test.kane
    own = kane.coordinates
    if kane.assembled or len(test.states.coordinates) != len(test.speeds):
        return False
    if own is None:
        return not quaternions(kane.mechanism)
    return bool(np.allclose(test.rates, test.states.u))


def _some(states: States) -> States:
    return states.take(np.arange(min(TRIAL_STATES, len(states))))


def _called(caller: Caller, states: States) -> Array | None:
    """The function's accelerations; None where it raises or they are not finite."""
    try:
        accelerations = caller(states)
    except InputError:
        return None
    return accelerations if np.isfinite(accelerations).all() else None


def _agree(accelerations: Array | None, right: Array) -> bool:
    if accelerations is None:
        return False
    return bool(
        np.abs(accelerations - right).max() <= HALF_DIGITS * np.abs(right).max(initial=1e-300)
    )
