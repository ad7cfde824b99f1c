"""Compiled steps of a fixed-step solver by themselves, without the records and checks of a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deltac.simulation.stepping.explicit import FixedMethod, FixedSteps
from deltac.simulation.stepping.interpreted import StageRate
from deltac.simulation.stepping.protocol import StepGrid

Array = NDArray[np.float64]


def end(method: FixedMethod, start: Array, step: float, count: int) -> Array:
    """The state after so many steps from t = 0."""
    p = np.empty(0)
    steps = FixedSteps(method, StageRate(method.flow, None, p), p, compiled=True)
    grid, k, x = StepGrid(0.0, step, count, count * step), 0, start
    while k < count:
        block = steps.ahead(grid, k, x, count)
        assert block is not None and not block.singular
        k, x = k + len(block.states), block.states[-1].copy()
    return x
