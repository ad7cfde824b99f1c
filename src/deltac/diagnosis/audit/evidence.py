"""What the columns of a log say of the equations: the evidence beyond energy.

Two tests speak of the equations. The one-step test rests on states and forces alone; the equations at the
samples on measured accelerations, which are believed as far as the speeds bear them out. A log whose rows
follow from each other by a known integrator has right equations, whatever else its columns seem to say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from deltac.calls.progress import Deadline, Progress, untold
from deltac.diagnosis.audit import conventions, samples, steps
from deltac.diagnosis.audit.corrections import corrected
from deltac.diagnosis.audit.reading import Known, Reference
from deltac.diagnosis.inputs.logs import Log
from deltac.diagnosis.residuals.at_samples import EquationTerms
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.verdict import Finding

OF_THE_LOG = ("actuator-delay", "late-rows", "zero-offset")
"""Causes that leave the equations as they are."""

CONVENTIONS = 10.0
"""Seconds that conventions may take beside the search: a log misread accuses nobody however long that takes.
"""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the columns of a log say of the equations.

    log       as it is judged: forces that were one row late are put right
    terms     the equations at the samples, where measured accelerations are believed
    step      the one-step test, where it was made
    findings  of both
    """

    log: Log
    terms: EquationTerms | None = None
    step: OneStep | None = None
    findings: tuple[Finding, ...] = ()


def gather(
    reference: Reference,
    known: Known,
    step: OneStep | None,
    *,
    deadline: Deadline,
    progress: Progress = untold,
) -> Evidence:
    """All evidence on the equations; `step` is the first one-step test of the log, see `first_tests`.

    A log that is doubted explains nothing: its residual is shown, and no cause is sought. `progress` is told
    how far the search for causes has come; it ends with what it has when the `deadline` has passed.
    """
    mechanism, log = reference.mechanism, known.log
    if not len(mechanism.free.u):
        return Evidence(log)
    foreign = step is not None and not step.closes and log.consecutive is log.run
    if foreign and (other := conventions.units(mechanism, log.run)):
        return Evidence(log, findings=(other,))
    log, step, found = corrected(reference, log, step)
    if known.between and not known.given:
        found.append(INTERPOLATED)
    terms = None
    if known.measured:
        terms, doubts = samples.believed(reference, known, log, step)
        found += doubts
    if terms is not None:
        told = samples.at_samples(
            reference, log, terms, doubted=known.doubted, deadline=deadline, progress=progress
        )
        if any(f.kind == "forces-not-of-this-row" for f in told):
            terms = None
        found += told
    elif log.run.forces and not known.doubted:
        without = samples.unaccelerated_terms(mechanism, log.run)
        found += samples.differing_channels(reference, log, without)
    if step is not None and not any(f.weight == "cause" for f in found):
        step, more = steps.causes_by_steps(reference, log, step, deadline, progress)
        again = {("not-reproducible", ""), *((f.kind, f.element) for f in more)}
        found = [f for f in found if (f.kind, f.element) not in again] + more
    if foreign:
        found = _or_conventions(reference, log, found, deadline.beside(CONVENTIONS))
    return Evidence(log, terms, step, (*_of_the_log(found), *_left_out(deadline)))


def _or_conventions(
    reference: Reference, log: Log, found: list[Finding], deadline: Deadline
) -> list[Finding]:
    """The findings, with a convention in which log and model differ, where that explains as much.

    It has no number that was fitted, so that it comes before several causes; beside a single one it is told
    as its equal.
    """
    mechanism, run = reference.mechanism, log.run
    causes = [f for f in found if f.weight == "cause"]
    other = conventions.orders_and_signs(mechanism, run, deadline)
    if other is None:
        axis = None if causes else conventions.axes(mechanism, run, deadline)
        return found if axis is None else [axis, *found]
    if len(causes) != 1 or causes[0].kind == "missing-contact":
        return [other, *(replace(f, weight="note") if f in causes else f for f in found)]
    (cause,) = causes
    equals = (*cause.equals, (other.kind, other.element), *other.equals)
    first = cause.what if cause.equals else f"one of these: {cause.what}"
    told = replace(cause, what=f"{first}; or {other.what}", equals=equals)
    return [told if f is cause else f for f in found]


def _of_the_log(found: list[Finding]) -> list[Finding]:
    """Findings of which causes in the log are doubts of it.

    Where one of these comes first, it explains the most. What else would explain the rest is of a log
    that is not yet right, and accuses nothing.
    """
    causes = [f for f in found if f.weight == "cause"]
    if not causes or causes[0].kind not in OF_THE_LOG:
        return found
    return [
        replace(f, weight="doubt" if f.kind in OF_THE_LOG else "note") if f in causes else f
        for f in found
    ]


def _left_out(deadline: Deadline) -> list[Finding]:
    """What was not looked at, since time was up."""
    if not deadline.left_out:
        return []
    return [
        Finding(
            "search-ended",
            "the search for causes ended when its time was up",
            f"not tried: {'; '.join(deadline.left_out)}",
            "The causes named are those found until then. A shorter log, or a part of the model, is searched "
            "faster; `deltac audit --explain` searches without end",
        )
    ]


INTERPOLATED = Finding(
    "interpolated-rows",
    "the rows lie between the solver's steps, on its interpolant, and satisfy the equations only "
    "approximately",
    "equally spaced times from a solver with adaptive steps",
    "Leave t_eval out or set dense_output=True, so that the solver's own steps are tested; or pass the "
    "equations: Trajectory.from_scipy(result, model, equations=f)",
)
