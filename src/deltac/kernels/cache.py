"""The disk cache of compiled code: a file each, placed, bounded, sealed, and silent.

Environment: `DELTAC_CACHE_DIR` names the folder (default: `deltac` in the user's cache folder, by
the XDG rules); `DELTAC_CACHE=off` turns the disk cache off.

A file is named after all that its code was made from: the instructions, the compiler and its version, the
processor. It appears whole or not at all, so processes share a folder without locks; it does not wait for the
disk, since what is lost with the power is compiled anew. No state of the cache fails a run; a folder that
cannot be written costs time only, and `deltac cache` says so.

What is read here is run, so only what this user wrote is read. Folder and files must be the user's own
and closed to the writing of others, links are not followed, and each file is sealed: it begins with a keyed
digest (BLAKE2b, RFC 7693) of its name and its content. The key is a random secret of the user, kept apart
from the cache (`deltac/kernels.key` in the user's state folder, by the XDG rules). So whoever can write into
the cache, restores it from elsewhere, or exchanges two of its files, cannot seal what he puts there. What is
not as it was sealed is removed and compiled anew, with a warning.

Kernels are kept as object code, which is only linked when it is read. Of heyoka's objects (Taylor's method)
their own archives are kept, and parsed by heyoka; nothing is unpickled.
"""

from __future__ import annotations

import hashlib
import hmac
import importlib
import json
import os
import re
import secrets
import stat
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from deltac.calls.arguments import checked
from deltac.errors import FileError, InputError
from deltac.foreign.files import UNFINISHED, appearing, remove_abandoned
from deltac.kernels.simd import processor

T = TypeVar("T")

CACHE_BYTES = 256 * 2**20
"""Bytes that the cache takes at most; beyond it, what was not used for longest goes."""

KEPT = CACHE_BYTES // 4 * 3
"""Bytes that are left after that."""

FINISHED = re.compile(r"[0-9a-f]{40}\.kernel")
"""Names of our files: the folder may be the user's, with other things in it."""

HEYOKA_CLASSES = re.compile(r"taylor_adaptive_\w+")
"""Classes of heyoka that are kept."""

_SEAL = 32  # bytes of the digest, and of the key
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class CacheWarning(UserWarning):
    """Something in the cache of compiled kernels is not as it was written there; it is compiled anew."""


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


@checked
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
        CACHE_BYTES,
    )


@checked
def clear_cache() -> None:
    """Remove what the cache holds on disk; kernels already compiled stay usable.

    Raises:
        InputError: the files cannot be removed.
    """
    folder = cache_folder()
    files = _files(folder, FINISHED) + _files(folder, UNFINISHED)
    errors = [error for file, _, _ in files if (error := _removed(Path(file)))]
    if errors:
        raise FileError(
            f"the kernel cache in {folder} cannot be cleared: {len(errors)} of {len(files)} files cannot be "
            f"removed ({errors[0]})"
        )


def compiled(source: str, make: Callable[[], T], folder: Path | None = None) -> T:
    """What `make` compiles from `source`: from the cache if it is there, else made, and put there.

    Args:
        source: all that decides what is made, but for the processor.
        make: it returns an object of heyoka's, bytes, or what JSON holds.
        folder: another one than the cache's.
    """
    folder = folder or (cache_folder() if cache_wanted() else None)
    secret = _secret() if folder is not None and _private(folder) else None
    if folder is None or secret is None:
        return make()
    key = hashlib.blake2b(repr((source, processor())).encode(), digest_size=20).hexdigest()
    file = folder / f"{key}.kernel"
    try:
        code: T | None = _read(file, secret)
    except _Unsealed as problem:
        _warn(f"{file}: {problem}; it is compiled anew")
        _removed(file)
        code = None
    if code is None:
        code = make()
        _write(file, code, secret)
    return code


@checked
def verify_cache() -> dict[str, str]:
    """Files of the cache that would not be used -> what is wrong with them; runs nothing."""
    folder = cache_folder()
    states = {}
    if folder is not None and folder.exists() and (problem := _open_to_others(folder)):
        states[str(folder)] = problem
    secret = _secret()
    for file, _, _ in _files(folder, FINISHED):
        try:
            if secret is None:
                raise _Unsealed("there is no key that it could be sealed with")
            _content(Path(file), secret)
        except _Unsealed as problem:
            states[file] = str(problem)
    return states


HEYOKA_MEMORY = 64 << 20
"""Bytes of compiled code that heyoka itself keeps; its own limit is 2 GB a process."""


@cache
def our_code() -> str:
    """What tells one way in which this package writes code from others."""
    ours = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.blake2b(b"".join(file.read_bytes() for file in ours), digest_size=8).hexdigest()


@cache
def prepare_heyoka() -> str:
    """Silence heyoka and leave caching to us, once in a process; returns what tells its code from others'."""
    import heyoka as hy

    hy.set_logger_level_error()  # its warnings go to standard output, among the results
    hy.llvm_state.set_diskcache_enabled(False)
    hy.llvm_state.set_memcache_limit(HEYOKA_MEMORY)
    return f"heyoka {hy.__version__}, {our_code()}"


# -- sealed files --------------------------------------------------------------------------------


class _Unsealed(Exception):
    """A file is not as this user wrote it; the text says how."""


def _read(file: Path, secret: bytes) -> Any:
    """What the file holds; None if there is none. _Unsealed if it is not as it was written."""
    content = _content(file, secret)
    if content is None:
        return None
    try:
        value = _unpacked(content)
    except Exception as error:  # another version's
        raise _Unsealed(f"cannot be read ({type(error).__name__}: {error})") from None
    with suppress(OSError):
        os.utime(file)  # last used now
    return value


def _content(file: Path, secret: bytes) -> bytes | None:
    """The content of a sealed file, once the seal is found whole; None if there is no file."""
    try:
        flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        handle = os.open(file, flags | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        return None
    except OSError:
        if file.is_symlink():
            raise _Unsealed("is a link") from None
        return None
    with os.fdopen(handle, "rb", closefd=True) as stream:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise _Unsealed("is no regular file")
        if problem := _foreign(about):
            raise _Unsealed(problem)
        seal, content = stream.read(_SEAL), stream.read(CACHE_BYTES + 1)
    if not hmac.compare_digest(seal, _seal(file.name, content, secret)):
        raise _Unsealed("is damaged, or was not written by this user under this name")
    return content


def _write(file: Path, value: Any, secret: bytes) -> None:
    """Put it in the file, then make room; a folder that is full or cannot be written stays as it is."""
    content = _packed(value)
    with suppress(OSError, InputError):
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with appearing(file, mode=0o600, durable=False) as stream:  # the seal tells what was lost
            stream.write(_seal(file.name, content, secret))
            stream.write(content)
        _make_room(file.parent, _SEAL + len(content))


def _seal(name: str, content: bytes, secret: bytes) -> bytes:
    digest = hashlib.blake2b(name.encode() + b"\n", key=secret, digest_size=_SEAL)
    digest.update(content)
    return digest.digest()


def _packed(value: Any) -> bytes:
    """A compiled object as the name of its class and heyoka's archive of it; bytes; else JSON."""
    if type(value).__module__.startswith("heyoka."):
        archive, attributes = value.__getstate__()
        assert not attributes, "heyoka's objects have no attributes of their own"
        return f"heyoka {type(value).__name__}\n".encode() + bytes(archive)
    if isinstance(value, bytes):
        return b"bytes\n" + value
    return b"json\n" + json.dumps(value).encode()


def _unpacked(content: bytes) -> Any:
    kind, _, rest = content.partition(b"\n")
    if kind == b"bytes":
        return rest
    if kind == b"json":
        return json.loads(rest)
    name = kind.decode().removeprefix("heyoka ")
    if not HEYOKA_CLASSES.fullmatch(name):
        raise ValueError(f"no class of compiled objects: {name!r}")
    constructor = getattr(importlib.import_module("heyoka._core"), name)
    value = constructor.__new__(constructor)
    value.__setstate__((rest, {}))
    return value


# -- whose they are ------------------------------------------------------------------------------


def _foreign(about: os.stat_result) -> str:
    """Why a file or folder may not be only this user's; empty if it is."""
    if not hasattr(os, "getuid"):
        return ""
    if about.st_uid != os.getuid():
        return "belongs to another user"
    return "can be written by others" if about.st_mode & _OTHERS_WRITE else ""


def _open_to_others(folder: Path) -> str:
    """Why others may have written into the folder; empty if only this user may."""
    try:
        about = folder.stat()
    except OSError:
        return ""
    if folder.is_symlink() and hasattr(os, "getuid") and folder.lstat().st_uid != os.getuid():
        return "is a link of another user"
    return _foreign(about) if stat.S_ISDIR(about.st_mode) else ""


def _private(folder: Path) -> bool:
    """Whether the folder is this user's alone, or yet to be made; else it is not used, with a warning."""
    if problem := _open_to_others(folder):
        _warn(
            f"the folder of compiled kernels {folder} {problem}: it is not used. Close it (chmod go-w), or "
            "name another in DELTAC_CACHE_DIR"
        )
    return not problem


def key_file() -> Path | None:
    """Where this user's key is kept; None for a user without a home."""
    xdg = Path(os.environ.get("XDG_STATE_HOME", ""))
    with suppress(RuntimeError):
        return (
            (xdg if xdg.is_absolute() else Path.home() / ".local" / "state")
            / "deltac"
            / "kernels.key"
        )
    return None


def _secret() -> bytes | None:
    """The key that seals this user's files, made at first use; None where none can be kept."""
    file = key_file()
    return None if file is None else _secret_in(file)


@cache
def _secret_in(file: Path) -> bytes | None:
    with suppress(OSError, InputError):
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        for _ in range(3):
            if file.is_symlink():
                file.unlink()
            unfit = True
            try:
                handle = os.open(file, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
            except FileNotFoundError:
                unfit = False
            else:
                with os.fdopen(handle, "rb") as stream:
                    about, secret = os.fstat(handle), stream.read(_SEAL + 1)
                mine = not _foreign(about) and not (about.st_mode & 0o077 and hasattr(os, "getuid"))
                if mine and len(secret) == _SEAL:
                    return secret
            # Another process may be making it now: only a file that is there and unfit is replaced.
            with appearing(file, mode=0o600, replace=unfit) as stream:
                stream.write(secrets.token_bytes(_SEAL))
    return None


def _warn(message: str) -> None:
    """One line, once in a process: where one file is damaged the others often are."""
    if not _warned:
        _warned.append(message)
        warnings.warn_explicit(f"{message}. See: deltac cache --verify", CacheWarning, "deltac", 0)


_warned: list[str] = []


# -- room ----------------------------------------------------------------------------------------


_written: dict[Path, int] = {}
"""Bytes that this process put into a folder since it last looked how full it is."""


def _make_room(folder: Path, size: int) -> None:
    """Look now and then how full the folder is: where it holds thousands of files, that takes a while."""
    _written[folder] = _written.get(folder, CACHE_BYTES) + size
    if _written[folder] > CACHE_BYTES // 64:
        _written[folder] = 0
        _evict(folder)


def _evict(folder: Path) -> None:
    """Remove what was used longest ago if there is too much, and what was never finished."""
    remove_abandoned(folder)
    files = sorted(_files(folder, FINISHED), key=lambda entry: entry[2])
    size = sum(entry[1] for entry in files)
    if size <= CACHE_BYTES:
        return
    for file, own, _ in files:
        if size <= KEPT:
            break
        if _removed(Path(file)) is None:
            size -= own


def _removed(file: Path) -> OSError | None:
    """Remove it; the error if that cannot be."""
    try:
        file.unlink(missing_ok=True)
    except OSError as error:
        return error
    return None


def _files(folder: Path | None, name: re.Pattern[str]) -> list[tuple[str, int, float]]:
    """Our files of that name: (path, bytes, last used)."""
    files = []
    with suppress(OSError):
        for entry in os.scandir(folder) if folder is not None else ():
            if name.fullmatch(entry.name):
                with suppress(OSError):  # another process may have removed it
                    about = entry.stat()
                    files.append((entry.path, about.st_size, about.st_mtime))
    return files


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
