"""`python -m tests.fuzz.mechanisms COUNT`: are accelerations right where masses and lengths are extreme?

Random mechanisms, masses and lengths of their bodies times powers of ten, constraints, redundant and nearly
dependent ones. Every instruction of the equations of motion is evaluated a second time with 60 decimal
digits. The error of the accelerations in double precision is measured in the energy norm, which knows no
units: beside what the condition of the (scaled) mass matrix and constraints excuses. An error that is large
and told by nobody is a failure; so is anything raised that is no `InputError`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections import Counter
from dataclasses import replace
from typing import Any

import casadi as ca
import mpmath
import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from tests.systems.constrained_mechanisms import tied
from tests.systems.random_mechanisms import Options, Sample, random_state, samples

DIGITS = 60
LOOSE = 1e-6
"""Errors of accelerations, relative in the energy norm, above which they must not go untold."""

UNARY = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_NEG: lambda x: -x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: 2 * x,
    ca.OP_INV: lambda x: 1 / x,
    ca.OP_SQRT: mpmath.sqrt,
    ca.OP_SIN: mpmath.sin,
    ca.OP_COS: mpmath.cos,
    ca.OP_TAN: mpmath.tan,
    ca.OP_ASIN: mpmath.asin,
    ca.OP_ACOS: mpmath.acos,
    ca.OP_ATAN: mpmath.atan,
    ca.OP_EXP: mpmath.exp,
    ca.OP_LOG: mpmath.log,
    ca.OP_TANH: mpmath.tanh,
    ca.OP_SINH: mpmath.sinh,
    ca.OP_COSH: mpmath.cosh,
    ca.OP_FABS: abs,
    ca.OP_SIGN: mpmath.sign,
    ca.OP_NOT: lambda x: mpmath.mpf(x == 0),
}
BINARY = {
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: lambda x, y: x / y,
    ca.OP_POW: mpmath.power,
    ca.OP_CONSTPOW: mpmath.power,
    ca.OP_ATAN2: mpmath.atan2,
    ca.OP_HYPOT: mpmath.hypot,
    ca.OP_FMIN: min,
    ca.OP_FMAX: max,
    ca.OP_LT: lambda x, y: mpmath.mpf(x < y),
    ca.OP_LE: lambda x, y: mpmath.mpf(x <= y),
    ca.OP_EQ: lambda x, y: mpmath.mpf(x == y),
    ca.OP_NE: lambda x, y: mpmath.mpf(x != y),
    ca.OP_AND: lambda x, y: mpmath.mpf(x != 0 and y != 0),
    ca.OP_OR: lambda x, y: mpmath.mpf(x != 0 or y != 0),
    ca.OP_IF_ELSE_ZERO: lambda x, y: y if x != 0 else mpmath.mpf(0),
}


def exactly(f: ca.Function, arguments: list[Any]) -> list[np.ndarray[Any, Any]]:
    """The outputs of a function of dense SX, with `DIGITS` decimal digits."""
    given = [[mpmath.mpf(float(v)) for v in np.ravel(a, order="F")] for a in arguments]
    found = [[mpmath.mpf(0)] * f.nnz_out(k) for k in range(f.n_out())]
    work: dict[int, Any] = {}
    for k in range(f.n_instructions()):
        operation, into, of = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if operation == ca.OP_CONST:
            work[into[0]] = mpmath.mpf(f.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            work[into[0]] = given[of[0]][of[1]]
        elif operation == ca.OP_OUTPUT:
            found[into[0]][into[1]] = work[of[0]]
        elif operation in UNARY:
            work[into[0]] = UNARY[operation](work[of[0]])
        else:
            work[into[0]] = BINARY[operation](work[of[0]], work[of[1]])
    return [np.array(values, dtype=object) for values in found]


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
    motion = equations_of_motion(mechanism)
    f = ca.Function("f", [flow.t, flow.x, flow.inputs], [ca.densify(flow.xdot)])
    s = motion.system
    M = ca.Function("M", [s.t, s.q], [ca.densify(motion.M)])
    x = flow.start(state, np.empty(0))
    inputs = np.zeros(flow.inputs.shape[0])
    udot = slice(flow.q_size, flow.q_size + flow.u_size)
    found = np.array(f(state.t, x, inputs)).ravel()[udot]
    [exact] = exactly(f, [state.t, x, inputs])
    [mass] = exactly(M, [state.t, x[: flow.q_size]])
    mass = mass.reshape(len(found), len(found))

    def norm(a: Any) -> float:
        return float(mpmath.sqrt(abs(a @ mass @ a)))

    if not np.isfinite(found).all():
        return "told"  # the run stops at its first row
    size = norm(exact[udot])
    error = norm(found - exact[udot]) / size if size else norm(found)
    return "right" if error < LOOSE else f"silent {error:.1e}"


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
        if outcome.startswith("silent"):
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
