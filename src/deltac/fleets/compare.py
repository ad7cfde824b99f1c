"""`compare`: two folders of results, before and after a change, row by row: what got worse?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltac.arrays import SAME
from deltac.calls.arguments import checked
from deltac.errors import FileError, InputError
from deltac.fleets.result import shown_cell
from deltac.fleets.rows import FAILED, is_point
from deltac.fleets.store import Store
from deltac.results import SHOWN, Report, Section, Table

if TYPE_CHECKING:
    import polars


SEVERITY = {
    "consistent": 0,
    "unresolved": 1,
    "integration-error": 2,
    "equation-error": 2,
    FAILED: 3,
}


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Report):
    """Two fleets, row by row.

    Attributes:
        before, after: their folders.
        rows: the number of rows that both have; `only_before`, `only_after`: the numbers that one of them
            lacks.
        worse: how many have a worse verdict afterwards; `better`: a better one.
        grown: how many have the same verdict and a larger energy error; `shrunk`: a smaller one.
        listed: the rows that are worse, worst first, with verdict and relative energy error of both.
        factor: how many times larger an error has to be to have grown.
    """

    before: str
    after: str
    rows: int
    only_before: int
    only_after: int
    worse: int
    better: int
    grown: int
    shrunk: int
    listed: tuple[Mapping[str, Any], ...]
    factor: float

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 1 something got worse, 3 rows are missing after, else 0."""
        if self.worse or self.grown:
            return 1
        return 3 if self.only_before else 0

    def summary(self) -> str:
        """How many rows got worse, and how many better."""
        return (
            f"{self.rows} rows: {self.worse} have a worse verdict, {self.grown} a larger energy error; "
            f"{self.better} have a better verdict, {self.shrunk} a smaller error"
        )

    def sections(self) -> Iterator[Section]:
        """Counts, and what got worse."""
        yield self.summary() + "."
        if self.only_before or self.only_after:
            before, after = self.only_before, self.only_after
            yield f"{before} rows are in {self.before} only, {after} in {self.after} only."
        if self.listed:
            heads = tuple(self.listed[0])
            rows = tuple(tuple(shown_cell(row[n], n) for n in heads) for row in self.listed)
            yield Table(heads, rows)


@checked
def compare(before: str | Path, after: str | Path, *, factor: float = 2.0) -> Comparison:
    """Compare two folders of results of the same runs or logs, before and after a change.

    Args:
        before: a folder of `sweep` or `audit_many`.
        after: another one; rows are the same if their model, setting and axes are, or their log (the name of
            its file, and its folder where names are there twice) and episode.
        factor: ratio of energy errors from which on the later one has grown.

    Raises:
        InputError: a folder does not hold results of deltac, they are of different kinds, or have no row in
            common.
    """
    if not (isinstance(factor, int | float) and factor > 1.0):
        raise InputError(f"factor is {factor!r}; expected a number above 1")
    import polars

    stores = [Store.open(Path(folder)) for folder in (before, after)]
    kinds = [store.head.get("kind") for store in stores]
    if kinds[0] != kinds[1]:
        raise InputError(
            f"{before} holds a {kinds[0]}, {after} a {kinds[1]}; compare like with like"
        )
    a, b = (_judged(store) for store in stores)
    keys = [n for n in a.columns if n in b.columns and is_point(n)]
    if "log" in keys:
        a, b = _by_name(a, b)
    joined = a.join(b, on=keys, how="full", suffix=" after", nulls_equal=True, coalesce=True)
    both = joined.filter(
        polars.col("verdict").is_not_null() & polars.col("verdict after").is_not_null()
    )
    if not len(both):
        raise InputError(
            f"{before} and {after} have no row in common: they are of other runs or logs"
        )
    rank = polars.col("verdict").replace_strict(SEVERITY, default=3)
    rank_after = polars.col("verdict after").replace_strict(SEVERITY, default=3)
    old, new = polars.col("relative").fill_null(0.0), polars.col("relative after").fill_null(0.0)
    both = both.with_columns(
        (rank_after - rank).alias("change"),
        ((rank == rank_after) & (new > SAME) & (new > factor * old)).alias("grown"),
        ((rank == rank_after) & (old > SAME) & (old > factor * new)).alias("shrunk"),
    )
    bad = both.filter((polars.col("change") > 0) | polars.col("grown"))
    bad = bad.sort(-polars.col("change"), -new / polars.max_horizontal(old, polars.lit(SAME)))
    varying = [n for n in keys if both[n].n_unique() > 1]
    columns = [*varying, "verdict", "verdict after", "relative", "relative after"]
    return Comparison(
        before=str(before),
        after=str(after),
        rows=len(both),
        only_before=joined["verdict after"].null_count(),
        only_after=joined["verdict"].null_count(),
        worse=int((both["change"] > 0).sum()),
        better=int((both["change"] < 0).sum()),
        grown=int(both["grown"].sum()),
        shrunk=int(both["shrunk"].sum()),
        listed=tuple(bad.head(SHOWN).select(columns).to_dicts()),
        factor=float(factor),
    )


def _judged(store: Store) -> polars.DataFrame:
    frame = store.table()
    if not len(frame) or "verdict" not in frame.columns:
        raise FileError(f"{store.folder}: there are no rows yet")
    points = [n for n in frame.columns if is_point(n)]
    if store.head.get("kind") == "audit":
        points = ["log", "episode"]
    return frame.select(*points, "verdict", "relative").unique(
        points, keep="first", maintain_order=True
    )


def _by_name(a: polars.DataFrame, b: polars.DataFrame) -> tuple[polars.DataFrame, polars.DataFrame]:
    """Logs by what the ends of their paths have in common: folders of two versions differ in theirs."""
    import polars

    depth = 1
    while depth < 16:
        cut = [
            f.with_columns(
                polars.Series(
                    "log", ["/".join(Path(log).parts[-depth:]) for log in f["log"]], polars.String
                )
            )
            for f in (a, b)
        ]
        if all(len(f.unique(["log", "episode"])) == len(f) for f in cut):
            return cut[0], cut[1]
        depth += 1
    return a, b
