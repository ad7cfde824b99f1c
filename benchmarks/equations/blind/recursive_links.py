import numpy as np

g = 9.81
m = [1.0, 0.7, 0.4, 0.9]
l = [0.8, 0.5, 0.6, 0.4]


def jacobian(q, k):
    """Of particle k, by recursion from the ceiling."""
    if k < 0:
        return np.zeros((2, len(q)))
    J = jacobian(q, k - 1).copy()
    J[:, k] = l[k] * np.array([np.cos(q[k]), np.sin(q[k])])
    return J


def drift(q, u, k):
    if k < 0:
        return np.zeros(2)
    return drift(q, u, k - 1) + l[k] * u[k] ** 2 * np.array([-np.sin(q[k]), np.cos(q[k])])


def f(t, q, u):
    M = np.zeros((4, 4))
    rhs = np.zeros(4)
    for k, mk in enumerate(m):
        J = jacobian(q, k)
        M += mk * J.T @ J
        rhs += J.T @ (mk * (np.array([0.0, -g]) - drift(q, u, k)))
    return np.linalg.solve(M, rhs)
