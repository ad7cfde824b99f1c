"""The theory's matrices: their identities on random mechanisms, closed forms, reactions by other means."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings

import deltac as dc
from deltac.analysis.matrices import Matrices, matrices_at, stacked
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.dynamics.kkt import least_squares
from deltac.errors import InputError
from deltac.mechanism.laws import as_law
from deltac.mechanism.scene import Constraint, Scene
from deltac.problems.triple_pendulum_equations import HandEquations
from tests.systems.constrained_mechanisms import Tied, condition, four_bar, parallelogram, tied
from tests.systems.machines import pendulum
from tests.systems.random_mechanisms import Options, Sample, samples

ROUNDING = 1e-9
"""Relative to the largest term: complements are solved for, and random mechanisms are badly scaled."""


few = settings(max_examples=settings().max_examples // 3)
"""An example takes some tenths of a second."""


def near(a: Any, b: Any, *scale: Any, loss: float = 1.0) -> None:
    """Equal to rounding of the largest of a, b and `scale`, magnified by `loss`."""
    size = max(float(np.abs(np.asarray(x)).max(initial=0.0)) for x in (a, b, *scale, 1.0))
    np.testing.assert_allclose(a, b, rtol=0.0, atol=ROUNDING * size * loss)


def vanishes(product: Any, *scale: Any, loss: float = 1.0) -> None:
    near(product, np.zeros(np.shape(product)), *scale, loss=loss)


def identities(m: Matrices, loss: float = 1.0) -> None:
    """What must hold of the matrices of any state that meets its constraints."""
    R, R_hat = m.R, m.R_hat
    near(m.R @ m.u + m.v_t, m.v, R, loss=loss)
    near(m.R_hat @ m.u_hat + m.v_t_hat, m.v, R_hat, loss=loss)
    vanishes(m.J @ m.R, R, loss=loss)
    vanishes(m.J @ m.R_hat, R_hat, loss=loss)
    vanishes(m.A @ m.R_hat, R_hat, loss=loss)
    near(m.J @ m.v_t, -m.f_t, m.v_t, loss=loss)
    near(m.A @ m.v_t_hat, -m.b, m.v_t_hat, loss=loss)
    vanishes(m.J @ m.v + m.f_t, m.v, loss=loss)
    vanishes(m.A @ m.v + m.b, m.v, loss=loss)
    near(m.J_joints @ m.v, -m.f_t_joints, m.v)
    vanishes(m.J_joints @ m.R, R, loss=loss)
    vanishes(m.F_r + m.F_r_star, np.abs(R_hat).T @ np.abs(m.M @ m.v_dot), loss=loss)
    vanishes(m.F + m.F_star + m.F_prime, m.F)
    # F′ is what joints, loops and motion constraints can exert, and nothing else.
    inner = m.F_prime - m.J.T @ m.lambda_c - m.A.T @ m.lambda_m
    multipliers = np.linalg.lstsq(m.J_joints.T, inner, rcond=None)[0]
    near(m.J_joints.T @ multipliers, inner, m.F_prime, loss=loss)


@given(samples(Options()))
def test_identities_of_trees(sample: Sample) -> None:
    loss = float(np.linalg.cond(sample.book.mass_matrix)) if len(sample.book.free) else 1.0
    m = matrices_at(sample.mechanism, sample.t, sample.q, sample.u, joints=True)
    identities(m, max(1.0, 1e-4 * loss))
    assert len(m.J) == len(m.A) == 0 and m.R is not m.R_hat
    near(m.R @ m.udot[sample.mechanism.free.u] + m.R_dot @ m.u + m.v_t_dot, m.v_dot, m.R_dot)


@pytest.mark.long
@few
@given(tied(Options(bodies=3, massless=False, thin=False)))
def test_identities_with_constraints(tied: Tied) -> None:
    s = tied.sample
    loss = condition(tied)
    assume(loss < 1e6)  # nearly dependent constraints have nearly any multipliers
    m = matrices_at(s.mechanism, s.t, s.q, s.u, joints=True)
    identities(m, loss)
    rank = len(tied.independent)
    assert m.R_hat.shape[1] == len(s.mechanism.free.u) - rank


@pytest.mark.long
@few
@given(tied(Options(bodies=3, massless=False, thin=False)))
def test_the_recursions_find_the_same(tied: Tied) -> None:
    """u̇ and, where no row is redundant, λ of the factorised equations that simulations use."""
    s, free = tied.sample, tied.sample.mechanism.free
    loss = condition(tied)
    assume(loss < 1e6)
    m = matrices_at(s.mechanism, s.t, s.q, s.u)
    motion = equations_of_motion(s.mechanism)
    terms = motion.terms(s.t, s.q[free.q], s.u[free.u])
    rows = list(tied.independent)
    solved = least_squares(terms.M, terms.G[rows])
    force = terms.force - terms.bias
    lam = solved.multipliers(force, terms.gamma[rows])
    udot = solved.free_response(force + terms.G[rows].T @ lam)
    near(m.udot[free.u], udot, loss=loss)
    G = m.B[:, free.u].T @ np.vstack([m.J, m.A]).T
    ties = G @ np.concatenate([m.lambda_c, m.lambda_m])
    near(ties, terms.G[rows].T @ lam, force, loss=loss)


@few
@given(samples(Options()))
def test_the_textbook_finds_the_same_on_trees(sample: Sample) -> None:
    """Kinematics, forces and equations that share no line with what is traced."""
    s, book = sample, sample.book
    m = matrices_at(s.mechanism, s.t, s.q, s.u)
    keep = [
        *range(6 * len(m.bodies)),
        *(6 * len(m.bodies) + np.flatnonzero(book.M.diagonal()[6 * len(m.bodies) :])),
    ]
    near(m.B, book.P[keep])
    near(m.v_t, book.v_t[keep], m.v)
    near(m.R_dot, book.R_dot[keep])
    near(m.v_t_dot, book.v_t_dot[keep], m.v_dot)
    near(m.M, book.M[np.ix_(keep, keep)])
    near(m.beta, book.beta[keep])
    near(m.F_V, book.F_V[keep], m.F)
    near(m.F_D, book.F_D[keep], m.F)
    near(m.F_star, book.F_star(m.udot)[keep])


@pytest.mark.long
@few
@given(tied(Options(bodies=3, massless=False, thin=False)))
def test_the_textbook_finds_the_same_with_constraints(tied: Tied) -> None:
    s, book = tied.sample, tied.ties
    m = matrices_at(s.mechanism, s.t, s.q, s.u, udot=np.zeros(len(s.u)))
    holonomic = book.holonomic
    near(m.J @ m.B, book.G_all[holonomic])
    near(m.A @ m.B, book.G_all[~holonomic])
    near(m.f_t, book.c[holonomic])
    near(m.b, book.c[~holonomic])
    vanishes(m.J @ m.R_hat, m.R_hat, loss=condition(tied))


# --- closed forms --------------------------------------------------------------------------------------


def test_closed_forms_of_the_triple_pendulum() -> None:
    """R, v, M, F and F* of three bars in a chain, written out (chapter 3 of the thesis)."""
    problem = dc.problems.load("triple-pendulum")
    mechanism = problem.mechanism
    names = mechanism.coordinates.names
    theta, rate = np.array([0.3, 1.1, -0.4]), np.array([0.7, -1.2, 2.0])
    relative = np.diff(theta, prepend=0.0), np.diff(rate, prepend=0.0)
    state = mechanism.state(dict(zip(names, relative[0])), dict(zip(names, relative[1])))
    m = matrices_at(mechanism, 0.0, state.q, state.u)
    l, W, g = np.array([0.1, 0.25, 0.5]), np.array([10.0, 30.0, 20.0]), 9.8
    mass, r = W / g, l / 2
    R = np.zeros((18, 3))
    for body in range(3):
        for k in range(body + 1):
            arm = r[k] if k == body else l[k]
            R[6 * body : 6 * body + 2, k] = arm * np.array([np.cos(theta[k]), np.sin(theta[k])])
        R[6 * body + 5, body] = 1.0
    R = R @ np.tril(np.ones((3, 3)))  # absolute rates from those of the joints
    np.testing.assert_allclose(m.R, R, atol=1e-14)
    np.testing.assert_allclose(m.v, R @ relative[1], atol=1e-13)
    place = [l[:k] @ np.c_[np.sin(theta[:k]), -np.cos(theta[:k])] for k in range(4)]
    for k in range(3):
        at = place[k] + r[k] * np.array([np.sin(theta[k]), -np.cos(theta[k])])
        np.testing.assert_allclose(m.x[7 * k : 7 * k + 2], at, atol=1e-14)
    np.testing.assert_allclose(m.M.diagonal()[0::6], mass, rtol=1e-14)
    np.testing.assert_allclose(m.M.diagonal()[5::6], mass * l**2 / 12, rtol=1e-13)
    np.testing.assert_allclose(m.F.reshape(3, 6)[:, 1], -W, rtol=1e-14)
    # At the tip nothing hangs on bar 3: its hinge carries what accelerates it.
    np.testing.assert_allclose(
        m.reaction_force[2, :2], (m.M @ m.v_dot)[12:14] - m.F[12:14], rtol=1e-12
    )


def test_power_of_the_driven_pendulum() -> None:
    """K̇ in the absolute angles, and the drive as a motion constraint A v + b = 0: Q̇ = −bᵀλ_m = M1 θ̇1."""
    A, w, t = 1.0, 0.75, 0.4
    problem = dc.problems.load("triple-pendulum")
    first = problem.mechanism.joints[0]
    drive = dc.constraints.motion_constraint("drive", f"u.{first.name} - {A}*{w}*cos({w}*t)")
    mechanism = replace(problem.mechanism, constraints=(drive,))
    theta = np.array([A * np.sin(w * t), 1.1, -0.4])
    omega = np.array([A * w * np.cos(w * t), -1.2, 2.0])
    q, u = np.diff(theta, prepend=0.0), np.diff(omega, prepend=0.0)
    state = mechanism.state(q, u, t)
    m = dc.matrices(mechanism, state)
    hand = HandEquations.of({**mechanism.parameters, "A": A, "w": w})
    torque = hand.driving_torque(t, theta[1:], omega[1:])
    # A picks θ̇1 out of the velocities, and b = −Aω cos ωt.
    assert (m.A @ m.v)[0] == pytest.approx(omega[0], rel=1e-13)
    assert m.b[0] == pytest.approx(-omega[0], rel=1e-13)
    assert m.lambda_m[0] == pytest.approx(torque, rel=1e-11)
    # K̇ = Σ ω_i (M ω̇)_i + ½ ωᵀṀω = Σ ω_i (f_i + M1 δ_i1 + …) = power of weight and drive.
    a1 = -A * w**2 * np.sin(w * t)
    rate = np.array([a1, *hand.driven(t, theta[1:], omega[1:])])
    (M11, M12, M13, M22, M23, M33), _ = hand.terms(theta, omega)
    M = np.array([[M11, M12, M13], [M12, M22, M23], [M13, M23, M33]])
    step = 1e-6

    def kinetic(at: float) -> float:
        (a, b, c, d, e, f), _ = hand.terms(theta + at * omega, omega)
        v = omega + at * rate
        return float(0.5 * v @ np.array([[a, b, c], [b, d, e], [c, e, f]]) @ v)

    by_hand = (kinetic(step) - kinetic(-step)) / (2 * step)
    K_dot = m.v @ (m.M @ m.v_dot)
    assert K_dot == pytest.approx(by_hand, rel=1e-8)
    assert 0.5 * omega @ M @ omega == pytest.approx(0.5 * m.v @ (m.M @ m.v), rel=1e-13)
    assert K_dot - m.v @ m.F == pytest.approx(torque * omega[0], rel=1e-10)
    assert -m.b @ m.lambda_m == pytest.approx(torque * omega[0], rel=1e-10)


def test_the_drive_read_as_an_applied_force_and_as_a_multiplier() -> None:
    """(3.2.25) and (3.2.35)-(3.2.36): Q̇ = q̇ᵀF̂_D − b̂ᵀ(F̂ + F̂*) is M1 θ̇1 in both.

    With M1 inside F̂_D the second term is zero; with M1 as the multiplier of (3.2.26) the first one is.
    The thesis's R̂ acts on q̇ = R̂ u + b̂ (2.5.23); `R_hat` is its product R R̂ (2.5.26).
    """
    problem = dc.problems.load("triple-pendulum", drive="constraint")
    mechanism, t = problem.mechanism, 0.4
    A, w = mechanism.parameters["A"], mechanism.parameters["w"]
    theta = np.array([A * np.sin(w * t), 1.1, -0.4])
    omega = np.array([A * w * np.cos(w * t), -1.2, 2.0])
    state = mechanism.state(np.diff(theta, prepend=0.0), np.diff(omega, prepend=0.0), t)
    m = dc.matrices(mechanism, state, independent=("joint2", "joint3"))
    torque = HandEquations.of(mechanism.parameters).driving_torque(t, theta[1:], omega[1:])
    absolute = np.tril(np.ones((3, 3)))  # θ̇ from the joints' rates
    R = m.R @ np.linalg.inv(absolute)  # (3.2.11)
    R_thesis, b_thesis = np.eye(3)[:, 1:], np.array([omega[0], 0.0, 0.0])  # (3.2.26)
    A_thesis = m.A @ R  # Â = A R (2.5.22)
    np.testing.assert_allclose(A_thesis @ R_thesis, 0.0, atol=1e-14)  # (2.5.24)
    np.testing.assert_allclose(A_thesis @ b_thesis, -m.b, atol=1e-14)  # (2.5.24)
    rates = absolute[1:, 1:]  # of bars 2 and 3 from those of joints 2 and 3, where bar 1 rests
    np.testing.assert_allclose(m.R_hat, R @ R_thesis @ rates, atol=1e-14)  # (2.5.26)
    np.testing.assert_allclose(m.R_hat @ m.u_hat + m.v_t_hat, R @ omega, atol=1e-13)

    F, F_star, F_D = R.T @ m.F, R.T @ m.F_star, R.T @ m.F_D
    outside = b_thesis @ (F + F_star)
    assert outside == pytest.approx(-torque * omega[0], rel=1e-11)
    assert omega @ F_D - outside == pytest.approx(torque * omega[0], rel=1e-11)
    M1 = np.array([torque, 0.0, 0.0])  # (3.2.15): part of F̂_D and of F̂
    assert b_thesis @ (F + M1 + F_star) == pytest.approx(
        0.0, abs=float(1e-11 * abs(outside))
    )  # (3.2.35)
    assert omega @ (F_D + M1) == pytest.approx(torque * omega[0], rel=1e-13)  # (3.2.36)


def test_the_bead_on_a_hoop_is_acatastatic() -> None:
    """A hoop of radius r about the vertical at Ω: v_t = Ω × x, and K2 − K0 + V is constant."""
    problem = dc.problems.load("bead-on-hoop")
    m = matrices_at(problem.mechanism, 0.0, problem.state.q, problem.state.u, joints=True)
    assert np.abs(m.v_t).max() > 0.1 and m.R.shape[1] == 1
    identities(m)


# --- reactions by other means --------------------------------------------------------------------------


def arm(spread: bool) -> tuple[dc.Mechanism, dc.State]:
    """Two bodies and ball joints, in joint coordinates, or as free bodies held together by constraints."""
    bodies = [
        dc.body("upper", 1.3, [0.2, 0.1, 0.15], [0.05, 0.1, -0.3]),
        dc.body("lower", 0.7, [0.1, 0.12, 0.08], [0.02, -0.05, -0.2]),
    ]
    tree = dc.Mechanism(
        bodies,
        [
            dc.joints.spherical("shoulder", "ground", "upper", position=[0.1, 0.2, 0.3]),
            dc.joints.spherical("elbow", "upper", "lower", position=[0, 0.1, -0.6]),
        ],
        gravity=[0, 0, -9.81],
    )
    turn = np.array([0.8, 0.2, -0.5, 0.3])
    turn2 = np.array([0.5, -0.3, 0.6, 0.2])
    state = tree.state(
        {"shoulder": turn / np.linalg.norm(turn), "elbow": turn2 / np.linalg.norm(turn2)},
        {"shoulder": [0.5, -1.0, 2.0], "elbow": [1.0, 0.7, -0.4]},
    )
    if not spread:
        return tree, state
    apart = dc.Mechanism(
        bodies,
        [dc.free("one", "upper"), dc.free("two", "lower")],
        gravity=[0, 0, -9.81],
        constraints=[
            dc.constraints.loop_spherical("shoulder", "ground", "upper", point1=[0.1, 0.2, 0.3]),
            dc.constraints.loop_spherical("elbow", "upper", "lower", point1=[0, 0.1, -0.6]),
        ],
    )
    m = matrices_at(tree, 0.0, state.q, state.u)
    q, u = [], []
    for k, body in enumerate(bodies):
        x, E = m.x[7 * k : 7 * k + 3], rotation_of(m.x[7 * k + 3 : 7 * k + 7])
        lever = -E @ np.array(body.mass_centre)
        w = m.v[6 * k + 3 : 6 * k + 6]
        q += [*(x + lever), *m.x[7 * k + 3 : 7 * k + 7]]
        u += [*(m.v[6 * k : 6 * k + 3] + np.cross(E @ w, lever)), *w]
    return apart, apart.state(q, u)


def rotation_of(q: Any) -> Any:
    w, v = q[0], np.asarray(q[1:])
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def test_reactions_against_multipliers_of_free_bodies() -> None:
    tree, state = arm(spread=False)
    apart, loose = arm(spread=True)
    m = matrices_at(tree, 0.0, state.q, state.u)
    far = matrices_at(apart, 0.0, loose.q, loose.u)
    np.testing.assert_allclose(far.v, m.v, atol=1e-13)
    np.testing.assert_allclose(far.v_dot, m.v_dot, atol=1e-11)
    # A row of a spherical loop is the place on body 2 less that on body 1, so λ acts on body 2.
    np.testing.assert_allclose(far.lambda_c.reshape(2, 3), m.reaction_force, atol=1e-11)
    np.testing.assert_allclose(m.reaction_moment, 0.0, atol=1e-11)
    np.testing.assert_allclose(far.reaction_force, 0.0, atol=1e-11)  # free joints carry nothing
    assert far.loop_rows == ("shoulder",) * 3 + ("elbow",) * 3


def test_reactions_against_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><compiler autolimits="true"/><option gravity="0.3 0 -9.81"/><worldbody>
        <body name="a" pos="0.1 0 0.2"><joint name="h1" axis="1 0.2 0.3"/>
          <inertial pos="0.05 0.1 -0.3" mass="1.3" diaginertia="0.2 0.1 0.15"/>
          <body name="b" pos="0 0.1 -0.6"><joint name="h2" axis="0 1 0.4"/>
            <inertial pos="0.02 -0.05 -0.2" mass="0.7" diaginertia="0.1 0.12 0.08"/></body>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = [0.4, -0.9], [1.5, -2.0]
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    mechanism, _ = dc.read_mechanism(model)
    state = mechanism.state(data.qpos, data.qvel)
    m = matrices_at(mechanism, 0.0, state.q, state.u)
    np.testing.assert_allclose(m.udot, data.qacc, rtol=1e-10)
    for k, joint in enumerate(mechanism.joints):
        body = int(model.body(joint.child).id)
        moment, force = data.cfrc_int[body, :3], data.cfrc_int[body, 3:]
        about = data.subtree_com[model.body_rootid[body]]
        np.testing.assert_allclose(m.reaction_force[k], force, atol=1e-10)
        at_joint = moment + np.cross(about - m.reaction_place[k], force)
        np.testing.assert_allclose(m.reaction_moment[k], at_joint, atol=1e-10)


@dataclass(frozen=True)
class Wire(Constraint):
    """Rows of what a scene also answers with: coordinates, speeds, velocities of points."""

    name: str

    noun = "wire"

    def positions(self, scene: Scene) -> list[Any]:
        """A coordinate, tied to the height of a point."""
        return [scene.coordinate("hinge0")[0] - scene.point("bar1", (0.3, 0.1, 0.0)).place[1]]

    def motions(self, scene: Scene) -> list[Any]:
        """Speeds, tied to a velocity and to time."""
        velocity = scene.point("bar2", (0.1, 0.0, 0.0)).velocity
        factor, drift = (scene.number(as_law(law, "wire")) for law in ("2 + t", "sin(t)"))
        return [scene.speeds("hinge1") * factor - velocity[0] + drift]


def test_rows_of_a_constraint_of_ones_own() -> None:
    """J B and A B are the Jacobians that simulations use, and f_t and b what is left without motion."""
    mechanism = replace(four_bar(), constraints=(Wire("wire"),))
    state = mechanism.state([0.3, -0.7, 1.1], [1.0, -0.4, 0.6], 0.8)
    m = matrices_at(mechanism, state.t, state.q, state.u)
    rows = equations_of_motion(mechanism).terms(state.t, state.q, state.u)
    near(np.vstack([m.J, m.A]) @ m.B, rows.G)
    near(np.concatenate([m.f_t, m.b]), rows.psi - rows.G @ state.u)
    near(rows.G @ m.udot, -rows.gamma)


# --- choices and bad input -------------------------------------------------------------------------------


def four_bar_state() -> tuple[dc.Mechanism, dc.State]:
    mechanism = four_bar()
    return mechanism, dc.assemble(mechanism, mechanism.state(parallelogram(1.0), [1, -1, 1])).state


@pytest.mark.parametrize("crank", ["hinge0", "hinge1", "hinge2"])
def test_independent_speeds_are_those_asked_for(crank: str) -> None:
    mechanism, state = four_bar_state()
    m = matrices_at(mechanism, 0.0, state.q, state.u, independent=[crank], joints=True)
    assert m.speeds == m.speeds_hat == (crank,)
    identities(m)


def test_bad_input() -> None:
    mechanism, state = four_bar_state()
    with pytest.raises(InputError, match="hinge0.*follows"):
        matrices_at(mechanism, 0.0, state.q, state.u, independent=["hinge1", "hinge0"])
    with pytest.raises(InputError, match="'hinge'"):
        matrices_at(mechanism, 0.0, state.q, state.u, independent=["hinge"])
    with pytest.raises(InputError, match="'motor'"):
        dc.matrices(mechanism, state, inputs={"motor": 1.0})


def test_motions_without_inertia_are_named_at_every_attitude() -> None:
    """Two slender rods: by rounding alone the mass matrix would have an inverse, and u̇ 10¹⁵ rad/s²."""
    mechanism = dc.Mechanism(
        bodies=[dc.bodies.rod("a", 1.0, 1.0), dc.bodies.rod("b", 2.0, 1.0)],
        joints=[
            dc.joints.spherical("s", "ground", "a"),
            dc.joints.universal("hook", "a", "b", position=(1, 0, 0)),
        ],
    )
    rng = np.random.default_rng(0)
    for turned in rng.normal(size=(4, 4)):
        state = mechanism.state({"s": turned / np.linalg.norm(turned), "hook": rng.normal(size=2)})
        with pytest.raises(InputError, match="'s.wx'") as raised:
            dc.matrices(mechanism, state)
        assert raised.value.code == "E-MODEL"


def test_motors_without_a_law() -> None:
    mechanism = replace(pendulum(), forces=[dc.forces.joint_torque("motor", "hinge")])
    state = mechanism.state({"hinge": 0.3})
    idle = matrices_at(mechanism, 0.0, state.q, state.u)
    pulled = matrices_at(mechanism, 0.0, state.q, state.u, inputs=np.array([1.5]))
    # m l² q̈ = −m g l sin q + τ
    np.testing.assert_allclose(pulled.udot - idle.udot, 1.5 / (2.0 * 0.5**2), rtol=1e-12)
    with pytest.raises(InputError, match="motor"):
        dc.matrices(mechanism, state, inputs={"motor": [1.0, 2.0]})


def test_quaternions_along_a_run_keep_their_sign() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("box", 1.0, [0.1, 0.2, 0.3])], [dc.joints.spherical("j", "ground", "box")]
    )
    samples = []
    for angle in np.linspace(0, 2 * np.pi, 30):
        turn = [np.cos(angle / 2), np.sin(angle / 2), 0, 0]
        state = mechanism.state({"j": turn})
        samples.append(matrices_at(mechanism, 0.0, state.q, state.u))
    x = stacked(samples).x
    assert x.shape == (30, 7)
    assert np.abs(np.diff(x[:, 3:], axis=0)).max() < 0.2
