"""Which further motion would tell causes apart that a log does not: computed, not guessed."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equations import Sampled
from deltac.diagnosis.explanation.columns import evaluate
from deltac.diagnosis.explanation.equations import Prepared
from deltac.diagnosis.explanation.regression import Fit
from deltac.diagnosis.explanation.search import Found
from deltac.mechanism.joints import KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

Array: TypeAlias = NDArray[np.float64]

STATES = 60
APART = 0.05
"""Relative difference of what two causes do, from which on a motion is said to tell them apart."""


def advice(mechanism: Mechanism, run: Trajectory, prepared: Prepared, found: Found) -> str:
    """A sentence: the simplest motion in which the causes differ, or that there is none."""
    fits = [found.best, *found.alternatives]
    most, said = 0, ""
    for name, samples in _experiments(mechanism, run, prepared):
        first, *others = _effects(prepared, samples, fits)
        told = sum(_difference(first, other) > APART for other in others)
        if told > most:
            most, said = told, name
    if not said:
        return (
            "No motion of this machine tells them apart by joint coordinates and these forces: they say the "
            "same in other words"
        )
    them = "them" if most == len(found.alternatives) else "some of them"
    return f"To tell {them} apart, log also {said}"


def _effects(prepared: Prepared, samples: Sampled, fits: list[Fit]) -> list[Array]:
    """What each fit adds to the equations at the samples, scaled equation by equation."""
    kernels = prepared.kernels
    nothing = np.zeros_like(samples.logged)
    rng = np.random.default_rng(2)
    rates = [rng.standard_normal(nothing.shape) * (np.abs(samples.logged) > 0) for _ in range(2)]
    columns = [
        samples.t[:, None], samples.q, samples.u, samples.udot, samples.logged, *rates,
    ]  # fmt: skip
    X = evaluate(kernels.pointwise(), columns, kernels.speeds)[0][..., 1:]
    scale = np.sqrt(np.mean(np.sum(X**2, axis=2), axis=0))
    X = X / np.maximum(scale, 1e-300)[:, None]
    found = []
    for fit in fits:
        total = np.zeros(X.shape[:2])
        for k, theta in zip(fit.chosen, fit.theta):
            c = prepared.regression.candidates[k]
            total += X[..., list(c.columns)] @ c.coefficients(theta)
        found.append(total.ravel())
    return found


def _difference(a: Array, b: Array) -> float:
    """Relative difference of two effects."""
    size = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)))
    return float(np.linalg.norm(a - b)) / size if size > 0.0 else 0.0


def _experiments(
    mechanism: Mechanism, run: Trajectory, prepared: Prepared
) -> list[tuple[str, Sampled]]:
    """Motions that a user could make, simplest first."""
    rng = np.random.default_rng(1)
    free = mechanism.free
    speed = max(float(np.abs(run.u).max(initial=0.0)), 1.0)
    bent = max(speed**2, 10.0)
    nq, nu = len(free.q), len(free.u)
    logged = prepared.kernels.evaluator.log.size

    def states(q: Array, u: Array, udot: Array, forces: float) -> Sampled:
        return Sampled(
            np.full(STATES, float(run.t[0])),
            q,
            u,
            udot,
            forces * rng.standard_normal((STATES, logged)),
        )

    anywhere = _poses(mechanism, rng)
    here = np.repeat(run.q[:1, free.q], STATES, axis=0)
    still = np.zeros((STATES, nu))
    fast, hard = speed * rng.standard_normal((STATES, nu)), bent * rng.standard_normal((STATES, nu))
    force = (
        float(max((np.abs(f).max(initial=0.0) for f in run.forces.values()), default=0.0)) or 1.0
    )
    found = [
        ("the machine at rest in several poses", states(anywhere, still, still, 0.0)),
        ("a motion with other forces of the motors", states(anywhere, fast, hard, force)),
    ]
    for k in range(nu):
        alone = np.zeros((STATES, nu))
        alone[:, k] = 1.0
        name = mechanism.speeds[int(free.u[k])].name
        found.append((f"a motion of `{name}` alone", states(here, fast * alone, hard * alone, 0.0)))
    found += [
        ("fast motions at constant speeds", states(anywhere, 5 * fast, still, 0.0)),
        ("a motion of all joints through other poses", states(anywhere, fast, hard, 0.0)),
    ]
    assert all(s.q.shape[1] == nq for _, s in found)
    return found


def _poses(mechanism: Mechanism, rng: np.random.Generator) -> Array:
    """Random poses (STATES, free q); quaternions of unit length."""
    q = rng.uniform(-np.pi, np.pi, (STATES, len(mechanism.coordinates)))
    for joint in mechanism.joints:
        offset = KINDS[joint.kind].quaternion
        if offset is not None:
            start = mechanism.coordinates.of(joint.name).start + offset
            turns = rng.standard_normal((STATES, 4))
            q[:, start : start + 4] = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    return np.asarray(q[:, mechanism.free.q])
