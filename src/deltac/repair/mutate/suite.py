"""The user's own tests, run on mutants: in a copy of their project, which is never changed itself."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from deltac.errors import LimitError, SourceError, UnknownName

LARGEST = 200 * 1024**2
"""Bytes of a project that is copied."""

LEFT_OUT = tuple(
    ".git .hg .venv venv node_modules __pycache__ .mypy_cache .ruff_cache .tox .pytest_cache".split()
)

MARKS = (".git", ".hg", "pyproject.toml", "setup.py", "setup.cfg", "tox.ini", "pytest.ini")
"""What stands in the root of a project."""

EXTRA_SECONDS = 10.0
"""A run may take three times as long as that of the right program, and this much more (s)."""


@dataclass(frozen=True)
class Suite:
    """A command that runs tests in a copy of a project; `file` is the copy of the file with the equations."""

    command: tuple[str, ...]
    folder: Path
    file: Path
    environment: dict[str, str]
    seconds: float = 300.0

    def passes(self, text: str) -> bool:
        """Whether the tests pass with this text in place of the file's; a run that does not end fails."""
        self.file.write_text(text, encoding="utf-8")
        with subprocess.Popen(
            self.command,
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as process:
            try:
                return process.wait(self.seconds) == 0
            except BaseException as error:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                if isinstance(error, subprocess.TimeoutExpired):
                    return False
                raise


@contextlib.contextmanager
def copied(command: str, file: Path, function: str) -> Iterator[Suite]:
    """The suite that a command runs, in a copy of the project that a file belongs to.

    Raises InputError where the tests fail on the file as it is, or pass on one that cannot even be loaded:
    then they do not load this file.
    """
    words = tuple(shlex.split(command))
    if not words or shutil.which(words[0]) is None:
        raise UnknownName(
            f"tests {command!r}: no such command; expected one such as 'pytest tests/'"
        )
    path = file.resolve()
    root = next((p for p in path.parents if any((p / m).exists() for m in MARKS)), path.parent)
    size = sum(p.stat().st_size for p in _files(root))
    if size > LARGEST:
        raise LimitError(
            f"the project {root} has {size / 1024**2:.0f} MB, more than are copied ({LARGEST // 1024**2}); "
            "run the command where the equations and their tests are alone"
        )
    folder = Path.cwd().resolve()
    with tempfile.TemporaryDirectory(prefix="deltac-mutate-") as name:
        copy = Path(name).resolve() / root.name
        shutil.copytree(root, copy, ignore=shutil.ignore_patterns(*LEFT_OUT), symlinks=True)
        folder = copy / folder.relative_to(root) if folder.is_relative_to(root) else copy
        suite = Suite(words, folder, copy / path.relative_to(root), _environment(root, copy))
        text = path.read_text(encoding="utf-8")
        start = time.monotonic()
        if not suite.passes(text):
            raise SourceError(
                f"tests {command!r}: they fail on {file.name} as it is; let them pass first"
            )
        seconds = 3.0 * (time.monotonic() - start) + EXTRA_SECONDS
        suite = Suite(words, folder, suite.file, suite.environment, seconds)
        if suite.passes("raise ImportError('not to be loaded')\n" + text):
            raise SourceError(
                f"tests {command!r}: they pass although {file.name} cannot be loaded: they do not use "
                "it, or use an installed copy. Run them from the project's own files"
            )
        yield suite


def _files(root: Path) -> Iterator[Path]:
    for folder, inner, files in os.walk(root):
        inner[:] = [name for name in inner if name not in LEFT_OUT]
        yield from (p for p in (Path(folder) / name for name in files) if p.is_file())


def _environment(root: Path, copy: Path) -> dict[str, str]:
    """The environment, in which imports find the copy before the project itself."""
    paths = [Path(p).resolve() for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    moved = [copy / p.relative_to(root) if p.is_relative_to(root) else p for p in paths]
    path = os.pathsep.join(map(str, (copy, copy / "src", *moved)))
    return {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
