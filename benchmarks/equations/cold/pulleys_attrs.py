"""Atwood's double machine: a heavy pulley hangs from a thread over a fixed one."""
import attrs
import numpy as np


@attrs.define
class Pulley:
    J: float
    r: float
    m: float = 0.0


@attrs.define(frozen=True)
class Machine:
    m1: float = 2.9
    m2: float = 1.1
    m3: float = 0.8
    top: Pulley = attrs.field(factory=lambda: Pulley(J=0.0032, r=0.08))
    low: Pulley = attrs.field(factory=lambda: Pulley(J=0.0017, r=0.06, m=0.35))
    g: float = 9.81

    def matrix(self):
        hanging = self.m2 + self.m3 + self.low.m
        a = self.m1 + hanging + self.top.J / self.top.r**2
        b = self.m3 - self.m2
        c = self.m2 + self.m3 + self.low.J / self.low.r**2
        return np.array([[a, b], [b, c]])

    def forces(self):
        hanging = self.m2 + self.m3 + self.low.m
        return self.g * np.array([self.m1 - hanging, self.m2 - self.m3])


def ode(x, t, machine=Machine()):
    """x: how far m1 has sunk, how far m2 has sunk under the low pulley, and their rates."""
    return np.concatenate([x[2:], np.linalg.solve(machine.matrix(), machine.forces())])
