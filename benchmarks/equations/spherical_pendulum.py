"""The spherical pendulum in Cartesian coordinates, the rod's force eliminated.

E. T. Whittaker, Analytical Dynamics, section 55. From r.r = l^2: r.a + v.v = 0.
"""

import numpy as np

m, l, g = 1.0, 1.0, 9.81


def rhs(t, q, u):
    x, y, z = q
    vx, vy, vz = u
    speed2 = vx**2 + vy**2 + vz**2
    tension = m * (speed2 - g * z) / l
    ax = -tension * x / (m * l)
    ay = -tension * y / (m * l)
    az = -tension * z / (m * l) - g
    return np.array([ax, ay, az])
