import crane_values as prm
import numpy as np


def crane(t, z):
    """z = [x, phi, xdot, phidot]"""
    x, phi, xd, phid = z
    total = prm.M + prm.m
    A = np.array(
        [[total, prm.m * prm.L * np.cos(phi)], [prm.m * prm.L * np.cos(phi), prm.m * prm.L**2]]
    )
    rhs = np.array(
        [
            prm.m * prm.L * phid**2 * np.sin(phi) - prm.bx * xd,
            -prm.m * prm.g * prm.L * np.sin(phi) - prm.bt * phid,
        ]
    )
    acc = np.linalg.solve(A, rhs)
    return [xd, phid, *acc]
