import numpy as np

g = 9.81
m = np.array([1.0, 0.7, 0.4])
l = np.array([0.8, 0.5, 0.6])
below = np.cumsum(m[::-1])[::-1]  # mass at and below each rod's end


def f(t, y):
    th, om = np.split(y, 2)
    i = np.arange(len(th))
    mu = below[np.maximum.outer(i, i)] * np.outer(l, l)
    d = th[:, None] - th[None, :]
    M = mu * np.cos(d)
    h = (mu * np.sin(d)) @ om**2 + below * g * l * np.sin(th)
    return np.concatenate([om, -np.linalg.solve(M, h)])
