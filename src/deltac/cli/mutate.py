"""`deltac mutate`: how well do the tests protect equations written by hand?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli.output import Json, new_table, print_json, print_table, progress_bar

if TYPE_CHECKING:
    from rich.table import Table

    from deltac.repair.mutate.report import MutationReport


def command(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="A problem's name, an .xml or .urdf file, or FILE.py:FUNCTION."
        ),
    ],
    equations: Annotated[
        str, typer.Argument(metavar="FILE.py:FUNCTION", help="A function of (t, q, u) → u̇.")
    ],
    coordinates: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:MAP",
            help="The function's coordinates: joint, absolute, or a CoordinateMap.",
        ),
    ] = None,
    names: Annotated[
        int, typer.Option(min=0, help="Other names that take the place of each use of a name.")
    ] = 2,
    seed: Annotated[int, typer.Option(help="Which names and states are drawn.")] = 0,
    tests: Annotated[
        str | None,
        typer.Option(
            metavar="COMMAND",
            help='Your own tests, such as "pytest tests/": which mistakes do they miss? They run in a copy '
            "of the project.",
        ),
    ] = None,
    most: Annotated[int, typer.Option(min=1, help="With --tests: on how many mutants.")] = 40,
    as_json: Json = False,
) -> None:
    """Change equations in every small way, and see which tests notice.

    Exit status 1 if the equations are wrong as they are, or your tests (--tests) miss a mistake; else 0.
    """
    from deltac.diagnosis.inputs.equations import load_map
    from deltac.repair.mutate.report import mutate_equations

    with progress_bar() as progress:
        found = mutate_equations(
            model,
            equations,
            coordinates=None if coordinates is None else load_map(coordinates),
            names=names,
            seed=seed,
            tests=tests,
            most=most,
            progress=progress,
        )
    if as_json:
        print_json(found.to_dict())
    else:
        _print(found)
    raise typer.Exit(found.status)


def _print(found: MutationReport) -> None:
    print_table(_table(found))
    typer.echo("")
    typer.echo(found.explain())


def _table(found: MutationReport) -> Table:
    table = new_table()
    table.add_column("mutants", no_wrap=True)
    for column in ("made", "equivalent", *found.tests):
        table.add_column(HEADS.get(column, column), justify="right")
    for kind, row in found.table().items():
        if kind == "all":
            table.add_section()
        table.add_row(kind, *(str(value) for value in row.values()))
    return table


HEADS = {
    "equivalent": "equal",
    "kane-levinson-1988": "kane\n1988",
    "kane-levinson-1990": "kane\n1990",
    "liu-huston": "liu",
    "momentum": "mom.",
    "coordinate residual": "F + F*",
    "constraints": "ties",
}
"""Heads of short words, on two lines: all columns have room in a terminal of 80 columns."""
