import math

KEYS = ("x", "th", "xd", "thd")
P = {
    "cart": {"mass": 1.6, "friction": 0.45},
    "pole": {"mass": 0.31, "length": 0.88, "inertia": 0.021},
    "g": 9.81,
}


def forces(s, p):
    """Everything that is not inertia."""
    mp, l = p["pole"]["mass"], p["pole"]["length"]
    return {
        "x": mp * l * s["thd"] ** 2 * math.sin(s["th"]) - p["cart"]["friction"] * s["xd"],
        "th": -mp * p["g"] * l * math.sin(s["th"]),
    }


def ode(t, y):
    s = dict(zip(KEYS, y))
    mc, mp, l = P["cart"]["mass"], P["pole"]["mass"], P["pole"]["length"]
    rhs = forces(s, P)
    a = mc + mp
    b = mp * l * math.cos(s["th"])
    d = P["pole"]["inertia"] + mp * l**2
    det = a * d - b * b
    if abs(det) < 1e-12:
        raise ValueError("singular")
    out = {
        "x": s["xd"],
        "th": s["thd"],
        "xd": (d * rhs["x"] - b * rhs["th"]) / det,
        "thd": (a * rhs["th"] - b * rhs["x"]) / det,
    }
    return [out[k] for k in KEYS]
