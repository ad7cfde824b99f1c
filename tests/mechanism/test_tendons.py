"""Tendons and gravity compensation: closed forms, and what is said of those that cannot be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deltac.dynamics.forces import channels
from deltac.dynamics.system import trace
from deltac.errors import InputError
from deltac.mechanism.bodies import point_mass, sphere
from deltac.mechanism.forces import gravity_compensation, tendon
from deltac.mechanism.joints import prismatic, spherical
from deltac.mechanism.mechanism import Mechanism
from tests.systems.random_mechanisms import Sample, scalar


def slider(element: Any) -> Mechanism:
    """A particle on the x axis."""
    return Mechanism(
        [point_mass("bead", 2.0)],
        [prismatic("x", "ground", "bead", "x")],
        forces=[element],
        gravity=(-10, 0, 0),
    )


def evaluated(element: Any, x: float, u: float) -> dict[str, tuple[float, float]]:
    """Force and potential of each channel at a state of the slider."""
    mechanism = slider(element)
    system = trace(mechanism)
    sample = Sample(mechanism, 0.0, np.array([x]), np.array([u]), np.zeros(1))
    found: dict[str, tuple[float, float]] = {}
    for part in channels(system):
        V = 0 if part.potential is None else part.potential
        force, V = sample.evaluate(system, part.force, V)
        found[part.name] = (scalar(force), scalar(V))
    return found


@pytest.mark.parametrize("x", [0.2, 0.9, 1.5])
def test_band_without_force(x: float) -> None:
    """V = ½ k d², d the distance to the band [0.5, 1]."""
    cord = tendon(
        "cord", [("ground", (0, 0, 0)), ("bead", (0, 0, 0))], stiffness=8, length=(0.5, 1)
    )
    force, V = evaluated(cord, x, 0.0)["spring cord"]
    d = x - np.clip(x, 0.5, 1.0)
    np.testing.assert_allclose([force, V], [-8 * d, 4 * d**2], rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("x", [0.3, -0.4])
@pytest.mark.parametrize("u", [0.6, -0.7])
def test_polynomials(x: float, u: float) -> None:
    """With l = 3 q: force −3 (a l + b l² + c l³), potential its integral; damping with v |v|."""
    coupling = tendon("t", coordinates={"x": 3}, stiffness=[2, 1, 4], damping=[0.5, 2, 1])
    found = evaluated(coupling, x, u)
    l, v = 3 * x, 3 * u
    spring = [-3 * (2 * l + l**2 + 4 * l**3), l**2 + l**3 / 3 + l**4]
    np.testing.assert_allclose(found["spring t"], spring, rtol=1e-14)
    np.testing.assert_allclose(
        found["damper t"][0], -3 * (0.5 * v + 2 * v * abs(v) + v**3), rtol=1e-14
    )


def test_pulley_halves_the_length() -> None:
    """Two parts that count half each pull as one: l = |x| with twice the points."""
    path = [("ground", (0, 0, 0)), ("bead", (0, 0, 0))]
    whole = tendon("t", path, stiffness=5, length=0.2)
    parts = tendon("t", branches=[(path, 0.5), (path, 0.5)], stiffness=5, length=0.2)
    np.testing.assert_allclose(
        evaluated(whole, 0.7, 0)["spring t"], evaluated(parts, 0.7, 0)["spring t"], rtol=1e-14
    )


def test_gravity_compensation_lifts() -> None:
    found = evaluated(gravity_compensation("lift", {"bead": 0.25}), 0.3, 0.0)
    assert found["applied lift"][0] == pytest.approx(0.25 * 2.0 * 10.0)
    assert found["gravity"][0] == pytest.approx(-20.0)


def test_springs_and_tendons_share_names_of_channels() -> None:
    twice = [tendon("t", coordinates={"x": 1}, stiffness=k) for k in (1, 2)]
    with pytest.raises(InputError, match="both use the channel 'spring t'"):
        Mechanism([point_mass("bead", 1.0)], [prismatic("x", "ground", "bead")], forces=twice)


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({}, "has no length"),
    "one point": ({"path": [("bead", (0, 0, 0))]}, "two points or more, found 1"),
    "no pairs": ({"path": [(0, 0, 0), (1, 0, 0)]}, r"\(body, point\) pairs"),
    "body": ({"path": [("ground", (0, 0, 0)), ("bed", (0, 0, 0))]}, "did you mean 'bead'"),
    "coordinate": ({"coordinates": {"y": 1}}, "unknown coordinate 'y'"),
    "band": ({"coordinates": {"x": 1}, "length": (1, 0.5)}, "swap them"),
    "lengths": ({"coordinates": {"x": 1}, "length": (1, 2, 3)}, "one length or two"),
    "symbol": ({"coordinates": {"x": 1}, "stiffness": "k"}, "'k'"),
    "factor": (
        {"branches": [([("ground", (0, 0, 0)), ("bead", (0, 0, 0))], -1)]},
        "expected a positive number",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_tendons(what: str) -> None:
    options, message = BAD[what]
    with pytest.raises(InputError, match=message):
        slider(tendon("t", **options))


def test_a_quaternion_is_no_length() -> None:
    with pytest.raises(InputError, match="without quaternions"):
        Mechanism(
            [sphere("ball", 1.0, 0.1)],
            [spherical("joint", "ground", "ball")],
            forces=[tendon("t", coordinates={"joint.qw": 1}, stiffness=1)],
        )
