"""A skate on an inclined plane, downhill is -x; multiplier by least squares."""
from types import MappingProxyType

import numpy as np

PAR = MappingProxyType(dict(m=1.7, J=0.043, g=9.81, slope=0.31))


def constraint_rows(q, qd):
    """A(q) qd = 0 and the part of its derivative without accelerations."""
    s, c = np.sin(q[2]), np.cos(q[2])
    A = np.array([[-s, c, 0.0]])
    dA = np.array([[-c, -s, 0.0]]) * qd[2]
    return A, dA @ qd


def sleigh(t, q, qd, par=PAR):
    M = np.diag([par["m"], par["m"], par["J"]])
    A, gamma = constraint_rows(q, qd)
    Q = np.array([-par["m"] * par["g"] * np.sin(par["slope"]), 0.0, 0.0])
    K = np.zeros((4, 4))
    K[:3, :3] = M
    K[:3, 3:] = -A.T
    K[3:, :3] = A
    sol, *_ = np.linalg.lstsq(K, np.concatenate([Q, -gamma]), rcond=None)
    return sol[:3]
