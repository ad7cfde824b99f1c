"""A block on a spring that slides on a wedge that slides on the floor: SymPy, LUsolve, lambdify."""
import numpy as np
import sympy as sp

X, s, Xd, sd = sp.symbols("X s Xd sd")
M, m, alpha, k, s0, g, c = sp.symbols("M m alpha k s0 g c")
values = {M: 2.6, m: 0.8, alpha: 0.52, k: 31.0, s0: 0.25, g: 9.81, c: 0.4}

vx = Xd + sd * sp.cos(alpha)
vy = -sd * sp.sin(alpha)
T = M * Xd**2 / 2 + m * (vx**2 + vy**2) / 2
V = -m * g * s * sp.sin(alpha) + k * (s - s0) ** 2 / 2
q, qd = sp.Matrix([X, s]), sp.Matrix([Xd, sd])
mass = sp.hessian(T, list(qd))
force = sp.Matrix([-sp.diff(V, X), -sp.diff(V, s)]) - sp.Matrix([c * Xd, 0])
acc = mass.LUsolve(force).subs(values)
_f = sp.lambdify((X, s, Xd, sd), list(acc), "numpy")


def rhs(t, y):
    return np.array([y[2], y[3], *_f(*y)])
