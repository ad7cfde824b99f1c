import numpy as np

m, g, h, I1, I3 = 0.3, 9.81, 0.07, 0.0025, 0.0011


def top(t, q, u):
    th = q[0]
    thd, phd, psd = u
    s, c = np.sin(th), np.cos(th)
    spin = psd + phd * c
    thdd = (I1 * phd**2 * s * c - I3 * spin * phd * s + m * g * h * s) / I1
    phdd = (I3 * spin * thd - 2 * I1 * phd * thd * c) / (I1 * s)
    psdd = phd * thd * s - phdd * c
    return np.array([thdd, phdd, psdd])
