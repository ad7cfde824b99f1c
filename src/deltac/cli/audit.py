"""`deltac audit`: a log made elsewhere, against a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli.output import (
    Json,
    new_table,
    number,
    print_json,
    print_table,
    print_text,
)

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit
    from deltac.diagnosis.explain.result import Explanation
    from deltac.importers import ImportReport

SHOWN = 6
"""Remarks of an import that are printed; --json has all of them."""


def command(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="A problem's name, an .xml or .urdf file, or FILE.py:FUNCTION."
        ),
    ],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log of its motion.")],
    tolerance: Annotated[
        float, typer.Option(help="Accepted |ΔC| as a fraction of the energy turned over.")
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
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Name the changes of the model that would fit the log."),
    ] = False,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the energies over time (PNG).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Audit a log: where every joule went, what is left, and what is wrong.

    Exit status 0 if the energy balance holds within the tolerance, 1 if not, 3 if the log does not tell.
    """
    if explain_log:
        _explain(model, log, mapping, as_json)
        return
    from deltac.diagnosis.audit.audit import audit

    if figure is not None:
        from deltac.report import check_figure

        check_figure(figure)
    found = audit(model, log, tolerance=tolerance, work=work, mapping=mapping)
    if figure is not None:
        _draw(found, f"{found.mechanism.name}: {log.name}", figure)
    explanation = None
    if explain:
        from deltac.diagnosis.explain.explain import explain_residual

        explanation = explain_residual(model, log, mapping=mapping)
    if as_json:
        told = {} if explanation is None else {"explanation": explanation.to_dict()}
        shown = None if figure is None else str(figure)
        print_json({**found.to_dict(), **told, "figure": shown})
    else:
        _print(found, figure)
        if explanation is not None:
            _print_explanation(explanation)
    raise typer.Exit(found.status)


def _print(found: Audit, figure: Path | None) -> None:
    table = new_table()
    table.add_column("channel")
    for column in ("energy (J)", "share"):
        table.add_column(column, no_wrap=True, justify="right")
    table.add_column("basis")
    for row in found.rows():
        if row.name == "ΔK":
            table.add_section()
        table.add_row(row.name, number(row.energy), f"{100 * row.share:.3g} %", row.basis)
    print_table(table)
    typer.echo("")
    typer.echo(found.verdict.explain())
    if found.import_report is not None:
        _print_import(found.import_report)
    if figure is not None:
        typer.echo(f"figure: {figure}")


def _print_explanation(found: Explanation) -> None:
    """The outcome in words, then cause by cause."""
    typer.echo("")
    print_text(f"{found.sentence}.")
    if found.causes:
        table = new_table()
        for column in ("cause", "of", "in the run", "±", "in the model", "unit", "explains"):
            table.add_column(column)
        for row in found.rows():
            table.add_row(*row)
        print_table(table)
    if found.unseen:
        shown = ", ".join(found.unseen[:SHOWN]) + (", …" if len(found.unseen) > SHOWN else "")
        print_text(f"Not seen in this log: {shown}.")


def _print_import(report: ImportReport) -> None:
    """What the model is an import of, in short."""
    counts = f"{len(report.read)} elements read, {len(report.ignored)} left to the log"
    print_text(f"Model: {report.source}, {counts}, {len(report.assumed)} assumed.")
    for heading, remarks in (("Left to the log", report.ignored), ("Assumed", report.assumed)):
        shown = "; ".join(f"{r.element} ({r.what})" for r in remarks[:SHOWN])
        if remarks:
            print_text(f"{heading}: {shown}{'; …' if len(remarks) > SHOWN else ''}.")


def _explain(model: str, log: Path, mapping: Path | None, as_json: bool) -> None:
    from deltac.diagnosis.inputs.models import load_model
    from deltac.trajectories import explain

    readings = explain(log, mapping, load_model(model).mechanism)
    if as_json:
        print_json([vars(reading) for reading in readings])
        return
    table = new_table()
    for column in ("column", "is read as", "unit", "factor", "note"):
        table.add_column(column)
    for r in readings:
        factor = "" if r.factor == 1.0 and not r.offset else number(r.factor, digits=6)
        table.add_row(r.column, r.meaning or "–", r.unit, factor, r.note)
    print_table(table)


def _draw(found: Audit, title: str, path: Path) -> None:
    from deltac.report import audit_figure, write_figure

    allowed = found.tolerance * found.ledger.turnover
    write_figure(audit_figure(title, found.ledger, found.left_over, found.function, allowed), path)
