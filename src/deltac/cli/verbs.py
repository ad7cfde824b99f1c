"""Commands that call one verb and print what it found."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from deltac.cli.options import Model, Parameters, Verb, of, with_parameters
from deltac.cli.output import progress_bar

PRINTED = "deltac.cli.output"


@of(examine="deltac.procedure", deliver=PRINTED)
def examine(
    examine: Verb,
    deliver: Verb,
    model: Model,
    log: Annotated[
        Path | None, typer.Option(metavar="LOG", help="A log of this model from another program.")
    ] = None,
    values: Parameters = None,
) -> None:
    """Check the equations, choose solver and step, study the remaining error, audit the log.

    Exit code 0 if all parts hold, 1 if something is wrong, 3 if unresolved.
    """
    with progress_bar() as progress:
        found = examine(with_parameters(model, values), log=log, progress=progress)
    deliver(found, name=model, model=model)


@of(classify="deltac.analysis.classify", deliver=PRINTED, without="figure")
def describe(
    classify: Verb,
    deliver: Verb,
    model: Model,
    values: Parameters = None,
    numbers: Annotated[
        bool, typer.Option("--numbers", help="List only the named parameters and numbers.")
    ] = False,
) -> None:
    """Show bodies, joints, degrees of freedom, class of constraints, conserved quantities, energies."""
    from deltac.models import load_model

    chosen = with_parameters(model, values)
    if not numbers:
        deliver(classify(chosen), name=model)
    found = dict(load_model(chosen).mechanism.numbers)
    wide = max(map(len, found), default=0)
    lines = (f"{name:{wide}}  {value:.9g}" for name, value in found.items())
    typer.echo(json.dumps(found) if deliver.keywords["as_json"] else "\n".join(lines))


@of(recommend="deltac.diagnosis.recommend.recommend", deliver=PRINTED, without="equations")
def recommend(
    recommend: Verb,
    deliver: Verb,
    model: Model,
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            "--control",
            metavar="FILE.py:FUNCTION",
            help="Controller of a MuJoCo model: a function of (model, data).",
        ),
    ] = None,
    values: Parameters = None,
) -> None:
    """Find the cheapest solver and step that keep a tolerance, by trial runs.

    Exit code 0 if the recommendation is verified, 1 if no trial keeps the tolerance, 3 if nothing moves.
    """
    from deltac.models import load_callable

    chosen = None if controller is None else load_callable(controller)
    with progress_bar() as progress:
        found = recommend(with_parameters(model, values), controller=chosen, progress=progress)
    deliver(found, name=model, model=model)


@of(mutate_equations="deltac.repair.mutate.report", deliver=PRINTED)
def mutate(
    mutate_equations: Verb,
    deliver: Verb,
    model: Model,
    equations: Annotated[
        str, typer.Argument(metavar="FILE.py:FUNCTION", help="A function of (t, q, u) → u̇.")
    ],
) -> None:
    """Make small mistakes in equations on purpose, and see which tests notice.

    Exit code 1 if the equations are wrong as they are, or your tests (--tests) miss a mistake; else 0.
    """
    with progress_bar() as progress:
        found = mutate_equations(model, equations, progress=progress)
    deliver(found, name=equations)


@of(compare="deltac.fleets.compare", deliver=PRINTED, without="figure")
def compare(
    compare: Verb,
    deliver: Verb,
    before: Annotated[
        Path, typer.Argument(metavar="BEFORE", help="Results of a sweep or of audits.")
    ],
    after: Annotated[
        Path, typer.Argument(metavar="AFTER", help="Later results of the same runs or logs.")
    ],
) -> None:
    """Compare two folders of results row by row: what got worse?

    Exit code 1 if a verdict got worse or an energy error grew, 3 if rows are missing in AFTER, else 0.
    """
    deliver(compare(before, after), name=str(after))


@of(write_states="deltac.diagnosis.check.table")
def states(
    write_states: Verb,
    model: Model,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.csv", help="The table to write.")],
) -> None:
    """Write random states of a model to a table, to check a program in another language.

    The program fills in the columns udot.<speed> (and may add qdot.<coordinate>); then
    `deltac check MODEL FILE.csv` tests them.
    """
    states = write_states(model, out)
    typer.echo(
        f"{out}: {len(states)} states of {', '.join(states.coordinates)}. Fill in "
        f"{', '.join(f'udot.{name}' for name in states.speeds)}, then: deltac check {model} {out}"
    )
