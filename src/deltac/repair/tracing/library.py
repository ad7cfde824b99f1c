"""What the user's function may call: arithmetic on numbers and arrays, and nothing with side effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from deltac.repair.tracing.tape import CONSTANTS, ELEMENTARY, Operation, Row, Slot, Solve, Tape

Call = Callable[[Tape, list[Any], dict[str, Any]], Any]


class NotUnderstood(Exception):
    """A call that cannot be put on a tape."""


@dataclass(frozen=True)
class Module:
    """One of NumPy, numpy.linalg, math."""

    name: str


@dataclass(frozen=True)
class Constants:
    """An object or mapping outside of the function whose numbers it reads."""

    owner: Any

    def __getitem__(self, key: Any) -> Any:
        return self.owner[key]


@dataclass(frozen=True)
class Elementary:
    """An elementary function: by its name, so that it can be exchanged for another."""

    name: str

    @property
    def operation(self) -> Operation:
        """On arrays (B,)."""
        return ELEMENTARY[self.name][0]

    def __call__(self, tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        """Apply it to every entry."""
        count = ELEMENTARY[self.name][1]
        if named or len(arguments) != count:
            raise NotUnderstood(f"expected {count} argument{'s' if count > 1 else ''}")
        arguments = [arrayed(a) for a in arguments]
        if not any(isinstance(a, np.ndarray) for a in arguments):
            return tape.record(self.operation, *arguments)
        apply = np.frompyfunc(lambda *a: tape.record(self.operation, *a), count, 1)
        return apply(*arguments)


def module(name: str) -> Module | None:
    """A module that may be imported."""
    return Module(name) if name in ("numpy", "numpy.linalg", "math") else None


def member(module_name: str, name: str) -> Any:
    """A function, constant or submodule of a module; None for what is not understood."""
    if module_name in ("numpy", "math"):
        if name in ELEMENTARY:
            return Elementary(name)
        if name in CONSTANTS:
            return float(CONSTANTS[name])
        if module_name == "math":
            return SPECIAL.get(name) if name in ("prod", "dist") else None
        if name == "linalg":
            return Module("numpy.linalg")
        if name in ("float64", "newaxis", "float32"):
            return {"newaxis": None}.get(name, BUILTINS["float"])
        if name in SPECIAL:
            return SPECIAL[name]
        return _structural(getattr(np, name)) if name in STRUCTURAL else None
    if module_name == "numpy.linalg":
        return {"solve": _solve, "inv": _inverse, "norm": _norm, "det": _determinant}.get(name)
    return None


def known(value: Any) -> Any:
    """A live value of a module or closure: what can be understood of it."""
    if isinstance(value, ModuleType):
        found = module(value.__name__)
        return value if found is None else found
    for owner in ("numpy", "math"):
        name = getattr(value, "__name__", None)
        if name and getattr(np if owner == "numpy" else math, name, None) is value:
            return member(owner, name)
    if isinstance(value, np.ndarray | list | tuple):
        return np.array(value, dtype=object) if isinstance(value, np.ndarray) else value
    if isinstance(value, str | bool) or value is None or callable(value):
        return value if not callable(value) else None
    return Constants(value)


def attribute(base: Any, name: str) -> Any:
    """An attribute of a module or of an array; None for what is not understood."""
    if isinstance(base, Module):
        return member(base.name, name)
    if isinstance(base, np.ndarray):
        if name in ("T", "shape", "size", "ndim"):
            return getattr(base, name)
        if name in METHODS:
            bound = getattr(base, name)
            return lambda tape, arguments, named: bound(
                *(plain(a) if name != "dot" else arrayed(a) for a in arguments), **_plain(named)
            )
    if isinstance(base, list) and name == "append":
        return None
    if isinstance(base, dict) and name in ("keys", "values", "items", "get"):
        bound = getattr(base, name)
        return lambda tape, arguments, named: bound(*arguments)
    return None


METHODS = ("dot", "sum", "copy", "reshape", "transpose", "ravel", "flatten", "prod", "trace")
STRUCTURAL = (
    "array asarray stack vstack hstack column_stack concatenate dot matmul cross outer inner diag "
    "block transpose trace sum prod cumsum vdot einsum flip roll tile squeeze ravel reshape "
    "zeros ones eye empty identity zeros_like ones_like empty_like atleast_1d tensordot kron"
).split()
MAKERS = "zeros ones eye empty identity zeros_like ones_like empty_like".split()


def _structural(function: Callable[..., Any]) -> Call:
    name = function.__name__

    def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        named = {k: v for k, v in _plain(named).items() if k != "dtype"}
        if name in MAKERS:
            if name.endswith("_like"):
                shape = np.shape(arrayed(arguments[0]))
                made = np.zeros(shape) if name != "ones_like" else np.ones(shape)
            else:
                made = np.asarray(function(*(plain(a) for a in arguments[:2]), **named))
            if name.startswith("empty"):
                made = np.zeros(made.shape)
            return made.astype(object)
        if name in ("array", "asarray"):
            return arrayed(arguments[0], copy=True)
        if name in ("diag", "reshape", "roll", "tile", "sum", "cumsum", "prod", "flip"):
            return function(arrayed(arguments[0]), *(plain(a) for a in arguments[1:]), **named)
        if name == "einsum":
            return function(arguments[0], *(arrayed(a) for a in arguments[1:]))
        if name in ("stack", "vstack", "hstack", "column_stack", "concatenate", "block"):
            parts = [arrayed(a) for a in items(arguments[0])]
            return function(parts, *(plain(a) for a in arguments[1:]), **named)
        return function(*(arrayed(a) for a in arguments), **named)

    return call


def _solve(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    A, b = (arrayed(a) for a in arguments)
    rows = A.shape[0]
    if A.shape != (rows, rows) or b.shape[:1] != (rows,):
        raise NotUnderstood(f"a matrix of shape {A.shape} and a right side of shape {b.shape}")
    if b.ndim == 2:
        columns = [_solve(tape, [A, b[:, k]], {}) for k in range(b.shape[1])]
        return np.stack(columns, axis=1)
    whole = tape.record(Solve(rows), *A.ravel(), *b)
    result = np.empty(rows, dtype=object)
    for k in range(rows):
        result[k] = tape.record(Row(k), whole)
    return result


def _inverse(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    A = arrayed(arguments[0])
    return _solve(tape, [A, np.eye(A.shape[0]).astype(object)], {})


def _determinant(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    A = arrayed(arguments[0])
    if A.shape == (1, 1):
        return A[0, 0]
    total: Any = 0.0
    for k in range(A.shape[0]):
        minor = np.delete(np.delete(A, 0, axis=0), k, axis=1)
        total = total + (-1) ** k * A[0, k] * _determinant(tape, [minor], {})
    return total


def _norm(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    entries = list(flatten(arguments[0]))
    return tape.record(np.sqrt, sum((e * e for e in entries[1:]), start=entries[0] * entries[0]))


def _sum(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    start = arguments[1] if len(arguments) > 1 else 0
    return sum(items(arguments[0]), start)


def _least(pick: str) -> Call:
    def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        entries = list(items(arguments[0])) if len(arguments) == 1 else arguments
        result = entries[0]
        for entry in entries[1:]:
            result = tape.record(getattr(np, pick), result, entry)
        return result

    return call


def _float(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    return arguments[0] if arguments else 0.0


BUILTINS: dict[str, Any] = {
    "abs": Elementary("abs"),
    "pow": Elementary("pow"),
    "float": _float,
    "sum": _sum,
    "min": _least("minimum"),
    "max": _least("maximum"),
    "len": lambda tape, a, named: len(a[0]),
    "range": lambda tape, a, named: range(*(plain(x) for x in a)),
    "enumerate": lambda tape, a, named: list(enumerate(items(a[0]), *(plain(x) for x in a[1:]))),
    "zip": lambda tape, a, named: list(zip(*(items(x) for x in a))),
    "reversed": lambda tape, a, named: list(reversed(list(items(a[0])))),
    "tuple": lambda tape, a, named: tuple(items(a[0])) if a else (),
    "list": lambda tape, a, named: list(items(a[0])) if a else [],
    "dict": lambda tape, a, named: {**(a[0] if a else {}), **named},
    "int": lambda tape, a, named: int(plain(a[0])),
    "True": True,
    "False": False,
    "None": None,
}

SPECIAL: dict[str, Call] = {
    "clip": lambda tape, a, named: _least("maximum")(
        tape, [_least("minimum")(tape, [a[0], a[2]], {}), a[1]], {}
    ),
}


def items(value: Any) -> Iterator[Any]:
    """The entries of a tuple, list, range or array."""
    if isinstance(value, Slot) or not hasattr(value, "__iter__"):
        raise TypeError("a number where several are expected")
    return iter(value)


def flatten(value: Any) -> Iterator[Any]:
    """All numbers in nested sequences and arrays, in order."""
    if isinstance(value, np.ndarray):
        yield from value.flat
    elif isinstance(value, list | tuple):
        for part in value:
            yield from flatten(part)
    elif value is None:
        raise TypeError("it returns nothing")
    else:
        yield value


def arrayed(value: Any, copy: bool = False) -> Any:
    """Lists and tuples as arrays of objects; everything else as it is."""
    if isinstance(value, np.ndarray):
        return value.copy() if copy else value
    if isinstance(value, list | tuple | range):
        parts = [arrayed(part) for part in value]
        shapes = {np.shape(p) if isinstance(p, np.ndarray) else () for p in parts}
        if len(shapes) > 1:
            raise TypeError("an array of rows of different length")
        shape = shapes.pop() if shapes else ()
        made = np.empty((len(parts), *shape), dtype=object)
        for k, part in enumerate(parts):
            made[k] = part
        return made
    return value


def plain(value: Any) -> Any:
    """Sizes, indices and axes as Python numbers."""
    if isinstance(value, Slot):
        return value.exact()
    if isinstance(value, tuple):
        return tuple(plain(part) for part in value)
    if isinstance(value, list):
        return [plain(part) for part in value]
    return value


def _plain(named: Mapping[str, Any]) -> dict[str, Any]:
    return {key: plain(value) for key, value in named.items()}
