"""`deltac view`: the page of a motion, without a verdict."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from deltac.cli.options import COMMAND, Verb, of
from deltac.cli.output import progress_bar


@of(viewed="deltac.report.page.motion")
def view(
    viewed: Verb,
    what: Annotated[
        str,
        typer.Argument(
            metavar="MODEL|LOG",
            help="A problem's name, an .xml or .urdf file, FILE.py:NAME; or a log alone.",
        ),
    ],
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="A log of the model's motion.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.html", help="The page to write. [default: NAME.html]"),
    ] = None,
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
) -> None:
    """Show the motion of a log, or one simulated from the model's start. No verdict is given.

    Without a model, a log is shown as curves. With one, the page also shows the mechanism and its energies.
    """
    from deltac.report.files import check_page
    from deltac.report.page import write_page
    from deltac.report.page.motion import log_page, motion_page

    name = Path(log or what).name.rpartition(":")[2]
    path = check_page(out or Path(f"{Path(name).stem or 'motion'}.html"))
    with progress_bar(f"showing {name}"):
        if log is None and _is_log(what):
            page = log_page(Path(what), viewed.keywords.get("mapping"))
        else:
            page = motion_page(*viewed(what, log))
        write_page(page, path, COMMAND.get())
    print(f"page: {path}")
    if show:
        webbrowser.open(path.resolve().as_uri())


def _is_log(text: str) -> bool:
    from deltac.trajectories.formats.files import FORMATS

    return Path(text).suffix.lower() in FORMATS
