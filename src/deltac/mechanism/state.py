"""The state of a mechanism: (t, q, u) at an instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class State:
    """Time t (s), coordinates q (nq,) and speeds u (nu,) of all joints; made by `Mechanism.state`.

    The arrays are read-only; prescribed joints are included, at the values of their law.
    """

    t: float
    q: NDArray[np.float64]
    u: NDArray[np.float64]
