"""How much of a foreign file is read: one set of limits that every reader and parser keeps.

A log is written by anybody. So what a file declares (sizes, counts, depths) is compared with `Limits` before
it is unpacked or reserved, and what is beyond is an InputError that says which limit it was and how to
raise it: for a block of code ``with Limits(columns=200_000).applied():``, for a process
``DELTAC_LIMITS="columns=200000 bytes=64e9"``.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

from deltac.errors import FileError, InputError, LimitError, LogError, check_names, shown

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

LIMITS_VARIABLE = "DELTAC_LIMITS"

SMALL_FILE = 256 * 2**20
"""Bytes that any file may unpack to, however small it is."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Upper bounds on what is read of a file.

    bytes      of a file that is read whole, and of the numbers that it unpacks to
    expansion  how many times its own size a file above 256 MiB may unpack to; bombs reach 1000 and more
    rows       of a log that is read whole
    columns    of a log, and elements of an archive
    header     bytes of comments, column names and other lines before the numbers
    metadata   bytes of deltac's own JSON header
    nesting    levels of structures in structures, in JSON, TOML, MATLAB and HDF5
    name       characters of a column's name
    text       bytes of a mapping or another file of settings, and of a module that repair reads
    model      bytes of a model file (MJCF, URDF)
    seconds    that native decoders may take (and one more for each 5 MB of the file), and an MJCF file to
               compile, if it is large or asks for many elements

    Raises InputError for a limit that is no whole number above zero.
    """

    bytes: int = 32 * 2**30
    expansion: int = 200
    rows: int = 200_000_000
    columns: int = 50_000
    header: int = 16 * 2**20
    metadata: int = 64 * 2**20
    nesting: int = 64
    name: int = 1000
    text: int = 4 * 2**20
    model: int = 64 * 2**20
    seconds: int = 120

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and value.is_integer():
                object.__setattr__(self, field.name, int(value))
            elif isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise LimitError(f"Limits: {field.name} is {shown(value)}, expected 1 or more")

    @staticmethod
    def current() -> Limits:
        """The limits in force: of the innermost `applied`, else of ``DELTAC_LIMITS``, else the usual."""
        return _applied.get() or _of_environment(os.environ.get(LIMITS_VARIABLE, ""))

    @contextmanager
    def applied(self) -> Iterator[Limits]:
        """Put these limits in force while the block runs, in this thread or task."""
        token = _applied.set(self)
        try:
            yield self
        finally:
            _applied.reset(token)

    def check(self, name: str, amount: float, what: str) -> None:
        """Raise InputError if `amount`, of what `what` says, is more than the limit `name`."""
        if amount > getattr(self, name):
            amount = min(amount, 10**18)  # what a file declares may be beyond all floats
            self.refuse(name, f"{what} {_amount(amount, name)}", 1.1 * amount)

    def refuse(self, name: str, problem: str, needed: float = 0.0) -> NoReturn:
        """Raise the InputError that says which limit it was, and how it is raised."""
        limit = getattr(self, name)
        raise LimitError(
            f"{problem}, more than the limit of {_amount(limit, name)}. If that is meant, raise "
            f"{name!r}: {LIMITS_VARIABLE}={name}={int(max(2 * limit, needed))} in the environment, or "
            f"'with deltac.Limits({name}=…).applied():' around the call"
        )

    def check_unpacked(self, unpacked: float, size: int, copies: float = 1.0) -> None:
        """Raise InputError if `size` bytes of a file unpack to too many, or to more than memory holds."""
        self.check("bytes", unpacked, "it unpacks to")
        if unpacked > max(SMALL_FILE, self.expansion * size):
            self.refuse(
                "expansion",
                f"its {_amount(size, 'bytes')} unpack to {_amount(unpacked, 'bytes')}, "
                f"{unpacked / max(size, 1):.0f} times as many",
                1.1 * unpacked / max(size, 1),
            )
        require_memory(unpacked * copies, f"{_amount(unpacked, 'bytes')} of numbers")


_applied: ContextVar[Limits | None] = ContextVar("deltac_limits", default=None)


@lru_cache(maxsize=8)
def _of_environment(text: str) -> Limits:
    """The limits that ``name=number`` says, separated by blanks or commas."""
    names = [field.name for field in fields(Limits)]
    limits: dict[str, float] = {}
    for entry in text.replace(",", " ").split():
        name, _, value = entry.partition("=")
        check_names([name], names, f"{LIMITS_VARIABLE}: unknown limit")
        try:
            limits[name] = int(float(value))
        except (ValueError, OverflowError):
            raise LimitError(
                f"{LIMITS_VARIABLE}: {name} is {shown(value)}, expected a whole number"
            ) from None
    return Limits(**limits)  # type: ignore[arg-type]


def _amount(value: float, name: str) -> str:
    match name:
        case "bytes" | "header" | "metadata" | "text" | "model":
            for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
                if value >= size:
                    return f"{value / size:.4g} {unit}"
            return f"{value:.0f} bytes"
        case "expansion":
            return f"{value:.0f} times"
        case "nesting":
            return f"{value:.0f} levels"
        case "name":
            return f"{value:.0f} characters"
    return f"{value:.0f} {name}"


# -- memory --------------------------------------------------------------------------------------


def require_memory(needed: float, size: str) -> None:
    """Raise InputError when reading would take more bytes than are free; where unknown, pass."""
    free = free_memory()
    if free is not None and needed > free:
        raise LimitError(
            f"the log has {size}; reading it whole takes about {needed / 1e9:.1f} GB, and "
            f"{free / 1e9:.1f} GB are free. Store it as Parquet, which is read in parts "
            "(scan_trajectory), or take a part of it."
        )


def free_memory() -> float | None:
    """Bytes that can be had without swapping, within the limits of this process and its container."""
    sizes = []
    with suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                sizes.append(float(line.split()[1]) * 1024.0)
    with suppress(OSError, ValueError):  # cgroup 2
        limit = float(Path("/sys/fs/cgroup/memory.max").read_text("ascii"))
        sizes.append(limit - float(Path("/sys/fs/cgroup/memory.current").read_text("ascii")))
    with suppress(OSError, ValueError, AttributeError):
        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
            sizes.append(limit - float(pages * resource.getpagesize()))
    return max(0.0, min(sizes)) if sizes else None


# -- JSON ----------------------------------------------------------------------------------------


def parse_json(text: str | bytes, what: str) -> Any:
    """The value of a JSON text within the limits, its numbers finite and its integers of 64 bits.

    Raises InputError, about `what`, for anything else.
    """
    limits = Limits.current()
    limits.check("metadata", len(text), f"the text of {what} is of")
    try:
        value = json.loads(
            text, parse_int=_integer, parse_float=_number, parse_constant=_not_a_number
        )
    except RecursionError:
        limits.refuse("nesting", f"lists and objects of {what} are nested deeper")
    except InputError as error:
        raise InputError(f"damage in {what}: {error}") from None
    except (ValueError, UnicodeError) as error:  # of the parser and the codec
        raise FileError(f"damage in {what}: {error}") from error
    check_nesting(value, what)
    return value


def parse_toml(text: str) -> dict[str, Any]:
    """The document of a TOML text within the limits; InputError with line and column for what is none."""
    import tomllib

    limits = Limits.current()
    limits.check("text", len(text), "the file has")
    # Each dot of a key is a table in a table; thousands of them keep the parser busy for minutes.
    dense = text.replace(" ", "").replace("\t", "")
    deepest = max((word.count(".") for word in re.split(r"[\s=,\[\]{}#]+", dense)), default=0)
    limits.check("nesting", deepest, "a key or text has dots, each a table:")
    try:
        document = tomllib.loads(text)
        check_nesting(document, "its tables and lists")
    except RecursionError:
        limits.refuse("nesting", "its tables and lists are nested deeper")
    except InputError:
        raise
    except ValueError as error:  # also of integers and dates beyond what there is
        raise FileError(f"is no TOML: {error}") from error
    return document


_PART = r"\"[^\"]*\"|'[^']*'|[\w\-]+"
_STATEMENT = re.compile(
    rf"\s*(?P<table>\[\[?)?\s*(?P<key>(?:{_PART})(?:\s*\.\s*(?:{_PART}))*)\s*(?(table)\]|=)"
)


def line_of(text: str, key: str) -> int:
    r"""The line, from 1, of the statement of a TOML text that gives a dotted key or what holds it; 0: none.

    Python's parser tells no positions, so headers and keys at the beginning of lines are read here.

    >>> line_of("a = 1\n[b]\nc = [\n  1,\n  2,\n]\nd = 3\n", "b.c.1")
    3
    """
    table, best, longest = "", 0, 0
    for number, line in enumerate(text.splitlines(), 1):
        if not (match := _STATEMENT.match(line)):
            continue
        place = ".".join(part.strip("\"'") for part in re.findall(_PART, match["key"]))
        if match["table"]:
            table = place
        elif table:
            place = f"{table}.{place}"
        if len(place) > longest and f"{key}.".startswith(f"{place}."):
            best, longest = number, len(place)
    return best


def check_nesting(value: Any, what: str) -> None:
    """Raise InputError for lists and dictionaries in each other, deeper than the limit."""
    limits = Limits.current()
    level, depth = [value], 0
    while level := [
        item
        for outer in level
        if isinstance(outer, dict | list)
        for item in (outer.values() if isinstance(outer, dict) else outer)
        if isinstance(item, dict | list)
    ]:
        depth += 1
        if depth > limits.nesting:
            limits.refuse("nesting", f"lists and objects of {what} are nested {depth} levels deep")


def _integer(text: str) -> int:
    if len(text) > 20 or not -(2**63) <= int(text) < 2**63:
        raise LogError(f"found {shown(text)}, expected an integer of 64 bits")
    return int(text)


def _number(text: str) -> float:
    value = float(text)
    if value - value != 0.0:
        raise LogError(f"found {shown(text)}, expected a number within double precision")
    return value


def _not_a_number(text: str) -> NoReturn:
    raise LogError(f"found {text}, expected a finite number")
