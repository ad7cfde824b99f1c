"""Bad constraints: each message names the constraint, what is wrong with it, and what is expected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import deltac as dc
from deltac.errors import InputError


def mechanism(*constraints: Any) -> dc.Mechanism:
    """Two arms on the ground and a free ball."""
    return dc.Mechanism(
        [dc.rod("upper", 1.0, 1.0), dc.rod("lower", 1.0, 1.0), dc.bodies.sphere("ball", 1.0, 0.1)],
        [
            dc.revolute("shoulder", "ground", "upper", "y"),
            dc.revolute("elbow", "upper", "lower", "y", position=[0, 0, -1]),
            dc.free("base", "ball"),
        ],
        constraints=constraints,
        parameters={"length": 0.7},
    )


MADE_WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "ground with itself": (
        lambda: dc.constraints.point_in_plane("plane", "ground"),
        "'plane' connects body 'ground' with itself",
    ),
    "itself": (
        lambda: dc.constraints.loop_spherical("tie", "upper", "upper"),
        "loop constraint 'tie' connects body 'upper' with itself",
    ),
    "no name": (
        lambda: dc.constraints.distance("", "upper", "lower", 1.0),
        "needs a name .* found ''",
    ),
    "blank name": (
        lambda: dc.constraints.angle(" a", "upper", "lower", 1.0),
        "surrounding blanks, found ' a'",
    ),
    "number as name": (lambda: dc.constraints.gear(3, "x", "y", 1.0), "needs a name .* found 3"),  # type: ignore[arg-type]
    "no length": (
        lambda: dc.constraints.distance("rod", "upper", "lower", 0.0),
        "length of distance constraint 'rod'.*0",
    ),
    "negative length": (
        lambda: dc.constraints.distance("rod", "upper", "lower", -1.0),
        "length of distance constraint 'rod'.*-1",
    ),
    "negative radius": (
        lambda: dc.constraints.rolling("wheel", "ball", -0.1),
        "radius of rolling constraint 'wheel'",
    ),
    "no radius at all": (
        lambda: dc.constraints.rolling("wheel", "ball"),
        "rolling constraint 'wheel': give a radius .* or a tube radius",
    ),
    "rolls on itself": (
        lambda: dc.constraints.rolling("wheel", "ball", 0.1, on="ball"),
        "rolling constraint 'wheel' connects body 'ball' with itself",
    ),
    "zero axis": (
        lambda: dc.constraints.loop_revolute("pin", "upper", "ball", axis1=[0, 0, 0]),
        "axis1 of loop constraint 'pin'",
    ),
    "two components": (
        lambda: dc.constraints.loop_spherical("pin", "upper", "ball", point1=[0, 1]),
        "point1 of loop constraint 'pin'",
    ),
    "no rotation": (
        lambda: dc.constraints.loop_weld("glue", "upper", "ball", rotation=[[1, 0, 0]] * 3),
        "rotation of loop constraint 'glue'",
    ),
    "not in the grammar": (
        lambda: dc.constraints.holonomic("f", "q.elbow + __import__('os')"),
        "holonomic constraint 'f'",
    ),
    "nan": (
        lambda: dc.constraints.distance("rod", "upper", "lower", float("nan")),
        "length of distance constraint 'rod'",
    ),
}
"""Refused when the constraint is made."""


@pytest.mark.parametrize("case", MADE_WRONG)
def test_refused_when_made(case: str) -> None:
    make, message = MADE_WRONG[case]
    with pytest.raises(InputError, match=message):
        make()


FITS_NOWHERE: dict[str, tuple[Callable[[], Any], str]] = {
    "unknown body": (
        lambda: dc.constraints.distance("rod", "uper", "ball", 1.0),
        "distance constraint 'rod': unknown body 'uper'; did you mean 'upper'",
    ),
    "unknown body to stand on": (
        lambda: dc.constraints.rolling("wheel", "ball", 0.1, on="tabel"),
        "rolling constraint 'wheel': unknown body 'tabel'",
    ),
    "unknown coordinate": (
        lambda: dc.constraints.gear("mesh", "elbow", "sholder", 2.0),
        "law of holonomic constraint 'mesh': unknown symbol 'q.sholder'; did you mean 'q.shoulder'",
    ),
    "unknown parameter": (
        lambda: dc.constraints.distance("rod", "upper", "ball", "lenght"),
        "length of distance constraint 'rod': unknown symbol 'lenght'; did you mean 'length'",
    ),
    "length of q": (
        lambda: dc.constraints.distance("rod", "upper", "ball", "2 + q.elbow"),
        "length of .*'rod': unknown symbol 'q.elbow'.*may depend on",
    ),
    "configuration of speeds": (
        lambda: dc.constraints.holonomic("f", "q.elbow - u.elbow"),
        "law of .*'f': unknown symbol 'u.elbow'",
    ),
    "no coordinate": (
        lambda: dc.constraints.holonomic("f", "sin(t)"),
        "'f'.* holds no coordinate q.<name>",
    ),
    "no speed": (
        lambda: dc.constraints.motion_constraint("a", "q.elbow"),
        "'a'.* holds no speed u.<name>",
    ),
    "not linear": (
        lambda: dc.constraints.motion_constraint("a", "u.elbow**2 - 1"),
        r"'a'.*is not linear in u.elbow; only A\(q, t\) v \+ b\(q, t\) = 0",
    ),
    "a product of speeds": (
        lambda: dc.constraints.motion_constraint("a", "u.elbow*u.shoulder + u.elbow"),
        "not linear in",
    ),
    "no surface": (
        lambda: dc.constraints.point_on("pin", "ball", "sin(t)"),
        "'pin'.* holds none of x, y, z",
    ),
    "surface of q": (
        lambda: dc.constraints.point_on("pin", "ball", "z - q.elbow"),
        "equations of .*'pin': unknown symbol 'q.elbow'",
    ),
    "radius of time": (
        lambda: dc.constraints.rolling("wheel", "ball", "0.1 + t"),
        "radius of rolling constraint 'wheel': unknown symbol 't'",
    ),
}
"""Refused by the mechanism that they do not fit."""


@pytest.mark.parametrize("case", FITS_NOWHERE)
def test_refused_by_the_mechanism(case: str) -> None:
    make, message = FITS_NOWHERE[case]
    with pytest.raises(InputError, match=message):
        mechanism(make())


def test_names_of_constraints_differ() -> None:
    rod = dc.constraints.distance("rod", "upper", "ball", 1.0)
    with pytest.raises(InputError, match="both use the channel 'constraint rod'"):
        mechanism(rod, rod)


def test_linear_in_disguise_is_linear() -> None:
    """(u + 1)² − u² is linear in u, whatever it looks like."""
    mechanism(
        dc.constraints.motion_constraint(
            "a", "(u.elbow + 1)**2 - u.elbow**2 + u.shoulder*sin(q.elbow)"
        )
    )


def test_parameters_are_known_to_constraints() -> None:
    made = mechanism(dc.constraints.distance("rod", "upper", "ball", "length*(1 + 0.1*sin(t))"))
    assert made.constraints[0].name == "rod"


def test_a_joint_that_closes_a_cycle_points_to_constraints() -> None:
    with pytest.raises(InputError, match="Close a loop by a constraint instead"):
        dc.Mechanism(
            [dc.rod("a", 1.0, 1.0), dc.rod("b", 1.0, 1.0)],
            [
                dc.revolute("one", "ground", "a"),
                dc.revolute("two", "a", "b"),
                dc.revolute("three", "ground", "b"),
            ],
        )
