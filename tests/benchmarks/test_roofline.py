"""Instructions and bytes of code, counted by hand."""

from __future__ import annotations

import casadi as ca
import pytest
import roofline


# a·b is kept while c·d is computed of two more numbers: three at a time.
@pytest.mark.parametrize(("registers", "spilled"), [(4, 0), (3, 0), (2, 1)])
def test_a_sum_of_products(registers: int, spilled: int) -> None:
    a, b, c, d = (ca.SX.sym(name) for name in "abcd")
    found = roofline.counted(ca.Function("f", [a, b, c, d], [a * b + c * d]), registers)
    assert (found["instructions"], found["inputs"], found["outputs"]) == (3, 4, 1)
    assert (found["stores"], found["loads"]) == (spilled, spilled)


def test_a_chain_needs_few_registers() -> None:
    x = ca.SX.sym("x")
    y = x
    for _ in range(50):
        y = ca.sin(y) * x
    found = roofline.counted(ca.Function("f", [x], [y]), 2)
    assert found["instructions"] == 100 and found["stores"] == 0
