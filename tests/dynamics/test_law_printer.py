from __future__ import annotations

import math
import operator
import subprocess
import sys
from typing import Any

import casadi as ca
import pytest
import sympy as sp
from hypothesis import assume, given
from hypothesis import strategies as st

from deltac.dynamics.laws import to_casadi
from deltac.errors import InputError
from deltac.mechanism.expressions import FUNCTIONS
from deltac.mechanism.grammar import parse
from deltac.mechanism.laws import q, time, u

SYMBOLS = [time(), q("elbow"), u("base.wx"), sp.Symbol("k", real=True)]
t, angle, speed, k = SYMBOLS


def traced(law: Any) -> ca.Function:
    """The law as a CasADi function of all symbols."""
    values = {symbol.name: ca.SX.sym(symbol.name) for symbol in SYMBOLS}
    return ca.Function("law", list(values.values()), [to_casadi(law, values)])


def instructions(law: Any) -> list[int]:
    function = traced(law)
    return [function.instruction_id(i) for i in range(function.n_instructions())]


def at(law: Any, *point: float) -> float:
    return float(traced(law)(*point))


# Every function below maps bounded values to bounded values with slopes of a few units, so that
# the rounding of a double evaluation stays within some hundred times machine precision.
SMOOTH = [
    sp.sin,
    sp.cos,
    sp.tanh,
    sp.atan,
    lambda x: sp.tan(sp.sin(x)),
    lambda x: sp.asin(sp.tanh(x) / 2),
    lambda x: sp.acos(sp.cos(x) / 2),
    lambda x: sp.sinh(sp.sin(x)),
    lambda x: sp.cosh(sp.sin(x)),
    lambda x: sp.exp(sp.tanh(x)),
    lambda x: sp.exp(-(x**2)),
    lambda x: sp.log(2 + x**2),
    lambda x: sp.sqrt(1 + x**2),
    lambda x: (2 + sp.cos(x)) ** sp.Rational(-3, 2),
    lambda x: (2 + sp.cos(x)) ** 1.7,
    lambda x: (2 + sp.cos(x)) ** -7,
    lambda x: sp.sin(x) ** 5,
    lambda x: sp.pi * x / 3,
    lambda x: sp.E - x,
]
KINKED = [sp.Abs, sp.sign]
PAIRS = [
    lambda x, y: x + y,
    lambda x, y: x - 2 * y,
    lambda x, y: sp.sin(x) * sp.cos(y),
    lambda x, y: sp.sin(x) / (2 + sp.cos(y)),
    lambda x, y: (2 + sp.sin(x)) ** sp.cos(y),
    sp.atan2,
    sp.Max,
    sp.Min,
    lambda x, y: sp.Max(x, y, sp.Rational(1, 3), evaluate=False),
]
CONDITIONS = [
    lambda x, y: x < y,
    lambda x, y: x <= y,
    lambda x, y: (x > y) & (x >= t),
    lambda x, y: (x > y) | (y < k),
    lambda x, y: sp.Not((x > y) & (y < k)),
    lambda x, y: sp.ITE(x < y, x < k, y > t),
]

leaves = st.sampled_from([*SYMBOLS, sp.Integer(2), sp.Rational(2, 7), sp.Float(0.3), sp.pi])


def larger(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    def choice(condition: Any, x: Any, y: Any, a: Any, b: Any) -> Any:
        return sp.Piecewise((a, condition(x, y)), (b, y < 1), (a - b, True), evaluate=False)

    # Conditions compare plain symbols and numbers: SymPy is slow at rewriting others.
    return st.one_of(
        st.builds(lambda f, x: f(x), st.sampled_from(SMOOTH + KINKED), inner),
        st.builds(lambda f, x, y: f(x, y), st.sampled_from(PAIRS), inner, inner),
        st.builds(choice, st.sampled_from(CONDITIONS), leaves, leaves, inner, inner),
    )


# Not zero: SymPy has no atan2(0, 0).
numbers = st.floats(0.01, 2).map(lambda x: round(x, 5))
points = st.tuples(*[st.one_of(numbers, numbers.map(operator.neg)) for _ in SYMBOLS])


@given(law=st.recursive(leaves, larger, max_leaves=10), point=points)
def test_agrees_with_sympy(law: Any, point: tuple[float, ...]) -> None:
    assume(not law.has(sp.nan))
    here = {symbol: sp.Rational(x) for symbol, x in zip(SYMBOLS, point, strict=True)}
    # Near a jump, rounding decides on which side a double falls.
    jumps = [part.args[0] for part in law.atoms(sp.sign, sp.atan2)]
    jumps += [part.lhs - part.rhs for part in law.atoms(sp.core.relational.Relational)]
    assume(all(abs(jump.xreplace(here).evalf(30)) > 1e-9 for jump in jumps))
    expected = law.xreplace(here).evalf(30)
    assume(expected.is_real)
    assert at(law, *point) == pytest.approx(float(expected), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_of_the_grammar(name: str) -> None:
    function = FUNCTIONS[name]
    arguments = [0.3, 0.7, 0.2][: 3 if function.variadic else function.arguments]
    names = ["t", "q.elbow", "k"][: len(arguments)]
    law = parse(f"{name}({', '.join(names)})", "law")
    point = dict(zip(names, arguments, strict=True))
    found = at(law, *(point.get(symbol.name, 0.0) for symbol in SYMBOLS))
    assert found == pytest.approx(function.value(*arguments), rel=4e-16)


def test_numbers() -> None:
    for law, value in (
        (2.5, 2.5),
        (sp.Rational(1, 3), 1 / 3),
        (sp.pi, math.pi),
        (sp.E, math.e),
        (sp.S.Half, 0.5),
    ):
        assert at(law, 0, 0, 0, 0) == value


def test_the_function_sympy_makes_by_itself() -> None:
    law = parse("tan(pi/2 - t)", "law")
    assert sp.sympify(law).has(sp.cot)
    assert at(law, 0.4, 0, 0, 0) == pytest.approx(1 / math.tan(0.4), rel=4e-16)


@pytest.mark.parametrize("n", [2, 3, 5, 12, 64])
def test_integer_powers_are_products(n: int) -> None:
    for exponent in (n, -n):
        law = t**exponent
        assert ca.OP_POW not in instructions(law)
        assert ca.OP_CONSTPOW not in instructions(law)
        assert at(law, -2.0, 0, 0, 0) == (-2.0) ** exponent  # powers of two: exact
        assert at(law, 1.1, 0, 0, 0) == pytest.approx(1.1**exponent, rel=n * 2e-16)


def test_half_integer_powers_take_one_root() -> None:
    law = t ** sp.Rational(-5, 2)
    assert instructions(law).count(ca.OP_SQRT) == 1
    assert ca.OP_CONSTPOW not in instructions(law)
    assert at(law, 4.0, 0, 0, 0) == 1 / 32
    assert at(t**0.5, 9.0, 0, 0, 0) == 3.0


def test_other_powers() -> None:
    assert at(t**100, 1.1, 0, 0, 0) == pytest.approx(1.1**100, rel=1e-13)
    assert at(t**0.3, 1.1, 0, 0, 0) == pytest.approx(1.1**0.3, rel=4e-16)
    assert at(t**k, 1.1, 0, 0, 2.5) == pytest.approx(1.1**2.5, rel=4e-16)


def test_equal_parts_are_printed_once() -> None:
    part = sp.sin(t + angle)
    for law in (part * k + part**3 + sp.exp(part), part * sp.exp(part), part ** sp.exp(part)):
        assert instructions(law).count(ca.OP_SIN) == 1


def test_one_division_a_product() -> None:
    assert instructions(t / (k * angle**2)).count(ca.OP_DIV) == 1
    assert instructions(t / k).count(ca.OP_INV) == 0


def test_a_branch_that_does_not_hold_has_no_say() -> None:
    law = parse("where(t > 0, log(t), 0)", "law")
    assert at(law, -1.0, 0, 0, 0) == 0.0
    assert at(law, math.e, 0, 0, 0) == 1.0


def test_the_first_branch_that_holds_counts() -> None:
    law = parse("1 if t < 1 else 2 if t < 2 else 3 if t < 3 else 4", "law")
    assert [at(law, x, 0, 0, 0) for x in (0.5, 1.0, 2.5, 3.0)] == [1.0, 2.0, 3.0, 4.0]


def test_equalities_and_truth_values() -> None:
    law = sp.Piecewise((1, sp.Eq(t, 1)), (2, sp.Ne(t, 2)), (3, True))
    assert [at(law, x, 0, 0, 0) for x in (1.0, 1.5, 2.0)] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(("x", "y"), [(1.0, 2.0), (2.0, 2.0), (2.0, 1.0)])
def test_conditions(x: float, y: float) -> None:
    a, b = t < k, angle > speed
    for condition, holds in {
        t < k: x < y,
        t <= k: x <= y,
        t > k: x > y,
        t >= k: x >= y,
        sp.Not(a & b): not (x < y and x > y),
        a & (angle < speed): x < y and x < y,
        a | b: x < y or x > y,
        sp.ITE(t <= k, b, angle <= speed): (x > y) if x <= y else (x <= y),
        sp.ITE(t < k, angle <= speed, b): (x <= y) if x < y else (x > y),
    }.items():
        law = sp.Piecewise((1, condition), (0, True), evaluate=False)
        assert at(law, x, x, y, y) == float(holds), condition


def test_derivatives_are_exact() -> None:
    symbol = ca.SX.sym("t")
    law = to_casadi(parse("exp(-t)*sin(t**2)", "law"), {"t": symbol})
    slope = ca.Function("slope", [symbol], [ca.jacobian(law, symbol)])
    x = 0.8
    expected = math.exp(-x) * (2 * x * math.cos(x * x) - math.sin(x * x))
    assert float(slope(x)) == pytest.approx(expected, rel=1e-14)


def test_deep_laws() -> None:
    law = t
    for _ in range(150):
        law = law * angle + 1  # Horner's scheme: at 1/2, all ones give 2 - 2**-150 + 2**-150 t
    assert at(law, 1.0, 0.5, 0, 0) == 2.0


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (1 + sp.floor(t), "the function floor .* is not supported"),
        (sp.Function("f")(t), "the function f .* is not supported"),
        (sp.Derivative(sp.sin(t), t), "the function Derivative .* is not supported"),
        (sp.Piecewise((t, t > 0)), r"add a last branch \(value, True\)"),
        (sp.Symbol("q.elbwo"), "a law depends on 'q.elbwo'; did you mean 'q.elbow'?"),
        (sp.I * t, "ImaginaryUnit .* is not supported"),
        (sp.zoo * t, "ComplexInfinity .* is not supported"),
        (sp.nan, "not a finite number"),
        (sp.oo, "not a finite number"),
        (math.nan, "not a finite number"),
    ],
)
def test_refused(law: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        traced(law)


def test_numbers_do_not_load_sympy() -> None:
    code = (
        "import sys; from deltac.dynamics.laws import to_casadi; to_casadi(2.0, {});"
        "assert 'sympy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
