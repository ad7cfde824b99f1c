"""Units of columns against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.trajectories.formats.units import column_unit, unit


@pytest.mark.parametrize(
    ("text", "factor", "same_kind_as"),
    [
        ("deg", math.pi / 180, "rad"),
        ("°/s", math.pi / 180, "rad/s"),
        ("deg/s²", math.pi / 180, "rad/s^2"),
        ("rad s^-1", 1.0, "rad/s"),
        ("rpm", 2 * math.pi / 60, "rad/s"),
        ("rev/min", 2 * math.pi / 60, "rad/s"),
        ("mm", 1e-3, "m"),
        ("inches", 0.0254, "m"),
        ("newton millimetres", 1e-3, "N*m"),
        ("ms", 1e-3, "s"),
        ("km/h", 1 / 3.6, "m/s"),
        ("m/s/s", 1.0, "m/s**2"),
        ("N·mm", 1e-3, "N*m"),
        ("N.m", 1.0, "J"),
        ("kg*m^2/s^2", 1.0, "Nm"),
        ("lbf*ft", 1.3558179483314, "N*m"),  # exact by the definitions of pound and foot
        ("1", 1.0, ""),
    ],
)
def test_units_convert_to_si(text: str, factor: float, same_kind_as: str) -> None:
    found = unit(text)
    assert found.factor == pytest.approx(factor, rel=1e-14)  # a few roundings
    assert found.dimension == unit(same_kind_as).dimension


def test_angles_lengths_and_numbers_are_told_apart() -> None:
    assert len({unit(text).dimension for text in ("deg", "mm", "1", "ms", "g")}) == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("degs", "did you mean 'deg"),
        ("m/", "cannot parse the unit 'm/'"),
        ("/s", "cannot parse"),
        ("m^x", "cannot parse"),
        ("2 m", "cannot parse"),
    ],
)
def test_what_is_no_unit_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        unit(text)


@pytest.mark.parametrize(
    ("column", "found"),
    [
        ("elbow [deg]", "deg"),
        ("v (m/s)", "m/s"),
        ("q[0]", None),
        ("motor [left]", None),
        ("x", None),
    ],
)
def test_units_in_names_of_columns(column: str, found: str | None) -> None:
    assert column_unit(column) == found


def test_the_second_axis_of_a_universal_joint_is_no_unit_of_time() -> None:
    mechanism = dc.Mechanism(
        [dc.body("bob", 1.0, inertia=(0.1, 0.1, 0.1), mass_centre=(0, 0, -0.5))],
        [dc.joints.universal("hook", "ground", "bob")],
    )
    t = np.linspace(0.0, 1.0, 11)
    names = [f"{kind}.hook.{axis}" for kind in "qu" for axis in ("first", "second")]
    table = {"time": t} | {name: (k + 1.0) * t for k, name in enumerate(names)}
    run = dc.read_trajectory(table, model=mechanism)
    assert run.coordinates == ("hook.first", "hook.second")
    assert np.array_equal(run.q[:, 1], 2.0 * t) and np.array_equal(run.u[:, 1], 4.0 * t)
