"""`deltac audit`: a log made elsewhere, against a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.cli.formats import Case, worst
from deltac.cli.output import (
    FigureFile,
    Form,
    Format,
    Json,
    Model,
    deliver,
    print_cases,
    print_json,
    print_sections,
    progress_bar,
)
from deltac.errors import InputError
from deltac.results import Report, Table, number, plain

if TYPE_CHECKING:
    from deltac.trajectories.formats.reading import ColumnReading


def command(
    model: Model,
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG", help="Logs of its motion, one or more.")
    ],
    tolerance: Annotated[
        float, typer.Option(help="Accepted |ΔC| as a fraction of the energy exchanged.")
    ] = 1e-3,
    work: Annotated[
        str | None, typer.Option(help="How works are taken: in-loop, samples or discrete.")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Column names and units of the log (TOML).")
    ] = None,
    explain_log: Annotated[
        bool, typer.Option("--explain-log", help="Only show how each column is read.")
    ] = False,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="A mistake within the tolerance that is real counts too."),
    ] = False,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Name the changes of the model that would fit the log."),
    ] = False,
    figure: FigureFile = None,
    form: Format = Form.text,
    as_json: Json = False,
) -> None:
    """Audit logs: where every joule went, what is left, and what is wrong.

    Exit code 0 if the energy balance holds within the tolerance, 1 if not, 3 if the log does not decide; of
    several logs the worst, and 2 if one cannot be read.
    """
    if len(logs) > 1 and (explain or explain_log or figure is not None):
        raise InputError("--explain, --explain-log and --figure are of one log; give one")
    log = logs[0]
    if explain_log:
        _explain(model, log, mapping, as_json)
        return
    from deltac.diagnosis.audit.audit import audit
    from deltac.models import load_model

    form = form.unless(as_json)
    if len(logs) > 1:
        loaded = load_model(model)  # first: a model that is none is no error of a log

        def judged(path: Path) -> Report:
            return audit(
                loaded, path, tolerance=tolerance, work=work, mapping=mapping, strict=strict
            )

        with progress_bar(f"auditing {len(logs)} logs") as progress:
            cases = []
            for k, each in enumerate(logs):
                progress(k / len(logs))
                cases.append(_case(each, judged))
        _print_several(cases, form)
        raise typer.Exit(worst(cases))
    with progress_bar(f"auditing {log.name}"):
        found = audit(model, log, tolerance=tolerance, work=work, mapping=mapping, strict=strict)
    explanations = []
    if explain:
        from deltac.diagnosis.explain.explain import explain_residual

        with progress_bar("seeking causes"):
            explanations.append(explain_residual(model, log, mapping=mapping))
    deliver(found, form, *explanations, name=str(log), figure=figure)


def _case(log: Path, judged: Callable[[Path], Report]) -> Case:
    """One of several logs; one that cannot be read does not keep the others from being judged."""
    try:
        return Case(str(log), str(log), judged(log))
    except InputError as error:
        return Case(str(log), str(log), error)


def _print_several(cases: Sequence[Case], form: Form) -> None:
    """The outcome of each log in a line, then at length where it is not consistent."""
    if form is Form.json:
        told = [{"log": case.name, **_contents(case)} for case in cases]
        print_json("Audits", {"exit_code": worst(cases), "audits": told})
    elif form in (Form.text, Form.github):
        rows = tuple((case.name, case.summary()) for case in cases)
        print_sections([Table(("log", "outcome"), rows)])
        for case in cases:
            if case.exit_code and not isinstance(case.report, InputError):
                print(f"\n{case.name}")
                print_sections(case.report.sections())
    print_cases(cases, form)


def _contents(case: Case) -> dict[str, Any]:
    if isinstance(case.report, InputError):
        error = {"code": case.report.code, "message": str(case.report)}
        return {"exit_code": case.exit_code, "error": error}
    return case.report.contents()


def _explain(model: str, log: Path, mapping: Path | None, as_json: bool) -> None:
    from deltac.models import load_model
    from deltac.trajectories import explain

    readings = explain(log, mapping, load_model(model).mechanism)
    if as_json:
        print_json("Readings", {"columns": [plain(reading) for reading in readings]})
        return

    def factor(r: ColumnReading) -> str:
        return "" if r.factor == 1.0 and not r.offset else number(r.factor, digits=6)

    rows = ((r.column, r.meaning or "–", r.unit, factor(r), r.note) for r in readings)
    print_sections([Table(("column", "is read as", "unit", "factor", "note"), tuple(rows))])
