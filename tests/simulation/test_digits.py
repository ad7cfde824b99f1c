"""Accelerations with few digits are told, those without any refused, and honest ones left alone."""

from __future__ import annotations

import warnings
from contextlib import suppress

import casadi as ca
import mpmath
import numpy as np
import pytest

import deltac as dc
from deltac.dynamics.digits import acceleration_error, condition
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.kernels import to_mpmath
from deltac.problems import load
from deltac.simulation.flow import build_flow


def carried(light: float, apart: float = 1e-6) -> dc.Mechanism:
    """Two hinges close to each other: a body of `light` kg between the ground and one of a kilogram."""
    bodies = [
        dc.body("light", light, mass_centre=(0.3, 0.1, 0.0), inertia=(light, light, light)),
        dc.body("heavy", 1.3, mass_centre=(0.2, -0.4, 0.0), inertia=(0.1, 0.2, 0.3)),
    ]
    joints = [
        dc.revolute("j", "ground", "light", axis="z"),
        dc.revolute("k", "light", "heavy", position=(apart, 0.0, 0.0), axis="z"),
    ]
    return dc.Mechanism(bodies, joints, gravity=(0.0, -9.81, 0.0))


def error(light: float) -> float:
    motion = equations_of_motion(carried(light))
    return acceleration_error(motion, (), 0.0, np.array([0.3, 0.4]), np.array([1.0, 2.0]))


def test_the_condition_is_that_of_the_scaled_matrices() -> None:
    M = np.diag([1e-12, 1.0, 1e9])
    assert condition(M, np.zeros((0, 3))) == pytest.approx(1.0)
    tied = np.array([[1e6, 0.0, 0.0], [0.0, 1.0, 0.0]])  # at right angles in the mass metric
    assert condition(M, tied) == pytest.approx(1.0)
    # Rows at an angle ε have the Gram matrix [[1, cos ε], [cos ε, 1]], of condition 4/ε².
    close = np.array([[1.0, 0.0], [np.cos(1e-2), np.sin(1e-2)]])
    assert condition(np.eye(2), close) == pytest.approx(4e4, rel=1e-3)


def test_errors_are_looked_at_where_the_condition_is_large() -> None:
    assert error(1.0) == 0.0
    assert 0.0 < error(1e-9) < 1e-6 < condition_of(1e-9) * 2.0**-53 * 1e3


def condition_of(light: float) -> float:
    motion = equations_of_motion(carried(light))
    M, _, _, G, _ = motion.ties(0.0, np.array([0.3, 0.4]), np.zeros(2), ())
    return condition(M, G)


def test_it_is_told_and_then_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = carried(1e-15)
    start = mechanism.state({"j": 0.3, "k": 0.4}, {"j": 1.0, "k": 2.0})
    # The recursions lose few digits of so small a mechanism; the campaign has worse ones.
    monkeypatch.setattr("deltac.simulation.arguments.INACCURATE", 1e-13)
    for _ in range(2):  # also of a start that was looked at before
        with pytest.warns(dc.IllConditionedWarning, match="'j'"):
            dc.simulate(mechanism, start, 1e-3, 1e-3)
    found = dc.study(mechanism, start, 2e-3, [1e-3, 5e-4])
    assert [f.weight for f in found.findings if f.code == "F-ILL-CONDITIONED"] == ["doubt"]
    monkeypatch.setattr("deltac.simulation.arguments.WORTHLESS", 1e-13)
    with pytest.raises(InputError, match="no correct digit") as caught:
        dc.simulate(mechanism, start, 1e-3, 1e-3)
    assert caught.value.code == "E-STATE"


def test_honest_mechanisms_are_left_alone() -> None:
    for name in ("triple-pendulum", "n-four-bar"):
        problem = load(name)
        with warnings.catch_warnings():
            warnings.simplefilter("error", dc.IllConditionedWarning)
            dc.simulate(problem.mechanism, problem.state, 1e-3, 1e-3)


def test_an_equilibrium_has_its_digits() -> None:
    """There the accelerations vanish, and rounding alone is left of them."""
    motion = equations_of_motion(carried(1e-12))
    found = acceleration_error(motion, (), 0.0, np.zeros(2), np.zeros(2))
    assert found < 1e-6


def by_newton(light: float, q: list[float], u: list[float]) -> list[mpmath.mpf]:
    """u̇ of `carried` by Newton's and Euler's laws in a fixed frame, Σ Jᵀ(m a + m J̇u − m g) = 0."""
    a, b = (mpmath.mpf(x) for x in q)
    wa, wb = mpmath.mpf(u[0]), mpmath.mpf(u[0]) + mpmath.mpf(u[1])

    def turned(angle: mpmath.mpf, x: float, y: float) -> mpmath.matrix:
        c, s = mpmath.cos(angle), mpmath.sin(angle)
        return mpmath.matrix([c * x - s * y, s * x + c * y])

    def across(r: mpmath.matrix) -> mpmath.matrix:
        return mpmath.matrix([-r[1], r[0]])

    near, knee, far = turned(a, 0.3, 0.1), turned(a, 1e-6, 0.0), turned(a + b, 0.2, -0.4)
    M, f = mpmath.zeros(2), mpmath.zeros(2, 1)
    for mass, inertia, arms, turns, drawn in (
        (light, light, (near, mpmath.zeros(2, 1)), (1, 0), -(wa**2) * near),
        (1.3, 0.3, (knee + far, far), (1, 1), -(wa**2) * knee - wb**2 * far),
    ):
        J = [across(arm) for arm in arms]
        force = mpmath.matrix([0, -mpmath.mpf(9.81)]) - drawn
        for i in range(2):
            f[i] += mass * (J[i].T * force)[0]
            for j in range(2):
                M[i, j] += mass * (J[i].T * J[j])[0] + mpmath.mpf(inertia) * turns[i] * turns[j]
    return list(mpmath.lu_solve(M, f))


@pytest.mark.parametrize("light", [1.0, 1e-12])
def test_the_digits_are_those_of_newtons_laws(light: float) -> None:
    """But for products of constants, folded by CasADi in double precision: a few units of its last place."""
    q, u = [0.3, 0.4], [1.0, 2.0]
    flow = build_flow(carried(light), ())
    f = ca.Function("f", [flow.t, flow.x, flow.inputs], [ca.densify(flow.xdot)])
    with mpmath.workdps(60):
        [found] = to_mpmath(f, [0.0, [*q, *u], []])
        for ours, theirs in zip(found[2:], by_newton(light, q, u)):
            assert abs(ours - theirs) < 4 * np.finfo(float).eps * abs(theirs)


def test_every_operation_is_that_of_arithmetic() -> None:
    """Identities that hold exactly, one for each operation that can be known wrongly."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    zero = [
        ca.sin(x) ** 2 + ca.cos(x) ** 2 - 1,
        ca.tan(x) * ca.cos(x) - ca.sin(x),
        ca.sin(ca.asin(x)) - x,
        ca.cos(ca.acos(x)) - x,
        ca.tan(ca.atan2(x, y)) * y - x,
        ca.tan(ca.atan(y)) - y,
        ca.exp(ca.log(y)) - y,
        ca.expm1(x) - ca.exp(x) + 1,
        ca.log1p(x) - ca.log(1 + x),
        ca.cosh(x) ** 2 - ca.sinh(x) ** 2 - 1,
        ca.sinh(ca.asinh(y)) - y,
        ca.cosh(ca.acosh(y)) - y,
        ca.tanh(ca.atanh(x)) - x,
        ca.hypot(x, y) ** 2 - x * x - y * y,
        ca.sqrt(y) ** 2 - y,
        y**1.5 - y * ca.sqrt(y),
        ca.fmax(x, y) - y,
        ca.fmin(x, y) - x,
        ca.fabs(-x) - x,
        ca.sign(-x) + 1,
        ca.if_else(x < y, x, y) - x,
    ]
    f = ca.Function("f", [x, y], [ca.vertcat(*zero)])
    with mpmath.workdps(60):
        [found] = to_mpmath(f, [0.37, 1.9])
        assert max(abs(value) for value in found) < mpmath.mpf(10) ** -55


def grain(size: float) -> dc.Mechanism:
    """A ball of `size` m hangs, off its centre, on a free body of a metre."""
    inertia = 0.4 * size**2
    bodies = [
        dc.body("craft", 1.0, inertia=(0.3, 0.4, 0.5)),
        dc.body("grain", 1.0, mass_centre=(0.3 * size, 0.0, size), inertia=(inertia,) * 3),
    ]
    joints = [
        dc.free("f", "craft"),
        dc.joints.spherical("s", "craft", "grain", position=(1.0, 0.5, 0.0)),
    ]
    return dc.Mechanism(bodies, joints, gravity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("size", "fast", "told"), [(1e-9, 1e12, True), (1e-9, 1e6, False), (0.1, 1e3, False)]
)
def test_a_grain_that_moves_fast(size: float, fast: float, *, told: bool) -> None:
    """Accelerations do not depend on a velocity that all share; where rounding makes them, it is told."""
    mechanism = grain(size)

    def start(v: float) -> dc.State:
        turning = {"f.wx": 0.3, "f.wz": 0.5, "s.wy": 0.2}
        return mechanism.state(None, {"f.vx": v, "f.vy": v / 3, **turning})

    still, moving = (dc.evaluate(mechanism, start(v)) for v in (0.0, fast))
    apart = moving.udot - still.udot
    off = np.sqrt(apart @ still.M @ apart / (still.udot @ still.M @ still.udot))
    assert (off > 1e-6) == told
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with suppress(InputError):
            dc.simulate(mechanism, start(fast), 1e-6, 1e-6, "ode4")
            assert [w.category for w in caught] == [dc.IllConditionedWarning] * told
