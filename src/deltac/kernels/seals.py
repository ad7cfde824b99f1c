"""Checksums beside heyoka's kernel database, which keeps machine code without any.

A flipped bit in cached code is wrong numbers or a crash. So each entry is sealed (its CRC-32 is
stored, in a database beside heyoka's) when the process that made it ends, and every seal is checked
before the next process opens the cache: about 0.1 s for 256 MiB. An entry without a seal (its maker
was killed, or still runs) is dropped, and compiled again when needed.

Neither function may run while heyoka has the database open in the same process: POSIX drops all
locks of a process on a file when it closes any handle of it, and heyoka brings its own SQLite.
"""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

DATABASE = "cache.db"
SEALS = "seals.db"
Error = sqlite3.Error

_SCHEMA_VERSION = 0  # of heyoka's tables, as of heyoka 7.13


class DamagedCacheError(sqlite3.DatabaseError):
    """An entry of the cache is not what was stored."""


def verify(folder: Path) -> None:
    """Drop the entries without a seal, and check the others.

    Raises:
        DamagedCacheError: an entry does not match its seal.
        Error: the database cannot be read, or is malformed.
    """
    with _databases(folder) as connection:
        if connection is None:
            return
        sealed = {(row[0], row[1]): row[2] for row in connection.execute("SELECT * FROM seal")}
        unsealed = []
        for entry, checksum in _checksums(connection, _ENTRIES):
            if entry not in sealed:
                unsealed.append(entry[:1])
            elif sealed[entry] != checksum:
                raise DamagedCacheError(f"corrupt entry {entry[0]}")
        if unsealed:
            connection.executemany("DELETE FROM cache WHERE hash = ?", unsealed)
            connection.execute(
                "UPDATE config SET value = (SELECT coalesce(sum(size), 0) FROM cache)"
                " WHERE key = 'total_size'"
            )


def seal(folder: Path) -> None:
    """Seal the entries that have no seal yet, and forget the seals of evicted ones."""
    with _databases(folder) as connection:
        if connection is None:
            return
        new = [(*entry, checksum) for entry, checksum in _checksums(connection, _NEW_ENTRIES)]
        connection.executemany("INSERT OR REPLACE INTO seal VALUES (?, ?, ?)", new)
        connection.execute("DELETE FROM seal WHERE hash NOT IN (SELECT hash FROM cache)")


_ENTRIES = "SELECT hash, env_fingerprint, bitcode, opt_bc, opt_ir, obj FROM cache"
_NEW_ENTRIES = _ENTRIES + (
    " WHERE (hash, env_fingerprint) NOT IN (SELECT hash, env_fingerprint FROM seal)"
)


def _checksums(connection: sqlite3.Connection, query: str) -> Iterator[tuple[tuple[int, str], int]]:
    for key, fingerprint, *blobs in connection.execute(query):
        checksum = 0
        for blob in blobs:
            checksum = zlib.crc32(blob, checksum)
        yield (key, fingerprint), checksum


@contextmanager
def _databases(folder: Path) -> Iterator[sqlite3.Connection | None]:
    """The database of heyoka with the seals attached, in one transaction.

    None if there is none, or it was written by a heyoka whose tables we do not know.
    """
    if not (folder / DATABASE).exists():
        yield None
        return
    connection = sqlite3.connect(folder / DATABASE, timeout=10.0)
    try:
        if not _has_known_tables(connection):
            yield None
            return
        connection.execute("ATTACH ? AS seals", (str(folder / SEALS),))
        connection.execute(
            "CREATE TABLE IF NOT EXISTS seals.seal (hash INTEGER, env_fingerprint TEXT,"
            " checksum INTEGER, PRIMARY KEY (hash, env_fingerprint))"
        )
        with connection:
            yield connection
    finally:
        connection.close()


def _has_known_tables(connection: sqlite3.Connection) -> bool:
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if not {"cache", "config"} <= tables:
        return False
    query = "SELECT 1 FROM config WHERE key = 'schema_version' AND value = ?"
    return connection.execute(query, (_SCHEMA_VERSION,)).fetchone() is not None
