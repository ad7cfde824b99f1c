"""Logs of which several steps lie between two rows: forces that were held over each of them.

A pendulum with a motor and a damper, integrated by hand; its true joules are of the exact flow under the
torque that acted, by SciPy's DOP853 over every step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, filtfilt, lfilter, savgol_filter

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.causes.columns import LogEquations, column_kernels
from deltac.diagnosis.inference.comparison import compared
from deltac.diagnosis.inference.forces import LoggedForce
from deltac.diagnosis.inference.hypotheses import Block, nothing
from deltac.diagnosis.inference.inference import inferred
from deltac.diagnosis.inference.linearisation import start
from deltac.diagnosis.inference.model import Intervals, LogModel, Rows
from deltac.diagnosis.inference.observations import observations
from deltac.diagnosis.inference.regression import regression
from tests.support.slow import crossed, repeated

pytestmark = pytest.mark.case_study

H, LENGTH, DAMPING, G = 2e-3, 0.8, 0.2, 9.81
INERTIA = LENGTH**2

MECHANISM = dc.Mechanism(
    [dc.point_mass("bob", 1.0)],
    [dc.revolute("j", "ground", "bob", child_position=(0, LENGTH, 0), damping=DAMPING)],
    gravity=(0, -G, 0),
)


def acceleration(q: float, u: float, torque: float) -> float:
    return float((torque - DAMPING * u - G * LENGTH * np.sin(q)) / INERTIA)


def semi_implicit_euler(q: float, u: float, torque: float) -> tuple[float, float]:
    u += H * acceleration(q, u, torque)
    return q + H * u, u


def explicit_euler(q: float, u: float, torque: float) -> tuple[float, float]:
    return q + H * u, u + H * acceleration(q, u, torque)


def implicit_damping(q: float, u: float, torque: float) -> tuple[float, float]:
    u += H * acceleration(q, u, torque) / (1.0 + H * DAMPING / INERTIA)
    return q + H * u, u


def rk4(q: float, u: float, torque: float) -> tuple[float, float]:
    def rate(x: Array) -> Array:
        return np.array([x[1], acceleration(x[0], x[1], torque)])

    x = np.array([q, u])
    k1 = rate(x)
    k2 = rate(x + H / 2 * k1)
    k3 = rate(x + H / 2 * k2)
    x = x + H / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + H * k3))
    return float(x[0]), float(x[1])


Step = Callable[[float, float, float], tuple[float, float]]


def motion(step: Step, steps: int = 1000) -> tuple[Array, Array]:
    """States (N + 1, 2) and the torques (N + 1,) of a controller that is asked at every step."""
    rows, torques = [np.array([0.7, 0.0])], list[float]()
    for k in range(steps + 1):
        torques.append(5.0 * np.sin(9.0 * k * H) - 1.5 * float(rows[-1][1]))
        if k < steps:
            rows.append(np.array(step(float(rows[-1][0]), float(rows[-1][1]), torques[-1])))
    return np.array(rows), np.array(torques)


def true_joules(x: Array, torques: Array) -> Array:
    """What the steps add to the energy beyond the exact flow from each row (N + 1,), J."""

    def energy(x: Array) -> float:
        return float(0.5 * INERTIA * x[1] ** 2 - G * LENGTH * np.cos(x[0]))

    def flow(x: Array, torque: float, h: float) -> Array:
        def rate(_: float, y: Array) -> list[float]:
            return [y[1], acceleration(y[0], y[1], torque)]

        return np.asarray(solve_ivp(rate, (0.0, h), x, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1])

    ahead = [energy(b) - energy(flow(a, F, H)) for a, b, F in zip(x, x[1:], torques, strict=False)]
    back = [energy(flow(b, F, -H)) - energy(a) for a, b, F in zip(x, x[1:], torques, strict=False)]
    return np.concatenate([[0.0], np.cumsum(0.5 * (np.array(ahead) + np.array(back)))])


def log(x: Array, torques: Array, some: NDArray[np.intp], **provenance: Any) -> dc.Trajectory:
    return dc.Trajectory(
        t=H * some.astype(float), q=x[some, :1], u=x[some, 1:], coordinates=("j",), speeds=("j",),
        forces={"actuator motor": torques[some, None]},
        provenance=dc.Provenance("hand", **provenance),
    )  # fmt: skip


@pytest.mark.parametrize(("step", "parts"), crossed((semi_implicit_euler, rk4), (4, 5)))
def test_rows_of_every_few_steps_tell_how_often_their_forces_were_held(
    step: Step, parts: int
) -> None:
    x, torques = motion(step)
    audit = dc.audit(MECHANISM, log(x, torques, np.arange(0, 1001, parts)))
    assert audit.verdict.kind != "equation-error" and not audit.causes
    assert audit.inference is not None and audit.attribution is not None
    assert audit.inference.forces == ("step",)
    curve = true_joules(x, torques)[parts::parts]
    told = audit.inference.attribution.integrator.curve
    # Between rows the torque is that of a spline: its fourth derivative, (9 · 10 ms)⁴/384, and its ends.
    assert told == pytest.approx(curve, abs=0.01 * np.abs(curve).max() + 1e-8)


def implicit(residual: Callable[[Array, Array, float], Array]) -> Step:
    """The step by which a residual of the states at its ends vanishes, under a torque held over it."""

    def step(q: float, u: float, torque: float) -> tuple[float, float]:
        x = end = np.array([q, u])
        for _ in range(20):  # each is a hundred times nearer
            end = end - residual(x, end, torque)
        return float(end[0]), float(end[1])

    return step


def rate(x: Array, torque: float) -> Array:
    return np.array([x[1], acceleration(x[0], x[1], torque)])


trapezoidal = implicit(lambda x, y, F: y - x - 0.5 * H * (rate(x, F) + rate(y, F)))
midpoint = implicit(lambda x, y, F: y - x - H * rate(0.5 * (x + y), F))


@pytest.mark.parametrize("step", repeated((trapezoidal, midpoint), trapezoidal))
def test_implicit_methods_of_second_order_under_forces_that_are_held(step: Step) -> None:
    x, torques = motion(step, 400)
    audit = dc.audit(MECHANISM, log(x, torques, np.arange(401)))
    assert audit.integrator is not None and audit.attribution is not None
    assert audit.integrator.names == (
        "trapezoidal" if step is trapezoidal else "implicit-midpoint",
    )
    # Rounding of some joules, 1e-15, at each of 400 steps; methods of both ends miss by 2e-11.
    told = audit.attribution.integrator.curve
    assert told == pytest.approx(true_joules(x, torques), abs=1e-12)


def of_time(t: float) -> float:
    return float(5.0 * np.sin(9.0 * t))


def generalized_alpha(radius: float, h: float, steps: int) -> Array:
    """States (N + 1, 2) by Chung and Hulbert's method under a torque that is a function of time."""
    m, f = (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)
    gamma = 0.5 + f - m
    beta = 0.25 * (gamma + 0.5) ** 2
    q, u = 0.7, 0.0
    a = before = acceleration(q, u, of_time(0.0))
    rows = [(q, u)]
    for k in range(steps):
        own, behind, later = a, before, (q, u)
        for _ in range(30):  # each is a thousand times nearer
            later = (
                q + h * u + h * h * ((0.5 - beta) * a + beta * own),
                u + h * ((1.0 - gamma) * a + gamma * own),
            )
            behind = acceleration(*later, of_time((k + 1) * h))
            own = ((1.0 - f) * behind + f * before - m * a) / (1.0 - m)
        a, before, (q, u) = own, behind, later
        rows.append(later)
    return np.array(rows)


@pytest.mark.parametrize(("radius", "decimals"), [(0.6, 16), (0.9, 16), (0.6, 7), (0.9, 6)])
def test_a_method_that_takes_forces_at_rows_alone_leaves_them_functions_of_time(
    radius: float, decimals: int
) -> None:
    """Generalized-α has the torque of both ends of a step. What it was between, no row tells."""
    h, steps = 5e-3, 400
    x, t = generalized_alpha(radius, h, steps), h * np.arange(steps + 1.0)
    rounded, torques = np.round(x, decimals), np.round(5.0 * np.sin(9.0 * t), decimals)
    run = replace(
        log(rounded, torques, np.arange(steps + 1)), t=t, provenance=dc.Provenance("hand")
    )
    audit = dc.audit(MECHANISM, run)
    assert audit.integrator is not None and audit.integrator.names == ("generalized-alpha",)

    def energy(x: Array) -> float:
        return float(0.5 * INERTIA * x[1] ** 2 - G * LENGTH * np.cos(x[0]))

    def flow(x: Array, start: float, end: float) -> Array:
        def rate(t: float, y: Array) -> list[float]:
            return [y[1], acceleration(y[0], y[1], of_time(t))]

        return np.asarray(
            solve_ivp(rate, (start, end), x, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        )

    pairs = list(zip(x, x[1:], t, t[1:], strict=False))
    ahead = np.array([energy(b) - energy(flow(a, *ends)) for a, b, *ends in pairs])
    back = np.array([energy(flow(b, *ends[::-1])) - energy(a) for a, b, *ends in pairs])
    curve = np.concatenate([[0.0], np.cumsum(0.5 * (ahead + back))])
    assert audit.attribution is not None
    told = audit.attribution.integrator.curve
    # A cubic spline lacks (ω h)⁴/384 of the torque, 1e-8; straight lines lack (ω h)²/12, 1.7e-4 of 8 J.
    # Half of the last decimal of a row is so much energy:
    digits = 0.5 * 10.0**-decimals * (INERTIA * np.abs(x[:, 1]).max() + G * LENGTH)
    assert told == pytest.approx(curve, abs=1e-3 * float(np.abs(curve).max()) + digits)


def adams_bashforth(torques: Array) -> Array:
    """States (N + 1, 2) by the explicit method of two steps under the torques of the rows."""
    rows = [np.array([0.7, 0.0])]
    before = None
    for torque in torques[:-1]:
        now = rate(rows[-1], torque)
        rows.append(rows[-1] + H * (now if before is None else 1.5 * now - 0.5 * before))
        before = now
    return np.array(rows)


def test_torques_that_keep_their_values_over_several_rows_are_held_by_any_method() -> None:
    """A method of two steps makes the same rows of them whatever they do between: stairs are stairs."""
    torques = np.array([of_time(H * (k - k % 5)) for k in range(1001)])
    x = adams_bashforth(torques)
    audit = dc.audit(MECHANISM, log(x, torques, np.arange(1001)))
    assert audit.integrator is not None and audit.attribution is not None
    assert audit.integrator.names == ("adams-bashforth-2",)
    curve = true_joules(x, torques)
    # Of the first step, Euler's own, the method of two says nothing: half of h² a F' there.
    own, first = audit.attribution.integrator, abs(float(curve[1]))
    assert own.energy == pytest.approx(float(curve[-1]), abs=2.0 * (own.error + first))
    assert own.error < 0.01 * abs(float(curve[-1]))


def test_the_bar_covers_ramps_and_smooth_torques_that_heun_cannot_tell() -> None:
    """He asks for them at both ends of a step alone. What they are in between changes the exact motion."""
    h, steps = 5e-3, 400
    t, x = h * np.arange(steps + 1.0), [np.array([0.7, 0.0])]
    for k in range(steps):
        first = rate(x[-1], of_time(float(t[k])))
        last = rate(x[-1] + h * first, of_time(float(t[k + 1])))
        x.append(x[-1] + 0.5 * h * (first + last))
    states, torques = np.array(x), np.array([of_time(float(at)) for at in t])
    run = replace(log(states, torques, np.arange(steps + 1)), t=t)
    inference = dc.audit(MECHANISM, run).inference
    assert inference is not None and [m.name for m in inference.methods][:1] == ["heun"]
    own = inference.attribution.integrator
    # Torques of straight lines have means that are smaller by h² ω²/12, and do as much less work.
    less = (9.0 * h) ** 2 / 12.0 * float(np.abs(np.cumsum(h * torques * states[:, 1])).max())
    assert 0.1 * less < own.error < less


def stopped(h: float, every: int) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A block on a spring that strikes an elastic stop, by semi-implicit Euler; every so many rows."""
    mass, stiffness, drag, hard, gap = 2.0, 50.0, 1.0, 4000.0, 0.15
    mechanism = dc.Mechanism(
        [dc.point_mass("block", mass)],
        [dc.prismatic("slide", "ground", "block", "x", damping=drag)],
        forces=[
            dc.forces.joint_spring("spring", "slide", stiffness),
            dc.forces.joint_spring(
                "stop", "slide", potential=f"{hard} * max(q.slide - {gap}, 0)**2 / 2"
            ),
        ],
    )
    t = h * np.arange(12001.0)
    pull = 9.0 * np.sin(2.3 * t) + 4.0 * np.sin(5.1 * t)
    q, u, rows = 0.05, 0.0, [(0.05, 0.0)]
    for force in pull[:-1]:
        u += h * float(force - drag * u - stiffness * q - hard * max(q - gap, 0.0)) / mass
        q += h * u
        rows.append((q, u))
    x = np.array(rows)[::every]
    return mechanism, dc.Trajectory(
        t=t[::every], q=x[:, :1], u=x[:, 1:], coordinates=("slide",), speeds=("slide",),
        forces={"actuator pull": pull[::every, None]}, provenance=dc.Provenance("hand"),
    )  # fmt: skip


def test_kinks_of_a_stop_hide_no_method_of_several_steps_between_rows() -> None:
    audit = dc.audit(*stopped(5e-4, 4))
    assert audit.verdict.kind != "equation-error" and not audit.causes
    assert audit.integrator is not None and audit.integrator.names == ("semi-implicit-euler",)
    assert audit.integrator.step == pytest.approx(5e-4)


def of_other_rows(step: Step, late: int) -> tuple[dc.Trajectory, Array]:
    """A log in which each torque acts so many rows after its own, and the true joules at its rows."""
    x, torques = motion(step, 400)
    some = np.arange(5, 395)
    run = log(x, torques, some)
    joules = true_joules(x, torques)[some]
    return replace(run, forces={n: torques[some + late, None] for n in run.forces}), joules


@pytest.mark.parametrize(("step", "late"), crossed((rk4, semi_implicit_euler), (2, -2)))
def test_forces_that_act_rows_after_their_own_are_put_back(step: Step, late: int) -> None:
    run, joules = of_other_rows(step, late)
    audit = dc.audit(MECHANISM, run)
    assert audit.verdict.kind != "equation-error" and not audit.causes
    [told] = [f for f in audit.findings if f.kind == "late-forces"]
    assert told.factor == pytest.approx(late * H) and told.weight == "note"
    assert audit.attribution is not None
    curve = joules[max(late, 0) : len(joules) + min(late, 0)]
    share = audit.attribution.integrator.curve
    # Held or not is not seen in rows of semi-implicit Euler: the bar says so.
    bar = 2.0 * audit.attribution.integrator.curve_error + 1e-12
    assert np.all(np.abs(share - (curve - curve[0])) <= bar + 1e-3 * np.abs(curve - curve[0]).max())


def test_a_damper_beside_forces_of_other_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "DAMPING", 1.5 * DAMPING)
    run, _ = of_other_rows(rk4, 2)
    audit = dc.audit(MECHANISM, run)
    assert audit.verdict.kind == "equation-error"
    [cause] = audit.causes
    assert (cause.kind, cause.element) == ("damping", "j")
    assert cause.size == pytest.approx(DAMPING, rel=1e-6)


@pytest.mark.parametrize("step", repeated((semi_implicit_euler, rk4), rk4))
def test_rows_at_random_of_which_the_step_is_the_shortest_interval(step: Step) -> None:
    """Stairs of one to eight steps between two rows: the flow goes over each."""
    x, torques = motion(step)
    rng = np.random.default_rng(3)
    some = np.sort(rng.choice(1001, 500, replace=False))
    audit = dc.audit(MECHANISM, log(x, torques, some))
    assert not audit.causes and audit.attribution is not None
    curve = true_joules(x, torques)
    true, told = curve[some[-1]] - curve[some[0]], audit.attribution.integrator
    assert told.energy == pytest.approx(true, abs=0.01 * np.abs(curve).max() + 1e-11)
    assert abs(told.energy - true) < 2.0 * told.error
    # A method of order four sees what forces do within its steps; one of order one does not.
    assert (told.error < 1e-10) == (step is rk4)


def test_the_steps_to_what_imitates_gravity_end() -> None:
    """Lengths, turns and zeros do nearly the same; one linearised again and again went round for ever."""
    length, damping, step, g = 0.702, 0.05, 5e-3, 10.30682
    model = dc.Mechanism(
        [dc.point_mass("bob", 1.0)],
        [dc.revolute("j", "ground", "bob", child_position=(0, length, 0), damping=damping)],
        forces=[dc.forces.joint_torque("motor", "j")],
        gravity=(0, -G, 0),
    )
    x, torques = np.zeros((401, 2)), np.zeros((401, 1))
    q, u = -0.22446, 0.0
    for k in range(401):
        torque = 3.66998 * np.sin(3.90878 * k * step) - 0.4113 * u
        x[k], torques[k] = (q, u), torque
        force = torque - damping * u - g * length * np.sin(q)
        # The damper is that of the end of the step.
        u += step * force / length**2 / (1.0 + step * damping / length**2)
        q += step * u
    found = dc.audit(
        model,
        dc.Trajectory(
            t=step * np.arange(401, dtype=float), q=x[:, :1], u=x[:, 1:],
            coordinates=("j",), speeds=("j",), forces={"actuator motor": torques},
        ),
    )  # fmt: skip
    assert found.verdict.kind == "equation-error" and found.causes[0].kind == "gravity"
    assert found.causes[0].size == pytest.approx(g / G, rel=1e-6)


def test_a_stair_has_the_mean_of_its_line_half_a_step_later() -> None:
    """Of a straight line, held over each of n steps: at the begin of a step, and on average."""
    t = np.linspace(0.0, 1.0, 6)
    nothing = np.zeros((5, 0))
    rows = [Rows(x, nothing, nothing, 3.0 + 2.0 * x[:, None]) for x in (t[:-1], t[1:])]
    counts = np.full(5, 4)
    force = LoggedForce.of(Intervals(*rows), [(0, 5)], counts)(("step",))  # type: ignore[arg-type]
    first, change = 3.0 + 2.0 * t[:-1, None], 0.4
    for begin, s in ((0.0, 0.1), (0.25, 0.4), (0.75, 0.99)):
        assert force(s, begin) == pytest.approx(first + change * begin, abs=1e-12)
    stairs = np.mean([force(b + 0.1, b) for b in (0.0, 0.25, 0.5, 0.75)], axis=0)
    assert force(0.5) == pytest.approx(stairs, abs=1e-12)


def test_a_method_implicit_in_the_damper_is_no_inertia_behind_a_filter() -> None:
    """Its steps are those of an explicit one with the inertia h c more: beside that, none is missing."""
    x, torques = motion(implicit_damping)
    b, a = butter(2, 2.0 * 60.0 * H)
    smooth = filtfilt(b, a, x, axis=0)
    audit = dc.audit(MECHANISM, log(smooth, torques, np.arange(50, 951), step=H))
    assert audit.verdict.kind != "equation-error"
    assert not any("inertia" in c.kind or "moment" in c.kind for c in audit.causes)


def test_what_departs_between_rows_of_right_accelerations_is_of_the_steps() -> None:
    """A method of two steps, which is no map from row to row, of a log with accelerations."""
    steps, x, rates = 500, [np.array([0.7, 0.0])], list[Array]()
    h = 4e-3
    for _ in range(steps):
        q, u = x[-1]
        rates.append(np.array([u, acceleration(q, u, 0.0)]))
        last = rates[-2] if len(rates) > 1 else rates[-1]
        x.append(x[-1] + h * (1.5 * rates[-1] - 0.5 * last))
    y = np.array(x)
    udot = np.array([[acceleration(q, u, 0.0)] for q, u in y])
    run = dc.Trajectory(
        t=np.arange(steps + 1, dtype=float) * h, q=y[:, :1], u=y[:, 1:], udot=udot,
        coordinates=("j",), speeds=("j",), provenance=dc.Provenance("hand"),
    )  # fmt: skip
    audit = dc.audit(MECHANISM, run)
    assert audit.verdict.kind in ("consistent", "integration-error") and not audit.causes
    assert audit.attribution is not None
    # No force is logged: ΔC is all the steps', and the work of the damper a quadrature of the rows.
    balance = dc.balance(MECHANISM, run)
    assert audit.attribution.integrator.energy == pytest.approx(
        balance.delta_c["wang"][-1], rel=0.02
    )


def test_a_wrong_damper_of_an_oscillator_is_not_the_integrators() -> None:
    """In linear motion a field of first order does what a damper does; no known method does."""
    h, mass, stiffness, damping = 2e-3, 1.0, 40.0, 0.4
    A = np.array([[0.0, 1.0], [-stiffness / mass, -1.25 * damping / mass]])
    rows, B = [np.array([0.1, 0.0])], h * A
    step = np.eye(2) + B + B @ B / 2 + B @ B @ B / 6 + B @ B @ B @ B / 24  # the classical method
    for _ in range(1500):
        rows.append(step @ rows[-1])
    x = np.array(rows)
    x += 1e-5 * x.std(axis=0) * np.random.default_rng(0).standard_normal(x.shape)
    slider = dc.Mechanism(
        [dc.point_mass("block", mass)],
        [
            dc.prismatic(
                "s", "ground", "block", axis=(1, 0, 0), stiffness=stiffness, damping=damping
            )
        ],
    )
    run = dc.Trajectory(
        t=h * np.arange(len(x), dtype=float), q=x[:, :1], u=x[:, 1:], coordinates=("s",), speeds=("s",),
        provenance=dc.Provenance("hand"),
    )  # fmt: skip
    audit = dc.audit(slider, run)
    assert audit.verdict.kind == "equation-error"
    assert audit.causes[0].kind == "damping"
    assert audit.causes[0].size == pytest.approx(1.25 * damping, rel=1e-3)


def test_evidence_is_the_marginal_likelihood() -> None:
    """Of columns with a normal prior beside noise of unit variance: N(0, 1 + D P² Dᵀ), by its determinant."""
    rng = np.random.default_rng(2)
    N, p, none = 2000, 30, np.zeros(0, dtype=np.intp)
    D = rng.standard_normal((N, p)) * np.logspace(-3, 0, p)
    prior = np.full(p, 0.5)
    r = rng.standard_normal(N)
    plain = Block(r[:, None], np.zeros((N, 1, 0)), none, np.zeros(0), none)
    series = Block(r[:, None], D[:, None, :], np.arange(p), prior, none)
    told = series.evidence(nothing(0), 1.0) - plain.evidence(nothing(0), 1.0)
    scaled = D * prior
    S = np.eye(p) + scaled.T @ scaled
    explained = scaled.T @ r
    exact = 0.5 * explained @ np.linalg.solve(S, explained) - 0.5 * np.linalg.slogdet(S)[1]
    # The variance of the noise is estimated: that is a matter of p/N of the likelihood.
    assert told == pytest.approx(exact, abs=1.0)


def test_splines_of_two_orders_tell_what_a_spline_lacks_of_a_force() -> None:
    """Of a sine of 0.8 rad a row its mean over each interval is known: (cos ωt₀ − cos ωt₁)/ωh.

    A spline lacks (ωh)⁴/720 of it, and several times as much at the ends; the next order lacks (ωh)² of that.
    """
    h, omega = 0.1, 8.0
    t = h * np.arange(21.0)
    F = np.sin(omega * t)[:, None]
    none = np.zeros((20, 0))
    start, end = (Rows(s, none, none, x) for s, x in ((t[:-1], F[:-1]), (t[1:], F[1:])))
    force = LoggedForce.of(Intervals(start, end), [(0, 20)])
    course = force.first + 0.5 * force.change + (force.bends[0] - force.bends[1]) / 12.0
    true = -np.diff(np.cos(omega * t))[:, None] / (omega * h)
    lacking = true - course
    assert np.abs(lacking[[0, -1]]).max() > 5.0 * np.abs(lacking[4:-4]).max()
    assert force.gap == pytest.approx(lacking, abs=(omega * h) ** 2 * np.abs(lacking).max())
    assert np.all(np.abs(lacking) <= 2.0 * (force.doubt + force.ends))


def swinging(seed: int, told: float = 0.1) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A pendulum by Heun's method, logged at every 25th row; the torque turns by a radian between two.

    Its damper is of 0.1 N·m·s, the model's as `told`.
    """
    rng = np.random.default_rng(seed)
    size, omega, phase = rng.uniform(0.5, 3.0), rng.uniform(2.0, 9.0), rng.uniform(0.0, 6.0)
    x, length = np.array([rng.uniform(-1.0, 1.0), 0.0]), rng.uniform(0.5, 1.0)
    h, rows, torques = 5e-3, list[Array](), list[float]()

    def rate(x: Array, torque: float) -> Array:
        return np.array([x[1], (torque - 0.1 * x[1]) / length**2 - G / length * np.sin(x[0])])

    for k in range(401):
        torque = size * np.sin(omega * k * h + phase) - 0.4 * float(x[1])
        if k % 25 == 0:
            rows.append(x)
            torques.append(torque)
        first = rate(x, torque)
        x = x + 0.5 * h * (first + rate(x + h * first, torque))
    y = np.array(rows) + 1e-4 * rng.standard_normal((17, 2))
    run = dc.Trajectory(
        t=25 * h * np.arange(17.0), q=y[:, :1], u=y[:, 1:], coordinates=("j",), speeds=("j",),
        forces={"actuator motor": np.array(torques)[:, None]}, provenance=dc.Provenance("hand"),
    )  # fmt: skip
    hinge = dc.revolute("j", "ground", "bob", child_position=(0, length, 0), damping=told)
    return dc.Mechanism([dc.point_mass("bob", 1.0)], [hinge], gravity=(0, -G, 0)), run


@pytest.mark.parametrize("seed", repeated((39, 55, 63, 84, 90, 104, 118), 39, 63, 84))
def test_a_torque_that_swings_between_rows_accuses_nobody(seed: int) -> None:
    """No gear, spring or gravity is wrong."""
    assert dc.audit(*swinging(seed)).verdict.kind != "equation-error"


@pytest.mark.parametrize("seed", repeated((2, 6, 8, 14, 22), 2, 22))
def test_what_few_rows_cannot_tell_from_an_unknown_integrator_blames_none(seed: int) -> None:
    """Sixteen intervals tell no damper from the fields of an integrator, but its numbers are of no method."""
    audit = dc.audit(*swinging(seed, told=0.15))
    assert audit.verdict.kind in ("unresolved", "equation-error")


@pytest.mark.parametrize(("step", "scatter"), [(2e-3, 0.01), (1 / 240, 0.05)])
def test_stamps_that_scatter_about_an_even_clock(
    step: float, scatter: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows follow from each other to rounding by a step of 2 ms or 1/240 s, not by one that was averaged."""
    monkeypatch.setitem(globals(), "H", step)
    x, torques = motion(rk4)
    run = log(x, torques, np.arange(1001))
    rng = np.random.default_rng(1)
    audit = dc.audit(MECHANISM, replace(run, t=run.t + scatter * H * rng.uniform(-1.0, 1.0, 1001)))
    assert audit.integrator is not None and audit.attribution is not None
    assert audit.integrator.names == ("rk4",) and not audit.causes
    # Rounding of some joules at each of 1000 steps; the torque is of the rows' times, not of the clock's.
    assert audit.attribution.integrator.curve == pytest.approx(true_joules(x, torques), abs=1e-11)


@pytest.mark.parametrize("kind", ["start", "ramp"])
def test_a_method_with_held_torques_is_no_likelier_than_the_exact_motion(kind: str) -> None:
    """Rows interpolated some 0.04 ms off their times, which hide how torques act between them.

    Methods that hold a torque close the rows however it is said to act.
    """
    x, torques = motion(rk4)
    t = H * np.arange(1001)
    read = t + 0.02 * H * np.random.default_rng(1).standard_normal(1001)
    y = np.stack([np.interp(read, t, column) for column in x.T], axis=-1)
    run = log(y, torques, np.arange(1, 1000))
    model = LogModel(MECHANISM, run)
    rows = observations(model, run, len(run))
    assert rows is not None
    point = start(model, run, rows)
    acting = point.with_flow(forces=point.forces.alike(kind)).with_noise_of_rows()
    comparison = compared(acting.with_process_noise().with_columns())
    share, curve = inferred(comparison).attribution.integrator, true_joules(x, torques)
    assert comparison.maps
    assert abs(share.energy - (curve[999] - curve[1])) < 2.0 * share.error


def test_what_a_mistake_does_beside_torques_that_jump_from_step_to_step() -> None:
    """Of a rotor: the difference of one step of RK4 with and without it, by hand."""
    rng, small = np.random.default_rng(2), 1e-6
    x, torques = np.zeros((301, 2)), 20.0 * rng.standard_normal(301)
    x[0] = 0.7, 0.0
    moved = np.zeros((300, 2))
    for k in range(300):
        q, u = float(x[k, 0]), float(x[k, 1])
        x[k + 1] = rk4(q, u, float(torques[k]))
        moved[k] = rk4_of(INERTIA + small, q, u, float(torques[k])) - x[k + 1]
    run = log(x, torques, np.arange(301), held=("actuator motor",), step=H)
    model = LogModel(MECHANISM, run)
    rows = observations(model, run, len(run))
    assert rows is not None
    equations = LogEquations(MECHANISM, run)
    point = start(model, run, rows).with_candidates(equations, column_kernels(equations))
    point = point.with_columns()
    rotor = next(c for c in point.candidates if c.kind == "missing-rotor-inertia")
    own = next(of for of in point.flow.maps if of.method.name == "rk4")
    told = regression(point).moved_in(own)[:, :, list(rotor.columns)] @ rotor.linear[:, 0]
    # To first order in the rotor's share of the inertia, and Simpson's rule in h c/I = 6e-4.
    assert told * small == pytest.approx(moved, rel=1e-3, abs=1e-3 * np.abs(moved).max())


def rk4_of(inertia: float, q: float, u: float, torque: float) -> Array:
    """`rk4` of another inertia."""

    def rate(x: Array) -> Array:
        return np.array([x[1], acceleration(x[0], x[1], torque) * INERTIA / inertia])

    x = np.array([q, u])
    k1 = rate(x)
    k2 = rate(x + H / 2 * k1)
    k3 = rate(x + H / 2 * k2)
    return np.asarray(x + H / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + H * k3)))


@pytest.mark.parametrize("held", [None, ("actuator motor",), ()])
def test_a_balance_that_rests_on_held_torques_says_so(held: tuple[str, ...] | None) -> None:
    """Semi-implicit Euler asks for the torque once a step, whether that is held or a function of time."""
    h, n = 1e-3, 2000
    t = h * np.arange(n + 1, dtype=float)
    torques, x = 6.0 * np.sin(11.0 * t), np.zeros((n + 1, 2))
    x[0] = 0.7, 0.0
    joules = {"held": 0.0, "function": 0.0}

    def rate(s: float, y: Array, k: int, way: str) -> list[float]:
        torque = torques[k] if way == "held" else 6.0 * np.sin(11.0 * s)
        return [float(y[1]), acceleration(float(y[0]), float(y[1]), float(torque))]

    for k in range(n):
        u = x[k, 1] + h * acceleration(x[k, 0], x[k, 1], float(torques[k]))
        x[k + 1] = x[k, 0] + h * u, u
        for way in joules:
            end = solve_ivp(
                rate, (t[k], t[k + 1]), x[k], "DOP853", args=(k, way), rtol=1e-10, atol=1e-12
            )
            joules[way] += energy(x[k + 1]) - energy(end.y[:, -1])
    run = dc.Trajectory(
        t=t, q=x[:, :1], u=x[:, 1:], coordinates=("j",), speeds=("j",),
        forces={"actuator motor": torques[:, None]}, provenance=dc.Provenance("hand", held=held),
    )  # fmt: skip
    audit = dc.audit(MECHANISM, run)
    assert audit.attribution is not None
    share = audit.attribution.integrator
    true = joules["function" if held == () else "held"]
    assert share.energy == pytest.approx(true, abs=2.0 * share.error)
    kinds = [f.kind for f in audit.verdict.findings]
    assert ("held-forces" in kinds) == (held is None)
    if held is None:  # the bar covers the other way
        assert abs(joules["function"] - share.energy) < 2.0 * share.error
        assert (audit.verdict.kind, audit.verdict.confidence) == ("consistent", "medium")
    else:
        kind = "consistent" if held else "integration-error"
        assert (audit.verdict.kind, audit.verdict.confidence) == (kind, "high")
        assert share.error < 0.01 * abs(joules["function"])


def energy(x: Array, g: float = G) -> float:
    """Of the pendulum, J."""
    return float(0.5 * INERTIA * x[1] ** 2 - g * LENGTH * np.cos(x[0]))


def position_verlet(x: Array, h: float) -> Array:
    q = x[0] + 0.5 * h * x[1]
    u = x[1] + h * acceleration(q, 0.0, 0.0)
    return np.array([q + 0.5 * h * u, u])


def test_speeds_that_a_log_lacks_are_those_of_the_one_method_that_makes_its_rows() -> None:
    """ΔC of a log of coordinates alone is that of the states which the method had."""
    h, x = 8e-3, np.zeros((601, 2))
    x[0] = 1.2, 0.4
    for k in range(600):
        x[k + 1] = position_verlet(x[k], h)
    model = replace(MECHANISM, joints=[replace(MECHANISM.joints[0], damping=(0.0,))])
    audit = dc.audit(model, {"time": h * np.arange(601), "q.j": x[:, 0]})
    assert audit.integrator is not None and audit.integrator.names == ("position-verlet",)
    true = np.array([energy(y) - energy(x[0]) for y in x])
    # Rounding of angles of 1 rad over steps of 8 ms, at 7 N·m.
    assert audit.ledger.delta_c["wang"] == pytest.approx(true, abs=1e-9)
    assert audit.attribution is not None
    assert audit.attribution.integrator.energy == pytest.approx(true[-1], abs=1e-9)
    assert audit.ledger.error_bar["wang"].max() < 1e-6


@pytest.mark.parametrize("damping", [0.0, DAMPING])
def test_central_differences_may_be_the_speeds_of_the_method(damping: float) -> None:
    """Velocity Verlet of one acceleration a step, with the damper at the speed of half a step before."""
    h, n = 8e-3, 300

    def rate(_: float, y: Array) -> Array:
        return np.array([y[1], acceleration(y[0], y[1], (DAMPING - damping) * y[1])])

    x = np.zeros((n + 1, 2))
    x[0] = 1.2, 0.0
    kick = 0.5 * h * rate(0.0, x[0])[1]
    for k in range(n):
        middle = x[k, 1] + kick
        q = x[k, 0] + h * middle
        kick = 0.5 * h * rate(0.0, np.array([q, middle]))[1]
        x[k + 1] = q, middle + kick
    assert np.abs(x[:, 1] - np.gradient(x[:, 0], h))[1:-1].max() < 1e-12
    model = replace(MECHANISM, joints=[replace(MECHANISM.joints[0], damping=(damping,))])
    audit = dc.audit(model, {"time": h * np.arange(n + 1), "q.j": x[:, 0], "u.j": x[:, 1]})
    assert audit.integrator is not None and "leapfrog" in audit.integrator.names
    exact = [solve_ivp(rate, (0.0, h), y, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1] for y in x]
    true = [energy(after) - energy(y) for after, y in zip(x[1:], exact[:-1], strict=True)]
    assert audit.verdict.kind == "consistent" and audit.attribution is not None
    # The first step has the damper at its own speed. What that takes of a defect is of the order of the step.
    curve, order = audit.attribution.integrator.curve, h * damping / INERTIA
    assert curve[-1] - curve[1] == pytest.approx(sum(true[1:]), rel=1e-4 + 2.0 * order)


@pytest.mark.slow
def test_of_two_methods_that_make_the_same_coordinates_neither_has_all_joules() -> None:
    """Semi-implicit Euler, and its adjoint by the speeds of the rows before, beside a wrong weight."""
    h, n = 8e-3, 1200
    x = np.zeros((n + 1, 2))
    x[0] = 1.2, 0.4
    for k in range(n):
        u = x[k, 1] + h * acceleration(x[k, 0], x[k, 1], 0.0)
        x[k + 1] = x[k, 0] + h * u, u
    wrong = replace(MECHANISM, gravity=(0, -1.5 * G, 0))
    audit = dc.audit(wrong, {"time": h * np.arange(n + 1), "q.j": x[:, 0]})
    assert [c.kind for c in audit.causes] == ["gravity"] and audit.attribution is not None
    share = audit.attribution.integrator
    # Joules are those of the model's energy; by the adjoint, speeds are those of the next rows.
    for rows in (x[:-1], np.column_stack([x[:-1, 0], x[1:, 1]])):
        joules = 0.0
        for y, after in zip(rows[:-1], rows[1:], strict=True):
            end = solve_ivp(
                lambda _, y: [y[1], acceleration(y[0], y[1], 0.0)],
                (0.0, h), y, "DOP853", rtol=1e-9, atol=1e-12,
            )  # fmt: skip
            joules += energy(after, 1.5 * G) - energy(end.y[:, -1], 1.5 * G)
        assert abs(share.energy - joules) < 2.0 * share.error


def implicit_euler(tolerance: float) -> Step:
    """By iterations of the whole state that stop at a change of the speed of so much."""

    def step(q: float, u: float, torque: float) -> tuple[float, float]:
        p, v, change = q, u, np.inf
        while abs(change) > tolerance:
            before = v
            p, v = q + H * v, u + H * acceleration(p, v, torque)
            change = v - before
        return p, v

    return step


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_what_the_solver_of_an_implicit_step_leaves_is_of_the_step(tolerance: float) -> None:
    x, torques = motion(implicit_euler(tolerance))
    audit = dc.audit(MECHANISM, log(x, torques, np.arange(1001)))
    assert audit.verdict.kind == "integration-error"
    assert audit.integrator is not None and audit.integrator.names == ("implicit-euler",)
    share, true = audit.attribution.integrator, true_joules(x, torques)  # type: ignore[union-attr]
    # The speed is off by the tolerance in each of 1000 steps; power is of the order of 1 W/(m/s).
    assert share.energy == pytest.approx(true[-1], abs=1e3 * tolerance + 1e-6)


def driven(every: int, damping: float = DAMPING) -> dc.Trajectory:
    """Some rows of RK4 at 10 ms under a stiff law, of which the log has the torques at its rows alone."""
    h = 1e-2

    def torque(t: float, x: Array) -> float:
        swing = 8.0 * np.sin(30.0 * t) * np.cos(x[0])
        return float(swing - 3.0 * x[1] + 40.0 * (np.sin(3.0 * t) - x[0]))

    def rate(t: float, x: Array) -> Array:
        own = DAMPING * x[1] - damping * x[1]
        return np.array([x[1], acceleration(x[0], x[1], torque(t, x)) + own / INERTIA])

    rows = [np.array([0.7, 0.0])]
    for k in range(2000):
        t, x = k * h, rows[-1]
        k1 = rate(t, x)
        k2 = rate(t + h / 2, x + h / 2 * k1)
        k3 = rate(t + h / 2, x + h / 2 * k2)
        rows.append(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, x + h * k3)))
    some = np.arange(0, 2001, every)
    torques = np.array([torque(k * h, x) for k, x in enumerate(rows)])
    run = log(np.array(rows), torques, some)
    return replace(run, t=h * some.astype(float))


@pytest.mark.parametrize("every", [1, 2, 4])
def test_torques_that_rows_hardly_show_are_no_mistake(every: int) -> None:
    """Splines through torques of 20 and 40 ms are off by what a rotor's inertia or a delay would explain."""
    assert dc.audit(MECHANISM, driven(every)).verdict.kind in ("consistent", "unresolved")


def test_a_damper_beside_such_torques_is_found() -> None:
    audit = dc.audit(MECHANISM, driven(1, damping=1.05 * DAMPING))
    assert audit.verdict.kind == "equation-error" and audit.causes[0].kind == "damping"
    assert audit.causes[0].values[0] == pytest.approx(1.05 * DAMPING, rel=1e-2)


def mean(x: Array, rows: int) -> Array:
    return np.asarray(uniform_filter1d(x, rows, axis=0))


def polynomial(x: Array, rows: int) -> Array:
    return np.asarray(savgol_filter(x, rows, 2, axis=0))


def late_mean(x: Array, rows: int) -> Array:
    return np.asarray(lfilter(np.ones(rows) / rows, [1.0], x - x[0], axis=0) + x[0])


@pytest.mark.parametrize(
    ("through", "rows", "every", "noise"),
    [
        (mean, 5, 1, 1e-4),
        (polynomial, 9, 1, 0.0),
        (mean, 5, 4, 1e-4),
        (mean, 9, 4, 1e-4),
        (late_mean, 21, 4, 1e-4),
    ],
)
def test_filters_of_states_beside_held_torques_accuse_nobody(
    through: Callable[[Array, int], Array], rows: int, every: int, noise: float
) -> None:
    """The torques went through no filter, and noise did: integrators and causes do about the same."""
    x, torques = motion(rk4, 4000)
    some = np.arange(0, 4001, every)
    read = x[some] + noise * np.random.default_rng(0).standard_normal((len(some), 2))
    y = through(read, rows)
    run = replace(log(x, torques, some), q=y[:, :1], u=y[:, 1:])
    assert dc.audit(MECHANISM, run).verdict.kind in ("consistent", "unresolved")


# Two links that turn about vertical axes and a slide on a stiff spring, all with dry friction and dampers.
MASSES, INERTIAS, ARM, CENTRES = (6.0, 6.0, 1.9), (0.1, 0.07), 0.35, (0.15, 0.16)
STIFFNESS, DAMPERS = 1500.0, np.array([0.6, 0.4, 25.0])
FRICTION, WIDTHS = np.array([0.5, 0.3, 4.0]), np.array([0.05, 0.05, 0.02])


def machine() -> dc.Mechanism:
    (m1, m2, m3), (J1, J2), (c1, c2) = MASSES, INERTIAS, CENTRES
    names, (d1, d2, d3) = ("j1", "j2", "j3"), DAMPERS
    friction = zip(names, FRICTION, WIDTHS, strict=True)
    return dc.Mechanism(
        [
            dc.body("inner", m1, inertia=(J1, J1, J1), mass_centre=(c1, 0, 0)),
            dc.body("outer", m2, inertia=(J2, J2, J2), mass_centre=(c2, 0, 0)),
            dc.point_mass("quill", m3),
        ],
        [
            dc.revolute("j1", "ground", "inner", "z", damping=d1),
            dc.revolute("j2", "inner", "outer", "z", position=(ARM, 0, 0), damping=d2),
            dc.prismatic("j3", "ground", "quill", "x", stiffness=STIFFNESS, damping=d3),
        ],
        forces=[
            *(dc.forces.joint_torque(f"motor {name}", name) for name in names),
            *(dc.forces.joint_friction(f"dry {j}", j, mu, width=w) for j, mu, w in friction),
        ],
        gravity=(0, 0, 0),
    )


def inertia(angle: float, rotor: float) -> tuple[float, float, float]:
    """Elements 11, 12, 22 of the two links' mass matrix, from their kinetic energy."""
    (m1, m2, _), (J1, J2), (c1, c2) = MASSES, INERTIAS, CENTRES
    couple, far = m2 * ARM * c2 * np.cos(angle), J2 + m2 * c2**2
    return J1 + m1 * c1**2 + m2 * ARM**2 + far + 2.0 * couple, far + couple, far + rotor


def machine_rate(y: Array, torque: Array, rotor: float) -> Array:
    """Of three coordinates and speeds, by Lagrange's equations."""
    q, u = y[:3], y[3:]
    a, b, d = inertia(q[1], rotor)
    f = torque - DAMPERS * u - FRICTION * np.tanh(u / WIDTHS)
    turning = MASSES[1] * ARM * CENTRES[1] * np.sin(q[1])
    f = f + [turning * (2.0 * u[0] + u[1]) * u[1], -turning * u[0] ** 2, -STIFFNESS * q[2]]
    det = a * d - b * b
    slide = f[2] / MASSES[2]
    return np.array([*u, (d * f[0] - b * f[1]) / det, (a * f[1] - b * f[0]) / det, slide])


def test_nobody_is_asked_for_forces_more_often_than_once_a_step() -> None:
    """Kutta's method of third order under torques held over its steps, beside a rotor that is missing.

    One step from row to row does not show what forces do if they change half way.
    """
    h, n, rotor = 2e-3, 1000, 0.2
    gains, rates, phases = np.array([80.0, 40.0, 3e3]), np.array([10.0, 5.0, 60.0]), np.arange(3)
    y, torques, joules = np.zeros((n + 1, 6)), np.zeros((n + 1, 3)), 0.0
    y[0, :3] = 0.1, 0.9, 0.02

    def energy(y: Array) -> float:
        a, b, d = inertia(y[1], 0.0)
        v, w, speed = y[3:]
        links = 0.5 * a * v**2 + b * v * w + 0.5 * d * w**2
        return float(links + 0.5 * MASSES[2] * speed**2 + 0.5 * STIFFNESS * y[2] ** 2)

    for k in range(n + 1):
        x, target = y[k], 0.5 * np.sin(3.0 * k * h + phases)
        torques[k] = torque = gains * (target - x[:3]) - rates * x[3:]
        if k < n:
            first = machine_rate(x, torque, rotor)
            middle = machine_rate(x + 0.5 * h * first, torque, rotor)
            last = machine_rate(x + h * (2.0 * middle - first), torque, rotor)
            y[k + 1] = x + h / 6.0 * (first + 4.0 * middle + last)
            exact = solve_ivp(
                lambda t, x, torque=torque: machine_rate(x, torque, rotor),
                (0.0, h), x, "DOP853", rtol=1e-10, atol=1e-13,
            )  # fmt: skip
            joules += energy(y[k + 1]) - energy(exact.y[:, -1])
    log = {"time": h * np.arange(n + 1)}
    for k, name in enumerate(("j1", "j2", "j3")):
        log |= {f"q.{name}": y[:, k], f"u.{name}": y[:, 3 + k]}
        log[f"force.actuator motor {name}.{name}"] = torques[:, k]
    found = dc.audit(machine(), log)
    assert [(c.kind, c.element) for c in found.causes] == [("missing-rotor-inertia", "j2")]
    assert found.attribution is not None and found.integrator is not None
    assert found.integrator.names == ("kutta-3",)
    told = found.attribution.integrator
    assert told.energy == pytest.approx(joules, abs=2.0 * told.error)
    assert told.error < 1e-3


def policy(steps: int, seed: int) -> tuple[Array, Array]:
    """States (N, 2) and random torques (N,), a new one at each step."""
    rng, rows, torques = np.random.default_rng(seed), [np.array([0.7, 0.0])], list[float]()
    for _ in range(steps):
        torques.append(float(rng.uniform(-6.0, 6.0)))
        rows.append(np.array(rk4(float(rows[-1][0]), float(rows[-1][1]), torques[-1])))
    return np.array(rows[:-1]), np.array(torques)


@pytest.mark.parametrize("every", [5, 10])
def test_torques_of_which_most_were_not_logged_accuse_nobody(every: int) -> None:
    """A new random torque at each step: those between the rows are not told by those of the rows."""
    x, torques = policy(steps=400 * every, seed=2)
    audit = dc.audit(MECHANISM, log(x, torques, np.arange(0, 400 * every, every)))
    assert audit.verdict.kind == "unresolved"


def asked_seldom(step: Step, times: int) -> tuple[Array, Array]:
    """States (N, 2) and torques (N,) of a controller that is asked in every so many steps."""
    rows, torques, torque = [np.array([0.7, 0.0])], list[float](), 0.0
    for k in range(1800):
        if k % times == 0:
            torque = 5.0 * np.sin(9.0 * k * H) - 1.5 * float(rows[-1][1])
        torques.append(torque)
        rows.append(np.array(step(float(rows[-1][0]), float(rows[-1][1]), torque)))
    return np.array(rows[:-1]), np.array(torques)


@pytest.mark.parametrize(("times", "every"), [(7, 3), (5, 2), (9, 4)])
@pytest.mark.parametrize("step", [rk4, semi_implicit_euler])
def test_torques_that_change_at_steps_between_the_rows(step: Step, times: int, every: int) -> None:
    """No row tells when they changed."""
    x, acted = asked_seldom(step, times)
    audit = dc.audit(MECHANISM, log(x, acted, np.arange(0, len(x), every)))
    assert not audit.causes and audit.attribution is not None
    joules, share = true_joules(x, acted), audit.attribution.integrator
    assert share.energy == pytest.approx(joules[-1], abs=2.0 * share.error + 1e-9)
    assert share.error < 0.1 * np.abs(joules).max() + 1e-9
    small = np.abs(joules).max() < audit.tolerance * audit.reference_energy
    assert audit.verdict.kind == ("consistent" if small else "integration-error")


def test_no_balance_of_gaps_contradicts_torques_that_change_between_the_rows() -> None:
    x, acted = asked_seldom(rk4, 7)
    rows = np.arange(0, len(x), 3)
    audit = dc.audit(MECHANISM, log(x, acted, np.delete(rows, np.arange(300, 310))))
    assert audit.verdict.kind == "consistent" and audit.attribution is not None
    assert audit.attribution.integrator.error < 0.1 * audit.tolerance * audit.reference_energy


@pytest.mark.parametrize(
    ("step", "late"), [(explicit_euler, 2), (semi_implicit_euler, 2), (rk4, -1)]
)
def test_torques_held_over_rows_that_are_logged_rows_late(step: Step, late: int) -> None:
    """A stair of another row looks like one that changes between two; only the right one closes."""
    x, acted = asked_seldom(step, 5)
    logged = np.roll(acted, late)
    some = np.arange(abs(late), len(x) - abs(late))
    audit = dc.audit(MECHANISM, log(x, logged, some))
    assert audit.verdict.kind != "equation-error" and not audit.causes
    (told,) = (f for f in audit.findings if f.kind == "late-forces")
    assert told.factor == pytest.approx(-late * H)
    assert audit.integrator is not None and audit.attribution is not None
    assert audit.integrator.names[0].replace("-", "_") == step.__name__
    first, last = np.round(audit.run.t[[0, -1]] / H).astype(int)
    joules, share = true_joules(x, acted), audit.attribution.integrator
    # The works of a stair are those of its steps: nothing is interpolated.
    assert share.energy == pytest.approx(joules[last] - joules[first], rel=1e-3, abs=1e-9)
