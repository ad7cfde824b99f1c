"""Logs of robots that float, walk and touch the ground at a policy's rate: read right, drafted or refused.

Written cold, before the reader knew them, by random actions in models of Gymnasium and dm_control. The truth
is MuJoCo's own qpos and qvel, whose conventions are the schema's.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import read_trajectory, rotations
from deltac.trajectories import draft_mapping

mujoco = pytest.importorskip("mujoco")
gymnasium = pytest.importorskip("gymnasium")

GYMNASIUM = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
READ, DRAFTED, REFUSED = "read", "drafted", "refused"


class Rollout:
    """Random actions at a policy's rate: t (T,), q (T, nq), u (T, nv), the commands, the names of joints."""

    def __init__(self, path: Path, seed: int, skip: int = 5, rows: int = 200) -> None:
        self.path, model = path, mujoco.MjModel.from_xml_path(str(path))
        data, rng = mujoco.MjData(model), np.random.default_rng(seed)
        data.qvel[:] = 0.1 * rng.standard_normal(model.nv)
        samples = []
        for _ in range(rows):
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
            samples.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
            mujoco.mj_step(model, data, skip)
        self.t, self.q, self.u, self.ctrl = (np.array(part) for part in zip(*samples))
        self.names = [model.joint(k).name for k in range(model.njnt)]
        self.dt, self.skip = model.opt.timestep, skip
        if model.jnt_type[0] == 0:
            R = rotations.matrices(self.q[:, 3:7])
            self.p, self.wxyz, self.joints, self.rates = (
                self.q[:, :3], self.q[:, 3:7], self.q[:, 7:], self.u[:, 6:],
            )  # fmt: skip
            self.xyzw = self.wxyz[:, [1, 2, 3, 0]]
            self.v, self.w = self.u[:, :3], self.u[:, 3:6]
            self.v_body = np.einsum("tji,tj->ti", R, self.v)
            self.w_world = np.einsum("tij,tj->ti", R, self.w)


@lru_cache
def rollout(name: str, seed: int = 30, skip: int = 5) -> Rollout:
    """A rollout of a model by its file's name."""
    return Rollout(GYMNASIUM / f"{name}.xml", seed, skip)


@lru_cache
def mechanism(name: str) -> dc.Mechanism:
    """The model of a rollout."""
    return dc.load_model(str(GYMNASIUM / f"{name}.xml")).mechanism


Log = tuple[str, dict[str, Any]]


def numbered(form: str, r: Rollout) -> dict[str, Any]:
    """Columns of q and u, each by its number."""
    parts = (("qpos", r.q), ("qvel", r.u))
    return {form.format(n, k): x for n, table in parts for k, x in enumerate(table.T)}


def spelled(r: Rollout, form: str, order: Any) -> dict[str, Any]:
    """The columns of joints by their names, in an order of their own."""
    names = np.array(r.names[1:])
    return {
        form.format(kind, names[k]): values[:, k]
        for kind, values in (("pos", r.joints), ("vel", r.rates))
        for k in order
    }


def odometry(r: Rollout) -> dict[str, Any]:
    """ROS's odometry, velocities in the body's components."""
    parts = {
        "pose.pose.position": (r.p, "xyz"), "pose.pose.orientation": (r.xyzw, "xyzw"),
        "twist.twist.linear": (r.v_body, "xyz"), "twist.twist.angular": (r.w, "xyz"),
    }  # fmt: skip
    return {
        f"odom.{n}.{c}": x for n, (part, letters) in parts.items() for c, x in zip(letters, part.T)
    }


BREADTH_FIRST = [0, 2, 4, 6, 1, 3, 5, 7]
"""Isaac Lab's order of the ant's joints: hips, then ankles."""


def lab(r: Rollout, order: Any, **more: Any) -> dict[str, Any]:
    """Isaac Lab's names."""
    return dict(
        time=r.t, root_pos_w=r.p, root_quat_w=r.wxyz, root_lin_vel_b=r.v_body, root_ang_vel_b=r.w,
        joint_pos=r.joints[:, order], joint_vel=r.rates[:, order], **more,
    )  # fmt: skip


def ants() -> Iterator[tuple[str, str, Callable[[Rollout], dict[str, Any]], str]]:
    """Name, outcome, columns, suffix."""
    yield "arrays", READ, lambda r: {"time": r.t, "qpos": r.q, "qvel": r.u, "ctrl": r.ctrl}, "npz"
    yield "lines", READ, lambda r: {"t": r.t, "qpos": r.q, "qvel": r.u}, "jsonl"
    yield "brackets", READ, lambda r: {"time": r.t, **numbered("{}[{}]", r)}, "csv"
    yield "underscores", READ, lambda r: {"time": r.t, **numbered("{}_{}", r)}, "csv"
    yield "padded", READ, lambda r: {"time": r.t, **numbered("{}.{:02d}", r)}, "csv"
    yield (
        "sorted",
        READ,
        lambda r: {"time": r.t, **dict(sorted(numbered("{}_{}", r).items()))},
        "csv",
    )
    yield (
        "skip",
        READ,
        lambda r: {"qpos": r.q, "qvel": r.u, "dt": r.dt, "frame_skip": r.skip},
        "npz",
    )
    yield "state", READ, lambda r: {"time": r.t, "state": np.hstack([r.q, r.u])}, "npz"
    yield "robosuite", READ, lambda r: {"states": np.column_stack([r.t, r.q, r.u])}, "npz"
    yield "pinocchio", READ, lambda r: {
        "t": r.t, "q": np.hstack([r.p, r.xyzw, r.joints]), "v": np.hstack([r.v_body, r.w, r.rates])
    }, "npz"  # fmt: skip
    yield "drake", READ, lambda r: {
        "time": r.t, "data": np.hstack([r.wxyz, r.p, r.joints, r.w_world, r.v, r.rates])
    }, "npz"  # fmt: skip
    yield "other order", READ, lambda r: {
        "time": r.t, "qpos": np.hstack([r.p, r.xyzw, r.joints]), "qvel": r.u
    }, "npz"  # fmt: skip
    yield "lab", READ, lambda r: lab(
        r, BREADTH_FIRST, joint_names=np.array(r.names[1:])[BREADTH_FIRST]
    ), "npz"  # fmt: skip
    yield "lab without names", REFUSED, lambda r: lab(r, BREADTH_FIRST), "npz"
    yield "gym", REFUSED, lambda r: {
        "root_states": np.hstack([r.p, r.xyzw, r.v, r.w_world]), "dof_pos": r.joints,
        "dof_vel": r.rates, "dt": r.dt * r.skip,
    }, "npz"  # fmt: skip
    yield "topics", READ, lambda r: {
        "time": r.t, **spelled(r, "joint_states.{}.{}", range(7, -1, -1)), **odometry(r)
    }, "csv"  # fmt: skip
    yield (
        "observation",
        REFUSED,
        lambda r: {"time": r.t, "obs": np.hstack([r.q[:, 2:], r.u])},
        "npz",
    )


def write(path: Path, columns: dict[str, Any]) -> None:
    """A log in the form of its suffix."""
    if path.suffix == ".npz":
        np.savez(path, **columns)
    elif path.suffix == ".jsonl":
        rows = ({n: x[k].tolist() for n, x in columns.items()} for k in range(len(columns["t"])))
        path.write_text("\n".join(map(json.dumps, rows)))
    else:
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(np.column_stack(list(columns.values())).tolist())


def judge(model: str, r: Rollout, path: Path, outcome: str) -> dc.Trajectory | None:
    """Assert that a log is read right, after an unedited draft, or refused."""
    machine = mechanism(model)
    try:
        run, found = read_trajectory(path, machine), READ
    except dc.InputError:
        mapping = path.with_suffix(".toml")
        mapping.write_text(draft_mapping(path, machine), "utf-8")
        try:
            run, found = read_trajectory(path, mapping, machine), DRAFTED
        except dc.InputError:
            assert outcome == REFUSED
            return None
    assert run.q == pytest.approx(r.q, abs=1e-6), run.provenance.reading
    assert run.u == pytest.approx(r.u, abs=1e-5), run.provenance.reading
    assert found == outcome
    return run


@pytest.mark.parametrize(
    ("name", "outcome", "columns", "suffix"), list(ants()), ids=lambda x: str(x)[:20]
)
def test_ants(name: str, outcome: str, columns: Any, suffix: str, tmp_path: Path) -> None:
    r = rollout("ant")
    write(path := tmp_path / f"log.{suffix}", columns(r))
    run = judge("ant", r, path, outcome)
    if name == "other order":  # the names say MuJoCo's, the motion speaks against it: aloud
        assert run is not None and any("quaternion xyzw" in text for text in run.provenance.guessed)


@pytest.mark.parametrize("seed", [12, 26, 36])
@pytest.mark.parametrize("form", ["{}[{}]", "{}_{}"])
def test_a_joint_that_moves_like_the_base_is_none(seed: int, form: str, tmp_path: Path) -> None:
    """In contact the base's columns fit its velocity less well than three joints' do."""
    r = rollout("ant", seed)
    write(path := tmp_path / "log.csv", {"time": r.t, **numbered(form, r)})
    run = judge("ant", r, path, READ)
    assert run is not None and not run.provenance.guessed
    assert run.provenance.reading.startswith("read as time from time because")
    assert all(name in run.provenance.reading for name in ("qpos", "qvel", "width"))


@pytest.mark.parametrize("model", ["humanoid", "half_cheetah", "hopper", "swimmer", "pusher"])
def test_other_robots(model: str, tmp_path: Path) -> None:
    r = rollout(model, 1)
    write(path := tmp_path / "log.npz", {"time": r.t, "qpos": r.q, "qvel": r.u, "action": r.ctrl})
    judge(model, r, path, READ)
    order = slice(None, None, -1)
    named = {f"{n}_pos": x for n, x in zip(r.names[order], r.q.T[order])}
    named |= {f"{n}_vel": x for n, x in zip(r.names[order], r.u.T[order])}
    if model != "humanoid":
        write(path := tmp_path / "log.csv", {"t": r.t, **named})
        judge(model, r, path, READ)
    write(path := tmp_path / "obs.npz", {"time": r.t, "obs": np.hstack([r.q[:, 1:], r.u])})
    judge(model, r, path, REFUSED)


def test_what_is_guessed_is_kept_in_the_log(tmp_path: Path) -> None:
    r = rollout("ant")
    state = np.hstack([r.wxyz, r.p, r.joints, r.w_world, r.v, r.rates])
    run = read_trajectory({"time": r.t, "data": state}, model=mechanism("ant"))
    assert any("velocity in world" in text for text in run.provenance.guessed)
    run.write(tmp_path / "run.parquet")
    assert read_trajectory(tmp_path / "run.parquet").provenance == run.provenance


def test_the_motion_objects_to_what_the_names_declare(tmp_path: Path) -> None:
    r = rollout("ant")
    swapped = {"time": r.t, "qpos": np.hstack([r.u, r.u[:, :1]]), "qvel": r.q[:, :14]}
    with pytest.raises(dc.InputError, match="no unit quaternion"):
        read_trajectory(swapped, model=mechanism("ant"))
    c = rollout("half_cheetah")
    shifted = {"time": c.t, "observation": np.hstack([c.q[:, 1:], c.u, c.t[:, None]])}
    with pytest.raises(dc.InputError):  # all but one column move as its own speed says
        read_trajectory(shifted, model=mechanism("half_cheetah"))


def test_what_is_wanted_or_comes_next_did_not_happen(tmp_path: Path) -> None:
    r = rollout("ant")
    log = {
        "time": r.t, "target_qpos": r.q + 0.1, "next_qpos": np.roll(r.q, -1, 0), "qvel_cmd": 0.0 * r.u,
        "qpos": r.q, "qvel": r.u, "foot_pos": r.p + 1.0, "foot_quat": r.xyzw,
    }  # fmt: skip
    run = read_trajectory(log, model=mechanism("ant"))
    assert np.array_equal(run.q, r.q) and np.array_equal(run.u, r.u)
