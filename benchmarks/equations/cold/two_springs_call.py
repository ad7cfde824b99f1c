"""A mass in space on two springs with dampers, weight and a cubic stiffening."""
import numpy as np
from numpy.linalg import norm


class Spring:
    def __init__(self, anchor, k, rest, c=0.0, k3=0.0):
        self.anchor = np.asarray(anchor, float)
        self.k, self.rest, self.c, self.k3 = k, rest, c, k3

    @staticmethod
    def unit(d):
        return d / norm(d)

    def __call__(self, r, v):
        d = r - self.anchor
        n = self.unit(d)
        s = norm(d) - self.rest
        return -(self.k * s + self.k3 * s**3 + self.c * (n @ v)) * n


class Mass:
    def __init__(self, m, *springs, g=9.81):
        self.m, self.springs, self.g = m, springs, g

    def __call__(self, t, q, u):
        total = np.array([0.0, 0.0, -self.m * self.g])
        for spring in self.springs:
            total = total + spring(np.array(q), np.array(u))
        return total / self.m


system = Mass(
    0.74,
    Spring((0.0, 0.0, 1.5), 64.0, 0.9, c=0.21),
    Spring((0.6, -0.4, -1.1), 37.0, 0.7, k3=120.0),
)
