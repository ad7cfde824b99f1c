"""What `study` says: errors, confidence and reasons must be true of the numbers beside them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Study
from deltac.errors import InputError


def pendulum(steps: tuple[float, ...] = (2e-2, 1e-2, 5e-3), **options: Any) -> Study:
    problem = dc.problems.load("simple-pendulum")
    return dc.study(problem, duration=1.0, steps=steps, **{"solver": "ode4", **options})


# --- equations by hand ----------------------------------------------------------------------------


def raising(t: float, q: Any, u: Any) -> Any:
    raise ZeroDivisionError("no luck")


def raising_later(t: float, q: Any, u: Any) -> Any:
    if t > 0.5:
        raise ValueError("too late")
    return -9.81 * np.sin(q)


@pytest.mark.parametrize(
    ("rhs", "said"),
    [
        (raising, "raised ZeroDivisionError: no luck .*State: t = 0, q.pivot = -1.57"),
        (raising_later, "raised ValueError: too late .*State: t = 0.50"),
        (lambda t, q, u: q * np.nan, "not finite at the start.*nan.*State: t = 0, q.pivot"),
        (lambda t, q, u: None, "returned nothing"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_function_that_fails_is_named_with_its_state(rhs: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        pendulum(equations=rhs)
