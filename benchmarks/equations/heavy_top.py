"""A heavy body on a fixed tip: Euler's equations about the tip, angular velocity in body components.

L. D. Landau, E. M. Lifshitz, Mechanics, section 36. The mass centre is at `h` on the body's y axis; the
moments of inertia differ, so that no mistake is hidden by a symmetry.
"""

import numpy as np

m = 15.0
g = 9.81
h = 0.8
Jx, Jy, Jz = 0.3, 0.47, 0.39  # about the mass centre
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
