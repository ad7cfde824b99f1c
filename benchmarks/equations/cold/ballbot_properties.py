"""Planar ballbot: the ball rolls without slip, the body leans from upright."""
import numpy as np


class Ballbot:
    r = 0.12
    g = 9.81

    def __init__(self, M=2.4, J=0.016, m=9.2, l=0.34, I=0.61, b=0.08):
        self.M, self.J = M, J
        self.m, self.l, self.I = m, l, I
        self.b = b

    @property
    def rolling_inertia(self):
        return self.J + (self.M + self.m) * self.r**2

    @property
    def coupling(self):
        return self.m * self.r * self.l

    @property
    def tilt_inertia(self):
        return self.I + self.m * self.l**2

    def mass(self, theta):
        k = self.coupling * np.cos(theta)
        return np.array([[self.rolling_inertia, k], [k, self.tilt_inertia]])

    def torques(self, theta, dphi, dtheta):
        slip = self.b * (dphi - dtheta)
        return np.array([
            self.coupling * np.sin(theta) * dtheta**2 - slip,
            self.m * self.g * self.l * np.sin(theta) + slip,
        ])

    def ode(self, t, x):
        phi, theta, dphi, dtheta = x
        acc = np.linalg.solve(self.mass(theta), self.torques(theta, dphi, dtheta))
        return np.hstack(([dphi, dtheta], acc))
