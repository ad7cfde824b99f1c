"""Serial-link arm in the manner of robotics toolboxes: recursive Newton-Euler, M column by column."""

import numpy as np


class Link:
    def __init__(self, a, m, r, I):
        self.a, self.m, self.I = a, m, I
        self.r = np.array([r, 0.0, 0.0])

    def A(self, q):
        c, s = np.cos(q), np.sin(q)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class SerialLink:
    def __init__(self, links, gravity=(0.0, 9.81, 0.0)):
        self.links = links
        self.gravity = np.asarray(gravity)
        self.n = len(links)

    def rne(self, q, qd, qdd, grav=None):
        grav = self.gravity if grav is None else np.asarray(grav)
        z0 = np.array([0.0, 0.0, 1.0])
        w, wd, vd = np.zeros(3), np.zeros(3), grav
        F, N, Rs = [], [], []
        p = np.zeros(3)
        for j, link in enumerate(self.links):
            R = link.A(q[j])
            vd = R.T @ (vd + np.cross(wd, p) + np.cross(w, np.cross(w, p)))
            wd = R.T @ wd + z0 * qdd[j]
            w = R.T @ w + z0 * qd[j]
            ac = vd + np.cross(wd, link.r) + np.cross(w, np.cross(w, link.r))
            F.append(link.m * ac)
            N.append(link.I * wd)
            Rs.append(R)
            p = np.array([link.a, 0.0, 0.0])
        tau = np.zeros(self.n)
        f, nn = np.zeros(3), np.zeros(3)
        for j in reversed(range(self.n)):
            link = self.links[j]
            Rn = Rs[j + 1] if j + 1 < self.n else np.eye(3)
            f_child = Rn @ f
            nn = Rn @ nn + np.cross([link.a, 0.0, 0.0], f_child) + np.cross(link.r, F[j]) + N[j]
            f = f_child + F[j]
            tau[j] = nn[2]
        return tau

    def inertia(self, q):
        zero = np.zeros(self.n)
        return np.column_stack([self.rne(q, zero, e, grav=[0, 0, 0]) for e in np.eye(self.n)])

    def accel(self, q, qd, torque=None):
        tau = np.zeros(self.n) if torque is None else torque
        bias = self.rne(q, qd, np.zeros(self.n))
        return np.linalg.solve(self.inertia(q), tau - bias)


robot = SerialLink([Link(0.5, 2.0, 0.26, 0.05), Link(0.4, 1.5, 0.18, 0.03), Link(0.3, 0.8, 0.13, 0.009)])


def forward(t, x):
    q, qd = x[:3], x[3:]
    return np.r_[qd, robot.accel(q, qd)]
