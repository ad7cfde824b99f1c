"""Occurrences: what they hold, how logs carry them, what cuts of a run keep."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.energy.accumulator import OVERLAP, balance_chunks
from deltac.trajectories import from_columns, to_columns, to_metadata


def mechanism() -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.point_mass("table", 1.0), dc.point_mass("ball", 1.0)],
        joints=[
            dc.prismatic("lift", "ground", "table", axis="z", motion="0.05*sin(3*t)"),
            dc.prismatic("height", "ground", "ball", axis="z"),
        ],
        gravity=(0.0, 0.0, -9.81),
        events=[
            dc.events.impact(
                "hit", dc.shapes.point("ball"), dc.shapes.half_space("table"), restitution=0.7
            )
        ],
    )


@cache
def run() -> dc.Trajectory:
    m = mechanism()
    return dc.simulate(m, m.state({"height": 0.5}), 1.28, 0.01)


def same(one: dc.Trajectory, other: dc.Trajectory) -> None:
    assert len(one.events) == len(other.events) > 0
    for a, b in zip(one.events, other.events):
        assert a.to_dict() == b.to_dict()


@pytest.mark.parametrize("suffix", ["csv", "parquet", "npz"])
def test_files_carry_events_exactly(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log.{suffix}"
    run().write(path)
    read = dc.read_trajectory(path)
    same(run(), read)
    ledger = dc.balance(mechanism(), read, work="samples")
    assert np.abs(ledger.delta_c["wang"]).max() <= 1e-9 + ledger.error_bar["wang"].max()


def test_events_go_through_columns_and_metadata() -> None:
    assert "events" not in to_metadata(replace(run(), events=()))
    same(run(), from_columns(to_columns(run()), to_metadata(run())))
    same(run(), pickle.loads(pickle.dumps(run())))


def test_cuts_keep_the_events_within() -> None:
    first = run().events[0]
    assert run().every(4).events == run().events
    later = run().between(first.t + 0.05, 1.28)
    assert later.events == run().events[1:]
    assert run().between(0.0, first.t - 0.05).events == ()
    # The ledger of a part is a part of the ledger.
    m = mechanism()
    whole, part = (dc.balance(m, r, work="samples") for r in (run(), later))
    rows = len(later)
    of_whole = whole.work["impact hit"][-rows:] - whole.work["impact hit"][-rows]
    np.testing.assert_allclose(part.work["impact hit"], of_whole, rtol=0, atol=1e-15)
    # Works on every second row: the same impulses, and the quadrature's bar.
    coarse = dc.balance(m, run().every(2), work="samples")
    assert coarse.work["impact hit"][-1] == whole.work["impact hit"][-1]
    bar = coarse.error_bar["wang"] + whole.error_bar["wang"][::2]
    assert (np.abs(coarse.delta_c["wang"] - whole.delta_c["wang"][::2]) <= bar).all()


def test_columns_in_another_order_take_the_events_along() -> None:
    r, turned = run(), [1, 0]
    mixed = dc.Trajectory(
        t=r.t,
        q=r.q[:, turned],
        u=r.u[:, turned],
        udot=None if r.udot is None else r.udot[:, turned],
        forces={name: force[:, turned] for name, force in r.forces.items()},
        coordinates=r.coordinates[::-1],
        speeds=r.speeds[::-1],
        events=tuple(event.reordered(turned, turned) for event in r.events),
    )
    audit = dc.audit(mechanism(), mixed)
    assert audit.verdict.kind == "consistent" and [f.kind for f in audit.findings] == ["order"]
    same(r, audit.run)


def test_without_accelerations_pieces_are_derived_one_by_one() -> None:
    m = dc.Mechanism(
        bodies=[dc.point_mass("ball", 1.0)],
        joints=[dc.prismatic("height", "ground", "ball", axis="z", damping=0.2)],
        gravity=(0.0, 0.0, -9.81),
        events=[dc.events.joint_stop("floor", "height", lower=0.0, restitution=0.7)],
    )
    full = dc.simulate(m, m.state({"height": 0.5}), 1.28, 0.01, "ode8")
    events = tuple(replace(e, udot_before=None, udot_after=None) for e in full.events)
    bare = replace(full, udot=None, events=events)
    ledger = dc.balance(m, bare, work="samples")
    assert ledger.basis["u̇"] == "derived"
    # The flights are smooth, so splines of degree five find u̇ well enough for a cubic's rates.
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-8
    assert dc.audit(m, bare).verdict.kind == "consistent"


def test_the_ledger_in_chunks_is_the_ledger(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    run().write(path)
    whole = dc.balance(mechanism(), run(), work="samples")
    chunks = dc.scan_trajectory(path, rows=32, overlap=OVERLAP)
    ledger, rows = balance_chunks(mechanism(), chunks, work="samples")
    same(run(), rows)
    np.testing.assert_allclose(
        ledger.work["impact hit"], whole.work["impact hit"], rtol=0, atol=1e-13
    )
    bar = ledger.error_bar["wang"] + whole.error_bar["wang"]
    assert (np.abs(ledger.delta_c["wang"] - whole.delta_c["wang"]) <= bar).all()
    assert ledger.energy_exchanged == pytest.approx(
        whole.energy_exchanged, rel=0.05
    )  # a scale, by trapezoids


def event(**changes: Any) -> dc.Occurrence:
    given: dict[str, Any] = {
        "t": 0.5,
        "names": ("impact floor",),
        "q": [0.0],
        "u_before": [-2.0],
        "u_after": [1.0],
        "impulses": {"impact floor": [3.0]},
    }
    return dc.Occurrence(**(given | changes))


def test_what_an_occurrence_tells() -> None:
    made = event()
    assert made.work == {"impact floor": -1.5} and made.energy_lost == 1.5
    assert "impact floor" in repr(made) and "1.5 J lost" in repr(made)
    with pytest.raises(ValueError, match="read-only"):
        made.u_after[0] = 3.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"t": float("nan")}, "expected a finite time"),
        ({"u_after": [1.0, 2.0]}, r"u_after of .* found shape \(2,\), expected 1 numbers"),
        ({"u_after": [np.inf]}, "expected finite numbers"),
        ({"q": "zero"}, "q of .* expected real numbers"),
        ({"impulses": {"bang floor": [1.0]}}, "'bang' is no kind of channel"),
    ],
)
def test_unusable_occurrences_say_why(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(dc.InputError, match=words):
        event(**changes)


@pytest.mark.parametrize(
    ("events", "words"),
    [
        ([event(t=7.0)], "outside the rows from 0.0 to 1.0 s"),
        ([event(t=0.6), event(t=0.4)], "out of order"),
        ([event(q=[0.0, 1.0])], "has 2 coordinates and 1 speeds, the rows have 1 and 1"),
        ([event(udot_before=[0.0])], "both have udot, or neither"),
        (["bang"], "expected an Occurrence"),
    ],
)
def test_a_trajectory_checks_its_events(events: Any, words: str) -> None:
    table = np.zeros((2, 1))
    with pytest.raises(dc.InputError, match=words):
        dc.Trajectory(
            t=np.array([0.0, 1.0]),
            q=table,
            u=table,
            coordinates=("x",),
            speeds=("x",),
            events=events,
        )


def test_rows_are_taken_by_slice_places_and_mask() -> None:
    whole = run()
    places = np.arange(3, len(whole), 2)
    mask = np.zeros(len(whole), dtype=bool)
    mask[places] = True
    for rows in (slice(3, None, 2), places, mask):
        part = whole.take(rows)
        np.testing.assert_array_equal(part.t, whole.t[3::2])
        np.testing.assert_array_equal(part.u, whole.u[3::2])
        assert part.events == tuple(e for e in whole.events if part.t[0] <= e.t <= part.t[-1])
    for bad in (
        places[:0],
        places[::-1],
        np.array([0, 0]),
        np.array([len(whole)]),
        np.array([0.5]),
    ):
        with pytest.raises(dc.InputError, match="^rows: "):
            whole.take(bad)
