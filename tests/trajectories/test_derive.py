"""Speeds and accelerations by splines against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation

from deltac.errors import InputError
from deltac.trajectories import (
    Trajectory,
    derived_error,
    from_columns,
    read_trajectory,
    with_accelerations,
)

Z = np.array([0.0, 0.0, 1.0])


def smooth(rows: int) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """A free body: times, coordinates, exact speeds. It precesses: Rz(2t) Rx(0.5) Rz(3t)."""
    t = np.linspace(0.0, 2.0, rows)
    turn = (
        Rotation.from_rotvec(2 * t[:, None] * Z)
        * Rotation.from_euler("x", 0.5)
        * Rotation.from_rotvec(3 * t[:, None] * Z)
    )
    p = turn.as_quat(scalar_first=True)
    p[::3] *= -1.0  # p and −p are the same rotation
    q = {"b.x": np.sin(2 * t), "b.y": t**2, "b.z": 0 * t}
    q |= {f"b.q{c}": p[:, i] for i, c in enumerate("wxyz")}
    # ω of precession and spin, body components (Goldstein, *Classical Mechanics*, Euler rates).
    omega = [
        2 * np.sin(0.5) * np.sin(3 * t),
        2 * np.sin(0.5) * np.cos(3 * t),
        2 * np.cos(0.5) + 3 + 0 * t,
    ]
    u = {"b.vx": 2 * np.cos(2 * t), "b.vy": 2 * t, "b.vz": 0 * t}
    return t, q, u | {f"b.w{c}": w for c, w in zip("xyz", omega, strict=True)}


def positions_only(folder: Path, rows: int) -> Trajectory:
    t, q, _ = smooth(rows)
    columns = {"time": t} | {f"q.{name}": values for name, values in q.items()}
    polars.DataFrame(columns).write_parquet(folder / "log.parquet")
    return read_trajectory(folder / "log.parquet")


def test_speeds_converge_at_the_order_of_the_spline_and_the_estimate_covers(tmp_path: Path) -> None:
    errors = []
    for rows in (81, 161):
        _, _, exact = smooth(rows)
        run = positions_only(tmp_path, rows)
        assert run.speeds == tuple(exact)
        assert list(run.provenance.derived) == ["u"]
        found = np.abs(run.u - np.column_stack(list(exact.values()))).max(axis=0)
        estimate = derived_error(run)
        assert estimate is not None
        assert (found <= estimate + 1e-12).all()  # rounding of h⁻¹ sums
        errors.append(found.max())
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) > 4.5  # degree 5: order 5 in the derivative


def test_noise_is_covered_by_the_estimate(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 401)
    noise = 1e-5 * np.random.default_rng(2).standard_normal(t.size)
    path = tmp_path / "log.csv"
    polars.DataFrame({"time": t, "q.a": np.sin(t) + noise}).write_csv(path)
    run = read_trajectory(path)
    estimate = derived_error(run)
    assert estimate is not None
    found = np.abs(run.u[:, 0] - np.cos(t)).max()
    assert 1e-3 < found < 2.0 * estimate[0]  # an estimate, no bound


def test_accelerations_are_derived_on_demand(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 101)
    run = from_columns({"time": t, "q.a": np.sin(t), "u.a": np.cos(t)})
    full = with_accelerations(run)
    assert full.udot is not None and np.allclose(full.udot[:, 0], -np.sin(t), atol=1e-8)
    assert list(full.provenance.derived) == ["udot"]
    error = derived_error(full, "udot")
    assert error is not None and 0.0 < error[0] < 1e-6
    assert derived_error(full, "u") is None
    assert with_accelerations(full) is full
    both = with_accelerations(positions_only(tmp_path, 81))
    assert list(both.provenance.derived) == ["u", "udot"]
    full.write(tmp_path / "log.h5")  # what was derived travels with the log
    assert read_trajectory(tmp_path / "log.h5").provenance == full.provenance


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,q.a\n0,1\n1,2\n", r"no column 'u\.<speed>', and 2 rows are too few to derive it"),
        ("time,q.a\n0,1\n1,2\n1,3\n2,4\n", r"column 'time', row 2 \(of 0 to 3\)"),
        (
            "time,q.a\n0,1\n1,nan\n2,3\n3,4\n",
            r"cannot be derived.*column 'q\.a'.*row 1 \(of 0 to 3\)",
        ),
        ("time,u.a\n0,1\n1,2\n", r"no column 'q\.<coordinate>'"),
    ],
)
def test_what_cannot_be_derived(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_trajectory(tmp_path / "log.csv")
