import math

import numpy as np

try:
    from numba import njit
except ImportError:

    def njit(*args, **kwargs):
        return (lambda f: f) if not args or not callable(args[0]) else args[0]


N = 4
masses = np.array([1.0, 0.7, 0.4, 0.9])
lengths = np.array([0.8, 0.5, 0.6, 0.4])
G = 9.81


@njit("float64[:](float64[:,:],float64[:])", cache=False)
def gauss(A, b):
    n = b.shape[0]
    x = np.empty(n)
    for k in range(n):
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            for j in range(k, n):
                A[i, j] -= f * A[k, j]
            b[i] -= f * b[k]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for j in range(i + 1, n):
            s -= A[i, j] * x[j]
        x[i] = s / A[i, i]
    return x


@njit(fastmath=False)
def chain(t, q, u):
    A = np.zeros((N, N))
    b = np.zeros(N)
    for i in range(N):
        for j in range(N):
            below = 0.0
            for k in range(max(i, j), N):
                below += masses[k]
            A[i, j] = below * lengths[i] * lengths[j] * math.cos(q[i] - q[j])
            b[i] -= below * lengths[i] * lengths[j] * math.sin(q[i] - q[j]) * u[j] ** 2
            if i == j:
                b[i] -= below * G * lengths[i] * math.sin(q[i])
    return gauss(A, b)
