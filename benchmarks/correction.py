"""What corrections buy: `make bench-correction`. Prints tables and writes JSON.

The motion: the smooth problems of the library by runs of a study that are extrapolated, beside the plain
solver and ode8 at the same number of evaluations of ẋ.

The energy: the thesis's 50 s run (fig. 4.8, no dampers: chaotic) and a long run of the heavy top, by plain
solvers, by the same with the energy restored, and by solvers that keep the energy by themselves; all against
Taylor's method in quadruple precision.
"""

from __future__ import annotations

import argparse
import json
import math
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measure import machine

import deltac as dc
from deltac.studies.thesis.runs import problem

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


# --- the motion, on the problem library -----------------------------------------------------------

SMOOTH = (
    "andrews-squeezer", "ball-on-rising-table", "ball-on-table", "bead-on-hoop", "bicycle", "bricard",
    "chaotic-double-body", "chaplygin-sleigh", "disc-on-moving-plane", "double-pendulum", "driven-pendulum",
    "driven-triple-pendulum", "elastic-pendulum", "heavy-top", "knife-edge", "rolling-disc",
    "simple-pendulum", "spherical-pendulum", "torque-free-box", "triple-pendulum",
)  # fmt: skip
"""Problems without impacts, contacts and friction that are not stiff, nor right at any step.

Without n-four-bar, which goes through singular configurations.
"""

ROWS = 25
"""Samples at which motions are compared."""

LONGEST = 2.0
"""Motions are followed for so long (s), or for their own duration if that is shorter."""

RESOLVED = 1e-2
"""The coarsest run of a study is off by less than this (m, rad)."""

LEVELS = (1, 2, 4)
"""Studies: their coarsest step, as parts of the one that resolves the motion."""

STAGES = {"ode4": 4, "ode5": 6, "ode8": 12}
"""Evaluations of ẋ in a step."""


def library(names: list[str]) -> list[dict[str, Any]]:
    """Each problem, extrapolated, against the plain solver and ode8 at the same cost."""
    found = []
    for name in names:
        begun = time.process_time()
        problem = dc.problems.load(name)
        duration = min(problem.duration, LONGEST)
        for solver in ("ode4", "ode5"):
            rows = _followed(problem, duration, solver)
            found += [{"problem": name, "solver": solver, **row} for row in rows]
        print(f"  {name}: {time.process_time() - begun:.0f} s of CPU", flush=True)
    return found


def _plain(problem: dc.Problem, duration: float, solver: str, count: int) -> dc.Trajectory:
    record = dc.Record(testing=("wang",), every=count // ROWS)
    return dc.simulate(problem, None, duration, duration / count, solver, record)


def _off(run: dc.Trajectory, exact: dc.Trajectory) -> float:
    if len(run) < len(exact):
        return math.inf
    every = (len(run) - 1) // (len(exact) - 1)
    return float(np.abs(run.q[::every] - exact.q).max())


def _followed(problem: dc.Problem, duration: float, solver: str) -> list[dict[str, Any]]:
    count = ROWS
    fine = _plain(problem, duration, solver, 2 * count)
    while count < 200_000:  # the first doubling at which runs hardly differ
        coarse, fine = fine, _plain(problem, duration, solver, 4 * count)
        if len(coarse) == len(fine) and _off(coarse, fine) < RESOLVED:
            break
        count *= 2
    count *= 2
    if problem.mechanism.constraints:  # Taylor's method takes long to compile there
        exact = _plain(problem, duration, "ode5", 64 * count * LEVELS[-1])
    else:
        exact = dc.simulate(problem, None, duration, duration / ROWS, dc.solvers.Taylor())
    stages, rows = STAGES[solver], []
    for level in LEVELS:
        n = count * level
        study = dc.study(
            problem,
            duration=duration,
            steps=[duration / (n * k) for k in (1, 2, 4)],
            solver=solver,
            record=("wang",),
        )
        eighth = max(1, round(7 * n * stages / STAGES["ode8"] / ROWS)) * ROWS
        row = {
            "evaluations": 7 * n * stages,
            "plain": _off(_plain(problem, duration, solver, 7 * n), exact),
            "ode8": _off(_plain(problem, duration, "ode8", eighth), exact),
        }
        try:
            better = study.extrapolate()
        except dc.InputError as error:
            rows.append(row | {"corrected": None, "refused": str(error)})
            continue
        whole = better.run.t[-1] >= problem.state.t + duration * (1 - 1e-9)
        error = _off(better.run, exact) if whole else None
        told = {} if whole else {"refused": "the runs part"}
        rows.append(row | {"corrected": error, "estimate": float(better.error.max()), **told})
    return rows


ROUNDING = 1e-12
"""Motions that are both so near (m, rad) are at rounding, and none is the better one."""


def _library_table(rows: list[dict[str, Any]]) -> str:
    lines = []
    for solver in ("ode4", "ode5"):
        own = [r for r in rows if r["solver"] == solver]
        offered = [r for r in own if r["corrected"] is not None]
        told = [r for r in offered if max(r["plain"], r["corrected"]) > ROUNDING]
        better = [r for r in told if r["corrected"] < r["plain"]]
        gains = sorted(r["plain"] / max(r["corrected"], 1e-16) for r in told)
        inside = sum(r["corrected"] <= r["estimate"] for r in told)
        eighth = sum(r["ode8"] < r["corrected"] for r in told)
        lines.append(
            f"extrapolated, {solver}: better in {len(better)} of {len(told)} at equal cost "
            f"({len(own) - len(offered)} refused, {len(offered) - len(told)} at rounding); error of plain / "
            f"corrected: median {gains[len(gains) // 2]:.3g}, tenth {gains[len(gains) // 10]:.3g}; the "
            f"estimate holds in {inside}; ode8 is better still in {eighth}"
        )
        lines += [
            f"    {r['problem']:<24}{r['evaluations']:>9}  plain {r['plain']:.1e}  corrected "
            f"{r['corrected']:.1e}"
            for r in told
            if r not in better
        ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/correction.json"))
    parser.add_argument("--only", choices=("motion", "energy"), help="one of the two parts")
    parser.add_argument("--problems", help="of the library, separated by commas")
    options = parser.parse_args()
    found: dict[str, Any] = {"machine": machine(("deltac", "numpy", "casadi", "heyoka"))}
    if options.only != "energy":
        names = options.problems.split(",") if options.problems else list(SMOOTH)
        found["library"] = library(names)
        print(_library_table(found["library"]))
    if options.only != "motion":
        found["cases"] = [compared(case) for case in cases()]
        for case in found["cases"]:
            print(_table(case))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", "utf-8")
    print(f"written to {options.out}")


# --- the energy, on two motions ---------------------------------------------------------------------


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
