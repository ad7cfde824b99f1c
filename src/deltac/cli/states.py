"""`deltac states`: states at which a program in any language is to say what the accelerations are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltac.cli.output import Model


def command(
    model: Model,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.csv", help="Where the states are written.")
    ],
    coordinates: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:MAP",
            help="The program's coordinates: joint, absolute, or a CoordinateMap.",
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="How many random states.")] = 64,
    seed: Annotated[int, typer.Option(help="Which random states.")] = 0,
) -> None:
    """Write random states of a model to a table, for a program that is to be checked.

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
