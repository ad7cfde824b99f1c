"""From measures to a verdict: the rules, in the order in which they apply."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deltac.diagnosis.equations import EquationTerms
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.verdict import Confidence, Kind, Verdict

NOTHING = 1e-12
"""Energy turned over below this share of the energies themselves is their rounding."""

DOMINATES = 4.0
"""What is left counts from this many error bars on, once the bar is above the tolerance."""

HALF = 0.5
"""Share of what is left that the residual must account for to be its cause."""


@dataclass(frozen=True)
class Measures:
    """Numbers (J, s) that a verdict on one log rests on.

    turnover  energy turned over; scale: that and the energies themselves
    left      largest |ΔC|, corrections included; bar: the error bar of its quadrature
    tolerance accepted share of the turnover
    spacing   of the samples; step: of the simulator, if known; method: how the work was taken
    bar_growth  gives how many times larger the bar is on every second sample
    """

    turnover: float
    scale: float
    left: float
    bar: float
    tolerance: float
    spacing: float
    step: float | None
    method: str
    bar_growth: Callable[[], float]

    @property
    def allowed(self) -> float:
        """The energy error that is accepted, J."""
        return self.tolerance * self.turnover


def judge(
    measures: Measures, terms: EquationTerms | None, findings: tuple[Finding, ...]
) -> Verdict:
    """The verdict on one log.

    A log that was misread, or in which nothing moves, cannot be judged. Then the equations of motion at
    the samples speak, which no integration enters; then ΔC against tolerance and error bar.
    """

    def verdict(kind: Kind, confidence: Confidence, *evidence: str) -> Verdict:
        return Verdict(kind, confidence, evidence, findings)

    balance = _balance(measures)
    if any(f.weight == "doubt" for f in findings):
        named = ", ".join(dict.fromkeys(f.kind for f in findings if f.weight == "doubt"))
        return verdict(
            "unresolved", "high", f"The log is not what it claims to be ({named}): correct it first"
        )
    equations = _equations(terms)
    if any(f.weight == "cause" for f in findings):
        return verdict("equation-error", "high", balance, equations, *_slight(measures))
    if terms is not None and terms.significant.any():
        share = float(np.abs(terms.share_of_energy).max())
        if float(terms.relative.max()) > measures.tolerance or (
            measures.left > measures.allowed and share >= HALF * measures.left
        ):
            accounted = f"The residual of the equations accounts for {share:.3g} J of what is left"
            return verdict("equation-error", "medium", balance, equations, accounted)
    if measures.turnover <= NOTHING * measures.scale:
        return verdict(
            "unresolved",
            "high",
            f"Next to nothing moves: {measures.turnover:.3g} J are turned over, no more than rounding. "
            "Take a run in which energy flows",
        )
    if measures.bar > measures.allowed and measures.left <= DOMINATES * measures.bar:
        return verdict("unresolved", "high", balance, equations, _sampling(measures))
    if measures.left <= measures.allowed + measures.bar:
        sure = measures.left <= measures.allowed and terms is not None
        return verdict("consistent", "high" if sure else "medium", balance, equations)
    if terms is None:
        return verdict(
            "unresolved",
            "medium",
            balance,
            "The log has no measured accelerations, so an error of the equations cannot be told from one "
            "of the integration: log udot.<speed> of the same instants (MuJoCo: qacc)",
        )
    return verdict("integration-error", "high", balance, equations, _smaller_step(measures))


def _balance(m: Measures) -> str:
    share = m.left / m.turnover if m.turnover > 0.0 else 0.0
    return (
        f"Largest |ΔC| {m.left:.3g} J ± {m.bar:.2g} J ({m.method}), {100 * share:.2g} % of the "
        f"{m.turnover:.4g} J turned over; accepted are {100 * m.tolerance:g} %"
    )


def _equations(terms: EquationTerms | None) -> str:
    if terms is None:
        return "The equations of motion were not tested at the samples: no measured accelerations"
    if not terms.significant.any():
        worst = float(terms.relative.max(initial=0.0))
        return (
            f"At {len(terms.t)} samples the equations of motion close to {worst:.1g} of their terms: no "
            "mistake shows"
        )
    k = int(np.argmax(np.where(terms.significant, terms.relative, 0.0)))
    above = terms.size[k] / terms.precision[k]
    return (
        f"At {len(terms.t)} samples the equations of motion leave up to {100 * terms.relative[k]:.3g} % of "
        f"their terms ({terms.speeds[k]}), {above:.2g} times what the log's precision explains"
    )


def _sampling(m: Measures) -> str:
    """Which sampling rate would bring the error bar below the tolerance."""
    order = float(np.clip(math.log2(max(m.bar_growth(), 1.0)), 1.0, 8.0))
    rate = (m.bar / m.allowed) ** (
        1.0 / math.floor(order)
    ) / m.spacing  # a whole order is counted on
    rate = float(f"{rate:.2g}") if rate < 1e4 else float(f"{rate:.1g}")
    now = f"the error bar of the samples dominates at {1.0 / m.spacing:.4g} Hz"
    if m.step is not None and m.spacing > 1.5 * m.step and rate >= 0.9 / m.step:
        advice = f"log every step of the simulator ({1.0 / m.step:.4g} Hz)"
    elif m.step is not None and m.spacing <= 1.5 * m.step:
        advice = "every step is logged already: take a smaller step"
        advice += ", or work='discrete' to check the bookkeeping" if m.method == "samples" else ""
    else:
        advice = f"sample at about {rate:g} Hz or more"
    return f"Unresolved because {now} (it falls with order {order:.1f}): {advice}"


def _slight(m: Measures) -> tuple[str, ...]:
    if m.left > m.allowed:
        return ()
    return ("As far as energy goes, the mistake stays within the tolerance",)


def _smaller_step(m: Measures) -> str:
    if m.step is None:
        return "A smaller step, or a method of higher order, is the remedy"
    return f"The step was {m.step:g} s: a smaller one, or a method of higher order, is the remedy"
