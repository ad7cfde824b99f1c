"""`explain_residual`: the few causes that explain what a model leaves of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis.explain.result import Cause, Explanation, Kind, sentence
from deltac.diagnosis.explain.separation import advice
from deltac.diagnosis.inference.hypotheses import CERTAIN, Fit, nothing
from deltac.diagnosis.inference.inference import Inference, infer
from deltac.diagnosis.inputs.channels import Gear, foreign_channels, foreign_words, other_gears
from deltac.diagnosis.inputs.logs import LogLike, in_model_order, read_run
from deltac.errors import LogError, ModelError
from deltac.mechanism.coordinate_map import CoordinateMap
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
    log: LogLike,
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

    Args:
        model: as for `audit`.
        log: as for `audit`.
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
    run, _ = in_model_order(mechanism, read_run(mechanism, log, mapping, chosen))
    if not len(mechanism.free.u):
        raise ModelError(
            "every joint of the model is prescribed: no equation of motion is left to explain"
        )
    ignored = " ".join(map(str, loaded.import_report.ignored)) if loaded.import_report else ""
    own = [n for n in run.forces if n.kind in PASSIVE and f"'{n}'" not in ignored]
    run = replace(run, forces={n: f for n, f in run.forces.items() if n not in own})
    inference = infer(mechanism, run)
    if progress is not None:
        progress(1.0)
    if inference is None:
        raise LogError(
            f"the log has {len(run)} rows, or the model's motion leaves all bounds between them: too few "
            "follow each other to explain anything. Log more of the motion, or a smaller step"
        )
    found = explanation_of(inference, run)
    works = foreign_channels(mechanism, run, loaded.import_report)
    notes = tuple(words for _, words in foreign_words(works))
    return replace(_with_gears(found, other_gears(run, loaded.import_report)), notes=notes)


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
        errors = fit.deviation(k) * np.sqrt(inference.tau)
        causes.append(
            Cause(
                c.kind,
                c.element,
                tuple(map(float, c.base + theta)),
                tuple(map(float, errors)),
                c.names,
                c.units,
                tuple(map(float, c.base)),
                float(np.clip((left(others) - left(fit.coefficients)) / total, 0.0, 1.0)),
                sentence(inference.model.mechanism, c, theta, errors),
                fit.each[k] if k < len(fit.each) else fit.log_odds,
                float(inference.energy[k]) if best else 0.0,
                float(inference.exchanged[k]) if best else 0.0,
            )
        )
    return tuple(sorted(causes, key=lambda cause: -cause.exchanged))


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
