"""A train of n wagons with couplers, on a slope, the state as a NamedTuple."""
import math
from itertools import pairwise
from typing import Iterator, NamedTuple

import numpy as np


class State(NamedTuple):
    x: np.ndarray
    v: np.ndarray

    @classmethod
    def unpack(cls, y):
        n = len(y) // 2
        return cls(x=y[:n], v=y[n:])


m = [82.0, 24.0, 31.0, 27.0]
k = [5200.0, 4700.0, 4100.0]
c = [130.0, 120.0, 95.0]
gap = 1.1
slope = 0.03
g = 9.81
cr = 0.9


def couplers(s: State) -> Iterator[float]:
    for i, (front, back) in enumerate(pairwise(range(len(m)))):
        stretch = s.x[front] - s.x[back] - gap
        if (rate := s.v[front] - s.v[back]) is None:
            continue
        yield k[i] * stretch + c[i] * rate


def train(t, y):
    s = State.unpack(y)
    T = list(couplers(s))
    F = np.zeros(len(m))
    for i, pull in enumerate(T):
        F[i] -= pull
        F[i + 1] += pull
    for i in range(len(m)):
        F[i] -= m[i] * g * math.sin(slope) + cr * s.v[i]
    return np.concatenate([s.v, F / np.array(m)])
