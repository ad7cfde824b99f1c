"""Loops that were integrated in one coordinate: a ladder that slides along a wall and a floor.

The oracle is Lagrange's equation of its angle, by hand, with integrators written here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.inference.comparison import compared
from deltac.diagnosis.inference.linearisation import start
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import observations
from deltac.diagnosis.inference.reduced import reductions
from tests.support.slow import repeated

pytestmark = pytest.mark.case_study("test_inertia_is_that_of_the_independent_speeds")

LENGTH, FOOT, ROD, HEAD, INERTIA, BRAKE, GRAVITY = 1.2, 0.5, 0.2, 0.4, 0.05, 0.3, 9.81
"""The mass of the rod is at the foot."""
Rate = Callable[[float, float], float]
Step = Callable[[Rate, float, float, float], tuple[float, float]]


def ladder(foot: float = FOOT, brake: float = BRAKE) -> dc.Mechanism:
    """A foot on the floor, a head at the wall, and a rod between them that turns about the foot."""
    return dc.Mechanism(
        bodies=[
            dc.point_mass("foot", foot),
            dc.body("rod", ROD, inertia=(INERTIA, INERTIA, INERTIA)),
            dc.point_mass("head", HEAD),
        ],
        joints=[
            dc.prismatic("floor", "ground", "foot", "x"),
            dc.revolute("turn", "foot", "rod", "z", damping=brake),
            dc.prismatic("wall", "ground", "head", "y"),
        ],
        constraints=[dc.constraints.loop_spherical("top", "rod", "head", point1=(0, LENGTH, 0))],
        gravity=(0, -GRAVITY, 0),
    )


def acceleration(angle: float, rate: float) -> float:
    """Of the angle θ from the wall: x = L sin θ, y = L cos θ; T = ½ (J + L² ((m + μ) c² + M s²)) θ̇²."""
    s, c = np.sin(angle), np.cos(angle)
    mass = INERTIA + LENGTH**2 * ((FOOT + ROD) * c**2 + HEAD * s**2)
    slope = 2.0 * LENGTH**2 * (HEAD - FOOT - ROD) * s * c
    force = HEAD * GRAVITY * LENGTH * s - BRAKE * rate - 0.5 * slope * rate**2
    return float(force / mass)


def explicit_euler(f: Rate, q: float, u: float, h: float) -> tuple[float, float]:
    return q + h * u, u + h * f(q, u)


def semi_implicit_euler(f: Rate, q: float, u: float, h: float) -> tuple[float, float]:
    u = u + h * f(q, u)
    return q + h * u, u


def heun(f: Rate, q: float, u: float, h: float) -> tuple[float, float]:
    a = f(q, u)
    b = f(q + h * u, u + h * a)
    return q + 0.5 * h * (u + u + h * a), u + 0.5 * h * (a + b)


def slid(step: Step, h: float = 1e-3, rows: int = 400) -> dc.Trajectory:
    states = [(0.35, 0.4)]
    for _ in range(rows - 1):
        states.append(step(acceleration, *states[-1], h))
    return of_angle(h * np.arange(rows, dtype=float), *np.array(states).T)


def of_angle(t: np.ndarray, q: np.ndarray, u: np.ndarray) -> dc.Trajectory:
    """All coordinates and speeds by those of the angle."""
    x, y = LENGTH * np.sin(q), LENGTH * np.cos(q)
    return dc.Trajectory(
        t=t,
        q=np.column_stack([x, q, y]),
        u=np.column_stack([u * y, u, -u * x]),
        coordinates=("floor", "turn", "wall"),
        speeds=("floor", "turn", "wall"),
        provenance=dc.Provenance("by hand"),
    )


def energy(run: dc.Trajectory) -> np.ndarray:
    q, u = run.q[:, 1], run.u[:, 1]
    s, c = np.sin(q), np.cos(q)
    mass = INERTIA + LENGTH**2 * ((FOOT + ROD) * c**2 + HEAD * s**2)
    return np.asarray(0.5 * mass * u**2 + HEAD * GRAVITY * LENGTH * c)


def test_inertia_is_that_of_the_independent_speeds() -> None:
    """The foot carries the mass of the rod, which turns about it."""
    run = slid(semi_implicit_euler)
    by_hand = {"floor": FOOT + ROD, "turn": INERTIA, "wall": HEAD}
    some = list(reductions(LogModel(ladder(), run), run))
    assert some
    for reduced in some:
        [speed] = reduced.of_u
        expected = np.full((len(run), 1), by_hand[run.speeds[speed]])
        assert reduced.inertia(reduced.rows(run)) == pytest.approx(expected, rel=1e-12)


METHODS = {
    "explicit-euler": explicit_euler,
    "semi-implicit-euler": semi_implicit_euler,
    "heun": heun,
}


@pytest.mark.parametrize("name", METHODS)
def test_an_integrator_of_one_coordinate_is_named(name: str) -> None:
    run = slid(METHODS[name])
    audit = dc.audit(ladder(), run)
    assert audit.verdict.kind in ("consistent", "integration-error"), audit.verdict.explain()
    assert audit.integrator is not None and name in audit.integrator.names
    assert audit.attribution is not None and not audit.causes
    # E less the work of the damper by trapezoids: their error is far below that of a first-order method.
    power = -BRAKE * run.u[:, 1] ** 2
    h = run.t[1]
    work = np.concatenate([[0.0], np.cumsum(0.5 * h * (power[1:] + power[:-1]))])
    own = audit.attribution.integrator
    if name != "heun":
        error = (energy(run) - energy(run)[0] - work)[-1]
        assert own.energy == pytest.approx(error, rel=0.02)


@pytest.mark.parametrize("digits", [6, 5])
def test_digits_hide_no_integrator_of_one_coordinate(digits: int) -> None:
    """The others follow from it to what its digits make of them."""
    run = slid(semi_implicit_euler, 2e-3, 200)

    def written(x: np.ndarray) -> np.ndarray:
        return np.array([[float(f"{v:.{digits}g}") for v in row] for row in x])

    log = replace(run, q=written(run.q), u=written(run.u))
    exact, told = (dc.audit(ladder(), r).attribution for r in (run, log))
    assert exact is not None and told is not None
    apart = told.integrator.energy - exact.integrator.energy
    assert abs(apart) <= 2.0 * told.integrator.error
    assert told.integrator.error < 0.01 * abs(exact.integrator.energy)


@pytest.mark.parametrize(
    "name", repeated(("explicit-euler", "semi-implicit-euler"), "semi-implicit-euler")
)
def test_a_wrong_damper_is_found(name: str) -> None:
    audit = dc.audit(ladder(brake=1.1 * BRAKE), slid(METHODS[name]))
    [cause] = audit.causes
    # Nothing but the damper and masses acts: all masses larger are the same as a weaker damper.
    told = {("damping", "turn"): BRAKE, ("mass-scale", "all bodies"): 1.1}
    # Rows are exact, and the equations linear in it.
    assert cause.size == pytest.approx(told[cause.kind, cause.element], rel=1e-6)


def in_all_coordinates(rows: list[int], h: float = 1e-2) -> dc.Trajectory:
    """Some rows of the ladder under a torque held over each step, by Lagrange's multipliers and RK4."""
    M = np.diag([FOOT + ROD, INERTIA, HEAD])

    def rate(x: np.ndarray, torque: float) -> np.ndarray:
        u, s, c = x[3:], LENGTH * np.sin(x[1]), LENGTH * np.cos(x[1])
        G = np.array([[1.0, -c, 0.0], [0.0, s, 1.0]])
        force = np.array([0.0, torque - BRAKE * u[1], -HEAD * GRAVITY])
        both = np.block([[M, -G.T], [G, np.zeros((2, 2))]])
        a = np.linalg.solve(both, np.concatenate([force, -(u[1] ** 2) * np.array([s, c])]))
        return np.concatenate([u, a[:3]])

    s, c, w = np.sin(0.5), np.cos(0.5), 0.3
    x = np.array([LENGTH * s, 0.5, LENGTH * c, w * LENGTH * c, w, -w * LENGTH * s])
    states = list[np.ndarray]()
    for k in range(rows[-1] + 1):
        follow = 3.0 * np.sin(7.0 * k * h) - 1.2 * x[4] - 6.0 * (x[1] - 0.6)
        torque = float(follow - HEAD * GRAVITY * LENGTH * np.sin(x[1]))
        states.append(np.r_[k * h, x, torque])
        k1 = rate(x, torque)
        k2 = rate(x + h / 2 * k1, torque)
        k3 = rate(x + h / 2 * k2, torque)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, torque))
    t, q, u, force = np.split(np.array(states)[rows], (1, 4, 7), axis=1)
    names = ("floor", "turn", "wall")
    forces = {"actuator m": force * (np.arange(3) == 1)}
    return dc.Trajectory(t=t[:, 0], q=q, u=u, coordinates=names, speeds=names, forces=forces)


def test_what_forces_do_between_rows_is_no_correction_of_a_constraint() -> None:
    """Little of a torque in steps that were left out is along the impulses of the constraints."""
    steps = np.random.default_rng(0).choice([1, 2, 3, 7], p=[0.4, 0.3, 0.2, 0.1], size=90)
    run = in_all_coordinates([0, *np.cumsum(steps).tolist()])
    model = LogModel(ladder(), run)
    log = observations(model, run, len(run))
    assert log is not None
    comparison = compared(start(model, run, log).with_columns())
    across, flow, lost = comparison.across, comparison.point.flow, comparison.point.lost
    assert across is not None and lost.sum() > 30
    speeds = across[:, 3:, 3:]
    impulses = flow.plant.impulses(flow.end.t, flow.end.q)
    assert speeds @ impulses == pytest.approx(impulses, abs=1e-12 * np.abs(impulses).max())
    by_torque = flow.force_responses[0]
    taken = (speeds @ by_torque[:, :, None])[:, :, 0]
    share = np.linalg.norm(taken, axis=1) / np.linalg.norm(by_torque, axis=1)
    # By the noise of the rows alone it would be two thirds.
    assert share[lost].max() < 0.1
