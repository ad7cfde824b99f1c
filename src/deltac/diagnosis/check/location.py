"""Where wrong equations are wrong: which equation, what it varies with, which term."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.check.terms import Match, explain_residual
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.function import Caller
from deltac.diagnosis.residuals.states import States
from deltac.diagnosis.verdict import percent
from deltac.mechanism.joints import KINDS
from deltac.results import Record

BASES = 16
"""States at which single variables are changed, or all speeds scaled."""

SCALINGS = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""Factors of all speeds; five, so that polynomials up to the fourth degree are told apart."""


@dataclass(frozen=True, eq=False)
class Blame(Record):
    """One of the equations that do not hold.

    Attributes:
        speed: the own speed it belongs to, and `number`, its place (from 1).
        relative: root mean square of F_r + F*_r over the states, as a fraction of the equation's terms.
        residual: the same in `unit`.
        acceleration: root mean square error of u̇ of that speed, in `acceleration_unit`.
        degrees: the powers of the rates that the residual consists of; None if it is no polynomial.
        depends_on: what it changes with, ``t``, ``q.<coordinate>``, ``u.<speed>``; None if not known.
        terms: what it consists of, if that could be told.
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

    def __str__(self) -> str:
        said = [
            f"equation {self.number} ({self.speed}) is off by {_share(self.relative)} of its terms"
        ]
        if self.degrees:
            said.append(
                _POWERS.get(self.degrees) or f"of degree {_listed(self.degrees)} in the rates"
            )
        if self.depends_on is not None and len(self.depends_on) <= 4:
            what = ", ".join(self.depends_on)
            said.append(f"a function of {what} alone" if what else "a constant")
        if self.terms:
            said.append(" and ".join(map(str, self.terms)))
        return "; ".join(said)


def _share(relative: float) -> str:
    """A share in per cent; as a fraction where per cent would need an exponent."""
    return percent(relative) if relative >= 1e-6 else f"{relative:.1e}"


_POWERS: dict[tuple[int, ...], str] = {
    (0,): "independent of the rates",
    (1,): "linear in the rates",
    (2,): "quadratic in the rates",
}


def _listed(degrees: tuple[int, ...]) -> str:
    return " and ".join(map(str, degrees))


def blame(caller: Caller, test: EquationTest, udot: Array, limit: Array) -> tuple[Blame, ...]:
    """Every equation whose residual passes `limit` (n,), as a fraction of its terms; the worst first."""
    good: NDArray[np.bool_] = np.asarray(np.isfinite(udot).all(axis=0))
    relative = test.relative(udot)[:, good].max(axis=1, initial=0.0)
    residual, wrong = test.residual(udot)[:, good], (udot - test.acceleration)[:, good]
    rows = [int(k) for k in np.argsort(-relative) if relative[k] > limit[k]]
    if not rows:
        return ()
    typical = test.typical(udot)
    tied = bool(test.kane.rows.names) and bool(len(test.gamma))
    base = _bases(test, residual / typical[:, None], good)
    degrees = _degrees(caller, test, base, typical, limit)
    depends = None if tied else _dependence(caller, test, base, typical, limit)
    units, rates = _units(test)
    made = []
    for k in rows:
        variables = None if depends is None else depends[k]
        made.append(
            Blame(
                speed=test.speeds[k],
                number=k + 1,
                relative=_rms(residual[k]) / float(typical[k]),
                residual=_rms(residual[k]),
                unit=units[k],
                acceleration=_rms(wrong[k]),
                acceleration_unit=rates[k],
                degrees=degrees[k],
                depends_on=variables,
                terms=() if tied else _terms(caller, test, k, variables),
            )
        )
    return tuple(made)


def blame_at(test: EquationTest, udot: Array, limit: Array) -> tuple[Blame, ...]:
    """`blame` of accelerations that are known at the test's own states only: what they vary with is not."""
    relative = test.relative(udot).max(axis=1, initial=0.0)
    residual, wrong, typical = test.residual(udot), udot - test.acceleration, test.typical(udot)
    units, rates = _units(test)
    tied = bool(len(test.gamma))
    return tuple(
        Blame(
            speed=test.speeds[k],
            number=k + 1,
            relative=_rms(residual[k]) / float(typical[k]),
            residual=_rms(residual[k]),
            unit=units[k],
            acceleration=_rms(wrong[k]),
            acceleration_unit=rates[k],
            terms=() if tied else explain_residual(test, residual[k], udot, k),
        )
        for k in map(int, np.argsort(-relative))
        if relative[k] > limit[k]
    )


def _terms(
    caller: Caller, test: EquationTest, row: int, depends: tuple[str, ...] | None
) -> tuple[Match, ...]:
    """What the residual of one equation consists of: the model's own terms, else plain functions."""
    udot = caller(test.states)
    if not np.isfinite(udot).all():
        return ()
    return explain_residual(test, test.residual(udot)[row], udot, row, depends)


def _varied(test: EquationTest, caller: Caller, states: States) -> Array:
    """The residual at other states (n, S), which need not meet constraints."""
    there = EquationTest(test.kane, states, scales=test.scales, strict=False)
    return there.residual(caller(states))


def _bases(test: EquationTest, relative: Array, good: NDArray[np.bool_]) -> States:
    """The first states and those that fail worst: an error may show at a few only, as of slow slip."""
    first = np.arange(min(BASES // 2, len(test.states)))
    worst = np.flatnonzero(good)[np.argsort(-np.abs(relative).max(axis=0), kind="stable")]
    rest = worst[~np.isin(worst, first)]
    return test.states.take(np.concatenate([first, rest[: BASES - len(first)]]))


def _degrees(
    caller: Caller, test: EquationTest, base: States, typical: Array, limit: Array
) -> list[tuple[int, ...] | None]:
    """Powers of the rates in each equation's residual: all speeds are scaled together."""
    count, times = len(base), len(SCALINGS)
    states = States(
        np.tile(base.t, times),
        np.tile(base.q, times),
        np.concatenate([s * base.u for s in SCALINGS], axis=1),
        base.coordinates,
        base.speeds,
    )
    values = _varied(test, caller, states).reshape(-1, times, count)
    powers = np.vander(np.array(SCALINGS), increasing=True)
    parts = np.linalg.solve(powers, values)
    found: list[tuple[int, ...] | None] = []
    for k in range(len(values)):
        size = np.abs(parts[k]).max(axis=1)
        there = tuple(int(d) for d in np.flatnonzero(size > 10 * limit[k] * typical[k]))
        usable = np.isfinite(size).all() and all(d <= 2 for d in there)
        found.append(there if usable else None)
    return found


def _dependence(
    caller: Caller, test: EquationTest, base: States, typical: Array, limit: Array
) -> list[tuple[str, ...]]:
    """What each equation's residual changes with: one variable at a time is taken from another state."""
    variables = _variables(test)
    t, q, u = [base.t], [base.q], [base.u]
    for _, kind, where in variables:
        moved = {"t": base.t.copy(), "q": base.q.copy(), "u": base.u.copy()}
        moved[kind][where] = np.roll(moved[kind][where], 1, axis=-1)
        t, q, u = [*t, moved["t"]], [*q, moved["q"]], [*u, moved["u"]]
    states = States(
        np.concatenate(t),
        np.concatenate(q, axis=1),
        np.concatenate(u, axis=1),
        base.coordinates,
        base.speeds,
    )
    values = _varied(test, caller, states).reshape(-1, 1 + len(variables), len(base))
    change = np.abs(values[:, 1:] - values[:, :1]).max(axis=2)
    return [
        tuple(
            name
            for (name, _, _), moved in zip(variables, change[k])
            if not moved <= 10 * limit[k] * typical[k]
        )
        for k in range(len(values))
    ]


def _variables(test: EquationTest) -> list[tuple[str, str, Any]]:
    """Name, array and place of what is varied; a quaternion as a whole."""
    states = test.states
    found: list[tuple[str, str, Any]] = [("t", "t", slice(None))]
    taken: set[int] = set()
    if test.kane.coordinates is None or not test.kane.coordinates.q:
        place = {int(index): k for k, index in enumerate(test.kane.mechanism.free.q)}
        for joint in test.kane.mechanism.joints:
            offset = KINDS[joint.kind].quaternion
            if offset is not None:
                start = place[test.kane.mechanism.coordinates.of(joint.name).start + offset]
                taken |= set(range(start, start + 4))
                found.append((f"q.{joint.name} (orientation)", "q", slice(start, start + 4)))
    if test.kane.assembled:  # one coordinate alone would leave the constraints
        found = []
        taken = set(range(len(states.coordinates)))
    found += [(f"q.{n}", "q", k) for k, n in enumerate(states.coordinates) if k not in taken]
    found += [(f"u.{n}", "u", k) for k, n in enumerate(states.speeds)]
    return found


def _units(test: EquationTest) -> tuple[list[str], list[str]]:
    """Units of the equations and of the accelerations; empty for own speeds, whose units nobody says."""
    if test.kane.coordinates is not None:
        return [""] * len(test.speeds), [""] * len(test.speeds)
    entries = [test.kane.mechanism.speeds[int(k)] for k in test.kane.mechanism.free.u]
    return (
        ["N" if e.unit == "m/s" else "N·m" for e in entries],
        [f"{e.unit}²" for e in entries],
    )


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0
