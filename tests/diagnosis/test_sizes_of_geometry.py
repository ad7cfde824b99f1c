"""Sizes of mistakes in the geometry, of a double pendulum whose equations are written out here.

They are nonlinear in all of them: what a tilted axis does to a planar machine grows with the square of its
angle, and to first order at the tilted model half of the angle would explain it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.explain.explain import advice
from tests.support.slow import repeated

pytestmark = pytest.mark.case_study(
    "test_the_right_model_is_right", "test_the_ratio_of_an_elastic_gear[0.05]"
)

UPPER, LOWER, LENGTH, G = 1.2, 0.8, 0.4, 9.81
CENTRES, MOMENTS = (0.2, 0.15), (0.02, 0.012)
STEP, ROWS = 0.005, 300


def rate(x: Array) -> Array:
    """Of the angles from the vertical (a, b) and their rates, by Lagrange's equations."""
    a, b, v, w = x
    (c, d), (I, J), cross = CENTRES, MOMENTS, LOWER * LENGTH * CENTRES[1]
    M = np.array(
        [
            [I + UPPER * c**2 + LOWER * LENGTH**2, cross * np.cos(a - b)],
            [cross * np.cos(a - b), J + LOWER * d**2],
        ]
    )
    forces = [
        -cross * np.sin(a - b) * w**2 - (UPPER * c + LOWER * LENGTH) * G * np.sin(a),
        cross * np.sin(a - b) * v**2 - LOWER * d * G * np.sin(b),
    ]
    return np.concatenate([[v, w], np.linalg.solve(M, forces)])


@cache
def log() -> dc.Trajectory:
    """By the classical Runge–Kutta method; the second joint's coordinate is relative."""
    rows = [np.array([1.1, 0.4, 0.0, 1.5])]
    for _ in range(ROWS):
        x = rows[-1]
        k = rate(x)
        l = rate(x + STEP / 2 * k)
        m = rate(x + STEP / 2 * l)
        n = rate(x + STEP * m)
        rows.append(x + STEP / 6 * (k + 2 * l + 2 * m + n))
    a, b, v, w = np.array(rows).T
    names = ("shoulder", "elbow")
    t = np.arange(len(a), dtype=np.float64) * STEP
    q, u = np.stack([a, b - a], axis=1), np.stack([v, w - v], axis=1)
    return dc.Trajectory(t=t, q=q, u=u, coordinates=names, speeds=names)


def mechanism(**elbow: Any) -> dc.Mechanism:
    elbow = {"axis": (0, 1, 0), "position": (0, 0, -LENGTH), **elbow}

    def bar(name: str, mass: float, k: int) -> Any:
        inertia = (1.3 * MOMENTS[k], MOMENTS[k], 0.4 * MOMENTS[k])
        return dc.body(name, mass, inertia, (0, 0, -CENTRES[k]))

    return dc.Mechanism(
        [bar("upper", UPPER, 0), bar("lower", LOWER, 1)],
        [
            dc.revolute("shoulder", "ground", "upper", (0, 1, 0)),
            dc.revolute("elbow", "upper", "lower", **elbow),
        ],
        gravity=(0, 0, -G),
    )


def tilted(angle: float) -> dc.Mechanism:
    return mechanism(axis=(np.sin(angle), np.cos(angle), 0))


Case = tuple[Callable[[], dc.Mechanism], str, str, float]
CASES: list[Case] = [
    (lambda: tilted(0.02), "joint-axis", "elbow", 0.02),
    (lambda: tilted(0.15), "joint-axis", "elbow", 0.15),
    (lambda: mechanism(position=(0, 0, -1.1 * LENGTH)), "link-length", "upper", LENGTH),
    (lambda: mechanism(position=(0, 0, -0.8 * LENGTH)), "link-length", "upper", LENGTH),
    (lambda: mechanism(position=(0.05, 0, -LENGTH)), "joint-position", "elbow", -0.05),
    (lambda: mechanism(child_position=(0, 0, 0.03)), "body-position", "elbow", 0.03),
]


# One of every kind, the larger ones.
@pytest.mark.parametrize("case", repeated(CASES, CASES[1], CASES[3], CASES[4]))
def test_sizes_are_those_of_the_true_model(case: Case) -> None:
    wrong, kind, element, size = case
    result = dc.audit(wrong(), log(), tolerance=1e-5)
    assert result.verdict.kind == "equation-error"
    explanation = result.explanation
    assert explanation is not None
    sets = (explanation.causes, *explanation.alternatives)
    assert all(len(one) == 1 for one in sets)  # there is nothing left for a second one
    named = {(one.kind, one.element): one for (one,) in sets}
    cause = named[kind, element]
    (value,), (error,) = cause.values, cause.errors
    assert abs(value) == pytest.approx(abs(size), abs=4.0 * error + 1e-9)
    assert error < (0.03 if kind == "joint-axis" else 1e-4) * abs(size)
    assert explanation.explained > 1.0 - 1e-9
    # The square of what is built in has a column of its own, of which no trial motion tells.
    inference = result.inference
    assert inference is not None
    posterior = inference.posterior
    columns = sum(len(own.columns) for own in inference.kernels)
    assert max(k for c in posterior.best.chosen for k in c.columns) >= columns
    same = replace(inference, posterior=replace(posterior, alternatives=(posterior.best,)))
    assert "equivalent" in advice(log(), same)


def test_the_right_model_is_right() -> None:
    assert dc.audit(mechanism(), log(), tolerance=1e-5).verdict.kind in (
        "consistent",
        "integration-error",
    )


@pytest.mark.parametrize("ratio", [0.05, 0.045])
def test_the_ratio_of_an_elastic_gear(ratio: float) -> None:
    """A load, a rotor and a spring between them, and the same spring of a gear of another ratio."""
    load, rotor, stiffness = 2.0, 0.02, 30.0
    model = dc.Mechanism(
        [dc.body("load", load, (0.1, 0.1, 0.1)), dc.body("rotor", rotor, (0.1, 0.1, 0.1))],
        [dc.prismatic(s, "ground", s, axis="x") for s in ("load", "rotor")],
        forces=[
            dc.forces.tendon("gear", coordinates={"load": 1.0, "rotor": -0.04}, stiffness=stiffness)
        ],
        gravity=(0, 0, 0),
    )
    along = np.array([1.0, -ratio])
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = -stiffness * np.outer(along, along) / np.array([[load], [rotor]])
    step, x = expm(0.01 * A), np.zeros((400, 4))
    x[0] = 0.1, -0.5, 0.0, 1.0
    for k in range(399):
        x[k + 1] = step @ x[k]
    names = ("load", "rotor")
    log = dc.Trajectory(
        t=0.01 * np.arange(400.0), q=x[:, :2], u=x[:, 2:], coordinates=names, speeds=names
    )
    audit = dc.audit(model, log)
    (cause,) = audit.causes
    assert (cause.kind, cause.element) == ("law-number", "tendon 'gear'")
    assert cause.values[0] == pytest.approx(-ratio, rel=1e-6)
