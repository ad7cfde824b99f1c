import logging
from enum import Enum, auto
from typing import Final

import numpy as np
from scipy import constants

log = logging.getLogger(__name__)


class Hinge(Enum):
    FREE = auto()
    DAMPED = auto()


MODE: Final = Hinge.DAMPED
m1: Final[float] = 1.1
m2: Final[float] = 0.7
L1, L2 = 0.8, 0.6
b1, b2 = 0.1, 0.07


def friction(rates: np.ndarray) -> np.ndarray:
    match MODE:
        case Hinge.FREE:
            return np.zeros(2)
        case Hinge.DAMPED:
            return np.array([b * w for b, w in zip((b1, b2), rates)])
        case _:
            raise ValueError(f"unknown {MODE!r}")


def two_rods(t: float, y: np.ndarray, /, verbose: bool = False) -> list[float]:
    (a, b, *rates) = y
    w1, w2 = rates
    if verbose:
        log.info("t = %g", t)
    M11 = (J2 := m2 * L2**2 / 3) + m1 * L1**2 / 3 + m2 * L1**2 + 2 * (h := m2 * L1 * L2 / 2) * np.cos(b)
    M12 = J2 + h * np.cos(b)
    t1, t2 = friction(np.asarray(rates))
    G2 = m2 * constants.g * L2 / 2 * np.sin(a + b)
    G1 = (m1 / 2 + m2) * constants.g * L1 * np.sin(a) + G2
    f = {
        "shoulder": h * np.sin(b) * (2 * w1 * w2 + w2**2) - G1 - t1,
        "elbow": -h * np.sin(b) * w1**2 - G2 - t2,
    }
    det = M11 * J2 - M12**2
    acc = [
        (J2 * f["shoulder"] - M12 * f["elbow"]) / det,
        (M11 * f["elbow"] - M12 * f["shoulder"]) / det,
    ]
    return [*rates, *acc]
