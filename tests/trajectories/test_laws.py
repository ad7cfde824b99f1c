"""Logs without the columns of prescribed joints, beside the closed form of their laws."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.trajectories import read_trajectory


def driven(motion: object) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.bodies.frame("cart"), dc.bodies.point_mass("bob", 0.2)],
        joints=[
            dc.joints.prismatic("shake", "ground", "cart", "z", motion=motion),  # type: ignore[arg-type]
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
    tmp_path: Path,
    motion: str,
    place: Callable[..., Any],
    rate: Callable[..., Any],
    with_speeds: bool,
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
    run = read_trajectory(path, model=driven(motion))
    eps = np.finfo(float).eps
    np.testing.assert_allclose(run.coordinate("shake"), place(t), rtol=0, atol=4 * eps)
    # A spline of degree 5 is off by h⁵ of the sixth derivative, and at the kink by h of the second.
    atol = 8 * eps if with_speeds else 2e-2 if "where" in motion else 0.02 * 9**6 * 1e-10
    np.testing.assert_allclose(run.speed("shake"), rate(t), rtol=0, atol=atol)


def swinging(path: Path, t: np.ndarray) -> Path:
    """A log of the swing alone."""
    table = {"t": t, "swing": np.sin(t - t[0]), "omega": np.cos(t - t[0])}
    values = np.column_stack(list(table.values()))
    np.savetxt(path, values, "%.17g", ",", header=",".join(table), comments="")
    return path


@pytest.mark.parametrize("start", [100.0, 1.7e9, -3.0])
def test_laws_tell_nothing_at_times_of_another_clock(tmp_path: Path, start: float) -> None:
    path = swinging(tmp_path / "log.csv", start + np.linspace(0.0, 1.0, 129))
    with pytest.raises(dc.InputError, match="mapping") as refused:
        read_trajectory(path, model=driven("A*sin(9*t)"))
    assert f"offset = {-start:.15g}" in str(refused.value)
    still = read_trajectory(path, model=driven("3*A"))  # a law without t needs no clock
    assert np.all(still.coordinate("shake") == 3 * 0.02)


def test_a_mapping_says_which_clock_it_is(tmp_path: Path) -> None:
    model = driven("A*sin(9*t)")
    path = swinging(tmp_path / "log.csv", 100.0 + np.linspace(0.0, 1.0, 129))
    mapping = tmp_path / "map.toml"
    places = []
    for clock in ('{ column = "t", offset = -100 }', '{ column = "t" }'):
        mapping.write_text(
            f'[log]\ntime = {clock}\n[coordinates]\nswing = "swing"\n[speeds]\nswing = "omega"\n'
        )
        run = read_trajectory(path, mapping=mapping, model=model)
        places.append((run.t[0], run.coordinate("shake")[0]))
    assert places[0] == (0.0, 0.0)
    assert places[1] == (100.0, pytest.approx(0.02 * np.sin(900.0), abs=1e-15))


@pytest.mark.long
def test_an_audit_says_that_a_driven_joint_follows_its_law_by_another_clock(tmp_path: Path) -> None:
    model = driven("A*sin(9*t)")
    run = dc.simulate(model, model.state({"swing": 1.0}), duration=0.3, step=1e-2)
    later = dc.Trajectory(
        t=run.t + 100.0, q=run.q, u=run.u, coordinates=run.coordinates, speeds=run.speeds
    )
    departs = [f for f in dc.audit(model, later).findings if f.kind == "prescribed-departs"]
    assert departs and all("100 s" in f.remedy for f in departs)
    wrong = dc.audit(driven("2*A*sin(9*t)"), later).findings
    assert not any("100 s" in f.remedy for f in wrong)


def test_an_audit_tells_what_is_by_law(tmp_path: Path) -> None:
    model = driven("A*sin(9*t)")
    run = dc.simulate(model, model.state({"swing": 1.0}), duration=1.0, step=1e-2)
    table = np.column_stack([run.t, run.coordinate("swing"), run.speed("swing")])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, "%.17g", ",", header="t,swing,omega", comments="")
    found = dc.audit(model, path)
    assert found.verdict.kind == "consistent"
    assert "F-BY-LAW" in {finding.code for finding in found.findings}
