"""`deltac recommend`: solver and step for a tolerance."""

from __future__ import annotations

from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import deliver, progress_bar


def command(
    model: options.Model,
    tolerance: options.Tolerance = 1e-6,
    motion_tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="FRACTION",
            help="Accepted error of q and u as a share of their ranges; inf: not tested. "
            "[default: the tolerance]",
        ),
    ] = None,
    duration: options.Duration = None,
    solvers: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Solvers to try, for example ode4,ode5 or mujoco:rk4."),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            "--control",
            metavar="FILE.py:FUNCTION",
            help="Controller of a MuJoCo model: a function of (model, data).",
        ),
    ] = None,
    figure: options.FigureFile = None,
    page: options.PageFile = None,
    time_limit: Annotated[
        float, typer.Option("--time-limit", metavar="SECONDS", help="Time limit of the search.")
    ] = 120.0,
    state: options.StartState = None,
    values: options.Parameters = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Find the cheapest solver and step that keep a tolerance, by trial runs.

    Exit code 0 if the recommendation is verified, 1 if no trial keeps the tolerance, 3 if nothing moves.
    """
    from deltac.diagnosis.recommend.recommend import recommend
    from deltac.models import load_callable

    chosen = None
    if solvers is not None:
        chosen = [name.strip() for name in solvers.split(",") if name.strip()]
    with progress_bar() as progress:
        found = recommend(
            options.with_parameters(model, values),
            state,
            duration=duration,
            tolerance=tolerance,
            motion_tolerance=motion_tolerance,
            solvers=chosen,
            controller=None if controller is None else load_callable(controller),
            time_limit=time_limit,
            progress=progress,
        )
    deliver(found, form.unless(as_json), name=model, figure=figure, page=page, model=model)
