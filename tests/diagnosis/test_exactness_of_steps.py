"""What rows tell though steps are coarse, rows far apart, or rotations moved by quaternions.

Each log is of physics written out here; true numbers are those that made it.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.inference.hypotheses import CERTAIN, Block, intermittent, nothing

pytestmark = pytest.mark.case_study(
    "test_quaternions_that_are_added_and_normalised_close",
    "test_joules_at_the_tolerance_are_no_doubt",
    "test_a_stiffness_of_zero_is_no_factor",
)

G = 9.81


# --- two masses on springs: the lower mode turns 2.7 rad from row to row ---------------------------

WHEEL, CHASSIS, TYRE, STRUT, DAMPER = 32.0, 300.0, 1.6e5, 2.5e4, 1.2e3


def quarter_car(tyre: float) -> dc.Mechanism:
    return dc.Mechanism(
        [dc.point_mass("wheel", WHEEL), dc.point_mass("chassis", CHASSIS)],
        [
            dc.prismatic("tyre", "ground", "wheel", "z", stiffness=tyre),
            dc.prismatic("strut", "wheel", "chassis", "z", stiffness=STRUT, damping=DAMPER),
        ],
        gravity=(0, 0, 0),
    )


def vibration(tyre: float, h: float, rows: int, noise: float) -> dc.Trajectory:
    """Exact: displacements (wheel, chassis over wheel) by the matrix exponential."""
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    # z₁'' of the wheel, and the relative one of the strut.
    wheel = np.array([-tyre, STRUT, 0.0, DAMPER]) / WHEEL
    chassis = np.array([0.0, -STRUT, 0.0, -DAMPER]) / CHASSIS
    A[2], A[3] = wheel, chassis - wheel
    step, x = expm(A * h), np.empty((rows, 4))
    x[0] = 0.004, 0.05, 0.3, -0.4
    for k in range(1, rows):
        x[k] = step @ x[k - 1]
    x += noise * x.std(axis=0) * np.random.default_rng(2).standard_normal(x.shape)
    names = ("tyre", "strut")
    return dc.Trajectory(
        t=h * np.arange(rows, dtype=float), q=x[:, :2], u=x[:, 2:], coordinates=names, speeds=names
    )


def test_rows_far_apart_tell_the_stiffness_of_a_fast_mode() -> None:
    """What the series of an unknown step may leave out is larger than the motion; what it does is nothing."""
    run = vibration(1.027 * TYRE, 0.04, 60, 1e-6)
    audit = dc.audit(quarter_car(TYRE), run)
    assert audit.verdict.kind == "equation-error"
    cause, *_ = audit.causes
    assert (cause.kind, cause.element) == ("stiffness", "tyre")
    assert cause.size == pytest.approx(1.027 * TYRE, abs=3.0 * cause.size_error + 1e-5 * TYRE)


# --- one sine of torque: its second derivative is itself --------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_gear_under_one_sine_is_no_filter_of_negative_width(noise: float) -> None:
    """τ + b τ″ is a multiple of τ = sin ωt: with b < 0 a larger one, which no filter makes."""
    mass, arm, h, gear = 1.2, 0.6, 4e-3, 1.356
    inertia = mass * arm**2

    def rate(x: Array, torque: float) -> Array:
        return np.array([x[1], (torque - 0.1 * x[1] - mass * G * arm * np.sin(x[0])) / inertia])

    t = h * np.arange(501)
    torque = 3.0 * np.sin(7.0 * t + 1.0)
    x = np.empty((len(t), 2))
    x[0] = 0.6, 0.0
    for k in range(len(t) - 1):
        tau = gear * torque[k]  # held over the step
        a = rate(x[k], tau)
        b = rate(x[k] + h / 2 * a, tau)
        c = rate(x[k] + h / 2 * b, tau)
        d = rate(x[k] + h * c, tau)
        x[k + 1] = x[k] + h / 6 * (a + 2 * b + 2 * c + d)
    x += noise * x.std(axis=0) * np.random.default_rng(5).standard_normal(x.shape)
    model = dc.Mechanism(
        [dc.point_mass("bob", mass)],
        [dc.revolute("hinge", "ground", "bob", "y", child_position=(0, 0, arm), damping=0.1)],
        forces=[dc.forces.joint_torque("motor", "hinge")],
        gravity=(0, 0, -G),
    )
    log = dc.Trajectory(
        t=t, q=x[:, :1], u=x[:, 1:], coordinates=("hinge",), speeds=("hinge",),  # type: ignore[arg-type]
        forces={"actuator motor": torque[:, None]},
    )  # fmt: skip
    audit = dc.audit(model, log)
    assert audit.verdict.kind == "equation-error"
    cause, *_ = audit.causes
    assert cause.kind == "actuator-gear"
    assert cause.size == pytest.approx(gear, abs=3.0 * cause.size_error + 1e-6)


# --- rotations that are moved as quaternions are added ------------------------------------------------

MOMENTS = np.array([0.8, 1.1, 1.5])


def tumbling(h: float, steps: int) -> dc.Trajectory:
    """Euler's equations by the half-implicit method of Euler; q + ½ h q ⊗ ω, normalised."""
    q, u = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.9, 1.4, -0.6])
    rows = [(q, u)]
    for _ in range(steps):
        u = u - h * np.cross(u, MOMENTS * u) / MOMENTS
        w, v = q[0], q[1:]
        q = q + 0.5 * h * np.concatenate([[-v @ u], w * u + np.cross(v, u)])
        q = q / np.linalg.norm(q)
        rows.append((q, u))
    Q, U = (np.array(x) for x in zip(*rows, strict=True))
    quaternion, speeds = (f"base.q{k}" for k in "wxyz"), [f"base.w{k}" for k in "xyz"]
    return dc.Trajectory(
        t=h * np.arange(steps + 1, dtype=float),
        q=Q,
        u=U,
        coordinates=tuple(quaternion),
        speeds=tuple(speeds),
    )


def test_quaternions_that_are_added_and_normalised_close() -> None:
    """Their rotation is that by 2 atan(ωh/2), off the exponential by (ωh)²/12 of itself."""
    body = dc.body("base", mass=1.0, inertia=tuple(MOMENTS))
    model = dc.Mechanism([body], [dc.joints.spherical("base", "ground", "base")], gravity=(0, 0, 0))
    h = 0.01
    run = tumbling(h, 400)
    names = model.coordinates.names, model.speeds.names
    log = dc.Trajectory(t=run.t, q=run.q, u=run.u, coordinates=names[0], speeds=names[1])
    audit = dc.audit(model, log)
    assert audit.verdict.kind in ("consistent", "integration-error") and not audit.causes
    assert audit.integrator is not None and audit.integrator.names == ("semi-implicit-euler",)
    energy = 0.5 * (run.u**2 * MOMENTS).sum(axis=1)
    told = audit.attribution
    assert told is not None
    # No force acts: all that the energy changes by is the integrator's.
    true = energy[-1] - energy[0]
    assert abs(told.integrator.energy - true) < 2.0 * told.integrator.error + 1e-4 * abs(true)


STAGES: dict[str, tuple[list[list[float]], list[float]]] = {
    "explicit-euler": ([[]], [1.0]),
    "heun": ([[], [1.0]], [0.5, 0.5]),
    "explicit-midpoint": ([[], [0.5]], [0.0, 1.0]),
    "ralston": ([[], [2 / 3]], [0.25, 0.75]),
    "kutta-3": ([[], [0.5], [-1.0, 2.0]], [1 / 6, 2 / 3, 1 / 6]),
}
"""Weights of the stages in each other and in the step, as of textbooks."""


@pytest.mark.parametrize("scheme", STAGES)
def test_steps_on_the_group_of_rotations_close(scheme: str) -> None:
    """A heavy top whose attitude a Runge–Kutta method moves by exponentials, by SciPy's rotations."""
    rows_of_a, b = STAGES[scheme]
    h, mass, height = 1e-3, 0.4, 0.09
    moments = MOMENTS + mass * height**2 * np.array([1.0, 1.0, 0.0])
    centre = np.array([0.0, 0.0, height])

    def acceleration(attitude: Rotation, w: Array) -> Array:
        down = attitude.inv().apply([0.0, 0.0, -mass * 9.81])
        return np.asarray((np.cross(centre, down) - np.cross(w, moments * w)) / moments)

    attitude, w = Rotation.from_rotvec([0.5, 0.0, 0.0]), np.array([0.3, 0.2, 30.0])
    q, u = [attitude], [w]
    for _ in range(600):
        rates, slopes = list[Array](), list[Array]()
        for a in rows_of_a:
            turn = h * sum((x * r for x, r in zip(a, rates, strict=True)), np.zeros(3))
            change = h * sum((x * r for x, r in zip(a, slopes, strict=True)), np.zeros(3))
            rates.append(w + change)
            slopes.append(acceleration(attitude * Rotation.from_rotvec(turn), w + change))
        attitude = attitude * Rotation.from_rotvec(h * np.array(b) @ rates)
        w = w + h * np.array(b) @ slopes
        q.append(attitude)
        u.append(w)
    top = dc.body("top", mass, tuple(MOMENTS), mass_centre=tuple(centre))
    model = dc.Mechanism(
        [top], [dc.joints.spherical("tip", "ground", "top")], gravity=(0, 0, -9.81)
    )
    quaternions = np.array([x.as_quat(canonical=False)[[3, 0, 1, 2]] for x in q])
    log = dc.Trajectory(
        t=h * np.arange(601, dtype=float), q=quaternions, u=np.array(u),
        coordinates=model.coordinates.names, speeds=model.speeds.names,
    )  # fmt: skip
    audit = dc.audit(model, log)
    assert audit.integrator is not None and audit.attribution is not None
    assert audit.integrator.names == (scheme,) and not audit.causes
    energies = [
        0.5 * (w**2 * moments).sum() + mass * 9.81 * x.apply(centre)[2]
        for x, w in zip(q, u, strict=True)
    ]
    told, true = audit.attribution.integrator, energies[-1] - energies[0]
    # Rounding of 600 steps of a body with some 5 J.
    assert abs(told.energy - true) < 2.0 * told.error + 1e-11
    assert told.error < 1e-7 * abs(true) + 1e-11


def test_steps_of_constant_acceleration_close() -> None:
    """A pendulum by q + h u + ½ h² a and u + h a: nothing else changes its energy."""
    h, x = 4e-3, [np.array([1.2, 0.4])]
    for _ in range(400):
        a = -G * np.sin(x[-1][0])
        x.append(x[-1] + h * np.array([x[-1][1] + 0.5 * h * a, a]))
    bob = dc.point_mass("bob", 1.0)
    hinge = dc.revolute("hinge", "ground", "bob", "y", child_position=(0, 0, 1.0))
    model = dc.Mechanism([bob], [hinge], gravity=(0, 0, -G))
    q, u = np.array(x).T
    audit = dc.audit(model, {"time": h * np.arange(401), "q.hinge": q, "u.hinge": u})
    assert audit.integrator is not None and audit.integrator.names == ("constant-acceleration",)
    energy = 0.5 * u**2 - G * np.cos(q)
    assert audit.verdict.kind == "integration-error" and audit.attribution is not None
    assert audit.attribution.integrator.curve[-1] == pytest.approx(energy[-1] - energy[0], rel=1e-4)


# --- near the tolerance -------------------------------------------------------------------------------


def free_fall(h: float, steps: int) -> tuple[dc.Mechanism, dc.Trajectory, float]:
    """A spring by the half-implicit method of Euler, and the largest |ΔC|: its energy swings by ½ h k q u."""
    k = 4.0
    q, u, rows = 1.0, 0.0, [(1.0, 0.0)]
    for _ in range(steps):
        u -= h * k * q
        q += h * u
        rows.append((q, u))
    x = np.array(rows)
    energy = 0.5 * x[:, 1] ** 2 + 0.5 * k * x[:, 0] ** 2
    model = dc.Mechanism(
        [dc.point_mass("bob", 1.0)],
        [dc.prismatic("rail", "ground", "bob", "x", stiffness=k)],
        gravity=(0, 0, 0),
    )
    log = dc.Trajectory(
        t=h * np.arange(steps + 1, dtype=float),
        q=x[:, :1],
        u=x[:, 1:],
        coordinates=("rail",),
        speeds=("rail",),
    )
    return model, log, float(np.abs(energy - energy[0]).max())


def test_joules_at_the_tolerance_are_no_doubt() -> None:
    """A tolerance is a round number: what may be on either side of it is told so, and blames nobody."""
    model, log, error = free_fall(2e-3, 1500)
    plain = dc.audit(model, log)
    share = error / plain.reference_energy
    at = dc.audit(model, log, tolerance=share)
    assert at.verdict.kind == "consistent" and at.verdict.confidence == "medium"
    assert 0.1 < at.odds["integration-error"] < 0.9
    assert dc.audit(model, log, tolerance=share / 1.5).verdict.kind == "integration-error"
    assert dc.audit(model, log, tolerance=share * 1.5).verdict.confidence == "high"


def test_a_stiffness_of_zero_is_no_factor() -> None:
    model = dc.Mechanism(
        [dc.point_mass("cart", 2.0)],
        [dc.prismatic("rail", "ground", "cart", "x", damping=0.5, stiffness=0.0)],
        gravity=(0, 0, -G),
    )
    t = 0.002 * np.arange(501)
    u = np.exp(-0.25 * t)
    q = (1.0 - u) / 0.25
    log = dc.Trajectory(t=t, q=q[:, None], u=u[:, None], coordinates=("rail",), speeds=("rail",))  # type: ignore[arg-type]
    assert dc.audit(model, log).verdict.kind == "consistent"


# --- what acts from time to time ----------------------------------------------------------------------


@pytest.mark.parametrize(("first", "acts"), [(0, False), (40, True)])
def test_what_a_log_begins_with_is_no_contact(first: int, acts: bool) -> None:
    """The same blow in the middle of white noise has two ends, at the start one, as a filter's start."""
    r = np.random.default_rng(1).standard_normal((120, 2))
    r[first : first + 10] *= 1e3
    none = np.zeros(0, dtype=np.intp)
    block = Block(r, np.zeros((120, 2, 0)), none, np.zeros(0), none)
    odds, active = intermittent(block, nothing(0), np.zeros(120, dtype=np.bool_))
    assert (odds > CERTAIN) == acts
    assert np.flatnonzero(active).tolist() == (list(range(40, 50)) if acts else [])
