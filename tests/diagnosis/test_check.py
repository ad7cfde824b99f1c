"""Equations written by hand: right ones pass, wrong ones are told, with where and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.problems.triple_pendulum_equations import HandEquations
from tests.support.slow import repeated
from tests.systems.hand_equations import (
    CASES,
    chaplygin_sleigh,
    free_box,
    lagrange_top,
)

PENDULUM = dc.problems.load("triple-pendulum", damping=(0.01, 0.02, 0.03))
HAND = HandEquations.of(PENDULUM.mechanism.parameters)


def check(rhs: Callable[..., Any], **options: Any) -> dc.EquationCheck:
    """Of the triple pendulum's equations in absolute angles."""
    return dc.check_equations(PENDULUM, rhs, **options)


# --- right equations ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", [0, 1])
def test_right_equations_are_consistent(name: str, seed: int) -> None:
    case = CASES[name]()
    found = dc.check_equations(
        case.mechanism, case.rhs, coordinates=case.coordinates or "joint", seed=seed
    )
    assert found.verdict.kind == "consistent", found.explain()
    # Rounding of some hundred operations; the conditioning of angles near a singularity is in it.
    assert found.worst < 1e-11
    assert found.exit_code == 0
    assert found.blame == () and found.example is None
    assert not any(seen.sees for seen in found.seen)


def test_a_constraint_row_without_terms_is_no_violation() -> None:
    """A ball rolls on a turning table: nothing accelerates it upwards but rounding."""
    mechanism = dc.problems.load("ball-on-table").mechanism
    states = dc.random_states(mechanism, count=16)
    right = EquationTest(mechanism, states).acceleration
    rounded = right + 1e-17 * np.random.default_rng(0).standard_normal(right.shape)
    found = EquationTest(mechanism, states)(rounded)
    assert found.violation.max() < 1e-12


def test_equations_from_sympys_lagrangian_are_consistent() -> None:
    import sympy as sp
    from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

    mechanism = dc.problems.load("double-pendulum").mechanism
    m1, m2, l1, l2, g = (mechanism.parameters[k] for k in ("m1", "m2", "l1", "l2", "g"))
    a, b = dynamicsymbols("a b")
    t = dynamicsymbols._t
    x1, y1 = l1 * sp.sin(a), -l1 * sp.cos(a)
    x2, y2 = x1 + l2 * sp.sin(a + b), y1 - l2 * sp.cos(a + b)
    kinetic = sum(
        m * (x.diff(t) ** 2 + y.diff(t) ** 2) / 2 for m, x, y in ((m1, x1, y1), (m2, x2, y2))
    )
    method = LagrangesMethod(kinetic - g * (m1 * y1 + m2 * y2), [a, b])
    method.form_lagranges_equations()
    equations = dc.equations_from_sympy(method)
    found = dc.check_equations(mechanism, equations.rhs, coordinates="joint")
    assert found.verdict.kind == "consistent", found.explain()


def test_symbolic_equations_of_a_driven_mechanism_are_consistent() -> None:
    import sympy as sp

    mechanism = dc.problems.load("driven-pendulum").mechanism
    written = dc.symbolic_equations(mechanism)
    symbols = {s.name: s for s in written.h.free_symbols | written.M.free_symbols}
    known = {symbols[k]: v for k, v in mechanism.parameters.items() if k in symbols}
    names = [symbols.get(n, sp.Symbol(n)) for n in ("t", "q.pivot", "u.pivot")]
    M, h = (sp.lambdify(names, x.subs(known), "numpy") for x in (written.M, written.h))

    def rhs(t: float, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.linalg.solve(M(t, *q, *u), -h(t, *q, *u)).ravel()

    assert dc.check_equations(mechanism, rhs).verdict.kind == "consistent"


def test_absolute_angles_of_a_chain_are_made() -> None:
    drawn = dc.absolute_angles(PENDULUM.mechanism)
    assert drawn.coordinates == ("joint1", "joint2", "joint3")
    found = dc.check_equations(PENDULUM.mechanism, HAND.free, coordinates="absolute")
    assert found.verdict.kind == "consistent"
    driven = dc.problems.load("driven-triple-pendulum")
    assert driven.equations is not None
    found = dc.check_equations(driven.mechanism, driven.equations.rhs, coordinates="absolute")
    assert found.verdict.kind == "consistent"
    with pytest.raises(dc.InputError, match="no two hinges"):
        dc.absolute_angles(dc.problems.load("simple-pendulum").mechanism)


# --- wrong equations ------------------------------------------------------------------------------


def test_the_mistake_of_the_thesis_is_found() -> None:
    """Fig. 4.7: the weight in the second equation has the wrong sign."""
    p = dc.problems.load("triple-pendulum", mistake=True)
    assert p.equations is not None
    found = dc.check_equations(p.mechanism, p.equations)
    assert found.verdict.kind == "equation-error" and found.exit_code == 1
    (blame,) = found.blame
    assert (blame.number, blame.speed) == (2, "theta2")
    assert blame.degrees == (0,)
    assert blame.depends_on == ("q.theta2",)
    (term,) = blame.terms
    assert term.part == "gravity" and term.factor == pytest.approx(-1.0, abs=1e-9)
    # The residual is twice the term: 2 (m2 r2 + m3 l2) g sin θ2, of root mean square √2 times the moment.
    moment = (30 / 9.8 * 0.125 + 20 / 9.8 * 0.25) * 9.8
    assert blame.residual == pytest.approx(np.sqrt(2.0) * moment, rel=0.15)
    assert all(seen.sees for seen in found.seen)
    example = found.example
    assert example is not None
    assert {name for name, x in example.state.items() if x != 0.0} == {"q.theta2"}
    M, f = _at_rest(example.state["q.theta2"])
    right, wrong = np.linalg.solve(M, f), np.linalg.solve(M, -f)
    assert np.allclose(list(example.right.values()), right, rtol=1e-12)
    assert np.allclose(list(example.given.values()), wrong, rtol=1e-12)
    said = " ".join(found.explain().split())
    assert "equation 2 (theta2)" in said and "enters with the wrong sign" in said
    # The term in the model's parameters, r = l/2: −(m2 r2 + m3 l2) g sin θ2
    values = {**p.mechanism.parameters, "theta2": 0.7, "sin": np.sin}
    right = -moment * np.sin(0.7)
    assert eval(term.symbols, {"__builtins__": {}}, values) == pytest.approx(right, rel=1e-12)


def _at_rest(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """The thesis's M and f with bar 2 alone turned."""
    (a, b, c, d, e, f), right = HAND.terms(np.array([0.0, angle, 0.0]), np.zeros(3))
    return np.array([[a, b, c], [b, d, e], [c, e, f]]), np.array(right)


COEFFICIENTS = [f.name for f in fields(HandEquations) if f.name not in ("A", "w", "noise")]
ROWS = {"J1": {1}, "J2": {2}, "J3": {3}, "k21": {1, 2}, "k31": {1, 3}, "k32": {2, 3},
        "g1": {1}, "g2": {2}, "g3": {3}, "c1": {1}, "c2": {1, 2}, "c3": {2, 3}}  # fmt: skip


@pytest.mark.parametrize("factor", repeated([1.0001, -1.0], 1.0001))
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in ("J2", "c2") else pytest.mark.slow)
        for name in COEFFICIENTS
    ],
)
def test_every_coefficient_counts(name: str, factor: float) -> None:
    """One coefficient of the hand-written equations wrong: its rows are blamed, its terms named."""
    wrong = replace(HAND, **{name: factor * getattr(HAND, name)})
    found = check(wrong.free)
    assert found.verdict.kind == "equation-error", found.explain()
    assert {blame.number for blame in found.blame} == ROWS[name]
    # Every wrong term is named, with the factor in front of it, and no other.
    for blame in found.blame:
        assert 1 <= len(blame.terms) <= 2
        assert [m.factor for m in blame.terms] == pytest.approx(
            [factor] * len(blame.terms), abs=1e-6
        )
    assert found.example is not None
    assert next(seen for seen in found.seen if seen.test == "wang").sees


MISTAKES: dict[str, tuple[Callable[[Any, Any, Any], Any], tuple[int, ...], str]] = {
    # name: change of the generalized force of equation 1, degrees in the rates, words
    "gravity by cosine": (lambda t, q, u: HAND.g1 * (np.sin(q[0]) - np.cos(q[0])), (0,), "q.theta1"),
    "damper's sign": (lambda t, q, u: 2 * HAND.c1 * u[0], (1,), "'damper joint1'"),
    "rate not squared": (
        lambda t, q, u: HAND.k21 * np.sin(q[1] - q[0]) * (u[1] - u[1] ** 2), (1, 2), "u.theta2"),
    "wrong index": (
        lambda t, q, u: HAND.k31 * np.sin(q[2] - q[0]) * (u[1] ** 2 - u[2] ** 2), (2,), "u.theta3"),
    "a torque that is not there": (lambda t, q, u: 0.3 * np.sin(2.0 * t), (0,), "a function of t alone"),
    "a constant": (lambda t, q, u: 0.25 + 0.0 * q[0], (0,), "0.25"),
}  # fmt: skip


@pytest.mark.parametrize("name", repeated(MISTAKES, *[m for m in MISTAKES if m != "a constant"]))
def test_what_is_wrong_is_told(name: str) -> None:
    change, degrees, words = MISTAKES[name]

    def rhs(t: Any, q: Any, u: Any) -> Any:
        (a, b, c, d, e, f), right = HAND.terms(q, u)
        M = np.array([[a, b, c], [b, d, e], [c, e, f]])
        return np.linalg.solve(M, np.array(right) + np.array([1.0, 0.0, 0.0]) * change(t, q, u))

    found = check(rhs)
    (blame,) = found.blame
    assert (blame.number, blame.degrees) == (1, degrees)
    assert words in " ".join(str(blame).split()) or words in (blame.depends_on or ())


def test_an_error_without_work_is_invisible_to_energy_and_caught() -> None:
    """Gyroscopic terms 10 % too large do no work: ω·(ω × Iω) = 0. The momentum sees them."""
    case = free_box()

    def rhs(t: Any, q: Any, u: Any) -> Any:
        return case.rhs(t, q, u) * np.array([1, 1, 1, 1.1, 1.1, 1.1]).reshape(
            (6,) + (1,) * (u.ndim - 1)
        )

    found = dc.check_equations(case.mechanism, rhs)
    assert found.verdict.kind == "equation-error"
    assert {blame.speed for blame in found.blame} == {"flight.wx", "flight.wy", "flight.wz"}
    seen = {s.test: s.sees for s in found.seen}
    assert seen["coordinate residual"] and seen["momentum, angular x flight"]
    assert not seen["momentum, linear z flight"]
    functions = ("wang", "liu-huston", "kane-levinson-1988", "kane-levinson-1990")
    assert not any(seen[name] for name in functions)
    assert "does no work" in " ".join(found.explain().split())
    assert all(str(b.terms[0]).endswith("with the factor 1.1") for b in found.blame)


def test_a_violated_constraint_is_told() -> None:
    """The rate of the sleigh's direction left out: the accelerations leave the blade's line."""
    case = CASES["sleigh_in_joint_coordinates"]()
    right = chaplygin_sleigh().rhs

    def rhs(t: Any, q: Any, u: Any) -> Any:
        c, s = np.cos(q[2]), np.sin(q[2])
        v_dot, w_dot = right(t, q, (u[0] * c + u[1] * s, u[2]))
        return np.array([v_dot * c, v_dot * s, w_dot])

    found = dc.check_equations(case.mechanism, rhs)
    assert found.verdict.kind == "equation-error"
    assert next(s for s in found.seen if s.test == "constraint blade").sees
    assert "violate blade" in " ".join(found.explain().split())
    example = found.example
    assert example is not None
    assert {n for n, x in example.state.items() if x != 0.0} == {"u.ice.x", "u.ice.angle"}


def test_an_error_along_a_constraint_force_alone_is_told() -> None:
    """M⁻¹Gᵀμ leaves the projected residual at zero; only the constraint's own test sees it."""
    case = CASES["sleigh_in_joint_coordinates"]()
    m, inertia, a = (case.mechanism.parameters[k] for k in ("m", "I", "a"))
    M = np.diag([m, m, inertia + m * a**2])

    def rhs(t: Any, q: Any, u: Any) -> Any:
        c, s = np.cos(q[2]), np.sin(q[2])
        M[0, 2] = M[2, 0] = -m * a * s
        M[1, 2] = M[2, 1] = m * a * c
        return case.rhs(t, q, u) + np.linalg.solve(M, np.array([-s, c, 0.0]))

    found = dc.check_equations(case.mechanism, rhs)
    assert found.verdict.kind == "equation-error" and found.blame == ()
    seen = {s.test: s.sees for s in found.seen}
    assert seen["constraint blade"] and not seen["coordinate residual"]
    assert found.example is not None


def test_a_singular_map_is_no_excuse() -> None:
    case = lagrange_top()
    wrong = lambda t, q, u: case.rhs(t, q, u) * 1.001  # noqa: E731
    found = dc.check_equations(case.mechanism, wrong, coordinates=case.coordinates)
    assert found.verdict.kind == "equation-error"
    assert found.example is not None and found.example.state["q.theta"] != 0.0


@pytest.mark.slow
def test_the_same_function_in_other_coordinates_is_noticed() -> None:
    found = check(HAND.free, coordinates="joint")
    assert found.verdict.kind == "equation-error"
    (finding,) = found.verdict.findings
    assert finding.kind == "coordinates" and "absolute" in finding.what
    relative = CASES["relative_triple_pendulum"]()
    found = dc.check_equations(PENDULUM, relative.rhs)  # the problem's own map is the default
    assert "joint coordinates" in found.verdict.findings[0].what


def test_json_has_all_there_is() -> None:
    import json

    found = check(replace(HAND, g2=-HAND.g2).free)
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert told["verdict"] == "equation-error" and told["count"] == 64
    assert told["blame"][0]["terms"][0]["words"].endswith(", enters with the wrong sign")
    assert set(told["example"]["given"]) == {"theta1", "theta2", "theta3"}
    assert {"coordinate residual", "wang"} <= {entry["test"] for entry in told["seen"]}


def test_states_of_a_run_or_of_ones_own() -> None:
    relative = CASES["relative_triple_pendulum"]()
    states = dc.random_states(PENDULUM.mechanism, count=5, seed=9)
    found = dc.check_equations(PENDULUM, relative.rhs, states=states, coordinates="joint")
    assert found.verdict.kind == "consistent" and len(found.states) == 5
    with pytest.raises(dc.InputError, match="states are of joint1"):
        dc.check_equations(PENDULUM, HAND.free, states=states)

    run = dc.simulate(PENDULUM.mechanism, PENDULUM.state, duration=0.5, step=1e-2)
    found = dc.check_equations(PENDULUM, HAND.free, states=run)
    assert found.verdict.kind == "consistent"
    assert np.allclose(found.states.q, np.cumsum(run.q, axis=1).T, atol=1e-14)
