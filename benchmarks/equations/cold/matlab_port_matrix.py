"""Ported from MATLAB: two links in the vertical plane, np.matrix."""
import numpy as np

I1 = 0.084; I2 = 0.033; m1 = 2.4; m2 = 1.3; a1 = 0.5; r1 = 0.24; r2 = 0.19; g = 9.81
alpha = I1 + I2 + m1*r1**2 + m2*(a1**2 + r2**2)
beta = m2*a1*r2
delta = I2 + m2*r2**2


def twolink(t, x):
    q = np.matrix(x[0:2]).T
    qd = np.matrix(x[2:4]).T
    c2 = np.cos(q[1, 0]); s2 = np.sin(q[1, 0])
    Mq = np.matrix([[alpha + 2*beta*c2, delta + beta*c2],
                    [delta + beta*c2, delta]])
    Cq = np.matrix([[-beta*s2*qd[1, 0], -beta*s2*(qd[0, 0] + qd[1, 0])],
                    [beta*s2*qd[0, 0], 0]])
    Gq = np.matrix([[m1*g*r1*np.cos(q[0, 0]) + m2*g*(a1*np.cos(q[0, 0]) + r2*np.cos(q[0, 0] + q[1, 0]))],
                    [m2*g*r2*np.cos(q[0, 0] + q[1, 0])]])
    qdd = Mq.I * (-Cq*qd - Gq)
    return np.concatenate((qd, qdd)).A1
