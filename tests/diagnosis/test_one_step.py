"""The one-step test: integrators are identified, right logs bear it, wrong models do not.

The oracle is a cart-pole with hand-written equations and integrators.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.measurements.kinematics import coordinates_against_speeds
from deltac.diagnosis.residuals.one_step import CLEAR, OneStep, one_step
from tests.support.slow import repeated
from tests.systems.cart_pole import SCHEMES, CartPole, generalized_alpha, log

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()
WRONG = CartPole(gravity=9.81 * 1.02)


def made(run: dc.Trajectory) -> OneStep:
    lates = [c.late for c in coordinates_against_speeds(MECHANISM, run).values()]
    found = one_step(MECHANISM, run, float(np.median(lates)))
    assert found is not None
    return found


@pytest.mark.parametrize("scheme", SCHEMES)
def test_integrators_are_identified(scheme: str) -> None:
    """From one log at one step, to rounding (implicit ones to what fixed-point iterations leave)."""
    step = made(log(RIGHT, scheme, accelerations=False))
    assert step.scheme is not None and step.scheme.name == scheme
    assert step.closes and step.scheme.defect < 1e-11
    assert not step.significant.any()
    # The residual, which nobody asks for then, says the same.
    assert not step.local.unclosed.any() and not step.standing_out.any()


def test_a_row_that_does_not_follow_is_seen_among_those_that_do() -> None:
    run = log(RIGHT, "heun", accelerations=False)
    u = run.u.copy()
    u[301, 0] += 1e-3
    step = made(replace(run, u=u))
    assert step.scheme is not None and step.scheme.name == "heun"
    assert step.local.unclosed.any() and step.closes  # a spike, by the residual


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("every", [1, 3])
def test_wrong_models_are_significant(scheme: str, every: int) -> None:
    step = made(log(WRONG, scheme, accelerations=False).every(every))
    assert not step.closes
    assert step.significant.any()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("every", [2, 5])
def test_right_logs_of_unknown_substeps_are_borne(scheme: str, every: int) -> None:
    step = made(log(RIGHT, scheme, accelerations=False, held=scheme == "rk4").every(every))
    assert float(step.residual.ratio.max()) < 0.5 * CLEAR


def test_columns_that_constraints_take_off_are_not_fitted() -> None:
    """Of them rounding alone is left, which would be taken for all that there is."""
    problem = dc.problems.load("spherical-pendulum")
    run = dc.simulate(problem, duration=0.6, step=2e-3, solver="semi-implicit-euler")
    bare = dc.Trajectory(t=run.t, q=run.q, u=run.u, coordinates=run.coordinates, speeds=run.speeds)
    step = one_step(problem.mechanism, bare, 0.5)
    assert step is not None and float(step.residual.relative.max()) < 1e-9


@pytest.mark.parametrize("form", ["float32", "decimals", "noise", "stale", "non-uniform"])
def test_imperfect_right_logs_are_borne(form: str) -> None:
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
        kept = np.sort(rng.choice(len(run), int(0.6 * len(run)), replace=False))
        run = replace(run, t=run.t[kept], q=run.q[kept], u=run.u[kept],
                      forces={"actuator motor": force[kept]})  # fmt: skip
    assert float(made(run).residual.ratio.max()) < 0.5 * CLEAR


@pytest.mark.parametrize("scheme", ["explicit-euler", "heun"])
def test_a_motor_that_is_off_before_a_gap_may_be_logged_late_after_it(scheme: str) -> None:
    """What an integrator may leave is asked of all stretches of a log, not of the first one alone."""
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
    assert float(made(run).residual.ratio.max()) < 0.5 * CLEAR


@pytest.mark.parametrize("case", [("clutch", "semi-implicit-euler"), ("knife-edge", "ode4")])
def test_scheme_columns_that_are_all_but_one_leave_an_error_bar(case: tuple[str, str]) -> None:
    """Those of so simple motions are the same to rounding: their normal equations are singular."""
    name, solver = case
    problem = dc.problems.load(name)
    run = dc.simulate(problem, duration=0.7, step=2e-3, solver=solver)
    bare = dc.Trajectory(
        t=run.t, q=run.q, u=run.u, coordinates=run.coordinates, speeds=run.speeds, forces=run.forces
    )
    g = tuple(1.02 * problem.mechanism.number(x) for x in problem.mechanism.gravity)
    for mechanism in (problem.mechanism, replace(problem.mechanism, gravity=g)):
        step = one_step(mechanism, bare)
        assert step is not None and np.isfinite(step.residual.bar).all()


@pytest.mark.parametrize("rho", [0.3, 0.85])
def test_generalized_alpha_of_any_spectral_radius_is_identified(rho: float) -> None:
    """Also where ρ∞ is none of the `SPECTRAL_RADII`: by a fit of its two-step relation."""
    step = made(replace(generalized_alpha(RIGHT, rho), udot=None))
    assert step.scheme is not None and step.scheme.name == "generalized-alpha" and step.closes


def test_late_forces_are_told() -> None:
    run = log(RIGHT, "rk4", held=True, accelerations=False)
    force = run.forces["actuator motor"]
    late = made(replace(run, forces={"actuator motor": np.vstack([force[:1], force[:-1]])}))
    assert late.scheme is not None and late.scheme.late_forces
    right = made(run)
    assert right.scheme is not None and not right.scheme.late_forces


def test_the_error_bar_falls_with_the_step() -> None:
    """Of an unknown scheme the next order is left, so that the bar falls with h² at least."""
    coarse, fine = (
        made(log(RIGHT, "heun", step=h, accelerations=False).every(2)) for h in (0.008, 0.004)
    )
    assert np.all(fine.residual.bar < 0.35 * coarse.residual.bar)


def test_nothing_free_or_too_few_rows() -> None:
    assert one_step(MECHANISM, log(RIGHT, duration=0.02)) is None


# --- audits of such logs --------------------------------------------------------------------------------


def codes(found: dc.Audit) -> set[str]:
    return {f.code for f in found.findings}


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
    assert codes(found) & {"F-UDOT-DIFFERENCED", "F-UDOT-NOT-OF-THIS-ROW"}


def test_algorithmic_accelerations_accuse_nobody() -> None:
    assert dc.audit(MECHANISM, generalized_alpha(RIGHT)).verdict.kind == "consistent"


@pytest.mark.parametrize("scheme", ["semi-implicit-euler", "rk4", "trapezoidal"])
def test_a_wrong_model_is_seen_without_accelerations(scheme: str) -> None:
    found = dc.audit(MECHANISM, log(WRONG, scheme, accelerations=False))
    assert found.verdict.kind == "equation-error", found.verdict.explain()
    causes = [f for f in found.findings if f.weight == "cause"]
    assert [f.kind for f in causes] == ["gravity"]
    assert causes[0].factor == pytest.approx(1.02, abs=1e-3)


def test_small_but_real() -> None:
    """Gravity 0.15 % larger: within the tolerance, far beyond what Runge–Kutta's method leaves."""
    run = log(CartPole(gravity=9.81 * 1.0015), "rk4", step=0.002, accelerations=False)
    found = dc.audit(MECHANISM, run)
    assert found.verdict.kind == "consistent", found.verdict.explain()
    assert "F-SMALL-BUT-REAL" in codes(found)
    assert found.verdict.confidence != "high"
    assert found.exit_code == 0
    assert dc.audit(MECHANISM, run, strict=True).exit_code == 1


def test_integration_error_is_told_without_accelerations() -> None:
    found = dc.audit(MECHANISM, log(RIGHT, "explicit-euler", step=0.02, accelerations=False))
    assert (found.verdict.kind, found.verdict.confidence) == ("integration-error", "high")
    assert found.step is not None and found.step.closes


# --- a mistake and the integrator together; habits of logs ----------------------------------------------


@pytest.mark.parametrize("scheme", ["explicit-euler", "semi-implicit-euler", "rk4"])
def test_a_mistake_far_below_what_integrators_leave_is_named(scheme: str) -> None:
    """Gravity 1e-4 too large, at the step that leaves Euler's methods some per cent."""
    slightly = CartPole(gravity=9.81 * 1.0001)
    found = dc.audit(MECHANISM, log(slightly, scheme, accelerations=False, held=False))
    (cause,) = (f for f in found.findings if f.kind == "gravity")
    assert cause.weight == "note" and cause.factor == pytest.approx(1.0001, abs=3e-6)
    assert "F-SMALL-BUT-REAL" in codes(found) and found.verdict.kind != "equation-error"
    assert found.step is not None and found.step.known_but_for_causes


def test_an_unknown_integrator_is_no_mistake() -> None:
    """No pair of the dictionary closes the steps of a log that lacks every second one."""
    found = dc.audit(MECHANISM, log(RIGHT, "semi-implicit-euler", accelerations=False).every(2))
    assert found.step is not None and not found.step.known_but_for_causes


def test_scattered_time_stamps_are_put_back() -> None:
    run = log(RIGHT, "semi-implicit-euler", accelerations=False)
    h = run.t[1] - run.t[0]
    scatter = 0.02 * h * np.random.default_rng(4).uniform(-1, 1, len(run))
    found = dc.audit(MECHANISM, replace(run, t=run.t + scatter))
    assert "F-CLOCK-JITTER" in codes(found)
    assert found.verdict.kind != "equation-error"
    assert np.std(np.diff(found.run.t)) < 1e-9 * h


@pytest.mark.parametrize("habit", ["mean", "late", "commanded"])
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
    told = {"mean": "F-FORCES-NOT-OF-THIS-ROW", "late": "F-FORCE-DELAYED"}
    assert habit == "commanded" or told[habit] in codes(found)


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
