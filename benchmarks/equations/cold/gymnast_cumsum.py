"""Four uniform rods hanging from a bar, relative angles; vectors and outer differences."""
import numpy as np

G = 9.81
MASS = np.array([6.1, 17.0, 9.4, 5.5])
LEN = np.array([0.62, 0.51, 0.43, 0.4])
DAMP = np.array([0.2, 0.7, 0.5, 0.3])
COM = LEN / 2
INERTIA = MASS * LEN**2 / 12
BELOW = np.cumsum(MASS[::-1])[::-1] - MASS  # masses hanging from each rod's end
FIRST = MASS * COM + BELOW * LEN
T = np.tril(np.ones((4, 4)))


def coefficients():
    C = np.triu(np.outer(LEN, FIRST), 1)
    return C + C.T + np.diag(INERTIA + MASS * COM**2 + BELOW * LEN**2)


def swing(t, q, u):
    a = np.cumsum(q)
    w = np.cumsum(u)
    D = np.subtract.outer(a, a)
    C = coefficients()
    M = C * np.cos(D)
    h = (C * np.sin(D)) @ w**2 + G * FIRST * np.sin(a)
    return np.linalg.solve(T.T @ M @ T, -T.T @ h - DAMP * u)
