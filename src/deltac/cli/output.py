"""What the commands share: how a report leaves them, a progress bar, the width of a terminal."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import typer

from deltac.calls.progress import Progress
from deltac.cli import options
from deltac.cli.formats import Case, github, junit, sarif
from deltac.results import Report, Section, as_text, headed

UNKNOWN, WIDEST_TEXT = 100, 120
"""Columns of text where no terminal says how many it has, and the most that are easy to read."""


def width() -> int:
    """Columns of the terminal, or of COLUMNS; within reason."""
    return max(40, min(WIDEST_TEXT, shutil.get_terminal_size((UNKNOWN, 24)).columns))


def displayed(text: str) -> str:
    """Text for a terminal or the log of a CI, in which names that files give are no commands.

    Control characters and those that turn the direction of writing are written out; lines that a workflow of
    GitHub would obey (``::set-output``, ``##[group]``) are broken.
    """
    text = _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)
    return _WORKFLOW.sub(r"\1: :", text).replace("##[", "## [")


_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
_WORKFLOW = re.compile(r"^(\s*)::", re.MULTILINE)


def print_json(kind: str, contents: Mapping[str, Any]) -> None:
    """Print contents as JSON, under the head that all JSON of deltac has."""
    print(json.dumps(headed(kind, contents), ensure_ascii=False, allow_nan=False, indent=2))


def print_sections(sections: Iterable[Section]) -> None:
    """Print sections as wide as the terminal, verdicts in colour where it has colours."""
    text = displayed(as_text(sections, width()))
    print(_painted(text) if _coloured() else text)


def deliver(
    report: Report,
    *more: Report,
    name: str = "",
    form: options.Form = options.Form.text,
    as_json: bool = False,
    figure: Path | None = None,
    page: Path | None = None,
    model: Any = None,
    rhs: Any = None,
    **contents: Any,
) -> NoReturn:
    """Print a report, then further ones, and end the command with its exit code.

    `name` is what was judged, for forms that tell of several things; `figure` is where its picture goes,
    `page` its page, with `model` and the equations `rhs` for reports that hold none. In JSON, `contents` and
    the further reports (by the names of their classes) follow its own.
    """
    form = form.unless(as_json)
    if figure is not None:
        from deltac.report.files import write_figure

        write_figure(report.plot(), figure)
    if page is not None:
        report.report(page, *more, model=model, equations=rhs, command=options.COMMAND.get())
    written = {"figure": figure, "page": page}
    files = {what: str(path) for what, path in written.items() if path is not None}
    if form is options.Form.json:
        others = {type(other).__name__.lower(): other.contents() for other in more}
        print_json(type(report).__name__, {**report.contents(), **others, **contents, **files})
    else:
        # What has a line and an edit says more to a program than what the check found without them.
        fixed = [part for part in more if getattr(part, "fixes", ())]
        with_findings = [part for part in (*fixed, report, *more) if part.findings]
        if form in READ_BY_PEOPLE:
            for k, part in enumerate((report, *more)):
                print("\n" * bool(k), end="")
                print_sections(part.sections())
            if figure is not None:
                print(f"figure: {figure}")
            if page is not None:
                print(f"report: {page}")
        case = Case(name, name.rpartition(":")[0] or name, next(iter(with_findings), report))
        print_cases([case], form)
    raise typer.Exit(report.exit_code)


READ_BY_PEOPLE = (options.Form.text, options.Form.github)


def print_cases(cases: Sequence[Case], form: options.Form) -> None:
    """Print what programs read of some cases; nothing for people."""
    if form is options.Form.github:
        print(github(cases))
    elif form is options.Form.junit:
        print(junit("deltac", cases))
    elif form is options.Form.sarif:
        print(json.dumps(sarif(cases), ensure_ascii=False, indent=2))


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
def progress_bar(what: str = "") -> Iterator[Progress]:
    """A bar with the time left on standard error while the block runs, on terminals only.

    Until the block reports a fraction the bar pulses; `what` says what is being done.
    """
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
        TextColumn("{task.description}{task.fields[left]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None, left="")

        def report(fraction: float) -> None:
            progress.update(task, total=1.0, completed=fraction, left=" time left")

        yield report
