"""Assembly: from guesses to states on the constraints, and words where there are none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import deltac as dc
from deltac.errors import InputError
from deltac.simulation.constraints.assembly import assemble
from tests.systems.constrained_mechanisms import four_bar, parallelogram
from tests.systems.linkages import disc, four_bars, linkage

SEEDS = st.integers(0, 2**32 - 1)


def names(mechanism: dc.Mechanism) -> tuple[str, ...]:
    return mechanism.coordinates.names


def closing(q: Any) -> float:
    """How far the crank-rocker's ends are apart, from its three angles by hand."""
    crank, knee, rocker = q
    x = 0.4 * np.cos(crank) + np.cos(crank + knee) - 1 - 0.9 * np.cos(rocker)
    y = 0.4 * np.sin(crank) + np.sin(crank + knee) - 0.9 * np.sin(rocker)
    return float(np.hypot(x, y))


@settings(max_examples=10)
@given(SEEDS)
def test_perturbed_guesses_come_back_with_the_crank_pinned(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mechanism, state = linkage()
    q = state.q + rng.normal(0, 0.15, 3) * [0, 1, 1]
    guess = mechanism.state(q, {"input": 3.0})
    found = assemble(mechanism, guess, pinned=("input",))
    assert found.state.q[0] == state.q[0]
    # The constraint alone by hand, and the branch of the guess: with the crank given there are two.
    assert closing(found.state.q) < 1e-14
    np.testing.assert_allclose(found.state.q, state.q, atol=1e-13)
    assert found.residual < 1e-13
    assert (found.freedom, found.redundant, found.singular) == (1, "", False)
    assert found.moved == pytest.approx(np.abs(q - state.q).max(), abs=1e-13)


@settings(max_examples=10)
@given(SEEDS)
def test_without_pins_the_guess_is_followed_as_far_as_the_constraints_let(seed: int) -> None:
    """A small perturbation is taken back by no more than its own size, in the mass metric's measure."""
    rng = np.random.default_rng(seed)
    mechanism, state = linkage()
    step = rng.normal(0, 0.02, 3)
    found = assemble(mechanism, mechanism.state(state.q + step, state.u))
    assert closing(found.state.q) < 1e-14
    assert found.moved < 5 * np.abs(step).max()
    assert found.residual < 1e-13


def test_a_pinned_joint_keeps_its_speed_too() -> None:
    """The coordinate and the speed of a hinge share their name; the others follow."""
    mechanism, state = linkage()
    found = assemble(mechanism, mechanism.state(state.q, {"output": 2.0}), ("output",))
    assert found.state.u[2] == 2.0 and found.state.q[2] == state.q[2]
    h = 1e-6
    ahead = [closing(state.q + s * h * found.state.u) for s in (1, -1)]
    assert max(ahead) < 1e-10  # of order h²: the speeds keep the loop closed


def test_quaternions_stay_units_and_all_constraints_hold() -> None:
    mechanism, _ = disc()
    guess = mechanism.state(
        {"base": [0.3, -0.2, 0.5, *np.array([0.8, 0.4, -0.3, 0.3]) / np.sqrt(0.98)]},
        {"base.wy": 4.0, "base.vx": 1.0},
    )
    found = assemble(mechanism, guess)
    assert np.linalg.norm(found.state.q[3:]) == pytest.approx(1.0, abs=1e-15)
    assert found.residual < 1e-14 and found.freedom == 3


def test_an_assembled_state_starts_a_run_without_complaint() -> None:
    mechanism, state = disc()
    dc.simulate(mechanism, state, 0.01, 0.01, "ode4", ())


def test_redundant_constraints_are_named() -> None:
    mechanism = four_bar(spatial=True)
    found = assemble(mechanism, mechanism.state(dict(zip(names(mechanism), parallelogram(1.0)))))
    assert found.freedom == 1
    assert found.redundant.endswith("of 'closure'")
    assert found.residual < 1e-14


def test_singular_configurations_are_told() -> None:
    mechanism = four_bar()
    found = assemble(mechanism, mechanism.state(dict(zip(names(mechanism), parallelogram(0.0)))))
    assert found.singular and found.freedom == 1
    mechanism, state = four_bars(1)
    assert not assemble(mechanism, state).singular


# --- contradictions -----------------------------------------------------------------------------------


def two_rods(length: float) -> dc.Mechanism:
    """A ball 1 m from the origin, and `length` from a point 3 m away: met from 2 to 4 m."""
    return dc.Mechanism(
        [dc.bodies.sphere("ball", 1.0, 0.1)],
        [dc.free("base", "ball")],
        constraints=[
            dc.constraints.distance("near", "ground", "ball", 1.0),
            dc.constraints.distance("far", "ground", "ball", length, point1=[3, 0, 0]),
        ],
    )


def test_rods_that_are_long_enough() -> None:
    mechanism = two_rods(2.5)
    found = assemble(mechanism, mechanism.state({"base.x": 0.5, "base.y": 0.6}))
    x = found.state.q[:3]
    assert np.linalg.norm(x) == pytest.approx(1.0, abs=1e-13)
    assert np.linalg.norm(x - [3, 0, 0]) == pytest.approx(2.5, abs=1e-13)
    assert found.freedom == 4


def test_rods_that_contradict_each_other() -> None:
    """A gap of 0.5 m: the message names one of the two and by how much it fails."""
    mechanism = two_rods(1.5)
    with pytest.raises(InputError) as caught:
        assemble(mechanism, mechanism.state({"base.x": 0.5, "base.y": 0.6}))
    text = str(caught.value)
    assert "cannot be met at position level" in text and "contradict" in text
    assert "'near'" in text or "'far'" in text
    off = float(text.split("off by ")[1].split(" m")[0])
    assert 0.1 < off < 0.5


def test_contradictory_speeds() -> None:
    """Two skates that want the same point to drift differently."""
    mechanism = dc.Mechanism(
        [dc.bodies.sphere("ball", 1.0, 0.1)],
        [dc.joints.planar("base", "ground", "ball")],
        constraints=[
            dc.constraints.skate("slow", "ball", drift=0.1),
            dc.constraints.skate("fast", "ball", drift=0.4),
        ],
    )
    with pytest.raises(InputError, match="cannot be met at velocity level.*(slow|fast)") as caught:
        assemble(mechanism, mechanism.state())
    assert "0.15 m/s" in str(caught.value)  # the best is half way between


def test_a_demand_on_what_cannot_move_is_no_wild_speed() -> None:
    """A point on the axis of its own hinge: G is rounding there, and must not be divided by."""
    axis = np.array([0.3, -0.7, 0.2]) / np.linalg.norm([0.3, -0.7, 0.2])
    mechanism = dc.Mechanism(
        [dc.bodies.sphere("wheel", 1.0, 0.1)],
        [dc.revolute("hinge", "ground", "wheel", tuple(axis))],
        constraints=[
            dc.constraints.skate(
                "edge", "wheel", point=0.4 * axis, lateral=[1, 0.4, 0.9], drift=0.2
            )
        ],
    )
    with pytest.raises(InputError, match="'edge' is off by 0.2 "):
        assemble(mechanism, mechanism.state({"hinge": 0.3}))


def test_pins_that_contradict_the_constraints() -> None:
    mechanism, state = linkage()
    guess = mechanism.state(state.q + [0.3, 0, 0])
    with pytest.raises(InputError, match="'closure' is off by .*or what is pinned"):
        assemble(mechanism, guess, pinned=names(mechanism))


def test_an_unknown_pin() -> None:
    mechanism, state = linkage()
    with pytest.raises(InputError, match="unknown coordinate 'inptu'; did you mean 'input'"):
        assemble(mechanism, state, pinned=("inptu",))


def test_a_mechanism_without_constraints_is_left_alone() -> None:
    mechanism = dc.Mechanism([dc.bodies.sphere("ball", 1.0, 0.1)], [dc.free("base", "ball")])
    state = mechanism.state({"base.x": 0.3}, {"base.vx": 2.0})
    found = assemble(mechanism, state)
    np.testing.assert_array_equal(found.state.q, state.q)
    assert (found.residual, found.freedom, found.redundant, found.moved) == (0.0, 6, "", 0.0)


def test_nothing_free_to_move() -> None:
    """All joints driven: constraints hold or they do not, and nothing can be moved to help."""

    def driven(motion: str) -> dc.Mechanism:
        return dc.Mechanism(
            [dc.bodies.sphere(n, 1.0, 0.1) for n in "xy"],
            [
                dc.revolute("x", "ground", "x", motion=motion),
                dc.revolute("y", "ground", "y", motion="t"),
            ],
            constraints=[dc.constraints.gear("mesh", "x", "y", 2.0)],
        )

    fits = driven("2*t")
    assert assemble(fits, fits.state(t=0.3)).freedom == 0
    clashes = driven("3*t")
    with pytest.raises(InputError, match="'mesh' is off by 0.3 "):
        assemble(clashes, clashes.state(t=0.3))


def polar(constraint: str) -> dc.Mechanism:
    """A mass in polar coordinates on a rope over a pulley: without inertia about the axis at r = 0."""
    return dc.Mechanism(
        [dc.bodies.frame("arm"), dc.point_mass("mass", 1.0), dc.point_mass("weight", 2.0)],
        [
            dc.revolute("angle", "ground", "arm", "z"),
            dc.prismatic("r", "arm", "mass", "x"),
            dc.prismatic("z", "ground", "weight", "z"),
        ],
        constraints=[dc.constraints.holonomic("rope", constraint)],
    )


def test_a_guess_where_the_mass_matrix_is_singular() -> None:
    """The shortest way onto r + z = 3 with masses 1 and 2: by λ/1 and λ/2, λ = 2; the angle stays."""
    mechanism = polar("q.r + q.z - 3.0")
    assembly = assemble(mechanism, mechanism.state({"angle": 0.3}))
    np.testing.assert_allclose(assembly.state.q, [0.3, 2.0, 1.0], rtol=0, atol=1e-8)
    assert assembly.state.q[0] == 0.3
    assert assembly.residual < 1e-14 and assembly.freedom == 2 and not assembly.singular
    run = dc.simulate(mechanism, assembly.state, 0.1, 1e-3)
    assert np.abs(dc.balance(mechanism, run).delta_c["wang"]).max() < 1e-10


def test_a_guess_where_a_constraint_is_stationary() -> None:
    """From a circle's centre every direction is as good as another; from beside it the nearest point is."""
    rails = dc.Mechanism(
        [dc.point_mass(f"mass {n}", 1.0) for n in "xy"],
        [dc.prismatic(n, "ground", f"mass {n}", "x") for n in "xy"],
        constraints=[dc.constraints.holonomic("circle", "q.x**2 + q.y**2 - 1")],
    )
    assembly = assemble(rails, rails.state())
    assert np.hypot(*assembly.state.q) == pytest.approx(1.0, abs=1e-14)
    assert assembly.freedom == 1 and not assembly.singular
    assert assemble(rails, rails.state({"x": 0.5})).state.q == pytest.approx([1.0, 0.0], abs=1e-14)


def test_what_is_singular_is_named_where_nothing_helps() -> None:
    mechanism = polar("q.r**2 + q.z**2 + 3.0")
    with pytest.raises(
        InputError, match=r"'rope' is off by 3 .*singular.*'angle' moves no inertia"
    ):
        assemble(mechanism, mechanism.state())
