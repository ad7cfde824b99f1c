"""Construction, validation and views of a Trajectory."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest

from deltac.errors import InputError
from deltac.trajectories import Provenance, Trajectory


def arguments(rows: int = 5, **changes: Any) -> dict[str, Any]:
    t = np.linspace(1.0, 3.0, rows)
    base = dict(
        t=t,
        q=np.column_stack([t, 2 * t, 3 * t]),
        u=np.column_stack([np.ones(rows), 2 * np.ones(rows)]),
        udot=np.zeros((rows, 2)),
        forces={"damper elbow": np.column_stack([-t, 0 * t]), "gravity": np.ones((rows, 2))},
        integrals={"wang": t**2},
        coordinates=("a", "b", "elbow"),
        speeds=("a", "elbow"),
        provenance=Provenance("deltac", solver="ode5", step=0.5),
    )
    return base | changes


def make(rows: int = 5, **changes: Any) -> Trajectory:
    return Trajectory(**arguments(rows, **changes))


def test_arrays_are_copied_converted_and_read_only() -> None:
    t = np.arange(3, dtype=np.int32)
    q = np.ones((3, 1), dtype=np.float32)
    run = Trajectory(t=t, q=q, u=[[1], [2], [3]], coordinates=("x",), speeds=("x",))  # type: ignore[arg-type]
    t[0], q[0] = 7, 7.0
    assert run.t[0] == 0.0 and run.q[0, 0] == 1.0
    for array in (run.t, run.q, run.u):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        run.t = run.q  # type: ignore[misc]
    with pytest.raises(TypeError):
        make().forces["gravity"] = q  # type: ignore[index]
    assert run.provenance.simulator == "unknown"


def test_views() -> None:
    run = make()
    assert len(run) == 5
    assert run.duration == 2.0
    assert np.array_equal(run.coordinate("elbow"), 3 * run.t)
    assert np.array_equal(run.speed("elbow"), [2, 2, 2, 2, 2])
    with pytest.raises(InputError, match=r"coordinate 'elbwo'.*did you mean 'elbow'"):
        run.coordinate("elbwo")
    with pytest.raises(InputError, match=r"unknown speed 'b'; known: a, elbow"):
        run.speed("b")


def test_every_keeps_each_nth_row_and_the_integrals() -> None:
    run = make(6).every(2)
    assert np.array_equal(run.t, make(6).t[[0, 2, 4]])
    assert np.array_equal(run.integrals["wang"], run.t**2)
    assert np.array_equal(run.forces["damper elbow"][:, 0], -run.t)
    assert run.udot is not None and run.udot.shape == (3, 2)
    assert run.provenance.step == 0.5
    for bad in (0, -1, 1.5):
        with pytest.raises(InputError, match="every"):
            make().every(bad)  # type: ignore[arg-type]


def test_between_takes_both_ends_and_restarts_the_integrals() -> None:
    run = make().between(1.5, 2.5)
    assert np.array_equal(run.t, [1.5, 2.0, 2.5])
    # Squares of multiples of 0.5: their differences are exact.
    assert np.array_equal(run.integrals["wang"], [0.0, 1.75, 4.0])
    assert len(make().between(-np.inf, np.inf)) == 5
    for t0, t1 in [(4.0, 5.0), (2.0, 1.0), (1.6, 1.9), (np.nan, 2.0), (1.0, np.nan)]:
        with pytest.raises(InputError, match=r"there is no row in between.*1\.0 to 3\.0 s"):
            make().between(t0, t1)


def test_repr_is_short_and_tells_what_is_there() -> None:
    assert repr(make()) == (
        "Trajectory(deltac ode5; 5 rows, 1 … 3 s; 3 coordinates, 2 speeds; udot; 2 channels; "
        "integrals of wang)"
    )
    stopped = make(provenance=Provenance("other", completed=False, message="blew up"))
    assert repr(stopped).endswith("stopped early: blew up)")


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda run: pickle.loads(pickle.dumps(run))])
def test_clones_are_equal_and_still_read_only(clone: Any) -> None:
    run = make(provenance=Provenance("deltac", notes={"who": "me"}))
    twin = clone(run)
    assert twin.provenance == run.provenance
    assert np.array_equal(twin.forces["gravity"], run.forces["gravity"])
    assert not twin.q.flags.writeable and not twin.forces["gravity"].flags.writeable


def test_a_mechanism_without_joints_and_a_single_row() -> None:
    none = np.zeros((1, 0))
    run = Trajectory(t=[0.0], q=none, u=none, coordinates=(), speeds=())  # type: ignore[arg-type]
    assert run.duration == 0.0 and run.q.shape == (1, 0)


def spoilt(key: str, row: int, column: int, value: float) -> dict[str, Any]:
    array = np.array(arguments()[key])
    array[row, column] = value
    return {key: array}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": [0, 1, 2, 2, 3]}, r"'time', row 3 \(of 0 to 4\): found 2\.0 after 2\.0"),
        ({"t": [0, 1, 2, 1, 0]}, r"'time', row 3 .*found 1\.0 after 2\.0.*increase"),
        ({"t": [0, 1, np.nan, 1, 4]}, r"'time', row 2 .*found nan"),
        ({"t": [0, 1, 2, 3, np.inf]}, r"'time', row 4 .*found inf"),
        ({"t": []}, "no rows"),
        ({"t": np.zeros((5, 1))}, r"time: found shape \(5, 1\)"),
        ({"t": ["0", "1"]}, r"time: found values of type <U1"),
        ({"t": np.arange(5) > 2}, r"time: found values of type bool"),
        (spoilt("q", 2, 1, np.nan), r"'q\.b', row 2 .*t = 2\.0 s: found nan"),
        (spoilt("u", 4, 1, -np.inf), r"'u\.elbow', row 4 .*found -inf"),
        (spoilt("udot", 0, 0, np.inf), r"'udot\.a', row 0"),
        ({"forces": {"gravity": np.full((5, 2), np.nan)}}, r"'force\.gravity\.a', row 0"),
        ({"integrals": {"wang": [0, 1, np.nan, 3, 4]}}, r"'integral\.wang', row 2"),
        ({"q": np.ones((3, 5))}, r"q: found shape \(3, 5\), expected \(5, 3\).*transpose"),
        ({"u": np.ones((5, 3))}, r"u: found shape \(5, 3\), expected \(5, 2\).*a, elbow"),
        ({"u": np.ones(5)}, r"u: found shape \(5,\)"),
        ({"q": [[1, 2], [3]]}, "q: expected an array of numbers"),
        ({"q": np.ones((5, 3)) * 1j}, "q: found values of type complex128"),
        ({"integrals": {"wang": np.ones(4)}}, r"integral\.wang: found shape \(4,\)"),
        ({"forces": {"dampr elbow": np.ones((5, 2))}}, "did you mean 'damper'"),
        ({"forces": {"damper": np.ones((5, 2))}}, "'damper' names no element"),
        ({"speeds": ("a", "a")}, "speeds: 'a' appears twice"),
        ({"speeds": "ab"}, "speeds: found the text 'ab'"),
        ({"coordinates": ("a", "", "b")}, "coordinates: found ''"),
        ({"coordinates": ("a", "x\ny", "b")}, "line break"),
        ({"coordinates": ("a", 3, "b")}, "coordinates: found 3"),
        ({"integrals": {" ": np.ones(5)}}, "integrals: found ' '"),
        ({"provenance": "deltac"}, "expected a Provenance"),
    ],
)
def test_unusable_samples_are_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"(?s){message}"):
        make(**changes)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"simulator": ""}, "simulator is ''"),
        ({"step": 0.0}, "step is 0.0, expected a finite number, above 0"),
        ({"step": float("nan")}, "step is nan"),
        ({"step": "1e-3"}, "step is '1e-3'"),
        ({"step": [1]}, r"step is \[1\]"),
        ({"tolerance": -1e-9}, "tolerance is -1e-09, expected a finite number, 0 or more"),
        ({"solver": 5}, "solver is 5, expected text or None"),
        ({"completed": "no"}, "completed is 'no'"),
        ({"message": None}, "message is None"),
        ({"notes": {"a": 1}}, "notes is"),
        ({"servo_damping": 0.3}, "servo_damping is 0.3, expected a mapping"),
        ({"servo_damping": {"j": float("nan")}}, "servo_damping is nan, .*'j'"),
    ],
)
def test_unusable_provenance_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Provenance(**({"simulator": "deltac"} | values))


def test_provenance_takes_numpy_scalars() -> None:
    made = Provenance("deltac", step=np.float32(0.5), completed=np.bool_(False))  # type: ignore
    assert type(made.step) is float and made.completed is False
    assert hash(made) == hash(dataclasses.replace(made))
