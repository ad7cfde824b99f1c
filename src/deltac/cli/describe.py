"""`deltac describe`: what a model is, before anything is simulated."""

from __future__ import annotations

from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import deliver


def command(
    model: options.Model,
    state: options.StartState = None,
    values: options.Parameters = None,
    numbers: Annotated[
        bool,
        typer.Option("--numbers", help="List only the named parameters and numbers."),
    ] = False,
    page: options.PageFile = None,
    as_json: options.Json = False,
) -> None:
    """Show bodies, joints, degrees of freedom, class of constraints, conserved quantities, energies."""
    from deltac.analysis.classify import classify

    chosen = options.with_parameters(model, values)
    if numbers:
        _list(chosen, as_json)
    else:
        deliver(classify(chosen, state), options.Form.text.unless(as_json), name=model, page=page)


def _list(model: object, as_json: bool) -> None:
    import json

    from deltac.models import load_model

    found = dict(load_model(model).mechanism.numbers)  # type: ignore[arg-type]
    wide = max(map(len, found), default=0)
    lines = [f"{name:{wide}}  {value:.9g}" for name, value in found.items()]
    typer.echo(json.dumps(found) if as_json else "\n".join(lines))
