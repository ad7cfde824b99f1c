"""A leg of a hexapod (yaw, femur, tibia), point masses, from its Lagrangian by CasADi."""
import casadi as ca

m1, m2 = 0.32, 0.21
lc, lf, lt = 0.05, 0.11, 0.14
g = 9.81
d = 0.02

q, dq = ca.SX.sym("q", 3), ca.SX.sym("dq", 3)
yaw, femur, tibia = q[0], q[1], q[2]

reach_knee = lc + lf * ca.cos(femur)
knee = ca.vertcat(reach_knee * ca.cos(yaw), reach_knee * ca.sin(yaw), lf * ca.sin(femur))
reach_foot = reach_knee + lt * ca.cos(femur + tibia)
foot = ca.vertcat(
    reach_foot * ca.cos(yaw), reach_foot * ca.sin(yaw), lf * ca.sin(femur) + lt * ca.sin(femur + tibia)
)
v_knee = ca.jtimes(knee, q, dq)
v_foot = ca.jtimes(foot, q, dq)
T = 0.5 * m1 * ca.dot(v_knee, v_knee) + 0.5 * m2 * ca.dot(v_foot, v_foot)
V = m1 * g * knee[2] + m2 * g * foot[2]
p = ca.gradient(T, dq)
M = ca.jacobian(p, dq)
rhs = ca.gradient(T - V, q) - ca.jtimes(p, q, dq) - d * dq
forward = ca.Function("forward", [q, dq], [ca.solve(M, rhs)])


def leg(t, q, u):
    return forward(q, u).full().ravel()
