"""Half car about its equilibrium: heave, pitch, front and rear wheel; x' = A x."""
import numpy as np

ms, Is = 690.0, 1222.0
mf, mr = 40.5, 45.4
kf, kr = 17000.0, 22000.0
cf, cr = 1500.0, 1800.0
kt = 192000.0
a, b = 1.3, 1.5

M = np.diag([ms, Is, mf, mr])
# how far each suspension is compressed, and each tyre, for a unit of (z, theta, zf, zr)
S = np.array([[1, -a, -1, 0], [1, b, 0, -1]])
T = np.array([[0, 0, 1, 0], [0, 0, 0, 1]])
K = S.T @ np.diag([kf, kr]) @ S + kt * T.T @ T
C = S.T @ np.diag([cf, cr]) @ S
Minv = np.linalg.inv(M)
A = np.block([[np.zeros((4, 4)), np.eye(4)], [-Minv @ K, -Minv @ C]])


def f(t, x):
    return A @ x
