"""Several runs audited at once: each report is that of the run alone, to the last bit."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.audit.audit import audit_together
from deltac.errors import InputError
from deltac.kernels.rows import compiled_rows

PROBLEM = dc.problems.load("double-pendulum")


def log(solver: str, step: float = 0.005, duration: float = 0.6, **values: float) -> dc.Trajectory:
    """A motion as another program would log it."""
    mechanism = PROBLEM.mechanism.with_parameters(**values) if values else PROBLEM.mechanism
    run = dc.simulate(mechanism, PROBLEM.state, duration, step, solver)
    return replace(run, udot=None, integrals={}, works={}, provenance=dc.Provenance("another"))


def noisy(run: dc.Trajectory) -> dc.Trajectory:
    rng = np.random.default_rng(1)
    return replace(run, u=run.u + 1e-4 * rng.standard_normal(run.u.shape))


def rows(run: dc.Trajectory, keep: np.ndarray) -> dc.Trajectory:
    return replace(run, t=run.t[keep], q=run.q[keep], u=run.u[keep])


def kinds() -> dict[str, dc.Trajectory]:
    """Right, wrong, short, noisy, uneven and damaged logs of one model."""
    good = log("ode4")
    spiked = np.array(good.u)
    spiked[50] += 30.0
    pushed = np.zeros_like(good.u)
    pushed[:, 0] = np.sin(7.0 * good.t)
    return {
        "rk4": good,
        "semi-implicit": log("semi-implicit-euler"),
        "coarse": log("ode1", 0.02),
        "wrong mass": log("ode4", m1=1.3),
        "short": rows(good, np.arange(15)),
        "two rows": rows(good, np.arange(2)),
        "noisy": noisy(good),
        "five decimals": replace(good, q=good.q.round(5), u=good.u.round(5)),
        "singles": replace(good, q=good.q.astype("f4").astype(float)),
        "uneven": rows(good, np.flatnonzero(np.arange(len(good)) % 7)),
        "spike": replace(good, u=spiked),
        "degrees": replace(good, q=np.rad2deg(good.q)),
        "a force that did not act": replace(good, forces={"actuator j1": pushed}),
        "at rest": replace(good, q=0.0 * good.q, u=0.0 * good.u),
        "blown up": replace(good, u=good.u * 1e60),
        "of another model": replace(good, coordinates=("a", "b"), speeds=("a", "b")),
    }


@pytest.fixture(scope="module")
def logs() -> dict[str, dc.Trajectory]:
    return kinds()


def report(found: dc.Audit | InputError) -> str:
    """All numbers and words of an audit, some of which are found when they are asked for."""
    if isinstance(found, InputError):
        return f"{found.code} {found}"
    return json.dumps(found.to_dict(), default=str)


def told(judge: Callable[[], dc.Audit]) -> str:
    try:
        return report(judge())
    except InputError as error:
        return report(error)


FEW = ("rk4", "coarse", "wrong mass", "uneven", "two rows", "spike", "blown up", "of another model")
"""Logs of every verdict and of every kind of trouble."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("way", "names"),
    [
        pytest.param(nullcontext, None, marks=pytest.mark.slow, id="as it is"),
        pytest.param(compiled_rows, None, marks=pytest.mark.slow, id="compiled"),
        pytest.param(compiled_rows, FEW, id="some, compiled"),
    ],
)
def test_each_is_judged_as_alone(
    logs: dict[str, dc.Trajectory],
    way: Callable[[], AbstractContextManager[None]],
    names: Sequence[str] | None,
) -> None:
    logs = logs if names is None else {name: logs[name] for name in names}
    with way():
        alone = {name: told(partial(dc.audit, PROBLEM, run)) for name, run in logs.items()}
        made = dict(zip(logs, audit_together(PROBLEM, list(logs.values()))))
        together = {name: report(one) for name, one in made.items()}
    assert together == alone
    verdicts = {n: one.verdict.kind for n, one in made.items() if isinstance(one, dc.Audit)}
    assert verdicts["rk4"] == "consistent"
    assert verdicts["wrong mass"] == "equation-error"
    assert verdicts["coarse"] == "integration-error"
    assert logs.keys() - verdicts.keys() == {"blown up", "of another model"}
