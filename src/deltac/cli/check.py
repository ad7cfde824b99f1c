"""`deltac check`: equations written by hand, against a model; nothing is integrated."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from deltac.cli import options
from deltac.cli.output import deliver, progress_bar
from deltac.errors import ArgumentsError, InputError, LimitError

if TYPE_CHECKING:
    from deltac.repair.outcome import NoRepair, Repair


def command(
    model: options.Model,
    equations: Annotated[
        str,
        typer.Argument(
            metavar="FILE.py:FUNCTION",
            help="A function of (t, q, u) that returns u̇, one of (t, y) that returns ẏ, dc.Equations; "
            "LIBRARY.so:FUNCTION; UNIT.fmu (model exchange); or a table of `deltac states`, filled in.",
        ),
    ],
    coordinates: options.OwnCoordinates = None,
    count: options.StateCount = 64,
    seed: options.Seed = 0,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="FRACTION",
            help="Accepted residual as a fraction of an equation's terms. [default: 1.5e-8]",
        ),
    ] = None,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair", help="Find the line, the expression and the edit that corrects it."
        ),
    ] = False,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.patch", help="With --repair: write the smallest edit as a patch."
        ),
    ] = None,
    limit: Annotated[
        float,
        typer.Option(
            "--time-limit", min=0.1, metavar="SECONDS", help="Time limit of the function's calls."
        ),
    ] = 300.0,
    figure: options.FigureFile = None,
    page: options.PageFile = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Check equations of motion at random states: are they the model's, and if not, where do they differ?

    Exit code 0 if they agree, 1 if not, 3 if unresolved.
    """
    from deltac.diagnosis.check.check import TOLERANCE, check_equations
    from deltac.diagnosis.inputs.equations import load_equations, load_map

    if equations.lower().endswith(".csv"):
        if repair or write:
            raise ArgumentsError(
                "--repair seeks an edit in the text of a function, FILE.py:FUNCTION; a table has none"
            )
        _check_table(model, equations, coordinates, tolerance, form.unless(as_json), figure, page)
    chosen = None if coordinates is None else load_map(coordinates)
    rhs = load_equations(equations, _names(model, chosen) if equations.endswith(".fmu") else ())
    # First, because it reads the function without running it: one that never ends is named, not awaited.
    repaired = refused = None
    if repair or write:
        from deltac.repair.repair import TIME_LIMIT

        with progress_bar(f"seeking the edit, at most {TIME_LIMIT:g} s"):
            repaired, refused = _repair(model, equations, rhs, chosen, seed)
    try:
        with (
            progress_bar(f"checking at {count} random states") as progress,
            time_limit(limit, f"{equations} has not answered"),
        ):
            found = check_equations(
                model,
                rhs,
                coordinates=chosen,
                count=count,
                seed=seed,
                tolerance=TOLERANCE if tolerance is None else tolerance,
                progress=progress,
            )
    except InputError:
        if repaired is not None and not repaired.right and not as_json:
            typer.echo(f"Repair. {repaired.explain()}\n")
        raise
    if write is not None and repaired is not None and repaired.fixes:
        from deltac.report.files import write_text

        write_text(repaired.fixes[0].diff, write)
    more = [report for report in (repaired, refused) if report is not None]
    deliver(
        found,
        form.unless(as_json),
        *more,
        name=equations,
        figure=figure,
        page=page,
        model=model,
        equations=rhs,
    )


def _names(model: str, coordinates: Any) -> tuple[str, ...]:
    """The coordinates that equations of a model are written in."""
    from deltac.models import chosen_map, load_model

    loaded = load_model(model)
    chosen = chosen_map(loaded, coordinates)
    if chosen is not None and chosen.coordinates:
        return chosen.coordinates
    free = loaded.mechanism.free.q
    return tuple(loaded.mechanism.coordinates[int(k)].name for k in free)


def _check_table(
    model: str,
    table: str,
    coordinates: str | None,
    tolerance: float | None,
    form: options.Form,
    figure: Path | None,
    page: Path | None,
) -> NoReturn:
    """Check the accelerations that a table has."""
    from deltac.diagnosis.check.table import check_table
    from deltac.diagnosis.inputs.equations import load_map

    chosen = None if coordinates is None else load_map(coordinates)
    found = check_table(model, table, coordinates=chosen, tolerance=tolerance)
    deliver(found, form, name=table, figure=figure, page=page, model=model)


def _repair(
    model: str, text: str, rhs: Any, coordinates: Any, seed: int
) -> tuple[Repair | None, NoRepair | None]:
    """Seek the edit in the function that the text names, as it is loaded; or say why not."""
    from deltac.repair.outcome import NoRepair
    from deltac.repair.repair import repair_loaded
    from deltac.repair.tracing.tracer import Endless

    try:
        return repair_loaded(model, text, rhs, coordinates=coordinates, seed=seed), None
    except Endless:
        raise
    except InputError as error:
        return None, NoRepair(str(error))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # A defect of the search must not take the check's answer with it.
        return None, NoRepair(
            f"the search failed, please report it: {type(error).__name__}: {error}"
        )


@contextmanager
def time_limit(seconds: float, what: str) -> Iterator[None]:
    """Raise LimitError where a block takes longer, on systems that have alarms."""

    def late(number: int, frame: Any) -> None:
        raise LimitError(
            f"{what} within {seconds:g} s; look for a loop that does not end, or --time-limit"
        )

    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
