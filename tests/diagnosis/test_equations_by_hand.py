"""Logs of equations that somebody wrote by hand and got wrong, or right, and what each mistake works.

A cart on a rail with a damper, and a pendulum that hangs from it; a mass on a spring. Nothing in the logs is
of deltac: motions are stepped here, works are quadratures of exact flows or closed forms.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, filtfilt

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.measurements.kinematics import coordinates_against_speeds

pytestmark = pytest.mark.case_study("test_a_zero_that_is_off_is_put_right[rail-0]")

CART, BOB, ARM, INERTIA, DAMPING, G = 2.0, 0.7, 0.6, 0.02, 0.4, 9.81
H, STEPS = 2e-3, 2000

MECHANISM = dc.Mechanism(
    bodies=[
        dc.body("cart", mass=CART, inertia=(0.1, 0.1, 0.1)),
        dc.body("bob", mass=BOB, inertia=(INERTIA,) * 3, mass_centre=(0, 0, -ARM)),
    ],
    joints=[
        dc.prismatic("rail", "ground", "cart", axis="x", damping=DAMPING),
        dc.revolute("hinge", "cart", "bob", axis="-y"),
    ],
    gravity=(0, 0, -G),
)


def rate(x: Array, of_speeds: float = 1.0, push: float = 0.0, inertia: float = INERTIA) -> Array:
    """ẋ with the term of θ̇² in the cart's equation times a factor, and an unknown push on the pendulum."""
    (_, q), (v, w) = x[:2], x[2:]
    M = np.array([[CART + BOB, BOB * ARM * np.cos(q)], [0.0, inertia + BOB * ARM**2]])
    M[1, 0] = M[0, 1]
    F = [
        of_speeds * BOB * ARM * np.sin(q) * w**2 - DAMPING * v,
        -BOB * G * ARM * np.sin(q) + push * np.sin(5.0 * q),
    ]
    return np.array([v, w, *np.linalg.solve(M, F)])


Step = Callable[[Array, float, float, float], Array]


def rk4(x: Array, h: float, of_speeds: float, push: float) -> Array:
    a = rate(x, of_speeds, push)
    b = rate(x + 0.5 * h * a, of_speeds, push)
    c = rate(x + 0.5 * h * b, of_speeds, push)
    return np.asarray(x + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + h * c, of_speeds, push)))


def euler(x: Array, h: float, of_speeds: float, push: float) -> Array:
    """Half implicit."""
    u = x[2:] + h * rate(x, of_speeds, push)[2:]
    return np.concatenate([x[:2] + h * u, u])


def motion(step: Step = rk4, of_speeds: float = 1.0, push: float = 0.0) -> Array:
    x = np.empty((STEPS + 1, 4))
    x[0] = 0.0, 1.9, 0.3, 0.0
    for k in range(STEPS):
        x[k + 1] = step(x[k], H, of_speeds, push)
    return x


def log(x: Array, h: float = H) -> dc.Trajectory:
    names = ("rail", "hinge")
    return dc.Trajectory(
        t=h * np.arange(len(x), dtype=float),
        q=x[:, :2],
        u=x[:, 2:],
        coordinates=names,
        speeds=names,
    )


def work(of_speeds: float, push: float) -> float:
    """What the mistake works along the exact motion, in which the log's differs by 1e-9."""

    def both(_: float, y: Array) -> Array:
        x = y[:4]
        force = (of_speeds - 1.0) * BOB * ARM * np.sin(x[1]) * x[3] ** 2, push * np.sin(5.0 * x[1])
        return np.append(rate(x, of_speeds, push), force @ x[2:])

    run = solve_ivp(
        both, (0.0, H * STEPS), [0.0, 1.9, 0.3, 0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-12
    )
    return float(run.y[4, -1])


def test_a_term_of_one_equation_that_is_missing_has_a_name() -> None:
    audit = dc.audit(MECHANISM, log(motion(of_speeds=0.0)))
    assert audit.verdict.kind == "equation-error" and audit.attribution is not None
    cause, *others = audit.causes
    # There is no such term in the other equation.
    names = [("velocity-terms", "all bodies"), ("velocity-term", "rail")]
    assert (cause.kind, cause.element) in names and not others
    assert cause.size == pytest.approx(0.0, abs=1e-8)
    told = audit.attribution.equations
    assert told.energy == pytest.approx(work(0.0, 0.0), rel=1e-6)
    assert cause.energy == pytest.approx(told.energy, rel=0.05)


@pytest.mark.parametrize("every", [1, 3])
def test_a_moment_of_inertia_that_was_forgotten_is_none(every: int) -> None:
    """The bob as a point: what the model's inertia would have taken is ½ I θ̇²."""
    x = np.empty((STEPS + 1, 4))
    x[0] = 0.0, 1.9, 0.3, 0.0
    for k in range(STEPS):
        slopes, at = [], x[k]
        for c in (0.5, 0.5, 1.0, 0.0):
            slopes.append(rate(at, inertia=0.0))
            at = x[k] + c * H * slopes[-1]
        x[k + 1] = x[k] + H / 6.0 * np.array([1.0, 2.0, 2.0, 1.0]) @ slopes
    rows = x[::every]
    audit = dc.audit(MECHANISM, log(rows, every * H))
    assert audit.verdict.kind == "equation-error" and audit.attribution is not None
    [cause] = audit.causes
    assert (cause.kind, cause.element) == ("body-moments", "bob")
    assert cause.size == pytest.approx(0.0, abs=1e-5)
    work = 0.5 * INERTIA * (rows[-1, 3] ** 2 - rows[0, 3] ** 2)
    assert audit.attribution.equations.energy == pytest.approx(work, rel=1e-5)


@pytest.mark.parametrize(("of_speeds", "push", "where"), [(0.7, 0.0, "rail"), (1.0, 0.15, "hinge")])
def test_a_force_without_a_name_is_of_the_equations(
    of_speeds: float, push: float, where: str
) -> None:
    """No cause is a push by sin 5θ, nor 0.7 of a term: rows depart by a force, not by an integrator."""
    audit = dc.audit(MECHANISM, log(motion(of_speeds=of_speeds, push=push)))
    assert audit.verdict.kind == "equation-error" and audit.attribution is not None
    first = audit.findings[0]
    assert (first.kind, first.element) == ("residual", where)
    true, told = work(of_speeds, push), audit.attribution
    # What the force does otherwise in a step than a constant one is of second order in it.
    assert told.equations.energy == pytest.approx(true, rel=1e-3)
    assert abs(told.equations.energy - true) < 3.0 * told.equations.error + 1e-4 * abs(true)
    assert abs(told.integrator.energy) < 3.0 * told.integrator.error + 1e-9


def sharp(x: Array) -> Array:
    return np.asarray(filtfilt(*butter(2, 60.0 * 2.0 * H), x, axis=0)[20:-20])


def averaged(x: Array) -> Array:
    return np.stack([np.convolve(c, np.ones(101) / 101.0, "valid") for c in x.T], axis=1)


def gaussian(x: Array) -> Array:
    return np.asarray(gaussian_filter1d(x, 30.0, axis=0)[150:-150])


@pytest.mark.parametrize(
    ("step", "through"), [(rk4, sharp), (euler, sharp), (rk4, averaged), (rk4, gaussian)]
)
def test_rows_behind_a_filter_depart_by_no_force(
    step: Step, through: Callable[[Array], Array]
) -> None:
    """A filter leaves a smooth force, too; what others leave of that tells, though none undoes this one."""
    audit = dc.audit(MECHANISM, log(through(motion(step))))
    assert audit.verdict.kind != "equation-error"
    assert "residual" not in [f.kind for f in audit.findings]


def test_a_mistake_works_what_it_does_along_coarse_rows() -> None:
    """A mass on a spring, five rows a period: ∫−Δk x ẋ dt = −Δk (x₁² − x₀²)/2, whatever the rows."""
    m, k, wrong = 1.5, 400.0, 430.0
    w = np.sqrt(k / m)
    h = 2.0 * np.pi / w / 5.0
    t = h * np.arange(300)
    x, v = 0.1 * np.cos(w * t + 0.4), -0.1 * w * np.sin(w * t + 0.4)
    model = dc.Mechanism(
        bodies=[dc.body("mass", mass=m, inertia=(1, 1, 1))],
        joints=[dc.prismatic("slide", "ground", "mass", axis="x", stiffness=wrong)],
        gravity=(0, 0, 0),
    )
    audit = dc.audit(model, {"time": t, "q.slide": x, "u.slide": v})
    assert audit.verdict.kind == "equation-error" and audit.attribution is not None
    assert audit.causes[0].kind in ("stiffness", "body-mass", "body-inertia")
    true = 0.5 * (wrong - k) * (x[-1] ** 2 - x[0] ** 2)
    told = audit.attribution.equations
    # By Simpson's rule within an interval of which the flow takes a few steps.
    assert told.energy == pytest.approx(true, abs=1e-3 * 0.5 * wrong * 0.01)
    assert abs(audit.attribution.log.energy) < 1e-3 * 0.5 * wrong * 0.01


def generalized_alpha(h: float, rho: float) -> Array:
    """Rows by Chung and Hulbert's method (J. Appl. Mech. 60, 1993), solved by fixed-point iteration."""
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma, beta = 0.5 - am + af, 0.25 * (1.0 - am + af) ** 2
    x = np.empty((801, 4))
    x[0] = 0.0, 1.9, 0.3, 0.0
    a = rate(x[0])[2:]
    before = a
    for k in range(len(x) - 1):
        (q, u), now = (x[k, :2], x[k, 2:]), before
        for _ in range(12):
            v = u + h * ((1.0 - gamma) * a + gamma * now)
            p = q + h * u + h**2 * ((0.5 - beta) * a + beta * now)
            at = (1.0 - af) * np.append(p, v) + af * x[k]
            now = (rate(at)[2:] - am * a) / (1.0 - am)
        x[k + 1], a = np.append(p, v), now
        before = now
    return x


@pytest.mark.parametrize("width", [3, 9])
def test_what_an_average_does_is_nobodys(width: int) -> None:
    """Rows of a method without a name, averaged: a filter undone in part accuses neither side."""
    x = generalized_alpha(0.01, 0.8)
    mean = np.stack([np.convolve(c, np.ones(width) / width, "valid") for c in x.T], axis=1)
    audit = dc.audit(MECHANISM, log(mean, 0.01))
    # By a tight method from each row, the integrator's own joules are at most 0.0012, 0.011 are allowed.
    assert audit.verdict.kind in ("consistent", "unresolved")


@pytest.mark.parametrize(("element", "place"), [("rail", 0), ("hinge", 1)])
def test_a_zero_that_is_off_is_put_right(element: str, place: int) -> None:
    """An encoder's zero accuses no equations, although a mass centre that is elsewhere does the same."""
    x = motion()
    off = 0.03 * (np.arange(4) == place)
    audit = dc.audit(MECHANISM, log(x + off))
    right = dc.audit(MECHANISM, log(x))
    assert audit.verdict.kind == "consistent" and not audit.causes
    if element == "hinge":  # nothing depends on where the cart is
        (zero,) = [f for f in audit.findings if f.kind == "zero-offset"]
        assert zero.element == element and zero.factor == pytest.approx(0.03, abs=1e-9)
    assert audit.attribution is not None and right.attribution is not None
    assert audit.attribution.integrator.energy == pytest.approx(
        right.attribution.integrator.energy, rel=1e-6
    )


def test_forces_held_from_row_to_row_are_no_gear() -> None:
    """A mass on a spring under a controller of 50 Hz: ∫u dt is the trapezoid's times (ωh/2)/tan(ωh/2).

    Speeds have kinks at the rows, which splines cut. In all rows that factor is the same, as a gear's is.
    """
    w, h, n = 9.0, 0.02, 300
    step = expm(h * np.array([[0.0, 1.0, 0.0], [-w * w, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    x, force = np.empty((n, 2)), np.empty(n)
    x[0] = 0.2, 0.0
    for k in range(n):
        force[k] = -8.0 * (x[k, 0] - 0.3 * np.sin(2.0 * h * k)) - 0.6 * x[k, 1]
        if k + 1 < n:
            x[k + 1] = (step @ [*x[k], force[k]])[:2]
    model = dc.Mechanism(
        bodies=[dc.body("mass", mass=1.0, inertia=(1, 1, 1))],
        joints=[dc.prismatic("slide", "ground", "mass", axis="x", stiffness=w * w)],
        gravity=(0, 0, 0),
    )
    run = dc.Trajectory(
        t=h * np.arange(float(n)), q=x[:, :1], u=x[:, 1:], coordinates=("slide",), speeds=("slide",),
        forces={"actuator motor": force[:, None]},
    )  # fmt: skip
    assert not coordinates_against_speeds(model, run)["slide"].scaled
    assert dc.audit(model, run).verdict.kind == "consistent"
