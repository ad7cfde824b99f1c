import casadi as ca
import numpy as np

x = ca.SX.sym("x", 4)
pos, phi, vel, om = x[0], x[1], x[2], x[3]
M, m, L, g, k, d = 2.3, 0.7, 1.4, 9.81, 12.0, 0.3
lc = L / 2
J = m * L**2 / 12
H = ca.vertcat(
    ca.horzcat(M + m, m * lc * ca.cos(phi)),
    ca.horzcat(m * lc * ca.cos(phi), J + m * lc**2),
)
h = ca.vertcat(m * lc * ca.sin(phi) * om**2 - k * pos - d * vel, -m * g * lc * ca.sin(phi))
ode = ca.vertcat(vel, om, ca.solve(H, h))
f = ca.Function("f", [x], [ode], ["x"], ["xdot"])


def rhs(t, y):
    return np.array(f(y)).ravel()
