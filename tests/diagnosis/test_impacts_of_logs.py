"""Impacts that a log leaves out: those of the model's law, or of another restitution; in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from deltac.energy.prepare import _rate
from deltac.problems.bouncing_ball import problem

GRAVITY, HEIGHT, STEP, ROWS = 9.81, 1.0, 0.01, 300


def bounced(restitution: float, height: float = HEIGHT) -> dc.Trajectory:
    """Heights and speeds of a ball that fell from a height, at even times, by its parabolas."""
    begin, speed = -np.sqrt(2.0 * height / GRAVITY), np.sqrt(2.0 * GRAVITY * height)
    q, u, times = [], [], np.asarray(STEP * np.arange(ROWS))
    for t in times:
        while t - begin > 2.0 * speed / GRAVITY:
            begin, speed = begin + 2.0 * speed / GRAVITY, restitution * speed
        since = t - begin
        q.append(speed * since - 0.5 * GRAVITY * since**2)
        u.append(speed - GRAVITY * since)
    return dc.Trajectory(
        t=times, q=np.array(q)[:, None], u=np.array(u)[:, None],
        coordinates=("height",), speeds=("height",), provenance=dc.Provenance("by hand"),
    )  # fmt: skip


def test_impacts_of_the_model_are_taken() -> None:
    audit = dc.audit(problem(0.8), bounced(0.8))
    assert audit.verdict.kind == "consistent", audit.explain()
    assert "F-IMPACTS-BY-LAW" in {f.code for f in audit.findings}
    # Each impact takes 1 − e² of m g z; what is left are the digits of the rows.
    lost = -audit.ledger.work["impact floor"][-1]
    count = len(audit.run.events)
    assert count > 3, count
    assert lost == pytest.approx(GRAVITY * HEIGHT * (1.0 - 0.8 ** (2 * count)), rel=1e-9)
    assert np.abs(audit.energy_error).max() < 1e-10


def test_a_row_at_the_time_of_an_impact() -> None:
    """The ball falls for 45 rows: the rows of the impact and of the log are of one instant."""
    audit = dc.audit(problem(0.8), bounced(0.8, 0.5 * GRAVITY * (45.0 * STEP) ** 2))
    assert audit.verdict.kind == "consistent", audit.explain()
    assert np.min(np.abs([event.t - 0.45 for event in audit.run.events])) < 1e-12


@pytest.mark.parametrize("own", [0.78, 0.81, 0.9])
def test_another_restitution_is_named(own: float) -> None:
    audit = dc.audit(problem(0.8), bounced(own))
    assert audit.verdict.kind == "equation-error", audit.explain()
    [told] = [f for f in audit.findings if f.kind == "restitution"]
    assert told.factor == pytest.approx((1.0 + own) / 1.8, rel=1e-6)
    # The model's law takes what it would take of each impact: (e² − 0.8²) of K before it is missing.
    before = GRAVITY * HEIGHT * own ** (2.0 * np.arange(len(audit.run.events)))
    missing = float(np.sum((own**2 - 0.8**2) * before))
    assert audit.attribution is not None
    assert audit.attribution.equations.energy == pytest.approx(missing, rel=1e-6)


def test_noise_is_no_restitution() -> None:
    run, rng = bounced(0.8), np.random.default_rng(3)
    noisy = dc.Trajectory(
        t=run.t, q=run.q + 1e-3 * rng.standard_normal(run.q.shape),
        u=run.u + 1e-2 * rng.standard_normal(run.u.shape),
        coordinates=run.coordinates, speeds=run.speeds,
    )  # fmt: skip
    audit = dc.audit(problem(0.8), noisy)
    assert audit.verdict.kind != "equation-error", audit.explain()
    assert not [f for f in audit.findings if f.kind == "restitution"]


def test_two_rows_tell_of_no_impact() -> None:
    audit = dc.audit(problem(0.8), bounced(0.8).take(slice(0, 2)))
    assert "F-IMPACTS" in {f.code for f in audit.findings}


def test_two_impacts_tell_no_restitution() -> None:
    """Two departures may be alike by chance, as what a method does to the places of impacts."""
    audit = dc.audit(problem(0.8), bounced(0.9).take(slice(0, 180)))
    assert audit.verdict.kind == "unresolved", audit.explain()


def test_an_impact_at_the_last_row() -> None:
    fallen = bounced(0.8, 0.5 * GRAVITY * (45.0 * STEP) ** 2).take(slice(0, 46))
    audit = dc.audit(problem(0.8), fallen)
    assert audit.verdict.kind == "consistent", audit.explain()


@pytest.mark.parametrize("t", [[0.45], [0.45, 0.45], [0.1, 0.1, 0.2, 0.3, 0.3]])
def test_rates_of_rows_at_the_time_of_an_event(t: list[float]) -> None:
    """A straight line has its slope at every row; a piece that is no longer than an instant has none."""
    times = np.array(t)
    slope = 3.0 if times[-1] > times[0] else 0.0
    assert _rate(times, 3.0 * times[:, None])[:, 0] == pytest.approx([slope] * len(t), abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("stopped", [False, True])
@pytest.mark.parametrize(("restitution", "step"), [(0.5, 0.04), (0.8, 0.01), (0.7, 0.04)])
def test_impacts_of_whole_steps_accuse_nobody(
    stopped: bool, restitution: float, step: float
) -> None:
    """Time stepping puts a ball back above the floor, or onto it, and leaves no impact in the log."""
    rows = [(HEIGHT, 0.0)]
    for _ in range(149):
        q, u = rows[-1]
        u -= step * GRAVITY
        q += step * u
        if q < 0.0:
            q, u = (0.0 if stopped else -restitution * q), -restitution * u
        rows.append((q, u))
    q_, u_ = np.array(rows).T[:, :, None]
    t = np.asarray(step * np.arange(150.0), dtype=float)
    run = dc.Trajectory(t=t, q=q_, u=u_, coordinates=("height",), speeds=("height",))
    assert dc.audit(problem(restitution), run).verdict.kind == "unresolved"


def test_a_mistake_beside_impacts_is_told() -> None:
    model = problem(0.8).mechanism.with_parameters(g=1.02 * GRAVITY)
    audit = dc.audit(model, bounced(0.8))
    assert audit.verdict.kind == "equation-error", audit.explain()
    # Of a point mass on a slider that is all the same.
    assert audit.causes[0].kind in ("gravity", "constant-force", "parameter")
