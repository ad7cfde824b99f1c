"""Logs as other people hand them over: held controls, slow sensors, encoders with another zero, filters.

The oracle is a cart-pole with hand-written equations and integrators.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_ivp

import deltac as dc
from deltac.diagnosis.inference.inference import infer
from deltac.kernels.rows import at_rows
from tests.support.slow import repeated
from tests.systems.cart_pole import CartPole, generalized_alpha, log

pytestmark = pytest.mark.case_study("test_forces_that_change_smoothly_are_not_held")

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()
WRONG = CartPole(gravity=9.81 * 1.02)


def codes(found: dc.Audit) -> set[str]:
    return {f.code for f in found.findings}


def test_functions_at_rows_are_those_at_each() -> None:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    function = ca.Function("f", [x, y], [ca.densify(x @ y.T), ca.densify(ca.sum1(ca.sin(x)))])
    rng = np.random.default_rng(0)
    X, Y = rng.standard_normal((7, 3)), rng.standard_normal((7, 2))
    outer, sums = at_rows(function, [X, Y])
    products = X[:, :, None] * Y[:, None, :]
    np.testing.assert_array_equal(outer.reshape(7, 2, 3).transpose(0, 2, 1), products)
    np.testing.assert_allclose(sums[:, 0], np.sin(X).sum(axis=1), rtol=0, atol=1e-14)


def held(system: CartPole, rows: int) -> dc.Trajectory:
    """Heun's method with controls that jump at random and are held over some rows."""
    rng = np.random.default_rng(7)
    h, count = 0.002, 600
    forces = np.repeat(rng.uniform(-8.0, 8.0, count // rows + 1), rows)[:count]
    q, u, made = np.array([0.1, 0.4]), np.array([0.2, -0.5]), []
    for k, force in enumerate(forces):
        made.append([k * h, *q, *u, force])
        a = system.acceleration(0.0, q, u, force)
        v, x = u + h * a, q + h * u
        q, u = q + h / 2 * (u + v), u + h / 2 * (a + system.acceleration(0.0, x, v, force))
    rows_ = np.array(made)
    names = ("slide", "hinge")
    return dc.Trajectory(
        t=rows_[:, 0], q=rows_[:, 1:3], u=rows_[:, 3:5], coordinates=names, speeds=names,
        forces={"actuator motor": rows_[:, 5:] * [1.0, 0.0]}, provenance=dc.Provenance("own loop"),
    )  # fmt: skip


@pytest.mark.parametrize("every", repeated((1, 2), 2))
def test_forces_that_were_held_are_known_to_be(every: int) -> None:
    """Jumps of 8 N between the rows."""
    run = held(RIGHT, 10).every(every)
    inference = infer(MECHANISM, run)
    assert inference is not None and set(inference.forces) == {"start"}
    assert not inference.posterior.best.chosen


@pytest.mark.slow
@pytest.mark.parametrize("every", (1, 2))
def test_a_mistake_beside_forces_that_were_held(every: int) -> None:
    wrong = dc.audit(MECHANISM, held(CartPole(gravity=9.81 * 1.1), 10).every(every))
    assert wrong.verdict.kind == "equation-error"
    assert wrong.causes[0].kind.removesuffix("-vector") == "gravity"


def test_forces_that_change_smoothly_are_not_held() -> None:
    inference = infer(MECHANISM, log(RIGHT, "rk4", accelerations=False))
    assert inference is not None and not {"start", "end", "mean"} & set(inference.forces)


def test_controls_two_rows_late_accuse_nobody() -> None:
    run = held(RIGHT, 10)
    force = run.forces["actuator motor"]
    late = replace(run, forces={"actuator motor": np.vstack([force[:1], force[:1], force[:-2]])})
    assert dc.audit(MECHANISM, late).verdict.kind != "equation-error"


@pytest.mark.parametrize("system", repeated((RIGHT, WRONG), WRONG))
def test_speeds_of_a_slower_sensor(system: CartPole) -> None:
    """Thinned to the rows in which they are new, the log is judged as one of that pace."""
    run = log(system, "rk4", accelerations=False)
    slow = replace(run, u=np.repeat(run.u[::4], 4, axis=0)[: len(run)])
    found = dc.audit(MECHANISM, slow)
    assert "F-HELD-COLUMNS" in codes(found)
    assert abs(len(found.run) - len(run) / 4) <= 1
    assert (found.verdict.kind == "equation-error") == (system is WRONG)


def test_a_mistake_together_with_a_two_step_method() -> None:
    """Generalized-α and 2 % of gravity."""
    found = dc.audit(MECHANISM, replace(generalized_alpha(WRONG), udot=None))
    first = found.findings[0]
    assert first.code == "F-GRAVITY" and first.factor == pytest.approx(1.02, abs=1e-4)


def test_an_encoder_with_another_zero_is_a_doubt_of_the_log() -> None:
    run = log(RIGHT, "rk4", accelerations=False)
    found = dc.audit(MECHANISM, replace(run, q=run.q + [0.0, 0.02]))
    assert found.verdict.kind == "unresolved"
    zero = next(f for f in found.findings if f.code == "F-ZERO-OFFSET")
    assert zero.weight == "doubt" and zero.element == "hinge"
    assert zero.factor == pytest.approx(
        0.02, rel=2e-3
    )  # the third order is δ²/6 of it, about the error


@dataclass(frozen=True)
class Held(CartPole):
    """A cart-pole with drag at its hinge, and a stop above an angle, that the model does not have."""

    drag: float = 0.0
    stop: float = 0.0
    above: float = 0.5

    def more(self, angle: float, rate: float) -> float:
        return -self.drag * rate * abs(rate) - self.stop * max(angle - self.above, 0.0)


@pytest.mark.parametrize(
    ("system", "code"),
    [(Held(drag=0.02), "F-MISSING-DRAG"), (Held(stop=3.0, above=1.5), "F-MISSING-STOP")],
)
def test_drag_and_stops_are_named(system: Held, code: str) -> None:
    found = dc.audit(MECHANISM, log(system, "heun", accelerations=False).every(2))
    assert found.verdict.kind == "equation-error"
    cause = found.findings[0]
    assert cause.code == code and cause.element == "hinge"
    if code == "F-MISSING-DRAG":
        assert cause.factor == pytest.approx(system.drag, rel=5e-3)


@pytest.mark.parametrize("rows", [1, 10])
def test_held_forces_do_their_work_as_held(rows: int) -> None:
    """Digits hide the scheme, but not that forces act from their row on. Their work is Σ F Δx, to the digits.

    By splines through the jumps of such forces it is off by some thousandths of the energy exchanged.
    """
    run = held(RIGHT, rows)
    run = replace(run, q=np.round(run.q, 4), u=np.round(run.u, 4))
    found = dc.audit(MECHANISM, run)
    assert found.verdict.kind != "integration-error"
    exact = np.sum(run.forces["actuator motor"][:-1, 0] * np.diff(run.q[:, 0]))
    told = found.ledger.work["actuator motor"][-1]
    assert abs(told - exact) < 1e-3 * found.energy_exchanged


@pytest.mark.slow  # of two per cent: tests/diagnosis/test_audit_logs.py
def test_a_cause_of_two_thousandths_is_seen_behind_four_decimals() -> None:
    run = log(CartPole(gravity=9.81 * 1.002), "heun", accelerations=False)
    run = replace(run, q=np.round(run.q, 4), u=np.round(run.u, 4))
    found = dc.audit(MECHANISM, run)
    assert found.verdict.kind == "equation-error"
    cause = next(f for f in found.findings if f.code == "F-GRAVITY")
    assert cause.factor == pytest.approx(1.002, abs=3e-4)


def test_rows_at_random_tell_no_gear() -> None:
    """Euler's method is late by a share of its own step, however many rows are lost."""
    run = log(RIGHT, "explicit-euler", step=0.002, accelerations=False)
    rows = np.sort(np.random.default_rng(1).choice(len(run), int(0.6 * len(run)), replace=False))
    lost = replace(
        run, t=run.t[rows], q=run.q[rows], u=run.u[rows],
        forces={n: f[rows] for n, f in run.forces.items()},
    )  # fmt: skip
    assert not any(f.weight == "doubt" for f in dc.audit(MECHANISM, lost).findings)


def test_coordinates_of_the_row_before_accuse_nobody() -> None:
    """Nothing but the integrator has energy in them, and no more than in the log without the slip."""
    run = log(RIGHT, "implicit-euler", accelerations=False)
    right = dc.audit(MECHANISM, run)
    found = dc.audit(MECHANISM, replace(run, q=np.vstack([run.q[:1], run.q[:-1]])))
    assert found.verdict.kind in ("unresolved", right.verdict.kind) and not found.causes
    assert found.attribution is not None and right.attribution is not None
    told = found.attribution.integrator.energy
    true = right.attribution.integrator.energy
    assert told == pytest.approx(true, rel=0.05)


def solved(
    system: CartPole, method: str, tolerance: float = 1e-3
) -> tuple[dc.Trajectory, np.ndarray]:
    """SciPy's `solve_ivp`, by default at its own tolerance, rows of its dense output; their ΔC by hand, J."""
    t = np.arange(0.0, 4.0, 0.01)
    rate = lambda t, x: np.concatenate([x[2:], system.acceleration(t, x[:2], x[2:])])  # noqa: E731
    x = solve_ivp(rate, (0.0, 4.0), [0.0, -1.2, 0.4, 0.0], method, t, rtol=tolerance).y
    (_, angle, v, w), m, l = x, system.pole, system.length
    a, b, c = system.cart + m, -m * l * np.sin(angle), system.inertia + m * l**2
    energy = 0.5 * a * v**2 + b * v * w + 0.5 * c * w**2 - m * system.gravity * l * np.sin(angle)
    power = system.force(t) * v - system.slide * v**2 - system.hinge * w**2
    work = cumulative_simpson(power, x=t, initial=0.0)
    force = np.column_stack([system.force(t), np.zeros_like(t)])
    run = dc.Trajectory(
        t=t, q=x[:2].T, u=x[2:].T, coordinates=("slide", "hinge"), speeds=("slide", "hinge"),
        forces={"actuator motor": force}, provenance=dc.Provenance("solve_ivp"),
    )  # fmt: skip
    return run, energy - energy[0] - work


@pytest.mark.parametrize("method", repeated(["RK45", "RK23", "BDF"], "RK45", "BDF"))
def test_errors_of_steps_that_a_solver_chose_are_the_integrators(method: str) -> None:
    """Rows of its dense output depart from the flow as no force makes them depart."""
    run, true = solved(RIGHT, method)
    found = dc.audit(MECHANISM, run)
    allowed = found.tolerance * found.reference_energy
    beyond = np.abs(true).max() > allowed
    assert found.verdict.kind == ("integration-error" if beyond else "consistent")
    assert found.attribution is not None and not found.causes
    told = found.attribution.integrator
    assert told.energy == pytest.approx(true[-1], rel=0.02, abs=2.0 * told.error)


@pytest.mark.slow  # beside fixed steps: test_a_mistake_together_with_a_two_step_method
@pytest.mark.parametrize("method", ("RK45", "BDF"))
def test_a_mistake_beside_errors_of_such_steps(method: str) -> None:
    found = dc.audit(MECHANISM, solved(WRONG, method, 1e-5)[0])
    assert found.verdict.kind == "equation-error"
    assert found.causes[0].kind == "gravity"


def test_integrators_that_close_alike_are_listed() -> None:
    """Seven digits do not tell methods of fourth and fifth order apart at this step."""
    run = log(RIGHT, "rk4", accelerations=False)
    single = replace(run, q=np.float32(run.q), u=np.float32(run.u))  # type: ignore[arg-type]
    integrator = dc.audit(MECHANISM, single).integrator
    assert integrator is not None and integrator.order >= 3
    assert {"rk4", "dormand-prince"} <= {*integrator.names} or "higher-order" in integrator.names


ARM = """<robot name="arm">
<link name="base"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="upper"><inertial><origin xyz="0.1 0 -0.4"/><mass value="2"/>
  <inertia ixx="0.05" iyy="0.07" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0.1 -0.3"/><mass value="1.5"/>
  <inertia ixx="0.04" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0 -0.8"/><axis xyz="1 0 0"/></joint></robot>"""


@pytest.mark.parametrize(
    ("damping", "size", "name"),
    [
        (None, 0.04, "the linear and angular damping of Bullet"),  # unless it is switched off
        pytest.param((0.1, 0.0), 0.1, "the linear damping of Bullet", marks=pytest.mark.slow),
        pytest.param((0.0, 0.2), 0.2, "the angular damping of Bullet", marks=pytest.mark.slow),
    ],
)
def test_damping_of_bullet_is_named(
    damping: tuple[float, float] | None, size: float, name: str, tmp_path: Path
) -> None:
    bullet = pytest.importorskip("pybullet")
    (tmp_path / "arm.urdf").write_text(ARM)
    client = bullet.connect(bullet.DIRECT)
    of = {"physicsClientId": client}
    try:
        bullet.setGravity(0, 0, -9.81, **of)
        bullet.setTimeStep(0.002, **of)
        arm = bullet.loadURDF(
            str(tmp_path / "arm.urdf"), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, **of
        )  # fmt: skip
        for k, angle in ((0, 0.8), (1, -0.7)):
            bullet.changeDynamics(arm, k, jointDamping=0, maxJointVelocity=1e6, **of)
            if damping is not None:
                own = {"linearDamping": damping[0], "angularDamping": damping[1]}
                bullet.changeDynamics(arm, k, **own, **of)
            bullet.setJointMotorControl2(arm, k, bullet.VELOCITY_CONTROL, force=0, **of)
            bullet.resetJointState(arm, k, angle, 0.0, **of)
        rows = []
        for _ in range(800):
            rows.append(np.array([bullet.getJointState(arm, k, **of)[:2] for k in range(2)]))
            bullet.stepSimulation(**of)
    finally:
        bullet.disconnect(client)
    q, u = np.moveaxis(np.array(rows), 2, 0)
    names = ("shoulder", "elbow")
    t = np.asarray(0.002 * np.arange(800.0), dtype=float)
    log_ = dc.Trajectory(t=t, q=q, u=u, coordinates=names, speeds=names)
    audit = dc.audit(tmp_path / "arm.urdf", log_)
    (cause,) = audit.causes
    assert (cause.kind, cause.element) == ("velocity-decay", "all bodies")
    assert cause.size == pytest.approx(size, rel=1e-6) and name in str(cause)
