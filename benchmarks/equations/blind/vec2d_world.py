"""A small physics engine: vectors with operators, rods as constraints."""

import numpy as np


class Vec2d:
    __slots__ = ("x", "y")

    def __init__(self, x, y):
        self.x = x
        self.y = y

    def __add__(self, other):
        return Vec2d(self.x + other.x, self.y + other.y)

    def __sub__(self, other):
        return Vec2d(self.x - other.x, self.y - other.y)

    def __mul__(self, k):
        return Vec2d(self.x * k, self.y * k)

    __rmul__ = __mul__

    def __truediv__(self, k):
        return Vec2d(self.x / k, self.y / k)

    def dot(self, other):
        return self.x * other.x + self.y * other.y


m1, m2, g = 1.3, 0.8, 9.81
origin = Vec2d(0.0, 0.0)


def accelerations(t, q, u):
    p1, p2 = Vec2d(q[0], q[1]), Vec2d(q[2], q[3])
    v1, v2 = Vec2d(u[0], u[1]), Vec2d(u[2], u[3])
    d1, d2 = p1 - origin, p2 - p1
    e = v2 - v1
    # multipliers of the two rods
    a11 = d1.dot(d1) / m1
    a12 = -1.0 * d1.dot(d2) / m1
    a22 = d2.dot(d2) * (1 / m1 + 1 / m2)
    gravity = Vec2d(0.0, -g)
    b1 = -(d1.dot(gravity) + v1.dot(v1))
    b2 = -e.dot(e)
    det = a11 * a22 - a12 * a12
    s1 = (b1 * a22 - b2 * a12) / det
    s2 = (a11 * b2 - a12 * b1) / det
    acc1 = gravity + (s1 * d1 - s2 * d2) / m1
    acc2 = gravity + d2 * s2 / m2
    return [acc1.x, acc1.y, acc2.x, acc2.y]
