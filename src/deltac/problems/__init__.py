"""The library: published problems with their parameters, invariants and reference numbers.

A problem is a module with a `problem()` function that returns a `Problem`, listed in `_MODULES`;
that is all it takes for it to be known, loaded and tested.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from inspect import signature

from deltac.errors import check_names
from deltac.problems.problem import Problem, Reference

__all__ = ["Problem", "Reference", "load", "names"]

_MODULES = (
    "andrews_squeezer",
    "ball_on_compliant_floor",
    "ball_on_rising_table",
    "ball_on_table",
    "bead_on_hoop",
    "bicycle",
    "block_on_incline",
    "bouncing_ball",
    "bricard",
    "chaotic_double_body",
    "chaplygin_sleigh",
    "clutch",
    "disc_on_moving_plane",
    "double_pendulum",
    "driven_pendulum",
    "driven_triple_pendulum",
    "elastic_pendulum",
    "free_particle",
    "heavy_top",
    "knife_edge",
    "n_four_bar",
    "rolling_disc",
    "simple_pendulum",
    "spherical_pendulum",
    "stick_slip",
    "stiff_governor",
    "struck_slider_crank",
    "torque_free_box",
    "triple_pendulum",
    "tumbling_box",
)


def names() -> tuple[str, ...]:
    """The names of all problems, in alphabetical order."""
    return tuple(sorted(module.replace("_", "-") for module in _MODULES))


def load(name: str, **options: object) -> Problem:
    """A problem of the library; `options` choose a variant, where its module offers some.

    >>> load("triple-pendulum", damping=0.001).conserved
    ()

    Raises InputError for an unknown name or option.
    """
    check_names([name], names(), "unknown problem")
    make: Callable[..., Problem] = import_module(f"{__name__}.{name.replace('-', '_')}").problem
    check_names(options, signature(make).parameters, f"problem {name!r} has no option")
    return make(**options)
