"""What an explanation holds: causes with their numbers, alternatives, and words for all of it."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any, Literal

from deltac.diagnosis.explanation.equations import Form
from deltac.diagnosis.explanation.words import remedy
from deltac.diagnosis.findings import Finding

Kind = Literal["nothing", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class Cause:
    """A change of the model that would explain the residual.

    kind, element   what, and of which body, joint or channel; "gravity", "body-mass", "missing-damper", …
    values, errors  its numbers with their standard errors: what the run has
    names, units    of these
    model           what the model has in their place
    share           of the squared residual that this cause alone explains of what the others leave
    sentence        all of it in words
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

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class Explanation:
    """What explains the residual F_r + F*_r of a log.

    Attributes:
        kind: "nothing" to explain; "explained"; "ambiguous", where other causes do as well; or
            "unexplained" by the causes that are known.
        causes: the fewest that explain it, largest first.
        explained: share of the squared residual that they explain, what is noise left out.
        alternatives: other sets of causes that the log does not tell from these.
        separating: the motion that would tell them apart, or that none does.
        unseen: elements whose masses, inertias or channels the log hardly shows.
        form: "samples", with measured accelerations; "weak", from speeds over windows.
        residual: largest root mean square of an equation's residual, as a share of its terms.
        noise: what of that the noise of the log accounts for.
        samples: how many were looked at.
        notes: what the log's forces hide: channels that the model does not have.
    """

    kind: Kind
    causes: tuple[Cause, ...]
    explained: float
    alternatives: tuple[tuple[Cause, ...], ...]
    separating: str
    unseen: tuple[str, ...]
    form: Form
    residual: float
    noise: float
    samples: int
    notes: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The outcome in a sentence or two."""
        return ". Note: ".join((self._outcome, *self.notes))

    @property
    def _outcome(self) -> str:
        if self.kind == "nothing":
            return (
                f"There is nothing to explain: the equations of motion hold to {self.residual:.1g} of their "
                f"terms, and noise accounts for {self.noise:.1g}"
            )
        if self.kind == "unexplained":
            nearest = f"; the nearest is {self.causes[0]}" if self.causes else ""
            return (
                f"No few causes of those known explain the residual ({self.residual:.2g} of the terms)"
                f"{nearest}, which explains {percent(self.explained)}"
            )
        told = "; ".join(c.sentence for c in self.causes)
        told = f"{told[:1].upper()}{told[1:]}"
        if not any(c.share for c in self.causes):
            closed = f"the equations hold to {self.residual:.1g} of their terms"
            return f"{told}. With the forces as logged, {closed}"
        that = "Together that" if len(self.causes) > 1 else "That"
        said = f"{told}. {that} explains {percent(self.explained)} of the residual"
        if self.kind == "ambiguous":
            others = "; or ".join(" and ".join(map(str, other)) for other in self.alternatives[:4])
            more = len(self.alternatives) - 4
            said += f". The log explains as well: {others}"
            said += f"; or {more} more" if more > 0 else ""
            said += f". {self.separating}" if self.separating else ""
        return said

    def explain(self, width: int = 96) -> str:
        """All of it in words: the outcome, the causes with their numbers, notes, what was not seen."""
        lines = [f"{self.kind}. {self._outcome}."]
        lines += [f"Note: {note}." for note in self.notes]
        if self.unseen:
            lines.append(f"Not seen in this log: {', '.join(self.unseen)}.")
        told = [textwrap.fill(line, width, subsequent_indent="  ") for line in lines]
        return "\n".join([*told, self.table()] if self.causes else told)

    def rows(self) -> list[tuple[str, ...]]:
        """Cause, element, value in the run, its error, value in the model, unit, share; as text."""
        return [
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
        ]

    def table(self) -> str:
        """Causes with their numbers, a line each."""
        heads = ("cause", "of", "in the run", "±", "in the model", "unit", "explains")
        rows = [heads, *self.rows()]
        widths = [max(len(row[k]) for row in rows) for k in range(len(heads))]
        return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        held = {k: v for k, v in vars(self).items() if k not in ("causes", "alternatives")}
        return {
            **held,
            "sentence": self.sentence,
            "causes": [vars(c) for c in self.causes],
            "alternatives": [[vars(c) for c in other] for other in self.alternatives],
        }

    def findings(self) -> list[Finding]:
        """The causes as findings of an audit; none where the residual is not explained."""
        if self.kind not in ("explained", "ambiguous"):
            return []
        evidence = f"explains {percent(self.explained)} of what is left of the equations of motion"
        if len(self.causes) > 1:
            evidence = (
                f"together these explain {percent(self.explained)} of what is left of the equations"
            )
        if self.alternatives:
            others = (" and ".join(map(str, other)) for other in self.alternatives[:3])
            evidence += f"; explained as well by: {'; '.join(others)}"
            evidence += f". {self.separating}" if self.separating else ""
        return [
            Finding(
                c.kind,
                c.sentence,
                evidence,
                remedy(c.kind),
                "cause",
                c.element,
                c.values[0],
                c.errors[0],
            )
            for c in self.causes
        ]

    def __str__(self) -> str:
        return self.sentence


def percent(share: float) -> str:
    """A share near one, with as many nines as it has."""
    if share == 1.0:
        return "all but noise and rounding"
    return "all but 1e-6" if share > 1 - 1e-6 else f"{100 * share:.4g} %"
