"""`explain_residual`: the few causes that explain what a model leaves of a log."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Deadline, Progress, untold
from deltac.diagnosis.explain.regression import (
    Fit,
    Prepared,
    Regression,
    prepare,
    too_short,
)
from deltac.diagnosis.explain.result import Cause, Explanation, Kind, sentence
from deltac.diagnosis.explain.search import MOST, Found, plausible, search
from deltac.diagnosis.explain.separation import advice
from deltac.diagnosis.explain.turned import turned
from deltac.diagnosis.inputs.channels import Gear, foreign_channels, foreign_words, other_gears
from deltac.diagnosis.inputs.logs import in_model_order
from deltac.diagnosis.measurements.kinematics import accelerations, trusted
from deltac.diagnosis.residuals.defect import Residual
from deltac.diagnosis.residuals.one_step import one_step
from deltac.errors import ArgumentsError, ModelError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

EXPLAINS = 0.95
"""Share of what is no noise that causes must explain of the squared residual to be named."""

ROUGHLY, NEARER = 0.3, 0.5
"""Share that a stop may leave whose place is not yet known, and of that what it must at a better place."""

WITH_A_STOP = 3
"""Causes together with a stop at its exact place."""

CLEAR = 4.0
"""A residual whose squares are so many times those of noise and rounding is there."""

NOISE = 1.2
"""What is left counts as noise up to so many times its estimate."""

PASSIVE = ("spring", "damper")
"""Kinds of which the model's own forces are tested, where it is asked to explain a run by itself."""

UNSEEN = 0.3
"""Standard error of a factor from which on a log is said not to show it."""


@checked
@interruptible()
def explain_residual(
    model: Any, log: Any, *, mapping: Any = None, progress: Progress | None = None
) -> Explanation:
    """Find the few changes of a model that explain the residual of its equations along a log.

    Springs and dampers are taken from the model, also where the log holds them, so that what model
    and run have differently is found; all other logged forces are taken as they are, and channels among
    them that the model does not have are noted. Motors of which a recorded run tells another strength
    than the model's are causes too, although their logged forces close the equations. Without measured
    accelerations each row is compared with what the equations make of the one before, as in the one-step
    test of `audit`.

    Args:
        model: as for `audit`.
        log: a Trajectory, or the path of a log.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        progress: called with the fraction done.

    Returns:
        The explanation; `str()` of it is the outcome in words, `table()` the numbers.

    Raises:
        InputError: model or log cannot be read, the log is not of this model, or it is too short.
    """
    from deltac.models import load_model
    from deltac.trajectories import read_trajectory

    loaded = load_model(model)
    mechanism = loaded.mechanism
    if not isinstance(log, Trajectory):
        log = read_trajectory(log, mapping, mechanism)
    elif mapping is not None:
        raise ArgumentsError("mapping= is for log files; this log is a Trajectory already")
    run, _ = in_model_order(mechanism, log)
    if not len(mechanism.free.u):
        raise ModelError(
            "every joint of the model is prescribed: no equation of motion is left to explain"
        )
    told = " ".join(str(r) for r in loaded.import_report.ignored) if loaded.import_report else ""
    own = [n for n in run.forces if n.kind in PASSIVE and f"'{n}'" not in told]
    run = replace(run, forces={n: f for n, f in run.forces.items() if n not in own})
    derived = "udot" in run.provenance.derived
    known = run.udot is not None and not derived
    if known and (trusted(run) or not accelerations(run).difference):
        found = explanation(mechanism, run, progress=progress or untold)
    else:
        step = one_step(mechanism, run)
        if step is None:
            raise too_short(run)
        found = explanation(mechanism, run, step.residual, progress=progress or untold)
    works = foreign_channels(mechanism, run, loaded.import_report)
    notes = tuple(words for _, words in foreign_words(works))
    return replace(_with_gears(found, other_gears(run, loaded.import_report)), notes=notes)


def _with_gears(found: Explanation, gears: list[Gear]) -> Explanation:
    """Also the motors whose strengths differ: their logged forces close the equations all the same."""
    named = {(c.kind, c.element) for other in (found.causes, *found.alternatives) for c in other}
    also = tuple(
        Cause(
            "actuator-gear", gear.channel, (gear.factor,), (0.0,), ("factor",), ("1",), (1.0,), 0.0,
            str(gear),
        )
        for gear in gears
        if gear.factor and ("actuator-gear", gear.channel) not in named
    )  # fmt: skip
    if not also or found.kind == "unexplained":
        return found
    return replace(
        found,
        kind="explained" if found.kind == "nothing" else found.kind,
        causes=(*found.causes, *also),
        explained=1.0 if found.kind == "nothing" else found.explained,
        alternatives=tuple((*other, *also) for other in found.alternatives),
    )


def explanation(
    mechanism: Mechanism,
    run: Trajectory,
    left: Residual | None = None,
    least: float = EXPLAINS,
    *,
    most: int = MOST,
    sliding: bool = False,
    deadline: Deadline | None = None,
    progress: Progress = untold,
) -> Explanation:
    """The explanation of a run whose columns are in the mechanism's order, with its forces as logged.

    The residual is that at the samples, or what is `left` from row to row. `least` is the share of its square
    that causes must explain, `most` their number. `sliding` leaves out what joints do that hardly move: dry
    friction has no law there. It is tried where nothing else fits. The search ends with what it has when the
    `deadline` has passed, and notes there what it left out.
    """
    deadline = deadline or Deadline()
    prepared = prepare(mechanism, run, left, sliding=sliding)
    regression = prepared.regression

    floor = regression.floor(regression.nothing)
    if regression.total <= (floor if left is not None else regression.precision):
        return _made(prepared, "nothing")
    found = search(regression, most, deadline, progress)
    explained = _explained(prepared, found.best)
    if most > 1 and regression.total <= CLEAR * floor and not regression.stands_out(found.best):
        found = search(regression, 1)
        explained = _explained(prepared, found.best)
        if not regression.stands_out(found.best):
            return _made(prepared, "nothing")
    unclosed = regression.left(found.best) > CLEAR * regression.floor(found.best)
    if not prepared.sliding and unclosed and not deadline.passed("joints that stick at times"):
        slid = explanation(mechanism, run, left, least, most=most, sliding=True, deadline=deadline)
        if (
            any("friction" in f"{c.kind} {c.element}" for c in slid.causes)
            and slid.explained > explained
        ):
            return slid
    if unclosed and not prepared.sliding and not deadline.passed("a stop at its exact place"):
        stopped = _at_its_place(mechanism, run, prepared, left, deadline)
        if stopped is not None:
            there = search(stopped.regression, min(most, WITH_A_STOP), deadline)
            share = _explained(stopped, there.best)
            if share > explained and share >= _enough(stopped.regression, there.best, least):
                return told(stopped, there, run, deadline)
    if explained < _enough(regression, found.best, least):  # then one cause, if it says nearly all
        found = search(regression, 1)
        explained = _explained(prepared, found.best)
    if not found.best.chosen or explained < _enough(regression, found.best, least):
        return _made(prepared, "unexplained", Found(found.best, ()), explained)
    return told(prepared, found, run, deadline)


def _at_its_place(
    mechanism: Mechanism,
    run: Trajectory,
    prepared: Prepared,
    left_over: Residual | None,
    deadline: Deadline,
) -> Prepared | None:
    """The regression with a stop at the place where it leaves least; None where no stop explains most."""
    better, left = None, ROUGHLY * prepared.regression.total
    while not deadline.passed():
        regression = (better or prepared).regression
        stops = (regression.fit((k,)) for k, c in enumerate(regression.candidates) if c.stop)
        fits = [fit for fit in stops if fit.left < left and plausible(regression, fit)]
        if not fits:
            break
        best = min(fits, key=lambda fit: fit.left)
        stop = regression.candidates[best.chosen[0]].stop
        assert stop is not None
        place, low, high = stop
        around = (low - (high - low), high + (high - low))
        better = prepare(mechanism, run, left_over, stops_in={place: around})
        left = NEARER * best.left
    return better


def told(
    prepared: Prepared, found: Found, run: Trajectory, deadline: Deadline | None = None
) -> Explanation:
    """The explanation by causes that were found."""
    kind: Kind = "ambiguous" if found.alternatives else "explained"
    separating = advice(run, prepared, found, deadline or Deadline()) if found.alternatives else ""
    explained = _explained(prepared, found.best)
    return turned(prepared.mechanism, _made(prepared, kind, found, explained, separating))


def _made(
    prepared: Prepared,
    kind: Kind,
    found: Found | None = None,
    explained: float = 0.0,
    separating: str = "",
) -> Explanation:
    relative = float(np.max(prepared.residual / np.maximum(prepared.scale, 1e-300), initial=0.0))
    noise = float(np.max(prepared.noise / np.maximum(prepared.scale, 1e-300), initial=0.0))
    effect, work = prepared.effect(found.best) if found else (np.zeros_like(prepared.scale), 0.0)
    return Explanation(
        kind,
        _causes(prepared, found.best) if found else (),
        explained,
        tuple(_causes(prepared, f) for f in found.alternatives) if found else (),
        separating,
        _unseen(prepared),
        prepared.form,
        relative,
        noise,
        prepared.samples,
        0.0 if kind == "nothing" else prepared.regression.predicted,
        tuple((effect / np.maximum(prepared.scale, 1e-300)).tolist()),
        work,
    )


def _enough(regression: Regression, fit: Fit, least: float) -> float:
    """The share that causes must explain: with each number more, what is left must be a tenth."""
    numbers = sum(regression.candidates[k].size for k in fit.chosen)
    return float(1.0 - (1.0 - least) * 10.0 ** -min(max(numbers - 1, 0), 5))


def _explained(prepared: Prepared, fit: Fit) -> float:
    """Share of the squared residual beyond noise that a fit explains."""
    regression = prepared.regression
    # What an integrator may leave is no noise: a cause must explain all that it says it does.
    of_noise = regression.noise if prepared.form == "steps" else regression.floor
    if fit.left <= NOISE * of_noise(fit):
        return 1.0
    there = max(regression.total - regression.noise(regression.nothing), 1e-300)
    left = max(fit.left - regression.noise(fit), 0.0)
    return float(np.clip(1.0 - left / there, 0.0, 1.0))


def _causes(prepared: Prepared, fit: Fit) -> tuple[Cause, ...]:
    regression = prepared.regression
    if not fit.chosen:
        return ()
    errors = np.sqrt(np.maximum(np.diag(regression.covariance(fit)), 0.0))
    found, start = [], 0
    for n, (k, theta) in enumerate(zip(fit.chosen, fit.theta)):
        c = regression.candidates[k]
        error = errors[start : start + c.size]
        start += c.size
        others = [j for m, j in enumerate(fit.chosen) if m != n]
        without = regression.fit(others).left if others else regression.total
        share = (without - fit.left) / regression.total
        found.append(
            Cause(
                c.kind,
                c.element,
                tuple(float(x) for x in c.base + theta),
                tuple(float(x) for x in error),
                c.names,
                c.units,
                tuple(float(x) for x in c.base),
                float(min(share, 1.0)),
                sentence(prepared.mechanism, c, theta, error),
            )
        )
    held = [c for c in found if c.kind == "actuator-delay" and abs(c.values[0]) <= prepared.spacing]
    kept = [c for c in found if c not in held] or found  # a force held over a step is no fault
    return tuple(sorted(kept, key=lambda cause: -cause.share))


def _unseen(prepared: Prepared) -> tuple[str, ...]:
    """Bodies and channels of which a change by a third would not stand out."""
    regression = prepared.regression
    sizes = regression.sizes
    largest = float(sizes.max(initial=0.0))
    deviation = float(np.sqrt(regression.floor(regression.nothing) / max(1, regression.rows)))
    found = []
    for c, size in zip(regression.candidates, sizes):
        if c.kind in ("body-mass", "body-moments", "actuator-gear", "channel-factor") and (
            size <= 1e-9 * largest or deviation > UNSEEN * size
        ):
            what = {"body-mass": "mass of ", "body-moments": "inertia of "}.get(c.kind, "")
            found.append(f"{what}{c.element}")
    return tuple(found)
