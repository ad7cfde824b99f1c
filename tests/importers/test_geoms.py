"""Geoms of MuJoCo models as shapes; the gaps between them against MuJoCo's own distances."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np
import pytest

from deltac import InputError, read_mechanism, read_shapes
from deltac.dynamics.gaps import gaps
from deltac.dynamics.system import trace
from deltac.mechanism.shapes import Box, Capsule, HalfSpace, Sphere

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: the extra 'mujoco'")

XML = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" euler="10 20 0" pos="0 0 -1"/>
  <body name="a" pos=".3 0 .2"><freejoint/>
    <geom name="ball" type="sphere" size=".15" pos=".1 .05 0" mass="1"/>
    <geom name="sight" type="sphere" size=".4" contype="0" conaffinity="0" mass="0"/></body>
  <body name="b" euler="30 0 40"><joint type="ball"/>
    <geom name="pill" type="capsule" fromto="-.2 0 .1 .3 .2 0" size=".1" mass="1"/></body>
  <body name="c" pos="0 .5 .5"><freejoint/>
    <geom name="crate" type="box" size=".2 .3 .1" euler="15 25 35" pos="0 .1 .1" mass="1"/>
    <geom name="drum" type="cylinder" size=".1 .2" mass="1"/></body>
  <body name="d" pos="1 0 0"><freejoint/>
    <geom name="other pill" type="capsule" size=".12 .25" euler="50 0 0" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def model() -> Any:
    return mujoco.MjModel.from_xml_string(XML)


def test_what_is_read_and_what_is_left_out(model: Any) -> None:
    shapes, left_out = read_shapes(model)
    assert {name: type(shape) for name, shape in shapes.items()} == {
        "floor": HalfSpace,
        "ball": Sphere,
        "pill": Capsule,
        "crate": Box,
        "other pill": Capsule,
    }
    assert [(remark.element, remark.what) for remark in left_out] == [
        ("drum", "cylinder has no shape here; stand spheres in for it")
    ]
    assert shapes["floor"].body == "ground"


#: pairs whose gap is the distance itself; corners alone stand for boxes on boxes and capsules on boxes
EXACT = [
    pair
    for pair in combinations(("ball", "pill", "crate", "other pill"), 2)
    if set(pair) not in ({"pill", "crate"}, {"crate", "other pill"})
]


@pytest.mark.parametrize("pair", EXACT, ids="-".join)
def test_gaps_are_mujocos_distances(model: Any, pair: tuple[str, str]) -> None:
    mechanism, _ = read_mechanism(model)
    shapes, _ = read_shapes(model)
    system = trace(mechanism)
    (gap,) = gaps(system, shapes[pair[0]], shapes[pair[1]])
    f = ca.Function("f", [system.q], [gap.gap, gap.on_first, gap.on_second])
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    apart = 0
    ids = [model.geom(name).id for name in pair]
    for _ in range(30):
        q = np.array(model.qpos0)
        mujoco.mj_integratePos(model, q, rng.normal(0, 0.6, model.nv), 1.0)
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        ends = np.zeros(6)
        distance = mujoco.mj_geomDistance(model, data, *ids, 10.0, ends)
        g, first, second = (np.array(value).ravel() for value in f(q))
        if distance <= 1e-3:
            continue  # where shapes overlap, its search has another depth
        apart += 1
        # MuJoCo searches for the nearest points up to a tolerance of 1e-6.
        assert float(g[0]) == pytest.approx(distance, abs=2e-6)
        # Points are as sharp as the distance is flat about them.
        np.testing.assert_allclose(np.concatenate([first, second]), ends, atol=5e-3)
    assert apart >= 10


@pytest.mark.parametrize("name", ["ball", "pill", "crate"])
def test_gaps_to_a_plane(model: Any, name: str) -> None:
    """The least height of the geom's points, over MuJoCo's own frames."""
    mechanism, _ = read_mechanism(model)
    shapes, _ = read_shapes(model)
    system = trace(mechanism)
    found = gaps(system, shapes["floor"], shapes[name])
    f = ca.Function("f", [system.q], [ca.vertcat(*(g.gap for g in found))])
    data = mujoco.MjData(model)
    rng = np.random.default_rng(6)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(0, 0.6, model.nv), 1.0)
    mujoco.mj_kinematics(model, data)
    k = model.geom(name).id
    x, R, size = data.geom_xpos[k], data.geom_xmat[k].reshape(3, 3), model.geom_size[k]
    floor = model.geom("floor").id
    n = data.geom_xmat[floor].reshape(3, 3)[:, 2]
    height = n @ (x - data.geom_xpos[floor])
    reach = {"ball": size[0], "pill": size[0] + size[1] * abs(n @ R[:, 2])}
    reach["crate"] = float(np.abs(n @ R) @ size)
    assert float(np.array(f(data.qpos)).min()) == pytest.approx(height - reach[name], abs=1e-12)


def test_files_that_are_not_there() -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_shapes("nowhere.xml")
