from __future__ import annotations

from math import cos, sin
from typing import NamedTuple


class State(NamedTuple):
    r: float
    phi: float
    rdot: float
    phidot: float


class Parameters(NamedTuple):
    m: float = 0.9
    k: float = 70.0
    l0: float = 0.45
    c: float = 0.6
    g: float = 9.81


def derivative(state: State, p: Parameters = Parameters()) -> State:
    tension = p.k * (state.r - p.l0) + p.c * state.rdot
    return State(
        r=state.rdot,
        phi=state.phidot,
        rdot=state.r * state.phidot**2 - tension / p.m + p.g * cos(state.phi),
        phidot=-(2 * state.rdot * state.phidot + p.g * sin(state.phi)) / state.r,
    )


def ode(t, y):
    return derivative(State(*y))
