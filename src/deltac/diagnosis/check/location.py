"""Where wrong equations are wrong: which equation, what it varies with, which term; a state that shows it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import HALF_DIGITS, Array
from deltac.calls.progress import Parts, Progress, counted, no_progress
from deltac.diagnosis.check.matching import (
    Match,
    explain_acceleration,
    explain_plainly,
    explain_row,
)
from deltac.diagnosis.residuals.at_states import EquationTest, rms
from deltac.diagnosis.residuals.function import Caller
from deltac.diagnosis.residuals.kane import times
from deltac.diagnosis.residuals.states import TRIAL_STATES, States, admissible, joined
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.errors import InputError
from deltac.results import Serialisable, fraction

SCALINGS = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""Factors of all speeds; five, so that polynomials up to the fourth degree are told apart."""


@dataclass(frozen=True, eq=False)
class Blame(Serialisable):
    """One of the equations that do not hold.

    Attributes:
        speed: the own speed it belongs to, and `number`, its place (from 1).
        relative: root mean square of F_r + F*_r over the states, as a fraction of the equation's terms.
        residual: the same in `unit`.
        acceleration: root mean square error of u̇ of that speed, in `acceleration_unit`.
        degrees: the powers of the rates that the residual consists of; None if it is no polynomial.
        depends_on: what it changes with, ``t``, ``q.<coordinate>``, ``u.<speed>``; None if not known.
        terms: what it consists of, if that could be told.
        solved: what the error of u̇ consists of, where only some accelerations are wrong and the equations
            seem to be solved for them by hand: terms of the model as M⁻¹ brings them into this acceleration.
        span: of a motion, the time (s) that holds most of the residual.
    """

    speed: str
    number: int
    relative: float
    residual: float
    unit: str
    acceleration: float
    acceleration_unit: str
    degrees: tuple[int, ...] | None = None
    depends_on: tuple[str, ...] | None = None
    terms: tuple[Match, ...] = ()
    solved: tuple[Match, ...] = ()
    span: tuple[float, float] | None = None

    def __str__(self) -> str:
        parts = [
            f"equation {self.number} ({self.speed}) is off by {fraction(self.relative)} of its terms"
            + (" in the mean" if self.span is None else "")
        ]
        if self.span is not None:
            parts[0] += f", mostly from t = {self.span[0]:.4g} to {self.span[1]:.4g} s"
        if self.degrees:
            parts.append(
                _POWERS.get(self.degrees)
                or f"of degree {' and '.join(map(str, self.degrees))} in the rates"
            )
        if self.depends_on is not None and len(self.depends_on) <= 4:
            what = ", ".join(self.depends_on)
            parts.append(f"a function of {what} alone" if what else "a constant")
        if self.solved:
            parts.append(
                f"in u̇.{self.speed} as it is solved for: {' and '.join(map(str, self.solved))}"
            )
        elif self.terms:
            parts.append(" and ".join(map(str, self.terms)))
        return "; ".join(parts)


def explained(blamed: tuple[Blame, ...]) -> bool:
    """Whether one term says it all of every equation, its factor being plain or a formula."""
    each = [entry.solved or entry.terms for entry in blamed]
    return all(len(one) == 1 and (one[0].plain or one[0].formula or one[0].ratio) for one in each)


def without_sums(blamed: tuple[Blame, ...]) -> tuple[Blame, ...]:
    """The same without sums of several terms with odd factors: what all equations have is another cause."""
    return tuple(
        entry
        if len(entry.terms) == 1 or (entry.terms and all(m.plain for m in entry.terms))
        else replace(entry, terms=(), solved=())
        for entry in blamed
    )


_POWERS: dict[tuple[int, ...], str] = {
    (0,): "independent of the rates",
    (1,): "linear in the rates",
    (2,): "quadratic in the rates",
}


def blame(
    test: EquationTest,
    udot: Array,
    limit: Array,
    caller: Caller | None = None,
    progress: Progress = no_progress,
) -> tuple[Blame, ...]:
    """Every equation whose residual passes `limit` (n,), as a fraction of its terms; the worst first.

    `caller` gives accelerations at further states; without it what a residual varies with is not known.
    """
    good: NDArray[np.bool_] = np.asarray(np.isfinite(udot).all(axis=0))
    blamed = _failing(test, udot, limit, good)
    tied = bool(len(test.gamma))
    if blamed and caller is not None:
        typical = test.typical(udot)
        base = _bases(test, test.residual(udot)[:, good] / typical[:, None], good)
        degrees = _degrees(caller, test, base, typical, limit)
        blamed = [replace(b, degrees=degrees[b.number - 1]) for b in blamed]
        if not tied:
            depends = _dependence(caller, test, base, typical, limit)
            blamed = [replace(b, depends_on=depends[b.number - 1]) for b in blamed]
    if tied or not good.all():
        return tuple(blamed)
    return _explained(test, udot, blamed, limit, progress)


def _failing(test: EquationTest, udot: Array, limit: Array, good: NDArray[np.bool_]) -> list[Blame]:
    """The equations whose residual passes `limit` (n,) at the states that are `good`, the worst first."""
    relative = test.relative(udot)[:, good].max(axis=1, initial=0.0)
    residual, wrong = test.residual(udot)[:, good], (udot - test.acceleration)[:, good]
    sizes, errors = rms(residual), rms(wrong)
    typical = test.typical(udot)
    units, rates = _units(test)
    return [
        Blame(
            speed=test.speeds[k],
            number=k + 1,
            relative=float(sizes[k] / typical[k]),
            residual=float(sizes[k]),
            unit=units[k],
            acceleration=float(errors[k]),
            acceleration_unit=rates[k],
        )
        for k in map(int, np.argsort(-relative))
        if relative[k] > limit[k]
    ]


def _explained(
    test: EquationTest, udot: Array, blamed: list[Blame], limit: Array, progress: Progress
) -> tuple[Blame, ...]:
    """The same with what each error consists of.

    The model's own terms in the rows of M u̇ = f first; where some rows have no such sum, the errors of the
    accelerations; else plain functions.
    """
    residual = test.residual(udot)
    rows = {b.speed: b.number - 1 for b in blamed}
    parts = Parts(progress, {"own": 0.5, "plain": 0.5})
    places = counted(list(rows.values()), parts.part("own"))
    own = {k: explain_row(test, residual[k], udot, k) for k in places}
    if not all(own.values()):
        error = udot - test.acceleration
        size = np.abs(test.acceleration).max(axis=1)
        wrong = [int(k) for k in np.flatnonzero(np.abs(error).max(axis=1) > limit.max() * size)]
        solved = {k: explain_acceleration(test, error[k], k) for k in wrong}
        if wrong and all(solved.values()):
            unsolved = [b for b in blamed if rows[b.speed] in wrong]
            return tuple(replace(b, solved=solved[rows[b.speed]]) for b in unsolved)
    explained = []
    for b in counted(blamed, parts.part("plain")):
        k = rows[b.speed]
        terms = own[k] or explain_plainly(test, residual[k], udot, b.depends_on)
        explained.append(replace(b, terms=terms))
    return tuple(explained)


def _varied(test: EquationTest, caller: Caller, states: States) -> Array:
    """The residual at other states (n, S), which need not meet constraints."""
    varied = EquationTest(test.kane, states, strict=False)
    return varied.residual(caller(states))


def _bases(test: EquationTest, relative: Array, good: NDArray[np.bool_]) -> States:
    """The first states and those that fail worst: an error may show at a few only, as of slow slip."""
    first = np.arange(min(TRIAL_STATES // 2, len(test.states)))
    worst = np.flatnonzero(good)[np.argsort(-np.abs(relative).max(axis=0), kind="stable")]
    rest = worst[~np.isin(worst, first)]
    return test.states.take(np.concatenate([first, rest[: TRIAL_STATES - len(first)]]))


def _degrees(
    caller: Caller, test: EquationTest, base: States, typical: Array, limit: Array
) -> list[tuple[int, ...] | None]:
    """Powers of the rates in each equation's residual: all speeds are scaled together."""
    states = joined([replace(base, u=s * base.u) for s in SCALINGS])
    values = _varied(test, caller, states).reshape(-1, len(SCALINGS), len(base))
    powers = np.vander(np.array(SCALINGS), increasing=True)
    parts = np.linalg.solve(powers, values)
    rows: list[tuple[int, ...] | None] = []
    for k in range(len(values)):
        size = np.abs(parts[k]).max(axis=1)
        degrees = tuple(int(d) for d in np.flatnonzero(size > 10 * limit[k] * typical[k]))
        usable = np.isfinite(size).all() and all(d <= 2 for d in degrees)
        rows.append(degrees if usable else None)
    return rows


def _dependence(
    caller: Caller, test: EquationTest, base: States, typical: Array, limit: Array
) -> list[tuple[str, ...]]:
    """What each equation's residual changes with: one variable at a time is taken from another state."""
    variables = _variables(test)
    states = [base]
    for _, kind, where in variables:
        values = getattr(base, kind).copy()
        values[where] = np.roll(values[where], 1, axis=-1)
        states.append(replace(base, **{kind: values}))
    values = _varied(test, caller, joined(states)).reshape(-1, len(states), len(base))
    change = np.abs(values[:, 1:] - values[:, :1]).max(axis=2)
    steady = change <= 10 * (limit * typical)[:, None]  # what is not finite is not
    return [tuple(v[0] for v, still in zip(variables, row) if not still) for row in steady]


def _variables(test: EquationTest) -> list[tuple[str, str, Any]]:
    """Name, array and place of what is varied; a quaternion as a whole."""
    states, speeds = test.states, [(f"u.{n}", "u", k) for k, n in enumerate(test.states.speeds)]
    if test.kane.assembled:  # one coordinate alone would leave the constraints
        return speeds
    turned = orientations(test)
    single = np.ones(len(states.coordinates), dtype=np.bool_)
    for place in turned.values():
        single[place] = False
    return [
        ("t", "t", slice(None)),
        *((f"q.{joint} (orientation)", "q", place) for joint, place in turned.items()),
        *((f"q.{n}", "q", k) for k, n in enumerate(states.coordinates) if single[k]),
        *speeds,
    ]


def orientations(test: EquationTest) -> dict[str, slice]:
    """The places of quaternions among the coordinates, by joint; own coordinates have none."""
    kane = test.kane
    if kane.coordinates is not None and kane.coordinates.q:
        return {}
    return dict(zip(kane.mechanism.quaternions, kane.motion.quaternions, strict=True))


def _units(test: EquationTest) -> tuple[list[str], list[str]]:
    """Units of the equations and of the accelerations; empty for own speeds, whose units nobody says."""
    if test.kane.coordinates is not None:
        return [""] * len(test.speeds), [""] * len(test.speeds)
    entries = [test.kane.mechanism.speeds[int(k)] for k in test.kane.mechanism.free.u]
    return (
        ["N" if e.unit == "m/s" else "N·m" for e in entries],
        [f"{e.unit}²" for e in entries],
    )


# --- a state as simple as can be at which equations fail -------------------------------------------

PLAIN = (1.0, 0.5, 2.0, 10.0)
"""Values that are tried, after zero, in place of an odd one."""


@dataclass(frozen=True, eq=False)
class Example:
    """A state at which the equations fail, most of it zero.

    `state` by name (``t``, ``q.<coordinate>``, ``u.<speed>``); the accelerations by speed: `given` by the
    tested equations, `right` by the mechanism; `speed` is the equation that fails, by `relative` of its
    typical terms.
    """

    state: Mapping[str, float]
    given: Mapping[str, float]
    right: Mapping[str, float]
    speed: str
    relative: float

    def __str__(self) -> str:
        moved = {name: x for name, x in self.state.items() if x != 0.0}
        where = ", ".join(f"{name} = {x:.6g}" for name, x in moved.items())
        where = f"{where}, all else zero" if moved else "the zero state"
        rounding = 1e-12 * max(map(abs, (*self.given.values(), *self.right.values())))
        differences = {n: _difference(x, self.right[n], rounding) for n, x in self.given.items()}
        worst = max(differences, key=lambda n: differences[n])
        lines = [
            f"u̇.{n}: the equations give {_with_digits(self.given[n], differences[n])}, the model "
            f"{_with_digits(self.right[n], differences[n])}"
            for n in differences
            if n == worst or differences[n] > HALF_DIGITS
        ]
        return f"At {where}: " + "; ".join(lines)


def _difference(a: float, b: float, rounding: float) -> float:
    """How far two numbers differ, relative to the larger; 0 for what rounding leaves of zero."""
    return 0.0 if abs(a - b) <= rounding else abs(a - b) / max(abs(a), abs(b))


def _with_digits(value: float, difference: float) -> str:
    """A number with the digits that show a relative difference, six at least."""
    digits = 6 if difference <= 0.0 else int(np.clip(np.ceil(-np.log10(difference)) + 2, 6, 17))
    return f"{value:.{digits}g}"


def simplest_failure(
    caller: Caller, test: EquationTest, udot: Array, limit: Array
) -> Example | None:
    """A failing state with as many zeros as single steps lead to, from the state that fails worst.

    Time, speeds and coordinates are set to zero one by one, then to plain numbers, and moved back onto the
    constraints, as long as an equation still misses by more than `limit` (n,).
    """
    typical = test.typical(udot)
    with np.errstate(all="ignore"):
        excess = (_missed(test, udot) / (limit * typical)[:, None]).max(axis=0)
    excess[~np.isfinite(excess)] = -1.0
    if excess.max() <= 1.0:
        return None
    # A simple state must show at least half of the worst failure's orders of magnitude, to convince.
    shown = limit * float(np.sqrt(excess.max()))

    def at(state: States) -> tuple[EquationTest, Array, Array]:
        """The equations at a state, the accelerations given there, and what they miss, relative (n,)."""
        equations, accelerations = EquationTest(test.kane, state, strict=False), caller(state)
        return equations, accelerations[:, 0], _missed(equations, accelerations)[:, 0] / typical

    def fails(state: States) -> bool:
        """Whether the state is admissible and an equation misses there by more than is to be shown."""
        with np.errstate(all="ignore"), suppress(InputError):
            if admissible(test.kane, state)[0]:
                missed = at(state)[2]
                return bool(np.isfinite(missed).all() and (missed > shown).any())
        return False

    state = test.states.take([int(np.argmax(excess))])
    moves = _moves(test)
    plain = [(name, k, PLAIN) for name, k, zero in moves if name != "t" and np.ndim(zero) == 0]
    for name, k, values in [(name, k, (zero,)) for name, k, zero in moves] + plain:
        if values is PLAIN and getattr(state, name)[k, 0] == 0.0:
            continue
        for value in values:
            array = getattr(state, name).copy()
            array[k] = value
            trial = _onto_constraints(test, replace(state, **{name: array}))
            gain = _zeros(trial) - _zeros(state)
            if (gain > 0 or (gain == 0 and values is PLAIN)) and fails(trial):
                state = trial
                break
    equations, accelerations, missed = at(state)
    worst = int(np.argmax(missed / shown))
    return Example(
        state=state.describe(0),
        given=dict(zip(test.speeds, map(float, accelerations))),
        right=dict(zip(test.speeds, map(float, equations.acceleration[:, 0]))),
        speed=test.speeds[worst],
        relative=float(missed[worst]),
    )


def _missed(test: EquationTest, udot: Array) -> Array:
    """Inertia forces of the error of accelerations (n, B): the residual, and what violates constraints."""
    return np.abs(times(test.M, udot - test.acceleration))


def _zeros(state: States) -> int:
    """How many entries are zero; a quaternion that is the identity has three."""
    return sum(int((x == 0.0).sum()) for x in (state.t, state.q, state.u))


def _onto_constraints(test: EquationTest, state: States) -> States:
    """The state moved onto the constraints, its smallest entries to zero."""
    kane = test.kane
    if not len(test.gamma) or kane.own is not None:
        return state
    q = _without_rounding(onto_positions(kane.motion, state.t, state.q))
    return replace(state, q=q, u=_without_rounding(onto_speeds(kane.motion, state.t, q, state.u)))


def _without_rounding(x: Array) -> Array:
    return np.where(np.abs(x) < 1e-12, 0.0, x)


def _moves(test: EquationTest) -> list[tuple[str, Any, Any]]:
    """What is set to zero, one after the other; a quaternion as a whole, to the identity."""
    moves = [
        (kind, place, np.eye(4)[:, :1] if kind == "q" and isinstance(place, slice) else 0.0)
        for _, kind, place in _variables(test)
    ]
    # Time and speeds first, then coordinates, each alone before whole orientations: the simplest state wins.
    return sorted(moves, key=lambda move: ("tuq".index(move[0]), isinstance(move[1], slice)))
