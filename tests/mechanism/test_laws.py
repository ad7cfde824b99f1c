"""Laws as numbers and SymPy expressions, and what is asked of a law."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import sympy as sp

from deltac.errors import InputError
from deltac.mechanism import laws
from deltac.mechanism.grammar import parse
from deltac.mechanism.laws import (
    as_law,
    check_symbols,
    evaluate,
    q,
    rate,
    symbol_names,
    time,
)

WHERE = "law of joint torque 'motor'"
t, k = time(), sp.Symbol("k", real=True)

# --- numbers and SymPy expressions ----------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [2, 2.0, np.float64(2), np.float32(2), np.int8(2), sp.Integer(2), sp.sqrt(4), sp.Float(2), "2"],
)
def test_numbers_become_floats(value: Any) -> None:
    law = as_law(value, WHERE)
    assert type(law) is float
    assert law == 2.0


def test_constants_become_floats() -> None:
    for law, value in ((sp.pi / 3, math.pi / 3), (sp.exp(1) + k - k, math.e)):
        assert type(as_law(law, WHERE)) is float
        assert as_law(law, WHERE) == pytest.approx(value, rel=3e-16)  # an ulp


def test_symbols_go_by_name() -> None:
    plain, positive = sp.Symbol("t"), sp.Symbol("k", positive=True)
    assert as_law(positive * sp.Symbol("q.elbow") + sp.sin(plain), WHERE) == k * q(
        "elbow"
    ) + sp.sin(t)
    assert as_law(sp.sqrt(plain**2), WHERE) == sp.Abs(t)
    assert laws.t == t
    assert not hasattr(laws, "tt")


def test_a_law_is_a_law() -> None:
    law = parse("where(t < 1, max(t, 2*k), abs(t))", WHERE)
    assert as_law(law, WHERE) is law


x = sp.Symbol("x")
REFUSED = {
    "nan": (math.nan, "found nan, expected a finite number"),
    "infinity": (np.inf, "found inf"),
    "too large": (10**400, "expected a finite number"),
    "bool": (True, "expected a number, a text or a SymPy expression"),
    "numpy bool": (np.bool_(True), "expected a number"),
    "complex": (1j, "expected a number"),
    "None": (None, "found NoneType None"),
    "list": ([1.0], "found list"),
    "Python function": (math.sin, "write the function as a SymPy expression"),
    "SymPy nan": (sp.nan, "nan is not a finite real number"),
    "SymPy infinity": (sp.oo * sp.Symbol("k", positive=True), "oo is not a finite real number"),
    "SymPy division by zero": (x + sp.zoo, "division by zero"),
    "i": (sp.I * x, "complex"),
    "hidden complex": (sp.asin(2) * x, "not a finite real number"),
    "complex root": (sp.Rational(-8) ** sp.Rational(1, 3) * x, "not a finite real number"),
    "too large for doubles": (10 ** sp.Integer(400) * x, "not a finite real number"),
    "root of a negative": (sp.sqrt(-(x**2)), "complex"),
    "derivative": (sp.Derivative(sp.Function("f")(x), x), "write u.<speed> for a rate"),
    "plain derivative": (sp.Derivative(sp.sin(x), x), "Derivative is not supported"),
    "integral": (sp.Integral(sp.sin(x), (x, 0, t)), "Integral is not supported"),
    "definite integral": (x + sp.Integral(sp.sin(t), (t, 0, 1)), "Integral is not supported"),
    "undefined function": (sp.Function("theta")(t), "function theta(t) is not defined"),
    "undefined sin": (sp.Function("sin")(t), "not defined"),
    "floor": (1 + sp.floor(x), "floor is not supported"),
    "Heaviside": (sp.Heaviside(x), "write Piecewise or where"),
    "relation": (x < 1, "expected an expression with a real value"),
    "no default": (sp.Piecewise((x, x > 0)), "add a last branch (value, True)"),
    "dummy": (sp.Dummy("t"), "not a plain symbol"),
    "imaginary symbol": (sp.Symbol("t", imaginary=True), "not declared as a real number"),
    "matrices": (sp.Symbol("A", commutative=False), "not declared as a real number"),
    "matrix": (sp.ImmutableMatrix([[x]]), "Matrix is not supported"),
    "matrix symbol": (sp.MatrixSymbol("A", 2, 2)[0, 0], "not a plain symbol"),
}


@pytest.mark.parametrize(("value", "says"), REFUSED.values(), ids=REFUSED)
def test_refused_value(value: Any, says: str) -> None:
    with pytest.raises(InputError) as refusal:
        as_law(value, WHERE)
    assert str(refusal.value).startswith(f"{WHERE}: ")
    assert says in str(refusal.value)


def test_too_deep_for_sympy() -> None:
    deep = x
    for _ in range(3000):
        deep = sp.sin(deep, evaluate=False) + 1
    with pytest.raises(InputError, match="nested too deeply"):
        as_law(deep, WHERE)


# --- what is asked of a law -----------------------------------------------------------------------


def test_symbol_names() -> None:
    assert symbol_names(1.0) == frozenset()
    assert symbol_names(parse('k*q["left hip"] + u.base.wx*t', WHERE)) == {
        "k", "q.left hip", "u.base.wx", "t",
    }  # fmt: skip


def test_check_symbols() -> None:
    law = parse("k*q.elbwo", WHERE)
    check_symbols(law, ["k", "q.elbwo"], WHERE)
    check_symbols(1.0, [], WHERE)
    with pytest.raises(InputError) as refusal:
        check_symbols(law, ["t", "k", "q.elbow"], WHERE)
    assert str(refusal.value) == (
        f"{WHERE}: unknown symbol 'q.elbwo'; did you mean 'q.elbow'?; "
        "the law may depend on k, q.elbow, t"
    )
    with pytest.raises(InputError, match="it must be a number"):
        check_symbols(law, [], WHERE)


def test_evaluate() -> None:
    law = parse("k*sin(t) + max(t, 0)", WHERE)
    assert evaluate(law, {"k": 2.0, "t": 0.5, "unused": 0.0}) == 2.0 * math.sin(0.5) + 0.5
    assert evaluate(3.0, {}) == 3.0
    with pytest.raises(InputError, match="unknown symbol 'k'"):
        evaluate(law, {"t": 0.5})
    with pytest.raises(InputError, match="no finite real value at t = -1"):
        evaluate(parse("log(t)", WHERE), {"t": -1.0})
    with pytest.raises(InputError, match="no finite real value at t = 0"):
        evaluate(parse("1/t", WHERE), {"t": 0.0})


@pytest.mark.parametrize(
    "text",
    ["3", "k", "t**3 - 2*t", "k*sin(2*pi*t)**2", "tan(pi/2 - t)", "where(t < 1, t**2, 2*t - 1)"]
    + ["abs(t - 2)", "max(t, k, 2*t - 1)", "min(t**2, 2)", "sign(t)*t", "atan2(t, 2)", "2**t"],
)
@pytest.mark.parametrize("at", [-0.7, 0.3, 1.9])
def test_rate(text: str, at: float) -> None:
    law, h = parse(text, WHERE), 1e-4
    # Central differences of order 4: their error is about h**4 times a fifth derivative of some
    # thousands, and rounding is about 1e-16/h.
    f = [evaluate(law, {"t": at + i * h, "k": 0.4}) for i in (-2, -1, 1, 2)]
    slope = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
    assert evaluate(rate(law), {"t": at, "k": 0.4}) == pytest.approx(slope, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("text", ["max(t, 0)", "min(t, 0)", "where(t < 0, 0, t)"])
def test_rate_at_a_kink_is_that_of_a_side(text: str) -> None:
    assert evaluate(rate(parse(text, WHERE)), {"t": 0.0}) in (0.0, 1.0)


def test_rate_leaves_no_impulse() -> None:
    assert rate(parse("sign(t)", WHERE)) == 0.0


def test_numbers_do_not_load_sympy() -> None:
    code = (
        "import sys, deltac.mechanism.laws as laws; law = laws.as_law(2, 'x');"
        "assert not laws.symbol_names(law) and laws.rate(law) == 0.0;"
        "laws.check_symbols(law, [], 'x'); assert laws.evaluate(law, {}) == 2.0;"
        "assert 'sympy' not in sys.modules; laws.t; assert 'sympy' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
