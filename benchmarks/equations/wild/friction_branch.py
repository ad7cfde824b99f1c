import numpy as np

m1, m2, k, mu, vs, ks, gap, g = 1.5, 0.9, 30.0, 0.2, 0.05, 400.0, 0.3, 9.81


def stop(d):
    """The force of a stop that the spring's stretch d may meet."""
    if d > gap:
        return ks * (d - gap)
    return 0.0


def rhs(t, q, u):
    d = q[1] - q[0]
    F = k * d + stop(d)
    R = mu * m1 * g * np.tanh(u[0] / vs)
    return np.array([(F - R) / m1, -F / m2])
