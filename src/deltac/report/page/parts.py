"""What a page is made of: plots, tables, texts, a scene. Each says what it is in terms of JSON.

Arrays go into the page as base64 of little-endian numbers, ``{"f4": "…"}`` or ``{"f8": "…"}``: half the size
of digits, and read at once. Histories that are longer than anybody can see are cut down to the smallest and
the largest value of each of many stretches, so that no peak is lost.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.report.panels import CURVE_POINTS, Bars, Flows, HeatMap, Line, LogPlot, Panel, TimePlot
from deltac.results import Finding, Serialisable, Table, plain

if TYPE_CHECKING:
    from deltac.report.page.scene import Drawing

PAGE_NUMBERS = 25 * CURVE_POINTS
"""Numbers of time histories, which all plots share, and of what moves that a page holds: 0.55 MB each."""


Tone = Literal["good", "bad", "doubt", "plain"]
"""What a verdict is: it holds, it does not, it cannot be told, or nothing was judged."""


@dataclass(frozen=True, eq=False)
class Numbers(Serialisable):
    """An array as the page holds it; float32 unless `exact`."""

    values: NDArray[np.number[Any]]
    exact: bool = False

    def contents(self) -> dict[str, Any]:
        """Base64 of its little-endian bytes, under the type of its numbers."""
        kind = "f8" if self.exact else "f4"
        with np.errstate(over="ignore"):
            flat = np.ascontiguousarray(self.values, dtype=f"<{kind}")
        return {kind: base64.b64encode(flat.tobytes()).decode("ascii")}


@dataclass(frozen=True, eq=False)
class Stretches:
    """Rows in stretches of equal counts: of each the smallest and the largest value, in their order.

    t      two times for each stretch (2n,), its first and last; or all of them where there are so few
    whole  whether all rows are kept as they are
    """

    t: Array
    starts: Any
    whole: bool
    rows: int

    @classmethod
    def of(cls, t: Array, count: int) -> Stretches:
        """At most `count` stretches."""
        rows = len(t)
        if rows <= 2 * count:
            return cls(t, None, True, rows)
        starts = np.linspace(0, rows, count + 1).astype(np.intp)[:-1]
        ends = np.append(starts[1:], rows) - 1
        return cls(np.column_stack([t[starts], t[ends]]).ravel(), starts, False, rows)

    def smallest(self, y: Array) -> Array:
        """The smallest value of each stretch, twice."""
        return y if self.whole else np.repeat(np.fmin.reduceat(y, self.starts), 2)

    def largest(self, y: Array) -> Array:
        """The largest value of each stretch, twice."""
        return y if self.whole else np.repeat(np.fmax.reduceat(y, self.starts), 2)

    def extremes(self, y: Array) -> Array:
        """The smallest and the largest value of each stretch, in the order in which the motion has them."""
        if self.whole:
            return y
        low, high = np.fmin.reduceat(y, self.starts), np.fmax.reduceat(y, self.starts)
        ends = np.append(self.starts[1:], self.rows) - 1
        rises = y[ends] >= y[self.starts]
        return np.column_stack([np.where(rises, low, high), np.where(rises, high, low)]).ravel()


@dataclass(frozen=True)
class Grid(Panel):
    """A table whose columns can be sorted; `links` are of the last cells of its rows, "" for none."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...] = ()
    folded: bool = False
    links: tuple[str, ...] = ()
    kind = "table"

    @classmethod
    def of(cls, title: str, table: Table, folded: bool = False) -> Grid:
        """A report's table."""
        return cls(title, table.heads, table.rows, table.numeric, folded)


@dataclass(frozen=True)
class Words(Panel):
    """Paragraphs."""

    title: str
    paragraphs: tuple[str, ...]
    folded: bool = False
    kind = "words"


@dataclass(frozen=True)
class CodeListing(Panel):
    """Text as it is, such as source: lines in `wrong` are marked; `diff` colours added and removed lines."""

    title: str
    text: str
    first: int = 1
    wrong: tuple[int, ...] = ()
    diff: bool = False
    note: str = ""
    kind = "code"


Part: TypeAlias = "TimePlot | LogPlot | HeatMap | Bars | Flows | Grid | Words | CodeListing"


@dataclass(frozen=True)
class Told:
    """A finding, and where to look for it: its instant (s) and its element, where known."""

    finding: Finding
    t: float | None = None
    element: str = ""


@dataclass(frozen=True, eq=False)
class Chapter:
    """Parts under a heading and a `lead`, a sentence; the first part of a page has the scene beside it."""

    heading: str
    parts: tuple[Part, ...] = ()
    findings: tuple[Told, ...] = ()
    lead: str = ""


@dataclass(frozen=True, eq=False)
class Page:
    """A page.

    title      what it is of
    asked      the question that was asked, in words
    tone       how the banner looks
    word       the verdict in a word or two
    sentence   what it means
    numbers    what it rests on: (what, value) each
    chapters   what follows
    scene      what moves, see `scene.Scene`; None where nothing does
    limits     what the test cannot see
    made       how it was made: (what, value) each
    data       the report as JSON
    """

    title: str
    asked: str
    tone: Tone
    word: str
    sentence: str
    numbers: tuple[tuple[str, str], ...] = ()
    chapters: tuple[Chapter, ...] = ()
    scene: Drawing | None = None
    limits: tuple[str, ...] = ()
    made: tuple[tuple[str, str], ...] = ()
    data: Mapping[str, Any] = field(default_factory=dict)

    def packed(self) -> dict[str, Any]:
        """The page in terms of JSON."""
        plots = [p for chapter in self.chapters for p in chapter.parts if isinstance(p, TimePlot)]
        share = _share(plots)

        def cut(chapter: Chapter) -> dict[str, Any]:
            parts = [_cut(p, share) if isinstance(p, TimePlot) else p for p in chapter.parts]
            return {**vars(chapter), "parts": parts}

        packed: dict[str, Any] = plain({**vars(self), "chapters": [*map(cut, self.chapters)]})
        return packed


def _share(plots: Sequence[TimePlot]) -> float:
    """How many numbers a plot may take: what small ones leave is for the larger ones."""
    sizes = sorted(_columns(plot) * min(len(plot.t), 2 * CURVE_POINTS) for plot in plots)
    rest = float(PAGE_NUMBERS)
    for count, size in zip(range(len(sizes), 0, -1), sizes):
        if size * count > rest:
            return rest / count
        rest -= size
    return math.inf


def _columns(plot: TimePlot) -> int:
    """How many numbers a plot takes for each point; times are twice as long as others."""
    return 2 + len(plot.lines) + 2 * sum(_shaded(plot, line) for line in plot.lines)


def _shaded(plot: TimePlot, line: Line) -> bool:
    """Whether the error bar of a curve can be seen: it is more than a row of a screen."""
    if line.bar is None:
        return False
    return plot.log or not CURVE_POINTS * np.max(line.bar) <= np.ptp(line.y)


def _cut(plot: TimePlot, share: float) -> dict[str, Any]:
    """A plot in terms of JSON, its curves cut down to the extremes of as many stretches as it may have."""
    cut = Stretches.of(plot.t, int(min(CURVE_POINTS, max(1.0, 0.5 * share / _columns(plot)))))
    lines = []
    for line in plot.lines:
        y = np.abs(line.y) if plot.log else line.y
        entry: dict[str, Any] = {
            "name": line.name,
            "y": Numbers(cut.extremes(y)),
            "dashed": line.dashed,
            "shown": line.shown,
            "colour": line.colour,
        }
        if line.bar is not None and _shaded(plot, line):
            entry["high"] = Numbers(cut.largest(line.bar if plot.log else y + line.bar))
            if not plot.log:
                entry["low"] = Numbers(cut.smallest(y - line.bar))
        lines.append(entry)
    curves: Any = {"t": Numbers(cut.t, exact=True), "lines": tuple(lines)}
    return replace(plot, **curves).contents() | {"rows": len(plot.t), "whole": cut.whole}
