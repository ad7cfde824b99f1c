"""Functions that cannot be checked, or only so well: clear words, no false accusations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.problems.triple_pendulum_equations import HandEquations
from tests.support.slow import repeated

PENDULUM = dc.problems.load("triple-pendulum")
HAND = HandEquations.of(PENDULUM.mechanism.parameters)


def check(rhs: Any, **options: Any) -> dc.EquationCheck:
    return dc.check_equations(PENDULUM, rhs, **options)


def raises(t: Any, q: Any, u: Any) -> Any:
    if np.ndim(q[0]) == 0 and q[0] > 1.0:
        raise ValueError("the angle is out of range")
    return HAND.free(t, q, u)


class Remembers:
    """Gives what it was asked for before."""

    def __init__(self) -> None:
        self.last = np.zeros(3)

    def __call__(self, t: Any, q: Any, u: Any) -> Any:
        before, self.last = self.last, HAND.free(t, q, u)
        return before + 0.0 * q


NOISE = np.random.default_rng(0)

BAD: dict[str, tuple[Callable[..., Any], str]] = {
    "raises": (raises, r"raises raised ValueError: the angle is out of range \(line \d+: raise Val.*t = "),
    "too few": (lambda t, q, u: [1.0, 2.0], r"shape \(2,\), expected \(3,\): u̇ of theta1, theta2"),
    "column": (lambda t, q, u: HAND.free(t, q, u).reshape(3, 1), r"shape \(3, 1\).*flatten it"),
    "nothing": (lambda t, q, u: None, r"returned nothing; end it with a return"),
    "text": (lambda t, q, u: "abc", r"returned str 'abc', expected 3 real numbers"),
    "complex": (lambda t, q, u: HAND.free(t, q, u) * 1j, r"expected 3 real numbers"),
    "nan": (lambda t, q, u: HAND.free(t, q, u) * np.nan, r"not finite at all 64 states"),
    "random": (lambda t, q, u: HAND.free(t, q, u) + NOISE.normal(size=np.shape(q)),
               r"asked twice at one state .* a memory or a random element"),
    "memory": (Remembers(), r"asked twice at one state"),
    "arguments": (lambda a, b, c, d, e: a, r"\(a, b, c, d, e\): expected a function of"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_right_hand_side_is_told(name: str) -> None:
    rhs, words = BAD[name]
    with pytest.raises(dc.InputError, match=words):
        check(rhs)


def test_bad_options() -> None:
    with pytest.raises(dc.InputError, match="coordinates is 'polar'"):
        check(HAND.free, coordinates="polar")
    with pytest.raises(dc.InputError, match="count is 0"):
        check(HAND.free, count=0)
    with pytest.raises(dc.InputError, match="tolerance is -1"):
        check(HAND.free, tolerance=-1.0)
    with pytest.raises(dc.InputError, match="tolerance is 0"):
        check(HAND.free, tolerance=0.0)
    with pytest.raises(dc.InputError, match="expected a function"):
        check(3.0)


def test_a_mechanism_that_cannot_move_has_no_equations() -> None:
    prescribed = dc.Mechanism(
        bodies=[dc.rod("bar", 1.0, 1.0)],
        joints=[dc.revolute("pin", "ground", "bar", motion="sin(t)")],
    )
    with pytest.raises(dc.InputError, match="are prescribed or fixed"):
        dc.check_equations(prescribed, lambda t, q, u: u)


def test_values_that_are_not_finite_at_some_states() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        return HAND.free(t, q, u) * np.sqrt(q[0]) / np.sqrt(q[0])

    found = check(rhs)
    assert found.verdict.kind == "unresolved" and found.exit_code == 3
    (finding,) = found.verdict.findings
    assert finding.kind == "not-finite" and "of 64 states" in finding.what
    assert (found.states.q[0] > 0.0).all()

    wrong = replace(HAND, g1=-HAND.g1)
    found = check(lambda t, q, u: wrong.free(t, q, u) * np.sqrt(q[0]) / np.sqrt(q[0]))
    assert found.verdict.kind == "equation-error"


def test_writing_to_the_input_is_noticed() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        value = HAND.free(t, q, u)
        q[:] = 0.0
        return value

    found = check(rhs)
    assert found.verdict.kind == "consistent"
    assert [f.kind for f in found.verdict.findings] == ["writes-to-input"]


@pytest.mark.slow
def test_single_precision_is_not_called_a_mistake() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        single = HAND.free(np.float32(t), np.float32(q), np.float32(u))
        return np.asarray(single, dtype=np.float32)

    found = check(rhs)
    assert found.verdict.kind == "unresolved", found.explain()
    assert "accurate to" in found.explain()
    assert (
        1e-9 < max(found.rough.values()) < 1e-6
    )  # ε of float32 is 1.2e-7; terms add up and cancel
    wrong = replace(HAND, g2=1.001 * HAND.g2)
    single = lambda t, q, u: wrong.free(t, q, u).astype(np.float32)  # noqa: E731
    assert check(single).verdict.kind == "equation-error"


def _by_differences(step: float, hand: HandEquations = HAND) -> Callable[..., Any]:
    """Gravity by forward differences of the potential energy."""
    rest = replace(hand, g1=0.0, g2=0.0, g3=0.0)

    def rhs(t: Any, q: Any, u: Any) -> Any:
        (a, b, c, d, e, f), right = rest.terms(q, u)
        force = np.array(right)
        for k in range(3):
            moved = q + step * np.eye(3)[k]
            force[k] -= (hand.energy(moved, 0 * q) - hand.energy(q, 0 * q)) / step
        return np.linalg.solve(np.array([[a, b, c], [b, d, e], [c, e, f]]), force)

    return rhs


@pytest.mark.parametrize("step", repeated([1e-4, 1e-5, 1e-6, 1e-7, 1e-8], 1e-4, 1e-8))
def test_derivatives_by_differences_are_not_called_a_mistake(step: float) -> None:
    """Their error is of the size of the step, or of rounding divided by it."""
    found = check(_by_differences(step))
    assert found.verdict.kind in ("unresolved", "consistent"), found.explain()


@pytest.mark.parametrize("step", repeated([1e-6, 1e-7, 1e-8], 1e-7))
def test_mistakes_show_through_differences(step: float) -> None:
    wrong = _by_differences(step, replace(HAND, g2=1.01 * HAND.g2))
    assert check(wrong).verdict.kind == "equation-error"


@pytest.mark.parametrize("scale", repeated([1e-6, 1e6], 1e6))
def test_the_verdict_knows_no_units(scale: float) -> None:
    """The same machine in micrograms or gigagrams: masses alone change no acceleration."""
    weights = tuple(scale * w for w in (10.0, 30.0, 20.0))
    p = dc.problems.load("triple-pendulum", weights=weights)
    hand = HandEquations.of(p.mechanism.parameters)
    assert dc.check_equations(p, hand.free).verdict.kind == "consistent"
    assert dc.check_equations(p, HAND.free).verdict.kind == "consistent"
    wrong = replace(hand, g3=(1.0 + 1e-6) * hand.g3)
    found = dc.check_equations(p, wrong.free)
    assert [blame.number for blame in found.blame] == [3]


def test_a_motor_without_a_law_exerts_nothing() -> None:
    p = dc.problems.load("triple-pendulum", drive="torque")
    found = dc.check_equations(p.mechanism, HAND.free, coordinates="absolute")
    assert found.verdict.kind == "consistent"
    assert [f.kind for f in found.verdict.findings] == ["motor"]
