"""A state as simple as can be at which equations fail."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
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
    shown = limit * float(np.sqrt(excess.max()))

    def at(state: States) -> tuple[EquationTest, Array, Array]:
        """The equations at a state, the accelerations given there, and what they miss, relative (n,)."""
        there, given = EquationTest(test.kane, state, strict=False), caller(state)
        return there, given[:, 0], _missed(there, given)[:, 0] / typical

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
    there, given, missed = at(state)
    worst = int(np.argmax(missed / shown))
    return Example(
        state=state.describe(0),
        given=dict(zip(test.speeds, map(float, given))),
        right=dict(zip(test.speeds, map(float, there.acceleration[:, 0]))),
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
    speeds = [("u", k, 0.0) for k in range(len(test.states.u))]
    if test.kane.assembled:  # a coordinate alone would leave the constraints, and so would the time
        return speeds
    turned = orientations(test).values()
    whole = {k for place in turned for k in range(place.start, place.stop)}
    single = [("q", k, 0.0) for k in range(len(test.states.q)) if k not in whole]
    return [
        ("t", slice(None), 0.0),
        *speeds,
        *single,
        *(("q", place, np.eye(4)[:, :1]) for place in turned),
    ]
