from __future__ import annotations

import numpy as np
import pytest

from deltac.errors import InputError
from deltac.recorders import TrajectoryBuilder
from deltac.trajectories import Provenance

HERE = Provenance("a test")


def test_a_channel_that_did_not_act_is_zero_in_that_row() -> None:
    builder = TrajectoryBuilder(("x",), ("x",))
    builder.add(0.0, [1.0], [2.0], [3.0])
    builder.add(0.5, [2.0], [2.0], [3.0], {"contact floor:foot": [7.0]})
    builder.add(1.0, [3.0], [2.0], [3.0], {"damper x": [-1.0]})
    run = builder.trajectory(HERE)
    assert np.array_equal(run.t, [0.0, 0.5, 1.0])
    assert np.array_equal(run.coordinate("x"), [1.0, 2.0, 3.0])
    assert np.array_equal(run.forces["contact floor:foot"], [[0.0], [7.0], [0.0]])
    assert np.array_equal(run.forces["damper x"], [[0.0], [0.0], [-1.0]])
    assert builder.channels == ("contact floor:foot", "damper x")
    assert len(builder) == 3
    assert run.provenance is HERE


def test_rows_are_copies() -> None:
    builder = TrajectoryBuilder(("x",), ("x",))
    q = np.array([1.0])
    builder.add(0.0, q, q, q, {"applied x": q})
    q[0] = 5.0
    run = builder.trajectory(HERE)
    assert run.udot is not None
    found = (run.q, run.u, run.udot, run.forces["applied x"])
    assert all(values[0, 0] == 1.0 for values in found)


def test_without_accelerations() -> None:
    builder = TrajectoryBuilder(("x",), ("x",))
    builder.add(0.0, [0.0], [0.0])
    assert builder.trajectory(HERE).udot is None


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ((1.0, [0.0, 1.0], [0.0], [0.0]), r"q at t = 1 s.*\(2,\), expected \(1,\).* x$"),
        ((1.0, [0.0], [0.0], [[0.0]]), r"udot at t = 1 s.*\(1, 1\)"),
        ((1.0, [0.0], [0.0], [0.0], {"damper x": [0.0, 0.0]}), r"damper x at t = 1 s.*\(2,\)"),
        ((1.0, [0.0], [0.0]), "accelerations must be given in every row or in none"),
    ],
)
def test_rows_that_do_not_fit(row: tuple[object, ...], words: str) -> None:
    builder = TrajectoryBuilder(("x",), ("x",))
    builder.add(0.0, [0.0], [0.0], [0.0])
    with pytest.raises(InputError, match=words):
        builder.add(*row)  # type: ignore[arg-type]


def test_no_rows() -> None:
    with pytest.raises(InputError):
        TrajectoryBuilder(("x",), ("x",)).trajectory(HERE)


def test_later_stages_are_sums_without_springs_and_dampers() -> None:
    builder = TrajectoryBuilder(("x",), ("x",))
    for t in (0.0, 1.0):
        builder.add(t, [0.0], [1.0], [0.0], {"contact a": [2.0], "limit b": [1.0]})
        for k in range(3):
            forces = {"contact a": [2.0 + k], "limit b": [1.0], "damper c": [-float(k)]}
            builder.stage(0.25, [1.0], forces)
    run = builder.trajectory(HERE)
    assert run.stages is not None
    assert np.array_equal(run.stages[0], [[4.0], [5.0]])
    assert np.array_equal(run.works["contact a"], [0.0, 0.25 * (2 + 3 + 4)])
    assert builder.varying == {"contact a", "damper c"}


def test_stages_that_do_not_begin_with_the_row_are_not_held() -> None:
    builder = TrajectoryBuilder(("x",), ("x",))
    for t in (0.0, 1.0):
        builder.add(t, [0.0], [1.0], [0.0], {"contact a": [2.0]})
        builder.stage(0.5, [1.0], {"contact a": [3.0]})
        builder.stage(0.5, [1.0], {"contact a": [4.0]})
    assert builder.trajectory(HERE).stages is None
