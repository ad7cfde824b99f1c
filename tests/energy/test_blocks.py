"""Ledgers do not depend on how the work is cut up: cores, blocks and the cache leave no trace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.energy.sampling import quadrature
from deltac.energy.sampling import samples as sampled


def logged() -> tuple[dc.Mechanism, dc.Trajectory]:
    problem = dc.problems.load("triple-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, 3.0, 1e-3, "ode8", record=())
    return problem.mechanism, run


@pytest.mark.parametrize("threads", [1, 3])
def test_bits_do_not_depend_on_cores(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, run = logged()
    whole = dc.balance(mechanism, run, work="samples")
    monkeypatch.setattr("deltac.kernels.parallel.cores", lambda: threads)
    monkeypatch.setattr(quadrature, "cores", lambda: threads)
    again = dc.balance(mechanism, run, work="samples")
    for name in whole.power:
        np.testing.assert_array_equal(whole.power[name], again.power[name])
        np.testing.assert_array_equal(whole.work[name], again.work[name])
    for name in whole.delta_c:
        np.testing.assert_array_equal(whole.delta_c[name], again.delta_c[name])
        np.testing.assert_array_equal(whole.error_bar[name], again.error_bar[name])


def test_powers_do_not_depend_on_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Powers at samples to the last bit; sums over them to rounding, since sums are cut with the blocks."""
    mechanism, run = logged()
    whole = dc.balance(mechanism, run, work="samples")
    monkeypatch.setattr(sampled, "BLOCK_STATES", 40)
    monkeypatch.setattr(quadrature, "ROWS_AT_ONCE", 40)
    small = dc.balance(mechanism, run, work="samples")
    scale = whole.energy_exchanged
    for name in whole.power:
        np.testing.assert_array_equal(whole.power[name], small.power[name])
        np.testing.assert_allclose(whole.work[name], small.work[name], rtol=0, atol=1e-14 * scale)


def test_violations_of_a_long_log_are_told() -> None:
    """All columns of a log long enough for one pass: a quaternion that is off by 1e-3 in one row."""
    mechanism = dc.Mechanism(
        bodies=[dc.bodies.box("brick", 1.0, (0.1, 0.4, 0.9))],
        joints=[dc.free("base", "brick")],
    )
    run = dc.simulate(
        mechanism, mechanism.state(speeds={"base": (0, 0, 0, 0.1, 2, 0.1)}), 10.0, 1e-3, record=()
    )
    q = run.q.copy()
    row, places = 7000, [run.coordinates.index(f"base.{c}") for c in ("qw", "qx", "qy", "qz")]
    q[row, places] *= 1.001
    ledger = dc.balance(mechanism, replace(run, q=q), "samples")
    assert len(ledger.t) == 10_001
    off = ledger.violation["quaternion base"]
    assert off[row] == pytest.approx(1e-3, rel=1e-6)
    assert np.delete(off, row).max() < 1e-9
