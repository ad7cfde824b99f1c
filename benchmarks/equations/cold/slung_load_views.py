"""A planar vehicle in free flight with a load on a rigid cable below its mass centre."""
import numpy as np

M, J = 1.35, 0.021
m, L, h = 0.28, 0.9, 0.07
g = 9.81
drag = 0.17


def load_jacobian(th, ph):
    jac = np.empty((2, 4))
    jac[:, :2] = np.eye(2)
    jac[:, 2] = h * np.cos(th), h * np.sin(th)
    jac[:, 3] = L * np.cos(ph), L * np.sin(ph)
    return jac


def dynamics(t, s):
    out = np.zeros_like(s)
    pos, vel = s[:4], s[4:]
    out[:4] = vel
    th, ph = pos[2:]
    jac = load_jacobian(th, ph)
    turn = np.array([
        -h * np.sin(th) * vel[2] ** 2 - L * np.sin(ph) * vel[3] ** 2,
        h * np.cos(th) * vel[2] ** 2 + L * np.cos(ph) * vel[3] ** 2,
    ])
    mass = m * jac.T @ jac
    mass[np.arange(3), np.arange(3)] += M, M, J
    force = -m * jac.T @ turn
    force[:2] -= drag * vel[:2]
    force[1] -= M * g
    force -= m * g * jac[1]
    out[4:] = np.linalg.solve(mass, force)
    return out
