"""`deltac sweep`: thousands of runs or studies by one plan; stopped or killed, it goes on where it was."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from deltac.calls.progress import Progress
from deltac.cli import options
from deltac.cli.formats import Case
from deltac.cli.options import Verb, of
from deltac.cli.output import print_cases, print_json, print_sections, progress_bar
from deltac.errors import ArgumentsError, FileError

if TYPE_CHECKING:
    from deltac.fleets.fleet import Plan
    from deltac.fleets.result import Fleet
    from deltac.fleets.spec import Execution

INTERVAL = 10.0
"""Seconds between two lines of progress where there is no terminal."""


Only = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Make only this run, in this process, and show its row, and its page with --report.",
    ),
]


@of(sweep="deltac.fleets.sweep")
def sweep(
    sweep: Verb,
    plan: Annotated[
        Path | None, typer.Argument(metavar="SWEEP.toml", help="The plan; see docs/fleets.md.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the results. [default: NAME.sweep]"),
    ] = None,
    only: Only = None,
    status: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Show the progress of a sweep; nothing is run."),
    ] = None,
    page: options.PageFile = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Sweep models, parameters, initial states, solvers and steps: one table, one exit code.

    Results already in the folder are reused, so a sweep that was stopped or killed resumes where it was.
    Exit code 0 if all runs are within the tolerance, 1 if not, 3 if some are unresolved, 2 if some could not
    be run.
    """
    form = form.unless(as_json)
    if status is not None:
        from deltac.fleets.result import fleet_status

        deliver_fleet(fleet_status(status), form, page)
    if plan is None:
        raise ArgumentsError("give a plan, FILE.toml, or --status DIR")
    if plan.suffix.lower() != ".toml":
        raise FileError(f"{plan}: expected a .toml file that says what is run; see docs/fleets.md")
    from deltac.fleets.sweep import plan_sweep

    planned = plan_sweep(str(plan))
    if only is not None:
        if page is not None:
            planned.write_case(only, page)
        piece = planned.piece_at(only)
        (row,) = piece.table(piece()).to_dicts()
        print_json("Run", {"exit_code": 0, **row})
        raise typer.Exit
    run(planned, out, planned.spec.execution, sweep.keywords, form, page)


def run(
    plan: Plan,
    out: Path | None,
    execution: Execution,
    keywords: Mapping[str, Any],
    form: options.Form,
    page: Path | None,
) -> NoReturn:
    """Do what a plan lacks, as the options that are given say, and end the command with its results."""
    own = {name: keywords[name] for name in type(execution).model_fields if name in keywords}
    with fleet_progress(
        "audits" if plan.kind == "audit" else "runs", len(plan.addresses)
    ) as progress:
        fleet = plan.run(
            out,
            execution.overridden(**own),
            retry_failed=keywords["retry_failed"],
            progress=progress,
            notice=tell,
        )
    deliver_fleet(fleet, form, page, plan.write_case)


def tell(line: str) -> None:
    """Say on standard error what should be known before the work is done."""
    print(f"deltac: {line}", file=sys.stderr, flush=True)


@contextmanager
def fleet_progress(what: str, total: int) -> Iterator[Progress]:
    """A bar with the time left on terminals, else a line now and then, on standard error."""
    from deltac.fleets.execution import Pace

    if sys.stderr.isatty():
        with progress_bar(f"{total} {what}") as bar:
            yield bar
        return
    pace, last = Pace(total), time.monotonic()

    def advance(fraction: float) -> None:
        nonlocal last
        line = pace.progress_line(fraction)
        if time.monotonic() - last >= INTERVAL:
            last = time.monotonic()
            print(f"deltac: {what}: {line}", file=sys.stderr, flush=True)

    yield advance


def deliver_fleet(
    fleet: Fleet,
    form: options.Form,
    page: Path | None = None,
    case: Callable[[str, Path], None] | None = None,
) -> NoReturn:
    """Print the results of a fleet, write its page, and end with its exit code."""
    if page is not None:
        fleet.report(page, case=case)
    if form is options.Form.json:
        print_json("Fleet", fleet.contents())
    elif form in (options.Form.text, options.Form.github):
        print_sections(fleet.sections())
    if form not in (options.Form.text, options.Form.json):
        print_cases([Case(group.name, str(fleet.folder), group) for group in fleet.groups()], form)
    raise typer.Exit(fleet.exit_code)
