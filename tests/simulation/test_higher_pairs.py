"""Surfaces in touch, their contact points massless coordinates, against closed forms of the same motions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import deltac as dc
from deltac.arrays import Array
from tests.support.slow import repeated

MASS, SEMI_AXES, GRAVITY = 1.3, np.array([0.3, 0.2, 0.15]), 9.81
INERTIA = MASS / 5 * (np.sum(SEMI_AXES**2) - SEMI_AXES**2)
UP = np.array([0.0, 0.0, 1.0])


def marks(*names: str) -> tuple[list[Any], list[Any]]:
    """Massless frames that move freely, and their joints."""
    frames, joints = [], []
    for name in names:
        below = "ground"
        for axis in "xyz":
            child = name if axis == "z" else f"{name} {axis}"
            frames.append(dc.bodies.frame(child))
            joints.append(dc.prismatic(f"{name}.{axis}", below, child, axis))
            below = child
    return frames, joints


def ellipsoid(rolling: bool) -> dc.Mechanism:
    frames, joints = marks("mark")
    surface = "((x/0.3)**2 + (y/0.2)**2 + (z/0.15)**2 - 1)"
    pair = dc.constraints.higher_pair(
        "contact", "egg", surface, "ground", "z", at="mark", rolling=rolling
    )
    return dc.Mechanism(
        [dc.body("egg", MASS, INERTIA), *frames],
        [dc.free("base", "egg"), *joints],
        constraints=[pair],
        gravity=-GRAVITY * UP,
    )


def turned(quaternion: Array) -> Array:
    return np.asarray(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix())


def arm(R: Array, w: Array) -> tuple[Array, Array]:
    """From the centre to the contact point, eliminated: −A²n/√(n·A²n), n = RᵀUP in the body; and its rate."""
    n, n_dot = R.T @ UP, -np.cross(R.T @ w, R.T @ UP)
    square = SEMI_AXES**2
    height = np.sqrt(n @ (square * n))
    inside = -square * n / height
    rate = -square * n_dot / height - inside * (n @ (square * n_dot)) / height**2
    return R @ inside, np.cross(w, R @ inside) + R @ rate


def newton_euler(rolling: bool) -> Any:
    """ẏ of y = (x, quaternion, v, ω), with the contact force from the acceleration of the material point."""

    def rhs(t: float, y: Array) -> Array:
        R, v, w = turned(y[3:7]), y[7:10], y[10:]
        p, p_dot = arm(R, w)
        I = R @ np.diag(INERTIA) @ R.T
        free_v, free_w = -GRAVITY * UP, np.linalg.solve(I, -np.cross(w, I @ w))
        lever = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
        rows = np.eye(3) if rolling else UP[None, :]
        # v + ω × p of the material point vanishes along the rows, and so does its rate.
        wanted = rows @ (free_v - lever @ free_w + np.cross(w, p_dot))
        mobility = np.eye(3) / MASS - lever @ np.linalg.solve(I, lever)
        force = rows.T @ np.linalg.solve(rows @ mobility @ rows.T, -wanted)
        a, alpha = free_v + force / MASS, free_w + np.linalg.solve(I, lever @ force)
        s, e = y[3], y[4:7]
        return np.concatenate([v, [-0.5 * w @ e], 0.5 * (s * w + np.cross(w, e)), a, alpha])

    return rhs


@pytest.mark.long
@pytest.mark.parametrize("rolling", repeated((True, False), True))
def test_an_ellipsoid_on_a_plane_moves_as_with_its_contact_point_eliminated(rolling: bool) -> None:
    m = ellipsoid(rolling)
    quaternion, w = np.array([0.9, 0.3, 0.2, -0.1]), np.array([1.0, 2.0, 3.0])
    quaternion /= np.linalg.norm(quaternion)
    R = turned(quaternion)
    p, p_dot = arm(R, w)
    v = -np.cross(w, p) if rolling else np.array([0.4, 0.1, -np.cross(w, p)[2]])
    x = np.array([0.1, 0.2, -p[2]])
    start = m.state([*x, *quaternion, *(x + p)], [*v, *(R.T @ w), *(v + p_dot)])
    run = dc.simulate(m, start, 0.5, 5e-3, solver=dc.solvers.Scipy("DOP853", tolerance=1e-11))
    exact = solve_ivp(
        newton_euler(rolling),
        (0.0, 0.5),
        [*x, *quaternion, *v, *w],
        method="DOP853",
        rtol=1e-11,
        atol=1e-11,
        t_eval=run.t,
    ).y.T
    assert np.abs(run.q[:, :7] - exact[:, :7]).max() < 2e-8
    contact = [y[:3] + arm(turned(y[3:7]), y[10:])[0] for y in exact]
    assert np.abs(run.q[:, 7:] - contact).max() < 2e-8
    assert np.ptp(run.q[:, 7:9], axis=0).min() > 0.1  # the contact point travels
    ledger = dc.balance(m, run)
    assert max(np.abs(delta).max() for delta in ledger.delta_c.values()) < 1e-8


def wheelset(conicity: float) -> dc.Mechanism:
    """Two cones on an axle, on rails whose heads are cylinders of the radius `head`."""
    frames, joints = marks("left", "right")
    pairs = [
        dc.constraints.higher_pair(
            side,
            "axle",
            f"(x**2 + z**2 - (r - c*({sign}*y - b))**2)/(2*r)",
            "ground",
            f"((y - {sign}*b)**2 + (z + head)**2 - head**2)/(2*head)",
            at=side,
            rolling=True,
        )
        for side, sign in (("left", 1), ("right", -1))
    ]
    return dc.Mechanism(
        [dc.body("axle", 1000.0, (600.0, 100.0, 600.0)), *frames],
        [dc.free("base", "axle"), *joints],
        constraints=pairs,
        gravity=-GRAVITY * UP,
        parameters={"r": 0.46, "b": 0.75, "c": conicity, "head": 0.3},
        name="wheelset",
    ).varying("head")


@pytest.mark.slow
def test_a_wheelset_hunts_with_klingels_wavelength() -> None:
    """2π√(r b/λ) for small amplitudes (Klingel, Organ f. d. Fortschritte d. Eisenbahnwesens 20 (1883) 113).

    That is of rails like knife-edges. A round head is met λ·head nearer to the middle of the track, and the
    radius there changes by λ²·head/b more a metre as the axle leans: the wave is shorter by λ·head/b, to
    first order in λ.
    """
    conicity, r, b, v = 0.05, 0.46, 0.75, 5.0
    klingel = 2 * np.pi * np.sqrt(r * b / conicity)
    for head in (1e-4, 0.3):
        m = wheelset(conicity).with_parameters(head=head)
        guess = m.state(
            {"base.y": 1e-3, "base.z": r, "left.y": b, "right.y": -b},
            {"base.vx": v, "base.wy": v / r},
        )
        assembly = dc.assemble(m, guess, pinned=["base.y", "base.vx"])
        assert assembly.freedom == 1  # it can only roll on: twelve rows of rank 11
        run = dc.simulate(m, assembly.state, 1.1 * klingel / v, 1.1 * klingel / v / 400)
        x, y = (run.q[:, m.coordinates[f"base.{c}"].index] for c in "xy")
        first, second = CubicSpline(x, y).roots(extrapolate=False)
        shorter = 1 - 2 * (second - first) / klingel
        assert shorter == pytest.approx(conicity * head / b, rel=conicity, abs=1e-6)
        assert np.abs(dc.evaluate(m, run).phi).max() < 1e-12  # rows left out are those of motion
