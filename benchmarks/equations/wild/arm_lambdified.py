from numpy import array, cos, sin


def _lambdifygenerated(t, q, u):
    [q1, q2] = q
    [u1, u2] = u
    x0 = cos(q2)
    x1 = 0.2310 * x0
    x2 = 0.12802
    x3 = x1 + x2
    x4 = 0.92658 + 2 * x1
    x5 = 0.2310 * sin(q2)
    x6 = 9.81 * 0.462 * cos(q1 + q2)
    x7 = x5 * u2 * (2 * u1 + u2) - 9.81 * 1.844 * cos(q1) - x6 - 0.4 * u1
    x8 = -x5 * u1**2 - x6 - 0.3 * u2
    x9 = 1 / (x4 * x2 - x3**2)
    return array([x9 * (x2 * x7 - x3 * x8), x9 * (x4 * x8 - x3 * x7)])
