"""Times of too few digits: what is offered where the rows are plainly evenly apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.trajectories.formats.mapping import with_step
from deltac.trajectories.trajectory import rounded_clock


def _pendulum() -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.rod("bar", 1.0, 1.0, along="-y")],
        joints=[dc.revolute("hinge", "ground", "bar", axis="z")],
        gravity=(0.0, -9.81, 0.0),
    )


@pytest.mark.parametrize("round_", [np.round, lambda t, d: np.floor(t * 10**d) / 10**d])
@pytest.mark.parametrize(("step", "digits"), [(2.5e-4, 3), (1e-3, 2), (1.0 / 240.0, 2), (3e-5, 4)])
def test_the_step_is_that_of_the_clock(step: float, digits: int, round_: object) -> None:
    rows = 401
    t = round_(2.0 + step * np.arange(rows), digits)  # type: ignore[operator]
    told = rounded_clock(t)
    offered = float(told.partition("--step ")[2].split(",")[0])
    # Over the whole log the offered clock stays within the rounding of the stamps.
    assert abs(offered - step) * (rows - 1) <= 2.0 * 10.0**-digits


def test_exact_decimals_are_offered_as_they_are() -> None:
    assert "--step 0.00025," in rounded_clock(np.round(2.5e-4 * np.arange(2001), 3))


@pytest.mark.parametrize(
    "t",
    [
        np.sort(np.r_[np.arange(50.0), 7.0, 31.0]),  # two rows that are there twice
        np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2]),  # two motions
        np.round(np.cumsum(np.r_[0.0, np.full(200, 2e-4), np.full(200, 8e-4)]), 3),  # two rates
        np.zeros(5),
    ],
)
def test_nothing_is_offered_where_spacing_is_not_even(t: np.ndarray) -> None:
    assert rounded_clock(t) == ""


@pytest.mark.parametrize("speeds", [True, False], ids=["q and u", "q alone"])
def test_a_log_with_such_times_is_refused_with_the_step_and_read_by_it(
    tmp_path: Path, speeds: bool
) -> None:
    mechanism = _pendulum()
    run = dc.simulate(mechanism, mechanism.state({"hinge": 0.5}), 0.5, step=2.5e-4)
    path = tmp_path / "log.csv"
    rows = np.column_stack([np.round(run.t, 3), run.q, run.u][: 2 + speeds])
    header = "t,q.hinge,u.hinge" if speeds else "t,q.hinge"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.15g")
    with pytest.raises(InputError, match=r"--step 0\.00025"):
        dc.read_trajectory(path, None, mechanism)
    again = dc.read_trajectory(path, with_step(None, 2.5e-4), mechanism)
    assert np.allclose(again.t, run.t, rtol=0.0, atol=1e-12)
    assert dc.audit(mechanism, again).verdict.kind == "consistent"
    with pytest.raises(InputError, match="positive"):
        with_step(None, 0.0)


def test_a_step_leaves_names_of_columns_as_they_are_read(tmp_path: Path) -> None:
    """Columns of a log that is read by their names are the same where its times are counted."""
    mechanism = _pendulum()
    run = dc.simulate(mechanism, mechanism.state({"hinge": 0.5}), 0.1, step=2.5e-4)
    path = tmp_path / "log.csv"
    rows = np.column_stack([np.round(run.t, 3), run.q, run.u])
    np.savetxt(
        path, rows, delimiter=",", header="time,hinge_pos,hinge_vel", comments="", fmt="%.17g"
    )
    again = dc.read_trajectory(path, with_step(None, 2.5e-4), mechanism)
    assert np.array_equal(again.q, run.q) and np.array_equal(again.u, run.u)
    assert np.allclose(again.t, run.t, rtol=0.0, atol=1e-12)
