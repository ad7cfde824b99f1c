"""Mapping files: other names, units, orders and signs, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from deltac import Mechanism, free, prismatic, revolute
from deltac.bodies import frame, sphere
from deltac.errors import InputError
from deltac.trajectories import MechanismNames, explain, read_mapping, read_trajectory
from deltac.trajectories.trajectory import Trajectory

T = np.linspace(0.0, 1.0, 5)

FULL = """
[log]
simulator = "RigSim 3"
time = { column = "t_ms", unit = "ms" }

[units]
angular_speed = "rpm"

[coordinates]
elbow = { column = "pos", unit = "deg", sign = -1, offset = 90 }
rail = { column = "x [mm]" }
crank = { constant = 30, unit = "deg" }
"base.x" = "px"
"base.y" = { constant = 0.0 }
"base.z" = { constant = 1.5 }

[quaternions]
base = { columns = ["a", "b", "c", "d"], order = "xyzw" }

[speeds]
elbow = "vel"
rail = { column = "v", unit = "mm/s" }
crank = { constant = 0 }
"base.vx" = "px_dot"
"base.vy" = { constant = 0 }
"base.vz" = { constant = 0 }
"base.wx" = { constant = 0, unit = "rad/s" }
"base.wy" = { constant = 0, unit = "rad/s" }
"base.wz" = { constant = 0, unit = "rad/s" }

[forces."actuator left motor"]
elbow = { column = "tau", unit = "N*mm", sign = -1 }
"""

MACHINE = Mechanism(
    bodies=[sphere("a", mass=1.0, radius=1.0), frame("b"), sphere("c", mass=1.0, radius=1.0)]
    + [sphere("d", mass=1.0, radius=1.0)],
    joints=[
        free("base", "a"),
        prismatic("rail", "a", "b"),
        revolute("elbow", "b", "c"),
        revolute("crank", "a", "d"),
    ],
)


def log(folder: Path, **changes: Any) -> Path:
    columns = {
        "t_ms": T * 1e3,
        "pos": 10.0 * T,
        "vel": 60.0 + T,
        "x [mm]": 1e3 * T,
        "v": 1e3 + 0 * T,
        "px": T**2,
        "px_dot": 2 * T,
        "a": 0 * T + 0.1,
        "b": 0 * T + 0.2,
        "c": 0 * T + 0.3,
        "d": 0 * T + 0.9,
        "tau": 500.0 * T,
        "temperature": 20 + T,
    }
    polars.DataFrame(columns | changes).write_csv(folder / "log.csv")
    return folder / "log.csv"


def toml(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, "utf-8")
    return path


def full(folder: Path, text: str = FULL, **changes: Any) -> Trajectory:
    return read_trajectory(log(folder, **changes), toml(folder, text), MACHINE)


def test_everything_a_mapping_can_say(tmp_path: Path) -> None:
    run = full(tmp_path)
    assert run.coordinates == MACHINE.coordinates.names and run.speeds == MACHINE.speeds.names
    # Conversions are a multiplication and an addition: a few roundings.
    near = {"rtol": 1e-14, "atol": 1e-14}
    assert np.allclose(run.t, T, **near)  # type: ignore[arg-type]
    assert np.allclose(run.coordinate("elbow"), np.deg2rad(90.0 - 10.0 * T), **near)  # type: ignore[arg-type]
    assert np.allclose(run.coordinate("rail"), T, **near)  # type: ignore[arg-type]
    assert np.allclose(run.coordinate("crank"), np.pi / 6, **near)  # type: ignore[arg-type]
    assert np.allclose(run.coordinate("base.x"), T**2, **near)  # type: ignore[arg-type]
    quaternion = [run.coordinate(f"base.q{c}")[0] for c in "wxyz"]
    assert np.allclose(quaternion, [0.9, 0.1, 0.2, 0.3], **near)  # type: ignore[arg-type]
    assert np.allclose(run.speed("elbow"), (60.0 + T) * 2 * np.pi / 60, **near)  # type: ignore[arg-type] # rpm, by [units]
    assert np.allclose(run.speed("rail"), 1.0, **near)  # type: ignore[arg-type]
    ((channel, force),) = run.forces.items()
    assert channel == "actuator left motor"
    assert np.allclose(force[:, run.speeds.index("elbow")], -0.5 * T, **near)  # type: ignore[arg-type]
    assert np.count_nonzero(force.any(axis=0)) == 1
    assert run.provenance.simulator == "RigSim 3"
    assert run.provenance.ignored == ("temperature",)


def test_explain_says_how_each_column_is_read(tmp_path: Path) -> None:
    readings = explain(log(tmp_path), toml(tmp_path, FULL), MACHINE)
    by_column = {r.column: r for r in readings}
    assert by_column["pos"].meaning == "q.elbow" and by_column["pos"].unit == "deg"
    assert by_column["pos"].factor == pytest.approx(-np.pi / 180, rel=1e-15)
    assert by_column["pos"].offset == pytest.approx(np.pi / 2, rel=1e-15)
    assert by_column["x [mm]"].note == "unit from the column's name"
    assert by_column["vel"].note == "unit from [units] of the mapping"
    assert by_column["temperature"].meaning == ""
    assert "ignored" in by_column["temperature"].note
    assert [r.meaning for r in readings if not r.column][:1] == ["q.crank"]


def test_explain_does_not_judge_values(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,q.a,u.a,speed\n0,nan,1,1\n0,2,3,1\n")
    readings = [(r.column, r.meaning) for r in explain(path)]
    assert readings == [("time", "time"), ("q.a", "q.a"), ("u.a", "u.a"), ("speed", "")]


def test_a_quaternion_in_the_schemas_names_but_another_order(tmp_path: Path) -> None:
    parts = {f"q.ball.q{c}": [float(i)] * 2 for i, c in enumerate("wxyz")}
    speeds = {f"u.ball.w{c}": [0.0] * 2 for c in "xyz"}
    polars.DataFrame({"time": [0.0, 1.0]} | parts | speeds).write_parquet(tmp_path / "log.parquet")
    path = toml(tmp_path, '[quaternions]\nball = "xyzw"\n')
    run = read_trajectory(tmp_path / "log.parquet", path)
    assert [run.coordinate(f"ball.q{c}")[0] for c in "wxyz"] == [3.0, 0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[log\n", "rig.toml: is no TOML.*line 1"),
        (
            "[coordinate]\n",
            "rig.toml, line 1, coordinate: unknown table; did you mean 'coordinates'",
        ),
        ("[log]\ntimes = 't'\n", "line 2, log.times: unknown key; did you mean 'time'"),
        ("[log]\nsimulator = 3\n", "line 2, log.simulator: found 3"),
        ("[log]\nangles = 'a'\n", "line 2, log.angles: found 'a', expected a list"),
        ("[coordinates]\n\nelbow = 3\n", "line 3, coordinates.elbow: found 3, expected a column"),
        (
            "[coordinates]\nelbow = {column='a', units='deg'}\n",
            "line 2, coordinates.elbow.units: unknown key; did you mean 'unit'",
        ),
        ("[coordinates]\nelbow = {column='a', constant=1}\n", "either 'column' or 'constant'"),
        (
            "[coordinates]\nelbow = {column='a', unit='dog'}\n",
            "unknown unit 'dog'.*did you mean 'deg'",
        ),
        ("[coordinates]\nelbow = {column='a', sign=2}\n", "sign: found 2.0, expected 1 or -1"),
        (
            "[coordinates]\nelbow = {constant='a'}\n",
            "constant: found 'a', expected a finite number",
        ),
        ("[coordinates]\nelbow = {constant=nan}\n", "found nan, expected a finite number"),
        ("[units]\nangel = 'deg'\n", "line 2, units.angel: unknown key; did you mean 'angle'"),
        ("[units]\nangle = 'mm'\n", "'mm' is not a unit of angle"),
        ("[quaternions]\nbase = 'wxzy'\n", "found 'wxzy', expected 'wxyz' or 'xyzw'"),
        ("[quaternions]\nbase = ['a']\n", "line 2, quaternions.base: found"),
        ("[quaternions]\nb = {columns=['a'], order='wxyz'}\n", "expected four names"),
        (
            "[forces.'motor x']\na = 'b'\n",
            "line 1, forces.motor x: channel 'motor x': expected .*'motor' is no kind",
        ),
        ("[forces]\n'actuator x' = 'b'\n", "expected a table"),
        (
            "[quaternions]\nb = 'wxyz'\n[coordinates]\n'b.qw' = 'c'\n",
            "'q.b.qw' is given twice",
        ),
    ],
)
def test_mappings_that_cannot_be_used(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"(?s){message}"):
        read_mapping(toml(tmp_path, text))


def test_a_mapping_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such mapping file"):
        read_mapping(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"pos"',
            '"poss"',
            r"log\.csv: .*rig\.toml, line 10, coordinates\.elbow: the file has no column 'poss'; did "
            r"you mean 'pos'\? \(it is meant as 'q\.elbow': .*potential energy",
        ),
        ('"t_ms", unit = "ms"', '"t_ms", unit = "mm"', "'mm' is not a unit of 'time'"),
        ('"pos", unit = "deg"', '"pos", unit = "mm"', "'mm' is not a unit of 'q.elbow'; .*rad"),
        (
            'unit = "N*mm"',
            'unit = "N"',
            "'N' is not a unit of 'force.actuator left motor.elbow'.*N.m",
        ),
        ('crank = { constant = 30, unit = "deg" }\n', "", r"no column 'q\.crank'.*constant"),
    ],
)
def test_mappings_that_do_not_fit_the_log(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in FULL
    with pytest.raises(InputError, match=f"(?s){message}"):
        full(tmp_path, FULL.replace(old, new))


def test_a_speed_of_the_mechanism_that_is_missing(tmp_path: Path) -> None:
    names = MechanismNames({"a": "rad", "b": "rad"}, {"a": "rad/s", "b": "rad/s"})
    path = tmp_path / "log.csv"
    path.write_text("time,q.a,q.b,u.a\n0,1,2,3\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"no column 'u\.b'.*kinetic energy.*Add it"):
        read_trajectory(path, model=names)


def test_mixed_units_without_a_mechanism(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,a [mm],b [deg/s]\n0,1,2\n1,2,3\n")
    text = '[log]\ntime = "t"\n[coordinates]\nx = "a [mm]"\n[speeds]\nx = "b [deg/s]"\n'
    with pytest.raises(InputError, match=r"mixed units: 'q\.x' is in 'mm'.*'u\.x' in 'deg/s'"):
        read_trajectory(path, toml(tmp_path, text))


def test_default_units_need_to_know_what_is_an_angle(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,q.a,u.a\n0,180,90\n1,270,90\n")
    units = '[units]\nangle = "deg"\nangular_speed = "deg/s"\n'
    with pytest.raises(InputError, match="whether this is an angle or a length is not known"):
        read_trajectory(path, toml(tmp_path, units))
    run = read_trajectory(path, toml(tmp_path, units + '[log]\nangles = ["a"]\n'))
    assert np.allclose(run.q[:, 0], [np.pi, 1.5 * np.pi], rtol=1e-15)
    assert np.allclose(run.u[:, 0], np.pi / 2, rtol=1e-15)


def test_nan_in_a_column_is_named_by_its_schema_column(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"'q\.rail', row 3 .*found nan"
    ):  # to the end: it diverged
        full(tmp_path, **{"x [mm]": np.array([0, 1, 2, np.nan, np.nan])})  # type: ignore[arg-type]
    run = full(tmp_path, **{"x [mm]": np.array([0, 1, np.nan, 3, 4])})  # type: ignore[arg-type] # a lost sample
    assert run.t.tolist() == [0.0, 0.25, 0.75, 1.0]
    assert run.provenance.notes["left out"].startswith("1 of 5 rows, row 2 the first")
    with pytest.raises(InputError, match=r"'time', row 2 .*found 0\.25 after 0\.25"):
        full(tmp_path, t_ms=np.array([0.0, 250, 250, 750, 1000]))


def test_a_log_of_deltac_needs_no_mapping(tmp_path: Path) -> None:
    full(tmp_path).write(tmp_path / "own.csv")
    with pytest.raises(InputError, match=r"own\.csv: the log has deltac's own metadata"):
        read_trajectory(tmp_path / "own.csv", tmp_path / "rig.toml")


def test_units_in_brackets_need_no_mapping(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,q.elbow (deg),u.elbow (deg/s)\n0,1,0\n1,2,0\n")
    names = MechanismNames({"elbow": "rad"}, {"elbow": "rad/s"})
    run = read_trajectory(path, model=names)
    np.testing.assert_allclose(run.q[:, 0], np.radians([1.0, 2.0]))
