"""Rotary pendulum by the vector form: positions, Jacobian, Newton's law projected."""

from functools import partial

import numpy as np

Ja, m, r, l, g, b = 0.021, 0.13, 0.21, 0.16, 9.81, 0.002


def kinematics(q, r, l):
    th, al = q
    er = np.array([np.cos(th), np.sin(th), 0])
    et = np.array([-np.sin(th), np.cos(th), 0])
    ez = np.array([0, 0, 1])
    d_th = r * et - l * np.sin(al) * er
    d_al = l * np.cos(al) * et - l * np.sin(al) * ez
    return er, et, ez, np.column_stack([d_th, d_al])


def model(t, q, u, kin):
    er, et, ez, J = kin(q)
    al = q[1]
    bias = (
        -(r * er + l * np.sin(al) * et) * u[0] ** 2
        - 2 * l * np.cos(al) * er * u[0] * u[1]
        - l * (np.sin(al) * et + np.cos(al) * ez) * u[1] ** 2
    )
    M = m * J.T @ J + np.diag([Ja, 0])
    F = J.T @ (-m * g * ez - m * bias) - np.array([b * u[0], 0])
    return np.linalg.solve(M, F)


rhs = partial(model, kin=lambda q: kinematics(q, r, l))
