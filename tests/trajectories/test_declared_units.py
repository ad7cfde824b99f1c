"""Units that a file declares beside its arrays: by column, by kind, or in no way that is clear."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import problems
from deltac.trajectories import read_trajectory

T = np.linspace(0.0, 1.0, 101)
Q, U = 0.5 * np.cos(3.0 * T), -1.5 * np.sin(3.0 * T)
ARRAYS = {"time": T, "q": np.degrees(Q)[:, None], "u": np.degrees(U)[:, None]}

UNDERSTOOD: list[dict[str, Any]] = [
    {"units": {"q": "deg", "u": "deg/s"}},
    {"units": {"q": ["deg"], "u": ["deg/s"], "time": ["s"]}},
    {"units": {"angle": "deg", "angular_velocity": "degrees per second"}},
    {"units": ["s", "deg", "deg/s"]},
    {"q_unit": "deg", "uUnits": "deg/s"},
    {"units": {"angle": "deg", "rate": "deg/s", "mass": "kg", "time": "s"}},
]
UNCLEAR: list[dict[str, Any]] = [
    {"units": {"angle": "deg"}},  # and the speeds?
    {"units": "deg"},
    {"units": {"angle": "gons"}},
    {"units": {"hip": "deg", "knee": "rad"}},
    {"units": [1, "deg"]},
]
INNOCENT: list[dict[str, Any]] = [
    {"units": None},
    {"units": "SI"},
    {"unit": 7},
    {"units": {"dt": "ms"}, "dt": 10.0},
]


def as_json(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "log.json"
    path.write_text(json.dumps(content, default=lambda array: array.tolist()))
    return path


def as_npz(folder: Path, content: dict[str, Any]) -> Path:
    flat = {k: np.array(v) for k, v in content.items() if not isinstance(v, dict) and v is not None}
    tables = {
        f"units.{k}": v for t in content.values() if isinstance(t, dict) for k, v in t.items()
    }
    np.savez(folder / "log.npz", **flat, **tables)  # type: ignore[arg-type]
    return folder / "log.npz"


def as_hdf5(folder: Path, content: dict[str, Any]) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "log.h5", "w") as file:
        for name, value in content.items():
            if isinstance(value, dict):
                file.create_group(name).attrs.update(value)
            else:
                file[name] = value
    return folder / "log.h5"


def as_matlab(folder: Path, content: dict[str, Any]) -> Path:
    from scipy.io import savemat

    def cell(value: Any) -> Any:
        return np.array(value, dtype=object) if isinstance(value, list) else value

    inner = {
        k: {a: cell(b) for a, b in v.items()} if isinstance(v, dict) else cell(v)
        for k, v in content.items()
        if v is not None
    }
    savemat(folder / "log.mat", {"s": inner})
    return folder / "log.mat"


def as_dictionary(folder: Path, content: dict[str, Any]) -> dict[str, Any]:
    return content


FORMATS = [as_dictionary, as_json, as_npz, as_hdf5, as_matlab]


@pytest.fixture(scope="module")
def pendulum() -> dc.Mechanism:
    return problems.load("simple-pendulum").mechanism


@pytest.mark.parametrize("written", FORMATS)
@pytest.mark.parametrize("told", UNDERSTOOD)
def test_units_beside_arrays_are_understood(
    tmp_path: Path, pendulum: dc.Mechanism, told: dict[str, Any], written: Callable[..., Any]
) -> None:
    run = read_trajectory(written(tmp_path, {**ARRAYS, **told}), None, pendulum)
    np.testing.assert_allclose(run.q[:, 0], Q, rtol=1e-12)
    np.testing.assert_allclose(run.u[:, 0], U, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("written", FORMATS)
@pytest.mark.parametrize("told", UNCLEAR)
def test_units_that_are_unclear_are_refused_but_for_a_mapping(
    tmp_path: Path, pendulum: dc.Mechanism, told: dict[str, Any], written: Callable[..., Any]
) -> None:
    content = {**ARRAYS, **told}
    if told == {"units": [1, "deg"]} and written in (as_npz, as_hdf5, as_matlab):
        pytest.skip("a list of one kind only")
    log = written(tmp_path, content)
    with pytest.raises(dc.errors.InputError, match="mapping"):
        read_trajectory(log, None, pendulum)
    before = "s." if written is as_matlab else ""
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        f'[log]\ntime = {{ column = "{before}time", unit = "s" }}\n'
        f'[coordinates]\npivot = {{ column = "{before}q", unit = "deg" }}\n'
        f'[speeds]\npivot = {{ column = "{before}u", unit = "deg/s" }}\n'
    )
    run = read_trajectory(log, mapping, pendulum)
    np.testing.assert_allclose(run.q[:, 0], Q, rtol=1e-12)


@pytest.mark.parametrize("written", [as_dictionary, as_json])
@pytest.mark.parametrize("told", INNOCENT)
def test_what_declares_nothing_changes_nothing(
    tmp_path: Path, pendulum: dc.Mechanism, told: dict[str, Any], written: Callable[..., Any]
) -> None:
    content = {"time": T, "q": Q[:, None], "u": U[:, None], **told}
    run = read_trajectory(written(tmp_path, content), None, pendulum)
    np.testing.assert_array_equal(run.t, T)
    np.testing.assert_array_equal(run.q[:, 0], Q)


def test_a_step_is_in_its_own_unit(pendulum: dc.Mechanism) -> None:
    run = read_trajectory(
        {"dt": 10.0, "q": Q[:, None], "u": U[:, None], "units": {"dt": "ms"}}, None, pendulum
    )
    np.testing.assert_allclose(run.t, T, atol=1e-12)


def test_units_beside_records(tmp_path: Path, pendulum: dc.Mechanism) -> None:
    records = [{"time": t, "q": q, "u": u} for t, q, u in zip(T, np.degrees(Q), np.degrees(U))]
    log = as_json(tmp_path, {"units": {"q": "deg", "u": "deg/s"}, "data": records})
    np.testing.assert_allclose(read_trajectory(log, None, pendulum).q[:, 0], Q, rtol=1e-12)


def test_a_column_of_units_in_a_table(tmp_path: Path, pendulum: dc.Mechanism) -> None:
    log = tmp_path / "log.csv"
    rows = [f"{t!r},{q!r},deg" for t, q in zip(T.tolist(), np.degrees(Q).tolist())]
    log.write_text("\n".join(["time,q.pivot,unit", *rows]))
    np.testing.assert_allclose(read_trajectory(log, None, pendulum).q[:, 0], Q, rtol=1e-12)
    rows = [f"{t!r},{q!r},{u!r},deg" for t, q, u in zip(T.tolist(), Q.tolist(), U.tolist())]
    log.write_text("\n".join(["time,q.pivot,u.pivot,unit", *rows]))
    with pytest.raises(dc.errors.InputError, match="deg"):
        read_trajectory(log, None, pendulum)


def test_dates_beside_a_column_that_never_changes_are_times(
    tmp_path: Path, pendulum: dc.Mechanism
) -> None:
    log = tmp_path / "log.csv"
    rows = [f"2026-03-04 10:00:{t:09.6f},{q!r},1" for t, q in zip(T.tolist(), Q.tolist())]
    log.write_text("\n".join(["time,q.pivot,mode", *rows]))
    run = read_trajectory(log, None, pendulum)
    np.testing.assert_allclose(run.t, T, atol=1e-9)
    np.testing.assert_array_equal(run.q[:, 0], Q)


@pytest.mark.parametrize("form", ["h5", "npz"])
def test_units_and_names_beside_arrays_of_episodes(tmp_path: Path, form: str) -> None:
    problem = problems.load("double-pendulum")
    mechanism = problem.mechanism
    run = dc.simulate(mechanism, problem.state, 0.2, 0.005, "ode4")
    one, other = run.coordinates
    arrays = {
        "time": run.t,
        "q": np.degrees(np.stack([run.q[:, ::-1]] * 2, axis=1)),
        "u": np.degrees(np.stack([run.u[:, ::-1]] * 2, axis=1)),
    }
    told = {"joint_names": [other, one], "units": ["s", "deg", "deg/s"]}
    log = tmp_path / f"log.{form}"
    if form == "npz":
        np.savez(log, **arrays, **told)  # type: ignore[arg-type]
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(log, "w") as file:
            for name, values in arrays.items():
                file[name] = values
            file.attrs.update(told)
    fleet = dc.audit_many(mechanism, log, out=tmp_path / "out", workers=1)
    assert fleet.exit_code == 0
