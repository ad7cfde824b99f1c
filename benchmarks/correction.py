"""What corrections buy: `make bench-correction`. Prints tables and writes JSON.

The energy: the thesis's 50 s run (fig. 4.8, no dampers: chaotic) and a long run of the heavy top, by plain
solvers, by the same with the energy restored, and by solvers that keep the energy by themselves; all against
Taylor's method in quadruple precision.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measure import machine
from thesis.runs import problem

import deltac as dc

warnings.simplefilter("ignore", dc.SimulationStoppedWarning)

LOST = 0.1
"""A motion is lost when a coordinate (rad, or an entry of a quaternion) is so far off."""

SAMPLES = 500


@dataclass(frozen=True)
class Case:
    """A motion to be followed, at one step by every solver."""

    title: str
    mechanism: dc.Mechanism
    state: dc.State
    duration: float
    step: float


def cases() -> list[Case]:
    """The two motions."""
    thesis = problem("tumbling")
    top = dc.problems.load("heavy-top")
    return [
        Case("thesis, fig. 4.8 without dampers", thesis.mechanism, thesis.state, 50.0, 0.01),
        Case("heavy top", top.mechanism, top.state, 20.0, 1e-3),
    ]


METHODS: tuple[tuple[str, str | None], ...] = (
    ("ode2", None),
    ("ode2", "energy"),
    ("ode4", None),
    ("ode4", "energy"),
    ("ode5", None),
    ("ode5", "energy"),
    ("implicit-midpoint", None),
    ("discrete-gradient", None),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/correction.json"))
    options = parser.parse_args()
    found: dict[str, Any] = {
        "machine": machine(("deltac", "numpy", "casadi", "heyoka")),
        "cases": [compared(case) for case in cases()],
    }
    for case in found["cases"]:
        print(_table(case))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", "utf-8")
    print(f"written to {options.out}")


def compared(case: Case) -> dict[str, Any]:
    """Every method against the reference."""
    times = case.duration / SAMPLES
    exact = dc.simulate(
        case.mechanism, case.state, case.duration, times, dc.solvers.Taylor(1e-25, quad=True)
    )
    rows = []
    for solver, correct in METHODS:
        begun = time.perf_counter()
        steps = round(case.duration / case.step)
        run = dc.simulate(
            case.mechanism,
            case.state,
            case.duration,
            case.step,
            solver,
            dc.Record(testing=("wang",), every=steps // SAMPLES),
            constraints=dc.Projection(energy=correct == "energy"),
        )
        rows.append(
            {"solver": solver, "correct": correct, "seconds": time.perf_counter() - begun}
            | _judged(case, run, exact)
        )
    return {"title": case.title, "step": case.step, "duration": case.duration, "methods": rows}


def _judged(case: Case, run: dc.Trajectory, exact: dc.Trajectory) -> dict[str, Any]:
    ledger = dc.balance(case.mechanism, run, testing=("wang",))
    E = ledger.kinetic + ledger.potential_energy
    off = np.abs(run.q - exact.q[: len(run)]).max(axis=1)
    lost = off > LOST
    first = int(np.argmax(lost)) if lost.any() else len(off) - 1
    tenth = len(exact.t) // 10
    return {
        "energy_error": float(np.abs(E - E[0]).max()),
        "delta_c": float(np.abs(ledger.delta_c["wang"]).max()),
        "energy_exchanged": ledger.energy_exchanged,
        "error_early": float(off[: tenth + 1].max()),
        "error_at_end": float(off[-1]),
        "lost_at": float(run.t[first]) if lost.any() else None,
        "completed": run.provenance.completed,
    }


def _table(case: dict[str, Any]) -> str:
    lines = [
        f"\n{case['title']}: {case['duration']:g} s at h = {case['step']:g} s",
        f"  {'solver':<26}{'|K+V−E0| J':>12}{'|ΔC| J':>11}{'error, first tenth':>20}{'lost at s':>11}"
        f"{'at the end':>12}{'time s':>8}",
    ]
    for m in case["methods"]:
        name = m["solver"] + (" + correction" if m["correct"] else "")
        lost = "never" if m["lost_at"] is None else f"{m['lost_at']:.1f}"
        lines.append(
            f"  {name:<26}{m['energy_error']:>12.1e}{m['delta_c']:>11.1e}{m['error_early']:>20.1e}"
            f"{lost:>11}{m['error_at_end']:>12.1e}{m['seconds']:>8.2f}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
