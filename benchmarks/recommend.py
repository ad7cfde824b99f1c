"""How long `recommend` takes on every problem of the library, what it names, and whether that is true.

The recommended run is made again and measured against the two that agree best among runs which `recommend`
does not see: another solver at a fraction of the step, DOP853 and Radau near rounding. `measured` is to be
`motion` less `doubt`, or between both; `unsure` is how far those two are apart. With `--full`, every solver
is searched alone as well, to the coarsest setting that keeps the tolerance by its own estimate: `dearer` is
the CPU time of the recommended run over that of the cheapest. One line of JSON for each problem.

    python benchmarks/recommend.py [--only NAME] [--tolerance 1e-6] [--seconds 2] [--full]
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
import warnings
from dataclasses import replace

import numpy as np

import deltac as dc
from deltac.diagnosis.recommend.families import families
from deltac.diagnosis.recommend.recommend import Search, SolverCandidate
from deltac.diagnosis.recommend.work_precision import Deadline, Family, Trial, Trials, distance

LIMIT = 6.0
"""Seconds that the search of one solver may take; one that needs longer is not the cheapest."""


def searched(
    problem: dc.Problem, duration: float, tolerance: float, *, full: bool
) -> dict[str, object]:
    """CPU seconds of the search, its answer, and the work of the answer's run."""
    start = time.process_time()
    advice = dc.recommend(problem, duration=duration, tolerance=tolerance)
    seconds = time.process_time() - start
    best = advice.best
    row: dict[str, object] = {
        "problem": problem.name,
        "cpu_s": round(seconds, 2),
        "runs": len(advice.trials),
        "exit_code": advice.exit_code,
    }
    if best is None:
        return row
    measured, unsure = error(problem, duration, best)
    row |= {
        "solver": best.solver,
        "setting": best.setting,
        "energy": best.energy,
        "run_ms": 1e3 * best.seconds,
        "evaluations": best.evaluations,
        "motion": best.motion,
        "doubt": best.doubt,
        "measured": measured,
        "unsure": unsure,
    }
    return row | (cheapest(problem, duration, tolerance, best) if full else {})


def run(
    problem: dc.Problem, duration: float, trial: Trial, rows: int | None = None
) -> dc.Trajectory:
    """The recommended run: all of its steps, or at least so many rows of them."""
    if trial.knob == "tolerance":
        chosen = dc.solvers.by_name(trial.solver, trial.setting)
        return dc.simulate(problem, None, duration, duration / (rows or 1000), chosen, ("wang",))
    steps = round(duration / trial.setting)
    every = max((n for n in range(1, steps // (rows or steps) + 1) if steps % n == 0), default=1)
    record = dc.Record(("wang",), every)
    return dc.simulate(problem, None, duration, duration / steps, trial.solver, record)


def error(problem: dc.Problem, duration: float, trial: Trial) -> tuple[float, float]:
    """The largest error of q and u as a share of their ranges, and how far two references are apart."""
    found = run(problem, duration, trial)
    steps = len(found.t) - 1
    other = "ode5" if trial.solver == "ode8" else "ode8"

    def stepped(divisor: int) -> dc.Trajectory:
        record = dc.Record(("wang",), every=divisor)
        return dc.simulate(problem, None, duration, duration / steps / divisor, other, record)

    def adaptive(solver: str, tolerance: float) -> dc.Trajectory:
        chosen = dc.solvers.by_name(solver, tolerance)
        return dc.simulate(problem, None, duration, duration / steps, chosen, ("wang",))

    made: list[dc.Trajectory] = []
    measured, unsure = np.inf, np.inf
    for make in (
        lambda: stepped(16),
        lambda: adaptive("DOP853", 1e-13),
        lambda: adaptive("Radau", 1e-12),
        lambda: stepped(128),
        lambda: adaptive("RK45", 1e-13),
    ):
        try:
            made.append(make())
        except dc.DeltacError:
            continue
        pairs = itertools.combinations(made, 2)
        apart = [(distance(problem.mechanism, a, b), k) for k, (a, b) in enumerate(pairs)]
        if apart:
            unsure, best = min(apart)
            exact = list(itertools.combinations(made, 2))[best][1]
            measured = distance(problem.mechanism, found, exact)
            if unsure <= 0.01 * measured:
                break
    return measured, unsure


class Estimated(Trials):
    """Trials that are believed as they are: a full search of all solvers takes too long to verify them."""

    def verified(self, family: Family, trial: Trial) -> Trial:
        return replace(trial, verified=True)


def cheapest(
    problem: dc.Problem, duration: float, tolerance: float, best: Trial
) -> dict[str, object]:
    """The cheapest among the coarsest settings of all solvers that keep the tolerance."""

    def seconds(trial: Trial) -> float:
        times = []
        while len(times) < 5 or (len(times) < 50 and sum(times) < 0.2):
            start = time.process_time()
            run(problem, duration, trial, 200)
            times.append(time.process_time() - start)
        return min(times)

    mechanism, state, asked = problem.mechanism, problem.state, (tolerance, tolerance)
    deadline = Deadline()
    choice, _ = families(problem, mechanism, state, duration, None, {}, deadline)
    trials, left = [best], []
    for family in choice:
        deadline = Deadline(LIMIT)
        (family,), _ = families(problem, mechanism, state, duration, (family.name,), {}, deadline)
        alone = SolverCandidate(family, asked, duration)
        made = Estimated(mechanism, state, tolerance)
        found = Search([alone], made, asked, deadline, None).cheapest()
        if found is None:
            left.append(family.name)
        elif (trial := found.trials[found.passing]).solver != best.solver or (
            trial.setting != best.setting
        ):
            trials.append(trial)
    # Only those that may be the cheapest are timed in turn, and verified, which at kinks some do not stand.
    worth = [t for t in trials if t is best or t.seconds <= 2.0 * best.seconds]
    timed = sorted(((seconds(trial), k, trial) for k, trial in enumerate(worth)))
    own = next(time for time, _, trial in timed if trial is best)
    trust = Trials(mechanism, state, tolerance)
    by_name = {family.name: family for family in choice}
    least, cheapest = next(
        (time, trial)
        for time, _, trial in timed
        if trial is best or trust.verified(by_name[trial.solver], trial).passes(*asked)
    )
    return {
        "best_ms": 1e3 * own,
        "cheapest": cheapest.solver,
        "cheapest_setting": cheapest.setting,
        "cheapest_ms": 1e3 * least,
        "cheapest_evaluations": cheapest.evaluations,
        "dearer": own / least,
        "left_out": left,
    }


def main() -> None:
    """Run the problems and print their lines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=dc.problems.names())
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--full", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for name in options.only:
        problem = dc.problems.load(name)
        duration = min(problem.duration, options.seconds)
        row = searched(problem, duration, options.tolerance, full=options.full)
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
