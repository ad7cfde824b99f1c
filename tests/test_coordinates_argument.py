"""`coordinates=` means the same at every door: a map, "joint", or "absolute" for absolute angles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import deltac as dc

Array = NDArray[np.float64]
PROBLEM = dc.problems.load("double-pendulum")
PENDULUM = PROBLEM.mechanism
START = PENDULUM.state({"joint1": 0.9, "joint2": 0.4}, {"joint1": 0.3, "joint2": -0.2})
VALUES = {name: float(value) for name, value in PENDULUM.parameters.items()}


def textbook(t: float, q: Array, u: Array) -> Array:
    """Lagrange's equations of the double pendulum, both angles from the downward vertical."""
    (a, b), (wa, wb) = q, u
    m1, m2, l1, l2, g = (VALUES[name] for name in ("m1", "m2", "l1", "l2", "g"))
    c, s = np.cos(a - b), np.sin(a - b)
    f1 = -m2 * l2 * wb**2 * s - (m1 + m2) * g * np.sin(a)
    f2 = m2 * (l1 * wa**2 * s - g * np.sin(b))
    A, B, C = (m1 + m2) * l1, m2 * l2 * c, m2 * l2
    D = m2 * l1 * c
    determinant = A * C - B * D
    return np.array([(f1 * C - f2 * B) / determinant, (f2 * A - f1 * D) / determinant])


ABSOLUTE = dc.Equations(textbook, coordinates="absolute")


@pytest.fixture(scope="module")
def run() -> dc.Trajectory:
    return dc.simulate(PENDULUM, START, 1.0, 0.01)


def test_equations_in_absolute_angles_are_the_mechanisms(run: dc.Trajectory) -> None:
    own = dc.simulate(PENDULUM, START, 1.0, 0.01, equations=ABSOLUTE)
    np.testing.assert_allclose(own.q, run.q, atol=1e-9)
    assert dc.check_equations(PENDULUM, ABSOLUTE).exit_code == 0
    assert dc.check_equations(PENDULUM, textbook, coordinates="absolute").exit_code == 0
    assert dc.check_equations(PENDULUM, textbook, coordinates="joint").exit_code == 1


def test_a_study_takes_them() -> None:
    right = dc.study(PENDULUM, START, 1.0, (0.02, 0.01, 0.005), equations=ABSOLUTE)
    wrong = dc.study(
        PENDULUM, START, 1.0, (0.02, 0.01, 0.005), equations=dc.Equations(textbook, "joint")
    )
    assert right.exit_code == 0 and wrong.exit_code == 1


def test_a_ledger_and_a_record_divide_by_absolute_speeds(run: dc.Trajectory) -> None:
    by_map = dc.CoordinateMap(("a", "b"), q={"joint1": "q.a", "joint2": "q.b - q.a"}, inverse={})
    testing = ("kane-levinson-1990",)
    ledgers = [
        dc.balance(PENDULUM, run, "samples", testing, coordinates=coordinates)
        for coordinates in ("absolute", by_map, "joint", None)
    ]
    curves = [ledger.delta_c["kane-levinson-1990"] for ledger in ledgers]
    np.testing.assert_array_equal(curves[0], curves[1])
    np.testing.assert_array_equal(curves[2], curves[3])
    record = dc.Record(testing, coordinates="absolute")
    recorded = dc.simulate(PENDULUM, START, 1.0, 0.01, record=record)
    kept = dc.balance(PENDULUM, recorded).delta_c["kane-levinson-1990"]
    np.testing.assert_allclose(kept, curves[0], atol=1e-6)


def test_states_and_places_are_told_in_absolute_angles(run: dc.Trajectory) -> None:
    assert dc.random_states(PENDULUM, "absolute").coordinates == ("joint1", "joint2")
    assert dc.localise(PENDULUM, run, coordinates="absolute").exit_code == 0


@pytest.fixture(scope="module")
def log(run: dc.Trajectory) -> dict[str, Array]:
    """The table of a run in absolute angles, as somebody's own program writes it."""
    angles, rates = (np.cumsum(x, axis=1) for x in (run.q, run.u))
    columns = {f"q.{name}": angle for name, angle in zip(run.coordinates, angles.T)}
    return {
        "time": run.t,
        **columns,
        **{f"u.{n}": w for n, w in zip(run.speeds, rates.T)},
    }


def test_a_log_in_absolute_angles_is_audited_as_such(
    run: dc.Trajectory, log: dict[str, Array]
) -> None:
    read = dc.audit(PENDULUM, log, coordinates="absolute")
    np.testing.assert_allclose(read.run.q, run.q, atol=1e-12)
    np.testing.assert_allclose(read.run.u, run.u, atol=1e-12)
    # That it is none otherwise is told, too: tests/diagnosis/test_conventions.py.
    assert read.exit_code == 0


def test_a_log_has_the_columns_of_its_map(run: dc.Trajectory, log: dict[str, Array]) -> None:
    by_map = dc.CoordinateMap(("a", "b"), q={"joint1": "q.a", "joint2": "q.b - q.a"})
    renamed = {k.replace("joint1", "a").replace("joint2", "b"): v for k, v in log.items()}
    explained = dc.explain_residual(PENDULUM, renamed, coordinates=by_map)
    assert explained.kind == "nothing"
    with pytest.raises(dc.InputError, match="'a'"):
        dc.audit(PENDULUM, run, coordinates=by_map)


@pytest.mark.parametrize(
    "call",
    [
        lambda run: dc.Equations(textbook, coordinates="absolut"),
        lambda run: dc.balance(PENDULUM, run, coordinates="absolut"),
        lambda run: dc.residuals(PENDULUM, run, coordinates="absolut"),
        lambda run: dc.localise(PENDULUM, run, coordinates="absolut"),
        lambda run: dc.audit(PENDULUM, run, coordinates="absolut"),
        lambda run: dc.random_states(PENDULUM, "absolut"),
        lambda run: dc.check_equations(PENDULUM, textbook, coordinates="absolut"),
        lambda run: dc.simulate(
            PENDULUM, START, 0.1, 0.01, record=dc.Record(coordinates="absolut")
        ),
    ],
)
def test_other_words_are_refused(call: Callable[[dc.Trajectory], Any], run: dc.Trajectory) -> None:
    with pytest.raises(dc.InputError, match=r"'absolut'.*expected 'joint', 'absolute'"):
        call(run)
