"""Commands that call one verb and print what it found."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from deltac.cli.options import MappingFile, Model, Parameters, Verb, of, with_parameters
from deltac.cli.output import progress_bar
from deltac.errors import InputError

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
        report = examine(with_parameters(model, values), log=log, progress=progress)
    deliver(report, name=model, model=model)


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
    numbers_by_name = dict(load_model(chosen).mechanism.numbers)
    wide = max(map(len, numbers_by_name), default=0)
    lines = (f"{name:{wide}}  {value:.9g}" for name, value in numbers_by_name.items())
    typer.echo(json.dumps(numbers_by_name) if deliver.keywords["as_json"] else "\n".join(lines))


@of(study="deltac.diagnosis.study.study", deliver=PRINTED)
def study(
    study: Verb,
    deliver: Verb,
    model: Model,
    steps: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,C", help="Steps (s): three or more, each half of the previous one."
        ),
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option(
            metavar="SOLVER",
            help="ode1 … ode8, …, or mujoco:rk4, mujoco:euler, … (if MODEL is a file).",
        ),
    ] = None,
    tolerances: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="In place of steps, for adaptive solvers (DOP853 …)."),
    ] = None,
    logs: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="A log of the motion at one step; repeat for each step."),
    ] = None,
    mapping: MappingFile = None,
    values: Parameters = None,
) -> None:
    """Study a motion at several steps: is the energy error the integrator's or the equations'?

    Exit code 0 if the energy balance holds within the tolerance at the finest step, 1 if not, 3 if
    unresolved.
    """
    from deltac.simulation.solvers import solver_options

    source = with_parameters(model, values)
    by: Any = solver
    if tolerances is not None:
        values_of_tolerance = _numbers(tolerances, "--tolerances")
        by = [solver_options(solver or "DOP853", tolerance) for tolerance in values_of_tolerance]
    keywords: dict[str, Any] = {} if steps is None else {"steps": _numbers(steps, "--steps")}
    with progress_bar() as progress:
        if logs:
            from deltac.models import load_model
            from deltac.verbs import read_trajectory

            mechanism = load_model(source).mechanism
            keywords["runs"] = [read_trajectory(log, mapping, mechanism) for log in logs]
        report = study(source, solver=by, **keywords, progress=progress)
    deliver(report, name=model)


def _numbers(text: str, option: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"{option} {text!r}: expected numbers with commas between them, such as 1e-2,5e-3,2.5e-3"
        ) from None


@of(recommend="deltac.diagnosis.recommend.recommend", deliver=PRINTED)
def recommend(recommend: Verb, deliver: Verb, model: Model, values: Parameters = None) -> None:
    """Find the cheapest solver and step that keep a tolerance, by trial runs.

    Exit code 0 if the recommendation is verified, 1 if no trial keeps the tolerance, 3 if nothing moves.
    """
    with progress_bar() as progress:
        report = recommend(with_parameters(model, values), progress=progress)
    deliver(report, name=model, model=model)


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
        report = mutate_equations(model, equations, progress=progress)
    deliver(report, name=equations)


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
