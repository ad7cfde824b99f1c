"""Topics of a bag at the times of another one, beside a function that is known everywhere."""

from __future__ import annotations

import numpy as np

from deltac.trajectories.formats.rosbag import _interpolated


def test_nothing_is_made_up_where_a_topic_paused() -> None:
    every = np.arange(0, 4_000_000_000, 10_000_000)
    times = every[(every < 1_000_000_000) | (every >= 2_000_000_000)]
    at = np.arange(0, 3_900_000_000, 4_000_000)
    found = _interpolated(times, {"x": np.sin(times / 1e9)}, at)["x"]
    paused = (at > 990_000_000) & (at < 2_000_000_000)
    assert np.isnan(found[paused]).all()
    # A cubic spline is off by 5/384 h⁴ of the fourth derivative, more at its ends and at the pause.
    np.testing.assert_allclose(found[~paused], np.sin(at[~paused] / 1e9), rtol=0, atol=1e-3)
    near = np.abs(at - 1.5e9) > 0.6e9
    np.testing.assert_allclose(found[near], np.sin(at[near] / 1e9), rtol=0, atol=1e-7)


def test_a_steady_topic_is_whole() -> None:
    times = np.arange(0, 1_000_000_000, 20_000_000) + np.tile([0, 4_000_000], 25)
    at = np.arange(0, 970_000_000, 5_000_000)
    found = _interpolated(times, {"x": np.sin(times / 1e9)}, at)["x"]
    np.testing.assert_allclose(found, np.sin(at / 1e9), rtol=0, atol=1e-6)
