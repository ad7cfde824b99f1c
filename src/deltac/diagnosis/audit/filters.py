"""Logs of a low-pass filter: what went into it, recovered as the filter made its output.

What went into a digital filter of second order is x + a Dx + b D²x of what came out, x, D a derivative in
units of rows: the backward difference in recursive averages, and 2 (1 − z⁻¹)/(1 + z⁻¹) in filters that the
trapezoid rule makes of analogue ones, as Butterworth's (Oppenheim & Schafer, Discrete-Time Signal Processing,
§7.1). What went in follows from row to row by the equations and an integrator: a and b are those of the least
prediction errors, by the method of Gauss and Newton. Filters that keep the time are none of these: what they
do is of fourth order.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import orth

from deltac.arrays import NEWTON_STEPS, ROUGHLY, SAME, SIX_DIGITS, SMALL_SHARE, Array
from deltac.diagnosis.causes.columns import ColumnKernels
from deltac.diagnosis.inference.inference import LEAST_ROWS
from deltac.diagnosis.inference.integrators import INTEGRATORS, transition
from deltac.diagnosis.inference.linearisation import FlowError, Point, cause_columns, start
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import observations
from deltac.diagnosis.measurements.kinematics import stretches
from deltac.diagnosis.verdict import Finding
from deltac.energy.terms import LoggedForces
from deltac.kernels.rows import compiled_rows
from deltac.results import percent
from deltac.trajectories import Trajectory

BEGIN = 1.0
"""Number a to begin with, rows; Butterworth's filter has b = a²/2."""

LEFT_OF_INPUT = 0.3
"""Share of the prediction errors of a log that may be left of what went into its filter, beside causes."""

NOTHING = 0.01
"""The same where the filter is all that is wrong with a log."""

SMOOTH = 6
"""Order of differences by which what alternates from row to row is told from a motion."""


@dataclass(frozen=True, eq=False)
class LowPass:
    """A filter of second order, by numbers a and b (rows and their squares) of its inverse.

    trapezoid    whether D is that of the trapezoid rule
    forces       whether logged forces went through it as well
    alternating  what alternates in coordinates and speeds (2, nq + nu), constant and linear in time: the
                 trapezoid's inverse does not tell it
    """

    a: float
    b: float
    trapezoid: bool
    forces: bool
    alternating: Array | float = 0.0

    @property
    def low_pass(self) -> bool:
        """Whether it is late and makes no frequency larger; a motion of its own time may be a row early."""
        own, plus = self._polynomials
        z = np.exp(-1j * np.linspace(0.0, 0.99 * np.pi, 100))[:, None] ** np.arange(3)
        return bool(
            self.a > 0.0 and np.all(np.abs(z @ own) >= (1.0 - SMALL_SHARE) * np.abs(z @ plus))
        )

    @property
    def _polynomials(self) -> tuple[Array, Array]:
        """Of the inverse, in z⁻¹ (3,): of what came out, and of what went in."""
        a, b = (2.0 * self.a, 4.0 * self.b) if self.trapezoid else (self.a, self.b)
        plus = np.array((1.0, 2.0, 1.0) if self.trapezoid else (1.0, 0.0, 0.0))
        along = np.array((1.0, 0.0, -1.0) if self.trapezoid else (1.0, -1.0, 0.0))
        return plus + a * along + b * np.array((1.0, -2.0, 1.0)), plus

    def with_numbers(self, a: float, b: float) -> LowPass:
        """The same filter with other numbers."""
        return replace(self, a=a, b=b)

    def before(self, run: Trajectory) -> Trajectory:
        """What went in: all but the first two rows."""
        some = run.take(slice(2, None))
        forces = some.forces
        if self.forces:
            forces = {name: self._before(f) for name, f in run.forces.items()}
        q, u = self._before(run.q), self._before(run.u)
        if np.any(self.alternating):
            both = alternating(len(some)) @ self.alternating
            q, u = q - both[:, : q.shape[1]], u - both[:, q.shape[1] :]
        return replace(some, q=q, u=u, udot=None, forces=forces, integrals={}, works={}, events=())

    def _before(self, x: Array) -> Array:
        own, _ = self._polynomials
        y = own[0] * x[2:] + own[1] * x[1:-1] + own[2] * x[:-2]
        if not self.trapezoid:
            return np.asarray(y)
        # (1 + z⁻¹)² is a second difference of what alternates.
        signs = alternating(len(y))[:, 0].reshape(-1, *(1,) * (y.ndim - 1))
        y = signs * np.cumsum(np.cumsum(signs * y, axis=0), axis=0)
        flat, unknown = y.reshape(len(y), -1), alternating(len(y))
        rough, of_x = (np.diff(part, SMOOTH, axis=0) for part in (unknown, flat))
        numbers: Array = np.linalg.lstsq(rough, of_x)[0]
        return np.asarray((flat - unknown @ numbers).reshape(y.shape))


def alternating(rows: int) -> Array:
    """(−1)^k and (−1)^k τ (T, 2) at times τ from 0 to 1."""
    k = np.arange(rows)
    signs = 1.0 - 2.0 * (k % 2)
    return np.stack([signs, signs * k / rows], axis=1)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A filter with what it leaves of prediction errors, in units of those of the log."""

    filter: LowPass
    left: float


BETWEEN_ROWS = ("smooth", "start")
"""How forces act between rows of a fit."""


@dataclass(frozen=True, eq=False)
class _FilteredRows:
    """Rows of a log that went through a filter, perhaps by equations with causes of these columns in them."""

    model: LogModel
    run: Trajectory
    kernels: tuple[ColumnKernels, ...]

    @property
    def output(self) -> Trajectory:
        """The rows of which the input can be told."""
        return self.run.take(slice(2, None))

    @cached_property
    def unit(self) -> Array:
        """Prediction errors (2n,) of the rows as they are, by the exact flow."""
        w = self._point(self.output).flow.w
        return np.asarray(np.sqrt(np.mean(w**2, axis=0)) + 1e-300)

    @cached_property
    def whole(self) -> float:
        """What the likeliest method leaves of them beside the causes, in these units."""
        nothing = np.zeros((len(self.output), 2 * self.model.n, 0))
        return min(left for left, _ in self._fitted(self.output, nothing))

    def improved(self, fit: _Fit, alternates: bool = True) -> _Fit:
        """A fit after a step of Gauss and Newton.

        By the likeliest method; `alternates`: with what alternates beside.

        Raises:
            FlowError: the equations have no finite motion between rows of what went in.
        """
        own, model, n = fit.filter, self.model, 2 * self.model.n
        before, half, changes = own.before(self.run), 1e-4, list[Array]()
        for d in half * np.eye(2):
            ends = [own.with_numbers(own.a + s * d[0], own.b + s * d[1]) for s in (-1.0, 1.0)]
            first, last = (model.rows(end.before(self.run)) for end in ends)
            changes.append(model.difference(first, last) / (2.0 * half))
        alternates = alternates and own.trapezoid
        if alternates:
            unknown = alternating(len(before))
            changes += [np.outer(x, e) for e in np.eye(n) for x in unknown.T]
        fits = self._fitted(before, np.stack(changes, axis=-1))
        left, step = min(fits, key=lambda item: item[0])
        moved = own.with_numbers(own.a + step[0], own.b + step[1])
        if alternates:
            along = step[2:].reshape(n, -1).T
            change = np.zeros((2, self.run.q.shape[1] + self.run.u.shape[1]))
            of_q, of_u = model.rates.T
            change[:, model.of_q[of_q]] = along[:, of_u]
            change[:, self.run.q.shape[1] + model.of_u] = along[:, model.n :]
            moved = replace(moved, alternating=own.alternating - change)
        return _Fit(moved, left)

    def settled(self, fit: _Fit) -> _Fit:
        """A fit after as many steps as make it better. Raises as `improved`."""
        fit = replace(fit, left=np.inf)
        for _ in range(NEWTON_STEPS):
            before, fit = fit, self.improved(fit)
            if fit.left > (1.0 - ROUGHLY) * before.left:
                break
        return fit

    def _flat(self, x: Array) -> Array:
        """Columns (N, 2n, p) in units of the prediction errors (N · 2n, p)."""
        return (x / self.unit[:, None]).reshape(x.shape[0] * x.shape[1], x.shape[2])

    def _point(self, run: Trajectory) -> Point:
        log = observations(self.model, run, len(run))
        if log is None:
            raise FlowError("too few rows are left of what went into the filter")
        point = start(self.model, run, log)
        if len(point.log.intervals) != len(run) - 1:
            raise FlowError("the flow of what went into the filter leaves all bounds")
        return point

    def _fitted(self, run: Trajectory, change: Array) -> Iterator[tuple[float, Array]]:
        """What each method leaves, by forces of each kind, beside changes of the rows (T, 2n, p).

        With the numbers of these. Causes are beside both.
        """
        point, model = self._point(run), self.model
        log = point.log
        B = point.tangent.transported(cause_columns(point.flow, log, self.kernels, None))
        basis = self._flat(B)
        if basis.shape[1]:
            sizes = np.linalg.norm(basis, axis=0)
            basis = orth(basis[:, sizes > 0.0] / sizes[sizes > 0.0], rcond=SAME)

        def beside_causes(x: Array) -> Array:
            flat = self._flat(x)
            return np.asarray(flat - basis @ (basis.T @ flat))

        for kind in BETWEEN_ROWS if run.forces else BETWEEN_ROWS[:1]:
            forces = point.forces.alike(kind)
            # A memory is a filter as well.
            methods = tuple(m for m in INTEGRATORS if m.memory is None)
            for of in point.flow.at(log, forces=forces, methods=methods).maps:
                w = model.difference(of.end, log.intervals.end)
                Phi = transition(model, of, log.intervals, forces.between)
                moved = change[1:] - (point.tangent.Phi if Phi is None else Phi) @ change[:-1]
                r, D = beside_causes(w[:, :, None])[:, 0], beside_causes(moved)
                if np.isfinite(r).all() and np.isfinite(D).all():
                    step = np.asarray(-np.linalg.lstsq(D, r)[0], dtype=float)
                    # In most intervals: blows are of a few, which two numbers could explain.
                    each = ((r + D @ step) ** 2).reshape(w.shape).mean(axis=1)
                    yield float(np.sqrt(np.median(each))), step


def _likely(rows: _FilteredRows) -> list[_Fit]:
    """Filters by which prediction errors are a small share of those of a log, the likeliest first."""
    settled = list[_Fit]()
    for trapezoid, forces in product((True, False), (False, True)):
        if forces and not rows.run.forces:
            continue
        with suppress(FlowError, np.linalg.LinAlgError):
            first = LowPass(BEGIN, BEGIN**2 / 2, trapezoid, forces)
            fit = rows.improved(_Fit(first, np.inf), alternates=False)
            if fit.left <= rows.whole:
                settled.append(rows.settled(fit))
    share = LEFT_OF_INPUT if rows.kernels else NOTHING
    right = [fit for fit in settled if fit.filter.low_pass and fit.left < share * rows.whole]
    return sorted(right, key=lambda fit: fit.left)


def unfiltered(
    model: LogModel, run: Trajectory, kernels: tuple[ColumnKernels, ...] = ()
) -> tuple[Trajectory, Finding] | None:
    """What went into the filter of a log, if it follows itself; None for no filter.

    All states went through it, or all columns, at even times. With the columns of causes it is looked for
    beside these.
    """
    a, b = max(stretches(run), key=lambda piece: piece[1] - piece[0], default=(0, 0))
    h = np.diff(run.t[a:b])
    derived = "u" in run.provenance.derived or model.quaternions or run.works or run.integrals
    if derived or b - a < LEAST_ROWS or np.ptp(h) > ROUGHLY * h.mean():
        return None
    acting = LoggedForces.of(run).places
    run = run.take(slice(a, b))
    if LoggedForces.of(run).places != acting:
        return None  # what acts elsewhere only has no column here
    part = run.take(slice(0, LEAST_ROWS))
    part = part if LoggedForces.of(part).places == acting else run
    with np.errstate(all="ignore"), compiled_rows(), suppress(FlowError, np.linalg.LinAlgError):
        if _FilteredRows(model, part, ()).whole < SIX_DIGITS:  # most rows follow from each other
            return None
        for fit in _likely(_FilteredRows(model, part, kernels)):
            own = _FilteredRows(model, run, kernels).settled(fit).filter
            return own.before(run), _told(own, float(h.mean()), fit.left)
    return None


def _told(own: LowPass, h: float, left: float) -> Finding:
    what = "all columns" if own.forces else "coordinates and speeds"
    return Finding(
        "filtered",
        f"{what} of the log went through a filter that is {own.a * h:.3g} s late",
        f"of what went in, the equations leave {percent(left)} of what they leave of the log",
        "Log what goes into the filter; it is what is judged",
        "note",
        factor=own.a * h,
    )
