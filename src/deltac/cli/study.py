"""`deltac study`: the same motion at several steps: the integrator's error, or the equations'?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli import options
from deltac.cli.output import deliver, progress_bar

if TYPE_CHECKING:
    from deltac.simulation.equations import Equations


def command(
    model: options.Model,
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
    duration: options.Duration = None,
    tolerances: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="In place of steps, for adaptive solvers (DOP853 …)."),
    ] = None,
    equations: options.OwnEquations = None,
    logs: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="A log of the motion at one step; repeat for each step."),
    ] = None,
    mapping: options.MappingFile = None,
    tolerance: options.Tolerance = 1e-6,
    figure: options.FigureFile = None,
    page: options.PageFile = None,
    state: options.StartState = None,
    values: options.Parameters = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Study a motion at several steps: is the energy error the integrator's or the equations'?

    Exit code 0 if the energy balance holds within the tolerance at the finest step, 1 if not, 3 if
    unresolved.
    """
    from deltac.diagnosis.study.study import study
    from deltac.models import load_model
    from deltac.simulation.solvers import Options, solver_options
    from deltac.trajectories import read_trajectory

    source = options.with_parameters(model, values)
    chosen: str | list[Options] | None = solver
    if (wanted := _numbers(tolerances, "--tolerances")) is not None:
        chosen = [solver_options(solver or "DOP853", tolerance) for tolerance in wanted]
    with progress_bar() as progress:
        if logs:
            mechanism = load_model(source).mechanism
            runs = [read_trajectory(log, mapping, mechanism) for log in logs]
        found = study(
            source,
            state,
            duration=duration,
            steps=_numbers(steps, "--steps"),
            solver=chosen,
            runs=runs if logs else None,
            tolerance=tolerance,
            progress=progress,
            equations=None if equations is None else _equations(equations),
        )
    deliver(found, form.unless(as_json), name=model, figure=figure, page=page)


def _numbers(text: str | None, option: str) -> tuple[float, ...] | None:
    from deltac.errors import InputError

    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"{option} {text!r}: expected numbers with commas between them, such as 1e-2,5e-3,2.5e-3"
        ) from None


def _equations(text: str) -> Equations:
    """What FILE.py:FUNCTION means: Equations, or the function u̇ = f(t, q, u) itself."""
    from deltac.diagnosis.inputs.equations import load_equations
    from deltac.simulation.equations import Equations

    found = load_equations(text)
    return found if isinstance(found, Equations) else Equations(found, name=text)
