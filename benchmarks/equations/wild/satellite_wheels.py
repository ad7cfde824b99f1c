import numpy as np

Jx, Jy, Jz, Jw = 1.2, 0.9, 1.5, 0.02
# the hull and the wheels, with all that does not turn about its own wheel's axis
WHEEL = np.diag([Jw, Jw, Jw])
J = np.diag([Jx, Jy, Jz]) + WHEEL + 2 * np.diag([0.02, 0.02, 0.02])


def skew(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rates(t, q, u):
    w, Om = u[:3], u[3:]
    H = J @ w + WHEEL @ Om
    dw = np.linalg.solve(J - WHEEL, -skew(w) @ H)
    return np.hstack((dw, -dw))
