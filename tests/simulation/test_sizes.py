"""Tolerances know no units: a solver takes the same steps, whatever the motion is measured in."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from deltac.simulation.solvers import Options

SOLVERS: list[Options] = [
    *(dc.solvers.Scipy(name, 1e-6) for name in ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")),
    *(dc.solvers.Sundials(name, 1e-6) for name in ("CVODES", "IDAS")),
    dc.solvers.Taylor(1e-6),
]
GM = 3.986004418e14
R = 7e6
"""Of a satellite in a low orbit: its period is 2π √(R³/GM), its kinetic energy 2.8e12 J at 1e5 kg."""


def orbit(mass: float, length: float) -> tuple[dc.Mechanism, dc.State, float]:
    """An ellipse of 0.1, in a unit of mass and one of length; from perigee, and its period in s."""
    gm, m, r = GM / length**3, 1e5 / mass, R / length
    pull = f"*{gm * m!r}/(q.x**2 + q.y**2)**1.5"
    mechanism = dc.Mechanism(
        [dc.bodies.frame("carrier"), dc.point_mass("satellite", m)],
        [
            dc.prismatic("x", "ground", "carrier", "x"),
            dc.prismatic("y", "carrier", "satellite", "y"),
        ],
        [
            dc.forces.joint_torque("fx", "x", f"-q.x{pull}"),
            dc.forces.joint_torque("fy", "y", f"-q.y{pull}"),
        ],
    )
    state = mechanism.state({"x": 0.9 * r}, {"y": np.sqrt(gm / r * 1.1 / 0.9)})
    return mechanism, state, 2 * np.pi * np.sqrt(R**3 / GM)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_the_unit_of_mass_and_length_changes_no_step(solver: Options) -> None:
    """By powers of two every number is the same to the last bit, but for its exponent.

    Newton's methods stop by numbers of their own; their steps differ slightly.
    """
    mechanism, state, period = orbit(1.0, 1.0)
    run = dc.simulate(mechanism, state, period, None, solver)
    mass, length = 2.0**40, 2.0**23
    other = dc.simulate(*orbit(mass, length), None, solver)
    flow, same = (r.integrals["liu-huston"] for r in (run, other))
    if solver.name in ("Radau", "BDF", "IDAS"):  # type: ignore[attr-defined]
        assert len(other) == pytest.approx(len(run), rel=0.02)
        np.testing.assert_allclose(run.q[-1], other.q[-1] * length, rtol=0, atol=1e-4 * R)
        np.testing.assert_allclose(flow[-1], same[-1] * mass * length**2, rtol=0, atol=1e-4 * 3e12)
    else:
        assert run.t.tobytes() == other.t.tobytes()
        assert run.q.tobytes() == (other.q * length).tobytes()
        assert flow.tobytes() == (same * mass * length**2).tobytes()


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_integrals_cost_few_steps_and_the_orbit_closes(solver: Options) -> None:
    """Kepler: after a period the satellite is where it was; testing functions of 1e12 J are no burden."""
    mechanism, state, period = orbit(1.0, 1.0)
    run = dc.simulate(mechanism, state, period, None, solver)
    alone = dc.simulate(mechanism, state, period, None, solver, record=[])
    assert len(run) <= 4 * len(alone)
    assert np.hypot(*(run.q[-1] - state.q)) < 1e-3 * R
    assert run.provenance.energy_error is not None
    assert run.provenance.energy_error < 1e-3 * 3e12


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_what_rests_needs_no_steps(solver: Options) -> None:
    """A body of 1e6 kg in equilibrium: forces of 1e7 N cancel but for rounding, which is not followed."""
    resting = dc.Mechanism(
        [dc.point_mass("block", 1e6)],
        [dc.prismatic("z", "ground", "block", "z", stiffness=3e7, rest=0.1)],
        gravity=(0, 0, -9.81),
    )
    run = dc.simulate(resting, resting.state({"z": 0.1 - 9.81e6 / 3e7}), 10.0, None, solver)
    assert len(run) <= 201 and np.ptp(run.q) < 1e-6


@pytest.mark.parametrize("name", ["RK45", "DOP853", "LSODA"])
def test_a_satellite_s_attitude_is_not_followed_below_rounding(name: str) -> None:
    """Kilometres a second times kilograms turn a small body by rounding alone, 1e-7 rad/s².

    By hand: the circle closes after its period, and the body turns at the rate that it had.
    """
    mass, spin = 100.0, 2e-3
    satellite = dc.Mechanism(
        [dc.bodies.sphere("satellite", mass, 0.5)],
        [dc.free("base", "satellite")],
        [
            dc.forces.force_field(
                "earth", "satellite", potential=f"-{mass * GM!r}/sqrt(x**2 + y**2 + z**2)"
            )
        ],
    )
    start = satellite.state({"base.x": R}, {"base.vy": np.sqrt(GM / R), "base.wz": spin})
    period = 2 * np.pi * np.sqrt(R**3 / GM)
    run = dc.simulate(satellite, start, period, None, dc.solvers.Scipy(name, 1e-9))
    assert len(run) < 2000
    assert np.abs(run.q[-1, :3] - [R, 0, 0]).max() < 1e-5 * R
    turned = 2 * np.arctan2(run.coordinate("base.qz")[-1], run.coordinate("base.qw")[-1])
    assert abs(np.angle(np.exp(1j * (turned - spin * period)))) < 1e-3
