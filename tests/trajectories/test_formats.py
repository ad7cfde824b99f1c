"""NPZ, HDF5 and MATLAB files of other programs, written here by those programs' own libraries."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from deltac.errors import InputError
from deltac.trajectories import Trajectory, explain, read_trajectory, write_trajectory

h5py: Any = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")

T = np.array([0.0, 0.5, 1.0])


def mapping(folder: Path, text: str) -> Path:
    path = folder / "mapping.toml"
    path.write_text(text, "utf-8")
    return path


def assert_elbow(run: Trajectory) -> None:
    assert np.array_equal(run.t, T)
    assert run.coordinates == run.speeds == ("elbow",)
    assert np.array_equal(run.q, T[:, None] ** 2) and np.array_equal(run.u, 2 * T[:, None])


ELBOW = {"time": T, "q.elbow": T**2, "u.elbow": 2 * T}


# -- NPZ -----------------------------------------------------------------------------------------


def test_a_foreign_npz(tmp_path: Path) -> None:
    extra: Any = {"label": np.array("run 7"), "mass": 2.5}
    np.savez_compressed(tmp_path / "log.npz", **ELBOW, **extra)  # type: ignore[arg-type]
    run = read_trajectory(tmp_path / "log.npz")
    assert_elbow(run)
    assert run.provenance.ignored == ("label", "mass")


def test_columns_of_an_array_by_a_mapping(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=T[:, None], state=np.column_stack([T**2, 2 * T]))
    file = mapping(
        tmp_path,
        '[log]\ntime = "t"\n[coordinates]\nelbow = "state[0]"\n[speeds]\nelbow = "state[1]"\n',
    )
    assert_elbow(read_trajectory(tmp_path / "log.npz", file))


def test_an_npz_that_cannot_be_used(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, time=T, **{"q.elbow": np.array([{}, {}, {}]), "u.elbow": T})  # type: ignore
    with pytest.raises(InputError, match=r"log\.npz: 'q\.elbow' holds Python objects"):
        read_trajectory(path)
    np.savez(path, **(ELBOW | {"u.elbow": T[:2]}))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"'u\.elbow' has 2 values, 'time' has 3"):
        read_trajectory(path)
    np.savez(path, **(ELBOW | {"u.elbow": np.array([0, np.nan, 1])}))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"'u\.elbow', row 1 \(of 0 to 2\), t = 0\.5 s: found nan"):
        read_trajectory(path)
    np.save(tmp_path / "one.npy", T)
    (tmp_path / "one.npy").rename(path)
    with pytest.raises(InputError, match="not an NPZ archive"):
        read_trajectory(path)


# -- damage, in every format of arrays -----------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat"])
@pytest.mark.parametrize("kept", [1, 100, 0.5, -20])
def test_a_truncated_file(suffix: str, kept: float, tmp_path: Path) -> None:
    path = tmp_path / f"log{suffix}"
    table = np.random.default_rng(0).random((50, 1))
    run = Trajectory(t=np.arange(50.0), q=table, u=table, coordinates=("elbow",), speeds=("elbow",))
    write_trajectory(run, path)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data)) if isinstance(kept, float) else kept])
    with pytest.raises(InputError, match=f"log{suffix}: .*(damaged|no array)"):
        read_trajectory(path)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".parquet", ".csv", ".sto"])
def test_a_file_of_noise(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"log{suffix}"
    path.write_bytes(np.random.default_rng(3).bytes(4000))
    with pytest.raises(InputError, match=f"log{suffix}: "):
        read_trajectory(path)


def test_a_table_that_lost_rows_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    write_trajectory(
        Trajectory(t=T, q=T[:, None], u=T[:, None], coordinates=("a",), speeds=("a",)), path
    )
    with h5py.File(path, "a") as file:
        del file["u"]
        file["u"] = np.zeros((2, 1))
    with pytest.raises(
        InputError, match=r"array 'u': found shape \(2, 1\), the metadata say \(3, 1\)"
    ):
        read_trajectory(path)


# -- HDF5 ----------------------------------------------------------------------------------------


def test_a_foreign_hdf5_with_groups_tables_and_units(tmp_path: Path) -> None:
    path = tmp_path / "log.hdf5"
    table = np.zeros(3, dtype=[("t", "f8"), ("name", "S4")])
    table["t"] = T * 1e3
    with h5py.File(path, "w") as file:
        file["clock"] = table
        file["arm/elbow/angle"] = np.rad2deg(T**2).astype("f4")
        file["arm/elbow/angle"].attrs["units"] = "deg"
        file["arm/elbow/rate"] = 2 * T
        file["note"] = "hello"
    file = mapping(
        tmp_path,
        '[log]\ntime = { column = "clock/t", unit = "ms" }\n'
        '[coordinates]\nelbow = "arm/elbow/angle"\n[speeds]\nelbow = "arm/elbow/rate"\n',
    )
    run = read_trajectory(path, file)
    assert np.allclose(run.t, T, rtol=1e-15)
    assert np.allclose(run.q[:, 0], T**2, rtol=1e-7)  # single precision
    assert np.array_equal(run.u[:, 0], 2 * T)
    readings = {r.column: r for r in explain(path, file)}
    assert readings["arm/elbow/angle"].unit == "deg"
    assert readings["arm/elbow/angle"].note == "unit from the file"
    assert readings["clock/name"].meaning == "" and "not numbers" in readings["clock/name"].note


def test_hdf5_as_another_program_sees_it(tmp_path: Path) -> None:
    run = Trajectory(
        t=T,
        q=np.zeros((3, 1)),
        u=np.ones((3, 1)),
        forces={"damper a/b": np.full((3, 1), 7.0)},
        coordinates=("a/b",),
        speeds=("a/b",),
    )
    write_trajectory(run, tmp_path / "log.h5")
    with h5py.File(tmp_path / "log.h5") as file:
        assert [s.decode() for s in file["coordinates"][()]] == ["a/b"]
        assert [s.decode() for s in file["channels"][()]] == ["damper a/b"]
        assert np.array_equal(file["force"][:, 0, 0], [7, 7, 7])
        assert file["q"].shape == (3, 1)


# -- MATLAB 5 ------------------------------------------------------------------------------------


def test_a_mat_of_structures_named_like_the_schema(tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", {"time": T, "q": {"elbow": T**2}, "u": {"elbow": 2 * T[:, None]}})
    assert_elbow(read_trajectory(tmp_path / "log.mat"))


def test_a_mat_with_a_structure_without_fields(tmp_path: Path) -> None:
    values = {"time": T, "q": {"elbow": T**2}, "u": {"elbow": 2 * T}, "options": {}}
    savemat(tmp_path / "log.mat", values)
    assert_elbow(read_trajectory(tmp_path / "log.mat"))


def test_simulink_structure_with_time(tmp_path: Path) -> None:
    signals = np.zeros(2, dtype=[("values", "O"), ("dimensions", "O"), ("label", "O")])
    signals[0] = (T[:, None] ** 2, 1.0, "elbow angle")
    signals[1] = ((2 * T).reshape(1, 1, 3), [1.0, 1.0], "")  # a matrix signal: time comes last
    path = tmp_path / "log.mat"
    savemat(path, {"logsout": {"time": T, "signals": signals, "blockName": "arm/To Workspace"}})
    file = mapping(
        tmp_path,
        '[log]\ntime = "logsout.time"\n[coordinates]\nelbow = "logsout.elbow angle"\n'
        '[speeds]\nelbow = "logsout.signals[1]"\n',
    )
    assert_elbow(read_trajectory(path, file))


def test_a_flattened_simlog_with_units(tmp_path: Path) -> None:
    series = {"values": np.rad2deg(T**2), "time": T, "unit": "deg"}
    speed = {"values": 2 * T, "time": T, "unit": "rad/s"}
    savemat(tmp_path / "log.mat", {"simlog": {"Elbow": {"Rz": {"q": series, "w": speed}}}})
    file = mapping(
        tmp_path,
        '[log]\ntime = "simlog.Elbow.Rz.q.time"\n'
        '[coordinates]\nelbow = "simlog.Elbow.Rz.q.values"\n'
        '[speeds]\nelbow = "simlog.Elbow.Rz.w.values"\n',
    )
    run = read_trajectory(tmp_path / "log.mat", file)
    assert np.allclose(run.q[:, 0], T**2, rtol=1e-15)
    assert np.array_equal(run.u[:, 0], 2 * T)


def _element(kind: int, data: bytes) -> bytes:
    """A data element of the MAT-file format, level 5: tag, data, padding to eight bytes."""
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _opaque(name: str, kind: str) -> bytes:
    """A variable of a MATLAB class, as MATLAB stores objects (class 17, undocumented)."""
    flags = _element(6, struct.pack("<II", 17, 0))
    texts = b"".join(_element(1, text.encode()) for text in (name, "MCOS", kind))
    numbers = _element(6, struct.pack("<II", 13, 0)) + _element(5, struct.pack("<ii", 1, 1))
    numbers += _element(1, b"") + _element(6, struct.pack("<I", 0xDD000000))
    return _element(14, flags + texts + _element(14, numbers))


def test_objects_that_only_matlab_reads_are_named_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"time": T, "u": {"elbow": 2 * T}})
    path.write_bytes(path.read_bytes() + _opaque("elbow", "timeseries"))
    assert "elbow" not in loadmat(path)  # SciPy gives it no name
    file = mapping(tmp_path, '[log]\ntime = "time"\n[coordinates]\nelbow = "elbow"\n')
    with pytest.raises(
        InputError, match=r"'elbow' is an object of MATLAB's class 'timeseries'.*x\.Data"
    ):
        read_trajectory(path, file)


def test_a_matlab_variable_that_is_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deltac.trajectories.formats.matlab._LARGEST", 20)
    run = Trajectory(t=T, q=T[:, None], u=T[:, None], coordinates=("a",), speeds=("a",))
    with pytest.raises(InputError, match=r"log\.mat: 'time' takes .* write \.h5"):
        write_trajectory(run, tmp_path / "log.mat")
    assert not list(tmp_path.iterdir())


# -- MATLAB 7.3 ----------------------------------------------------------------------------------


def matlab73(path: Path) -> Any:
    """An HDF5 file as MATLAB writes it: 512 bytes of header, arrays in column order."""
    file = h5py.File(path, "w", userblock_size=512)
    file.create_group("#refs#")
    return file


def put(group: Any, name: str, values: Any, kind: bytes = b"double", **attributes: Any) -> None:
    group[name] = np.asarray(values)
    group[name].attrs["MATLAB_class"] = np.bytes_(kind)
    for key, value in attributes.items():
        group[name].attrs[key] = value


def finish(path: Path) -> None:
    data = bytearray(path.read_bytes())
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64"
    data[: len(text)] = text
    path.write_bytes(data)


def test_a_mat_of_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    with matlab73(path) as file:
        put(file, "tout", T[None, :])  # a column vector, transposed
        put(file, "state", np.array([T**2, 2 * T]))  # (3, 2) in MATLAB
        put(file, "remark", [[100], [101], [103]], b"char")
        put(file, "empty", [0, 0], MATLAB_empty=1)
        put(file, "out", [[1, 2, 3]], b"Simulink.SimulationOutput", MATLAB_object_decode=3)
        cells = [file["#refs#"].create_dataset(name, data=T[None, :]).ref for name in "ab"]
        put(file, "cells", np.array([cells], dtype=h5py.ref_dtype), b"cell")
        joint = file.create_group("joint")
        joint.attrs["MATLAB_class"] = np.bytes_(b"struct")
        put(joint, "q", T[None, :] ** 2)
    finish(path)
    readings = {r.column: r for r in explain(path)}
    assert {"state[0]", "state[1]", "cells[0]", "cells[1]", "joint.q", "tout"} <= set(readings)
    assert "Structure with time" in readings["out"].note
    file = mapping(
        tmp_path,
        '[log]\ntime = "tout"\n[coordinates]\nelbow = "joint.q"\n[speeds]\nelbow = "state[1]"\n',
    )
    assert_elbow(read_trajectory(path, file))
