import numpy as np


def tora(M=1.36, m=0.096, e=0.0592, I=0.0002175, k=186.3):
    def rhs(t, q, u):
        x, th = q
        J = I + m * e**2
        D = J * (M + m) - (m * e * np.cos(th)) ** 2
        xdd = (J * (m * e * u[1] ** 2 * np.sin(th) - k * x)) / D
        thdd = (m * e * np.cos(th) * (k * x - m * e * u[1] ** 2 * np.sin(th))) / D
        return np.array([xdd, thdd])

    return rhs


rhs = tora()
