"""Polynomials in symbols against SymPy, which knows nothing of them."""

from __future__ import annotations

import copy
import math
import pickle
import subprocess
import sys
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from deltac.dynamics.laws import to_casadi
from deltac.errors import InputError
from deltac.mechanism.laws import as_law, at_times, evaluate, rate, with_values
from deltac.mechanism.polynomials import Polynomial

VALUES = {"a": 0.7, "b": -1.9, "q.x": 1.3}
SYMBOLS = {name: sympy.Symbol(name, real=True) for name in VALUES}

leaves = st.sampled_from([*VALUES, "2", "3", "0.5", "12"])


def _joined(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pairs = st.tuples(parts, st.sampled_from("+-*/"), parts).map(
        lambda p: f"({p[0]}){p[1]}({p[2]})"
    )
    return (
        pairs
        | st.tuples(parts, st.integers(1, 3)).map(lambda p: f"({p[0]})**{p[1]}")
        | parts.map("-({})".format)
    )


def _in_sympy(text: str) -> Any:
    """The text as SymPy evaluates it, by Python."""
    named = {"a": SYMBOLS["a"], "b": SYMBOLS["b"], "q": type("q", (), {"x": SYMBOLS["q.x"]})}
    return sympy.sympify(eval(text, {}, named))


@given(st.recursive(leaves, _joined, max_leaves=8))
def test_a_text_means_what_sympy_makes_of_it(text: str) -> None:
    try:
        expected = _in_sympy(text)
    except ZeroDivisionError:
        expected = sympy.nan
    if expected.has(sympy.zoo, sympy.nan, sympy.oo):
        with pytest.raises(InputError):
            as_law(text, "law")
        return
    law = as_law(text, "law")
    by_sympy = float(expected.xreplace({SYMBOLS[n]: sympy.Float(v) for n, v in VALUES.items()}))
    assert math.isclose(evaluate(law, VALUES), by_sympy, rel_tol=1e-9, abs_tol=1e-9)
    traced = to_casadi(law, {n: ca.SX(v) for n, v in VALUES.items()})
    assert math.isclose(float(ca.DM(traced)), by_sympy, rel_tol=1e-9, abs_tol=1e-9)
    # However it was written, equal terms have one form, which the digest of a mechanism is made of.
    again = as_law(expected, "law")
    if isinstance(law, Polynomial):
        assert again == law and repr(again) == repr(law)
        assert sympy.expand(law.expression - expected).evalf(17) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "text", ["m1", "-l1/2", "m*l**2/12", "q.hip - 2*q.knee", 'q["left hip"]', "2*t - 1", "1/m"]
)
def test_what_descriptions_are_made_of_needs_no_sympy(text: str) -> None:
    code = f"import sys; from deltac.mechanism.laws import as_law; as_law({text!r}, ''); "
    code += "print('sympy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def test_arithmetic_with_others() -> None:
    a, b = as_law("a", "law"), SYMBOLS["b"]
    assert isinstance(np.float64(2.0) * a, Polynomial)
    assert isinstance(a * np.int64(2) / 3, Polynomial)
    assert a * b == SYMBOLS["a"] * b
    assert b - a == b - SYMBOLS["a"]
    assert sympy.sin(a) == sympy.sin(SYMBOLS["a"])
    assert (a + 1) * (a - 1) == (SYMBOLS["a"] + 1) * (SYMBOLS["a"] - 1)
    assert 2**a == 2 ** SYMBOLS["a"]
    assert a - a == 0.0
    assert sympy.sympify(a).diff(SYMBOLS["a"]) == 1
    assert hash(a) == hash(SYMBOLS["a"])


def test_copies_are_equal() -> None:
    law = as_law("m*l**2/12", "law")
    assert pickle.loads(pickle.dumps(law)) == law == copy.deepcopy(law)


def test_laws_of_time() -> None:
    law = as_law("2*t**2 - w*t", "law")
    assert rate(law) == 4 * sympy.Symbol("t", real=True) - sympy.Symbol("w", real=True)
    assert rate(as_law("w*q.x", "law")) == 0.0
    part = with_values(law, {"w": 3.0})
    assert at_times(part, np.array([0.0, 2.0])).tolist() == [0.0, 2.0]


@pytest.mark.parametrize("text", ["a/0", "1/(a - a)", "1e400*a", "a**(2**2000)", "a*1e200*1e200"])
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        as_law(text, "law")


def test_a_value_that_is_not_finite_names_the_symbols() -> None:
    with pytest.raises(InputError, match="a = 0"):
        evaluate(as_law("1/a", "law"), {"a": 0.0})
