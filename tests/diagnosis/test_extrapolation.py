"""Richardson's extrapolation of the runs of a study: against exact motions, and where it is refused."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from tests.support.slow import repeated

CASES = [
    ("simple-pendulum", 1.6, 0.01, "ode5"),
    ("chaplygin-sleigh", 1.6, 0.01, "ode4"),
    ("torque-free-box", 1.6, 0.01, "ode3"),
    ("andrews-squeezer", 0.01, 1e-4, "ode4"),
    ("rolling-disc", 0.8, 4e-3, "implicit-midpoint"),
]


@pytest.mark.parametrize("case", repeated(CASES, *CASES[:3]))
def test_extrapolated_motions(case: tuple[str, float, float, str]) -> None:
    """A tenth of the finest run's error or less; smaller than a run of equal cost; the estimate holds."""
    name, duration, step, solver = case
    problem = dc.problems.load(name)
    study = dc.study(problem, duration=duration, steps=[4 * step, 2 * step, step], solver=solver)
    found = study.extrapolate()
    spacing = 4 * step
    exact = dc.simulate(problem, None, duration, spacing, dc.solvers.Taylor())
    finest = study.runs[-1].run
    assert finest is not None
    off = np.abs(found.run.q - exact.q)
    fine = np.abs(finest.q[::4] - exact.q)
    assert off.max() < 0.1 * fine.max()
    assert (off <= 2.0 * found.q_error + 1e-13).all()
    assert off.max() <= found.error.max() <= 3.0 * fine.max()
    # 1 + 2 + 4 parts of steps have been taken: a run with so many.
    count = round(duration / step) * 7 // 4
    equal = dc.simulate(problem, None, duration, duration / count, solver)
    assert off[-1].max() < np.abs(equal.q[-1] - exact.q[-1]).max()
    ledger = dc.balance(problem, found.run)  # the integrals are extrapolated, too
    assert ledger.method == "in-loop"
    if solver != "implicit-midpoint":  # which keeps this energy to rounding by itself
        assert (
            np.abs(ledger.delta_c["wang"]).max()
            < 0.1 * np.abs(study.runs[-1].ledger.delta_c["wang"]).max()
        )
    if problem.mechanism.constraints:
        assert all(v.max() < 1e-10 for v in ledger.violation.values())


def test_chaos_is_extrapolated_up_to_where_runs_part() -> None:
    wild = dc.problems.load("double-pendulum")
    start = wild.mechanism.state(wild.state.q + 2.0, wild.state.u + 3.0)
    study = dc.study(wild.mechanism, start, 20.0, [0.04, 0.02, 0.01], "ode4")
    try:
        found = study.extrapolate()
    except dc.InputError as error:
        assert error.code == "E-SOLVER"
    else:
        assert found.run.t[-1] <= study.horizon


def _refused(study: dc.Study, words: str) -> None:
    with pytest.raises(dc.InputError, match=words) as caught:
        study.extrapolate()
    assert caught.value.code == "E-SOLVER"


def test_refusals() -> None:
    pendulum = dc.problems.load("simple-pendulum")
    _refused(dc.study(pendulum, duration=0.8, steps=[0.02, 0.01], solver="ode4"), "2 runs")
    particle = dc.problems.load("free-particle")  # exact at any step
    _refused(dc.study(particle, duration=0.8, steps=[0.04, 0.02, 0.01], solver="ode4"), "floor")
    triple = dc.problems.load("triple-pendulum")  # steps too long for ode5 to have its order
    _refused(dc.study(triple, duration=1.0, steps=[0.02, 0.01, 0.005], solver="ode5"), "the same")
    ball = dc.problems.load("bouncing-ball")
    study = dc.study(ball, duration=0.8, steps=[0.04, 0.02, 0.01], solver="ode1")
    with pytest.raises(dc.InputError):
        study.extrapolate()


def test_it_is_a_report() -> None:
    pendulum = dc.problems.load("simple-pendulum")
    found = dc.study(pendulum, duration=0.8, steps=[0.04, 0.02, 0.01], solver="ode4").extrapolate()
    assert found.exit_code == 0
    assert found.to_dict()["order"] == 4.0
    assert found.run.provenance.notes["extrapolated"] == "order 4"
    assert "h^4 and h^5" in found.explain()
