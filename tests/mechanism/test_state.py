"""The state at an instant: names, identity quaternions, prescribed joints, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from deltac.errors import InputError
from deltac.mechanism.bodies import box
from deltac.mechanism.joints import free, revolute, spherical
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State

BODIES = [box(name, 1, [1, 1, 1]) for name in "abc"]
JOINTS = [
    free("base", "a"),
    revolute("elbow", "a", "b"),
    revolute("drive", "b", "c", motion="A*sin(w*t)"),
]
MECHANISM = Mechanism(BODIES, JOINTS, parameters={"A": 0.5, "w": 3.0})
ARM = Mechanism(BODIES[:2], [revolute("shoulder", "ground", "a"), spherical("wrist", "a", "b")])


def test_unnamed_entries_are_zero_or_identity() -> None:
    state = MECHANISM.state()
    np.testing.assert_array_equal(state.q, [0, 0, 0, 1, 0, 0, 0, 0, 0])
    assert state.t == 0.0
    np.testing.assert_array_equal(state.u[:-1], np.zeros(7))


def test_names_of_entries_and_of_joints() -> None:
    state = MECHANISM.state(
        {"elbow": 0.3, "base.y": 2}, {"base": [1, 2, 3, 4, 5, 6], "elbow": -1}, t=0.0
    )
    np.testing.assert_array_equal(state.q[:8], [0, 2, 0, 1, 0, 0, 0, 0.3])
    np.testing.assert_array_equal(state.u[:7], [1, 2, 3, 4, 5, 6, -1])
    again = MECHANISM.state(state.q, state.u, state.t)
    np.testing.assert_array_equal(again.q, state.q)
    assert MECHANISM.state(iter(state.q)).q.tolist() == state.q.tolist()  # type: ignore[arg-type]


def test_prescribed_joints_follow_their_law() -> None:
    t = 0.4
    state = MECHANISM.state(t=t)
    assert state.q[-1] == pytest.approx(0.5 * math.sin(3 * t), rel=1e-15)
    assert state.u[-1] == pytest.approx(1.5 * math.cos(3 * t), rel=1e-15)
    MECHANISM.state({"drive": 0.5 * math.sin(3 * t)}, t=t)


def test_nearly_unit_quaternions_are_brought_to_unit_length() -> None:
    half = math.sqrt(0.5)
    state = ARM.state({"wrist": [half * 1.0002, 0, half * 1.0002, 0]})
    assert np.linalg.norm(state.q[1:]) == pytest.approx(1.0, rel=1e-15)
    np.testing.assert_allclose(state.q[1:], [half, 0, half, 0], rtol=1e-15)


def test_states_are_read_only() -> None:
    state = ARM.state()
    assert isinstance(state, State)
    with pytest.raises(ValueError, match="read-only"):
        state.q[0] = 1.0


NAN = float("nan")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ARM.state({"wrst": 1}), ["coordinate 'wrst'", "did you mean 'wrist'"]),
        (lambda: ARM.state(None, {"sholder": 1}), ["speed 'sholder'", "'shoulder'"]),
        (lambda: ARM.state([1, 2]), ["coordinates", "expected 5", "wrist.qw", "(2,)"]),
        (lambda: ARM.state(None, [1, 2]), ["speeds", "expected 4", "(2,)"]),
        (lambda: ARM.state(3.0), ["coordinates", "expected 5", "()"]),  # type: ignore[arg-type]
        (lambda: ARM.state(list("abcde")), ["coordinates", "numbers", "'a'"]),  # type: ignore[arg-type]
        (lambda: ARM.state({"shoulder": NAN}), ["'shoulder'", "nan", "finite"]),
        (lambda: ARM.state(None, {"shoulder": 1e999}), ["'shoulder'", "inf", "finite"]),
        (lambda: ARM.state({"shoulder": "up"}), ["'shoulder'", "'up'", "number"]),
        (lambda: ARM.state({"wrist": [1, 0]}), ["'wrist'", "expected 4", "[1, 0]"]),
        (lambda: ARM.state({"wrist": "abcd"}), ["'wrist'", "numbers", "'abcd'"]),
        (lambda: ARM.state({"wrist": [[1], [2, 3]]}), ["'wrist'", "numbers"]),
        (lambda: ARM.state(None, {"wrist": [1, 2]}), ["'wrist'", "expected 3"]),
        (
            lambda: ARM.state({"wrist": [1, 1, 0, 0]}),
            ["'wrist'", "length 1.41421", "unit", "Divide"],
        ),
        (lambda: ARM.state({"wrist": [0, 0, 0, 0]}), ["'wrist'", "length 0"]),
        (lambda: ARM.state(t=NAN), ["time", "nan", "seconds"]),
        (lambda: ARM.state(t="noon"), ["time", "'noon'"]),  # type: ignore[arg-type]
        (
            lambda: MECHANISM.state({"drive": 0.3}),
            ["'drive'", "prescribed", "law gives 0", "0.3", "Leave it out"],
        ),
        (lambda: MECHANISM.state(None, {"drive": 0.3}), ["'drive'", "law gives 1.5", "0.3"]),
    ],
)
def test_states_that_cannot_be(make: Callable[[], object], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        make()
    for word in words:
        assert word in str(caught.value)
