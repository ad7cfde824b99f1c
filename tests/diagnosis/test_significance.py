"""Small mistakes that many rows make certain, and large ones that act in a few of them.

The runs are by the classical method of Runge and Kutta, written out in the tests.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array
from tests.diagnosis.test_pendulum_logs import rk4

pytestmark = pytest.mark.case_study

G = 9.81

# --- a ball that is in contact in some of the rows ---

MASS, RADIUS, STIFFNESS, DISSIPATION = 0.8, 0.1, 6e3, 0.15


def ball(stiffness: float) -> dc.Mechanism:
    floor = dc.forces.contact(
        "floor",
        dc.shapes.sphere("ball", RADIUS),
        dc.shapes.half_space(),
        stiffness,
        exponent=1.5,
        dissipation=DISSIPATION,
    )
    return dc.Mechanism(
        [dc.bodies.sphere("ball", MASS, RADIUS)],
        [dc.prismatic("height", "ground", "ball", "z")],
        forces=[floor],
        gravity=(0, 0, -G),
    )


def bounces(h: float, rows: int, every: int = 1) -> dc.Trajectory:
    """Hertz's law with the damping of Hunt and Crossley."""

    def rate(q: Array, u: Array) -> Array:
        depth = np.maximum(0.0, RADIUS - q)
        push = STIFFNESS * depth**1.5 * np.maximum(0.0, 1 - DISSIPATION * u)
        return np.asarray(push / MASS - G)

    x = np.empty((rows, 2))
    x[0] = 0.45, 0.0
    for k in range(1, rows):
        x[k] = rk4(rate, x[k - 1, 0], x[k - 1, 1], h)
    x = x[::every]
    return dc.Trajectory(
        t=h * every * np.arange(len(x), dtype=float), q=x[:, :1], u=x[:, 1:],
        coordinates=("height",), speeds=("height",),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("share", "every"),
    [
        pytest.param(0.985, 1, marks=pytest.mark.slow),
        (0.97, 5),
        pytest.param(0.99, 10, marks=pytest.mark.slow),
    ],
)
def test_a_floor_of_another_stiffness_is_told_by_the_rows_in_contact(
    share: float, every: int
) -> None:
    """Heavier in the same share is all that it may be as well: forces per mass are what the rows tell."""
    h, rows = (2e-4, 1800) if every == 1 else (5e-4, 400 * every)
    found = dc.audit(ball(STIFFNESS * share), bounces(h, rows, every))
    assert found.verdict.kind == "equation-error"
    cause = found.causes[0]
    masses = ("body-mass", "body-inertia")
    assert cause.size is not None and cause.kind in ("channel-factor", "contact-stiffness", *masses)
    told = 1.0 / cause.size if cause.kind in masses else cause.size
    # The spring of the floor is told apart from its damping, which is stiffer in the same share.
    assert told - 1.0 == pytest.approx(1.0 / share - 1.0, rel=0.25)
    assert dc.audit(ball(STIFFNESS), bounces(h, rows, every)).verdict.kind != "equation-error"


# --- a hinge whose rows are noisy, or whose motor is driven by noise ---

INERTIA, ARM, DAMPING = 0.3, 0.4, 0.2


def hinge(damping: float) -> dc.Mechanism:
    central = INERTIA - MASS * ARM**2
    return dc.Mechanism(
        [dc.body("rod", mass=MASS, inertia=(central, central, central), mass_centre=(0, 0, -ARM))],
        [dc.revolute("hinge", "ground", "rod", axis="y", damping=damping)],
        forces=[dc.forces.joint_torque("motor", "hinge")],
        gravity=(0, 0, -G),
    )


def acceleration(torque: float, q: Array, u: Array) -> Array:
    return np.asarray((torque - DAMPING * u - MASS * G * ARM * np.sin(q)) / INERTIA)


def driven(torque: Callable[[int], float], h: float, rows: int) -> tuple[Array, Array]:
    x, made = np.empty((rows, 2)), np.zeros(rows)
    x[0] = 0.9, 0.0
    for k in range(rows):
        made[k] = tau = torque(k)
        if k + 1 < rows:
            x[k + 1] = rk4(partial(acceleration, tau), x[k, 0], x[k, 1], h)
    return x, made


def log(x: Array, torque: Array, h: float) -> dc.Trajectory:
    return dc.Trajectory(
        t=h * np.arange(len(x), dtype=float), q=x[:, :1], u=x[:, 1:],
        coordinates=("hinge",), speeds=("hinge",),
        forces={"actuator motor": torque[:, None]}, provenance=dc.Provenance(simulator="by hand", step=h),
    )  # fmt: skip


def test_noise_of_a_command_is_no_noise_of_the_log() -> None:
    """A controller that reads noisy encoders drives with noise, and the log tells what it did."""
    rng = np.random.default_rng(5)
    noise, h = rng.normal(scale=0.3, size=2000), 1e-3
    x, torque = driven(lambda k: 2.0 * np.sin(7.0 * k * h) + noise[k], h, 2000)
    right, wrong = (dc.audit(hinge(DAMPING * share), log(x, torque, h)) for share in (1.0, 1.003))
    assert right.verdict.kind == "consistent" and not right.causes
    cause = wrong.causes[0]
    assert cause.kind == "damping" and cause.size == pytest.approx(DAMPING, rel=1e-6)


@pytest.mark.parametrize("share", [1.0, 1.01])
def test_a_damper_within_the_tolerance_is_found_in_all_rows_if_not_in_few(share: float) -> None:
    """Thousands of noisy rows tell what no sixty of them do."""
    rng, h, rows = np.random.default_rng(7), 1e-3, 4000
    x, torque = driven(lambda k: 2.0 * np.sin(7.0 * k * h), h, rows)
    x = x + 1e-5 * rng.standard_normal(x.shape)
    found = dc.audit(hinge(DAMPING * share), log(x, torque, h))
    told = [f.kind for f in found.findings]
    if share == 1.0:
        assert found.verdict.kind == "consistent" and "small-but-real" not in told
    else:
        assert found.verdict.kind == "equation-error" or "small-but-real" in told
        assert found.causes[0].kind == "damping"
        size, error = found.causes[0].size, found.causes[0].size_error
        assert size is not None and error is not None and abs(size - DAMPING) < 3.0 * error


def test_what_adds_up_counts_however_much_flows_back_and_forth() -> None:
    """A damped oscillator by its closed form: in 64 cycles a damper takes 6 tolerances.

    It takes 5e-5 of the energy that the spring exchanges meanwhile.
    """
    k, c, h = 25.0, 1.5e-4, 0.004
    t = h * np.arange(20001)
    root = -0.5 * c + 1j * np.sqrt(k - 0.25 * c * c)
    z = np.exp(root * t) * (1.0 - 1j * 0.5 * c / root.imag)
    log = {"time": t, "q.slide": z.real, "u.slide": (root * z).real}
    model = dc.Mechanism(
        [dc.point_mass("cart", 1.0)],
        [dc.prismatic("slide", "ground", "cart", "x", stiffness=k)],
    )
    audit = dc.audit(model, log)
    assert audit.verdict.kind == "equation-error", audit.verdict.explain()
    assert (audit.causes[0].kind, audit.causes[0].element) == ("missing-damper", "slide")
    assert audit.attribution is not None
    x, u = z.real, (root * z).real
    lost = 0.5 * (u[-1] ** 2 + k * x[-1] ** 2) - 0.5 * (u[0] ** 2 + k * x[0] ** 2)
    # Of a long log some stretches are looked at; the rest follows by their rates.
    share = audit.attribution.equations
    assert abs(share.energy - lost) < 3.0 * share.error < 1e-2 * abs(lost)
    assert abs(lost) > 5.0 * audit.tolerance * audit.reference_energy
    assert abs(lost) < 1e-4 * audit.energy_exchanged
