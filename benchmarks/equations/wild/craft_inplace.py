import numpy as np

m, J, g, d, dw = 1.4, 0.09, 9.81, 0.2, 0.03


def craft(t, x, u1=0.0, u2=0.0):
    q, qd = x.reshape(2, 3)
    acc = np.zeros(3)
    acc[:2] -= d * qd[:2] / m
    acc[0] += -(u1 + u2) * np.sin(q[2]) / m
    acc[1] += (u1 + u2) * np.cos(q[2]) / m - g
    acc[2] -= dw * qd[2] / J
    return np.ravel([qd, acc])
