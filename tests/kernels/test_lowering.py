"""Every operation against NumPy and SciPy, in both evaluators and in SymPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi
import numpy as np
import pytest
import scipy.special
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from deltac.errors import InputError
from deltac.kernels import Kernel, to_heyoka, to_sympy
from deltac.kernels.lowering import Algebra, lower

EPS = np.finfo(float).eps

# (CasADi, NumPy, lower and upper end of the domain); x is the operand.
Operation = Callable[..., Any]

UNARY: dict[str, tuple[Operation, Operation, float, float]] = {
    "neg": (lambda x: -x, np.negative, -3, 3),
    "exp": (casadi.exp, np.exp, -3, 3),
    "log": (casadi.log, np.log, 0, 3),
    "sqrt": (casadi.sqrt, np.sqrt, 0, 3),
    "sq": (lambda x: x**2, np.square, -3, 3),
    "twice": (lambda x: 2 * x, lambda x: 2 * x, -3, 3),
    "inv": (lambda x: 1 / x, lambda x: 1 / x, -3, 3),
    "cube": (lambda x: x**3, lambda x: x * x * x, -3, 3),
    "inverse square": (lambda x: x**-2, lambda x: 1 / (x * x), -3, 3),
    "power 2.5": (lambda x: x**2.5, lambda x: x**2.5, 0, 3),
    "power 1.3": (lambda x: x**1.3, lambda x: x**1.3, 0, 3),
    "sin": (casadi.sin, np.sin, -3, 3),
    "cos": (casadi.cos, np.cos, -3, 3),
    "tan": (casadi.tan, np.tan, -1.5, 1.5),
    "asin": (casadi.asin, np.arcsin, -1, 1),
    "acos": (casadi.acos, np.arccos, -1, 1),
    "atan": (casadi.atan, np.arctan, -3, 3),
    "sinh": (casadi.sinh, np.sinh, -3, 3),
    "cosh": (casadi.cosh, np.cosh, -3, 3),
    "tanh": (casadi.tanh, np.tanh, -3, 3),
    "asinh": (casadi.asinh, np.arcsinh, -3, 3),
    "acosh": (casadi.acosh, np.arccosh, 1, 3),
    "atanh": (casadi.atanh, np.arctanh, -0.99, 0.99),
    "erf": (casadi.erf, scipy.special.erf, -3, 3),
    "log1p": (casadi.log1p, np.log1p, -1, 3),
    "expm1": (casadi.expm1, np.expm1, -3, 3),
    "fabs": (casadi.fabs, np.abs, -3, 3),
    "sign": (casadi.sign, np.sign, -3, 3),
    "not": (casadi.logic_not, lambda x: 1.0 * np.logical_not(x), -3, 3),
    "if_else": (
        lambda x: casadi.if_else(x > 1, x**3, -x),
        lambda x: np.where(x > 1, x**3, -x),
        -3,
        3,
    ),
    "cubic spline by Horner": (
        lambda x: casadi.if_else(x < 0, 0, casadi.if_else(x < 1, x * x * (3 - 2 * x), 1)),
        lambda x: np.where(x < 0, 0, np.where(x < 1, x * x * (3 - 2 * x), 1)),
        -3,
        3,
    ),
}

BINARY: dict[str, tuple[Operation, Operation]] = {
    "add": (lambda x, y: x + y, np.add),
    "sub": (lambda x, y: x - y, np.subtract),
    "mul": (lambda x, y: x * y, np.multiply),
    "div": (lambda x, y: x / y, np.divide),
    "pow": (lambda x, y: casadi.fabs(x) ** y, lambda x, y: np.abs(x) ** y),
    "atan2": (casadi.atan2, np.arctan2),
    "hypot": (casadi.hypot, np.hypot),
    "fmin": (casadi.fmin, np.minimum),
    "fmax": (casadi.fmax, np.maximum),
    "lt": (lambda x, y: x < y, np.less),
    "le": (lambda x, y: x <= y, np.less_equal),
    "gt": (lambda x, y: x > y, np.greater),
    "ge": (lambda x, y: x >= y, np.greater_equal),
    "eq": (casadi.eq, np.equal),
    "ne": (casadi.ne, np.not_equal),
    "and": (casadi.logic_and, np.logical_and),
    "or": (casadi.logic_or, np.logical_or),
    "if_else_zero": (lambda x, y: casadi.if_else(x, y, 0), lambda x, y: np.where(x != 0, y, 0)),
}

# Operations of the machine, correctly rounded (fmin etc. are choices): no tolerance at all.
# Library functions are within a few ulp in each library; a scalar power of heyoka's, within 4.
EXACT = {"neg", "sqrt", "sq", "twice", "inv", "fabs", "sign", "not", "add", "sub", "mul", "div"}
EXACT |= {"fmin", "fmax", "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "if_else_zero"}


def samples(low: float, high: float) -> np.ndarray:
    rng = np.random.default_rng(7)
    specials = [v for v in (0.0, 1.0, -1.0, 2.0, -0.5, low, high) if low <= v <= high]
    return np.concatenate([specials, rng.uniform(low, high, 90)])


def check(name: str, found: np.ndarray, expected: np.ndarray) -> None:
    expected = expected.astype(float)
    if name in EXACT:
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_allclose(found, expected, rtol=8 * EPS, atol=EPS)


@cache
def kernel_of_all(evaluator: str, arity: int) -> Kernel:
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    if arity == 1:
        return Kernel({"x": x}, {name: op[0](x) for name, op in UNARY.items()}).compile()
    outputs = {name: op[0](x, y) for name, op in BINARY.items()}
    return Kernel({"x": x, "y": y}, outputs).compile()


@pytest.mark.parametrize("name", UNARY)
def test_unary_operation(evaluator: str, name: str) -> None:
    kernel = kernel_of_all(evaluator, 1)
    _, reference, low, high = UNARY[name]
    x = samples(low, high)
    out = np.empty(kernel.n_out)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = reference(x)
    check(name, kernel(x=x)[name], expected)
    scalar = [kernel.single(v, out)[kernel.output_slices[name]].item() for v in x[:, None]]
    check(name, np.array(scalar), expected)


@pytest.mark.parametrize("name", BINARY)
def test_binary_operation(evaluator: str, name: str) -> None:
    kernel = kernel_of_all(evaluator, 2)
    grid = np.array([(a, b) for a in (-1.5, 0.0, 1.0, 2.0) for b in (-1.5, 0.0, 1.0, 2.0)])
    xy = np.concatenate([grid, np.random.default_rng(3).uniform(-3, 3, (80, 2))])
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = BINARY[name][1](*xy.T)
    check(name, kernel(x=xy[:, 0], y=xy[:, 1])[name], expected)


@pytest.mark.parametrize("name", [*UNARY, *BINARY])
def test_operation_in_sympy(name: str) -> None:
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    expression = UNARY[name][0](x) if name in UNARY else BINARY[name][0](x, y)
    reference = UNARY[name][1] if name in UNARY else BINARY[name][1]
    function = casadi.Function("f", [x, y], [expression])
    symbols = sympy.symbols("x y", real=True)
    ((written,),) = to_sympy(function, [symbols[:1], symbols[1:]])
    points = [(0.5, 0.75), (0.75, 0.5)]
    if name == "acosh":
        points = [(1.5, 0.5)]
    for point in points:
        value = float(written.subs(dict(zip(symbols, point, strict=True))).evalf(20))
        arguments = point[:1] if name in UNARY else point
        assert value == pytest.approx(float(reference(*map(np.float64, arguments))), rel=1e-14)


def test_branch_not_taken_does_not_spread_its_nan(evaluator: str) -> None:
    x = casadi.SX.sym("x")
    root = casadi.if_else(x > 0, casadi.sqrt(x), -casadi.log(-x))
    found = Kernel({"x": x}, {"root": root})(x=[4.0, -1.0, 9.0, -np.e])["root"]
    np.testing.assert_allclose(found, [2.0, 0.0, 3.0, -1.0], rtol=4 * EPS)


@pytest.mark.heyoka
@pytest.mark.parametrize("operation", [casadi.fmin, casadi.fmax])
def test_minimum_and_maximum_hand_a_nan_on(
    operation: Operation, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("llvmlite")
    monkeypatch.setenv("DELTAC_EVALUATOR", "llvm")
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    kernel = Kernel({"x": x, "y": y}, {"m": operation(x, y)})
    assert np.isnan(kernel(x=[np.nan, 1.0], y=[1.0, np.nan])["m"]).all()


def test_structural_zeros_are_zero(evaluator: str) -> None:
    x = casadi.SX.sym("x", 2)
    matrix = casadi.SX(3, 2)
    matrix[2, 0], matrix[0, 1] = x[0], 2 * x[1]
    found = Kernel({"x": x}, {"m": matrix, "none": casadi.SX(2, 2)})(x=[[3.0, 5.0]])
    np.testing.assert_array_equal(found["m"], [[[0, 10], [0, 0], [3, 0]]])
    np.testing.assert_array_equal(found["none"], np.zeros((1, 2, 2)))


def test_sparse_output_of_a_walk_is_the_whole_matrix() -> None:
    x = casadi.SX.sym("x")
    sparse = casadi.diag(casadi.vertcat(x, x**2))
    (found,) = to_sympy(casadi.Function("f", [x], [sparse]), [[sympy.Symbol("a")]])
    a = sympy.Symbol("a")
    assert found == [a, 0, 0, a**2]


@pytest.mark.heyoka
def test_unsupported_operation_is_named() -> None:
    hy = pytest.importorskip("heyoka")
    x = casadi.SX.sym("x")
    function = casadi.Function("drag", [x], [casadi.floor(x)])
    with pytest.raises(InputError, match="drag: the operation FLOOR cannot be written in heyoka"):
        to_heyoka(function, [[hy.expression("x")]])


def test_arguments_must_fit() -> None:
    x = casadi.SX.sym("x", 2)
    with pytest.raises(InputError, match=r"sizes \[1\], its inputs have sizes \[2\]"):
        to_sympy(casadi.Function("f", [x], [x]), [[sympy.Symbol("a")]])


# Random expressions. Each operation maps [-2, 2] into itself and at most doubles the errors of its
# operands, so that n of them in a row are off by at most 2^n times a few ulp of 2.
NODES: list[Operation] = [
    lambda a, b, c: (a + b) / 2,
    lambda a, b, c: (a - b) / 2,
    lambda a, b, c: a * b / 2,
    lambda a, b, c: casadi.sin(a),
    lambda a, b, c: casadi.cos(a + b),
    lambda a, b, c: casadi.tanh(a),
    lambda a, b, c: casadi.atan(a),
    lambda a, b, c: casadi.erf(a),
    lambda a, b, c: casadi.fabs(a),
    lambda a, b, c: casadi.fmin(a, b),
    lambda a, b, c: casadi.fmax(a, b),
    lambda a, b, c: casadi.hypot(a, b) / 2,
    lambda a, b, c: 2 / (1 + a * a),
    lambda a, b, c: casadi.sqrt(1 + a * a) / 2,
    lambda a, b, c: casadi.expm1(-casadi.fabs(a)),
    lambda a, b, c: casadi.if_else(c < 0.3, a, b),
    lambda a, b, c: casadi.if_else(casadi.logic_or(c > 1, c <= -1), a, casadi.log(3 + b) / 2),
]
DEPTH = 10


@pytest.mark.heyoka
@settings(max_examples=25, deadline=None)
@given(
    steps=st.lists(
        st.tuples(
            st.integers(0, len(NODES) - 1),
            st.integers(0, 10**6),
            st.integers(0, 10**6),
            st.integers(0, 2),
        ),
        min_size=1,
        max_size=DEPTH,
    ),
    points=st.lists(st.lists(st.floats(-2, 2), min_size=3, max_size=3), min_size=1, max_size=9),
)
def test_random_expressions_agree_with_casadi(steps: list[Any], points: list[Any]) -> None:
    pytest.importorskip("llvmlite")
    x = casadi.SX.sym("x", 3)
    nodes = [x[0], x[1], x[2]]
    for op, i, j, k in steps:
        nodes.append(NODES[op](nodes[i % len(nodes)], nodes[j % len(nodes)], x[k]))
    function = casadi.Function("f", [x, casadi.SX(0, 1)], [casadi.vertcat(*nodes)])
    batch = np.array(points).T.copy()
    found = Kernel({"x": x}, {"nodes": casadi.vertcat(*nodes)}).flat(batch)
    expected = np.array(function(batch, casadi.DM(0, 1)))
    tolerance = 2**DEPTH * 16 * EPS
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_a_divisor_of_many_is_inverted_once() -> None:
    """And of one alone not: 49/49 is 1, 49·(1/49) is not."""

    class Counted(float):
        divisions = 0

        def __truediv__(self, other: float) -> Counted:
            Counted.divisions += 1
            return Counted(float(self) / float(other))

        def __mul__(self, other: float) -> Counted:
            return Counted(float(self) * float(other))

    x, d, e = casadi.SX.sym("x", 3), casadi.SX.sym("d"), casadi.SX.sym("e")
    found = casadi.vertcat(x / d, 1 / d, x[0] / e)
    function = casadi.Function("f", [x, d, e], [found])
    operations = {
        casadi.OP_DIV: lambda a, b: a / b,
        casadi.OP_INV: lambda a: Counted(1.0) / a,
    }
    algebra = Algebra("numbers", Counted, operations)  # type: ignore[arg-type]
    ((*scaled, inverse, alone),) = lower(
        function, [[Counted(v) for v in (1.0, 2.0, 49.0)], [Counted(7.0)], [Counted(49.0)]], algebra
    )
    assert Counted.divisions == 2
    assert scaled == pytest.approx([1 / 7, 2 / 7, 7.0], rel=3e-16)
    assert inverse == 1 / 7 and alone == 1 / 49
