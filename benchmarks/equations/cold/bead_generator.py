"""A bead on a straight wire that turns about the vertical at a constant rate, inclined."""
from functools import reduce
import operator

OMEGA, INCL = 2.7, 0.6
m, g, k, rest, c = 0.15, 9.81, 5.5, 0.4, 0.03


def prod(*xs):
    return reduce(operator.mul, xs, 1.0)


def forces(s, v):
    from math import sin, cos
    yield prod(m, OMEGA**2, cos(INCL)**2, s)
    yield -prod(m, g, sin(INCL))
    yield -k * (s - rest)
    yield -c * v


def bead(t, q, u):
    return [sum(forces(q[0], u[0])) / m]
