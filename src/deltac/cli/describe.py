"""`deltac describe`: what a model is, before anything is simulated."""

from __future__ import annotations

from typing import Annotated

import typer

from deltac.cli.output import Form, Json, deliver


def command(
    model: Annotated[
        str,
        typer.Argument(
            help="A problem's name, an .xml, .mjcf or .urdf file, or FILE.py:FUNCTION.",
        ),
    ],
    as_json: Json = False,
) -> None:
    """Bodies, joints, degrees of freedom, the class of the constraints, what is constant, energies."""
    from deltac.analysis.classify import classify

    deliver(classify(model), Form.text.unless(as_json), name=model)
