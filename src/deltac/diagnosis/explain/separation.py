"""Which further motion would tell causes apart that a log does not: computed, not guessed."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inference.hypotheses import Fit
from deltac.diagnosis.inference.inference import Inference
from deltac.mechanism.joints import KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

STATES = 60
APART = 0.05
"""Relative difference of what two causes do, from which on a motion is said to tell them apart."""


Samples: TypeAlias = tuple[Array, ...]
"""t, free q, u and u̇, logged forces (STATES, …)."""


def advice(run: Trajectory, inference: Inference) -> str:
    """A sentence: the simplest motion in which the causes differ, or that there is none."""
    fits = [inference.posterior.best, *inference.posterior.alternatives]
    most, motion = 0, ""
    for name, samples in _experiments(run, inference):
        first, *others = _effects(inference, samples, fits)
        distinguished = sum(_difference(first, other) > APART for other in others)
        if distinguished > most:
            most, motion = distinguished, name
    if not motion:
        return (
            "No motion of this machine can tell them apart from joint coordinates and these forces: they "
            "are equivalent"
        )
    them = "them" if most == len(fits) - 1 else "some of them"
    return f"To tell {them} apart, log also {motion}"


def _effects(inference: Inference, samples: Samples, fits: list[Fit]) -> list[Array]:
    """What each fit adds to the equations at the samples, scaled equation by equation."""
    logged = samples[-1]
    rng = np.random.default_rng(2)
    rates = [rng.standard_normal(logged.shape) * (np.abs(logged) > 0) for _ in range(2)]
    X = np.concatenate(
        [kernels(*samples, *rates)[..., 1:] for kernels in inference.kernels], axis=2
    )
    scale = np.sqrt(np.mean(np.sum(X**2, axis=2), axis=0))
    X = X / np.maximum(scale, 1e-300)[:, None]
    effects = []
    for fit in fits:
        total = np.zeros(X.shape[:2])
        for c, theta in zip(fit.chosen, fit.theta, strict=True):
            effect = X[..., list(c.columns)] @ c.coefficients(theta)
            if c.touching is not None:  # it pushes to one side, wherever else the motion goes
                effect = np.where(effect * (theta[1] - theta[0] * c.touching[0]) > 0.0, effect, 0.0)
            total += effect
        effects.append(total.ravel())
    return effects


def _difference(a: Array, b: Array) -> float:
    """Relative difference of two effects."""
    size = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)))
    return float(np.linalg.norm(a - b)) / size if size > 0.0 else 0.0


def _experiments(run: Trajectory, inference: Inference) -> list[tuple[str, Samples]]:
    """Motions that a user could make, simplest first."""
    rng = np.random.default_rng(1)
    mechanism = inference.model.mechanism
    free = mechanism.free
    speed = max(float(np.abs(run.u).max(initial=0.0)), 1.0)
    bent = max(speed**2, 10.0)
    nu, logged = len(free.u), inference.model.log.size

    def states(q: Array, u: Array, udot: Array, forces: float) -> Samples:
        t = np.full(STATES, float(run.t[0]))
        return t, q, u, udot, forces * rng.standard_normal((STATES, logged))

    anywhere = _poses(mechanism, rng)
    pose = np.repeat(run.q[:1, free.q], STATES, axis=0)
    still = np.zeros((STATES, nu))
    fast, hard = speed * rng.standard_normal((STATES, nu)), bent * rng.standard_normal((STATES, nu))
    force = (
        max((float(np.abs(f).max(initial=0.0)) for f in run.forces.values()), default=0.0) or 1.0
    )
    motions = [
        ("the machine at rest in several poses", states(anywhere, still, still, 0.0)),
        ("a motion with different motor forces", states(anywhere, fast, hard, force)),
    ]
    for k, alone in enumerate(np.eye(nu)):
        name = mechanism.speeds[int(free.u[k])].name
        motions.append(
            (f"a motion of `{name}` alone", states(pose, fast * alone, hard * alone, 0.0))
        )
    return [
        *motions,
        ("fast motions at constant speeds", states(anywhere, 5 * fast, still, 0.0)),
        ("a motion of all joints through other poses", states(anywhere, fast, hard, 0.0)),
    ]


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
