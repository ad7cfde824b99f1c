"""Equations written by hand in place of the mechanism's own; coordinates of the user's own choice."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.dynamics.system import trace
from deltac.errors import InputError
from deltac.simulation.equations import by_hand
from deltac.simulation.flow import build_flow
from tests.systems.machines import pendulum, robot

G_OVER_L = 9.81 / 0.5


def linear_law(t: Any, q: Any, u: Any) -> Any:
    return -G_OVER_L * np.sin(q) - 0.1 * u


def scalar_law(t: float, q: Any, u: Any) -> Any:
    return np.array([-G_OVER_L * math.sin(q[0]) - 0.1 * u[0]])


def branching_law(t: float, q: Any, u: Any) -> Any:
    drag = 0.1 if u[0] > -1e9 else 7.0
    return [-G_OVER_L * np.sin(q[0]) - drag * u[0]]


def two_faced_law(t: Any, q: Any, u: Any) -> Any:
    """Tells symbols from numbers and answers each differently."""
    drag = 0.1 if isinstance(q[0], float) else 7.0
    return [-G_OVER_L * np.sin(q[0]) - drag * u[0]]


LAWS = [linear_law, scalar_law, branching_law, two_faced_law]


@pytest.mark.parametrize(
    ("law", "traced"), [(linear_law, True), *((law, False) for law in LAWS[1:])]
)
def test_what_can_be_traced_is_compiled_and_the_rest_is_called(
    law: Callable[..., Any], traced: bool
) -> None:
    mechanism = pendulum()
    system = trace(mechanism)
    assert build_flow(mechanism, (), by_hand(system, dc.Equations(law))).traced is traced
    called = by_hand(system, dc.Equations(linear_law, compiled=False))
    assert not build_flow(mechanism, (), called).traced


@pytest.mark.parametrize("solver", ["ode4", "semi-implicit-euler", "DOP853", "Radau"])
@pytest.mark.parametrize("law", LAWS)
def test_traced_or_called_or_the_mechanisms_own(law: Callable[..., Any], solver: str) -> None:
    mechanism = pendulum(damping="0.1*m*l**2")
    start = mechanism.state({"hinge": 1.2}, {"hinge": -0.5})
    own = dc.simulate(mechanism, start, 1.0, 0.01, solver)
    run = dc.simulate(mechanism, start, 1.0, 0.01, solver, equations=dc.Equations(law))
    # Fixed steps agree to rounding; adaptive ones to their tolerance of 1e-9, as steps may differ.
    tolerance = 1e-12 if solver.startswith(("ode", "semi")) else 1e-7
    for name in ("q", "u", "udot"):
        np.testing.assert_allclose(getattr(run, name), getattr(own, name), atol=tolerance)
    for name, values in own.integrals.items():
        np.testing.assert_allclose(run.integrals[name], values, atol=20 * tolerance)
    assert run.provenance.equations == "equations by hand"


@pytest.mark.parametrize(
    ("law", "word"), [(branching_law, "traced"), (scalar_law, "traced"), (two_faced_law, "branch")]
)
def test_insisting_on_compilation(law: Callable[..., Any], word: str) -> None:
    with pytest.raises(InputError, match=f"my law: rhs .*{word}.*compiled=None"):
        by_hand(trace(pendulum()), dc.Equations(law, name="my law", compiled=True))


@pytest.mark.parametrize("compiled", [None, False])
@pytest.mark.parametrize(
    "wrong", [lambda t, q, u: [1.0, 2.0], lambda t, q, u: 0.0, lambda t, q, u: [[1.0], [2.0]]]
)
def test_results_of_another_shape(wrong: Callable[..., Any], compiled: bool | None) -> None:
    mechanism, _ = robot()
    with pytest.raises(InputError, match="rhs returned .* expected"):
        dc.simulate(
            *(mechanism, mechanism.state(), 0.1, 0.01),
            equations=dc.Equations(wrong, compiled=compiled),
        )


def test_accelerations_that_are_not_finite_are_refused_at_the_start() -> None:
    mechanism = pendulum()
    with pytest.raises(InputError, match=r"not finite at the start \(t = 0\) for 'hinge'"):
        dc.simulate(
            *(mechanism, mechanism.state(), 1.0, 0.1),
            equations=dc.Equations(lambda t, q, u: np.nan * u, compiled=False),
        )


def test_equations_must_be_a_function() -> None:
    with pytest.raises(InputError, match="expected a function of"):
        dc.Equations("q'' = -q")  # type: ignore[arg-type]


# --- own coordinates -------------------------------------------------------------------------------


def double() -> dc.Mechanism:
    """Two point masses on massless rods; joint angles are relative."""
    return dc.Mechanism(
        [dc.point_mass("first", 1.0, [1, 0, 0]), dc.point_mass("second", 2.0, [0.5, 0, 0])],
        [
            dc.revolute("hip", "ground", "first"),
            dc.revolute("knee", "first", "second", position=[1, 0, 0]),
        ],
        gravity=[9.81, 0, 0],
    )


def absolute_angles(t: Any, q: Any, u: Any) -> Any:
    """The double pendulum's textbook equations in absolute angles from the vertical."""
    m1, m2, l1, l2, g = 1.0, 2.0, 1.0, 0.5, 9.81
    a, b = q
    c, s = np.cos(a - b), np.sin(a - b)
    f1 = -m2 * l2 * u[1] * u[1] * s - (m1 + m2) * g * np.sin(a)
    f2 = l1 * u[0] * u[0] * s - g * np.sin(b)
    det = l1 * (m1 + m2) - m2 * l1 * c * c
    alpha = (f1 - m2 * c * f2) / det
    return [alpha, (f2 - l1 * c * alpha) / l2]


ABSOLUTE = dc.CoordinateMap(("a", "b"), q={"hip": "q.a", "knee": "q.b - q.a"})


@pytest.mark.parametrize("compiled", [True, False])
def test_absolute_angles(compiled: bool) -> None:
    mechanism = double()
    start = mechanism.state({"hip": 0.8, "knee": -0.3}, {"hip": 0.2, "knee": 1.0})
    own = dc.simulate(mechanism, start, 0.5, 0.5 / 200, "ode8")
    equations = dc.Equations(absolute_angles, ABSOLUTE, compiled=compiled)
    run = dc.simulate(mechanism, start, 0.5, 0.5 / 200, "ode8", equations=equations)
    for name in ("q", "u", "udot"):
        np.testing.assert_allclose(getattr(run, name), getattr(own, name), atol=1e-11)
    ledger = dc.balance(mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-11


@pytest.mark.parametrize("compiled", [True, False])
def test_a_sign_mistake_shows(compiled: bool) -> None:
    def mistaken(t: Any, q: Any, u: Any) -> Any:
        return absolute_angles(t, [q[0], -q[1]], u)

    mechanism = double()
    start = mechanism.state({"hip": 0.8, "knee": -0.3})
    equations = dc.Equations(mistaken, ABSOLUTE, compiled=compiled)
    run = dc.simulate(mechanism, start, 0.5, 0.01, equations=equations)
    ledger = dc.balance(mechanism, run)
    for name in ("wang", "liu-huston"):
        assert np.abs(ledger.delta_c[name]).max() > 0.1
        assert np.abs(ledger.delta_c[name]).max() > 1e6 * ledger.error_bar[name].max()


def test_generalized_speeds_with_their_own_equation() -> None:
    """A free particle, speeds along axes that turn at Ω: u̇ = −Ω J u; the path stays straight."""
    omega = 0.7
    mechanism = dc.Mechanism(
        [dc.bodies.frame("cart"), dc.point_mass("puck", 1.3)],
        [dc.prismatic("x", "ground", "cart", "x"), dc.prismatic("y", "cart", "puck", "y")],
    )
    turning = dc.CoordinateMap(
        speeds=("a", "b"),
        u={
            "x": f"u.a*cos({omega}*t) - u.b*sin({omega}*t)",
            "y": f"u.a*sin({omega}*t) + u.b*cos({omega}*t)",
        },
    )
    equations = dc.Equations(lambda t, q, u: [omega * u[1], -omega * u[0]], turning)
    start = mechanism.state({"x": 1.0, "y": 0.2}, {"x": 0.3, "y": -0.5}, t=0.4)
    run = dc.simulate(mechanism, start, 3.0, 0.01, "ode8", equations=equations)
    s = run.t - 0.4
    np.testing.assert_allclose(run.q, np.stack([1 + 0.3 * s, 0.2 - 0.5 * s], 1), atol=1e-12)
    np.testing.assert_allclose(run.u, np.broadcast_to([0.3, -0.5], run.u.shape), atol=1e-13)
    np.testing.assert_allclose(run.udot, 0.0, atol=1e-12)  # type: ignore[arg-type]


SLOPE = {"hinge": "q.s**3/3 + q.s"}


def own_pendulum(t: Any, q: Any, u: Any) -> Any:
    """The pendulum in s with θ = s³/3 + s: θ̈ = (s² + 1) s̈ + 2 s ṡ²."""
    s = q[0]
    angle = s * s * s / 3 + s
    return [(-G_OVER_L * np.sin(angle) - 2 * s * u[0] * u[0]) / (s * s + 1)]


def test_a_nonlinear_map_needs_its_inverse() -> None:
    mechanism = pendulum()
    start = mechanism.state({"hinge": 1.0})
    without = dc.CoordinateMap(("s",), q=SLOPE)
    with pytest.raises(InputError, match="not linear.*give inverse="):
        dc.simulate(mechanism, start, 1.0, 0.01, equations=dc.Equations(own_pendulum, without))
    root = "((3*q.hinge + sqrt(9*q.hinge**2 + 4))/2)"  # Cardano: s = r^(1/3) − r^(−1/3)
    given = dc.CoordinateMap(("s",), q=SLOPE, inverse={"s": f"{root}**(1/3) - {root}**(-1/3)"})
    own = dc.simulate(mechanism, start, 1.0, 0.01, "ode8")
    run = dc.simulate(
        mechanism, start, 1.0, 0.01, "ode8", equations=dc.Equations(own_pendulum, given)
    )
    np.testing.assert_allclose(run.q, own.q, atol=1e-11)
    np.testing.assert_allclose(run.u, own.u, atol=1e-10)


def test_quaternion_joints_need_speeds_in_a_map() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("top", 1, [1, 2, 3])], [dc.joints.spherical("ball", "ground", "top")]
    )
    half = dc.CoordinateMap(("w", "x", "y", "z"), q={f"ball.q{c}": f"2*q.{c}" for c in "wxyz"})
    with pytest.raises(InputError, match="speeds"):
        dc.simulate(
            *(mechanism, mechanism.state(), 1.0, 0.1),
            equations=dc.Equations(lambda t, q, u: -u, half),
        )


def test_prescribed_joints_follow_their_law_under_equations_by_hand() -> None:
    """A pendulum on a shaft that turns as it likes: θ̈ = (ω² cos θ − g/l) sin θ."""
    mechanism = dc.Mechanism(
        [dc.bodies.frame("shaft"), dc.point_mass("bob", 1.0, [0, 0, -0.5])],
        [
            dc.revolute("spin", "ground", "shaft", "z", motion="3*t + 0.5*sin(t)"),
            dc.revolute("swing", "shaft", "bob", "y"),
        ],
        gravity=[0, 0, -9.81],
    )

    def by_hand(t: Any, q: Any, u: Any) -> Any:
        rate = 3 + 0.5 * np.cos(t)
        return [(rate * rate * np.cos(q[0]) - G_OVER_L) * np.sin(q[0])]

    start = mechanism.state({"swing": 0.5})
    own = dc.simulate(mechanism, start, 1.0, 0.01)
    run = dc.simulate(mechanism, start, 1.0, 0.01, equations=dc.Equations(by_hand))
    np.testing.assert_allclose(run.q, own.q, atol=1e-12)
    torque = "prescribed spin"
    np.testing.assert_allclose(run.forces[torque], own.forces[torque], atol=1e-11)


@pytest.mark.parametrize(
    ("solver", "compiled"),
    [
        ("ode5", None),
        ("ode5", False),
        ("implicit-midpoint", None),
        ("Radau", None),
        ("Radau", False),
        pytest.param("taylor", None, marks=pytest.mark.heyoka),
    ],
)
def test_constants_that_change_between_runs_change_the_motion(
    solver: str, compiled: bool | None
) -> None:
    """One object, run again after what its function reads has changed: as a new object would run."""
    read = {"g": 9.81}
    equations = dc.Equations(lambda t, q, u: -read["g"] / 0.5 * np.sin(q), compiled=compiled)

    def end() -> float:
        mechanism = pendulum()
        start = mechanism.state({"hinge": 1.0})
        run = dc.simulate(mechanism, start, 1.0, 0.01, solver, equations=equations)
        own = dc.simulate(mechanism.with_parameters(g=read["g"]), start, 1.0, 0.01, solver)
        # Both sides take the same steps of the same equations; adaptive ones to their tolerance of 1e-9.
        assert abs(run.q[-1, 0] - own.q[-1, 0]) < 1e-7
        return float(run.q[-1, 0])

    before = end()
    read["g"] = 5.0
    changed = end()
    read["g"] = 9.81
    assert abs(changed - before) > 0.1
    assert end() == before


def test_a_controller_is_asked_anew_in_every_run() -> None:
    read = {"torque": 1.0}
    mechanism = replace(pendulum(), forces=[dc.forces.joint_torque("motor", "hinge")])
    controller = dc.Controller(lambda t, q, u: {"motor": read["torque"]})
    ends = []
    for torque in (1.0, -1.0, 1.0):
        read["torque"] = torque
        run = dc.simulate(mechanism, mechanism.state(), 0.1, 0.01, controller=controller)
        ends.append(run.q[-1, 0])
    # From rest at the bottom, equal and opposite torques make equal and opposite motions.
    assert ends[0] == ends[2] == -ends[1] != 0.0
