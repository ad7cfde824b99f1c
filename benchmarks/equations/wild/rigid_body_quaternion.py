import numpy as np


class RigidBody:
    """Attitude dynamics with a unit quaternion, scalar first."""

    def __init__(self, inertia=(0.7, 1.1, 1.6)):
        self.I = np.diag(inertia)

    def quaternion_rate(self, q, w):
        w0, x, y, z = q
        return 0.5 * np.array(
            [
                -x * w[0] - y * w[1] - z * w[2],
                w0 * w[0] + y * w[2] - z * w[1],
                w0 * w[1] + z * w[0] - x * w[2],
                w0 * w[2] + x * w[1] - y * w[0],
            ]
        )

    def __call__(self, t, state):
        q, w = state[:4], state[4:]
        alpha = np.linalg.solve(self.I, np.cross(self.I @ w, w))
        return np.r_[self.quaternion_rate(q, w), alpha]


body = RigidBody()
