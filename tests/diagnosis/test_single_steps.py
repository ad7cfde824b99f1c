"""What a known integrator leaves of single steps: where rows are missing, of the first ones, beside a cause.

The oracle is a cart-pole with hand-written equations and integrators; its wall and its rotor are planted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.residuals.one_step import one_step
from tests.systems.cart_pole import CartPole, log

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()


@dataclass(frozen=True)
class Walled(CartPole):
    """A spring of 2000 N·m/rad pushes the pole back above an angle."""

    wall: float = 0.0

    def acceleration(self, t: float, q: Array, u: Array, force: float | None = None) -> Array:
        free = super().acceleration(t, q, u, force)
        if q[1] <= self.wall:
            return free
        m, l, theta = self.pole, self.length, float(q[1])
        a, b, c = self.cart + m, -m * l * np.sin(theta), self.inertia + m * l**2
        return free - 2000.0 * (theta - self.wall) * np.array([-b, a]) / (a * c - b * b)


def lacking(run: dc.Trajectory, share: float = 0.6) -> dc.Trajectory:
    """Some of the rows, at random."""
    count = len(run)
    kept = np.sort(np.random.default_rng(1).choice(count, int(share * count), replace=False))
    return replace(
        run, t=run.t[kept], q=run.q[kept], u=run.u[kept], udot=None,
        forces={name: force[kept] for name, force in run.forces.items()},
    )  # fmt: skip


@pytest.mark.parametrize("scheme", ["explicit-euler", "heun", "implicit-euler"])
def test_logs_that_lack_rows_tell_their_integrator(scheme: str) -> None:
    """Six rows in ten leave two thirds of the intervals single steps: they close to rounding."""
    step = one_step(MECHANISM, lacking(log(RIGHT, scheme)))
    assert step is not None and step.scheme is not None and step.closes
    assert step.scheme.name in (scheme, "euler") and step.scheme.defect < 1e-11
    assert not step.local.unclosed.any()
    assert len(step.local.t) < 0.8 * 0.6 * 750


def test_a_wrong_mass_is_named_in_a_log_that_lacks_rows() -> None:
    found = dc.audit(MECHANISM, lacking(log(replace(RIGHT, pole=0.63, length=0.4), "heun")))
    assert found.verdict.kind == "equation-error"
    assert any(f.element == "pole" for f in found.verdict.findings if f.weight == "cause")


def test_a_wall_that_is_left_in_the_first_rows_is_seen() -> None:
    """The log begins in the last five steps of a touch, and ends before the next one."""
    run = log(Walled(wall=0.3), "semi-implicit-euler", step=0.002)
    touching = np.flatnonzero(run.q[:, 1] > 0.3)
    last = int(touching[np.argmax(np.diff(touching) > 1)])
    after = int(touching[touching > last][0])
    part = run.between(float(run.t[last - 4]), float(run.t[after - 2]))
    step = one_step(MECHANISM, part, 0.5)
    assert step is not None and step.closes_mostly
    assert np.flatnonzero(step.standing_out).tolist() == [0, 1, 2, 3, 4]
    found = dc.audit(MECHANISM, part).verdict
    assert found.kind == "equation-error"
    assert "F-MISSING-CONTACT" in {f.code for f in found.findings if f.weight == "cause"}


def damped(system: CartPole, share: float, rotor: float, step: float = 0.002) -> dc.Trajectory:
    """Euler's method with a share of the dampers' forces from the end of a step, and a rotor at the hinge."""
    q, u, rows = np.array([0.1, -0.4]), np.array([0.3, 1.0]), []
    D = np.diag([system.slide, system.hinge])
    for k in range(1000):
        push = float(system.force(k * step))
        rows.append((k * step, q, u, push))
        m, l, theta = system.pole, system.length, float(q[1])
        b, c = -m * l * np.sin(theta), system.inertia + m * l**2 + rotor
        M = np.array([[system.cart + m, b], [b, c]])
        bent = m * l * np.cos(theta)
        f = np.array([push + bent * u[1] ** 2, bent * system.gravity])
        now = M @ u + step * (f - (1.0 - share) * D @ u)
        u = np.linalg.solve(M + share * step * D, now)
        q = q + step * u
    t, q_, u_, f_ = (np.array([row[k] for row in rows]) for k in range(4))
    names = ("slide", "hinge")
    return dc.Trajectory(
        t=t, q=q_, u=u_, coordinates=names, speeds=names,
        forces={"actuator motor": np.column_stack([f_, 0 * f_])},
        provenance=dc.Provenance("own loop"),
    )  # fmt: skip


def test_a_rotor_beside_implicit_damping_is_told_to_rounding() -> None:
    """A third of what the damping adds to the inertia: no integrator takes more than all of that."""
    rotor = 0.3 * 0.002 * RIGHT.hinge
    found = dc.audit(MECHANISM, damped(RIGHT, 1.0, rotor)).verdict
    told = {(f.code, f.element): f.factor for f in found.findings}
    assert told["F-MISSING-ROTOR-INERTIA", "hinge"] == pytest.approx(rotor, rel=1e-6)


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_damping_taken_in_part_from_the_end_is_no_rotor(share: float) -> None:
    system = replace(RIGHT, slide=0.0, hinge=0.2)
    found = dc.audit(system.mechanism(), damped(system, share, 0.0)).verdict
    assert found.kind in ("consistent", "integration-error")
    assert "F-MISSING-ROTOR-INERTIA" not in {f.code for f in found.findings}


def test_a_kick_in_one_step_is_told_from_the_error_of_the_steps() -> None:
    """One interval is too few for a cause; but its energy is not the integrator's."""
    problem = dc.problems.load("double-pendulum")
    mechanism = problem.mechanism
    first = dc.simulate(mechanism, problem.state, 1.0, 1e-3, "ode4")
    kicked = dc.State(float(first.t[-1]), first.q[-1], first.u[-1] + np.array([0.5, 0.0]))
    second = dc.simulate(mechanism, kicked, 1.0, 1e-3, "ode4")
    t, q, u = (
        np.concatenate([a, b[1:]])
        for a, b in zip((first.t, first.q, first.u), (second.t, second.q, second.u))
    )
    run = dc.Trajectory(t=t, q=q, u=u, coordinates=first.coordinates, speeds=first.speeds)
    found = dc.audit(mechanism, run)
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    assert any("t = 1" in sentence for sentence in found.verdict.evidence)
