"""Functions of NumPy, SciPy, JAX and CasADi on arrays of slots, where the library's own cannot take them.

Arrays that hold slots are NumPy's arrays of objects, so most of NumPy acts on them as it is. What does not,
and what other libraries call otherwise, is here.
"""

from __future__ import annotations

import functools
import importlib
import math
from collections.abc import Callable, Iterator, Mapping, ValuesView
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from deltac.repair.tracing.tape import (
    ELEMENTARY,
    NUMBER_TYPES,
    Operation,
    Slot,
    Solve,
    TapeRow,
)


class NotUnderstood(Exception):
    """A call that cannot be put on a tape."""


@dataclass(frozen=True)
class Foreign:
    """A module that is not imported, or something of it, by its dotted name: to be passed on, not called."""

    name: str

    def __getattr__(self, name: str) -> Foreign:
        if name.startswith("__"):
            raise AttributeError(name)
        return Foreign(f"{self.name}.{name}")

    def __getitem__(self, index: Any) -> Foreign:
        return self

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Refused."""
        raise NotUnderstood(f"calls {self.name}, which is not understood")


class Library:
    """A library that need not be installed: its functions are NumPy's, or those of this module."""

    def __init__(self, name: str) -> None:
        self.__name = name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        inner = f"{self.__name}.{name}"
        if inner in NUMPY_LIKE:
            return Library(inner)
        sources = (REPLACEMENTS.get(name), getattr(np, name, None), getattr(np.linalg, name, None))
        return next(
            (f for f in sources if f is not None), None if name == "newaxis" else Foreign(inner)
        )


NUMPY_LIKE = {
    "jax", "jax.numpy", "jax.numpy.linalg", "autograd", "autograd.numpy", "autograd.numpy.linalg",
}  # fmt: skip
"""Libraries whose functions of NumPy's names do what NumPy's do."""

IMPORTED = {
    "numpy", "scipy", "math", "cmath", "itertools", "functools", "operator", "collections", "copy", "types",
    "typing", "typing_extensions", "dataclasses", "enum", "abc", "numbers", "json", "tomllib", "contextlib",
    "fractions", "string", "re", "textwrap", "__future__", "attr", "attrs",
}  # fmt: skip
"""Packages that are imported; others are the user's own, or `Foreign`."""

CALLED = IMPORTED | {"builtins", "_operator", "_collections", "_functools", "deltac"}
"""Packages whose functions may be called: they change nothing but their arguments."""

FORBIDDEN = {
    "open", "exec", "eval", "compile", "input", "breakpoint", "exit", "quit", "__import__", "help",
    "globals", "memoryview",
}  # fmt: skip
"""Names of Python's own that are `Foreign`."""

FILES = {
    "save", "savez", "savez_compressed", "savetxt", "load", "loadtxt", "genfromtxt", "fromfile", "memmap",
    "fromregex", "tofile", "dump", "loadmat", "savemat", "import_module", "f2py",
}  # fmt: skip
"""Functions of those packages that read or write files, and are not called."""


class LibraryNumber(float):
    """A number that a library made: no constant of the user's."""


def library(name: str) -> Any:
    """A library by its dotted name, to be used as the module; None for what is none."""
    if name in NUMPY_LIKE:
        return Library(name)
    root = name.partition(".")[0]
    if root in IMPORTED:
        return importlib.import_module(name)
    return None


def known(function: Any) -> Callable[..., Any] | None:
    """How a function of a library acts on slots; None for what is no library's, or acts on them as it is."""
    module = getattr(function, "__module__", None) or type(function).__module__
    name = getattr(function, "__name__", "")
    own = getattr(function, "__self__", None)
    if name in FILES or not isinstance(module, str) or ".random" in module:
        return None
    if isinstance(own, np.ndarray):
        return functools.partial(METHODS[name], own) if name in METHODS else _numbers(function)
    if isinstance(own, np.ufunc):
        return functools.partial(_ufunc, own, name)
    root = module.partition(".")[0]
    if isinstance(function, np.ufunc):
        root = "numpy"
    if root == "builtins" and isinstance(own, type(None) | type(math)):
        return {"min": least("minimum"), "max": least("maximum")}.get(name)
    if root not in ("numpy", "math", "cmath", "scipy"):
        return None
    return REPLACEMENTS.get(name) or (_numbers(function) if root == "numpy" else None)


def tape_of(values: Any) -> Any:
    """The tape of the first slot among some values; None if there is none."""
    return next((x.tape for x in flatten(values) if isinstance(x, Slot)), None)


@dataclass(frozen=True)
class Elementary:
    """An elementary function: by its name, so that it can be exchanged for another."""

    name: str

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Apply it to every entry."""
        operation = ELEMENTARY[self.name]
        if self.name == "hypot" and len(arguments) > 2:
            return norm(list(arguments))
        if len(arguments) != getattr(operation, "nin", len(arguments)) or named.keys() - {"dtype"}:
            raise NotUnderstood(f"calls {self.name} with arguments that are not understood")
        return applied(operation, *arguments)


def applied(operation: Operation, *arguments: Any) -> Any:
    """An operation on numbers, or on the entries of arrays."""
    values = [arrayed(a) for a in arguments]

    def one(*entries: Any) -> Any:
        tape = next((x.tape for x in entries if isinstance(x, Slot)), None)
        if tape is not None:
            return tape.record(operation, *entries)
        if not all(isinstance(x, NUMBER_TYPES) for x in entries):
            raise NotUnderstood(f"arithmetic with {type(entries[0]).__name__}")
        return operation(*entries)

    if not any(isinstance(a, np.ndarray) for a in values):
        return one(*values)
    apply: Any = np.frompyfunc(one, len(values), 1)
    return apply(*values)


def _ufunc(function: np.ufunc, name: str, *arguments: Any, **named: Any) -> Any:
    """np.subtract.outer and its like."""
    own = REPLACEMENTS.get(function.__name__)
    if name != "outer" or not isinstance(own, Elementary):
        raise NotUnderstood(f"calls {function.__name__}.{name}")
    a, b = (np.asarray(arrayed(x), dtype=object) for x in arguments)
    return own(a.reshape(a.shape + (1,) * b.ndim), b.reshape((1,) * a.ndim + b.shape))


def _made(fill: Any, like: bool = False) -> Callable[..., Any]:
    """np.zeros and its like, with entries that can hold slots."""

    def make(shape: Any = None, *more: Any, fill_value: Any = None, **named: Any) -> Any:
        array = np.empty(np.shape(arrayed(shape)) if like else plain(shape), dtype=object)
        value = fill_value if fill_value is not None else more[0] if more else 0.0
        array[...] = arrayed(value) if fill is None else fill
        return array

    return make


def eye(rows: Any, columns: Any = None, k: Any = 0, **named: Any) -> Any:
    """The identity."""
    n = plain(rows)
    m = plain(columns) if isinstance(columns, int | Slot) else n
    return entries(np.eye(n, m, k=plain(k)))


def array(value: Any, *more: Any, copy: Any = True, ndmin: int = 0, **named: Any) -> Any:
    """np.array."""
    many = isinstance(value, Iterator | ValuesView | map | zip)
    entries = arrayed(list(value) if many else value, copy=copy is not False)
    if not isinstance(entries, np.ndarray) or ndmin > entries.ndim:
        entries = np.array(entries, dtype=object, ndmin=int(plain(ndmin))) if ndmin else entries
    return entries


def same_array(value: Any, *more: Any, **named: Any) -> Any:
    """np.asarray: an array stays what it is."""
    return array(value, copy=False)


def block(parts: Any) -> Any:
    """np.block, whose own check of depths wants lists."""

    def joined(rows: Any, depth: int) -> Any:
        if not isinstance(rows, list | tuple):
            return np.atleast_2d(arrayed(rows)) if depth else np.atleast_1d(arrayed(rows))
        parts = [joined(row, depth) for row in rows]
        nested = any(isinstance(row, list | tuple) for row in rows)
        return np.concatenate(parts, axis=-2 if nested else -1)

    return joined(parts, int(any(isinstance(row, list | tuple) for row in parts)))


def einsum(sums: Any, *operands: Any, **named: Any) -> Any:
    """np.einsum."""
    return np.einsum(sums, *map(arrayed, operands))


def solve(A: Any, b: Any, *more: Any, **named: Any) -> Any:
    """The solution of A x = b; b may have columns."""
    A, b = arrayed(A), arrayed(b)
    rows = np.shape(A)[0]
    if A.shape != (rows, rows) or np.shape(b)[:1] != (rows,):
        raise NotUnderstood(f"a matrix of shape {A.shape} and a right side of shape {np.shape(b)}")
    if b.ndim == 2:
        return np.stack([solve(A, b[:, k]) for k in range(b.shape[1])], axis=1)
    tape = tape_of([A, b])
    if tape is None:
        return np.linalg.solve(A.astype(float), b.astype(float)).astype(object)
    whole = tape.record(Solve(rows), *A.ravel(), *b)
    return objects([tape.record(TapeRow(k), whole) for k in range(rows)])


def inverse_of(value: Any) -> np.ndarray[Any, Any] | None:
    """The matrix that an array of slots is the inverse of, if it is one: M⁻¹ f is better solved for."""
    n = len(value) if isinstance(value, np.ndarray) and value.ndim == 2 else 0
    if not n or value.shape != (n, n) or not all(isinstance(x, Slot) for x in value.flat):
        return None
    tape = value.flat[0].tape
    wholes = [tape.whole([x.index for x in column]) for column in value.T]
    if any(whole is None or tape.operations[whole] != Solve(n) for whole in wholes):
        return None
    systems = [tape.inputs[whole] for whole in wholes]
    right = [[tape.exact[k] for k in system[n * n :]] for system in systems]
    if len({system[: n * n] for system in systems}) > 1 or right != np.eye(n).tolist():
        return None
    return objects([Slot(tape, k) for k in systems[0][: n * n]]).reshape(n, n)


def product(A: Any, B: Any) -> Any:
    """A @ B, M⁻¹ f as the solution of M x = f."""
    A, B = arrayed(A), arrayed(B)
    inverted = inverse_of(A) if isinstance(B, np.ndarray) and B.ndim <= 2 else None
    return A @ B if inverted is None else solve(inverted, B)


def dot(a: Any, b: Any, **named: Any) -> Any:
    """np.dot, of numbers too."""
    a, b = arrayed(a), arrayed(b)
    return product(a, b) if np.ndim(a) and np.ndim(b) else a * b


def inverse(A: Any, **named: Any) -> Any:
    """A⁻¹, as the solution of A x = e for each unit vector e."""
    A = arrayed(A)
    if np.ndim(A) != 2 or A.shape[0] != A.shape[1]:
        raise NotUnderstood(f"a matrix of shape {np.shape(A)}")
    return solve(A, np.eye(A.shape[0]).astype(object))


def least_squares(A: Any, b: Any, **named: Any) -> Any:
    """np.linalg.lstsq, of full rank."""
    A, b = arrayed(A), arrayed(b)
    square = A.shape[0] == A.shape[1]
    return solve(*((A, b) if square else (A.T @ A, A.T @ b))), None, A.shape[1], None


def determinant(A: Any) -> Any:
    """By the first row."""
    A = arrayed(A)
    if A.shape == (1, 1):
        return A[0, 0]
    total: Any = 0.0
    for k in range(A.shape[0]):
        minor = np.delete(np.delete(A, 0, axis=0), k, axis=1)
        total = total + (-1) ** k * A[0, k] * determinant(minor)
    return total


def norm(x: Any, order: Any = None, axis: Any = None, **named: Any) -> Any:
    """The Euclidean norm, of rows or columns with `axis`."""
    value = arrayed(x)
    if axis is not None:
        return applied(np.sqrt, (value * value).sum(axis=plain(axis)))
    first, *rest = flatten(value)
    return applied(np.sqrt, sum((e * e for e in rest), start=first * first))


def least(pick: str) -> Callable[..., Any]:
    """The least, or greatest, of numbers or of an array's entries."""

    def call(*arguments: Any, default: Any = None, key: Any = None, **named: Any) -> Any:
        python: Callable[..., Any] = max if pick == "maximum" else min
        entries = list(
            arguments[0] if isinstance(arguments[0], Iterator) else flatten(arguments[0])
        )
        entries = entries if len(arguments) == 1 else list(arguments)
        if key is not None or not any(isinstance(e, Slot) for e in entries):
            return python(entries) if key is None else python(entries, key=key)
        return functools.reduce(lambda a, b: applied(ELEMENTARY[pick], a, b), entries)

    return call


def clip(
    x: Any, a_min: Any = None, a_max: Any = None, *, min: Any = None, max: Any = None, **named: Any
) -> Any:
    """np.clip, with the names of its bounds in NumPy and in JAX."""
    low, high = (a_min if min is None else min), (a_max if max is None else max)
    above = x if low is None else applied(np.maximum, x, low)
    return above if high is None else applied(np.minimum, above, high)


def number(value: Any = 0.0) -> Any:
    """float(x): a slot stays one."""
    return value.item() if isinstance(value, np.ndarray) else value


def _numbers(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of NumPy's that acts on arrays of slots: lists are arrays, whole numbers axes and sizes."""

    def call(*arguments: Any, **named: Any) -> Any:
        keywords = {
            k: plain(v) for k, v in named.items() if k not in ("dtype", "order", "optimize")
        }
        return function(*(_sequence(_whole(a)) for a in arguments), **keywords)

    return call


def _whole(value: Any) -> Any:
    """A whole number of the source as Python's own; everything else as it is."""
    counts = isinstance(value, Slot) and isinstance(value.tape.exact[value.index], int)
    return plain(value) if counts else value


def _sequence(value: Any) -> Any:
    """An array; arrays of different shapes as a list of them: np.concatenate joins them."""
    if isinstance(value, list | tuple):
        parts = [arrayed(part) for part in value]
        arrays = [part for part in parts if isinstance(part, np.ndarray)]
        if len({part.shape for part in arrays}) > 1:
            return parts
    return arrayed(value)


REPLACEMENTS: dict[str, Callable[..., Any]] = {
    **{name: Elementary(name) for name in ELEMENTARY},
    **{
        f"{name}{like}": _made(fill, bool(like))
        for name, fill in (
            ("zeros", LibraryNumber(0.0)), ("ones", LibraryNumber(1.0)),
            ("empty", LibraryNumber(0.0)), ("full", None),
        )
        for like in ("", "_like")
    },
    "arange": lambda *ends, **named: np.arange(*map(plain, ends)),
    "eye": eye, "identity": eye, "array": array, "copy": array, "fromiter": array, "asarray": same_array,
    "asanyarray": same_array, "ascontiguousarray": same_array, "block": block, "einsum": einsum, "dot": dot,
    "matmul": dot, "solve": solve, "inv": inverse, "pinv": inverse, "lstsq": least_squares,
    "cho_factor": lambda A, *a, **named: (arrayed(A), True),
    "lu_factor": lambda A, *a, **named: (arrayed(A), None),
    "cho_solve": lambda factors, b, **named: solve(factors[0], b),
    "lu_solve": lambda factors, b, **named: solve(factors[0], b),
    "norm": norm, "det": determinant,
    "clip": clip, "max": least("maximum"), "min": least("minimum"), "amax": least("maximum"),
    "amin": least("minimum"), "all": lambda x, **named: all(bool(e) for e in flatten(x)),
    "any": lambda x, **named: any(bool(e) for e in flatten(x)), "fsum": sum,
    "isfinite": lambda x: True, "isnan": lambda x: False, "isclose": lambda a, b, **named: a == b,
    "dist": lambda a, b: norm(arrayed(a) - arrayed(b)), "reciprocal": lambda x, **named: 1.0 / arrayed(x),
    "float64": number, "float32": number, "double": number, "longdouble": number, "float16": number,
    "int64": lambda x: int(x), "int32": lambda x: int(x), "intp": lambda x: int(x),
    "fill_diagonal": np.fill_diagonal,
}  # fmt: skip
"""What takes the place of a library's function of this name."""


METHODS: Mapping[str, Callable[..., Any]] = {
    "astype": lambda a, *arguments, **named: a.copy(),
    "dot": dot,
    "max": lambda a, **named: least("maximum")(a),
    "min": lambda a, **named: least("minimum")(a),
    "fill": lambda a, value: a.fill(value),
    "clip": clip,
    "conj": lambda a: a,
}  # fmt: skip
"""Methods of arrays that the array of objects has not."""


class _Numeric(type):
    """Makes slots pass for numbers of a type of Python's, and lets the type's call keep them."""

    python: ClassVar[type]

    def __instancecheck__(cls, value: Any) -> bool:
        return isinstance(value, cls.python | Slot)


class Float(float, metaclass=_Numeric):
    """The float that traced code sees: float(x) of a slot is the slot."""

    python = float

    def __new__(cls, value: Any = 0.0) -> Any:
        """The number; a text is read."""
        return float(value) if isinstance(value, str | bytes) else number(value)


class Int(int, metaclass=_Numeric):
    """The int that traced code sees."""

    python = int

    def __new__(cls, *value: Any) -> Any:
        """The whole number."""
        return int(*map(plain, value))


def entries(value: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """An array of numbers that a library made as one that can hold slots."""
    return np.frompyfunc(LibraryNumber, 1, 1)(value) if value.size else value.astype(object)


def objects(entries: list[Any]) -> np.ndarray[Any, Any]:
    """A NumPy array of objects of one dimension."""
    array = np.empty(len(entries), dtype=object)
    for k, entry in enumerate(entries):
        array[k] = entry
    return array


def flatten(value: Any) -> Iterator[Any]:
    """All numbers in nested sequences and arrays, in order."""
    if isinstance(value, np.ndarray):
        for part in value.flat:
            yield from flatten(part) if isinstance(part, np.ndarray | list | tuple) else (part,)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from flatten(part)
    elif value is None:
        raise TypeError("it returns nothing")
    else:
        yield value


def arrayed(value: Any, copy: bool = False) -> Any:
    """Lists and tuples of numbers as arrays of objects; everything else as it is."""
    if isinstance(value, np.ndarray):
        array = entries(value) if value.dtype.kind == "f" else value
        return array.copy() if copy and array is value else array
    if isinstance(value, list | tuple | range):
        parts = [arrayed(part) for part in value]
        if any(isinstance(part, str | slice) or part is Ellipsis or part is None for part in parts):
            return value
        shapes = {np.shape(p) if isinstance(p, np.ndarray) else () for p in parts}
        if len(shapes) > 1:
            raise TypeError("an array of rows of different length")
        shape = shapes.pop() if shapes else ()
        array = np.empty((len(parts), *shape), dtype=object)
        for k, part in enumerate(parts):
            array[k] = part
        return array
    return value


def plain(value: Any) -> Any:
    """Sizes, indices and axes as Python numbers."""
    if isinstance(value, Slot):
        return value.exact()
    if isinstance(value, tuple):
        return tuple(plain(part) for part in value)
    if isinstance(value, list):
        return [plain(part) for part in value]
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray) and value.dtype == object:
        numbers = np.array([plain(x) for x in value.flat])
        return numbers.reshape(value.shape) if value.size else value.astype(int)
    return value
