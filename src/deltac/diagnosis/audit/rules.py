"""From measures to a verdict: the rules, in the order in which they apply."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.audit.evidence import OF_THE_LOG, Evidence, beyond
from deltac.diagnosis.explain.causes import PREFERENCE
from deltac.diagnosis.residuals.at_samples import CLEAR, EquationTerms
from deltac.diagnosis.residuals.one_step import NAMED, OneStep
from deltac.diagnosis.verdict import Confidence, Finding, Kind, Verdict, percent

NOTHING = 1e-12
"""Energy exchanged below this share of the energies themselves is their rounding."""

DOMINATES = 4.0
"""What is left counts from this many error bars on, once the bar is above the tolerance."""

SMOOTH = 2.0
"""Order of convergence from which on an error bar above the tolerance is believed."""

OF_INERTIA = ("body-inertia", "body-mass", "body-moments", "body-moment", "body-tensor")
"""Causes that no controlled actuator looks like whose force is not in the log."""

BEYOND = 30.0
"""So many error bars count whatever their order."""

IDLE = 2.0
"""Energy exchanged that is less than so many times what is left is that itself: nothing was exchanged."""

FAR = 3.0
"""How many tolerances a residual without a known cause must be to accuse the equations."""

LOWERING = ("constraint-violation",)
"""Notes that lower the confidence in a motion that is consistent otherwise."""

FEW = 6
"""Methods that are named at most where several close."""

HALF = 0.5
"""Share of what is left that the residual must account for to be its cause."""


@dataclass(frozen=True)
class Measures:
    """Numbers (J, s) that a verdict on one log rests on.

    energy_exchanged; held_energy: what of energy the system has at a time
    scale     all of that, and the energies themselves; kinetic: the largest K
    left      largest |ΔC|, corrections included; bar: the error bar of its quadrature, and `held`:
              what of it comes of forces held over steps that were not all logged; `noise`: of the
              digits of the log and noise on it
    tolerance accepted share of the smaller of energy_exchanged and energy held
    spacing   of the samples; step: of the simulator, if known; method: how the work was taken
    outside_gaps  gives left and bar of the parts between gaps, if rows are missing
    bar_growth  gives how many times larger the bar is on every second sample
    """

    energy_exchanged: float
    held_energy: float
    scale: float
    kinetic: float
    left: float
    bar: float
    held: float
    noise: float
    tolerance: float
    spacing: float
    step: float | None
    method: str
    outside_gaps: Callable[[], tuple[float, float]] | None
    bar_growth: Callable[[], float]

    @property
    def allowed(self) -> float:
        """The energy error that is accepted, J."""
        return self.tolerance * self.beside

    @property
    def fine(self) -> bool:
        """Whether the samples tell the energy to the tolerance; their error grows with what is exchanged."""
        return self.bar <= self.tolerance * self.energy_exchanged

    @property
    def beside(self) -> float:
        """The energy exchanged, which grows with time, or that the system has, where that is less, J."""
        return (
            min(self.energy_exchanged, self.held_energy)
            if self.held_energy > 0.0
            else self.energy_exchanged
        )

    @property
    def idle(self) -> bool:
        """Whether no energy is exchanged: what is exchanged is rounding, or the error itself."""
        return self.energy_exchanged <= max(NOTHING * self.scale, IDLE * self.left)

    @property
    def within_motion(self) -> bool:
        """Whether what is left is small beside the kinetic energy of a body that moves."""
        return self.kinetic > 0.0 and max(self.left, self.bar) <= self.tolerance * self.kinetic

    @property
    def order(self) -> float:
        """Order of convergence that the error bar shows when every second sample is left out."""
        return math.log2(max(self.bar_growth(), 1.0))

    @property
    def clear(self) -> bool:
        """Whether what is left is no error of the samples, where their bar exceeds the tolerance."""
        sure = BEYOND if self.order < SMOOTH else DOMINATES
        return self.left > sure * self.bar


def judge(measures: Measures, evidence: Evidence, findings: tuple[Finding, ...]) -> Verdict:
    """The verdict on one log.

    A log that was misread, or in which nothing moves, cannot be judged. Then the equations speak, by the
    one-step test and at the samples; then ΔC against tolerance and error bar.
    """
    terms, step = evidence.terms, evidence.step
    proven = step is not None and step.closes
    borne = step is not None and not step.significant.any()
    tested = terms is not None or proven
    small = any(f.kind == "small-but-real" for f in findings)

    def verdict(kind: Kind, confidence: Confidence, *said: str) -> Verdict:
        if small or (kind == "consistent" and any(f.kind in LOWERING for f in findings)):
            confidence = "medium" if confidence == "high" else "low"
        return Verdict(kind, confidence, tuple(x for x in said if x), findings)

    balance = _balance(measures)
    if any(f.weight == "doubt" for f in findings):
        named = ", ".join(dict.fromkeys(f.kind for f in findings if f.weight == "doubt"))
        return verdict(
            "unresolved", "high", f"The log contradicts itself ({named}); correct it first"
        )
    equations = (_steps(step), _equations(terms, step))
    causes = {f.kind for f in findings if f.weight == "cause"}
    like_a_mistake = not any(f.kind == "not-reproducible" for f in findings)
    unlogged = next((f for f in findings if f.kind == "assumed-zero" and f.element), None)
    impacts = next((f for f in findings if f.kind == "impacts"), None)
    if causes == {"missing-contact"} and impacts is not None:
        # What the log does not hold the model has: they do not contradict each other.
        return verdict("unresolved", "high", balance, f"{impacts}")
    # That an equality's own force is the one that is lacking is no excuse of another kind.
    actuated = unlogged is not None and not causes <= {*OF_INERTIA, "missing-equality"}
    if unlogged and actuated and _like_actuators(evidence, 1 + len(unlogged.equals)):
        alike = "; ".join(f.what for f in findings if f.weight == "cause")
        findings = tuple(replace(f, weight="note") if f.weight == "cause" else f for f in findings)
        lacking = f"It may be {alike}; or a force that the log lacks: {unlogged.evidence}"
        return verdict("unresolved", "high", balance, *equations, lacking)
    if causes == {"constraint-drift"}:
        return verdict("integration-error", "medium", balance, *equations, _smaller_step(measures))
    if causes:
        closed = terms is not None and not terms.significant.any()
        # Equations closed by forces as logged do not speak for the model.
        told = () if closed else (*equations, *_slight(measures))
        by_steps = step is not None and bool(step.significant.any())
        sure = not by_steps or (
            step is not None and step.clear > NAMED and float(step.residual.ratio.max()) > BEYOND
        )
        return verdict("equation-error", "high" if sure else "medium", balance, *told)
    by_samples = terms is not None and terms.significant.any()
    unlogged = unlogged or next((f for f in findings if f.kind == "assumed-zero"), None)
    if unlogged and (by_samples or (step is not None and beyond(step, measures.tolerance))):
        # No cause is known, and the model has an actuator whose force is not.
        lacking = f"What is missing may be forces that the log lacks: {unlogged.evidence}"
        return verdict("unresolved", "high", balance, *equations, lacking)
    if terms is not None and terms.significant.any() and like_a_mistake:
        share = float(np.abs(terms.share_of_energy).max())
        if float(terms.relative[terms.significant].max()) > measures.tolerance or (
            measures.left > measures.allowed and share >= HALF * measures.left
        ):
            accounted = (
                f"The residual of the equations accounts for {share:.3g} J of the energy error"
            )
            findings = _accused(findings)
            return verdict("equation-error", "medium", balance, *equations, accounted)
    if step is not None and beyond(step, measures.tolerance):
        r = step.residual
        far = step.significant & (r.ratio > BEYOND) & (r.relative > FAR * measures.tolerance)
        closed = terms is not None and not terms.significant.any()
        if far.any() and like_a_mistake and impacts is not None and closed:
            # The equations hold at every row and not across steps: impulses, which the model has.
            return verdict("unresolved", "high", balance, *equations, f"{impacts}")
        if far.any() and like_a_mistake:
            return verdict("equation-error", "medium", balance, *equations)
        if measures.left > measures.allowed:
            return verdict("unresolved", "medium", balance, *equations, _open(step))
    elif small and step is not None and measures.left > measures.allowed + measures.bar:
        # So little accuses only where a term of the model, or the samples, say so as well.
        explained = terms is not None or any(
            f.factor is not None and _of_model(f) for f in findings
        )
        if explained and step.residual.spent >= HALF * measures.left:
            findings = _accused(findings)
            return verdict("equation-error", "medium", balance, *equations)
        if step.known_but_for_causes:
            return verdict(
                "integration-error", "medium", balance, *equations, _smaller_step(measures)
            )
        return verdict("unresolved", "medium", balance, *equations, _open(step))
    if measures.idle and measures.within_motion:
        return verdict("consistent", "high" if tested else "medium", _idle(measures), *equations)
    if measures.energy_exchanged <= NOTHING * measures.scale:
        return verdict(
            "unresolved",
            "high",
            f"Almost nothing moves: the energy exchanged, {measures.energy_exchanged:.3g} J, is at "
            f"rounding level. "
            "Use a run in which energy flows",
        )
    if measures.outside_gaps is not None and max(measures.left, measures.bar) > measures.allowed:
        left, bar = measures.outside_gaps()
        outside = replace(measures, left=left, bar=bar, held=min(measures.held, bar))
        within = left <= measures.allowed + bar or (not outside.fine and not outside.clear)
        if within and not borne:
            return verdict("unresolved", "high", balance, *equations, _missing_rows(outside))
        measures, balance = (
            outside,
            f"{balance}; {left:.3g} J ± {bar:.2g} J in one part between gaps",
        )
    if measures.left <= measures.allowed and (measures.fine or borne):
        return verdict(
            "consistent",
            "high" if tested and measures.fine else "medium",
            balance,
            *equations,
        )
    unsure = not measures.fine and not measures.clear
    if unsure or measures.left <= measures.allowed + measures.bar:
        # Rows that no mistake of this size can hide behind tell more than a balance of such a bar.
        known = step is not None and _hides(step) <= measures.allowed + measures.bar
        if borne and known and measures.left <= measures.allowed + measures.bar:
            return verdict("consistent", "medium", balance, *equations, _by_steps(measures))
        if not (borne and known) or measures.left <= measures.bar:
            return verdict("unresolved", "high", balance, *equations, _sampling(measures))
    if not tested and not (step is not None and _hides(step) <= HALF * measures.left):
        wanted = (
            "The log has no accelerations of its own, and the one-step test cannot rule out that wrong "
            "equations cause the energy error: log udot.<speed> at the same instants (MuJoCo: qacc; SciPy: "
            "Trajectory.from_scipy(result, model, equations=f)), or log every step. If the simulator has "
            "no accelerations, run the same motion with half the step as well: deltac study MODEL --logs "
            "COARSE "
            "--logs FINE"
        )
        return verdict("unresolved", "medium", balance, *equations, wanted)
    if impacts is not None:
        return verdict("unresolved", "high", balance, *equations, f"{impacts}")
    few = step.by_scheme() if step is not None and proven else None
    if few is not None and few.work >= HALF * measures.left:
        when = ", ".join(f"{t:.4g}" for t in few.t[few.unclosed][:FEW])
        wanted = (
            f"The energy error comes from single steps, near t = {when} s: log what acted there"
        )
        return verdict("unresolved", "medium", balance, *equations, wanted)
    if any(f.kind == "forces-not-of-this-row" for f in findings):
        wanted = "The energy error may come from the logged forces, which belong to other rows"
        return verdict("unresolved", "medium", balance, *equations, wanted)
    return verdict(
        "integration-error",
        "high" if tested else "medium",
        balance,
        *equations,
        _smaller_step(measures),
    )


def _like_actuators(evidence: Evidence, count: int) -> bool:
    """Whether so many actuators may have done what the equations leave: it has no more directions than that.

    Controllers look like springs and dampers, or compensate gravity.
    """
    step, terms = evidence.step, evidence.terms
    left = list[Array]()
    if step is not None and step.significant.any():
        left.append(step.residual.forces / np.maximum(step.clear * step.residual.bar, 1e-300))
    elif step is not None and step.standing_out.any():
        left.append(step.local.forces[step.standing_out] / np.maximum(step.residual.scale, 1e-300))
    if terms is not None and terms.significant.any():
        left.append(terms.residual / np.maximum(CLEAR * terms.precision, 1e-300))
    return all(
        np.sum(np.linalg.svd(x, compute_uv=False) > math.sqrt(len(x))) <= count for x in left
    )


def _accused(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """The findings with what explains the residual as causes: small, it was a note; the energy says more."""
    causes = [replace(f, weight="cause") for f in findings if _of_model(f)]
    return (*causes, *(f for f in findings if not _of_model(f)))


def _of_model(finding: Finding) -> bool:
    """Whether it names a change of the model, not of the log."""
    return finding.kind in PREFERENCE and finding.kind not in OF_THE_LOG


def small_but_real(measures: Measures, evidence: Evidence) -> list[Finding]:
    """What is within the tolerance, and yet no chance: a residual beyond its error bar."""
    step, terms = evidence.step, evidence.terms
    energy = measures.left / measures.beside if measures.beside > 0.0 else 0.0
    if terms is not None and terms.significant.any():
        k = int(np.argmax(np.where(terms.significant, terms.relative, 0.0)))
        bar = CLEAR * float(terms.precision[k]) + (0.0 if terms.doubt is None else terms.doubt[k])
        if terms.relative[k] > measures.tolerance:
            return []
        return [
            Finding(
                "small-but-real",
                f"the equations at the samples have a residual of {percent(terms.relative[k])} of the "
                f"terms of {terms.speeds[k]!r}: within the tolerance, but {terms.size[k] / bar:.2g} times "
                f"its error bar",
                f"|ΔC| {percent(energy)} of the energy",
                "See the notes for possible causes; strict=True makes it count",
                "note",
                terms.speeds[k],
            )
        ]
    unlike = any(f.kind == "not-reproducible" for f in evidence.findings)
    if step is None or unlike or not step.significant.any() or beyond(step, measures.tolerance):
        return []
    r = step.residual
    k = int(np.argmax(np.where(step.significant, r.ratio, 0.0)))
    return [
        Finding(
            "small-but-real",
            f"the equations have a residual of {percent(r.relative[k])} of the terms of "
            f"{step.speeds[k]!r}: within the tolerance, but {r.ratio[k]:.2g} times its error bar",
            f"|ΔC| {percent(energy)} of the energy; an integrator may leave "
            f"{percent(r.bar[k] / r.scale[k])} at most",
            "See the notes for possible causes; strict=True makes it count",
            "note",
            step.speeds[k],
        )
    ]


def _hides(step: OneStep) -> float:
    """Energy (J) that a mistake may have done in the time of the log."""
    return step.residual.hidden + (step.residual.spent if step.significant.any() else 0.0)


def _steps(step: OneStep | None) -> str:
    """What the one-step test says."""
    if step is None:
        return ""
    if step.closes and step.scheme is not None:
        several = f"one step of several methods ({', '.join(step.scheme.among[:FEW])})"
        by = f"a step of {step.scheme.name}" if step.scheme.name else several
        few = step.by_scheme()
        out = 0 if few is None else int(few.unclosed.sum())
        but = f" but {out}" if out else ""
        return (
            f"Each of {step.rows} rows{but} follows from the previous one by {by}, to "
            f"{max(step.scheme.defect, 1e-16):.1g} of the accelerations: the motion obeys the model's "
            f"equations"
        )
    r = step.residual
    k = int(np.argmax(np.where(step.significant, r.relative, 0.0)))
    if step.known_but_for_causes and step.scheme is not None:
        by = f"a step of {step.scheme.name}" if step.scheme.name else "one step"
        return (
            f"Each of {len(r.t)} rows follows from the previous one by {by}, except for "
            f"{percent(r.relative[k])} of the terms of {step.speeds[k]!r}; all but "
            f"{percent(1.0 / r.ratio[k])} of that has one cause"
        )
    if not step.significant.any():
        k = int(np.argmax(r.bar / r.scale))
        return (
            f"Over {step.rows} rows, each follows from the previous one as far as an integrator, the "
            f"digits of the log and the unknown motion between rows permit: "
            f"{percent(r.bar[k] / r.scale[k])} of the terms "
            f"({step.speeds[k]})"
        )
    return (
        f"Over {step.rows} rows, the next does not follow from the previous one by the model's equations: "
        f"{percent(r.relative[k])} of the terms of {step.speeds[k]!r} remain, {r.ratio[k]:.2g} "
        f"times what any integrator, the digits and the noise can explain"
    )


def _open(step: OneStep) -> str:
    return (
        "No known cause explains the residual from row to row, and the integrator is unknown: log every "
        "step, with more digits"
    )


def _by_steps(m: Measures) -> str:
    if m.noise > HALF * m.bar:
        return (
            f"With the digits of the log and the noise on it the energy is known only to ± {m.bar:.2g} J; "
            f"the verdict rests on the test from row to row"
        )
    return (
        f"At {1.0 / m.spacing:.4g} Hz the energy is known only to ± {m.bar:.2g} J; the verdict rests on "
        f"the test from row to row"
    )


def _balance(m: Measures) -> str:
    share = m.left / m.beside if m.beside > 0.0 else 0.0
    what = f"{m.energy_exchanged:.4g} J exchanged"
    if m.beside < m.energy_exchanged:
        what = f"{m.beside:.4g} J held by the system, of {what}"
    return (
        f"Largest |ΔC| {m.left:.3g} J ± {m.bar:.2g} J ({m.method}), {percent(share)} of the {what}; the "
        f"tolerance is {100 * m.tolerance:g} %"
    )


def _equations(terms: EquationTerms | None, step: OneStep | None) -> str:
    if terms is None:
        if step is not None:
            return ""
        return "The equations of motion were not tested at the samples: there are no measured accelerations"
    if not terms.significant.any():
        worst = float(terms.relative.max(initial=0.0))
        if not worst:
            return f"At {len(terms.t)} samples the equations of motion hold to rounding"
        return (
            f"At {len(terms.t)} samples the equations of motion hold to {worst:.1g} of their terms"
        )
    k = int(np.argmax(np.where(terms.significant, terms.relative, 0.0)))
    above = terms.size[k] / terms.precision[k]
    return (
        f"At {len(terms.t)} samples the equations of motion have a residual of up to "
        f"{percent(terms.relative[k])} of "
        f"their terms ({terms.speeds[k]}), {above:.2g} times what the log's precision explains"
    )


def _idle(m: Measures) -> str:
    return (
        f"Hardly any energy is exchanged ({m.energy_exchanged:.3g} J), so the kinetic energy is the scale: "
        f"largest |ΔC| {m.left:.3g} J ± {m.bar:.2g} J ({m.method}) of {m.kinetic:.4g} J; the tolerance is "
        f"{100 * m.tolerance:g} %"
    )


def _missing_rows(outside: Measures) -> str:
    return (
        "Unresolved because rows are missing (see the gap below): what happened there is unknown, and "
        f"between gaps the energy error is at most {outside.left:.3g} J ± {outside.bar:.2g} J"
    )


def _sampling(m: Measures) -> str:
    """Which sampling rate, or how much less noise, would bring the error bar to where it decides."""
    if m.noise > HALF * m.bar:
        return (
            f"Unresolved because the digits of the log and the noise on it leave the energy known to ± "
            f"{m.bar:.2g} J, {m.bar / m.allowed:.2g} times the tolerance: log with more digits, or less noise"
        )
    order = min(max(m.order, 1.0), 8.0)
    if m.bar > m.allowed:
        wanted = m.allowed
        now = f"the error bar of the samples dominates at {1.0 / m.spacing:.4g} Hz"
    else:
        wanted = max(m.left - m.allowed, 0.1 * m.bar)
        now = f"the energy error exceeds the tolerance by less than its error bar at {1.0 / m.spacing:.4g} Hz"
    # What was held does not fall with the spacing; a whole order is counted on.
    excess = max(m.bar - m.held, 0.0) / max(wanted - m.held, 0.01 * wanted)
    rate = max(excess, 1.0) ** (1.0 / math.floor(order)) / m.spacing
    rate = float(f"{rate:.2g}") if rate < 1e4 else float(f"{rate:.1g}")
    fewer = m.step is not None and m.spacing > 1.5 * m.step
    if m.step is not None and fewer and (rate >= 0.9 / m.step or 2.0 * m.held > m.bar):
        advice = f"log every step of the simulator ({1.0 / m.step:.4g} Hz)"
    elif m.step is not None and not fewer:
        advice = "every step is logged already: take a smaller step"
        advice += ", or work='discrete' to check the bookkeeping" if m.method == "samples" else ""
    else:
        advice = f"sample at about {rate:g} Hz or more"
    return f"Unresolved because {now} (it falls with order {order:.1f}): {advice}"


def _slight(m: Measures) -> tuple[str, ...]:
    if m.left > m.allowed:
        return ()
    return ("The energy error that it causes is within the tolerance",)


def _smaller_step(m: Measures) -> str:
    if m.step is None:
        return "Use a smaller step, or a method of higher order"
    return f"The step was {m.step:g} s: use a smaller one, or a method of higher order"
