"""Arrays that programs log without names: taken by what they are called and how wide they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from deltac.errors import InputError
from deltac.trajectories import explain, read_trajectory
from deltac.trajectories.columns import MechanismNames
from deltac.trajectories.formats.objects import read_table

NAMES = MechanismNames(
    {"hip": "rad", "knee": "rad", "slide": "m"},
    {"hip": "rad/s", "knee": "rad/s", "slide": "m/s"},
)
T = np.linspace(0.0, 1.0, 11)
Q = np.column_stack([np.sin(T), np.cos(T), T**2])
U = np.column_stack([np.cos(T), -np.sin(T), 2 * T])


@pytest.mark.parametrize(
    "arrays",
    [
        {"time": T, "qpos": Q, "qvel": U, "ctrl": np.ones((11, 2)), "act": np.ones((11, 0))},
        {"t": T, "q": Q, "v": U},
        {"t": T, "x": np.hstack([Q, U])},
        {"tout": T, "yout": np.hstack([Q, U])},
        {"Time": T, "q": Q, "qd": U, "qdd": U},
        {"time": T, "q": Q, "dq": U, "u": np.ones((11, 2))},
        {"u": U, "time": T, "q": Q, "tau": np.ones((11, 3))},
    ],
    ids=lambda arrays: " ".join(arrays),
)
@pytest.mark.parametrize("form", ["npz", "mat"])
def test_arrays_by_name_and_width(form: str, arrays: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / f"log.{form}"
    if form == "npz":
        np.savez(path, **arrays)
    else:
        savemat(path, {name: array for name, array in arrays.items() if array.size})
    run = read_trajectory(path, None, NAMES)
    assert run.coordinates == tuple(NAMES.coordinates) and run.speeds == tuple(NAMES.speeds)
    assert np.array_equal(run.t, T) and np.array_equal(run.q, Q) and np.array_equal(run.u, U)
    assert {r.meaning for r in explain(path, None, NAMES)} >= {"time", "q.hip", "u.slide"}


@pytest.mark.parametrize(
    "arrays",
    [
        {"time": T, "qpos": Q[:, :2], "qvel": U},  # too narrow
        {"time": T, "qpos": Q, "q": Q, "qvel": U},  # which?
        {"time": T, "t": T, "qpos": Q, "qvel": U},
    ],
)
def test_what_does_not_fit_or_is_there_twice_is_not_guessed(
    arrays: dict[str, Any], tmp_path: Path
) -> None:
    np.savez(tmp_path / "log.npz", **arrays)
    if "t" in arrays:  # `time` is the schema's own name
        assert np.array_equal(read_trajectory(tmp_path / "log.npz", None, NAMES).q, Q)
        return
    with pytest.raises(InputError, match=r"no column 'q\.hip'"):
        read_trajectory(tmp_path / "log.npz", None, NAMES)


def test_of_two_lists_of_names_the_first_holds() -> None:
    q = np.column_stack([T, T**2])
    lists = {"joints": ["b", "a"], "labels": ["left", "right"]}
    raw = read_table({"time": T, "q": q, **lists})
    assert {"q.b", "q.a"} <= set(raw.columns)
    np.testing.assert_array_equal(raw.columns["q.a"], T**2)
