"""From facts to a verdict: a table of rules, of which the first that applies decides.

A log that was misread, or in which nothing moves, cannot be judged. Then the equations are asked, by the
one-step test and at the samples, and last ΔC, against tolerance and error bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from deltac.diagnosis.audit import sentences as say
from deltac.diagnosis.audit.facts import Facts, of_model
from deltac.diagnosis.audit.measures import BEYOND
from deltac.diagnosis.residuals.one_step import NAMED
from deltac.diagnosis.verdict import Confidence, Finding, Kind, Verdict

LOWERED: dict[Confidence, Confidence] = {"high": "medium", "medium": "low", "low": "low"}
"""The confidence in a verdict that something else speaks against."""


@dataclass(frozen=True)
class Rule:
    """A verdict, and when it applies.

    Attributes:
        kind, confidence: of the verdict.
        when: whether it applies, where no rule before does.
        says: the sentences that follow those on the balance and on the equations, or all, where `alone`.
        changes: gives causes another weight.
    """

    kind: Kind
    confidence: Confidence | Callable[[Facts], Confidence]
    when: Callable[[Facts], object]
    says: Callable[[Facts], str | tuple[str, ...]] = lambda _: ()
    alone: bool = False
    changes: Callable[[tuple[Finding, ...]], tuple[Finding, ...]] = lambda findings: findings


def accused(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """The findings with what explains the residual as causes: small, it was a note; the energy says more."""
    causes = [replace(f, weight="cause") for f in findings if of_model(f)]
    return (*causes, *(f for f in findings if not of_model(f)))


def excused(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """The findings with causes as notes: something else may be the cause."""
    return tuple(replace(f, weight="note") if f.weight == "cause" else f for f in findings)


def _sure(f: Facts) -> Confidence:
    """High where a cause stands far out of every error bar."""
    step = f.step
    if step is None or not f.left_by_steps:
        return "high"
    return "high" if step.clear > NAMED and float(step.residual.ratio.max()) > BEYOND else "medium"


def _tested(f: Facts) -> Confidence:
    return "high" if f.tested else "medium"


RULES = (
    # The log cannot be judged as it is.
    Rule("unresolved", "high", lambda f: f.doubts, say.contradiction, alone=True),
    # A cause is known, or what looks like one may be a force that the log lacks.
    Rule(
        "unresolved", "high", lambda f: f.causes == {"missing-contact"} and f.impacts, say.impacts
    ),
    Rule("unresolved", "high", lambda f: f.like_actuators, say.may_be_unlogged, changes=excused),
    Rule(
        "integration-error", "medium", lambda f: f.causes == {"constraint-drift"}, say.smaller_step
    ),
    Rule("equation-error", _sure, lambda f: f.causes, say.named, alone=True),
    # The equations leave something that has no name; across steps it may be impulses, which the model has.
    Rule("unresolved", "high", lambda f: f.lacking and f.off, say.unlogged),
    Rule(
        "equation-error", "medium", lambda f: f.accused_at_samples, say.accounted, changes=accused
    ),
    Rule("unresolved", "high", lambda f: f.far_off and f.impacts, say.impacts),
    Rule("equation-error", "medium", lambda f: f.far_off),
    Rule(
        "unresolved",
        "medium",
        lambda f: f.beyond_by_steps and not f.energy.within,
        say.no_known_cause,
    ),
    # They leave less than the tolerance, beside an energy error that is beyond it.
    Rule("equation-error", "medium", lambda f: f.matters and f.explained, changes=accused),
    Rule(
        "integration-error",
        "medium",
        lambda f: f.matters and f.known_but_for_causes,
        say.smaller_step,
    ),
    Rule("unresolved", "medium", lambda f: f.matters, say.no_known_cause),
    # Hardly any energy flows.
    Rule("consistent", _tested, lambda f: f.energy.idles, say.idle, alone=True),
    Rule("unresolved", "high", lambda f: f.energy.nothing_moves, say.nothing_moves, alone=True),
    # The balance, between gaps where rows are missing.
    Rule("unresolved", "high", lambda f: f.lost_in_gaps and not f.borne_out, say.missing_rows),
    Rule("consistent", _tested, lambda f: f.judged.within and f.judged.fine),
    Rule(
        "consistent", "medium", lambda f: f.judged.may_be_within and f.known_by_steps, say.by_steps
    ),
    Rule("unresolved", "high", lambda f: f.unsure, say.sampling),
    # The energy error is real: is it the integrator's?
    Rule("unresolved", "medium", lambda f: not (f.tested or f.ruled_out), say.untested),
    Rule("unresolved", "high", lambda f: f.impacts, say.impacts),
    Rule("unresolved", "medium", lambda f: f.single_steps, say.single_steps),
    Rule("unresolved", "medium", lambda f: f.of("forces-not-of-this-row"), say.other_rows),
    Rule("integration-error", _tested, lambda _: True, say.smaller_step),
)


def judge(facts: Facts) -> Verdict:
    """The verdict on one log."""
    rule = next(rule for rule in RULES if rule.when(facts))
    confidence = rule.confidence if isinstance(rule.confidence, str) else rule.confidence(facts)
    violated = rule.kind == "consistent" and facts.of("constraint-violation") is not None
    said = rule.says(facts)
    said = (said,) if isinstance(said, str) else said
    return Verdict(
        rule.kind,
        LOWERED[confidence] if facts.small or violated else confidence,
        said if rule.alone else (*say.numbers(facts), *said),
        rule.changes(facts.findings),
    )
