"""The folder of a fleet: what it is of, its rows in pieces, what was set aside.

A piece is a Parquet file of some rows, written once, whole or not at all. A row is named by an address, a
digest of all that determines its answer; so whoever comes again, after a kill or with a changed plan, sees
which rows are there. All pieces of a folder can be read at any time, as by
``polars.scan_parquet("DIR/pieces/*.parquet")``.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltac.errors import FileError, InputError
from deltac.fleets.rows import parquet
from deltac.foreign.files import appearing, read_bytes, remove_abandoned
from deltac.foreign.isolation import Failure
from deltac.foreign.limits import parse_json

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    import polars

FORMAT = 1
"""Version of the folder; it grows when older programs cannot go on in it."""

HEAD, PLAN, PIECES_FOLDER, ASIDE = "fleet.json", "plan.parquet", "pieces", "aside"
RESULTS_FILE, LOCK = "results.parquet", ".lock"

ADDRESS = 12
"""Bytes of an address: among 10⁹ rows two are alike with a probability of 6e-12."""


def versions() -> dict[str, str]:
    """Versions of all programs whose numbers enter the results."""
    from importlib.metadata import PackageNotFoundError, version

    from deltac import __version__

    packages = {"deltac": __version__}
    for name in ("numpy", "scipy", "casadi", "llvmlite", "heyoka"):
        with contextlib.suppress(PackageNotFoundError):
            packages[name] = version(name)
    return packages


def digest(contents: Any) -> bytes:
    """A digest of plain contents, the same on every machine."""
    text = json.dumps(contents, sort_keys=True, ensure_ascii=False, allow_nan=False)
    return hashlib.blake2b(text.encode(), digest_size=32).digest()


@dataclass(frozen=True)
class Store:
    """A folder of results.

    head: what it is of, as in its fleet.json: kind ("sweep" or "audit"), name, plan, digests of the
        models by name, what was left out, versions.
    """

    folder: Path
    head: dict[str, Any]

    @staticmethod
    def open(folder: Path) -> Store:
        """A folder that is there, for reading.

        Raises InputError if it is none of ours, or of a later version of deltac.
        """
        try:
            head = parse_json(read_bytes(folder / HEAD, "metadata"), "its contents")
        except InputError as error:
            raise FileError(
                f"{folder}: no results of a sweep or an audit are here ({HEAD}: {error})"
            ) from None
        if not isinstance(head, dict) or not isinstance(head.get("format"), int):
            raise FileError(f"{folder / HEAD}: expected a table with format, kind and name")
        if head["format"] > FORMAT:
            versions_of = head.get("versions")
            maker = "a later version"
            if isinstance(versions_of, dict):
                maker = str(versions_of.get("deltac"))
            raise FileError(
                f"{folder}: its format is {head['format']}, of deltac {maker}; this one reads up to "
                f"{FORMAT}. "
                "Install that version to go on, or write into another folder"
            )
        return Store(folder, head)

    @staticmethod
    def make(
        folder: Path,
        kind: str,
        name: str,
        plan: Any,
        models: Mapping[str, str] | None = None,
        skipped: Sequence[str] = (),
    ) -> Store:
        """The folder to write to, made where it is not there; nothing that it holds is changed.

        Raises InputError if it holds something else: another sweep, files of others.
        """
        head = {
            "format": FORMAT,
            "kind": kind,
            "name": name,
            "plan": plan,
            "models": dict(models or {}),
            "skipped": list(skipped),
            "versions": versions(),
        }
        store = Store(folder, head)
        if (folder / HEAD).exists():
            before = Store.open(folder).head
            if (before.get("kind"), before.get("name")) != (kind, name):
                raise FileError(
                    f"{folder} holds the {before.get('kind')} {before.get('name')!r}, this is the {kind} "
                    f"{name!r}. Choose another folder by --out, or remove that one"
                )
        elif folder.exists() and (not folder.is_dir() or _strange(folder)):
            raise FileError(
                f"{folder} exists already and is not a folder of results; choose another one by --out"
            )
        with _refusals(folder):
            folder.mkdir(parents=True, exist_ok=True)
        return store

    def begin(self) -> dict[str, Any]:
        """Write what the folder is of from now on, within `locked`; returns what it was of before, or {}."""
        before = Store.open(self.folder).head if (self.folder / HEAD).exists() else {}
        with _refusals(self.folder):
            for name in (PIECES_FOLDER, ASIDE):
                (self.folder / name).mkdir(exist_ok=True)
            remove_abandoned(self.folder / PIECES_FOLDER)
        self.write_json(HEAD, self.head)
        return before

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """The folder for this process alone: two would do the same work twice, and nothing worse.

        Raises InputError while another process works here.
        """
        if fcntl is None:
            yield
            return
        with _refusals(self.folder), open(self.folder / LOCK, "a+b") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise FileError(
                    f"{self.folder}: another process is working there; wait for it ('deltac sweep --status "
                    f"{self.folder}' says how far it is), or choose another folder by --out"
                ) from None
            except OSError:  # a file system without locks
                pass
            yield

    # --- rows ------------------------------------------------------------------------------------

    def keep(self, content: bytes, addresses: Sequence[str]) -> None:
        """Put a piece of rows into the folder, under the digest of their addresses."""
        name = hashlib.blake2b("".join(addresses).encode(), digest_size=ADDRESS).hexdigest()
        with (
            _refusals(self.folder),
            appearing(self.folder / PIECES_FOLDER / f"{name}.parquet") as file,
        ):
            file.write(content)

    def pieces(self) -> list[Path]:
        """The files with rows, in order of their names."""
        return sorted((self.folder / PIECES_FOLDER).glob("*.parquet"))

    def done(self) -> set[str]:
        """Addresses of the rows that are there; a damaged piece counts for nothing."""
        import polars

        addresses: set[str] = set()
        for path in self.pieces():
            try:
                addresses.update(
                    polars.read_parquet(path, columns=["address"], glob=False)["address"]
                )
            except (OSError, polars.exceptions.PolarsError, polars.exceptions.PanicException):
                with contextlib.suppress(OSError):
                    path.unlink()
        return addresses

    def rows(self) -> polars.DataFrame:
        """All rows that are there, each once; columns that a piece lacks are null."""
        import polars

        parts = []
        for path in self.pieces():
            try:
                parts.append(polars.read_parquet(path, glob=False))
            except (polars.exceptions.PolarsError, polars.exceptions.PanicException) as error:
                raise FileError(
                    f"{path} is damaged ({error}); run the sweep again, which rebuilds it"
                ) from error
        if not parts:
            return polars.DataFrame({"address": []}, {"address": polars.String})
        joined = polars.concat(parts, how="diagonal_relaxed")
        return joined.unique("address", keep="first", maintain_order=True)

    def plan(self, addresses: Sequence[str]) -> None:
        """Keep which rows there are to be, in order."""
        import polars

        self.write_frame(PLAN, polars.DataFrame({"address": addresses}, {"address": polars.String}))

    def planned(self) -> polars.DataFrame:
        """The addresses of the rows that there are to be; InputError where that is not kept."""
        import polars

        try:
            return polars.read_parquet(self.folder / PLAN, glob=False)
        except (OSError, polars.exceptions.PolarsError) as error:
            raise FileError(f"{self.folder / PLAN} cannot be read: {error}") from error

    def table(self, rows: polars.DataFrame | None = None) -> polars.DataFrame:
        """The planned rows that are there (of `rows`, if these were read already), in the plan's order."""
        frame = self.rows() if rows is None else rows
        return self.planned().join(frame, on="address", maintain_order="left")

    # --- what failed -----------------------------------------------------------------------------

    def set_aside(self, address: str, about: dict[str, Any], failure: Failure) -> None:
        """Keep what a row failed of, and what calls it again."""
        contents = {
            "address": address,
            **about,
            "code": failure.code,
            "message": failure.message,
            "details": failure.details,
            "versions": versions(),
        }
        self.write_json(f"{ASIDE}/{address}.json", contents)

    def aside(self) -> dict[str, dict[str, Any]]:
        """What was set aside, by address."""
        cases: dict[str, dict[str, Any]] = {}
        for path in sorted((self.folder / ASIDE).glob("*.json")):
            with contextlib.suppress(InputError):
                cases[path.stem] = parse_json(read_bytes(path, "metadata"), "its contents")
        return cases

    def forget(self, addresses: Iterable[str]) -> None:
        """Take rows out of the pieces, so that they are made again."""
        import polars

        gone = set(addresses)
        for path in self.pieces() if gone else []:
            frame = polars.read_parquet(path, glob=False)
            remaining = frame.filter(~frame["address"].is_in(gone))
            if len(remaining) == len(frame):
                continue
            if len(remaining):
                self.keep(parquet(remaining), remaining["address"].to_list())
            path.unlink(missing_ok=True)

    def take_back(self, addresses: Iterable[str]) -> None:
        """Forget that these were set aside."""
        for address in addresses:
            with contextlib.suppress(OSError):
                (self.folder / ASIDE / f"{address}.json").unlink()

    # --- files -----------------------------------------------------------------------------------

    def write_json(self, name: str, contents: Any) -> None:
        """Write a file of the folder."""
        text = json.dumps(contents, ensure_ascii=False, allow_nan=False, indent=1)
        self.write(name, text.encode())

    def write_frame(self, name: str, frame: polars.DataFrame) -> None:
        """Write a table of the folder."""
        self.write(name, parquet(frame))

    def write(self, name: str, content: bytes) -> None:
        """Write a file of the folder."""
        with _refusals(self.folder), appearing(self.folder / name) as file:
            file.write(content)


def _strange(folder: Path) -> bool:
    """Whether a folder without a head holds something else than what is written before it."""
    with _refusals(folder):
        return any(p.name not in (LOCK, PIECES_FOLDER, ASIDE) for p in folder.iterdir())


@contextlib.contextmanager
def _refusals(folder: Path) -> Iterator[None]:
    """A disk that is full or cannot be written as an InputError; what is there stays."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        full = error.errno in (28, 122)  # ENOSPC, EDQUOT
        remedy = (
            "Make room, and run it again: it goes on where it stopped"
            if full
            else "Choose a folder that can be written by --out, or change its rights"
        )
        raise FileError(
            f"{folder} cannot be written: {error.strerror or error}. {remedy}"
        ) from error
