"""Every kind of constraint, row by row: CasADi's derivatives against velocities drawn by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.dynamics.constraints import constraint_rows
from deltac.dynamics.system import trace
from deltac.mechanism.scene import Constraint
from tests.oracles.textbook.constraints import KINDS
from tests.oracles.textbook.kinematics import along
from tests.systems.constrained_mechanisms import EXAMPLES, Tied, four_bar, playground, playing
from tests.systems.random_mechanisms import Sample, assert_close, random_state

KINDS_OF_LOOP = {"spherical", "revolute", "universal", "prismatic", "weld"}


@pytest.fixture(scope="module", params=EXAMPLES)
def tied(request: pytest.FixtureRequest) -> Tied:
    return playing(request.param)


def test_every_kind_has_an_example() -> None:
    examples = [constraint for constraint, _ in EXAMPLES.values()]
    listed = {k for k in Constraint.__subclasses__() if k.__module__.startswith("deltac.")}
    assert {type(c) for c in examples} == listed == set(KINDS)
    assert {c.kind for c in examples if isinstance(c, dc.mechanism.constraints.Loop)} == (
        KINDS_OF_LOOP
    )


def test_rows_against_the_textbook(tied: Tied) -> None:
    """φ, ψ, G, b, γ: two derivations of the same numbers, to rounding."""
    rows, ties = tied.all_rows, tied.ties
    assert rows.names == ties.names
    assert rows.holonomic == tuple(ties.holonomic)
    found = tied.evaluate(rows.phi, rows.psi, rows.G_all, rows.G, rows.b, rows.gamma)
    expected = (ties.f, ties.psi, ties.G_all, ties.G, ties.c, ties.gamma)
    for value, wanted in zip(found, expected, strict=True):
        assert_close(value, wanted, 1e-13, 10.0)


def test_how_many_rows(request: pytest.FixtureRequest, tied: Tied) -> None:
    name = request.node.callspec.params["tied"]
    assert len(tied.all_rows) == EXAMPLES[name][1]


def test_psi_is_the_rate_of_phi(tied: Tied) -> None:
    """Both of the textbook's lines: f differentiated along the motion by a complex step, and ψ."""
    ties, book = tied.ties, tied.book

    def f(instant: np.ndarray) -> np.ndarray:
        return ties.f_at(instant[-1], instant[:-1])

    rates = along(f, np.append(book.q, book.t), np.append(book.q_dot, 1.0))
    assert_close(rates, ties.psi[ties.holonomic], 1e-13, 10.0)


def test_psi_is_linear_in_the_speeds(tied: Tied) -> None:
    """ψ = G u + b at any speeds, and J v + f_t, A v + b of the bodies' own velocities."""
    rows, ties, s = tied.all_rows, tied.ties, tied.sample
    psi, G_all, b = tied.evaluate(rows.psi, rows.G_all, rows.b)
    assert_close(psi, G_all @ s.u[:, None] + b, 1e-13, 10.0)
    v = ties.book.v
    h = ties.holonomic
    assert_close(ties.J @ v + ties.c[h], psi[h], 1e-13, 10.0)
    assert_close(ties.A @ v + ties.c[~h], psi[~h], 1e-13, 10.0)


def test_gamma_by_differences(tied: Tied) -> None:
    """ψ(t + h) − ψ(t − h) along a motion with given accelerations, whose error is of order h²."""
    rows, s, system = tied.all_rows, tied.sample, tied.system
    G, gamma = tied.evaluate(rows.G, rows.gamma)
    free = s.mechanism.free
    h = 1e-5

    def psi(step: float) -> np.ndarray:
        state = s.mechanism.state(
            dict(zip(names(s, "coordinates"), (s.q + step * tied.book.q_dot)[free.q])),
            dict(zip(names(s, "speeds"), (s.u + step * s.udot)[free.u])),
            s.t + step,
        )
        near = Sample(s.mechanism, state.t, state.q, state.u, s.udot)
        return near.evaluate(system, rows.psi)[0]

    difference = (psi(h) - psi(-h)) / (2 * h)
    assert_close(G @ s.udot[free.u][:, None] + gamma, difference, 1e-7, 10.0)


def names(sample: Sample, what: str) -> list[str]:
    return [entry.name for entry in getattr(sample.mechanism, what) if not entry.prescribed]


AT_REST = (
    "disc on the ground",
    "skate on a body",
    "gear on a driven shaft",
    "bevel gear",
    "differential",
    "rolling cam",
)
"""Examples without a law of t."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_moving_constraints_move(name: str) -> None:
    """b ≠ 0 where a law holds t, b = 0 where none does: a driven shaft is no motion of a constraint."""
    tied = playing(name)
    (b,) = tied.evaluate(tied.all_rows.b)
    size = np.abs(b).max()
    assert size < 1e-14 if name in AT_REST else size > 1e-3


def test_gears_by_hand() -> None:
    """q1 − w q2 − 0.1 t: G = (1, −w), b = −0.1; with a driven shaft the drive's column is in G_all."""
    tied = playing("gear")
    (G, b) = tied.evaluate(tied.all_rows.G, tied.all_rows.b)
    assert_close(G[0, -2:], [1.0, -1.3], 1e-15)
    assert np.abs(G[0, :-2]).max() == 0.0
    assert_close(b, [[-0.1]], 1e-15)
    tied = playing("gear on a driven shaft")
    G, G_all, b, gamma = tied.evaluate(
        tied.all_rows.G, tied.all_rows.G_all, tied.all_rows.b, tied.all_rows.gamma
    )
    assert_close(b, [[0.0]], 1e-15)
    assert G_all[0, 0] == 2.0 and np.abs(G).sum() == 1.0
    assert_close(gamma, [[2.0 * tied.sample.udot[0]]], 1e-14)


# --- rows that vanish ---------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_planar_loops_lose_the_rows_out_of_their_plane(axis: str) -> None:
    rows = constraint_rows(trace(four_bar(axis)))
    assert len(rows) == 2
    ties = Tied(random_state(four_bar(axis), np.random.default_rng(3))).ties
    assert sorted(np.abs(ties.G).max(axis=1) > 1e-12) == [False, False, False, True, True]


def test_rows_that_vanish_but_do_not_hold_are_kept() -> None:
    """A point held out of the plane of its motion: no speed can help, so the row must stay to say so."""
    planar = four_bar("z")
    lifted = dc.constraints.loop_spherical(
        "closure", "ground", "bar2", point1=[1, 0, 0.1], point2=[1, 0, 0]
    )
    rows = constraint_rows(trace(replace(planar, constraints=[lifted])))
    assert len(rows) == 3


# --- by hand ------------------------------------------------------------------------------------------


def test_rolling_disc_by_hand() -> None:
    """A disc upright on z = 0: φ = z − r, ψ = ẋ − rω at heading x, ẏ = 0."""
    r = 0.4
    mechanism = dc.Mechanism(
        [dc.bodies.disc("disc", 1.0, r, "y")],
        [dc.free("base", "disc")],
        constraints=[dc.constraints.rolling("ground", "disc", r)],
    )
    u = np.array([0.7, 0.2, 0.1, 0.3, 1.9, -0.5])
    q = np.array([0.3, -0.2, 0.45, 1.0, 0, 0, 0])
    tied = Tied(Sample(mechanism, 0.0, q, u, np.zeros(6)))
    phi, psi = tied.evaluate(tied.all_rows.phi, tied.all_rows.psi)
    assert_close(phi[0], [0.45 - r], 1e-15)
    vx, vy, vz, wx, wy, _ = u
    # The contact is r below the centre: ω × (0, 0, −r) = (−r ω_y, r ω_x, 0).
    slip = np.array([vx - r * wy, vy + r * wx])
    assert_close(psi[0], [vz], 1e-15)
    assert_close(np.sort(np.abs(psi[1:, 0])), np.sort(np.abs(slip)), 1e-15)


def test_a_leaning_wheel_touches_the_plane_at_its_lowest_point() -> None:
    """Height of a torus over a plane, against the least height of points strewn over the torus."""
    example = playground([EXAMPLES["wheel on a rising table"][0]])
    tied = Tied(random_state(example, np.random.default_rng(11)))
    (phi,) = tied.evaluate(tied.all_rows.phi)
    frames, t = tied.book.tree.frames, tied.sample.t
    around, about = np.meshgrid(np.linspace(0, 2 * np.pi, 1201), np.linspace(0, 2 * np.pi, 1201))
    far = 0.2 * 1.3 + 0.05 * np.cos(about)
    torus = np.stack([far * np.cos(around), 0.05 * np.sin(about), far * np.sin(around)], -1)
    places = frames["b2"].origin + torus @ frames["b2"].turned.T
    n = frames["b0"].turned @ (np.array([0.1, 0.2, 1]) / np.linalg.norm([0.1, 0.2, 1]))
    base = frames["b0"].place(np.array([t, 0, 0.1 * np.sin(t)]))
    # The grid is 5e-3 rad wide, so its lowest point is at most r δ²/8 above the torus's.
    lowest = ((places - base) @ n).min()
    assert 0 <= lowest - phi[0, 0] < 3e-6
