import numpy as np
import sympy as sp

t = sp.Symbol("t")
r, phi = sp.Function("r")(t), sp.Function("phi")(t)
m, k, l0, c, g = sp.symbols("m k l0 c g")
T = m / 2 * (r.diff(t) ** 2 + r**2 * phi.diff(t) ** 2)
V = k / 2 * (r - l0) ** 2 - m * g * r * sp.cos(phi)
Lag = T - V
q = [r, phi]
Q = [-c * r.diff(t), 0]
eqs = [Lag.diff(x.diff(t)).diff(t) - Lag.diff(x) - F for x, F in zip(q, Q)]
acc = sp.solve(eqs, [x.diff(t, 2) for x in q])
R, Phi, Rd, Phid = sp.symbols("R Phi Rd Phid")
values = {m: 0.9, k: 70.0, l0: 0.45, c: 0.6, g: 9.81}
plain = [
    acc[x.diff(t, 2)].subs({r.diff(t): Rd, phi.diff(t): Phid}).subs({r: R, phi: Phi}).subs(values) for x in q
]
compiled = sp.lambdify((R, Phi, Rd, Phid), plain, "numpy", cse=True)


def rhs(time, y):
    return np.concatenate([y[2:], compiled(*y)])
