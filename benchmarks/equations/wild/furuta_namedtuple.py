from collections import namedtuple

import numpy as np

Furuta = namedtuple("Furuta", "Ja m r l g b")
par = Furuta(Ja=0.021, m=0.13, r=0.21, l=0.16, g=9.81, b=0.002)


def accelerations(t, q, qd, par=par):
    theta, alpha = q
    dtheta, dalpha = qd
    sa, ca = np.sin(alpha), np.cos(alpha)
    M = np.zeros((2, 2))
    M[0, 0] = par.Ja + par.m * (par.r**2 + par.l**2 * sa**2)
    M[0, 1] = M[1, 0] = par.m * par.r * par.l * ca
    M[1, 1] = par.m * par.l**2
    tau = np.zeros(2)
    tau[0] -= par.b * dtheta
    tau[0] -= 2 * par.m * par.l**2 * sa * ca * dtheta * dalpha
    tau[0] += par.m * par.r * par.l * sa * dalpha**2
    tau[1] += par.m * par.l**2 * sa * ca * dtheta**2
    tau[1] += par.m * par.g * par.l * sa
    return np.linalg.solve(M, tau)
