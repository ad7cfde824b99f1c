"""The heavy top on a fixed tip: Euler's equations about the tip, angular velocity in body components.

O. Brüls, A. Cardona, J. Comput. Nonlinear Dyn. 5 (2010) 031002 (the data); L. D. Landau, E. M.
Lifshitz, Mechanics, section 36 (the equations). The mass centre is at `h` on the body's y axis.
"""

import numpy as np

m = 15.0
g = 9.81
h = 1.0
Jx, Jy, Jz = 0.234375, 0.46875, 0.234375  # about the mass centre
A, B, C = Jx + m * h**2, Jy, Jz + m * h**2  # about the tip


def down(q):
    """The direction of gravity in body components."""
    w, x, y, z = q
    return -2 * (x * z - w * y), -2 * (y * z + w * x), -(w**2 - x**2 - y**2 + z**2)


def rhs(t, q, u):
    wx, wy, wz = u
    dx, dy, dz = down(q)
    Mx = h * m * g * dz
    Mz = -h * m * g * dx
    ax = (Mx - (C - B) * wy * wz) / A
    ay = -(A - C) * wz * wx / B
    az = (Mz - (B - A) * wx * wy) / C
    return np.array([ax, ay, az])
