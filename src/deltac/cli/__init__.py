"""The command line: parse, call, print. Each command is a module that loads what it needs itself.

Exit code: 0 all is well; 1 it is not (numbers disagree); 2 bad usage or bad input; 3 unresolved;
70 an error of deltac itself (its traceback is shown with DELTAC_DEBUG=1); 130 interrupted; 141 nobody reads
the output any more.
"""

from __future__ import annotations

import gc
import io
import os
import shlex
import sys
from collections.abc import Collection, Sequence
from importlib import import_module
from typing import Annotated, Any, NamedTuple, NoReturn

import typer
import typer.core

from deltac.calls.interrupts import interruptible
from deltac.cli import options
from deltac.errors import InputError

BAD_INPUT, INTERNAL_ERROR, INTERRUPTED, CLOSED = 2, 70, 130, 141


ClickException: Any = typer.BadParameter.__mro__[2]
"""The base of all errors of usage, from the click that typer brings or needs."""

USAGE, INTERNAL = "E-USAGE", "E-INTERNAL"
"""Codes of errors that are no InputError: of the command line itself, and of deltac."""


class Command(NamedTuple):
    """What the list of commands says of one, the examples in its help, its module, its page in the docs."""

    short: str
    examples: str
    module: str
    page: str


COMMANDS = {
    "examine": Command(
        "Run every check of a model, its equations and its log at once.",
        "deltac examine double-pendulum --duration 2\n"
        "  deltac examine model.py:pendulum --equations eom.py:rhs --log run.csv",
        "verbs",
        "examine",
    ),
    "audit": Command(
        "Audit logs: where every joule went, and what is wrong.",
        "deltac audit arm.xml run.parquet --tolerance 1e-3 --explain\n"
        "  deltac audit robot.py:model runs/*.csv --mapping map.toml --format github",
        "audit",
        "audit",
    ),
    "study": Command(
        "Run a motion at several steps: is the error the integrator's?",
        "deltac study triple-pendulum --steps 0.02,0.01,0.005 --solver ode5\n"
        "  deltac study arm.xml --logs coarse.csv --logs middle.csv --logs fine.csv",
        "verbs",
        "study",
    ),
    "sweep": Command(
        "Run thousands of motions or studies from one plan, resumably.",
        "deltac sweep arm.toml --out results\n"
        "  deltac sweep --status results\n"
        "  deltac sweep arm.toml --scheduler tcp://head:8786 --format junit",
        "sweep",
        "fleets",
    ),
    "compare": Command(
        "Compare two folders of results, before and after a change.",
        "deltac compare main.audits branch.audits --format github",
        "verbs",
        "fleets",
    ),
    "recommend": Command(
        "Find the cheapest solver and step within a tolerance.",
        "deltac recommend double-pendulum --tolerance 1e-6 --solvers ode4,ode5",
        "verbs",
        "recommend",
    ),
    "check": Command(
        "Check hand-written equations of motion, and repair them.",
        "deltac check model.py:pendulum eom.py:rhs --repair --write fix.patch",
        "check",
        "check",
    ),
    "mutate": Command(
        "Make small mistakes on purpose, and see which tests notice.",
        "deltac mutate model.py:pendulum eom.py:rhs",
        "verbs",
        "repair",
    ),
    "describe": Command(
        "Show a model's bodies, joints, degrees of freedom and energies.",
        "deltac describe triple-pendulum",
        "verbs",
        "guide",
    ),
    "view": Command(
        "Show a motion and its energies in the browser.",
        "deltac view triple-pendulum\n  deltac view arm.xml run.parquet --out arm.html",
        "view",
        "report",
    ),
    "states": Command(
        "Write states, to check a program in another language.",
        "deltac states double-pendulum --out states.csv\n  deltac check double-pendulum states.csv",
        "verbs",
        "other-languages",
    ),
    "problems": Command(
        "List the problem library, or run one of its problems.",
        "deltac problems\n  deltac problems n-four-bar --set n=3",
        "library",
        "guide",
    ),
    "cache": Command(
        "Show, verify or clear the cache of compiled code.",
        "deltac cache --verify",
        "library",
        "guide",
    ),
}
"""The commands, in the order of the list."""


def _version(show: bool) -> None:
    if show:
        from deltac import __version__

        typer.echo(f"deltac {__version__}")
        raise typer.Exit


def _listed() -> None:
    """Stand for a command of which only the name is asked for."""


def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_version),
    ] = False,
) -> None:
    pass


class _Command(typer.core.TyperCommand):
    """A command whose help has no Python types beside the names of its arguments."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for parameter in self.params:
            if isinstance(parameter, typer.core.TyperArgument):
                vars(parameter)["display_type_rich"] = lambda ctx: None


def application(complete: Collection[str] = tuple(COMMANDS)) -> typer.Typer:
    """The command line; the commands that are not to be `complete` are listed and have no options.

    A command takes its options from the verbs that it calls, whose modules take a while to load.
    """
    app = typer.Typer(
        name="deltac",
        help="Energy testing functions: can this multibody simulation be trusted?",
        epilog="Completion for bash, zsh and fish: deltac --install-completion",
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for name, about in COMMANDS.items():
        epilog = f"\b\nExamples:\n  {about.examples}\nMore: docs/{about.page}.md"
        command = _listed
        if name in complete:
            module = import_module(f"deltac.cli.{about.module}")
            command = options.complete(getattr(module, name))
        app.command(name, cls=_Command, short_help=about.short, epilog=epilog)(command)
    app.callback()(_options)
    return app


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line (of this process, or `arguments`) and exit with its status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal may lack Δ or θ
    words_given = sys.argv[1:] if arguments is None else list(arguments)
    if arguments is None:  # a process of our own
        # Searches for cycles after 700 new objects, as Python has them, take a tenth of a verdict.
        gc.set_threshold(100_000, *gc.get_threshold()[1:])
        # Before NumPy is loaded; deltac.calls.linear_algebra says why.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        options.COMMAND.set(shlex.join(["deltac", *words_given]))
        with interruptible():
            # What the shell hands over to be completed stands in its variables.
            words = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
            command_name = words_given[:1] or words.split()[1:2]
            code = application(command_name)(words_given, prog_name="deltac", standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()  # what a closed pipe or a full disk has against it is said here
        sys.exit(code)
    except SystemExit:
        if type(sys.stdout).__name__ == "PacifyFlushWrapper":  # click has found the pipe closed
            sys.exit(CLOSED)
        raise
    except BrokenPipeError:  # who read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(CLOSED)
    except ClickException as error:
        error.show()
        _as_json(words_given, USAGE, error.format_message(), error.exit_code)
    except InputError as error:
        _complain(f"{error} [{error.code}]")
        _as_json(words_given, error.code, str(error), BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(INTERRUPTED)
    except OSError as error:  # a full disk, a name too long for it, a folder without rights
        _traceback()
        where = f"{error.filename}: " if error.filename is not None else ""
        _complain(f"{where}{error.strerror or error} [{'E-FILE'}]")
        _as_json(words_given, "E-FILE", f"{where}{error.strerror or error}", BAD_INPUT)
    except Exception as error:
        _traceback()
        message = f"{type(error).__name__}: {error}"
        _complain(
            f"internal error: {message}\n"
            "This should not happen. Please report it, with the command and the traceback that "
            "DELTAC_DEBUG=1 shows."
        )
        _as_json(words_given, INTERNAL, message, INTERNAL_ERROR)


def _traceback() -> None:
    if os.environ.get("DELTAC_DEBUG", "") not in ("", "0"):
        import traceback

        traceback.print_exc()


def _as_json(arguments: Sequence[str], code: str, message: str, exit_code: int) -> NoReturn:
    """End with an exit code; where JSON was asked for, with the error on standard output."""
    if "--json" in arguments:
        from deltac.cli.output import print_json

        print_json("Error", {"exit_code": exit_code, "error": {"code": code, "message": message}})
    sys.exit(exit_code)


def _complain(message: str) -> None:
    from deltac.cli.output import displayed

    print(f"deltac: {displayed(message)}", file=sys.stderr)
