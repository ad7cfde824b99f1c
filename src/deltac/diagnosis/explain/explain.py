"""The few causes that explain what a model leaves of a log, or of several, from its inference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from deltac.arrays import NEGLIGIBLE, Array, max_norm
from deltac.diagnosis.explain.result import Cause, Explanation, Outcome, sentence
from deltac.diagnosis.inference.hypotheses import Fit, autocorrelation_time, nothing
from deltac.diagnosis.inference.joint import joint_posterior
from deltac.diagnosis.inference.result import Inference
from deltac.diagnosis.inputs.channels import Gear
from deltac.diagnosis.residuals.kane import any_coordinates
from deltac.diagnosis.residuals.states import TRIAL_STATES
from deltac.diagnosis.verdict import Finding
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

UNSEEN = 0.3
"""Standard error of a factor from which on a log is said not to show it."""


def joint_explanation(inferences: Sequence[Inference], each: Sequence[Explanation]) -> Explanation:
    """The causes that several logs of one machine have together, in words; `each` is what one alone tells."""
    posterior, blocks = joint_posterior(inferences)
    best, mechanism = posterior.best, inferences[0].model.mechanism

    def left(coefficients: Array) -> float:
        return float(sum(block.projected.left(coefficients) for block in blocks))

    def causes(fit: Fit) -> tuple[Cause, ...]:
        """Those of a set, the largest share first; errors by the slowest correlation of what is left."""
        slowest = max(autocorrelation_time(b.residual(fit.coefficients)) for b in blocks)
        named = _causes(mechanism, fit, left, lambda k: fit.deviation(k) * np.sqrt(slowest))
        return tuple(sorted(named, key=lambda cause: -cause.share))

    kind: Outcome = "unexplained" if any(one.kind == "unexplained" for one in each) else "nothing"
    if best.chosen:
        kind = "ambiguous" if posterior.alternatives else "explained"
    return Explanation(
        kind,
        causes(best),
        _explained(best, left),
        tuple(causes(fit) for fit in posterior.alternatives),
        "",
        tuple(n for n in each[0].unseen if all(n in one.unseen for one in each)),
        "samples" if all(one.form == "samples" for one in each) else "steps",
        max(one.residual for one in each),
        max(one.noise for one in each),
        sum(one.samples for one in each),
        tuple(dict.fromkeys(reason for one in each for reason in one.reasons)),
    )


def explanation_of(
    inference: Inference | None,
    run: Trajectory,
    kind: Outcome,
    reasons: tuple[Finding, ...],
    residual: float,
    by_causes: bool,
) -> Explanation:
    """The causes of an inference, if it is explained `by_causes`; `reasons` are findings beside them."""
    if inference is None:
        return Explanation(kind, reasons=reasons)
    block, posterior = inference.blocks[0], inference.posterior
    explanation = Explanation(
        kind,
        unseen=_unseen(inference),
        form="samples" if inference.measured else "steps",
        residual=residual,
        noise=float(inference.relative[1].max()),
        samples=len(block.r),
        reasons=reasons,
    )
    if not by_causes:
        return explanation
    built = any(c.edit is not None for c in posterior.best.chosen)
    return replace(
        explanation,
        causes=causes_of(inference, posterior.best),
        explained=_explained(posterior.best, block.projected.left),
        alternatives=tuple(causes_of(inference, fit) for fit in posterior.alternatives),
        separating="" if built or not posterior.alternatives else advice(run, inference),
    )


def causes_of(inference: Inference, fit: Fit) -> tuple[Cause, ...]:
    """The causes of a set, those through which most energy flows first."""
    slowest = np.sqrt(inference.tau)
    residual = inference.blocks[0].projected.left
    causes = _causes(inference.model.mechanism, fit, residual, lambda k: fit.deviation(k) * slowest)
    if fit is inference.posterior.best:
        energies = zip(causes, inference.energy, inference.exchanged)
        causes = [replace(c, energy=float(e), exchanged=float(x)) for c, e, x in energies]
    return tuple(sorted(causes, key=lambda cause: -cause.exchanged))


def _explained(fit: Fit, unexplained: Callable[[Array], float]) -> float:
    """The share of the sum of squares that the causes of a set explain; `unexplained`: the rest."""
    return 1.0 - unexplained(fit.coefficients) / unexplained(
        nothing(len(fit.coefficients)).coefficients
    )


def _causes(
    mechanism: Mechanism,
    fit: Fit,
    residual: Callable[[Array], float],
    errors: Callable[[int], Array],
) -> list[Cause]:
    """The causes of a set: numbers, their standard errors, shares of the residual, and odds."""
    causes = []
    total = residual(nothing(len(fit.coefficients)).coefficients)
    for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta, strict=True)):
        others = fit.coefficients.copy()
        np.subtract.at(others, list(c.columns), fit.of(k))
        share, error = (residual(others) - residual(fit.coefficients)) / total, errors(k)
        causes.append(
            Cause(
                c.kind,
                c.element,
                tuple(map(float, c.base + theta)),
                tuple(map(float, error)),
                c.names,
                c.units,
                tuple(map(float, c.base)),
                float(np.clip(share, 0.0, 1.0)),
                sentence(mechanism, c, theta, error),
                fit.each[k] if k < len(fit.each) else fit.log_odds,
            )
        )
    return causes


def _unseen(inference: Inference) -> tuple[str, ...]:
    """Bodies and channels of which a change by a third would not stand out."""
    words = {"body-mass": "mass of ", "body-moments": "inertia of "}
    return tuple(
        f"{words.get(c.kind, '')}{c.element}"
        for c in inference.candidates
        if c.kind in ("body-mass", "body-moments", "actuator-gear", "channel-factor")
        and inference.deviation(c) > UNSEEN
    )


def with_gears(explanation: Explanation, gears: list[Gear]) -> Explanation:
    """Also the motors whose strengths differ: their logged forces close the equations all the same."""
    sets = (explanation.causes, *explanation.alternatives)
    named = {(c.kind, c.element) for causes in sets for c in causes}
    also = tuple(
        Cause(
            "actuator-gear", gear.channel, (gear.factor,), (0.0,), ("factor",), ("1",), (1.0,), 0.0,
            str(gear),
        )
        for gear in gears
        if gear.factor and ("actuator-gear", gear.channel) not in named
    )  # fmt: skip
    if not also or explanation.kind in ("unexplained", "doubtful"):
        return explanation
    first = not explanation.causes
    return replace(
        explanation,
        kind="explained" if first else explanation.kind,
        causes=(*explanation.causes, *also),
        explained=1.0 if first else explanation.explained,
        alternatives=tuple((*other, *also) for other in explanation.alternatives),
        reasons=tuple(f for f in explanation.reasons if f.kind != "actuator-gear"),
    )


# --- which further motion would tell causes apart that a log does not: computed, not guessed -----


Samples: TypeAlias = tuple[Array, ...]
"""t, free q, u and u̇, logged forces, at `TRIAL_STATES` states."""


def advice(run: Trajectory, inference: Inference) -> str:
    """A sentence: the simplest motion in which the causes differ, or that there is none."""
    fits = [inference.posterior.best, *inference.posterior.alternatives]
    most, motion = 0, ""
    for name, samples in _experiments(run, inference):
        first, *others = _effects(inference, samples, fits)
        distinguished = sum(_difference(first, other) > NEGLIGIBLE for other in others)
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
    """What each fit adds to the equations at the samples, to first order, scaled equation by equation."""
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
        for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta, strict=True)):
            columns = np.array(c.columns)
            linear = columns < X.shape[2]  # those beyond are bends of causes that are built in
            effect = X[..., columns[linear]] @ fit.of(k)[linear]
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
    speed = max(max_norm(run.u), 1.0)
    bent = max(speed**2, 10.0)
    nu, logged = len(free.u), inference.model.log.size

    def states(q: Array, u: Array, udot: Array, forces: float) -> Samples:
        t = np.full(TRIAL_STATES, float(run.t[0]))
        return t, q, u, udot, forces * rng.standard_normal((TRIAL_STATES, logged))

    anywhere = any_coordinates(mechanism, 1.0, rng, TRIAL_STATES).T
    pose = np.repeat(run.q[:1, free.q], TRIAL_STATES, axis=0)
    still = np.zeros((TRIAL_STATES, nu))
    fast, hard = (
        speed * rng.standard_normal((TRIAL_STATES, nu)),
        bent * rng.standard_normal((TRIAL_STATES, nu)),
    )
    force = max((max_norm(f) for f in run.forces.values()), default=0.0) or 1.0
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
