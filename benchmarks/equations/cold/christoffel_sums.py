"""Two links and a payload, relative angles from the horizontal: Christoffel's symbols by sums."""
import numpy as np

link = {"m": (3.0, 2.1), "l": (0.42, 0.36), "c": (0.2, 0.17), "I": (0.05, 0.025)}
payload = 0.9
g = 9.81
friction = (0.5, 0.35)


def inertia(q2):
    (m1, m2), (l1, l2), (c1, c2), (I1, I2) = link.values()
    k = m2 * c2 + payload * l2
    h = l1 * k * np.cos(q2)
    d = I2 + m2 * c2**2 + payload * l2**2
    return [[I1 + m1 * c1**2 + (m2 + payload) * l1**2 + d + 2 * h, d + h], [d + h, d]]


def dinertia(q2):
    """dM/dq: [i][j][k] is the derivative of M_ij with respect to q_k."""
    k = link["m"][1] * link["c"][1] + payload * link["l"][1]
    h = -link["l"][0] * k * np.sin(q2)
    return [[[0.0, 2 * h], [0.0, h]], [[0.0, h], [0.0, 0.0]]]


def potential_gradient(q):
    (m1, m2), (l1, l2), (c1, c2), _ = link.values()
    outer = (m2 * c2 + payload * l2) * np.cos(q[0] + q[1])
    return [g * ((m1 * c1 + (m2 + payload) * l1) * np.cos(q[0]) + outer), g * outer]


def robot(t, x):
    q, dq = x[:2], x[2:]
    D = dinertia(q[1])
    n = range(2)
    coriolis = [
        sum(0.5 * (D[i][j][k] + D[i][k][j] - D[j][k][i]) * dq[j] * dq[k] for j in n for k in n)
        for i in n
    ]
    G = potential_gradient(q)
    tau = [-coriolis[i] - G[i] - friction[i] * dq[i] for i in n]
    return np.append(dq, np.linalg.solve(inertia(q[1]), tau))
