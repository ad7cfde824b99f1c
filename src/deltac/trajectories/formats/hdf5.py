"""HDF5 logs by h5py (the extra ``hdf5``).

deltac's own have the arrays of `to_arrays` and the header as the text dataset ``deltac``. In other
programs' files each dataset is a column named by its path, ``group/dataset``, the fields of a table
are columns of their own, and an attribute ``units`` (or ``unit``) is taken at its word.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from deltac.errors import InputError
from deltac.trajectories.formats.raw import Collector, RawLog, from_arrays, parse_header, to_arrays
from deltac.trajectories.trajectory import Trajectory


def write_hdf5(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the arrays of `to_arrays`, with the names of their columns beside them."""
    h5py = import_h5py()
    with h5py.File(file, "w") as log:
        log["deltac"] = header  # a dataset: attributes end at 64 kB
        for key in ("coordinates", "speeds"):
            log.create_dataset(key, data=list(getattr(run, key)), dtype=h5py.string_dtype())
        log.create_dataset("channels", data=list(run.forces), dtype=h5py.string_dtype())
        for name, array in to_arrays(run).items():
            log[name] = array


def read_hdf5(path: Path) -> RawLog:
    """The arrays of deltac's own logs, or every dataset of another program's file."""
    with opened(path) as log:
        if "deltac" in log:
            header = parse_header(log["deltac"].asstr()[()]) or {}
            return from_arrays({name: item[()] for name, item in log.items()}, header)
        collector = Collector()
        log.visititems(lambda name, item: _add(collector, name, item))
        return collector.log()


def _add(collector: Collector, name: str, item: Any) -> None:
    if not hasattr(item, "shape"):
        return  # a group
    unit = next((item.attrs[k] for k in ("units", "unit") if k in item.attrs), None)
    text = unit.decode() if isinstance(unit, bytes) else unit if isinstance(unit, str) else None
    if item.shape is None:
        collector.skip(name, "is empty")
    elif item.dtype.names:
        for field in item.dtype.names:
            collector.add(f"{name}/{field}", item[field], text)
    else:
        collector.add(name, item[()], text)


def import_h5py() -> Any:
    """h5py, or an InputError that says how to get it."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            'HDF5 and MATLAB 7.3 files need h5py: pip install "deltac[hdf5]" (or use Parquet)'
        ) from error
    return h5py


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """An open HDF5 file; what h5py raises for a damaged one becomes an InputError."""
    h5py = import_h5py()
    try:
        with h5py.File(path, "r") as log:
            yield log
    except InputError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"the HDF5 file is damaged, truncated, or no HDF5 file; write it again. {error}"
        ) from error
