"""One run of the triple pendulum, testing functions in the loop, beside other programs at the same step.

Both sides record the state at every step: we in a `Trajectory` (t, q, u, u̇ and two integrals), the others
as their adapters in `peers` say. The order of a method, and how often it evaluates the accelerations in a
step, stand beside its time. What takes long goes a shorter way; times are compared per step.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from importlib.util import find_spec
from typing import Any

import numpy as np
from measure import contest, median_seconds
from numpy.typing import NDArray
from peers import PENDULUMS, Absent, Pendulum, Rival, pendulum_rivals

import deltac as dc
from deltac.simulation.solvers import find_solver

Array = NDArray[np.float64]
SOLVER, DURATION, STEP = "ode5", 10.0, 1e-4

WITHIN = {3: 1e-5, 4: 1e-9, 5: 1e-9}
"""Largest error after 10 s (rad) that a method of that order may have: far above its own at this step,
far below what another model would show."""
OURS_WITHIN = 1e-11


def run(rounds: int, few: int, adapters: Iterable[str] = PENDULUMS) -> list[dict[str, Any]]:
    """Check that both sides are right, then time them; {"skipped": why} for what is not installed.

    `rounds` are measured beside a rival that is to be beaten by some factor, `few` beside the others;
    `adapters` are those of the rivals to run beside.
    """
    pendulum = Pendulum(dc.problems.load("triple-pendulum"), DURATION, STEP)
    exact = _reference(pendulum.problem)
    error = _error(_ours(pendulum).q[1:], exact)
    assert error < OURS_WITHIN, f"deltac is {error:.1e} rad off the reference"
    return [
        _skipped(rival)
        if isinstance(rival, Absent)
        else _timed(rival, pendulum, exact, error, rounds if rival.target else few)
        for adapter in adapters
        for rival in pendulum_rivals(adapter, pendulum)
    ]


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"with the whole ledger {found['with_ledger_s']:.3f} s; errors after 10 s: "
        f"{found['our_error_rad']:.0e} and {found['their_error_rad']:.0e} rad"
    )


def table(rows: list[dict[str, Any]]) -> str:
    """All rivals, a line each; a ratio below one is a loss, and is called one."""
    solver = find_solver(SOLVER)
    measured = [row["our_us_per_step"] for row in rows if "skipped" not in row]
    ours = f"{statistics.median(measured):.2f} µs" if measured else "not measured"
    heads = f"{'order':>6}{'u̇/step':>8}{'µs/step':>9}{'error rad':>11}  deltac is faster by"
    lines = [
        "\none trajectory of the triple pendulum, every state kept, per step; "
        f"deltac's {SOLVER}: {ours}, order {solver.order}, {solver.stages} u̇/step, "
        "two testing functions included",
        f"  {'':24}{heads}",
    ]
    for row in rows:
        if "skipped" in row:
            lines.append(f"  {row['rival']:24}skipped: {row['skipped']}")
            continue
        low, high = row["ratio_range"]
        lines.append(
            f"  {row['rival']:24}{row['order']:6}{row['evaluations']:8}"
            f"{row['their_us_per_step']:9.2f}{row['their_error_rad']:11.0e}"
            f"  {row['ratio']:.2f} ({low:.2f} to {high:.2f}){'' if row['ratio'] >= 1 else ' LOST'}"
            f"  {row['note']}"
        )
    return "\n".join(lines)


def _timed(
    rival: Rival, pendulum: Pendulum, exact: Array, error: float, rounds: int
) -> dict[str, Any]:
    """Our run of all steps beside the rival's of as many as it takes: seconds are of `DURATION`."""
    theirs = _error(rival.run(), exact)
    assert theirs < WITHIN[rival.order], (
        f"{rival.name} is {theirs:.1e} rad off the reference: another model?"
    )
    measured = contest(lambda: _ours(pendulum), rival.run, rounds).summary()
    scale = pendulum.steps / rival.steps
    found = {
        "name": f"triple pendulum, {DURATION:g} s at {STEP:g} s: deltac {SOLVER} + ΔC / {rival.name}",
        "rival": rival.name,
        "order": rival.order,
        "evaluations": rival.evaluations,
        "note": rival.note,
        "our_error_rad": error,
        "their_error_rad": theirs,
        **measured,
        "theirs_s": measured["theirs_s"] * scale,
        "ratio": measured["ratio"] * scale,
        "ratio_range": [r * scale for r in measured["ratio_range"]],
        "our_us_per_step": 1e6 * measured["ours_s"] / pendulum.steps,
        "their_us_per_step": 1e6 * measured["theirs_s"] / rival.steps,
    }
    if rival.target is None:
        return found
    mechanism = pendulum.problem.mechanism
    ledger_s = median_seconds(lambda: dc.balance(mechanism, _ours(pendulum)), max(1, rounds // 3))
    return {**found, "target": rival.target, "with_ledger_s": ledger_s}


def _skipped(rival: Absent) -> dict[str, Any]:
    name = f"triple pendulum: deltac {SOLVER} + ΔC / {rival.name}"
    return {"name": name, "rival": rival.name, "skipped": rival.why}


def _ours(pendulum: Pendulum) -> dc.Trajectory:
    problem = pendulum.problem
    return dc.simulate(problem.mechanism, problem.state, pendulum.duration, pendulum.step, SOLVER)


def _reference(problem: dc.problems.Problem) -> Array:
    """Angles at whole seconds from 1 s on, (10, 3)."""
    solver = "taylor" if find_spec("heyoka") else "DOP853"
    tolerance = None if solver == "taylor" else 1e-13
    mechanism, state = problem.mechanism, problem.state
    solver = dc.solvers.by_name(solver, tolerance)
    return dc.simulate(mechanism, state, DURATION, 1.0, solver, ()).q[1:]


def _error(angles: Array, exact: Array) -> float:
    """Largest error at the whole seconds of a run (rad); `angles` are those after every step."""
    second = round(1.0 / STEP)
    at_seconds = angles[second - 1 :: second]
    return float(np.abs(at_seconds - exact[: len(at_seconds)]).max())
