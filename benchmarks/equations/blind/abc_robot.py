from __future__ import annotations

import abc
from typing import ClassVar

import numpy as np


class Manipulator(abc.ABC):
    """Base class: M(q) qdd + C(q, qd) qd + G(q) + F qd = tau."""

    n: ClassVar[int]
    viscous: ClassVar[tuple[float, ...]]

    @abc.abstractmethod
    def mass_matrix(self, q): ...

    @abc.abstractmethod
    def gravity(self, q): ...

    @abc.abstractmethod
    def mass_derivatives(self, q):
        """dM/dq_k for each k."""

    def coriolis(self, q, qd):
        """Christoffel symbols of the first kind."""
        dM = self.mass_derivatives(q)
        n = self.n
        C = np.zeros((n, n))
        for i in range(n):
            for j in range(n):
                for k in range(n):
                    C[i, j] += 0.5 * (dM[k][i, j] + dM[j][i, k] - dM[i][j, k]) * qd[k]
        return C

    def friction(self, qd):
        return np.asarray(self.viscous) * qd

    def forward(self, t, state, tau=None):
        q, qd = state[: self.n], state[self.n :]
        tau = np.zeros(self.n) if tau is None else tau
        bias = self.coriolis(q, qd) @ qd + self.gravity(q) + self.friction(qd)
        return np.r_[qd, np.linalg.solve(self.mass_matrix(q), tau - bias)]


class PolarArm(Manipulator):
    """Swing (horizontal axis), then a sliding rod with a payload."""

    n = 2
    viscous = (0.12, 0.9)

    def __init__(self, m=2.4, mp=0.6, J=0.19, a=0.35, g=9.81):
        self.m, self.mp, self.J, self.a, self.g = m, mp, J, a, g

    def mass_matrix(self, q):
        th, r = q
        return np.diag([self.J + self.m * r**2 + self.mp * (r + self.a) ** 2, self.m + self.mp])

    def mass_derivatives(self, q):
        th, r = q
        d = np.zeros((2, 2))
        d[0, 0] = 2 * self.m * r + 2 * self.mp * (r + self.a)
        return [np.zeros((2, 2)), d]

    def gravity(self, q):
        th, r = q
        first = (self.m * r + self.mp * (r + self.a)) * np.cos(th)
        second = (self.m + self.mp) * np.sin(th)
        return self.g * np.array([first, second])


robot = PolarArm()
