from types import SimpleNamespace

import numpy as np

c = SimpleNamespace(M=2.3, m=0.7, L=1.4, g=9.81, bx=0.3, bt=0.05)


def rhs(t, q, u, F=0.0):
    phi, phid, xd = q[1], u[1], u[0]
    assert np.all(np.isfinite(q)), "state blew up"
    s, co = np.sin(phi), np.cos(phi)
    D = c.M + c.m * s**2
    xdd = (F - c.bx * xd + c.m * s * (c.L * phid**2 + c.g * co) + c.bt * phid * co / c.L) / D
    phidd = (
        -(F - c.bx * xd) * co
        - c.m * c.L * phid**2 * s * co
        - (c.M + c.m) * c.g * s
        - (c.M + c.m) * c.bt * phid / (c.m * c.L)
    ) / (c.L * D)
    return np.array([xdd, phidd])
