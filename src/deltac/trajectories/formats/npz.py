"""NumPy's NPZ and NPY: arrays by name, and deltac's header as the text array ``deltac``.

Archive and headers are taken apart here, not by `numpy.load`: what an array announces must be
what the archive holds of it, and both are looked at before anything is unpacked. Nothing is unpickled.
"""

from __future__ import annotations

import ast
import math
import os
import struct
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from deltac.errors import FileError, LogError, shown
from deltac.foreign.files import opened
from deltac.foreign.limits import Limits
from deltac.trajectories.formats.raw import (
    Budget,
    Collector,
    RawLog,
    damage_named,
    from_arrays,
    parse_header,
    to_arrays,
)
from deltac.trajectories.trajectory import Trajectory

T = TypeVar("T")

_NPY_MAGIC = b"\x93NUMPY"


def write_npz(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the arrays of `to_arrays`, uncompressed."""
    names = {key: np.array(getattr(run, key), dtype=str) for key in ("coordinates", "speeds")}
    arrays = {"deltac": np.array(header), **names, **to_arrays(run)}
    np.savez(file, allow_pickle=False, **arrays)


def read_npz(path: Path) -> RawLog:
    """The arrays of deltac's own logs, or each array of another program's as columns."""
    return _opened(path, _log)


def read_npy(path: Path) -> RawLog:
    """One array, a table with the times in its first column, or with named fields."""
    with opened(path) as file, damage_named("NPY"):
        size = os.fstat(file.fileno()).st_size
        collector = Collector()
        try:
            collector.add(
                "array", _values(file, size, f"the array {shown(path.name)}", Budget(size))
            )
        except TypeError as error:
            raise LogError(f"the array {error}") from None
    return collector.log()


def _opened(path: Path, read: Callable[[zipfile.ZipFile, int], T]) -> T:
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        if not zipfile.is_zipfile(file):
            raise FileError(
                "this is not an NPZ archive of named arrays, or it is damaged or truncated"
            )
        with damage_named("NPZ"):
            directory = _Directory(file)
            with zipfile.ZipFile(directory) as archive:
                directory.most = math.inf
                return read(archive, size)


def read_arrays(path: Path, parts: Mapping[str, slice] | None = None) -> dict[str, Any]:
    """The arrays of an archive by name, as they are; those of no numbers and no text are left out.

    Of those that `parts` names only that part of their second axis, which is then all that is in memory.
    """
    return _opened(path, lambda archive, size: _arrays(archive, size, Collector(), parts or {}))


def read_shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """The shapes of the arrays of an archive by name, from their headers alone."""

    def shapes(archive: zipfile.ZipFile, size: int) -> dict[str, tuple[int, ...]]:
        Limits.current().check("columns", len(archive.filelist), "the archive holds")
        shape_of = {}
        for info in archive.filelist:
            with archive.open(info) as stream:
                shape_of[info.filename.removesuffix(".npy")] = _header(stream, info.filename)[1]
        return shape_of

    return _opened(path, shapes)


def _arrays(
    archive: zipfile.ZipFile, size: int, collector: Collector, parts: Mapping[str, slice]
) -> dict[str, Any]:
    budget, arrays = Budget(size), {}
    Limits.current().check("columns", len(archive.filelist), "the archive holds")
    for info in archive.filelist:
        name = info.filename.removesuffix(".npy")
        try:
            arrays[name] = _array(archive, info, budget, parts.get(name))
        except TypeError as error:  # of values that are no numbers
            collector.skip(name, str(error))
    return arrays


def _log(archive: zipfile.ZipFile, size: int) -> RawLog:
    collector = Collector()
    arrays = _arrays(archive, size, collector, {})
    if "deltac" in arrays:
        header = arrays["deltac"]
        if header.dtype.kind != "U" or header.size != 1:
            raise LogError("the deltac metadata are not text; write the log again")
        return from_arrays(arrays, parse_header(str(header[()])) or {})
    collector.add_all(arrays)
    return collector.log()


_BLOCK = 2**24  # bytes that are unpacked at once where only a part of an array is wanted


def _array(
    archive: zipfile.ZipFile, info: zipfile.ZipInfo, budget: Budget, part: slice | None = None
) -> Any:
    """An array of numbers or texts, or a part of its second axis; TypeError says what else it holds."""
    what = f"the array {shown(info.filename)}"
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise LogError(f"{what} is compressed by a method that NumPy does not use")
    with archive.open(info) as stream:
        return _values(stream, info.file_size, what, budget, part)


def _values(stream: Any, size: int, what: str, budget: Budget, part: slice | None = None) -> Any:
    """The array that `size` bytes of a stream hold, or a part of its second axis."""
    dtype, shape, order, start = _header(stream, what)
    count = math.prod(shape) * dtype.itemsize
    if dtype.hasobject:
        raise TypeError("holds Python objects, not numbers")
    kinds = [dtype[name].kind for name in dtype.names] if dtype.names else [dtype.kind]
    if not set(kinds) <= set("biufSUmM"):
        raise TypeError(f"holds values of type {dtype}, not numbers")
    if start + count != size:
        raise FileError(
            f"{what} announces {shape} values of {dtype.itemsize} bytes, the file holds "
            f"{size - start} bytes of it: it is damaged"
        )
    if dtype.kind in "SU":
        Limits.current().check(
            "metadata", count // (4 if dtype.kind == "U" else 1), f"{what} is of"
        )

    def taken(size: int) -> bytes:
        content: bytes = stream.read(size)
        if len(content) != size:
            raise FileError(f"{what} is cut off: the file is damaged")
        return content

    if part is None or len(shape) < 2 or order != "C" or not count:
        budget.take(count)
        whole = np.frombuffer(taken(count), dtype).reshape(shape, order=order)
        return whole if part is None else whole[:, part]
    row = count // shape[0]
    part_of_rows = np.empty((shape[0], len(range(shape[1])[part]), *shape[2:]), dtype)
    budget.take(part_of_rows.nbytes + _BLOCK)
    at_once = max(1, _BLOCK // row)
    for first in range(0, shape[0], at_once):
        rows = min(at_once, shape[0] - first)
        block = np.frombuffer(taken(rows * row), dtype).reshape(rows, *shape[1:])
        part_of_rows[first : first + rows] = block[:, part]
    return part_of_rows


def _header(stream: Any, what: str) -> tuple[np.dtype[Any], tuple[int, ...], Any, int]:
    """The type, shape and order of an array, and where its values begin."""
    start = stream.read(8)
    if len(start) < 8 or start[:6] != _NPY_MAGIC or start[6] not in (1, 2, 3):
        raise FileError(f"{what} is not an array of NumPy's, or it is damaged")
    form = "<H" if start[6] == 1 else "<I"
    (length,) = struct.unpack(form, stream.read(struct.calcsize(form)))
    Limits.current().check("header", length, f"the header of {what} has")
    text = stream.read(length).decode("utf-8" if start[6] == 3 else "latin1")
    try:
        header = ast.literal_eval(text)
        descr, shape = header["descr"], header["shape"]
        dtype = np.dtype(descr if isinstance(descr, str) else [tuple(field) for field in descr])
        sizes = isinstance(shape, tuple) and len(shape) <= 32
        if not sizes or not all(type(n) is int and 0 <= n < 2**48 for n in shape):
            raise ValueError(f"shape {shown(shape)}")
        order = "F" if header["fortran_order"] is True else "C"
    except Exception as error:  # of Python's parser, or NumPy's
        raise FileError(f"{what} has a damaged header: {shown(text)} ({shown(error)})") from None
    return dtype, shape, order, 8 + struct.calcsize(form) + length


class _Directory:
    """A file of which no more than `most` bytes are read at once: those of an archive's directory."""

    def __init__(self, file: BinaryIO) -> None:
        self.file, self.most = file, float(Limits.current().header)

    def read(self, count: int = -1) -> bytes:
        if count > self.most:
            Limits.current().check("header", count, "the directory of the archive is of")
        return self.file.read(count)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)
