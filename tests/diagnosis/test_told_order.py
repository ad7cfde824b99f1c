"""Repairs and mutants of functions of a state vector whose order is told: it is believed, not sought."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc

ORDER = ("u.b", "a", "u.a", "b")
"""None of the usual orders, so that it cannot be found by trying."""

K = 40.0
TWO = dc.Mechanism(
    [dc.point_mass("A", 2.0), dc.point_mass("B", 3.0)],
    [dc.prismatic("a", "ground", "A", "x", stiffness=K), dc.prismatic("b", "A", "B", "y")],
    gravity=(0.0, -9.81, 0.0),
)


def right(t: float, y: Any) -> Any:
    return np.array([-9.81, y[2], -K * y[1] / 5.0, y[0]])


def wrong(t: float, y: Any) -> Any:
    return np.array([-9.81, y[2], K * y[1] / 5.0, y[0]])


def test_the_sign_is_found_in_the_order_that_is_told() -> None:
    assert dc.repair_equations(TWO, dc.Equations(right, form="ode", order=ORDER)).right
    found = dc.repair_equations(TWO, dc.Equations(wrong, form="ode", order=ORDER))
    assert not found.right and found.fixes
    assert found.fixes[0].kinds == ("sign",) and found.fixes[0].ran


def test_mutants_are_judged_in_the_order_that_is_told() -> None:
    found = dc.mutate_equations(TWO, dc.Equations(right, form="ode", order=ORDER))
    assert found.residual < 1e-9 and found.trials


def test_an_order_that_is_none() -> None:
    with pytest.raises(dc.InputError) as refused:
        dc.repair_equations(TWO, dc.Equations(right, form="ode", order=("a", "b", "u.a", "u.c")))
    assert refused.value.code == "E-NAME"
