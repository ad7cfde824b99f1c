"""A CasADi function as text of LLVM's intermediate representation: the code that is compiled for it.

The instructions are replayed on an `InstructionTape` (`lowering.lower`), which knows equal ones again.
What no output needs is left out. The tape is cut into pieces, a function each, for the time of LLVM's
passes grows faster than the length of what they look at: 50 000 instructions in pieces compile in half the
time. What one piece finds and a later one reads goes through memory, as most of it would anyway: a
processor has 32 registers.

Products and sums may be fused (`contract`), nothing else is reordered: what comes out depends on the
instructions and the kind of processor alone. Sines and cosines are written out (`lowering.sine`); other
functions are those of the C library, called for one state after the other.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import casadi

from deltac.kernels.lowering import (
    LIBRARY,
    PREFIX,
    Algebra,
    arithmetic,
    choices,
    cosine,
    lower,
    sine,
)
from deltac.kernels.simd import INSTRUCTIONS_CACHED, LINE

Function: TypeAlias = Any  # casadi.Function
Node: TypeAlias = tuple[str, tuple[Any, ...]]

PIECE = 2000
"""Instructions in a piece."""

COPIED = PIECE // 8
"""Outputs that are constants or inputs in a piece: LLVM's time grows with the square of their number."""


VECTORS_A_PIECE = 4
"""Vectors that go through a piece of code longer than `INSTRUCTIONS_CACHED` before the next one begins.

Chains of 30 and 100 joints take four fifths of the time so.
"""

LARGEST_POWER = 16
"""Whole powers up to this one are products."""


_BINARY = ("fadd", "fsub", "fmul", "fdiv")


class InstructionTape:
    """Instructions in order: a code and its operands, each the place of another one.

    Codes: ``x`` and ``p`` (inputs, by place), ``const`` (by bits), those of LLVM for arithmetic, ``select``
    with a comparison (of two numbers; the value if it holds, and if not), ``sqrt``, ``fabs``, and the names
    in `LIBRARY`. There are no logical values: a comparison is a selection between 1 and 0.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._known: dict[Node, int] = {}

    def put(self, code: str, *operands: Any) -> Value:
        """The value of an instruction: of the equal one where there is one."""
        node = (code, operands)
        place = self._known.setdefault(node, len(self.nodes))
        if place == len(self.nodes):
            self.nodes.append(node)
        return Value(self, place)

    def number(self, value: Value | float) -> Value:
        """A number as a value."""
        return value if isinstance(value, Value) else self.put("const", _bits(value))

    def call(self, code: str, *arguments: Value | float) -> Value:
        """The value of an instruction on numbers."""
        return self.put(code, *(self.number(a).place for a in arguments))

    def compare(self, how: str, a: Value | float, b: Value | float) -> Value:
        """1 where a comparison (``olt``, ``ole``, ``oeq``, ``une``) holds, else 0."""
        return self.call(f"select {how}", a, b, 1.0, 0.0)

    def select(self, condition: Value, a: Value | float, b: Value | float) -> Value:
        """`a` where the condition is not 0 (a NaN is not), else `b`."""
        code, operands = self.nodes[condition.place]
        ends = tuple(self.number(end).place for end in (1.0, 0.0))
        if code.startswith("select") and operands[2:] == ends:  # a comparison, made again
            return self.put(code, *operands[:2], self.number(a).place, self.number(b).place)
        return self.call("select une", condition, 0.0, a, b)


Operation: TypeAlias = "Callable[[Value, Value | float], Value]"


def _both_ways(code: str) -> tuple[Operation, Operation]:
    """An operation of two numbers, and the same with the operands exchanged."""
    return lambda a, b: a.tape.call(code, a, b), lambda b, a: b.tape.call(code, a, b)


class Value:
    """A number on a tape, with Python's arithmetic."""

    __slots__ = ("place", "tape")

    def __init__(self, tape: InstructionTape, place: int) -> None:
        self.tape, self.place = tape, place

    __add__, __radd__ = _both_ways("fadd")
    __sub__, __rsub__ = _both_ways("fsub")
    __mul__, __rmul__ = _both_ways("fmul")
    __truediv__, __rtruediv__ = _both_ways("fdiv")

    def __neg__(self) -> Value:
        return self.tape.call("fneg", self)

    def __pow__(self, other: Value) -> Value:
        code, operands = self.tape.nodes[other.place]
        exponent = _number(operands[0]) if code == "const" else None
        if exponent == 0.5:
            return self.tape.call("sqrt", self)
        if exponent is None or not exponent.is_integer() or abs(exponent) > LARGEST_POWER:
            return self.tape.call("pow", self, other)
        product = self.tape.number(1.0) if exponent == 0 else self
        for digit in bin(int(abs(exponent)))[3:]:
            product = product * product
            if digit == "1":
                product = product * self
        return 1.0 / product if exponent < 0 else product


def _algebra(tape: InstructionTape) -> Algebra:
    def both(a: Value, b: Value) -> Value:
        return tape.select(a, tape.compare("une", b, 0.0), 0.0)

    def either(a: Value, b: Value) -> Value:
        return tape.select(a, 1.0, tape.compare("une", b, 0.0))

    def less(a: Value | float, b: Value | float) -> Value:
        return tape.compare("olt", a, b)

    def named(name: str) -> Any:
        return lambda *arguments: tape.call(name, *arguments)

    functions = {getattr(casadi, f"OP_{f.upper()}"): named(f) for f in LIBRARY if f != "pow"}
    return Algebra(
        "machine code",
        tape.number,
        arithmetic()
        | choices(tape.select, less, lambda a, b: tape.compare("ole", a, b))
        | functions
        | {
            casadi.OP_SQRT: named("sqrt"),
            casadi.OP_FABS: named("fabs"),
            casadi.OP_SIN: lambda x: sine(x, tape.select, less),
            casadi.OP_COS: lambda x: cosine(x, tape.select, less),
            casadi.OP_HYPOT: lambda a, b: tape.call("sqrt", a * a + b * b),
            casadi.OP_EQ: lambda a, b: tape.compare("oeq", a, b),
            casadi.OP_NE: lambda a, b: tape.compare("une", a, b),
            casadi.OP_NOT: lambda a: tape.compare("oeq", a, 0.0),
            casadi.OP_AND: both,
            casadi.OP_OR: either,
        },
    )


def _bits(value: float) -> int:
    return int(struct.unpack("<Q", struct.pack("<d", value))[0])


def _number(bits: int) -> float:
    return float(struct.unpack("<d", struct.pack("<Q", bits))[0])


# --- from the tape to text -----------------------------------------------------------------------


def llvm_ir(function: Function, width: int, strided: bool = True) -> str:
    """The text of a module with three functions, `width` states at a time in the first.

    ``evaluate(x, y, p, stride, n)``: rows of x, y and p are `stride` numbers apart, or else side by side, of
    one state; n columns, a multiple of the width. ``iterate(rows, p, count, period)``: row k + 1 is made of
    row k, with the parameters of row k modulo period; unless strided, and with as many outputs as inputs.
    ``call(arrays)``: one state, x, y and p being the three pointers that lie there.

    Raises:
        InputError: an operation that is not in the tables.
    """
    tape = InstructionTape()
    inputs = [[tape.put(kind, k) for k in range(function.nnz_in(i))] for i, kind in enumerate("xp")]
    (outputs,) = lower(function, inputs, _algebra(tape))
    places = [value.place for value in outputs]
    needed = _needed(tape.nodes, places)
    cuts = [needed[k : k + PIECE] for k in range(0, len(needed), PIECE)] or [[]]
    home = {place: k for k, cut in enumerate(cuts) for place in cut}
    carried: dict[int, int] = {}  # what later pieces read: its place in the memory between them
    for place in needed:
        for operand in _read(tape.nodes[place]):
            if operand in home and home[operand] != home[place]:
                carried.setdefault(operand, len(carried))
    written: dict[int, list[int]] = {}
    for row, place in enumerate(places):
        written.setdefault(place, []).append(row)
    pieces = [_Piece(tape.nodes, width, strided, cut, home, carried, written) for cut in cuts]
    copied = [(place, row) for place, rows in written.items() if place not in home for row in rows]
    for k in range(0, len(copied), COPIED):
        pieces.append(_Piece(tape.nodes, width, strided, [], home, carried, {}))
        for place, row in copied[k : k + COPIED]:
            pieces[-1].store(place, row)
    text = [
        *(piece.text(k) for k, piece in enumerate(pieces)),
        _evaluate(
            width,
            len(pieces),
            len(carried),
            VECTORS_A_PIECE if len(needed) > INSTRUCTIONS_CACHED else 1,
        ),
    ]
    text += [_iterate(len(pieces), len(carried), len(places), function.nnz_in(1)), CALL]
    called = {tape.nodes[place][0] for place in needed} & LIBRARY.keys()
    kind = _type(width)
    text += [_lanes(name, width) for name in sorted(called)]
    text += [f"declare {kind} @llvm.{f}.{_suffix(width)}({kind})" for f in ("sqrt", "fabs")]
    text += [f"declare ptr @{PREFIX}malloc(i64)", f"declare void @{PREFIX}free(ptr)"]
    return "\n".join(text)


def _read(node: Node) -> tuple[int, ...]:
    """The places an instruction reads."""
    return () if node[0] in ("x", "p", "const") else node[1]


def _needed(nodes: Sequence[Node], outputs: Iterable[int]) -> list[int]:
    """The places of the instructions that the outputs need, in order; inputs and constants are none."""
    marks = bytearray(len(nodes))
    for place in outputs:
        marks[place] = 1
    for place in range(len(nodes) - 1, -1, -1):
        if marks[place]:
            for operand in _read(nodes[place]):
                marks[operand] = 1
    return [k for k, node in enumerate(nodes) if marks[k] and node[0] not in ("x", "p", "const")]


def _type(width: int) -> str:
    return "double" if width == 1 else f"<{width} x double>"


def _suffix(width: int) -> str:
    return "f64" if width == 1 else f"v{width}f64"


class _Piece:
    """The text of one piece, line by line."""

    def __init__(
        self,
        nodes: Sequence[Node],
        width: int,
        strided: bool,
        cut: Sequence[int],
        home: dict[int, int],
        carried: dict[int, int],
        written: dict[int, list[int]],
    ) -> None:
        self._nodes, self._width = nodes, width
        self._home, self._carried = home, carried
        self._type = _type(width)
        self._masks = "i1" if width == 1 else f"<{width} x i1>"
        self._stride = "%s" if strided else "1"
        self._names: dict[int, str] = {}
        self._lines: list[str] = []
        for place in cut:
            self._instruction(place)
            for row in written.get(place, ()):  # at once: a processor has 32 registers
                self.store(place, row)

    def _instruction(self, place: int) -> None:
        code, operands = self._nodes[place]
        kind, name, line = self._type, f"%v{place}", self._lines.append
        args = [self._operand(k) for k in operands]
        if code in _BINARY:
            line(f"{name} = {code} contract {kind} {args[0]}, {args[1]}")
        elif code == "fneg":
            line(f"{name} = fneg {kind} {args[0]}")
        elif code.startswith("select"):
            line(f"{name}c = fcmp {code.split()[1]} {kind} {args[0]}, {args[1]}")
            line(f"{name} = select {self._masks} {name}c, {kind} {args[2]}, {kind} {args[3]}")
        else:
            called = code if code in LIBRARY else f"llvm.{code}.{_suffix(self._width)}"
            line(f"{name} = call {kind} @{called}({', '.join(f'{kind} {a}' for a in args)})")
        self._names[place] = name
        if place in self._carried:
            line(f"{name}w = getelementptr {kind}, ptr %w, i64 {self._carried[place]}")
            line(f"store {kind} {name}, ptr {name}w, align {8 * self._width}")

    def _operand(self, place: int) -> str:
        """What an operand is called here; what is found elsewhere is read when it is first wanted."""
        if place in self._names:
            return self._names[place]
        code, operands = self._nodes[place]
        kind, name, line = self._type, f"%v{place}", self._lines.append
        if code == "const":
            number = f"0x{operands[0]:016X}"
            if self._width > 1:
                number = "<" + ", ".join([f"double {number}"] * self._width) + ">"
            self._names[place] = number
            return number
        if code in ("x", "p"):
            self._address(f"{name}a", code, operands[0])
            line(f"{name} = load {kind}, ptr {name}a, align 8")
        else:
            line(f"{name}a = getelementptr {kind}, ptr %w, i64 {self._carried[place]}")
            line(f"{name} = load {kind}, ptr {name}a, align {8 * self._width}")
        self._names[place] = name
        return name

    def _address(self, name: str, array: str, row: int) -> None:
        self._lines.append(f"{name}o = mul i64 {self._stride}, {row}")
        self._lines.append(f"{name} = getelementptr double, ptr %{array}, i64 {name}o")

    def store(self, place: int, row: int) -> None:
        """Write a value to a row of y."""
        value = self._operand(place)
        self._address(f"%y{row}", "y", row)
        self._lines.append(f"store {self._type} {value}, ptr %y{row}, align 8")

    def text(self, index: int) -> str:
        """The whole function, of this number."""
        arrays = ", ".join(f"ptr noalias %{name}" for name in "xypw")
        head = f"define internal void @piece{index}({arrays}, i64 %s) {{"
        return "\n".join([head, *self._lines, "ret void", "}"])


def _memory(width: int, carried: int) -> tuple[str, str]:
    """The lines that make the memory between the pieces, %w, and give it back."""
    if not carried:
        return "%w = inttoptr i64 0 to ptr", ""
    make = f"""%m = call ptr @{PREFIX}malloc(i64 {8 * width * carried + LINE})
%m0 = ptrtoint ptr %m to i64
%m1 = add i64 %m0, {LINE - 1}
%m2 = and i64 %m1, -{LINE}
%w = inttoptr i64 %m2 to ptr"""
    return make, f"call void @{PREFIX}free(ptr %m)"


def _calls(pieces: int) -> str:
    arrays = "ptr %xk, ptr %yk, ptr %pk, ptr %w, i64 %s"
    return "\n".join(f"call void @piece{k}({arrays})" for k in range(pieces))


def _evaluate(width: int, pieces: int, carried: int, block: int) -> str:
    """Piece by piece, each through a block of vectors."""
    make, give_back = _memory(width, carried * block)
    loops = "".join(_through_block(k, width, carried) for k in range(pieces))
    return f"""define void @evaluate(ptr %x, ptr %y, ptr %p, i64 %s, i64 %n) {{
entry:
{make}
br label %loop
loop:
%k = phi i64 [0, %entry], [%end, %piece{pieces}]
%full = add i64 %k, {block * width}
%inside = icmp slt i64 %full, %n
%end = select i1 %inside, i64 %full, i64 %n
br label %piece0
{loops}piece{pieces}:
%more = icmp slt i64 %end, %n
br i1 %more, label %loop, label %done
done:
{give_back}
ret void
}}"""


def _through_block(piece: int, width: int, carried: int) -> str:
    """The loop of one piece over the columns from %k to %end."""
    c, before = f"%c{piece}", f"piece{piece - 1}" if piece else "loop"
    return f"""piece{piece}:
{c} = phi i64 [%k, %{before}], [{c}n, %piece{piece}]
{c}x = getelementptr double, ptr %x, i64 {c}
{c}y = getelementptr double, ptr %y, i64 {c}
{c}p = getelementptr double, ptr %p, i64 {c}
{c}o = sub i64 {c}, %k
{c}a = mul i64 {c}o, {carried}
{c}w = getelementptr double, ptr %w, i64 {c}a
call void @piece{piece}(ptr {c}x, ptr {c}y, ptr {c}p, ptr {c}w, i64 %s)
{c}n = add i64 {c}, {width}
{c}m = icmp slt i64 {c}n, %end
br i1 {c}m, label %piece{piece}, label %piece{piece + 1}
"""


def _iterate(pieces: int, carried: int, size: int, parameters: int) -> str:
    make, give_back = _memory(1, carried)
    return f"""define void @iterate(ptr %rows, ptr %p, i64 %count, i64 %period) {{
entry:
%s = add i64 0, 1
{make}
br label %loop
loop:
%k = phi i64 [0, %entry], [%next, %loop]
%turn = urem i64 %k, %period
%from = mul i64 %k, {size}
%next = add i64 %k, 1
%to = mul i64 %next, {size}
%first = mul i64 %turn, {parameters}
%xk = getelementptr double, ptr %rows, i64 %from
%yk = getelementptr double, ptr %rows, i64 %to
%pk = getelementptr double, ptr %p, i64 %first
{_calls(pieces)}
%more = icmp slt i64 %next, %count
br i1 %more, label %loop, label %done
done:
{give_back}
ret void
}}"""


CALL = """define void @call(ptr %arrays) {
%second = getelementptr ptr, ptr %arrays, i64 1
%third = getelementptr ptr, ptr %arrays, i64 2
%x = load ptr, ptr %arrays
%y = load ptr, ptr %second
%p = load ptr, ptr %third
call void @evaluate(ptr %x, ptr %y, ptr %p, i64 1, i64 1)
ret void
}"""


def _lanes(name: str, width: int) -> str:
    """A function of the C library, lane by lane."""
    count, kind = LIBRARY[name], _type(width)
    letters = "ab"[:count]
    outer = ", ".join(f"{kind} %{a}" for a in letters)
    scalars = ", ".join(["double"] * count)
    lines = [
        f"declare double @{PREFIX}{name}({scalars})",
        f"define internal {kind} @{name}({outer}) {{",
    ]
    if width == 1:
        lines.append(f"%v0 = call double @{PREFIX}{name}({outer})")
    before = "zeroinitializer"
    for k in range(width if width > 1 else 0):
        lines += [f"%{a}{k} = extractelement {kind} %{a}, i64 {k}" for a in letters]
        parameters = ", ".join(f"double %{a}{k}" for a in letters)
        lines.append(f"%f{k} = call double @{PREFIX}{name}({parameters})")
        lines.append(f"%v{k} = insertelement {kind} {before}, double %f{k}, i64 {k}")
        before = f"%v{k}"
    return "\n".join([*lines, f"ret {kind} %v{width - 1}", "}"])
