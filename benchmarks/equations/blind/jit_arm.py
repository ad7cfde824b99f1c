import numpy as np
from numba import float64
from numba.experimental import jitclass

spec = [
    ("m1", float64),
    ("m2", float64),
    ("l1", float64),
    ("r1", float64),
    ("r2", float64),
    ("I1", float64),
    ("I2", float64),
    ("k", float64),
    ("d", float64),
]


@jitclass(spec)
class FlexArm:
    """Two links in a horizontal plane, a torsion spring in the elbow, q2 relative."""

    def __init__(self):
        self.m1 = 2.1
        self.m2 = 1.3
        self.l1 = 0.6
        self.r1 = 0.28
        self.r2 = 0.21
        self.I1 = 0.071
        self.I2 = 0.024
        self.k = 8.5
        self.d = 0.15

    def inertia(self, q2):
        alpha = self.I1 + self.I2 + self.m1 * self.r1**2 + self.m2 * (self.l1**2 + self.r2**2)
        beta = self.m2 * self.l1 * self.r2
        delta = self.I2 + self.m2 * self.r2**2
        M = np.empty((2, 2))
        M[0, 0] = alpha + 2.0 * beta * np.cos(q2)
        M[0, 1] = M[1, 0] = delta + beta * np.cos(q2)
        M[1, 1] = delta
        return M

    def coriolis(self, q2, w1, w2):
        b = self.m2 * self.l1 * self.r2 * np.sin(q2)
        return np.array([[-b * w2, -b * (w1 + w2)], [b * w1, 0.0]])

    def rhs(self, t, y):
        q = y[:2]
        w = y[2:4]
        out = np.zeros_like(y)
        out[:2] = w
        tau = np.zeros(2)
        tau[1] = -self.k * q[1] - self.d * w[1]
        out[2:] = np.linalg.solve(self.inertia(q[1]), tau - self.coriolis(q[1], w[0], w[1]).dot(w))
        return out


arm = FlexArm()
