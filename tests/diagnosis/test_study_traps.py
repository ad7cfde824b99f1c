"""Right equations that look wrong, and wrong ones that look right: what a study says of logs.

Nothing is known of these runs but states, sometimes accelerations and forces: the hard case.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Mechanism, Provenance, Study, Trajectory
from tests.support.slow import repeated

STEPS = (0.01, 0.005, 0.0025)
TRIPLE = (4e-3, 2e-3, 1e-3)


def kinds(study: Study) -> set[str]:
    return {f.kind for f in study.findings}


def log(run: Trajectory, udot: bool = False, step: bool = True) -> Trajectory:
    """The bare log that another program would have written."""
    source = Provenance("another program", step=run.provenance.step if step else None)
    return replace(
        run, udot=run.udot if udot else None, works={}, integrals={}, forces={}, provenance=source
    )


def samples(step: float, q: Any, u: Any, udot: Any = None, **forces: Any) -> Trajectory:
    q, u = (np.asarray(x, dtype=float)[:, None] for x in (q, u))
    return Trajectory(
        t=step * np.arange(len(q), dtype=float),
        q=q,
        u=u,
        udot=None if udot is None else np.asarray(udot, dtype=float)[:, None],
        forces={n: np.asarray(f, dtype=float)[:, None] for n, f in forces.items()},
        coordinates=("x",),
        speeds=("x",),
        provenance=Provenance("another program", step=step),
    )


@cache
def damped(solver: str = "ode4") -> tuple[Mechanism, tuple[Trajectory, ...]]:
    problem = dc.problems.load("triple-pendulum", damping=0.02)
    runs = tuple(
        dc.simulate(problem.mechanism, problem.state, 2.0, h, solver, record=()) for h in TRIPLE
    )
    return problem.mechanism, runs


def of_logs(mechanism: Mechanism, logs: list[Trajectory], **options: Any) -> Study:
    return dc.study(mechanism, runs=logs, **options)


# --- right equations ------------------------------------------------------------------------------


@pytest.mark.parametrize("udot", [True, False])
@pytest.mark.parametrize("solver", ["ode1", "ode4"])
def test_logs_of_right_runs(solver: str, udot: bool) -> None:
    mechanism, runs = damped(solver)
    found = of_logs(mechanism, [log(run, udot) for run in runs])
    expected = "integration-error" if solver == "ode1" else "consistent"
    assert found.verdict.kind == expected, found.verdict.explain()
    assert not [f for f in found.findings if f.weight != "note"]


@pytest.mark.parametrize("spacing", [0.02, 0.08, 0.2])
def test_decimated_logs(spacing: float) -> None:
    """Sampled alike at every step, the error of the quadrature does not fall with the step."""
    mechanism, runs = damped()
    logs = [log(run).every(round(spacing / run.provenance.step)) for run in runs]  # type: ignore[operator]
    found = of_logs(mechanism, logs)
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    assert "log at a higher rate" in found.verdict.meaning


def test_logs_in_single_precision() -> None:
    mechanism, runs = damped()

    def single(x: Any) -> Any:
        return np.asarray(x, dtype=np.float32).astype(float)

    for udot in (True, False):
        logs = [
            replace(r, q=single(r.q), u=single(r.u), udot=single(r.udot) if udot else None)
            for r in (log(run, udot) for run in runs)
        ]
        found = of_logs(mechanism, logs)
        assert found.verdict.kind in ("consistent", "unresolved"), found.verdict.explain()


@pytest.mark.parametrize("how", ["central", "forward"])
def test_accelerations_that_are_difference_quotients_accuse_nobody(how: str) -> None:
    mechanism, runs = damped()

    def differences(run: Trajectory) -> Trajectory:
        slopes = np.diff(run.u, axis=0) / np.diff(run.t)[:, None]
        ahead = np.vstack([slopes, slopes[-1:]])
        return replace(
            log(run), udot=np.gradient(run.u, run.t, axis=0) if how == "central" else ahead
        )

    found = of_logs(mechanism, [differences(run) for run in runs])
    assert found.verdict.kind == "consistent"


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("of", [float, np.float32])
def test_logs_in_degrees(single: bool, of: type) -> None:
    """Coordinates, speeds and accelerations agree with each other; the equations at the samples tell."""
    mechanism, runs = damped()
    factors = np.degrees(1.0) ** np.array([1, not single, not single])

    def degrees(values: Any) -> Any:
        return (values * factors).astype(of).astype(float)

    logs = [
        replace(r, q=degrees(r.q), u=degrees(r.u), udot=degrees(r.udot))
        for r in (log(run, udot=True) for run in runs)
    ]
    found = of_logs(mechanism, logs)
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    (slip,) = [f for f in found.findings if f.weight == "doubt"]
    assert (slip.kind, slip.element) == ("degrees", runs[0].coordinates[0] if single else "")


@pytest.mark.parametrize("solver", ["ode1", "ode4"])
def test_dry_friction(solver: str) -> None:
    mechanism = dc.Mechanism(
        [dc.point_mass("block", 1.0)],
        [dc.prismatic("x", "ground", "block", "x", stiffness=20.0)],
        [dc.forces.joint_torque("rub", "x", "-0.5*sign(u.x)")],
        gravity=[0, 0, 0],
    )
    state = mechanism.state({"x": 1.0})
    own = dc.study(mechanism, state, 2.0, (0.02, 0.01, 0.005), solver)
    assert own.verdict.kind in ("consistent", "integration-error")
    runs = [entry.run for entry in own.runs if entry.run is not None]
    for logs in ([log(r) for r in runs], [log(r).every(round(0.04 / r.t[1])) for r in runs]):
        assert of_logs(mechanism, logs).verdict.kind != "equation-error"


def bouncing(step: float, udot: bool) -> Trajectory:
    """A ball that falls from 1 m and keeps 0.8 of its speed at each impact, exactly."""
    g, z, v = 9.81, 1.0, 0.0
    rows = [(z, v)]
    for _ in range(round(2.0 / step)):
        left = step
        while (impact := (v + np.sqrt(v * v + 2 * g * z)) / g) <= left and impact > 1e-9:
            v, z, left = 0.8 * (g * impact - v), 0.0, left - impact
        z, v = z + v * left - 0.5 * g * left**2, v - g * left
        rows.append((z, v))
    q, u = zip(*rows)
    return samples(step, q, u, np.full(len(q), -g) if udot else None)


@pytest.mark.parametrize("udot", [True, False])
def test_a_bouncing_ball(udot: bool) -> None:
    """Each impact takes 36 % of K at any step, and no equation is wrong."""
    mechanism = dc.Mechanism(
        [dc.point_mass("ball", 1.0)],
        [dc.prismatic("x", "ground", "ball", "z")],
        gravity=[0, 0, -9.81],
    )
    found = dc.study(mechanism, runs=lambda h: bouncing(h, udot), steps=STEPS)
    assert found.observed_order["wang"].limit > 1.0
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    assert "impacts" in kinds(found)


def test_chaos_in_logs() -> None:
    problem = dc.problems.load("triple-pendulum", rates=(10.0, 0.0, 0.0))
    runs = [
        dc.simulate(problem.mechanism, problem.state, 10.0, h, "ode4", record=()) for h in TRIPLE
    ]
    found = of_logs(problem.mechanism, [log(run) for run in runs])
    assert found.verdict.kind in ("consistent", "integration-error"), found.verdict.explain()


PERIOD = 0.05


def sampled_control(step: float, every_row: bool) -> Trajectory:
    """A pendulum whose motor is set every 50 ms, at whatever step; perhaps logged only then."""
    inertia, rows = 1.0 / 3.0, []
    q, u, torque = 0.5, 0.0, 0.0
    for k in range(round(2.0 / step) + 1):
        if abs(k * step / PERIOD - round(k * step / PERIOD)) < 1e-9:
            torque = 5.0 * np.sin(3.0 * k * step) - 0.5 * u
        rows.append((q, u, torque))

        def rate(q: float) -> float:
            return float((torque - 9.81 * 0.5 * np.cos(q)) / inertia)  # noqa: B023

        # Nyström's method of order 4
        a, b = rate(q), rate(q + 0.5 * step * u + 0.125 * step**2 * rate(q))
        c = rate(q + step * u + 0.5 * step**2 * b)
        q, u = q + step * u + step**2 / 6 * (a + 2 * b), u + step / 6 * (a + 4 * b + c)
    columns = [np.array(column) for column in zip(*rows)]
    run = samples(step, columns[0], columns[1], **{"actuator motor": columns[2]})
    return run if every_row else run.every(round(PERIOD / step))


@pytest.mark.parametrize("every_row", [True, False])
def test_a_controller_with_a_period_of_its_own(every_row: bool) -> None:
    mechanism = dc.Mechanism(
        [dc.rod("arm", 1.0, 1.0)],
        [dc.revolute("x", "ground", "arm")],
        [dc.forces.joint_torque("motor", "x")],
        gravity=[0, -9.81, 0],
    )
    found = dc.study(mechanism, runs=lambda h: sampled_control(h, every_row), steps=STEPS)
    assert found.verdict.kind in ("unresolved", "integration-error"), found.verdict.explain()
    assert found.observed_order["state"].order == pytest.approx(4.0, abs=0.15)


def test_a_moving_support() -> None:
    problem = dc.problems.load("driven-triple-pendulum")
    runs = [
        dc.simulate(problem.mechanism, problem.state, 2.0, h, "ode4", record=()) for h in TRIPLE
    ]
    for udot in (True, False):
        found = of_logs(problem.mechanism, [log(run, udot) for run in runs])
        assert found.verdict.kind == "consistent", found.verdict.explain()


@pytest.mark.slow
def test_constraints_stabilised_in_three_ways() -> None:
    problem = dc.problems.load("n-four-bar")
    for constraints in ("projection", dc.Baumgarte(20.0, 20.0), None):
        found = dc.study(
            problem,
            duration=1.0,
            steps=(0.02, 0.01, 0.005),
            solver="ode3",
            constraints=constraints,
        )
        assert found.verdict.kind in ("consistent", "integration-error"), found.verdict.explain()


def test_a_stabilised_run_is_judged_by_its_corrections() -> None:
    """Scaling the speed back to the right energy hides the error from ΔC, not from the correction."""
    mechanism = dc.Mechanism(
        [dc.point_mass("block", 1.0)],
        [dc.prismatic("x", "ground", "block", "x", stiffness=40.0)],
        gravity=[0, 0, 0],
    )

    def run(step: float) -> Trajectory:
        q, u, push, rows = 1.0, 1.0, 0.0, []
        energy = 0.5 * u**2 + 20.0 * q**2
        for _ in range(round(1.0 / step) + 1):
            rows.append((q, u, push))
            q, v = q + step * u, u - step * 40.0 * q
            u = np.sign(v) * np.sqrt(max(2.0 * (energy - 20.0 * q**2), 0.0))
            push = (u - v) / step
        columns = [np.array(c) for c in zip(*rows)]
        return samples(step, columns[0], columns[1], **{"correction energy": columns[2]})

    found = dc.study(mechanism, runs=run, steps=(4e-3, 2e-3, 1e-3))
    assert found.verdict.kind != "equation-error"
    assert found.verdict.kind != "consistent"
    assert "stabilised" in kinds(found), found.verdict.explain()


# --- wrong equations ------------------------------------------------------------------------------


WRONG = [(parameter, udot) for parameter in ("g", "m2", "l3", "c1") for udot in (True, False)]


@pytest.mark.parametrize("case", repeated(WRONG, ("l3", False), ("c1", False)))
def test_a_wrong_parameter(case: tuple[str, bool]) -> None:
    """5 % of one parameter; the weakest, a damper that turns over 0.6 J, without u̇ is under the bar."""
    parameter, udot = case
    mechanism, runs = damped()
    other = mechanism.with_parameters(**{parameter: 1.05 * mechanism.parameters[parameter]})
    found = of_logs(other, [log(run, udot) for run in runs])
    assert found.verdict.kind == "equation-error", found.verdict.explain()
    assert found.exit_code == 1
    assert found.verdict.confidence == ("high" if udot else "medium")


def test_a_lost_damper() -> None:
    mechanism, runs = damped()
    other = mechanism.with_parameters(c1=0.0, c2=0.0, c3=0.0)
    found = of_logs(other, [log(run) for run in runs])
    assert found.verdict.kind == "equation-error"
    assert "does not vanish as the step is refined: it tends to" in found.verdict.meaning


def test_a_lost_gyroscopic_term_is_seen_by_momentum() -> None:
    """ω̇ = 0 in place of Euler's equations keeps K only where ω is; the momentum turns with the body."""
    problem = dc.problems.load("torque-free-box")
    wrong = dc.Equations(
        lambda t, q, u: np.array([0 * u[0], 0 * u[0], 0 * u[0] - 9.8, 0 * u[0], 0 * u[0], 0 * u[0]])
    )
    runs = [
        dc.simulate(problem.mechanism, problem.state, 1.0, h, "ode4", (), wrong)
        for h in (0.02, 0.01, 0.005)
    ]
    found = of_logs(problem.mechanism, [log(run) for run in runs])
    assert found.verdict.kind == "equation-error", found.verdict.explain()
    assert "momentum" in found.verdict.meaning
    seen = of_logs(problem.mechanism, [log(run, udot=True) for run in runs])
    assert seen.verdict.kind == "equation-error"
    assert {f.element for f in seen.findings if f.kind == "coordinate-residual"} <= {
        f"{problem.mechanism.joints[0].name}.w{axis}" for axis in "xyz"
    }


def test_another_drive_than_the_models_is_seen_at_any_step() -> None:
    problem = dc.problems.load("driven-triple-pendulum")
    runs = [
        dc.simulate(problem.mechanism, problem.state, 1.0, h, "ode1", record=()) for h in TRIPLE
    ]
    other = problem.mechanism.with_parameters(w=0.76)
    found = of_logs(other, [log(run, udot=True) for run in runs])
    assert found.verdict.kind == "equation-error"
    assert "constraint-violation" in kinds(found)


@pytest.mark.parametrize(
    ("factors", "stays"), [((1.01, 1.01, 1.0101), True), ((1.004, 1.002, 1.001), False)]
)
def test_a_slip_of_the_log_is_there_at_every_step(factors: tuple[float, ...], stays: bool) -> None:
    """What shrinks with the step is the method's: half the step, half of it, is of first order."""
    from deltac.diagnosis.study.runs import StudyRun, lasting
    from deltac.diagnosis.verdict import Finding

    runs = tuple(
        StudyRun(h, findings=(Finding("clock-scale", "the clock", "", "", "doubt", factor=f),))
        for h, f in zip((0.01, 0.005, 0.0025), factors, strict=True)
    )
    assert all(bool(run.findings) == stays for run in lasting(runs))
    assert not any(run.findings for run in lasting((StudyRun(0.02), *runs)))
