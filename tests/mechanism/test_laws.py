from __future__ import annotations

import math
import operator
import subprocess
import sys
import time as clock
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given
from hypothesis import strategies as st

from deltac.errors import InputError
from deltac.mechanism import laws
from deltac.mechanism.grammar import parse
from deltac.mechanism.laws import (
    as_law,
    check_symbols,
    evaluate,
    is_smooth,
    q,
    rate,
    symbol_names,
    time,
    u,
)

WHERE = "law of joint torque 'motor'"
t, k = time(), sp.Symbol("k", real=True)

# --- Texts against Python's own reading of them ---------------------------------------------------

ROUNDING = 1e-13  # some hundred times that of doubles: SymPy may reorder the operations


class Unclear(Exception):
    """The value is not real, or rounding decides which branch is taken."""


class Ball:
    """A value to 50 digits, and how far rounding may have moved a double that stands for it."""

    def __init__(self, value: Any, radius: Any) -> None:
        self.value, self.radius = value, radius

    def _less(self, other: Any) -> bool:
        other = ball(other)
        gap = other.value - self.value
        if abs(gap) <= self.radius + other.radius:
            raise Unclear
        return bool(gap > 0)

    # A tie is unclear, so that < and <= are the same.
    __lt__ = __le__ = _less

    def __gt__(self, other: Any) -> bool:
        return ball(other)._less(self)

    __ge__ = __gt__


def ball(x: Any) -> Ball:
    return x if isinstance(x, Ball) else Ball(mpmath.mpf(x), abs(x) * ROUNDING)


def lifted(function: Any) -> Any:
    """The function on balls: each argument's radius, as the function passes it on, and its own."""

    def on_balls(*arguments: Any) -> Ball:
        balls = [ball(x) for x in arguments]
        at = [b.value for b in balls]
        value = function(*at)
        radius = abs(value) * ROUNDING
        for i, b in enumerate(balls):
            for end in (b.value - b.radius, b.value + b.radius):
                radius += abs(function(*at[:i], end, *at[i + 1 :]) - value)
        if isinstance(value, mpmath.mpc) or not radius < 1e-4 * (1 + abs(value)):
            raise Unclear
        return Ball(value, radius)

    return on_balls


for name in "add sub mul truediv pow".split():
    forward = lifted(getattr(operator, name))
    setattr(Ball, f"__{name}__", forward)
    setattr(Ball, f"__r{name}__", lambda self, other, forward=forward: forward(other, self))
Ball.__neg__ = lifted(operator.neg)
Ball.__pos__ = lambda self: self

NAMES = "sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt sign".split()
MEANING: dict[str, Any] = {name: lifted(getattr(mpmath, name)) for name in NAMES}
MEANING |= {
    name: lifted(function)
    for name, function in {"abs": abs, "Abs": abs, "min": min, "max": max}.items()
}
MEANING |= {"Min": MEANING["min"], "Max": MEANING["max"], "pi": Ball(mpmath.pi(prec=170), 1e-15)}
MEANING["atan2"] = lifted(lambda y, x: mpmath.atan2(y, x) if x or y else mpmath.nan)
MEANING["where"] = lambda condition, a, b: a if condition else b

ATOMS = ["t", "k", "q.elbow", "u.base.wx", 'q["left hip"]', "pi", "1", "2", "3", "0.5", "1e-1"]
# No parentheses around what is put together: precedence is what is tested.
FORMS = (
    ["{0} + {1}", "{0} - {1}", "{0} * {1}", "{0} / {1}", "({0} - {1})", "({0} * {1})"]
    + ["-{0}", "+{0}", "{0}**2", "{0}**-3", "{0}**0.5", "({0})**-(3/2)", "2**{0}"]
    + [f"{name}({{0}})" for name in (*NAMES, "abs", "Abs") if name != "atan2"]
    + [f"{name}({{0}}, {{1}}, 1)" for name in ("min", "max", "Min", "Max")]
    + ["atan2({0}, {1})", "where({2}, {0}, {1})", "({0} if {2} else {1})"]
)
CONDITIONS = (
    ["{0} < {1}", "{0} <= {1}", "{0} > {1}", "{0} >= {1}", "{0} < {1} <= t"]
    + ["not {0} < {1} and t > {1}", "({0} < {1} or t < {0})"]
)  # fmt: skip


@st.composite
def texts(draw: Any, depth: int = 4, forms: list[str] = FORMS) -> str:
    """A text of the grammar; a condition has no conditions inside."""
    if depth == 0 or draw(st.integers(0, depth)) == 0:
        return draw(st.sampled_from(ATOMS))
    form = draw(st.sampled_from(forms))
    parts = [draw(texts(depth - 1, forms)) if f"{{{i}}}" in form else "" for i in (0, 1)]
    if "{2}" in form:
        plain = [f for f in FORMS if "{2}" not in f]
        operands = [draw(texts(min(depth - 1, 1), plain)) for _ in (0, 1)]
        parts.append(draw(st.sampled_from(CONDITIONS)).format(*operands))
    return form.format(*parts)


values_of_symbols = st.lists(
    st.floats(-3, 3).map(lambda x: round(x, 6)), min_size=5, max_size=5
).map(tuple)


@given(text=texts(), values=values_of_symbols)
def test_a_text_means_what_python_means_by_it(text: str, values: tuple[float, ...]) -> None:
    names = ("t", "k", "q.elbow", "u.base.wx", "q.left hip")
    at = {name: ball(value) for name, value in zip(names, values, strict=True)}

    class Coordinates(SimpleNamespace):
        def __getitem__(self, name: str) -> Ball:
            return at[f"q.{name}"]

    speeds = SimpleNamespace(base=SimpleNamespace(wx=at["u.base.wx"]))
    scope = {"t": at["t"], "k": at["k"], "q": Coordinates(elbow=at["q.elbow"]), "u": speeds}
    try:
        with mpmath.workdps(50):
            expected = ball(eval(text, MEANING | scope))
    except (Unclear, ArithmeticError, ValueError, TypeError):
        assume(False)
    assume(abs(expected.value) < 1e100)
    try:
        law = parse(text, WHERE)
    except InputError as error:
        # Rightly refused: a part without a value in a branch not taken, a power of a negative
        # number, or one like t**2**2**2**2.
        reasons = ("no real value", "complex", "negative", "division by zero", "this power is too")
        assume(not any(reason in str(error) for reason in reasons))
        raise
    found = evaluate(law, dict(zip(names, values, strict=True)))
    assert abs(found - expected.value) <= expected.radius + 1e-300


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("3*sin(2*pi*t) - k*u.elbow", 3 * sp.sin(2 * sp.pi * t) - k * u("elbow")),
        ("-k*q.base.x**2", -k * q("base.x") ** 2),
        ('q["left hip"] + u["left hip"].x', q("left hip") + u("left hip.x")),
        ("1 if t < 2 else 0", sp.Piecewise((1, t < 2), (0, True))),
        (
            "where(1 > t > k or k > 2, t, k)",
            sp.Piecewise((t, sp.Gt(1, t) & (t > k) | (k > 2)), (k, True), evaluate=False),
        ),
        ("  t\n  + k", t + k),
        ("max(t, k, 1)", sp.Max(t, k, 1)),
        ("sqrt(t)", t ** sp.Rational(1, 2)),
        ("t**(1/2)", sp.sqrt(t)),
        ("where(1 < 2, t, k)", t),
        ("2**3 - 8", 0.0),
        ("2**10*t", 1024 * t),
        ("9007199254740993", 2.0**53),
        ("1e-3", 1e-3),
        ("sin(1)", math.sin(1.0)),
        ("θ + t", sp.Symbol("θ", real=True) + t),
    ],
)  # fmt: skip
def test_reading(text: str, law: Any) -> None:
    assert parse(text, WHERE) == law
    assert isinstance(law, float) == isinstance(parse(text, WHERE), float)


@pytest.mark.parametrize("at", [{"t": 1.0, "k": 2.0}, {"t": 2.0, "k": 2.0}, {"t": 2.0, "k": 1.0}])
@pytest.mark.parametrize(
    "condition",
    ["t < k", "t <= k", "t > k", "t >= k", "not t < k", "t < k or t > k", "t <= k and t >= k"]
    + ["t < k < t + 2", "1 < t <= k", "not (t > k or k > t)", "t > 1 and t > k or k > 1"],
)
def test_conditions(condition: str, at: dict[str, float]) -> None:
    law = parse(f"where({condition}, 1, 0)", WHERE)
    assert evaluate(law, at) == float(eval(condition, dict(at)))


@pytest.mark.parametrize(
    ("text", "caret", "says"),
    [
        ("3*sn(t)", 2, "unknown function 'sn'; did you mean 'sin'?"),
        ("arctan(t)", 0, "did you mean 'atan'?"),
        ("whre(t > 1, 1, 2)", 0, "did you mean 'where'?"),
        ("t + 2^3", 5, "a power is written **"),
        ("(t) ^ 2", 4, "a power is written **"),
        ("t // 2", 2, "not supported"),
        ("t % 2", 2, "not supported"),
        ("~t", 0, "not part of a law"),
        ("t @ t", 2, "not supported"),
        ("1/0", 2, "division by zero"),
        ("k + t/(k - k)", 7, "division by zero"),
        ("k*log(-1)", 2, "no real value"),
        ("t*asin(2)", 2, "no real value"),
        ("(-8)**(1/3)", 0, "no real value"),
        ("t*(-2)**t", 2, "power of a negative number"),
        ("0**-1", 0, "no real value"),
        ("t*1e999", 2, "too large"),
        ("exp(1000)", 0, "too large"),
        ("t < 1", 0, "a condition where a number is expected"),
        ("2*(t < 1)", 3, "a condition where a number is expected"),
        ("not t < 1", 0, "a condition where a number is expected"),
        ("1 if t else 2", 5, "a condition is expected here"),
        ("1 if t > 1 or k else 2", 14, "a condition is expected here"),
        ("where(t == 1, 1, 2)", 8, "compare with < <= > >="),
        ("where(t is k, 1, 2)", 8, "compare with < <= > >="),
        ("where(where(t > 1, k, 2) > 1, 1, 2)", 6, "a condition inside a condition"),
        ("where(sqrt(-1 - t**2) < 1, 1, 2)", 6, "cannot be compared"),
        ("where(t > 1, 1)", 0, "where takes a condition and two values"),
        ("sin(t, 2)", 0, "the number of arguments of sin is 2, expected 1"),
        ("atan2(t)", 0, "expected 2"),
        ("k + max(t)", 4, "expected at least 2"),
        ("sin(x=1)", 0, "plain arguments"),
        ("max(*t)", 0, "plain arguments"),
        ("True", 0, "not a real number"),
        ("None", 0, "not a real number"),
        ("1j", 0, "not a real number"),
        ("'elbow'", 0, 'quotes are for names, as in q["left hip"]'),
        ("f'{t}'", 0, "not part of a law"),
        ("q", 0, "which coordinate? write q.<coordinate>"),
        ("2*u", 2, "which speed? write u.<speed>"),
        ("sin + 1", 0, "sin is a function"),
        ("base.x", 0, "names with parts start with q or u"),
        ("t.real", 0, "names with parts start with q or u"),
        ("q[0]", 0, "names with parts start with q or u"),
        ("__import__('os')", 0, "unknown function '__import__'"),
        ("q.__class__()", 0, "only the functions of the grammar"),
        ("(lambda: 1)()", 0, "only the functions of the grammar"),
        ("lambda: 1", 0, "not part of a law"),
        ("[t]", 0, "not part of a law"),
        ("(t, k)", 0, "not part of a law"),
        ("(t := 1)", 1, "not part of a law"),
        ("[t for t in k]", 0, "not part of a law"),
        ("2t", 0, "not an expression"),
        ("(t", 0, "never closed"),
        ("t)", 1, "unmatched"),
        ("q.lambda", 2, 'q["left hip"]'),
        ("t = 1", 2, "not an expression"),
        ("t; k", 1, "not an expression"),
        ("t # seconds", 2, "no comments"),
        ("k\n# hides\n+ 1", 2, "no comments"),
        ("ü*sn(t)", 2, "unknown function"),
    ],
)
def test_refused_text(text: str, caret: int, says: str) -> None:
    with pytest.raises(InputError) as refusal:
        parse(text, WHERE)
    message = str(refusal.value)
    first, shown, pointer, *_ = message.split("\n")
    assert says in message
    assert first.startswith(f"{WHERE}: ")
    assert shown[4:] == text.replace("\n", " ")
    assert pointer == " " * (4 + caret) + "^"
    assert "a law is made of numbers, pi, t" in message


def test_a_long_text_is_shown_around_the_place() -> None:
    with pytest.raises(InputError) as refusal:
        parse("t + " * 300 + "sn(t)" + " + t" * 300, WHERE)
    _, shown, pointer, *_ = str(refusal.value).split("\n")
    assert len(shown) < 140
    assert shown[pointer.index("^") :].startswith("sn(t)")


ABUSES = {
    "tower of powers": "9**9**9",
    "taller tower": "9**9**9**9**9",
    "power of an integer": "(2*t)**(10**9)",
    "power of powers": "(((((2*t)**1000)**1000)**1000)**1000)**1000",
    "powers that meet": "(2*k)**(t + 10**10)*(2*k)**(-t)",
    "tower of exponentials": "exp(exp(exp(100)))",
    "exponentials that meet": "exp(exp(exp(t + 1e3)*exp(-t)))",
    "long integer": "9" * 3999,
    "long product": "*".join(["9007199254740992*t"] * 200),
    "long text": "+".join(["t"] * 2500),
    "deep calls": "sin(" * 60 + "t" + ")" * 60,
    "deep parentheses": "(" * 500 + "t" + ")" * 500,
    "deep minus": "-" * 3000 + "t",
    "deep parts": "q" + ".a" * 100,
    "empty": " \n ",
    "null byte": "t\0",
    "half a character": "\ud800",
}


@pytest.mark.parametrize("text", ABUSES.values(), ids=ABUSES)
def test_abuse_is_refused_at_once(text: str) -> None:
    start = clock.perf_counter()
    with pytest.raises(InputError, match="law of joint torque 'motor': "):
        parse(text, WHERE)
    assert clock.perf_counter() - start < 5.0  # without the guards: for ever


@pytest.mark.parametrize(
    "text",
    [
        "max(" + ",".join(f"t*{i} + k" for i in range(200)) + ")",
        "where(" + " and ".join(f"abs(t**2 - {i}) < max(k, {i})" for i in range(80)) + ", 1, 0)",
        "where(sin(t)*t**5 - t > 1 and t**3 - t < 2, 1, 0)",
    ],
)
def test_long_laws_are_read_without_simplification(text: str) -> None:
    start = clock.perf_counter()
    assert symbol_names(parse(text, WHERE))
    assert clock.perf_counter() - start < 5.0  # SymPy's own evaluation: many times that


# --- Numbers and SymPy expressions ----------------------------------------------------------------


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


# --- What is asked of a law -----------------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("text", "smooth"),
    [
        ("1", True),
        ("sin(t)*exp(k)/(1 + t**2) + tanh(t) - log(k)", True),
        ("sqrt(t)", True),
        ("abs(t)**2", True),  # SymPy's own: t**2
        ("1 + abs(t)", False),
        ("sqrt(t**2)", False),
        ("sign(t)", False),
        ("min(t, 1)", False),
        ("max(t, 1)", False),
        ("sin(where(t < 1, 0, t))", False),
        ("atan2(t, k)", False),
        ("atan(t/k)", True),
    ],
)
def test_is_smooth(text: str, smooth: bool) -> None:
    assert is_smooth(parse(text, WHERE)) is smooth


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
        "assert laws.is_smooth(law) and not laws.symbol_names(law) and laws.rate(law) == 0.0;"
        "laws.check_symbols(law, [], 'x'); assert laws.evaluate(law, {}) == 2.0;"
        "assert 'sympy' not in sys.modules; laws.t; assert 'sympy' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
