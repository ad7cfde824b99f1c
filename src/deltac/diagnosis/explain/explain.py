"""`explain_residual`: the few causes that explain what a model leaves of a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress, counted, untold
from deltac.diagnosis.causes.causes import Candidate
from deltac.diagnosis.explain.result import Cause, Explanation, Kind, sentence
from deltac.diagnosis.explain.separation import advice
from deltac.diagnosis.inference.hypotheses import CERTAIN, Fit, nothing
from deltac.diagnosis.inference.inference import Inference, infer
from deltac.diagnosis.inference.joint import joint_posterior
from deltac.diagnosis.inputs.channels import Gear, foreign_channels, foreign_words, other_gears
from deltac.diagnosis.inputs.logs import LogLike, in_model_order, read_run
from deltac.errors import LogError, ModelError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, chosen_map, load_model
from deltac.trajectories import Trajectory
from deltac.trajectories.formats.mapping import MappingLike

PASSIVE = ("spring", "damper")
"""Kinds of which the model's own forces are tested, where it is asked to explain a run by itself."""

MOST = 0.9
"""Share of what is left that terms of a model must explain for there to be something."""

UNSEEN = 0.3
"""Standard error of a factor from which on a log is said not to show it."""


@checked
@interruptible()
def explain_residual(
    model: ModelLike,
    log: LogLike | list[LogLike],
    *,
    mapping: MappingLike = None,
    coordinates: CoordinateMap | str | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Find the few changes of a model that explain the residual of its equations along a log.

    Springs and dampers are taken from the model, also where the log holds them, so that what model
    and run have differently is found; all other logged forces are taken as they are, and channels among
    them that the model does not have are noted. Motors of which a recorded run tells another strength
    than the model's are causes too, although their logged forces close the equations. Causes are those of
    the posterior of `audit`: by measured accelerations where these are known to be those of the rows, else by
    how each row follows from the one before.

    Several logs of one machine share its causes, each with an integrator and noise of its own: what none of
    them shows alone may be certain from all.

    Args:
        model: as for `audit`.
        log: as for `audit`; or a list of several.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        coordinates: those of the log's columns, as for `audit`.
        progress: called with the fraction done.

    Returns:
        The explanation; `str()` of it is the outcome in words, `table()` the numbers.

    Raises:
        InputError: model or log cannot be read, the log is not of this model, or it is too short.
    """
    loaded = load_model(model)
    mechanism = loaded.mechanism
    chosen = None if coordinates is None else chosen_map(loaded, coordinates)
    if not len(mechanism.free.u):
        raise ModelError(
            "every joint of the model is prescribed: no equation of motion is left to explain"
        )
    logs = log if isinstance(log, list) else [log]
    if not logs:
        raise LogError("the list of logs is empty; give one log, or several of the same machine")
    ignored = " ".join(map(str, loaded.import_report.ignored)) if loaded.import_report else ""
    runs, inferences = list[Trajectory](), list[Inference]()
    for one in counted(logs, progress or untold):
        run, _ = in_model_order(mechanism, read_run(mechanism, one, mapping, chosen))
        own = [n for n in run.forces if n.kind in PASSIVE and f"'{n}'" not in ignored]
        run = replace(run, forces={n: f for n, f in run.forces.items() if n not in own})
        inference = infer(mechanism, run)
        if inference is None:
            raise LogError(
                f"the log has {len(run)} rows, or the model's motion leaves all bounds between them: too "
                "few follow each other to explain anything. Log more of the motion, or a smaller step"
            )
        runs.append(run)
        inferences.append(inference)
    if len(logs) == 1:
        explanation = explanation_of(inferences[0], runs[0])
    else:
        explanation = joint_explanation(inferences, runs)
    gears: dict[str, Gear] = {}
    notes: dict[str, None] = {}
    for run in runs:
        gears |= {gear.channel: gear for gear in other_gears(run, loaded.import_report)}
        works = foreign_channels(mechanism, run, loaded.import_report)
        notes |= dict.fromkeys(words for _, words in foreign_words(works))
    return replace(_with_gears(explanation, list(gears.values())), notes=tuple(notes))


def joint_explanation(inferences: Sequence[Inference], runs: Sequence[Trajectory]) -> Explanation:
    """The causes that several logs of one machine have together, in words."""
    joint = joint_posterior(inferences)
    best, mechanism = joint.posterior.best, inferences[0].model.mechanism
    total = joint.left(np.zeros(len(best.coefficients)))

    def causes(fit: Fit) -> tuple[Cause, ...]:
        """Those of a set, the largest share first."""
        named = []
        for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta, strict=True)):
            others = fit.coefficients.copy()
            np.subtract.at(others, list(c.columns), c.coefficients(theta))
            share = (joint.left(others) - joint.left(fit.coefficients)) / total
            odds = fit.each[k] if k < len(fit.each) else fit.log_odds
            named.append(_cause(mechanism, c, theta, joint.deviation(fit, k), share, odds))
        return tuple(sorted(named, key=lambda cause: -cause.share))

    each = [explanation_of(*pair) for pair in zip(inferences, runs, strict=True)]
    kind: Kind = "unexplained" if any(one.kind == "unexplained" for one in each) else "nothing"
    if best.chosen:
        kind = "ambiguous" if joint.posterior.alternatives else "explained"
    return Explanation(
        kind,
        causes(best),
        1.0 - joint.left(best.coefficients) / total if best.chosen else 0.0,
        tuple(causes(fit) for fit in joint.posterior.alternatives),
        "",
        tuple(n for n in each[0].unseen if all(n in one.unseen for one in each)),
        "samples" if all(one.form == "samples" for one in each) else "steps",
        max(one.residual for one in each),
        max(one.noise for one in each),
        sum(one.samples for one in each),
    )


def explanation_of(inference: Inference, run: Trajectory) -> Explanation:
    """The causes of an inference, in words."""
    posterior, generic = inference.posterior, inference.generic
    best = posterior.best
    kind: Kind = "nothing"
    if best.chosen:
        kind = "ambiguous" if posterior.alternatives else "explained"
    elif inference.intermittent[0] > CERTAIN or (
        generic.log_odds > CERTAIN and generic.explained > MOST
    ):
        kind = "unexplained"
    block = inference.blocks[0]
    total = block.projected.left(nothing(len(block.causes)).coefficients)
    error, noise = inference.relative
    return Explanation(
        kind,
        causes_of(inference, best),
        1.0 - block.projected.left(best.coefficients) / total if best.chosen else 0.0,
        tuple(causes_of(inference, fit) for fit in posterior.alternatives),
        advice(run, inference) if posterior.alternatives else "",
        _unseen(inference),
        "steps" if len(block.nuisance) or inference.methods else "samples",
        float(error.max()),
        float(noise.max()),
        len(block.r),
    )


def causes_of(inference: Inference, fit: Fit) -> tuple[Cause, ...]:
    """The causes of a set, those through which most energy flows first."""
    block, best = inference.blocks[0], fit is inference.posterior.best
    left = block.projected.left
    total = left(nothing(len(block.causes)).coefficients)
    causes = []
    for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta, strict=True)):
        others = fit.coefficients.copy()
        np.subtract.at(others, list(c.columns), c.coefficients(theta))
        share = (left(others) - left(fit.coefficients)) / total
        odds = fit.each[k] if k < len(fit.each) else fit.log_odds
        errors = fit.deviation(k) * np.sqrt(inference.tau)
        cause = _cause(inference.model.mechanism, c, theta, errors, share, odds)
        if best:
            energies = float(inference.energy[k]), float(inference.exchanged[k])
            cause = replace(cause, energy=energies[0], exchanged=energies[1])
        causes.append(cause)
    return tuple(sorted(causes, key=lambda cause: -cause.exchanged))


def _cause(
    mechanism: Mechanism, c: Candidate, theta: Array, errors: Array, share: float, odds: float
) -> Cause:
    """A cause with its numbers and their errors, its share of the squared residual and its log odds."""
    return Cause(
        c.kind,
        c.element,
        tuple(map(float, c.base + theta)),
        tuple(map(float, errors)),
        c.names,
        c.units,
        tuple(map(float, c.base)),
        float(np.clip(share, 0.0, 1.0)),
        sentence(mechanism, c, theta, errors),
        odds,
    )


def _unseen(inference: Inference) -> tuple[str, ...]:
    """Bodies and channels of which a change by a third would not stand out."""
    words = {"body-mass": "mass of ", "body-moments": "inertia of "}
    return tuple(
        f"{words.get(c.kind, '')}{c.element}"
        for c in inference.candidates
        if c.kind in ("body-mass", "body-moments", "actuator-gear", "channel-factor")
        and inference.deviation(c) > UNSEEN
    )


def _with_gears(explanation: Explanation, gears: list[Gear]) -> Explanation:
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
    if not also or explanation.kind == "unexplained":
        return explanation
    first = explanation.kind == "nothing"
    return replace(
        explanation,
        kind="explained" if first else explanation.kind,
        causes=(*explanation.causes, *also),
        explained=1.0 if first else explanation.explained,
        alternatives=tuple((*other, *also) for other in explanation.alternatives),
    )
