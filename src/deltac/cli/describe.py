"""`deltac describe`: what a model is, before anything is simulated."""

from __future__ import annotations

from deltac.cli.output import Form, Json, Model, PageFile, StartState, deliver


def command(
    model: Model,
    state: StartState = None,
    page: PageFile = None,
    as_json: Json = False,
) -> None:
    """Bodies, joints, degrees of freedom, the class of the constraints, what is constant, energies."""
    from deltac.analysis.classify import classify

    deliver(classify(model, state), Form.text.unless(as_json), name=model, page=page)
