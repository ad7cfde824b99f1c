"""The disk cache of compiled kernels: heyoka's own, placed, bounded and kept from breaking a run.

Environment: `DELTAC_CACHE_DIR` names the folder (default: `deltac` in the user's cache folder, by
the XDG rules); `DELTAC_CACHE=off` turns the disk cache off.

heyoka refuses a database that SQLite finds malformed, and goes on with every compile failing to
reach it; code damaged inside a well-formed database it loads and runs. `prepare_cache` looks first
(see `seals`), empties a damaged cache, and switches off one that cannot be used; both with a
warning. A disk that fills up later costs the saved work only.
"""

from __future__ import annotations

import os
import sys
import warnings
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing.util import Finalize  # unlike atexit, runs in multiprocessing children too
from pathlib import Path

from deltac.errors import InputError
from deltac.kernels import seals

LIMIT = 256 * 2**20
"""Bytes that the cache takes at most, SQLite's journal beside it included."""

EVICTED_FROM = LIMIT // 4 * 3
"""Size of the database above which heyoka evicts the entries used longest ago; a journal of a quarter
of that was seen beside it."""

_DAMAGE = ("corrupt", "malformed", "not a database")


@dataclass(frozen=True)
class CacheInfo:
    """Where the kernel cache is (None: nowhere), whether it is wanted, its size and its limit."""

    path: Path | None
    enabled: bool
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
    size = 0
    for file in _files(folder):
        with suppress(OSError):
            size += file.stat().st_size
    return CacheInfo(folder, cache_wanted() and folder is not None, size, LIMIT)


def clear_cache() -> None:
    """Remove what the cache holds on disk; kernels already compiled stay usable.

    Raises:
        InputError: the files cannot be removed.
    """
    folder = cache_folder()
    if folder is None:
        return
    if "heyoka" in sys.modules:
        with suppress(RuntimeError):
            _close(folder)
    try:
        _remove_files(folder)
    except OSError as error:
        raise InputError(f"the kernel cache in {folder} cannot be cleared: {error}") from error


@cache
def prepare_cache() -> None:
    """Direct heyoka's disk cache to our folder, once in a process, before the first compile."""
    import heyoka as hy

    hy.set_logger_level_error()  # its warnings go to standard output, among the results
    folder = cache_folder()
    if folder is None or not cache_wanted():
        hy.llvm_state.set_diskcache_enabled(False)
        return
    try:
        _open_or_rebuild(folder)
    except (OSError, RuntimeError, seals.Error) as error:
        hy.llvm_state.set_diskcache_enabled(False)
        warnings.warn(
            f"the kernel cache in {folder} cannot be used ({error}); kernels are compiled afresh. "
            "Set DELTAC_CACHE_DIR to a writable folder, or DELTAC_CACHE=off.",
            RuntimeWarning,
            stacklevel=2,
        )
    else:
        Finalize(None, _seal_at_exit, (folder,), exitpriority=0)


def _open_or_rebuild(folder: Path) -> None:
    try:
        _open(folder)
    except (RuntimeError, seals.Error) as error:
        if not any(sign in str(error) for sign in _DAMAGE):
            raise
        _close(folder)
        _remove_files(folder)
        _open(folder)
        warnings.warn(
            f"the kernel cache in {folder} was damaged ({error}); it has been emptied, "
            "and kernels are compiled anew.",
            RuntimeWarning,
            stacklevel=4,
        )


def _open(folder: Path) -> None:
    import heyoka as hy

    folder.mkdir(parents=True, exist_ok=True)
    seals.verify(folder)
    hy.llvm_state.set_diskcache_path(folder)
    hy.llvm_state.set_diskcache_limit(EVICTED_FROM)  # opens the database: errors show here
    hy.llvm_state.set_diskcache_enabled(True)


def _close(folder: Path) -> None:
    import heyoka as hy

    hy.llvm_state.set_diskcache_path(folder)  # closes the database until the next compile


def _seal_at_exit(folder: Path) -> None:
    with suppress(OSError, RuntimeError, seals.Error):  # unsealed entries are compiled again
        _close(folder)
        seals.seal(folder)


def _files(folder: Path | None) -> list[Path]:
    """What heyoka and we may have written, and nothing else: the folder may be the user's."""
    if folder is None:
        return []
    suffixes = ("", "-wal", "-shm", "-journal")
    return [folder / f"{name}{s}" for name in (seals.DATABASE, seals.SEALS) for s in suffixes]


def _remove_files(folder: Path) -> None:
    for file in _files(folder):
        file.unlink(missing_ok=True)
