"""What the user's function may call: arithmetic on numbers and arrays, and nothing with side effects.

Arrays that hold slots are NumPy's arrays of objects, so most of NumPy acts on them as it is. What does not,
and what JAX, SciPy, CasADi and SymPy call otherwise, is here.
"""

from __future__ import annotations

import collections
import copy
import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterator, ValuesView
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from deltac.repair.tracing.tape import (
    COMPARISONS,
    CONSTANTS,
    ELEMENTARY,
    Operation,
    Row,
    Slot,
    Solve,
    Tape,
    identity,
)
from deltac.repair.tracing.values import Object, objects

Call = Callable[[Tape, list[Any], dict[str, Any]], Any]


class NotUnderstood(Exception):
    """A call that cannot be put on a tape."""


@dataclass(frozen=True)
class Library:
    """A module whose functions are understood, by its own dotted name."""

    name: str


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
        named = {k: v for k, v in named.items() if k not in ("dtype", "where")}
        out = named.pop("out", None)
        if named or len(arguments) != count:
            raise NotUnderstood(f"expected {count} argument{'s' if count > 1 else ''}")
        arguments = [arrayed(a) for a in arguments]
        if not any(isinstance(a, np.ndarray) for a in arguments):
            return tape.record(self.operation, *arguments)
        apply = np.frompyfunc(lambda *a: tape.record(self.operation, *a), count, 1)
        found = apply(*arguments)
        if out is not None:
            out[...] = found
        return found


@dataclass(frozen=True)
class Plain:
    """A function of Python's or NumPy's that acts on arrays of slots as on any other."""

    function: Callable[..., Any]

    def __call__(self, tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        """Call it; lists of numbers count as arrays, whole numbers as axes, sizes and counts."""
        named = {k: plain(v) for k, v in named.items() if k not in ("dtype", "order", "optimize")}
        return self.function(*(_sequence(_whole(a)) for a in arguments), **named)


def _whole(value: Any) -> Any:
    """A whole number of the source as Python's own; everything else as it is."""
    counts = isinstance(value, Slot) and isinstance(value.tape.exact[value.index], int)
    return plain(value) if counts else value


def _sequence(value: Any) -> Any:
    """An array; arrays of different shapes, and matrices, as a list of them: np.concatenate joins them."""
    if isinstance(value, list | tuple):
        parts = [arrayed(part) for part in value]
        arrays = [part for part in parts if isinstance(part, np.ndarray)]
        if len({part.shape for part in arrays}) > 1 or any(type(a) is np.matrix for a in arrays):
            return parts
    return arrayed(value)


ARRAYS = (
    "numpy", "math", "jax.numpy", "autograd.numpy", "numpy.linalg", "jax.numpy.linalg", "scipy.linalg",
    "autograd.numpy.linalg", "casadi", "sympy", "jax.lax", "cupy", "cmath", "jax.scipy.linalg",
    "scipy.sparse.linalg", "mpmath", "numpy.lib.scimath",
)  # fmt: skip
"""Modules whose functions are understood by their names."""

PYTHON: dict[str, ModuleType] = {
    m.__name__: m for m in (itertools, operator, collections, functools, copy, math)
}
"""Modules of Python's whose functions act on any value."""

RENAMED = {
    "vertcat": "concatenate_scalars", "horzcat": "columns", "mtimes": "matmul", "fabs": "abs",
    "if_else": "where", "fmax": "maximum", "fmin": "minimum", "Abs": "abs", "Max": "maximum",
    "Min": "minimum", "Matrix": "array", "DM": "array", "SX": "array", "asarray": "array",
    "ascontiguousarray": "array", "asfarray": "array", "asanyarray": "array", "row_stack": "vstack",
    "fromiter": "array", "mat": "matrix", "asmatrix": "matrix", "bmat": "block",
    "acosh": "arccosh", "asinh": "arcsinh", "atanh": "arctanh", "norm_2": "norm", "select": "where",
    "bitwise_or": "logical_or", "concat": "concatenate", "matrix_transpose": "transpose",
    "permute_dims": "transpose", "true_divide": "divide", "float_power": "power",
}  # fmt: skip


def library(name: str) -> Library | None:
    """A module that may be imported."""
    known = (
        name in ARRAYS or name in PYTHON or name in ("jax", "scipy", "autograd", "scipy.constants")
    )
    return Library(name) if known else None


def member(module: str, name: str) -> Any:
    """A function, constant or submodule of a module; None for what is not understood."""
    inner = f"{module}.{name}"
    if library(inner) is not None:
        return Library(inner)
    if module == "scipy.constants":
        import scipy.constants

        value = getattr(scipy.constants, name, None)
        return float(value) if isinstance(value, int | float) else None
    if module not in ARRAYS:
        return _plain_python(module, name)
    name = RENAMED.get(name, name)
    if name in ELEMENTARY and not (module == "math" and name in ("square", "sign", "where")):
        return Elementary(name)
    if name in COMPARISONS:
        return _comparison(name)
    if name in CONSTANTS:
        return float(CONSTANTS[name])
    if name in ("float64", "float32", "double", "float_", "longdouble", "float16"):
        return BUILTINS["float"]
    if name in ("int64", "int32", "intp", "int_"):
        return BUILTINS["int"]
    if name in ("bool_", "ndarray"):
        return np.ndarray if name == "ndarray" else BUILTINS["bool"]
    if name in SPECIAL:
        return SPECIAL[name]
    if module == "math":
        return None
    if name in ("newaxis",):
        return None
    found = getattr(np, name, None)
    return Plain(found) if name in STRUCTURAL and found is not None else None


def _plain_python(module: str, name: str) -> Any:
    found = getattr(PYTHON.get(module), name, None)
    if found is None or not callable(found) or name in ("setattr", "exit"):
        return None
    if name in (
        "partial",
        "reduce",
        "lru_cache",
        "cache",
        "wraps",
        "cached_property",
        "namedtuple",
    ):
        return None  # the reader's own affair
    if module == "operator" and name in _OPERATORS:
        return Elementary(_OPERATORS[name])
    return lambda tape, arguments, named: found(*(_whole(a) for a in arguments), **named)


_OPERATORS = {
    "add": "add",
    "sub": "subtract",
    "mul": "multiply",
    "truediv": "divide",
    "neg": "negative",
}


def known(value: Any) -> Any:
    """A function, module or constant of a library that is understood, from the live object; else None."""
    if isinstance(value, ModuleType):
        return library(value.__name__)
    module, name = getattr(value, "__module__", None), getattr(value, "__name__", None)
    if isinstance(value, np.ufunc):
        return member("numpy", value.__name__)
    if not isinstance(module, str) or not isinstance(name, str):
        return None
    if module == "builtins":
        return BUILTINS.get(name)
    root = module.partition(".")[0]
    owner = {
        "jax": "jax.numpy",
        "numpy": "numpy",
        "scipy": "scipy.linalg",
        "autograd": "numpy",
    }.get(root, root)
    if "linalg" in module:
        owner = "numpy.linalg"
    return member(owner, name) if owner in ARRAYS or owner in PYTHON else None


def attribute(base: Any, name: str) -> Any:
    """An attribute of an array, a number or a container; None for what is not understood."""
    if isinstance(base, np.ndarray):
        if name in ("T", "mT", "shape", "size", "ndim", "real", "flat", "dtype"):
            return base if name == "real" else base.T if name == "mT" else getattr(base, name)
        if name == "at":
            return At(base)
        if isinstance(base, np.matrix) and name in ("I", "A", "A1"):
            if name == "I":
                return np.asmatrix(_inverse(base.flat[0].tape, [np.asarray(base)], {}))
            return np.asarray(base) if name == "A" else np.asarray(base).ravel()
        if name in METHODS:
            return _method(base, name)
    if isinstance(base, Elementary) and name in ("outer", "reduce", "accumulate"):
        return _ufunc(base, name)
    if isinstance(base, Slot):
        if name in ("T", "real", "mT"):
            return base
        if name in ("shape", "size", "ndim"):
            return {"shape": (), "size": 1, "ndim": 0}[name]
        if name in (
            "item",
            "copy",
            "squeeze",
            "ravel",
            "flatten",
            "astype",
            "reshape",
            "sum",
            "evalf",
        ):
            return lambda tape, arguments, named: base
    if isinstance(
        base, list | dict | tuple | set | str | collections.deque
    ) and not name.startswith("_"):
        bound = getattr(base, name, None)
        if callable(bound):
            return lambda tape, arguments, named: bound(
                *(
                    plain(a) if isinstance(base, dict | str) and k == 0 else a
                    for k, a in enumerate(arguments)
                ),
                **named,
            )
        return bound
    return None


def _ufunc(function: Elementary, name: str) -> Call:
    """np.add.reduce, np.maximum.outer and their like."""

    def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        if name == "outer":
            a, b = (np.asarray(arrayed(x), dtype=object) for x in arguments)
            return function(
                tape, [a.reshape(a.shape + (1,) * b.ndim), b.reshape((1,) * a.ndim + b.shape)], {}
            )
        made = np.frompyfunc(lambda a, b: tape.record(function.operation, a, b), 2, 1)
        named = {k: plain(v) for k, v in named.items()}
        return getattr(made, name)(
            arrayed(arguments[0]), *(plain(a) for a in arguments[1:]), **named
        )

    return call


def _method(base: np.ndarray[Any, Any], name: str) -> Call:
    def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        if name in ("astype", "tolist", "item"):
            return (
                base.item() if name == "item" else list(base) if name == "tolist" else base.copy()
            )
        if name == "dot":
            return _dot(tape, [base, *arguments], {})
        if name in ("fill", "put"):
            return getattr(base, name)(*(arrayed(a) for a in arguments))
        if name in ("max", "min"):
            return _least("maximum" if name == "max" else "minimum")(tape, [base], {})
        named = {k: plain(v) for k, v in named.items() if k not in ("dtype", "order")}
        return getattr(base, name)(*(plain(a) for a in arguments), **named)

    return call


@dataclass(frozen=True)
class At:
    """JAX's way to set entries: x.at[i].set(y) is a copy of x."""

    array: np.ndarray[Any, Any]
    index: Any = None

    def __getitem__(self, index: Any) -> At:
        return At(self.array, index)

    def update(self, name: str) -> Call | None:
        """set, add, multiply."""
        if name not in ("set", "add", "multiply", "divide"):
            return None

        def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
            made = self.array.copy()
            value = arrayed(arguments[0])
            old = made[self.index]
            found = {"set": lambda: value, "add": lambda: old + value,
                     "multiply": lambda: old * value, "divide": lambda: old / value}[name]()  # fmt: skip
            made[self.index] = found
            return made

        return call


METHODS = (
    "dot", "sum", "copy", "reshape", "transpose", "ravel", "flatten", "prod", "trace", "fill", "squeeze",
    "diagonal", "cumsum", "mean", "astype", "tolist", "item", "max", "min", "repeat", "swapaxes", "take",
)  # fmt: skip
STRUCTURAL = set((
    "stack vstack hstack dstack column_stack concatenate dot matmul cross outer inner diag diagonal "
    "transpose trace sum prod cumsum cumprod vdot einsum flip fliplr flipud roll tile squeeze ravel reshape "
    "tensordot kron moveaxis swapaxes rollaxis expand_dims atleast_1d atleast_2d atleast_3d mean average "
    "split array_split hsplit vsplit repeat append insert delete tril triu fill_diagonal broadcast_to "
    "shape size ndim arange indices ix_ diff rot90 linspace copy arange take unravel_index full_like "
    "block diag_indices triu_indices tril_indices logical_not isscalar vecdot matvec vecmat count_nonzero"
).split())  # fmt: skip


def _made(name: str) -> Call:
    """np.zeros and its like, with entries that can hold slots."""

    def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        named = {k: plain(v) for k, v in named.items() if k not in ("dtype", "order", "like")}
        if name.endswith("_like"):
            shape: Any = np.shape(arrayed(arguments[0]))
        else:
            shape = plain(named.pop("shape", arguments[0]))
            if isinstance(shape, np.ndarray):
                shape = tuple(int(plain(n)) for n in shape)
        made = np.empty(shape, dtype=object)
        if name.startswith("full"):
            value = arrayed(named.get("fill_value", arguments[1] if len(arguments) > 1 else 0.0))
            made[...] = value
        else:
            made[...] = 1.0 if name.startswith("ones") else 0.0
        return made

    return call


def _matrix(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    """np.matrix, whose * is the product of matrices."""
    return np.asmatrix(_array(tape, arguments, {}))


def _eye(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    sizes = [plain(a) for a in arguments[:2]]
    rows, columns = sizes[0], sizes[-1]
    return np.eye(rows, columns, k=plain(named.get("k", 0))).astype(object)


def _array(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    value = arguments[0]
    return arrayed(list(value) if isinstance(value, Iterator | ValuesView) else value, copy=True)


def _block(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    """np.block, whose own check of depths wants lists."""

    def joined(rows: Any, depth: int) -> Any:
        if not isinstance(rows, list | tuple):
            return np.atleast_2d(arrayed(rows)) if depth else np.atleast_1d(arrayed(rows))
        parts = [joined(row, depth) for row in rows]
        nested = any(isinstance(row, list | tuple) for row in rows)
        return np.concatenate(parts, axis=-2 if nested else -1)

    deep = any(isinstance(row, list | tuple) for row in arguments[0])
    return joined(arguments[0], int(deep))


def _einsum(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    return np.einsum(arguments[0], *(arrayed(a) for a in arguments[1:]))


def _solve(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    A, b = (arrayed(a) for a in arguments[:2])
    if isinstance(b, np.matrix):
        return np.asmatrix(_solve(tape, [A, np.asarray(b)], {}))
    A, rows = np.asarray(A), A.shape[0]
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


def inverse_of(value: Any) -> np.ndarray[Any, Any] | None:
    """The matrix that an array of slots is the inverse of, if it is one: M⁻¹ f is better solved for."""
    if not isinstance(value, np.ndarray) or value.ndim != 2 or value.shape[0] != value.shape[1]:
        return None
    n = len(value)
    wholes = []
    for (i, j), entry in np.ndenumerate(value):
        if not isinstance(entry, Slot):
            return None
        tape, k = entry.tape, entry.index
        while tape.operations[k] is identity:
            (k,) = tape.inputs[k]
        if tape.operations[k] != Row(i) or tape.operations[tape.inputs[k][0]] != Solve(n):
            return None
        if i == 0:
            wholes.append(tape.inputs[tape.inputs[k][0]])
        elif tape.inputs[tape.inputs[k][0]] != wholes[j]:
            return None
    for j, inputs in enumerate(wholes):
        right = [tape.exact[k] for k in inputs[n * n :]]
        if inputs[: n * n] != wholes[0][: n * n] or right != [float(i == j) for i in range(n)]:
            return None
    return objects([Slot(tape, k) for k in wholes[0][: n * n]]).reshape(n, n)


def product(left: Any, right: Any) -> Any:
    """Left @ right, M⁻¹ f as the solution of M x = f."""
    left, right = arrayed(left), arrayed(right)
    matrix = inverse_of(left) if isinstance(right, np.ndarray) and right.ndim <= 2 else None
    if matrix is not None:
        return _solve(matrix[0, 0].tape, [matrix, right], {})
    if not (isinstance(left, np.ndarray) and isinstance(right, np.ndarray)):
        raise TypeError("a matrix product of numbers")
    return left @ right


def _dot(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    a, b = (arrayed(x) for x in arguments[:2])
    return product(a, b) if np.ndim(a) and np.ndim(b) else a * b


def _inverse(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    A = arrayed(arguments[0])
    if A.ndim != 2 or A.shape[0] != A.shape[1]:
        raise NotUnderstood(f"a matrix of shape {A.shape}")
    return _solve(tape, [A, np.eye(A.shape[0]).astype(object)], {})


def _least_squares(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    A, b = (arrayed(a) for a in arguments[:2])
    square = A.shape[0] == A.shape[1]
    found = _solve(tape, [A, b] if square else [A.T @ A, A.T @ b], {})
    return found, None, A.shape[1], None


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
    axis = plain(named.get("axis"))
    value = arrayed(arguments[0])
    if axis is not None:
        return ELEMENTWISE["sqrt"](tape, [(value * value).sum(axis=axis)], {})
    entries = list(flatten(value))
    return tape.record(np.sqrt, sum((e * e for e in entries[1:]), start=entries[0] * entries[0]))


def _cross(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    a, b = (np.asarray(arrayed(x), dtype=object) for x in arguments[:2])
    if a.shape == (3,) == b.shape:
        return objects(
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        )
    if a.shape == (2,) == b.shape:
        return a[0] * b[1] - a[1] * b[0]
    return np.cross(a, b, **{k: plain(v) for k, v in named.items()})


def _skew(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    x, y, z = arrayed(arguments[0])
    return arrayed([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _block_diagonal(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    parts = [np.atleast_2d(arrayed(a)) for a in arguments]
    rows, columns = (sum(p.shape[k] for p in parts) for k in (0, 1))
    made = np.zeros((rows, columns)).astype(object)
    i = j = 0
    for p in parts:
        made[i : i + p.shape[0], j : j + p.shape[1]] = p
        i, j = i + p.shape[0], j + p.shape[1]
    return made


def _scalars(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    """CasADi's vertcat: a column of all there is, or rows of matrices one below the other."""
    parts = [arrayed(a) for a in arguments]
    if any(isinstance(p, np.ndarray) and p.ndim == 2 for p in parts):
        return np.vstack([np.atleast_2d(p) for p in parts])
    return objects(list(flatten(parts)))


def _columns(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    parts = [np.atleast_1d(arrayed(a)) for a in arguments]
    return (
        np.column_stack(parts)
        if parts[0].size > 1
        else np.concatenate([p.ravel() for p in parts])[None, :]
    )


def _sum(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    start = arguments[1] if len(arguments) > 1 else named.get("start", 0)
    return sum(items(arguments[0]), start)


def _least(pick: str) -> Call:
    def call(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
        entries = list(items(arguments[0])) if len(arguments) == 1 else arguments
        if not any(isinstance(e, Slot) for e in entries):
            return (max if pick == "maximum" else min)(entries)
        result = entries[0]
        for entry in entries[1:]:
            result = tape.record(getattr(np, pick), result, entry)
        return result

    return call


def _clip(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    a = [*arguments, *(named[k] for k in ("a_min", "min", "a_max", "max") if k in named)]
    low = a[0] if a[1] is None else ELEMENTWISE["maximum"](tape, [a[0], a[1]], {})
    return low if a[2] is None else ELEMENTWISE["minimum"](tape, [low, a[2]], {})


def _comparison(name: str) -> Call:
    return lambda tape, arguments, named: compared(COMPARISONS[name], *arguments)


def compared(operation: Operation, left: Any, right: Any) -> Any:
    """A comparison, entry by entry where there are arrays."""
    left, right = arrayed(left), arrayed(right)

    def one(a: Any, b: Any) -> Any:
        slot = a if isinstance(a, Slot) else b
        return slot.tape.record(operation, a, b) if isinstance(slot, Slot) else operation(a, b)

    apply: Any = np.frompyfunc(one, 2, 1)
    return apply(left, right)


def _float(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    value = arguments[0] if arguments else 0.0
    if isinstance(value, str):
        return float(value)
    return value.item() if isinstance(value, np.ndarray) else value


def _all(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    return all(bool(x) for x in flatten(arguments[0]))


def _any(tape: Tape, arguments: list[Any], named: dict[str, Any]) -> Any:
    return any(bool(x) for x in flatten(arguments[0]))


BUILTINS: dict[str, Any] = {
    "abs": Elementary("abs"),
    "pow": Elementary("pow"),
    "float": _float,
    "sum": _sum,
    "min": _least("minimum"),
    "max": _least("maximum"),
    "all": _all,
    "any": _any,
    "len": lambda tape, a, named: len(list(a[0])) if not hasattr(a[0], "__len__") else len(a[0]),
    "range": lambda tape, a, named: range(*(int(plain(x)) for x in a)),
    "enumerate": lambda tape, a, named: list(
        enumerate(items(a[0]), *(plain(x) for x in (*a[1:], *named.values())))
    ),
    "zip": lambda tape, a, named: list(zip(*(items(x) for x in a))),
    "reversed": lambda tape, a, named: list(reversed(list(items(a[0])))),
    "sorted": lambda tape, a, named: sorted(items(a[0])),
    "tuple": lambda tape, a, named: tuple(items(a[0])) if a else (),
    "list": lambda tape, a, named: list(items(a[0])) if a else [],
    "set": lambda tape, a, named: set(items(a[0])) if a else set(),
    "dict": lambda tape, a, named: {**(dict(a[0]) if a else {}), **named},
    "int": lambda tape, a, named: int(plain(a[0])),
    "bool": lambda tape, a, named: bool(a[0]),
    "str": lambda tape, a, named: str(a[0]),
    "round": lambda tape, a, named: round(plain(a[0]), *(plain(x) for x in a[1:])),
    "iter": lambda tape, a, named: iter(list(items(a[0]))),
    "next": lambda tape, a, named: next(a[0]),
    "slice": lambda tape, a, named: slice(*(plain(x) for x in a)),
    "divmod": lambda tape, a, named: (a[0] // a[1], a[0] % a[1]),
    "print": lambda tape, a, named: None,
    "True": True,
    "False": False,
    "None": None,
    "__name__": "equations",
    "__debug__": True,
    "NotImplemented": None,
    "Ellipsis": Ellipsis,
}

ELEMENTWISE = {name: Elementary(name) for name in ("sqrt", "maximum", "minimum")}

SPECIAL: dict[str, Call] = {
    **{
        f"{m}{like}": _made(f"{m}{like}")
        for m in ("zeros", "ones", "empty", "full")
        for like in ("", "_like")
    },
    "eye": _eye,
    "identity": _eye,
    "array": _array,
    "matrix": _matrix,
    "copy": _array,
    "block": _block,
    "einsum": _einsum,
    "dot": _dot,
    "matmul": _dot,
    "solve": _solve,
    "inv": _inverse,
    "pinv": _inverse,
    "lstsq": _least_squares,
    "cho_solve": lambda tape, a, named: _solve(tape, [a[0][0], a[1]], {}),
    "lu_solve": lambda tape, a, named: _solve(tape, [a[0][0], a[1]], {}),
    "cho_factor": lambda tape, a, named: (arrayed(a[0]), True),
    "lu_factor": lambda tape, a, named: (arrayed(a[0]), None),
    "norm": _norm,
    "det": _determinant,
    "cross": _cross,
    "skew": _skew,
    "block_diag": _block_diagonal,
    "diagcat": _block_diagonal,
    "concatenate_scalars": _scalars,
    "columns": _columns,
    "sumsqr": lambda tape, a, named: sum(x * x for x in flatten(arrayed(a[0]))),
    "clip": _clip,
    "max": _least("maximum"),
    "min": _least("minimum"),
    "amax": _least("maximum"),
    "amin": _least("minimum"),
    "all": _all,
    "any": _any,
    "fsum": _sum,
    "isfinite": lambda tape, a, named: True,
    "isnan": lambda tape, a, named: False,
    "float": _float,
    "prod": lambda tape, a, named: np.prod(
        arrayed(list(items(a[0]))), **{k: plain(v) for k, v in named.items()}
    ),
    "dist": lambda tape, a, named: _norm(tape, [arrayed(a[0]) - arrayed(a[1])], {}),
    "reciprocal": lambda tape, a, named: 1.0 / arrayed(a[0]),
    "r_": objects,  # type: ignore[dict-item]
}


def items(value: Any) -> Iterator[Any]:
    """The entries of a tuple, list, range or array."""
    if isinstance(value, Slot) or not hasattr(value, "__iter__"):
        raise TypeError("a number where several are expected")
    return iter(value)


def flatten(value: Any) -> Iterator[Any]:
    """All numbers in nested sequences and arrays, in order."""
    if isinstance(value, np.ndarray):
        for part in value.flat:
            yield from flatten(part) if isinstance(part, np.ndarray | list | tuple) else (part,)
    elif isinstance(value, list | tuple | Object):  # of objects, named tuples
        for part in value:
            yield from flatten(part)
    elif value is None:
        raise TypeError("it returns nothing")
    else:
        yield value


def arrayed(value: Any, copy: bool = False) -> Any:
    """Lists and tuples of numbers as arrays of objects; everything else as it is."""
    if isinstance(value, np.ndarray):
        return value.copy() if copy else value
    if isinstance(value, list | tuple | range):
        parts = [arrayed(part) for part in value]
        if any(isinstance(part, str | slice) or part is Ellipsis or part is None for part in parts):
            return value
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
    if isinstance(value, np.ndarray) and value.dtype == object:
        found = np.array([plain(x) for x in value.flat])
        return found.reshape(value.shape) if value.size else value.astype(int)
    return value


def count(value: Any) -> bool:
    """Whether a value is a number that a size or an index can be."""
    return isinstance(value, Slot) and value.tape.exact[value.index] is not None
