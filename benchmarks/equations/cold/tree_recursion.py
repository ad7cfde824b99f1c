"""A planar tree (torso with two arms, one with a forearm): Jacobians by recursion over the parents."""
import numpy as np

BODIES = {
    "torso": dict(parent=None, at=(0.0, 0.0), m=8.2, com=(0.0, 0.26), I=0.31),
    "arm": dict(parent="torso", at=(0.11, 0.5), m=1.9, com=(0.13, 0.0), I=0.014),
    "forearm": dict(parent="arm", at=(0.28, 0.0), m=1.2, com=(0.12, 0.01), I=0.009),
    "other": dict(parent="torso", at=(-0.12, 0.48), m=2.3, com=(-0.15, 0.02), I=0.017),
}
GRAVITY = np.array([0.0, -9.81])
INDEX = {name: k for k, name in enumerate(BODIES)}


def angle(name, q):
    parent = BODIES[name]["parent"]
    return q[INDEX[name]] + (angle(parent, q) if parent else 0.0)


def turned(vector, a):
    c, s = np.cos(a), np.sin(a)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def frame(name, q, u):
    """Jacobian (2, n) and bias acceleration of the joint, Jacobian (n,) and rate of the turn."""
    body = BODIES[name]
    if body["parent"] is None:
        J, bias, W = np.zeros((2, len(q))), np.zeros(2), np.zeros(len(q))
    else:
        J, bias, W = moved(body["parent"], body["at"], q, u)
    W = W.copy()
    W[INDEX[name]] = 1.0
    return J, bias, W


def moved(name, point, q, u):
    """The same for a point of a body."""
    J, bias, W = frame(name, q, u)
    r = turned(point, angle(name, q))
    across = np.array([-r[1], r[0]])
    return J + np.outer(across, W), bias - r * (W @ u) ** 2, W


def dynamics(t, q, u):
    n = len(BODIES)
    M, f = np.zeros((n, n)), np.zeros(n)
    for name, body in BODIES.items():
        J, bias, W = moved(name, body["com"], q, u)
        M += body["m"] * J.T @ J + body["I"] * np.outer(W, W)
        f += body["m"] * J.T @ (GRAVITY - bias)
    return np.linalg.solve(M, f)
