"""What noise, digits and the ends of a log make of ΔC, and what may hide behind them.

The oracle is a cart-pole with hand-written equations, and noise whose size is known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from tests.support.slow import crossed, repeated
from tests.systems.cart_pole import CartPole, log

pytestmark = pytest.mark.case_study("test_the_bar_of_the_energy_covers_digits")

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()


def noisy(run: dc.Trajectory, seed: int, q: float, u: float) -> dc.Trajectory:
    rng = np.random.default_rng(seed)
    return replace(
        run,
        q=run.q + q * rng.standard_normal(run.q.shape),
        u=run.u + u * rng.standard_normal(run.u.shape),
    )


def bar_and_error(audit: dc.Audit) -> tuple[float, float]:
    """The error bar of ΔC and the largest |ΔC|, J."""
    return audit.error_bar[audit.function], float(np.abs(audit.energy_error).max())


def test_the_bar_of_the_energy_covers_noise() -> None:
    """ΔC of right equations stays within it in nine rows of ten; it is at most five times too wide."""
    run = log(RIGHT, "rk4", accelerations=False)
    shares, ratios = [], []
    for seed in range(4):
        audit = dc.audit(MECHANISM, noisy(run, seed, 1e-4, 1e-2), work="samples")
        size, bar = np.abs(audit.energy_error), audit.ledger.error_bar[audit.function]
        shares.append(float(np.mean(size <= bar)))
        ratios.append(float(np.sqrt(np.mean(size**2) / np.mean(bar**2))))
    assert np.mean(shares) >= 0.9
    assert np.median(ratios) > 0.1  # half of it where ΔC is as noisy as the bar says


def test_the_bar_of_the_energy_covers_digits() -> None:
    run = log(RIGHT, "rk4", accelerations=False)
    half = replace(
        run, q=run.q.astype(np.float16).astype(float), u=run.u.astype(np.float16).astype(float)
    )
    bar, left = bar_and_error(dc.audit(MECHANISM, half, work="samples"))
    assert left <= bar <= 10.0 * left
    whole, _ = bar_and_error(dc.audit(MECHANISM, run, work="samples"))
    assert whole < 1e-2 * bar


@pytest.mark.parametrize("seed", repeated(range(3), 0))
def test_right_equations_under_noise_are_not_accused(seed: int) -> None:
    found = dc.audit(MECHANISM, noisy(log(RIGHT, "rk4", accelerations=False), seed, 1e-4, 1e-2))
    assert found.verdict.kind in ("consistent", "unresolved")


@pytest.mark.parametrize(
    "scheme", repeated(["explicit-euler", "semi-implicit-euler", "heun"], "semi-implicit-euler")
)
@pytest.mark.parametrize(("damper", "noise"), crossed((0.0, 1e-3, 1e-2), (0.0, 1e-3)))
def test_no_mistake_does_more_than_what_may_be_hidden(
    scheme: str, noise: float, damper: float
) -> None:
    """The work of a damper that the model lacks, however the log was made, against the bound."""
    run = log(replace(RIGHT, hinge=RIGHT.hinge + damper), scheme, accelerations=False)
    run = noisy(run, 7, 0.1 * noise, noise)
    audit = dc.audit(MECHANISM, run.every(2))
    assert audit.inference is not None
    done = damper * float(np.sum(run.u[:-1, 1] ** 2 * np.diff(run.t)))
    assert (
        2.0 * max(audit.inference.unseen.values()) + sum(c.exchanged for c in audit.causes)
        >= 0.9 * done
    )


def test_speeds_that_are_differences_accuse_nobody() -> None:
    """Speeds made of the coordinates by `np.gradient`, whose first and last are of lower order."""
    run = log(RIGHT, "rk4", accelerations=False)
    run = replace(run, u=np.gradient(run.q, run.t, axis=0))
    audit = dc.audit(MECHANISM, run)
    assert audit.verdict.kind in ("consistent", "unresolved"), audit.verdict.explain()
    assert not [f for f in audit.findings if f.weight == "cause"]
    # A contact near the end is not the end's.
    u = run.u.copy()
    u[-40:-30, 1] += 0.5
    assert dc.audit(MECHANISM, replace(run, u=u)).verdict.kind != "consistent"


@pytest.mark.parametrize("scheme", repeated(("explicit-euler", "rk4"), "rk4"))
@pytest.mark.parametrize("noise", repeated((1e-3, 1e-2), 1e-2))
def test_a_missing_damper_is_seen_through_noise(scheme: str, noise: float) -> None:
    """It takes a tenth of the pole's energy; rows fit each other's noise, windows do not."""
    run = noisy(log(replace(RIGHT, hinge=0.0), scheme, accelerations=False), 3, 0.01 * noise, noise)
    found = dc.audit(MECHANISM, run)
    assert found.verdict.kind == "equation-error"
    [cause] = [f for f in found.findings if f.weight == "cause"]
    assert (cause.code, cause.element) == ("F-DAMPING", "hinge")
    assert cause.factor is not None and abs(cause.factor) < 0.2 * RIGHT.hinge


@pytest.mark.parametrize("seed", repeated(range(4), 0))
def test_noise_of_one_equation_is_not_that_of_another(seed: int) -> None:
    """Coefficients that noise of the hinge alone tells must not be taken off the slide's equation."""
    run = log(RIGHT, "rk4", accelerations=False)
    rng = np.random.default_rng(seed)
    u = run.u + np.array([1e-6, 1e-2]) * rng.standard_normal(run.u.shape)
    audit = dc.audit(MECHANISM, replace(run, u=u))
    assert not audit.causes and audit.verdict.kind != "equation-error"


@pytest.mark.parametrize("row", [15, -15])
def test_an_impact_near_an_end_is_seen(row: int) -> None:
    """The coordinates show it, too: the run goes on from there with another speed."""
    pendulum = dc.Mechanism(
        [dc.point_mass("bob", 1.0, at=(0, -0.3, 0))],
        [dc.revolute("a", "ground", "bob")],
        gravity=(0, -9.81, 0),
    )
    h, rows = 1e-3, row % 2001

    def part(q: float, u: float, duration: float) -> dc.Trajectory:
        start = pendulum.state({"a": q}, {"a": u})
        return dc.simulate(pendulum, start, duration=duration, step=h, solver="rk4")

    before = part(0.9, 1.0, rows * h)
    after = part(before.q[-1, 0], before.u[-1, 0] + 0.5, (2000 - rows) * h)
    run = dc.Trajectory(
        t=h * np.arange(2001, dtype=float),
        q=np.concatenate([before.q, after.q[1:]]),
        u=np.concatenate([before.u, after.u[1:]]),
        coordinates=("a",),
        speeds=("a",),
    )
    found = dc.audit(pendulum, noisy(run, 3, 1e-5, 1e-4))
    assert found.verdict.kind != "consistent"


def test_noise_on_a_motion_without_scheme_columns() -> None:
    """Constant accelerations leave an integrator nothing to differ in."""
    mechanism = dc.Mechanism(
        [dc.body(name, m, inertia=(0.1, 0.1, 0.1)) for name, m in {"a": 2.0, "b": 1.0}.items()],
        [dc.prismatic(f"x{name}", "ground", name, "x") for name in "ab"],
    )
    t = 2e-3 * np.arange(1001)[:, None]
    a, start = np.array([0.15, 0.3]), np.array([1.0, 2.0])
    run = dc.Trajectory(
        t=t[:, 0],  # type: ignore[arg-type]
        q=1.0 + start * t + 0.5 * a * t**2,
        u=start + a * t,
        coordinates=("xa", "xb"),
        speeds=("xa", "xb"),
        forces={"actuator m": np.full((len(t), 2), 0.3)},
    )
    found = dc.audit(mechanism, noisy(run, 1, 1e-4, 1e-2))
    assert found.verdict.kind in ("consistent", "unresolved")
