"""A two-storey frame with a pendulum as tuned mass: states and rates as dictionaries."""
from typing import Any, Final

import numpy as np

STOREYS: Final = [{"m": 520.0, "k": 9.1e4, "c": 210.0}, {"m": 480.0, "k": 7.7e4, "c": 190.0}]
PENDULUM: Final = {"m": 31.0, "l": 0.62, "c": 4.2}
g: Final = 9.81


def unpack(y) -> dict[str, Any]:
    keys = ["x1", "x2", "th", "v1", "v2", "om"]
    return {k: y[i] for i, k in enumerate(keys)}


def shear(storey: dict[str, float], drift: float, rate: float) -> float:
    return -storey["k"] * drift - storey["c"] * rate


def building(t, y):
    s = unpack(y)
    low, high = STOREYS
    m, l = PENDULUM["m"], PENDULUM["l"]
    F1 = shear(low, s["x1"], s["v1"])
    F2 = shear(high, s["x2"] - s["x1"], s["v2"] - s["v1"])
    si, co = np.sin(s["th"]), np.cos(s["th"])
    hinge = PENDULUM["c"] * s["om"]
    # eliminate the pendulum: m l th'' = -m co a2 - m g si - hinge / l
    top = F2 + m * l * s["om"] ** 2 * si + m * g * si * co + hinge * co / l
    a2 = top / (high["m"] + m * si**2)
    rates = {
        "x1": s["v1"], "x2": s["v2"], "th": s["om"],
        "v1": (F1 - F2) / low["m"],
        "v2": a2,
        "om": -(a2 * co + g * si) / l - hinge / (m * l**2),
    }
    return np.fromiter(rates.values(), dtype=float)
