"""A dumbbell satellite in the plane of its orbit: gravity acts on each end."""
from dataclasses import dataclass, field
from math import cos, sin, hypot


@dataclass(frozen=True, kw_only=True)
class Dumbbell:
    mu: float = 3.9
    m1: float = 1.3
    m2: float = 0.7
    L: float = 0.4
    d1: float = field(init=False)
    d2: float = field(init=False)
    J: float = field(init=False)

    def __post_init__(self):
        total = self.m1 + self.m2
        object.__setattr__(self, "d1", self.m2 * self.L / total)
        object.__setattr__(self, "d2", self.m1 * self.L / total)
        object.__setattr__(self, "J", self.m1 * self.m2 / total * self.L**2)

    def ends(self, x, y, th):
        yield self.m1, x + self.d1 * cos(th), y + self.d1 * sin(th), self.d1
        yield self.m2, x - self.d2 * cos(th), y - self.d2 * sin(th), -self.d2

    def pull(self, m, x, y):
        r = hypot(x, y)
        k = -self.mu * m / r**3
        return k * x, k * y


body = Dumbbell()


def accelerations(t, q, u):
    x, y, th = q
    fx = fy = torque = 0.0
    for m, px, py, d in body.ends(x, y, th):
        gx, gy = body.pull(m, px, py)
        fx += gx
        fy += gy
        torque += d * (cos(th) * gy - sin(th) * gx)
    return [fx / (body.m1 + body.m2), fy / (body.m1 + body.m2), torque / body.J]
