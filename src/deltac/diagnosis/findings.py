"""Findings: one thing that an audit noticed, what it rests on, and what to do about it."""

from __future__ import annotations

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
