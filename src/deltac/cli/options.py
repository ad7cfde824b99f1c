"""Options of commands: the keyword arguments of the verbs that they call, and the words that verbs share.

A command names its verbs, ``@of(recommend="deltac.diagnosis.recommend.recommend")``. Their keyword arguments
become options, with the verb's types, defaults and descriptions; those that no text can give (a progress, an
executor) are left out. The command is called with each verb under its name, and the options bound to it.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Collection, Iterator
from contextvars import ContextVar
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_type_hints

import typer

COMMAND: ContextVar[str] = ContextVar("COMMAND", default="")
"""The command line that is being run, as a shell takes it."""

Json = Annotated[bool, typer.Option("--json", help="Print only JSON to standard output.")]


class Form(Enum):
    """Forms that a report is printed in."""

    text = "text"
    json = "json"
    github = "github"
    junit = "junit"
    sarif = "sarif"

    def unless(self, as_json: bool) -> Form:
        """This form, unless --json asks for JSON."""
        return Form.json if as_json else self


Format = Annotated[
    Form,
    typer.Option(
        "--format",
        help="Output format. json: see docs/contract.md; github: annotations and a job summary; junit: XML; "
        "sarif: findings and repairs with file and line.",
    ),
]

_MODELS = (".xml", ".urdf", ".sdf", ".py")


def _begun(incomplete: str) -> list[str]:
    """Models that begin so, for the completion of the shell: problems, files, and folders on the way."""
    from glob import escape, glob

    from deltac import problems

    paths = sorted(glob(f"{escape(incomplete)}*"))
    files = [path for path in paths if path.lower().endswith(_MODELS)]
    folders = [f"{path}/" for path in paths if Path(path).is_dir()]
    return [name for name in problems.names() if name.startswith(incomplete)] + files + folders


Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        autocompletion=_begun,
        help="A problem's name, an .xml, .urdf or .sdf file (FILE.urdf:free: floating base), "
        "or FILE.py:NAME (FILE.py, if it holds only one model).",
    ),
]

Parameters = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a parameter or number of the model, such as body.link.mass=2 (deltac "
        "describe --numbers lists them); repeatable.",
    ),
]
"""Values of parameters for this call."""


def with_parameters(model: str, texts: list[str] | None) -> Any:
    """The model of that name, with the values that ``--set`` gives."""
    if not texts:
        return model
    from deltac.errors import InputError
    from deltac.models import load_model

    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        try:
            values[name.strip()] = float(value)
        except ValueError:
            raise InputError(
                f"--set {text!r}: expected NAME=NUMBER, such as body.link.mass=2"
            ) from None
    return load_model(model).with_parameters(**values)


StartState = Annotated[
    str | None,
    typer.Option(
        "--state",
        metavar="NAME=VALUE,…|FILE|KEYFRAME",
        help="Initial state: hip=0.3,knee=-20deg,u.hip=1; a .json or .toml file; a log (its first row); "
        "or a keyframe of an MJCF file. [default: the model's]",
    ),
]


Tolerance = Annotated[
    float,
    typer.Option(
        metavar="FRACTION",
        help="Accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).",
    ),
]

Duration = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Duration of the motion. [default: the problem's]"),
]

MappingFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Column names and units of the log (TOML).")
]


def _by(name: str, home: str) -> Callable[[str], Any]:
    """A reader of the text of an option, which is loaded when there is some."""
    return lambda text: getattr(import_module(home), name)(text)


OwnEquations = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:FUNCTION", help="Hand-written equations of motion: u̇ = FUNCTION(t, q, u)."
    ),
    _by("load_equations", "deltac.diagnosis.inputs.equations"),
]

OwnController = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="FILE.py:FUNCTION",
        help="Controller of a MuJoCo model: a function of (model, data).",
    ),
    _by("load_callable", "deltac.models"),
]

OwnCoordinates = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE.py:MAP",
        help="The coordinates of the equations, or of the log's columns: joint, absolute, or a "
        "CoordinateMap. By default those of the dc.Equations, or of the problem's own equations, else joint.",
    ),
    _by("load_map", "deltac.diagnosis.inputs.equations"),
]


def _checked(check: str) -> Callable[[Path | None], Path | None]:
    """A callback that refuses a path before the work is done, by a function of `deltac.report.files`."""

    def checked(path: Path | None) -> Path | None:
        if path is not None:
            from deltac.report import files

            getattr(files, check)(path)
        return path

    return checked


FigureFile = Annotated[
    Path | None,
    typer.Option(
        "--figure",
        metavar="FILE",
        callback=_checked("check_figure"),
        help="Draw the result, as result.plot() does: FILE.pdf, FILE.svg or FILE.png.",
    ),
]


PageFile = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE.html",
        callback=_checked("check_page"),
        help="Write one page for the browser: verdict, plots, animation, findings.",
    ),
]

SHARED: dict[str, Any] = {
    "state": StartState,
    "tolerance": Tolerance,
    "duration": Duration,
    "mapping": MappingFile,
    "equations": OwnEquations,
    "controller": OwnController,
    "coordinates": OwnCoordinates,
    "figure": FigureFile,
    "page": PageFile,
    "form": Format,
    "as_json": Json,
}
"""Options by the arguments that mean the same to all verbs."""


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


ARGUMENT_KINDS: dict[str, tuple[Any, str | None, Callable[[Any], Any] | None]] = {
    "bool": (bool, None, None),
    "int": (int, "N", None),
    "float": (float, "NUMBER", None),
    "str": (str, "TEXT", None),
    "Sequence[str]": (str, "A,B", _words),
}
"""Annotations of arguments that text can give: the type for typer, the name of a value, how it is read."""

HANDED_ON = ("equations", "controller")
"""Options that verbs hand on to `simulate`, as their last argument says."""

Verb: TypeAlias = functools.partial[Any]
"""A verb with the options of the command line bound to it."""


Command: TypeAlias = Callable[..., None]


def of(*, without: str = "", **verbs: str) -> Callable[[Command], Command]:
    """A command that calls these verbs, each by the name of its module, `without` some of their options."""

    def noted(command: Command) -> Command:
        vars(command)["verbs"] = verbs, without.split()
        return command

    return noted


def complete(command: Command) -> Command:
    """A command with the options of its verbs, for typer; the modules of the verbs are loaded now."""
    homes, without = getattr(command, "verbs", ({}, []))
    if not homes:
        return command
    verbs = {name: getattr(import_module(home), name) for name, home in homes.items()}
    hints = get_type_hints(command, include_extras=True)
    own = {
        p.name: p.replace(annotation=hints[p.name], kind=p.KEYWORD_ONLY)
        for p in inspect.signature(command).parameters.values()
        if p.name not in verbs
    }
    left_out = {*own, *without}
    offered = {name: {p.name: p for p in _offered(verb, left_out)} for name, verb in verbs.items()}

    def run(**values: Any) -> None:
        def bound(name: str) -> Verb:
            settings = (
                (n, p, values[n]) for n, p in offered[name].items() if values[n] is not None
            )
            return functools.partial(
                verbs[name], **{n: _read(p, value) for n, p, value in settings}
            )

        command(**{name: bound(name) for name in verbs}, **{name: values[name] for name in own})

    every = dict(own)
    for name, p in (entry for each in offered.values() for entry in each.items()):
        every.setdefault(name, p)  # the first verb that has it says what it is
    vars(run)["__signature__"] = inspect.Signature(list(every.values()))
    run.__doc__ = command.__doc__
    return run


def _read(option: inspect.Parameter, value: Any) -> Any:
    """What is given for an option, as the verb takes it."""
    read = option.annotation.__metadata__[-1]
    return read(value) if callable(read) else value


def _offered(verb: Callable[..., Any], left_out: Collection[str]) -> Iterator[inspect.Parameter]:
    """The arguments of a verb that may be left out and that text can give, as options for typer."""
    descriptions = described(verb)
    parameters = list(inspect.signature(verb).parameters.values())
    if parameters[-1].name == "simulation":  # what it hands on to `simulate`
        parameters[-1:] = [
            parameters[-1].replace(name=n, kind=inspect.Parameter.KEYWORD_ONLY, default=None)
            for n in HANDED_ON
        ]
    for p in parameters:
        if p.default is not p.empty and p.name not in left_out:
            annotation = SHARED.get(p.name) or _option(p, descriptions.get(p.name, ""))
            default = None if isinstance(p.default, tuple) else p.default
            if annotation is not None:
                yield p.replace(annotation=annotation, kind=p.KEYWORD_ONLY, default=default)


def _option(p: inspect.Parameter, description: str) -> Any:
    """The option of an argument by its annotation and description; None where text cannot give it."""
    kind, _, rest = str(p.annotation).partition(" | ")
    if not description or kind not in ARGUMENT_KINDS or rest not in ("", "None"):
        return None
    option_type, value, read = ARGUMENT_KINDS[kind]
    value = "SECONDS" if description.startswith("seconds") else value
    name = p.name.replace("_", "-")
    names = (
        [f"--{name}" if p.default is False else f"--{name}/--no-{name}"]
        if option_type is bool
        else []
    )
    option = typer.Option(*names, metavar=value, help=f"{description[:1].upper()}{description[1:]}")
    return Annotated[
        option_type if p.default is not None and read is None else option_type | None, option, read
    ]


def described(verb: Callable[..., Any]) -> dict[str, str]:
    """What a verb's docstring says of each argument, without marks."""
    text = inspect.cleandoc(verb.__doc__ or "").partition("\nArgs:\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^    (\w+): (.*(?:\n     .*)*)", text, re.MULTILINE)
    return {name: " ".join(description.replace("`", "").split()) for name, description in entries}
