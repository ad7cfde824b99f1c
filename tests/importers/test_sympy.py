"""Equations from SymPy's methods against the mechanism's own, and a mechanism's equations in symbols."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import (
    KanesMethod,
    LagrangesMethod,
    Lagrangian,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import deltac as dc
from deltac.dynamics.recursions import crba
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward
from deltac.errors import InputError
from deltac.importers import equations_from_sympy, symbolic_equations
from deltac.mechanism.expressions import symbol_of
from tests.systems.random_mechanisms import random_state

M1, M2, L1, L2, G, C = sp.symbols("m1 m2 l1 l2 g c")
VALUES = {"m1": 1.2, "m2": 0.7, "l1": 0.5, "l2": 0.8, "g": 9.81, "c": 0.05}


def double_pendulum(**more: Any) -> dc.Mechanism:
    """Two rods that hang along −y, relative angles; a damper in the first hinge."""
    return dc.Mechanism(
        [dc.rod("upper", "m1", "l1", along="-y"), dc.rod("lower", "m2", "l2", along="-y")],
        [
            dc.revolute("shoulder", "ground", "upper", "z", damping="c"),
            dc.revolute("elbow", "upper", "lower", "z", position=(0, "-l1", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=VALUES,
        **more,
    )


def two_rods(q: Any, w: Any) -> tuple[ReferenceFrame, list[Any], list[Any]]:
    """Frame, bodies and loads of the pendulum at absolute angles q with angular velocities w."""
    N, O = ReferenceFrame("N"), Point("O")
    O.set_vel(N, 0)
    bodies, hinge = [], O
    for k, (m, l) in enumerate(((M1, L1), (M2, L2))):
        A = N.orientnew(f"A{k}", "Axis", (q[k], N.z))
        A.set_ang_vel(N, w[k] * N.z)
        centre = hinge.locatenew(f"G{k}", -l / 2 * A.y)
        centre.v2pt_theory(hinge, N, A)
        bodies.append(
            RigidBody(f"B{k}", centre, A, m, (inertia(A, m * l**2 / 12, 0, m * l**2 / 12), centre))
        )
        if k == 0:
            hinge = O.locatenew("E", -l * A.y)
            hinge.v2pt_theory(O, N, A)
    loads = [(b.masscenter, -b.mass * G * N.y) for b in bodies]
    return N, bodies, [*loads, (bodies[0].frame, -C * w[0] * N.z)]


def kane(scaled: bool) -> tuple[Any, Any]:
    """By Kane's method; speeds are the angular velocities, or other combinations."""
    q, u = dynamicsymbols("alpha beta"), dynamicsymbols("u1 u2")
    w = [2 * u[0], u[1] - u[0] * sp.cos(q[0])] if scaled else u
    N, bodies, loads = two_rods(q, w)
    method = KanesMethod(N, q, u, kd_eqs=[q[k].diff() - w[k] for k in range(2)])
    method.kanes_equations(bodies, loads)
    return method, q


def lagrange() -> tuple[Any, Any]:
    q = dynamicsymbols("alpha beta")
    N, bodies, loads = two_rods(q, [v.diff() for v in q])
    method = LagrangesMethod(Lagrangian(N, *bodies), q, forcelist=loads, frame=N)
    method.form_lagranges_equations()
    return method, q


@pytest.mark.parametrize("way", ["kane", "kane with other speeds", "lagrange"])
def test_motion_is_that_of_the_mechanism(way: str) -> None:
    """Two routes to the same equations, one solver and step: equal but for rounding, which grows."""
    method, (alpha, beta) = lagrange() if way == "lagrange" else kane(scaled="other" in way)
    mechanism = double_pendulum()
    equations = equations_from_sympy(
        method, {"shoulder": alpha, "elbow": beta - alpha}, parameters=VALUES
    )
    assert equations.coordinates is not None
    assert isinstance(equations.coordinates, dc.CoordinateMap)
    assert equations.coordinates.coordinates == ("alpha", "beta")
    state = mechanism.state({"shoulder": 0.4, "elbow": -0.9}, {"shoulder": 1.0, "elbow": 2.0})
    runs = [
        dc.simulate(mechanism, state, duration=0.5, step=1e-3, solver="ode5", equations=e)
        for e in (None, equations)
    ]
    # In other speeds the method's error is another, h⁵ in size; in the rates it is the same.
    tolerance = 1e-9 if "other" in way else 1e-11
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=0, atol=tolerance)
    assert np.abs(runs[0].q[-1] - runs[0].q[0]).max() > 0.1


def test_rhs_takes_batches() -> None:
    method, (alpha, beta) = kane(scaled=False)
    equations = equations_from_sympy(
        method, {"shoulder": alpha, "elbow": beta - alpha}, parameters=VALUES
    )
    rng = np.random.default_rng(3)
    q, u = rng.normal(size=(2, 2, 5))
    many = np.asarray(equations.rhs(0.0, q, u))
    assert many.shape == (2, 5)
    each = [equations.rhs(0.0, q[:, k], u[:, k]) for k in range(5)]
    np.testing.assert_array_equal(many, np.transpose(each))  # type: ignore[arg-type]


def test_lagrange_with_multipliers() -> None:
    """A particle on a circle, x² + y² = 1: ẍ has the closed form −g e_y + λ r, λ = g y − |v|²."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    P.set_vel(N, x.diff() * N.x + y.diff() * N.y)
    particle = Particle("P", P, M1)
    particle.potential_energy = M1 * G * y
    method = LagrangesMethod(Lagrangian(N, particle), [x, y], hol_coneqs=[x**2 + y**2 - 1], frame=N)
    method.form_lagranges_equations()
    equations = equations_from_sympy(method, parameters={M1: 2.0, "g": 9.81})
    angle, rate = 0.7, 1.3
    q = np.array([np.cos(angle), np.sin(angle)])
    u = rate * np.array([-q[1], q[0]])
    expected = np.array([0, -9.81]) + (9.81 * q[1] - rate**2) * q
    np.testing.assert_allclose(equations.rhs(0.0, q, u), expected, rtol=1e-14)  # type: ignore[arg-type]


def test_driven_torque_is_a_function_of_time() -> None:
    q, u, torque = dynamicsymbols("hinge u T")
    N, O = ReferenceFrame("N"), Point("O")
    O.set_vel(N, 0)
    A = N.orientnew("A", "Axis", (q, N.z))
    A.set_ang_vel(N, u * N.z)
    rotor = RigidBody("R", O, A, M1, (inertia(A, 0, 0, M2), O))
    method = KanesMethod(N, [q], [u], kd_eqs=[q.diff() - u])
    method.kanes_equations([rotor], [(A, torque * N.z)])
    equations = equations_from_sympy(method, parameters={torque: "3*sin(2*t)", "m2": 1.5})
    rhs = equations.rhs(0.4, np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(rhs, [3 * np.sin(0.8) / 1.5], rtol=1e-15)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="T"):
        equations_from_sympy(method, parameters={"m2": 1.5})


def test_bad_methods() -> None:
    method, _ = kane(scaled=False)
    with pytest.raises(InputError, match=r"no value for 'c'.*parameters="):
        equations_from_sympy(method, parameters={k: v for k, v in VALUES.items() if k != "c"})
    with pytest.raises(InputError, match="found dict"):
        equations_from_sympy({})
    q, u = dynamicsymbols("q u")
    unformed = KanesMethod(ReferenceFrame("N"), [q], [u], kd_eqs=[q.diff() - u])
    with pytest.raises(InputError, match=r"kanes_equations\(\)"):
        equations_from_sympy(unformed)


# --- a mechanism's own equations -----------------------------------------------------------------------


def test_symbolic_equations_of_a_pendulum_are_the_textbook_ones() -> None:
    """Of one rod: (m l²/3) θ̈ + c θ̇ + ½ m g l sin θ = 0; SymPy decides the equality."""
    mechanism = dc.Mechanism(
        [dc.rod("rod", "m1", "l1", along="-y")],
        [dc.revolute("theta", "ground", "rod", "z", damping="c")],
        gravity=(0, "-g", 0),
        parameters=VALUES,
    )
    equations = symbolic_equations(mechanism)
    m, l, g, c = (symbol_of(name) for name in ("m1", "l1", "g", "c"))
    theta, rate = symbol_of("q.theta"), symbol_of("u.theta")
    assert sp.simplify(equations.M[0, 0] - m * l**2 / 3) == 0
    assert sp.simplify(equations.h[0] - c * rate - m * g * l * sp.sin(theta) / 2) == 0
    text = equations.latex()
    for part in (r"\frac{l_{1}^{2} m_{1}}{3}", r"\ddot{q}_{\text{theta}}", "= 0"):
        assert part in text


@pytest.mark.parametrize("simplify", [True, False])
def test_symbolic_equations_have_the_values_of_the_mechanism(simplify: bool) -> None:
    mechanism = double_pendulum(
        forces=[
            dc.forces.joint_torque("motor", "elbow"),
            dc.forces.spring_damper(
                "cord", "ground", "lower", point1=(1, 0, 0), stiffness=3.0, length=0.4
            ),
        ]
    )
    equations = symbolic_equations(mechanism, simplify=simplify)
    sample = random_state(mechanism, np.random.default_rng(1))
    system = trace(mechanism)
    M, udot = sample.evaluate(system, crba(system), forward(system).udot)
    point = {symbol_of(name): value for name, value in VALUES.items()}
    point |= {symbol_of("input.motor"): 0.0, symbol_of("t"): 0.0}
    point |= {symbol_of(f"q.{c}"): v for c, v in zip(equations.coordinates, sample.q, strict=True)}
    point |= {symbol_of(f"u.{s}"): v for s, v in zip(equations.speeds, sample.u, strict=True)}
    found_M = np.array(equations.M.subs(point).evalf(), dtype=float)
    found_h = np.array(equations.h.subs(point).evalf(), dtype=float)
    np.testing.assert_allclose(found_M, M, rtol=1e-12)
    np.testing.assert_allclose(found_M @ udot + found_h, 0, atol=1e-12)
    assert r"\tau_{\text{motor}}" in equations.latex()


def test_symbolic_equations_with_a_constraint() -> None:
    """A particle on the unit circle: G = (x, y)/|…| up to a factor, γ its centripetal part."""
    mechanism = dc.Mechanism(
        [dc.bodies.frame("carriage"), dc.point_mass("bead", 2.0)],
        [
            dc.prismatic("x", "ground", "carriage", "x"),
            dc.prismatic("y", "carriage", "bead", "y"),
        ],
        constraints=[dc.constraints.holonomic("circle", "q.x**2 + q.y**2 - 1")],
    )
    equations = symbolic_equations(mechanism)
    x, y, u, v = (symbol_of(name) for name in ("q.x", "q.y", "u.x", "u.y"))
    assert sp.Matrix([[2 * x, 2 * y]]) - equations.G == sp.zeros(1, 2)
    assert sp.expand(equations.gamma[0] - 2 * u**2 - 2 * v**2) == 0
    assert r"\lambda" in equations.latex()


def test_symbolic_equations_of_a_large_mechanism_are_refused() -> None:
    bodies = [dc.bodies.sphere(f"b{k}", 1.0, 0.1) for k in range(9)]
    joints = [dc.revolute(f"j{k}", f"b{k - 1}" if k else "ground", f"b{k}") for k in range(9)]
    with pytest.raises(InputError, match="9 free speeds"):
        symbolic_equations(dc.Mechanism(bodies, joints))


def test_symbolic_quaternions_have_speeds_of_their_own() -> None:
    equations = symbolic_equations(
        dc.Mechanism(
            [dc.body("top", 1.0, [1, 2, 2.5])], [dc.joints.spherical("ball", "ground", "top")]
        )
    )
    w = [symbol_of(f"u.ball.w{c}") for c in "xyz"]
    # Euler's equations: I ω̇ + ω × I ω = 0.
    expected = [w[1] * w[2] / 2, -sp.Rational(3, 2) * w[0] * w[2], w[0] * w[1]]
    assert [sp.simplify(a - b) for a, b in zip(equations.h, expected, strict=True)] == [0, 0, 0]
    assert r"\dot{q}" not in equations.latex()


def test_numbers_by_casadi_and_by_sympy_agree() -> None:
    """The compiled right side against SymPy's own substitution."""
    method, (alpha, beta) = kane(scaled=True)
    equations = equations_from_sympy(
        method, {"shoulder": alpha, "elbow": beta - alpha}, parameters=VALUES
    )
    q, u = np.array([0.3, -0.8]), np.array([1.1, 0.4])
    point = dict(zip([*method.q, *method.u], [*q, *u], strict=True))
    point |= {s: VALUES[s.name] for s in (M1, M2, L1, L2, G, C)}
    M = np.array(method.mass_matrix.subs(point).evalf(), dtype=float)
    f = np.array(method.forcing.subs(point).evalf(), dtype=float)
    np.testing.assert_allclose(equations.rhs(0.0, q, u), np.linalg.solve(M, f)[:, 0], rtol=1e-12)  # type: ignore[arg-type]
