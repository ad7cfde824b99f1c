"""Tables and robot logs written once, as a user would: read right, drafted or refused, and none misread."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.trajectories import draft_mapping, read_trajectory
from tests.natural_logs import models

ARM, PENDULUM = models.arm(), models.pendulum()


def motion(mechanism: dc.Mechanism, q: dict[str, float]) -> dc.Trajectory:
    return dc.simulate(mechanism, mechanism.state(q), 0.5, 0.01, "ode4")


RUN = motion(ARM, {"shoulder": 1.1, "elbow": 0.6})
SWING = motion(PENDULUM, {"pivot": 0.8})
T, Q, U = RUN.t, RUN.q, RUN.u
DEGREES = np.degrees(np.column_stack([Q, U]))
REVERSED = {"name": ["elbow", "shoulder"], "effort": [0.0, 0.0]}
Writer = Callable[[Path], None]


def table(
    head: str, columns: list[np.ndarray], sep: str = ";", decimal: str = ",", before: str = ""
) -> Writer:
    """A text table of six decimals."""

    def write(path: Path) -> None:
        rows = (
            sep.join(f"{x:.6f}".replace(".", decimal) for x in row)
            for row in np.column_stack(columns)
        )
        path.write_text(before + "\n".join([*([head] if head else []), *rows]) + "\n", "utf-8")

    return write


def arrays(**columns: np.ndarray | float) -> Writer:
    return lambda path: np.savez(path, **columns)  # type: ignore[arg-type]


def records(value: object) -> Writer:
    def written(path: Path) -> None:
        path.write_text(json.dumps(value), "utf-8")

    return written


def stamp(t: float) -> dict[str, dict[str, int]]:
    return {"stamp": {"sec": int(t), "nanosec": round((t % 1.0) * 1e9)}}


MESSAGES = [
    {"header": stamp(t), **REVERSED, "position": [b, a], "velocity": [d, c]}
    for t, (a, b), (c, d) in zip(T.tolist(), Q.tolist(), U.tolist(), strict=True)
]
STATES = [
    {"timestamp": t, "observation.state": q, "observation.velocity": u}
    for t, q, u in zip(T.tolist(), Q.tolist(), U.tolist(), strict=True)
]
BOTH = [Q[:, 0], Q[:, 1], U[:, 0], U[:, 1]]
LOGS: dict[str, tuple[Writer, str]] = {
    "two.csv": (table("t;pivot", [SWING.t, SWING.q[:, 0]]), "read"),
    "three.txt": (table("", [SWING.t, SWING.q[:, 0], SWING.u[:, 0]]), "read"),
    "degrees.csv": (
        table(
            "Zeit [s];shoulder [°];elbow [°];shoulder_vel [°/s];elbow_vel [°/s]", [T, *DEGREES.T]
        ),
        "read",
    ),
    "milliseconds.tsv": (
        table(
            "time_ms\tshoulder_rad\telbow_rad\tshoulder_rad_s\telbow_rad_s",
            [1e3 * T, *BOTH],
            "\t",
            ".",
        ),
        "read",
    ),
    "pipes.txt": (table("t|q1|q2|qd1|qd2", [T, *BOTH], "|", "."), "read"),
    "quoted.csv": (
        table(
            '"Time (s)","Shoulder angle (deg)","Elbow angle (deg)","Shoulder speed (deg/s)",'
            '"Elbow speed (deg/s)"',
            [T, *DEGREES.T],
            ",",
            ".",
        ),
        "read",
    ),
    "comments.csv": (
        table(
            "time,elbow,shoulder,elbow_dot,shoulder_dot",
            [T, Q[:, 1], Q[:, 0], U[:, 1], U[:, 0]],
            ",",
            ".",
            "# rig 3, run 17\n# operator: K\n",
        ),
        "read",
    ),
    "french.csv": (
        table("temps;epaule;coude;v_epaule;v_coude\ns;rad;rad;rad/s;rad/s", [T, *BOTH]),
        "drafted",
    ),
    "rpm.csv": (
        table(
            "time [s];shoulder [rad];elbow [rad];shoulder [rpm];elbow [rpm]",
            [T, *BOTH[:2], *(30.0 / np.pi * U.T)],
        ),
        "read",
    ),
    "exponents.dat": (
        lambda path: np.savetxt(
            path, np.column_stack([T, Q, U]), header="t shoulder elbow d_shoulder d_elbow"
        ),
        "read",
    ),
    "cosines.npz": (
        arrays(time=T, observations=np.column_stack([np.cos(Q), np.sin(Q), U])),
        "refused",
    ),
    "dofs.npz": (arrays(dof_pos=Q, dof_vel=U, t=T), "read"),
    "dt.npz": (arrays(joint_pos=Q, joint_vel=U, dt=0.01), "read"),
    "physics.npz": (arrays(time=T, physics_state=np.hstack([Q, U])), "read"),
    "bag.json": (records({"messages": MESSAGES}), "read"),
    "single.npz": (
        arrays(time=T.astype("f4"), qpos=Q.astype("f4"), qvel=U.astype("f4")),
        "read",
    ),
    "datasets.json": (records(STATES), "refused"),
    "batched.npz": (arrays(time=T, qpos=np.stack([Q, Q]), qvel=np.stack([U, U])), "refused"),
    "flattened.npz": (arrays(timesteps=T, states=np.hstack([T[:, None], Q, U])), "read"),
    "reversed.npz": (
        arrays(
            joint_names=np.array(["elbow", "shoulder"]),
            positions=Q[:, ::-1],
            velocities=U[:, ::-1],
            time=T,
        ),
        "read",
    ),
}
"""File -> how it is written, and what becomes of it."""


@pytest.mark.parametrize("name", LOGS)
def test_each_is_read_right_or_not_at_all(name: str, tmp_path: Path) -> None:
    write, outcome = LOGS[name]
    path = tmp_path / name
    write(path)
    mechanism, run = (PENDULUM, SWING) if name in ("two.csv", "three.txt") else (ARM, RUN)
    mapping = None
    if outcome != "read":
        with pytest.raises(dc.InputError):
            read_trajectory(path, None, mechanism)
        mapping = tmp_path / "map.toml"
        mapping.write_text(draft_mapping(path, mechanism), "utf-8")
    if outcome == "refused":
        with pytest.raises(dc.InputError):
            read_trajectory(path, mapping, mechanism)
        return
    log = read_trajectory(path, mapping, mechanism)
    np.testing.assert_allclose(log.t, run.t, atol=1e-6)
    np.testing.assert_allclose(log.q, run.q, atol=1e-5)
    # Speeds that a log lacks are differences: exact to h² q⃛/6.
    np.testing.assert_allclose(log.u, run.u, atol=1e-2 if name == "two.csv" else 1e-5)
