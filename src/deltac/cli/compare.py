"""`deltac compare`: two folders of results, before and after a change."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import deliver


def command(
    before: Annotated[
        Path, typer.Argument(metavar="BEFORE", help="Results of a sweep or of audits.")
    ],
    after: Annotated[
        Path, typer.Argument(metavar="AFTER", help="Later results of the same runs or logs.")
    ],
    factor: Annotated[
        float,
        typer.Option(metavar="FACTOR", help="Ratio above which an energy error counts as grown."),
    ] = 2.0,
    page: options.PageFile = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Compare two folders of results row by row: what got worse?

    Exit code 1 if a verdict got worse or an energy error grew, 3 if rows are missing in AFTER, else 0.
    """
    from deltac.fleets.compare import compare

    found = compare(before, after, factor=factor)
    deliver(found, form.unless(as_json), name=str(after), page=page)
