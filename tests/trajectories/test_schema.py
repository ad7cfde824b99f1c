"""Column names and metadata of the log schema."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from deltac.errors import InputError
from deltac.trajectories import (
    Provenance,
    Trajectory,
    from_columns,
    read_trajectory,
    to_columns,
    to_metadata,
)

T = np.array([0.0, 0.5, 1.0])


def log(*names: str) -> dict[str, Any]:
    """Distinct samples for each column."""
    return {"time": T} | {name: T + 10.0 * i for i, name in enumerate(names, start=1)}


def test_columns_stand_in_the_order_of_the_schema() -> None:
    table = np.arange(6.0).reshape(3, 2)
    run = Trajectory(
        t=T,
        q=table,
        u=table + 10,
        udot=table + 20,
        forces={"gravity": table + 30, "spring left hip.y": table + 40},
        integrals={"liu-huston": T},
        coordinates=("base.x", "knee"),
        speeds=("base.vx", "knee"),
    )
    columns = to_columns(run)
    assert list(columns) == [
        "time",
        "q.base.x",
        "q.knee",
        "u.base.vx",
        "u.knee",
        "udot.base.vx",
        "udot.knee",
        "force.gravity.base.vx",
        "force.gravity.knee",
        "force.spring left hip.y.base.vx",
        "force.spring left hip.y.knee",
        "integral.liu-huston",
    ]
    assert np.array_equal(columns["udot.knee"], [21, 23, 25])
    assert np.array_equal(columns["force.spring left hip.y.base.vx"], [40, 42, 44])


def test_a_foreign_log_is_read_by_its_column_names() -> None:
    run = from_columns(
        log(
            "u.knee",
            "q.knee",
            "force.spring left.hip.base.vx",
            "q.base.x",
            "u.base.vx",
            "integral.wang",
            "force.gravity.knee",
            "udot.base.vx",
            "udot.knee",
        )
    )
    assert run.coordinates == ("knee", "base.x")
    assert run.speeds == ("knee", "base.vx")
    assert np.array_equal(run.speed("base.vx"), T + 50)
    assert list(run.forces) == ["spring left.hip", "gravity"]
    assert np.array_equal(run.forces["spring left.hip"], np.column_stack([0 * T, T + 30]))
    assert np.array_equal(run.forces["gravity"], np.column_stack([T + 70, 0 * T]))
    assert run.udot is not None and np.array_equal(run.udot, np.column_stack([T + 90, T + 80]))
    assert np.array_equal(run.integrals["wang"], T + 60)
    assert run.provenance == Provenance("unknown")


def test_a_dotted_element_is_told_apart_by_the_kinds() -> None:
    # 'gravity.base' is no channel, so that the speed can only be 'base.vx'.
    run = from_columns(log("q.x", "u.vx", "u.base.vx", "force.gravity.base.vx"))
    assert np.array_equal(run.forces["gravity"], np.column_stack([0 * T, T + 40]))


def test_metadata_settle_what_the_names_cannot() -> None:
    names = ("q.x", "u.vx", "u.base.vx", "force.applied hand.base.vx")
    with pytest.raises(InputError, match="ambiguous.*'applied hand.base' or 'applied hand'"):
        from_columns(log(*names))
    run = Trajectory(
        t=T,
        q=np.ones((3, 1)),
        u=np.ones((3, 2)),
        forces={"applied hand": np.column_stack([T, -T])},
        coordinates=("x",),
        speeds=("vx", "base.vx"),
    )
    back = from_columns(to_columns(run), to_metadata(run))
    assert np.array_equal(back.forces["applied hand"], run.forces["applied hand"])


def test_two_forces_in_one_column_are_refused() -> None:
    run = Trajectory(
        t=T,
        q=np.ones((3, 1)),
        u=np.ones((3, 2)),
        forces={"applied a": np.ones((3, 2)), "applied a.b": np.ones((3, 2))},
        coordinates=("x",),
        speeds=("c", "b.c"),
    )
    with pytest.raises(InputError, match=r"two columns would be named 'force\.applied a\.b\.c'"):
        to_columns(run)
    with pytest.raises(InputError, match=r"two columns would be named 'force\.applied a\.b\.c'"):
        from_columns({"time": T}, to_metadata(run))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("u.a",), r"no column 'q\.<coordinate>'"),
        (("q.a",), r"no column 'u\.<speed>'"),
        (("q.a", "u.a", "uddot.a"), r"unknown column 'uddot\.a'; did you mean 'udot\.a'"),
        (("q.a", "u.a", "tme"), r"unknown column 'tme'; did you mean 'time'"),
        (("q.a", "u.a", "temperature [K]"), r"unknown column 'temperature \[K\]'; known: time, q"),
        (("q.a", "u.a", "u.b", "udot.a"), r"no column 'udot\.b' \(add or rename"),
        (("q.a", "u.elbow", "udot.elbwo"), r"no speed 'u\.elbwo'; did you mean 'elbow'"),
        (("q.a", "u.elbow", "force.damper elbow"), "name of a speed at its end.*elbow"),
        (("q.a", "u.elbow", "force.damper x.elbwo"), "did you mean 'elbow'"),
        (("q.a", "u.a", "force.dampr x.a"), r"'force\.dampr x\.a'.*did you mean 'damper'"),
        (("q.a", "u.a", "force.damper.a"), r"'force\.damper\.a'.*names no element"),
    ],
)
def test_columns_that_a_foreign_log_cannot_have(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        from_columns(log(*names))


def test_missing_time_suggests_what_may_be_it() -> None:
    with pytest.raises(InputError, match="no column 'time'; did you mean 'Time'"):
        from_columns({"Time": T, "q.a": T, "u.a": T})


def test_columns_of_different_lengths_or_types() -> None:
    with pytest.raises(InputError, match=r"'u\.a': found shape \(2,\), time has \(3,\)"):
        from_columns({"time": T, "q.a": T, "u.a": T[:2]})
    with pytest.raises(InputError, match=r"'u\.a'.*found values of type <U1"):
        from_columns({"time": T, "q.a": T, "u.a": ["1", "2", "3"]})


def pendulum() -> Trajectory:
    return Trajectory(
        t=T,
        q=np.ones((3, 1)),
        u=np.ones((3, 1)),
        forces={"damper elbow": np.ones((3, 1))},
        coordinates=("elbow",),
        speeds=("elbow",),
        provenance=Provenance("deltac", model="pendulum"),
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 2}, "schema version 2, this deltac reads up to 1. Update deltac"),
        ({"schema_version": 0}, "schema_version is 0"),
        ({"schema_version": True}, "schema_version is True, expected int"),
        ({"units": {"angle": "deg"}}, "angle in 'deg', expected 'rad'"),
        ({"rows": 4}, "found 3 rows, the metadata say 4: the log is cut off"),
        ({"coordinates": "elbow"}, "coordinates is 'elbow', expected list"),
        ({"coordinates": [1]}, r"coordinates is \[1\], expected a list of names"),
        ({"coordinates": ["elbow", "knee"]}, r"no column 'q\.knee'"),
        ({"accelerations": True}, r"no column 'udot\.elbow'"),
        ({"channels": []}, r"'force\.damper elbow\.elbow' is not among"),
        ({"channels": ["damper elbow", "gravity"]}, r"no column 'force\.gravity\.elbow'"),
        ({"provenance": {"simulatr": "x"}}, "unknown provenance 'simulatr'; did you mean"),
        ({"provenance": {"step": -1}}, "step is -1"),
        ({"provenance": None}, "provenance is None, expected dict"),
    ],
)
def test_metadata_that_do_not_fit(change: dict[str, Any], message: str) -> None:
    run = pendulum()
    with pytest.raises(InputError, match=message):
        from_columns(to_columns(run), to_metadata(run) | change)


def test_a_renamed_column_is_suggested() -> None:
    columns = to_columns(pendulum())
    columns["q.elbwo"] = columns.pop("q.elbow")
    with pytest.raises(InputError, match=r"no column 'q\.elbow'; did you mean 'q\.elbwo'"):
        from_columns(columns, to_metadata(pendulum()))


@pytest.mark.parametrize("key", ["schema_version", "coordinates", "channels", "provenance"])
def test_metadata_that_lack_an_entry(key: str) -> None:
    run = pendulum()
    metadata = to_metadata(run)
    del metadata[key]
    with pytest.raises(InputError, match=f"metadata: no entry '{key}'"):
        from_columns(to_columns(run), metadata)


@pytest.mark.parametrize("described", [True, False])
def test_forces_at_stages_come_back(described: bool) -> None:
    stages = np.arange(9.0).reshape(3, 3, 1) + 1.0
    run = replace(pendulum(), stages=stages)
    columns = to_columns(run)
    assert [name for name in columns if name.startswith("stage")] == [
        "stage2.elbow",
        "stage3.elbow",
        "stage4.elbow",
    ]
    again = from_columns(columns, to_metadata(run) if described else None)
    assert again.stages is not None
    assert np.array_equal(again.stages, stages)


def test_a_table_with_forces_at_stages_is_read() -> None:
    columns = to_columns(replace(pendulum(), stages=np.ones((3, 2, 1))))
    run = read_trajectory(columns)
    assert run.stages is not None and run.stages.shape == (3, 2, 1)


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ("stage2.wrist", r"'stage2\.wrist': no speed 'u\.wrist'; known: elbow"),
        ("stage3.elbow", r"there is none of 'stage2\.<speed>'"),
    ],
)
def test_stages_that_do_not_fit(column: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_trajectory(to_columns(pendulum()) | {column: T})


def test_to_frame_has_the_columns_of_the_schema() -> None:
    frame = pendulum().to_frame()
    assert frame.columns == ["time", "q.elbow", "u.elbow", "force.damper elbow.elbow"]
    assert frame["time"].to_list() == [0.0, 0.5, 1.0]
