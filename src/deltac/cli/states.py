"""`deltac states`: states at which a program in any language is to say what the accelerations are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltac.cli import options


def command(
    model: options.Model,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.csv", help="The table to write.")],
    coordinates: options.OwnCoordinates = None,
    count: options.StateCount = 64,
    seed: options.Seed = 0,
) -> None:
    """Write random states of a model to a table, to check a program in another language.

    The program fills in the columns udot.<speed> (and may add qdot.<coordinate>); then
    `deltac check MODEL FILE.csv` tests them.
    """
    from deltac.diagnosis.check.table import write_states
    from deltac.diagnosis.inputs.equations import load_map

    chosen = None if coordinates is None else load_map(coordinates)
    states = write_states(model, out, coordinates=chosen, count=count, seed=seed)
    typer.echo(
        f"{out}: {len(states)} states of {', '.join(states.coordinates)}. Fill in "
        f"{', '.join(f'udot.{name}' for name in states.speeds)}, then: deltac check {model} {out}"
    )
