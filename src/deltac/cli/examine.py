"""`deltac examine`: the whole procedure for a model, its equations and its log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltac.cli.output import (
    FigureFile,
    Form,
    Format,
    Json,
    Model,
    PageFile,
    StartState,
    deliver,
    progress_bar,
)


def command(
    model: Model,
    duration: Annotated[float | None, typer.Option(help="How long the motion lasts (s).")] = None,
    equations: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.py:FUNCTION", help="Equations of motion by hand: u̇ = FUNCTION(t, q, u)."
        ),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="LOG", help="A log of this model, made elsewhere.")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Column names and units of the log (TOML).")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="Accepted |ΔC| as a fraction of the energy exchanged.")
    ] = 1e-6,
    state: StartState = None,
    figure: FigureFile = None,
    page: PageFile = None,
    form: Format = Form.text,
    as_json: Json = False,
) -> None:
    """Check the equations, choose solver and step, study what error is left, audit the log.

    Exit code 0 if all of it holds, 1 if something is wrong, 3 if that cannot be told.
    """
    from deltac.diagnosis.inputs.equations import load_equations
    from deltac.procedure import examine

    with progress_bar() as progress:
        found = examine(
            model,
            state,
            duration=duration,
            equations=None if equations is None else load_equations(equations),
            log=log,
            mapping=mapping,
            tolerance=tolerance,
            progress=progress,
        )
    deliver(found, form.unless(as_json), name=model, figure=figure, page=page, model=model)
