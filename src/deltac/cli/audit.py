"""`deltac audit`: a log made elsewhere, against a model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.calls.progress import counted
from deltac.cli import options
from deltac.cli.formats import Case
from deltac.cli.options import Verb, of
from deltac.cli.output import (
    READ_BY_PEOPLE,
    deliver,
    displayed,
    print_cases,
    print_json,
    print_sections,
    progress_bar,
)
from deltac.cli.sweep import deliver_fleet, run
from deltac.errors import ArgumentsError, FileError, InputError
from deltac.results import Table, number, plain, worst_code

if TYPE_CHECKING:
    from deltac.trajectories.formats.reading import ColumnReading


def _status(folder: Path | None) -> None:
    """How far the audit of many logs in a folder is; the command ends with it."""
    if folder is not None:
        from deltac.fleets.result import fleet_status

        deliver_fleet(fleet_status(folder), options.Form.text, None)


@of(audit="deltac.diagnosis.audit.audit", audit_many="deltac.fleets.audits")
def audit(
    audit: Verb,
    audit_many: Verb,
    model: options.Model,
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG",
            help="Logs of the motion: files, folders, patterns, URLs; see docs/fleets.md.",
        ),
    ],
    explain_log: Annotated[
        bool, typer.Option("--explain-log", help="Show how each column is read, and stop.")
    ] = False,
    draft_mapping: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a mapping to edit (columns recognised, guessed and missing), and stop.",
        ),
    ] = None,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Name the changes of the model that would explain the log."),
    ] = False,
    episode: Annotated[
        str | None, typer.Option(metavar="NAME", help="Audit only this episode of a batched log.")
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Time from row to row of logs without times, or with times of too few digits.",
        ),
    ] = None,
    values: options.Parameters = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Keep the table of many logs in this folder, and reuse the results in it.",
        ),
    ] = None,
    status: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Show the progress of an audit of many logs; nothing is run.",
            is_eager=True,
            callback=_status,
        ),
    ] = None,
    figure: options.FigureFile = None,
    page: options.PageFile = None,
    form: options.Format = options.Form.text,
    as_json: options.Json = False,
) -> None:
    """Audit logs: where every joule went, what is unexplained, and what is wrong.

    Exit code 0 if the energy balance holds within the tolerance, 1 if not, 3 if it is unresolved, 2 if
    the log cannot be read. Of several logs, the worst counts.
    """
    from deltac.fleets.audits import is_fleet
    from deltac.models import load_model

    form = form.unless(as_json)
    fleet = out is not None or is_fleet(logs)
    fleet = fleet or not {"workers", "scheduler"}.isdisjoint(audit_many.keywords)
    if (len(logs) > 1 or fleet) and any((explain, explain_log, draft_mapping, figure, episode)):
        raise ArgumentsError(
            "--explain, --explain-log, --draft-mapping, --episode and --figure are of one log; give one"
        )
    if fleet:
        if values or step or audit.keywords.get("replay"):
            raise ArgumentsError(
                "--set, --step and --replay are of logs that are audited at once; with --out, --workers, "
                "--scheduler, folders or patterns write the values into the model, the step into a mapping, "
                "and leave out --replay"
            )
        from deltac.fleets.audits import plan_audits
        from deltac.fleets.spec import Execution

        of_logs = ("tolerance", "work", "mapping", "strict")
        options_of_logs = {name: audit.keywords[name] for name in of_logs if name in audit.keywords}
        plan = plan_audits(model, logs, **options_of_logs)
        run(plan, out, Execution(), audit_many.keywords, form, page)
    if len(logs) > 1 and page is not None:
        raise ArgumentsError("--report of several logs is of their table: add --out DIR")
    if step is not None:
        from deltac.trajectories import with_step

        audit = partial(audit, mapping=with_step(audit.keywords.get("mapping"), step))
    log, mapping = Path(logs[0]), audit.keywords.get("mapping")
    if draft_mapping is not None:
        _draft(model, log, draft_mapping)
        return
    if explain_log:
        _explain(model, log, mapping, form)
        return
    varied = options.with_parameters(model, values)
    if len(logs) > 1:
        loaded = load_model(varied)  # first: a model that is none is no error of a log
        with progress_bar(f"auditing {len(logs)} logs") as progress:
            cases = [_case(each, loaded, audit) for each in counted(logs, progress)]
        _print_several(cases, form)
        raise typer.Exit(worst_code(case.exit_code for case in cases))
    judged: Any = log
    if episode is not None:
        from deltac.fleets.episodes import read_episode

        judged = read_episode(logs[0], episode, mapping, load_model(varied))
        audit = partial(audit, mapping=None)
    with progress_bar(f"auditing {log.name}") as progress:
        report = audit(varied, judged, progress=progress)
    if form in READ_BY_PEOPLE and (reading := report.run.provenance.reading):
        print(f"{reading}\n")
    explanations = []
    if explain:
        from deltac.diagnosis.audit.audit import explain_residual

        shared = ("mapping", "coordinates", "replay", "time_limit")
        same = {name: audit.keywords[name] for name in shared if name in audit.keywords}
        with progress_bar("seeking causes") as progress:
            explanations.append(explain_residual(varied, judged, progress=progress, **same))
    deliver(report, *explanations, form=form, name=str(log), figure=figure, page=page)


def _case(log: str, model: Any, audit: Verb) -> Case:
    """One of several logs; one that cannot be read does not keep the others from being judged."""
    try:
        return Case(log, log, audit(model, Path(log)))
    except InputError as error:
        return Case(log, log, error)


def _print_several(cases: Sequence[Case], form: options.Form) -> None:
    """The outcome of each log in a line, then at length where it is not consistent."""
    if form is options.Form.json:
        entries = [{"log": case.name, **_contents(case)} for case in cases]
        print_json(
            "Audits", {"exit_code": worst_code(case.exit_code for case in cases), "audits": entries}
        )
    elif form in (options.Form.text, options.Form.github):
        rows = tuple((case.name, case.summary()) for case in cases)
        print_sections([Table(("log", "outcome"), rows)])
        for case in cases:
            if case.exit_code and not isinstance(case.report, InputError):
                print(f"\n{displayed(case.name)}")
                print_sections(case.report.sections())
    print_cases(cases, form)


def _contents(case: Case) -> dict[str, Any]:
    if isinstance(case.report, InputError):
        error = {"code": case.report.code, "message": str(case.report)}
        return {"exit_code": case.exit_code, "error": error}
    return case.report.contents()


def _explain(model: str, log: Path, mapping: Path | None, form: options.Form) -> None:
    from deltac.models import load_model
    from deltac.trajectories import explain

    readings = explain(log, mapping, load_model(model).mechanism)
    if form is options.Form.json:
        print_json("Readings", {"columns": [plain(reading) for reading in readings]})
        return

    def factor(r: ColumnReading) -> str:
        return "" if r.factor == 1.0 and not r.offset else number(r.factor, digits=6)

    rows = ((r.column, r.meaning or "–", r.because, r.unit, factor(r), r.note) for r in readings)
    heads = ("column", "is read as", "because", "unit", "factor", "note")
    print_sections([Table(heads, tuple(rows))])


def _draft(model: str, log: Path, path: Path) -> None:
    """Write a mapping to edit, and say what is to be done with it."""
    from deltac.foreign.files import appearing
    from deltac.models import load_model
    from deltac.trajectories import draft_mapping

    if path.exists():
        raise FileError(f"--draft-mapping {path}: the file exists already; give another name")
    text = draft_mapping(log, load_model(model).mechanism)
    with appearing(path, replace=False) as file:
        file.write(text.encode())
    missing, guessed = (text.count(f"  # {word}: ") for word in ("missing", "guessed"))
    print(
        f"{path}: {guessed} guessed, {missing} missing. "
        + ("Say where these are, then: " if missing else "Look at it, then: ")
        + f"deltac audit {model} {log} --mapping {path}"
    )
