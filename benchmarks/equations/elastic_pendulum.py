"""A particle on a spring, in Cartesian coordinates.

A. Vitt, G. Gorelik, J. Tech. Phys. 3 (1933).
"""

import numpy as np

m, g, k, l0 = 1.0, 9.81, 39.24, 0.75


def rhs(t, q, u):
    x, y = q
    length = np.sqrt(x**2 + y**2)
    pull = k * (length - l0)
    return np.array([-pull * x / length / m, -pull * y / length / m - g])
