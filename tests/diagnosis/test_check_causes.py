"""What a check says of code that it cannot read: formulas, accelerations solved by hand, whole causes.

The two-link arm is written here by hand, in Spong's angles, and every mistake is put in on purpose: what must
be said is known.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.check import whole
from deltac.diagnosis.check.matching import formula
from deltac.diagnosis.check.table import check_table
from deltac.dynamics import system

P = {"m1": 1.1, "m2": 0.93, "l1": 1.05, "c1": 0.52, "c2": 0.41, "I1": 0.083, "I2": 0.33, "g": 9.81}

ARM = dc.Mechanism(
    [
        dc.body("upper", "m1", (0.9, 0.9, "I1"), (0, "-c1", 0)),
        dc.body("lower", "m2", (0.9, 0.9, "I2"), (0, "-c2", 0)),
    ],
    [
        dc.revolute("a", "ground", "upper"),
        dc.revolute("b", "upper", "lower", position=(0, "-l1", 0)),
    ],
    gravity=(0, "-g", 0),
    parameters=P,
)


def parts(q: Any, u: Any, p: dict[str, float], small: bool = False) -> tuple[Any, Any]:
    """M and f of M u̇ = f."""
    m1, m2, l1, c1, c2, I1, I2, g = (p[n] for n in ("m1", "m2", "l1", "c1", "c2", "I1", "I2", "g"))
    sin: Callable[[Any], Any] = (lambda x: x) if small else np.sin
    c, h = np.cos(q[1]), m2 * l1 * c2 * np.sin(q[1])
    M12 = I2 + m2 * (c2**2 + l1 * c2 * c)
    M = np.array(
        [
            [I1 + I2 + m1 * c1**2 + m2 * (l1**2 + c2**2 + 2 * l1 * c2 * c), M12],
            [M12, I2 + m2 * c2**2],
        ]
    )
    lower = m2 * c2 * g * sin(q[0] + q[1])
    f1 = h * (2 * u[0] * u[1] + u[1] ** 2) - (m1 * c1 + m2 * l1) * g * sin(q[0]) - lower
    return M, np.array([f1, -h * u[0] ** 2 - lower])


def arm(t: Any, q: Any, u: Any, **changed: float) -> Any:
    return np.linalg.solve(*parts(q, u, P | changed))


def rows(term: Callable[[Any, Any], tuple[float, float]]) -> Callable[..., Any]:
    """The arm with something added to f."""

    def rhs(t: Any, q: Any, u: Any) -> Any:
        M, f = parts(q, u, P)
        return np.linalg.solve(M, f + np.array(term(q, u)))

    return rhs


def told(rhs: Callable[..., Any]) -> list[Any]:
    found = dc.check_equations(ARM, rhs)
    assert found.verdict.kind == "equation-error"
    return [match for blame in found.blame for match in (blame.solved or blame.terms)]


G1 = P["m2"] * P["l1"] * P["g"]
G2 = P["m2"] * P["c2"] * P["g"]


@pytest.mark.parametrize(
    ("term", "symbols", "formulas"),
    [
        (lambda q, u: (G1 * (1 - 1 / P["g"]) * np.sin(q[0]), 0), "-g*l1*m2*sin(a)", "1/g"),
        (lambda q, u: (G1 * (1 - P["c2"] / P["l1"]) * np.sin(q[0]), 0), "-g*l1*m2*sin(a)", "c2/l1"),
        (lambda q, u: (G1 * (1 - P["l1"]) * np.sin(q[0]), 0), "-g*l1*m2*sin(a)", "l1"),
    ],
)
def test_factors_are_formulas_in_the_models_parameters(
    term: Callable[[Any, Any], tuple[float, float]], symbols: str, formulas: str
) -> None:
    (match,) = told(rows(term))
    assert (match.symbols, match.formula) == (symbols, formulas)


def test_a_function_of_the_state_may_be_the_factor() -> None:
    """One angle for the sum of both, and a cosine forgotten in M."""
    (match,) = told(rows(lambda q, u: (0, G2 * (np.sin(q[0] + q[1]) - np.sin(q[0])))))
    assert match.ratio == "sin(a)/sin(b + a)" and match.factor == pytest.approx(1.0)


def test_one_summand_of_a_moment_of_inertia_is_named() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        M, f = parts(q, u, P)
        M[1, 1] = P["I2"]
        return np.linalg.solve(M, f)

    (match,) = told(rhs)
    assert match.symbols == "-c2**2*m2*u̇.b" and match.factor == pytest.approx(0.0, abs=1e-6)


def test_terms_are_named_in_accelerations_that_were_solved_for_by_hand() -> None:
    """Cramer's rule with a wrong sign in one numerator, and with a wrong determinant."""

    def by_hand(sign: float, denominator: float) -> Callable[..., Any]:
        def rhs(t: Any, q: Any, u: Any) -> Any:
            M, f = parts(q, u, P)
            det = M[0, 0] * M[1, 1] - denominator * M[0, 1] ** 2
            whole = M[0, 0] * M[1, 1] - M[0, 1] ** 2
            return np.array(
                [
                    (M[1, 1] * f[0] - M[0, 1] * f[1]) / det,
                    (M[0, 0] * f[1] - sign * M[0, 1] * f[0]) / whole,
                ]
            )

        return rhs

    found = dc.check_equations(ARM, by_hand(-1.0, 1.0))
    assert [blame.speed for blame in found.blame] == ["b"]
    (match,) = found.blame[0].solved
    assert match.part == "what drives equation 1 (a)" and match.factor == pytest.approx(-1.0)


STIFF = np.linalg.solve(
    parts(np.zeros(2), np.zeros(2), P)[0],
    np.array([[P["m1"] * P["c1"] * P["g"] + G1 + G2, G2], [G2, G2]]),
)


@pytest.mark.parametrize(
    ("rhs", "kind", "words"),
    [
        (lambda t, q, u: arm(t, q, u, I2=0.4), "parameter-value", "I2 = 0.4"),
        (lambda t, q, u: arm(t, q, u, c1=0.41, c2=0.52), "parameter-value", "c1 and c2"),
        (
            lambda t, q, u: arm(t, q + [np.pi, 0], u),
            "coordinates",
            "a is measured from elsewhere, π",
        ),
        pytest.param(
            lambda t, q, u: arm(t, q * [1, -1], u * [1, -1]) * [1, -1],
            "coordinates",
            "the other way",
            marks=pytest.mark.slow,
        ),
        (
            lambda t, q, u: np.degrees(arm(t, np.radians(q), np.radians(u))),
            "coordinates",
            "all coordinates are in degrees",
        ),
        pytest.param(
            lambda t, q, u: arm(t, q[::-1], u[::-1])[::-1],
            "coordinates",
            "in the order b, a",
            marks=pytest.mark.slow,
        ),
        (
            lambda t, q, u: np.array([1, 1.0]) * np.cumsum(arm(t, *unsummed(q, u))),
            "coordinates",
            "absolute",
        ),
        (
            lambda t, q, u: np.linalg.solve(*parts(q, u, P, small=True)),
            "linearised",
            "small coordinates",
        ),
        pytest.param(
            lambda t, q, u: np.linalg.solve(*parts(0 * q, 0 * u, P)) - STIFF @ q,
            "linearised",
            "linear in the state",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_causes_of_a_function_as_a_whole(rhs: Callable[..., Any], kind: str, words: str) -> None:
    found = dc.check_equations(ARM, rhs)
    causes = [f for f in found.verdict.findings if f.weight == "cause"]
    assert [f.kind for f in causes] == [kind]
    assert words in causes[0].what


def unsummed(q: Any, u: Any) -> tuple[Any, Any]:
    """Relative angles and rates from absolute ones."""
    return np.diff(q, prepend=0.0), np.diff(u, prepend=0.0)


UNNAMED = dc.Mechanism(
    [
        dc.body("upper", P["m1"], (0.9, 0.9, P["I1"]), (0, -P["c1"], 0)),
        dc.body("lower", P["m2"], (0.9, 0.9, P["I2"]), (0, -P["c2"], 0)),
    ],
    [
        dc.revolute("a", "ground", "upper"),
        dc.revolute("b", "upper", "lower", position=(0, -P["l1"], 0)),
    ],
    gravity=(0, -P["g"], 0),
)
"""The same machine, of which no number has a name."""


def damped(t: Any, q: Any, u: Any) -> Any:
    """A damper on the second joint, and a heavier lower arm."""
    M, f = parts(q, u, P | {"m2": 1.1})
    return np.linalg.solve(M, f - np.array([0.0, 0.2 * u[1]]))


@pytest.mark.parametrize(
    ("rhs", "causes"),
    [
        (lambda t, q, u: arm(t, q, u, m2=1.1), {("body-mass", "lower"): 1.1 / P["m2"]}),
        (lambda t, q, u: arm(t, q, u, I2=0.4), {("body-moments", "lower"): 0.4 / P["I2"]}),
        (lambda t, q, u: arm(t, q, u, c2=0.45), {("body-centre", "lower"): -0.04}),
        (lambda t, q, u: arm(t, q, u, g=9.9), {("gravity", "gravity"): 9.9}),
        (damped, {("missing-damper", "b"): 0.2, ("body-mass", "lower"): 1.1 / P["m2"]}),
    ],
)
def test_numbers_of_a_model_without_names_are_causes(
    rhs: Callable[..., Any], causes: dict[tuple[str, str], float]
) -> None:
    """All equations are off by many terms; the model's own numbers say it in one or two."""
    check = dc.check_equations(UNNAMED, rhs)
    told = {(f.kind, f.element): f for f in check.findings if f.weight == "cause"}
    assert told.keys() == causes.keys()
    for cause, value in causes.items():
        shown = [float(x) for x in re.findall(r"-?\d+\.\d+", told[cause].what)]
        assert shown[0] == pytest.approx(value, rel=1e-5)
    assert all(len(b.terms) < 2 or all(m.plain for m in b.terms) for b in check.blame)


def test_an_error_that_is_none_of_the_models_numbers_has_no_cause() -> None:
    """A force that is no element of any model: nothing is guessed."""

    def rhs(t: Any, q: Any, u: Any) -> Any:
        M, f = parts(q, u, P)
        return np.linalg.solve(M, f + np.array([0.3 * np.sin(3 * q[0]) * u[1], 0.1 * np.cos(q[0])]))

    check = dc.check_equations(UNNAMED, rhs)
    assert check.verdict.kind == "equation-error"
    assert not [f for f in check.findings if f.weight == "cause"]


def test_a_table_of_accelerations_has_the_same_causes(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    states = dc.write_states(UNNAMED, path, count=32)
    head, *rows = path.read_text().splitlines()
    table = [head]
    for k, row in enumerate(rows):
        udot = arm(0.0, states.q[:, k], states.u[:, k], m2=1.1)
        table.append(",".join([*row.split(",")[:5], *map(repr, map(float, udot))]))
    path.write_text("\n".join(table) + "\n")
    check = check_table(UNNAMED, path)
    assert [(f.kind, f.element) for f in check.findings] == [("body-mass", "lower")]


def test_numbers_as_formulas() -> None:
    known = {"l1": 1.2, "l2": 0.7, "g": 9.81, "m": 2.0}
    assert formula(1 / 9.81, known) == "1/g"
    assert formula(0.7 / 1.2, known, "g*l1*m*sin(a)") == "l2/l1"
    assert not formula(0.7 / 1.2, known, "g*l2*m*sin(a)")  # what it divides by is not in the term
    assert not formula(0.123456, known)
    assert not formula(1.0 + 1e-7, known)


def test_a_parameter_that_leaves_no_inertia_is_no_cause() -> None:
    """m1 exchanged with d: the mass matrix [[m1 + m2, m2], [m2, m2]] is singular in double precision."""
    model = dc.Mechanism(
        [dc.point_mass("near", "m1"), dc.point_mass("far", "m2")],
        [
            dc.prismatic("x", "ground", "near", stiffness=3.0, damping="d"),
            dc.prismatic("y", "near", "far", stiffness=5.0),
        ],
        parameters={"m1": 1.2, "m2": 0.7, "d": 1e-20},
    )

    def wrong(t: float, q: Any, u: Any) -> Any:
        first = (-3.0 * q[0] + 5.0 * np.sin(q[1])) / 1.2
        return np.array([first, -5.0 * q[1] / 0.7 - first])

    found = dc.check_equations(model, wrong)
    assert found.verdict.kind == "equation-error"
    assert "parameter-value" not in [f.kind for f in found.verdict.findings]


def test_hypotheses_about_parameters_share_one_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many parameters a mechanism has does not matter, nor how fast the machine is."""
    made: list[tuple[str, ...]] = []
    written_out = system._written_out

    def counted(mechanism: dc.Mechanism, vary: tuple[str, ...]) -> Any:
        made.append(vary)
        return written_out(mechanism, vary)

    monkeypatch.setattr(system, "_written_out", counted)
    found = dc.check_equations(replace(ARM, name="renamed"), lambda t, q, u: arm(t, q, u, I2=0.4))
    assert [f.kind for f in found.verdict.findings if f.weight == "cause"] == ["parameter-value"]
    assert len(made) == 2 and sum(map(bool, made)) == 1


def test_the_search_for_other_coordinates_is_bounded_by_calls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Right in degrees: calls in other coordinates show it, and without any it stays unknown."""

    def rhs(t: float, q: Any, u: Any) -> Any:
        return np.degrees(arm(t, np.radians(q), np.radians(u)))

    assert "coordinates" in {f.kind for f in dc.check_equations(ARM, rhs).findings}
    monkeypatch.setattr(whole, "MOST_HYPOTHESES", 0)
    assert "coordinates" not in {f.kind for f in dc.check_equations(ARM, rhs).findings}
