"""OpenSim's tables, written as plain text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.trajectories import MechanismNames, explain, read_trajectory

NAMES = MechanismNames({"tilt": "rad", "tx": "m"}, {"tilt": "rad/s", "tx": "m/s"})
T = np.linspace(0.0, 1.0, 201)


def table(
    path: Path, columns: dict[str, np.ndarray], *header: str, rows: int | None = None
) -> Path:
    lines = ["Coordinates", *header, f"nRows={len(T) if rows is None else rows}"]
    lines += [f"nColumns={len(columns)}", "endheader", "\t".join(columns)]
    lines += ["\t".join(f"{x:.17g}" for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def test_a_motion_in_degrees_with_speeds_by_splines(tmp_path: Path) -> None:
    columns = {"time": T, "tx": np.sin(T), "tilt": np.rad2deg(np.cos(3 * T)), "toe": T}
    path = table(tmp_path / "gait.mot", columns, "version=1", "inDegrees=yes")
    run = read_trajectory(path, model=NAMES)
    assert run.coordinates == run.speeds == ("tilt", "tx")  # the mechanism's order
    assert np.allclose(run.coordinate("tilt"), np.cos(3 * T), atol=1e-14)
    assert np.array_equal(run.coordinate("tx"), np.sin(T))
    # Splines of degree 5: the derivative errs by O(h⁵), at the ends by a larger constant.
    assert np.allclose(run.speed("tilt"), -3 * np.sin(3 * T), atol=3**6 * 0.005**5)
    assert list(run.provenance.derived) == ["u"]
    assert run.provenance.ignored == ("toe",)
    assert "tilt: deg" in run.provenance.converted


@pytest.mark.parametrize("old", [True, False])
def test_states(old: bool, tmp_path: Path) -> None:
    place = "{}" if old else "/jointset/hip/{}/value"
    speed = "{}_u" if old else "/jointset/hip/{}/speed"
    columns = {"time": T}
    for name in ("tilt", "tx"):
        columns |= {place.format(name): np.sin(T), speed.format(name): np.cos(T)}
    columns["/forceset/soleus/activation"] = T
    header = "datarows=201" if old else "DataType=double"
    path = table(tmp_path / "states.sto", columns, "version=3", "inDegrees=no", header)
    run = read_trajectory(path)
    assert run.coordinates == run.speeds == ("tilt", "tx")
    assert np.allclose(run.u[:, 1], np.cos(T), atol=1e-15)
    assert run.provenance.ignored == ("/forceset/soleus/activation",)


def test_what_degrees_mean_may_come_from_a_mapping(tmp_path: Path) -> None:
    columns = {"time": T, "tx": T, "tilt": 90 * T}
    path = table(tmp_path / "gait.mot", columns, "inDegrees=yes")
    mapping = tmp_path / "mapping.toml"
    mapping.write_text('[log]\nangles = ["tilt"]\n[coordinates]\ntilt = "tilt"\ntx = "tx"\n')
    run = read_trajectory(path, mapping)
    assert np.allclose(run.coordinate("tilt"), np.pi / 2 * T, rtol=1e-15)
    assert np.array_equal(run.coordinate("tx"), columns["tx"])
    notes = {r.column: (r.meaning, r.unit, r.note) for r in explain(path, mapping)}
    assert notes["tilt"] == ("q.tilt", "deg", "inDegrees=yes")
    assert notes["tx"][:2] == ("q.tx", "")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (["DataType=Vec3"], "DataType=Vec3: expected double"),
        (["version=9"], "version=9"),
        (["inDegrees=maybe"], "inDegrees=maybe: expected yes or no"),
        (["datarows=7"], "the table has 201 rows, the header says datarows=7"),
        (["datacolumns=7"], "the table has 3 columns, the header says datacolumns=7"),
    ],
)
def test_headers_that_contradict(header: list[str], message: str, tmp_path: Path) -> None:
    path = table(tmp_path / "gait.mot", {"time": T, "tx": T, "tilt": T}, *header)
    with pytest.raises(InputError, match=f"gait\\.mot: {message}"):
        read_trajectory(path, model=NAMES)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time\ttx\n0\t1\n", "no line 'endheader'"),
        ("endheader\n", "no column names after 'endheader'"),
        ("endheader\ntime\ttx\n", "no rows"),
        ("endheader\ntime\ttx\n0\t1\t2\n", "line 3 has 3 fields, expected 2"),
        ("endheader\ntime\ttx\n0\tx\n", "row 0 (of 0 to 0), line 3: found 'x'"),
        ("endheader\ntime\ttx\ttx\n0\t1\t1\n", "'tx' appears twice"),
        ("endheader\ntime\ttx\n0\t1\n", "no column is known to be a coordinate"),
        (
            "inDegrees=yes\nendheader\ntime\t/jointset/a/b/value\n0\t1\n",
            "whether this is an angle or a length is not known",
        ),
        (
            "endheader\ntime\ttx_u\ttx\n0\t1\tnan\n",
            "'q.tx', row 0 (of 0 to 0), t = 0.0 s: found nan",
        ),
    ],
)
def test_tables_that_cannot_be_used(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "log.sto"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_trajectory(path)
    assert message in str(caught.value)


def test_a_coordinate_of_the_mechanism_that_is_missing(tmp_path: Path) -> None:
    path = table(tmp_path / "gait.mot", {"time": T, "tx": T, "tiltt": T})
    with pytest.raises(
        InputError, match=r"no column 'q\.tilt'; did you mean 'tiltt'.*potential energy"
    ):
        read_trajectory(path, model=NAMES)
    with pytest.raises(InputError, match="does not write"):
        read_trajectory(table(tmp_path / "g.mot", {"time": T, "tx_u": T, "tx": T})).write(path)


def test_motors_are_known_by_their_names(tmp_path: Path) -> None:
    """As in OpenSim's files of forces; a control of the same name is no force."""
    arm = dc.Mechanism(
        [dc.point_mass("bob", 1.0, at=(0, -1, 0))],
        [dc.revolute("knee", "ground", "bob")],
        forces=[dc.forces.joint_torque("soleus", "knee")],
    )
    head = "nRows=3\nnColumns={}\ninDegrees=no\nendheader\ntime\t{}\n"
    for name, columns, rows in (
        ("states", "/jointset/k/knee/value\t/jointset/k/knee/speed", ("0\t1", "0.1\t1", "0.2\t1")),
        ("controls", "soleus", ("7", "8", "9")),
        ("Actuation_force", "soleus", ("1", "2", "3")),
    ):
        lines = "".join(f"{0.1 * k:g}\t{row}\n" for k, row in enumerate(rows))
        count = columns.count("\t") + 2
        (tmp_path / f"run_{name}.sto").write_text(name + "\n" + head.format(count, columns) + lines)
    run = dc.read_trajectory(tmp_path, None, arm)
    assert {name: force.tolist() for name, force in run.forces.items()} == {
        "actuator soleus": [[1.0], [2.0], [3.0]]
    }
