"""Findings: one thing that an audit noticed, what it rests on, and what to do about it."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Literal

Weight = Literal["cause", "doubt", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed.

    kind      a short fixed name, for programs: "gravity", "mass-scale", "missing-damper", …
    what      what it is, in a sentence
    evidence  the numbers it rests on
    remedy    what to change or to record
    weight    "cause": it explains what is wrong; "doubt": the log cannot be judged as it stands; "note"
    element   the joint, body or channel, where there is one
    factor    what to multiply by (a force, a mass), or the coefficient found, with its standard `error`
    """

    kind: str
    what: str
    evidence: str
    remedy: str
    weight: Weight = "note"
    element: str = ""
    factor: float | None = None
    error: float | None = None

    def __str__(self) -> str:
        return f"{self.what} ({self.evidence}). {self.remedy}"


def percent(share: float) -> str:
    """A share in per cent, without exponents where it is large: "0.0021 %", "101 %"."""
    value = 100.0 * float(share)
    return f"{value:.0f} %" if 99.5 <= abs(value) < 1e6 else f"{value:.2g} %"


# --- the verdict: can this motion be trusted, and if not, what is wrong? -------------------------

Kind = Literal["consistent", "integration-error", "equation-error", "unresolved"]
Confidence = Literal["high", "medium", "low"]

MEANINGS: dict[Kind, str] = {
    "consistent": "The energy balance holds: motion, model and logged forces belong together.",
    "integration-error": "The equations hold at the samples, but energy is not kept: the step or the "
    "integrator is to blame, not the model.",
    "equation-error": "The motion does not obey the model's equations: a parameter, a force or a missing "
    "channel is to blame, not the integrator.",
    "unresolved": "The log does not tell.",
}
"""What each kind means of a log; other tests say it in words of their own."""

LIMITS: tuple[str, ...] = (
    "an error shared by motion and model, such as one wrong mass used in both",
    "a wrong force that does no work, unless the log has accelerations",
    "accuracy, where a stabilised or symplectic method keeps ΔC bounded at large steps",
    "what happened between the samples",
)
"""What no energy test sees; printed with every verdict."""


@dataclass(frozen=True)
class Verdict:
    """What a test of a motion came to.

    kind        "consistent", "integration-error", "equation-error" or "unresolved"
    confidence  "high", "medium" or "low"
    evidence    the numbers it rests on, a sentence each
    findings    what was noticed, causes first
    limits      what the test cannot see
    meaning     what it comes to, in a sentence; by default what the kind means of a log
    """

    kind: Kind
    confidence: Confidence
    evidence: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    limits: tuple[str, ...] = LIMITS
    meaning: str = ""

    def explain(self, width: int = 96) -> str:
        """The verdict in words, with evidence, findings and limits, a paragraph each."""
        lines = [
            f"{self.kind} (confidence {self.confidence}). {self.meaning or MEANINGS[self.kind]}"
        ]
        lines += [f"- {sentence}." for sentence in self.evidence]
        for heading, weights in (("Cause", ("cause",)), ("Doubt", ("doubt",)), ("Note", ("note",))):
            lines += [f"{heading}: {f}." for f in self.findings if f.weight in weights]
        lines.append(f"Not seen by this test: {'; '.join(self.limits)}.")
        return "\n".join(textwrap.fill(line, width, subsequent_indent="  ") for line in lines)
