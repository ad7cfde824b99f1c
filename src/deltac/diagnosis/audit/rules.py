"""From facts to a verdict: a table of rules, of which the first that applies decides.

A log that was misread, or in which nothing moves, cannot be judged. Then the equations are asked, by the
one-step test and at the samples, and last ΔC, against tolerance and error bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from deltac.diagnosis.audit import sentences as say
from deltac.diagnosis.audit.facts import HALF, Facts, of_model
from deltac.diagnosis.audit.measures import BEYOND
from deltac.diagnosis.residuals.one_step import NAMED
from deltac.diagnosis.verdict import Confidence, Finding, Kind, Verdict

LOWERED: dict[Confidence, Confidence] = {"high": "medium", "medium": "low", "low": "low"}
"""The confidence in a verdict that something else speaks against."""


@dataclass(frozen=True)
class Rule:
    """What follows where a condition holds.

    `says` are the sentences that follow those on the balance and on the equations, or all of them, where the
    rule is `alone`. `changes` gives causes another weight.
    """

    when: Callable[[Facts], bool]
    kind: Kind
    confidence: Confidence | Callable[[Facts], Confidence]
    says: Callable[[Facts], tuple[str, ...] | str] = lambda f: ()
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
    # the log cannot be judged as it is
    Rule(lambda f: bool(f.weighing("doubt")), "unresolved", "high", say.contradiction, alone=True),
    # a cause is known, or what looks like one may be a force that the log lacks
    Rule(
        lambda f: f.causes == {"missing-contact"} and f.of("impacts") is not None,
        "unresolved", "high", say.impacts,
    ),
    Rule(lambda f: f.like_actuators, "unresolved", "high", say.may_be_unlogged, changes=excused),
    Rule(
        lambda f: f.causes == {"constraint-drift"},
        "integration-error", "medium", say.smaller_step,
    ),
    Rule(lambda f: bool(f.causes), "equation-error", _sure, say.named, alone=True),
    # the equations leave something that has no name
    Rule(
        lambda f: f.of("assumed-zero") is not None and (f.left_at_samples or f.beyond_by_steps),
        "unresolved", "high", say.unlogged,
    ),
    Rule(lambda f: f.off_at_samples, "equation-error", "medium", say.accounted, changes=accused),
    Rule(
        # equations that hold at every row and not across steps: impulses, which the model has
        lambda f: f.far_off and f.closed_at_samples and f.of("impacts") is not None,
        "unresolved", "high", say.impacts,
    ),
    Rule(lambda f: f.far_off, "equation-error", "medium"),
    Rule(
        lambda f: f.beyond_by_steps and not f.energy.within,
        "unresolved", "medium", say.no_known_cause,
    ),
    # a residual within the tolerance beside an energy error that is not
    Rule(
        lambda f: f.matters_though_small and f.explained,
        "equation-error", "medium", changes=accused,
    ),
    Rule(
        lambda f: f.matters_though_small and f.known_but_for_causes,
        "integration-error", "medium", say.smaller_step,
    ),
    Rule(lambda f: f.matters_though_small, "unresolved", "medium", say.no_known_cause),
    # hardly any energy flows
    Rule(lambda f: f.energy.idles, "consistent", _tested, say.idle, alone=True),
    Rule(lambda f: f.energy.nothing_moves, "unresolved", "high", say.nothing_moves, alone=True),
    # the balance
    Rule(
        lambda f: f.lost_in_gaps and not f.borne_out,
        "unresolved", "high", say.missing_rows,
    ),
    Rule(
        lambda f: f.judged.within and f.judged.fine,
        "consistent", _tested,
    ),
    Rule(lambda f: f.judged.within and f.borne_out, "consistent", "medium"),
    Rule(
        lambda f: f.unsure and f.known_by_steps and f.judged.left <= f.judged.allowed + f.judged.bar,
        "consistent", "medium", say.by_steps,
    ),
    Rule(
        lambda f: f.unsure and (not f.known_by_steps or f.judged.left <= f.judged.bar),
        "unresolved", "high", say.sampling,
    ),
    # the energy error is real: is it the integrator's?
    Rule(
        lambda f: not f.tested and not f.hidden <= HALF * f.judged.left,
        "unresolved", "medium", say.untested,
    ),
    Rule(lambda f: f.of("impacts") is not None, "unresolved", "high", say.impacts),
    Rule(lambda f: f.single_steps is not None, "unresolved", "medium", say.single_steps),
    Rule(
        lambda f: f.of("forces-not-of-this-row") is not None,
        "unresolved", "medium", say.other_rows,
    ),
    Rule(lambda f: True, "integration-error", _tested, say.smaller_step),
)  # fmt: skip


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
        tuple(x for x in (said if rule.alone else (*say.numbers(facts), *said)) if x),
        rule.changes(facts.findings),
    )
