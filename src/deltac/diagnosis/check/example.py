"""A state as simple as can be at which equations fail."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deltac.arrays import HALF_DIGITS, Array
from deltac.diagnosis.check.location import orientations
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.function import Caller
from deltac.diagnosis.residuals.kane import times
from deltac.diagnosis.residuals.states import States, admissible
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.errors import InputError

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
    probe = _Probe(caller, test, typical, limit * float(np.sqrt(excess.max())))
    start = test.states.take([int(np.argmax(excess))])
    return probe.example(_simplified(test, probe, start))


def _missed(test: EquationTest, udot: Array) -> Array:
    """Inertia forces of the error of accelerations (n, B): the residual, and what violates constraints."""
    return np.abs(times(test.M, udot - test.acceleration))


def _simplified(test: EquationTest, probe: _Probe, state: States) -> States:
    """The state with zeros, and plain numbers, wherever it still fails."""

    def tried(state: States, name: str, k: Any, value: Any, plain: bool = False) -> States | None:
        array = getattr(state, name).copy()
        array[k] = value
        trial = _onto_constraints(test, replace(state, **{name: array}))
        gained = _zeros(trial) - _zeros(state)
        simpler = gained >= 0 if plain else gained > 0
        return trial if simpler and probe.fails(trial) else None

    for name, k, value in _moves(test):
        state = tried(state, name, k, value) or state
    for name, k in _single(test):
        if getattr(state, name)[k, 0] == 0.0:
            continue
        trials = (tried(state, name, k, value, plain=True) for value in PLAIN)
        state = next((trial for trial in trials if trial is not None), state)
    return state


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
    zeros = [(name, k, 0.0) for name, k in _single(test)]
    if test.kane.assembled:  # a coordinate alone would leave the constraints, and so would the time
        return [move for move in zeros if move[0] == "u"]
    identity = np.eye(4)[:, :1]
    turned = [("q", place, identity) for place in orientations(test).values()]
    return [("t", slice(None), 0.0), *zeros, *turned]


def _single(test: EquationTest) -> list[tuple[str, int]]:
    """Speeds, then coordinates, that may be changed one by one: those of no quaternion."""
    whole = {k for place in orientations(test).values() for k in range(place.start, place.stop)}
    places = [("u", k) for k in range(len(test.states.u))]
    return places + [("q", k) for k in range(len(test.states.q)) if k not in whole]


@dataclass(frozen=True, eq=False)
class _Probe:
    """One state at a time, judged by the typical terms of many."""

    caller: Caller
    test: EquationTest
    typical: Array
    limit: Array

    def fails(self, state: States) -> bool:
        """Whether the state is admissible and an equation misses there by more than the limit."""
        try:
            accelerations, test = self._at(state)
        except InputError:
            return False
        with np.errstate(all="ignore"):
            if not admissible(self.test.kane, state)[0]:
                return False
            missed = _missed(test, accelerations)[:, 0]
        return bool(np.isfinite(missed).all() and (missed > self.limit * self.typical).any())

    def example(self, state: States) -> Example:
        """The state in words."""
        accelerations, test = self._at(state)
        missed = _missed(test, accelerations)[:, 0] / self.typical
        worst = int(np.argmax(missed / self.limit))
        names = self.test.speeds
        return Example(
            state=state.describe(0),
            given=dict(zip(names, map(float, accelerations[:, 0]))),
            right=dict(zip(names, map(float, test.acceleration[:, 0]))),
            speed=names[worst],
            relative=float(missed[worst]),
        )

    def _at(self, state: States) -> tuple[Array, EquationTest]:
        test = EquationTest(self.test.kane, state, strict=False)
        return self.caller(state), test
