"""`deltac check`: equations written by hand, against a model; nothing is integrated."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.cli import options
from deltac.cli.options import Verb, of
from deltac.cli.output import progress_bar
from deltac.errors import ArgumentsError, InputError, LimitError

if TYPE_CHECKING:
    from deltac.repair.outcome import NoRepair, Repair


@of(check_equations="deltac.diagnosis.check.check", deliver="deltac.cli.output")
def check(
    check_equations: Verb,
    deliver: Verb,
    model: options.Model,
    equations: Annotated[
        str,
        typer.Argument(
            metavar="FILE.py:FUNCTION",
            help="A function of (t, q, u) that returns u̇, one of (t, y) that returns ẏ, dc.Equations; "
            "LIBRARY.so:FUNCTION; UNIT.fmu (model exchange); or a table of `deltac states`, filled in.",
        ),
    ],
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
) -> None:
    """Check equations of motion at random states: are they the model's, and if not, where do they differ?

    Exit code 0 if they agree, 1 if not, 3 if unresolved.
    """
    coordinates = check_equations.keywords.get("coordinates")
    if equations.lower().endswith(".csv"):
        if repair or write:
            raise ArgumentsError(
                "--repair seeks an edit in the text of a function, FILE.py:FUNCTION; a table has none"
            )
        from deltac.diagnosis.check.table import check_table

        report = check_table(model, equations, coordinates=coordinates, tolerance=tolerance)
        deliver(report, name=equations, model=model)
    from deltac.diagnosis.inputs.equations import load_equations

    names = _names(model, coordinates) if equations.endswith(".fmu") else ()
    rhs = load_equations(equations, names)
    count, failure = check_equations.keywords["count"], None
    try:
        with (
            progress_bar(f"checking at {count} random states") as progress,
            time_limit(limit, equations),
        ):
            accepted = {} if tolerance is None else {"tolerance": tolerance}
            report = check_equations(model, rhs, **accepted, progress=progress)
    except LimitError:
        raise
    except InputError as error:  # an edit may mend what the function cannot do
        failure = error
    repaired: Any = None
    if repair or write:
        from deltac.calls.progress import TIME_LIMIT

        seed = check_equations.keywords["seed"]
        with progress_bar(f"seeking the edit, at most {TIME_LIMIT:g} s"):
            repaired = _repair(model, equations, rhs, coordinates, seed)
    if failure is not None:
        if not getattr(repaired, "right", True) and not deliver.keywords["as_json"]:
            print(f"Repair. {repaired.explain()}\n")
        raise failure
    fixes = getattr(repaired, "fixes", None)
    if write is not None and fixes:
        from deltac.report.files import write_text

        write_text(fixes[0].diff, write)
    more = [] if repaired is None else [repaired]
    deliver(report, *more, name=equations, model=model, rhs=rhs)


def _names(model: str, coordinates: Any) -> tuple[str, ...]:
    """The coordinates that equations of a model are written in."""
    from deltac.models import load_model

    loaded = load_model(model)
    chosen = loaded.coordinate_map(coordinates)
    if chosen is not None and chosen.coordinates:
        return chosen.coordinates
    return loaded.mechanism.coordinates.free_names


def _repair(model: str, text: str, rhs: Any, coordinates: Any, seed: int) -> Repair | NoRepair:
    """Seek the edit in the function that the text names, as it is loaded; or say why not."""
    from deltac.repair import repair_equations
    from deltac.repair.outcome import NoRepair
    from deltac.repair.tracing.tracer import Endless

    try:
        return repair_equations(model, text, function=rhs, coordinates=coordinates, seed=seed)
    except Endless:
        raise
    except InputError as error:
        return NoRepair(str(error))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # A defect of the search must not take the check's answer with it.
        return NoRepair(f"the search failed, please report it: {type(error).__name__}: {error}")


class _Late(BaseException):
    """The time is over; no `except Exception`, of ours or of the user's function, keeps it."""


@contextmanager
def time_limit(seconds: float, function: str) -> Iterator[None]:
    """Raise LimitError where the calls of ``FILE:NAME`` take longer, on systems that have alarms."""
    file = function.rpartition(":")[0]
    lines: list[int] = []

    def late(number: int, frame: FrameType | None) -> None:
        while frame is not None and os.path.abspath(frame.f_code.co_filename) != os.path.abspath(
            file
        ):
            frame = frame.f_back
        lines.extend([] if frame is None else [frame.f_lineno])
        raise _Late

    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, late)
    # It rings again every second, because a bare `except` in the function keeps the first one.
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    except _Late:
        where = f"; it was at {file}:{lines[-1]}" if lines else ""
        raise LimitError(
            f"{function} has not answered within {seconds:g} s{where}; look for a loop that does not end, "
            "or --time-limit"
        ) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
