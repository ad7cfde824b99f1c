"""Impacts: exact results, momentum through mechanisms and loops, and every joule booked."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deltac as dc
from deltac import shapes
from deltac.simulation.events.impact import ContactInertia, TouchingContact, resolve
from deltac.simulation.events.stronge import collide
from tests.support.slow import repeated

G = 9.81
Array = np.ndarray


def ball(restitution: Any = 0.8, **options: Any) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.point_mass("ball", 1.0)],
        joints=[dc.prismatic("height", "ground", "ball", axis="z")],
        gravity=(0.0, 0.0, -G),
        events=[
            dc.events.joint_stop("floor", "height", lower=0.0, restitution=restitution, **options),
            dc.events.event("apex", "u.height", direction="falling"),
        ],
    )


def quiet(*arguments: Any, **options: Any) -> dc.Trajectory:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.SimulationStoppedWarning)
        return dc.simulate(*arguments, **options)


def assert_closes(mechanism: dc.Mechanism, run: dc.Trajectory, error: float) -> None:
    """Every testing function, in the loop and on samples; and a verdict to match."""
    for work in ("in-loop", "samples"):
        ledger = dc.balance(mechanism, run, work=work)
        for name, delta_c in ledger.delta_c.items():
            allowed = error * ledger.energy_exchanged + ledger.error_bar[name]
            assert (np.abs(delta_c) <= allowed).all(), (work, name, np.abs(delta_c).max())
        assert dc.audit(mechanism, run, work=work).verdict.kind == "consistent"


@pytest.mark.parametrize(
    ("e", "solver", "options"),
    [
        (0.5, "ode4", {"step": 0.01}),
        (0.8, "ode8", {"step": 0.02}),
        (0.8, dc.solvers.Scipy("DOP853", 1e-11), {}),
        (1.0, "ode2", {"step": 0.01}),
    ],
)
def test_bounces_are_exact(e: float, solver: Any, options: dict[str, Any]) -> None:
    """h_k = e^(2k) h0; each impact takes 1 − e². Flights are of degree two in t: only rounding is left."""
    mechanism = ball(e)
    run = quiet(mechanism, mechanism.state({"height": 1.0}), 2.0, solver=solver, **options)
    hits = [event for event in run.events if "impact floor" in event.names]
    tops = [event for event in run.events if "event apex" in event.names]
    fall = math.sqrt(2 / G)
    t = fall
    for k, hit in enumerate(hits[:15]):
        assert hit.t == pytest.approx(t, abs=1e-12)
        assert hit.energy_lost == pytest.approx((1 - e**2) * G * e ** (2 * k), abs=1e-12)
        t += 2 * fall * e ** (k + 1)
    for k, top in enumerate(tops[:14]):
        assert top.q[0] == pytest.approx(e ** (2 * k + 2), abs=1e-12)
    ledger = dc.balance(mechanism, run)
    lost = sum(hit.energy_lost for hit in hits)
    assert ledger.work["impact floor"][-1] == pytest.approx(-lost, abs=1e-13)
    assert_closes(mechanism, run, 1e-13)


def test_accumulating_impacts_end_with_words_and_the_time() -> None:
    mechanism, e = ball(0.6), 0.6
    with pytest.warns(dc.SimulationStoppedWarning, match="'impact floor'.*Zeno"):
        run = dc.simulate(mechanism, mechanism.state({"height": 1.0}), 5.0, 0.01)
    exact = math.sqrt(2 / G) * (1 + e) / (1 - e)
    assert not run.provenance.completed
    said = float(run.provenance.message.split("accumulate (Zeno) at t = ")[1].split(" s")[0])
    assert said == pytest.approx(exact, abs=1e-9)
    assert 0.0 < exact - run.t[-1] < 1e-5
    assert_closes(mechanism, run, 1e-13)


def test_a_contact_that_lasts_ends_with_words() -> None:
    mechanism = ball(0.0)
    with pytest.warns(dc.SimulationStoppedWarning, match="is in lasting contact"):
        run = dc.simulate(mechanism, mechanism.state({"height": 1.0}), 1.0, 0.01)
    assert run.t[-1] == pytest.approx(math.sqrt(2 / G), abs=1e-12)
    assert run.u[-1, 0] == 0.0 and run.events[-1].energy_lost == pytest.approx(G, abs=1e-12)


def test_starts_in_contact() -> None:
    """Closing, it is hit at once, and the first row is after that; resting, it is no matter for impacts."""
    mechanism = ball(0.5)
    run = dc.simulate(mechanism, mechanism.state(speeds={"height": -4.0}), 0.3, 0.01)
    assert run.events[0].t == run.t[0] == 0.0 and run.events[0].energy_lost == 6.0
    assert run.u[0, 0] == 2.0
    for work in ("in-loop", "samples"):
        ledger = dc.balance(mechanism, run, work=work)
        assert np.abs(ledger.delta_c["wang"]).max() < 1e-13
        assert (ledger.work["impact floor"] == 0.0).all()  # since the first row
    with pytest.warns(dc.SimulationStoppedWarning, match="is in lasting contact"):
        assert len(dc.simulate(mechanism, mechanism.state(), 0.3, 0.01)) == 1


def test_energy_sources_are_refused_unless_asked_for_and_then_booked() -> None:
    with pytest.raises(dc.InputError, match="above 1 every impact creates energy"):
        ball(1.2)
    with pytest.raises(dc.InputError, match="above 1 every impact creates energy"):
        dc.Mechanism(ball().bodies, ball().joints, parameters={"e": 1.5},
                     events=[dc.events.joint_stop("floor", "height", lower=0, restitution="e")])  # fmt: skip
    mechanism = ball(1.1, allow_energy_source=True)
    run = dc.simulate(mechanism, mechanism.state({"height": 1.0}), 2.0, 0.01)
    assert run.events[0].energy_lost == pytest.approx(-(1.1**2 - 1) * G, abs=1e-12)
    assert_closes(mechanism, run, 1e-13)


def test_an_overlapping_start_is_refused_with_pair_depth_and_remedy() -> None:
    mechanism = ball()
    with pytest.raises(dc.InputError, match=r"'height' is beyond the lower limit .* by 0\.25 m"):
        dc.simulate(mechanism, mechanism.state({"height": -0.25}), 1.0, 0.1)
    hit = dc.events.impact("hit", shapes.sphere("a", 0.3), shapes.sphere("b", 0.4))
    pair = dc.Mechanism(
        bodies=[dc.point_mass("a", 1.0), dc.point_mass("b", 2.0)],
        joints=[dc.prismatic(n, "ground", n, axis="x") for n in "ab"],
        events=[hit],
    )
    with pytest.raises(dc.InputError, match=r"'a' and 'b' overlap at the start.*by 0\.1 m.*zero"):
        dc.simulate(pair, pair.state({"b": 0.6}), 1.0, 0.1)


def test_spheres_exchange_momentum() -> None:
    """Two balls on a line: v₁' = v₁ − (1 + e) m₂/(m₁ + m₂) v, by the textbook."""
    pair = dc.Mechanism(
        bodies=[dc.point_mass("a", 1.0), dc.point_mass("b", 2.0)],
        joints=[dc.prismatic(n, "ground", n, axis="x") for n in "ab"],
        events=[
            dc.events.impact(
                "hit", shapes.sphere("a", 0.1), shapes.sphere("b", 0.2), restitution=0.7
            )
        ],
    )
    run = dc.simulate(pair, pair.state({"b": 1.0}, speeds={"a": 2.0}), 1.0, 0.1)
    (hit,) = run.events
    assert hit.t == pytest.approx(0.35, abs=1e-14)
    np.testing.assert_allclose(hit.u_after, [2 - 1.7 * 2 / 3 * 2, 1.7 / 3 * 2], atol=1e-14)
    assert hit.energy_lost == pytest.approx(0.5 * (2 / 3) * (1 - 0.49) * 4, abs=1e-14)


@pytest.mark.parametrize(
    ("mu", "spin"), [(0.05, 0.0), (0.4, 0.0), (0.1, 40.0)], ids=["slips", "sticks", "spins"]
)
def test_a_ball_with_friction_slips_or_sticks(mu: float, spin: float) -> None:
    """A sphere's slip loses 7/2 μ p_n at most; below that it comes to rest (Routh, in closed form)."""
    R, e = 0.1, 0.8
    mechanism = dc.Mechanism(
        bodies=[dc.bodies.sphere("ball", 1.0, R)],
        joints=[dc.free("base", "ball")],
        gravity=(0.0, 0.0, -G),
        events=[
            dc.events.impact(
                "floor", shapes.sphere("ball", R), shapes.half_space(), restitution=e, friction=mu
            )
        ],
    )
    speeds = {"base.vx": 1.0, "base.vy": -0.5, "base.wy": spin}
    run = dc.simulate(mechanism, mechanism.state({"base.z": 0.6}, speeds=speeds), 0.6, 0.01)
    hit = run.events[0]
    vz = -math.sqrt(2 * G * 0.5)
    slip = np.array([1.0 - R * spin, -0.5])
    impulse = (1 + e) * -vz
    after = slip * max(0.0, 1 - 3.5 * mu * impulse / np.hypot(*slip))
    change = (after - slip) / 3.5  # of the centre: 2/7 of the slip's, for J = 2/5 m R²
    np.testing.assert_allclose(
        hit.u_after[:3], [1.0 + change[0], -0.5 + change[1], -e * vz], rtol=0, atol=1e-12
    )
    assert_closes(mechanism, run, 1e-13)


def test_a_loop_takes_the_impulse_on() -> None:
    """The slider-crank has one freedom: its reduced mass A turns the blow into θ̇' = −e θ̇ everywhere."""
    problem = dc.problems.load("struck-slider-crank")
    run = dc.simulate(problem.mechanism, problem.state, 0.2, 2e-3, "ode8")
    (hit,) = run.events
    np.testing.assert_allclose(hit.u_after, -0.7 * hit.u_before, rtol=1e-12)
    assert abs(hit.work["constraint wrist"]) < 1e-14 < abs(hit.impulses["constraint wrist"]).max()
    ledger = dc.balance(problem.mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-12


def test_a_moving_support_puts_its_work_in() -> None:
    """Ball on a driven table, told twice: as a body that is hit, and as a limit that moves."""
    table = dc.Mechanism(
        bodies=[dc.point_mass("table", 2.0), dc.point_mass("ball", 1.0)],
        joints=[
            dc.prismatic("lift", "ground", "table", axis="z", motion="0.1*sin(7*t)"),
            dc.prismatic("height", "ground", "ball", axis="z"),
        ],
        gravity=(0.0, 0.0, -G),
        events=[
            dc.events.impact(
                "hit", shapes.point("ball"), shapes.half_space("table"), restitution=0.8
            )
        ],
    )
    limit = dc.Mechanism(
        bodies=[dc.point_mass("ball", 1.0)],
        joints=[dc.prismatic("height", "ground", "ball", axis="z")],
        gravity=(0.0, 0.0, -G),
        events=[dc.events.joint_stop("hit", "height", lower="0.1*sin(7*t)", restitution=0.8)],
    )
    body = dc.simulate(table, table.state({"height": 1.0}), 2.0, 0.01)
    told = dc.simulate(limit, limit.state({"height": 1.0}), 2.0, 0.01)
    np.testing.assert_allclose(body.q[:, 1], told.q[:, 0], rtol=0, atol=1e-12)
    for one, other in zip(body.events, told.events, strict=True):
        v, w = one.u_before
        assert one.u_after[1] - v == pytest.approx(-0.8 * (w - v), abs=1e-12)
        # Lost in the contact: half the mass of the ball (the table is driven) (1 − e²)(w − v)².
        both = one.work["impact hit"] + one.work["prescribed lift"]
        assert one.energy_lost == pytest.approx(0.5 * 0.36 * (w - v) ** 2, abs=1e-12)
        assert other.work["impact hit"] == pytest.approx(both, abs=1e-12)
    assert_closes(table, body, 1e-11)  # ode5's own error along the driven motion
    assert_closes(limit, told, 1e-13)


def test_simultaneous_contacts_are_one_problem() -> None:
    """A bar that falls flat bounces flat, and a corner takes the blows of both its walls."""
    bar = dc.Mechanism(
        bodies=[dc.bodies.box("bar", 1.0, (1.0, 0.1, 0.1))],
        joints=[dc.free("base", "bar")],
        gravity=(0.0, 0.0, -G),
        events=[
            dc.events.impact(
                "floor",
                shapes.box("bar", (1.0, 0.1, 0.1)),
                shapes.half_space(),
                restitution=0.5,
            )
        ],
    )
    run = dc.simulate(bar, bar.state({"base.z": 0.55}), 0.5, 0.01)
    (hit,) = run.events
    np.testing.assert_allclose(hit.u_after[[0, 1, 3, 4, 5]], 0.0, atol=1e-10)
    assert hit.u_after[2] == pytest.approx(0.5 * math.sqrt(G), abs=1e-12)
    assert hit.names == ("impact floor",)
    assert_closes(bar, run, 1e-13)

    nothing = (np.empty((0, 2)), np.empty(0))
    walls = [TouchingContact(normal, 0.0, *nothing, 0.5, 0.0) for normal in np.eye(2)]
    u = np.array([-1.0, -2.0])
    impulses, law = resolve(ContactInertia(np.eye(2), np.empty((0, 2))), walls, u)
    np.testing.assert_allclose([p[0] for p in impulses], [1.5, 3.0], atol=1e-14)
    assert law == "moreau"


def test_a_box_that_tumbles_on_rough_ground_never_gains() -> None:
    size = (0.4, 0.3, 0.2)
    mechanism = dc.Mechanism(
        bodies=[dc.bodies.box("box", 1.0, size)],
        joints=[dc.free("base", "box")],
        gravity=(0.0, 0.0, -G),
        events=[
            dc.events.impact(
                "floor", shapes.box("box", size), shapes.half_space(), restitution=0.6, friction=0.3
            )
        ],
    )
    turned = np.array([0.9, 0.3, 0.2, 0.1]) / math.sqrt(0.95)
    start = mechanism.state(
        {"base": [0.0, 0.0, 1.0, *turned]}, speeds={"base.vx": 1.0, "base.wx": 2.0, "base.wy": -3.0}
    )
    run = dc.simulate(mechanism, start, 0.8, 0.01, "ode8")
    assert len(run.events) > 5 and all(event.energy_lost > 0.0 for event in run.events)
    ledger = dc.balance(mechanism, run)
    # ode8's error over 80 steps of a tumbling box, relative to the energy exchanged.
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-11 * ledger.energy_exchanged


# --- the law of one contact ------------------------------------------------------------------------


def random_contact(rng: np.random.Generator) -> tuple[Array, Array, float, float]:
    A = rng.standard_normal((3, 5))
    v = rng.standard_normal(3)
    v[0] = -abs(v[0])
    return A @ A.T, v, float(rng.uniform(0, 1)), float(rng.uniform(0, 1.5))


def newton_coulomb(W: Array, v: Array, e: float, mu: float) -> Array:
    """Newton's ratio of speeds with Coulomb's cone: stick if it can, else slip as it was."""
    stick = np.linalg.solve(W, -v * np.array([1 + e, 1, 1]))
    if np.hypot(*stick[1:]) <= mu * stick[0]:
        return stick
    d = v[1:] / np.hypot(*v[1:])
    force = np.array([1.0, *(-mu * d)])
    return np.asarray(-(1 + e) * v[0] / float(W[0] @ force) * force)


def test_friction_never_makes_energy_though_newton_s_ratio_would() -> None:
    rng = np.random.default_rng(5)
    made = 0
    for _ in range(40):
        W, v, e, mu = random_contact(rng)
        P = collide(W, v, e, mu)
        assert P @ (v + 0.5 * W @ P) <= 1e-12 * abs(P @ v)
        assert P[0] >= 0.0 and np.hypot(*P[1:]) <= mu * P[0] * (1 + 1e-9)
        assert (v + W @ P)[0] >= -1e-12
        Q = newton_coulomb(W, v, e, mu)
        made += bool(Q[0] > 0 and Q @ (v + 0.5 * W @ Q) > 1e-6)
    assert made > 0, "the paradox is there to be avoided"


def test_turning_slip_against_keller_s_equations() -> None:
    """The impulse as the independent variable, integrated by SciPy as it stands; slip does not vanish."""
    rng = np.random.default_rng(0)
    for _ in range(4):
        W, v, e, _ = random_contact(rng)
        v[1:] *= 3.0
        mu = 0.1

        def rates(p: float, y: Array, W: Array = W, mu: float = mu) -> Array:
            d = y[1:3] / np.hypot(*y[1:3])
            force = np.array([1.0, *(-mu * d)])
            return np.array([*(W @ force), y[0], *force])

        def compressed(p: float, y: Array) -> float:
            return float(y[0])

        compressed.terminal = True  # type: ignore[attr-defined]
        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        first = solve_ivp(rates, (0, 1e3), [*v, 0, 0, 0, 0], events=compressed, **tight).y[:, -1]

        def given_back(p: float, y: Array, work: float = first[3], e: float = e) -> float:
            return float(y[3] - work * (1 - e**2))

        given_back.terminal = True  # type: ignore[attr-defined]
        exact = solve_ivp(rates, (0, 1e3), first, events=given_back, **tight).y[4:, -1]
        # Kutta's method over turns of at most 0.03 rad: fourth order, 0.03⁴ / 100 at worst.
        np.testing.assert_allclose(collide(W, v, e, mu), exact, rtol=0, atol=1e-8 * exact[0])


def test_a_slip_that_cannot_be_held_starts_where_it_goes_on() -> None:
    """A point without slip on a body that kicks sideways: planar, so the direction is known."""
    W = np.array([[2.0, 1.5, 0.0], [1.5, 2.0, 0.0], [0.0, 0.0, 1.0]])
    v, e, mu = np.array([-1.0, 0.0, 0.0]), 0.5, 0.3
    P = collide(W, v, e, mu)
    # Without friction it would slip towards +x (W_tn > 0): friction pulls to −x, from first to last.
    rate = W[0, 0] - mu * W[0, 1]
    np.testing.assert_allclose(P, np.array([1.0, -mu, 0.0]) * (1 + e) / rate, rtol=0, atol=1e-12)


@pytest.mark.parametrize("friction", repeated((0.05, 0.3, 3.0, 1000.0), 0.3, 1000.0))
def test_friction_in_a_planar_mechanism_is_that_in_space(friction: float) -> None:
    """A tangent out of the plane has no mobility; the same body, free in space, moves in the plane too."""
    slab = dc.body("slab", 1.3, [0.2, 0.3, 0.1])
    corner = shapes.point("slab", (0.4, -0.3, 0.0))
    floor = shapes.half_space(normal=(0.0, 1.0, 0.0))
    hit = dc.events.impact("floor", corner, floor, restitution=0.5, friction=friction)
    planar = dc.Mechanism([slab], [dc.joints.planar("base", "ground", "slab")], events=[hit])
    free = dc.Mechanism([slab], [dc.free("base", "slab")], events=[hit])
    start = planar.state({"base": [0.0, 0.5, 0.0]}, {"base": [0.7, -1.5, 0.4]})
    placed = free.state(
        {"base": [0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0]}, {"base": [0.7, -1.5, 0.0, 0.0, 0.0, 0.4]}
    )
    flat, spatial = (quiet(m, s, 0.3, 0.01, "ode8") for m, s in ((planar, start), (free, placed)))
    assert len(flat.events) == len(spatial.events) > 0
    for one, other in zip(flat.events, spatial.events):
        assert one.t == pytest.approx(other.t, abs=1e-11)
        np.testing.assert_allclose(one.u_after, other.u_after[[0, 1, 5]], atol=1e-9)
        assert (
            one.energy_lost == pytest.approx(other.energy_lost, abs=1e-9) and one.energy_lost > 0.0
        )
    assert_closes(planar, flat, 1e-10)


@pytest.mark.parametrize("friction, paradox", [(1.66, False), (1.67, True), (1000.0, True)])
def test_painleves_rod_is_told_from_a_lasting_contact(friction: float, paradox: bool) -> None:
    """A rod at 45° that slides on its front end: W_nn/W_ns = (1 + 3 cos²)/(3 sin cos) = 5/3."""
    a = 0.4
    rod = dc.body("rod", 1.0, [2 * a * a / 3, 2 * a * a / 3, 2 * a * a / 3])
    hit = dc.events.impact(
        "floor",
        shapes.point("rod", (a, -a, 0.0)),
        shapes.half_space(normal=(0.0, 1.0, 0.0)),
        friction=friction,
        restitution=0.0,
    )
    mechanism = dc.Mechanism(
        [rod], [dc.joints.planar("base", "ground", "rod")], gravity=(0, -9.81, 0), events=[hit]
    )
    state = mechanism.state({"base": [0.0, a, 0.0]}, {"base": [1.0, 0.0, 0.0]})
    with pytest.warns(UserWarning):
        run = dc.simulate(mechanism, state, 0.3, 0.01, "ode4")
    assert not run.provenance.completed
    assert ("Painlevé" in run.provenance.message) == paradox
    assert not paradox or "1.66667" in run.provenance.message


# --- several at once --------------------------------------------------------------------------------


def cradle(masses: Sequence[float], gap: float = 0.0, **options: Any) -> dc.Mechanism:
    """Balls of 2 cm that hang side by side on bars of 20 cm; every joint angle alike lifts a ball."""
    balls = range(len(masses))
    place = {"position": (0, 0, -0.2)}
    return dc.Mechanism(
        bodies=[dc.point_mass(f"ball {k}", m, at=(0, 0, -0.2)) for k, m in enumerate(masses)],
        joints=[
            dc.revolute(f"bar {k}", "ground", f"ball {k}", "y", position=(k * (0.04 + gap), 0, 0))
            for k in balls
        ],
        events=[
            dc.events.impact(
                f"pair {k}",
                shapes.sphere(f"ball {k}", 0.02, **place),
                shapes.sphere(f"ball {k + 1}", 0.02, **place),
                restitution=1.0,
                **options,
            )
            for k in balls[:-1]
        ],
        gravity=(0, 0, -9.81),
    )


@pytest.mark.parametrize("lifted", [1, 2, 3])
def test_newton_s_cradle(lifted: int) -> None:
    """As many balls leave as came, with the speed that these had: from 0.5 rad, ω² = 2 (g/l)(1 − cos)."""
    balls = cradle([0.1] * 5, simultaneous="sequential")
    start = balls.state({f"bar {k}": 0.5 for k in range(lifted)})
    run = dc.simulate(balls, start, 0.5, 1e-3, record=("wang", "liu-huston"))
    speed = np.sqrt(2 * 9.81 / 0.2 * (1 - np.cos(0.5)))
    expected = np.where(np.arange(5) >= 5 - lifted, -speed, 0.0)
    np.testing.assert_allclose(run.events[0].u_after, expected, atol=1e-9 * speed)
    assert "sequential" in run.provenance.notes["simultaneous impacts"]
    assert np.abs(dc.balance(balls, run).delta_c["wang"]).max() < 1e-9


def test_unequal_balls_take_one_impact_after_the_other() -> None:
    """Elastic impacts of 1 and 2, then of 2 and 3: by hand, the second leaves at 2 m/(m + m') v."""
    balls = cradle([0.3, 0.2, 0.1], simultaneous="sequential")
    run = dc.simulate(balls, balls.state({"bar 0": 0.5}), 0.4, 1e-3)
    event = run.events[0]
    v = event.u_before[0]
    second = 2 * 0.3 / 0.5 * v
    expected = [0.1 / 0.5 * v, 0.1 / 0.3 * second, 2 * 0.2 / 0.3 * second]
    np.testing.assert_allclose(event.u_after, expected, rtol=1e-9)
    apart = cradle([0.3, 0.2, 0.1], gap=1e-7)  # and so it is with gaps, one event after the other
    final = dc.simulate(apart, apart.state({"bar 0": 0.5}), 0.4, 1e-3).events[1].u_after
    np.testing.assert_allclose(final, expected, rtol=1e-4)


def test_moreau_s_law_reverses_every_pair_at_once() -> None:
    """Momentum and five approach speeds, of which one was not zero: v₁ − v₂ = −1, the others are equal."""
    balls = cradle([0.1] * 5)
    run = dc.simulate(balls, balls.state({"bar 0": 0.5}), 0.4, 1e-3)
    event = run.events[0]
    np.testing.assert_allclose(
        event.u_after / event.u_before[0], [-0.6, 0.4, 0.4, 0.4, 0.4], atol=1e-9
    )
    assert "moreau" in run.provenance.notes["simultaneous impacts"]
    with pytest.raises(dc.InputError, match="simultaneous"):
        cradle([1.0, 1.0], simultaneous="newton")
