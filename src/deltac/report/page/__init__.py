"""One page of a result that holds all it shows: plots, the mechanism moving, findings, tables."""

from __future__ import annotations

import datetime
import html
import json
import platform
import re
from importlib import resources
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from deltac.report.files import check_page, write_text
from deltac.report.page.content import Beside, page_of
from deltac.report.page.parts import Page

if TYPE_CHECKING:
    from deltac.results import Report

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
    model: Any = None,
    run: Any = None,
    command: str = "",
) -> None:
    """Write the page of a report, with what further ones have to add; see `Report.report`."""
    path = check_page(path)
    write_text(html_of(report, *more, model=model, run=run, command=command), path)


def html_of(
    report: Report, *more: Report, model: Any = None, run: Any = None, command: str = ""
) -> str:
    """The page of a report as HTML."""
    from deltac.models import load_model

    mechanism = None if model is None else load_model(model).mechanism
    return document(page_of(report, Beside(mechanism, run, more)), command)


def write_page(page: Page, path: str | PurePath, command: str = "") -> None:
    """Write a page, whole or not at all."""
    write_text(document(page, command), check_page(path))


def document(page: Page, command: str = "") -> str:
    """The page as HTML, with its script, its style and its data inside."""
    contents = page.packed()
    contents["made"] = [*_here(command), *contents["made"]]
    data = json.dumps(contents, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    parts = {
        "title": html.escape(f"{page.title}: {page.word}"),
        "style": _asset("page.css"),
        "script": _asset("page.js"),
        "data": _inert(data),
        "word": html.escape(page.word),
        "sentence": html.escape(page.sentence),
    }
    # One pass: what is put in may itself look like a place.
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _asset("page.html"))


def _asset(name: str) -> str:
    return resources.files(__name__).joinpath("assets", name).read_text("utf-8")


def _inert(data: str) -> str:
    """JSON that ends no element and begins none, whatever its texts are."""
    return (
        data.replace("<", "\\u003c")
        .replace(">", "\\u003e")
        .replace("&", "\\u0026")
        .replace("\u2028", "\\u2028")
        .replace("\u2029", "\\u2029")
    )


def _here(command: str) -> list[tuple[str, str]]:
    """How this page was made."""
    from deltac import __version__

    made = [("command", command)] if command else []
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    where = f"deltac {__version__}, Python {platform.python_version()}, {platform.system()}"
    return [*made, ("written by", where), ("written on", now)]
