"""What the integrator of a log would do at another step: its joules, along the rows of the log.

A method that closes the rows is tried at the other step from each of them: the energy at the end of such a
step beyond that of the exact flow, divided by the step, is the power of its error, with all orders of the
step. Where only the numbers of a method are known, its joules grow with the power that is its order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import make_interp_spline

from deltac.arrays import EPS, NEWTON_STEPS, SAME_STEP, Array
from deltac.diagnosis.inference.flow import predict
from deltac.diagnosis.inference.forces import FORCES, ForceInStep
from deltac.diagnosis.inference.integrators import Integrator
from deltac.diagnosis.inference.model import Intervals, Rows
from deltac.diagnosis.inference.result import Inference
from deltac.diagnosis.verdict import LEAST_ORDER

PREDICTED_ROWS = 200
"""Rows of the log from which a method is tried, at most: the largest of a sum needs two digits."""

SHARE = 0.1
"""Share of the errors of a step that is noise to the flow from which they are measured."""

SETTLED = 1e-10
"""Change of an implicit step, relative to the state, at which it is solved."""

TRIALS = 6
"""Steps that are tried, at most; the secant's error is below a per cent after three."""

LONGEST = 10.0
"""Steps, in steps of the log, up to which its rows tell what a method does."""


def step_with(inference: Inference, energy: float, accepted: float) -> float:
    """The step (s) at which the integrator's joules reach `accepted`, if they reach `energy` at its own.

    The secant of log energy over log step, from the power law of the order on. At most `LONGEST` times the
    step of the log.
    """
    own, order = inference.integrator.step, float(inference.integrator.order)
    goal, farthest = float(np.log(accepted / energy)), float(np.log(LONGEST))
    size = _size(inference)
    at = 0.0 if size is None else size(own)
    x, y, slope = 0.0, 0.0, order
    for _ in range(TRIALS if size is not None and np.isfinite(at) and at > 0.0 else 0):
        after = min(x + (goal - y) / slope, farthest)
        value = size(own * np.exp(after)) if size is not None else 0.0
        if not (np.isfinite(value) and value > 0.0):
            break  # the method leaves all bounds there: the law of the steps before stands
        reached = float(np.log(value / at))
        secant = (reached - y) / (after - x) if after != x else slope
        slope = secant if secant > LEAST_ORDER else slope
        x, y = after, reached
        if abs(goal - y) < SAME_STEP * slope or (x == farthest and y < goal):
            break
    return float(own * np.exp(min(x + (goal - y) / slope, farthest)))


def _size(inference: Inference) -> Callable[[float], float] | None:
    """Largest joules (J) of the integrator along the log, as a function of the step; None without a map."""
    method = next(
        (m for m in inference.methods if m.step is not None or m.defect is not None), None
    )
    if method is None:
        return None
    log, model = inference.log, inference.model
    every = max(1, len(log.intervals) // PREDICTED_ROWS)
    some = slice(None, None, every)
    start = log.intervals.start.take(some)
    duration = log.intervals.h[:, 0]
    weight = np.add.reduceat(duration, np.arange(len(duration))[some])
    own, order = inference.integrator.step, inference.integrator.order
    a, b, c, d = np.array([FORCES[kind] for kind in inference.forces]).reshape(-1, 4).T
    # What a cubic tells of smooth forces a straight line would turn into kinks, which no order foresees.
    rows, ends = log.intervals.start, log.intervals.end
    times, forces = np.append(rows.t, ends.t[-1]), np.vstack([rows.F, ends.F[-1:]])
    degrees = ((c > 0.0, min(3, len(times) - 1)), (c == 0.0, 1))
    splines = [
        (some, make_interp_spline(times, forces[:, some], k)) for some, k in degrees if some.any()
    ]

    def logged(at: Array) -> Array:
        F = np.empty((len(at), forces.shape[1]))
        for columns, spline in splines:
            F[:, columns] = spline(at)
        return F

    @np.errstate(all="ignore")
    def joules(step: float) -> float:
        last = logged(start.t + step)

        def force(share: float | Array, _: float | Array | None = None) -> Array:
            constant = start.F + a * (last - start.F)
            return np.where(b > d, logged(start.t + np.ravel(share) * step), constant)

        intervals = Intervals(start, Rows(start.t + step, start.q, start.u, last))
        defects = np.abs(inference.w[some]) * min(step / own, 1.0) ** (order + 1)
        end = predict(model, intervals, force, SHARE * defects).end
        end = Rows(end.t, end.q, end.u, last)  # not the force that was held till then
        after = _stepped(inference, method, intervals, end, force)
        slope = 0.5 * (model.energy_gradient(end) + model.energy_gradient(after))
        power = np.einsum("km,km->k", slope, model.difference(end, after)) / step
        # Behind the last row no force is known.
        inside = not splines or start.t + step <= times[-1] + EPS
        return float(np.abs(np.cumsum(np.where(inside, power, 0.0) * weight)).max())

    return joules


def _stepped(
    inference: Inference,
    method: Integrator,
    intervals: Intervals,
    end: Rows,
    force: ForceInStep,
) -> Rows:
    """The rows after a step of the method; NaN where an implicit one does not settle."""
    model, start, h = inference.model, intervals.start, intervals.h
    if method.step is not None:
        return Rows(end.t, *method.step(model, start, h, force), end.F)
    assert method.defect is not None
    at = end
    for _ in range(NEWTON_STEPS):
        after = Rows(end.t, *method.defect(model, start, at, h, force(0.5)), end.F)
        change = max(np.abs(after.q - at.q).max(), np.abs(after.u - at.u).max())
        at = after
        if change <= SETTLED * (1.0 + np.abs(at.u).max()):
            return at
    return Rows(end.t, np.full_like(at.q, np.nan), np.full_like(at.u, np.nan), end.F)
