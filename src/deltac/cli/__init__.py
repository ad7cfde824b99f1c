"""The command line: parse, call, print. Each command is a module that loads what it needs itself.

Exit code: 0 all is well; 1 it is not (numbers disagree); 2 bad usage or bad input; 3 unresolved;
70 an error of deltac itself (its traceback is shown with DELTAC_DEBUG=1); 130 interrupted.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from typing import Annotated, NoReturn

import typer

from deltac.cli import (
    audit,
    cache,
    check,
    describe,
    examine,
    mutate,
    problems,
    recommend,
    reproduce,
    study,
)
from deltac.errors import InputError

BAD_INPUT, INTERNAL_ERROR, INTERRUPTED = 2, 70, 130

USAGE, INTERNAL = "E-USAGE", "E-INTERNAL"
"""Codes of errors that are no InputError: of the command line itself, and of deltac."""

app = typer.Typer(
    name="deltac",
    help="Energy testing functions: can this multibody simulation be trusted?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("reproduce")(reproduce.command)
app.command("problems")(problems.command)
app.command("examine")(examine.command)
app.command("study")(study.command)
app.command("audit")(audit.command)
app.command("recommend")(recommend.command)
app.command("check")(check.command)
app.command("mutate")(mutate.command)
app.command("describe")(describe.command)
app.command("cache")(cache.command)


def _version(wanted: bool) -> None:
    if wanted:
        from deltac import __version__

        typer.echo(f"deltac {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_version),
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line (of this process, or `arguments`) and exit with its status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal may lack Δ or θ
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        app(given, prog_name="deltac")
    except SystemExit as left:
        if left.code == BAD_INPUT:  # said on standard error already
            _as_json(given, USAGE, "wrong usage; standard error says what", BAD_INPUT)
        raise
    except InputError as error:
        _complain(f"{error} [{error.code}]")
        _as_json(given, error.code, str(error), BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        if os.environ.get("DELTAC_DEBUG", "") not in ("", "0"):
            import traceback

            traceback.print_exc()
        message = f"{type(error).__name__}: {error}"
        _complain(
            f"internal error: {message}\n"
            "This should not happen. Please report it, with the command and the traceback that "
            "DELTAC_DEBUG=1 shows."
        )
        _as_json(given, INTERNAL, message, INTERNAL_ERROR)


def _as_json(given: Sequence[str], code: str, message: str, exit_code: int) -> NoReturn:
    """End with an exit code; where JSON was asked for, with the error on standard output."""
    if "--json" in given:
        from deltac.cli.output import print_json

        print_json("Error", {"exit_code": exit_code, "error": {"code": code, "message": message}})
    sys.exit(exit_code)


def _complain(message: str) -> None:
    print(f"deltac: {message}", file=sys.stderr)
