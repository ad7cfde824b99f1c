"""The inference from prediction errors: each part against another route, the whole against reruns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter, group_delay, lfilter
from scipy.stats import norm

import deltac as dc
from deltac.arrays import Array
from deltac.diagnosis.audit.verdict import Judgement
from deltac.diagnosis.causes.causes import Candidate, candidates
from deltac.diagnosis.causes.columns import ColumnKernels, LogEquations, column_kernels
from deltac.diagnosis.inference import inference
from deltac.diagnosis.inference.fields import FIELDS, elementary_differentials
from deltac.diagnosis.inference.flow import composed, predict, transitions, transported
from deltac.diagnosis.inference.forces import LoggedForce
from deltac.diagnosis.inference.hypotheses import (
    Block,
    _ordered,
    autocorrelation_time,
    fitted,
    nothing,
)
from deltac.diagnosis.inference.inference import infer, inferred, likeliest
from deltac.diagnosis.inference.integrators import INTEGRATORS, numbers_of
from deltac.diagnosis.inference.linearisation import RELINEARISATIONS, start
from deltac.diagnosis.inference.model import Intervals, LogModel, Rows
from deltac.diagnosis.inference.observations import observations
from deltac.diagnosis.inference.regression import moved_by
from deltac.diagnosis.inference.whitening import Innovations
from deltac.diagnosis.measurements.cleaning import cleaned
from tests.support.slow import crossed, repeated

G, L1, L2 = 9.81, 0.6, 0.4
VALUES = {"m1": 1.0, "m2": 0.7, "c1": 0.02, "c2": 0.01, "g": G}

MECHANISM = dc.Mechanism(
    [dc.point_mass("a", 1.0), dc.point_mass("b", 0.7)],
    [
        dc.revolute("j1", "ground", "a", child_position=(0, L1, 0), damping=0.02),
        dc.revolute("j2", "a", "b", child_position=(0, L2, 0), damping=0.01),
    ],
    gravity=(0, -G, 0),
)


def accelerations(x: Array, p: dict[str, float]) -> Array:
    """Of absolute angles (a, b) and their rates, from the textbook."""
    a, b, w, v = x
    m1, m2, c1, c2, g = (p[n] for n in VALUES)
    s, c = np.sin(a - b), np.cos(a - b)
    M = np.array([[(m1 + m2) * L1**2, m2 * L1 * L2 * c], [m2 * L1 * L2 * c, m2 * L2**2]])
    f = [
        -m2 * L1 * L2 * s * v * v - (m1 + m2) * g * L1 * np.sin(a) - c1 * w + c2 * (v - w),
        m2 * L1 * L2 * s * w * w - m2 * g * L2 * np.sin(b) - c2 * (v - w),
    ]
    return np.linalg.solve(M, np.array(f))


def explicit_euler(x: Array, h: float, p: dict[str, float]) -> Array:
    return np.asarray(x + h * np.r_[x[2:], accelerations(x, p)])


def semi_implicit_euler(x: Array, h: float, p: dict[str, float]) -> Array:
    u = x[2:] + h * accelerations(x, p)
    return np.asarray(np.r_[x[:2] + h * u, u])


def rk4(x: Array, h: float, p: dict[str, float]) -> Array:
    def rate(x: Array) -> Array:
        return np.asarray(np.r_[x[2:], accelerations(x, p)])

    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3))


Step = Callable[[Array, float, dict[str, float]], Array]


def log(
    step: Step, h: float, noise: float = 0.0, duration: float = 2.0, **wrong: float
) -> dc.Trajectory:
    rows = [np.array([1.2, 0.8, 0.0, 1.0])]
    for _ in range(round(duration / h)):
        rows.append(step(rows[-1], h, VALUES | wrong))
    y = np.array(rows)
    y = y + noise * y.std(axis=0) * np.random.default_rng(0).standard_normal(y.shape)
    return dc.Trajectory(
        t=np.arange(len(y), dtype=float) * h,
        q=np.c_[y[:, 0], y[:, 1] - y[:, 0]],
        u=np.c_[y[:, 2], y[:, 3] - y[:, 2]],
        coordinates=("j1", "j2"),
        speeds=("j1", "j2"),
        provenance=dc.Provenance(simulator="hand", step=h),
    )


def rows_of(run: dc.Trajectory, some: slice) -> Rows:
    nothing = np.zeros((len(run.t[some]), 0))
    return Rows(run.t[some], run.q[some], run.u[some], nothing)


def absolute(q: Array, u: Array) -> Array:
    """Absolute angles and their rates of coordinates and speeds of the mechanism."""
    return np.array([q[0], q[0] + q[1], u[0], u[0] + u[1]])


def exact(q: Array, u: Array, h: float, p: dict[str, float]) -> Array:
    """Coordinates and speeds after a time h, by an adaptive method on the textbook's equations."""
    solution = solve_ivp(
        lambda _, x: np.r_[x[2:], accelerations(x, p)], (0.0, h), absolute(q, u), "DOP853",
        rtol=1e-13, atol=1e-14,
    )  # fmt: skip
    a, b, w, v = solution.y[:, -1]
    return np.array([a, b - a, w, v - w])


def test_the_flow_is_that_of_an_adaptive_solver() -> None:
    run = log(semi_implicit_euler, 5e-3, duration=0.5)
    model = LogModel(MECHANISM, run)
    intervals = Intervals(rows_of(run, slice(0, -1)), rows_of(run, slice(1, None)))
    none = np.zeros((len(intervals), 4))
    flow = predict(model, intervals, LoggedForce.of(intervals, [(0, len(intervals))])(()), none)
    end = np.c_[flow.end.q, flow.end.u]
    for k in (0, 40, 80):
        expected = exact(run.q[k], run.u[k], 5e-3, VALUES)
        assert end[k] == pytest.approx(expected, abs=1e-12)  # rounding of some ten steps


def test_the_variational_equation_is_that_of_reruns() -> None:
    """Φ by starts that are moved; B of a damper by a flow with another one; both by differences."""
    run, h = log(rk4, 5e-3, duration=0.2), 5e-3
    model = LogModel(MECHANISM, run)
    intervals = Intervals(rows_of(run, slice(0, -1)), rows_of(run, slice(1, None)))
    none = np.zeros((len(intervals), 4))
    flow = predict(model, intervals, LoggedForce.of(intervals, [(0, len(intervals))])(()), none, 8)
    J, damper = [], []
    for at in flow.nodes:
        J.append(model.jacobian(at))
        force = np.c_[
            np.zeros(len(at.t)), -at.u[:, 1]
        ]  # of a damper of one N·m·s at the second joint
        response = model.response(at.t, at.q, force)
        damper.append(np.concatenate([np.zeros_like(response), response], axis=1)[:, :, None])
    steps = transitions(intervals.h, J)
    Phi, B = composed(steps), transported(intervals.h, steps, damper)
    assert transported(intervals.h, steps, [x[:, 2:] for x in damper]) == pytest.approx(B)
    for k in (0, 20, 39):
        q, u, d = run.q[k], run.u[k], 1e-5
        for i, e in enumerate(np.eye(4)):
            ends = [exact(q + s * d * e[:2], u + s * d * e[2:], h, VALUES) for s in (1.0, -1.0)]
            column = (ends[0] - ends[1]) / (2.0 * d)
            assert Phi[k, :, i] == pytest.approx(column, rel=2e-5, abs=1e-6)
        ends = [exact(q, u, h, VALUES | {"c2": VALUES["c2"] + s * d}) for s in (1.0, -1.0)]
        column = (ends[0] - ends[1]) / (2.0 * d)
        assert B[k, :, 0] == pytest.approx(column, rel=1e-5, abs=1e-9)


def test_elementary_differentials_are_the_derivatives_of_the_accelerations() -> None:
    run = log(rk4, 5e-3, duration=0.2)
    model = LogModel(MECHANISM, run)
    at = rows_of(run, slice(3, 6))
    fields = elementary_differentials(model, at, np.ones((3, 1)))
    place = {f.name: k for k, f in enumerate(FIELDS)}

    def a_of(q: Array, u: Array) -> Array:
        first, second = accelerations(absolute(q, u), VALUES)
        return np.array([first, second - first])

    for k in range(3):
        q, u = at.q[k], at.u[k]
        a, d = a_of(q, u), 1e-5
        aq_u = (a_of(q + d * u, u) - a_of(q - d * u, u)) / (2 * d)
        au_a = (a_of(q, u + d * a) - a_of(q, u - d * a)) / (2 * d)
        assert fields[k, :2, place["q: a"]] == pytest.approx(a, rel=1e-12)
        assert fields[k, 2:, place["u: a_q u"]] == pytest.approx(
            aq_u, rel=1e-6
        )  # both by differences
        assert fields[k, 2:, place["u: a_u a"]] == pytest.approx(au_a, rel=1e-6)


def test_whitening_is_by_the_cholesky_factor_of_the_whole_covariance() -> None:
    """Two pieces of unequal noise and a force that is not known: their covariance is written out."""
    rng = np.random.default_rng(1)
    N, m = 12, 2
    Phi = np.eye(m) + 0.3 * rng.standard_normal((N, m, m))
    start, end = rng.uniform(0.2, 0.6, (2, N, m))
    start[1:5], start[6:] = end[:4], end[5:-1]  # an interval starts with the row that ends another
    root = 0.3 * rng.standard_normal((N, m, m))
    Q = root @ root.transpose(0, 2, 1)
    columns = rng.standard_normal((N, m, 3))
    innovations = Innovations([(0, 5), (5, N)], Phi, (start, end), Q)
    white, log_determinant = innovations(columns)
    S = np.zeros((N * m, N * m))
    for k in range(N):
        own, before = slice(k * m, (k + 1) * m), slice((k - 1) * m, k * m)
        S[own, own] = np.diag(end[k] ** 2) + Phi[k] @ np.diag(start[k] ** 2) @ Phi[k].T + Q[k]
        if k not in (0, 5):
            S[own, before] = -Phi[k] @ np.diag(end[k - 1] ** 2)
            S[before, own] = S[own, before].T
    L = np.linalg.cholesky(S)
    dense = np.linalg.solve(L, columns.reshape(N * m, 3))
    np.testing.assert_allclose(white.reshape(N * m, 3), dense, rtol=1e-7, atol=1e-7)
    assert log_determinant == pytest.approx(0.5 * np.linalg.slogdet(S)[1], rel=1e-7)


@pytest.mark.parametrize("speeds", [True, False])
def test_what_the_rows_are_off_by_is_its_mean_given_the_prediction_errors(speeds: bool) -> None:
    """E e wᵀ S⁻¹ w from all covariances written out; without speeds theirs are 1e4 times all else."""
    rng = np.random.default_rng(2)
    N, n, h, pieces = 9, 2, 0.1, [(0, 5), (5, 9)]
    A = rng.standard_normal((N, 2 * n, 2 * n))
    A[:, :n] = np.eye(2 * n)[n:]
    Phi = np.eye(2 * n) + h * A + 0.5 * h**2 * A @ A
    rows = rng.uniform(0.01, 0.02, (N + len(pieces), 2 * n))
    if not speeds:
        rows[:, n:] = 1e4
    start, end = (np.array([rows[k + (k >= 5) + d] for k in range(N)]) for d in (0, 1))
    root = 1e-2 * rng.standard_normal((N, 2 * n, 2 * n))
    Q = root @ root.transpose(0, 2, 1)
    w = 0.05 * rng.standard_normal((N, 2 * n))
    of_rows = np.zeros((N, 2 * n, *rows.shape))  # w = (this) e + v
    for k in range(N):
        of_rows[k, :, k + (k >= 5)] = -Phi[k]
        of_rows[k, :, k + (k >= 5) + 1] = np.eye(2 * n)
    E = of_rows.reshape(N * 2 * n, -1)
    S = (E * rows.ravel() ** 2) @ E.T
    for k in range(N):
        some = slice(k * 2 * n, (k + 1) * 2 * n)
        S[some, some] += Q[k]
    expected = (rows.ravel() ** 2 * (E.T @ np.linalg.solve(S, w.ravel()))).reshape(rows.shape)
    found = Innovations(pieces, Phi, (start, end), Q, speeds).errors(w[:, :, None])
    # The condition of the covariance is 1e12 without speeds.
    for k in range(N):
        for x, at in zip(found, (k + (k >= 5), k + (k >= 5) + 1)):
            assert x[k, :, 0] == pytest.approx(expected[at], abs=1e-7 if speeds else 1e-3)


def test_without_speeds_nothing_is_assumed_of_them() -> None:
    """Whitened prediction errors do not change by what a speed is off by, nor by how far it might be."""
    rng = np.random.default_rng(3)
    N, n, h = 8, 2, 0.1
    A = rng.standard_normal((N, 2 * n, 2 * n))
    A[:, :n] = np.eye(2 * n)[n:]
    Phi = np.eye(2 * n) + h * A + 0.5 * h**2 * A @ A
    noise = np.full((N, 2 * n), 0.01)
    noise[:, n:] = rng.uniform(0.0, 100.0, (N, n))
    innovations = Innovations([(0, N)], Phi, (noise, noise), np.zeros_like(Phi), False)
    w, e = rng.standard_normal((N, 2 * n)), rng.standard_normal((N + 1, 2 * n))
    e[:, :n] = 0.0
    moved = w + e[1:] - np.einsum("kij,kj->ki", Phi, e[:-1])
    white, _ = innovations(np.stack([w, moved], axis=2))
    assert white.shape == (N, n, 2)
    assert white[:-1, :, 0] == pytest.approx(white[:-1, :, 1], rel=1e-8)


@pytest.mark.long
@pytest.mark.parametrize(
    ("step", "names"),
    [
        # One map of coordinates: the speeds alone are those of other instants.
        (semi_implicit_euler, {"semi-implicit-euler", "semi-implicit-euler-qu", "leapfrog"}),
        pytest.param(explicit_euler, {"explicit-euler"}, marks=pytest.mark.slow),
        pytest.param(rk4, {"rk4"}, marks=pytest.mark.slow),
    ],
)
def test_an_integrator_is_known_by_coordinates_alone(step: Step, names: set[str]) -> None:
    """And a damper of another strength with it, to digits: speeds by differences are off by a per cent."""
    run = log(step, 5e-3)
    table = {"t": run.t} | {f"q.{n}": x for n, x in zip(run.coordinates, run.q.T)}
    audit = dc.audit(MECHANISM, table)
    found, share = audit.integrator, audit.attribution
    assert found is not None and set(found.names) & names
    # The energy is that of the method's own speeds, which the log with them has.
    with_speeds = dc.audit(MECHANISM, run).attribution
    assert share is not None and with_speeds is not None
    gap = abs(share.integrator.energy - with_speeds.integrator.energy)
    assert gap <= 2 * share.integrator.error + 1e-3 * abs(with_speeds.integrator.energy)
    assert set(found.names) <= names | {"implicit-damping-euler"}
    wrong = log(step, 5e-3, c2=1.1 * VALUES["c2"])
    table = {"t": wrong.t} | {f"q.{n}": x for n, x in zip(wrong.coordinates, wrong.q.T)}
    cause, *others = dc.audit(MECHANISM, table).causes
    assert (cause.kind, cause.element, others) == ("damping", "j2", [])
    assert cause.size == pytest.approx(1.1 * VALUES["c2"], rel=1e-6)


@pytest.mark.parametrize(
    ("step", "noise", "numbers", "name"),
    [
        (explicit_euler, 0.0, (-0.5, -0.5, -0.5), "explicit-euler"),
        (explicit_euler, 1e-5, (-0.5, -0.5, -0.5), "explicit-euler"),
        (semi_implicit_euler, 0.0, (0.5, -0.5, -0.5), "semi-implicit-euler"),
        (semi_implicit_euler, 1e-5, (0.5, -0.5, -0.5), "semi-implicit-euler"),
        (rk4, 0.0, (0.0, 0.0, 0.0), "rk4"),
        (rk4, 1e-5, (0.0, 0.0, 0.0), "higher-order"),
    ],
)
def test_an_integrator_is_named_by_its_map_or_its_modified_equation(
    step: Step, noise: float, numbers: tuple[float, ...], name: str
) -> None:
    found = dc.audit(MECHANISM, log(step, 2e-3, noise)).integrator
    assert found is not None
    c = [found.coefficients[n] for n in ("q: a", "u: a_q u", "u: a_u a")]
    # The terms of second order are fitted beside; what is left is h² of the third.
    assert c == pytest.approx(numbers, abs=0.03)
    assert name in found.names


@pytest.mark.long
@pytest.mark.parametrize(
    ("mistake", "noise"),
    crossed(
        [
            ({"c2": 0.012}, "damping", "j2", 0.012),
            ({"m2": 0.707}, "body-inertia", "b", 1.01),
            ({"g": 9.85}, "gravity", "gravity", 9.85 / 9.81),
        ],
        (0.0, 1e-4),
    ),
)
def test_a_mistake_is_named_with_its_size_beside_an_unknown_integrator(
    mistake: tuple[dict[str, float], str, str, float], noise: float
) -> None:
    wrong, kind, element, true = mistake
    cause = dc.audit(MECHANISM, log(semi_implicit_euler, 2e-3, noise, **wrong)).causes[0]
    # Gravity of another size is gravity of another direction, too, as far as a planar motion tells.
    assert (cause.kind.removesuffix("-vector"), cause.element) == (kind, element)
    assert cause.log_odds > np.log(99.0)
    # Products of the mistake with itself are left out, of one percent of it here.
    if cause.kind == kind:
        off = abs(true - (0.01 if kind == "damping" else 1.0))
        assert cause.size == pytest.approx(true, abs=4.0 * cause.size_error + 0.02 * off)


@pytest.mark.long
def test_odds_of_verdicts_are_probabilities() -> None:
    """They add up to one, and the verdict is the most probable, whatever is wrong."""
    kinds = {"consistent", "integration-error", "equation-error", "unresolved"}
    for run in (
        log(rk4, 2e-3), log(explicit_euler, 5e-3), log(rk4, 2e-3, 1e-3), log(rk4, 2e-3, c2=0.02),
    ):  # fmt: skip
        audit = dc.audit(MECHANISM, run)
        assert set(audit.odds) == kinds
        assert sum(audit.odds.values()) == pytest.approx(1.0, abs=1e-12)
        assert min(audit.odds.values()) >= 0.0
        if audit.verdict.kind != "unresolved":
            assert audit.odds[audit.verdict.kind] == max(audit.odds.values()) >= 0.9


@pytest.mark.long
@pytest.mark.parametrize("h", repeated((1e-3, 2e-3), 2e-3))
def test_joules_of_integrator_and_mistake_add_up_and_agree_with_reruns(h: float) -> None:
    parts = dc.audit(MECHANISM, log(semi_implicit_euler, h, c2=0.015)).attribution
    right = dc.audit(MECHANISM, log(semi_implicit_euler, h)).attribution
    assert parts is not None and right is not None
    # The integrator does the same to right equations, but for motions that drift apart.
    assert parts.integrator.energy == pytest.approx(right.integrator.energy, rel=0.2)
    # What a damper that is stronger by half takes: −∫ Δc u² dt along the rows.
    run = log(semi_implicit_euler, h, c2=0.015)
    taken = -np.trapezoid(0.005 * run.u[:, 1] ** 2, run.t)
    assert parts.equations.energy == pytest.approx(taken, rel=0.02)
    ledger = dc.balance(MECHANISM, run, "samples")
    total = parts.integrator.energy + parts.equations.energy + parts.log.energy
    # Works are taken along the flow of each interval here, and along the rows there: h of the motion.
    assert total == pytest.approx(float(ledger.delta_c["wang"][-1]), rel=5e-3)
    assert abs(parts.log.energy) < 0.02 * abs(parts.equations.energy)


def held(noise: float = 0.0) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A damped pendulum under a torque that a controller computes once a step and holds, by RK4 at 1 ms."""
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 1.0)],
        [dc.revolute("j", "ground", "bob", child_position=(0, 0.8, 0), damping=0.1)],
        gravity=(0, -9.81, 0),
    )
    x, h, rows, torques = np.array([0.5, 0.0]), 1e-3, list[Array](), list[float]()
    for k in range(3001):
        torque = 6.0 * np.sin(11.0 * k * h) - 1.5 * x[1]
        rows.append(x)
        torques.append(torque)

        def rate(x: Array, torque: float = torque) -> Array:
            return np.array([x[1], (torque - 0.1 * x[1] - 9.81 * 0.8 * np.sin(x[0])) / 0.64])

        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3))
    y = np.array(rows)
    y = y + noise * np.random.default_rng(0).standard_normal(y.shape)
    run = dc.Trajectory(
        t=np.arange(len(y), dtype=float) * h, q=y[:, :1], u=y[:, 1:], coordinates=("j",), speeds=("j",),
        forces={"actuator motor": np.array(torques)[:, None]},
    )  # fmt: skip
    return mechanism, run


def test_a_torque_that_was_held_is_not_the_integrators_error() -> None:
    mechanism, run = held()
    audit = dc.audit(mechanism, run)
    assert audit.verdict.kind == "consistent"
    inference = audit.inference
    assert inference is not None and inference.forces == ("start",)
    # RK4's own error is h⁴ of the energy: 1e-10 J here.
    assert abs(inference.attribution.integrator.energy) < 1e-9


def test_held_torques_are_recognised_under_noise() -> None:
    mechanism, run = held(noise=1e-4)
    inference = infer(mechanism, run)
    assert inference is not None and inference.forces == ("start",)
    assert abs(inference.attribution.integrator.energy) < 0.01
    assert not inference.posterior.best.chosen


def test_few_rows_have_no_attribution() -> None:
    audit = dc.audit(MECHANISM, log(rk4, 2e-3, duration=0.01))
    assert audit.attribution is None and audit.causes == () and audit.integrator is None


def test_quaternions_differ_by_rotation_vectors() -> None:
    mechanism = dc.Mechanism([dc.body("box", 1.0, (1.0, 2.0, 2.5))], [dc.free("f", "box")])
    run = dc.simulate(mechanism, mechanism.state({}, {"f.wx": 1.0, "f.wy": 0.3}), 0.1, step=1e-2)
    model = LogModel(mechanism, run)
    here, turn = rows_of(run, slice(4, 5)), np.array([[0.0, 0.0, 0.0, 0.01, -0.02, 0.005]])
    there = Rows(here.t, model.moved(here.q, turn, np.ones((1, 1))), here.u, here.F)
    moved = model.difference(here, there)
    # sin of half the angle in place of the angle: a cube of it.
    assert moved[0, :6] == pytest.approx(turn[0], abs=1e-6)
    assert moved[0, 6:] == pytest.approx(np.zeros(6))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_rows_of_noise_accuse_nobody(seed: int) -> None:
    """Columns share their noise with the prediction errors: what fits them so is its bias, and no mistake."""
    rng = np.random.default_rng(seed)
    q, u = rng.standard_normal((2, 400, 1))
    mechanism, _ = held()
    run = dc.Trajectory(
        t=0.01 * np.arange(400, dtype=float), q=q, u=u, coordinates=("j",), speeds=("j",),
    )  # fmt: skip
    audit = dc.audit(mechanism, run)
    assert audit.verdict.kind == "unresolved"
    assert not [f for f in audit.findings if f.weight == "cause"]


# --- causes in the equations, filters, gaps, unknown steps -----------------------------------------------


def kernels_of(run: dc.Trajectory) -> tuple[LogEquations, ColumnKernels]:
    equations = LogEquations(MECHANISM, run)
    return equations, column_kernels(equations)


@pytest.mark.parametrize(
    ("kind", "element", "theta", "wrong"),
    [
        ("body-inertia", "b", 0.6, {"m2": 0.7 * 1.6}),
        ("damping", "j2", 0.05, {"c2": 0.06}),
        ("gravity", "gravity", -0.3, {"g": 0.7 * G}),
    ],
)
def test_a_model_with_a_cause_is_that_of_the_textbook_with_other_numbers(
    kind: str, element: str, theta: float, wrong: dict[str, float]
) -> None:
    """However large the cause is: inertia acts through u̇, in which the equations are solved anew."""
    run = log(rk4, 5e-3, duration=0.5)
    equations, kernels = kernels_of(run)
    (cause,) = (
        c for c in candidates(equations, kernels.columns) if (c.kind, c.element) == (kind, element)
    )
    coefficients = np.zeros(len(kernels.columns))
    np.add.at(coefficients, list(cause.columns), cause.coefficients(np.array([theta])))
    rows = rows_of(run, slice(None))
    found = LogModel(MECHANISM, run).changed((kernels,), coefficients).at(rows)
    for k in (0, 50, 100):
        a, b = accelerations(absolute(run.q[k], run.u[k]), VALUES | wrong)
        assert found[k] == pytest.approx([a, b - a], rel=1e-11)  # rounding of two factorisations


@pytest.mark.long
def test_a_large_mistake_beside_a_coarse_integrator_is_told_without_another() -> None:
    """A mass 40 % too large and semi-implicit Euler: what the first order in either misses is no cause."""
    audit = dc.audit(MECHANISM, log(semi_implicit_euler, 5e-3, m2=0.7 * 1.4))
    assert [(c.kind, c.element) for c in audit.causes] == [("body-inertia", "b")]
    # The second pass of Gauss and Newton starts 1e-4 off, and squares that.
    assert audit.causes[0].size == pytest.approx(1.4, rel=1e-7)
    assert audit.integrator is not None and "semi-implicit-euler" in audit.integrator.names


@pytest.mark.long
def test_joules_are_those_of_steps_and_flows_of_both_equations() -> None:
    """A damper three times as strong, and steps of 5 ms: each against the textbook's exact flows.

    The integrator's are E after a step less E after the exact flow of the equations that were simulated, the
    mistake's those of that flow less the model's; by the middle of both ends of a step.
    """
    wrong, h = VALUES | {"c2": 0.03}, 5e-3
    run = log(semi_implicit_euler, h, duration=2.0, c2=0.03)
    parts = dc.audit(MECHANISM, run).attribution
    assert parts is not None

    def energy(q: Array, u: Array) -> float:
        a, b, w, v = absolute(q, u)
        K = 0.5 * (1.7 * L1**2 * w**2 + 0.7 * L2**2 * v**2) + 0.7 * L1 * L2 * np.cos(a - b) * w * v
        return float(K - 1.7 * G * L1 * np.cos(a) - 0.7 * G * L2 * np.cos(b))

    sums = np.zeros(
        (2, 2)
    )  # of the integrator and the mistake, at the end and the start of the steps
    for k in range(len(run) - 1):
        here, there = (run.q[k], run.u[k]), (run.q[k + 1], run.u[k + 1])
        for side, (x, z, sign) in enumerate(((here, there, 1.0), (there, here, -1.0))):
            ends = [exact(*x, sign * h, p) for p in (wrong, VALUES)]
            own, nominal = (energy(e[:2], e[2:]) for e in ends)
            sums[side] += sign * np.array([energy(*z) - own, own - nominal])
    expected, slack = sums.mean(axis=0), np.abs(sums[0] - sums[1]) / 2.0
    told = np.array([parts.integrator.energy, parts.equations.energy])
    # Gradients in place of differences: the defect of a step squared, 1e-4 of its joules.
    assert np.all(np.abs(told - expected) <= slack + 1e-3 * np.abs(expected))


def test_a_filtered_force_is_that_of_its_kernel() -> None:
    """Of a sine, a triangle of half width w leaves sinc²(ω w/2), a delay δ later; of a ramp, the delay."""
    t, delay, spread, omega = np.linspace(0.0, 2.0, 1001), 0.013, 0.006, 30.0
    F = np.column_stack([np.sin(omega * t), 3.0 * t])
    rows = Rows(t, np.zeros((1001, 1)), np.zeros((1001, 1)), F)
    intervals = Intervals(rows.take(slice(0, -1)), rows.take(slice(1, None)))
    pieces = [(0, 1000)]
    smooth = LoggedForce.of(intervals, pieces)(("smooth", "smooth"))
    found = LoggedForce.filtered(intervals, pieces, smooth, delay, spread).start.F
    gain = np.sinc(omega * spread * np.sqrt(6.0) / 2.0 / np.pi) ** 2
    inner = slice(100, 900)
    # Means by the trapezoid of quarters of an interval: (ω h/4)²/12 of the force.
    allowed = 2.0 * (omega * 2e-3 / 4.0) ** 2 / 12.0
    assert found[inner, 0] == pytest.approx(
        gain * np.sin(omega * (t[:-1][inner] - delay)), abs=allowed
    )
    assert found[inner, 1] == pytest.approx(3.0 * (t[:-1][inner] - delay), abs=1e-9)


@pytest.mark.slow  # with a torque that went through none: tests/diagnosis/test_filters.py
def test_states_that_were_filtered_are_told_by_the_filters_delay() -> None:
    """A Butterworth filter of second order at 60 Hz is late by its group delay."""
    mechanism, run = held()
    h, edge = 1e-3, 60.0
    b, a = butter(2, 2.0 * edge * h)
    x = np.c_[run.q, run.u]
    x = (lfilter(b, a, x - x[0], axis=0) + x[0])[200:]
    forces = {name: f[200:] for name, f in run.forces.items()}
    log = replace(run, t=run.t[200:], q=x[:, :1], u=x[:, 1:], forces=forces)
    audit = dc.audit(mechanism, log)
    assert audit.verdict.kind == "consistent"
    [told] = [f for f in audit.findings if f.kind == "filtered"]
    _, delay = group_delay((b, a), w=[1e-3])
    assert told.factor == pytest.approx(h * delay[0], rel=1e-3)


@pytest.mark.long
def test_the_step_of_a_log_that_lacks_rows_and_does_not_say_its_step() -> None:
    for step, parts in ((explicit_euler, 4), (semi_implicit_euler, 5)):
        run = log(step, 4e-3, duration=2.0).every(parts)
        found = dc.audit(MECHANISM, replace(run, provenance=dc.Provenance("hand"))).integrator
        name = step.__name__.replace("_", "-")
        assert found is not None and name in found.names
        assert found.step == pytest.approx(4e-3, rel=1e-9)


def test_gaps_add_what_their_ends_do() -> None:
    """Of a rate that is linear in time, all of it: times as long on both sides of a gap have its mean."""
    run = log(rk4, 5e-3, duration=1.0)
    run = run.take(np.delete(np.arange(201), np.arange(60, 100)))
    observed = observations(LogModel(MECHANISM, run), run, 1000)
    assert observed is not None and len(observed.pieces) == 2
    t, h = observed.intervals.start.t, observed.intervals.h[:, 0]
    rate = 2.0 + 3.0 * (t + 0.5 * h)
    whole = 2.0 + 1.5 * run.t[-1] ** 2 / run.t[-1]
    assert observed.running(rate * h)[-1] == pytest.approx(whole * run.t[-1], rel=1e-12)


def test_central_differences_are_no_measured_speeds() -> None:
    run = log(rk4, 5e-3, duration=1.0)
    differences = replace(run, u=np.gradient(run.q, run.t, axis=0))
    assert "u" in cleaned(MECHANISM, differences).run.provenance.derived
    assert "u" not in cleaned(MECHANISM, run).run.provenance.derived
    assert dc.audit(MECHANISM, differences).verdict.kind == "consistent"


@pytest.mark.parametrize(("joules", "error"), [(0.0, 0.2), (0.0, 50.0), (1.5, 0.4), (-6.0, 1.0)])
def test_the_probability_of_an_error_is_that_of_its_posterior(joules: float, error: float) -> None:
    """Spike and slab of equal weight, by quadrature of likelihood times prior."""
    ledger = SimpleNamespace(energy_exchanged=300.0, reference_energy=1000.0)
    judged = Judgement(cast(Any, None), cast(Any, ledger), "", None, None, None, (), 1e-3)  # type: ignore[arg-type]
    found = judged._beyond(np.array([joules]), np.array([error]))[0]
    size = max(0.01 * 1000.0, abs(joules))
    J = np.linspace(-40.0, 40.0, 400_001)
    slab = norm.pdf(joules, J, error) * norm.pdf(J, 0.0, size)
    total = np.trapezoid(slab, J) + norm.pdf(joules, 0.0, error)
    beyond = np.trapezoid(np.where(np.abs(J) > 1.0, slab, 0.0), J)
    assert found == pytest.approx(beyond / total, abs=2e-4)  # steps of the quadrature


def servo(h: float) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A pendulum under a stiff PD torque of the instant, by RK4, its torque logged at the rows."""
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 1.0)],
        [dc.revolute("j", "ground", "bob", child_position=(0, 0.8, 0), damping=0.1)],
        gravity=(0, -9.81, 0),
    )

    def torque(x: Array) -> float:
        return float(-900.0 * (x[0] - 0.6) - 80.0 * x[1])  # the fast mode decays with 112/s

    def rate(x: Array) -> Array:
        return np.array([x[1], (torque(x) - 0.1 * x[1] - 9.81 * 0.8 * np.sin(x[0])) / 0.64])

    rows = [np.array([0.5, 0.0])]
    for _ in range(round(0.3 / h)):
        x = rows[-1]
        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        rows.append(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3)))
    y = np.array(rows)
    return mechanism, dc.Trajectory(
        t=np.arange(len(y), dtype=float) * h, q=y[:, :1], u=y[:, 1:], coordinates=("j",), speeds=("j",),
        forces={"actuator motor": np.array([[torque(x)] for x in rows])},
        provenance=dc.Provenance("own loop", solver="rk4", step=h, order=4),
    )  # fmt: skip


@pytest.mark.parametrize("h", [4e-3, 2e-3])
def test_a_torque_of_the_instant_accuses_nobody(h: float) -> None:
    mechanism, run = servo(h)
    audit = dc.audit(mechanism, run)
    assert audit.inference is not None and not audit.inference.posterior.best.chosen
    assert audit.verdict.kind == "consistent"


def test_what_a_sample_tells_of_a_log_that_closes_is_what_all_rows_tell() -> None:
    run = log(rk4, 2e-3)
    closed = infer(MECHANISM, run)
    equations, model = LogEquations(MECHANISM, run), LogModel(MECHANISM, run)
    observed = observations(model, run, 4000)
    assert closed is not None and closed.closes and observed is not None
    point = start(model, run, observed).with_candidates(equations, column_kernels(equations))
    result = inferred(likeliest(point))
    assert closed.posterior.best.chosen == result.posterior.best.chosen == ()
    energies = [x.attribution.integrator.energy for x in (closed, result)]
    assert energies[0] == pytest.approx(energies[1], abs=3.0 * result.attribution.integrator.error)
    assert closed.unseen.keys() == result.unseen.keys()
    largest = max(result.unseen, key=lambda name: result.unseen[name])
    # Long stretches tell more of a number than as many rows in short ones: a sample errs to the safe side.
    assert 0.5 < closed.unseen[largest] / result.unseen[largest] < 100.0


def test_no_number_of_an_integrator_is_less_known_than_by_its_prior() -> None:
    """Columns that fit far below the digits of the rows, two of them alike, beside the noise of these digits.

    The covariance is Bayes's, (DᵀD/v + P⁻²)⁻¹ with the variance v of the digits, times τ of what is left.
    """
    rng = np.random.default_rng(7)
    D = rng.standard_normal((200, 1, 3))
    D[:, :, 2] = D[:, :, 1] + 1e-7 * D[:, :, 2]
    prior, none = np.full(3, 0.5), np.zeros(0, dtype=np.intp)
    r = D @ np.array([1e-5, 0.0, 0.0]) + 1e-6 * rng.standard_normal((200, 1))
    block = Block(r, D, np.arange(3), prior, none, rounding=1.0)
    told = block.numbers(nothing(0))[1]
    variance = block.misfit(np.zeros(0)) / block.count
    assert variance > 1e9 * block.variance
    noise = variance * autocorrelation_time(block.residual(np.zeros(0)))
    exact = np.linalg.inv(D[:, 0].T @ D[:, 0] / noise + np.diag(prior**-2.0))
    assert told == pytest.approx(exact, rel=1e-6, abs=1e-9)
    assert np.all(np.sqrt(np.diag(told)) <= prior)


def test_what_a_wrong_hypothesis_leaves_slowly_counts_all_rows_of_another() -> None:
    """One leaves white noise beside 26 free numbers, the other a motion of 1e8 times its variance."""
    rng, N, numbers = np.random.default_rng(4), 800, 26
    white = 1e-4 * rng.standard_normal((N, 2))
    slow = np.sin(0.02 * np.arange(N))[:, None] * np.ones(2) + 0.01 * rng.standard_normal((N, 2))
    none, some = np.zeros(0, dtype=np.intp), np.arange(numbers)
    right = Block(white, rng.standard_normal((N, 2, numbers)), some, np.full(numbers, 1e3), none)
    wrong = Block(slow, np.zeros((N, 2, 0)), none, np.zeros(0), none)
    taus = [autocorrelation_time(block.residual(np.zeros(0))) for block in (right, wrong)]
    assert taus[0] < 2.0 < 20.0 < taus[1]
    comparisons = [
        SimpleNamespace(blocks=[block], posterior=SimpleNamespace(best=nothing(0)), tau=tau)
        for block, tau in zip((right, wrong), taus, strict=True)
    ]
    odds = inference._log_odds(cast(Any, comparisons))
    # Each of 1600 numbers tells ½ ln 1e8; the price of 26 free ones, some 15 each, is a small part of that.
    assert odds[0] > odds[1] + 0.5 * (0.5 * 1600 * np.log(1e8))


def test_the_order_in_which_causes_are_fitted_is_by_least_squares() -> None:
    rng = np.random.default_rng(5)
    D, r = rng.standard_normal((50, 2, 6)), rng.standard_normal((50, 2))
    block = Block(r, D, np.arange(2), np.full(2, 1e6), np.arange(2, 6))
    causes = [
        Candidate("damping", f"{k}", (k,), np.eye(1), ("",), np.zeros(1), ("",)) for k in range(4)
    ]
    best = fitted((block,), causes[:1])
    assert best is not None
    X, y = D.reshape(-1, 6), r.ravel()

    def left(columns: list[int]) -> float:
        return float(np.linalg.lstsq(X[:, columns], y, rcond=None)[1][0])

    for bound, c in _ordered((block,), best, causes):
        gain = 0.5 * 98 * np.log(left([0, 1, 2]) / left([0, 1, 2, 2 + c.columns[0]]))
        assert bound == pytest.approx(gain - 0.5 * np.log(98) - np.log(4), abs=1e-6)


@pytest.mark.parametrize("scale", [1.0, 1.01])
def test_a_coarse_step_is_no_wrong_clock(scale: float) -> None:
    """Of a method of order two ∫u dt of the rows is not q, by O(h²); a wrong clock has another map."""
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 0.5)],
        [dc.revolute("j", "ground", "bob", child_position=(0, -0.6, 0))],
        gravity=(0, -9.81, 0),
    )
    run = dc.simulate(mechanism, {"j": 0.1}, 0.3, 0.02, "ode2")
    bare = replace(run, t=scale * run.t, works={}, integrals={}, udot=None, mechanism=None)
    doubts = {f.kind for f in dc.audit(mechanism, bare).findings if f.weight == "doubt"}
    assert doubts == (set() if scale == 1.0 else {"clock-scale"})


@pytest.mark.parametrize("step", [explicit_euler, semi_implicit_euler])
def test_causes_move_the_rows_as_the_integrator_does(step: Step) -> None:
    """The column of a damper beside two steps of the textbook's equations: alike to second order in h.

    The flow's own column is off by half of the displacement of the coordinates.
    """
    errors = []
    for h in (4e-3, 2e-3):
        run = log(step, h, duration=0.4)
        model = LogModel(MECHANISM, run)
        evaluator = LogEquations(MECHANISM, run)
        rows = observations(model, run, 1000)
        assert rows is not None
        point = start(model, run, rows, 1.0)
        point = point.with_candidates(evaluator, column_kernels(evaluator))
        at = likeliest(point).at
        damper = next(c for c in point.candidates if (c.kind, c.element) == ("damping", "j2"))
        own = numbers_of(next(m for m in INTEGRATORS if m.name == step.__name__.replace("_", "-")))
        column = moved_by(at.point, at.of_causes, at.point.columns, own, rows.intervals.h)
        column = column[:, :, list(damper.columns)]
        column = (column @ damper.linear)[:, :, 0]
        gaps, sizes = [], []
        for k in range(0, len(column), len(column) // 10):
            x, d = absolute(run.q[k], run.u[k]), 1e-4
            a, b, w, v = (
                step(x, h, VALUES | {"c2": VALUES["c2"] + d})
                - step(x, h, VALUES | {"c2": VALUES["c2"] - d})
            ) / (2.0 * d)
            expected = np.array([a, b - a, w, v - w]) / [h**2, h**2, h, h]
            gaps.append(np.abs(column[k] / [h**2, h**2, h, h] - expected))
            sizes.append(np.abs(expected))
        errors.append(np.max(gaps) / np.max(sizes))
    # What is left of each component is of the next order in h.
    assert errors[0] < 0.02
    assert errors[1] < 0.6 * errors[0]


def driven(amplitude: float = 0.3) -> dc.Mechanism:
    """A pendulum on a slide that is driven to and fro."""
    return dc.Mechanism(
        [dc.body("slide", mass=1.0, inertia=(1.0, 1.0, 1.0)), dc.point_mass("bob", 0.8)],
        [
            dc.prismatic("drive", "ground", "slide", "x", motion=f"{amplitude!r}*sin(4*t)"),
            dc.revolute("swing", "slide", "bob", "z", child_position=(0, 0.6, 0), damping=0.02),
        ],
        gravity=(0, -G, 0),
    )


@pytest.mark.long
def test_laws_of_time_go_through_the_filter_of_a_log() -> None:
    """A causal Butterworth filter is late by its group delay; an amplitude of 1.05 is no delay."""
    model = driven()
    run = dc.simulate(model, model.state({"swing": 0.7}), 3.0, 2e-3, "ode4")
    b, a = butter(2, 40.0 * 2.0 * 2e-3)
    q, u = (lfilter(b, a, x - x[0], axis=0) + x[0] for x in (run.q, run.u))
    rows = slice(100, None)
    late = dc.Trajectory(
        t=run.t[rows], q=q[rows], u=u[rows], coordinates=run.coordinates, speeds=run.speeds
    )
    audit = dc.audit(model, late)
    assert audit.verdict.kind == "consistent", audit.verdict.explain()
    [told] = [f for f in audit.findings if f.kind == "filtered"]
    _, delay = group_delay((b, a), w=[1e-3])
    assert told.factor == pytest.approx(2e-3 * delay[0], rel=1e-3)
    wrong = dc.audit(driven(0.3 / 1.05), late)
    assert wrong.verdict.kind == "equation-error"


def test_causes_settle_beside_a_method_that_is_fitted_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each turn leaves a quarter of what the same point has, beside a method that was made for it."""
    turns = list[object]()
    best = SimpleNamespace(
        chosen=(SimpleNamespace(kind="damping"),), coefficients=1.0, settled=lambda other: False
    )

    def linearised(point: Any, found: Any, methods: Any = ()) -> Any:
        turns.append(point)
        assert len(turns) < 20
        return SimpleNamespace(
            point=SimpleNamespace(coefficients=4.0),
            posterior=SimpleNamespace(best=best),
            blocks=[SimpleNamespace(misfit=float, least=1e-12)],
            methods=(replace(INTEGRATORS[0]),),
        )

    monkeypatch.setattr(inference, "_linearised", linearised)
    monkeypatch.setattr(inference, "_late_forces", lambda point, best: [])
    assert inference._settled(cast(Any, None), cast(Any, SimpleNamespace(best=best))) is not None
    assert len(turns) == RELINEARISATIONS
