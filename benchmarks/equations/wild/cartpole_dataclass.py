from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Params:
    masscart: float = 1.1
    masspole: float = 0.17
    length: float = 0.53
    gravity: float = 9.8

    @property
    def total(self) -> float:
        return self.masscart + self.masspole


class System:
    def __init__(self, params: Params | None = None):
        self.p = params or Params()

    def rhs(self, t: float, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        p = self.p
        s, c = np.sin(q[1]), np.cos(q[1])
        ml = p.masspole * p.length
        a, b, d = p.total, ml * c, 4 / 3 * ml * p.length
        f1 = ml * u[1] ** 2 * s
        f2 = ml * p.gravity * s
        det = a * d - b * b
        return np.array([(d * f1 - b * f2) / det, (a * f2 - b * f1) / det])


system = System()
