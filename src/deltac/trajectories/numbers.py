"""Numbers that a trajectory is made of: checked, copied, read-only."""

from __future__ import annotations

from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.errors import LogError, WrongType


def as_numbers(label: str, values: Any) -> Array:
    """A read-only float64 copy of `values`; InputError when they are not real numbers.

    Arrays that are read-only, and no views of writeable ones, are not copied.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:  # ragged rows
        raise LogError(f"{label}: expected an array of numbers; {error}") from None
    if array.dtype.kind not in "iuf":
        raise WrongType(
            f"{label}: found values of type {array.dtype}, expected real numbers (SI units)"
        )
    whole = array.base is None and array.dtype == np.float64 and array.flags.c_contiguous
    if whole and not array.flags.writeable:
        return np.asarray(array)
    if array.dtype.itemsize <= 8:
        copy = np.array(array, dtype=np.float64, order="C")
    else:
        with np.errstate(over="ignore"):  # a long double beyond float64 is caught as infinite
            copy = np.array(array, dtype=np.float64, order="C")
    copy.flags.writeable = False
    return copy
