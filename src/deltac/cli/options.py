"""Options that several commands share, each described once."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

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
        help="Output format. json: see docs/json.md; github: annotations and a job summary; junit: XML; "
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


def with_parameters(model: str, given: list[str] | None) -> Any:
    """The model of that name, with the values that ``--set`` gives."""
    if not given:
        return model
    from deltac.errors import InputError
    from deltac.models import load_model

    values = {}
    for text in given:
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
    typer.Option(metavar="FRACTION", help="Accepted |ΔC| as a fraction of the energy exchanged."),
]

Duration = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Duration of the motion. [default: the problem's]"),
]

MappingFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Column names and units of the log (TOML).")
]

OwnEquations = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:FUNCTION", help="Hand-written equations of motion: u̇ = FUNCTION(t, q, u)."
    ),
]

OwnCoordinates = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE.py:MAP",
        help="The coordinates of the equations: joint, absolute, or a CoordinateMap. By default those of "
        "the dc.Equations, or of the problem's own equations, else joint.",
    ),
]

StateCount = Annotated[int, typer.Option(min=1, metavar="N", help="Number of random states.")]
Seed = Annotated[int, typer.Option(metavar="N", help="Random seed.")]


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

# --- of fleets ----------------------------------------------------------------------------------

Workers = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Worker processes. [default: one per core]")
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="tcp://…", help="Address of the scheduler of a Dask cluster to run on."),
]
TimeLimit = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Time limit of a piece of work. [default: 600]"),
]
RetryFailed = Annotated[
    bool, typer.Option("--retry-failed", help="Try again the runs that were set aside.")
]
