"""`Kernel`: named CasADi expressions, compiled once, evaluated for one state or for many."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from itertools import accumulate
from typing import Any, TypeAlias

import casadi
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import Array
from deltac.errors import InputError, UnknownName, closest
from deltac.kernels.evaluators import Evaluator, NativeLoop, compile_function, compile_loop
from deltac.kernels.lowering import simplified

SX: TypeAlias = Any  # casadi.SX

BLOCK_STATES = 1032
"""States in a block of a named evaluation: they stay in a core's cache on the way through the kernel, and
their rows are not a power of two apart.
"""


class Kernel:
    """A function from named columns (and parameters) to named columns or matrices.

    Inputs are stacked, in their order, into one flat column x, outputs into one flat column y
    (matrices column by column). Three ways to call it: `flat` for batches in that layout, `single`
    for one state in a loop, and the kernel itself for named, time-first arrays.

    The results of a batch depend, to the last bit, on its columns alone: not on how the batch is
    cut, nor on the number of threads. Those of `single` are reproducible too, but are not bit by
    bit those of a batch (scalar and vector code differ in rounding). Each of the two is compiled when
    it is first wanted.

    Attributes:
        input_slices, output_slices: where each name lies in x and y.
        output_shapes: (rows, columns) of each output.
        n_in, n_out, n_parameters: sizes of x, y and the parameters.
    """

    def __init__(
        self,
        inputs: Mapping[str, SX],
        outputs: Mapping[str, SX],
        parameters: SX | None = None,
        *,
        name: str = "kernel",
    ) -> None:
        """Take the expressions; simplification and compilation wait for the first call.

        Args:
            inputs: symbolic dense columns by name.
            outputs: expressions of these and of the parameters, by name.
            parameters: a symbolic column of what changes between runs, such as a mass that varies;
                what is a number in the expressions is folded into the code, and is much faster.
            name: what errors call it.

        Raises:
            InputError: an input that is not a symbolic column, or an output with unknown symbols.
        """
        self.name = name
        columns = {key: casadi.SX(value) for key, value in inputs.items()}
        results = {key: casadi.SX(value) for key, value in outputs.items()}
        p = casadi.SX(0, 1) if parameters is None else casadi.SX(parameters)
        for key, column in [*columns.items(), ("parameters", p)]:
            if not (column.is_column() and column.is_dense() and column.is_valid_input()):
                raise InputError(
                    f"{name}: input {key!r} is {column} of shape {column.shape}, "
                    "expected a column of symbols"
                )
        if "parameters" in columns:
            raise InputError(f"{name}: an input cannot be called 'parameters'; rename it")
        self.input_slices = _slices({key: column.numel() for key, column in columns.items()})
        self.output_slices = _slices({key: result.numel() for key, result in results.items()})
        self.output_shapes: dict[str, tuple[int, int]] = {k: r.shape for k, r in results.items()}
        x = casadi.vertcat(casadi.SX(0, 1), *columns.values())
        y = casadi.vertcat(casadi.SX(0, 1), *map(casadi.vec, results.values()))
        self.n_in, self.n_out, self.n_parameters = x.numel(), y.numel(), p.numel()
        if self.n_in == 0:
            raise InputError(f"{name}: no inputs; expected at least one")
        _check_symbols(name, casadi.vertcat(x, p), results)
        self._written = casadi.Function("kernel", [x, p], [casadi.densify(y)])

    def __repr__(self) -> str:
        ins, outs = ", ".join(self.input_slices), ", ".join(self.output_slices)
        return f"Kernel({self.name}: {ins} -> {outs}; {self.instructions} instructions)"

    @property
    def input_names(self) -> tuple[str, ...]:
        """The names of the inputs, in the order of x."""
        return tuple(self.input_slices)

    @cached_property
    def function(self) -> Any:
        """The simplified CasADi function (x, p) -> y, dense."""
        return simplified(self._written)

    @property
    def instructions(self) -> int:
        """The number of scalar instructions, with reads of inputs and writes of outputs."""
        return int(self.function.n_instructions())

    @cached_property
    def _for_one(self) -> Evaluator:
        return compile_function(self._written, batches=False)

    @cached_property
    def _for_batches(self) -> Evaluator:
        return compile_function(self._written)

    @cached_property
    def width(self) -> int:
        """How many columns of a batch the code evaluates at a time."""
        return self._for_batches.width if self.n_out else 1

    @cached_property
    def _loop(self) -> NativeLoop:
        return compile_loop(self._written)

    def compile(self, *, single: bool = False) -> Kernel:
        """Compile now, for batches or for `single` states, not at the first call; returns the kernel."""
        if self.n_out:
            _ = self._for_one if single else self._for_batches
        return self

    def single(self, x: Array, out: Array, parameters: Array | None = None) -> Array:
        """Evaluate one state: for loops, as near to a bare call of the compiled code as can be.

        All arrays are contiguous float64. Hand over the same ones every time: the CasADi evaluator
        binds them.

        Args:
            x: `(n_in,)`.
            out: where to write y, `(n_out,)`; also returned.
            parameters: `(n_parameters,)`, None if the kernel has none.

        Raises:
            InputError: parameters are missing.
            ValueError: an array of another size.
        """
        if parameters is None and self.n_parameters:
            raise InputError(f"{self.name}: parameters expected, an array ({self.n_parameters},)")
        if self.n_out:
            self._for_one.single(x, out, parameters)
        return out

    def bound(self, x: Array, out: Array, parameters: Array | None = None) -> Callable[[], object]:
        """`single` of the same arrays every time, as a function without arguments, which keeps them.

        For loops in which tenths of a microsecond count: it is called in 0.1 µs, `single` in 0.5 µs.
        """
        return self._for_one.bound(x, out, parameters)

    def iterate(self, start: Array, count: int, parameters: ArrayLike | None = None) -> Array:
        """Apply a kernel of as many outputs as inputs over and over, in native code; keep every result.

        Args:
            start: `(n_in,)`.
            count: how often.
            parameters: `(n_parameters,)`, or `(period, n_parameters)` to be taken in turn.

        Returns:
            y after each application, `(count, n_in)`.

        Raises:
            InputError: an array of another size, or a kernel whose outputs are no inputs.
        """
        p = np.asarray(() if parameters is None else parameters, dtype=np.float64)
        p = np.ascontiguousarray(p.reshape(1, -1) if p.ndim < 2 else p)
        rows = np.empty((count + 1, self.n_in))
        if self.n_out != self.n_in or np.shape(start) != (self.n_in,):
            raise InputError(
                f"{self.name}: a start of shape {np.shape(start)} for {self.n_in} inputs and {self.n_out} "
                "outputs; expected as many of each"
            )
        if p.shape[1] != self.n_parameters or not len(p):
            raise InputError(
                f"{self.name}: parameters have shape {p.shape}, expected (period, {self.n_parameters})"
            )
        rows[0] = start
        if count:
            self._loop.iterate(rows, p)
        return rows[1:]

    def bound_batch(
        self, x: Array, out: Array, parameters: Array | None = None
    ) -> Callable[[], None]:
        """`flat` of the same arrays every time, without arguments; it keeps them.

        All are float64: x `(n_in, B)`, out `(n_out, B)`, parameters `(n_parameters, B)`, with whole SIMD
        vectors of columns. They may be parts of larger arrays, whose rows are as long in all of them.
        """
        sizes = (self.n_in, self.n_out, self.n_parameters)
        lengths = set()
        for array, size in zip((x, out, parameters), sizes, strict=True):
            shape = (0, out.shape[1]) if array is None else array.shape
            assert shape == (size, out.shape[1]), f"{self.name}: {shape} for {size} rows"
            if array is not None:
                assert array.dtype == np.float64 and array.strides[1] == array.itemsize
                lengths |= {array.strides[0]} if len(array) > 1 else set()
        assert len(lengths) <= 1, f"{self.name}: rows of different lengths"
        assert out.shape[1] % self._for_batches.width == 0, "columns would be left out"
        return self._for_batches.bound_batch(x, out, parameters)

    def flat(
        self, x: Array, parameters: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Evaluate a batch of columns.

        Args:
            x: `(n_in, B)`.
            parameters: `(n_parameters,)`, or `(n_parameters, B)` for other ones in each column.
            out: where to write, contiguous float64 `(n_out, B)`; a new array if None.

        Returns:
            y, `(n_out, B)`.

        Raises:
            InputError: an array of another size.
        """
        x = np.ascontiguousarray(x, dtype=np.float64)
        if x.ndim != 2 or x.shape[0] != self.n_in:
            raise InputError(f"{self.name}: x has shape {x.shape}, expected ({self.n_in}, B)")
        batch = x.shape[1]
        p = self._batch_parameters(parameters, batch)
        shape = (self.n_out, batch)
        if out is None:
            out = np.empty(shape)
        elif out.shape != shape or out.dtype != np.float64 or not out.flags.c_contiguous:
            raise InputError(
                f"{self.name}: out has shape {out.shape} and type {out.dtype}, "
                f"expected contiguous float64 {shape}"
            )
        if out.size == 0:
            return out
        evaluator = self._for_batches
        left_over = batch % evaluator.width
        if left_over < batch:
            evaluator.batch(x, out, p)
        if left_over:  # as a whole SIMD vector: bits must not tell where a batch was cut
            whole = batch - left_over
            last = np.minimum(np.arange(whole, whole + evaluator.width), batch - 1)
            vector = np.empty((self.n_out, evaluator.width))
            evaluator.batch(x.take(last, 1), vector, None if p is None else p.take(last, 1))
            out[:, -left_over:] = vector[:, :left_over]
        return out

    def __call__(
        self, parameters: ArrayLike | None = None, **arrays: ArrayLike
    ) -> dict[str, Array]:
        """Evaluate named arrays at T times.

        Args:
            **arrays: for an input of size n: `(T, n)`, or `(n,)` if it stays the same; for n = 1
                also `(T,)` or a number.
            parameters: `(n_parameters,)`, or `(T, n_parameters)`.

        Returns:
            `(T,)` for a scalar, `(T, n)` for a column, `(T, rows, columns)` for a matrix.

        Raises:
            InputError: an input that is missing, unknown, or of the wrong size.
        """
        for key in arrays:
            if key not in self.input_slices:
                raise UnknownName(
                    f"{self.name}: unknown input {key!r}{closest(key, self.input_slices)}"
                )
        for key in self.input_slices:
            if key not in arrays:
                raise InputError(f"{self.name}: input {key!r} is missing")
        rows = {key: self._rows(key, value) for key, value in arrays.items()}
        lengths = {key: len(value) for key, value in rows.items() if len(value) != 1}
        if len(set(lengths.values())) > 1:
            raise InputError(f"{self.name}: inputs differ in their number of times: {lengths}")
        times = next(iter(lengths.values()), 1)
        p = None if parameters is None else np.asarray(parameters, dtype=np.float64)
        varying = p is not None and p.ndim == 2
        if p is not None and varying and len(p) != times:
            raise InputError(
                f"{self.name}: parameters have shape {p.shape}, expected ({self.n_parameters},) or "
                f"({times}, {self.n_parameters})"
            )
        parts = []
        for start in range(0, max(times, 1), BLOCK_STATES):
            block = slice(start, min(start + BLOCK_STATES, times))
            x = np.empty((self.n_in, block.stop - start))
            for key, where in self.input_slices.items():
                x[where] = (rows[key] if len(rows[key]) == 1 else rows[key][block]).T
            y = self.flat(x, p[block].T if varying and p is not None else p)
            # Of a matrix (T, rows, columns): column by column.
            parts.append(
                {
                    key: y[where].reshape(*self._shape(key)[::-1], y.shape[1]).T
                    for key, where in self.output_slices.items()
                }
            )
        if len(parts) == 1:
            return parts[0]
        return {key: np.concatenate([part[key] for part in parts]) for key in self.output_slices}

    def _rows(self, key: str, value: ArrayLike) -> Array:
        """The values of an input as `(T, n)`, with T = 1 for one that stays the same."""
        size = self.input_slices[key].stop - self.input_slices[key].start
        array = np.asarray(value, dtype=np.float64)
        if array.ndim < 2:
            array = array.reshape(-1, 1) if size == 1 else array.reshape(1, -1)
        if array.ndim != 2 or array.shape[1] != size:
            series = f"(T, {size}) or ({size},)" if size != 1 else "(T,) or a number"
            raise InputError(
                f"{self.name}: input {key!r} has shape {np.shape(value)}, expected {series}"
            )
        return array

    def _shape(self, key: str) -> tuple[int, ...]:
        """The shape of an output at one time."""
        rows, columns = self.output_shapes[key]
        if columns == 1:
            return () if rows == 1 else (rows,)
        return rows, columns

    def _batch_parameters(self, parameters: ArrayLike | None, batch: int) -> Array | None:
        n = self.n_parameters
        if parameters is None and n == 0:
            return None
        p = np.asarray(() if parameters is None else parameters, dtype=np.float64)
        if p.shape not in ((n,), (n, batch)):
            raise InputError(
                f"{self.name}: parameters have shape {p.shape}, expected ({n},) or ({n}, {batch})"
            )
        if n == 0:
            return None
        return np.ascontiguousarray(np.broadcast_to(p.reshape(n, -1), (n, batch)))


def _slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    ends = list(accumulate(sizes.values()))
    return {
        key: slice(end - size, end) for (key, size), end in zip(sizes.items(), ends, strict=True)
    }


def _check_symbols(name: str, symbols: SX, outputs: Mapping[str, SX]) -> None:
    """Each output is an expression of `known` alone, and no symbol in `known` stands twice."""
    by_hash: dict[int, SX] = {}
    for symbol in symbols.elements():
        if by_hash.setdefault(symbol.element_hash(), symbol) is not symbol:
            raise InputError(f"{name}: the symbol {symbol} occurs twice in the inputs")
    for key, output in outputs.items():
        free = [s for s in casadi.symvar(output) if s.element_hash() not in by_hash]
        if free:
            raise InputError(
                f"{name}: output {key!r} depends on {', '.join(map(str, free))}, "
                "which is in neither the inputs nor the parameters; add it to one of them"
            )
