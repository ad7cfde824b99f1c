"""MATLAB files of versions 4 to 7, parsed element by element: *MAT-File Format*, MathWorks.

Nothing is believed: a size is compared with the bytes that are there before anything is reserved, compressed
variables are unpacked only as far as the limits go, and structures are read to a bounded depth.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from deltac.errors import FileError
from deltac.limits import Limits
from deltac.trajectories.formats.raw import Budget

_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_TEXTS = {16: "utf-8", 17: "utf-16", 18: "utf-32"}
_LARGEST = 2**60
"""Elements beyond which NumPy makes no array, not even an empty one."""

_CLASSES = {
    6: "f8",
    7: "f4",
    8: "i1",
    9: "u1",
    10: "i2",
    11: "u2",
    12: "i4",
    13: "u4",
    14: "i8",
    15: "u8",
}
_VERSION_4 = ("f8", "f4", "i4", "i2", "u2", "u1")


@dataclass(frozen=True)
class MatlabObject:
    """An object of a MATLAB class, of which only the class is known."""

    kind: str


def variables(content: bytes) -> Iterator[tuple[str, Any]]:
    """The variables of a file: arrays, texts, dictionaries (structures), lists (cells), objects.

    Raises InputError for what is not as the format says, or beyond the limits.
    """
    if len(content) < 4:
        _damaged("it ends within its header")
    budget = Budget(len(content))
    if 0 in content[:4]:
        yield from _version_4(content, budget)
        return
    mark = content[126:128]
    if mark not in (b"IM", b"MI"):
        _damaged("the mark of the byte order is missing")
    order = "<" if mark == b"IM" else ">"
    file = _Elements(memoryview(content)[128:], order, budget)
    while file.rest():
        kind, data = file.element()
        if kind == _COMPRESSED:
            kind, data = _unpacked(data, order, budget)
        if kind == _MATRIX and len(data):
            name, value = _Elements(data, order, budget).matrix()
            if name:  # the nameless one is what MATLAB keeps of its objects
                yield name, value


def _unpacked(data: memoryview, order: str, budget: Budget) -> tuple[int, memoryview]:
    """The element that a compressed one holds; its tag says how large it is."""
    try:
        stream = zlib.decompressobj()
        tag = stream.decompress(data, 8)
        if len(tag) < 8:
            _damaged("a compressed variable is cut off")
        kind, size = struct.unpack(f"{order}II", tag)
        budget.take(size)
        content = stream.decompress(stream.unconsumed_tail, max(size, 1))
    except zlib.error as error:
        _damaged(f"a compressed variable is ({error})")
    if len(content) < size:
        _damaged("a compressed variable is cut off")
    return kind, memoryview(content)[:size]


class _Elements:
    """Reads the elements in a piece of a file one after the other."""

    def __init__(self, data: memoryview, order: str, budget: Budget, depth: int = 0) -> None:
        self.data, self.order, self.budget, self.depth, self.at = data, order, budget, depth, 0
        if depth > (limits := Limits.current()).nesting:
            limits.refuse("nesting", f"its structures are nested {depth} levels deep")

    def rest(self) -> int:
        return len(self.data) - self.at

    def element(self) -> tuple[int, memoryview]:
        """The kind and the content of the next element."""
        if self.rest() < 8:
            _damaged("it ends within the tag of an element")
        kind, size = struct.unpack_from(f"{self.order}II", self.data, self.at)
        if kind >> 16:  # a small element: its size beside the kind, its content in the tag
            kind, size, first = kind & 0xFFFF, kind >> 16, self.at + 4
            if size > 4:
                _damaged("a small element is larger than its tag")
            self.at += 8
        else:
            first = self.at + 8
            if size > self.rest() - 8:
                _damaged(f"an element announces {size} bytes, and {self.rest() - 8} are left")
            padding = 0 if kind == _COMPRESSED else -size % 8
            self.at = min(first + size + padding, len(self.data))
        return kind, self.data[first : first + size]

    def numbers(self) -> Any:
        kind, data = self.element()
        if kind not in _NUMBERS and len(data):
            _damaged(f"numbers are stored as kind {kind}, which there is not")
        dtype = np.dtype(self.order + _NUMBERS.get(kind, "u1"))
        if len(data) % dtype.itemsize:
            _damaged("an element ends within a number")
        return np.frombuffer(data, dtype)

    def text(self) -> str:
        return bytes(self.element()[1]).decode("utf-8", "replace")

    def matrix(self) -> tuple[str, Any]:
        """The name and the value of an array, at the start of its content."""
        flags = self.numbers()
        if not len(flags):
            _damaged("an array has no flags")
        kind, complex_ = int(flags[0]) & 0xFF, bool(int(flags[0]) & 0x800)
        if kind == _OPAQUE:
            name, _, found = self.text(), self.text(), self.text()
            return name, MatlabObject(found)
        sizes = self.numbers()
        if not np.isfinite(sizes).all():
            _damaged("an array has a size that is no number")
        shape = tuple(map(int, sizes))
        # An empty array may claim sizes whose product with the others would be beyond all memory.
        if (
            not 1 < len(shape) <= 32
            or min(shape) < 0
            or math.prod(s or 1 for s in shape) > _LARGEST
        ):
            _damaged(f"an array has the shape {shape[:32]}")
        name = self.text()
        return name, self.value(kind, shape, complex_)

    def value(self, kind: int, shape: tuple[int, ...], complex_: bool) -> Any:
        count = math.prod(shape)
        if kind in _CLASSES:
            values = self.part(count, _CLASSES[kind])
            if complex_:
                values = values.astype(np.complex128)
                values.imag = self.part(count, _CLASSES[kind])
            return values.reshape(shape, order="F")
        if kind == _CHAR:
            return self.characters(shape)
        if kind == _CELL:
            cells = self.children(count)
            return cells[0] if count == 1 else cells
        if kind == _SPARSE:
            return self.sparse(shape)
        if kind == _FUNCTION:
            return MatlabObject("function_handle")
        if kind == _OBJECT:
            return MatlabObject(self.text())
        if kind == _STRUCT:
            return self.structure(count)
        _damaged(f"an array is of class {kind}, which there is not")

    def part(self, count: int, dtype: str) -> Any:
        """`count` numbers of a class, however they are stored."""
        values = self.numbers()
        if len(values) != count:
            _damaged(f"an array announces {count} numbers and has {len(values)}")
        self.budget.take(count * 8)
        with np.errstate(invalid="ignore", over="ignore"):
            return values.astype(dtype)

    def characters(self, shape: tuple[int, ...]) -> str:
        kind, data = self.element()
        if kind in _TEXTS:
            order = "" if kind == 16 else "-le" if self.order == "<" else "-be"
            return bytes(data).decode(_TEXTS[kind] + order, "replace")
        if kind not in _NUMBERS:
            _damaged(f"a text is stored as kind {kind}, which there is not")
        dtype = np.dtype(self.order + _NUMBERS[kind])
        if len(data) != math.prod(shape) * dtype.itemsize:
            _damaged("a text is not as long as it announces")
        codes = np.frombuffer(data, dtype).reshape(shape, order="F").ravel()
        if dtype.kind == "f" or (codes < 0).any() or (codes > 0x10FFFF).any():
            _damaged("a text holds what is no character")
        return "".join(map(chr, codes.tolist()))

    def children(self, count: int) -> list[Any]:
        """The values of so many arrays, each an element."""
        if count * 8 > self.rest():
            _damaged(f"{count} arrays are announced, more than there is room for")
        found = []
        for _ in range(count):
            kind, data = self.element()
            if kind != _MATRIX:
                _damaged(f"an element of kind {kind} stands where an array is expected")
            inner = _Elements(data, self.order, self.budget, self.depth + 1)
            found.append(inner.matrix()[1] if len(data) else np.empty(0))
        return found

    def structure(self, count: int) -> Any:
        widths = self.numbers()
        width = int(widths[0]) if len(widths) == 1 else 0
        _, data = self.element()
        if width < 1 or len(data) % width:
            _damaged("the names of a structure's fields cannot be told apart")
        keys = [
            bytes(data[k : k + width]).split(b"\0", 1)[0].decode("utf-8", "replace")
            for k in range(0, len(data), width)
        ]
        if not keys:
            return {}
        values = self.children(count * len(keys))
        items = [
            dict(zip(keys, values[k : k + len(keys)], strict=True))
            for k in range(0, len(values), len(keys))
        ]
        return items[0] if count == 1 else items

    def sparse(self, shape: tuple[int, ...]) -> Any:
        """A sparse matrix, by columns, as the dense one."""
        rows, starts, values = self.numbers(), self.numbers(), self.numbers()
        if len(shape) != 2 or len(starts) != shape[1] + 1:
            _damaged("a sparse matrix has not one start for each column")
        return _dense(shape, rows.astype(np.int64), starts.astype(np.int64), values, self.budget)


def _dense(shape: tuple[int, ...], rows: Any, starts: Any, values: Any, budget: Budget) -> Any:
    lengths, count = np.diff(starts), int(starts[-1])
    if starts[0] != 0 or (lengths < 0).any() or count > min(len(rows), len(values)):
        _damaged("the columns of a sparse matrix are out of order")
    rows = rows[:count]
    if count and (rows.min() < 0 or rows.max() >= shape[0]):
        _damaged("a row of a sparse matrix lies outside of it")
    budget.take(math.prod(shape) * 8)
    dense = np.zeros(shape)
    dense[rows, np.repeat(np.arange(shape[1]), lengths)] = values[:count]
    return dense


def _version_4(content: bytes, budget: Budget) -> Iterator[tuple[str, Any]]:
    at = 0
    while at < len(content):
        if len(content) - at < 20:
            _damaged("it ends within the header of a variable")
        order = "<" if struct.unpack_from("<i", content, at)[0] in range(5000) else ">"
        kind, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", content, at)
        form, what = kind // 10 % 10, kind % 10
        if kind not in range(5000) or form >= len(_VERSION_4) or what > 2:
            _damaged("this is no MATLAB file, or the header of a variable is damaged")
        dtype = np.dtype(order + _VERSION_4[form])
        size = rows * columns * dtype.itemsize
        first = at + 20 + length
        if min(rows, columns, length) < 0 or first + size * (1 + bool(imaginary)) > len(content):
            _damaged("a variable is cut off")
        name = content[at + 20 : first].split(b"\0", 1)[0].decode("latin1")
        budget.take(rows * columns * 8)
        values = np.frombuffer(content, dtype, rows * columns, first)
        values = values.reshape((rows, columns), order="F")
        at = first + size * (1 + bool(imaginary))
        if imaginary:
            yield name, values.astype(np.complex128)
        elif what == 1:
            codes = values.ravel()
            if not ((codes >= 0) & (codes <= 0x10FFFF)).all():
                _damaged("a text holds what is no character")
            yield name, "".join(chr(int(code)) for code in codes)
        else:
            yield name, _triples(values, budget) if what == 2 else values


def _triples(values: Any, budget: Budget) -> Any:
    """A sparse matrix of version 4: rows of (row, column, value), counted from one; the last its size."""
    if values.shape[1] != 3 or not len(values) or not (np.abs(values[:, :2]) < 2**53).all():
        _damaged("a sparse matrix is not of rows, columns and real values")
    shape = (int(values[-1, 0]), int(values[-1, 1]))
    places = values[:-1, :2].astype(np.int64) - 1
    if min(shape) < 0 or (places < 0).any() or (places >= shape).any():
        _damaged("an entry of a sparse matrix lies outside of it")
    budget.take(math.prod(shape) * 8)
    dense = np.zeros(shape)
    dense[places[:, 0], places[:, 1]] = values[:-1, 2]
    return dense


def _damaged(problem: str) -> NoReturn:
    raise FileError(
        f"the MATLAB file is damaged, truncated, or no MATLAB file; save it again. At fault: {problem}"
    )
