"""A four-bar in its plane, told by its crank angle alone: the closed form of textbooks.

a e^{iθ} + b e^{iα} = d + c e^{iβ} with crank a at θ, coupler b at α, rocker c at β, and the ground d. Its
open assembly; α and β follow from θ in closed form, and M(θ) θ̈ + ½ M′ θ̇² + V′ = 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import deltac as dc

CRANK, COUPLER, ROCKER, GROUND = 0.4, 1.0, 0.8, 1.1
MASSES = (1.0, 2.0, 1.5)
G = 9.81


def mechanism() -> dc.Mechanism:
    """Three uniform bars in a loop of four hinges."""
    a, b, c = MASSES
    return dc.Mechanism(
        [
            dc.rod("a", a, CRANK, along="x"),
            dc.rod("b", b, COUPLER, along="x"),
            dc.rod("c", c, ROCKER, along="x"),
        ],
        [
            dc.revolute("crank", "ground", "a"),
            dc.revolute("coupler", "a", "b", position=(CRANK, 0, 0)),
            dc.revolute("rocker", "ground", "c", position=(GROUND, 0, 0)),
        ],
        constraints=[
            dc.constraints.loop_revolute(
                "loop", "b", "c", point1=(COUPLER, 0, 0), point2=(ROCKER, 0, 0)
            )
        ],
        gravity=(0, -G, 0),
        name="four-bar",
    )


def angles(theta: Any) -> tuple[Any, Any]:
    """α and β of the open assembly."""
    x, y = GROUND - CRANK * np.cos(theta), -CRANK * np.sin(theta)
    diagonal = np.sqrt(x**2 + y**2)
    at_crank = np.arccos((diagonal**2 + COUPLER**2 - ROCKER**2) / (2 * diagonal * COUPLER))
    alpha = np.arctan2(y, x) + at_crank
    dx = CRANK * np.cos(theta) + COUPLER * np.cos(alpha) - GROUND
    dy = CRANK * np.sin(theta) + COUPLER * np.sin(alpha)
    return alpha, np.arctan2(dy, dx)


def slopes(theta: Any) -> tuple[Any, Any, Any, Any]:
    """α′, β′, α″, β″ by θ."""
    a, b, c = CRANK, COUPLER, ROCKER
    alpha, beta = angles(theta)
    da = a * np.sin(beta - theta) / (b * np.sin(alpha - beta))
    db = a * np.sin(theta - alpha) / (c * np.sin(beta - alpha))
    dda = -(a * (1 - db) * np.cos(theta - beta) + b * da * (da - db) * np.cos(alpha - beta)) / (
        b * np.sin(alpha - beta)
    )
    ddb = (a * (1 - da) * np.cos(theta - alpha) - c * db * (db - da) * np.cos(beta - alpha)) / (
        c * np.sin(beta - alpha)
    )
    return da, db, dda, ddb


def acceleration(t: Any, q: Any, u: Any, weight: float = 1.0) -> Any:
    """θ̈ by θ and θ̇; `weight` scales the weight of the coupler, 1 if right."""
    theta, rate = q[0], u[0]
    a, b, c = CRANK, COUPLER, ROCKER
    ma, mb, mc = MASSES
    alpha, beta = angles(theta)
    da, db, dda, ddb = slopes(theta)
    turn = np.cos(theta - alpha)
    M = ma * a**2 / 3 + mb * (a**2 + b**2 / 3 * da**2 + a * b * da * turn) + mc * c**2 / 3 * db**2
    M_slope = (
        mb
        * (2 * b**2 / 3 * da * dda + a * b * (dda * turn - da * (1 - da) * np.sin(theta - alpha)))
        + 2 * mc * c**2 / 3 * db * ddb
    )
    V_slope = G * (
        ma * a / 2 * np.cos(theta)
        + weight * mb * (a * np.cos(theta) + b / 2 * np.cos(alpha) * da)
        + mc * c / 2 * np.cos(beta) * db
    )
    return np.array([-(0.5 * M_slope * rate**2 + V_slope) / M])


def start(theta: float = 0.5, rate: float = 3.0) -> dc.State:
    """The state of the whole mechanism."""
    alpha, beta = angles(theta)
    da, db, *_ = slopes(theta)
    return mechanism().state(
        {"crank": theta, "coupler": alpha - theta, "rocker": beta},
        {"crank": rate, "coupler": (da - 1) * rate, "rocker": db * rate},
    )
