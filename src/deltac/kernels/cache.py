"""The disk cache of compiled code: a file each, placed, bounded, and silent.

Environment: `DELTAC_CACHE_DIR` names the folder (default: `deltac` in the user's cache folder, by
the XDG rules); `DELTAC_CACHE=off` turns the disk cache off.

A file is named after all that its code was made from: the instructions, the compiler and its version, the
processor. It appears whole or not at all, so processes share a folder without locks. It begins with a
digest of the rest: a flipped bit in machine code is wrong numbers or a crash, and what is not as it was
written is removed and compiled anew. No state of the cache fails a run; a folder that cannot be written
costs time only, and `deltac cache` says so.

heyoka's objects are kept whole, pickled: its own cache keeps machine code only, and writing out what it
looks up there takes 0.7 s for a robot of 30 joints, five times as long as all of this. Machine
code or pickle, what is read is run: so files of other users are not.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from deltac.errors import InputError
from deltac.kernels.simd import processor

T = TypeVar("T")

LIMIT = 256 * 2**20
"""Bytes that the cache takes at most; beyond it, what was not used for longest goes."""

KEPT = LIMIT // 4 * 3
"""Bytes that are left after that."""

FINISHED = re.compile(r"[0-9a-f]{40}\.kernel")
UNFINISHED = re.compile(r"deltac-\w+\.part")
"""Names of our files: the folder may be the user's, with other things in it."""

ABANDONED = 3600.0
"""Age (s) from which an unfinished file is taken to be left over from a process that was killed."""

_DIGEST = 32


@dataclass(frozen=True)
class CacheInfo:
    """The folder of the cache (None: nowhere), whether it is wanted and can be written, files and bytes."""

    path: Path | None
    enabled: bool
    writable: bool
    entries: int
    size_bytes: int
    limit_bytes: int


def cache_folder() -> Path | None:
    """The folder of the cache; None for a user without a home."""
    if chosen := os.environ.get("DELTAC_CACHE_DIR"):
        return Path(chosen).expanduser().absolute()
    xdg = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if xdg.is_absolute():  # the XDG rules ignore a relative one
        return xdg / "deltac"
    try:
        return Path.home() / ".cache" / "deltac"
    except RuntimeError:
        return None


def cache_wanted() -> bool:
    """False after `DELTAC_CACHE=off`.

    Raises:
        InputError: any value other than `on` and `off`.
    """
    setting = os.environ.get("DELTAC_CACHE", "").strip().lower() or "on"
    if setting not in ("on", "off"):
        raise InputError(f"DELTAC_CACHE={setting!r}: expected 'on' or 'off'")
    return setting == "on"


def cache_info() -> CacheInfo:
    """The state of the cache on disk; compiles nothing and loads no compiler."""
    folder = cache_folder()
    files = _files(folder, FINISHED)
    return CacheInfo(
        folder,
        cache_wanted() and folder is not None,
        folder is not None and _writable(folder),
        len(files),
        sum(size for _, size, _ in files),
        LIMIT,
    )


def clear_cache() -> None:
    """Remove what the cache holds on disk; kernels already compiled stay usable.

    Raises:
        InputError: the files cannot be removed.
    """
    folder = cache_folder()
    files = _files(folder, FINISHED) + _files(folder, UNFINISHED)
    errors = [error for file, _, _ in files if (error := _removed(file))]
    if errors:
        raise InputError(
            f"the kernel cache in {folder} cannot be cleared: {len(errors)} of {len(files)} files cannot be "
            f"removed ({errors[0]})"
        )


def compiled(source: str, make: Callable[[], T], folder: Path | None = None) -> T:
    """What `make` compiles from `source`: from the cache if it is there, else made, and put there.

    Args:
        source: all that decides what is made, but for the processor.
        make: what it returns can be pickled.
        folder: another one than the cache's.
    """
    folder = folder or (cache_folder() if cache_wanted() else None)
    if folder is None:
        return make()
    key = hashlib.blake2b(repr((source, processor())).encode(), digest_size=20).hexdigest()
    file = folder / f"{key}.kernel"
    found: T | None = _read(file)
    if found is None:
        found = make()
        _write(file, found)
    return found


@cache
def prepare_heyoka() -> str:
    """Silence heyoka and leave caching to us, once in a process; returns what tells its code from others'."""
    import heyoka as hy

    hy.set_logger_level_error()  # its warnings go to standard output, among the results
    hy.llvm_state.set_diskcache_enabled(False)
    ours = sorted(Path(__file__).parent.glob("*.py"))  # how expressions are put to heyoka
    digest = hashlib.blake2b(b"".join(file.read_bytes() for file in ours), digest_size=8)
    return f"heyoka {hy.__version__}, {digest.hexdigest()}"


def _read(file: Path) -> Any:
    """What the file holds; None if there is none, or it is not what was written."""
    try:
        if hasattr(os, "getuid") and file.stat().st_uid != os.getuid():
            return None  # nobody runs another user's code
        content = file.read_bytes()
    except OSError:
        return None
    digest, code = content[:_DIGEST], memoryview(content)[_DIGEST:]
    if hashlib.blake2b(code, digest_size=_DIGEST).digest() == digest:
        with suppress(Exception):  # whatever pickle and heyoka may find wrong with it
            found = pickle.loads(code)
            with suppress(OSError):
                os.utime(file)  # last used now
            return found
    with suppress(OSError):
        file.unlink()
    return None


def _write(file: Path, made: Any) -> None:
    """Put it in the file, then make room; a folder that is full or cannot be written stays as it is."""
    code = pickle.dumps(made, protocol=5)
    part: Path | None = None
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(".part", "deltac-", file.parent)
        part = Path(name)
        with open(handle, "wb") as stream:
            stream.write(hashlib.blake2b(code, digest_size=_DIGEST).digest())
            stream.write(code)
        part.replace(file)
        _evict(file.parent)
    except OSError:
        if part is not None:
            _removed(part)


def _evict(folder: Path) -> None:
    """Remove what was used longest ago if there is too much, and what was never finished."""
    now = time.time()
    for file, _, used in _files(folder, UNFINISHED):
        if now - used > ABANDONED:
            _removed(file)
    files = sorted(_files(folder, FINISHED), key=lambda entry: entry[2])
    size = sum(entry[1] for entry in files)
    if size <= LIMIT:
        return
    for file, own, _ in files:
        if size <= KEPT:
            break
        if _removed(file) is None:
            size -= own


def _removed(file: Path) -> OSError | None:
    """Remove it; the error if that cannot be."""
    try:
        file.unlink(missing_ok=True)
    except OSError as error:
        return error
    return None


def _files(folder: Path | None, name: re.Pattern[str]) -> list[tuple[Path, int, float]]:
    """Our files of that name: (file, bytes, last used)."""
    found = []
    with suppress(OSError):
        for file in folder.iterdir() if folder is not None else ():
            if name.fullmatch(file.name):
                with suppress(OSError):  # another process may have removed it
                    about = file.stat()
                    found.append((file, about.st_size, about.st_mtime))
    return found


def _writable(folder: Path) -> bool:
    """Whether a file can be made in the folder, or in the nearest above it that there is: tried."""
    place = next((p for p in (folder, *folder.parents) if p.exists()), folder)
    try:
        with tempfile.TemporaryFile(dir=place) as file:
            file.write(bytes(2**16))
            file.flush()
    except OSError:
        return False
    return True
