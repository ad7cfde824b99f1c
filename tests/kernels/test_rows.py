"""Expressions at rows: interpreted or compiled, the same to rounding; the choice is their own."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from deltac.arrays import EPS
from deltac.kernels import evaluator_name, rows
from deltac.kernels.rows import RowExpression, at_rows, compiled_rows

LONG_SUM = 30
"""Terms of an expression that is long, here: real ones take seconds to compile."""


@pytest.fixture(autouse=True)
def _hundreds_of_instructions_are_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "LONG_CODE", 600)


T = 37  # no multiple of a vector's width


def _expression(terms: int, *, often: bool) -> tuple[RowExpression, tuple[np.ndarray, ...]]:
    """Σ over `terms` of sines, among columns that are constants, inputs, or empty."""
    t, x, none = ca.SX.sym("t"), ca.SX.sym("x", 3), ca.SX(0, 1)
    wave = sum(ca.sin(x + k) * (k + 1) for k in range(terms))
    inputs = {"t": t, "x": x, "none": none}
    made = RowExpression("e", inputs, wave, ca.SX.ones(400), ca.vertcat(t, x[1], 0), often=often)
    rng = np.random.default_rng(1)
    return made, (rng.random(T), rng.random((T, 3)), np.empty((T, 0)))


@pytest.mark.parametrize(("terms", "often"), [(3, False), (3, True), (LONG_SUM, True)])
def test_both_ways_agree(terms: int, often: bool) -> None:
    expression, columns = _expression(terms, often=often)
    expected = at_rows(expression.function, columns)
    found = expression(*columns)
    with compiled_rows():
        others = expression(*columns)
    bound = 8 * EPS * terms**2  # of a sum of so many sines, weighted by up to their number
    for one in (found, others):
        for a, b in zip(one, expected, strict=True):
            assert a.shape == b.shape
            np.testing.assert_allclose(a, b, rtol=0, atol=bound)


def test_the_choice_is_the_expressions_own() -> None:
    llvm = evaluator_name() == "llvm"
    for terms, often in ((3, True), (LONG_SUM, False), (LONG_SUM, True)):
        expression, columns = _expression(terms, often=often)
        expression(*columns)
        assert ("kernel" in vars(expression)) == (llvm and often and terms > 3)
        first = expression(*columns)
        with compiled_rows():
            expression(*columns)
        for a, b in zip(first, expression(*columns), strict=True):
            np.testing.assert_array_equal(a, b)
