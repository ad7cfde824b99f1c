"""A page as one file: the template with its script, its style and its data inside."""

from __future__ import annotations

import datetime
import html
import json
import platform
import re
from importlib import resources
from pathlib import PurePath

from deltac.report.files import check_page, write_text
from deltac.report.page.parts import Page


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
    return resources.files("deltac.report.page").joinpath("assets", name).read_text("utf-8")


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

    command_line = [("command", command)] if command else []
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    where = f"deltac {__version__}, Python {platform.python_version()}, {platform.system()}"
    return [*command_line, ("written by", where), ("written on", now)]
