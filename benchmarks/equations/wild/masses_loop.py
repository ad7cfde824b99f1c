import numpy as np

m = [1.0, 1.4, 0.8, 1.7]
k = [90.0, 60.0, 75.0, 40.0]
c = [0.5, 0.7, 0.4, 0.3]


def rhs(t, x, v):
    F = np.zeros(4)
    for i in range(4):
        left = x[i - 1] if i > 0 else 0.0
        vleft = v[i - 1] if i > 0 else 0.0
        f = k[i] * (x[i] - left) + c[i] * (v[i] - vleft)
        F[i] -= f
        if i > 0:
            F[i - 1] += f
    return F / m
