"""Bad input of many kinds: each is refused with a code, and the message has the word that helps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError

P = dc.problems.load("simple-pendulum")
NOTHING: Callable[..., Any] = lambda t, q, u: None  # noqa: E731


def simulate(**options: Any) -> Any:
    return dc.simulate(P.mechanism, P.state, **{"duration": 1.0, "step": 1e-2, **options})


def run() -> dc.Trajectory:
    found: dc.Trajectory = simulate(duration=0.1)
    return found


BAD: dict[str, tuple[Callable[[], Any], str, str]] = {
    "solver of MATLAB": (lambda: simulate(solver="ode45"), "E-NAME", "RK45"),
    "solver misspelt": (lambda: simulate(solver="od5"), "E-NAME", "ode5"),
    "solver no name": (lambda: simulate(solver=5), "E-TYPE", "ode5"),
    "too many rows": (lambda: simulate(step=1e-9), "E-LIMIT", "record=10,"),
    "endless": (lambda: simulate(step=1e-300), "E-SOLVER", "larger step"),
    "step does not divide": (lambda: simulate(step=0.03), "E-SOLVER", "0.0294"),
    "right-hand side a scalar": (lambda: simulate(equations=lambda t, q, u: 1.0), "E-SOURCE", "u̇"),
    "equal steps": (lambda: dc.study(P, steps=[0.1, 0.1, 0.1]), "E-VALUE", "half"),
    "negative step": (lambda: dc.study(P, steps=[0.1, -0.1]), "E-VALUE", "positive"),
    "log and model swapped": (
        lambda: dc.audit("run.csv", P.name),
        "E-ARGUMENTS",
        "the model comes",
    ),
    "no such problem": (lambda: dc.audit("pendulm", "run.csv"), "E-NAME", "pendul"),
    "no such log": (lambda: dc.audit(P, "missing.csv"), "E-FILE", "missing.csv"),
    "log of another type": (lambda: dc.audit(P, 3), "E-TYPE", "Trajectory"),  # type: ignore[arg-type]
    "model of another type": (lambda: dc.audit(3, run()), "E-TYPE", "Mechanism"),  # type: ignore[arg-type]
    "tolerance": (lambda: dc.audit(P, run(), tolerance=2.0), "E-VALUE", "between 0 and 1"),
    "channel": (lambda: dc.balance(P.mechanism, run()).work["gravty"], "E-NAME", "'gravity'"),
    "keyword": (
        lambda: dc.joints.revolute("a", "ground", "b", postion=(0, 0, 0)),  # type: ignore[call-arg]
        "E-NAME",
        "'position'",
    ),
    "coordinate": (lambda: P.mechanism.state({"pivt": 1.0}), "E-NAME", "pivot"),
    "check: scalar": (lambda: dc.check_equations(P, lambda t, q, u: 1.0), "E-SOURCE", "[value]"),
    "check: raises": (
        lambda: dc.check_equations(P, lambda t, q, u: q[7]),
        "E-SOURCE",
        "IndexError",
    ),
    "check: nothing": (lambda: dc.check_equations(P, NOTHING), "E-SOURCE", "return"),
    "no solvers": (lambda: dc.recommend(P, solvers=[]), "E-VALUE", "leave it out"),
    "solver of the search": (lambda: dc.recommend(P, solvers="ode4,od5"), "E-NAME", "ode5"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_has_a_code_and_a_remedy(case: str) -> None:
    call, code, word = BAD[case]
    with pytest.raises(InputError) as stop:
        call()
    assert stop.value.code == code, stop.value
    assert word in str(stop.value)


def test_what_people_mean_is_understood() -> None:
    """Names of solvers whatever their capitals; one solver as a text; a bare function as equations."""
    assert simulate(solver="rk45", duration=0.1).provenance.solver == "RK45"
    free = simulate(equations=lambda t, q, u: np.zeros_like(u), duration=0.1)
    assert np.ptp(free.u) == 0.0
