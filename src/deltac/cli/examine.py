"""`deltac examine`: the whole procedure for a model, its equations and its log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import deliver, progress_bar


def command(
    model: options.Model,
    duration: options.Duration = None,
    equations: options.OwnEquations = None,
    log: Annotated[
        Path | None, typer.Option(metavar="LOG", help="A log of this model from another program.")
    ] = None,
    mapping: options.MappingFile = None,
    tolerance: options.Tolerance = 1e-6,
    state: options.StartState = None,
    figure: options.FigureFile = None,
    page: options.PageFile = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Check the equations, choose solver and step, study the remaining error, audit the log.

    Exit code 0 if all parts hold, 1 if something is wrong, 3 if unresolved.
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
