import numpy as np


class Quaternion:
    def __init__(self, w, x, y, z):
        self.w, self.x, self.y, self.z = w, x, y, z

    @property
    def vec(self):
        return np.array([self.x, self.y, self.z])

    def __mul__(self, o):
        v = self.w * o.vec + o.w * self.vec + np.cross(self.vec, o.vec)
        return Quaternion(self.w * o.w - self.vec @ o.vec, *v)

    def conj(self):
        return Quaternion(self.w, -self.x, -self.y, -self.z)

    def rotate(self, v):
        return (self * Quaternion(0.0, *v) * self.conj()).vec

    def asarray(self):
        return np.array([self.w, self.x, self.y, self.z])


class HeavyBody:
    m, g, h = 0.4, 9.81, 0.06
    inertia = np.array([0.0031, 0.0027, 0.0012])

    def __call__(self, t, s):
        q, w = Quaternion(*s[:4]), s[4:]
        down = q.conj().rotate(np.array([0.0, 0.0, -1.0]))
        torque = np.cross([0.0, 0.0, self.h], self.m * self.g * down)
        wdot = (torque - np.cross(w, self.inertia * w)) / self.inertia
        qdot = 0.5 * (q * Quaternion(0.0, *w)).asarray()
        return np.concatenate((qdot, wdot))


body = HeavyBody()
