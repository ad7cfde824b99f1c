"""Gaps between shapes: against nearest points found by search, and their rate against the motion."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from deltac import InputError, Mechanism, free, shapes
from deltac.bodies import box
from deltac.dynamics.gaps import gaps
from deltac.dynamics.system import trace
from deltac.mechanism.shapes import Box, Capsule, HalfSpace, Shape, Sphere, check_pair

Array = NDArray[Any]

MACHINE = Mechanism(
    [box("a", 1.0, [1, 1, 1]), box("b", 2.0, [1, 2, 1])],
    [free("fa", "a"), free("fb", "b")],
    parameters={"r": 0.2},
)
SYSTEM = trace(MACHINE)

#: one shape of every kind, off its body's origin and turned
MAKERS: dict[type[Shape], Callable[[str], Shape]] = {
    Sphere: lambda body: shapes.sphere(body, "r", (0.1, 0, 0)),
    Capsule: lambda body: shapes.capsule(body, 0.15, 0.8, (1, 2, 3), (0, 0.1, 0)),
    Box: lambda body: shapes.box(
        body,
        (0.6, 0.5, 0.7),
        (0, 0, 0.1),
        [[0, -1, 0], [0.6, 0, -0.8], [0.8, 0, 0.6]],  # type: ignore[arg-type]
    ),
    HalfSpace: lambda body: shapes.half_space(body, (1, 1, 0.5), (0, 0, 0.2)),
}
KINDS = list(product(MAKERS, MAKERS))
PAIRS = [pair for pair in KINDS if pair != (HalfSpace, HalfSpace)]
by_pair = pytest.mark.parametrize(
    "pair", PAIRS, ids=lambda pair: f"{pair[0].__name__}-{pair[1].__name__}"
)


def states(seed: int, count: int, apart: float = 0.5) -> list[tuple[Array, Array]]:
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        q = rng.normal(0, apart, 14)
        for place in (3, 10):
            turned = rng.normal(size=4)
            q[place : place + 4] = turned / np.linalg.norm(turned)
        found.append((q, rng.normal(size=12)))
    return found


def evaluated(pair: tuple[type, type]) -> Any:
    """gap, n, surface points and velocities of all points of a pair, as a function of (q, u)."""
    found = gaps(SYSTEM, MAKERS[pair[0]]("a"), MAKERS[pair[1]]("b"))
    columns = [
        ca.vertcat(
            g.gap,
            g.n,
            g.on_first,
            g.on_second,
            ca.dot(g.n, g.relative_velocity),
            ca.jtimes(g.gap, SYSTEM.q, SYSTEM.qdot),
        )
        for g in found
    ]
    return ca.Function("gaps", [SYSTEM.q, SYSTEM.u], [ca.horzcat(*columns)])


@by_pair
def test_the_gap_opens_at_the_speed_of_the_material_points(pair: tuple[type, type]) -> None:
    """n·(v1 − v2) = ġ: the condition for f(g) n to have a potential. n is a unit vector, the ends g apart."""
    f = evaluated(pair)
    for q, u in states(1, 30):
        for gap, *rest in np.array(f(q, u)).T:
            n, p1, p2 = np.reshape(rest[:9], (3, 3))
            opening, rate = rest[9:]
            assert abs(opening - rate) <= 1e-12 * (1 + abs(rate))  # rounding
            assert abs(n @ n - 1) <= 1e-13
            np.testing.assert_allclose(p1 - p2, gap * n, atol=1e-13)


# --- nearest points by search: a shape is a core (point, segment, box) and a radius ------------------


def rotation(q: Array) -> Array:
    w, v = q[0], q[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def core(shape: Shape, q: Array) -> tuple[Array, Array, float]:
    """Middle, half axes (3, k) and radius of a shape in the world."""
    turned = rotation(q[3:])
    middle = q[:3] + turned @ np.array(shape.position, dtype=float)
    match shape:
        case Capsule():
            half = 0.5 * shape.length * turned @ np.array(shape.axis)
            return middle, half[:, None], shape.radius
        case Box():
            half = turned @ np.array(shape.rotation) @ np.diag(0.5 * np.array(shape.size))
            return middle, half, 0.0
    return middle, np.zeros((3, 0)), MACHINE.number(shape.radius)  # type: ignore[attr-defined]


def distance_by_search(one: Shape, other: Shape, q: Array) -> float:
    """The distance of two cores (a convex problem) less the radii; only right where the cores are apart."""
    (c1, A1, r1), (c2, A2, r2) = core(one, q[:7]), core(other, q[7:])
    A = np.hstack([A1, -A2])

    def square(x: Array) -> float:
        d = c1 - c2 + A @ x
        return float(d @ d)

    count = A.shape[1]
    x = np.zeros(count)
    if count:
        found = minimize(
            square,
            x,
            jac=lambda x: 2 * A.T @ (c1 - c2 + A @ x),
            bounds=[(-1, 1)] * count,
            method="L-BFGS-B",
            options={"ftol": 1e-15, "gtol": 1e-12},
        )
        x = found.x
    return float(np.sqrt(square(x))) - r1 - r2


EXACT = [
    (Sphere, Sphere), (Sphere, Capsule), (Sphere, Box), (Capsule, Sphere), (Capsule, Capsule),
    (Box, Sphere),
]  # fmt: skip


@pytest.mark.parametrize("pair", EXACT, ids=lambda pair: f"{pair[0].__name__}-{pair[1].__name__}")
def test_the_gap_is_the_least_distance(pair: tuple[type, type]) -> None:
    f = evaluated(pair)
    one, other = MAKERS[pair[0]]("a"), MAKERS[pair[1]]("b")
    seen = 0
    for q, u in states(2, 60):
        searched = distance_by_search(one, other, q)
        if searched + core(one, q[:7])[2] + core(other, q[7:])[2] < 1e-3:
            continue  # the cores meet: the distance of cores is zero and says no more
        seen += 1
        assert abs(float(f(q, u)[0, 0]) - searched) <= 1e-7  # the search's own accuracy
    assert seen >= 40


@pytest.mark.parametrize("pair", [(Capsule, Box), (Box, Box)])
def test_sampled_pairs_never_report_less_than_the_distance(pair: tuple[type, type]) -> None:
    """Samples see no edge across an edge, so they may miss an overlap; they never invent one."""
    f = evaluated(pair)
    one, other = MAKERS[pair[0]]("a"), MAKERS[pair[1]]("b")
    met = 0
    for q, u in states(3, 40, apart=1.0):
        searched = distance_by_search(one, other, q)
        if searched > 1e-3:
            least = float(np.array(f(q, u))[0].min())
            assert least >= searched - 1e-7
            met += abs(least - searched) < 1e-6
    assert met >= 5, "corners are often the nearest points"


def test_inside_a_box_the_nearest_face_counts() -> None:
    ball, crate = shapes.sphere("a", 0.1), shapes.box("b", (2.0, 1.0, 4.0))
    (found,) = gaps(SYSTEM, ball, crate)
    f = ca.Function("f", [SYSTEM.q], [found.gap, found.n])
    still = [0, 0, 0, 1, 0, 0, 0]
    for place, gap, n in (
        ((0.2, -0.4, 1.0), -0.1 - 0.1, (0, -1, 0)),
        ((0.9, 0.1, 0.0), -0.1 - 0.1, (1, 0, 0)),
        ((0.0, 0.5, 0.0), -0.1, (0, 1, 0)),  # the centre on a face
        ((0.0, 0.0, 0.0), -0.5 - 0.1, (0, 1, 0)),  # at the middle: the nearest faces are ±y
        ((0.0, 0.0, 2.5), 0.5 - 0.1, (0, 0, 1)),
    ):
        g, normal = f([*place, 1, 0, 0, 0, *still])
        assert float(g) == pytest.approx(gap, abs=1e-15)
        np.testing.assert_allclose(np.array(normal).ravel(), n, atol=1e-15)


@pytest.mark.parametrize(
    ("pair", "q"),
    [
        ((Sphere, Sphere), None),
        ((Capsule, Capsule), [0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0]),
        ((Capsule, Capsule), [0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]),
    ],
    ids=["one centre", "parallel capsules", "one axis"],
)
def test_degenerate_poses_stay_finite(pair: tuple[type, type], q: Any) -> None:
    """Coincident centres and parallel axes have no unique normal; a fixed one is taken, never NaN."""
    found = gaps(SYSTEM, MAKERS[pair[0]]("a"), MAKERS[pair[1]]("b"))[0]
    f = ca.Function(
        "f", [SYSTEM.q], [found.gap, found.n, ca.jacobian(found.gap, SYSTEM.q), found.place]
    )
    q = [0, 0, 0, 1, 0, 0, 0] * 2 if q is None else q
    gap, n, slope, place = (np.array(value) for value in f(q))
    assert np.isfinite([gap.sum(), slope.sum(), place.sum()]).all()
    assert np.linalg.norm(n) == pytest.approx(1.0)


def test_a_moving_plane_carries_its_normal_along() -> None:
    plane = shapes.half_space("b", "z")
    (found,) = gaps(SYSTEM, shapes.point("a"), plane)
    f = ca.Function("f", [SYSTEM.q], [found.gap, found.n])
    half = np.sqrt(0.5)
    gap, n = f([0.3, 0.0, 0.0, 1, 0, 0, 0, 0.1, 0, 0, half, 0, half, 0])  # z turned to x
    assert float(gap) == pytest.approx(0.2)
    np.testing.assert_allclose(np.array(n).ravel(), [1, 0, 0], atol=1e-15)


def test_shapes_without_sense_are_refused() -> None:
    with pytest.raises(InputError, match=r"radius of sphere shape of body 'a': found -1, expected"):
        shapes.sphere("a", -1.0)
    with pytest.raises(InputError, match=r"size of box shape of body 'a', component y"):
        shapes.box("a", (1, 0, 1))
    with pytest.raises(InputError, match=r"axis of capsule shape.*no direction"):
        shapes.capsule("a", 0.1, 1.0, (0, 0, 0))
    with pytest.raises(InputError, match=r"both shapes belong to 'a'"):
        check_pair(shapes.point("a"), shapes.sphere("a", 1.0), "contact 'c'")
    with pytest.raises(InputError, match=r"two half-spaces"):
        check_pair(shapes.half_space("a"), shapes.half_space(), "contact 'c'")
    with pytest.raises(InputError, match=r"two points never touch"):
        check_pair(shapes.point("a"), shapes.point("b"), "contact 'c'")
    with pytest.raises(InputError, match=r"in contact 'c': unknown body 'ball'"):
        shapes.point("ball").check(MACHINE.scope, "contact 'c'")
    with pytest.raises(
        InputError, match=r"radius of the sphere shape of 'a' in contact 'c': found -0.2"
    ):
        negative = MACHINE.with_parameters(r=-0.2)
        shapes.sphere("a", "r").check(negative.scope, "contact 'c'")
