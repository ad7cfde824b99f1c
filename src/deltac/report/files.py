"""Files that appear complete or not at all: written under another name, then renamed."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Any

from deltac.errors import FileError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def output_folder(path: Path) -> Path:
    """Make a folder for results; InputError if it cannot be made or written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{path} cannot be a folder for results: {error.strerror}") from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise FileError(f"the folder {path} cannot be written to; choose another one")
    return path


def check_figure(path: Path) -> None:
    """InputError, before the work is done, for a path that a figure could not be written to."""
    if path.suffix.lower() != ".png":
        raise FileError(f"{path}: figures are written as .png; name it so")
    if not path.parent.is_dir():
        raise FileError(f"{path}: the folder {path.parent} does not exist; create it first")


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG."""
    from deltac.report.figures import styled

    with _replacing(path) as temporary, styled():
        figure.savefig(temporary, format="png")


def write_json(value: Any, path: Path) -> None:
    """Write a value as JSON, readable by people too."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, indent=2)
    with _replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A name beside `path` to write to; renamed to it at the end, removed if something fails."""
    try:
        with NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = Path(file.name)
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror}") from error
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())  # temporary files are private
        temporary.replace(path)
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
