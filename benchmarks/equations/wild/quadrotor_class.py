import numpy as np


class Quadrotor:
    def __init__(self):
        self.m = 0.51
        self.g = 9.81
        self.J = np.diag([0.0023, 0.0031, 0.0044])
        self.Jinv = np.linalg.inv(self.J)
        self.kd = 0.11

    def f(self, t, s):
        pos, angles, vel, omega = s[0:3], s[3:6], s[6:9], s[9:12]
        phi, theta, psi = angles
        T = np.array(
            [
                [1.0, np.sin(phi) * np.tan(theta), np.cos(phi) * np.tan(theta)],
                [0.0, np.cos(phi), -np.sin(phi)],
                [0.0, np.sin(phi) / np.cos(theta), np.cos(phi) / np.cos(theta)],
            ]
        )
        ds = np.zeros(12)
        ds[0:3] = vel
        ds[3:6] = T @ omega
        ds[6:9] = np.array([0.0, 0.0, -self.g]) - self.kd / self.m * vel
        ds[9:12] = self.Jinv @ (-np.cross(omega, self.J @ omega))
        return ds
