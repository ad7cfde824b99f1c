"""Tables handed over in Python are read as files are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import polars
import pytest

import deltac as dc
from tests.natural_logs import models

MECHANISM = models.arm()
T = np.linspace(0.0, 1.0, 201)
Q = np.column_stack([np.sin(3 * T), 0.5 * np.cos(2 * T)])
U = np.column_stack([3 * np.cos(3 * T), -np.sin(2 * T)])
COLUMNS = {
    "time": T,
    "shoulder_pos": Q[:, 0],
    "elbow_pos": Q[:, 1],
    "shoulder_vel": U[:, 0],
    "elbow_vel": U[:, 1],
}
RECORDS = np.zeros(len(T), dtype=[("t", float), ("q", float, (2,)), ("qd", float, (2,))])
RECORDS["t"], RECORDS["q"], RECORDS["qd"] = T, Q, U
INTERLEAVED = np.column_stack([Q[:, 0], U[:, 0], Q[:, 1], U[:, 1]])


class Dataset:
    """What xarray's Dataset offers of what is read."""

    def __init__(self, **variables: Any) -> None:
        self.data_vars, self.coords = {k: v for k, v in variables.items() if k != "time"}, ["time"]
        self._all = variables

    def __getitem__(self, name: str) -> Any:
        return SimpleNamespace(values=self._all[name])


@pytest.mark.parametrize(
    "table",
    [
        {"t": T, "q": Q, "qd": U},
        {"t": T.tolist(), "q": Q.T.tolist(), "v": U.T.tolist()},
        {"log": {"time": T, "pos": Q, "vel": U}, "note": "a run"},
        {"t": T, "X": INTERLEAVED},
        COLUMNS,
        polars.DataFrame(COLUMNS),
        polars.DataFrame({"t": T, "q": Q.tolist(), "qd": U.tolist()}),
        Dataset(time=T, q=Q, qd=U),
        RECORDS,
        np.column_stack([T, Q, U]),
        np.column_stack([T, INTERLEAVED]),
        np.column_stack([T, U, Q]),
        {"time": (T * 1e9).astype("timedelta64[ns]"), "q": Q, "qd": U},
    ],
    ids=lambda table: type(table).__name__,
)
def test_a_table_is_a_log(table: Any) -> None:
    run = dc.read_trajectory(table, model=MECHANISM)
    assert run.t == pytest.approx(T, abs=1e-9)
    assert np.array_equal(run.q, Q) and np.array_equal(run.u, U)


@pytest.mark.parametrize("table", [{"t": T, "q": Q[:, :1]}, {}, np.zeros((5, 5)), object(), 3])
def test_what_is_no_log_is_refused_in_words(table: Any) -> None:
    with pytest.raises(dc.InputError) as refused:
        dc.audit(MECHANISM, table)
    assert refused.value.code in ("E-LOG", "E-TYPE")
