"""Sine and cosine written out in products and sums, and the walk from CasADi to other algebras.

A call of a library's sine empties the registers of vector code around it, and sine and cosine of an angle
are two calls. Written out, they share the reduction of the angle, and a step of a pendulum in an ensemble
takes two thirds of the time.

The angle is x = k π/2 + r with |r| ≤ π/4 (Cody and Waite's reduction, π/2 in three parts), the polynomials
in r are minimax ones, and the quadrant k turns the pair (cos r, sin r) by right angles. The result is
within two units in the last place where products and sums are fused (all processors with SIMD of 256 bits
and more), elsewhere within |x| ε; NaN where neighbouring numbers are a degree apart, from 8e13 on.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import casadi
import numpy as np

from deltac.arrays import EPS
from deltac.errors import FileError, InputError

Scalar: TypeAlias = Any  # a scalar of an algebra that neither reorders nor folds sums

HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
"""π/2 in three parts, each the double nearest to what is left."""

SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
"""(sin r − r)/r³ in powers of r² for |r| ≤ π/4, to 2^-58 of r (the coefficients of fdlibm's k_sin.c)."""

COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
"""(cos r − 1 + r²/2)/r⁴ in powers of r² for |r| ≤ π/4, to 2^-58 (fdlibm's k_cos.c)."""

TO_INTEGER = 1.5 * 2.0**52
"""Added to a number and taken away again it leaves the nearest integer, of two the even one."""

LARGEST_ANGLE = math.radians(1.0) / EPS
"""Angle (rad) up to which the quadrant is found: beyond it, neighbouring numbers are degrees apart."""


LIBRARY = {
    **dict.fromkeys("exp log tan asin acos atan sinh cosh tanh asinh acosh atanh".split(), 1),
    **dict.fromkeys("log1p expm1 erf".split(), 1),
    **dict.fromkeys("atan2 pow".split(), 2),
}
"""Functions of the C library that code may call, as `PREFIX` + name -> how many arguments they take."""

PREFIX = "deltac_"
"""Before the names of the C library's functions: which ones they are, is told when code is loaded."""


def sine(x: Scalar, select: Any, below: Any) -> Scalar:
    """The sine of x; `select(condition, a, b)` and `below(a, b)` are the algebra's own."""
    s, c, a, b = _turned(x, select, below)
    return a * s + b * c


def cosine(x: Scalar, select: Any, below: Any) -> Scalar:
    """The cosine of x; as `sine`, with which it shares most of its operations."""
    s, c, a, b = _turned(x, select, below)
    return a * c - b * s


def _turned(x: Scalar, select: Any, below: Any) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Sine and cosine of r; cosine and sine of k π/2."""
    k = _nearest(x * (2.0 / math.pi))
    r = x
    for part in HALF_PI:
        r = r - k * part
    z = select(below(x * x, LARGEST_ANGLE**2), r * r, math.nan)
    s = r + (r * z) * _polynomial(SINE, z)
    c = (1.0 - 0.5 * z) + (z * z) * _polynomial(COSINE, z)
    return s, c, _quarter_turns(k + 1.0), _quarter_turns(k)


def _quarter_turns(k: Scalar) -> Scalar:
    """sin(k π/2) of an integer k: 0, 1, 0, −1."""
    return k - 2.0 * _nearest(0.5 * k)


def _nearest(y: Scalar) -> Scalar:
    """The integer nearest to y, of two the even one."""
    return (y + TO_INTEGER) - TO_INTEGER


def _polynomial(coefficients: Sequence[float], z: Scalar) -> Scalar:
    value = coefficients[-1] * z + coefficients[-2]
    for coefficient in coefficients[-3::-1]:
        value = value * z + coefficient
    return value


# --- one walk over the instructions of a CasADi function -----------------------------------------
# A CasADi `SX` function is a straight line of scalar instructions on a work vector. `lower`
# replays it with the operations of another algebra; `llvm_ir` (machine code), `to_heyoka` (Taylor
# series, quad precision), `to_mpmath` (any number of digits) and `to_sympy` (equations to read) are that walk
# with four tables.
# What the tables agree on: comparisons and logical operations are numbers, 0 or 1; `if_else_zero`
# selects, so that a NaN in the branch not taken does not spread; `fmin` and `fmax` hand a NaN on
# (CasADi's own evaluator follows C and drops it).

Function: TypeAlias = Any  # casadi.Function


def simplified(function: Function) -> Function:
    """A function of expressions without common subexpressions."""
    inputs = function.sx_in()
    outputs = [casadi.cse(out) for out in function.call(inputs)]
    return casadi.Function(function.name(), inputs, outputs)


Operation: TypeAlias = Callable[..., Scalar]


@dataclass(frozen=True)
class Algebra:
    """A target of the walk: its name, its constants, and its operations by CasADi's op code."""

    name: str
    constant: Callable[[float], Scalar]
    operations: dict[int, Operation]


def to_heyoka(function: Function, arguments: Sequence[Sequence[Scalar]]) -> list[list[Scalar]]:
    """`function` on heyoka expressions: one list of arguments per input, one list per output.

    Inputs are listed by their structural nonzeros (all entries, when dense); outputs are whole
    matrices, column by column, structural zeros included.

    Raises:
        InputError: an operation heyoka cannot express, or arguments that do not fit the inputs.
    """
    return lower(function, arguments, _heyoka())


def to_sympy(function: Function, arguments: Sequence[Sequence[Scalar]]) -> list[list[Scalar]]:
    """`function` on SymPy expressions; arguments, results and errors as in `to_heyoka`."""
    return lower(function, arguments, _sympy())


def to_mpmath(function: Function, arguments: Sequence[Any]) -> list[Any]:
    """`function` of arrays in mpmath's numbers, with its current precision: an array of objects per output.

    Raises:
        InputError: as `to_heyoka`.
        ArithmeticError, ValueError, TypeError: an operation is not defined there, as mpmath tells it.
    """
    import mpmath as mp

    numbers = [[mp.mpf(float(v)) for v in np.ravel(a, order="F")] for a in arguments]
    return [np.array(out, dtype=object) for out in lower(function, numbers, _mpmath())]


def lower(
    function: Function, arguments: Sequence[Sequence[Scalar]], algebra: Algebra
) -> list[list[Scalar]]:
    """Replay the instructions of `function` (an `SX` function) in `algebra`; see `to_heyoka`."""
    _check_arguments(function, arguments)
    work: dict[int, Scalar] = {}
    nonzeros: list[dict[int, Scalar]] = [{} for _ in range(function.n_out())]
    shared, inverses = _shared_divisors(function), dict[int, Scalar]()
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        reads, writes = function.instruction_input(k), function.instruction_output(k)
        if op == casadi.OP_INPUT:
            work[writes[0]] = arguments[reads[0]][reads[1]]
        elif op == casadi.OP_OUTPUT:
            nonzeros[writes[0]][writes[1]] = work[reads[0]]
        elif op == casadi.OP_CONST:
            work[writes[0]] = algebra.constant(function.instruction_constant(k))
        elif k in shared:
            if shared[k] not in inverses:
                inverses[shared[k]] = algebra.constant(1.0) / work[reads[-1]]
            inverse = inverses[shared[k]]
            work[writes[0]] = inverse if op == casadi.OP_INV else work[reads[0]] * inverse
        elif op in algebra.operations:
            work[writes[0]] = algebra.operations[op](*(work[i] for i in reads))
        else:
            raise FileError(
                f"{function.name()}: the operation {_op_name(op)} cannot be written in "
                f"{algebra.name}; use operations that it has, or DELTAC_EVALUATOR=casadi"
            )
    return [
        _densify(function.sparsity_out(i), values, algebra.constant(0.0))
        for i, values in enumerate(nonzeros)
    ]


def _shared_divisors(function: Function) -> dict[int, int]:
    """Divisions by a number that others are divided by too -> the instruction that finds the number.

    They become products with its reciprocal: a division takes as long as ten products. (CasADi makes a
    division of x·(1/d), so that expressions cannot say it.)
    """
    writer: dict[int, int] = {}  # place in the work vector -> the instruction that wrote there last
    divided: dict[int, list[int]] = {}
    for k in range(function.n_instructions()):
        op, writes = function.instruction_id(k), function.instruction_output(k)
        if op in (casadi.OP_DIV, casadi.OP_INV):
            divided.setdefault(writer[function.instruction_input(k)[-1]], []).append(k)
        if op != casadi.OP_OUTPUT:
            writer[writes[0]] = k
    return {k: by for by, these in divided.items() if len(these) > 1 for k in these}


def _check_arguments(function: Function, arguments: Sequence[Sequence[Scalar]]) -> None:
    expected = [function.nnz_in(i) for i in range(function.n_in())]
    sizes = [len(argument) for argument in arguments]
    if sizes != expected:
        raise InputError(
            f"{function.name()}: arguments of sizes {sizes}, its inputs have sizes {expected}"
        )


def _densify(sparsity: Any, values: Mapping[int, Scalar], zero: Scalar) -> list[Scalar]:
    dense = [zero] * sparsity.numel()
    for k, place in enumerate(sparsity.find()):
        dense[place] = values[k]
    return dense


def _op_name(op: int) -> str:
    names = (n for n in dir(casadi) if n.startswith("OP_") and getattr(casadi, n) == op)
    return next(names, f"number {op}").removeprefix("OP_")


def arithmetic() -> dict[int, Operation]:
    """The operations that Python's own operators express, in whatever algebra."""
    return {
        casadi.OP_ASSIGN: lambda a: a,
        casadi.OP_ADD: lambda a, b: a + b,
        casadi.OP_SUB: lambda a, b: a - b,
        casadi.OP_MUL: lambda a, b: a * b,
        casadi.OP_DIV: lambda a, b: a / b,
        casadi.OP_NEG: lambda a: -a,
        casadi.OP_TWICE: lambda a: a + a,
        casadi.OP_SQ: lambda a: a * a,
        casadi.OP_INV: lambda a: 1.0 / a,
        casadi.OP_POW: lambda a, b: a**b,
        casadi.OP_CONSTPOW: lambda a, b: a**b,
    }


def choices(select: Operation, less: Operation, least: Operation) -> dict[int, Operation]:
    """What comparisons ``a < b`` and ``a <= b`` and `select(condition, a, b)` of an algebra express."""

    def sign(a: Scalar) -> Scalar:  # the last branch keeps 0 and NaN
        return select(less(0.0, a), 1.0, select(less(a, 0.0), -1.0, a))

    def smaller(a: Scalar, b: Scalar) -> Scalar:  # a + b is reached by a NaN only
        return select(less(a, b), a, select(least(b, a), b, a + b))

    def larger(a: Scalar, b: Scalar) -> Scalar:
        return select(less(b, a), a, select(least(a, b), b, a + b))

    return {
        casadi.OP_SIGN: sign,
        casadi.OP_FMIN: smaller,
        casadi.OP_FMAX: larger,
        casadi.OP_LT: less,
        casadi.OP_LE: least,
        casadi.OP_IF_ELSE_ZERO: lambda a, b: select(a, b, 0.0),
    }


_FUNCTIONS = """
    exp log sqrt sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh atan2 erf
""".split()


def _named_functions(module: Any) -> dict[int, Operation]:
    """The elementary functions that CasADi and `module` call by the same name."""
    return {getattr(casadi, f"OP_{f.upper()}"): getattr(module, f) for f in _FUNCTIONS}


@cache
def _heyoka() -> Algebra:
    import heyoka as hy

    return Algebra(
        "heyoka",
        hy.expression,
        arithmetic()
        | choices(hy.select, hy.lt, hy.lte)
        | _named_functions(hy)
        | {
            casadi.OP_LOG1P: hy.log1p,
            casadi.OP_EXPM1: hy.expm1,
            casadi.OP_HYPOT: lambda a, b: hy.sqrt(a * a + b * b),
            casadi.OP_FABS: lambda a: hy.select(hy.lt(a, 0.0), -a, a),
            casadi.OP_EQ: hy.eq,
            casadi.OP_NE: hy.neq,
            casadi.OP_NOT: lambda a: hy.eq(a, 0.0),
            casadi.OP_AND: lambda a, b: hy.logical_and([a, b]),
            casadi.OP_OR: lambda a, b: hy.logical_or([a, b]),
        },
    )


@cache
def _mpmath() -> Algebra:
    import mpmath as mp

    def truth(holds: Callable[..., object]) -> Operation:
        return lambda *numbers: mp.mpf(bool(holds(*numbers)))

    return Algebra(
        "mpmath",
        mp.mpf,
        arithmetic()
        | _named_functions(mp)
        | {
            casadi.OP_LOG1P: mp.log1p,
            casadi.OP_EXPM1: mp.expm1,
            casadi.OP_HYPOT: mp.hypot,
            casadi.OP_FABS: abs,
            casadi.OP_SIGN: mp.sign,
            casadi.OP_FLOOR: mp.floor,
            casadi.OP_CEIL: mp.ceil,
            casadi.OP_FMIN: min,
            casadi.OP_FMAX: max,
            casadi.OP_LT: truth(operator.lt),
            casadi.OP_LE: truth(operator.le),
            casadi.OP_EQ: truth(operator.eq),
            casadi.OP_NE: truth(operator.ne),
            casadi.OP_NOT: truth(operator.not_),
            casadi.OP_AND: truth(lambda a, b: a and b),
            casadi.OP_OR: truth(lambda a, b: a or b),
            casadi.OP_IF_ELSE_ZERO: lambda a, b: b if a else mp.mpf(0),
        },
    )


@cache
def _sympy() -> Algebra:
    import sympy as sp

    def constant(value: float) -> Scalar:
        return sp.Integer(int(value)) if value == int(value) else sp.Float(value)

    def truth(a: Scalar) -> Scalar:
        """The relation behind a 0/1 number made by `indicator`, else `a ≠ 0`."""
        if isinstance(a, sp.Piecewise) and [v for v, _ in a.args] == [1, 0]:
            return a.args[0].cond
        return sp.Ne(a, 0)

    def indicator(relation: Scalar) -> Scalar:
        return sp.Piecewise((sp.Integer(1), relation), (sp.Integer(0), True))

    def relation(kind: Any) -> Operation:
        return lambda a, b: indicator(kind(a, b))

    return Algebra(
        "SymPy",
        constant,
        arithmetic()
        | _named_functions(sp)
        | {
            casadi.OP_INV: lambda a: 1 / a,
            casadi.OP_LOG1P: lambda a: sp.log(1 + a),
            casadi.OP_EXPM1: lambda a: sp.exp(a) - 1,
            casadi.OP_HYPOT: lambda a, b: sp.sqrt(a**2 + b**2),
            casadi.OP_FABS: sp.Abs,
            casadi.OP_SIGN: sp.sign,
            casadi.OP_FMIN: sp.Min,
            casadi.OP_FMAX: sp.Max,
            casadi.OP_LT: relation(sp.Lt),
            casadi.OP_LE: relation(sp.Le),
            casadi.OP_EQ: relation(sp.Eq),
            casadi.OP_NE: relation(sp.Ne),
            casadi.OP_NOT: lambda a: indicator(sp.Not(truth(a))),
            casadi.OP_AND: lambda a, b: indicator(sp.And(truth(a), truth(b))),
            casadi.OP_OR: lambda a, b: indicator(sp.Or(truth(a), truth(b))),
            casadi.OP_IF_ELSE_ZERO: lambda a, b: sp.Piecewise((b, truth(a)), (0, True)),
        },
    )
