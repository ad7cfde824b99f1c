"""What a check of equations found, in values and in words."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.check_example import Example
from deltac.diagnosis.equation_test import EquationTest, Residuals
from deltac.diagnosis.localisation import Blame
from deltac.diagnosis.states import States
from deltac.diagnosis.verdict import Verdict
from deltac.mechanism.coordinate_map import CoordinateMap

Array: TypeAlias = NDArray[np.float64]

SHOWN = 6
"""Equations that are told of in words."""

STATUS = {"consistent": 0, "equation-error": 1, "unresolved": 3}

LIMITS = (
    "states other than those drawn, such as a branch that is seldom taken",
    "a parameter that is wrong in the model and in the equations alike",
)

MEANINGS = {
    "consistent": "The equations are the model's.",
    "equation-error": "The equations are not the model's.",
    "unresolved": "The function is too rough, or too often undefined, to tell.",
}


@dataclass(frozen=True)
class Seen:
    """What one test makes of the equations: its largest `relative` residual, and whether it `sees` them fail.

    `test`: "coordinate residual", "constraint <name>", "momentum, <name>", or the name of a testing function.
    """

    test: str
    relative: float
    sees: bool


@dataclass(frozen=True, eq=False)
class EquationCheck:
    """What a check of equations found.

    Attributes:
        verdict: "consistent", "equation-error" or "unresolved", with evidence and findings.
        blame: the equations that fail, the worst first.
        seen: which of all tests see that they fail.
        example: a simple state at which they fail, and both accelerations; None if they do not.
        states: where they were tested; `udot` (n, B) their accelerations there, `residuals` what is left.
        test: the mechanism's own equations at these states.
        roughness: of the function, as a fraction of the terms (n,), by speed.
        tolerance: relative residual that is accepted.
        coordinates: the map to the mechanism's coordinates, None for its own.
        name: what the equations are called; `vectorised`: whether they take batches.
    """

    verdict: Verdict
    blame: tuple[Blame, ...]
    seen: tuple[Seen, ...]
    example: Example | None
    states: States
    udot: Array
    residuals: Residuals
    test: EquationTest
    roughness: Array
    tolerance: float
    coordinates: CoordinateMap | None
    name: str
    vectorised: bool

    @property
    def status(self) -> int:
        """Exit status of the command line: 0 consistent, 1 wrong, 3 unresolved."""
        return STATUS[self.verdict.kind]

    @property
    def worst(self) -> float:
        """The largest relative residual, of all equations at all states where it is finite."""
        values = self.residuals.relative
        return float(values[np.isfinite(values)].max(initial=0.0))

    def explain(self, width: int = 96) -> str:
        """The check in words, a paragraph each."""
        v = self.verdict
        lines = [f"{v.kind} (confidence {v.confidence}). {MEANINGS[v.kind]}"]
        lines += [f"- {sentence}." for sentence in v.evidence]
        for k, finding in enumerate(self.blame[:SHOWN]):
            lines.append(f"{'Where' if k == 0 else 'Also'}: {finding}.")
        if len(self.blame) > SHOWN:
            lines.append(f"Also: {len(self.blame) - SHOWN} more equations.")
        if self.example is not None:
            lines.append(f"Example: {self.example}.")
        for heading, weight in (("Cause", "cause"), ("Doubt", "doubt"), ("Note", "note")):
            lines += [f"{heading}: {f}." for f in v.findings if f.weight == weight]
        lines.append(f"Not seen by this check: {'; '.join(v.limits)}.")
        return "\n".join(textwrap.fill(line, width, subsequent_indent="  ") for line in lines)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "verdict": self.verdict.kind,
            "confidence": self.verdict.confidence,
            "evidence": list(self.verdict.evidence),
            "equations": self.name,
            "mechanism": self.test.kane.mechanism.name,
            "states": len(self.states),
            "tolerance": self.tolerance,
            "relative_residual": dict(zip(self.test.speeds, finite_worst(self.residuals))),
            "roughness": dict(zip(self.test.speeds, map(float, self.roughness))),
            "vectorised": self.vectorised,
            "blame": [entry.to_dict() for entry in self.blame],
            "tests": [vars(entry) for entry in self.seen],
            "example": None if self.example is None else self.example.to_dict(),
            "findings": [vars(finding) for finding in self.verdict.findings],
            "limits": list(self.verdict.limits),
        }


def finite_worst(residuals: Residuals) -> list[float]:
    """The largest relative residual of each equation, where it is finite."""
    return [float(row[np.isfinite(row)].max(initial=0.0)) for row in residuals.relative]
