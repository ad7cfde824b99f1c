import numpy as np


def make_rhs(p):
    m1, m2, l1, lc1, lc2, I1, I2, g = (
        p[k] for k in ("m1", "m2", "l1", "lc1", "lc2", "I1", "I2", "g")
    )

    def mass(q):
        c2 = np.cos(q[1])
        M11 = I1 + I2 + m1 * lc1**2 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * c2)
        M12 = I2 + m2 * (lc2**2 + l1 * lc2 * c2)
        M22 = I2 + m2 * lc2**2
        return np.array([[M11, M12], [M12, M22]])

    def bias(q, v):
        h = m2 * l1 * lc2 * np.sin(q[1])
        cor = np.array([-2 * h * v[0] * v[1] - h * v[1] ** 2, h * v[0] ** 2])
        grav = np.array(
            [
                (m1 * lc1 + m2 * l1) * g * np.sin(q[0]) + m2 * lc2 * g * np.sin(q[0] + q[1]),
                m2 * lc2 * g * np.sin(q[0] + q[1]),
            ]
        )
        return cor + grav

    def rhs(t, x):
        q, v = x[:2], x[2:]
        return np.hstack([v, np.linalg.inv(mass(q)) @ (-bias(q, v))])

    return rhs


rhs = make_rhs(dict(m1=1.1, m2=0.9, l1=1.05, lc1=0.5, lc2=0.45, I1=0.083, I2=0.33, g=9.8))
