import numpy as np

try:
    from numba import njit
except ImportError:

    def njit(f):
        return f


Ja, m, r, l, g, b = 0.021, 0.13, 0.21, 0.16, 9.81, 0.002
p1 = Ja + m * r * r
p2 = m * l * l
p3 = m * r * l
p4 = m * l * g


@njit
def f(t, x):
    th, al, thd, ald = x[0], x[1], x[2], x[3]
    s = np.sin(al)
    c = np.cos(al)
    den = (p1 + p2 * s * s) * p2 - (p3 * c) ** 2
    n1 = -b * thd - 2 * p2 * s * c * thd * ald + p3 * s * ald**2
    n2 = p2 * s * c * thd**2 + p4 * s
    out = np.empty(4)
    out[0] = thd
    out[1] = ald
    out[2] = (p2 * n1 - p3 * c * n2) / den
    out[3] = ((p1 + p2 * s * s) * n2 - p3 * c * n1) / den
    return out
