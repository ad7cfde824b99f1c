"""A body in flight: velocity in its own axes, Euler angles (yaw, pitch, roll), linear drag."""
import numpy as np

mass, g = 11.0, 9.81
I = np.diag([0.82, 1.13, 1.76])
D = np.array([0.3, 1.4, 2.6])


def R_x(a):
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def R_y(a):
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def R_z(a):
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def eom(t, x):
    phi, theta, psi = x[3:6]
    v, w = x[6:9], x[9:12]
    R = R_z(psi) @ R_y(theta) @ R_x(phi)
    H = np.array([
        [1, 0, -np.sin(theta)],
        [0, np.cos(phi), np.cos(theta) * np.sin(phi)],
        [0, -np.sin(phi), np.cos(theta) * np.cos(phi)],
    ])
    p_dot = R @ v
    e_dot = np.linalg.solve(H, w)
    v_dot = R.T @ [0, 0, -g] - D * v / mass - np.cross(w, v)
    w_dot = np.linalg.inv(I) @ -np.cross(w, I @ w)
    return np.concatenate([p_dot, e_dot, v_dot, w_dot])
