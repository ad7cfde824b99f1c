"""Planar five-bar of four uniform rods, angles from the horizontal, closed by two multipliers."""
from dataclasses import dataclass

import numpy as np


@dataclass
class Rod:
    m: float
    l: float

    @property
    def J(self):
        return self.m * self.l**2 / 12


@dataclass
class FiveBar:
    left: tuple[Rod, Rod]
    right: tuple[Rod, Rod]
    d: float
    g: float = 9.81

    @staticmethod
    def arm(one: Rod, two: Rod, a: float, b: float, da: float, db: float, g: float):
        c = two.m * one.l * two.l / 2
        M = np.array([
            [one.J + one.m * one.l**2 / 4 + two.m * one.l**2, c * np.cos(a - b)],
            [c * np.cos(a - b), two.J + two.m * two.l**2 / 4],
        ])
        f = np.array([
            -c * np.sin(a - b) * db**2 - (one.m / 2 + two.m) * g * one.l * np.cos(a),
            c * np.sin(a - b) * da**2 - two.m / 2 * g * two.l * np.cos(b),
        ])
        return M, f

    def closure(self, q, u):
        lengths = np.array([self.left[0].l, self.left[1].l, -self.right[0].l, -self.right[1].l])
        G = np.vstack([-lengths * np.sin(q), lengths * np.cos(q)])
        gamma = np.array([(lengths * np.cos(q) * u**2).sum(), (lengths * np.sin(q) * u**2).sum()])
        return G, gamma

    def accelerations(self, t, q, u):
        Ml, fl = self.arm(*self.left, q[0], q[1], u[0], u[1], self.g)
        Mr, fr = self.arm(*self.right, q[2], q[3], u[2], u[3], self.g)
        Z = np.zeros((2, 2))
        G, gamma = self.closure(q, u)
        K = np.block([[np.block([[Ml, Z], [Z, Mr]]), G.T], [G, Z]])
        return np.linalg.solve(K, np.concatenate([fl, fr, gamma]))[:4]


robot = FiveBar((Rod(0.8, 0.3), Rod(0.5, 0.45)), (Rod(0.7, 0.32), Rod(0.55, 0.42)), d=0.25)
