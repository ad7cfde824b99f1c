"""Logs that are damaged, lie about their sizes, or are no files: refused by name, at once, in little memory.

What is refused for its size is read in a process whose memory is bounded; `tests/hostile.py` has the bounds.
"""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from deltac.errors import InputError
from deltac.foreign.limits import SMALL_FILE, Limits, parse_json
from deltac.trajectories import Trajectory, read_trajectory, to_metadata
from tests.support.hostile import outcome

T = np.arange(5.0)
RUN = Trajectory(t=T, q=T[:, None], u=T[:, None], coordinates=("a",), speeds=("a",))
BODY = "time,q.a,u.a\n" + "".join(f"{t},{t},{t}\n" for t in T)
EVENT: dict[str, Any] = dict(
    t=1.0,
    names=["impact floor"],
    q=[1.0],
    u_before=[1.0],
    u_after=[-1.0],
    udot_before=None,
    udot_after=None,
    forces_before={},
    forces_after={},
    impulses={"impact floor": [-2.0]},
)


def refused(path: Path) -> str:
    """What the InputError says; it names the file."""
    with pytest.raises(InputError) as caught:
        read_trajectory(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert len(str(caught.value)) < 2000, "a message is for people"
    return str(caught.value)


def own_csv(folder: Path, header: str) -> Path:
    path = folder / "log.csv"
    path.write_text(f"# deltac {header}\n{BODY}", "utf-8")
    return path


def header(**changes: Any) -> str:
    return json.dumps({**to_metadata(RUN), **changes})


# -- metadata ------------------------------------------------------------------------------------


def test_the_header_that_is_changed_below_is_right(tmp_path: Path) -> None:
    assert len(read_trajectory(own_csv(tmp_path, header())).events) == 0
    whole = header(schema_version=1, events=[EVENT])
    assert read_trajectory(own_csv(tmp_path, whole)).events[0].energy_lost == 0.0


@pytest.mark.parametrize(
    "value", [10**30, 10**400, float("inf"), float("nan"), -1, None, "5", [5], {}, True, 1.5]
)
@pytest.mark.parametrize("entry", ["rows", "schema_version"])
def test_numbers_of_the_header_that_are_none(entry: str, value: Any, tmp_path: Path) -> None:
    refused(own_csv(tmp_path, header(**{entry: value})))


@pytest.mark.parametrize("step", [10**400, float("inf"), -1.0, "1", [1.0], {}, True])
def test_a_step_that_is_no_number(step: Any, tmp_path: Path) -> None:
    provenance = {**to_metadata(RUN)["provenance"], "step": step}
    refused(own_csv(tmp_path, header(provenance=provenance)))


@pytest.mark.parametrize("value", [None, 3, "a", [1], [None], [["a"]], {"a": 1}])
@pytest.mark.parametrize("entry", ["coordinates", "speeds", "channels", "integrals"])
def test_lists_of_names_that_are_none(entry: str, value: Any, tmp_path: Path) -> None:
    refused(own_csv(tmp_path, header(**{entry: value})))


WRONG: dict[str, list[Any]] = {
    "t": [None, "x", [1], {}, True, 10**400],
    "names": [3, None, [1], [[]], "impact floor"],
    "q": [None, {"a": 1}, [[1]], ["1"], [10**400], 3, "1", [None], [True, "x"]],
    "u_before": [None, 3, "x", [{}], [[1.0]], [1.0, 2.0]],
    "udot_before": [3, "x", [1.0]],
    "forces_before": [None, 3, [1], "x", {"bang": [1.0]}, {"damper a": None}],
    "impulses": [[1], {"impact a": "x"}, {"impact a": [[1]]}, {"": [1.0]}],
}


@pytest.mark.parametrize(("entry", "value"), [(k, v) for k, vs in WRONG.items() for v in vs])
def test_events_with_entries_of_wrong_types(entry: str, value: Any, tmp_path: Path) -> None:
    refused(own_csv(tmp_path, header(schema_version=1, events=[{**EVENT, entry: value}])))


@pytest.mark.parametrize("events", [{}, 3, "x", [None], [3], [[]], [{}]])
def test_events_that_are_none(events: Any, tmp_path: Path) -> None:
    refused(own_csv(tmp_path, header(schema_version=1, events=events)))


@pytest.mark.parametrize("depth", [65, 500, 100_000])
@pytest.mark.parametrize("brackets", ["[]", ('{"a":', "}")])
def test_json_that_is_nested_deeply(depth: int, brackets: Any, tmp_path: Path) -> None:
    text = f'{{"units": {brackets[0] * depth}1{brackets[1] * depth}}}'
    assert "DELTAC_LIMITS=nesting=" in refused(own_csv(tmp_path, text))


@pytest.mark.parametrize("digits", [20, 400, 6000])
def test_json_integers_beyond_64_bits(digits: int) -> None:
    with pytest.raises(InputError, match="64 bits"):
        parse_json("9" * digits, "it")
    assert parse_json(str(2**63 - 1), "it") == 2**63 - 1


# -- limits --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "text", "name"),
    [
        ({"columns": 2}, BODY, "columns"),
        ({"rows": 3}, BODY, "rows"),
        ({"bytes": 20}, BODY, "bytes"),
        ({"header": 9}, BODY, "header"),
        ({"header": 30}, "#hi\n" * 10 + BODY, "header"),
        ({"name": 2}, BODY, "name"),
        ({"metadata": 9}, f"# deltac {header()}\n{BODY}", "metadata"),
    ],
)
def test_a_message_says_the_limit_and_the_option_that_raises_it(
    limits: dict[str, int], text: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with Limits(**limits).applied():
        message = refused(path)
    assert f"DELTAC_LIMITS={name}=" in message
    monkeypatch.setenv("DELTAC_LIMITS", " ".join(f"{k}={v}" for k, v in limits.items()))
    assert refused(path) == message
    option = message.partition("DELTAC_LIMITS=")[2].split()[0]
    monkeypatch.setenv("DELTAC_LIMITS", f"{option}, rows=1e6")  # as the message says
    if name not in ("header", "bytes"):  # of which there are several parts
        assert len(read_trajectory(path)) == 5
    monkeypatch.delenv("DELTAC_LIMITS")
    assert len(read_trajectory(path)) == 5


@pytest.mark.parametrize("text", ["colums=3", "columns", "columns=", "columns=x", "columns=-1"])
def test_limits_of_the_environment_that_are_none(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DELTAC_LIMITS", text)
    with pytest.raises(InputError, match="columns"):
        Limits.current()


# -- what is no file -----------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".csv", ".sto", ".npz", ".mat", ".h5", ".parquet"])
def test_what_is_no_regular_file(suffix: str, tmp_path: Path) -> None:
    pipe, device = tmp_path / f"pipe{suffix}", tmp_path / f"zero{suffix}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    assert "a named pipe" in refused(pipe)
    assert "a device" in refused(device)


def test_mappings_that_are_no_files_or_no_mappings(tmp_path: Path) -> None:
    log, pipe, file = tmp_path / "log.csv", tmp_path / "pipe.toml", tmp_path / "m.toml"
    log.write_text(BODY)
    os.mkfifo(pipe)
    for mapping in (pipe, "/dev/zero"):
        with pytest.raises(InputError, match="expected a regular file"):
            read_trajectory(log, mapping)
    for text in (
        "a = " + "[" * 10_000 + "]" * 10_000,
        "a" + ".a" * 5000 + " = 1",
        "[coordinates]\na = { constant = " + "9" * 5000 + " }",
        "[coordinates]\na = { constant = 1e999 }",
        "[coordinates]\na = { column = 'q.a', offset = inf }",
        f"[log]\nsimulator = {'9' * 400}",
        "[log]\ntime = 1979-13-99",
        "[units]\nangle = 'm^" + "9" * 400 + "'",
        " " * 200_000 + "x",
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=r"m\.toml"):
            read_trajectory(log, file)


# -- numbers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["²", "٣", "１", "1_0", "0x1", "1d0", "nan()", "", "1e400"])
@pytest.mark.parametrize("form", ["csv", "sto"])
def test_texts_that_are_no_plain_numbers(form: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / f"log.{form}"
    if form == "csv":
        path.write_text(f"time,q.a,u.a\n0,1,2\n1,{text},2\n", "utf-8")
    else:
        names = "time\t/jointset/j/a/value\t/jointset/j/a/speed"
        path.write_text(f"endheader\n{names}\n0\t1\t2\n1\t{text}\t2\n", "utf-8")
    assert "row 1" in refused(path) or text == ""


@pytest.mark.parametrize("version", ["²", "٣", "9" * 5000, "-1", "1.5"])
def test_versions_of_opensim_that_are_none(version: str, tmp_path: Path) -> None:
    path = tmp_path / "log.sto"
    path.write_text(f"version={version}\nendheader\ntime\ta\n0\t1\n", "utf-8")
    assert "version=" in refused(path)


# -- archives ------------------------------------------------------------------------------------


def npy(text: str, content: bytes = b"") -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + content


@pytest.mark.parametrize(
    "array",
    [
        b"",
        b"\x93NUMPY",
        b"\x93NUMPY\x01\x00\xff\xff",
        b"\x93NUMPY\x09\x00\x01\x00 ",
        npy("("),
        npy("(" * 5000),
        npy("{}"),
        npy("[1, 2]"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1e400,)}"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10**9,)}"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': " + "9" * 5000 + "}"),
        npy("{'descr': 'V99999999999999', 'fortran_order': False, 'shape': (1,)}"),
        npy("{'descr': [[[[[]]]]], 'fortran_order': False, 'shape': (1,)}"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (5,)}", bytes(39)),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (5,)}", bytes(41)),
        npy("{'descr': '|O', 'fortran_order': False, 'shape': (5,)}", bytes(40)),
    ],
)
def test_an_npz_with_a_damaged_array(array: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("time.npy", array)
    refused(path)


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def array(kind: int, shape: tuple[int, ...], name: str, *parts: bytes) -> bytes:
    flags = element(6, struct.pack("<II", kind, 0))
    sizes = element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, flags + sizes + element(1, name.encode()) + b"".join(parts))


MAT = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM"
NUMBER = array(6, (1, 1), "", element(9, bytes(8)))


def deep(levels: int) -> bytes:
    cell = NUMBER
    for _ in range(levels):
        cell = array(1, (1, 1), "", cell)
    return array(1, (1, 1), "x", cell)


@pytest.mark.parametrize(
    "content",
    [
        array(6, (2**31 - 1, 2**31 - 1), "time", element(9, b"")),
        array(6, (-1, 1), "time", element(9, b"")),
        array(6, (5, 1), "time", element(9, bytes(32))),
        array(6, (0, 2**31 - 1), "time", element(9, b"")),
        array(6, (5,), "time", element(9, bytes(40))),
        array(6, (5, 1), "time", element(3, bytes(3))),
        array(1, (2**31 - 1, 1), "time"),
        array(2, (2**31 - 1, 1), "time", element(5, struct.pack("<i", 0)), element(1, b"")),
        array(2, (2**31 - 1, 1), "time", element(5, struct.pack("<i", 32)), element(1, b"a" * 32)),
        array(4, (1, 2), "time", element(12, struct.pack("<qq", -1, 2**40))),
        array(
            5,
            (2, 2),
            "time",
            *[element(5, struct.pack("<iii", 0, 9, 2))] * 2,
            element(9, bytes(16)),
        ),
        array(99, (1, 1), "time"),
        deep(65),
        deep(5000),
        struct.pack("<II", 14, 2**32 - 8),
        struct.pack("<II", 14 | 9 << 16, 0),
        element(15, b"no zlib at all"),
        element(15, zlib.compress(b"")),
        element(15, zlib.compress(struct.pack("<II", 14, 400) + bytes(100))),
        b"\0" * 7,
    ],
    ids=range(20),
)
def test_a_mat_whose_sizes_lie(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(MAT + content)
    refused(path)


@pytest.mark.parametrize(
    "content",
    [
        struct.pack("<5i", 0, 2**30, 2**30, 0, 2) + b"t\0",
        struct.pack("<5i", 0, -1, 1, 0, 2) + b"t\0",
        struct.pack("<5i", 0, 1, 1, 0, -20) + b"t\0",
        struct.pack("<5i", 2, 2, 3, 0, 2) + b"t\0" + np.array([1, 1e9, 1, 1e9, 1, 0.0]).tobytes(),
        struct.pack("<5i", 2, 1, 3, 0, 2) + b"t\0" + np.array([np.nan, 1, 1]).tobytes(),
        struct.pack("<5i", 1, 1, 1, 0, 2) + b"t\0" + np.array([-5.0]).tobytes(),
    ],
    ids=range(6),
)
def test_a_mat_of_version_4_whose_sizes_lie(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(content)
    refused(path)


@pytest.mark.parametrize("form", ["4", "5"])
@pytest.mark.parametrize("compressed", [True, False])
def test_every_kind_of_variable_in_a_mat_file_is_read(
    form: str, compressed: bool, tmp_path: Path
) -> None:
    rng = np.random.default_rng(5)
    values: dict[str, Any] = {"time": T, "q_a": rng.random((5, 1)), "sparse": csc_matrix(np.eye(5))}
    values |= {"m": rng.random((5, 3)), "text": "abc", "one": np.array(2.5), "z": T + 1j * T}
    if form == "5":
        values |= {
            f"i{n}": rng.integers(0, 99, 5).astype(n) for n in ("i1", "u2", "i4", "u8", "f4")
        }
        values |= {"s": {"a": T, "b": {"c": T, "text": "é漢"}}, "cells": np.array([T, "x"], object)}
    path = tmp_path / "log.mat"
    savemat(path, values, format=form, do_compression=compressed and form == "5")
    from deltac.trajectories.formats.matlab import variables

    found = variables(path)
    assert found.keys() == values.keys()
    for name in values.keys() - {"text", "s", "cells", "sparse", "z"}:
        assert np.array_equal(np.ravel(found[name]), np.ravel(values[name])), name
        assert form == "4" or found[name].dtype == np.asarray(values[name]).dtype
    assert found["text"] == "abc"
    assert np.array_equal(found["sparse"], np.eye(5))
    if form == "5":
        assert np.array_equal(found["z"].ravel(), values["z"])
        assert np.array_equal(found["s"]["b"]["c"].ravel(), T)
        assert found["s"]["b"]["text"] == "é漢"
        assert found["cells"][1] == "x"


# -- bombs: in a process with little memory ------------------------------------------------------


BOMB = SMALL_FILE + 2**24
"""Bytes that are too many for a small file to unpack to."""


def npz_bomb(path: Path) -> None:
    size, text = BOMB, io.BytesIO()
    np.lib.format.write_array_header_1_0(
        text, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)}
    )
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("time.npy", "w", force_zip64=True) as file,
    ):
        file.write(text.getvalue())
        for _ in range(size // 2**24):
            file.write(bytes(2**24))


def mat_bomb(path: Path) -> None:
    size, packer = BOMB, zlib.compressobj(1)
    inner = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", size // 8, 1))
    inner += element(1, b"time") + struct.pack("<II", 9, size)
    parts = [packer.compress(struct.pack("<II", 14, len(inner) + size) + inner)]
    parts += [packer.compress(bytes(2**24)) for _ in range(size // 2**24)]
    packed = b"".join(parts) + packer.flush()
    path.write_bytes(MAT + struct.pack("<II", 15, len(packed)) + packed)


def parquet_bomb(path: Path) -> None:
    zeros = polars.zeros(BOMB // 8, dtype=polars.Float64, eager=True)
    polars.DataFrame({"time": zeros}).write_parquet(path)


def hdf5_bomb(path: Path) -> None:
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (10**12,), dtype="f8", chunks=(10**6,))


def mat73_cycle(path: Path) -> None:
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        cell = file.create_dataset("c", (2,), dtype=h5py.ref_dtype)
        cell[0] = cell[1] = cell.ref


def hdf5_cycle(path: Path) -> None:
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file.create_group("a")["b"] = file["/"]


def hdf5_elsewhere(path: Path) -> None:
    h5py: Any = pytest.importorskip("h5py")
    raw = path.with_suffix(".raw")
    raw.write_bytes(bytes(80))
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (10,), dtype="f8", external=[(str(raw), 0, 80)])


def wide(path: Path) -> None:
    names = ",".join(f"q.a{k}" for k in range(10**6))
    path.write_text(f"time,{names}\n0" + ",0" * 10**6)


def blank_rows(path: Path) -> None:
    names = ",".join(f"q.a{k},u.a{k}" for k in range(15_000))
    path.write_text(f"time,{names}\n" + "\n" * 3_000_000 + "0\n")


def comments(path: Path) -> None:
    path.write_text("# a comment, one of many\n" * 1_600_000 + BODY)


def opensim_header(path: Path) -> None:
    path.write_text("key=value\n" * 4_000_000 + "endheader\ntime\ta\n0\t1\n")


def parquet_texts(path: Path) -> None:
    text = polars.DataFrame({"time": ["x" * 10**6]})
    text.select(polars.col("time").repeat_by(600).explode()).write_parquet(path)


@pytest.mark.parametrize(
    ("suffix", "make"),
    [
        (".npz", npz_bomb),
        (".mat", mat_bomb),
        (".parquet", parquet_bomb),
        pytest.param(".parquet", parquet_texts, marks=pytest.mark.slow),
        (".h5", hdf5_bomb),
        pytest.param(".h5", hdf5_cycle, marks=pytest.mark.slow),
        pytest.param(".h5", hdf5_elsewhere, marks=pytest.mark.slow),
        pytest.param(".mat", mat73_cycle, marks=pytest.mark.slow),
        pytest.param(".csv", wide, marks=pytest.mark.slow),
        pytest.param(".csv", blank_rows, marks=pytest.mark.slow),
        (".csv", comments),
        (".sto", opensim_header),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_bombs_are_refused_in_little_memory(
    suffix: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    path = tmp_path / f"log{suffix}"
    make(path)
    assert path.stat().st_size < 60e6
    assert outcome(path).startswith(f"InputError {path}: ")


@pytest.mark.slow
def test_a_wide_log_within_the_limits_is_read(tmp_path: Path) -> None:
    names = ",".join(f"q.a{k},u.a{k},udot.a{k}" for k in range(10_000))
    forces = ",".join(f"force.damper b.a{k}" for k in range(10_000))
    rows = "\n".join(f"{t}" + f",{t}" * 40_000 for t in range(3))
    path = tmp_path / "log.csv"
    path.write_text(f"time,{names},{forces}\n{rows}\n")
    assert outcome(path) == "read 3 10000\n"
