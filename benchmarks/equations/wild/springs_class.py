import numpy as np


class Particle:
    def __init__(self, mass):
        self.mass = mass
        self.force = np.zeros(2)

    def clear(self):
        self.force = np.zeros(2)


class Spring:
    def __init__(self, k, rest):
        self.k, self.rest = k, rest

    def pull(self, a, b, xa, xb):
        e = xb - xa
        length = np.linalg.norm(e)
        f = self.k * (length - self.rest) * e / length
        a.force = a.force + f
        b.force = b.force - f


class World:
    def __init__(self):
        self.a, self.b = Particle(1.2), Particle(0.8)
        self.spring = Spring(14.0, 0.9)

    def accelerations(self, t, q, u):
        for body in (self.a, self.b):
            body.clear()
        self.spring.pull(self.a, self.b, q[:2], q[2:])
        return np.concatenate([self.a.force / self.a.mass, self.b.force / self.b.mass])


world = World()
