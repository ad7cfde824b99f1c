"""Verdicts on logs of loops that users write: right ones are not accused, mistakes are named with their size.

The oracle is a cart-pole with hand-written equations and integrators; its wall and its rotor are planted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array
from tests.support.slow import crossed, repeated
from tests.systems.cart_pole import SCHEMES, CartPole, generalized_alpha, log

pytestmark = pytest.mark.case_study(
    "test_integration_error_is_told_without_accelerations",
    "test_algorithmic_accelerations_accuse_nobody",
)

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()
WRONG = CartPole(gravity=9.81 * 1.02)


def codes(audit: dc.Audit) -> set[str]:
    return {f.code for f in audit.findings}


def of_equations(audit: dc.Audit) -> list[str]:
    """Kinds of findings that accuse the model."""
    return [f.kind for f in audit.findings if f.weight == "cause"]


# --- right logs -----------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["float32", "decimals", "noise", "stale", "non-uniform"])
def test_imperfect_right_logs_accuse_nobody(form: str) -> None:
    run = log(RIGHT, "semi-implicit-euler", accelerations=False)
    rng = np.random.default_rng(1)
    force = run.forces["actuator motor"]
    if form == "float32":
        run = replace(run, q=run.q.astype(np.float32), u=run.u.astype(np.float32))
    elif form == "decimals":
        run = replace(run, q=np.round(run.q, 4), u=np.round(run.u, 4))
    elif form == "noise":
        run = replace(run, q=run.q + 1e-4 * rng.standard_normal(run.q.shape),
                      u=run.u + 1e-3 * rng.standard_normal(run.u.shape))  # fmt: skip
    elif form == "stale":
        run = replace(run, forces={"actuator motor": np.vstack([force[:1], force[:-1]])})
    else:
        some = np.sort(rng.choice(len(run), int(0.6 * len(run)), replace=False))
        run = run.take(some)
    audit = dc.audit(MECHANISM, run)
    assert audit.verdict.kind != "equation-error", audit.verdict.explain()
    assert not of_equations(audit)


@pytest.mark.parametrize("scheme", ["explicit-euler", "heun"])
def test_a_motor_that_is_off_before_a_gap_may_be_logged_late_after_it(scheme: str) -> None:
    off, on = (
        log(system, scheme, accelerations=False).every(2) for system in (CartPole(drive=0.0), RIGHT)
    )
    force = on.forces["actuator motor"]
    later = np.vstack([force[1:], force[-1:]])
    run = replace(
        on,
        t=np.concatenate([off.t, on.t + 10.0]),
        q=np.concatenate([off.q, on.q]),
        u=np.concatenate([off.u, on.u]),
        forces={"actuator motor": np.vstack([np.zeros_like(force), later])},
    )
    audit = dc.audit(MECHANISM, run)
    assert audit.verdict.kind != "equation-error", audit.verdict.explain()


@pytest.mark.parametrize(
    "case",
    repeated(
        [(w, s) for w in ("backward", "forward", "central", "late", "filtered") for s in SCHEMES],
        # Every kind once, every scheme with differences.
        *[(w, "trapezoidal") for w in ("forward", "central", "late", "filtered")],
        *[("backward", s) for s in SCHEMES],
    ),
)
def test_accelerations_that_are_none_accuse_nobody(case: tuple[str, str]) -> None:
    which, scheme = case
    run = log(RIGHT, scheme)
    assert run.udot is not None
    D = np.diff(run.u, axis=0) / np.diff(run.t)[:, None]
    smooth = np.apply_along_axis(lambda x: np.convolve(x, np.ones(25) / 25, "same"), 0, run.udot)
    udot = {
        "backward": np.vstack([D[:1], D]),
        "forward": np.vstack([D, D[-1:]]),
        "central": np.gradient(run.u, run.t, axis=0),
        "late": np.vstack([run.udot[:1], run.udot[:-1]]),
        "filtered": smooth,
    }[which]
    found = dc.audit(MECHANISM, replace(run, udot=udot))
    assert found.verdict.kind in ("consistent", "integration-error"), found.verdict.explain()
    assert not of_equations(found)


def test_algorithmic_accelerations_accuse_nobody() -> None:
    assert dc.audit(MECHANISM, generalized_alpha(RIGHT)).verdict.kind == "consistent"


# --- mistakes --------------------------------------------------------------------------------------


ONE_OF_A_KIND = ("explicit-euler", "trapezoidal", "rk4")
"""Explicit of first order, implicit, of high order; others with mistakes: test_inference."""


@pytest.mark.parametrize(
    ("scheme", "every"),
    [
        *crossed(ONE_OF_A_KIND, (1, 3)),
        *(
            pytest.param(scheme, every, marks=pytest.mark.slow)
            for scheme in SCHEMES
            for every in (1, 3)
            if scheme not in ONE_OF_A_KIND
        ),
    ],
)
def test_wrong_gravity_is_named_beside_any_integrator(scheme: str, every: int) -> None:
    audit = dc.audit(MECHANISM, log(WRONG, scheme, accelerations=False).every(every))
    assert audit.verdict.kind == "equation-error", audit.verdict.explain()
    assert audit.causes[0].kind.removesuffix("-vector") == "gravity"
    if audit.causes[0].kind == "gravity":
        assert audit.causes[0].size == pytest.approx(1.02, abs=1e-3)
    if every == 1 and scheme in ("semi-implicit-euler", "rk4", "trapezoidal"):
        assert of_equations(audit) == ["gravity"]


def test_small_but_real() -> None:
    """Gravity 0.15 % larger: within the tolerance, far beyond what Runge–Kutta's method leaves."""
    run = log(CartPole(gravity=9.81 * 1.0015), "rk4", step=0.002, duration=1.5, accelerations=False)
    found = dc.audit(MECHANISM, run)
    assert found.verdict.kind == "consistent", found.verdict.explain()
    assert "F-SMALL-BUT-REAL" in codes(found)
    assert found.verdict.confidence != "high"
    assert found.exit_code == 0
    assert replace(found, strict=True).exit_code == 1


def test_integration_error_is_told_without_accelerations() -> None:
    found = dc.audit(MECHANISM, log(RIGHT, "explicit-euler", step=0.02, accelerations=False))
    assert (found.verdict.kind, found.verdict.confidence) == ("integration-error", "high")
    assert found.integrator is not None and found.integrator.names == ("explicit-euler",)
    share = found.attribution.integrator if found.attribution is not None else None
    assert share is not None and share.energy == pytest.approx(
        float(found.energy_error[-1]), rel=1e-2
    )


@pytest.mark.slow  # by a precise method: test_small_but_real
@pytest.mark.parametrize("scheme", ("explicit-euler", "semi-implicit-euler", "rk4"))
def test_a_mistake_far_below_what_integrators_leave_is_named(scheme: str) -> None:
    """Gravity 1e-4 too large, at the step that leaves Euler's methods some per cent."""
    slightly = CartPole(gravity=9.81 * 1.0001)
    found = dc.audit(MECHANISM, log(slightly, scheme, accelerations=False, held=False))
    (cause,) = (f for f in found.findings if f.kind == "gravity")
    assert cause.weight == "note" and cause.factor == pytest.approx(1.0001, abs=3e-6)
    assert "F-SMALL-BUT-REAL" in codes(found) and found.verdict.kind != "equation-error"


# --- habits of logs --------------------------------------------------------------------------------


def test_scattered_time_stamps_are_put_back() -> None:
    run = log(RIGHT, "semi-implicit-euler", accelerations=False)
    h = run.t[1] - run.t[0]
    scatter = 0.02 * h * np.random.default_rng(4).uniform(-1, 1, len(run))
    found = dc.audit(MECHANISM, replace(run, t=run.t + scatter))
    assert "F-CLOCK-JITTER" in codes(found)
    assert found.verdict.kind != "equation-error"
    assert np.std(np.diff(found.run.t)) < 1e-9 * h


@pytest.mark.parametrize("habit", repeated(("mean", "late", "commanded"), "mean"))
def test_forces_of_other_rows_accuse_nobody(habit: str) -> None:
    run = log(RIGHT, "rk4", held=False)
    force = run.forces["actuator motor"]
    other = {
        "mean": np.vstack([0.5 * (force[1:] + force[:-1]), force[-1:]]),
        "late": np.vstack([force[:1], force[:1], force[:-2]]),
        "commanded": np.repeat(force[::4], 4, axis=0)[: len(force)],
    }[habit]
    found = dc.audit(MECHANISM, replace(run, forces={"actuator motor": other}))
    assert found.verdict.kind != "equation-error", found.verdict.explain()
    assert not of_equations(found)


@pytest.mark.slow  # the zero of an encoder: tests/diagnosis/test_foreign_logs.py
def test_a_small_cause_is_told_once() -> None:
    """The samples and the steps both show the zero of an encoder."""
    run = log(RIGHT, "rk4", held=False)
    found = dc.audit(MECHANISM, replace(run, q=run.q + [0.0, 3e-4]))
    assert [f.kind for f in found.findings].count("zero-offset") == 1
    assert found.verdict.kind == "consistent"


def test_rows_between_the_steps_accuse_nobody() -> None:
    """Interpolated linearly at another clock's times: q̇ = u is kept as poorly as the equations are."""
    run = log(RIGHT, "semi-implicit-euler", accelerations=False)
    t = np.arange(run.t[0], run.t[-1], 1.6 * (run.t[1] - run.t[0]))

    def at(x: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(t, run.t, column) for column in x.T])

    forces = {name: at(f) for name, f in run.forces.items()}
    found = dc.audit(MECHANISM, replace(run, t=t, q=at(run.q), u=at(run.u), forces=forces))
    assert found.verdict.kind != "equation-error", found.verdict.explain()


# --- rows that are missing, walls, rotors ----------------------------------------------------------------


@dataclass(frozen=True)
class Walled(CartPole):
    """A spring of 2000 N·m/rad pushes the pole back above an angle."""

    wall: float = 0.0

    def acceleration(self, t: float, q: Array, u: Array, force: float | None = None) -> Array:
        free = super().acceleration(t, q, u, force)
        if q[1] <= self.wall:
            return free
        m, l, theta = self.pole, self.length, float(q[1])
        a, b, c = self.cart + m, -m * l * np.sin(theta), self.inertia + m * l**2
        push = 2000.0 * (theta - self.wall) * np.array([-b, a]) / (a * c - b * b)
        return np.asarray(free - push)


def lacking(run: dc.Trajectory, share: float = 0.6) -> dc.Trajectory:
    """Some of the rows, at random."""
    count = len(run)
    kept = np.sort(np.random.default_rng(1).choice(count, int(share * count), replace=False))
    return replace(
        run, t=run.t[kept], q=run.q[kept], u=run.u[kept], udot=None,
        forces={name: force[kept] for name, force in run.forces.items()},
    )  # fmt: skip


@pytest.mark.slow  # rows that are missing: tests/diagnosis/test_audit_logs.py
def test_a_wrong_mass_is_named_in_a_log_that_lacks_rows() -> None:
    found = dc.audit(MECHANISM, lacking(log(replace(RIGHT, pole=0.63, length=0.4), "heun")))
    assert found.verdict.kind == "equation-error"
    assert any(f.element == "pole" for f in found.verdict.findings if f.weight == "cause")


@pytest.mark.slow  # stops: tests/diagnosis/test_foreign_logs.py
def test_a_wall_that_is_left_in_the_first_rows_is_seen() -> None:
    """The log begins in the last five steps of a touch, and ends before the next one."""
    run = log(Walled(wall=0.3), "semi-implicit-euler", step=0.002)
    touching = np.flatnonzero(run.q[:, 1] > 0.3)
    last = int(touching[np.argmax(np.diff(touching) > 1)])
    after = int(touching[touching > last][0])
    part = run.between(float(run.t[last - 4]), float(run.t[after - 2]))
    found = dc.audit(MECHANISM, part).verdict
    assert found.kind == "equation-error"
    causes = {f.code for f in found.findings if f.weight == "cause"}
    assert causes & {"F-MISSING-CONTACT", "F-MISSING-STOP"}


def damped(system: CartPole, share: float, rotor: float, step: float = 0.002) -> dc.Trajectory:
    """Euler's method with a share of the dampers' forces from the end of a step, and a rotor at the hinge."""
    q, u, rows = np.array([0.1, -0.4]), np.array([0.3, 1.0]), []
    D = np.diag([system.slide, system.hinge])
    for k in range(1000):
        push = float(system.force(k * step))
        rows.append((k * step, q, u, push))
        m, l, theta = system.pole, system.length, float(q[1])
        b, c = -m * l * np.sin(theta), system.inertia + m * l**2 + rotor
        M = np.array([[system.cart + m, b], [b, c]])
        bent = m * l * np.cos(theta)
        f = np.array([push + bent * u[1] ** 2, bent * system.gravity])
        now = M @ u + step * (f - (1.0 - share) * D @ u)
        u = np.linalg.solve(M + share * step * D, now)
        q = q + step * u
    t, q_, u_, f_ = (np.array([row[k] for row in rows]) for k in range(4))
    names = ("slide", "hinge")
    return dc.Trajectory(
        t=t, q=q_, u=u_, coordinates=names, speeds=names,
        forces={"actuator motor": np.column_stack([f_, 0 * f_])},
        provenance=dc.Provenance("own loop"),
    )  # fmt: skip


def test_a_rotor_beside_implicit_damping_is_told_to_rounding() -> None:
    """A third of what the damping adds to the inertia: no integrator takes more than all of that."""
    rotor = 0.3 * 0.002 * RIGHT.hinge
    found = dc.audit(MECHANISM, damped(RIGHT, 1.0, rotor)).verdict
    told = {(f.code, f.element): f.factor for f in found.findings}
    assert told["F-MISSING-ROTOR-INERTIA", "hinge"] == pytest.approx(rotor, rel=1e-6)


@pytest.mark.parametrize("share", repeated([0.25, 0.5, 0.75], 0.5))
def test_damping_taken_in_part_from_the_end_is_no_rotor(share: float) -> None:
    system = replace(RIGHT, slide=0.0, hinge=0.2)
    found = dc.audit(system.mechanism(), damped(system, share, 0.0)).verdict
    assert found.kind in ("consistent", "integration-error")
    assert "F-MISSING-ROTOR-INERTIA" not in {f.code for f in found.findings}


def test_a_kick_in_one_step_is_told_from_the_error_of_the_steps() -> None:
    """One interval is too few for a cause; but its energy is not the integrator's."""
    problem = dc.problems.load("double-pendulum")
    mechanism = problem.mechanism
    first = dc.simulate(mechanism, problem.state, 1.0, 1e-3, "ode4")
    kicked = dc.State(float(first.t[-1]), first.q[-1], first.u[-1] + np.array([0.5, 0.0]))
    second = dc.simulate(mechanism, kicked, 1.0, 1e-3, "ode4")
    t, q, u = (
        np.concatenate([a, b[1:]])
        for a, b in zip((first.t, first.q, first.u), (second.t, second.q, second.u))
    )
    run = dc.Trajectory(t=t, q=q, u=u, coordinates=first.coordinates, speeds=first.speeds)
    found = dc.audit(mechanism, run)
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    assert any("t = 1" in sentence for sentence in found.verdict.evidence)
