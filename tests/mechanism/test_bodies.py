"""Bodies: inertias of common shapes, by cutting them in pieces and by what Newton already knew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from deltac.errors import InputError
from deltac.mechanism.bodies import Body, body, box, disc, frame, point_mass, rod, sphere

Array = NDArray[np.float64]
EXACT = 1e-13  # a few products and sums
sizes = st.floats(0.05, 5.0)
SYMBOLIC: Any = ["l", 0, 1]


def inertia(part: Body) -> Array:
    return np.array(part.inertia, dtype=float)


def about(part: Body, point: Array) -> Array:
    """Inertia about another point, by the parallel-axis theorem."""
    r = np.array(part.mass_centre, dtype=float) - point
    return inertia(part) + float(part.mass) * (r @ r * np.eye(3) - np.outer(r, r))


@given(sizes, sizes, sizes, sizes)
def test_a_box_is_two_half_boxes(mass: float, a: float, b: float, c: float) -> None:
    whole = box("whole", mass, [a, b, c])
    halves = [box("half", mass / 2, [a / 2, b, c], [x, 0, 0]) for x in (-a / 4, a / 4)]
    together = sum(about(half, np.zeros(3)) for half in halves)
    np.testing.assert_allclose(together, inertia(whole), rtol=EXACT, atol=EXACT)


@given(sizes, sizes, st.integers(0, 2**31))
def test_a_rod_is_two_half_rods(mass: float, length: float, seed: int) -> None:
    n = np.random.default_rng(seed).normal(size=3)
    whole = rod("whole", mass, length, along=n)
    n /= np.linalg.norm(n)
    first = rod("first", mass / 2, length / 2, along=n)
    second = rod("second", mass / 2, length / 2, along=n, start=n * length / 2)
    centre = n * length / 2
    np.testing.assert_allclose(np.array(whole.mass_centre, dtype=float), centre, rtol=EXACT)
    together = about(first, centre) + about(second, centre)
    np.testing.assert_allclose(
        together, inertia(whole), rtol=0, atol=1e-14 * mass * (1 + length**2)
    )
    assert np.abs(inertia(whole) @ n).max() < 1e-14 * mass * (
        1 + length**2
    )  # slender: none along it


@given(sizes, sizes, sizes)
def test_a_cylinder_is_two_half_cylinders(mass: float, radius: float, height: float) -> None:
    whole = disc("whole", mass, radius, "y", height)
    halves = [
        disc("half", mass / 2, radius, "y", height / 2, [0, y, 0])
        for y in (-height / 4, height / 4)
    ]
    together = sum(about(half, np.zeros(3)) for half in halves)
    np.testing.assert_allclose(together, inertia(whole), rtol=EXACT, atol=EXACT)
    assert inertia(whole)[1, 1] == pytest.approx(mass * radius**2 / 2, rel=EXACT)


def test_a_sphere_is_a_stack_of_discs() -> None:
    """Gauss–Legendre quadrature over the height is exact: the integrand is a polynomial."""
    mass, radius = 2.0, 0.7
    heights, weights = np.polynomial.legendre.leggauss(8)
    density = mass / (4 / 3 * np.pi * radius**3)
    total = np.zeros((3, 3))
    for z, w in zip(radius * heights, radius * weights, strict=True):
        area = np.pi * (radius**2 - z**2)
        slice_ = disc("slice", density * area * w, np.sqrt(radius**2 - z**2), "z", 0.0, [0, 0, z])
        total += about(slice_, np.zeros(3))
    np.testing.assert_allclose(total, inertia(sphere("ball", mass, radius)), rtol=EXACT, atol=1e-14)


def test_particles_and_frames_have_no_inertia_of_their_own() -> None:
    assert not inertia(point_mass("bead", 1.0, [1, 2, 3])).any()
    assert frame("gimbal").massless


def test_principal_moments_and_a_matrix_say_the_same() -> None:
    one = body("one", 1.0, [1.0, 2.0, 2.5])
    assert one.inertia == body("one", 1.0, np.diag([1.0, 2.0, 2.5])).inertia


@pytest.mark.parametrize(
    "moments", [[0.0, 1.0, 1.0], [1.0, 1.0, 2.0]], ids=["slender rod", "thin plate"]
)
def test_the_bounds_of_the_triangle_inequality_are_allowed(moments: list[float]) -> None:
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    tensor = turned @ np.diag(moments) @ turned.T
    body("limit", 1.0, (tensor + tensor.T) / 2)


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: body("crank", 0, [1, 1, 1]), ["mass of body 'crank'", "0", "positive"]),
        (lambda: body("crank", -2, [1, 1, 1]), ["mass of body 'crank'", "-2", "positive"]),
        (lambda: body("crank", NAN, [1, 1, 1]), ["mass of body 'crank'", "nan", "finite"]),
        (lambda: body("crank", INF, [1, 1, 1]), ["mass of body 'crank'", "inf", "finite"]),
        (lambda: body("crank", None, [1, 1, 1]), ["mass of body 'crank'", "None", "number"]),  # type: ignore[arg-type]
        (lambda: body("crank", 1, [1, 1, 3]), ["'crank'", "triangle inequality", "1 + 1 < 3"]),
        (lambda: body("crank", 1, [1, NAN, 1]), ["inertia of body 'crank'", "y", "nan"]),
        (lambda: body("crank", 1, [-1, 1, 1]), ["'crank'", "-1", "negative"]),
        (
            lambda: body("crank", 1, [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),  # type: ignore[arg-type]
            ["'crank'", "not symmetric"],
        ),
        (lambda: body("crank", 1, 2.0), ["'crank'", "three principal moments", "2.0"]),  # type: ignore[arg-type]
        (lambda: body("crank", 1, [[1, 0, 0], [0, 1, 0]]), ["'crank'", "3 by 3"]),
        (lambda: body("crank", 1, [1, 1, 1], [0, 0]), ["mass centre", "'crank'", "three"]),
        (lambda: body("crank", 1, [1, 1, 1], 3.0), ["mass centre", "'crank'", "3.0"]),  # type: ignore[arg-type]
        (lambda: body("crank", 1, [1, 1, 1], [0, 0, NAN]), ["'crank'", "component z", "nan"]),
        (lambda: rod("crank", 1, 0), ["length of rod 'crank'", "0", "positive"]),
        (lambda: rod("crank", 1, 1, along="w"), ["'crank'", "'w'", "known: x, y, z"]),
        (lambda: rod("crank", 1, 1, along=[0, 0, 0]), ["'crank'", "no direction"]),
        (lambda: rod("crank", 1, 1, along=SYMBOLIC), ["'crank'", "plain numbers"]),
        (lambda: box("crank", 1, [1, 0, 1]), ["size of box 'crank'", "0"]),
        (lambda: disc("crank", 1, 1, thickness=-1), ["thickness of disc 'crank'", "-1"]),
        (lambda: sphere("crank", 1, -1), ["radius of sphere 'crank'", "-1"]),
        (lambda: frame("ground"), ["ground", "inertial frame"]),
        (lambda: frame(" a"), ["' a'", "blanks"]),
        (lambda: frame(""), ["name"]),
    ],
)
def test_what_no_body_can_be(make: object, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        make()  # type: ignore[operator]
    for word in words:
        assert word in str(caught.value)
