"""`python -m tests.fuzz.mechanisms COUNT`: are accelerations right where masses and lengths are extreme?

Random mechanisms, masses and lengths of their bodies times powers of ten, constraints, redundant and nearly
dependent ones. Every instruction of the equations of motion is evaluated a second time with 60 decimal
digits. The error of the accelerations in double precision is measured in the energy norm, which knows no
units. An error that is large and that the start of a run does not tell is a failure; so are a warning where
they are right, and anything raised that is no `InputError`.

The 60 digits are of our own equations, by the code that counts the digits at the start of a run. A third of
the mechanisms are therefore trees that Pinocchio knows: its inverse dynamics, which shares no code with ours,
must find that these accelerations need no forces, but for the rounding that the condition magnifies;
"apart" is a failure.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
import warnings
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from typing import Any

import casadi as ca
import mpmath
import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from deltac.arrays import SMALL_SHARE
from deltac.dynamics.digits import NEARBY, condition
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.kernels import to_mpmath
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.arguments import INACCURATE as LOOSE
from deltac.simulation.arguments import IllConditionedWarning, check_accelerations
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import StateFlow, build_flow
from deltac.simulation.solvers import find_solver
from tests.dynamics.test_against_simulators import IN_PINOCCHIO, PLAIN, in_pinocchio, to_pinocchio
from tests.systems.constrained_mechanisms import tied
from tests.systems.random_mechanisms import Options, Sample, random_state, samples

DIGITS = 60
EACH = 10
"""Mechanisms of one structure, of different masses and lengths: drawing and assembling one takes as long."""


def power(rng: np.random.Generator, decades: float) -> float:
    """A power of ten, often none."""
    return 1.0 if rng.random() < 0.3 else float(10.0 ** rng.uniform(-decades, decades))


def plain(mechanism: Mechanism) -> Mechanism:
    """The same with numbers for masses and lengths that are expressions of parameters."""

    def number(values: Any) -> Any:
        if isinstance(values, tuple):
            return tuple(map(number, values))
        return float(mechanism.number(values))

    def of(part: Any, *names: str) -> Any:
        return replace(part, **{name: number(getattr(part, name)) for name in names})

    bodies = tuple(of(body, "mass", "mass_centre", "inertia") for body in mechanism.bodies)
    joints = tuple(of(joint, "position") for joint in mechanism.joints)
    return replace(mechanism, bodies=bodies, joints=joints)


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
                inertia=tuple(tuple(e * (m * size**2) for e in row) for row in body.inertia),  # type: ignore[arg-type]
            )
        )
    joints = [
        replace(joint, position=tuple(c * common for c in joint.position))
        for joint in mechanism.joints
    ]
    return replace(mechanism, bodies=tuple(bodies), joints=tuple(joints))


class Structure:
    """Mechanisms that differ in masses and lengths alone, which are parameters of one set of equations."""

    def __init__(self, sample: Sample) -> None:
        parts = ("body.", "joint.")
        known = sample.mechanism.numbers.items()
        self.names = tuple(n for n, value in known if n.startswith(parts) and value)
        self.flows: dict[tuple[int, ...], tuple[StateFlow, ca.Function, ca.Function]] = {}

    def written(
        self, mechanism: Mechanism, rows: tuple[int, ...]
    ) -> tuple[StateFlow, ca.Function, ca.Function]:
        """ẋ and M as functions of (t, x, inputs, p)."""
        if rows not in self.flows:
            flow = build_flow(mechanism, (), vary=self.names, rows=rows, works=False)
            given = [flow.t, flow.x, flow.inputs, flow.p]
            motion = equations_of_motion(mechanism, self.names)
            q = flow.x[: flow.q_size]
            [M] = ca.substitute([motion.M], [motion.system.q], [q])
            f = ca.Function("f", given, [ca.densify(flow.xdot)])
            self.flows[rows] = flow, f, ca.Function("M", given, [ca.densify(M)])
        return self.flows[rows]


def judged(structure: Structure, sample: Sample, beside: bool) -> str:
    """What became of one mechanism; "silent" for a large error that nobody told.

    `beside`: Pinocchio knows it, and is asked.
    """
    mechanism = sample.mechanism.opened(*structure.names)
    p = np.array([mechanism.parameters[name] for name in structure.names])
    state = mechanism.state(
        {mechanism.coordinates[int(i)].name: sample.q[i] for i in mechanism.free.q},
        {mechanism.speeds[int(i)].name: sample.u[i] for i in mechanism.free.u},
        sample.t,
    )
    try:
        rows = constraint_start(mechanism, state, find_solver("ode4"), "projection")
    except InputError:
        return "refused"
    flow, f, M = structure.written(mechanism, tuple(rows))
    x = flow.start(state, p)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_accelerations(flow, mechanism, None, state, x, p, structure.names, rows)
        except InputError:
            return "refused"
    told = any(issubclass(w.category, IllConditionedWarning) for w in caught)
    given = [state.t, x, np.zeros(flow.inputs.shape[0]), p]
    udot = slice(flow.q_size, flow.q_size + flow.u_size)
    found = np.array(f(*given)).ravel()[udot]
    [exact] = to_mpmath(f, given)
    [mass] = to_mpmath(M, given)
    mass = mass.reshape(len(found), len(found))

    def norm(a: Any) -> float:
        return float(mpmath.sqrt(abs(a @ mass @ a)))

    size = norm(exact[udot])
    error = norm(found - exact[udot]) / size if size else norm(found)
    if told:
        return "told" if error > LOOSE / 10 else f"false alarm {error:.1e}"
    if beside:
        left, bias = unbalanced(sample, exact[udot].astype(float))
        worst = condition(mass.astype(float), np.zeros((0, len(found))))
        allowed = max(LOOSE, 1e-12 * worst**0.5, 100 * error)
        with suppress(ZeroDivisionError):  # a mass matrix without 60 digits

            def dual(r: Any) -> float:
                solved = mpmath.lu_solve(mpmath.matrix(mass.tolist()), mpmath.matrix(r.tolist()))
                return float(mpmath.sqrt(abs(mpmath.fdot(solved, r.tolist()))))

            if not dual(left) <= allowed * dual(bias):
                return f"apart {dual(left):.1e} of {dual(bias):.1e}, {allowed:.0e}"
    if error < 2 * LOOSE:
        return "right"
    rng = np.random.default_rng(1)  # as the start of a run: what is large where they nearly vanish?
    given[1] = x + NEARBY * rng.uniform(-1.0, 1.0, len(x))
    [near] = to_mpmath(f, given)
    error /= max(1.0, SMALL_SHARE * norm(near[udot]) / size) if size else 1.0
    return "balance" if error < 2 * LOOSE else f"silent {error:.1e}"


def unbalanced(sample: Sample, udot: Any) -> tuple[Any, Any]:
    """What Pinocchio's inverse dynamics leaves of the forces at these accelerations, and at none.

    Its articulated-body algorithm would not do: in double precision it loses digits that ours keeps.
    """
    import pinocchio as pin

    model = in_pinocchio(pin, sample.mechanism)
    data = model.createData()
    q, T, bias = to_pinocchio(sample)
    left, still = (pin.rnea(model, data, q, T @ sample.u, T @ a + bias) for a in (udot, 0 * udot))
    return T.T @ left, T.T @ still


def campaign(count: int, first: int, decades: float) -> tuple[Counter[str], list[str]]:
    """`count` mechanisms, a third of them constrained; what became of them, and what went wrong."""
    counts: Counter[str] = Counter()
    failures: list[str] = []
    known = replace(PLAIN, joints=IN_PINOCCHIO, armature=False)
    kinds = st.one_of(
        samples(Options()).map(lambda s: ("tree", s)),
        tied(Options(bodies=4)).map(lambda t: ("tied", t.sample)),
        samples(known).map(lambda s: ("plain", s)),
    )

    @seed(first)
    @settings(
        max_examples=max(1, count // EACH),
        phases=[Phase.generate],
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(kinds, st.integers(0, 2**32 - 1))
    def one(drawn: tuple[str, Sample], number: int) -> None:
        kind, sample = drawn
        if not len(sample.mechanism.free.u):
            return
        rng = np.random.default_rng(number)
        sample = replace(sample, mechanism=plain(sample.mechanism))
        structure = Structure(sample)
        for _ in range(EACH):
            try:
                outcome = judged(structure, resized(kind, sample, rng, decades), kind == "plain")
            except InputError:
                outcome = "refused"
            except Exception:
                outcome = "broken"
                failures.append(f"{number} {sample!r}\n{traceback.format_exc()[-800:]}")
            if outcome.startswith(("silent", "false", "apart")):
                failures.append(f"{number} {outcome} {sample!r}")
            counts[f"{kind} {outcome.split()[0]}"] += 1

    one()
    return counts, failures


def resized(kind: str, sample: Sample, rng: np.random.Generator, decades: float) -> Sample:
    """The mechanism with other masses and lengths, at another state."""
    if kind != "tied":
        return random_state(extreme(sample.mechanism, rng, decades), rng)
    bodies = []  # lengths stay, since the state is on its constraints
    for b in sample.mechanism.bodies:
        m = power(rng, decades)
        inertia = tuple(tuple(e * m for e in row) for row in b.inertia)
        bodies.append(replace(b, mass=b.mass * m, inertia=inertia))  # type: ignore[arg-type]
    return replace(sample, mechanism=replace(sample.mechanism, bodies=tuple(bodies)))


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
