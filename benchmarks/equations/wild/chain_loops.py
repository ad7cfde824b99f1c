import numpy as np

N = 3
g = 9.81
m = np.array([1.0, 0.7, 0.4])
l = np.array([0.8, 0.5, 0.6])


def rhs(t, q, u):
    M = np.zeros((N, N))
    f = np.zeros(N)
    for i in range(N):
        for j in range(N):
            mass = 0.0
            for k in range(max(i, j), N):
                mass += m[k]
            M[i, j] = mass * l[i] * l[j] * np.cos(q[i] - q[j])
            f[i] -= mass * l[i] * l[j] * np.sin(q[i] - q[j]) * u[j] ** 2
        f[i] -= sum(m[i:]) * g * l[i] * np.sin(q[i])
    return np.linalg.solve(M, f)
