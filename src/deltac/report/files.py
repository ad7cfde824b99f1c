"""Figures, JSON and texts as files, which appear whole or not at all (see `foreign.files`)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO

from deltac.errors import FileError
from deltac.foreign.files import appearing, checked_target

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FIGURE_FORMATS = ("pdf", "svg", "png")
"""Of figures, by the ending of the name."""


def check_figure(path: Path) -> Path:
    """The path of a figure; InputError, before the work is done, where none could be written."""
    import deltac.report.picture  # noqa: F401  # without matplotlib it says what to install

    if path.suffix.lower().lstrip(".") not in FIGURE_FORMATS:
        raise FileError(
            f"{path}: figures are written as .pdf or .svg (for papers) or .png; name it so"
        )
    checked_target(path)
    return path


def check_page(path: str | PurePath) -> Path:
    """The path of a page, refused before the work is done where none can be written.

    Raises InputError for another ending than .html, and for a folder that does not exist.
    """
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise FileError(
            f"{path}: a report is a page for the browser; name it {path.with_suffix('.html').name}. A PDF is "
            "printed from there; --figure draws pictures, --json prints the numbers"
        )
    checked_target(path)
    return path


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the path's ending says; the same figure gives the same bytes."""
    from deltac.report.style import UNDATED, styled

    kind = path.suffix.lower().lstrip(".")
    with _written(path) as file, styled():
        figure.savefig(file, format=kind, metadata=UNDATED.get(kind))


def write_json(value: Any, path: Path) -> None:
    """Write a value as JSON, readable by people too."""
    write_text(json.dumps(value, ensure_ascii=False, allow_nan=False, indent=2) + "\n", path)


def write_text(text: str, path: Path) -> None:
    """Write a text as UTF-8."""
    with _written(path) as file:
        file.write(text.encode())


@contextmanager
def _written(path: Path) -> Iterator[BinaryIO]:
    """`appearing`, for which a disk that refuses is an error of input."""
    try:
        with appearing(path) as file:
            yield file
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror}") from error
