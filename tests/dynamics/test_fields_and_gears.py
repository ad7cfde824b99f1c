"""Force fields and gears against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.mechanism.scene import Constraint

GM = 3.986004418e14


def particle(*forces: object, mass: float = 2.0) -> dc.Mechanism:
    return dc.Mechanism(
        [dc.bodies.sphere("ball", mass, 0.1)],
        [dc.free("base", "ball")],
        list(forces),  # type: ignore[arg-type]
    )


def test_a_satellite_in_the_field_of_a_distant_mass() -> None:
    """Kepler: from perigee a (1 − e), half a period later apogee a (1 + e), at the angle π."""
    a, e = 8e6, 0.2
    field = dc.forces.force_field(
        "earth", "ball", potential=f"-{2.0 * GM!r}/sqrt(x**2 + y**2 + z**2)"
    )
    model = particle(field)
    speed = np.sqrt(GM / a * (1 + e) / (1 - e))
    start = model.state({"base.x": a * (1 - e)}, {"base.vy": speed})
    half = np.pi * np.sqrt(a**3 / GM)
    run = dc.simulate(model, start, half, None, dc.solvers.Scipy("DOP853", 1e-11))
    np.testing.assert_allclose(run.q[-1, :3], [-a * (1 + e), 0, 0], atol=1e-8 * a)
    ledger = dc.balance(model, run)
    energy = -GM * 2.0 / (2 * a)
    assert ledger.kinetic[-1] + ledger.potential_energy[-1] == pytest.approx(energy, rel=1e-9)
    assert ledger.relative("wang") < 1e-9


def test_a_charge_in_a_magnetic_field() -> None:
    """F = q v × B: a circle of radius m v/(q B), passed in 2π m/(q B); no work is done."""
    charge, B, m, v = 0.5, 1.2, 2.0, 3.0
    field = dc.forces.force_field("magnet", "ball", [f"{charge * B}*vy", f"-{charge * B}*vx", 0.0])
    model = particle(field, mass=m)
    period = 2 * np.pi * m / (charge * B)
    start = model.state({}, {"base.vx": v})
    run = dc.simulate(model, start, period, period / 400, "ode8")
    radius = m * v / (charge * B)
    np.testing.assert_allclose(run.q[200, :2], [0.0, -2 * radius], atol=1e-9)
    np.testing.assert_allclose(run.q[-1, :2], [0.0, 0.0], atol=1e-9)
    assert np.abs(dc.balance(model, run).work["applied magnet"]).max() < 1e-9


def test_a_field_of_a_body_acts_on_it_with_the_opposite_force() -> None:
    """Two free bodies that attract each other: momentum and angular momentum are constant, and energy."""
    pair = dc.Mechanism(
        [dc.bodies.sphere("star", 5.0, 0.2), dc.bodies.sphere("planet", 1.0, 0.1)],
        [dc.free("s", "star"), dc.free("p", "planet")],
        [
            dc.forces.force_field(
                "pull", "planet", potential="-3/sqrt(x**2 + y**2 + z**2)", on="star"
            )
        ],
    )
    start = pair.state({"p.x": 1.0}, {"p.vy": 1.5, "p.vz": 0.3, "s.wz": 2.0, "s.wx": 1.0})
    run = dc.simulate(pair, start, 3.0, 1e-2, "ode8")
    at = {n: k for k, n in enumerate(run.speeds)}
    v_s, v_p = (run.u[:, [at[f"{b}.v{axis}"] for axis in "xyz"]] for b in "sp")
    x_s, x_p = (run.q[:, [run.coordinates.index(f"{b}.{axis}") for axis in "xyz"]] for b in "sp")
    momentum = 5.0 * v_s + v_p
    np.testing.assert_allclose(momentum - momentum[0], 0.0, atol=1e-10)
    orbital = 5.0 * np.cross(x_s, v_s) + np.cross(x_p, v_p)
    np.testing.assert_allclose(orbital - orbital[0], 0.0, atol=1e-9)
    assert dc.balance(pair, run).relative("wang") < 1e-10


def test_fields_that_are_none() -> None:
    with pytest.raises(InputError, match="give force="):
        dc.forces.force_field("f", "ball")
    with pytest.raises(InputError, match="give force="):
        dc.forces.force_field("f", "ball", [1, 0, 0], potential="x")
    with pytest.raises(InputError, match="vx"):
        particle(dc.forces.force_field("f", "ball", potential="vx*x"))
    with pytest.raises(InputError, match="'r'"):
        particle(dc.forces.force_field("f", "ball", ["r", 0, 0]))
    with pytest.raises(InputError, match="'ball'"):
        dc.forces.force_field("f", "ball", ["x", 0, 0], on="ball")


# --- gears ------------------------------------------------------------------------------------------

INERTIA = {"a": 0.3, "b": 0.7, "c": 0.2}


def shafts(constraint: Constraint, torque: str) -> dc.Mechanism:
    """Three shafts about z with inertias of 0.3, 0.7, 0.2 kg·m²; 1 N·m on one of them."""
    return dc.Mechanism(
        [dc.body(n, 1.0, inertia=(1.0, 1.0, i)) for n, i in INERTIA.items()],
        [dc.revolute(f"q{n}", "ground", n) for n in INERTIA],
        [dc.forces.joint_torque("motor", torque, 1.0)],
        constraints=[constraint],
    )


def accelerations(model: dc.Mechanism) -> np.ndarray:
    run = dc.simulate(model, model.state(), 1.0, 0.1, "ode4")
    assert run.udot is not None
    np.testing.assert_allclose(run.u[-1], run.udot[0], rtol=1e-9, atol=1e-12)
    return np.asarray(run.udot[0])


@pytest.mark.parametrize("crossed", [False, True])
def test_a_belt(crossed: bool) -> None:  # noqa: FBT001
    """I α = 1 with the reflected inertia I_a + I_b (r_a/r_b)²."""
    model = shafts(dc.constraints.belt("belt", "qa", 0.1, "qb", 0.25, crossed=crossed), "qa")
    a = 1.0 / (0.3 + 0.7 * 0.4**2)
    np.testing.assert_allclose(accelerations(model), [a, (-0.4 if crossed else 0.4) * a, 0.0])


def test_bevel_gears_turn_in_opposite_senses() -> None:
    model = shafts(dc.constraints.bevel_gear("mesh", "qa", 15, "qb", 45), "qa")
    a = 1.0 / (0.3 + 0.7 / 9)
    np.testing.assert_allclose(accelerations(model), [a, -a / 3, 0.0])


def test_a_differential_divides_the_torque() -> None:
    """Lagrange by hand: q_c = (q_a + q_b)/2, so that half of the carrier's torque is at either side."""
    model = shafts(dc.constraints.differential("axle", "qa", "qb", "qc"), "qc")
    M = np.array([[0.3 + 0.2 / 4, 0.2 / 4], [0.2 / 4, 0.7 + 0.2 / 4]])
    a, b = np.linalg.solve(M, [0.5, 0.5])
    np.testing.assert_allclose(accelerations(model), [a, b, (a + b) / 2])


def test_a_planetary_gear_with_its_ring_held() -> None:
    """Willis: sun by carrier is 1 + z_ring/z_sun = 4.5 where the ring stands."""
    model = dc.Mechanism(
        [dc.body(n, 1.0, inertia=(1.0, 1.0, i)) for n, i in INERTIA.items()],
        [
            dc.revolute("sun", "ground", "a"),
            dc.revolute("ring", "ground", "b", motion="0"),
            dc.revolute("carrier", "ground", "c"),
        ],
        [dc.forces.joint_torque("motor", "sun", 1.0)],
        constraints=[dc.constraints.differential("set", "sun", "ring", "carrier", 70 / 20)],
    )
    a = 1.0 / (0.3 + 0.2 / 4.5**2)
    np.testing.assert_allclose(accelerations(model)[[0, 2]], [a, a / 4.5])
