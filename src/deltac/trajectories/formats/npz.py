"""NumPy's NPZ: arrays by name, and deltac's header as the text array ``deltac``."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np

from deltac.errors import InputError
from deltac.trajectories.formats.raw import Collector, RawLog, from_arrays, parse_header, to_arrays
from deltac.trajectories.trajectory import Trajectory


def write_npz(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the arrays of `to_arrays`, uncompressed."""
    names = {key: np.array(getattr(run, key), dtype=str) for key in ("coordinates", "speeds")}
    arrays = {"deltac": np.array(header), **names, **to_arrays(run)}
    np.savez(file, allow_pickle=False, **arrays)


def read_npz(path: Path) -> RawLog:
    """The arrays of deltac's own logs, or each array of another program's as columns."""
    try:
        if not zipfile.is_zipfile(path):
            raise InputError(
                "this is no NPZ archive of named arrays, or it is damaged or truncated"
            )
        with np.load(path, allow_pickle=False) as archive:
            if "deltac" in archive:
                header = parse_header(str(archive["deltac"][()]))
                return from_arrays(archive, header or {})
            collector = Collector()
            for name in archive.files:
                try:
                    collector.add(name, archive[name])
                except ValueError:  # would need unpickling
                    collector.skip(name, "holds Python objects, not numbers")
            return collector.log()
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, KeyError) as error:
        raise InputError(
            f"the NPZ file is damaged or truncated; write it again. {error}"
        ) from error
