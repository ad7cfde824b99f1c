"""How people name the forces of motors, units in names, and times in JSON: read as they are, or guessed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.trajectories import draft_mapping
from deltac.trajectories.formats.files import read_raw

ARM = dc.Mechanism(
    bodies=[dc.point_mass("upper", 1.0, (0, -0.4, 0)), dc.point_mass("fore", 0.5, (0, -0.3, 0))],
    joints=[
        dc.revolute("shoulder", "ground", "upper", "z"),
        dc.revolute("elbow", "upper", "fore", "z", position=(0, -0.4, 0)),
    ],
    forces=[dc.forces.joint_torque("lift", "shoulder")],
    gravity=(0, -9.81, 0),
)
T = np.linspace(0.0, 1.0, 51)
Q = np.column_stack([np.sin(2 * T), np.cos(3 * T)])
U = np.column_stack([2 * np.cos(2 * T), -3 * np.sin(3 * T)])
TAU = np.exp(-T) * np.sin(5 * T + 0.3)


def table(head: str, *columns: Any, separator: str = ",", number: str = "%.12g") -> str:
    rows = [separator.join(number % x for x in row) for row in np.column_stack(columns)]
    return "\n".join([head, *rows, ""])


def messages(nested: bool) -> str:
    """Joint states of ROS, whose joints have another order, as JSON."""
    found = []
    for t, q, u, tau in zip(T, Q, U, TAU):
        nanoseconds = round(1e9 * t)
        stamp = {"sec": 1700000000 + nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
        found.append(
            {
                "header": {"stamp": stamp, "frame_id": ""},
                "name": ["elbow", "shoulder"],
                "position": q[::-1].tolist(),
                "velocity": u[::-1].tolist(),
                "effort": [0.0, tau],
            }
        )
    return json.dumps(found) if nested else "\n".join(map(json.dumps, found))


DEG = np.degrees
COLUMNS = (T, *Q.T, *U.T, TAU)
LVM = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\nChannels\t5\n***End_of_Header***\n"
AS_IS: dict[str, Callable[[], str]] = {
    "unit.csv": lambda: table("Time (s),q_shoulder,q_elbow,w_shoulder,w_elbow,T_lift (Nm)", *COLUMNS),
    "milli.csv": lambda: table(
        "time,shoulder [°],elbow [°],shoulder.rate [°/s],elbow.rate [°/s],lift [mNm]",
        T, *DEG(Q).T, *DEG(U).T, 1e3 * TAU,
    ),
    "endings.csv": lambda: table(
        "t_ms,shoulder_deg,elbow_deg,shoulder_rad_s,elbow_rad_s,lift_nm", 1e3 * T, *DEG(Q).T, *U.T, TAU
    ),
    "fortran.dat": lambda: table("# t q1 q2 dq1 dq2 tau", *COLUMNS, separator=" ", number="%.12E").replace(
        "E", "D"
    ),
    "labview.lvm": lambda: LVM
    + table("X_Value\tshoulder\telbow\tshoulder_vel\telbow_vel\tlift_torque\tComment", *COLUMNS,
            separator="\t"),
    "messages.json": lambda: messages(True),
    "messages.jsonl": lambda: messages(False),
}  # fmt: skip


@pytest.mark.parametrize("name", AS_IS)
def test_read_as_it_is(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(AS_IS[name](), encoding="utf-8")
    run = dc.read_trajectory(path, None, ARM)
    np.testing.assert_allclose(run.t - run.t[0], T, atol=1e-9)
    np.testing.assert_allclose(run.q, Q, atol=1e-9)
    np.testing.assert_allclose(run.u, U, atol=1e-9)
    np.testing.assert_allclose(run.forces["actuator lift"][:, 0], TAU, atol=1e-9)


@pytest.mark.parametrize(
    "stamp", [{"sec": 0, "nanosec": 1}, {"sec": None, "nanosec": 0}, {"sec": "0", "nanosec": "0"}]
)
def test_columns_of_records_that_never_change(tmp_path: Path, stamp: dict[str, Any]) -> None:
    """A motor that holds its torque has a column of forces; stamps that are no numbers are none."""
    path = tmp_path / "run.jsonl"
    rows = [
        {"time": t, "header": {"stamp": stamp}, "q": list(q), "qd": list(u), "tau": [0.0, 0.3]}
        for t, q, u in zip(T, Q, U)
    ]
    path.write_text("\n".join(map(json.dumps, rows)), encoding="utf-8")
    found = read_raw(path).columns
    assert all(np.all(found[name] == x) for name, x in zip(("tau[0]", "tau[1]"), (0.0, 0.3)))


@pytest.mark.parametrize("key", ["ctrl", "action", "U"])
def test_commands_are_only_guessed(tmp_path: Path, key: str) -> None:
    """A motor may have a gear: so a command is a force in a draft alone."""
    path, draft = tmp_path / "run.npz", tmp_path / "map.toml"
    np.savez(path, t=T, q=Q, qd=U, **{key: TAU[:, None]})  # type: ignore[arg-type]
    assert "actuator lift" not in dc.read_trajectory(path, None, ARM).forces
    with pytest.raises(InputError, match=r'\[forces."actuator lift"\]'):
        dc.audit(ARM, path)
    draft.write_text(draft_mapping(path, ARM), encoding="utf-8")
    run = dc.read_trajectory(path, draft, ARM)
    np.testing.assert_allclose(run.forces["actuator lift"][:, 0], TAU)


@pytest.mark.parametrize("suffix", ["csv.gz", "zip", "feather", "db", "res", "c3d", "tdms"])
def test_what_is_not_read_says_what_to_do(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    path.write_bytes(b"\x00")
    with pytest.raises(InputError) as caught:
        dc.read_trajectory(path)
    assert caught.value.code == "E-FILE"


def test_the_model_is_taken_by_place_and_by_name(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(AS_IS["unit.csv"](), encoding="utf-8")
    whole = dc.read_trajectory(path, None, ARM)
    for run in (
        dc.read_trajectory(path, ARM),
        dc.read_trajectory(path, model=ARM),
        dc.read_trajectory(path, model=dc.load_model(ARM)),
    ):
        assert np.array_equal(run.q, whole.q) and run.coordinates == whole.coordinates
    with pytest.raises(InputError, match="found int"):
        dc.read_trajectory(path, model=3)  # type: ignore[arg-type]
