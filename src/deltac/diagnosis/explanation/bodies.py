"""Causes that are a body's: its mass, its mass centre, its central inertia."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equations import Evaluator
from deltac.diagnosis.explanation.candidates import Candidate, Places, Sign, one
from deltac.diagnosis.explanation.columns import UNIT_MOMENTS, Column
from deltac.dynamics.system import Link

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Mass:
    """Numbers of a body: mass, mass centre and central inertia in the link frame, E: link to body."""

    name: str
    mass: float
    centre: Array
    central: Array
    E: Array
    columns: tuple[int, ...] = field(default=())

    @staticmethod
    def of(link: Link) -> _Mass:
        """Those of a link."""
        mass = float(ca.evalf(ca.SX(link.mass)))
        centre = np.array(ca.evalf(link.centre)).ravel()
        J = np.array(ca.evalf(ca.densify(ca.SX(link.inertia.J))))
        central = J - mass * _steiner(centre)
        E = np.array(ca.evalf(ca.densify(link.to_body.E)))
        return _Mass(link.joint.child, mass, centre, central, E)


def _steiner(c: Array) -> Array:
    """|c|² 1 − c cᵀ: the moments of inertia of a unit mass at c."""
    return np.asarray(float(c @ c) * np.eye(3) - np.outer(c, c))


def _six(J: Array) -> list[float]:
    return [float(J[i, j]) for i, j in UNIT_MOMENTS]


def of_bodies(evaluator: Evaluator, places: Places) -> Iterator[Candidate]:
    """Masses, moments of inertia and mass centres of each body, and all masses together."""
    system = evaluator.symbols.system
    whole: list[tuple[tuple[int, ...], list[float]]] = []
    for link in system.links:
        if evaluator.mechanism.body(link.joint.child).massless:
            continue
        b = _Mass.of(link)
        here = [places(Column("inertia", b.name, k)) for k in range(10)]
        kept = [k for k, p in enumerate(here) if p is not None]
        at = tuple(p[0] for p in here if p is not None)
        if not kept:
            continue

        def take(weights: list[float], kept: list[int] = kept) -> list[float]:
            return [weights[k] for k in kept]

        mass = [b.mass, *(b.mass * b.centre), *_six(b.mass * _steiner(b.centre))]
        moments = [0.0] * 4 + _six(b.central)
        every = [x + y for x, y in zip(mass, moments)]
        whole.append((at, take(every)))
        factor: Sign = "factor"
        yield from one("body-inertia", b.name, at, take(every), "factor", 1.0, "1", factor)
        yield from one("body-mass", b.name, at, take(mass), "factor", 1.0, "1", factor)
        yield from one("body-moments", b.name, at, take(moments), "factor", 1.0, "1", factor)
        yield from _centres(b, at, kept)
        yield from _moments(b, at, kept)
    if len(whole) > 1:
        columns = tuple(k for at, _ in whole for k in at)
        weights = [w for _, some in whole for w in some]
        yield from one("mass-scale", "all bodies", columns, weights, "factor", 1.0, "1", "factor")


def _centres(b: _Mass, at: tuple[int, ...], kept: list[int]) -> Iterator[Candidate]:
    """The mass centre moved along an axis of the body, or anywhere; in body components."""
    L, Q = np.zeros((10, 3)), np.zeros((10, 3, 3))
    axes = b.E.T  # columns: the body's axes in the link frame
    for k in range(3):
        d = axes[:, k]
        L[1:4, k] = b.mass * d
        turned = (
            2.0 * float(b.centre @ d) * np.eye(3) - np.outer(b.centre, d) - np.outer(d, b.centre)
        )
        L[4:, k] = _six(b.mass * turned)
        for l in range(3):
            e = axes[:, l]
            both = float(d @ e) * np.eye(3) - 0.5 * (np.outer(d, e) + np.outer(e, d))
            Q[4:, k, l] = _six(b.mass * both)
    L, Q = L[kept], Q[kept]
    gyration = np.sqrt(0.5 * float(np.trace(b.central)) / b.mass) if b.mass else 0.0
    limit = max(3.0 * gyration, float(np.linalg.norm(b.centre)))  # it stays within the body
    shown = [k for k in range(3) if L[:, k].any()]  # of planar motion, not the axis across
    for group in [*([k] for k in shown), shown] if len(shown) > 1 else [shown]:
        if group:
            yield Candidate(
                "body-centre", b.name, at, L[:, group], tuple("xyz"[k] for k in group),
                np.zeros(len(group)), ("m",) * len(group), "any", Q[:, group][:, :, group],
                limit=limit,
            )  # fmt: skip


def _moments(b: _Mass, at: tuple[int, ...], kept: list[int]) -> Iterator[Candidate]:
    """Central moments of inertia, in the axes of the body."""
    L = np.zeros((10, 6))
    own = b.E @ b.central @ b.E.T
    for n, (i, j) in enumerate(UNIT_MOMENTS):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        L[4:, n] = _six(b.E.T @ unit @ b.E)
    L, base, names = L[kept], np.array(_six(own)), ("xx", "yy", "zz", "xy", "xz", "yz")
    for n in range(3):
        yield from one(
            "body-moment", b.name, at, list(L[:, n]), names[n], float(base[n]), "kg·m²",
            "positive",
        )  # fmt: skip
    if L.any():
        yield Candidate("body-tensor", b.name, at, L, names, base, ("kg·m²",) * 6)
