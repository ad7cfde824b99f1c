"""Tables as people write them, whose motion is known: each is read with the right numbers, or refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from deltac.trajectories import MechanismNames, read_trajectory

T = np.arange(60) / 50.0
Q = np.column_stack([np.sin(T), 0.4 * np.cos(2.0 * T)])
U = np.column_stack([np.cos(T), -0.8 * np.sin(2.0 * T)])
NAMES = ("shoulder", "elbow")
ARM = MechanismNames(dict.fromkeys(NAMES, "rad"), dict.fromkeys(NAMES, "rad/s"))
LONG = pl.DataFrame(
    {
        "time": np.repeat(T, 2),
        "joint": list(NAMES) * len(T),
        "position": Q.ravel(),
        "velocity": U.ravel(),
    }
)


def text(names: str, *columns: object, separator: str = ",", end: str = "\n") -> bytes:
    """A table of names and columns."""
    rows = zip(*(np.asarray(column) for column in columns))
    lines = [names, *(separator.join(str(x) for x in row) for row in rows)]
    return end.join(lines).encode()


def _stamps(form: Callable[[int, str], str]) -> list[str]:
    return [form(int(s), f"{int(s):02d}.{round(s % 1 * 100):02d}") for s in T]


MOTION = (*Q.T, *U.T)
DEGREES = np.degrees(MOTION)
TEXTS = {
    "units in words": text(
        "time_seconds,shoulder_degrees,elbow_degrees,shoulder_degrees_per_second,elbow_deg_per_s",
        T,
        *DEGREES,
    ),
    "units in words, SI": text(
        "t_s,shoulder_radians,elbow_radians,shoulder_vel_radians_per_second,elbow_vel_rad_per_sec",
        T,
        *MOTION,
    ),
    "lines of old Macs": text("t,shoulder,elbow,shoulder_dot,elbow_dot", T, *MOTION, end="\r"),
    "German dates": text(
        "Zeit;shoulder;elbow;shoulder_vel;elbow_vel",
        _stamps(lambda _, s: f"31.12.2023 12:00:{s}".replace(".", ",").replace(",", ".", 2)),
        *MOTION,
        separator=";",
    ),
    "dates with slashes": text(
        "Date Time,shoulder,elbow,shoulder_vel,elbow_vel",
        _stamps(lambda _, s: f"2024/03/01 12:00:{s}"),
        *MOTION,
    ),
    "American dates": text(
        "Timestamp,shoulder,elbow,shoulder_vel,elbow_vel",
        _stamps(lambda _, s: f"3/4/2024 11:59:{s}"),
        *MOTION,
    ),
    "phases of a motion": text(
        "t,percent,phase,shoulder,elbow,shoulder_vel,elbow_vel",
        T,
        [*range(30), *range(30)],
        ["swing"] * 30 + ["stance"] * 30,
        *MOTION,
    ),
    "long": LONG.write_csv().encode(),
    "long, joint after joint": LONG.sort("joint", "time").write_csv().encode(),
    "long, a row for each number": LONG.unpivot(
        on=["position", "velocity"], index=["time", "joint"], variable_name="quantity"
    )
    .write_csv()
    .encode(),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_is_read_with_its_numbers(name: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(TEXTS[name])
    run = read_trajectory(path, None, ARM)
    assert not run.provenance.derived
    assert run.t - run.t[0] == pytest.approx(T, abs=1e-9)
    assert run.q == pytest.approx(Q, abs=1e-9)
    assert run.u == pytest.approx(U, abs=1e-9)


# The names stand in the file in the order of its columns, which is not the model's.
_SWAPPED = {"time": T, "joint_positions": Q[:, ::-1], "joint_velocities": U[:, ::-1]}


def _npz(path: Path, names: object) -> Path:
    np.savez(path / "log.npz", joint_names=np.array(names), **_SWAPPED)  # type: ignore[arg-type]
    return path / "log.npz"


def _json(path: Path, **names: object) -> Path:
    arrays = {
        "time": T.tolist(),
        "state": {k: v.tolist() for k, v in _SWAPPED.items() if k != "time"},
    }
    (path / "log.json").write_text(json.dumps({**arrays, **names}))
    return path / "log.json"


def _hdf5(path: Path, where: str) -> Path:
    h5py = pytest.importorskip("h5py", reason="HDF5 needs h5py")
    with h5py.File(path / "log.h5", "w") as file:
        group = file.create_group("log")
        for name, values in _SWAPPED.items():
            group[name] = values
        if where == "dataset":
            group["joint_names"] = ["elbow", "shoulder"]
        elif where == "group":
            group.attrs["joint_names"] = ["elbow", "shoulder"]
        else:
            for name in ("joint_positions", "joint_velocities"):
                group[name].attrs["columns"] = ["elbow", "shoulder"]
    return path / "log.h5"


def _nested(path: Path) -> dict[str, object]:
    return {"log": {**_SWAPPED, "joint_names": np.array(["elbow", "shoulder"], dtype=object)}}


@pytest.mark.parametrize(
    "make",
    [
        lambda path: _npz(path, ["elbow", "shoulder"]),
        lambda path: _npz(path, [b"elbow", b"shoulder"]),
        lambda path: _json(path, joint_names=["elbow", "shoulder"]),
        lambda path: _json(path, joints=["elbow", "shoulder"]),
        lambda path: _hdf5(path, "dataset"),
        lambda path: _hdf5(path, "group"),
        lambda path: _hdf5(path, "array"),
        _nested,
    ],
    ids=["npz", "npz of bytes", "json", "joints", "hdf5", "group", "attribute", "dictionary"],
)
def test_names_beside_arrays_say_their_order(
    make: Callable[[Path], object], tmp_path: Path
) -> None:
    run = read_trajectory(make(tmp_path), None, ARM)  # type: ignore[arg-type]
    assert np.array_equal(run.q, Q)
    assert np.array_equal(run.u, U)


def test_names_are_those_of_their_own_group() -> None:
    """Two arms in one table, each with an order of its own."""
    arms = {
        side: {"joint_names": names, "position": q, "velocity": u}
        for side, names, q, u in (
            ("left", ["elbow", "shoulder"], Q[:, ::-1], U[:, ::-1]),
            ("right", ["elbow", "shoulder"], 2.0 * Q[:, ::-1], 2.0 * U[:, ::-1]),
        )
    }
    names = [f"{side} {name}" for side in arms for name in NAMES]
    both = MechanismNames(dict.fromkeys(names, "rad"), dict.fromkeys(names, "rad/s"))
    run = read_trajectory({"time": T, **arms}, None, both)
    assert np.array_equal(run.q, np.hstack([Q, 2.0 * Q]))
