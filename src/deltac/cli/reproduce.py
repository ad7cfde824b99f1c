"""`deltac reproduce`: the thesis's study, ten figures and one table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli.output import (
    Json,
    new_table,
    number,
    print_json,
    print_table,
    print_text,
    progress_bar,
)

if TYPE_CHECKING:
    from deltac.studies.thesis import Reproduction, Result
    from deltac.studies.thesis.drawing import Written

RUNS = 0.85
"""The share of the runs in the time that it all takes; the rest is drawing."""


def command(
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="FIGURE",
            help="Only these figures: 4.7, or 4.1,4.2; repeatable. floor: what inexact accelerations do.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where figures and results.json go.")
    ] = Path("results/thesis"),
    thesis_axes: Annotated[
        bool, typer.Option("--thesis-axes", help="Draw the panels and axes of the thesis.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Reproduce the thesis's study (figs. 4.1 to 4.10).

    Exit status 0 if everything agrees but the known differences, which the table marks; else 1.
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
    (_print_json if as_json else _print)(reproduction, written)
    raise typer.Exit(0 if reproduction.agrees else 1)


def _print_json(reproduction: Reproduction, written: Written) -> None:
    print_json(
        {
            "results": [row.to_dict() for row in reproduction.results],
            "known_differences": [
                {
                    "figure": row.figure,
                    "run": row.run,
                    "quantity": row.quantity,
                    "why": row.difference,
                }
                for row in reproduction.differences
                if row.difference
            ],
            "assumed": {e.figure: e.assumed for e in reproduction.experiments if e.assumed},
            "agrees": reproduction.agrees,
            "figures": [str(path) for path in written.figures],
            "results_file": str(written.results),
        }
    )


def _print(reproduction: Reproduction, written: Written) -> None:
    reasons = list(dict.fromkeys(r.difference for r in reproduction.differences if r.difference))
    table = new_table()
    table.expand = True
    table.add_column("experiment", ratio=9)
    table.add_column("the thesis reports", ratio=9)
    table.add_column("we measure", ratio=20)
    table.add_column("agrees?", no_wrap=True)
    for experiment in reproduction.experiments:
        name, said = f"{experiment.figure}  {experiment.title}", ""
        for row in reproduction.results:
            if row.figure == experiment.figure and row.judged:
                again, said = said, _reported(row)
                reported = "" if said == again else said
                table.add_row(name, reported, _measured(row), _verdict(row, reasons))
                name = ""
        table.add_section()
    print_table(table)
    for k, reason in enumerate(reasons, 1):
        print_text(f"[{k}] {reason}")
    for experiment in reproduction.experiments:
        if experiment.assumed:
            print_text(f"{experiment.figure}: we chose {experiment.assumed}.")
    folder = written.results.parent
    if written.figures:
        typer.echo(f"figures: {folder / 'figure_*.png'} ({len(written.figures)})")
    typer.echo(f"results: {written.results} ({len(reproduction.results)} numbers)")


def _reported(row: Result) -> str:
    return number(row.thesis, row.unit) if isinstance(row.thesis, float) else row.thesis or "–"


def _measured(row: Result) -> str:
    return f"{row.run}: {row.quantity} = {number(row.value, row.unit)}"


def _verdict(row: Result, reasons: list[str]) -> str:
    if row.agrees:
        return "yes"
    return f"no \\[{reasons.index(row.difference) + 1}]" if row.difference else "[bold red]NO[/]"
