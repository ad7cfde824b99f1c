import numpy as np

prm = dict(m=0.3, a=1.7, g=9.81)


def bead_on_wire(t, q, v, p=prm):
    """[M G'; G 0] [a; -lam] = [f; gamma]"""
    x, y = q
    M = p["m"] * np.eye(2)
    G = np.atleast_2d([-2 * p["a"] * x, 1.0])
    KKT = np.block([[M, G.T], [G, np.zeros((1, 1))]])
    f = np.array([0.0, -p["m"] * p["g"]])
    gamma = np.array([2 * p["a"] * v[0] ** 2])
    return np.linalg.solve(KKT, np.hstack((f, gamma)))[:2]
