from math import *

m1, m2, L1, L2, G = 1.0, 0.8, 1.2, 0.7, 9.8


def deriv(y, t, L1, L2, m1, m2):
    """Return the first derivatives of y = theta1, z1, theta2, z2."""
    theta1, z1, theta2, z2 = y
    c, s = cos(theta1 - theta2), sin(theta1 - theta2)
    z1dot = (
        (
            m2 * G * sin(theta2) * c
            - m2 * s * (L1 * z1**2 * c + L2 * z2**2)
            - (m1 + m2) * G * sin(theta1)
        )
        / L1
        / (m1 + m2 * s**2)
    )
    z2dot = (
        (
            (m1 + m2) * (L1 * z1**2 * s - G * sin(theta2) + G * sin(theta1) * c)
            + m2 * L2 * z2**2 * s * c
        )
        / L2
        / (m1 + m2 * s**2)
    )
    return z1, z1dot, z2, z2dot


def rhs(y, t):
    return deriv(y, t, L1, L2, m1, m2)
