import numpy as np

m0, m1, m2, m3 = 1.0, 1.4, 0.8, 1.7
k0, k1, k2, k3 = 90.0, 60.0, 75.0, 40.0
c0, c1, c2, c3 = 0.5, 0.7, 0.4, 0.3
M = np.diag([m0, m1, m2, m3])


def tri(a, b, c, d):
    return np.array([[a + b, -b, 0, 0], [-b, b + c, -c, 0], [0, -c, c + d, -d], [0, 0, -d, d]])


K = tri(k0, k1, k2, k3)
C = tri(c0, c1, c2, c3)
A = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.linalg.inv(M) @ K, -np.linalg.inv(M) @ C]])


def statespace(t, x):
    return A @ x
