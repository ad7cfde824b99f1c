"""Spherical pendulum in Cartesian coordinates with drag; the thread's pull from its constraint."""
import numpy as np

ARGS = (0.45, 9.81, 0.06)
E_Z = np.array([0.0, 0.0, 1.0])


def ode(t, y, m, g, c):
    r, v = y[:3], y[3:]
    a_free = -g * E_Z - c / m * v
    pull = -(np.dot(v, v) + np.dot(r, a_free)) / np.dot(r, r)
    return np.r_[v, a_free + pull * r]


fun = lambda t, y: ode(t, y, *ARGS)
