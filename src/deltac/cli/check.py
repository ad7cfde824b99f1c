"""`deltac check`: equations written by hand, against a model; nothing is integrated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.cli.output import Form, Format, Json, Model, deliver, progress_bar

if TYPE_CHECKING:
    from deltac.repair import Repair


def command(
    model: Model,
    equations: Annotated[
        str,
        typer.Argument(
            metavar="FILE.py:FUNCTION",
            help="A function of (t, q, u) that returns u̇, or dc.Equations.",
        ),
    ],
    coordinates: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:MAP",
            help="The function's coordinates: joint, absolute, or a CoordinateMap. By default those of "
            "the dc.Equations, or of the problem's own equations, else joint.",
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="How many random states.")] = 64,
    seed: Annotated[int, typer.Option(help="Which random states.")] = 0,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Accepted residual as a fraction of an equation's terms. [default: 1.5e-8]"
        ),
    ] = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Seek the line, the expression and the edit.")
    ] = False,
    write: Annotated[
        Path | None,
        typer.Option(metavar="FILE.patch", help="With --repair: write the least edit as a patch."),
    ] = None,
    form: Format = Form.text,
    as_json: Json = False,
) -> None:
    """Check equations of motion at random states: are they the model's, and if not, where do they differ?

    Exit code 0 if they agree, 1 if not, 3 if that cannot be told.
    """
    from deltac.diagnosis.check.check import TOLERANCE, check_equations
    from deltac.diagnosis.inputs.equations import load_equations, load_map

    rhs = load_equations(equations)
    chosen = None if coordinates is None else load_map(coordinates)
    # First, because it reads the function without running it: one that never ends is named, not awaited.
    repaired = None
    if repair or write:
        with progress_bar("seeking the edit"):
            repaired = _repair(model, equations, rhs, chosen, seed)
    with progress_bar(f"checking at {count} random states"):
        found = check_equations(
            model,
            rhs,
            coordinates=chosen,
            count=count,
            seed=seed,
            tolerance=TOLERANCE if tolerance is None else tolerance,
        )
    if write is not None and repaired is not None and repaired.fixes:
        from deltac.report.files import write_text

        write_text(repaired.fixes[0].diff, write)
    more = () if repaired is None else (repaired,)
    deliver(found, form.unless(as_json), *more, name=equations)


def _repair(model: str, text: str, rhs: Any, coordinates: Any, seed: int) -> Repair:
    """Seek the edit: in the function that the text names, or that the `Equations` there have."""
    from deltac.repair import repair_equations
    from deltac.simulation.equations import Equations

    return repair_equations(
        model, rhs if isinstance(rhs, Equations) else text, coordinates=coordinates, seed=seed
    )
