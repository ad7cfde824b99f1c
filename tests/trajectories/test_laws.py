"""Logs without the columns of prescribed joints, beside the closed form of their laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.trajectories import read_trajectory


def driven(motion: object) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.bodies.frame("cart"), dc.bodies.point_mass("bob", 0.2)],
        joints=[
            dc.joints.prismatic("shake", "ground", "cart", "z", motion=motion),
            dc.joints.revolute("swing", "cart", "bob", "y", child_position=(0, 0, 0.35)),
        ],
        gravity=(0, 0, -9.81),
        parameters={"A": 0.02},
    )


@pytest.mark.parametrize("with_speeds", [True, False])
@pytest.mark.parametrize(
    ("motion", "place", "rate"),
    [
        ("A*sin(9*t)", lambda t: 0.02 * np.sin(9 * t), lambda t: 0.18 * np.cos(9 * t)),
        ("3*A", lambda t: 0 * t + 0.06, lambda t: 0 * t),
        (
            "where(t < 0.5, 0, (t - 0.5)**2)",
            lambda t: np.maximum(t - 0.5, 0) ** 2,
            lambda t: 2 * np.maximum(t - 0.5, 0),
        ),
    ],
)
def test_columns_that_laws_tell(
    tmp_path: Path, motion: str, place: object, rate: object, with_speeds: bool
) -> None:
    t = np.linspace(0.0, 1.0, 101)
    table = np.column_stack([t, np.sin(t), np.cos(t)])
    header = "t,swing,omega"
    path = tmp_path / "log.csv"
    columns = 3 if with_speeds else 2
    np.savetxt(
        path,
        table[:, :columns],
        delimiter=",",
        header=",".join(header.split(",")[:columns]),
        comments="",
    )
    run = read_trajectory(path, mechanism_names=driven(motion))
    eps = np.finfo(float).eps
    np.testing.assert_allclose(run.coordinate("shake"), place(t), rtol=0, atol=4 * eps)
    # A spline of degree 5 is off by h⁵ of the sixth derivative, and at the kink by h of the second.
    atol = 8 * eps if with_speeds else 2e-2 if "where" in motion else 0.02 * 9**6 * 1e-10
    np.testing.assert_allclose(run.speed("shake"), rate(t), rtol=0, atol=atol)
