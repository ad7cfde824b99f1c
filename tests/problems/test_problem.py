"""Loading, and the parts of a problem."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from deltac import InputError, Record, balance, problems, simulate
from deltac.energy import TESTING_FUNCTIONS
from deltac.problems import Reference
from deltac.problems.problem import largest, period, rotated, row_at
from deltac.trajectories import Trajectory


def test_unknown_names_get_the_closest() -> None:
    with pytest.raises(InputError, match="did you mean 'heavy-top'"):
        problems.load("heavy-topp")
    with pytest.raises(InputError, match="no option 'mass'"):
        problems.load("heavy-top", mass=1.0)


def test_listing_loads_nothing_heavy() -> None:
    script = (
        "import sys, deltac; assert len(deltac.problems.names()) >= 8;"
        "assert not {'casadi', 'heyoka', 'sympy', 'scipy', 'polars'} & set(sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"step": 0.0}, "0 < step"), ({"duration": 1e-9}, "step"), ({"duration": 0.5}, "outside")],
)
def test_impossible_times_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        dataclasses.replace(problems.load("heavy-top"), **changes)


def test_the_freedom_that_constraints_leave_must_be_told() -> None:
    assert problems.load("heavy-top").freedom == 3
    with pytest.raises(InputError, match=r"'bricard' has constraints.*freedom="):
        dataclasses.replace(problems.load("bricard"), freedom=None)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("n-four-bar", {"n": 0}, "n is 0, expected a whole number"),
        ("n-four-bar", {"n": 2.0}, "n is 2.0"),
        ("ball-on-table", {"table": "lies"}, "'lies'; known: 'laws', 'body'"),
    ],
)
def test_impossible_options_are_refused(name: str, options: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        problems.load(name, **options)


@pytest.mark.parametrize("changes", [{"kind": "guessed"}, {"accuracy": -1.0}, {"value": np.nan}])
def test_impossible_references_are_refused(changes: dict[str, Any]) -> None:
    reference = problems.load("heavy-top").reference[0]
    with pytest.raises(InputError, match=r"energy at 1 s"):
        dataclasses.replace(reference, **changes)
    assert isinstance(dataclasses.replace(reference, kind="published"), Reference)


def swing(times: Any) -> Trajectory:
    """q = sin(t − 1), sampled."""
    t = np.asarray(times, dtype=float)
    return Trajectory(
        t=t, q=np.sin(t - 1)[:, None], u=np.cos(t - 1)[:, None], coordinates=("a",), speeds=("a",)
    )


def test_measures() -> None:
    run = swing(np.linspace(0.0, 10.0, 1001))
    assert row_at(run, 2.5) == 250
    with pytest.raises(InputError, match="no row at t = 2.505"):
        row_at(run, 2.505)
    # The cubic is good to h⁴/384, the quartic to some h⁵; h = 0.01.
    assert abs(period("a")(run) - 2 * np.pi) < 1e-10
    assert abs(largest(lambda r: r.coordinate("a"))(run) - 1.0) < 1e-10
    assert abs(largest(lambda r: r.coordinate("a"), -1)(run) + 1.0) < 1e-10
    assert largest(lambda r: r.t)(run) == 10.0
    with pytest.raises(InputError, match="twice"):
        period("a")(swing([0.0, 2.0, 3.0]))


def test_rotated_turns_as_scipy_does() -> None:
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(5)
    quaternion, vector = rng.normal(size=(9, 4)), rng.normal(size=(9, 3))
    expected = Rotation.from_quat(quaternion, scalar_first=True).apply(vector)
    np.testing.assert_allclose(rotated(quaternion, vector), expected, atol=1e-14)


def test_only_the_form_of_1988_fails_for_the_particle_in_turning_coordinates() -> None:
    p = problems.load("free-particle")
    functions = tuple(TESTING_FUNCTIONS)
    record = Record(functions, coordinates=p.coordinates)
    run = simulate(p.mechanism, p.state, p.duration, p.step, p.solver, record)
    for work in ("in-loop", "samples"):
        ledger = balance(p.mechanism, run, work, functions, coordinates=p.coordinates)
        spread = {name: float(np.ptp(values)) for name, values in ledger.delta_c.items()}
        # The integrand is quadratic in t: exact for a method of order 4.
        assert abs(spread.pop("kane-levinson-1988") - 1.35681) < 1e-12
        assert max(spread.values()) < 1e-13
