"""The triple pendulum of the thesis, with dampers, in absolute angles.

K. Gugaratshan, M.S.E. thesis, Western Michigan University, 2008, (3.1.17)-(3.1.19), with a damper on
the relative rate in each joint.
"""

import numpy as np

g = 9.8
m1, m2, m3 = 10 / 9.8, 30 / 9.8, 20 / 9.8
l1, l2, l3 = 0.1, 0.25, 0.5
c1, c2, c3 = 0.1, 0.08, 0.05

r1, r2, r3 = l1 / 2, l2 / 2, l3 / 2
I1, I2, I3 = m1 * l1**2 / 12, m2 * l2**2 / 12, m3 * l3**2 / 12


def rhs(t, q, u):
    th1, th2, th3 = q[0], q[1], q[2]
    w1, w2, w3 = u[0], u[1], u[2]

    S21, C21 = np.sin(th2 - th1), np.cos(th2 - th1)
    S31, C31 = np.sin(th3 - th1), np.cos(th3 - th1)
    S32, C32 = np.sin(th3 - th2), np.cos(th3 - th2)

    M11 = I1 + m1 * r1**2 + (m2 + m3) * l1**2
    M12 = (m2 * r2 + m3 * l2) * l1 * C21
    M13 = m3 * l1 * r3 * C31
    M22 = I2 + m2 * r2**2 + m3 * l2**2
    M23 = m3 * l2 * r3 * C32
    M33 = I3 + m3 * r3**2

    f1 = (m2 * r2 + m3 * l2) * l1 * S21 * w2**2 + m3 * l1 * r3 * S31 * w3**2
    f1 = f1 - (m1 * r1 + (m2 + m3) * l1) * g * np.sin(th1) - c1 * w1 + c2 * (w2 - w1)
    f2 = -(m2 * r2 + m3 * l2) * l1 * S21 * w1**2 + m3 * l2 * r3 * S32 * w3**2
    f2 = f2 - (m2 * r2 + m3 * l2) * g * np.sin(th2) - c2 * (w2 - w1) + c3 * (w3 - w2)
    f3 = -m3 * l1 * r3 * S31 * w1**2 - m3 * l2 * r3 * S32 * w2**2
    f3 = f3 - m3 * r3 * g * np.sin(th3) - c3 * (w3 - w2)

    M = np.array([[M11, M12, M13], [M12, M22, M23], [M13, M23, M33]])
    return np.linalg.solve(M, np.array([f1, f2, f3]))
