"""What a search for a mistake came to: fixes, and what is known of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from deltac.diagnosis import Blame
from deltac.repair.edits.candidates import short
from deltac.repair.tracing.samples import RIGHT
from deltac.repair.tracing.source import Source
from deltac.results import Finding, Report, Section, Serialisable, Verbatim


@dataclass(frozen=True)
class Fix(Serialisable, omit=("text",)):
    """One or two edits that make the function right.

    lines     of the source, one for each edit
    words     what is wrong and what it should be, one for each edit
    kinds     sign, operator, name, index, function, power, number, factor, term, order
    cost      how much is changed: about 1 for one sign or name, more for what is put in
    diff      a unified diff of the file
    text      the whole file as it should be
    others    other ways to write the same in the same statements
    ran       whether Python itself, run on the edited function, gave the model's accelerations; None where
              it could not be run, `not_run` saying why
    """

    file: str
    lines: tuple[int, ...]
    words: tuple[str, ...]
    kinds: tuple[str, ...]
    cost: float
    diff: str
    text: str = field(repr=False)
    others: tuple[str, ...] = ()
    ran: bool | None = None
    not_run: str = ""

    def __str__(self) -> str:
        return "; ".join(
            f"{self.file}:{line}: {words}" for line, words in zip(self.lines, self.words)
        )


@dataclass(frozen=True, repr=False)
class Repair(Report, also=("right",)):
    """The outcome of a search for a mistake in equations of motion.

    file, function   what was searched
    residual         size of the residual, 1 being the size of an equation's terms; rounding when right
    equations        speeds whose equations are wrong
    fixes            edits that make it right, least first; empty if none was found, or none is needed
    certain          all fixes found are one and the same formula, right at every state and, where the
                     function names them, at other parameters too
    varied           parameters of the model that were varied with the function's
    suspects         expressions any one of which could be wrong by itself, "file:line: expression": the
                     widest of each line
    complete         whether the search came to its end within its time
    seconds          it took
    terms            without fixes: what the residual of an equation consists of, if that could be told
    contradicted     edits that are right as the source was read, but not as Python runs it
    unread           why the function could not be read, where edits were tried by running it instead
    """

    file: str
    function: str
    residual: float
    equations: tuple[str, ...] = ()
    fixes: tuple[Fix, ...] = ()
    certain: bool = False
    varied: tuple[str, ...] = ()
    suspects: tuple[str, ...] = ()
    complete: bool = True
    seconds: float = 0.0
    terms: tuple[str, ...] = ()
    contradicted: tuple[str, ...] = ()
    unread: str = ""

    @property
    def right(self) -> bool:
        """Whether there is nothing to repair."""
        return self.residual < RIGHT

    @property
    def exit_code(self) -> int:
        """Exit code: 0 right, 1 wrong (repaired or not)."""
        return 0 if self.right else 1

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Each fix as a cause; its element is the first line that it changes, "file:line"."""
        evidence = f"residual {self.residual:.2g} of the equation's terms"
        return tuple(
            Finding(
                "wrong-expression",
                "; ".join(fix.words),
                evidence,
                "Apply the edit",
                "cause",
                f"{fix.file}:{fix.lines[0]}",
            )
            for fix in self.fixes
        )

    def summary(self) -> str:
        """Whether the function is right, and the first fix."""
        name = f"{self.file}:{self.function}"
        if self.right:
            return f"{name} is right"
        return f"{name} is wrong: {self.fixes[0] if self.fixes else 'no edit was found'}"

    def sections(self) -> Iterator[Section]:
        """What was found, in words, with the diff of the first fix."""
        name = f"{self.file}:{self.function}"
        if self.right:
            yield f"{name} is right at all states (residual {self.residual:.1g}); nothing to repair."
            return
        if self.unread:
            yield f"It cannot be read ({self.unread}), so it was run."
        where = ", ".join(self.equations)
        wrong = f"residual {self.residual:.2g} of the terms"
        yield f"{name} is wrong: {wrong}, in the equation of {where}."
        if self.fixes:
            yield from self._fixes()
        elif self.suspects:
            one = "this line" if len(self.suspects) == 1 else "one of these lines"
            yield f"No edit was found. What is wrong is in {one}, or in what it uses:"
            yield from (f"  {suspect}" for suspect in self.suspects)
        elif self.terms:
            yield "No edit was found that makes it right. What is wrong there:"
            yield from (f"  {term}" for term in self.terms)
        elif self.residual > 0.3 and self.complete:
            yield (
                "No expression can be the only one that is wrong, and no two edits were found. Is it the "
                "function of this model, in these coordinates and units (radians)?"
            )
        else:
            yield "No edit was found, and no expression can be the only one that is wrong."
        for fix in self.contradicted:
            yield (
                f"Not offered: {fix}. By the source it is right, run by Python it is not: is there something "
                "in the module that changes what is read?"
            )
        for reason in dict.fromkeys(fix.not_run for fix in self.fixes if fix.not_run):
            yield f"Read, but not run by Python: {reason}."
        if not self.complete:
            yield "The search ran out of time: there may be other edits."
        if self.fixes:
            yield Verbatim(self.fixes[0].diff)

    def _fixes(self) -> list[str]:
        lines = []
        for fix in self.fixes:
            lines.append(str(fix))
            if not self.certain:
                lines += [f"  or: {other}" for other in fix.others]
        if len(lines) > 1:
            lines.insert(0, "Each of these makes it right:")
        tested = "random states"
        if self.varied:
            tested += f", and at other values of {', '.join(self.varied)}"
        if self.unread:
            lines.append(
                "Tested by running them at random states: other formulas may agree there too."
            )
        elif self.certain:
            lines.append(f"Tested at {tested}; no other formula was found.")
        else:
            lines.append(
                f"Tested at {tested}. Other formulas may agree at these numbers too: choose, or "
                "name the constants as the model does, so that they can be varied."
            )
        return lines


@dataclass(frozen=True)
class NoRepair(Report):
    """Why no edit was sought: the function cannot be read; file and line are named."""

    refused: str

    @property
    def exit_code(self) -> int:
        """Exit code: 0, for the check has its own."""
        return 0

    def summary(self) -> str:
        """Why."""
        return f"no repair was sought: {self.refused}"

    def sections(self) -> Iterator[Section]:
        """Why."""
        yield f"No repair was sought. {self.refused}."


def suspects(source: Source, places: Iterable[int]) -> list[str]:
    """The lines of some nodes, in order, each with the widest of their expressions."""
    widest: dict[int, str] = {}
    for place in places:
        line = source.statement(place).lineno
        own = source.segment(source.nodes[place])
        if len(own) > len(widest.get(line, "")):
            widest[line] = own
    return [f"{source.name}:{line}: {short(text)}" for line, text in sorted(widest.items())]


def blamed_terms(blamed: Iterable[Blame]) -> tuple[str, ...]:
    """What each wrong equation's residual consists of, where that could be told, in words."""
    return tuple(str(b) for b in blamed if b.terms or b.solved)
