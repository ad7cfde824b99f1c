"""`deltac audit`: a log made elsewhere, against a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltac.cli.output import (
    Json,
    Model,
    checked_figure,
    deliver,
    print_json,
    print_sections,
    write,
)
from deltac.results import Table, number, plain

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit
    from deltac.trajectories.formats.reading import ColumnReading


def command(
    model: Model,
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

    checked_figure(figure)
    found = audit(model, log, tolerance=tolerance, work=work, mapping=mapping)
    if figure is not None:
        _draw(found, f"{found.mechanism.name}: {log.name}", figure)
    explanations = []
    if explain:
        from deltac.diagnosis.explain.explain import explain_residual

        explanations.append(explain_residual(model, log, mapping=mapping))
    deliver(found, as_json, *explanations, figure=figure)


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


def _draw(found: Audit, title: str, path: Path) -> None:
    from deltac.report import audit_figure

    allowed = found.tolerance * found.ledger.energy_exchanged
    write(audit_figure(title, found.ledger, found.left_over, found.function, allowed), path)
