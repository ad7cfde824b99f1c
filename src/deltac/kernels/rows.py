"""CasADi functions at the rows of columns, without compiling anything."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from deltac.arrays import Array


def at_rows(function: ca.Function, columns: Sequence[Array]) -> list[Array]:
    """Each output of a function of dense columns at T rows: arrays (T, size), entries stacked by columns.

    `columns` are arrays (T, m) or (T,), one an input. CasADi's machine reads and writes one row in place:
    arrays of its own would be copied number by number, which takes ten times as long.
    """
    count = len(columns[0])
    given = [np.asarray(c, dtype=np.float64).reshape(count, -1) for c in columns]
    made = [np.empty((count, function.numel_out(k))) for k in range(function.n_out())]
    read = [np.zeros(c.shape[1]) for c in given]
    written = [np.zeros(m.shape[1]) for m in made]
    buffer, evaluate = function.buffer()
    for k, row in enumerate(read):
        if row.size:
            buffer.set_arg(k, row.data)
    for k, row in enumerate(written):
        if row.size:
            buffer.set_res(k, row.data)
    arguments = [(row, c) for row, c in zip(read, given) if row.size]
    results = [(m, row) for m, row in zip(made, written) if row.size]
    for t in range(count):
        for row, c in arguments:
            row[:] = c[t]
        evaluate()
        for m, row in results:
            m[t] = row
    return made
