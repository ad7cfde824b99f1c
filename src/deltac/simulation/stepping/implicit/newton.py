"""Newton's method, modified: a factorised Jacobian serves as long as it makes the iteration contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import EPS, ROOT_EPS, Array
from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.mechanism.friction import SLIP_WIDTH

MOST_ITERATIONS = 400
UNQUESTIONED, MOST_HALVED = 8, 40
"""Iterations whose steps are not questioned; how often one step is halved at most."""

SPEED_TOLERANCE = 512 * EPS
"""Of the speeds, relative to the largest of the run: some rounding errors above the best there is."""

SLOW_CONTRACTION = 0.01
"""A contraction worse than this calls for a new Jacobian: of small mechanisms it costs next to nothing."""

STIFF_ROUNDING = ROOT_EPS
"""Updates below this (relative) that will not shrink any more are rounding of stiff forces."""

SPARSE = 48
"""Unknowns from which on a sparse factorisation pays."""


@dataclass(frozen=True)
class NewtonOutcome:
    """What Newton's method came to: unknowns, whether they solve, iterations, residual."""

    y: Array
    solved: bool
    iterations: int
    residual: Array
    singular: bool = False


class StepSystem:
    """A step's equations, residual(y; data) = 0, compiled: one call for the residual, one with its Jacobian.

    It holds no numbers, so that runs in several threads may share it.
    """

    def __init__(self, y: SX, data: dict[str, SX], residual: SX, speeds: int) -> None:
        """Differentiate; `speeds` is how many of the unknowns, the first, tell convergence."""
        jacobian = ca.sparsify(ca.jacobian(residual, y))
        self.size, self.speeds = y.shape[0], speeds
        pattern = jacobian.sparsity()
        rows, columns = pattern.get_triplet()
        self.rows, self.columns = np.array(rows, dtype=np.int32), np.array(columns, dtype=int)
        self.indptr = np.array(pattern.colind(), dtype=np.int32)
        inputs = {"y": y, **{name: column for name, column in data.items() if column.shape[0]}}
        self.residual = Kernel(inputs, {"r": residual}, name="residual")
        entries = jacobian.nz[:]
        self.both = Kernel(inputs, {"r": residual, "J": entries}, name="residual and Jacobian")


class Newton:
    """Newton's method on a step's equations for one run: it owns its buffers and the factors it keeps."""

    def __init__(self, system: StepSystem) -> None:
        """No factors yet."""
        self._system, self._size, self._speeds = system, system.size, system.speeds
        both = system.both
        self._in, self._out = np.empty(both.n_in), np.empty(both.n_out)
        self._r = np.empty(self._size)
        self._solver: Callable[[Array], Array] | None = None

    def solve(self, start: Array, data: Array, fastest: float) -> NewtonOutcome:
        """The unknowns near `start`; `fastest` is the largest speed of the run, the measure.

        Steps are taken whole at first. Later on one that does not lessen the residual is halved: across the
        kinks of friction and contact Newton's method may else go to and fro for ever.
        """
        if not self._size:  # every joint is prescribed
            return NewtonOutcome(start, True, 0, start)
        self._in[self._size :] = data
        y, step, size, scale = start.copy(), np.zeros_like(start), np.inf, SLIP_WIDTH
        last, smallest, before = np.inf, np.inf, np.inf
        refresh, exact, halved = False, False, 0
        with np.errstate(all="ignore"):
            for k in range(1, MOST_ITERATIONS + 1):
                fresh = self._solver is None or refresh
                r = self._evaluated(y, fresh)
                residual = float(np.abs(r).max()) if np.isfinite(r).all() else np.inf
                came = bool(np.any(step))  # by a step that can be shortened
                if residual == np.inf and not came:
                    return NewtonOutcome(y, False, k, r)
                if residual == np.inf or (came and k > UNQUESTIONED and residual >= before):
                    if size <= STIFF_ROUNDING * scale and residual < np.inf:
                        return NewtonOutcome(y, True, k, r)
                    if not exact:
                        # The step of an old Jacobian need not go down: back, and make a new one.
                        y, refresh, last, before = y - step, True, np.inf, np.inf
                        step = np.zeros_like(y)
                        continue
                    if halved == MOST_HALVED:
                        return NewtonOutcome(y, False, k, r)
                    step, halved = step / 2, halved + 1
                    y = y - step
                    continue
                assert self._solver is not None
                step = -self._solver(r)
                if not np.isfinite(step).all():
                    if fresh:
                        return NewtonOutcome(y, False, k, r, singular=True)
                    self.forget()
                    step = np.zeros_like(y)
                    continue
                size = float(np.abs(step[: self._speeds]).max())
                comparable = 0.0 < last < np.inf
                rate = size / last if comparable else 1.0
                if comparable and rate > SLOW_CONTRACTION and not fresh:
                    refresh, last = True, np.inf  # not taken: the old Jacobian is no good here
                    step = np.zeros_like(y)
                    continue
                y = y + step
                scale = max(fastest, float(np.abs(y[: self._speeds]).max()), SLIP_WIDTH)
                ahead = size * min(rate, 1.0)  # what the next step would be
                if size <= SPEED_TOLERANCE * scale or (k > 2 and ahead <= SPEED_TOLERANCE * scale):
                    return NewtonOutcome(y, True, k, r)
                if fresh and size >= smallest and size <= STIFF_ROUNDING * scale:
                    return NewtonOutcome(y, True, k, r)
                smallest, before, halved = min(size, smallest), residual, 0
                exact = fresh
                last, refresh = size, (comparable and rate > SLOW_CONTRACTION) or k >= UNQUESTIONED
        self.forget()
        return NewtonOutcome(y, False, MOST_ITERATIONS, r)

    def forget(self) -> None:
        """Make a new Jacobian at the next iteration."""
        self._solver = None

    def _evaluated(self, y: Array, fresh: bool) -> Array:
        """The residual; with the Jacobian factorised anew if `fresh`."""
        self._in[: self._size] = y
        if not fresh:
            return self._system.residual.single(self._in, self._r).copy()
        self._system.both.single(self._in, self._out)
        r = self._out[: self._size].copy()
        entries = self._out[self._size :]
        if np.isfinite(r).all() and np.isfinite(entries).all():
            self._solver = self._factorised(entries)
        elif np.isfinite(r).all():
            r[:] = np.nan
        return r

    def _factorised(self, entries: Array) -> Callable[[Array], Array]:
        n = self._size
        if n >= SPARSE:
            from scipy.sparse import csc_matrix
            from scipy.sparse.linalg import splu

            system = self._system
            # splu may not keep the arrays it is given, and `entries` is a view of a buffer.
            matrix = csc_matrix((entries.copy(), system.rows, system.indptr), shape=(n, n))
            try:
                factors: Any = splu(matrix)
            except RuntimeError:  # exactly singular
                return lambda b: np.full_like(b, np.nan)
            return lambda b: factors.solve(b)
        from scipy.linalg.lapack import dgetrf, dgetrs

        J = np.zeros((n, n), order="F")
        J[self._system.rows, self._system.columns] = entries
        lu, pivots, failed = dgetrf(J, overwrite_a=True)
        if failed:
            return lambda b: np.full_like(b, np.nan)
        return lambda b: dgetrs(lu, pivots, b)[0]
