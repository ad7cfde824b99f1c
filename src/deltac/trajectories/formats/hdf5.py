"""HDF5 logs by h5py (the extra ``hdf5``).

deltac's own have the arrays of `to_arrays` and the header as the text dataset ``deltac``. In other
programs' files each dataset is a column named by its path, ``group/dataset``, the fields of a table
are columns of their own, and an attribute ``units`` (or ``unit``) is taken at its word; attributes that are
numbers may say the time between rows. What lies
in other files (external links and storage, virtual datasets) is not followed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from deltac.errors import LogError, requirement, shown
from deltac.foreign.files import opened
from deltac.foreign.isolation import apart
from deltac.foreign.limits import Limits
from deltac.trajectories.formats.raw import (
    Budget,
    Collector,
    RawLog,
    damage_named,
    from_arrays,
    is_label,
    is_unit,
    parse_header,
    to_arrays,
)
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


@apart
def read_hdf5(path: Path) -> RawLog:
    """The arrays of deltac's own logs, or every dataset of another program's file."""
    with opened_hdf5(path) as log:
        members = dict(log.members(log.root))
        if "deltac" in members:
            header = parse_header(log.text(members["deltac"])) or {}
            arrays = {
                name: log.values(item)
                for name, item in members.items()
                if getattr(item, "shape", None) and item.dtype.kind in "iuf"
            }
            return from_arrays(arrays, header)
        collector = Collector()
        units: dict[str, str] = {}
        collector.add_all(dict(_gather(collector, units, log, log.root, "", 0)), units)
        return collector.log()


@apart
def read_arrays(path: Path, parts: Mapping[str, slice] | None = None) -> dict[str, Any]:
    """The datasets of numbers at the top of a file, as they are; "deltac" is there in deltac's own files.

    Texts that say their units and the names of their columns are there as well. Of those arrays that `parts`
    names only that part of their second axis, which is then all that is in memory.
    """
    slices = parts or {}
    with opened_hdf5(path) as log:
        members = dict(log.members(log.root))
        arrays = {k: v for k, v in log.root.attrs.items() if is_label(k) or is_unit(k)}
        for name, item in members.items():
            if getattr(item, "shape", None) is None:
                continue
            kind, describes = item.dtype.kind, is_label(name) or is_unit(name)
            if name == "deltac" or (item.shape and kind in "iuf"):
                arrays[name] = log.values(item, slices.get(name))
                arrays |= {
                    f"{name}/{k.lower()}": v
                    for k, v in item.attrs.items()
                    if is_label(k) or is_unit(k)
                }
            elif describes and kind in "OS" and not log.refers(item):
                arrays[name] = log.values(item)
        return arrays


@apart
def read_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """The shapes of the datasets at the top of a file by name, without their values."""
    with opened_hdf5(path) as log:
        return {
            name: tuple(item.shape)
            for name, item in log.members(log.root)
            if getattr(item, "shape", None) is not None
        }


def _gather(
    collector: Collector, units: dict[str, str], log: Opened, group: Any, prefix: str, depth: int
) -> Iterator[tuple[str, Any]]:
    """Names and values of datasets, and of attributes that name columns; their `units` are put down."""
    log.check_depth(depth)
    for key, value in group.attrs.items():
        if isinstance(value, np.number | int | float):
            collector.scalars[f"{prefix}{key}"] = float(value)
        elif is_label(key) or is_unit(f"{prefix}{key}"):
            yield f"{prefix}{key}", value
    for key, item in log.members(group):
        name = prefix + key
        if not hasattr(item, "shape"):
            yield from _gather(collector, units, log, item, f"{name}/", depth + 1)
            continue
        unit = next((v for k, v in item.attrs.items() if k.lower() in ("unit", "units")), None)
        text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
        declared = {name: text} if isinstance(text, str) else {}
        if item.shape is None:
            collector.skip(name, "is empty")
        elif item.dtype.names:
            table = log.values(item)
            for field in item.dtype.names:
                units |= {f"{name}/{field}": text for text in declared.values()}
                yield f"{name}/{field}", table[field]
        elif item.dtype.kind in "iufb" or (
            item.dtype.kind in "OS" and (is_label(name) or is_unit(name)) and not log.refers(item)
        ):
            units |= declared
            yield name, log.values(item)
            yield from ((f"{name}/{k}", v) for k, v in item.attrs.items() if is_label(k))
            if not declared and unit is not None:  # one for each column
                yield f"{name}/units", unit
        else:
            collector.skip(name, f"holds values of type {item.dtype}, not numbers")


@dataclass(frozen=True)
class Opened:
    """An open HDF5 file, of which no more is read than the limits allow."""

    root: Any
    budget: Budget
    count: list[int]  # of the members that were seen, on all paths

    def members(self, group: Any) -> Iterator[tuple[str, Any]]:
        """Names and values of what lies in a group itself; links to elsewhere are passed over."""
        h5py = import_h5py()
        self.count[0] += len(group)
        Limits.current().check("columns", self.count[0], "the file holds")
        for name in group:
            if isinstance(group.get(name, getlink=True), h5py.HardLink):
                yield name, group[name]

    def values(self, item: Any, part: slice | None = None) -> Any:
        """The values of a dataset, or a part of its second axis.

        InputError when there are too many, or they lie in other files.
        """
        if item.external or item.is_virtual:
            raise LogError(f"{shown(item.name)} is stored in other files, which are not read")
        share = 1.0 if part is None else len(range(item.shape[1])[part]) / max(1, item.shape[1])
        self.budget.take(int(share * item.size) * max(item.dtype.itemsize, 8))
        return item[()] if part is None else item[:, part]

    def text(self, item: Any) -> str:
        """The text of a dataset that holds one."""
        if getattr(item, "shape", None) != () or item.dtype.kind not in "OS":
            raise LogError("the deltac metadata are not text; write the log again")
        if item.external or item.is_virtual:
            raise LogError("the deltac metadata are stored in another file, which is not read")
        return str(item.asstr()[()])

    def refers(self, item: Any) -> bool:
        """Whether a dataset holds references to other objects of the file."""
        h5py = import_h5py()
        return h5py.check_dtype(ref=item.dtype) is h5py.Reference

    def references(self, item: Any) -> Any:
        """The references of a dataset."""
        Limits.current().check("columns", int(item.size), f"{shown(item.name)} refers to")
        return self.values(item)

    def target(self, reference: Any) -> Any:
        """What a reference points to."""
        self.count[0] += 1
        Limits.current().check("columns", self.count[0], "the file holds")
        return self.root[reference]

    def check_depth(self, depth: int) -> None:
        """InputError for groups in groups, deeper than the limit: they may contain themselves."""
        if depth > (limits := Limits.current()).nesting:
            limits.refuse("nesting", f"its groups are nested {depth} levels deep")


def import_h5py() -> Any:
    """h5py, or an InputError that says how to get it."""
    with requirement(
        'HDF5 and MATLAB 7.3 files need h5py: pip install "deltac[hdf5]" (or use Parquet)'
    ):
        import h5py
    return h5py


@contextmanager
def opened_hdf5(path: Path) -> Iterator[Opened]:
    """An open HDF5 file; what h5py raises for a damaged one becomes an InputError."""
    h5py = import_h5py()
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        with damage_named("HDF5"), h5py.File(path, "r") as log:
            yield Opened(log, Budget(size), [0])
