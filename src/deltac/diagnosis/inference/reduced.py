"""Closed loops in independent coordinates: all others follow from them by the constraints.

Whoever derives the equations of a loop in one coordinate integrates that one: the rows satisfy the
constraints to rounding, and the errors of the integrator are those of the independent coordinates. In all
coordinates such errors are no elementary differentials, since the dependent ones are curved functions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import qr

from deltac.arrays import EPS, Array
from deltac.diagnosis.causes.columns import ColumnKernels
from deltac.diagnosis.inference.model import LogModel, Rows
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.residuals.states import WELL_CONDITIONED
from deltac.kernels.rows import RowExpression
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

NEWTON_CORRECTIONS = 12
"""Newton's steps to the dependent coordinates at most: they begin at those of the log."""

PROBED_ROWS = 40
"""Rows at which independent coordinates are chosen."""

SETS, MOST_SETS = 3, 300
"""Sets of independent coordinates that are tried, and of which these are chosen; of more there is one."""


class Reduced(LogModel):
    """A model whose state are independent coordinates with their rates."""

    def __init__(
        self, model: LogModel, run: Trajectory, independent: Sequence[int] | NDArray[np.intp]
    ) -> None:
        self.__dict__.update(model.__dict__)
        self.whole = model
        all_speeds = np.arange(model.n)
        place = {speed: coordinate for coordinate, speed in model.rates}
        self.own = np.array(independent, dtype=np.intp)
        self.others = np.setdiff1d(all_speeds, self.own)
        self.own_q, self.others_q = (
            np.array([place[int(k)] for k in some], dtype=np.intp)
            for some in (self.own, self.others)
        )
        self.of_q, self.of_u = model.of_q[self.own_q], model.of_u[self.own]
        self.n, self.rows_of_G = len(self.own), 0
        self.rates = np.stack([np.arange(self.n)] * 2, axis=1)
        self._near = CubicSpline(run.t, run.q[:, model.of_q[self.others_q]], axis=0)
        bound, s = model.symbols.constrained, model.symbols.system
        assert bound is not None
        self._constraints: RowExpression = model.symbols.once(
            "constraints in place",
            lambda: RowExpression("phi", {"t": s.t, "q": s.q}, bound.rows.phi, bound.rows.b),
        )

    def _complete(self, t: Array, q: Array, u: Array | None = None) -> tuple[Array, Array]:
        """All coordinates and speeds (T, n) of the whole model."""
        whole = self.whole
        every = np.zeros((len(t), whole.n))
        every[:, self.own_q], every[:, self.others_q] = q, self._near(t)
        for _ in range(NEWTON_CORRECTIONS):
            phi, b = self._constraints(t, every)
            G = whole.matrices(t, every)[1]
            inverse = np.linalg.inv(G[:, :, self.others])
            step = np.einsum("tij,tj->ti", inverse, phi)
            every[:, self.others_q] -= step
            if not np.abs(step).max(initial=0.0) > 8.0 * EPS * (1.0 + np.abs(every).max()):
                break
        speeds = np.zeros_like(every)
        if u is not None:
            speeds[:, self.own] = u
            drift = b + np.einsum("tij,tj->ti", G[:, :, self.own], u)
            speeds[:, self.others] = -np.einsum("tij,tj->ti", inverse, drift)
        return every, speeds

    def of_mechanism(self, mechanism: Mechanism, run: Trajectory) -> Reduced:
        """The same of another mechanism, in the same independent coordinates."""
        return Reduced(self.whole.of_mechanism(mechanism, run), run, self.own)

    def completed(self, rows: Rows) -> Rows:
        """The rows with all coordinates and speeds."""
        return Rows(rows.t, *self._complete(rows.t, rows.q, rows.u), rows.F)

    def changed(self, kernels: Sequence[ColumnKernels], coefficients: Array) -> Reduced:
        """The model with causes in its equations."""
        other = copy(self)
        other.whole = self.whole.changed(kernels, coefficients)
        other.change, other.damped = other.whole.change, other.whole.damped
        return other

    def acceleration(self, t: Array, q: Array, u: Array, F: Array) -> Array:
        """u̇ (T, n) of the independent speeds."""
        return self.whole.acceleration(t, *self._complete(t, q, u), F)[:, self.own]

    def every(self, rows: Rows) -> Array:
        """u̇ of all free speeds at rows."""
        return self.whole.at(self.completed(rows))

    def damping(self, t: Array, q: Array, u: Array, F: Array, everywhere: bool = False) -> Array:
        """Generalized forces of the model's own dampers, of all free speeds."""
        return self.whole.damping(t, *self._complete(t, q, u), F, everywhere)

    def servo_damping(self, t: Array, q: Array, u: Array) -> Array:
        """What of logged forces of all free speeds is damping by servos' own laws."""
        return self.whole.servo_damping(t, *self._complete(t, q, u))

    def rate(self, t: Array, q: Array, u: Array) -> Array:
        """q̇ (T, n): the speeds."""
        return u

    def response(self, t: Array, q: Array, force: Array) -> Array:
        """What generalized forces of all free speeds add to the accelerations."""
        return self.whole.response(t, self._complete(t, q)[0], force)[:, self.own]

    def inertia(self, at: Rows) -> Array:
        """Inertia of each independent speed, without what moves with it."""
        return super().inertia(at)[:, self.own]

    def matrices(self, t: Array, q: Array) -> tuple[Array, Array]:
        """Mass matrix and constraint Jacobian of all free speeds."""
        return self.whole.matrices(t, self._complete(t, q)[0])

    def powers(self, rows: Rows, a: Array) -> Array:
        """Power (T, n, p) by which changes of the accelerations flow through the independent speeds, W."""
        return self.energy_gradient(rows)[:, self.n :, None] * a

    def of_geometry(self, t: Array, q: Array, columns: Array) -> Array:
        """Accelerations of columns M ∂u̇/∂θ of all free speeds."""
        return self.whole.of_geometry(t, self._complete(t, q)[0], columns)[:, self.own]

    def energy_gradient(self, rows: Rows) -> Array:
        """What a jump of the state adds to ΔC (T, 2n), J: the others jump with it."""
        here, one = self.completed(rows), np.ones((1, self.n))
        gradient = self.whole.energy_gradient(here)
        columns = []
        for k in range(2 * self.n):
            e = np.where(np.arange(2 * self.n) == k, 1e-6, 0.0)[None]
            ends = [
                self.completed(
                    Rows(
                        rows.t,
                        rows.q + sign * one * e[:, : self.n],
                        rows.u + sign * one * e[:, self.n :],
                        rows.F,
                    )
                )
                for sign in (-1.0, 1.0)
            ]
            along = self.whole.difference(*ends) / 2e-6
            columns.append(np.einsum("ti,ti->t", gradient, along))
        return np.stack(columns, axis=1)


def reductions(model: LogModel, run: Trajectory) -> Iterator[Reduced]:
    """The model in sets of independent coordinates that tell the others all along the run.

    None where constraints are of speeds, coordinates are quaternions, or rows do not satisfy the constraints.
    """
    bound = model.symbols.constrained
    plain = len(model.rates) == model.n == len(model.of_q)
    if bound is None or not plain or not all(bound.rows.holonomic):
        return
    some = np.unique(np.linspace(0, len(run) - 1, PROBED_ROWS).astype(np.intp))
    rows = model.rows(run.take(some))
    G = model.matrices(rows.t, rows.q)[1]
    count = model.n - G.shape[1]
    if not 0 < count < model.n:
        return
    if comb(model.n, count) <= MOST_SETS:
        choices = list(combinations(range(model.n), count))
    else:  # the others are the columns that G has most of
        _, _, order = qr(np.concatenate(G), mode="economic", pivoting=True)
        choices = [tuple(sorted(int(k) for k in order[model.n - count :]))]
    digits = digits_of(run)
    of_q, of_u = (digits[name].scatter(some) for name in ("q", "u"))
    scatter = Rows(rows.t, of_q[:, model.of_q], of_u[:, model.of_u], rows.F)
    sets: list[tuple[float, tuple[int, ...]]] = []
    for own in choices:
        others = np.setdiff1d(np.arange(model.n), own)
        worst = float(np.linalg.cond(G[:, :, others]).max())
        sets.append((worst, own))
    exact = replace(scatter, q=0.0 * scatter.q, u=0.0 * scatter.u)
    for place, (worst, own) in enumerate(sorted(sets)[:SETS]):
        if worst <= 1.0 / WELL_CONDITIONED:
            reduced = Reduced(model, run, own)
            # Of coarse rows the set that tells the others best.
            if _satisfied(reduced, rows, exact if place else scatter):
                yield reduced


def _satisfied(reduced: Reduced, rows: Rows, scatter: Rows) -> bool:
    """Whether the others of some rows are those that follow from the independent ones.

    To a millionth, or twice what their scatter makes.
    """
    q, u, F = rows.q[:, reduced.own_q], rows.u[:, reduced.own], rows.F
    own = reduced.completed(Rows(rows.t, q, u, F))
    ends = (
        reduced.completed(Rows(rows.t, q + of_q, u + of_u, F))
        for of_q, of_u in ((scatter.q[:, reduced.own_q], 0.0), (0.0, scatter.u[:, reduced.own]))
    )
    difference = reduced.whole.difference
    allowed = sum(np.abs(difference(own, end)) for end in ends) + np.hstack([scatter.q, scatter.u])
    size = np.abs(difference(rows.take(slice(0, -1)), rows.take(slice(1, None)))).max(axis=0)
    off = np.abs(difference(own, rows))
    return bool(np.all(off <= 1e-6 * (size + 1e-300) + 2.0 * allowed))
