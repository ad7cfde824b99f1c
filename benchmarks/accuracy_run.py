"""To the last digits: the triple pendulum for 10 s with |ΔC| below 1e-13 of the energy turned over.

We take the Taylor method; the rival is SciPy's DOP853 at the tightest tolerance it takes, on the same
compiled right-hand side, powers included.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from measure import contest
from numpy.typing import NDArray

import deltac as dc
from deltac.kernels import evaluator_name
from deltac.simulation.ensemble_steps import rate_kernel
from deltac.simulation.flow import build_flow

Array = NDArray[np.float64]
DURATION, EVERY = 10.0, 1.0
TARGET = 10.0
WITHIN = 1e-13
TIGHTEST = 2.3e-14  # SciPy raises smaller relative tolerances to 100 ulp


def run(rounds: int) -> dict[str, Any]:
    """Check both sides' energy, then time them; {"skipped": why} without heyoka."""
    name = f"triple pendulum, {DURATION:g} s to {WITHIN:g}: deltac taylor / SciPy DOP853"
    if evaluator_name() != "heyoka":
        return {"name": name, "skipped": "the Taylor method needs heyoka"}
    from scipy.integrate import solve_ivp

    problem = dc.problems.load("triple-pendulum")
    flow = build_flow(problem.mechanism, ("wang",))
    kernel = rate_kernel(flow).compile()
    n = flow.x.shape[0]
    given, out = np.empty(kernel.n_in), np.empty(kernel.n_out)
    start = flow.start(problem.state, np.empty(0))
    times = np.arange(0.0, DURATION + EVERY / 2, EVERY)

    def rhs(t: float, x: Array) -> Array:
        given[0], given[1 : 1 + n] = t, x
        return kernel.single(given, out)

    def theirs() -> Any:
        return solve_ivp(rhs, (0.0, DURATION), start, "DOP853", times, rtol=TIGHTEST, atol=TIGHTEST)

    def ours() -> dc.Trajectory:
        return dc.simulate(
            problem.mechanism, problem.state, DURATION, EVERY, "taylor", testing=("wang",)
        )

    ledger, rival = dc.balance(problem.mechanism, ours()), theirs()
    error = ledger.relative("wang")
    assert error < WITHIN, f"deltac's ΔC is {error:.1e} of the energy turned over"
    apart = float(np.abs(rival.y[:3, -1] - ours().q[-1]).max())
    assert apart < 1e-9, f"deltac and SciPy end {apart:.1e} rad apart"
    measured = contest(ours, theirs, rounds).summary()
    return {
        "name": name,
        "target": TARGET,
        **measured,
        "our_error": error,
        "apart_rad": apart,
        "their_evaluations": int(rival.nfev),
    }


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"deltac's |ΔC| {found['our_error']:.0e} of the energy turned over; SciPy takes "
        f"{found['their_evaluations']} evaluations; they end {found['apart_rad']:.0e} rad apart"
    )
