"""The tape: a function of numbers as the list of its elementary operations, over many states at once.

Each operation acts on arrays (B,), one entry a state. Operations know the node of the source that they
belong to, so that one node can be given another operation, or another value, and only what follows
from it is computed again.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array

Operation: TypeAlias = Callable[..., Any]

MOST_OPERATIONS = 60_000
"""Operations that a function may have."""


class TapeError(Exception):
    """The function does something that cannot be put on a tape."""


class TapeBranch(BaseException):
    """A condition that holds at some states only: `holds` (B,) says at which.

    No Exception, which the user's own handlers may catch.
    """

    def __init__(self, holds: NDArray[np.bool_]) -> None:
        super().__init__("a branch that depends on the state")
        self.holds = holds


@dataclass(frozen=True)
class TapeChange:
    """What an operation of the tape is replaced by: another operation on other slots."""

    operation: Operation
    inputs: tuple[int, ...]

    @staticmethod
    def to(value: Any) -> TapeChange:
        """Another value (B,) or number in place of what is computed."""
        return TapeChange(partial(np.asarray, value), ())


@dataclass(frozen=True)
class Solve:
    """x (rows, B) of A x = b, from the entries of A (row by row) and of b."""

    rows: int

    def __call__(self, *entries: Any) -> Any:
        """The solution; not a number where A is singular."""
        A, b = matrix_and_rest(stacked(entries), self.rows)
        try:
            return np.linalg.solve(A, b.T[:, :, None])[:, :, 0].T
        except np.linalg.LinAlgError:
            return np.full_like(b, np.nan)


def matrix_and_rest(entries: Array, rows: int) -> tuple[Array, Array]:
    """Matrices (B, rows, rows) from their entries (·, B), row by row; and the entries after these."""
    matrix, rest = np.split(entries, [rows * rows])
    return np.moveaxis(matrix.reshape(rows, rows, -1), -1, 0), rest


@dataclass(frozen=True)
class TapeRow:
    """One row of a solution."""

    k: int

    def __call__(self, solution: Any) -> Any:
        """Row k (B,)."""
        return solution[self.k]


def stacked(values: Sequence[Any], width: int = 1) -> Array:
    """Numbers and arrays (B,) as one array (n, B), B being at least `width`."""
    width = max(width, *(np.size(value) for value in values)) if len(values) else width
    full = np.empty((len(values), width))
    for row, value in zip(full, values):
        row[:] = value
    return full


def identity(value: Any) -> Any:
    """The value itself: how names and constants are read."""
    return value


@dataclass(repr=False)
class Tape:
    """Operations in order. Slot k holds the value of operation k.

    operations, inputs  what is computed of which slots; inputs of the function and constants have None
    nodes               the node of the source that each belongs to, or None
    values              (B,) arrays or numbers, at the states it was made for
    exact               the Python number where a slot depends on literals alone, else None
    varying             whether a slot depends on the state
    width               B, the number of states
    """

    operations: list[Operation | None] = field(default_factory=list)
    inputs: list[tuple[int, ...]] = field(default_factory=list)
    nodes: list[int | None] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)
    exact: list[Any] = field(default_factory=list)
    varying: list[bool] = field(default_factory=list)
    node: int | None = None
    width: int = 1
    _known: dict[tuple[Any, ...], int] = field(default_factory=dict)
    _after: dict[int, tuple[int, ...]] = field(default_factory=dict)
    _before: dict[tuple[int, ...], frozenset[int]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.operations)

    def given(self, value: Any, *, exact: Any = None, varying: bool = True) -> Slot:
        """A slot whose value is given: an input or a constant."""
        self.width = max(self.width, np.size(value))
        return self._append(None, (), value, exact, varying)

    def record(self, operation: Operation, *inputs: Any, turn: int = 0) -> Slot:
        """Compute and note an operation on slots and numbers.

        What one node computes again of the same slots is the same number: a property that is asked for
        three times can be edited as one. In another `turn` of a loop it may have to be another number.
        """
        slots = tuple(self.slot(value).index for value in inputs)
        key = (operation, slots, self.node, turn)
        if key in self._known:
            return Slot(self, self._known[key])
        exact = None
        literal = [self.exact[k] for k in slots]
        if all(value is not None for value in literal):
            try:
                with np.errstate(all="ignore"):
                    exact = operation(*literal)
                exact = exact.item() if isinstance(exact, np.generic) else exact
            except (ArithmeticError, ValueError, TypeError):
                exact = None
        with np.errstate(all="ignore"):
            value = operation(*(self.values[k] for k in slots))
        slot = self._append(operation, slots, value, exact, any(self.varying[k] for k in slots))
        self._known[key] = slot.index
        return slot

    def slot(self, value: Any) -> Slot:
        """A value as a slot; numbers become constants."""
        if isinstance(value, Slot):
            return value
        if isinstance(value, bool | int | float | np.generic):
            number = value.item() if isinstance(value, np.generic) else value
            key = (type(number), number, self.node)
            if key not in self._known:
                self._known[key] = self.given(np.float64(number), exact=number, varying=False).index
            return Slot(self, self._known[key])
        raise TapeError(f"arithmetic with {type(value).__name__}")

    def _append(
        self,
        operation: Operation | None,
        slots: tuple[int, ...],
        value: Any,
        exact: Any,
        varying: bool,
    ) -> Slot:
        if len(self.operations) >= MOST_OPERATIONS:
            raise TapeError(
                f"more than {MOST_OPERATIONS} operations: is there a loop that does not end?"
            )
        self.operations.append(operation)
        self.inputs.append(slots)
        self.nodes.append(self.node)
        self.values.append(value)
        self.exact.append(exact)
        self.varying.append(varying)
        return Slot(self, len(self.operations) - 1)

    def whole(self, slots: Sequence[int]) -> int | None:
        """The operation of which slots are the rows, the first ones in order; None where there is none."""
        roots = []
        for k in slots:
            while self.operations[k] is identity:
                (k,) = self.inputs[k]
            roots.append(k)
        wholes = {self.inputs[k] for k in roots}
        in_order = all(self.operations[k] == TapeRow(row) for row, k in enumerate(roots))
        return wholes.pop()[0] if in_order and len(wholes) == 1 else None

    # --- operations put in place of others ---------------------------------------------------------

    @contextlib.contextmanager
    def aside(self) -> Iterator[int]:
        """What is computed within is taken off the tape afterwards; gives the first slot of it."""
        first, noted, node = len(self.operations), self._known, self.node
        self._known, self.node = {}, None
        try:
            yield first
        finally:
            self._known, self.node = noted, node
            for entries in (
                self.operations, self.inputs, self.nodes, self.values, self.exact, self.varying
            ):  # fmt: skip
                del entries[first:]

    def spliced(self, slot: Slot, first: int, own: Container[int]) -> TapeChange:
        """What replaces one of the operations `own`: a number computed `aside`, of earlier slots."""
        steps: set[int] = set()
        outside: set[int] = set()
        stack = [slot.index]
        while stack:
            k = stack.pop()
            if k < first and k not in own:
                outside.add(k)
            elif k not in steps:
                steps.add(k)
                stack += self.inputs[k]
        if not steps:
            return TapeChange(identity, (slot.index,))
        inputs = tuple(sorted(outside))
        program = [(k, self.operations[k], self.inputs[k], self.values[k]) for k in sorted(steps)]
        last = slot.index

        def operation(*values: Any) -> Any:
            results = dict(zip(inputs, values))
            for k, step, of, value in program:
                results[k] = value if step is None else step(*[results[i] for i in of])
            return results[last]

        return TapeChange(operation, inputs)

    # --- running it again -------------------------------------------------------------------------

    def after(self, index: int) -> tuple[int, ...]:
        """The slots that depend on slot `index`, in order."""
        if index not in self._after:
            touched = {index}
            for k in range(index + 1, len(self.operations)):
                if not touched.isdisjoint(self.inputs[k]):
                    touched.add(k)
            touched.discard(index)
            self._after[index] = tuple(sorted(touched))
        return self._after[index]

    def before(self, outputs: tuple[int, ...]) -> frozenset[int]:
        """The slots that some outputs depend on, with themselves."""
        if outputs not in self._before:
            slots, stack = set(outputs), list(outputs)
            while stack:
                for k in self.inputs[stack.pop()]:
                    if k not in slots:
                        slots.add(k)
                        stack.append(k)
            self._before[outputs] = frozenset(slots)
        return self._before[outputs]

    def run(self, outputs: Sequence[int], changes: Mapping[int, TapeChange] | None = None) -> Array:
        """The outputs (n, B) with some operations changed."""
        new = self._recomputed(changes or {}, self.before(tuple(outputs)))
        return stacked([new[k] if k in new else self.values[k] for k in outputs], self.width)

    def _recomputed(
        self, changes: Mapping[int, TapeChange], needed: Iterable[int]
    ) -> dict[int, Any]:
        """The values of those slots that some operations, changed, act on, as far as they are `needed`."""
        again = set(changes).union(*map(self.after, changes)).intersection(needed)
        new: dict[int, Any] = {}
        old, operations, inputs = self.values, self.operations, self.inputs
        with np.errstate(all="ignore"):
            for k in sorted(again):
                change = changes.get(k)
                slots = inputs[k] if change is None else change.inputs
                operation = operations[k] if change is None else change.operation
                if operation is None:
                    new[k] = old[k]
                    continue
                new[k] = operation(*[new[i] if i in new else old[i] for i in slots])
        return new

    def changed(self, changes: Mapping[int, TapeChange]) -> Tape:
        """A tape on which some operations are changed."""
        new = self._recomputed(changes, range(len(self)))
        values, operations, inputs = list(self.values), list(self.operations), list(self.inputs)
        exact, varying = list(self.exact), list(self.varying)
        for k, change in changes.items():
            operations[k], inputs[k] = change.operation, change.inputs
        for k, value in new.items():
            values[k], exact[k] = value, None
            varying[k] = any(varying[i] for i in inputs[k]) if inputs[k] else np.ptp(value) > 0.0
        return replace(
            self, operations=operations, inputs=inputs, values=values, exact=exact, varying=varying,
            _known={}, _after={}, _before={},
        )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Slot:
    """A number of the user's function: behaves like a float, and notes what is done with it."""

    tape: Tape
    index: int

    @property
    def value(self) -> Any:
        """Its value at the states, (B,) or a number."""
        return self.tape.values[self.index]

    def exact(self) -> Any:
        """Its Python number; TapeError where it depends on the state."""
        number = self.tape.exact[self.index]
        if number is None:
            raise TapeError(
                "an index, a size or a count that depends on the state or on a parameter"
            )
        return number

    def __index__(self) -> int:
        number = self.exact()
        if isinstance(number, float):
            raise TapeError(f"{number} where an integer is needed")
        return int(number)

    def __bool__(self) -> bool:
        """A condition: the same at all states; else `TapeBranch` says where it holds."""
        answers = np.atleast_1d(np.asarray(self.value, dtype=bool))
        if answers.all():
            return True
        if answers.any():
            raise TapeBranch(answers)
        return False

    def __int__(self) -> int:
        return int(self.exact())

    def __round__(self, digits: int | None = None) -> Any:
        return round(self.exact(), digits)

    def __divmod__(self, other: Any) -> tuple[Any, Any]:
        return self.tape.record(np.floor_divide, self, other), self.tape.record(np.mod, self, other)

    def __format__(self, spec: str) -> str:
        number = self.tape.exact[self.index]
        return "…" if number is None else format(number, spec)

    def __str__(self) -> str:
        return format(self)

    # What NumPy's scalars have besides.
    shape: ClassVar[tuple[int, ...]] = ()
    size: ClassVar[int] = 1
    ndim: ClassVar[int] = 0

    @property
    def real(self) -> Slot:
        """Itself."""
        return self

    T = mT = real

    def item(self, *arguments: Any, **named: Any) -> Slot:
        """Itself."""
        return self

    copy = squeeze = ravel = flatten = astype = reshape = sum = evalf = item


NUMBER_TYPES = (Slot, bool, int, float, np.generic)


def _binary(operation: Operation) -> tuple[Operation, Operation]:
    def forward(self: Slot, other: Any) -> Any:
        number = isinstance(other, NUMBER_TYPES)
        return self.tape.record(operation, self, other) if number else NotImplemented

    def reflected(self: Slot, other: Any) -> Any:
        number = isinstance(other, NUMBER_TYPES)
        return self.tape.record(operation, other, self) if number else NotImplemented

    return forward, reflected


def power(base: Any, exponent: Any) -> Any:
    """A power; squares and cubes as products, which is faster and exact."""
    if isinstance(base, int) and isinstance(exponent, int) and 0 <= exponent < 64:
        return base**exponent
    if np.ndim(exponent) == 0:
        if exponent == 2:
            return base * base
        if exponent == 3:
            return base * base * base
    return np.power(base, np.asarray(exponent, dtype=float))


BINARY: dict[str, Operation] = {
    "Add": np.add, "Sub": np.subtract, "Mult": np.multiply, "Div": np.true_divide, "Pow": power,
    "Mod": np.mod, "FloorDiv": np.floor_divide,
}  # fmt: skip
"""Arithmetic, by the names of Python's syntax trees."""

for _name, _operation in zip("add sub mul truediv pow mod floordiv".split(), BINARY.values()):
    _forward, _reflected = _binary(_operation)
    setattr(Slot, f"__{_name}__", _forward)
    setattr(Slot, f"__r{_name}__", _reflected)

COMPARISONS: dict[str, Operation] = {
    "Lt": np.less, "LtE": np.less_equal, "Gt": np.greater, "GtE": np.greater_equal, "Eq": np.equal,
    "NotEq": np.not_equal,
}  # fmt: skip

for _name, _operation in zip("lt le gt ge eq ne".split(), COMPARISONS.values()):
    setattr(Slot, f"__{_name}__", _binary(_operation)[0])
for _name, _operation in (("and", np.logical_and), ("or", np.logical_or)):
    setattr(Slot, f"__{_name}__", _binary(_operation)[0])
Slot.__hash__ = object.__hash__  # type: ignore[method-assign]

ELEMENTARY: dict[str, Operation] = {
    **{
        name: getattr(np, name)
        for name in (
            "sin cos tan arcsin arccos arctan sinh cosh tanh arcsinh arccosh arctanh exp log log2 log10 "
            "log1p expm1 sqrt cbrt sign sinc floor ceil trunc conjugate positive square abs fabs absolute "
            "negative deg2rad rad2deg radians degrees arctan2 hypot maximum minimum add subtract multiply "
            "divide true_divide copysign heaviside remainder mod fmod floor_divide where less less_equal "
            "greater greater_equal equal not_equal logical_and logical_or logical_not"
        ).split()
    },
    "power": power, "pow": power, "float_power": power, "asin": np.arcsin, "acos": np.arccos,
    "atan": np.arctan, "atan2": np.arctan2, "bitwise_or": np.logical_or, "bitwise_and": np.logical_and,
}  # fmt: skip
"""Functions of numbers, by their names in NumPy and math."""

_UNARY: dict[str, Operation] = {
    "__neg__": np.negative,
    "__pos__": np.positive,
    "__abs__": np.abs,
    "__invert__": np.logical_not,
}
for _name, _operation in (*_UNARY.items(), *ELEMENTARY.items()):
    # What np.sin calls on the entries of an array of objects.
    if getattr(_operation, "nin", 1) == 1:
        setattr(Slot, _name, lambda self, *_, f=_operation: self.tape.record(f, self))
