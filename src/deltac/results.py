"""`Report`, the base of what every verb returns: fields make its JSON, sections make its text.

A result is a frozen dataclass that says what it holds (its fields), what a reader is told of it
(`sections`), what was noticed (`findings`) and what a script needs (`exit_code`). All the rest follows:
`explain()` for a terminal, `_repr_html_` for a notebook, `plot()` for a paper, `to_markdown()` for a pull
request, `to_dict()` for a program. Mechanisms and trajectories show themselves in the same way (`Shown`).
"""

from __future__ import annotations

import html
import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias

from deltac.calls.services import service
from deltac.codes import FINDINGS, finding_code

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = 1
"""Version of the JSON; it grows when a key changes its meaning or goes, not when one is added."""

TEXT_WIDTH = 96
"""Columns of text where no terminal says how many it has."""

SHOWN = 6
"""Entries of a list that a text names before it only counts the rest."""

LEAST_COLUMN = 16
"""A column of a table is not wrapped to fewer characters than this, nor a word ever broken."""


# --- JSON ----------------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """A value in terms of JSON: dataclasses by field, arrays as lists, what is not finite as None."""
    if isinstance(value, Serialisable):
        return value.contents()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars, without loading NumPy to ask
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    if is_dataclass(value):
        names = [f.name for f in fields(value) if f.metadata.get("json", True)]
        return {name: plain(getattr(value, name)) for name in names}
    raise TypeError(f"{type(value).__name__} has no form in JSON; omit it from the record")


class Serialisable:
    """A dataclass whose JSON has its fields, less those it omits, and some properties and methods also.

    ``class Trial(Serialisable, omit=("text",), also=("passes",))``.
    """

    _omit: ClassVar[tuple[str, ...]] = ()
    _also: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(
        cls, omit: tuple[str, ...] = (), also: tuple[str, ...] = (), **keywords: Any
    ) -> None:
        super().__init_subclass__(**keywords)
        cls._omit, cls._also = (*cls._omit, *omit), (*cls._also, *also)

    @classmethod
    def json_keys(cls) -> tuple[str, ...]:
        """Names of what the JSON holds, in order."""
        own = (f.name for f in fields(cls))  # type: ignore[arg-type]  # each subclass is a dataclass
        return (*cls._also, *(name for name in own if name not in (*cls._omit, *cls._also)))

    def contents(self) -> dict[str, Any]:
        """What the JSON holds, in terms of JSON."""
        values = ((name, getattr(self, name)) for name in self.json_keys())
        return {name: plain(value() if callable(value) else value) for name, value in values}

    def to_dict(self) -> dict[str, Any]:
        """Everything but time histories, in terms of JSON; what is not finite is None."""
        return self.contents()


def headed(kind: str, contents: Mapping[str, Any]) -> dict[str, Any]:
    """Contents under the head that all JSON of deltac has: its schema, the version, what it is."""
    from deltac import __version__

    return {"schema": SCHEMA, "deltac": __version__, "report": kind, **contents}


# --- text ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Table:
    """Heads and rows of text; an empty row is a rule between rows."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns are mostly numbers, with or without a unit, and aligned to the right."""
        return tuple(
            2 * sum(bool(_NUMBER.match(cell)) for cell in cells) > len(cells)
            for k in range(len(self.heads))
            for cells in [[row[k] for row in self.rows if row and row[k].strip(" –")]]
        )

    def text(self, width: int = TEXT_WIDTH) -> str:
        """The table in at most `width` columns: text is wrapped, then further columns go below."""
        lines = [self.heads, *(row for row in self.rows if row)]
        least, natural = [], []
        for column in zip(*lines, strict=True):
            words = max((len(word) for cell in column for word in cell.split()), default=0)
            natural.append(max(max(map(len, cell.split("\n"))) for cell in column))
            least.append(min(natural[-1], max(words, LEAST_COLUMN)))
        right = self.numeric
        least = [n if number else m for m, n, number in zip(least, natural, right)]
        blocks: list[list[int]] = [[]]
        for k in range(len(self.heads)):
            if blocks[-1] and sum(least[j] + 2 for j in blocks[-1]) + least[k] > width:
                blocks.append([0] if least[0] + 2 + least[k] <= width else [])
            blocks[-1].append(k)
        texts = [self._block(columns, natural, least, right, width) for columns in blocks]
        return "\n\n".join(texts)

    def _block(
        self,
        columns: list[int],
        natural: list[int],
        least: list[int],
        right: tuple[bool, ...],
        width: int,
    ) -> str:
        """Some columns, side by side; the widest give way first."""
        sizes = {k: natural[k] for k in columns}
        while sum(sizes.values()) + 2 * (len(sizes) - 1) > width:
            widest = max(sizes, key=lambda k: (sizes[k] - least[k], sizes[k]))
            if sizes[widest] <= least[widest]:
                break
            sizes[widest] -= 1

        def line(row: tuple[str, ...]) -> Iterator[str]:
            cells = [
                [part for text in row[k].split("\n") for part in _wrapped(text, sizes[k])] or [""]
                for k in columns
            ]
            for n in range(max(map(len, cells))):
                parts = (cell[n] if n < len(cell) else "" for cell in cells)
                aligned = (
                    part.rjust(sizes[k]) if right[k] else part.ljust(sizes[k])
                    for k, part in zip(columns, parts)
                )
                yield "  ".join(aligned).rstrip()

        rule = "─" * (sum(sizes.values()) + 2 * (len(sizes) - 1))
        lines = [*line(self.heads), rule]
        for row in self.rows:
            lines += line(row) if row else [rule]
        return "\n".join(lines)

    def html(self) -> str:
        """The table as an HTML fragment; numbers are aligned to the right, a long table scrolls."""
        right = self.numeric
        rows = "".join(f"<tr>{_cells('td', row, right)}</tr>" for row in self.rows if row)
        head = f"<thead><tr>{_cells('th', self.heads, right)}</tr></thead>"
        table = f"<table>{head}<tbody>{rows}</tbody></table>"
        return f'<div style="max-height:24em;max-width:100%;overflow:auto">{table}</div>'

    def markdown(self) -> str:
        """The table in GitHub's Markdown."""

        def line(row: tuple[str, ...]) -> str:
            cells = (unmarked(" ".join(cell.split())).replace("|", "\\|") for cell in row)
            return f"| {' | '.join(cells)} |"

        marks = tuple("---:" if number else "---" for number in self.numeric)
        return "\n".join(map(line, (self.heads, marks, *(row for row in self.rows if row))))


@dataclass(frozen=True)
class Verbatim:
    """Text that keeps its lines, such as a diff."""

    text: str


def unmarked(text: str) -> str:
    """A text whose names cannot be HTML, links or pictures in Markdown.

    >>> print(unmarked("[a](http://b) <img> 1 < 2").replace(chr(92), "/"))
    [a]/(http://b) &lt;img> 1 < 2
    """
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", text).replace("](", "]\\(")


Section: TypeAlias = "str | Table | Verbatim"
"""A paragraph, a table, or text as it is."""

_UNIT = re.compile(r"(?<=\d) (?=(?:%|J|W|N|m|s|ms|Hz|rad|kg|N·m|m/s|± [\d.e+-]+ J)(?:[\s.,;:)]|$))")
_NUMBER = re.compile(r"^[-+±]? ?(\d[\d.e+-]*|nan|inf)( ± [\d.e+-]+)?( ?(%|[^\W\d]\S{0,5}))?$")


def _wrapped(text: str, width: int) -> list[str]:
    if len(text) <= width and text == text.strip() and text.isprintable():
        return [text]
    return textwrap.wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False)


def _cells(tag: str, row: tuple[str, ...], right: tuple[bool, ...]) -> str:
    sides = ("right" if number else "left" for number in right)
    return "".join(
        f'<{tag} style="text-align:{side};padding:.1em .6em">{html.escape(cell)}</{tag}>'
        for cell, side in zip(row, sides)
    )


def paragraph(text: str, width: int = TEXT_WIDTH) -> str:
    """A paragraph wrapped to a width, further lines indented; no word or number with its unit is broken."""
    joined = _UNIT.sub("\u00a0", text)  # which textwrap takes for no space
    lines = textwrap.fill(
        joined, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return lines.replace("\u00a0", " ")


def as_text(sections: Iterable[Section], width: int = TEXT_WIDTH) -> str:
    """Sections as text; tables and verbatim text stand between empty lines."""
    parts: list[str] = []
    for section in sections:
        if isinstance(section, str):
            parts.append(paragraph(section, width))
            continue
        text = section.text(width) if isinstance(section, Table) else section.text.rstrip("\n")
        parts += ["", text, ""]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).strip("\n")


EDGES = {0: "#009e73", 1: "#d55e00", 3: "#e69f00", None: "#0072b2"}
"""Colour beside the first line in a notebook, by exit code; None where nothing is judged."""

_CHANGED = {"+": "rgba(0,158,115,.22)", "-": "rgba(213,94,0,.22)"}
"""Background of the lines of a diff, in light and dark."""


def as_html(
    headline: str, sections: Iterable[Section], code: int | None = None, notices: Iterable[str] = ()
) -> str:
    """A fragment for notebooks: headline, the `notices`, tables and diffs; paragraphs are folded away.

    Everything is escaped, and styled inline, since notebooks that are not trusted lose style sheets.
    """
    edge = f"border-left:4px solid {EDGES.get(code, EDGES[1])};padding:.2em .7em"
    parts = [f'<div style="{edge}"><b>{html.escape(headline)}</b></div>']
    parts += (f"<p>{html.escape(text)}</p>" for text in notices)
    words: list[str] = []
    for section in sections:
        if isinstance(section, Table):
            parts += [section.html()] if section.rows else []
        elif isinstance(section, Verbatim):
            parts.append(_pre(section.text))
        elif section.rstrip(".") != headline.rstrip("."):
            words.append(f"<p>{html.escape(section)}</p>")
    if words:
        parts.append(f"<details><summary>in words</summary>{''.join(words)}</details>")
    return "\n".join(parts)


def _pre(text: str) -> str:
    """Text as it is; of a diff, what goes and what comes has a colour."""
    lines = text.rstrip("\n").split("\n")
    if not any(line.startswith("@@") for line in lines):
        return f"<pre>{html.escape(text)}</pre>"
    shown = (
        f'<span style="background:{_CHANGED[line[0]]}">{html.escape(line)}</span>'
        if line[:1] in _CHANGED and line[:3] not in ("+++", "---")
        else html.escape(line)
        for line in lines
    )
    return f"<pre>{chr(10).join(shown)}</pre>"


def number(value: float, unit: str = "", digits: int = 4) -> str:
    """A number for people, with its unit ("1" is none)."""
    text = re.sub(r"e([+-])0*", r"e\1", f"{value:.{digits}g}").replace("e+", "e")
    return text if unit in ("", "1") else f"{text} {unit}"


def percent(share: float) -> str:
    """A share in per cent, without exponents where it is large: "0.0021 %", "101 %"."""
    value = 100.0 * float(share)
    return f"{value:.0f} %" if 99.5 <= abs(value) < 1e6 else f"{value:.2g} %"


def fraction(share: float) -> str:
    """A share in per cent; as a number where that is below a millionth: "24 %", "1.5e-8"."""
    return percent(share) if abs(share) >= 1e-6 or share == 0.0 else number(share, digits=2)


def worst_code(codes: Iterable[int]) -> int:
    """The exit code that hides the others: an error before what is wrong, and that before the unresolved."""
    return min(codes, key=(70, 2, 1, 3, 0).index, default=0)


# --- findings and reports ------------------------------------------------------------------------

Weight = Literal["cause", "doubt", "note"]


@dataclass(frozen=True)
class Finding(Serialisable, also=("code",)):
    """One thing that was noticed.

    kind      a short fixed name, one of `deltac.codes.FINDINGS`: "gravity", "missing-damper", …
    what      what it is, in a sentence
    evidence  the numbers it rests on
    remedy    what to change or to record; "" where nothing is to be done
    weight    "cause": it explains what is wrong; "doubt": the log cannot be judged as it stands; "note"
    element   the joint, body or channel, where there is one
    factor    what to multiply by (a force, a mass), or the coefficient found, with its standard `error`
    equals    kind and element of other causes that explain the same, as far as the log tells
    """

    kind: str
    what: str
    evidence: str
    remedy: str
    weight: Weight = "note"
    element: str = ""
    factor: float | None = None
    error: float | None = None
    equals: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in FINDINGS:
            raise AssertionError(f"finding {self.kind!r} has no line in deltac/codes.py")

    @property
    def code(self) -> str:
        """The stable code, "F-MISSING-DAMPER"."""
        return finding_code(self.kind)

    def __str__(self) -> str:
        return f"{self.what} ({self.evidence})" + (f". {self.remedy}" if self.remedy else "")


HEADINGS: dict[Weight, str] = {"cause": "Cause", "doubt": "Doubt", "note": "Note"}


def findings_in_words(findings: Iterable[Finding]) -> Iterator[str]:
    """Findings as paragraphs, causes first, each with its code."""
    ranked = sorted(findings, key=lambda f: list(HEADINGS).index(f.weight))
    return (f"{HEADINGS[f.weight]} [{f.code}]: {f}." for f in ranked)


class Shown:
    """What shows itself: a picture for papers, a fragment in notebooks."""

    def summary(self) -> str:
        """What it is, in one line."""
        raise NotImplementedError

    def sections(self) -> Iterator[Section]:
        """What it is, for a reader: paragraphs and tables, in order."""
        raise NotImplementedError

    def plot(self, *, title: str | None = None, **options: object) -> Figure:
        """The picture of it: a figure of matplotlib (7.6 in wide), to be shown or written by its `savefig`.

        Args:
            title: in place of its own.
            options: of some pictures: `names` of the coordinates and speeds of a trajectory; `state` of a
                mechanism, or the run along which it is drawn.

        Raises:
            InputError: there is no picture of such a thing, or no such option.
        """
        drawn: Figure = service("figure")(self, title=title, **options)
        return drawn

    def _repr_html_(self) -> str:
        return as_html(self.summary(), self.sections())


@dataclass(frozen=True, repr=False)
class InFrame:
    """A page in a notebook, shut off from it: its script sees neither the notebook nor the network."""

    summary: str
    page: str

    def _repr_html_(self) -> str:
        look = "width:100%;height:48em;border:1px solid #8888"
        return (
            f'<iframe title="{html.escape(self.summary)}" sandbox="allow-scripts allow-downloads" '
            f'style="{look}" srcdoc="{html.escape(self.page)}"></iframe>'
        )

    def __repr__(self) -> str:
        return f"the page of: {self.summary} (shown in notebooks; report(path) writes it)"


class Report(Serialisable, Shown):
    """What a verb found.

    A subclass is a frozen dataclass (``repr=False``) with `sections`, `summary` and, where it judges,
    `exit_code`.
    """

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed, causes first."""
        return ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 consistent, 1 not, 3 unresolved."""
        return 0

    def explain(self, width: int = TEXT_WIDTH) -> str:
        """The whole report as text of at most `width` columns."""
        return as_text(self.sections(), width)

    def table(self, width: int = TEXT_WIDTH) -> str:
        """The tables of the report alone, as text."""
        return as_text((part for part in self.sections() if isinstance(part, Table)), width)

    def to_markdown(self) -> str:
        """The whole report in GitHub's Markdown, as for the summary of a job."""
        parts = []
        for section in self.sections():
            if isinstance(section, Table):
                parts.append(section.markdown())
            elif isinstance(section, Verbatim):
                fence = "`" * max(3, 1 + max(map(len, re.findall("`+", section.text)), default=0))
                parts.append(f"{fence}\n{section.text.rstrip()}\n{fence}")
            else:
                parts.append(unmarked(section))
        return "\n\n".join(parts) + "\n"

    def contents(self) -> dict[str, Any]:
        """What the JSON holds, in terms of JSON."""
        findings = [plain(finding) for finding in self.findings]
        return {"exit_code": self.exit_code, **super().contents(), "findings": findings}

    def to_dict(self) -> dict[str, Any]:
        """Everything but time histories, in terms of JSON, under the head that says the schema's version."""
        return headed(type(self).__name__, self.contents())

    def report(
        self,
        path: str | PurePath,
        *more: Report,
        model: object = None,
        run: object = None,
        equations: object = None,
        command: str = "",
    ) -> None:
        """Write the report as one page for the browser: plots, the mechanism moving, findings, tables.

        The page needs no network. It takes the place of a file of that name once it is complete.

        Args:
            path: where to, ending in ``.html``.
            more: further reports of the same thing, such as the repair of equations that were checked.
            model: whose motion is shown, for results that hold none; what every verb takes.
            run: the Trajectory that is shown, likewise.
            equations: those that were checked, to show their motion beside the model's.
            command: how it was made, for whoever wants to repeat it.

        Raises:
            InputError: another ending, a folder that does not exist or cannot be written to.
        """
        service("write_report")(
            self, path, *more, model=model, run=run, equations=equations, command=command
        )

    def show(self, *, model: object = None, run: object = None) -> InFrame:
        """The page of the report, in a notebook: plots to zoom into, the mechanism moving, findings, tables.

        Args and errors are those of `report`, which writes the same page into a file.
        """
        page: str = service("html_of")(self, model=model, run=run)
        return InFrame(self.summary(), page)

    def _repr_html_(self) -> str:
        paragraphs = findings_in_words(f for f in self.findings if f.weight != "note")
        return as_html(self.summary(), self.sections(), self.exit_code, paragraphs)

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.summary()})"
