"""Any value for any argument: an InputError that names it, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.calls.arguments import fits

ODD: list[Any] = [
    *(
        1e308,
        -1.0,
        0,
        float("nan"),
        float("inf"),
        10**400,
        -(2**63),
        True,
        None,
        "",
        "nan",
        b"1",
        1j,
    ),
    *(
        [],
        [1],
        {},
        {"a": 1},
        object(),
        np.array([]),
        np.array(1.0),
        np.array([[1, 2]]),
        np.array(["a"]),
    ),
    *(lambda x: x, Exception, "é" * 5000, "\x1b[31m"),
]
STATE_VERBS = (dc.matrices, dc.evaluate, dc.kinematics, dc.linearise, dc.classify)


def walked(call: Callable[..., Any], **given: Any) -> None:
    """Each argument in turn is each odd value."""
    for name in given:
        for value in ODD:
            try:
                call(**{**given, name: value})
            except dc.InputError as error:
                assert error.code


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("verb", STATE_VERBS, ids=lambda verb: verb.__name__)
def test_verbs_of_a_state(verb: Callable[..., Any]) -> None:
    walked(verb, model="double-pendulum", state=None)
    for value in (1e154, 1e300, -1.7e308):
        with pytest.raises(dc.InputError, match="at most 2e\\+51"):
            verb("double-pendulum", {"joint1": value})


@pytest.mark.filterwarnings("ignore")
def test_numbers_and_names() -> None:
    walked(dc.observed_order, steps=[0.1, 0.05, 0.025], values=[1.0, 0.5, 0.25], floor=0.0)
    walked(dc.rotation_matrix, axis="z", angle=1.0)
    walked(dc.rod, name="a", mass=1.0, length=1.0, along="x", start=(0, 0, 0))
    walked(dc.random_states, model="double-pendulum", count=4, seed=0, window=(0, 1))
    run = dc.simulate("double-pendulum", duration=0.02, step=0.01)
    walked(dc.residuals, model="double-pendulum", run=run, testing=None)
    walked(dc.suspicions, run=run, model=None)
    walked(dc.read_trajectory, log="no.csv", mapping=None, model=None)


def test_the_argument_is_named() -> None:
    with pytest.raises(
        dc.InputError, match=r"simulate: progress is 0\.5 \(float\), expected Callable"
    ):
        dc.simulate("double-pendulum", duration=0.1, step=0.01, progress=0.5)  # type: ignore[arg-type]
    with pytest.raises(dc.InputError, match="beyond double precision"):
        dc.rod("a", 1.0, 1e300)


def test_errors_of_a_users_function_are_its_own() -> None:
    def wrong(t: Any, q: Any, u: Any) -> Any:
        raise KeyError("mine")

    with pytest.raises(Exception, match="mine"):
        dc.check_equations("double-pendulum", wrong, count=2)


@pytest.mark.parametrize(
    ("value", "annotation", "right"),
    [
        (np.float32(1), "float", True),
        (np.array(1.0), "float | Sequence[float]", True),
        (np.zeros(3), "Sequence[float]", True),
        ({"a": 1}, "Sequence[float]", False),
        ("ab", "Sequence[str]", False),
        (iter("ab"), "Iterable[str]", True),
        (10**400, "float", True),
        (1.0, "int", False),
        ((0, 1), "tuple[float, float]", True),
        (len, "Callable[[float], None] | None", True),
        (dict, "Trajectory", False),
        (dict, "NoSuchThing", True),
    ],
)
def test_annotations(value: Any, annotation: str, *, right: bool) -> None:
    assert fits(value, annotation) is right


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("equations", dc.Equations),
        ("equations", float),
        ("constraints", np.array([])),
        ("constraints", np.zeros(3)),
    ],
)
def test_what_a_run_cannot_be_made_with(argument: str, value: Any) -> None:
    with pytest.raises(dc.InputError):
        dc.simulate("double-pendulum", duration=0.1, step=0.01, solver="ode4", **{argument: value})


@pytest.mark.parametrize("name", ["forces", "works", "integrals"])
@pytest.mark.parametrize("value", [1e-300, None, True, [], np.array([])])
def test_channels_of_a_trajectory_are_named(name: str, value: Any) -> None:
    with pytest.raises(dc.InputError, match=name):
        zero = np.zeros((1, 1))
        dc.Trajectory(t=zero[0], q=zero, u=zero, coordinates=("a",), speeds=("a",), **{name: value})


def test_errors_of_a_users_own_function_stay() -> None:
    def grows(t: float, q: Any, u: Any) -> Any:
        return u * math.exp(1000.0 + t)

    for equations in (grows, dc.Equations(grows)):
        with pytest.raises(OverflowError, match="math range error"):
            dc.simulate("double-pendulum", duration=0.1, step=0.01, equations=equations)
