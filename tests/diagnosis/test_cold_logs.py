"""What an outside examiner's logs were misjudged for: each by its principle, on another machine.

The oracle is a chain of masses on springs with hand-written equations.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.measurements.digits import digits_of
from deltac.trajectories.formats.floating import floating_base, packed

pytestmark = pytest.mark.case_study

N, MASS, SPRING, CUBIC = 3, 0.5, 80.0, 900.0


def chain(damping: float, torque: bool = False) -> dc.Mechanism:
    """Masses on a line, each on a spring to the one before."""
    return dc.Mechanism(
        [dc.point_mass(f"p{i}", MASS) for i in range(N)],
        [
            dc.prismatic(f"s{i}", f"p{i - 1}" if i else "ground", f"p{i}", damping=damping)
            for i in range(N)
        ],
        forces=[
            *(
                dc.forces.joint_spring(
                    f"k{i}", f"s{i}", torque=f"-{SPRING}*q.s{i} - {CUBIC}*q.s{i}**3"
                )
                for i in range(N)
            ),
            *([dc.forces.joint_torque("motor", "s0")] if torque else []),
        ],
    )


def accelerations(q: Array, u: Array, damping: float, force: float = 0.0) -> Array:
    """Of the extensions q, by the tensions in the springs."""
    tension = SPRING * q + CUBIC * q**3 + damping * u
    tension[0] -= force
    absolute = (np.append(tension[1:], 0.0) - tension) / MASS
    return np.diff(absolute, prepend=0.0)


Force = Callable[[float], float]


def leapfrog(damping: float, h: float = 4e-3, rows: int = 500) -> dict[str, Array]:
    """Coordinates of full steps beside speeds of half steps, as the method has them."""
    q, u = np.array([0.3, 0.1, -0.1]), np.zeros(N)
    u = u - 0.5 * h * accelerations(q, u, damping)
    made = []
    for _ in range(rows):
        made.append((q, u))
        u = u + h * accelerations(q, u, damping)
        q = q + h * u
    return table(h, made)


def rk4(damping: float, force: Force, h: float = 4e-3, rows: int = 500) -> dict[str, Array]:
    def rate(t: float, y: Array) -> Array:
        return np.concatenate([y[N:], accelerations(y[:N], y[N:], damping, force(t))])

    y, made = np.array([0.3, 0.1, -0.1, 0.0, 0.0, 0.0]), []
    for k in range(rows):
        t = k * h
        made.append((y[:N], y[N:]))
        a = rate(t, y)
        b = rate(t + h / 2, y + h / 2 * a)
        c = rate(t + h / 2, y + h / 2 * b)
        d = rate(t + h, y + h * c)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
    return table(h, made) | {
        "force.actuator motor.s0": np.array([force(k * h) for k in range(rows)])
    }


def table(h: float, made: list[tuple[Array, Array]]) -> dict[str, Array]:
    columns: dict[str, Array] = {"time": h * np.arange(len(made), dtype=float)}
    for k, letter in enumerate("qu"):
        columns |= {f"{letter}.s{i}": np.array([row[k][i] for row in made]) for i in range(N)}
    return columns


def test_dampers_of_all_joints_that_are_wrong_are_no_integration_error() -> None:
    """An integrator takes off what one joint's damper leaves, and what all of them leave is its work."""
    found = dc.audit(chain(0.05), leapfrog(0.3))
    assert found.verdict.kind in ("equation-error", "unresolved")
    assert dc.audit(chain(0.3), leapfrog(0.3)).verdict.kind == "integration-error"


def test_two_episodes_in_one_log_are_told() -> None:
    one = rk4(0.05, lambda t: 3.0 * np.sin(2.0 * t))
    h, rows = one["time"][1], len(one["time"])
    both = {name: np.concatenate([x, x]) for name, x in one.items()}
    both["time"] = h * np.arange(2 * rows)
    model = chain(0.05, torque=True)
    verdict = dc.audit(model, both).verdict
    assert verdict.kind == "unresolved"
    assert [f.kind for f in verdict.findings if f.weight == "doubt"] == ["jump"]
    assert dc.audit(model, one).verdict.kind == "consistent"


def test_a_force_of_few_values_is_commanded_so() -> None:
    """Switched between ±2 N it has one decimal, and is exact; in a log of four decimals nothing is."""
    log = rk4(0.05, lambda t: 2.0 if np.sin(5.0 * t) > 0.0 else -2.0 * (t > 0.0))
    model, motor = chain(0.05, torque=True), "force actuator motor"
    found = dc.audit(model, log)
    assert digits_of(found.run)[motor].half().max() < 1e-12
    # It is switched between the stages of a step, and no contact is missing there.
    assert "missing-contact" not in [f.kind for f in found.findings]
    rounded = {name: x if name == "time" else np.round(x, 4) for name, x in log.items()}
    assert digits_of(dc.audit(model, rounded).run)[motor].half().max() > 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_time_stamps_that_scatter_by_more_than_half_a_step_are_put_back(seed: int) -> None:
    log = leapfrog(0.05)
    h = log["time"][1]
    scattered = log["time"] + 0.12 * h * np.random.default_rng(seed).standard_normal(500)
    assert np.ptp(np.diff(scattered)) > 0.5 * h
    found = dc.audit(chain(0.05), log | {"time": scattered})
    assert "clock-jitter" in [f.kind for f in found.findings]
    assert found.verdict.kind == dc.audit(chain(0.05), log).verdict.kind


def test_wheels_beside_a_floating_body_are_not_its_place() -> None:
    """Angles and speeds of three wheels fit each other better than those of a body that is measured."""
    t = np.linspace(0.0, 4.0, 401)
    angle = 0.5 * t**2
    zero = 0.0 * t
    place = np.stack([np.sin(9.0 * t), 0.3 * np.cos(7.0 * t), 0.2 * np.sin(5.0 * t)], axis=1)
    speed = np.stack([9 * np.cos(9 * t), -2.1 * np.sin(7 * t), np.cos(5 * t)], axis=1)
    quaternion = np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=1)
    turning = np.stack([zero, zero, t], axis=1)
    wheels, rates = (
        np.stack([t, 2 * t, -t], axis=1),
        np.stack([zero + 1, zero + 2, zero - 1], axis=1),
    )
    columns = np.hstack([place, quaternion, wheels, speed, turning, rates]).T
    table = {f"column {k}": values for k, values in enumerate(columns)}
    layouts = list(packed(list(table)[:10], list(table)[10:]))
    found = floating_base(t, table, layouts)
    assert found is not None and found.usual and found.layout == layouts[0]


def pendulum(place: tuple[float, float, float], spring: float | None = None) -> dc.Mechanism:
    """A rod on a cart, whose mass centre may be elsewhere, on a spring or not."""
    return dc.Mechanism(
        [dc.point_mass("cart", 1.2), dc.body("pole", 0.3, (0.004,) * 3, place)],
        [
            dc.prismatic("x", "ground", "cart", "x", damping=0.3),
            dc.revolute("th", "cart", "pole", damping=0.003, stiffness=spring),
        ],
        gravity=(0.0, -9.81, 0.0),
    )


@pytest.mark.parametrize("offset", [0.04, -0.1])
@pytest.mark.parametrize("accelerations", [True, False])
def test_a_mass_centre_that_is_turned_is_an_encoders_zero(
    offset: float, accelerations: bool
) -> None:
    """Both leave the same: one number, of the log, comes before two of the model."""
    model = pendulum((0.0, 0.25, 0.0))
    run = dc.simulate(model, model.state({"th": 0.6}), 2.0, 5e-3)
    log = {"time": run.t, "q.x": run.q[:, 0], "q.th": run.q[:, 1] + offset}
    log |= {"u.x": run.u[:, 0], "u.th": run.u[:, 1]}
    if accelerations:
        assert run.udot is not None
        log |= {"udot.x": run.udot[:, 0], "udot.th": run.udot[:, 1]}
    found = dc.audit(model, log)
    (zero,) = [f for f in found.findings if f.kind == "zero-offset"]
    assert zero.element == "th" and zero.factor == pytest.approx(offset, abs=1e-6)
    # What it was taken off is right.
    assert found.verdict.kind == "consistent" and not found.causes
    longer = dc.audit(pendulum((0.0, 0.26, 0.0)), log | {"q.th": run.q[:, 1]})
    assert [f.kind for f in longer.findings if f.weight == "doubt"] == []


def test_a_spring_tells_a_zero_from_a_mass_centre() -> None:
    """Turned by 0.04 rad about the joint, the mass centre leaves the spring where it is."""
    turned = (0.25 * np.sin(0.04), 0.25 * np.cos(0.04), 0.0)
    moved = pendulum(turned, spring=2.0)
    run = dc.simulate(moved, moved.state({"th": 0.6}), 2.0, 5e-3)
    log = {"time": run.t, "q.x": run.q[:, 0], "q.th": run.q[:, 1]}
    log |= {"u.x": run.u[:, 0], "u.th": run.u[:, 1]}
    causes = [
        f for f in dc.audit(pendulum((0.0, 0.25, 0.0), 2.0), log).findings if f.weight == "cause"
    ]
    assert "body-centre" in {causes[0].kind, *(kind for kind, _ in causes[0].equals)}
