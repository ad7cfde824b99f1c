"""Mechanisms that are built anew with a cause of the geometry, against its columns there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.causes.causes import Candidate, Places, candidates, edited
from deltac.diagnosis.causes.columns import LogEquations, column_kernels
from deltac.diagnosis.causes.geometry import geometry_columns
from deltac.dynamics.equations_of_motion import equations_of_motion
from tests.diagnosis.test_geometry import samples, tree

STEP = 1e-4


def all_columns(mechanism: dc.Mechanism, run: dc.Trajectory) -> tuple[LogEquations, Array, Places]:
    """Equations at a run, the residual and all columns (T, n, 1 + P) there, and their places."""
    equations = LogEquations(mechanism, run)
    kernels = column_kernels(equations), geometry_columns(equations)
    free = mechanism.free
    assert run.udot is not None
    none = np.zeros((len(run), equations.symbols.logged.shape[0]))
    states = (run.t, run.q[:, free.q], run.u[:, free.u], run.udot[:, free.u], none, none, none)
    forces, geometry = (part(*states) for part in kernels)
    columns = kernels[0].columns + kernels[1].columns
    values = np.concatenate([forces, geometry[:, :, 1:]], axis=2)
    return equations, values, Places({column: k for k, column in enumerate(columns)})


def of_geometry(mechanism: dc.Mechanism, run: dc.Trajectory) -> list[Candidate]:
    equations, _, places = all_columns(mechanism, run)
    return [c for c in candidates(equations, list(places.of)) if c.edit is not None]


def residual(mechanism: dc.Mechanism) -> Array:
    """F_r + F*_r (T, n) of a mechanism without constraints, at the samples."""
    motion = equations_of_motion(mechanism)
    terms = [motion.terms(t, q, u) for t, q, u in zip(RUN.t, RUN.q, RUN.u)]
    assert RUN.udot is not None
    return np.array([x.force - x.bias - x.M @ a for x, a in zip(terms, RUN.udot)])


RUN = samples(tree())
CAUSES = of_geometry(tree(), RUN)


def test_all_kinds_of_causes_of_the_geometry_build_mechanisms() -> None:
    kinds = {c.kind for c in CAUSES}
    assert kinds >= {
        "joint-axis", "joint-position", "joint-pivot", "joint-orientation", "body-position",
        "body-orientation", "link-length", "body-size", "element-length", "contact-size", "attachment",
        "contact-position",
    }  # fmt: skip


QUICK = ("joint-axis", "body-position", "link-length")


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[] if kind in QUICK else [pytest.mark.long])
        for kind in sorted({c.kind for c in CAUSES})
    ],
)
def test_columns_at_what_is_built_are_its_derivatives(kind: str) -> None:
    """Differences of second order with steps of 1e-4 have errors of some 1e-8."""
    rng = np.random.default_rng(3)
    some = [c for c in CAUSES if c.kind == kind]
    for c in some[len(some) // 2 :][:1]:
        assert c.edit is not None
        theta = 0.2 * rng.standard_normal(c.size)
        built = c.edit.mechanism(tree(), theta)
        equations, values, places = all_columns(built, RUN)
        (there,) = edited(equations, places, c.kind, c.element, c.edit, names=c.names, theta=theta)
        exact = values[:, :, 1:][:, :, list(there.columns)] @ there.linear
        for k in range(c.size):
            ends = [
                residual(c.edit.mechanism(tree(), theta + sign * STEP * np.eye(c.size)[k]))
                for sign in (-1.0, 1.0)
            ]
            difference = (ends[1] - ends[0]) / (2.0 * STEP)
            size = np.abs(exact).max()
            np.testing.assert_allclose(exact[:, :, k], difference, atol=1e-6 * size)


def test_a_parameter_is_built_anew() -> None:
    mechanism = dc.Mechanism(
        [dc.body("rod", 1.0, (0.1, 0.1, 0.1), ("length/2", 0, 0))],
        [dc.revolute("hinge", "ground", "rod", "z")],
        gravity=(0, -9.81, 0),
        parameters={"length": 0.5},
    )
    run = samples(mechanism)
    (cause,) = (c for c in of_geometry(mechanism, run) if c.kind == "parameter")
    assert cause.edit is not None
    built = cause.edit.mechanism(mechanism, np.array([0.1]))
    expected = replace(mechanism, parameters={"length": 0.6})
    assert built.hash == expected.hash
