"""What controllers answer, checked."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.dynamics.system import System
from deltac.errors import InputError, closest
from deltac.simulation.equations import Controller


def motor_values(controller: Controller, system: System, t: float, q: Array, u: Array) -> Array:
    """Values of all motors without a law, in the order of `System.inputs`.

    Raises InputError for a motor that is unknown or left out, and a value of wrong size or not finite.
    """
    answer = controller.function(t, q, u)
    places = system.input_places
    if not hasattr(answer, "items"):
        raise InputError(
            f"the controller returned {type(answer).__name__}, expected a mapping of the names of "
            f"joint torques to values: {', '.join(places)}"
        )
    for name in answer:
        if name not in places:
            raise InputError(
                f"the controller sets an unknown joint torque {name!r}{closest(name, places)}"
            )
    values = np.empty(system.inputs.shape[0])
    for name, place in places.items():
        if name not in answer:
            raise InputError(f"the controller returned no value for joint torque {name!r}")
        value = np.atleast_1d(np.asarray(answer[name], dtype=np.float64))
        if value.shape != (place.stop - place.start,) or not np.isfinite(value).all():
            raise InputError(
                f"the controller returned {answer[name]!r} for joint torque {name!r} at t = {t:g}; "
                f"expected {place.stop - place.start} finite value(s)"
            )
        values[place] = value
    return values
