"""Cart with two hanging rods one below the other (absolute angles), chosen by a command."""
import numpy as np

params = {"cart": 1.9, "rods": [(0.6, 0.7), (0.4, 0.5)], "g": 9.81, "friction": 0.25}


def term(kind, *state, p):
    (m1, l1), (m2, l2) = p["rods"]
    x, a, b, v, w1, w2 = state
    match kind:
        case "mass":
            c1, c2, c12 = np.cos(a), np.cos(b), np.cos(a - b)
            return np.array([
                [p["cart"] + m1 + m2, (m1 / 2 + m2) * l1 * c1, m2 * l2 / 2 * c2],
                [(m1 / 2 + m2) * l1 * c1, (m1 / 3 + m2) * l1**2, m2 * l1 * l2 / 2 * c12],
                [m2 * l2 / 2 * c2, m2 * l1 * l2 / 2 * c12, m2 * l2**2 / 3],
            ])
        case "coriolis":
            s1, s2, s12 = np.sin(a), np.sin(b), np.sin(a - b)
            return np.array([
                -(m1 / 2 + m2) * l1 * s1 * w1**2 - m2 * l2 / 2 * s2 * w2**2,
                m2 * l1 * l2 / 2 * s12 * w2**2,
                -m2 * l1 * l2 / 2 * s12 * w1**2,
            ])
        case "gravity":
            return p["g"] * np.array([0, (m1 / 2 + m2) * l1 * np.sin(a), m2 * l2 / 2 * np.sin(b)])
        case "friction":
            return np.array([p["friction"] * v, 0, 0])
        case _:
            raise KeyError(kind)


def rhs(t, y):
    M = term("mass", *y, p=params)
    f = -sum(term(kind, *y, p=params) for kind in ("coriolis", "gravity", "friction"))
    return [*y[3:], *np.linalg.solve(M, f)]
