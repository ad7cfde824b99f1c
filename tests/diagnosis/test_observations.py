"""Observations of a log: what is known of the rows that stretches of it take."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np

import deltac as dc
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import observations


def test_numbers_that_stay_within_their_last_digit_share_one_rounding() -> None:
    """In a stretch of a long log they are counted over the whole log, by its own rows."""
    mechanism = dc.Mechanism(
        [dc.rod("bar", 1.0, 1.0, along="-y")],
        [dc.revolute("hinge", "ground", "bar")],
        gravity=(0.0, -9.81, 0.0),
    )
    exact = dc.simulate(mechanism, mechanism.state({"hinge": 0.05}), 20.0, 1e-3, "ode4")
    q = np.round(exact.q, 4)
    names: dict[str, Any] = {"coordinates": exact.coordinates, "speeds": exact.speeds}
    run = dc.Trajectory(t=exact.t, q=q, u=exact.u, **names)
    observed = observations(LogModel(mechanism, run), run, 400)
    assert observed is not None and len(observed.intervals.h) < 500
    runs = [len(list(group)) for _, group in groupby(q[:, 0])]
    alike = np.repeat(runs, runs)
    starts = np.concatenate([np.arange(a, b - 1) for a, b in observed.rows])
    np.testing.assert_array_equal(observed.intervals.start.q, q[starts])
    for noise, at in zip(observed.noise, (starts, starts + 1), strict=True):
        # A number of four decimals is off by up to 5e-5, uniformly.
        np.testing.assert_allclose(noise[:, 0], np.sqrt((5e-5) ** 2 / 3.0 * alike[at]), rtol=1e-6)
