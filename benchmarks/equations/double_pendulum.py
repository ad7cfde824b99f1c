"""The double pendulum in absolute angles, solved for the accelerations by hand.

L. D. Landau, E. M. Lifshitz, Mechanics, section 5, problem 1 (the Lagrangian).
"""

from math import cos, sin

m1 = 1.0
m2 = 1.0
l1 = 1.0
l2 = 1.0
g = 9.81


def rhs(t, q, u):
    a, b = q
    va, vb = u
    d = a - b
    D = m1 + m2 * sin(d) ** 2
    acc_a = -m2 * sin(d) * (l1 * va**2 * cos(d) + l2 * vb**2) - (m1 + m2) * g * sin(a)
    acc_a += m2 * g * sin(b) * cos(d)
    acc_b = (m1 + m2) * (l1 * va**2 * sin(d) + g * sin(a) * cos(d) - g * sin(b))
    acc_b += m2 * l2 * vb**2 * sin(d) * cos(d)
    return [acc_a / (l1 * D), acc_b / (l2 * D)]
