"""What a fleet came to: one table, counts of verdicts, the worst cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from deltac.calls.arguments import checked
from deltac.calls.services import service
from deltac.diagnosis import EXIT_CODES
from deltac.errors import listed
from deltac.fleets.rows import FAILED, SETTING, is_point
from deltac.fleets.store import RESULTS_FILE, Store
from deltac.results import SHOWN, Report, Section, Table, number, percent, worst_code

if TYPE_CHECKING:
    import polars

WORST_FIRST = (FAILED, "integration-error", "equation-error", "unresolved", "consistent")
"""Verdicts, the one to look at first at the front."""

OUTSIDE = "outside of the table"
"""Where rows are that the plan does not have."""

OF_AUDITS = ("log", "episode", "verdict", "relative", "energy_error", "findings", "code")
"""Columns of the worst audits that are listed."""


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Report):
    """The results of a sweep, or of the audits of many logs.

    `frame` has a row for every run, log or episode. Its columns:

    - `address`: hash of everything that determines the result, versions of deltac, NumPy, SciPy, CasADi,
      llvmlite and heyoka included
    - `model`, `solver`, `step`, `solver_tolerance`, `duration`, ``parameter.…``, ``q.…``, ``u.…``: the point
      of a sweep; `log`, `episode` of an audit
    - `verdict`: "consistent"; "integration-error": |ΔC| exceeds the tolerance, or the run blew up;
      "unresolved": no energy to compare with; "failed": the run could not be made. For studies and audits
      theirs, with `order`, `confidence`, `findings`
    - `energy_error`, `relative`, `energy`: largest |ΔC| of Wang's function, projections counted as error, in
      J and as a fraction; the energy of comparison (J). ``delta_c.…``: |ΔC| of each function (J)
    - `stopped`: when the state ceased to be finite (s); `evaluations` of ẋ; `seconds`: processor time without
      compilation, the only column that differs when the work is repeated
    - `code`, `message`, `details`: why a row failed; the report of a log that is not in order

    Attributes:
        kind: "sweep" or "audit".
        name: what it is called.
        folder: where the results are.
        total: the number of rows when complete; `done`: the number so far, including those that failed.
        verdicts: the number of rows with each verdict; "failed" are those that could not be made.
        aside: how many of the failed rows were set aside because their process died, hung or raised an error.
        others: the number of rows of an earlier plan, version or model that the folder also holds.
        exit_codes: the exit codes that occur, each once.
        worst: the worst rows: failed ones first, then by relative energy error.
        skipped: files in the folders that are not logs.
    """

    kind: str
    name: str
    folder: Path
    total: int
    done: int
    verdicts: Mapping[str, int]
    aside: int
    others: int
    exit_codes: tuple[int, ...]
    worst: tuple[Mapping[str, Any], ...]
    skipped: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 2 some failed, 1 some are wrong, 3 some are unresolved, else 0.

        Of audits as for `audit`: a mistake that stays within the tolerance is named, and is 0.
        """
        if self.done < self.total:
            return 3
        return worst_code(self.exit_codes)

    @property
    def frame(self) -> polars.DataFrame:
        """The table (a polars DataFrame); of a fleet that is not complete, its rows that are there."""
        import polars

        path = self.folder / RESULTS_FILE
        if self.done == self.total and path.exists():
            return polars.read_parquet(path, glob=False)
        return Store.open(self.folder).table()

    def report(  # type: ignore[override]
        self,
        path: str | PurePath,
        *,
        x: str | None = None,
        y: str | None = None,
        case: Callable[[str, Path], None] | None = None,
    ) -> None:
        """Write one page: counts, heat maps over two axes, work and precision, the worst cases.

        Args:
            path: where to, ending in ``.html``.
            x: the axis of the heat maps to the right; by default the first two that vary.
            y: their other axis.
            case: writes the page of one row, by its address, to a path; the worst cases link to theirs.

        Raises:
            InputError: another ending, a folder that does not exist, an axis that the table lacks.
        """
        service("write_summary")(self, path, x=x, y=y, case=case)

    def groups(self) -> tuple[Group, ...]:
        """The rows of each setting: model, solver and step; of audits each log, or episode."""
        frame = self.frame
        if self.kind == "audit":
            return tuple(
                Group(
                    " ".join(filter(None, (row["log"], row["episode"]))),
                    {row["verdict"]: 1},
                    (int(row["exit_code"]),),
                    ({n: row[n] for n in ("verdict", "relative", "findings", "message")},),
                )
                for row in frame.iter_rows(named=True)
            )
        keys = [n for n in SETTING if n in frame.columns]
        if not keys or not len(frame):
            return ()
        several = [n for n in keys if n == "model" or frame[n].n_unique() > 1]
        return tuple(
            Group(
                _setting(part.row(0, named=True), several),
                _counted(part),
                _exit_codes(part),
                _worst(part, 1),
            )
            for part in frame.partition_by(keys, maintain_order=True)
        )

    def summary(self) -> str:
        """How many rows there are, and how many of each verdict."""
        counts = ", ".join(f"{self.verdicts[v]} {v}" for v in WORST_FIRST if self.verdicts.get(v))
        done = f"{self.done}" if self.done == self.total else f"{self.done} of {self.total}"
        what = "audits" if self.kind == "audit" else "runs"
        return f"{self.name}: {done} {what}{': ' if counts else ''}{counts}"

    def sections(self) -> Iterator[Section]:
        """Counts, the worst cases, where the table is."""
        yield self.summary() + "."
        if self.done < self.total:
            remaining = self.total - self.done
            yield f"{remaining} are not there yet: run it again, and it goes on where it stopped."
        if self.worst:
            names = [n for n in self.worst[0] if n not in ("address", "message")]
            heads = (*names, "address")
            if self.kind == "audit":  # whose rows are known by their logs
                heads = tuple(n for n in names if n in OF_AUDITS)
            rows = tuple(tuple(shown_cell(row.get(n), n) for n in heads) for row in self.worst)
            yield Table(heads, rows)
            bad = sum(n for verdict, n in self.verdicts.items() if verdict != "consistent")
            if bad > len(rows):
                yield f"These are {len(rows)} of {bad}; the table has all."
        reasons = {row["message"]: None for row in self.worst if row.get("verdict") == FAILED}
        for message in list(reasons)[:3]:
            yield f"Failed: {message}"
        if self.aside:
            yield (
                f"{self.aside} were set aside, since their process died, took too long or went wrong; "
                f"{self.folder}/aside has the error of each and the command that runs it alone."
            )
        if self.skipped:
            yield f"No logs, and left out: {listed(self.skipped)}"
        if self.others:
            yield f"{self.others} other rows, of an earlier plan, version or model, are {OUTSIDE}."
        if self.done == self.total:
            yield f"Table: {self.folder / RESULTS_FILE}"


def shown_cell(value: Any, name: str) -> str:
    """A value of the table for people."""
    if value is None:
        return "–"
    if name.startswith("relative"):
        return percent(value)
    return number(value) if isinstance(value, float) else str(value)


@dataclass(frozen=True, eq=False, repr=False)
class Group(Report):
    """Rows of one setting: a case for the reports of a CI."""

    name: str
    verdicts: Mapping[str, int]
    exit_codes: tuple[int, ...]
    worst: tuple[Mapping[str, Any], ...]

    @property
    def exit_code(self) -> int:
        """As of a fleet."""
        return worst_code(self.exit_codes)

    def summary(self) -> str:
        """The worst verdict, and how many of each."""
        worst = next((v for v in WORST_FIRST if self.verdicts.get(v)), "consistent")
        counts = ", ".join(f"{self.verdicts[v]} {v}" for v in WORST_FIRST if self.verdicts.get(v))
        return f"{worst}: {counts}"

    def sections(self) -> Iterator[Section]:
        """Counts, and the worst row."""
        yield self.summary()
        for row in self.worst:
            yield ", ".join(f"{n} {shown_cell(v, n)}" for n, v in row.items() if v is not None)


SETTING_WORDS = {"step": "step {} s", "solver_tolerance": "tolerance {}", "duration": "{} s long"}
"""What is said of the numbers of a setting."""


def _setting(row: Mapping[str, Any], names: Iterable[str]) -> str:
    """A setting in words, without what its solver has not."""
    setting = {n: row[n] for n in names if row[n] is not None}
    return ", ".join(
        SETTING_WORDS[n].format(number(value)) if n in SETTING_WORDS else str(value)
        for n, value in setting.items()
    )


def _counted(frame: polars.DataFrame) -> dict[str, int]:
    if "verdict" not in frame.columns:
        return {}
    return {str(v): int(n) for v, n in frame["verdict"].value_counts(sort=True).iter_rows()}


def _exit_codes(frame: polars.DataFrame) -> tuple[int, ...]:
    if "exit_code" in frame.columns:
        return tuple(sorted(int(code) for code in frame["exit_code"].drop_nulls().unique()))
    codes = {FAILED: 2, **{str(verdict): code for verdict, code in EXIT_CODES.items()}}
    return tuple(sorted({codes[verdict] for verdict in _counted(frame)}))


HIDDEN = ("details", "text", "report", "confidence", "seconds", "evaluations", "energy")


def _worst(frame: polars.DataFrame, most: int) -> tuple[Mapping[str, Any], ...]:
    """The worst rows, failed ones, then wrong ones by energy error: setting, and what differs in them."""
    import polars

    if "verdict" not in frame.columns:
        return ()
    rank = {verdict: k for k, verdict in enumerate(WORST_FIRST)}
    bad = frame.filter(polars.col("verdict") != "consistent")
    order = polars.col("verdict").replace_strict(rank, default=len(rank))
    bad = bad.sort(order, -polars.col("relative"), maintain_order=True, nulls_last=True)
    # Neither those that failed nor those that are wrong hide the others.
    failed = polars.col("verdict") == FAILED
    judged = bad.filter(~failed)
    bad = polars.concat([bad.filter(failed).head(max(most - len(judged), (most + 1) // 2)), judged])
    bad = bad.head(most)
    keep = [
        n
        for n in bad.columns
        if n in ("address", "message", "verdict", "relative")
        or (is_point(n) and frame[n].n_unique() > 1 and bad[n].count())
        or (n not in HIDDEN and bad[n].n_unique() > 1 and not n.startswith("delta_c."))
    ]
    return tuple(bad.select(keep).to_dicts())


def summarise(store: Store, frame: polars.DataFrame, total: int, others: int) -> Fleet:
    """The fleet of the rows that are there."""
    return Fleet(
        kind=str(store.head.get("kind")),
        name=str(store.head.get("name")),
        folder=store.folder,
        total=total,
        done=len(frame),
        verdicts=_counted(frame),
        aside=len(store.aside()),
        others=others,
        exit_codes=_exit_codes(frame),
        worst=_worst(frame, SHOWN),
        skipped=tuple(map(str, store.head.get("skipped", ()))),
    )


@checked
def fleet_status(folder: str | Path) -> Fleet:
    """The contents of a folder of results, finished or not, even while another process writes to it.

    Raises InputError for a folder that does not hold results of deltac, or those of a later version.
    """
    store = Store.open(Path(folder))
    planned, rows = store.planned(), store.rows()
    frame = store.table(rows)
    return summarise(store, frame, len(planned), len(rows) - len(frame))
