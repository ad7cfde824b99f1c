"""`deltac reproduce`: the thesis's study, ten figures and one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import COMMAND, deliver, print_sections, progress_bar
from deltac.results import plain

RUNS = 0.85
"""The share of the runs in the time that it all takes; the rest is drawing."""


def command(
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="FIGURE",
            help="Only these figures: 4.7, or 4.1,4.2; repeatable. floor: effect of inexact accelerations.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for figures and results.json.")
    ] = Path("results/thesis"),
    thesis_axes: Annotated[
        bool, typer.Option("--thesis-axes", help="Draw the panels and axes of the thesis.")
    ] = False,
    page: options.PageFile = None,
    as_json: options.Json = False,
) -> None:
    """Reproduce the thesis's study (figs. 4.1 to 4.10).

    Exit code 0 if everything agrees except for known differences, which the table marks; else 1.
    """
    from deltac.report import output_folder
    from deltac.studies.thesis import reproduce, write

    figures = None
    if only is not None:
        figures = [part.strip() for entry in only for part in entry.split(",") if part.strip()]
    output_folder(out)
    with progress_bar() as progress:
        reproduction = reproduce(figures, lambda done: progress(RUNS * done))
        written = write(
            reproduction,
            out,
            lambda done: progress(RUNS + (1 - RUNS) * done),
            thesis_axes=thesis_axes,
        )
    if page is not None:
        reproduction.report(page, command=COMMAND.get())
    if as_json:
        deliver(
            reproduction,
            options.Form.json,
            figures=plain(written.figures),
            results_file=str(written.results),
        )
    print_sections(reproduction.sections())
    if written.figures:
        print(f"figures: {written.results.parent / 'figure_*.png'} ({len(written.figures)})")
    if page is not None:
        print(f"report: {page}")
    print(f"results: {written.results} ({len(reproduction.results)} numbers)")
    raise typer.Exit(reproduction.exit_code)
