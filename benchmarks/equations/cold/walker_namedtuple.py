"""Compass walker with a torso in single support; absolute angles from upright, clockwise."""
from typing import NamedTuple

import numpy as np
from numpy import cos, sin
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Walker(NamedTuple):
    a: float = 0.47
    b: float = 0.41
    m: float = 5.2
    mH: float = 12.5
    mT: float = 9.7
    L: float = 0.38
    g: float = 9.81

    @property
    def l(self) -> float:
        return self.a + self.b

    @property
    def total(self) -> float:
        return self.m + self.mH + self.mT


def mass_matrix(p: Walker, q: Vector) -> Vector:
    m11 = p.m * p.a**2 + p.total * p.l**2
    m12 = -p.m * p.l * p.b * cos(q[0] - q[1])
    m13 = p.mT * p.l * p.L * cos(q[0] - q[2])
    return np.array([[m11, m12, m13], [m12, p.m * p.b**2, 0.0], [m13, 0.0, p.mT * p.L**2]])


def bias(p: Walker, q: Vector, w: Vector) -> Vector:
    s12, s13 = sin(q[0] - q[1]), sin(q[0] - q[2])
    return np.array([
        -p.m * p.l * p.b * s12 * w[1] ** 2 + p.mT * p.l * p.L * s13 * w[2] ** 2,
        p.m * p.l * p.b * s12 * w[0] ** 2,
        -p.mT * p.l * p.L * s13 * w[0] ** 2,
    ])


def gravity(p: Walker, q: Vector) -> Vector:
    return p.g * np.array([
        (p.m * p.a + p.total * p.l) * sin(q[0]),
        -p.m * p.b * sin(q[1]),
        p.mT * p.L * sin(q[2]),
    ])


def swing(t: float, q: Vector, w: Vector, p: Walker = Walker()) -> Vector:
    return np.linalg.inv(mass_matrix(p, q)) @ (gravity(p, q) - bias(p, q, w))
