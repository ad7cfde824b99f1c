"""Rows of the table: what each is of, and what came of it."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

from deltac.arrays import max_norm
from deltac.foreign.isolation import Failure

if TYPE_CHECKING:
    import polars

    from deltac.diagnosis import Audit

TEXT, NUMBER = "text", "number"
"""Kinds of columns."""

FAILED = "failed"
"""The verdict of a row that could not be made: its code and message say why."""


@dataclass(frozen=True)
class Setting:
    """What the runs of an ensemble share; None is the model's own."""

    model: str
    solver: str | None
    step: float | None
    solver_tolerance: float | None
    duration: float | None


SETTING = tuple(field.name for field in fields(Setting))
"""Columns that tell the setting of a run."""

AXIS_GROUPS = ("parameter", "q", "u")
"""What else varies: "parameter.m", "q.hip", "u.hip"."""

POINT = ("log", "episode", "motion", *SETTING)

LONG_PIECE = 8
"""Studies, audits or runs of other simulators in a piece of work: each takes seconds."""

PIECES_A_WORKER = 4
"""Pieces for a worker, at least, so that none waits long for the last one."""


def is_point(column: str) -> bool:
    """Whether a column tells what a row is of: its log, its setting, the value of an axis."""
    group, dot, _ = column.partition(".")
    return column in POINT or bool(dot) and group in AXIS_GROUPS


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of work: a picklable call that finds what some rows of the table hold.

    needs    modules that a worker loads when it starts
    kinds    columns of the outcome, in order, and their kinds
    per_row  the field that holds something of each row, beside their `addresses`
    """

    needs: ClassVar[tuple[str, ...]] = ()
    kinds: ClassVar[Mapping[str, str]] = {}
    per_row: ClassVar[str] = ""

    addresses: tuple[str, ...]

    def point(self) -> Mapping[str, tuple[str, Any]]:
        """What the rows are of: columns with their kinds and values."""
        raise NotImplementedError

    def outcome(self) -> Mapping[str, Any]:
        """What came of them, in a worker: columns with a value for each row; those it lacks are null."""
        raise NotImplementedError

    def about(self) -> dict[str, Any]:
        """What the first row is of, in terms of JSON."""
        raise NotImplementedError

    @property
    def rows(self) -> int:
        """How many rows it makes."""
        return len(self.addresses)

    def __call__(self) -> Mapping[str, Any]:
        """Their outcome. Its table is made where it is written, so that workers need no Polars."""
        return self.outcome()

    def halves(self) -> tuple[Self, Self]:
        """Two pieces that make the same rows, to find the one that fails."""
        middle, of_each = self.rows // 2, ("addresses", self.per_row)
        first, second = (
            replace(self, **{name: getattr(self, name)[part] for name in of_each})
            for part in (slice(None, middle), slice(middle, None))
        )
        return first, second

    def table(self, outcome: Mapping[str, Any]) -> polars.DataFrame:
        """The rows with what came of them."""
        import polars

        types = {TEXT: polars.String, NUMBER: polars.Float64}
        nothing = [None] * self.rows
        columns = {"address": (TEXT, self.addresses), **self.point()}
        columns |= {name: (kind, outcome.get(name, nothing)) for name, kind in self.kinds.items()}
        return polars.DataFrame(
            polars.Series(name, values, types[kind], strict=False)
            for name, (kind, values) in columns.items()
        ).with_columns(polars.col(polars.Float64).fill_nan(None))


def parquet(frame: polars.DataFrame) -> bytes:
    """A table as the content of a Parquet file."""
    target = io.BytesIO()
    frame.write_parquet(target, compression_level=1)  # addresses are noise: more is no shorter
    return target.getvalue()


AUDITED: Mapping[str, str] = {
    "verdict": TEXT,
    "confidence": TEXT,
    "relative": NUMBER,
    "energy_error": NUMBER,
    "energy": NUMBER,
    "error_bar": NUMBER,
    "samples": NUMBER,
    "exit_code": NUMBER,
    "findings": TEXT,
    "seconds": NUMBER,
    "code": TEXT,
    "message": TEXT,
    "details": TEXT,
}
"""What a table says of every audit; energies in J."""


def audited_row(audit: Audit, seconds: float) -> dict[str, Any]:
    """The row of an audit that took so many seconds."""
    return {
        "verdict": audit.verdict.kind,
        "confidence": audit.verdict.confidence,
        "relative": audit.relative,
        "energy_error": max_norm(audit.energy_error),
        "energy": audit.reference_energy,
        "error_bar": float(audit.ledger.error_bar[audit.function].max()),
        "samples": float(audit.samples),
        "exit_code": float(audit.exit_code),
        "findings": " ".join(f.code for f in audit.findings) or None,
        "seconds": seconds,
        "message": audit.summary(),
        "details": audit.explain() if audit.exit_code else None,
    }


def failed_row(failure: Failure) -> dict[str, Any]:
    """The row of what could not be made."""
    return {
        "verdict": FAILED,
        "code": failure.code,
        "message": failure.message,
        "details": failure.details or None,
        "exit_code": 2.0,
    }


def failed_outcome(failure: Failure) -> dict[str, list[Any]]:
    """The outcome of a single row that could not be made."""
    return {name: [value] for name, value in failed_row(failure).items()}
