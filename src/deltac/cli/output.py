"""What the commands share: how a report leaves them, a progress bar, the width of a terminal."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TypeAlias

import typer

from deltac.results import Report, Section, as_text, headed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNKNOWN, WIDEST = 100, 120
"""Columns of text where no terminal says how many it has, and the most that are easy to read."""

Json = Annotated[bool, typer.Option("--json", help="Print JSON to standard output, nothing else.")]

Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL", help="A problem's name, an .xml or .urdf file, or FILE.py:FUNCTION."
    ),
]

StartState = Annotated[
    str | None,
    typer.Option(
        "--state",
        metavar="NAME=VALUE,…|FILE|KEYFRAME",
        help="Where the motion starts: hip=0.3,knee=-20deg,u.hip=1; a .json or .toml file, or a log's "
        "first row; a keyframe of an MJCF file. By default the model's own start.",
    ),
]

Progress: TypeAlias = Callable[[float], None]


def width() -> int:
    """Columns of the terminal, or of COLUMNS; within reason."""
    return max(40, min(WIDEST, shutil.get_terminal_size((UNKNOWN, 24)).columns))


def print_json(kind: str, contents: Mapping[str, Any]) -> None:
    """Print contents as JSON, under the head that all JSON of deltac has."""
    print(json.dumps(headed(kind, contents), ensure_ascii=False, allow_nan=False, indent=2))


def print_sections(sections: Iterable[Section]) -> None:
    """Print sections as wide as the terminal, verdicts in colour where it has colours."""
    text = as_text(sections, width())
    print(_painted(text) if _coloured() else text)


def deliver(
    report: Report, as_json: bool, *more: Report, figure: Path | None = None, **contents: Any
) -> NoReturn:
    """Print a report, then further ones, and end the command with its exit code.

    In JSON, `contents` and the further reports (by the names of their classes) follow its own.
    """
    if as_json:
        told = {type(other).__name__.lower(): other.contents() for other in more}
        shown = {} if figure is None else {"figure": str(figure)}
        held = {**report.contents(), **told, **contents, **shown}
        print_json(type(report).__name__, held)
    else:
        for k, part in enumerate((report, *more)):
            if k:
                print()
            print_sections(part.sections())
        if figure is not None:
            print(f"figure: {figure}")
    raise typer.Exit(report.exit_code)


def checked_figure(path: Path | None) -> Path | None:
    """The path of a figure, refused before the work is done where none can be written."""
    if path is not None:
        from deltac.report import check_figure

        check_figure(path)
    return path


def write(figure: Figure, path: Path) -> None:
    """Write a figure."""
    from deltac.report import write_figure

    write_figure(figure, path)


_COLOURS = {
    r"^consistent\b": "32",
    r"^(integration|equation)-error\b": "31",
    r"^unresolved\b": "33",
    r"^(Cause|Doubt)( \[F-[A-Z0-9-]+\])?": "1",
    r"\b(fails|NO)$": "31",
}
"""Patterns in the text of a report, and the colour of a terminal that each gets."""


def _coloured() -> bool:
    """Whether standard output shows colours; see no-color.org."""
    return (
        sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    )


def _painted(text: str) -> str:
    for pattern, colour in _COLOURS.items():
        text = re.sub(pattern, rf"\033[{colour}m\g<0>\033[0m", text, flags=re.MULTILINE)
    return text


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar with the time left on standard error while the block runs, on terminals only."""
    if not sys.stderr.isatty():
        yield lambda fraction: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=1.0)

        def report(fraction: float) -> None:
            progress.update(task, completed=fraction)

        yield report
