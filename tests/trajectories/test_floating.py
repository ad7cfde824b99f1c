"""A floating body in foreign logs: found by its motion, turned into the schema's components."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import deltac as dc
from deltac.arrays import Array
from deltac.trajectories import draft_mapping, read_trajectory
from deltac.trajectories.formats.floating import floating_base, packed
from tests.natural_logs import generate, models
from tests.natural_logs.cases import HERE

WALK = generate.walk()
NOISE = 1e-3 * np.random.default_rng(1).normal(size=(len(WALK.t), 40)).cumsum(axis=0)


@pytest.mark.parametrize("linear", ["world", "body"])
@pytest.mark.parametrize("angular", ["world", "body"])
@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
@pytest.mark.parametrize("position_first", [True, False])
@pytest.mark.parametrize("linear_first", [True, False])
def test_every_convention_is_told(
    linear: str, angular: str, order: str, position_first: bool, linear_first: bool
) -> None:
    p = WALK.quat if order == "wxyz" else WALK.xyzw
    v = WALK.v if linear == "world" else WALK.v_body
    w = WALK.w if angular == "body" else WALK.w_world
    q = [WALK.p, p] if position_first else [p, WALK.p]
    u = [v, w] if linear_first else [w, v]
    table = named("q", *q, WALK.q) | named("u", *u, WALK.u) | named("other", NOISE[:, :9])
    layouts = list(packed([n for n in table if n[0] == "q"], [n for n in table if n[0] == "u"]))
    found = floating_base(WALK.t, table, layouts)
    assert found is not None
    assert (found.order, found.linear_frame, found.angular_frame) == (order, linear, angular)
    for columns, values in (
        (found.layout.position, WALK.p),
        (found.quaternion, WALK.quat),
        (found.layout.linear, v),
    ):
        assert np.array_equal(np.column_stack([table[name] for name in columns]), values)


def named(name: str, *parts: Array) -> dict[str, Array]:
    """The columns of an array by their names."""
    return {f"{name}[{k}]": column for k, column in enumerate(np.hstack(parts).T)}


def test_no_body_is_seen_where_none_is() -> None:
    noise = named("q", NOISE[:, :9]) | named("u", NOISE[:, 9:17])
    turning = noise | named("q", NOISE[:, :3], WALK.quat, NOISE[:, 3:5])  # turns by no velocity
    layouts = list(packed([f"q[{k}]" for k in range(9)], [f"u[{k}]" for k in range(8)]))
    assert floating_base(WALK.t, noise, layouts) is None
    assert floating_base(WALK.t, turning, layouts) is None


def test_accelerations_of_body_components_are_those_of_the_origin() -> None:
    """Pinocchio's a holds the rates of v's components; u̇ of the log is compared with the derivative of u."""
    path = HERE / "logs" / "pinocchio_floating.npz"
    run = read_trajectory(path, None, models.walker())
    assert run.udot is not None
    rates = CubicSpline(run.t, run.u).derivative()(run.t)
    inner = slice(5, -5)  # splines are less exact at their ends
    assert run.udot[inner] == pytest.approx(rates[inner], abs=2e-3)
    # Free fall: the mass centre accelerates by gravity, whatever the trunk does.
    assert run.u[:, :3] == pytest.approx(WALK.v, abs=1e-9)


def test_a_wrench_on_the_body_is_turned_into_the_schema() -> None:
    """Pinocchio's τ of the width of v: six components on the body, in its frame, then the joints'."""
    rng = np.random.default_rng(2)
    force, moment = rng.standard_normal((2, len(WALK.t), 3))
    table = {
        "t": WALK.t,
        "q": np.hstack([WALK.p, WALK.xyzw, WALK.q]),
        "v": np.hstack([WALK.v_body, WALK.w, WALK.u]),
        "tau": np.hstack([force, moment, 0.1 * WALK.u]),
    }
    run = read_trajectory(table, None, models.walker())
    [wrench] = [f for name, f in run.forces.items() if name.kind == "applied"]
    in_world = Rotation.from_quat(WALK.xyzw).apply(force)
    assert wrench[:, :6] == pytest.approx(np.hstack([in_world, moment]), abs=1e-9)
    others = [f for name, f in run.forces.items() if name.kind == "actuator"]
    assert np.sum(others, axis=0)[:, 6:] == pytest.approx(0.1 * WALK.u)


def test_a_mapping_says_frames(tmp_path: Path) -> None:
    walker, path = models.walker(), HERE / "logs" / "pybullet_floating.npz"
    mapping = tmp_path / "map.toml"
    mapping.write_text(text := draft_mapping(path, walker), "utf-8")
    assert text.count('frame = "world"') == 3
    run = read_trajectory(path, mapping, walker)
    assert run.u == pytest.approx(np.hstack([WALK.v, WALK.w, WALK.u]), abs=1e-9)
    assert "F-FRAMES" in {finding.code for finding in dc.audit(walker, path).findings}
    mapping.write_text(text.replace(', frame = "world"', "", 1), "utf-8")
    with pytest.raises(dc.InputError, match="one frame"):
        read_trajectory(path, mapping, walker)


def test_slower_odometry_is_interpolated() -> None:
    pytest.importorskip("rosbags", reason="the extra 'ros' is not installed")
    run = read_trajectory(HERE / "logs" / "odometry_slower.mcap", None, models.walker())
    assert run.provenance.converted == ("odom: interpolated to the times of /joint_states",)
    # Cubic splines over 10 ms err by 5/384 h⁴ |x⁗|, of angular velocities of some 10 rad/s⁵.
    assert run.u[:, :6] == pytest.approx(np.hstack([WALK.v, WALK.w])[: len(run)], abs=1e-3)
