"""One page of a result that holds all it shows: plots, the mechanism moving, findings, tables."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

from deltac.report.files import check_page, write_text
from deltac.report.page.content import Beside, page_of
from deltac.report.page.document import document, write_page
from deltac.report.page.parts import Page

if TYPE_CHECKING:
    from deltac.models import ModelLike
    from deltac.results import Report
    from deltac.simulation import Equations, RightHandSide
    from deltac.trajectories import Trajectory

__all__ = [
    "Beside",
    "Page",
    "check_page",
    "document",
    "html_of",
    "page_of",
    "write_page",
    "write_report",
]


def write_report(
    report: Report,
    path: str | PurePath,
    *more: Report,
    model: ModelLike | None = None,
    run: Trajectory | None = None,
    equations: Equations | RightHandSide | None = None,
    command: str = "",
) -> None:
    """Write the page of a report, with what further ones have to add; see `Report.report`."""
    path = check_page(path)
    page = html_of(report, *more, model=model, run=run, equations=equations, command=command)
    write_text(page, path)


def html_of(
    report: Report,
    *more: Report,
    model: ModelLike | None = None,
    run: Trajectory | None = None,
    equations: Equations | RightHandSide | None = None,
    command: str = "",
) -> str:
    """The page of a report as HTML."""
    from deltac.models import load_model
    from deltac.simulation import Equations

    if equations is not None and not isinstance(equations, Equations):
        equations = Equations(equations)
    loaded = None if model is None else load_model(model)
    return document(page_of(report, Beside(loaded, run, equations, more)), command)
