"""Logs of one damped pendulum by methods written out here; true joules are of exact flows, row by row.

What a hinge's integrator and a wrong inertia do to its rows is nearly the same: an integrator far from its
prior explains an inertia to rounding, and the likelihood must be one of rows that are exact to 1e-15.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter

import deltac as dc
from deltac.arrays import Array
from tests.support.slow import crossed

pytestmark = pytest.mark.case_study

MASS, ARM, CENTRAL, DAMPING, G = 1.3, 0.4, 0.05, 0.08, 9.81
HEAVIER = 1.2
"""Central moment of inertia of the model in that of the run."""


def mechanism(central: float) -> dc.Mechanism:
    return dc.Mechanism(
        [dc.body("rod", mass=MASS, inertia=(central, central, central), mass_centre=(0, 0, -ARM))],
        [dc.revolute("hinge", "ground", "rod", axis="y", damping=DAMPING)],
        gravity=(0, 0, -G),
    )


Rate = Callable[[Array, Array], Array]


def rate(central: float) -> Rate:
    inertia = central + MASS * ARM**2
    return lambda q, u: (-DAMPING * u - MASS * G * ARM * np.sin(q)) / inertia


def energy(q: Array, u: Array, central: float) -> Array:
    inertia = central + MASS * ARM**2
    return np.asarray(0.5 * inertia * u**2 - MASS * G * ARM * np.cos(q))


def rk4(f: Rate, q: Array, u: Array, h: float) -> tuple[Array, Array]:
    a, v = f(q, u), u + h / 2 * f(q, u)
    b = f(q + h / 2 * u, v)
    w = u + h / 2 * b
    c = f(q + h / 2 * v, w)
    x = u + h * c
    d = f(q + h * w, x)
    return q + h / 6 * (u + 2 * v + 2 * w + x), u + h / 6 * (a + 2 * b + 2 * c + d)


def semi_implicit_euler(f: Rate, q: Array, u: Array, h: float) -> tuple[Array, Array]:
    u = u + h * f(q, u)
    return q + h * u, u


def verlet(f: Rate, q: Array, u: Array, h: float) -> tuple[Array, Array]:
    a = f(q, u)
    q = q + h * u + 0.5 * h * h * a
    return q, u + 0.5 * h * (a + f(q, u + h * a))


def midpoint(f: Rate, q: Array, u: Array, h: float) -> tuple[Array, Array]:
    p, v = q + h * u, u + h * f(q, u)
    for _ in range(60):
        p, v = q + 0.5 * h * (u + v), u + h * f(0.5 * (q + p), 0.5 * (u + v))
    return p, v


Step = Callable[[Rate, Array, Array, float], tuple[Array, Array]]


def motion(step: Step, h: float, steps: int, central: float = CENTRAL) -> Array:
    x = np.empty((steps + 1, 2))
    x[0] = 1.2, 0.3
    for k in range(steps):
        x[k + 1] = step(rate(central), x[k, 0], x[k, 1], h)
    return x


def flow(x: Array, h: float, central: float) -> tuple[Array, Array]:
    """The exact flow of all rows over a step: sixteen steps of the classical method, 1e-15 of the state."""
    q, u = x[:, 0], x[:, 1]
    for _ in range(16):
        q, u = rk4(rate(central), q, u, h / 16)
    return q, u


def joules(x: Array, h: float, model: float) -> tuple[float, float]:
    """What the steps and the wrong inertia add to the balance of the model.

    Along the exact flow of the run the wrong inertia works what the energy changes by beyond the damper's
    work, by Boole's rule.
    """
    ahead = flow(x[:-1], h, CENTRAL)
    of_step = energy(x[1:, 0], x[1:, 1], model) - energy(*ahead, model)
    speeds = [x[:-1, 1], *(flow(x[:-1], c * h, CENTRAL)[1] for c in (0.25, 0.5, 0.75)), ahead[1]]
    squares = sum(w * u**2 for w, u in zip((7, 32, 12, 32, 7), speeds, strict=True)) / 90.0
    mistake = energy(*ahead, model) - energy(x[:-1, 0], x[:-1, 1], model) + DAMPING * h * squares
    return float(of_step.sum()), float(np.sum(mistake))


def log(x: Array, h: float, u: Array | None = None) -> dc.Trajectory:
    speeds = x[:, 1] if u is None else u
    return dc.Trajectory(
        t=h * np.arange(len(x), dtype=float),
        q=x[:, :1],
        u=speeds[:, None],
        coordinates=("hinge",),
        speeds=("hinge",),
    )


@pytest.mark.parametrize(
    ("step", "h"),
    [(rk4, 5e-3), (midpoint, 1e-2), pytest.param(verlet, 2e-3, marks=pytest.mark.slow)],
)
def test_an_inertia_is_told_from_an_integrator_that_does_the_same(step: Step, h: float) -> None:
    x = motion(step, h, round(5.0 / h))
    audit = dc.audit(mechanism(HEAVIER * CENTRAL), log(x, h))
    assert audit.verdict.kind == "equation-error" and audit.attribution is not None
    cause, *_ = audit.causes
    assert cause.kind in ("body-moments", "body-moment", "missing-rotor-inertia")
    assert cause.size == pytest.approx(1.0 / HEAVIER, rel=1e-6)
    for told, true in zip(
        (audit.attribution.integrator, audit.attribution.equations),
        joules(x, h, HEAVIER * CENTRAL),
        strict=True,
    ):
        assert abs(told.energy - true) < 2.0 * told.error + 1e-4 * abs(true)


def adams_bashforth(h: float, steps: int) -> Array:
    f, x = rate(CENTRAL), np.empty((steps + 1, 2))
    x[0] = 1.2, 0.3
    slope = np.array([[u, f(q, u)] for q, u in x[:1]])[0]
    for k in range(steps):
        q, u = x[k]
        before, slope = slope, np.array([u, f(q, u)])
        x[k + 1] = x[k] + h * (1.5 * slope - 0.5 * before)
    return x


def alpha_method(m: float, a: float) -> Callable[[float, int], Array]:
    """The implicit method of Chung and Hulbert with these α_m and α_f, γ and β of second order."""
    gamma = 0.5 - m + a
    beta = 0.25 * (gamma + 0.5) ** 2

    def motion(h: float, steps: int) -> Array:
        f, x = rate(CENTRAL), np.empty((steps + 1, 2))
        x[0] = 1.2, 0.3
        own = f(*x[0])
        for k in range(steps):
            (q, u), here = x[k], f(*x[k])
            new = own
            for _ in range(60):
                p = q + h * u + h * h * ((0.5 - beta) * own + beta * new)
                v = u + h * ((1.0 - gamma) * own + gamma * new)
                new = ((1.0 - a) * f(p, v) + a * here - m * own) / (1.0 - m)
            x[k + 1], own = (p, v), new
        return x

    return motion


RADIUS = 0.8
WITH_MEMORY = {
    "adams-bashforth-2": adams_bashforth,
    "generalized-alpha": alpha_method((2 * RADIUS - 1) / (RADIUS + 1), RADIUS / (RADIUS + 1)),
    "generalized-alpha of Hilber, Hughes and Taylor": alpha_method(0.0, 0.2),
}


@pytest.mark.parametrize("first", [0, 40])
@pytest.mark.parametrize("name", WITH_MEMORY)
def test_methods_with_a_memory_close_the_rows(name: str, first: int) -> None:
    """Also where the log begins in the middle of the run, so that its first row does not tell the memory."""
    h = 5e-3
    x = WITH_MEMORY[name](h, 600)[first:]
    audit = dc.audit(mechanism(CENTRAL), log(x, h))
    assert audit.verdict.kind in ("consistent", "integration-error") and not audit.causes
    assert audit.integrator is not None and audit.integrator.names == (name.split()[0],)
    assert audit.attribution is not None
    told, (true, _) = audit.attribution.integrator, joules(x, h, CENTRAL)
    # The first step of a log has no memory: one of some hundreds.
    assert abs(told.energy - true) < 2.0 * told.error + 0.01 * abs(true)
    assert told.error < 0.05 * abs(true)


@pytest.mark.parametrize("name", WITH_MEMORY)
def test_an_inertia_is_told_from_methods_with_a_memory(name: str) -> None:
    h = 5e-3
    x = WITH_MEMORY[name](h, 600)
    audit = dc.audit(mechanism(HEAVIER * CENTRAL), log(x, h))
    assert audit.verdict.kind == "equation-error" and audit.integrator is not None
    cause, *_ = audit.causes
    assert cause.size == pytest.approx(1.0 / HEAVIER, abs=3.0 * cause.size_error + 1e-4)
    assert audit.integrator.names == (name.split()[0],)


@pytest.mark.parametrize("step", [semi_implicit_euler, rk4])
def test_joules_reach_both_ends_of_a_long_log(step: Step) -> None:
    """Of more rows than are looked at: stretches from its first row to its last."""
    h = 5e-4
    x = motion(step, h, 12_000)
    audit = dc.audit(mechanism(CENTRAL), log(x, h))
    assert audit.inference is not None and audit.attribution is not None
    assert len(audit.inference.w) < 12_000
    times = audit.inference.log.intervals
    assert (times.start.t[0], times.end.t[-1]) == (0.0, pytest.approx(12_000 * h))
    told, (true, _) = audit.attribution.integrator, joules(x, h, CENTRAL)
    assert abs(told.energy - true) < 2.0 * told.error + 1e-3 * abs(true)


def test_backward_differences_are_of_the_coordinates_where_no_method_makes_them_so() -> None:
    """Speeds of the method of Euler that is half implicit are such differences; those of others are not."""
    h = 2e-3
    for step, name in ((semi_implicit_euler, "semi-implicit-euler"), (rk4, "rk4")):
        x = motion(step, h, 1000)
        backward = np.diff(x[:, 0]) / h
        audit = dc.audit(mechanism(CENTRAL), log(x[1:], h, backward))
        assert audit.verdict.kind != "equation-error"
        assert audit.integrator is not None and name in audit.integrator.names
        assert audit.attribution is not None
        true, _ = joules(x[1:], h, CENTRAL)
        told = audit.attribution.integrator
        assert abs(told.energy - true) < 2.0 * told.error + 1e-3 * abs(true)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_behind_a_filter_is_no_error_of_steps(seed: int) -> None:
    """Coordinates and speeds depart each on their own, as by adaptive steps, and add up to nothing."""
    h, rng = 2e-3, np.random.default_rng(seed)
    x = motion(rk4, h, 1500)
    noisy = x + [1e-3, 5e-3] * rng.standard_normal(x.shape)
    b, a = butter(2, 20.0 * 2.0 * h)
    smooth = filtfilt(b, a, noisy, axis=0)[20:-20]
    audit = dc.audit(mechanism(CENTRAL), log(smooth, h))
    assert audit.verdict.kind in ("consistent", "unresolved")


@pytest.mark.parametrize(("cut", "noise"), crossed((60.0, 30.0), (0.0, 1e-4)))
def test_a_driven_joint_may_follow_its_law_through_a_filter(cut: float, noise: float) -> None:
    h, rng = 2e-3, np.random.default_rng(4)
    model = dc.Mechanism(
        [dc.body("trolley", mass=2.0, inertia=(1.0, 1.0, 1.0)), dc.point_mass("load", 0.8)],
        [
            dc.prismatic("rail", "ground", "trolley", "x", motion="0.2*sin(3*t)"),
            dc.revolute("sway", "trolley", "load", "y", child_position=(0, 0, 0.7), damping=0.02),
        ],
        gravity=(0, 0, -G),
    )
    run = dc.simulate(model, model.state({"sway": 0.4}), 4.0, h, "ode4")
    b, a = butter(1, cut * 2.0 * h)
    q, u = (
        lfilter(b, a, x + noise * rng.standard_normal(x.shape) - x[0], axis=0) + x[0]
        for x in (run.q, run.u)
    )
    late = dc.Trajectory(t=run.t, q=q, u=u, coordinates=run.coordinates, speeds=run.speeds)
    audit = dc.audit(model, late)
    assert audit.verdict.kind != "equation-error"
    departs = [f for f in audit.findings if f.kind == "prescribed-departs"]
    # What went into the filter is judged if it is seen; else the law is followed through it.
    seen = any(f.kind == "filtered" for f in audit.findings)
    assert seen or departs
    assert all(f.weight == "note" for f in departs)


@pytest.mark.parametrize(("amplitude", "h"), crossed((0.315, 0.285), (2e-3, 1e-2)))
def test_another_amplitude_is_no_filter(amplitude: float, h: float) -> None:
    """A filter of unit gain smooths: none makes a law larger, and of a log none is wider than a few rows."""

    def driven(size: float) -> dc.Mechanism:
        return dc.Mechanism(
            [dc.body("slide", mass=1.0, inertia=(1.0, 1.0, 1.0)), dc.point_mass("bob", 0.8)],
            [
                dc.prismatic("drive", "ground", "slide", "x", motion=f"{size!r}*sin(4*t)"),
                dc.revolute("swing", "slide", "bob", "z", child_position=(0, 0.6, 0), damping=0.02),
            ],
            gravity=(0, -G, 0),
        )

    model = driven(amplitude)
    run = dc.simulate(model, model.state({"swing": 0.7}), 3.0, h, "ode4")
    rows = dc.Trajectory(t=run.t, q=run.q, u=run.u, coordinates=run.coordinates, speeds=run.speeds)
    audit = dc.audit(driven(0.3), rows)
    assert audit.verdict.kind == "equation-error"
    departs = [f for f in audit.findings if f.kind == "prescribed-departs"]
    assert departs and {f.weight for f in departs} == {"cause"}
