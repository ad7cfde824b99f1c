"""From the inference to a verdict: probabilities of joules against the tolerance.

A mistake in the equations counts where more energy flows through it than the tolerance allows, or where it
adds more than that to ΔC; the integrator where its joules exceed it. All have error bars, so that each
verdict has a probability; one that is not probable enough is `unresolved`, with what would decide.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import expit, ndtr

from deltac.arrays import Array
from deltac.diagnosis.causes.causes import PREFERENCE, Candidate
from deltac.diagnosis.explain.explain import explanation_of
from deltac.diagnosis.explain.result import Explanation, Outcome
from deltac.diagnosis.inference.forces import FORCES
from deltac.diagnosis.inference.hypotheses import CERTAIN
from deltac.diagnosis.inference.integrators import NEAR
from deltac.diagnosis.inference.result import (
    KNOWN,
    OF_INERTIA,
    OF_THE_LOG,
    SLIGHT,
    Attribution,
    Inference,
    Share,
)
from deltac.diagnosis.verdict import Confidence, Finding, Verdict, VerdictKind, percent
from deltac.energy import Ledger
from deltac.results import HEADINGS, SHOWN
from deltac.trajectories import Trajectory
from deltac.trajectories.trajectory import INTERPOLATED, ROWS

PROBABLE: dict[Confidence, float] = {"high": 0.99, "medium": 0.9}
"""Probability from which on a verdict is told with that confidence; below the last it is `unresolved`."""


ROUND = 2.0
"""Times the tolerance, a round number, up to which joules that may be within it as well blame nobody."""

MISTAKE = 0.01
"""Prior standard deviation of an error's energy, as a fraction of the energy that the system has: masses,
lengths and dampers are rarely known to better than a per cent."""

COASTING = 1e6
"""Energy of what coasts, in units of what it exchanges."""

MOST_EXPLAINED = 0.9
"""Share of what is left that terms of a model must explain to be a mistake without a name."""

EXACT_ROWS = 1e-6
"""Noise of rows as a share of their changes below which they are as a simulator computed them."""

MOST_TIMES_AS_MANY = 100
"""Times as many rows that anyone would log."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is judged of a log: the verdict and the explanation are two views of it, and so agree.

    Attributes:
        run, ledger: the log and its balance; `function` is the testing function.
        rows: the rows that were inferred from: those of the log that follow each other.
        inference: what its rows say; None where nothing was inferred.
        attribution: ΔC in joules; None likewise.
        noticed: findings that need no inference.
        tolerance: accepted error as a fraction of the energy that the system has.
        recorded: whether the run brought the works of its own steps.
    """

    run: Trajectory
    ledger: Ledger
    function: str
    rows: Trajectory
    inference: Inference | None
    attribution: Attribution | None
    noticed: tuple[Finding, ...]
    tolerance: float
    recorded: bool = False

    # --- energies ---

    @property
    def allowed(self) -> float:
        """The accepted energy error, J."""
        return self.tolerance * self.ledger.reference_energy

    @property
    def allowed_flow(self) -> float:
        """The energy that may flow through a mistake, J: it grows with what is exchanged."""
        return self.tolerance * max(self.ledger.energy_exchanged, self.ledger.reference_energy)

    @property
    def still(self) -> bool:
        """Whether nothing moves. What coasts exchanges no energy either, but its rows tell.

        What has settled exchanges what weight takes and a floor gives back; its rows tell whether forces
        balance, and nothing of an integrator.
        """
        ledger = self.ledger
        coasts = ledger.reference_energy > COASTING * ledger.energy_exchanged
        settled = ledger.still and not self.certain and self.mistake[1] < PROBABLE["medium"]
        return settled or (ledger.at_rest and not (coasts and self.inference is not None))

    @cached_property
    def energy_error(self) -> tuple[float, float]:
        """Largest |ΔC|, corrections included, and its error bar, J."""
        error = np.abs(self.ledger.uncorrected(self.function))
        return float(error.max()), float(self.ledger.error_bar[self.function].max())

    # --- probabilities ---

    @cached_property
    def slip(self) -> float:
        """The largest energy that delays and zeros of the log exchange, J: smaller mistakes accuse nobody."""
        if self.inference is None:
            return 0.0
        of_log = [c.kind in OF_THE_LOG for c in self.inference.posterior.best.chosen]
        return float(self.inference.exchanged[of_log].max(initial=0.0))

    @cached_property
    def mistake(self) -> tuple[float, float]:
        """Probabilities of a mistake at all, and of one through which more flows than is allowed."""
        inference = self.inference
        if inference is None:
            return 0.0, 0.0
        causes = [
            (p, max(large, p * self.net_mistake))
            for p, large, joules in self._causes_of_equations
            if joules > self.slip
        ]
        real, intolerable = np.max([(0.0, 0.0), *causes], axis=0).tolist()
        if self.unnamed and not self.slip:
            p = float(expit(inference.generic.log_odds - CERTAIN))
            real, intolerable = max(real, p), max(intolerable, p)
        if inference.force is not None:
            real, intolerable = 1.0, float(inference.force.exchanged > self.allowed_flow)
        if self.intermittent:
            real = intolerable = max(intolerable, float(expit(inference.intermittent[0])))
        return real, intolerable

    @cached_property
    def net_mistake(self) -> float:
        """Probability that what mistakes add to ΔC is more than is allowed."""
        if self.attribution is None or not self.causes:
            return 0.0
        joules, error = self.attribution.equations.largest
        return float(ndtr((joules - self.allowed) / max(error, 1e-300)))

    @cached_property
    def doubted(self) -> float:
        """Probability of an intolerable mistake that explains the rest of a log that is not yet right."""
        causes = self._causes_of_equations
        return max((large for _, large, joules in causes if joules <= self.slip), default=0.0)

    @cached_property
    def _causes_of_equations(self) -> list[tuple[float, float, float]]:
        """Of each: probabilities that it is real, and intolerable, and the energy that it exchanges, J."""
        inference = self.inference
        if inference is None:
            return []
        best, each = inference.posterior.best, list[tuple[float, float, float]]()
        for c, odds, joules, error in zip(
            best.chosen, best.each, inference.exchanged, inference.exchanged_error, strict=True
        ):
            if c.kind not in OF_THE_LOG:
                p, beyond = float(expit(odds)), (joules - self.allowed_flow) / max(error, 1e-300)
                each.append((p, p * float(ndtr(beyond)), float(joules)))
        return each

    @property
    def unnamed(self) -> bool:
        """Whether what is left is of terms of a model, beyond what is allowed, and of no few of them."""
        generic = self.inference.generic if self.inference is not None else None
        return (
            generic is not None
            and not self.smoothed
            and generic.log_odds > CERTAIN
            and generic.exchanged > self.allowed_flow
            and generic.explained > MOST_EXPLAINED
            and self.left_flow > self.allowed_flow
        )

    @cached_property
    def left_flow(self) -> float:
        """The energy that what integrator and causes leave of the rows moves, J.

        Terms of a model may trace differences of the last digits, such as those of angles in a file.
        """
        inference = self.inference
        if inference is None:
            return 0.0
        return float(np.abs(inference.gradient * inference.residual).sum() * inference.whole)

    @property
    def smoothed(self) -> bool:
        """Whether rows were made of others, by a filter, an interpolant, or as rates of coordinates.

        They depart from the equations as small terms of the state do.
        """
        return self.filtered or "u" in self.run.provenance.derived

    @property
    def filtered(self) -> bool:
        """Whether a filter or an interpolant made the rows."""
        interpolated = self.run.provenance.notes.get(ROWS) == INTERPOLATED
        return interpolated or (self.inference is not None and self.inference.filter is not None)

    @cached_property
    def intermittent(self) -> bool:
        """Whether something acts from time to time that exchanges more than is allowed."""
        inference = self.inference
        if inference is None or not inference.intermittent[0] > CERTAIN:
            return False
        if any(f.kind == "replayed" for f in self.noticed):
            return False  # the model's own steps arrive at all rows, within their digits
        active = inference.intermittent[1]
        joules = np.abs(inference.gradient * inference.residual)[active].sum() * inference.whole
        return bool(joules > self.allowed_flow)

    @property
    def incomplete(self) -> bool:
        """Whether what looks like a mistake leaves as much that it is none; what acts now and then is one.

        Where a filter was undone, or a log leaves out impacts that the model has, only noise may be left:
        what is left of these looks like any force.
        """
        if self.inference is None:
            return False
        undone = {f.kind for f in self.noticed} & {"filtered", "impacts", "impacts-by-law"}
        if undone and self.inference.excess > KNOWN:
            return True
        return self.inference.incomplete and not self.intermittent

    @cached_property
    def integrator(self) -> float:
        """Probability that the integrator's joules exceed what is allowed."""
        return float(self._beyond(*self._largest_of_integrator))

    @cached_property
    def _largest_of_integrator(self) -> tuple[float, float]:
        """The integrator's largest joules, and their standard error by all that may be its own."""
        if self.attribution is None:
            return 0.0, 0.0
        share, error = self.attribution.integrator, self.attribution.integrator.curve_error
        scattered = self.inference is not None and self.inference.scattered
        own_works = self.recorded or bool(self.inference is not None and self.inference.methods)
        if self.ledger.method == "in-loop" and own_works and not scattered:
            # ΔC is of the steps' own works. By those of the flow the integrator has other joules, which is
            # no doubt of whose these are.
            # What mistakes may hide that nobody sees is `hidden`.
            bar = self.ledger.error_bar[self.function]
            mistakes = self.attribution.equations.curve_error if self.causes else 0.0
            disputed = self.inference.disputed if self.inference is not None else 0.0
            error = np.minimum(
                error, np.linalg.norm(np.broadcast_arrays(bar, mistakes, disputed), axis=0)
            )
        # What nothing explains may be its own, wherever it is most; so may what is left beside causes that
        # are not all.
        error = np.maximum(error, self.inference.unexplained if self.inference is not None else 0.0)
        beyond_noise = self.inference is not None and self.inference.excess > KNOWN
        incomplete = self.incomplete and beyond_noise and not self.between_rows
        if self.inference is not None and (incomplete or self.lacking):
            left = np.einsum("km,km->k", self.inference.gradient, self.inference.residual)
            net = np.abs(np.cumsum(left)).max() * self.inference.whole
            generic = self.inference.generic
            terms = generic.shift if generic.log_odds > CERTAIN else 0.0
            error = np.sqrt(error**2 + self.attribution.equations.curve**2 + net**2 + terms**2)
        # Where it is largest: of many rows one is likely to be beyond by chance.
        largest = int(np.argmax(np.abs(share.curve)))
        return float(share.curve[largest]), float(error[largest])

    @cached_property
    def hidden(self) -> float:
        """Probability that a mistake beyond what is allowed is hidden in what the log cannot tell.

        A mistake that may be there is any of those of one number, none of them seen.
        """
        if self.inference is None or not self.inference.unseen:  # the balance speaks alone
            return 0.0
        error = np.array(list(self.inference.unseen.values()))
        return float(np.mean(self._beyond(np.zeros_like(error), error)))

    def _beyond(self, joules: Array | float, error: Array | float, times: float = 1.0) -> Array:
        """Probabilities that errors of energies known to standard errors exceed `times` what is allowed.

        A spike-and-slab posterior: an error is absent or present with equal prior probability, and its energy
        is N(0, S²) J if it is present.
        """
        size = np.maximum(MISTAKE * self.ledger.reference_energy, np.abs(joules)) + 1e-300
        error = np.clip(error, 1e-12 * size, 1e6 * size)
        share = 1.0 / (1.0 + (error / size) ** 2)
        mean, deviation = share * joules, np.sqrt(share) * error
        odds = np.log(deviation / size) + 0.5 * share * (joules / error) ** 2
        allowed = times * self.allowed
        probabilities = [ndtr((sign * mean - allowed) / deviation) for sign in (1.0, -1.0)]
        return np.asarray(expit(odds) * (probabilities[0] + probabilities[1]))

    @cached_property
    def unexplained(self) -> float:
        """Probability that what nothing explains matters."""
        error, bar = self.energy_error
        if self.inference is None or self.attribution is None:  # the balance speaks alone
            return float(max(error, bar) > self.allowed)
        if self.incomplete:  # what looks like a mistake is nobody's, nor is what is left
            return max(self.mistake[1], float(self.inference.unexplained > self.allowed))
        return float(self.inference.unexplained > self.allowed and not self.between_rows)

    @property
    def between_rows(self) -> bool:
        """Whether forces may have varied between rows, which none shows, and the balance has their works."""
        varying = set(map(str, self.run.forces)) - set(map(str, self.run.provenance.held or ()))
        in_loop = self.ledger.method == "in-loop"
        return in_loop and bool(varying) and self.energy_error[0] <= self.allowed

    @cached_property
    def odds(self) -> dict[VerdictKind, float]:
        """Probabilities of the four verdicts; they add up to one."""
        return self._odds(self.integrator)

    @cached_property
    def near_tolerance(self) -> bool:
        """Whether the integrator's joules may be on either side of the tolerance, but not far beyond it."""
        joules, error = self._largest_of_integrator
        if max(self.odds.values()) >= PROBABLE["medium"] or error > self.allowed:
            return False
        far = float(self._beyond(joules, error, ROUND))
        return self._odds(far)["consistent"] >= PROBABLE["medium"]

    def _odds(self, integrator: float) -> dict[VerdictKind, float]:
        """Probabilities of the verdicts, by that of too many joules of the integrator."""
        if self.still or self.doubts:
            return {
                "consistent": 0.0,
                "integration-error": 0.0,
                "equation-error": 0.0,
                "unresolved": 1.0,
            }
        wrong = max(self.mistake[1], 1.0 if self.certain else 0.0)
        unknown = max(self.unexplained, self.hidden, self.doubted)
        if (self.lacking or self.incomplete) and wrong > 0.0 and not self.certain:
            unknown, wrong = wrong, 0.0
        # A mistake that may be hidden acquits no integrator; what nothing explains is in its bar.
        right = 1.0 - wrong
        blamed = right * integrator
        consistent = right * (1.0 - unknown) * (1.0 - integrator)
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
        return [f for f in self.noticed if f.weight == "doubt"]

    @property
    def certain(self) -> list[Finding]:
        """Causes that are known without an inference: channels, laws of joints, constraints."""
        late = any(c.kind == "late-laws" for c in self.causes)
        others = ("constraint-drift", "prescribed-departs" if late else "")
        return [f for f in self.noticed if f.weight == "cause" and f.kind not in others]

    @property
    def causes(self) -> tuple[Candidate, ...]:
        """The changes of model or log that the inference found; none where others are known to be there."""
        if self.inference is None or unattributable(self.noticed):
            return ()
        return self.inference.posterior.best.chosen

    @property
    def lacking(self) -> Finding | None:
        """Forces of the model's file that the log lacks, where these may be what is wrong."""
        absent = next((f for f in self.noticed if f.kind == "assumed-zero" and f.element), None)
        of_inertia = self.causes and all(c.kind in OF_INERTIA for c in self.causes)
        return None if of_inertia else absent

    @property
    def departing(self) -> Finding | None:
        """Rows that the model, stepped from those before, does not arrive at."""
        return next(filter(departs, self.noticed), None)

    @property
    def condition(self) -> str:
        """The assumption on which the joules of mistakes rest; empty if there is none."""
        if self.departing is not None and self.departing.kind == "replay-departs":
            return "or forces that the log lacks"
        if self.lacking is not None:
            return "if the forces that the log lacks did not act"
        return ""

    @cached_property
    def left(self) -> Array:
        """Share (n,) of each speed's changes from row to row that integrator and causes leave."""
        assert self.inference is not None
        n = self.inference.model.n
        size = [
            np.linalg.norm(x[:, n:], axis=0) for x in (self.inference.residual, self.inference.w)
        ]
        return np.asarray(self.inference.relative[0] * size[0] / (size[1] + 1e-300))

    @cached_property
    def closes(self) -> bool:
        """Whether what is left of the rows is noise, or moves less energy than is allowed."""
        inference = self.inference
        if self.departing is not None or inference is None or self.unexplained > 0.5:
            return False
        generic = inference.generic
        if inference.intermittent[0] > CERTAIN or (
            generic.log_odds > CERTAIN and generic.explained > MOST_EXPLAINED
        ):
            return False
        noise = bool((self.left <= NEAR * inference.relative[1]).all())
        return noise or self.left_flow <= self.allowed_flow

    @cached_property
    def outcome(self) -> Outcome:
        """What there is to explain, and whether that is done."""
        if self.doubts:
            return "doubtful"
        if self.causes:
            several = self.inference is not None and self.inference.posterior.alternatives
            return "ambiguous" if several or self.lacking else "explained"
        if self.certain and self.departing not in self.certain:
            return "explained"
        return "nothing" if self.closes else "unexplained"

    @cached_property
    def explanation(self) -> Explanation:
        """The causes, and what stands in their place or beside them."""
        reasons = [*self.doubts, *self.certain]
        reasons += [f for f in (self.departing,) if f is not None and f not in reasons]
        if self.lacking is not None and self.outcome != "nothing":
            reasons.append(self.lacking)
        inference = None if self.doubts else self.inference
        residual = np.nan if inference is None else float(self.left.max())
        return explanation_of(
            inference, self.rows, self.outcome, tuple(reasons), residual, bool(self.causes)
        )

    @property
    def impacts(self) -> Finding | None:
        """Impacts of the model of which the run does not tell."""
        return next((f for f in self.noticed if f.kind == "impacts"), None)

    # --- the verdict ---

    @cached_property
    def kind(self) -> VerdictKind:
        """The verdict."""
        kind = max(self.odds, key=lambda k: self.odds[k])
        kind = "consistent" if self.near_tolerance else kind
        # Where a model has impacts of which the log does not tell, they may be all that is wrong.
        jumps = kind == "integration-error" or (kind == "equation-error" and not self.causes)
        jumps |= kind == "consistent" and self.energy_error[0] > self.allowed
        if self.impacts and jumps and not self.certain:
            return "unresolved"
        sure = self.near_tolerance or self.odds[kind] >= PROBABLE["medium"]
        return kind if sure else "unresolved"

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict, in words and with all findings."""
        words: tuple[Confidence, ...] = ("high", "medium")
        odds = self.odds[self.kind]
        confidence: Confidence = next((word for word in words if odds >= PROBABLE[word]), "low")
        confidence = "medium" if self.near_tolerance else confidence
        findings = _findings(self)
        untested = self.inference is None and self.kind != "unresolved"
        small = any(f.kind == "small-but-real" for f in findings)
        guessed = bool(self.run.provenance.guessed)
        unseen = any(f.kind in ("work-unresolved", "held-forces") for f in findings)
        if (guessed or untested or small or unseen) and confidence == "high":
            confidence = "medium"
        return Verdict(self.kind, confidence, tuple(_evidence(self)), findings)


def departs(finding: Finding) -> bool:
    """Whether it says that the model, stepped from rows of the log, does not arrive at the next ones."""
    return finding.kind in ("replay-departs", "not-replayed") and finding.factor is not None


def unattributable(findings: Iterable[Finding]) -> bool:
    """Whether causes would only imitate what is known: a doubt of the log, an axis, forces that it lacks."""
    return any(
        f.weight == "doubt"
        or f.kind in ("joint-axis", "axis-sign")
        or (f.kind == "not-replayed" and departs(f))
        for f in findings
    )


def of_model(finding: Finding) -> bool:
    """Whether it names a change of the model, not of the log."""
    return finding.kind in (*PREFERENCE, "residual") and finding.kind not in OF_THE_LOG


def _findings(e: Judgement) -> tuple[Finding, ...]:
    """All findings, causes first: those of the posterior weigh as the verdict says."""
    kind, named = e.kind, list(e.explanation.findings)
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
    if kind != "equation-error" and e.inference is not None and e.inference.force is not None:
        own.append(replace(_unnamed(e), weight="note"))
    first = next(filter(of_model, own), None)
    small = kind != "equation-error" and e.mistake[1] < 1.0 - PROBABLE["medium"]
    if small and first and _clear(e) and e.mistake[0] > PROBABLE["high"]:
        own.append(_small(e, first))
    if kind == "equation-error" and not any(f.weight == "cause" for f in (*own, *e.noticed)):
        own.append(_unnamed(e))
    if kind == "unresolved":
        own.insert(0, _undecided(e))
    elif kind == "consistent" and e.inference is not None and e.inference.between > e.allowed:
        own.append(_held_forces(e, e.inference.between))
    weights = list(HEADINGS)
    everything = [*own, *e.noticed]
    return tuple(
        sorted(everything, key=lambda f: (weights.index(f.weight), f.kind == "constraint-drift"))
    )


def _unnamed(e: Judgement) -> Finding:
    """Equations that are wrong in a way without a name."""
    assert e.inference is not None
    generic, force = e.inference.generic, e.inference.force
    if force is not None:
        return Finding(
            "residual",
            f"the equation of {force.speed!r} is off by a force that no known cause explains",
            f"its changes from row to row are off by {percent(force.share)}, {force.exchanged:.3g} J flow "
            "through that, and no logged force acts there",
            "Compare the equations of model and simulator: `check_equations` tests them without a log",
            "cause",
            force.speed,
        )
    return Finding(
        "residual",
        "the residual depends on the state as model terms do, but no small set of causes explains it",
        f"{generic.exchanged:.3g} J flow through it; log odds {generic.log_odds:.3g}",
        "Compare the equations of model and simulator: `check_equations` tests them without a log",
        "cause",
    )


def _clear(e: Judgement) -> bool:
    """Whether a mistake that exchanges little stands out: of all that is left, and of the integrator's work.

    In rows with noise or few digits, another method much like the one found does what a small cause does.
    """
    inference = e.inference
    if inference is None or e.filtered or e.incomplete or inference.unnamed > SLIGHT:
        return False
    if e.attribution is None or float(inference.relative[1].max()) < EXACT_ROWS:
        return True
    return inference.flow > SLIGHT * e.attribution.integrator.largest[0]


def _small(e: Judgement, cause: Finding) -> Finding:
    assert e.inference is not None
    joules, each = e.inference.flow, e.inference.posterior.best.each
    share = joules / e.ledger.energy_exchanged if e.ledger.energy_exchanged > 0.0 else 0.0
    return Finding(
        "small-but-real",
        f"a mistake in the equations is real, though only {percent(share)} of the energy exchanged flows "
        "through it",
        f"{joules:.3g} J" + (f"; log odds {max(each):.3g}" if each else ""),
        "See the notes for its cause; strict=True makes it count",
        element=cause.element,
    )


def _held_forces(e: Judgement, between: float) -> Finding:
    return Finding(
        "held-forces",
        "the balance holds for forces that were held over each step, as controllers do",
        f"if they are functions of time, the integrator's joules are known only to ± {between:.2g} J; "
        f"{e.allowed:.2g} J are allowed",
        "Say which were: held=(…) of the log's provenance, empty for functions of time",
        factor=between / max(e.allowed, 1e-300),
    )


def _departing_equations(e: Judgement) -> Finding | None:
    """The equations whose momentum functions leave their bars by more than the tolerance."""
    momenta, exchanged = e.ledger.momenta(), e.ledger.momentum_exchanged
    excess = {
        n: m["delta_p"] - m["error_bar"] - e.tolerance * exchanged[n] for n, m in momenta.items()
    }
    names = sorted((n for n in momenta if excess[n] > 0.0), key=lambda n: -momenta[n]["relative"])
    if not names:
        return None
    sizes = ", ".join(
        f"{momenta[n]['delta_p']:.3g} ± {momenta[n]['error_bar']:.1g} of {n!r}"
        for n in names[:SHOWN]
    )
    rest = [momenta[n]["delta_p"] for n in momenta if n not in names]
    others = f"; at most {max(rest):.2g} of the others" if rest else ""
    return Finding(
        "equation-departs",
        f"the equation{'s' if len(names) > 1 else ''} of {', '.join(map(repr, names[:SHOWN]))} "
        f"{'do' if len(names) > 1 else 'does'} not hold: no force of the model makes up for its momentum",
        f"largest |ΔP| in kg, m, s: {sizes}{others}",
        "",
        element=names[0],
    )


def _missing_contact(e: Judgement, inference: Inference, kind: VerdictKind) -> Finding:
    active, n = inference.intermittent[1], inference.model.n
    size = np.abs(inference.residual[:, n:] / inference.log.intervals.h)
    k = int(np.argmax(size[active].max(axis=0)))
    speed = inference.model.mechanism.speeds[int(inference.model.of_u[k])].name
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


def _evidence(e: Judgement) -> Iterator[str]:
    if e.doubts:
        named = ", ".join(dict.fromkeys(f.kind for f in e.doubts))
        yield f"The log contradicts itself ({named}); correct it first"
        return
    if e.still:
        joules = e.ledger.energy_exchanged
        yield f"Almost nothing moves: the energy exchanged, {joules:.3g} J, is at rounding level"
        return
    yield _balance(e)
    if e.inference is None:
        yield (
            "The equations of motion were not tested: too few rows follow each other, or the model's motion "
            "leaves all bounds between them"
        )
    else:
        if e.attribution is not None:
            yield _shares(e.attribution, e.condition)
        yield from _rows(e, e.inference)
    if e.kind == "consistent" and e.near_tolerance:
        yield (
            f"The integrator's share is near the tolerance: beyond it with probability {e.integrator:.2g}, "
            f"beyond {ROUND:g} times as much with less than {1.0 - PROBABLE['medium']:.1g}"
        )
    if e.kind == "integration-error":
        step = e.run.provenance.step
        at = f"The step was {step:g} s: use a smaller one" if step else "Use a smaller step"
        yield f"{at}, or a method of higher order"
    if e.kind == "equation-error" and e.integrator > 0.5:
        yield "The integrator's share exceeds the tolerance as well"


def _balance(e: Judgement) -> str:
    error, bar = e.energy_error
    ledger = e.ledger
    share = error / ledger.reference_energy if ledger.reference_energy > 0.0 else 0.0
    what = f"{ledger.reference_energy:.4g} J that the system has ({ledger.energy_exchanged:.4g} J exchanged)"
    return (
        f"Largest |ΔC| {error:.3g} J ± {bar:.2g} J ({e.ledger.method}), {percent(share)} of the {what}; the "
        f"tolerance is {100 * e.tolerance:g} %"
    )


def parts_of(attribution: Attribution, condition: str) -> tuple[tuple[str, Share], ...]:
    """The shares of ΔC and whose they are."""
    mistakes = ", ".join(filter(None, ("mistakes in the equations", condition)))
    return (
        ("the integrator", attribution.integrator),
        (mistakes, attribution.equations),
        ("the log", attribution.log),
    )


def _shares(attribution: Attribution, condition: str) -> str:
    parts = parts_of(attribution, condition)
    return "ΔC at the end: " + "; ".join(
        f"{s.energy:.3g} ± {s.error:.2g} J of {name}" for name, s in parts
    )


def _rows(e: Judgement, inference: Inference) -> Iterator[str]:
    best, integrator = inference.posterior.best, inference.integrator
    error, noise = inference.relative
    worst = int(np.argmax(error))
    speed = inference.model.mechanism.speeds[int(inference.model.of_u[worst])].name
    count, whole = len(inference.w), len(e.run) - 1
    rows = f"Over {count} intervals" + (f" of {whole}" if count < whole else "")
    if inference.methods and e.departing is None:
        yield f"{rows}, each row follows from the one before by a known step; {integrator.sentence}"
    else:
        yield (
            f"{rows}, rows depart from the model's motion by {percent(float(error[worst]))} of the changes "
            f"of {speed!r}; noise accounts for {percent(float(noise[worst]))}; {integrator.sentence}"
        )
    if e.causes:
        each = zip(best.chosen, best.each, strict=True)
        odds = ", ".join(f"{c.kind} {c.element}: {x:.3g}" for c, x in each)
        yield f"Log odds of causes against none: {odds}"
    kinds = [kind for kind in dict.fromkeys(inference.forces) if FORCES[kind][1] == 0.0]
    if kinds and not inference.knows_stages:
        yield f"Logged forces act from row to row as {' or '.join(kinds)} values, by likelihood"


def _undecided(e: Judgement) -> Finding:
    """What would decide."""

    def finding(what: str, evidence: str, remedy: str, factor: float | None = None) -> Finding:
        return Finding("undecided", what, evidence, remedy, factor=factor)

    inference = e.inference
    if e.doubts:
        kinds = ", ".join(dict.fromkeys(f.kind for f in e.doubts))
        return finding("the log contradicts itself", kinds, "Correct the log as the doubts say")
    if e.still:
        joules = e.ledger.energy_exchanged
        return finding(
            "almost nothing moves", f"{joules:.3g} J exchanged", "Log a run in which energy flows"
        )
    if e.lacking is not None and e.departing is not None:
        return finding(
            "the forces that the log lacks are not those of the model, stepped with its controls",
            e.departing.evidence,
            "Give the model what the run had, or log the forces; replay=True (--replay) splits the energy of "
            "the difference from the integrator's",
        )
    if e.lacking is not None and e.mistake[1] > 0.0:
        return finding(
            "the forces that the log lacks may be all that is wrong", e.lacking.evidence, e.lacking.remedy
        )  # fmt: skip
    likely = max(e.mistake[1], e.integrator) > 1.0 - PROBABLE["medium"]
    if e.impacts is not None and (likely or e.energy_error[0] > e.allowed):
        return finding("impacts may be all that is wrong", e.impacts.evidence, e.impacts.remedy)
    if e.mistake[1] > 0.5 and inference is not None and e.incomplete:
        return finding(
            "the causes found leave too much unexplained that is not noise",
            f"{percent(inference.explained)} are explained; what is left has {inference.excess:.2g} times "
            "the variance of the noise",
            "Log every step with all forces, unfiltered",
        )
    if inference is None:
        return finding(
            "the equations of motion were not tested",
            f"{len(e.run)} rows",
            "Log more rows, or smaller steps, with speeds and all forces",
        )
    if e.causes and (e.doubted > 0.5 or all(c.kind in OF_THE_LOG for c in e.causes)):
        return finding(
            "the log is delayed, filtered or has another zero",
            ", ".join(f"{c.kind} {c.element}" for c in e.causes),
            "Correct the log, then audit it again",
        )
    if e.unexplained > 0.5:
        return finding(
            f"{inference.unexplained:.3g} J are of no integrator, no known cause, no noise",
            f"{e.allowed:.3g} J are allowed",
            "Log every step with all forces, and accelerations at the same instants",
            factor=inference.unexplained / max(e.allowed, 1e-300),
        )
    if e.hidden > 1.0 - PROBABLE["medium"]:
        name, joules = max(inference.unseen.items(), key=lambda item: item[1])
        times = min(2.0 * joules / max(e.allowed, 1e-300), 1e6)
        rows = int(np.ceil(times**2))
        more = f"{rows} times as many rows, " if rows <= MOST_TIMES_AS_MANY else ""
        return finding(
            f"{name} may hide {2.0 * joules:.2g} J",
            f"{times:.2g} times what is allowed",
            f"Log with {np.log10(max(times, 1.01)):.1f} more digits, {more}or accelerations, or excite it",
            factor=times,
        )
    if e.mistake[1] > 1.0 - PROBABLE["medium"]:
        return finding(
            "a mistake may exceed the tolerance, or stay within it",
            f"probability {e.mistake[1]:.2g}",
            "Log more of the motion, or with more digits; or give another tolerance",
        )
    bar = e.attribution.integrator.largest[1] if e.attribution is not None else 0.0
    if "u" in e.run.provenance.derived and e.energy_error[1] > e.allowed:
        return finding(
            "the log has no speeds of its own, and methods with different ones make these coordinates",
            f"ΔC is known to ± {e.energy_error[1]:.2g} J; {e.allowed:.2g} J are allowed",
            "Log the speeds",
            factor=e.energy_error[1] / max(e.allowed, 1e-300),
        )
    if inference.between > 0.5 * bar:
        return finding(
            "whether logged forces were held over each step decides, and the rows do not tell",
            f"± {inference.between:.2g} J of the integrator; {e.allowed:.2g} J are allowed",
            "Say which were: held=(…) of the log's provenance, empty for functions of time",
            factor=bar / max(e.allowed, 1e-300),
        )
    return finding(
        f"the integrator's share is known to ± {bar:.2g} J",
        f"{e.allowed:.2g} J are allowed",
        "Log every step with more digits",
        factor=bar / max(e.allowed, 1e-300),
    )
