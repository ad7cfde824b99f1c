import numpy as np


class PlanarArm:
    def __init__(self, **kw):
        self.m1 = kw.get("m1", 3.1)
        self.m2 = kw.get("m2", 2.2)
        self.a1 = kw.get("a1", 0.5)
        self.r1 = kw.get("r1", 0.24)
        self.r2 = kw.get("r2", 0.21)
        self.I1 = kw.get("I1", 0.07)
        self.I2 = kw.get("I2", 0.031)
        self.g = 9.81
        self.F = np.diag([0.4, 0.3])

    def D(self, q):
        """Inertia matrix."""
        d11 = (
            self.m1 * self.r1**2
            + self.m2 * (self.a1**2 + self.r2**2 + 2 * self.a1 * self.r2 * np.cos(q[1]))
            + self.I1
            + self.I2
        )
        d12 = self.m2 * (self.r2**2 + self.a1 * self.r2 * np.cos(q[1])) + self.I2
        d22 = self.m2 * self.r2**2 + self.I2
        return np.array([[d11, d12], [d12, d22]])

    def C(self, q, qd):
        """Coriolis matrix from Christoffel's symbols."""
        h = -self.m2 * self.a1 * self.r2 * np.sin(q[1])
        return np.array([[h * qd[1], h * (qd[0] + qd[1])], [-h * qd[0], 0.0]])

    def G(self, q):
        g2 = self.m2 * self.r2 * self.g * np.cos(q[0] + q[1])
        g1 = (self.m1 * self.r1 + self.m2 * self.a1) * self.g * np.cos(q[0]) + g2
        return np.array([g1, g2])

    def forward_dynamics(self, q, qd, tau):
        return np.linalg.solve(self.D(q), tau - self.C(q, qd) @ qd - self.G(q) - self.F @ qd)
