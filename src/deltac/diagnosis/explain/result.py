"""What was found, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from deltac.arrays import HALF_DIGITS, Array
from deltac.diagnosis.causes.causes import KINDS, SLIPPED, Candidate, other_unit
from deltac.diagnosis.verdict import Finding
from deltac.mechanism.mechanism import Mechanism
from deltac.results import SHOWN, Report, Section, Table, fraction


def sentence(mechanism: Mechanism, c: Candidate, theta: Array, error: Array) -> str:
    """One cause with its numbers, as what the run has and the model does not."""
    scale = 1.0
    if c.kind == "gravity":  # a factor, told as what it makes of g
        scale = float(np.linalg.norm([mechanism.number(x) for x in mechanism.gravity]))
    base, value, error = scale * c.base, scale * (c.base + theta), scale * error
    numbers = [_number(float(v), float(e)) for v, e in zip(value, error)]
    shown, bases = ", ".join(numbers), ", ".join(f"{x:.6g}" for x in base)
    factor = float(value[0])
    times = f"{shown} times the model's in the run{' (of the other sign)' * (factor < 0.0)}"
    side = ""
    if c.touching is not None:
        above = theta[1] - theta[0] * c.touching[1] < 0.0
        side = f"{'above' if above else 'below'} {theta[1] / theta[0]:.4g}"
    return c.words.format(
        element=f"`{c.element}`",
        shown=shown,
        several=f"({shown})" if c.size > 1 else shown,
        numbers=numbers,
        base=f"{base[0]:.6g}",
        bases=f"({bases})" if c.size > 1 else bases,
        unit=c.units[0],
        units=c.units,
        axes=", ".join(c.names),
        origin=c.origin,
        more=_more(factor),
        times="missing in the run" if abs(factor) < SLIPPED else times,
        acts="does not act in the run:" if abs(factor) < 3.0 * error[0] else "acts with",
        where=" and ".join(name.removeprefix("stiffness ") for name in c.names),
        side=side,
    )


def _more(factor: float) -> str:
    if other_unit(np.array(factor)):
        return ", the factor between two units"
    percent = 100.0 * abs(factor - 1.0)
    if percent < 1e-4 or factor <= 0.0:
        return ""
    return f": {percent:.3g} % {'larger' if factor > 1.0 else 'smaller'}"


def _number(value: float, error: float) -> str:
    if abs(value) < error:
        return f"0{_error(1.0, error)}"
    return f"{value:.{_digits(value, error)}g}{_error(value, error)}"


def _digits(value: float, error: float) -> int:
    if not value or not np.isfinite(error) or error <= 0.0:
        return 6
    return int(np.clip(np.ceil(np.log10(abs(value) / error)) + 1, 2, 7))


def _error(value: float, error: float) -> str:
    return "" if error <= HALF_DIGITS * abs(value) else f" ± {error:.2g}"


# --- what an explanation holds -------------------------------------------------------------------

Outcome = Literal["nothing", "explained", "ambiguous", "unexplained", "doubtful"]
Form = Literal["samples", "steps"]


@dataclass(frozen=True)
class Cause:
    """A change of the model that would explain the residual.

    kind, element   what, and of which body, joint or channel; "gravity", "body-mass", "missing-damper", …
    values, errors  its numbers with their standard errors: what the run has
    names, units    of these
    model           what the model has in their place
    share           of the squared residual that this cause alone explains of what the others leave
    sentence        all of it in words
    log_odds        against the model without it, natural logarithm
    energy          what it adds to ΔC by the end of the log, J
    exchanged       the energy that flows through the mistake, without sign, J
    """

    kind: str
    element: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    model: tuple[float, ...]
    share: float
    sentence: str
    log_odds: float = 0.0
    energy: float = 0.0
    exchanged: float = 0.0

    @property
    def odds(self) -> float:
        """Odds against the model without it; at most 1e300."""
        return float(np.exp(min(self.log_odds, 690.0)))

    @property
    def size(self) -> float:
        """Its (first) number in the run."""
        return self.values[0]

    @property
    def size_error(self) -> float:
        """The standard error of that."""
        return self.errors[0]

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True, repr=False)
class Explanation(Report, also=("sentence",)):
    """What explains the residual F_r + F*_r of a log.

    Attributes:
        kind: "nothing" to explain; "explained"; "ambiguous", where other causes fit equally well;
            "unexplained" by the known causes; or "doubtful", where the log must be corrected first.
        causes: the fewest that explain it, largest first.
        explained: share of the squared residual, noise excluded, that they explain.
        alternatives: other sets of causes that fit the log equally well.
        separating: a motion that would distinguish them, or the statement that none does.
        unseen: elements whose masses, inertias or channels the log hardly excites.
        form: "samples", with measured accelerations; "steps", of each row from the one before.
        residual: the largest unexplained change of a speed from row to row, as a share of its changes;
            NaN where nothing was inferred.
        noise: the part of it that the log's noise accounts for, as a share likewise.
        samples: how many samples or intervals were used.
        reasons: findings of the audit in place of causes or beside them: doubts of the log, channels that
            differ from the model's, forces that the log lacks.
        notes: what the log's forces hide: channels that the model does not have.
    """

    kind: Outcome
    causes: tuple[Cause, ...] = ()
    explained: float = 0.0
    alternatives: tuple[tuple[Cause, ...], ...] = ()
    separating: str = ""
    unseen: tuple[str, ...] = ()
    form: Form = "steps"
    residual: float = math.nan
    noise: float = math.nan
    samples: int = 0
    reasons: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The outcome in a sentence or two."""
        return ". Note: ".join((self._outcome, *self.notes))

    @property
    def _outcome(self) -> str:
        reasons = "; ".join(f"{f.what} ({f.evidence})" for f in self.reasons)
        text = reasons[:1].upper() + reasons[1:]
        rows = f"{fraction(self.residual)} of the changes from row to row ({fraction(self.noise)} is noise)"
        if self.kind == "doubtful":
            return f"The log is to be corrected before its residual can be explained: {reasons}"
        if self.kind == "nothing":
            return f"There is nothing to explain: the equations of motion leave {rows}"
        if self.kind == "unexplained":
            certainty = (
                f"No small set of known causes explains what the equations of motion leave, {rows}"
            )
            return ". ".join(filter(None, (certainty, text)))
        if not self.causes:
            return f"{text}. With the forces as logged, the equations hold: they leave {rows}"
        sentence = "; ".join(c.sentence for c in self.causes)
        sentence = f"{sentence[:1].upper()}{sentence[1:]}"
        if not any(c.share for c in self.causes):
            return f"{sentence}. With the forces as logged, the equations hold: they leave {rows}"
        that = "Together that" if len(self.causes) > 1 else "That"
        sentence = f"{sentence}. {that} explains {percent(self.explained)} of the residual"
        if self.alternatives:
            sentence += f". These explain the log equally well: {_listed(self.alternatives)}"
            sentence += f". {self.separating}" if self.separating else ""
        return f"{sentence}. Beside that: {reasons}" if reasons else sentence

    @property
    def exit_code(self) -> int:
        """Exit code: 0 nothing to explain, 1 a cause explains the residual, 3 none does, or several do."""
        return {"nothing": 0, "explained": 1}.get(self.kind, 3)

    def summary(self) -> str:
        """The outcome in a sentence or two."""
        return self.sentence

    def sections(self) -> Iterator[Section]:
        """The outcome, notes, what was not seen, and the causes with their numbers."""
        kind = "" if self.kind in ("nothing", "unexplained", "doubtful") else f"{self.kind}. "
        yield f"{kind}{self._outcome}."
        yield from (f"Note: {note}." for note in self.notes)
        if self.unseen:
            shown = ", ".join(self.unseen[:SHOWN]) + (", …" if len(self.unseen) > SHOWN else "")
            yield f"Not observable in this log: {shown}."
        if self.causes:
            heads = ("cause", "of", "in the run", "±", "in the model", "unit", "explains")
            yield Table(heads, self.rows())

    def rows(self) -> tuple[tuple[str, ...], ...]:
        """Cause, element, value in the run, its error, value in the model, unit, share; as text."""
        return tuple(
            (
                c.kind if k == 0 else "",
                c.element if k == 0 else "",
                f"{name} {c.values[k]:.6g}",
                f"{c.errors[k]:.2g}",
                f"{c.model[k]:.6g}",
                c.units[k],
                percent(c.share) if k == 0 else "",
            )
            for c in self.causes
            for k, name in enumerate(c.names)
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The causes as findings of an audit; none where the residual is not explained."""
        if self.kind not in ("explained", "ambiguous"):
            return ()
        explains = f"explains {percent(self.explained)} of the residual of the equations of motion"
        if len(self.causes) > 1:
            explains = (
                f"together these explain {percent(self.explained)} of the residual of the equations"
            )
        if self.alternatives:
            explains += ", and so do the others as far as this log tells"
            explains += f". {self.separating}" if self.separating else ""
        findings = []
        for c in self.causes:
            equals = self._in_place_of(c)
            others = tuple(dict.fromkeys((x.kind, x.element) for some in equals for x in some))
            what = f"one of these: {c.sentence}; or {_listed(equals)}" if equals else c.sentence
            numbers = c.values[0], c.errors[0]
            do = KINDS[c.kind].remedy
            findings.append(
                Finding(c.kind, what, explains, do, "cause", c.element, *numbers, others)
            )
        return tuple(findings)

    def _in_place_of(self, cause: Cause) -> list[tuple[Cause, ...]]:
        """What the alternatives have in the place of a cause, of which they have none."""
        ours = {(c.kind, c.element) for c in self.causes}
        alternatives = []
        for other in self.alternatives:
            theirs = {(c.kind, c.element) for c in other}
            if (cause.kind, cause.element) not in theirs:
                alternatives.append(tuple(c for c in other if (c.kind, c.element) not in ours))
            elif theirs == ours and len(self.causes) == 1:
                alternatives.append(other)
        return [some for some in alternatives if some]


def percent(share: float) -> str:
    """A share near one, with as many nines as it has."""
    if share == 1.0:
        return "all but noise and rounding"
    return "all but 1e-6" if share > 1 - 1e-6 else f"{100 * share:.4g} %"


def _listed(sets: Sequence[Sequence[Cause]]) -> str:
    """Sets of causes in words, and how many more there are."""
    shown = "; or ".join(" and ".join(map(str, some)) for some in sets[:SHOWN])
    return shown + (f"; or {len(sets) - SHOWN} more" if len(sets) > SHOWN else "")
