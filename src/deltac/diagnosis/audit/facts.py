"""What the rules of a verdict ask of a log, by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.audit.evidence import OF_THE_LOG, Evidence
from deltac.diagnosis.audit.measures import BEYOND, Measures
from deltac.diagnosis.audit.steps import beyond
from deltac.diagnosis.explain.causes import PREFERENCE
from deltac.diagnosis.residuals.at_samples import CLEAR, EquationTerms
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.residuals.schemes import Left
from deltac.diagnosis.verdict import Finding, percent
from deltac.results import HEADINGS

OF_INERTIA = ("body-inertia", "body-mass", "body-moments", "body-moment", "body-tensor")
"""Causes that no controlled actuator looks like whose force is not in the log."""

FAR = 3.0
"""How many tolerances a residual without a known cause must be to accuse the equations."""

HALF = 0.5
"""Share of the energy error that the residual must account for to be its cause."""


@dataclass(frozen=True, eq=False)
class Facts:
    """What the rules ask of a log: its energy, what the equations leave, what was noticed."""

    energy: Measures
    evidence: Evidence
    findings: tuple[Finding, ...]

    def of(self, kind: str) -> Finding | None:
        """The first finding of a kind."""
        return next((f for f in self.findings if f.kind == kind), None)

    @property
    def doubts(self) -> list[Finding]:
        """What the log contradicts itself in."""
        return [f for f in self.findings if f.weight == "doubt"]

    @cached_property
    def causes(self) -> set[str]:
        """Kinds of the causes that were found."""
        return {f.kind for f in self.findings if f.weight == "cause"}

    @property
    def impacts(self) -> Finding | None:
        """Impacts of the model of which the run does not tell."""
        return self.of("impacts")

    @property
    def lacking(self) -> Finding | None:
        """Forces of the model's file that the log lacks."""
        return self.of("assumed-zero")

    @property
    def step(self) -> OneStep | None:
        """The one-step test."""
        return self.evidence.step

    @property
    def terms(self) -> EquationTerms | None:
        """The equations at the samples."""
        return self.evidence.terms

    # --- what the equations say ---

    @cached_property
    def left_at_samples(self) -> bool:
        """Whether the equations leave something at the samples."""
        return self.terms is not None and bool(self.terms.significant.any())

    @cached_property
    def closed_at_samples(self) -> bool:
        """Whether they were tested there, and leave nothing."""
        return self.terms is not None and not self.left_at_samples

    @cached_property
    def left_by_steps(self) -> bool:
        """Whether the one-step test leaves more than its error bars."""
        return self.step is not None and bool(self.step.significant.any())

    @cached_property
    def beyond_by_steps(self) -> bool:
        """Whether that is more than the tolerance allows."""
        return self.step is not None and beyond(self.step, self.energy.tolerance)

    @cached_property
    def borne_out(self) -> bool:
        """Whether rows follow from each other as far as an unknown integrator and the digits tell."""
        return self.step is not None and not self.left_by_steps

    @cached_property
    def tested(self) -> bool:
        """Whether right equations are known to be right: by accelerations, or an integrator that closes."""
        return self.terms is not None or (self.step is not None and self.step.closes)

    @cached_property
    def far_off(self) -> bool:
        """Whether the one-step test leaves so much that it accuses the equations without a known cause."""
        if not self.beyond_by_steps or self.step is None or self.of("not-reproducible"):
            return False
        r = self.step.residual
        far = (r.ratio > BEYOND) & (r.relative > FAR * self.energy.tolerance)
        return bool((self.step.significant & far).any())

    @property
    def off(self) -> bool:
        """Whether the equations leave something, at the samples or beyond the tolerance across steps."""
        return self.left_at_samples or self.beyond_by_steps

    @cached_property
    def accused_at_samples(self) -> bool:
        """Whether what the samples leave accuses the equations without a name: by its size or its energy."""
        terms, energy = self.terms, self.energy
        if terms is None or not self.left_at_samples or self.of("not-reproducible"):
            return False
        large = float(terms.relative[terms.significant].max()) > energy.tolerance
        return large or (not energy.within and self.accounted >= HALF * energy.left)

    @property
    def accounted(self) -> float:
        """Energy (J) that the residual at the samples makes."""
        return 0.0 if self.terms is None else float(np.abs(self.terms.share_of_energy).max())

    @cached_property
    def small(self) -> bool:
        """Whether what is left is within the tolerance, and yet no chance."""
        return self.of("small-but-real") is not None

    @cached_property
    def matters(self) -> bool:
        """Whether the one-step test leaves less than the tolerance beside an energy error beyond it."""
        there = self.step is not None and self.small and not self.beyond_by_steps
        return there and self.energy.left > self.energy.allowed + self.energy.bar

    @cached_property
    def explained(self) -> bool:
        """Whether so little is a term of the model, or at the samples as well, and did half of ΔC."""
        if self.step is None:
            return False
        named = any(f.factor is not None and of_model(f) for f in self.findings)
        did = self.step.residual.spent >= HALF * self.energy.left
        return did and (named or self.terms is not None)

    @property
    def known_but_for_causes(self) -> bool:
        """Whether an integrator closes once the causes are taken off."""
        return self.step is not None and self.step.known_but_for_causes

    # --- what the log lacks ---

    @cached_property
    def like_actuators(self) -> bool:
        """Whether the causes may be what unlogged actuators did: no more directions than there are of these.

        Controllers look like springs and dampers, or compensate gravity. That an equality's own force is the
        one that is lacking is no excuse of another kind.
        """
        lacking = self.lacking
        if not lacking or not lacking.element or self.causes <= {*OF_INERTIA, "missing-equality"}:
            return False
        step, terms, left = self.step, self.terms, list[Array]()
        if step is not None and self.left_by_steps:
            left.append(step.residual.forces / np.maximum(step.clear * step.residual.bar, 1e-300))
        elif step is not None and step.standing_out.any():
            forces = step.local.forces[step.standing_out]
            left.append(forces / np.maximum(step.residual.scale, 1e-300))
        if terms is not None and self.left_at_samples:
            left.append(terms.residual / np.maximum(CLEAR * terms.precision, 1e-300))
        count = 1 + len(lacking.equals)
        sizes = (np.linalg.svd(x, compute_uv=False) / np.sqrt(len(x)) for x in left)
        return all(np.sum(size > 1.0) <= count for size in sizes)

    # --- what the energy says, between gaps where rows are missing ---

    @cached_property
    def judged(self) -> Measures:
        """The energy of the whole log, or where rows are missing of the part that is worst."""
        return self.energy.between_gaps if self.energy.gaps else self.energy

    @cached_property
    def lost_in_gaps(self) -> bool:
        """Whether all parts between gaps may balance, and nothing is known of what happened in these."""
        if not self.energy.gaps:
            return False
        return self.judged.may_be_within or not (self.judged.fine or self.judged.clear)

    @cached_property
    def unsure(self) -> bool:
        """Whether ΔC may be within the tolerance, or its bar hides that; rows may tell more than it does."""
        m = self.judged
        unknown = m.may_be_within or not (m.fine or m.clear)
        return unknown and (not self.known_by_steps or m.left <= m.bar)

    @cached_property
    def hidden(self) -> float:
        """Energy (J) that a mistake may have done in the time of the log without being seen."""
        if self.step is None:
            return np.inf
        r = self.step.residual
        return r.hidden + (r.spent if self.left_by_steps else 0.0)

    @cached_property
    def known_by_steps(self) -> bool:
        """Whether rows tell more than the balance: no mistake as large as its bar can hide behind them."""
        return self.borne_out and self.hidden <= self.judged.allowed + self.judged.bar

    @property
    def ruled_out(self) -> bool:
        """Whether no mistake can have made half of the energy error."""
        return self.hidden <= HALF * self.judged.left

    @cached_property
    def single_steps(self) -> Left | None:
        """What an integrator that closes leaves of single steps, where that makes half of ΔC."""
        left = self.step.by_scheme() if self.step is not None and self.step.closes else None
        return left if left is not None and left.work >= HALF * self.judged.left else None


def of_model(finding: Finding) -> bool:
    """Whether it names a change of the model, not of the log."""
    return finding.kind in PREFERENCE and finding.kind not in OF_THE_LOG


def facts_of(energy: Measures, evidence: Evidence, findings: Iterable[Finding]) -> Facts:
    """The facts of a log, causes first."""
    found = [*findings, *_small_but_real(energy, evidence)]
    # A motion drifts off its constraints by whatever else is wrong, too.
    weights = list(HEADINGS)
    ranked = sorted(found, key=lambda f: (weights.index(f.weight), f.kind == "constraint-drift"))
    return Facts(energy, evidence, tuple(ranked))


def _small_but_real(energy: Measures, evidence: Evidence) -> list[Finding]:
    """What is within the tolerance, and yet no chance: a residual beyond its error bar."""
    step, terms = evidence.step, evidence.terms
    share = energy.left / energy.beside if energy.beside > 0.0 else 0.0
    beside = f"|ΔC| {percent(share)} of the energy"
    if terms is not None and terms.significant.any():
        k = int(np.argmax(np.where(terms.significant, terms.relative, 0.0)))
        bar = CLEAR * float(terms.precision[k]) + (0.0 if terms.doubt is None else terms.doubt[k])
        at, speed, left, times = (
            " at the samples",
            terms.speeds[k],
            terms.relative[k],
            terms.size[k] / bar,
        )
        if left > energy.tolerance:
            return []
    elif step is not None and step.significant.any() and not beyond(step, energy.tolerance):
        if any(f.kind == "not-reproducible" for f in evidence.findings):
            return []
        r = step.residual
        k = int(np.argmax(np.where(step.significant, r.ratio, 0.0)))
        at, speed, left, times = "", step.speeds[k], r.relative[k], r.ratio[k]
        beside += f"; an integrator may leave {percent(r.bar[k] / r.scale[k])} at most"
    else:
        return []
    return [
        Finding(
            "small-but-real",
            f"the equations{at} have a residual of {percent(left)} of the terms of {speed!r}: within the "
            f"tolerance, but {times:.2g} times its error bar",
            beside,
            "See the notes for possible causes; strict=True makes it count",
            element=speed,
        )
    ]
