import numpy as np

P = (2.7, 1.0, 9.81)


def swinging_atwood(du, u, p, t):
    """Port of a Julia script: fills du."""
    M, m, g = p
    r, theta, rdot, thetadot = u
    du[0] = rdot
    du[1] = thetadot
    du[2] = (m * r * thetadot**2 + m * g * np.cos(theta) - M * g) / (M + m)
    du[3] = -(2 * rdot * thetadot + g * np.sin(theta)) / r
    return None


def rhs(t, y):
    du = np.zeros_like(y)
    swinging_atwood(du, y, P, t)
    return du
