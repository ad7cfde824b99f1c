"""Random axes and rotations."""

from __future__ import annotations

from typing import Any

import numpy as np

from deltac.mechanism.quantities import rotation_matrix


def random_direction(rng: np.random.Generator) -> Any:
    """An axis: half of all are coordinate axes, whose zeros and ones take other paths."""
    if rng.random() < 0.5:
        return str(rng.choice(["x", "y", "z", "-x", "-y", "-z"]))
    return tuple(rng.normal(size=3))


def random_rotation(rng: np.random.Generator) -> Any:
    """A random rotation matrix."""
    return rotation_matrix(tuple(rng.normal(size=3)), float(rng.uniform(-3, 3)))
