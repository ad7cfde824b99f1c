"""Rows of the table: what whoever does the work hands back, as a small Parquet file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from deltac.foreign.isolation import Failure

Piece = TypeVar("Piece", bound=Any)

TEXT, NUMBER = "text", "number"
"""Kinds of columns."""

FAILED = "failed"
"""The verdict of a row that could not be made: its code and message say why."""

SETTING = ("model", "solver", "step", "solver_tolerance", "duration")
"""Columns that tell the setting of a run."""

POINT = ("log", "episode", *SETTING)


def is_point(column: str) -> bool:
    """Whether a column tells what a row is of: its log, its setting, the value of an axis."""
    group, dot, _ = column.partition(".")
    return column in POINT or bool(dot) and group in ("parameter", "q", "u")


MEASURED = ("seconds",)
"""Columns that differ between two runs of the same work."""


def rows_as_parquet(
    addresses: Sequence[str],
    point: Mapping[str, tuple[str, Any]],
    kinds: Mapping[str, str],
    outcome: Mapping[str, Any],
) -> bytes:
    """Rows of the table: address, what they are of, what came of them; what is not a number is null.

    `point` and `outcome` hold a sequence for each column, `kinds` the columns of the outcome, in order; those
    it lacks are null.
    """
    import polars

    types = {TEXT: polars.String, NUMBER: polars.Float64}
    nothing = [None] * len(addresses)
    columns = [polars.Series("address", addresses, polars.String)]
    for name, (kind, values) in point.items():
        columns.append(polars.Series(name, values, types[kind], strict=False))
    for name, kind in kinds.items():
        columns.append(polars.Series(name, outcome.get(name, nothing), types[kind], strict=False))
    frame = polars.DataFrame(columns).with_columns(polars.col(polars.Float64).fill_nan(None))
    target = io.BytesIO()
    frame.write_parquet(target)
    return target.getvalue()


def halved(piece: Piece, *names: str) -> tuple[Piece, Piece]:
    """A piece of work as two, cut in the middle of what it has of each row, by name."""
    middle = len(piece.addresses) // 2
    first, second = (
        replace(piece, **{name: getattr(piece, name)[part] for name in names})
        for part in (slice(None, middle), slice(middle, None))
    )
    return first, second


def failed_outcome(failure: Failure) -> dict[str, list[Any]]:
    """The outcome of a single row that could not be made."""
    return {
        "verdict": [FAILED],
        "code": [failure.code],
        "message": [failure.message],
        "details": [failure.details or None],
    }
