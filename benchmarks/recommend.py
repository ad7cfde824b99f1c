"""How long `recommend` takes on every problem of the library, what it names, and whether that is true.

The recommended run is made again and compared with one of another solver at a sixteenth of the step, which
`recommend` does not see: `measured` is to be `motion`. One line of JSON for each problem.

    python benchmarks/recommend.py [--only NAME] [--tolerance 1e-6] [--seconds 2]
"""

from __future__ import annotations

import argparse
import json
import time

import deltac as dc
from deltac.diagnosis.recommend.work_precision import distance


def measured(name: str, tolerance: float, longest: float) -> dict[str, object]:
    """CPU seconds of the search, its answer, and the work of the answer's run."""
    problem = dc.problems.load(name)
    duration = min(problem.duration, longest)
    start = time.process_time()
    advice = dc.recommend(problem, duration=duration, tolerance=tolerance)
    seconds = time.process_time() - start
    best = advice.best
    row: dict[str, object] = {
        "problem": name,
        "cpu_s": round(seconds, 2),
        "runs": len(advice.trials),
        "exit_code": advice.exit_code,
    }
    if best is None:
        return row
    return row | {
        "solver": best.solver,
        "setting": best.setting,
        "energy": best.energy,
        "motion": best.motion,
        "run_ms": 1e3 * best.seconds,
        "evaluations": best.evaluations,
        "measured": error(problem, duration, advice),
    }


def error(problem: dc.Problem, duration: float, advice: dc.Recommendation) -> float:
    """Of the recommended run, its largest error of q and u as a share of their ranges."""
    assert advice.best is not None
    step = advice.step or duration / 1000
    every = dc.Record(("wang",), every=16)
    other = "ode5" if advice.solver == "ode8" else "ode8"
    exact = (
        dc.simulate(problem, None, duration, step / 16, other, every)
        if advice.step
        else dc.simulate(problem, None, duration, step, dc.solvers.by_name("RK45", 1e-12))
    )
    chosen = dc.solvers.by_name(advice.best.solver, advice.setting_tolerance)
    run = dc.simulate(problem, None, duration, step, chosen)
    return distance(problem.mechanism, run, exact)


def main() -> None:
    """Run the problems and print their lines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=dc.problems.names())
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--seconds", type=float, default=2.0)
    options = parser.parse_args()
    for name in options.only:
        print(json.dumps(measured(name, options.tolerance, options.seconds)), flush=True)


if __name__ == "__main__":
    main()
