"""Constraints for tests: one example of every kind, and random constrained mechanisms.

Structure (which tree, which constraints) is drawn by Hypothesis; numbers come from a seeded generator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy
from numpy.typing import NDArray

import deltac as dc
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.independence import independence
from deltac.dynamics.system import System, trace
from deltac.dynamics.terms import Constrained
from deltac.errors import InputError
from deltac.mechanism.bodies import body, rod
from deltac.mechanism.constraints import (
    angle,
    belt,
    bevel_gear,
    differential,
    distance,
    gear,
    higher_pair,
    holonomic,
    loop_prismatic,
    loop_revolute,
    loop_spherical,
    loop_universal,
    loop_weld,
    motion_constraint,
    point_in_plane,
    point_on,
    point_on_line,
    rolling,
    skate,
)
from deltac.mechanism.joints import free, revolute, spherical, universal
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import rotation_matrix
from deltac.mechanism.scene import Constraint
from deltac.mechanism.scope import GROUND
from tests.oracles.textbook.constrained import ConstrainedTextbook
from tests.oracles.textbook.kinematics import tree
from tests.oracles.textbook.tree import Textbook
from tests.systems.random_mechanisms import Options, Sample, random_state, samples

Array = NDArray[Any]

# --- one example of every kind ------------------------------------------------------------------------

TURNED = rotation_matrix((0.3, -0.5, 0.8), 0.7)

EXAMPLES: dict[str, tuple[Constraint, int]] = {
    "spherical loop": (
        loop_spherical(
            "c", "b1", "b3", point1=["0.1*sin(w*t)", 0.2, 0.1], point2=[0, "0.1*t", -0.3]
        ),
        3,
    ),
    "revolute loop": (
        loop_revolute(
            "c", "b1", "b3", point1=[0.1, 0.2, "0.1*t"], axis1=[1, 2, 3], axis2=[0.5, -1, 1]
        ),
        5,
    ),
    "universal loop": (
        loop_universal("c", "b2", "b1", point2=["cos(t)", 0, 0], axis1=[1, 1, 0], axis2="z"),
        4,
    ),
    "prismatic loop": (
        loop_prismatic(
            "c",
            "b1",
            "b2",
            point1=["0.1*t", 0.2, 0],
            point2=[0, 0, "t**2"],
            axis1=[1, -1, 2],
            rotation=TURNED,
        ),
        5,
    ),
    "weld": (loop_weld("c", "b3", "b1", point1=[0.1, "sin(t)", 0], rotation=TURNED), 6),
    "loop to the ground": (loop_spherical("c", "ground", "b3", point1=["0.2*t", 0, "cos(t)"]), 3),
    "rod": (distance("c", "b1", "b3", "1 + 0.2*sin(w*t)", point1=["0.3*t", 0, 0.1]), 1),
    "surface": (point_on("c", "b2", "z - 0.1*sin(w*t)*x*y + x**2", point=[0.1, 0.2, "0.1*t"]), 1),
    "curve on a body": (
        point_on("c", "b3", ["y - sin(x - t)", "z - 0.2*x**3"], point=[0, 0.1, 0], on="b1"),
        2,
    ),
    "plane": (point_in_plane("c", "b3", on="b0", normal=[1, 2, 2], offset="0.3*sin(t)"), 1),
    "line": (
        point_on_line("c", "b2", point=[0.1, 0, 0], on="b1", through=["t", 0, 1], along=[1, 1, 0]),
        2,
    ),
    "angle": (angle("c", "b1", "b3", "1 + 0.3*sin(t)", axis1=[1, 0, 1], axis2="y"), 1),
    "gear": (gear("c", "knuckle.first", "knuckle.second", "w", "0.1*t"), 1),
    "gear on a driven shaft": (gear("c", "knuckle.first", "drive", -2.0), 1),
    "belt": (belt("c", "knuckle.first", 0.2, "knuckle.second", "w", crossed=True, phase="t"), 1),
    "bevel gear": (bevel_gear("c", "knuckle.first", 20, "knuckle.second", 35), 1),
    "differential": (differential("c", "knuckle.first", "knuckle.second", "drive", 2.5), 1),
    "holonomic": (holonomic("c", "q.knuckle.first**2 + sin(q.base.x*t) - q.drive"), 1),
    "motion": (
        motion_constraint("c", "q.base.y*u.base.vx + sin(t)*u.knuckle.first + u.drive - w*t"),
        1,
    ),
    "disc on the ground": (rolling("c", "b3", 0.3, axis=[0.2, 1, 0.1], centre=[0.1, 0, 0]), 3),
    "wheel on a rising table": (
        rolling(
            "c",
            "b2",
            "0.2*w",
            tube=0.05,
            axis="y",
            on="b0",
            point=["t", 0, "0.1*sin(t)"],
            normal=[0.1, 0.2, 1],
        ),
        3,
    ),
    "sphere on a belt": (
        rolling("c", "b3", tube=0.4, surface_velocity=["0.5 + 0.1*x", "sin(t)*y", 0]),
        3,
    ),
    "cam": (
        higher_pair(
            "c",
            "b1",
            "x**2 + 2*y**2 + z*y - t",
            "b0",
            "z - 0.3*sin(x) + 0.1*t*y",
            at="b3",
            along="y",
        ),
        4,
    ),
    "rolling cam": (
        higher_pair(
            "c", "b1", "x**2 + y**2 + 3*z**2 - w", "ground", "y - x*z", at="b2", rolling=True
        ),
        6,
    ),
    "skate": (skate("c", "b3", point=[0.3, 0, 0], lateral=[0, 1, 0.2], drift="0.1*sin(t)"), 1),
    "skate on a body": (skate("c", "b3", point=[0.3, 0, 0], on="b0"), 1),
}
"""Constraints of the playground with how many rows they have; every law of t that may stand does."""


def playground(constraints: Sequence[Constraint] = (), **options: Any) -> Mechanism:
    """A driven shaft with a ball joint on it; a free body with a universal joint."""
    return Mechanism(
        [
            body("b0", 1.1, (0.2, 0.3, 0.25), [0.1, 0, 0]),
            body("b1", 0.7, (0.12, 0.1, 0.15), [0, 0.1, -0.2]),
            body("b2", 1.5, (0.3, 0.2, 0.25), [0.05, 0, 0.1]),
            body("b3", 0.9, (0.1, 0.14, 0.12), [0, 0.1, 0]),
        ],
        [
            revolute("drive", GROUND, "b0", [0.2, 0.1, 1], motion="0.5*sin(1.7*t) + 0.2*t"),
            spherical("ball", "b0", "b1", position=[0.3, 0.1, 0.4]),
            free("base", "b2"),
            universal("knuckle", "b2", "b3", position=[0.1, 0, 0.3], first="x", second=[0, 1, 0.2]),
        ],
        constraints=constraints,
        gravity=options.pop("gravity", [0.3, 0.1, -9.81]),
        parameters={"w": 1.3},
        **options,
    )


def four_bar(
    axis: str = "z", *, spatial: bool = False, closure: Constraint | None = None, **options: Any
) -> Mechanism:
    """Three rods of length 1 on hinges a distance 1 apart; all about `axis`, unless `spatial` turns
    the frame they stand in. Flat at q = (0, 0, π) + k π: the parallelogram's singular positions.
    """
    along = {"z": "x", "x": "y", "y": "z"}[axis]
    x = np.array([float(along == e) for e in "xyz"])
    standing = rotation_matrix((0.3, -0.5, 0.8), 0.7) if spatial else rotation_matrix("z", 0.0)
    far = tuple(np.array(standing) @ x)
    turned = tuple(np.array(standing) @ np.array([float(axis == e) for e in "xyz"]))
    if closure is None:
        closure = loop_revolute(
            "closure", GROUND, "bar2", point1=far, point2=x, axis1=turned, axis2=axis
        )
    return Mechanism(
        [rod(f"bar{k}", 1.0, 1.0, along=along) for k in range(3)],
        [
            revolute("hinge0", GROUND, "bar0", axis, rotation=standing),
            revolute("hinge1", "bar0", "bar1", axis, position=x),
            revolute("hinge2", "bar1", "bar2", axis, position=x),
        ],
        constraints=[closure],
        name="four-bar",
        **options,
    )


def parallelogram(crank: float) -> list[float]:
    """The relative angles of a four-bar whose outer bars stay parallel."""
    return [crank, -crank, crank - np.pi]


# --- random constrained mechanisms --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Tied:
    """A sample of a constrained mechanism with its rows, in symbols and in the textbook."""

    sample: Sample

    @cached_property
    def system(self) -> System:
        return trace(self.sample.mechanism)

    @cached_property
    def all_rows(self) -> ConstraintRows:
        return equations_of(self.system).rows

    @cached_property
    def independent(self) -> tuple[int, ...]:
        """Rows independent at this very state."""
        q = self.sample.q[self.sample.mechanism.free.q]
        found = independence(equations_of(self.system), self.sample.t, q)
        return found.independent

    @cached_property
    def bound(self) -> Constrained:
        made = equations_of(self.system).constrained(self.independent)
        assert made is not None
        return made

    @cached_property
    def ties(self) -> ConstrainedTextbook:
        s = self.sample
        return ConstrainedTextbook(s.mechanism, s.t, s.q, s.u)

    @property
    def book(self) -> Textbook:
        return self.ties.book

    def evaluate(self, *expressions: Any, **given: Any) -> list[Array]:
        return self.sample.evaluate(self.system, *expressions, **given)

    def __repr__(self) -> str:
        kinds = ", ".join(type(c).__name__ for c in self.sample.mechanism.constraints)
        return f"Tied({self.sample!r}; {kinds})"


def condition(tied: Tied) -> float:
    """How much the constrained system magnifies rounding: that of G M⁻¹ Gᵀ, and of M."""
    ties = tied.ties
    M = tied.book.mass_matrix
    G = ties.G[list(tied.independent)]
    S = G @ np.linalg.solve(M, G.T)
    d = 1 / np.sqrt(np.diag(S))
    return float(np.linalg.cond(M) * np.linalg.cond(d[:, None] * S * d))


def tied(options: Options, *, moving: bool = True, most: int = 2) -> SearchStrategy[Tied]:
    """Random trees with random constraints, assembled: all constraints are met at both levels."""
    return st.composite(_tied)(options, moving, most)


def _tied(draw: DrawFn, options: Options, moving: bool, most: int) -> Tied:
    sample = draw(samples(options))
    seed = draw(st.integers(0, 2**32 - 1), label="seed of constraints")
    rng = np.random.default_rng(seed)
    kinds = draw(
        st.lists(st.sampled_from(tuple(RANDOM)), min_size=1, max_size=most), label="constraints"
    )
    made = [RANDOM[kind](rng, sample, f"{kind}{k}", moving) for k, kind in enumerate(kinds)]
    found = [constraint for constraint in made if constraint is not None]
    assume(found)
    mechanism = replace(sample.mechanism, constraints=found)
    guess = mechanism.state(
        {mechanism.coordinates[int(i)].name: sample.q[i] for i in mechanism.free.q},
        {mechanism.speeds[int(i)].name: sample.u[i] for i in mechanism.free.u},
        sample.t,
    )
    try:
        assembly = dc.assemble(mechanism, guess)
    except InputError:  # no such configuration near: too few freedoms
        assume(False)
    assume(assembly.freedom > 0 and not assembly.singular)
    state = assembly.state
    made_tied = Tied(Sample(mechanism, sample.t, state.q.copy(), state.u.copy(), sample.udot))
    # Rows that vanish identically are left out of the system, and stay in the textbook.
    assume(made_tied.independent and made_tied.all_rows.names == made_tied.ties.names)
    return made_tied


def _pair(rng: np.random.Generator, mechanism: Mechanism) -> tuple[str, str]:
    """Two different bodies, one of them possibly the ground; the second moves."""
    names = [b.name for b in mechanism.bodies]
    second = str(rng.choice(names))
    first = str(rng.choice([GROUND, *(name for name in names if name != second)]))
    return first, second


def _swing(rng: np.random.Generator, t: float, moving: bool) -> str:
    """A law of t that vanishes at the time of the sample."""
    return f"{rng.uniform(0.1, 0.4):.6f}*sin(1.3*(t - {t!r}))" if moving else "0"


def _meeting(rng: np.random.Generator, sample: Sample, moving: bool) -> dict[str, Any]:
    """Two bodies and a point on each that meet, but for some centimetres."""
    one, two = _pair(rng, sample.mechanism)
    frames = tree(sample.mechanism, sample.q).frames
    place = frames[two].place(rng.normal(0, 0.4, 3))
    first = frames[one].turned.T @ (place - frames[one].origin)
    second = frames[two].turned.T @ (place - frames[two].origin) + rng.normal(0, 0.02, 3)
    law = f"{float(first[0])!r} + {_swing(rng, sample.t, moving)}"
    return {
        "body1": one,
        "body2": two,
        "point1": [law, *map(float, first[1:])],
        "point2": list(map(float, second)),
    }


def _ball_loop(rng: np.random.Generator, sample: Sample, name: str, moving: bool) -> Constraint:
    return loop_spherical(name, **_meeting(rng, sample, moving))


def _hinge_loop(rng: np.random.Generator, sample: Sample, name: str, moving: bool) -> Constraint:
    met = _meeting(rng, sample, moving)
    frames = tree(sample.mechanism, sample.q).frames
    world = rng.normal(size=3)
    axes = [frames[met[b]].turned.T @ world for b in ("body1", "body2")]
    return loop_revolute(name, **met, axis1=tuple(axes[0]), axis2=tuple(axes[1]))


def _rod(rng: np.random.Generator, sample: Sample, name: str, moving: bool) -> Constraint:
    one, two = _pair(rng, sample.mechanism)
    frames = tree(sample.mechanism, sample.q).frames
    points = rng.normal(0, 1, (2, 3))
    apart = np.linalg.norm(frames[two].place(points[1]) - frames[one].place(points[0]))
    length = f"{float(apart) * 1.01!r} + {_swing(rng, sample.t, moving)}"
    return distance(name, one, two, length, point1=points[0], point2=points[1])


def _gear(rng: np.random.Generator, sample: Sample, name: str, moving: bool) -> Constraint | None:
    plain = [
        entry.name
        for entry in sample.mechanism.coordinates
        if entry.name.split(".")[-1] not in ("qw", "qx", "qy", "qz")
    ]
    if len(plain) < 2:
        return None
    first, second = (str(c) for c in rng.choice(plain, 2, replace=False))
    ratio = float(rng.uniform(0.5, 2))
    at = sample.mechanism.coordinates
    phase = float(sample.q[at[first].index] - ratio * sample.q[at[second].index])
    return gear(name, first, second, ratio, f"{phase!r} + {_swing(rng, sample.t, moving)}")


def _disc(rng: np.random.Generator, sample: Sample, name: str, moving: bool) -> Constraint:
    one, two = _pair(rng, sample.mechanism)
    frames = tree(sample.mechanism, sample.q).frames
    normal, axis = rng.normal(size=(2, 3))
    normal /= np.linalg.norm(normal)
    axis /= np.linalg.norm(axis)
    n, a = frames[one].turned @ normal, frames[two].turned @ axis
    lean = n @ a
    lowest = frames[two].origin - 0.3 * (n - lean * a) / np.sqrt(1 - lean**2) - 0.1 * n
    base = frames[one].turned.T @ (lowest - frames[one].origin)
    rising = f"{float(base[2])!r} + {_swing(rng, sample.t, moving)}"
    return rolling(
        name,
        two,
        0.3,
        tube=0.1,
        axis=tuple(axis),
        on=one,
        point=[float(base[0]), float(base[1]), rising],
        normal=tuple(normal),
        surface_velocity=["0.2*t", "0.1*y", 0] if moving else (0.0, 0.0, 0.0),
    )


def _skate(rng: np.random.Generator, sample: Sample, name: str, moving: bool) -> Constraint:
    one, two = _pair(rng, sample.mechanism)
    drift = "0.2 + 0.1*sin(t)" if moving else 0.0
    lateral = tuple(rng.normal(size=3))
    return skate(name, two, point=rng.normal(0, 0.3, 3), lateral=lateral, on=one, drift=drift)


RANDOM: dict[str, Callable[..., Constraint | None]] = {
    "ball": _ball_loop,
    "hinge": _hinge_loop,
    "rod": _rod,
    "gear": _gear,
    "disc": _disc,
    "skate": _skate,
}
"""Constraints that nearly hold at a sample's state: dc.assemble finds one where they do."""


def playing(name: str, seed: int = 5) -> Tied:
    """The playground with one example at a random state, which does not satisfy the constraint."""
    constraint, _ = EXAMPLES[name]
    return Tied(random_state(playground([constraint]), np.random.default_rng(seed)))


def numeric(values: Any) -> Array:
    """A CasADi matrix of numbers as an array."""
    return np.array(ca.DM(values))
