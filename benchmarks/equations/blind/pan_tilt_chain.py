import numpy as np


def Rz(a):
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def Ry(a):
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


Jp, m, e, g = 0.02, 0.7, 0.08, 9.81
I_cam = np.diag([0.003, 0.004, 0.0045])
b = np.array([0.03, 0.02])
EZ = np.array([0.0, 0.0, 1.0])


def dynamics(t, q, qd):
    R = Rz(q[0]) @ Ry(-q[1])
    tilt_axis = Rz(q[0]) @ np.array([0.0, -1.0, 0.0])
    Jw = np.column_stack([EZ, tilt_axis])
    r = R @ np.array([e, 0.0, 0.0])
    Jv = np.column_stack([np.cross(EZ, r), np.cross(tilt_axis, r)])
    I = R @ I_cam @ R.T
    M = m * Jv.T @ Jv + Jw.T @ I @ Jw + np.diag([Jp, 0.0])
    w = Jw @ qd
    alpha0 = np.cross(EZ * qd[0], tilt_axis * qd[1])
    a0 = np.cross(alpha0, r) + np.cross(w, np.cross(w, r))
    force = m * (-g * EZ - a0)
    torque = -(I @ alpha0 + np.cross(w, I @ w))
    return np.linalg.solve(M, Jv.T @ force + Jw.T @ torque - b * qd)
