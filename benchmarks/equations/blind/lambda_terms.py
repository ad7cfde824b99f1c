from functools import partial, reduce
from operator import add

from numpy import array, cos, sin

geometry = dict(R=0.42, l=0.31)
masses = dict(M=1.9, m=0.44, I=0.06)
G = 9.81

# a disc rolls on a level table, a pendulum hangs from its centre: x of the centre, th from hanging
inertia = {
    ("x", "x"): lambda q, R, l, M, m, I: M + m + I / R**2,
    ("x", "th"): lambda q, R, l, M, m, I: m * l * cos(q[1]),
    ("th", "th"): lambda q, R, l, M, m, I: m * l**2,
}
loads = {
    "x": [lambda q, v, l, m: m * l * sin(q[1]) * v[1] ** 2],
    "th": [lambda q, v, l, m: -m * G * l * sin(q[1]), lambda q, v, l, m: -0.02 * v[1]],
}


def rhs(t, y, geometry, masses):
    q, v = y[:2], y[2:]
    a, b, d = (inertia[k](q, **geometry, **masses) for k in inertia)
    fx, fth = (
        reduce(add, (load(q, v, geometry["l"], masses["m"]) for load in loads[k])) for k in ("x", "th")
    )
    det = a * d - b**2
    return array([*v, (d * fx - b * fth) / det, (a * fth - b * fx) / det])


f = partial(rhs, geometry=geometry, masses=masses)
