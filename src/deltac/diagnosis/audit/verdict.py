"""From the inference to a verdict: probabilities of joules against the tolerance.

A mistake in the equations counts where more energy flows through it than the tolerance allows, the
integrator where its joules exceed it. Both have error bars, so that each verdict has a probability; one that
is not probable enough is `unresolved`, with what would decide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import expit, ndtr

from deltac.arrays import Array
from deltac.diagnosis.causes.causes import PREFERENCE
from deltac.diagnosis.explain.result import Explanation
from deltac.diagnosis.inference.attribution import Attribution
from deltac.diagnosis.inference.flow import FORCES
from deltac.diagnosis.inference.hypotheses import CERTAIN
from deltac.diagnosis.inference.inference import OF_THE_LOG, Inference
from deltac.diagnosis.verdict import NOTHING, Confidence, Finding, Kind, Verdict, percent
from deltac.energy import Ledger
from deltac.results import HEADINGS
from deltac.trajectories import Trajectory
from deltac.trajectories.trajectory import INTERPOLATED, ROWS

PROBABLE: dict[Confidence, float] = {"high": 0.99, "medium": 0.9}
"""Probability from which on a verdict is told with that confidence; below the last it is `unresolved`."""

OF_INERTIA = ("body-inertia", "body-mass", "body-moments", "body-moment", "body-tensor")
"""Causes that no controlled actuator looks like whose force is not in the log."""


MISTAKE = 0.01
"""Prior standard deviation of an error's energy, as a fraction of the energy exchanged: masses, lengths and
dampers are rarely known to better than a per cent."""

MOST = 0.9
"""Share of what is left that terms of a model must explain to be a mistake without a name."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a verdict rests on.

    Attributes:
        run, ledger: the log and its balance; `function` is the testing function.
        inference: what its rows say; None where nothing was inferred.
        attribution: ΔC in joules; None likewise.
        explanation: the causes in words.
        findings: what was noticed besides.
        tolerance: accepted error as a fraction of the energy that the system has.
        guessed: whether the reading of the log was guessed.
    """

    run: Trajectory
    ledger: Ledger
    function: str
    inference: Inference | None
    attribution: Attribution | None
    explanation: Explanation | None
    findings: tuple[Finding, ...]
    tolerance: float
    guessed: bool = False

    # --- energies ---

    @property
    def allowed(self) -> float:
        """The accepted energy error, J."""
        return self.tolerance * self.ledger.reference_energy

    @property
    def allowed_flow(self) -> float:
        """The energy that may flow through a mistake, J: it grows with what is exchanged."""
        return self.tolerance * max(self.ledger.energy_exchanged, self.ledger.reference_energy)

    @cached_property
    def energy_error(self) -> tuple[float, float]:
        """Largest |ΔC|, corrections included, and its error bar, J."""
        error = np.abs(self.ledger.uncorrected(self.function))
        return float(error.max()), float(self.ledger.error_bar[self.function].max())

    @property
    def rests(self) -> bool:
        """Whether the energy exchanged is rounding."""
        ledger = self.ledger
        size = float(ledger.kinetic.max() + np.abs(ledger.potential_energy).max(initial=0.0))
        return ledger.energy_exchanged <= NOTHING * max(size, NOTHING)

    # --- probabilities ---

    @cached_property
    def mistake(self) -> tuple[float, float]:
        """Probabilities of a mistake at all, and of one through which more flows than is allowed."""
        inference = self.inference
        if inference is None:
            return 0.0, 0.0
        allowed = self.allowed_flow
        there, beyond = 0.0, 0.0
        best = inference.posterior.best
        # Of a log that is not yet right, what explains the rest accuses nobody.
        of_log = [c.kind in OF_THE_LOG for c in best.chosen]
        slip = float(inference.exchanged[of_log].max(initial=0.0))
        for c, odds, joules, error in zip(
            best.chosen, best.each, inference.exchanged, inference.exchanged_error, strict=True
        ):
            if c.kind not in OF_THE_LOG and joules > slip:
                p = float(expit(odds))
                there = max(there, p)
                beyond = max(beyond, p * float(ndtr((joules - allowed) / max(error, 1e-300))))
        if self.unnamed and not slip:
            p = float(expit(inference.generic.log_odds - CERTAIN))
            there, beyond = max(there, p), max(beyond, p)
        if self.intermittent:
            there = beyond = max(beyond, float(expit(inference.intermittent[0])))
        return there, beyond

    @property
    def unnamed(self) -> bool:
        """Whether what is left is of terms of a model, beyond what is allowed, and of no few of them."""
        generic = self.inference.generic if self.inference is not None else None
        return (
            generic is not None
            and not self.smoothed
            and generic.log_odds > CERTAIN
            and generic.exchanged > self.allowed_flow
            and generic.explained > MOST
        )

    @property
    def smoothed(self) -> bool:
        """Whether rows were made of others, by a filter, an interpolant, or as rates of coordinates.

        They depart from the equations as small terms of the state do.
        """
        provenance = self.run.provenance
        made = provenance.notes.get(ROWS) == INTERPOLATED or "u" in provenance.derived
        return made or (self.inference is not None and self.inference.filter is not None)

    @cached_property
    def intermittent(self) -> bool:
        """Whether something acts from time to time that exchanges more than is allowed."""
        inference = self.inference
        if inference is None or not inference.intermittent[0] > CERTAIN:
            return False
        active = inference.intermittent[1]
        joules = np.abs(inference.gradient * inference.residual)[active].sum() * inference.whole
        return bool(joules > self.allowed_flow)

    @cached_property
    def integrator(self) -> float:
        """Probability that the integrator's joules exceed what is allowed."""
        share = self.attribution.integrator if self.attribution is not None else None
        return 0.0 if share is None else float(self._beyond(share.curve, share.curve_error).max())

    @cached_property
    def hidden(self) -> float:
        """Probability that a mistake beyond what is allowed is hidden in what the log cannot tell.

        A mistake that may be there is any of those of one number, none of them seen.
        """
        if self.inference is None or not self.inference.unseen:  # the balance speaks alone
            return 0.0
        error = np.array(list(self.inference.unseen.values()))
        return float(np.mean(self._beyond(np.zeros_like(error), error)))

    def _beyond(self, joules: Array, error: Array) -> Array:
        """Probabilities that errors of energies known to standard errors exceed what is allowed.

        A spike-and-slab posterior: an error is absent or present with equal prior probability, and its energy
        is N(0, S²) J if it is present.
        """
        size = np.maximum(MISTAKE * self.ledger.energy_exchanged, np.abs(joules)) + 1e-300
        error = np.clip(error, 1e-12 * size, 1e6 * size)
        share = 1.0 / (1.0 + (error / size) ** 2)
        mean, deviation = share * joules, np.sqrt(share) * error
        odds = np.log(deviation / size) + 0.5 * share * (joules / error) ** 2
        beyond = [ndtr((sign * mean - self.allowed) / deviation) for sign in (1.0, -1.0)]
        return np.asarray(expit(odds) * (beyond[0] + beyond[1]))

    @cached_property
    def unexplained(self) -> float:
        """Probability that what nothing explains matters."""
        if self.inference is None:
            left, bar = self.energy_error
            return 1.0 if left > self.allowed else float(bar > self.allowed)
        return float(self.inference.unexplained > self.allowed)

    @cached_property
    def odds(self) -> dict[Kind, float]:
        """Probabilities of the four verdicts; they add up to one."""
        if self.rests or self.doubts:
            return {
                "consistent": 0.0,
                "integration-error": 0.0,
                "equation-error": 0.0,
                "unresolved": 1.0,
            }
        wrong = max(self.mistake[1], 1.0 if self.certain else 0.0)
        unknown = max(self.unexplained, self.hidden)
        if self.lacking and wrong > 0.0 and not self.certain:
            unknown, wrong = wrong, 0.0
        # A mistake that may be hidden acquits no integrator; what nothing explains may be anybody's.
        right = 1.0 - wrong
        blamed = right * (1.0 - min(unknown, self.unexplained)) * self.integrator
        consistent = right * (1.0 - unknown) * (1.0 - self.integrator)
        return {
            "consistent": consistent,
            "integration-error": blamed,
            "equation-error": wrong,
            "unresolved": max(right - blamed - consistent, 0.0),
        }

    # --- what else is known ---

    @property
    def doubts(self) -> list[Finding]:
        """What the log contradicts itself in."""
        return [f for f in self.findings if f.weight == "doubt"]

    @property
    def certain(self) -> list[Finding]:
        """Causes that are known without an inference: channels, laws of joints, constraints."""
        return [f for f in self.findings if f.weight == "cause" and f.kind != "constraint-drift"]

    @property
    def lacking(self) -> Finding | None:
        """Forces of the model's file that the log lacks, where these may be what is wrong."""
        found = next((f for f in self.findings if f.kind == "assumed-zero" and f.element), None)
        chosen = self.inference.posterior.best.chosen if self.inference is not None else ()
        of_inertia = chosen and all(c.kind in OF_INERTIA for c in chosen)
        return None if of_inertia else found

    @property
    def explained_by_causes(self) -> bool:
        """Whether a cause that acts all the time explains what is wrong."""
        return self.inference is not None and bool(self.inference.posterior.best.chosen)

    @property
    def impacts(self) -> Finding | None:
        """Impacts of the model of which the run does not tell."""
        return next((f for f in self.findings if f.kind == "impacts"), None)


def of_model(finding: Finding) -> bool:
    """Whether it names a change of the model, not of the log."""
    return finding.kind in PREFERENCE and finding.kind not in OF_THE_LOG


def judge(e: Evidence) -> Verdict:
    """The verdict on one log."""
    odds = e.odds
    kind = max(odds, key=lambda k: odds[k])
    # Where a model has impacts of which the log does not tell, they may be all that is wrong.
    jumps = kind == "integration-error" or (kind == "equation-error" and not e.explained_by_causes)
    if e.impacts and jumps and not e.certain:
        kind = "unresolved"
    if odds[kind] < PROBABLE["medium"]:
        kind = "unresolved"
    words: tuple[Confidence, ...] = ("high", "medium")
    confidence: Confidence = next((word for word in words if odds[kind] >= PROBABLE[word]), "low")
    findings = _findings(e, kind)
    untested = e.inference is None and kind != "unresolved"
    if (
        e.guessed or untested or any(f.kind == "small-but-real" for f in findings)
    ) and confidence == "high":
        confidence = "medium"
    return Verdict(kind, confidence, tuple(_evidence(e, kind)), findings)


def _findings(e: Evidence, kind: Kind) -> tuple[Finding, ...]:
    """All findings, causes first: those of the posterior weigh as the verdict says."""
    named = list(e.explanation.findings) if e.explanation is not None else []
    doubted = bool(named) and named[0].kind in OF_THE_LOG
    own = list[Finding]()
    for f in named:
        if f.kind in OF_THE_LOG:
            own.append(replace(f, weight="doubt" if kind == "unresolved" and doubted else "note"))
        else:
            own.append(replace(f, weight="cause" if kind == "equation-error" else "note"))
    if e.intermittent and e.inference is not None:
        own.append(_missing_contact(e, e.inference, kind))
    departing = _departing_equations(e) if kind == "equation-error" else None
    if departing is not None:
        own.append(departing)
    small = kind != "equation-error" and e.mistake[1] < 1.0 - PROBABLE["medium"]
    if small and not e.smoothed and e.mistake[0] > PROBABLE["high"] and any(map(of_model, named)):
        own.append(_small(e, next(filter(of_model, named))))
    weights = list(HEADINGS)
    everything = [*own, *e.findings]
    return tuple(
        sorted(everything, key=lambda f: (weights.index(f.weight), f.kind == "constraint-drift"))
    )


def _small(e: Evidence, cause: Finding) -> Finding:
    assert e.inference is not None
    joules = float(e.inference.exchanged.max(initial=0.0))
    share = joules / e.ledger.energy_exchanged if e.ledger.energy_exchanged > 0.0 else 0.0
    return Finding(
        "small-but-real",
        f"a mistake in the equations is real, though only {percent(share)} of the energy exchanged flows "
        "through it",
        f"{joules:.3g} J; log odds {max(e.inference.posterior.best.each):.3g}",
        "See the notes for its cause; strict=True makes it count",
        element=cause.element,
    )


def _departing_equations(e: Evidence) -> Finding | None:
    """The equations whose momentum functions leave their bars by more than the tolerance."""
    momenta, exchanged = e.ledger.momenta(), e.ledger.momentum_exchanged
    beyond = {
        n: m["delta_p"] - m["error_bar"] - e.tolerance * exchanged[n] for n, m in momenta.items()
    }
    names = sorted((n for n in momenta if beyond[n] > 0.0), key=lambda n: -momenta[n]["relative"])
    if not names:
        return None
    sizes = ", ".join(
        f"{momenta[n]['delta_p']:.3g} ± {momenta[n]['error_bar']:.1g} of {n!r}"
        for n in names[:NAMED]
    )
    rest = [momenta[n]["delta_p"] for n in momenta if n not in names]
    others = f"; at most {max(rest):.2g} of the others" if rest else ""
    return Finding(
        "equation-departs",
        f"the equation{'s' if len(names) > 1 else ''} of {', '.join(map(repr, names[:NAMED]))} "
        f"{'do' if len(names) > 1 else 'does'} not hold: no force of the model makes up for its momentum",
        f"largest |ΔP| in kg, m, s: {sizes}{others}",
        "",
        element=names[0],
    )


NAMED = 3
"""Equations that are named at most."""


def _missing_contact(e: Evidence, inference: Inference, kind: Kind) -> Finding:
    active, n = inference.intermittent[1], inference.model.n
    size = np.abs(inference.residual[:, n:] / inference.log.intervals.h)
    k = int(np.argmax(size[active].max(axis=0)))
    speed = inference.model.mechanism.speeds[int(inference.model.mechanism.free.u[k])].name
    times = ", ".join(f"{t:.4g}" for t in inference.log.intervals.end.t[active][:3])
    return Finding(
        "missing-contact",
        "something acts from time to time that is neither in the model nor in the log",
        f"in {percent(float(active.mean()))} of the steps the next row does not follow from the previous one "
        f"(near t = {times} s), most of all {speed!r}",
        "Log the forces of all contacts and limits",
        "cause" if kind == "equation-error" else "note",
        speed,
    )


# --- the evidence in sentences -------------------------------------------------------------------


def _evidence(e: Evidence, kind: Kind) -> list[str]:
    if e.doubts:
        named = ", ".join(dict.fromkeys(f.kind for f in e.doubts))
        return [f"The log contradicts itself ({named}); correct it first"]
    if e.rests:
        return [
            f"Almost nothing moves: the energy exchanged, {e.ledger.energy_exchanged:.3g} J, is at rounding "
            "level. Use a run in which energy flows"
        ]
    said = [_balance(e)]
    if e.inference is None:
        said.append(
            "The equations of motion were not tested: too few rows follow each other, or the model's motion "
            "leaves all bounds between them"
        )
    else:
        said += [_shares(e), *_rows(e, e.inference)]
    if kind == "integration-error":
        step = e.run.provenance.step
        at = f"The step was {step:g} s: use" if step else "Use"
        said.append(f"{at} a smaller one, or a method of higher order")
    if kind == "unresolved":
        said.append(_undecided(e))
    return said


def _balance(e: Evidence) -> str:
    left, bar = e.energy_error
    ledger = e.ledger
    share = left / ledger.reference_energy if ledger.reference_energy > 0.0 else 0.0
    what = f"{ledger.reference_energy:.4g} J that the system has ({ledger.energy_exchanged:.4g} J exchanged)"
    return (
        f"Largest |ΔC| {left:.3g} J ± {bar:.2g} J ({e.ledger.method}), {percent(share)} of the {what}; the "
        f"tolerance is {100 * e.tolerance:g} %"
    )


def _shares(e: Evidence) -> str:
    a = e.attribution
    assert a is not None
    parts = (
        (a.integrator, "the integrator"),
        (a.equations, "mistakes in the equations"),
        (a.log, "the log"),
    )
    return "ΔC at the end: " + ", ".join(
        f"{s.energy:.3g} ± {s.error:.2g} J of {name}" for s, name in parts
    )


def _rows(e: Evidence, inference: Inference) -> list[str]:
    said = []
    best, integrator = inference.posterior.best, inference.integrator
    error, noise = inference.relative
    worst = int(np.argmax(error))
    speed = inference.model.mechanism.speeds[int(inference.model.mechanism.free.u[worst])].name
    rows = f"Over {len(inference.w)} intervals"
    if inference.methods:
        said.append(
            f"{rows}, each row follows from the one before by a known step; {integrator.sentence}"
        )
    else:
        said.append(
            f"{rows}, rows depart from the model's motion by {percent(float(error[worst]))} of the changes "
            f"of {speed!r}; noise accounts for {percent(float(noise[worst]))}; {integrator.sentence}"
        )
    if best.chosen:
        each = zip(best.chosen, best.each, strict=True)
        odds = ", ".join(f"{c.kind} {c.element}: {x:.3g}" for c, x in each)
        said.append(f"Log odds of causes against none: {odds}")
    elif e.unnamed:
        said.append(
            "What is left depends on the state as terms of a model do (log odds "
            f"{inference.generic.log_odds:.3g}), and no few causes explain it"
        )
    held = [kind for kind in dict.fromkeys(inference.forces) if FORCES[kind][1] == 0.0]
    if held:
        said.append(
            f"Logged forces act from row to row as {' or '.join(held)} values, by likelihood"
        )
    return said


def _undecided(e: Evidence) -> str:
    """What would decide."""
    inference = e.inference
    if e.lacking is not None and e.mistake[1] > 0.0:
        return f"What is missing may be forces that the log lacks: {e.lacking.evidence}"
    if e.impacts is not None and e.mistake[1] > 0.0:
        return str(e.impacts)
    if inference is None:
        return "Log more rows, or smaller steps, with speeds and all forces"
    if e.unexplained > 0.5:
        return (
            f"{inference.unexplained:.3g} J are of no integrator, no known cause, no noise: log every step "
            "with all forces, and accelerations at the same instants"
        )
    if e.hidden > 1.0 - PROBABLE["medium"]:
        name, joules = max(inference.unseen.items(), key=lambda item: item[1])
        times = min(2.0 * joules / max(e.allowed, 1e-300), 1e6)
        rows = int(np.ceil(times**2))
        return (
            f"{name} may hide {2.0 * joules:.2g} J, {times:.2g} times what is allowed: "
            f"log with {np.log10(max(times, 1.01)):.1f} more digits, {rows} times as many rows, or "
            "accelerations, or excite it"
        )
    bar = e.attribution.integrator.largest[1] if e.attribution is not None else 0.0
    return (
        f"The integrator's share is known to ± {bar:.2g} J, {e.allowed:.2g} J are allowed; log every step "
        "with more digits"
    )
