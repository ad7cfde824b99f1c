"""`deltac audit`: a log made elsewhere, against a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.cli import options
from deltac.cli.formats import Case, worst
from deltac.cli.output import (
    deliver,
    displayed,
    print_cases,
    print_json,
    print_sections,
    progress_bar,
)
from deltac.cli.sweep import deliver_fleet, fleet_progress, tell
from deltac.errors import ArgumentsError, FileError, InputError
from deltac.results import Report, Table, number, plain

if TYPE_CHECKING:
    from deltac.trajectories.formats.reading import ColumnReading


def _status(folder: Path | None) -> None:
    """How far the audit of many logs in a folder is; the command ends with it."""
    if folder is not None:
        from deltac.fleets.result import fleet_status

        deliver_fleet(fleet_status(folder), options.Form.text, None)


def command(
    model: options.Model,
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG",
            help="Logs of the motion: files, folders, patterns, URLs; see docs/fleets.md.",
        ),
    ],
    tolerance: options.Tolerance = 1e-3,
    work: Annotated[
        str | None,
        typer.Option(
            metavar="RULE", help="How works are integrated: in-loop, samples or discrete."
        ),
    ] = None,
    mapping: options.MappingFile = None,
    explain_log: Annotated[
        bool, typer.Option("--explain-log", help="Show how each column is read, and stop.")
    ] = False,
    draft_mapping: Annotated[
        Path | None,
        typer.Option(
            "--draft-mapping",
            metavar="FILE",
            help="Write a mapping to edit (columns recognised, guessed and missing), and stop.",
        ),
    ] = None,
    replay: Annotated[
        bool,
        typer.Option(
            "--replay",
            help="Step MuJoCo's model between the rows, with the log's controls, and audit every step.",
        ),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict", help="Exit with 1 for significant mistakes within the tolerance too."
        ),
    ] = False,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Name the changes of the model that would explain the log."),
    ] = False,
    episode: Annotated[
        str | None, typer.Option(metavar="NAME", help="Audit only this episode of a batched log.")
    ] = None,
    values: options.Parameters = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Keep the table of many logs in this folder, and reuse the results in it.",
        ),
    ] = None,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    time_limit: options.TimeLimit = None,
    retry_failed: options.RetryFailed = False,
    status: Annotated[
        Path | None,
        typer.Option(
            "--status",
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

    fleet = out is not None or scheduler is not None or workers is not None or is_fleet(logs)
    of_one = (explain, explain_log, draft_mapping, figure, episode)
    if (len(logs) > 1 or fleet) and any(of_one):
        raise ArgumentsError(
            "--explain, --explain-log, --draft-mapping, --episode and --figure are of one log; give one"
        )
    if fleet and values:
        raise ArgumentsError(
            "--set is of logs that are audited at once; for --out, --workers or --scheduler write the "
            "values into the model"
        )
    if fleet:
        from deltac.fleets.audits import folder_of, plan_audits, write_case
        from deltac.fleets.spec import Execution

        plan = plan_audits(
            model, logs, tolerance=tolerance, work=work, mapping=mapping, strict=strict
        )
        execution = Execution().overridden(
            workers=workers, scheduler=scheduler, time_limit=time_limit
        )
        with fleet_progress("audits", len(plan.logs)) as progress:
            result = plan.run(
                folder_of(plan, out),
                execution,
                retry_failed=retry_failed,
                progress=progress,
                notice=tell,
            )
        deliver_fleet(
            result,
            form.unless(as_json),
            page,
            lambda address, path: write_case(plan, address, path),
        )
    if len(logs) > 1 and page is not None:
        raise ArgumentsError("--report of several logs is of their table: add --out DIR")
    log, varied = Path(logs[0]), options.with_parameters(model, values)
    if draft_mapping is not None:
        _draft(model, log, draft_mapping)
        return
    if explain_log:
        _explain(model, log, mapping, as_json)
        return
    from deltac.diagnosis.audit.audit import audit
    from deltac.models import load_model

    form = form.unless(as_json)
    if len(logs) > 1:
        loaded = load_model(varied)  # first: a model that is none is no error of a log

        def judged(path: Path) -> Report:
            return audit(
                loaded,
                path,
                tolerance=tolerance,
                work=work,
                mapping=mapping,
                strict=strict,
                replay=replay,
            )

        with progress_bar(f"auditing {len(logs)} logs") as progress:
            cases = []
            for k, each in enumerate(logs):
                progress(k / len(logs))
                cases.append(_case(Path(each), judged))
        _print_several(cases, form)
        raise typer.Exit(worst(cases))
    judged_log: Any = log
    if episode is not None:
        from deltac.fleets.episodes import read_episode

        judged_log, mapping = read_episode(logs[0], episode, mapping, load_model(varied)), None
    with progress_bar(f"auditing {log.name}") as progress:
        found = audit(
            varied,
            judged_log,
            tolerance=tolerance,
            work=work,
            mapping=mapping,
            strict=strict,
            replay=replay,
            progress=progress,
        )
    explanations = []
    if explain:
        from deltac.diagnosis.explain.explain import explain_residual

        with progress_bar("seeking causes") as progress:
            explanations.append(explain_residual(varied, log, mapping=mapping, progress=progress))
    deliver(found, form, *explanations, name=str(log), figure=figure, page=page)


def _case(log: Path, judged: Callable[[Path], Report]) -> Case:
    """One of several logs; one that cannot be read does not keep the others from being judged."""
    try:
        return Case(str(log), str(log), judged(log))
    except InputError as error:
        return Case(str(log), str(log), error)


def _print_several(cases: Sequence[Case], form: options.Form) -> None:
    """The outcome of each log in a line, then at length where it is not consistent."""
    if form is options.Form.json:
        told = [{"log": case.name, **_contents(case)} for case in cases]
        print_json("Audits", {"exit_code": worst(cases), "audits": told})
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
