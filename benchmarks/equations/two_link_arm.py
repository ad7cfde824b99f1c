"""Two rods, M u̇ = f solved for u̇ by Cramer's rule.

Lagrange's equations of two rods in absolute angles, with dampers and a spring at the elbow.
"""

import numpy as np

m1, m2, l1, l2, g = 1.3, 0.7, 0.6, 0.45, 9.81
c1, c2, k = 0.11, 0.07, 2.3


def rhs(t, q, u):
    a, b = q
    va, vb = u
    M11 = (m1 / 3 + m2) * l1**2
    M12 = m2 * l1 * l2 / 2 * np.cos(a - b)
    M22 = m2 * l2**2 / 3
    s = m2 * l1 * l2 / 2 * np.sin(a - b)
    elbow = k * (b - a) + c2 * (vb - va)
    f1 = -s * vb**2 - (m1 / 2 + m2) * g * l1 * np.sin(a) - c1 * va + elbow
    f2 = s * va**2 - m2 * g * l2 / 2 * np.sin(b) - elbow
    det = M11 * M22 - M12**2
    return np.array([(M22 * f1 - M12 * f2) / det, (M11 * f2 - M12 * f1) / det])
