"""What the commands share: JSON, tables, a progress bar."""

from __future__ import annotations

import json
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

if TYPE_CHECKING:
    from rich.table import Table

WIDTH = 100

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


def print_json(value: Any) -> None:
    """Print a value as JSON."""
    print(json.dumps(value, ensure_ascii=False, allow_nan=False, indent=2))


def print_table(table: Table) -> None:
    """Print a table at most 100 columns wide, whatever is narrower."""
    from rich.console import Console

    width = min(WIDTH, Console().width) if sys.stdout.isatty() else WIDTH
    Console(width=width, highlight=False).print(table)


def new_table(title: str = "") -> Table:
    """An empty table in our style."""
    from rich import box
    from rich.table import Table

    return Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 2, 0, 0),
        header_style="bold",
    )


def number(value: float, unit: str = "", digits: int = 4) -> str:
    """A number for people, with its unit ("1" is none)."""
    text = re.sub(r"e([+-])0*", r"e\1", f"{value:.{digits}g}").replace("e+", "e")
    return text if unit in ("", "1") else f"{text} {unit}"


def print_text(text: str) -> None:
    """Print a paragraph, wrapped."""
    print(textwrap.fill(text, WIDTH, subsequent_indent="    "))


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar on standard error while the block runs, on terminals only."""
    if not sys.stderr.isatty():
        yield lambda fraction: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task("", total=1.0)

        def report(fraction: float) -> None:
            progress.update(task, completed=fraction)

        yield report
