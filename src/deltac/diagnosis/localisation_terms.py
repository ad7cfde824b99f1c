"""The terms that a mechanism's equations are made of, as candidates for what is wrong in somebody else's.

Equations with one term T wrong by a factor k leave the residual (1 − k) T: twice the term where its sign
is wrong, the term itself where it is missing. So the residual is compared with the model's own terms,
and where none fits with products of sines, cosines and rates.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equation_test import EquationTest
from deltac.diagnosis.kane import times
from deltac.diagnosis.localisation_symbols import Key, written
from deltac.diagnosis.states import States
from deltac.dynamics.equations_of_motion import evaluate, matrices
from deltac.dynamics.recursions import gather, velocities
from deltac.dynamics.spatial import SX, cross

Array: TypeAlias = NDArray[np.float64]

FEW = 8
"""Speeds up to which terms are divided by bodies and pairs of rates."""

PRESENT = 1e-9
"""A part smaller than this share of its equation's terms is rounding."""

EXACT = 1e-7
"""Relative error of a fit that is no coincidence."""

MOST_TERMS = 3

MOST_VARIABLES = 4
"""Coordinates in a dictionary of plain functions."""

FACTORS = {-1.0: "with the wrong sign", 0.0: "is missing", 2.0: "twice", 0.5: "by half"}


@dataclass(frozen=True, eq=False)
class Part:
    """A candidate: what it is called and its values at the states (B,).

    A term of the model's own equation (with its sign in F_r + F*_r) has a `key`; a plain function has none.
    """

    name: str
    values: Array
    key: Key | None = None


@dataclass(frozen=True)
class Match:
    """`coefficient` times a part: one summand of a residual.

    For a term of the model's own equation, `factor` is what the tested equations have in place of 1: −1
    for a wrong sign, 0 for a missing term. None for a plain function of the state. `symbols`: the model's
    term as people write it, where it is short.
    """

    part: str
    coefficient: float
    factor: float | None
    symbols: str = ""

    def __str__(self) -> str:
        if self.factor is None:
            return f"{self.coefficient:.6g}·{self.part}"
        part = f"{self.part}, {self.symbols}," if self.symbols else self.part
        for factor, words in FACTORS.items():
            if abs(self.factor - factor) < 1e-5:
                return f"{part} {'' if factor == 0.0 else 'enters '}{words}"
        return f"{part} enters with the factor {_factor(self.factor)}"


def _factor(factor: float) -> str:
    """A factor; one that six digits do not tell from 1 by what it differs: "1 + 1.0e-07"."""
    more = factor - 1.0
    if abs(more) >= 1e-4:
        return f"{factor:.6g}"
    return f"1 {'-' if more < 0.0 else '+'} {abs(more):.1e}"


def own_parts(test: EquationTest, udot: Array, row: int) -> list[Part]:
    """The terms of one equation at the accelerations `udot`, whole and in their parts."""
    names = test.speeds
    scale = float(test.typical(udot)[row])
    found: list[Part] = []

    def add(name: str, values: Array, key: Key) -> None:
        if np.abs(values).max() > PRESENT * scale and np.isfinite(values).all():
            found.append(Part(name, values, key))

    for channel, force in test.forces.items():
        add(_called(channel), force[row], ("channel", channel, None))
    inertia = -test.M[:, row, :].T * udot
    add("the sum of the gyroscopic terms", -test.bias[row], ("gyroscopic", "", None))
    by_rates = _by_rates(test, row) if len(names) <= FEW else ()
    for name, values, key in by_rates:
        add(name, values, key)
    for j, name in enumerate(names):
        add(_inertia_term(name), inertia[j], ("inertia", name, None))
    if len(names) <= FEW:
        for name, values, key in _by_bodies(test, udot, row):
            add(name, values, key)
    return found


def _inertia_term(speed: str) -> str:
    return f"the inertia term of {speed}'s acceleration"


def _called(channel: str) -> str:
    return "gravity" if channel == "gravity" else f"{channel!r}"


def _by_rates(test: EquationTest, row: int) -> Iterable[tuple[str, Array, Key]]:
    """Parts of forces and gyroscopic terms by the rates that they are proportional to."""
    n, batch = test.bias.shape
    names = test.speeds
    pairs = list(combinations(range(n), 2))
    unit = np.eye(n)
    rays = [np.zeros(n), *unit, *(-unit), *(unit[i] + unit[j] for i, j in pairs)]
    states = test.states
    repeated = States(
        np.tile(states.t, len(rays)),
        np.tile(states.q, len(rays)),
        np.repeat(np.array(rays).T, batch, axis=1),
        states.coordinates,
        states.speeds,
    )
    there = EquationTest(test.kane, repeated, scales=test.scales, strict=False)
    u = states.u
    gyroscopic: list[tuple[str, str, str, Array, Array]] = [
        ("the gyroscopic term", "gyroscopic", "", -there.bias, -test.bias)
    ]
    acting = [(_called(c), "channel", c, there.forces[c], test.forces[c]) for c in test.forces]
    for name, kind, which, along, whole in gyroscopic + acting:
        at = along[row].reshape(len(rays), batch)
        rest, plus, minus, both = at[0], at[1 : n + 1], at[n + 1 : 2 * n + 1], at[2 * n + 1 :]
        linear, square = 0.5 * (plus - minus) * u, (0.5 * (plus + minus) - rest) * u**2
        mixed = [
            (both[k] - plus[i] - plus[j] + rest) * u[i] * u[j] for k, (i, j) in enumerate(pairs)
        ]
        total = rest + linear.sum(axis=0) + square.sum(axis=0) + sum(mixed, start=np.zeros(batch))
        if not np.allclose(total, whole[row], atol=1e-9 * np.abs(whole[row]).max(initial=1e-300)):
            continue  # not a polynomial of the rates
        yield f"{name} at rest", rest, (kind, which, ())
        for i in range(n):
            yield f"{name} with u.{names[i]}", linear[i], (kind, which, (i,))
            yield f"{name} with u.{names[i]}²", square[i], (kind, which, (i, i))
        for values, (i, j) in zip(mixed, pairs):
            yield f"{name} with u.{names[i]}·u.{names[j]}", values, (kind, which, (i, j))


def _by_bodies(test: EquationTest, udot: Array, row: int) -> Iterable[tuple[str, Array, Key]]:
    """Gravity and inertia terms of each body alone."""
    kane, s = test.kane, test.kane.system
    free = s.free_u
    V = velocities(s, s.u_all)
    bodies, outputs = [], []
    for k, (link, pose) in enumerate(zip(s.links, s.poses)):
        if s.mechanism.body(link.joint.child).massless:
            continue
        weight = link.mass * ca.mtimes(pose.E, s.gravity)
        wrench: SX = ca.vertcat(cross(link.centre, weight), weight)
        J = ca.jacobian(V[k], s.u)
        columns = [link.inertia @ J[:, j] for j in range(J.shape[1])]
        bodies.append(link.joint.child)
        outputs.append(gather(s, {k: wrench})[free])
        outputs.append(ca.mtimes(J.T, ca.horzcat(*columns)))
    if not bodies:
        return
    point = test.point
    found = evaluate(kane.function(outputs), test.states.t[None, :], point.q, point.u)
    Yt, n = point.Y.transpose(0, 2, 1), len(free)
    for body, weight, flat in zip(bodies, found[::2], found[1::2]):
        yield f"gravity on body {body!r}", times(Yt, weight)[row], ("weight", body, None)
        M = Yt @ matrices(flat, n, n) @ point.Y
        for j, name in enumerate(test.speeds):
            yield (
                f"{_inertia_term(name)} by body {body!r}",
                -M[:, row, j] * udot[j],
                ("inertia by body", body, None),
            )


def plain_parts(states: States, udot: Array, coordinates: Sequence[int]) -> list[Part]:
    """Products of sines and cosines of some coordinates, rates and accelerations."""
    q, names = states.q, states.coordinates
    shapes: list[tuple[str, Array]] = [("", np.ones(len(states)))]
    for k in coordinates:
        for name, f in (("sin", np.sin), ("cos", np.cos)):
            shapes.append((f"{name}({names[k]})", f(q[k])))
            shapes.append((f"{name}(2·{names[k]})", f(2 * q[k])))
        shapes += [(names[k], q[k]), (f"{names[k]}²", q[k] ** 2), (f"{names[k]}³", q[k] ** 3)]
    for i, j in combinations(coordinates, 2):
        for sign, shift in (("-", q[j] - q[i]), ("+", q[j] + q[i])):
            shapes.append((f"sin({names[j]} {sign} {names[i]})", np.sin(shift)))
            shapes.append((f"cos({names[j]} {sign} {names[i]})", np.cos(shift)))
        shapes.append((f"({names[j]} - {names[i]})", q[j] - q[i]))
    rates: list[tuple[str, Array]] = [("", np.ones(len(states)))]
    for i, speed in enumerate(states.speeds):
        rates.append((f"u.{speed}", states.u[i]))
        rates.append((f"u̇.{speed}", udot[i]))
        for j in range(i, len(states.speeds)):
            other = states.speeds[j]
            name = f"u.{speed}²" if i == j else f"u.{speed}·u.{other}"
            rates.append((name, states.u[i] * states.u[j]))
    return [Part("·".join(filter(None, (a, b))) or "1", x * y) for a, x in shapes for b, y in rates]


def explain_residual(
    test: EquationTest,
    residual: Array,
    udot: Array,
    row: int,
    depends: tuple[str, ...] | None = None,
) -> tuple[Match, ...]:
    """What the residual (B,) of one equation consists of: the model's own terms, else plain functions.

    `depends` names what it changes with, if that is known. Empty if it is no such sum.
    """
    found = explain_row(test, residual, udot, row)
    if found:
        return found
    names = test.states.coordinates
    some = [k for k, n in enumerate(names) if depends is None or f"q.{n}" in depends]
    if len(some) > MOST_VARIABLES:
        return ()
    return explain_by(residual, plain_parts(test.states, udot, some))


def explain_row(test: EquationTest, residual: Array, udot: Array, row: int) -> tuple[Match, ...]:
    """The model's own terms that the residual (B,) of one equation consists of; empty if it is no such sum.

    That the equation's own acceleration is missing is no explanation: the residual is the sum of all terms.
    """
    parts = own_parts(test, udot, row)
    found = explain_by(residual, parts)
    own = _inertia_term(test.speeds[row])
    if any(m.part == own and abs(m.coefficient - 1.0) < 1e-5 for m in found):
        return ()
    keys = {part.name: part.key for part in parts if part.key is not None}
    return tuple(replace(m, symbols=written(test.kane, keys[m.part], row)) for m in found)


def explain_by(residual: Array, parts: Sequence[Part], exact: float = EXACT) -> tuple[Match, ...]:
    """The fewest parts whose sum with constant coefficients is the residual (B,); empty if none is.

    Orthogonal matching pursuit, with at most `MOST_TERMS` parts. Among parts of the same shape the one
    with the plainest factor is named.
    """
    size = float(np.linalg.norm(residual))
    usable = [p for p in parts if float(np.linalg.norm(p.values)) > 0.0]
    if not usable or size == 0.0:
        return ()
    columns = np.array([p.values for p in usable])
    columns = columns / np.linalg.norm(columns, axis=1)[:, None]
    chosen: list[int] = []
    left = residual
    for _ in range(min(MOST_TERMS, len(residual) // 4)):
        fit = np.abs(columns @ left) / np.linalg.norm(left)
        fit[chosen] = -1.0
        best = int(np.argmax(fit))
        twins = [int(k) for k in np.flatnonzero(fit > fit[best] - 1e-12)]
        chosen.append(min(twins, key=lambda k: not _plain(left, usable[k])))
        coefficients, left = _fitted(residual, usable, chosen)
        if float(np.linalg.norm(left)) <= exact * size:
            needed = [
                k
                for k, c in zip(chosen, coefficients)
                if abs(c) * np.linalg.norm(usable[k].values) > 10 * exact * size
            ]
            coefficients, _ = _fitted(residual, usable, needed)
            return tuple(
                Match(usable[k].name, float(c), None if usable[k].key is None else 1.0 - float(c))
                for k, c in zip(needed, coefficients)
            )
    return ()


def _fitted(residual: Array, parts: Sequence[Part], chosen: Sequence[int]) -> tuple[Array, Array]:
    """Coefficients of the chosen parts by least squares, and what they leave of the residual."""
    A = np.array([parts[k].values for k in chosen]).T
    coefficients: Array = np.asarray(np.linalg.lstsq(A, residual, rcond=None)[0])
    return coefficients, residual - A @ coefficients


def _plain(left: Array, part: Part) -> bool:
    """Whether it is a term of the model that enters with the factor −1, 0, 2 or ½."""
    factor = 1.0 - float(part.values @ left) / float(part.values @ part.values)
    return part.key is not None and any(abs(factor - plain) < 1e-5 for plain in FACTORS)
