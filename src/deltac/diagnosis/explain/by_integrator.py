"""A mistake that shows once the integrator is known: each integrator is tried together with each cause.

A log that holds every step of an integrator obeys its relation to rounding, if the equations are right. If
they have one mistake, what the relation leaves is that mistake and nothing else. With another integrator, or
another cause, much more is left. Such a pair is found together, and counts where it leaves far less than the
freest unknown integrator does with equations that are right: so mistakes far below what an unknown integrator
may leave are found, and told to many digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import Array
from deltac.calls.progress import Deadline, Progress, counted, untold
from deltac.diagnosis.explain.columns import ColumnKernels, column_kernels
from deltac.diagnosis.explain.explain import told
from deltac.diagnosis.explain.regression import (
    LEAST,
    NOISY,
    Prepared,
    arranged,
    factored,
    regression_of,
    terms_of,
)
from deltac.diagnosis.explain.search import Found, promise, search
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.residuals.at_samples import Evaluator
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.residuals.rows import trimmed
from deltac.diagnosis.residuals.schemes import METHODS, Relation, Scheme, Steps
from deltac.diagnosis.verdict import Finding
from deltac.mechanism.forces import JointDamper, JointSpring
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

FAR_LESS = 0.1
"""Share that a pair may leave of what an unknown integrator leaves, and of what there is to explain."""

SURELY = 3.0
"""How many times more than a pair may leave digits must leave for none to be looked for."""

MOST = 3
"""Relations for which the search is made in full."""

APART = 3.0
"""How many times more all other integrators must leave with their causes for one to be named."""

CLEAR = 30.0
"""How many times digits and rounding a mistake must be."""


NEARLY = 1.1
"""How many times what an implicit step makes a cause may be to be that."""


@dataclass(frozen=True, eq=False)
class _Pair:
    """An integrator with the cause that explains best what its relation leaves, residual (I, n)."""

    relation: Relation
    prepared: Prepared
    residual: Array
    weight: Array
    found: Found

    @property
    def left(self) -> float:
        """Root mean square of what the cause leaves, weighted."""
        return math.sqrt(self.found.best.left / len(self.residual))

    @property
    def total(self) -> float:
        """The same without a cause."""
        return math.sqrt(self.prepared.regression.total / len(self.residual))


def known_but_for_one(
    mechanism: Mechanism,
    run: Trajectory,
    step: OneStep,
    deadline: Deadline,
    progress: Progress = untold,
) -> tuple[OneStep, tuple[Finding, ...]] | None:
    """The one-step test with an integrator that closes but for one cause, and that cause; None if none does.

    A pair counts since no other closes: when the `deadline` has passed before all were tried, none does.
    """
    steps = step.steps
    prescribed = len(mechanism.free.u) < len(mechanism.speeds)
    if steps is None or step.closes or prescribed or _below_digits(run, step, steps):
        return None
    evaluator = Evaluator(mechanism, run)
    for end, of in zip(evaluator.reach, (np.min, np.max)):  # of the rows that are looked at
        end[mechanism.free.q] = of(steps.start.q, axis=0)
    kernels = column_kernels(evaluator)
    tried, h = [], float(np.median(np.diff(run.t)))
    for relation in counted(list(_distinct(steps)), progress):
        if deadline.passed("all integrators together with one cause"):
            return None
        at = relation.at
        udot = steps.model.acceleration(at.t, at.q, at.u, at.F) + steps.D - relation.a
        still = np.zeros_like(at.F)
        whole = kernels(at.t, at.q, at.u, udot, at.F, still, still)
        method = METHODS.get(relation.name)
        if method is not None and method.at and not np.array_equal(udot, steps.D):
            # What implicit terms take off an acceleration is no part of what inertias multiply.
            whole[..., 1:] = kernels(at.t, at.q, at.u, steps.D, at.F, still, still)[..., 1:]
        several = method is None or method.order > 1  # instants, of which the columns are of one
        change = np.gradient(whole, at.t, axis=0) * h if several else None
        tried.append((relation, *_regression(whole, kernels, run, at.u, change)))
    tried.sort(key=lambda item: promise(item[1].regression))
    pairs = [
        _Pair(relation, prepared, residual, weight, search(prepared.regression, 1, deadline))
        for relation, prepared, residual, weight in tried[:MOST]
    ]
    best = min(pairs, key=lambda pair: pair.left, default=None)
    if best is None or not _counts(best, step, h):
        return None
    name = steps.named(best.relation)
    others = [p.left for p in pairs if steps.named(p.relation) != name]
    known = _with(step, best, name if min(others, default=math.inf) > APART * best.left else "")
    if not known.significant.any():
        return None
    return known, told(best.prepared, best.found, run).findings


def _below_digits(run: Trajectory, step: OneStep, steps: Steps) -> bool:
    """Whether the digits of the speeds alone leave more than any pair may that counts.

    They are in the mean accelerations D, and so in what every relation leaves; no cause takes them off.
    """
    rows = np.searchsorted(run.t, steps.start.t)
    speeds = steps.model.mechanism.free.u
    rounded = digits_of(run)["u"].half(rows)[:, speeds] * math.sqrt(2.0 / 3.0)  # of two rows
    rounded = rounded / (run.t[rows + 1] - run.t[rows])[:, None]
    digits = np.sqrt(np.mean((steps.N**2 @ rounded[..., None] ** 2)[..., 0], axis=0))
    found, scale = step.residual, np.maximum(step.residual.scale, 1e-300)
    return float(np.linalg.norm(digits / scale)) > SURELY * FAR_LESS * float(
        np.linalg.norm(found.size / scale)
    )


def _distinct(steps: Steps) -> list[Relation]:
    """The relations, of methods of high order those that see their forces and the rows in their own way."""
    found: list[Relation] = []
    for r in steps.relations:
        method = METHODS.get(r.name)
        accurate = method is not None and method.order > 2 and not method.on_group
        if accurate and (r.name != "rk4" or r.forces == "smooth"):
            continue
        if not any(np.allclose(r.a, x.a, rtol=1e-12, atol=0.0) for x in found):
            found.append(r)
    return found


def _regression(
    whole: Array, kernels: ColumnKernels, run: Trajectory, u: Array, change: Array | None
) -> tuple[Prepared, Array, Array]:
    """The regression of [r X] (I, n, 1 + P), with r and the weights of the equations.

    The columns may be off by their `change` (I, n, 1 + P) over a step.
    """
    scale = terms_of(whole, kernels)
    weight = 1.0 / np.maximum(NOISY * scale, 1e-300)
    matrix, width = arranged(whole * weight[:, None]), whole.shape[2]
    blur: Array | None = None
    if change is not None:
        blur = factored([arranged(change * weight[:, None]).reshape(-1, width)])[0]
    # What digits and noise leave needs no estimate: no cause takes it off.
    precise = float(np.sum((LEAST * scale * weight) ** 2))
    prepared = regression_of(
        kernels, run, matrix, whole[..., 1:], u, whole[..., 0], np.zeros_like(scale), scale, precise,
        np.zeros((1, width)), np.ones(whole.shape[:2]), blur=blur,
    )  # fmt: skip
    return prepared, whole[..., 0], weight


def _counts(pair: _Pair, step: OneStep, h: float) -> bool:
    """Whether a pair says more than that some unknown integrator was at work."""
    regression = pair.prepared.regression
    if not pair.found.best.chosen or not regression.stands_out(pair.found.best):
        return False
    unknown = float(np.linalg.norm(step.residual.size * pair.weight))
    there = CLEAR * math.sqrt(regression.precision / len(pair.residual))
    if pair.left > FAR_LESS * min(unknown, pair.total) or pair.total < there:
        return False
    return not _of_an_integrator(pair, h)


def _of_an_integrator(pair: _Pair, h: float) -> bool:
    """Whether the cause is what forces of the end of a step make, as an inertia of h times a damping.

    A relation that takes these at the end already has that; more of it is no integrator's.
    """
    mechanism = pair.prepared.kernels.evaluator.mechanism
    method = METHODS.get(pair.relation.name)
    at_end = method.at_end if method is not None else ()
    for k, theta in zip(pair.found.best.chosen, pair.found.best.theta):
        c = pair.prepared.regression.candidates[k]
        joint = c.element.split(".")[0]  # of a speed of several: joint.speed
        damping = 0.0 if "damper" in at_end else _largest(mechanism, JointDamper, joint)
        stiffness = 0.0 if "spring" in at_end else _largest(mechanism, JointSpring, joint)
        like = {
            "armature": h * damping + h * h * stiffness,
            "missing-rotor-inertia": h * damping + h * h * stiffness,
            "damping": h * stiffness,
            "missing-damper": h * stiffness,
        }
        if len(theta) == 1 and abs(float(theta[0])) <= NEARLY * like.get(c.kind, 0.0):
            return True
    return False


def _largest(mechanism: Mechanism, of: type[JointDamper] | type[JointSpring], joint: str) -> float:
    """The largest constant damping or stiffness of the dampers or springs of a joint."""
    laws = (
        law
        for e in mechanism.elements
        if isinstance(e, of) and e.joint == joint
        for law in (e.damping if isinstance(e, JointDamper) else e.stiffness)
    )
    return max((abs(law) for law in laws if isinstance(law, float)), default=0.0)


def _with(step: OneStep, pair: _Pair, name: str) -> OneStep:
    """The test with its integrator, `name` if it has one: it leaves the residual, the causes the bar."""
    steps, r = step.steps, pair.residual
    assert steps is not None
    bar = (
        np.maximum(pair.left, math.sqrt(pair.prepared.regression.precision / len(r))) / pair.weight
    )
    u = steps.start.u
    order = METHODS[name].order if name else 0
    time_ = float(step.residual.t[-1] - step.residual.t[0])
    left = replace(
        step.residual,
        t=steps.start.t,
        forces=r,
        allowed=np.broadcast_to(bar, r.shape),
        size=trimmed(r),
        bar=bar,
        taken=np.zeros_like(bar),
        hidden=float(np.sum(trimmed(u) * bar)) * time_,
        spent=abs(float(np.mean(np.sum(u * r, axis=1)))) * time_,
        bars={"left by the cause": bar},
    )
    return replace(
        step,
        scheme=Scheme(name, order, 1.0, steps.digits, pair.relation.forces, 1.0),
        found=lambda: left,
        by_scheme=lambda: None,
        known_but_for_causes=True,
    )
