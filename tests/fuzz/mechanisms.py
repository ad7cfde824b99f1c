"""`python -m tests.fuzz.mechanisms COUNT`: are accelerations right where masses and lengths are extreme?

Random mechanisms, masses and lengths of their bodies times powers of ten, constraints, redundant and nearly
dependent ones. Every instruction of the equations of motion is evaluated a second time with 60 decimal
digits. The error of the accelerations in double precision is measured in the energy norm, which knows no
units. An error that is large and that the start of a run does not tell is a failure; so are a warning where
they are right, and anything raised that is no `InputError`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
import warnings
from collections import Counter
from dataclasses import replace
from typing import Any

import casadi as ca
import mpmath
import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from deltac.dynamics.digits import exactly
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.arguments import INACCURATE as LOOSE
from deltac.simulation.arguments import IllConditionedWarning, check_accelerations
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from tests.systems.constrained_mechanisms import tied
from tests.systems.random_mechanisms import Options, Sample, random_state, samples

DIGITS = 60


def power(rng: np.random.Generator, decades: float) -> float:
    """A power of ten, often none."""
    return 1.0 if rng.random() < 0.3 else float(10.0 ** rng.uniform(-decades, decades))


def extreme(mechanism: Mechanism, rng: np.random.Generator, decades: float) -> Mechanism:
    """Masses, sizes and distances times powers of ten; some bodies alike, some not."""
    common = power(rng, decades)
    bodies = []
    for body in mechanism.bodies:
        m, size = power(rng, decades), common if rng.random() < 0.8 else power(rng, decades)
        bodies.append(
            replace(
                body,
                mass=body.mass * m,
                mass_centre=tuple(c * size for c in body.mass_centre),
                inertia=tuple(tuple(e * (m * size**2) for e in row) for row in body.inertia),
            )
        )
    joints = [
        replace(joint, position=tuple(c * common for c in joint.position))
        for joint in mechanism.joints
    ]
    return replace(mechanism, bodies=tuple(bodies), joints=tuple(joints))


def judged(sample: Sample) -> str:
    """What became of one mechanism; "silent" for a large error that nobody told."""
    mechanism = sample.mechanism
    state = mechanism.state(
        {mechanism.coordinates[int(i)].name: sample.q[i] for i in mechanism.free.q},
        {mechanism.speeds[int(i)].name: sample.u[i] for i in mechanism.free.u},
        sample.t,
    )
    solver = find_solver("ode4")
    try:
        rows = constraint_start(mechanism, state, solver, None, "projection")
    except InputError:
        return "refused"
    flow = build_flow(mechanism, (), rows=rows)
    x = flow.start(state, np.empty(0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_accelerations(flow, mechanism, None, state, x, np.empty(0), (), rows)
        except InputError:
            return "refused"
    told = any(issubclass(w.category, IllConditionedWarning) for w in caught)
    motion = equations_of_motion(mechanism)
    f = ca.Function("f", [flow.t, flow.x, flow.inputs], [ca.densify(flow.xdot)])
    s = motion.system
    M = ca.Function("M", [s.t, s.q], [ca.densify(motion.M)])
    inputs = np.zeros(flow.inputs.shape[0])
    udot = slice(flow.q_size, flow.q_size + flow.u_size)
    found = np.array(f(state.t, x, inputs)).ravel()[udot]
    [exact] = exactly(f, [state.t, x, inputs])
    [mass] = exactly(M, [state.t, x[: flow.q_size]])
    mass = mass.reshape(len(found), len(found))

    def norm(a: Any) -> float:
        return float(mpmath.sqrt(abs(a @ mass @ a)))

    size = norm(exact[udot])
    error = norm(found - exact[udot]) / size if size else norm(found)
    if told:
        return "told" if error > LOOSE / 10 else f"false alarm {error:.1e}"
    return "right" if error < 2 * LOOSE else f"silent {error:.1e}"


def campaign(count: int, first: int, decades: float) -> tuple[Counter[str], list[str]]:
    """`count` mechanisms, half of them constrained; what became of them, and what went wrong."""
    counts: Counter[str] = Counter()
    failures: list[str] = []
    kinds = st.one_of(samples(Options()), tied(Options(bodies=4)).map(lambda t: t.sample))

    @seed(first)
    @settings(
        max_examples=count,
        phases=[Phase.generate],
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(kinds, st.integers(0, 2**32 - 1))
    def one(sample: Sample, number: int) -> None:
        rng = np.random.default_rng(number)
        kind = "tied" if sample.mechanism.constraints else "tree"
        try:
            mechanism = extreme(sample.mechanism, rng, decades)
            if kind == "tree":
                sample = random_state(mechanism, rng)
            else:  # lengths stay, since the state is on its constraints
                bodies = [
                    replace(
                        b,
                        mass=b.mass * m,
                        inertia=tuple(tuple(e * m for e in r) for r in b.inertia),
                    )
                    for b in sample.mechanism.bodies
                    for m in [power(rng, decades)]
                ]
                sample = replace(sample, mechanism=replace(sample.mechanism, bodies=tuple(bodies)))
            outcome = judged(sample)
        except InputError:
            outcome = "refused"
        except Exception:
            outcome = "broken"
            failures.append(f"{number} {sample!r}\n{traceback.format_exc()[-800:]}")
        if outcome.startswith(("silent", "false")):
            failures.append(f"{number} {outcome} {sample!r}")
        counts[f"{kind} {outcome.split()[0]}"] += 1

    one()
    return counts, failures


def main() -> None:
    """Run, print a table as JSON, and exit with 1 if something broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--decades", type=float, default=9.0)
    options = parser.parse_args()
    start = time.process_time()
    with mpmath.workdps(DIGITS):
        counts, failures = campaign(options.count, options.seed, options.decades)
    for failure in failures[:20]:
        print(failure, file=sys.stderr)
    seconds = round(time.process_time() - start)
    print(json.dumps({"seed": options.seed, "cpu_seconds": seconds, "outcomes": counts}))
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
