import numpy as np

M1, M2 = 1.4, 0.9
LA, LB = 0.8, 0.55
GRAV = 9.80665
ALPHA = BETA = 5.0  # Baumgarte
DRAG = 0.07

mass = np.array([M1, M1, M2, M2])


def phi(q):
    x1, y1, x2, y2 = q
    return np.array([0.5 * (x1**2 + y1**2 - LA**2), 0.5 * ((x2 - x1) ** 2 + (y2 - y1) ** 2 - LB**2)])


def jacobian(q):
    x1, y1, x2, y2 = q
    dx, dy = x2 - x1, y2 - y1
    return np.array([[x1, y1, 0, 0], [-dx, -dy, dx, dy]])


def gamma(v):
    ex, ey = v[2] - v[0], v[3] - v[1]
    return -np.array([v[0] ** 2 + v[1] ** 2, ex**2 + ey**2])


def accelerations(t, q, v):
    W = np.diag(1.0 / mass)
    F = -DRAG * v
    F[1] -= M1 * GRAV
    F[3] -= M2 * GRAV
    J = jacobian(q)
    S = J @ W @ J.T
    rhs = gamma(v) - J @ W @ F - 2 * ALPHA * J @ v - BETA**2 * phi(q)
    lam = np.linalg.solve(S, rhs)
    return W @ (F + J.T @ lam)
