"""The verdict on a motion: can it be trusted, and if not, what is wrong?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from deltac.errors import InputError
from deltac.results import Finding, Report, Weight, findings_in_words, percent
from deltac.simulation.step_size.energy_error import ACCURATE

if TYPE_CHECKING:
    from deltac.energy import Ledger

__all__ = ["Confidence", "Finding", "Judged", "VerdictKind", "Verdict", "Weight", "percent"]

VerdictKind = Literal["consistent", "integration-error", "equation-error", "unresolved"]
Confidence = Literal["high", "medium", "low"]

MEANINGS: dict[VerdictKind, str] = {
    "consistent": "The energy balance holds: motion, model and logged forces are consistent with each other.",
    "integration-error": "The equations hold at the samples, but energy is not conserved: the step or the "
    "integrator is to blame, not the model.",
    "equation-error": "The motion does not obey the model's equations: a parameter, a force or a missing "
    "channel is to blame.",
    "unresolved": "The log does not allow a decision between these.",
}
"""What each kind means of a log; other tests say it in words of their own."""

EXIT_CODES: dict[VerdictKind, int] = {
    "consistent": 0,
    "integration-error": 1,
    "equation-error": 1,
    "unresolved": 3,
}

RUN_TOLERANCE = ACCURATE
"""Energy error of a run that is judged as it is, accepted by default, as a fraction of the energy that the
system has: samples, digits of a log and the low orders of real-time engines leave about as much."""

REFINED_TOLERANCE = 1e-6
"""The same where the step is ours to refine: methods of order 4 and more reach it at affordable steps."""

LEAST_ORDER = 0.5
"""What falls more slowly with the step is not seen to fall: non-smooth motions show 0.5 to 1."""


def check_tolerance(tolerance: float) -> float:
    """A tolerance as a number; InputError unless it is a fraction between 0 and 1."""
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance is {tolerance!r}; expected a number between 0 and 1")
    return float(tolerance)


def function_of(ledger: Ledger) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    preference = ("wang", "liu-huston", "kane-levinson-1990", *ledger.delta_c)
    return next(name for name in preference if name in ledger.delta_c)


LIMITS: tuple[str, ...] = (
    "an error shared by motion and model, such as the same wrong mass in both",
    "a wrong force that does no work, unless the log has accelerations",
    "accuracy, where a stabilised or symplectic method keeps ΔC bounded at large steps",
    "what happened between the samples",
)
"""What no energy test sees; printed with every verdict."""


@dataclass(frozen=True, repr=False)
class Verdict(Report):
    """The outcome of a test of a motion.

    kind        "consistent", "integration-error", "equation-error" or "unresolved"
    confidence  "high", "medium" or "low"
    evidence    the numbers it rests on, a sentence each
    findings    what was noticed, causes first
    limits      what the test cannot see
    meaning     what it comes to, in a sentence; by default what the kind means of a log
    """

    kind: VerdictKind
    confidence: Confidence
    evidence: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    limits: tuple[str, ...] = LIMITS
    meaning: str = ""

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 consistent, 1 an error, 3 unresolved."""
        return EXIT_CODES[self.kind]

    @property
    def certainty(self) -> str:
        """The confidence in brackets, to follow the kind; empty where nothing was decided."""
        return "" if self.kind == "unresolved" else f" (confidence {self.confidence})"

    def summary(self) -> str:
        """Kind, confidence and meaning."""
        return f"{self.kind}{self.certainty}. {self.meaning or MEANINGS[self.kind]}"

    def sections(self, details: Iterable[str] = ()) -> Iterator[str]:
        """The verdict in words: evidence, `details` of it, findings and limits, a paragraph each."""
        yield self.summary()
        yield from (f"- {sentence}." for sentence in self.evidence)
        yield from details
        yield from findings_in_words(self.findings)
        yield f"Not visible to this test: {'; '.join(self.limits)}."


class Judged(Report):
    """A report that has a verdict; the verdict's parts stand at the top of its JSON."""

    verdict: Verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed, causes first."""
        return self.verdict.findings

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 consistent, 1 an error, 3 unresolved."""
        return self.verdict.exit_code

    def contents(self) -> dict[str, Any]:
        """What the JSON holds, in terms of JSON."""
        v = self.verdict
        entries = {name: item for name, item in super().contents().items() if name != "verdict"}
        exit_code = entries.pop("exit_code")
        words = {"confidence": v.confidence, "meaning": v.meaning or MEANINGS[v.kind]}
        parts = {"evidence": list(v.evidence), "limits": list(v.limits)}
        return {"exit_code": exit_code, "verdict": v.kind, **words, **parts, **entries}
