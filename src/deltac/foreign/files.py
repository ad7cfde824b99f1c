"""Files on disk: only regular ones are read, and what is written appears whole or not at all."""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from deltac.errors import FileError, closest
from deltac.foreign.limits import Limits

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

UNFINISHED = re.compile(r"\.deltac-[0-9a-f]{12}\.tmp")
"""Names of files that are being written."""


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """A regular file, open for reading; what is none (a pipe, a device, a folder) is refused at once.

    Raises InputError, without the path, which the caller knows how to name.
    """
    source = Path(path)
    try:
        # Without O_NONBLOCK the opening of a named pipe waits for somebody to write into it.
        handle = os.open(
            source, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        )
    except FileNotFoundError:
        raise FileError(f"no such file{_neighbour(source)}") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise FileError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    kind = os.fstat(handle).st_mode
    if not stat.S_ISREG(kind):
        os.close(handle)
        raise FileError(f"cannot be read: it is {_kind(kind)}, expected a regular file")
    with os.fdopen(handle, "rb") as file:
        try:
            yield file
        except OSError as error:
            raise FileError(f"cannot be read: {error.strerror or error}") from error


def read_bytes(path: str | Path, limit: str = "bytes") -> bytes:
    """The content of a regular file of at most `limit` (a name in `Limits`) bytes."""
    limits = Limits.current()
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        limits.check(limit, size, "the file has")
        return file.read(size)


def read_text(path: str | Path, limit: str = "text") -> str:
    """The text of a regular file, UTF-8; InputError names the line that is not."""
    content = read_bytes(path, limit)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise FileError(f"line {line} is not UTF-8 text") from None


def checked_target(path: str | Path) -> Path:
    """Where a file of that name is written; InputError where its folder is missing, or it is no file."""
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileError(f"{path}: the folder {target.parent} does not exist; create it first")
    if target.is_dir():
        raise FileError(f"{path}: is a folder; expected the name of a file")
    if target.exists() and not target.is_file():
        raise FileError(f"{path}: is {_kind(target.stat().st_mode)}; expected the name of a file")
    return target


@contextmanager
def appearing(
    path: str | Path, mode: int | None = None, replace: bool = True, durable: bool = True
) -> Iterator[BinaryIO]:
    """A file to write to, that takes the place of `path` once it is complete and on the disk.

    It is written beside `path` (through a link, not over it), synchronised and renamed, so that a crash or
    an interrupt leaves the old file or the new one. What killed processes left in the folder is removed.
    The rights are `mode`, else those of the file that is replaced, else of the umask. Without `replace`
    a file that another process has put there meanwhile stays. What is not `durable` may be lost or damaged
    when the power fails, and need not wait for the disk (10 ms).

    Raises InputError for a folder that does not exist, OSError when the disk refuses.
    """
    target = checked_target(path)
    temporary, file = _unfinished(target.parent, mode)
    try:
        with file:
            yield file
            file.flush()
            if mode is None:
                with suppress(FileNotFoundError):
                    os.chmod(temporary, stat.S_IMODE(target.stat().st_mode))
            if durable:
                os.fsync(file.fileno())
            if fcntl is not None:  # while it is locked: see `remove_abandoned`
                _put(temporary, target, replace)
        if fcntl is None:  # Windows renames no open file
            _put(temporary, target, replace)
        if durable:
            _synchronise(target.parent)
    finally:
        temporary.unlink(missing_ok=True)
    if durable:
        remove_abandoned(target.parent)


def _put(temporary: Path, target: Path, replace: bool) -> None:
    if replace:
        os.replace(temporary, target)
    else:
        with suppress(FileExistsError):
            os.link(temporary, target)


def _unfinished(folder: Path, mode: int | None) -> tuple[Path, BinaryIO]:
    """A new file to write to, locked as long as it is open: so nobody takes it for abandoned."""
    while True:
        path = folder / f".deltac-{secrets.token_hex(6)}.tmp"
        file = open(path, "x+b", opener=lambda p, flags: os.open(p, flags, mode or 0o666))  # noqa: SIM115
        if fcntl is None:
            return path, file
        with suppress(OSError):  # a file system without locks
            fcntl.flock(file, fcntl.LOCK_EX)
        if os.fstat(file.fileno()).st_nlink:
            return path, file
        file.close()  # it was taken for abandoned before the lock


def remove_abandoned(folder: Path) -> None:
    """Remove the unfinished files in a folder whose processes were killed: their locks are gone."""
    with suppress(OSError):
        for name in filter(UNFINISHED.fullmatch, os.listdir(folder)):
            with suppress(OSError):
                if fcntl is None:
                    os.unlink(folder / name)  # refused while it is open
                    continue
                with open(folder / name, "rb") as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(folder / name)


def _synchronise(folder: Path) -> None:
    """Put the folder's new entry on the disk, where folders can be synchronised."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _kind(mode: int) -> str:
    for test, name in (
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a named pipe"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
        (stat.S_ISSOCK, "a socket"),
    ):
        if test(mode):
            return name
    return "no regular file"


def _neighbour(path: Path) -> str:
    """The closest match of a missing file's name in its folder."""
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist"
    with suppress(OSError):
        others = (entry.name for entry in path.parent.iterdir() if entry.name != path.name)
        hint = closest(path.name, others)
        return hint if "did you mean" in hint else ""
    return ""
