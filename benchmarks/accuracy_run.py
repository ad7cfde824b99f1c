"""To the last digits: the triple pendulum for 10 s with |ΔC| below 1e-13 of the energy exchanged.

We take the Taylor method; the rival is SciPy's DOP853 at the tightest tolerance it takes, on the same
compiled right-hand side, powers included.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from measure import contest
from numpy.typing import NDArray

import deltac as dc
from deltac.simulation.ensemble.steps import rate_kernel
from deltac.simulation.flow import build_flow

Array = NDArray[np.float64]
DURATION, EVERY = 10.0, 1.0
TARGET = 10.0
WITHIN = 1e-13
"""|ΔC| that is asked for, of the energy exchanged."""
APART = 1e-11
"""How far the two may be apart at any whole second (rad): what rounding has become of by then."""
TIGHTEST = 2.3e-14  # SciPy raises smaller relative tolerances to 100 ulp


def run(rounds: int) -> dict[str, Any]:
    """Check both sides' energy and angles, then time them; {"skipped": why} without heyoka."""
    name = f"triple pendulum, {DURATION:g} s to {WITHIN:g}: deltac taylor / SciPy DOP853"
    if find_spec("heyoka") is None:
        return {"name": name, "skipped": "the Taylor method needs heyoka"}
    problem = dc.problems.load("triple-pendulum")
    rival = Rival(problem)
    own, other = ours(problem), rival.run()
    errors = [_energy_error(problem, side) for side in (own, rival.trajectory(own, other))]
    for side, error in zip(("deltac", "SciPy"), errors, strict=True):
        assert error < WITHIN, f"{side}'s ΔC is {error:.1e} of the energy exchanged"
    apart = float(np.abs(other.y[:3].T - own.q).max())
    assert apart < APART, f"deltac and SciPy are {apart:.1e} rad apart"
    measured = contest(lambda: ours(problem), rival.run, rounds).summary()
    return {
        "name": name,
        "target": TARGET,
        **measured,
        "our_error": errors[0],
        "their_error": errors[1],
        "apart_rad": apart,
        "their_evaluations": int(other.nfev),
    }


def ours(problem: dc.problems.Problem) -> dc.Trajectory:
    """The whole `simulate`; its integrator is made in the first call and kept."""
    return dc.simulate(
        problem.mechanism, problem.state, DURATION, EVERY, "taylor", record=("wang",)
    )


class Rival:
    """SciPy's DOP853 on deltac's compiled ẋ, made before the clock starts."""

    def __init__(self, problem: dc.problems.Problem) -> None:
        self.flow = build_flow(problem.mechanism, ("wang",))
        self.start = self.flow.start(problem.state, np.empty(0))
        kernel = rate_kernel(self.flow).compile(single=True)
        given, out = np.empty(kernel.n_in), np.empty(kernel.n_out)

        def rate(t: float, x: Array) -> Array:
            given[0], given[1:] = t, x
            # SciPy keeps what it is given, and goes on from it after a step that it refused.
            return kernel.single(given, out).copy()

        self.rate = rate

    def run(self, duration: float = DURATION) -> Any:
        """SciPy's result, with the state at whole seconds."""
        from scipy.integrate import solve_ivp

        times = np.arange(0.0, duration + EVERY / 2, EVERY)
        return solve_ivp(
            self.rate, (0.0, duration), self.start, "DOP853", times, rtol=TIGHTEST, atol=TIGHTEST
        )

    def trajectory(self, like: dc.Trajectory, found: Any) -> dc.Trajectory:
        """SciPy's states in place of those of a run of deltac's at the same instants."""
        q, u, sums = (found.y[part] for part in self.flow.parts)
        first = len(self.flow.works)
        works = dict(zip(self.flow.works, sums[:first], strict=True))
        integrals = dict(zip(self.flow.integrals, sums[first:], strict=True))
        return replace(like, q=q.T, u=u.T, udot=None, works=works, integrals=integrals)


def _energy_error(problem: dc.problems.Problem, run: dc.Trajectory) -> float:
    """|ΔC| of the energy exchanged."""
    return dc.balance(problem.mechanism, run).relative("wang")


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"|ΔC| {found['our_error']:.0e} and {found['their_error']:.0e} of the energy exchanged; SciPy "
        f"takes {found['their_evaluations']} evaluations; at whole seconds they are at most "
        f"{found['apart_rad']:.0e} rad apart"
    )
