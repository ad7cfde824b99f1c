"""Expressions at the rows of columns: by CasADi's machine where little is to be done, else compiled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.kernels.casadi_evaluator import on_arrays
from deltac.kernels.evaluators import evaluator_name
from deltac.kernels.kernel import SX, Kernel

LONG_CODE = 2000
"""Instructions from which on it pays to compile for a single log what is evaluated often: that takes as long
as to interpret it at some 20 000 rows; what is shorter takes milliseconds either way.
"""


class RowExpression:
    """An expression of columns, evaluated at many rows.

    It is interpreted by CasADi's machine, or compiled: where it is wanted `often` for a single log and is
    `LONG_CODE`, and inside `compiled_rows`. What was evaluated before decides nothing, so that the results
    of a log are the same to the last bit.
    """

    def __init__(
        self, name: str, inputs: Mapping[str, SX], *outputs: SX, often: bool = False
    ) -> None:
        self.sizes = [out.numel() for out in outputs]
        dense = [ca.densify(ca.vec(out)) for out in outputs]
        self.function = ca.Function(name, [*inputs.values()], dense, {"cse": True})
        self._given = (
            {key: column for key, column in inputs.items() if column.shape[0]},
            {f"{name} {k}": out for k, out in enumerate(dense)},
        )
        self._often = often
        self._ends = np.cumsum(self.sizes).tolist()

    @cached_property
    def kernel(self) -> Kernel:
        """The same, compiled."""
        return Kernel(*self._given, name=self.function.name())

    @cached_property
    def _worth_it(self) -> bool:
        long = self.function.n_instructions() >= LONG_CODE
        return self._often and long and evaluator_name() == "llvm"

    def __call__(self, *columns: Array) -> list[Array]:
        """Its values at rows, (T, size) each."""
        if not (self._worth_it or _COMPILED.get()):
            return at_rows(self.function, columns)
        kernel, count, at = self.kernel, len(columns[0]), 0
        # Whole vectors of rows are one call; the last row fills up.
        x = np.empty((kernel.n_in, -(-count // kernel.width) * kernel.width))
        for column in columns:
            size = column.shape[1] if column.ndim == 2 else 1
            x[at : at + size, :count] = column.T
            at += size
        x[:, count:] = x[:, count - 1 : count]
        y = kernel.flat(x)[:, :count].T
        return [y[:, end - size : end] for size, end in zip(self.sizes, self._ends)]


_COMPILED: ContextVar[bool] = ContextVar("deltac_compiled_expressions", default=False)


@contextmanager
def compiled_rows() -> Iterator[None]:
    """Compile expressions of any length: where many logs of one model follow."""
    token = _COMPILED.set(True)
    try:
        yield
    finally:
        _COMPILED.reset(token)


def at_rows(function: ca.Function, columns: Sequence[Array]) -> list[Array]:
    """Each output of a function of dense columns at T rows: arrays (T, size), entries stacked by columns.

    Of sparse outputs the machine writes what they store: the zeros of forces by channel outnumber the rest.
    `columns` are arrays (T, m) or (T,), one an input. CasADi's machine reads and writes rows in place:
    arrays of its own would be copied number by number, which takes ten times as long.
    """
    count = len(columns[0])
    inputs = [np.asarray(c, dtype=np.float64).reshape(count, -1) for c in columns]
    outputs = [np.empty((count, function.nnz_out(k))) for k in range(function.n_out())]
    block = ROWS_A_CALL if function.n_instructions() < LONG_CODE else 1
    whole = count - count % block
    for first, last, size in ((0, whole, block), (whole, count, count - whole)):
        if first == last:
            continue
        read = [np.zeros((size, c.shape[1])) for c in inputs]
        written = [np.zeros((size, m.shape[1])) for m in outputs]
        _kept, evaluate = on_arrays(function.map(size), read, written)
        for start in range(first, last, size):
            rows = slice(start, start + size)
            for values, c in zip(read, inputs):
                values[:] = c[rows]
            evaluate()
            for m, values in zip(outputs, written):
                m[rows] = values
    return [whole_output(function, k, values) for k, values in enumerate(outputs)]


def whole_output(function: ca.Function, k: int, stored: Array) -> Array:
    """All entries (T, size) of an output, by those (T, nnz) that it stores."""
    pattern = function.sparsity_out(k)
    if pattern.is_dense():
        return stored
    entries = np.zeros((len(stored), pattern.numel()))
    entries[:, pattern.find()] = stored
    return entries


ROWS_A_CALL = 64
"""Rows of a call of CasADi's machine, which takes as long as some hundred instructions; one of what is
`LONG_CODE`: to repeat its code takes longer."""
