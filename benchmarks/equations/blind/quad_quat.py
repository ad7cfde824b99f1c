"""Quadrotor (no propellers turning): position, velocity, quaternion (w, x, y, z), body rates."""
import json

import numpy as np
import numpy.typing as npt

CONFIG = json.loads("""
{"vehicle": {"mass": 0.87, "inertia": [0.0031, 0.0036, 0.0057]},
 "drag": [0.21, 0.21, 0.34], "gravity": 9.81}
""")

Vec = npt.NDArray[np.float64]


def rotation(q: Vec) -> Vec:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def omega_matrix(w: Vec) -> Vec:
    p, q, r = w
    return np.array([[0, -p, -q, -r], [p, 0, r, -q], [q, -r, 0, p], [r, q, -p, 0]])


def f(t: float, s: Vec, cfg: dict = CONFIG) -> Vec:
    """s = (x, y, z, qw, qx, qy, qz, vx, vy, vz, p, q, r)"""
    quat, v, w = s[3:7], s[7:10], s[10:13]
    m = cfg["vehicle"]["mass"]
    J = np.diag(cfg["vehicle"]["inertia"])
    R = rotation(quat)
    D = np.diag(cfg["drag"])
    force = -R @ D @ R.T @ v
    a = np.array([0.0, 0.0, -cfg["gravity"]]) + force / m
    wdot = np.linalg.inv(J) @ (-np.cross(w, J @ w))
    return np.hstack([v, 0.5 * omega_matrix(w) @ quat, a, wdot])
