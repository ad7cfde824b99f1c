"""Chaplygin's sleigh: the blade's point (x, y) and its heading, with the constraint eliminated.

A. M. Bloch, Nonholonomic Mechanics and Control, section 1.7: with v along the blade,
m (v' - a w^2) = 0 and (I + m a^2) w' + m a v w = 0.
"""

import numpy as np

m, I, a = 1.0, 1.0, 0.5


def rhs(t, q, u):
    c, s = np.cos(q[2]), np.sin(q[2])
    w = u[2]
    v = u[0] * c + u[1] * s
    v_dot = a * w**2
    w_dot = -m * a * v * w / (I + m * a**2)
    x_ddot = v_dot * c - v * w * s
    y_ddot = v_dot * s + v * w * c
    return np.array([x_ddot, y_ddot, w_dot])
