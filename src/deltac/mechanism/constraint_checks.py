"""Checks of constraints against the mechanism that they belong to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltac.errors import InputError, closest
from deltac.mechanism.bodies import GROUND
from deltac.mechanism.constraints import (
    Angle,
    Constraint,
    Distance,
    Holonomic,
    Loop,
    MotionConstraint,
    PointOn,
    Rolling,
    Skate,
)
from deltac.mechanism.laws import check_symbols, symbol_names

if TYPE_CHECKING:
    from deltac.mechanism.mechanism import Mechanism


def check_constraint(mechanism: Mechanism, constraint: Constraint) -> None:
    """InputError for unknown bodies or symbols, and for motion constraints that are not linear in u."""
    parameters = tuple(mechanism.parameters)
    in_time = ["t", *parameters]
    coordinates = [*in_time, *(f"q.{name}" for name in mechanism.coordinates.names)]
    kind = {"MotionConstraint": "motion", "PointOn": "point-on"}.get(type(constraint).__name__)
    what = f"{kind or type(constraint).__name__.lower()} constraint {constraint.name!r}"

    def laws(values: tuple[object, ...], allowed: list[str], part: str) -> None:
        for law in values:
            check_symbols(law, allowed, f"{part} of {what}")

    match constraint:
        case Loop():
            _bodies(mechanism, what, constraint.body1, constraint.body2)
            laws((*constraint.point1, *constraint.point2), in_time, "a point")
        case Distance():
            _bodies(mechanism, what, constraint.body1, constraint.body2)
            laws((*constraint.point1, *constraint.point2), in_time, "a point")
            laws((constraint.length,), in_time, "length")
        case PointOn():
            _bodies(mechanism, what, constraint.body, constraint.on)
            laws(constraint.point, in_time, "point")
            laws(constraint.equations, ["x", "y", "z", *in_time], "equation")
            for law in constraint.equations:
                if not symbol_names(law) & {"x", "y", "z"}:
                    raise InputError(f"equation of {what}: {law} holds none of x, y, z")
        case Angle():
            _bodies(mechanism, what, constraint.body1, constraint.body2)
            laws((constraint.angle,), in_time, "angle")
        case Holonomic():
            laws((constraint.law,), coordinates, "law")
            if not any(name.startswith("q.") for name in symbol_names(constraint.law)):
                raise InputError(f"law of {what}: {constraint.law} holds no coordinate q.<name>")
        case MotionConstraint():
            speeds = [f"u.{name}" for name in mechanism.speeds.names]
            laws((constraint.law,), [*coordinates, *speeds], "law")
            _linear(constraint, what)
        case Rolling():
            _bodies(mechanism, what, constraint.body, constraint.on)
            laws(constraint.centre, list(parameters), "centre")
            laws((constraint.radius, constraint.tube), list(parameters), "radius")
            laws(constraint.point, in_time, "point")
            laws(constraint.surface_velocity, ["x", "y", "z", *in_time], "surface velocity")
        case Skate():
            _bodies(mechanism, what, constraint.body, constraint.on)
            laws(constraint.point, list(parameters), "point")
            laws((constraint.drift,), in_time, "drift")


def _bodies(mechanism: Mechanism, what: str, *names: str) -> None:
    known = [GROUND, *(body.name for body in mechanism.bodies)]
    for name in names:
        if name not in known:
            raise InputError(f"{what}: unknown body {name!r}{closest(name, known)}")
    if all(name == GROUND for name in names):
        raise InputError(f"{what} connects the ground with itself")


def _linear(constraint: MotionConstraint, what: str) -> None:
    import sympy

    speeds = [s for s in getattr(constraint.law, "free_symbols", ()) if s.name.startswith("u.")]
    if not speeds:
        raise InputError(f"law of {what}: {constraint.law} holds no speed u.<name>")
    for a in speeds:
        for b in speeds:
            if sympy.simplify(sympy.diff(constraint.law, a, b)) != 0:
                raise InputError(
                    f"law of {what}: {constraint.law} is not linear in {a}; only A(q, t) v + b(q, t) = 0 "
                    "is a simple nonholonomic constraint"
                )
