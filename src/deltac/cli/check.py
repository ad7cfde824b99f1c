"""`deltac check`: equations written by hand, against a model; nothing is integrated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli.output import Json, new_table, number, print_json, print_table

if TYPE_CHECKING:
    from deltac.diagnosis import EquationCheck


def command(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="A problem's name, an .xml or .urdf file, or FILE.py:FUNCTION."
        ),
    ],
    equations: Annotated[
        str,
        typer.Argument(
            metavar="FILE.py:FUNCTION",
            help="A function of (t, q, u) that returns u̇, or dc.Equations.",
        ),
    ],
    coordinates: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:MAP",
            help="The function's coordinates: joint, absolute, or a CoordinateMap. By default those of "
            "the dc.Equations, or of the problem's own equations, else joint.",
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="How many random states.")] = 64,
    seed: Annotated[int, typer.Option(help="Which random states.")] = 0,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Accepted residual as a fraction of an equation's terms. [default: 1.5e-8]"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check equations of motion at random states: are they the model's, and if not, where do they differ?

    Exit status 0 if they agree, 1 if not, 3 if that cannot be told.
    """
    from deltac.diagnosis.check import TOLERANCE, check_equations
    from deltac.diagnosis.check_files import load_equations, load_map

    found = check_equations(
        model,
        load_equations(equations),
        coordinates=None if coordinates is None else load_map(coordinates),
        count=count,
        seed=seed,
        tolerance=TOLERANCE if tolerance is None else tolerance,
    )
    # What else is asked of wrong equations (such as a repair) goes here, before anything is printed.
    if as_json:
        print_json(found.to_dict())
    else:
        _print(found)
    raise typer.Exit(found.status)


def _print(found: EquationCheck) -> None:
    table = new_table()
    table.add_column("test")
    table.add_column("relative residual", no_wrap=True, justify="right")
    table.add_column("")
    worst = found.to_dict()["relative_residual"]
    for k, (speed, value) in enumerate(worst.items()):
        wrong = any(entry.number == k + 1 for entry in found.blame)
        table.add_row(
            f"equation {k + 1} ({speed})", number(value, digits=2), "fails" if wrong else ""
        )
    table.add_section()
    for seen in found.seen[1:]:
        table.add_row(seen.test, number(seen.relative, digits=2), "fails" if seen.sees else "")
    print_table(table)
    typer.echo("")
    typer.echo(found.explain())
