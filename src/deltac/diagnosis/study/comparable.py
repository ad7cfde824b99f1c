"""Which runs are of one motion and may be compared, and what is wrong with the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from deltac.diagnosis.findings import Finding
from deltac.diagnosis.study.curves import scaled_start
from deltac.diagnosis.study.runs import StudyRun
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

SAME_START = 1e-6
"""Scaled difference of two starts from which on they are starts of two motions."""


def disagreements(
    mechanism: Mechanism, runs: Sequence[StudyRun]
) -> tuple[list[int], list[Finding]]:
    """Places of runs that are of one motion and may be compared, and what is wrong with the others.

    The finest run is taken for the motion that was meant.
    """
    places = [k for k, r in enumerate(runs) if r.usable]
    found = list(_failures(runs))
    if len(places) < 2:
        return places, found
    finest = runs[places[-1]].run
    assert finest is not None
    starts = scaled_start(mechanism, [_run(runs[k]) for k in places])
    span = float(finest.t[-1] - finest.t[0])
    kept: list[int] = []
    for k, start in zip(places, starts):
        run = _run(runs[k])
        off = float(np.abs(start - starts[-1]).max(initial=0.0))
        if abs(run.t[0] - finest.t[0]) > 1e-6 * span or off > SAME_START:
            found.append(_other_start(runs[k], run, finest, off))
        elif kept and _same(_run(runs[kept[-1]]), run):
            found.append(_ignored(runs[kept[-1]], runs[k]))
        else:
            kept.append(k)
    return kept, found


def _run(entry: StudyRun) -> Trajectory:
    assert entry.run is not None
    return entry.run


def _same(a: Trajectory, b: Trajectory) -> bool:
    return (
        len(a) == len(b) and bool(np.array_equal(a.t, b.t)) and bool(np.array_equal(a.q, b.q))
    ) and bool(np.array_equal(a.u, b.u) and np.ptp(a.u) + np.ptp(a.q) > 0.0)


def _failures(runs: Sequence[StudyRun]) -> Iterator[Finding]:
    stiff = [entry for entry in runs if entry.stiff]
    if stiff:
        yield Finding(
            "stiff-step",
            f"{'the step' if len(stiff) == 1 else 'steps'} {', '.join(f'{r.step:g}' for r in stiff)} s "
            f"{'is' if len(stiff) == 1 else 'are'} too large for the fast parts of the mechanism",
            stiff[-1].stiff.rstrip("."),
            "What converges at such steps says little of the motion",
        )
    stopped = [(entry, f) for entry in runs for f in entry.findings if f.kind == "stopped"]
    if len(stopped) > 1:
        yield replace(
            stopped[-1][1],
            what="; ".join(f.what for _, f in stopped),
        )
    for entry in runs:
        yield from (f for f in entry.findings if f.kind != "stopped" or len(stopped) == 1)
        if entry.failure:
            yield Finding(
                "run-failed",
                f"there is no run at step {entry.step:g}",
                entry.failure.rstrip("."),
                "The others are judged without it",
            )


def _other_start(entry: StudyRun, run: Trajectory, finest: Trajectory, off: float) -> Finding:
    if abs(run.t[0] - finest.t[0]) > 1e-6 * float(finest.t[-1] - finest.t[0]):
        evidence = f"it starts at t = {run.t[0]:g} s, the finest at {finest.t[0]:g} s"
    else:
        evidence = f"its first state is off by {off:.2g} of the range of the motion"
    return Finding(
        "other-start",
        f"the run at step {entry.step:g} starts at another time or state than the finest one and is not "
        "compared with it",
        evidence,
        "Let all runs start in the same state at the same time",
    )


def _ignored(a: StudyRun, b: StudyRun) -> Finding:
    return Finding(
        "step-ignored",
        f"the runs at steps {a.step:g} and {b.step:g} are the same, number by number",
        "the simulator ignores its step",
        "Let the simulator use the step that it is called with, then study it again",
        "doubt",
    )
