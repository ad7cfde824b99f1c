"""Own generalized speeds, and equations in minimal coordinates, of mechanisms with constraints.

Oracles: the four-bar by its crank angle in closed form; the rolling disc as SymPy's documentation has it
after Kane and Levinson; Chaplygin's sleigh; the same four-bar in maximal coordinates.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import deltac as dc
from tests.systems import four_bar

FUNCTIONS = ("wang", "liu-huston", "kane-levinson-1988", "kane-levinson-1990")
CRANK = dc.CoordinateMap(("crank",))
BY_HAND = dc.Equations(four_bar.acceleration, CRANK, "four-bar by hand")
BAR = four_bar.mechanism()
START = four_bar.start()


def _largest(ledger: dc.Ledger) -> dict[str, float]:
    return {name: float(np.abs(values).max()) for name, values in ledger.delta_c.items()}


# --- equations in minimal coordinates ------------------------------------------------------------


@pytest.fixture(scope="module")
def own_equations() -> dc.Trajectory:
    """The mechanism's own equations, all joints and multipliers."""
    return dc.simulate(BAR, START, 1.0, 1e-3, "ode8")


def test_four_bar_by_its_crank(own_equations: dc.Trajectory) -> None:
    """u̇ of one speed by hand; the other joints follow by assembly and the constraint Jacobian."""
    run = dc.simulate(BAR, START, 1.0, 1e-3, "ode8", equations=BY_HAND)
    assert np.abs(run.q - own_equations.q).max() < 1e-11
    assert np.abs(run.u - own_equations.u).max() < 1e-10
    alpha, beta = four_bar.angles(run.coordinate("crank"))
    assert np.abs(run.coordinate("crank") + run.coordinate("coupler") - alpha).max() < 1e-12
    assert np.abs(run.coordinate("rocker") - beta).max() < 1e-12
    assert max(_largest(dc.balance(BAR, run)).values()) < 1e-11
    assert dc.audit(BAR, run).verdict.kind == "consistent"


def test_the_crank_follows_the_users_own_integration() -> None:
    """Only dependent joints are brought back, so the crank is that of the scalar equation alone."""
    h, steps = 5e-3, 100
    run = dc.simulate(BAR, START, h * steps, h, "ode4", equations=BY_HAND)
    y = np.array([START.q[0], START.u[0]])

    def rate(y: np.ndarray) -> np.ndarray:
        return np.array([y[1], four_bar.acceleration(0.0, y[:1], y[1:])[0]])

    for _ in range(steps):
        k1 = rate(y)
        k2 = rate(y + h / 2 * k1)
        k3 = rate(y + h / 2 * k2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(y + h * k3))
    # Stages take the crank from the joints, whose drift within a step is of the method's order.
    assert abs(run.q[-1, 0] - y[0]) < 1e-12
    assert abs(run.u[-1, 0] - y[1]) < 1e-11


def test_equations_that_cannot_be_traced(own_equations: dc.Trajectory) -> None:
    called = dc.Equations(four_bar.acceleration, CRANK, compiled=False)
    run = dc.simulate(BAR, START, 0.1, 1e-3, "ode4", equations=called)
    assert np.abs(run.q[-1] - own_equations.q[100]).max() < 1e-9


@pytest.mark.parametrize(
    ("coordinates", "shift"),
    [
        (CRANK, 0.0),
        # Measured from the vertical; and by the height of the crank's pin.
        pytest.param(
            dc.CoordinateMap(("phi",), q={"crank": "q.phi - pi/2"}),
            np.pi / 2,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_check_of_minimal_coordinates(coordinates: dc.CoordinateMap, shift: float) -> None:
    def rhs(t: Any, q: Any, u: Any, weight: float = 1.0) -> Any:
        return four_bar.acceleration(t, q - shift, u, weight)

    model = (BAR, START)
    assert dc.check_equations(model, rhs, coordinates=coordinates).verdict.kind == "consistent"
    wrong = dc.check_equations(model, lambda t, q, u: rhs(t, q, u, 1.01), coordinates=coordinates)
    assert wrong.verdict.kind == "equation-error"
    # A hundredth of the weight of the coupler, as a force on it.
    cause = next(f for f in wrong.verdict.findings if f.weight == "cause")
    assert (cause.kind, cause.element) == ("applied-force", "b")
    force = -0.01 * four_bar.MASSES[1] * 9.81
    assert f"{force:.4g}" in cause.what


def test_check_of_one_vector_and_of_rates() -> None:
    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], four_bar.acceleration(t, y[:1], y[1:])[0]])

    found = dc.check_equations((BAR, START), rates, coordinates=CRANK)
    assert found.verdict.kind == "consistent"
    assert found.rates == {"crank": 0.0}


def test_states_stay_in_the_assembly_of_the_start() -> None:
    """Crossed, the same crank angle has other joint angles, and the closed form would be wrong."""
    states = dc.random_states((BAR, START), CRANK, count=32)
    alpha, beta = four_bar.angles(states.q[0])
    assert np.abs(np.exp(1j * (states.q[0] + states.q[1])) - np.exp(1j * alpha)).max() < 1e-9
    assert np.abs(np.exp(1j * states.q[2]) - np.exp(1j * beta)).max() < 1e-9
    assert states.speeds == ("crank",)
    assert len(set(np.round(states.q[0], 1))) > 20  # all around


def test_a_place_as_coordinate() -> None:
    """Own coordinates that are functions of the joints': `inverse` alone."""
    slider = dc.Mechanism(
        [dc.rod("a", 1.0, 0.3, along="x"), dc.rod("b", 2.0, 0.9, along="x")],
        [
            dc.revolute("crank", "ground", "a"),
            dc.revolute("pin", "a", "b", position=(0.3, 0, 0)),
        ],
        constraints=[dc.constraints.point_on("guide", "b", ["y"], point=(0.9, 0, 0))],
        gravity=(0, -9.81, 0),
    )
    start = dc.assemble(slider, {"crank": 1.0, "pin": -1.3}, {"crank": 1.0}).state
    place = dc.CoordinateMap(("x",), inverse={"x": "0.3*cos(q.crank) + 0.9*cos(q.crank + q.pin)"})
    right = dc.evaluate(slider, start)

    def x_of(q: np.ndarray) -> float:
        return float(0.3 * np.cos(q[0]) + 0.9 * np.cos(q[0] + q[1]))

    # ẍ of the mechanism's own accelerations, by differences of second order along the motion.
    e = 1e-4
    q0, u0, a0 = start.q, start.u, right.udot
    ahead, behind = (x_of(q0 + s * e * u0 + 0.5 * e**2 * a0) for s in (1, -1))
    bend = (ahead - 2 * x_of(q0) + behind) / e**2
    rate = (x_of(q0 + e * u0) - x_of(q0 - e * u0)) / (2 * e)
    states = dc.States(np.zeros(1), np.array([[x_of(q0)]]), np.array([[rate]]), ("x",), ("x",))
    found = dc.check_equations(
        (slider, start), lambda t, q, u: np.array([bend]), coordinates=place, states=states
    )
    assert found.test.acceleration[0, 0] == pytest.approx(bend, rel=1e-5)


def test_the_same_machine_in_maximal_coordinates(own_equations: dc.Trajectory) -> None:
    """Every bar on its own, all hinges constraints; the same motion from independent code paths."""
    a, b, c = four_bar.MASSES
    lengths = {"a": four_bar.CRANK, "b": four_bar.COUPLER, "c": four_bar.ROCKER}
    bodies = [dc.rod(n, m, lengths[n], along="x") for n, m in zip("abc", (a, b, c))]
    hinge = dc.constraints.loop_revolute
    machine = dc.Mechanism(
        bodies,
        [dc.joints.planar(f"at {n}", "ground", n) for n in "abc"],
        constraints=[
            hinge("O", "ground", "a"),
            hinge("A", "a", "b", point1=(four_bar.CRANK, 0, 0)),
            hinge("B", "b", "c", point1=(four_bar.COUPLER, 0, 0), point2=(four_bar.ROCKER, 0, 0)),
            hinge("C", "ground", "c", point1=(four_bar.GROUND, 0, 0)),
        ],
        gravity=(0, -four_bar.G, 0),
    )
    theta, coupler, rocker = START.q
    rate, relative, swing = START.u
    pin = four_bar.CRANK * np.array([np.cos(theta), np.sin(theta)])
    start = machine.state(
        {
            "at b": [*pin, theta + coupler],
            "at a": [0, 0, theta],
            "at c": [four_bar.GROUND, 0, rocker],
        },
        {
            "at a": [0, 0, rate],
            "at b": [-pin[1] * rate, pin[0] * rate, rate + relative],
            "at c": [0, 0, swing],
        },
    )
    free = dc.simulate(machine, start, 0.5, 1e-3, "ode8")
    assert np.abs(free.coordinate("at a.angle") - own_equations.q[:501, 0]).max() < 1e-10
    # The crank alone as own speed, of nine joints' speeds and eight constraints.
    one = dc.CoordinateMap(speeds=("at a.angle",))
    ledger = dc.balance(machine, free, work="samples", testing=FUNCTIONS, coordinates=one)
    for name in FUNCTIONS:
        assert np.abs(ledger.delta_c[name]).max() < 10 * np.abs(ledger.error_bar[name]).max() + 1e-9


# --- own speeds in testing functions --------------------------------------------------------------


def _disc() -> dc.Mechanism:
    """A disc by yaw, lean and spin, which rolls."""
    return dc.Mechanism(
        [
            *(dc.bodies.frame(n) for n in ("along", "across", "above", "yawed", "leant")),
            dc.bodies.disc("disc", 2.0, 0.3, axis="y"),
        ],
        [
            dc.prismatic("x", "ground", "along", "x"),
            dc.prismatic("y", "along", "across", "y"),
            dc.prismatic("z", "across", "above", "z"),
            dc.revolute("yaw", "above", "yawed", "z"),
            dc.revolute("lean", "yawed", "leant", "x"),
            dc.revolute("spin", "leant", "disc", "y"),
        ],
        constraints=[dc.constraints.rolling("road", "disc", 0.3, axis="y")],
        gravity=(0, 0, -9.81),
    )


KANE = dc.CoordinateMap(
    speeds=("u1", "u2", "u3"),
    u={"lean": "u.u1", "yaw": "u.u3/cos(q.lean)", "spin": "u.u2 - u.u3*tan(q.lean)"},
)
"""Angular velocity in the leaning frame; the velocity of the centre follows from rolling."""


def published_disc(t: Any, q: Any, u: Any) -> Any:
    """docs.sympy.org, "A rolling disc, with Kane's method"."""
    g, r, lean = 9.81, 0.3, q[4]
    u1, u2, u3 = u
    return np.array(
        [
            (4 * g * np.sin(lean) + 6 * r * u2 * u3 - r * u3**2 * np.tan(lean)) / (5 * r),
            -2 * u1 * u3 / 3,
            (-2 * u2 + u3 * np.tan(lean)) * u1,
        ]
    )


def test_rolling_disc_in_the_speeds_of_textbooks() -> None:
    disc = _disc()
    start = dc.assemble(
        disc,
        {"z": 0.3 * np.cos(0.2), "lean": 0.2},
        {"yaw": 0.5, "lean": 0.1, "spin": 8.0},
    ).state
    by_hand = dc.Equations(published_disc, KANE)
    record = dc.Record(FUNCTIONS, coordinates=KANE)
    run = dc.simulate(disc, start, 0.5, 1e-3, "ode4", record, by_hand)
    own = dc.simulate(disc, start, 0.5, 1e-3, "ode4", record)
    # At states of a run: upside down, the disc touches the road with its other side.
    check = dc.check_equations(disc, published_disc, coordinates=KANE, states=own)
    assert check.verdict.kind == "consistent"
    assert np.abs(run.q - own.q).max() < 1e-7  # ode4 at h = 1e-3 s
    for motion in (run, own):
        found = _largest(dc.balance(disc, motion))
        assert set(found) == set(FUNCTIONS)
        assert max(found.values()) < 1e-6  # of 100 J


SLEIGH = dc.problems.load("chaplygin-sleigh")
FORWARD = {"ice.angle": "u.w", "ice.x": 'u.v*cos(q["ice.angle"])'}
ACROSS = 'u.v*sin(q["ice.angle"])'
QUASI = {
    "ice.angle": "u.w",
    "ice.x": 'u.v*cos(q["ice.angle"]) - u.side*sin(q["ice.angle"])',
    "ice.y": 'u.v*sin(q["ice.angle"]) + u.side*cos(q["ice.angle"])',
}


@pytest.mark.parametrize(
    "own",
    [
        dc.CoordinateMap(speeds=("v", "w"), u=FORWARD),
        dc.CoordinateMap(speeds=("v", "w"), u={**FORWARD, "ice.y": ACROSS}),
        dc.CoordinateMap(speeds=("v", "w", "side"), u=QUASI),  # the last is dependent: zero
    ],
    ids=["what follows left out", "all laws", "a dependent speed"],
)
def test_sleigh_by_quasi_velocities(own: dc.CoordinateMap) -> None:
    run = dc.simulate(
        SLEIGH.mechanism, SLEIGH.state, 1.0, 2e-3, "ode8", dc.Record(FUNCTIONS, coordinates=own)
    )
    ledger = dc.balance(SLEIGH.mechanism, run)
    assert set(ledger.delta_c) == set(FUNCTIONS)
    assert max(_largest(ledger).values()) < 1e-12  # of 2.5 J


def test_sleigh_by_hand() -> None:
    """v̇ = a ω², ω̇ = −m a v ω/(I + m a²): the published equations in two quasi-velocities."""
    a = 0.5
    equations = dc.Equations(
        lambda t, q, u: np.array([a * u[1] ** 2, -a * u[0] * u[1] / (1.0 + a**2)]),
        dc.CoordinateMap(speeds=("v", "w"), u=FORWARD),
    )
    run = dc.simulate(SLEIGH.mechanism, SLEIGH.state, 5.0, 2e-3, "ode8", equations=equations)
    for reference in SLEIGH.reference:
        if reference.quantity.startswith("speed of the blade"):
            assert reference.measure(run) == pytest.approx(reference.value, abs=1e-10)
    assert dc.check_equations(SLEIGH, equations).verdict.kind == "consistent"


def test_a_loop_whose_foot_is_moved() -> None:
    """Time in the constraints: v_t ≠ 0, K0 ≠ 0, and all four functions close, in whichever joint's speed."""
    moved = dc.Mechanism(
        [dc.bodies.frame("foot"), *BAR.bodies],
        [
            dc.prismatic("shake", "ground", "foot", "x", motion="0.05*sin(7*t)"),
            *(j if j.name != "rocker" else _on(j, "foot") for j in BAR.joints),
        ],
        constraints=BAR.constraints,
        gravity=(0, -four_bar.G, 0),
    )
    q = {"crank": START.q[0], "coupler": START.q[1], "rocker": START.q[2]}
    start = dc.assemble(moved, q, {"crank": 3.0}).state
    largest = []
    for name in ("crank", "rocker"):
        own = dc.CoordinateMap((name,))
        run = dc.simulate(moved, start, 0.5, 1e-3, "ode8", dc.Record(FUNCTIONS, coordinates=own))
        ledger = dc.balance(moved, run)
        assert max(_largest(ledger).values()) < 1e-9
        largest.append(ledger.K0.max())
    assert min(largest) > 1e-3
    assert abs(largest[0] - largest[1]) > 1e-3  # two divisions of one motion


def _on(joint: Any, parent: str) -> Any:
    return dc.revolute(joint.name, parent, joint.child, position=joint.position)


# --- what the trajectory records, and words --------------------------------------------------------


def test_a_run_records_its_speeds(tmp_path: Any) -> None:
    own = dc.CoordinateMap(speeds=("v", "w"), u=FORWARD)
    run = dc.simulate(
        SLEIGH.mechanism, SLEIGH.state, 0.1, 2e-3, "ode8", dc.Record(FUNCTIONS, coordinates=own)
    )
    run.write(tmp_path / "run.parquet")
    back = dc.read_trajectory(tmp_path / "run.parquet")
    noted = back.provenance.coordinates
    assert dc.CoordinateMap(**noted).digest == own.digest
    assert json.loads(json.dumps(dict(noted)))["speeds"] == ["v", "w"]
    ours, theirs = dc.balance(SLEIGH.mechanism, run), dc.balance(SLEIGH.mechanism, back)
    for name in FUNCTIONS:
        assert np.array_equal(ours.delta_c[name], theirs.delta_c[name])
    other = dc.CoordinateMap(speeds=("v", "w", "side"), u=QUASI)
    with pytest.raises(dc.InputError) as caught:
        dc.balance(SLEIGH.mechanism, back, coordinates=other)
    assert caught.value.code == "E-MODEL"


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (dc.CoordinateMap(speeds=("w",), u={"ice.angle": "u.w"}), ["1 speeds", "2 independent"]),
        (
            dc.CoordinateMap(speeds=("v", "w"), u={**FORWARD, "ice.y": "u.v"}),
            ["'blade'", "not satisfy"],
        ),
        (dc.CoordinateMap(speeds=("ice.angel",)), ["ice.angel", "ice.angle"]),
    ],
    ids=["too few", "against the constraint", "unknown"],
)
def test_own_speeds_that_do_not_fit(own: dc.CoordinateMap, words: list[str]) -> None:
    with pytest.raises(dc.InputError) as caught:
        dc.simulate(SLEIGH.mechanism, SLEIGH.state, 0.1, 2e-3, record=dc.Record(coordinates=own))
    for word in words:
        assert word in str(caught.value)


def test_1988_asks_for_independent_speeds() -> None:
    with pytest.raises(dc.InputError, match="independent speeds"):
        dc.simulate(BAR, START, 0.1, 1e-2, record=("kane-levinson-1988",))


def test_results_of_solvers_hold_no_assembly() -> None:
    t = np.linspace(0.0, 0.1, 5)
    with pytest.raises(dc.InputError) as caught:
        dc.Trajectory.from_scipy((t, np.zeros((5, 2))), BAR, coordinates=CRANK)
    assert caught.value.code == "E-MODEL"


def test_implicit_solvers_refuse_fewer_coordinates() -> None:
    with pytest.raises(dc.InputError) as caught:
        dc.simulate(BAR, START, 0.1, 1e-2, "implicit-midpoint", equations=BY_HAND)
    assert caught.value.code == "E-SOLVER"
