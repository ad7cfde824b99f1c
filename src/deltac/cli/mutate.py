"""`deltac mutate`: how well do the tests protect equations written by hand?"""

from __future__ import annotations

from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import deliver, progress_bar


def command(
    model: options.Model,
    equations: Annotated[
        str, typer.Argument(metavar="FILE.py:FUNCTION", help="A function of (t, q, u) → u̇.")
    ],
    coordinates: options.OwnCoordinates = None,
    names: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Number of other names to substitute for each use of a name."
        ),
    ] = 2,
    seed: options.Seed = 0,
    tests: Annotated[
        str | None,
        typer.Option(
            metavar="COMMAND",
            help='Your own tests, such as "pytest tests/": which mistakes do they miss? They run in a copy '
            "of the project.",
        ),
    ] = None,
    most: Annotated[
        int, typer.Option(min=1, metavar="N", help="With --tests: number of mutants.")
    ] = 40,
    figure: options.FigureFile = None,
    page: options.PageFile = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Make small mistakes in equations on purpose, and see which tests notice.

    Exit code 1 if the equations are wrong as they are, or your tests (--tests) miss a mistake; else 0.
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
    deliver(found, form.unless(as_json), name=equations, figure=figure, page=page)
