"""The one-step test of a log, and the causes of what it leaves: local in time first, then all along it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deltac.calls.progress import Deadline, Parts, Progress, untold
from deltac.diagnosis.audit.corrections import lateness
from deltac.diagnosis.audit.reading import Known, Reference
from deltac.diagnosis.audit.samples import (
    FIRST,
    MISSING_NOW_AND_THEN,
    not_reproducible,
    upward_push,
)
from deltac.diagnosis.explain.by_integrator import known_but_for_one
from deltac.diagnosis.explain.causes import PREFERENCE
from deltac.diagnosis.explain.explain import EXPLAINS, explanation
from deltac.diagnosis.explain.regression import LEAST_ROWS
from deltac.diagnosis.explain.result import Explanation
from deltac.diagnosis.explain.search import MOST
from deltac.diagnosis.inputs.logs import Log
from deltac.diagnosis.measurements.digits import LEVELS
from deltac.diagnosis.measurements.kinematics import unsteadiness
from deltac.diagnosis.residuals.one_step import (
    FEWEST,
    LEAST,
    MATERIAL,
    NAMED,
    OneStep,
    one_step,
    one_steps,
)
from deltac.diagnosis.residuals.rows import rms, stairs
from deltac.diagnosis.verdict import Finding, Weight, percent
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism

ALONE, PREDICTED = 0.97, 0.9
"""Shares of what is within ten error bars that one cause must explain, and parts of the log predict."""

SHORT = 0.5
"""Share of the windows up to which a residual is one of now and then."""

MOSTLY, QUIET = 0.6, 0.1
"""Share of the windows that stand out in a part of a log, and of the log where none does."""

NOT_OF_FORCES = 3.0
"""How many times the largest change of a force must be missing beside one of its changes to be none of it."""

SWITCHED = 10.0
"""How many times more than usual a force changes where it is switched."""

TOUCHING = ("contact", "limit", "friction", "impact")
"""Kinds of forces that begin and end between two rows."""

BESIDE = 2.5
"""Steps from a change of a held force within which a window is beside it."""


def first_tests(mechanism: Mechanism, logs: Sequence[Known]) -> list[OneStep | None]:
    """The one-step test of the rows of logs as they are, all at once; None where it is not made."""
    tested = [not (k.doubted or k.given or k.between) for k in logs]
    runs = [
        (k.log.consecutive, lateness(k.log), unsteadiness(k.log.comparisons))
        for k, wanted in zip(logs, tested)
        if wanted
    ]
    made = iter(one_steps(mechanism, runs))
    return [next(made) if wanted else None for wanted in tested]


def causes_by_steps(
    reference: Reference, log: Log, step: OneStep, deadline: Deadline, progress: Progress
) -> tuple[OneStep, list[Finding]]:
    """The test with the causes that are known, and causes of what it leaves."""
    step, found = _causes(reference, log, step, deadline, progress)
    if not any(f.weight == "cause" and f.kind != "missing-contact" for f in found):
        found = _in_a_part(reference, log, step, deadline) or found
    return step, found


def _causes(
    reference: Reference, log: Log, step: OneStep, deadline: Deadline, progress: Progress = untold
) -> tuple[OneStep, list[Finding]]:
    """What is missing now and then; one cause beside a known integrator; several."""
    parts = Parts(progress, {"one cause": 0.5, "several": 0.5})
    if local := _now_and_then(log, step):
        return step, local
    pair = known_but_for_one(
        reference.mechanism,
        log.consecutive,
        step,
        deadline.part(FIRST),
        parts.part("one cause"),
    )
    if pair is not None:
        return pair[0], _weighed(pair[1], pair[0], reference.tolerance)
    return _several(reference, log, step, deadline, parts.part("several"))


def _several(
    reference: Reference, log: Log, step: OneStep, deadline: Deadline, progress: Progress
) -> tuple[OneStep, list[Finding]]:
    """The test, and causes of what it leaves whatever the integrator.

    What one cause explains all along the log is significant from fewer error bars on.
    """
    if step.closes:
        return step, []
    mechanism, told = reference.mechanism, None
    clear = bool(step.significant.any())
    outside = float((rms(step.residual.forces) / step.residual.bar).max())
    enough = (clear or outside > NAMED) and len(log.consecutive) >= LEAST_ROWS
    if enough and not deadline.passed("several causes together"):
        with contextlib.suppress(InputError):
            told = explanation(
                mechanism,
                log.consecutive,
                step.residual,
                EXPLAINS if outside > step.clear else ALONE,
                most=MOST if clear else 1,
                deadline=deadline,
                progress=progress,
            )
    # One cause may do all that is left, and the same all along the log, though that is little.
    if (
        told
        and told.findings
        and (clear or told.predicted >= PREDICTED and max(told.effect) > LEAST)
    ):
        step = _known_by(step, told)
        return step, _weighed(told.findings, step, reference.tolerance)
    local = _at_times(log, step)
    share = float(local.mean()) if len(local) else 0.0
    if local.sum() >= FEWEST and share <= SHORT:
        return step, _missing(step, share)
    if not clear:
        return step, []
    out = step.standing_out
    # A body that rests on something is pushed all the time: by what it falls onto, and never down.
    stands_out = np.where(out[:, None], -step.local.forces, 0.0)  # like F_r + F*_r
    if out.sum() >= FEWEST and upward_push(mechanism, step.speeds, stands_out):
        return step, _missing(step, float(out.mean()))
    return step, not_reproducible(told)


def _known_by(step: OneStep, told: Explanation) -> OneStep:
    """The test with causes that are known: what they make of the equations is what these leave.

    Part of that is like what an integrator leaves, and was taken off with it.
    """
    left = step.residual
    there = replace(left, size=np.array(told.effect) * left.scale, spent=told.work)
    return replace(step, found=lambda: there, clear=step.clear if step.significant.any() else NAMED)


def _in_a_part(reference: Reference, log: Log, step: OneStep, deadline: Deadline) -> list[Finding]:
    """Causes of what begins at some time of a log, or ends there: a load that drops, a motor that fails."""
    if step.closes:  # before its residual is asked for
        return []
    out = np.flatnonzero(step.standing_out)
    if not len(out) or deadline.passed("a cause in a part of the log"):
        return []
    t = step.local.t
    first, last, count = int(out[0]), int(out[-1]), len(t)
    if len(out) < MOSTLY * (last - first + 1) or (last - first + 1) > (1.0 - QUIET) * count:
        return []
    begins, ends = first >= QUIET * count, last < (1.0 - QUIET) * count
    if begins == ends:
        return []
    edge = float(t[first if begins else last])
    run = log.consecutive
    beside = BESIDE * float(np.median(np.diff(run.t)))
    part = run.between(edge + beside, run.t[-1]) if begins else run.between(run.t[0], edge - beside)
    there = one_step(reference.mechanism, part, lateness(log)) if len(part) >= LEAST_ROWS else None
    if there is None or not there.significant.any():
        return []
    _, causes = _causes(reference, replace(log, run=part, consecutive=part), there, deadline)
    when = f"from t = {edge:.4g} s on" if begins else f"until t = {edge:.4g} s"
    rest = "before" if begins else "afterwards"
    return [
        replace(f, what=f"{when}: {f.what}", evidence=f"{f.evidence}; {rest}, the equations hold")
        for f in causes
        if f.kind in PREFERENCE
    ]


def _now_and_then(log: Log, step: OneStep) -> list[Finding]:
    """A force that is missing in a few steps, where a known integrator closes most of the others to rounding.

    Those in which coordinates jump as well are not such.
    """
    if not step.closes_mostly:
        return []
    t, times = log.consecutive.t, step.local.t
    out = times[_at_times(log, step)]
    jumped = np.unique(
        np.concatenate([t[c.start[c.outliers]] for c in log.comparisons.values()] or [t[:0]])
    )
    beside = 2.0 * float(np.median(np.diff(t)))
    near = np.abs(out[:, None] - jumped[None, :]).min(axis=1, initial=np.inf) < beside
    share = len(out) / max(len(times), 1)
    if (~near).sum() < FEWEST or share > SHORT or near.mean() > SHORT:
        return []
    return _missing(step, share)


def _at_times(log: Log, step: OneStep) -> NDArray[np.bool_]:
    """Windows that stand out now and then, but for those beside a change of forces that are held.

    What stands out there may be that force, which the log may hold a few rows early or late; but not if it is
    far more than forces ever change by.
    """
    run, local = log.consecutive, step.now_and_then
    columns = [np.asarray(force).reshape(len(run), -1) for force in run.forces.values()]
    forces = stairs(np.hstack([np.zeros((len(run), 0)), *columns]))
    if forces.held:
        near = BESIDE * float(np.median(np.diff(run.t)))
        changes = run.t[1:][~forces.known]
        away = np.abs(step.local.t[:, None] - changes).min(axis=1) > near
        most = np.abs(np.diff(sum(run.forces.values()), axis=0)).max(axis=0)
        speeds = [run.speeds.index(name) for name in step.speeds]
        far = np.abs(step.local.forces) > NOT_OF_FORCES * most[speeds]
        local = local & (away | np.any(far, axis=1))
    if not run.forces or not local.any():
        return local
    # Within a step a contact may begin, end, or slip the other way, and a motor may be switched.
    speeds = [run.speeds.index(name) for name in step.speeds]
    touching = (np.abs(f) for name, f in run.forces.items() if name.kind in TOUCHING)
    acting = sum(touching, start=np.zeros_like(run.u))[:, speeds]
    total = sum(run.forces.values(), start=np.zeros_like(run.u))[:, speeds]
    changes = np.abs(np.diff(total, axis=0, prepend=total[:1]))
    switched = np.where(changes > SWITCHED * np.median(changes, axis=0), changes, 0.0)
    of_few = [len(np.unique(column)) <= LEVELS for column in total.T]  # on and off, at any time
    switched = np.where(of_few, np.ptp(total, axis=0), switched)
    at = np.clip(np.searchsorted(run.t, step.local.t), 1, len(run) - 1)
    nearby = np.clip(at[:, None] + np.arange(-2, 2), 0, len(run) - 1)
    most = np.maximum(acting, switched)[nearby].max(axis=1)
    left = np.abs(step.local.forces)
    share = left / np.maximum(step.residual.scale, 1e-300)
    far = left > NOT_OF_FORCES * most + step.local.allowed
    far &= share > MATERIAL * share.max(
        axis=1, keepdims=True
    )  # and no trace of it in another equation
    return np.asarray(local & np.any(far, axis=1))


def _weighed(causes: Iterable[Finding], step: OneStep, tolerance: float) -> list[Finding]:
    """Causes of a mistake below the tolerance, which is real but small, are told as notes."""
    weight: Weight = "cause" if beyond(step, tolerance) else "note"
    return [replace(f, weight=weight) for f in causes]


def beyond(step: OneStep, tolerance: float) -> bool:
    """Whether what the one-step test leaves of an equation is more than the tolerance allows."""
    return bool(
        step.significant.any() and step.residual.relative[step.significant].max() > tolerance
    )


def _missing(step: OneStep, share: float) -> list[Finding]:
    active, left = step.standing_out, step.local
    worst = np.abs(left.forces[active]).max(axis=0)
    k = int(np.argmax(worst / np.maximum(step.residual.scale, 1e-300)))
    when = ", ".join(f"{t:.4g}" for t in left.t[active][:3])
    return [
        Finding(
            "missing-contact",
            MISSING_NOW_AND_THEN,
            f"in {percent(share)} of the steps the next row does not follow from the previous one (near t = "
            f"{when} s): up to {worst[k]:.3g} at {step.speeds[k]!r} are missing",
            "Log the forces of all contacts and limits",
            "cause",
            step.speeds[k],
        )
    ]
