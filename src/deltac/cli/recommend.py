"""`deltac recommend`: solver and step for a tolerance."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli.output import (
    Json,
    new_table,
    number,
    print_json,
    print_table,
    progress_bar,
)

if TYPE_CHECKING:
    from deltac.diagnosis.recommend.result import Advice


def command(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="A problem's name, an .xml or .urdf file, or FILE.py:FUNCTION."
        ),
    ],
    tolerance: Annotated[
        float, typer.Option(help="Accepted |ΔC| as a share of the energy turned over.")
    ] = 1e-6,
    motion_tolerance: Annotated[
        float | None,
        typer.Option(
            help="Accepted error of q and u as a share of their ranges; inf: none is asked for. "
            "[default: the tolerance]"
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Length of the motion in s. [default: the problem's]")
    ] = None,
    solvers: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Choose from these, for example ode4,ode5 or mujoco:rk4."),
    ] = None,
    control: Annotated[
        str | None,
        typer.Option(metavar="FILE.py:FUNCTION", help="Input of a MuJoCo model: (model, data)."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw work against precision (PNG).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the cheapest solver and step that keep a tolerance, by trying them.

    Exit status 0 with a verified advice, 1 if nothing that was tried keeps the tolerance.
    """
    from deltac.diagnosis.inputs.models import load_callable
    from deltac.diagnosis.recommend.recommend import recommend

    if figure is not None:
        from deltac.report import check_figure

        check_figure(figure)
    chosen = None
    if solvers is not None:
        chosen = [name.strip() for name in solvers.split(",") if name.strip()]
    with progress_bar() as progress:
        advice = recommend(
            model,
            duration=duration,
            tolerance=tolerance,
            motion_tolerance=motion_tolerance,
            solvers=chosen,
            control=None if control is None else load_callable(control),
            progress=progress,
        )
    if figure is not None:
        from deltac.report import recommendation_figure, write_figure

        write_figure(recommendation_figure(f"{model}: work and precision", advice), figure)
    if as_json:
        print_json({**advice.to_dict(), "figure": None if figure is None else str(figure)})
    else:
        _print(advice, figure)
    raise typer.Exit(advice.status)


def _print(advice: Advice, figure: Path | None) -> None:
    table = new_table()
    for column in ("solver", "step or tolerance", "|ΔC|", "motion", "time", "evaluations", ""):
        table.add_column(
            column, no_wrap=True, justify="left" if column in ("solver", "") else "right"
        )
    asked = (advice.tolerance, advice.motion_tolerance)
    marked = {advice.best: "recommended", advice.runner_up: "runner-up"}
    last = ""
    for trial in sorted(advice.trials, key=lambda t: (t.solver, -t.setting)):
        if last and trial.solver != last:
            table.add_section()
        unit = "s" if trial.knob == "step" else ""
        kept = "within" if trial.passes(*asked) else ""
        table.add_row(
            trial.solver if trial.solver != last else "",
            number(trial.setting, unit),
            _share(trial.energy),
            _share(trial.motion),
            number(1e3 * trial.seconds, "ms", digits=3) if math.isfinite(trial.seconds) else "",
            str(trial.evaluations or ""),
            marked.get(trial, "breaks down" if trial.message else kept),
        )
        last = trial.solver
    print_table(table)
    typer.echo("")
    typer.echo(advice.explain())
    if figure is not None:
        typer.echo(f"figure: {figure}")


def _share(value: float) -> str:
    return f"{value:.1e}" if math.isfinite(value) else ""
