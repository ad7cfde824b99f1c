"""A heavy body on a fixed tip: quaternion (w, x, y, z) and body rates, by SciPy's Rotation."""
import numpy as np
from scipy.spatial.transform import Rotation

m, g = 0.62, 9.81
tip_to_com = np.array([0.01, 0.0, 0.083])
inertia_tip = np.array([0.0062, 0.0059, 0.0018])


def body(t, y):
    q, w = y[:4], y[4:]
    R = Rotation.from_quat(np.roll(q / np.linalg.norm(q), -1))
    weight = R.inv().apply([0.0, 0.0, -m * g])
    L = inertia_tip * w
    dw = (np.cross(tip_to_com, weight) - np.cross(w, L)) / inertia_tip
    W = np.array([
        [0.0, -w[0], -w[1], -w[2]],
        [w[0], 0.0, w[2], -w[1]],
        [w[1], -w[2], 0.0, w[0]],
        [w[2], w[1], -w[0], 0.0],
    ])
    return np.concatenate([0.5 * W @ q, dw])
