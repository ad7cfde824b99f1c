"""Logs of a low-pass filter: what went into it, recovered as the filter made its output.

What went into a digital filter of second order is x + a Dx + b D²x of what came out, x, D a derivative in
units of rows: the backward difference in recursive averages, and 2 (1 − z⁻¹)/(1 + z⁻¹) in filters that the
trapezoid rule makes of analogue ones, as Butterworth's (Oppenheim & Schafer, Discrete-Time Signal Processing,
§7.1). Columns that went through it forwards and backwards keep their time. What went in follows from row to
row by the equations and an integrator: a and b are those of the least prediction errors, by the method of
Gauss and Newton.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inference.integrators import EXACT, Integrator, transition
from deltac.diagnosis.inference.linearisation import FlowError, start
from deltac.diagnosis.inference.model import Model
from deltac.diagnosis.inference.observations import observations
from deltac.diagnosis.measurements.kinematics import stretches
from deltac.diagnosis.verdict import Finding
from deltac.kernels.rows import compiled
from deltac.results import percent
from deltac.trajectories import Trajectory

ROWS = 200
"""Rows by which kinds of filters are compared."""

BEGIN = (1.0, 0.5)
"""Numbers a and b to begin with, of Butterworth's filter: twice through it, its time is no longer kept by
a = 0 alone."""

FIRST, TURNS = 2, 20
"""Steps of Gauss and Newton by which kinds are compared, and all of them at most."""

LIKELY = 2
"""Kinds of filters that are told by more than the first steps: of the two D the wrong one may be ahead."""

BETTER = 0.9
"""Share of what was left before a step from which on the numbers are found."""

LEFT = 0.1
"""Share of the prediction errors of a log that may be left of what went into its filter."""

EVEN = 0.1
"""Differences of intervals as a share of them, of a clock that jitters: a digital filter knows no time."""

SMOOTH = 6
"""Order of differences by which what alternates from row to row is told from a motion."""


@dataclass(frozen=True, eq=False)
class LowPass:
    """A filter of second order, by numbers a and b (rows and their squares) of its inverse.

    trapezoid    whether D is that of the trapezoid rule
    twice        whether columns went through it forwards and backwards
    forces       whether logged forces went through it as well
    alternating  what alternates in coordinates and speeds (k, nq + nu): the trapezoid's inverse does not tell
                 it. Its rows are of powers of time over that of the log
    """

    a: float
    b: float
    trapezoid: bool
    twice: bool
    forces: bool
    alternating: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def delay(self) -> float:
        """By how many rows columns are late that went through it."""
        return 0.0 if self.twice else self.a

    @property
    def order(self) -> int:
        """Powers of time of what alternates and is not known."""
        return 2 * self.trapezoid * (1 + self.twice)

    def with_numbers(self, a: float, b: float) -> LowPass:
        """The same filter with other numbers."""
        return replace(self, a=a, b=b)

    def before(self, run: Trajectory) -> Trajectory:
        """What went in: all but the first two rows, and the last two of those that went through twice."""
        some = run.take(slice(2, -2 if self.twice else None))
        forces = some.forces
        if self.forces:
            forces = {name: self._before(f) for name, f in run.forces.items()}
        q, u = self._before(run.q), self._before(run.u)
        if self.alternating.size:
            both = alternating(len(some), self.order) @ self.alternating
            q, u = q - both[:, : q.shape[1]], u - both[:, q.shape[1] :]
        return replace(some, q=q, u=u, udot=None, forces=forces, integrals={}, works={}, events=())

    def _before(self, x: Array) -> Array:
        once = self._forwards(x)
        return self._forwards(once[::-1])[::-1] if self.twice else once

    def _forwards(self, x: Array) -> Array:
        a, b = (2.0 * self.a, 4.0 * self.b) if self.trapezoid else (self.a, self.b)
        plus, minus = (1.0, 2.0, 1.0) if self.trapezoid else (1.0, 0.0, 0.0), (1.0, -2.0, 1.0)
        along = (1.0, 0.0, -1.0) if self.trapezoid else (1.0, -1.0, 0.0)
        own = np.array(plus) + a * np.array(along) + b * np.array(minus)
        y = own[0] * x[2:] + own[1] * x[1:-1] + own[2] * x[:-2]
        if not self.trapezoid:
            return np.asarray(y)
        # (1 + z⁻¹)² is a second difference of what alternates.
        signs = alternating(len(y), 1)[:, 0].reshape(-1, *(1,) * (y.ndim - 1))
        y = signs * np.cumsum(np.cumsum(signs * y, axis=0), axis=0)
        flat, unknown = y.reshape(len(y), -1), alternating(len(y), 2)
        rough = [np.diff(part, SMOOTH, axis=0) for part in (unknown, flat)]
        return np.asarray((flat - unknown @ np.linalg.lstsq(*rough)[0]).reshape(y.shape))


def alternating(rows: int, powers: int) -> Array:
    """(−1)^k τ^j (T, p) for powers j of the time τ from 0 to 1."""
    k = np.arange(rows)
    return np.asarray((1.0 - 2.0 * (k % 2))[:, None] * (k[:, None] / rows) ** np.arange(powers))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A filter with its prediction errors, in units of those of the log, by forces of a kind and a method."""

    filter: LowPass
    left: float
    kind: str
    method: Integrator


KINDS = ("smooth", "start")
"""How forces act between rows of a fit."""


def _improved(
    model: Model, run: Trajectory, fit: _Fit, unit: Array, every: bool, whole: bool = False
) -> _Fit:
    """A fit after a step of Gauss and Newton.

    `every`: by the likeliest method of all; `whole`: with what alternates beside.

    Raises:
        FlowError: the equations have no finite motion between rows of what went in.
    """
    own = fit.filter
    before = own.before(run)
    log = observations(model, before, len(before))
    if log is None:
        raise FlowError("too few rows are left of what went into the filter")
    point = start(model, before, log)
    if len(point.log.intervals) != len(before) - 1:
        raise FlowError("the flow of what went into the filter leaves all bounds")
    changes, half = list[Array](), 1e-4
    for d in half * np.eye(2):
        ends = [own.with_numbers(own.a + s * d[0], own.b + s * d[1]) for s in (-1.0, 1.0)]
        first, last = (model.rows(end.before(run)) for end in ends)
        changes.append(model.difference(first, last) / (2.0 * half))
    unknown = alternating(len(before), own.order if whole else 0)
    parts = [np.outer(x, e) for e in np.eye(2 * model.n) for x in unknown.T]
    change = np.stack([*changes, *parts], axis=-1)
    best: tuple[float, Array, str, Integrator] | None = None
    for kind in KINDS if run.forces else KINDS[:1]:
        forces = point.forces.alike(kind)
        flow = replace(point.flow.at(log, forces=forces), methods=() if every else (fit.method,))
        for of in flow.maps:
            if not every and of.method is not fit.method:
                continue
            w = (model.difference(of.end, log.intervals.end) / unit).ravel()
            Phi = transition(model, of, log.intervals, forces.between)
            columns = change[1:] - (point.tangent.Phi if Phi is None else Phi) @ change[:-1]
            columns = (columns / unit[:, None]).reshape(len(w), -1)
            if np.isfinite(w).all() and np.isfinite(columns).all():
                step = -np.linalg.lstsq(columns, w)[0]
                left = float(np.sqrt(np.mean((w + columns @ step) ** 2)))
                if best is None or left < best[0]:
                    best = left, step, kind, of.method
    if best is None:
        raise FlowError("no method has a finite motion between rows of what went into the filter")
    left, step, kind, method = best
    moved = own.with_numbers(own.a + step[0], own.b + step[1])
    if len(parts):
        along = step[2:].reshape(2 * model.n, -1).T
        change = np.zeros((own.order, run.q.shape[1] + run.u.shape[1]))
        of_q, of_u = model.rates.T
        change[:, model.of_q[of_q]] = along[:, of_u]
        change[:, run.q.shape[1] + model.of_u] = along[:, model.n :]
        known = own.alternating if own.alternating.size else np.zeros_like(change)
        moved = replace(moved, alternating=known - change)
    return _Fit(moved, left, kind, method)


def _settled(model: Model, run: Trajectory, fit: _Fit, unit: Array) -> _Fit:
    """A fit after as many steps as make it better. Raises as `_improved`."""
    fit = replace(fit, left=np.inf)
    for turn in range(TURNS):
        before, fit = fit, _improved(model, run, fit, unit, not turn, whole=True)
        if fit.left > BETTER * before.left:
            break
    return fit


def _likely(model: Model, run: Trajectory) -> list[_Fit]:
    """Filters by which prediction errors are a `LEFT` of those of a log, the likeliest first."""
    log = observations(model, run, len(run))
    if log is None:
        return []
    flow = start(model, run, log).flow
    unit = np.sqrt(np.mean(flow.w**2, axis=0)) + 1e-300
    ends = [model.difference(of.end, log.intervals.end) / unit for of in flow.maps]
    whole = min(float(np.sqrt(np.mean(w**2))) for w in ends if np.isfinite(w).all())
    fits, settled = list[_Fit](), list[_Fit]()
    for trapezoid, twice, forces in product((True, False), (False, True), (False, True)):
        fit = _Fit(LowPass(*BEGIN, trapezoid, twice, forces), np.inf, KINDS[0], EXACT)
        if run.forces or not forces:
            with suppress(FlowError, np.linalg.LinAlgError):
                for turn in range(FIRST):
                    fit = _improved(model, run, fit, unit, True, turn > 0)
                    if fit.left > whole:
                        break
                else:
                    fits.append(fit)
    for fit in sorted(fits, key=lambda fit: fit.left)[:LIKELY]:
        with suppress(FlowError, np.linalg.LinAlgError):
            settled.append(_settled(model, run, fit, unit))
    right = [fit for fit in settled if fit.left < LEFT * whole]
    return sorted(right, key=lambda fit: fit.left)


def unfiltered(model: Model, run: Trajectory) -> tuple[Trajectory, Finding] | None:
    """What went into the filter of a log, if it follows itself; None for no filter.

    All states went through it, or all columns. Its rows are at even times; those of a model with causes in
    its equations may tell it, too.
    """
    a, b = max(stretches(run), key=lambda piece: piece[1] - piece[0])
    h = np.diff(run.t[a:b])
    derived = "u" in run.provenance.derived or model.quaternions or run.works or run.integrals
    if derived or b - a < ROWS or np.ptp(h) > EVEN * h.mean():
        return None
    run = run.take(slice(a, b))
    with np.errstate(all="ignore"), compiled(), suppress(FlowError, np.linalg.LinAlgError):
        for fit in _likely(model, run.take(slice(0, ROWS))):
            own = _settled(model, run, fit, np.ones(2 * model.n)).filter
            return own.before(run), _told(own, float(h.mean()), fit.left)
    return None


def _told(own: LowPass, h: float, left: float) -> Finding:
    what = "all columns" if own.forces else "coordinates and speeds"
    late = f"is {own.delay * h:.3g} s late" if own.delay else "keeps the time"
    return Finding(
        "filtered",
        f"{what} of the log went through a filter that {late}",
        f"of what went in, the equations leave {percent(left)} of what they leave of the log",
        "Log what goes into the filter; it is what is judged",
        "note",
        factor=own.delay * h,
    )
