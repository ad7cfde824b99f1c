import numpy as np

mass = np.array([1.2, 0.8])
k, L0 = 14.0, 0.9


def rhs(t, q, u):
    x = np.ascontiguousarray(q).reshape(2, 2)
    e = x[1] - x[0]
    n = e / np.sqrt(np.einsum("i,i->", e, e))
    stretch = np.einsum("i,i", e, n) - L0
    F = np.stack([k * stretch * n, -k * stretch * n])
    return np.einsum("ij,i->ij", F, 1 / mass).ravel()
