import numpy as np

m = np.array([3.1, 2.2])
a1 = 0.5
rc = np.array([0.24, 0.21])
I = np.array([0.07, 0.031])
visc = np.array([0.4, 0.3])
g = np.array([0.0, -9.81])


def jacobians(q):
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    s12, c12 = np.sin(q[0] + q[1]), np.cos(q[0] + q[1])
    J1 = np.array([[-rc[0] * s1, 0.0], [rc[0] * c1, 0.0]])
    J2 = np.array([[-a1 * s1 - rc[1] * s12, -rc[1] * s12], [a1 * c1 + rc[1] * c12, rc[1] * c12]])
    return J1, J2


def jacobian_rates(q, u):
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    s12, c12 = np.sin(q[0] + q[1]), np.cos(q[0] + q[1])
    w1, w2 = u[0], u[0] + u[1]
    Jd1 = np.array([[-rc[0] * c1 * w1, 0.0], [-rc[0] * s1 * w1, 0.0]])
    Jd2 = np.array(
        [
            [-a1 * c1 * w1 - rc[1] * c12 * w2, -rc[1] * c12 * w2],
            [-a1 * s1 * w1 - rc[1] * s12 * w2, -rc[1] * s12 * w2],
        ]
    )
    return Jd1, Jd2


def rhs(t, q, u):
    J1, J2 = jacobians(q)
    Jd1, Jd2 = jacobian_rates(q, u)
    W1, W2 = np.array([1.0, 0.0]), np.array([1.0, 1.0])
    M = m[0] * J1.T @ J1 + m[1] * J2.T @ J2 + I[0] * np.outer(W1, W1) + I[1] * np.outer(W2, W2)
    h = m[0] * J1.T @ (Jd1 @ u) + m[1] * J2.T @ (Jd2 @ u)
    Q = m[0] * J1.T @ g + m[1] * J2.T @ g - visc * u
    return np.linalg.solve(M, Q - h)
