# Lecture 7: trolley with a hanging rod
import numpy as np
from numpy.linalg import solve

M, m, L, g, k, d = 2.3, 0.7, 1.4, 9.81, 12.0, 0.3
J = m * L**2 / 12
lc = L / 2

Mass = lambda q: np.array([[M + m, m * lc * np.cos(q[1])], [m * lc * np.cos(q[1]), J + m * lc**2]])
Cor = lambda q, v: np.array([-m * lc * np.sin(q[1]) * v[1] ** 2, 0])
Grav = lambda q: np.array([k * q[0], m * g * lc * np.sin(q[1])])
Damp = lambda v: np.array([d * v[0], 0])
B = np.array([1, 0])
f = lambda x, u: np.r_[x[2:], solve(Mass(x[:2]), B * u - Cor(x[:2], x[2:]) - Grav(x[:2]) - Damp(x[2:]))]
