from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Car:
    """Single-track model with linear tyres at low speed: lateral force = -C * lateral velocity."""

    m: float = 1270.0
    Iz: float = 1536.0
    lf: float = 1.02
    lr: float = 1.48
    Cf: float = 4200.0
    Cr: float = 5100.0
    cd: float = 31.0

    @property
    def wheelbase(self):
        return self.lf + self.lr

    @cached_property
    def rear(self):
        return -self.lr

    def forces(self, vx, vy, r):
        front = -self.Cf * (vy + self.lf * r)
        back = -self.Cr * (vy + self.rear * r)
        return -self.cd * vx, front + back, self.lf * front - self.lr * back

    def __call__(self, t, state):
        X, Y, psi, Xd, Yd, r = state
        c, s = np.cos(psi), np.sin(psi)
        vx = c * Xd + s * Yd
        vy = -s * Xd + c * Yd
        Fx, Fy, Mz = self.forces(vx, vy, r)
        Xdd = (c * Fx - s * Fy) / self.m
        Ydd = (s * Fx + c * Fy) / self.m
        return [Xd, Yd, r, Xdd, Ydd, Mz / self.Iz]


car = Car()
