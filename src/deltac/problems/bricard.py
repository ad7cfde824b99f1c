"""Bricard's mechanism, IFToMM benchmark A04: six hinges that should be rigid, and move."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from deltac import rotations
from deltac.arrays import Array
from deltac.bodies import box
from deltac.constraints import loop_revolute
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, Signal, energy, instant, instants
from deltac.trajectories import Trajectory

WIDTH = 0.1
VERTICES = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
AXES = "yzxyzx"  # of the hinges at the vertices
THIRD_VERTEX = {
    1.0: (0.27448143, -0.88670796, -0.46232997),
    2.0: (-0.77813513, -0.98035264, -0.19725286),
}
CALCULATED = {
    1.0: (0.27448131927, -0.88670793874, -0.46233000269),
    2.0: (-0.77813537303, -0.98035268344, -0.19725267061),
    10.0: (0.9997309872, -0.9999999638, -0.0002689765),
}


def problem() -> Problem:
    """Five rods of 1 kg and 1 m, and the ground, form a loop of edges of a cube; from rest, 10 s."""
    vertices = np.array(VERTICES, dtype=float)
    edges = np.diff(vertices, axis=0)
    rods = [f"rod{k}" for k in range(1, 6)]
    bodies = [
        box(name, "m", [1.0 if e else WIDTH for e in edge], edge / 2)
        for name, edge in zip(rods, edges, strict=True)
    ]
    joints = []
    for k, (parent, name) in enumerate(zip(["ground", *rods], rods, strict=False)):
        start = edges[k - 1] if k else np.zeros(3)
        joints.append(revolute(f"hinge{k + 1}", parent, name, AXES[k], position=list(start)))
    last = loop_revolute(
        "hinge6",
        "ground",
        "rod5",
        point1=list(vertices[5]),
        point2=list(edges[4]),
        axis1=AXES[5],
    )
    mechanism = Mechanism(
        bodies=bodies,
        joints=joints,
        constraints=[last],
        gravity=(0.0, "-g", 0.0),
        parameters={"m": 1.0, "g": G},
        name="Bricard's mechanism",
    )
    heights = vertices[:-1, 1] + edges[:, 1] / 2
    start_energy = G * float(heights.sum())
    reference = [instant("energy", 10.0, energy(mechanism), start_energy, "J", "exact", 1e-14)]
    vertex = {f"third vertex {axis}": _vertex(2, k) for k, axis in enumerate("xyz")}
    elsewhere = {f"{name} (another solver)": signal for name, signal in vertex.items()}
    reference += instants(THIRD_VERTEX, elsewhere, "m", "published", 1e-6)
    for t, position in CALCULATED.items():
        accuracy = 1e-11 if t < 10.0 else 2e-10
        reference += instants({t: position}, vertex, "m", "calculated", accuracy)
    return Problem(
        name="bricard",
        title="Bricard's mechanism (IFToMM A04)",
        mechanism=mechanism,
        state=mechanism.state(),
        duration=10.0,
        step=5e-3,
        solver="ode8",
        source="IFToMM Technical Committee for Multibody Dynamics, Library of Computational "
        "Benchmark Problems, A04 Bricard mechanism",
        freedom=1,
        invariants={"energy": _energy},
        reference=tuple(reference),
        notes="Six hinges in space leave no freedom by counting; these are placed so that one of the "
        "five equations of the last hinge follows from the others. The community's threshold is an "
        "energy error below 1e-6 J.",
    )


def turned(run: Trajectory, vectors: Iterable[ArrayLike]) -> list[Array]:
    """World components (T, 3) of one vector of each rod, by the product of the hinges' rotations."""
    R = np.broadcast_to(np.eye(3), (len(run), 3, 3))
    components = []
    for k, vector in enumerate(vectors):
        R = R @ rotations.about("xyz".index(AXES[k]), run.q[:, k])
        components.append(R @ np.asarray(vector, dtype=float))
    return components


def _vertex(number: int, axis: int) -> Signal:
    edges = np.diff(np.array(VERTICES, dtype=float), axis=0)[:number]
    return lambda run: np.sum(turned(run, edges), axis=0)[:, axis]


def _energy(run: Trajectory) -> Array:
    """By rod: ½m v_G² + ½ω·Iω + m g y, with the vertices' velocities and angular velocities summed up."""
    edges = np.diff(np.array(VERTICES, dtype=float), axis=0)
    rods = turned(run, edges)
    axes = turned(run, [np.eye(3)["xyz".index(a)] for a in AXES[:5]])
    across, along = (1 + WIDTH**2) / 12, WIDTH**2 / 6
    start, velocity, w = (np.zeros((len(run), 3)) for _ in range(3))
    total = np.zeros(len(run))
    for k, (edge, axis) in enumerate(zip(rods, axes, strict=True)):
        w = w + axis * run.u[:, k, None]
        swing = np.cross(w, edge)
        centre = velocity + swing / 2
        # An axially symmetric rod: across |ω|² less what turning about itself does not have.
        spin = (w * edge).sum(axis=1)
        total += 0.5 * (centre**2).sum(axis=1) + G * (start + edge / 2)[:, 1]
        total += 0.5 * across * (w**2).sum(axis=1) + 0.5 * (along - across) * spin**2
        start, velocity = start + edge, velocity + swing
    return total
