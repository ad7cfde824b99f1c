"""q against u without any dynamics: each slip of a log is named, and right logs are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import deltac as dc
from deltac import Trajectory
from deltac.arrays import HALF_DIGITS
from deltac.diagnosis.measurements import kinematics
from deltac.diagnosis.measurements.cleaning import cleaned
from deltac.diagnosis.measurements.kinematics import (
    coordinates_against_speeds,
)
from deltac.trajectories.formats.schema import to_columns
from tests.systems.cart_pole import SCHEMES, CartPole, log

MECHANISM = CartPole().mechanism()


def kinds(run: Trajectory) -> list[str]:
    return [f.kind for f in cleaned(MECHANISM, run).findings]


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("every", [1, 5])
def test_right_logs_have_no_findings(scheme: str, every: int) -> None:
    assert kinds(log(CartPole(), scheme).every(every)) == []


@pytest.mark.parametrize("decimals", [3, 4, 6])
def test_nor_have_logs_of_few_digits(decimals: int) -> None:
    run = log(CartPole())
    assert kinds(replace(run, q=np.round(run.q, decimals), u=np.round(run.u, decimals))) == []


@pytest.mark.parametrize(
    ("scheme", "late"),
    [("explicit-euler", -0.5), ("semi-implicit-euler", 0.5), ("implicit-euler", 0.5), ("rk4", 0.0)],
)
def test_the_instant_of_the_rate_tells_the_scheme(scheme: str, late: float) -> None:
    """Δq = h u at the start or the end of a step, exactly; of Runge–Kutta's to its order."""
    for made in coordinates_against_speeds(MECHANISM, log(CartPole(), scheme)).values():
        assert made.late == pytest.approx(late, abs=1e-9 if late else 1e-3)
        assert made.ratio == pytest.approx(1.0, abs=1e-9 if late else 1e-6)


@pytest.mark.parametrize("factor", [1.01, 1.001, 0.999])
@pytest.mark.parametrize("scheme", ["explicit-euler", "rk4"])
def test_a_clock(factor: float, scheme: str) -> None:
    run = log(CartPole(), scheme)
    (found,) = cleaned(MECHANISM, replace(run, t=run.t * factor)).findings
    assert (found.kind, found.weight) == ("clock-scale", "doubt")
    assert found.factor == pytest.approx(1.0 / factor, abs=2e-5)


def test_a_gear_between_coordinate_and_speed() -> None:
    run = log(CartPole())
    (found,) = cleaned(MECHANISM, replace(run, q=run.q * [1.0, 0.7])).findings
    assert (found.kind, found.element) == ("gear-between-q-and-u", "hinge")
    assert found.factor == pytest.approx(0.7, abs=1e-5)


def test_copies_of_rows_are_left_out() -> None:
    run = log(CartPole())
    q, u = np.array(run.q), np.array(run.u)
    for x in (q, u):
        x[7::7] = x[6::7][: len(x[7::7])]
    made = cleaned(MECHANISM, replace(run, q=q, u=u))
    assert [f.kind for f in made.findings] == ["duplicated-rows"]
    assert len(made.run) == len(run) - len(run.t[7::7])


@pytest.mark.parametrize("decimals", [None, 10])
@pytest.mark.parametrize("every", [(2,), (3, 5, 2)])
def test_rows_on_chords_give_back_the_states_between_which_they_lie(
    every: tuple[int, ...], decimals: int | None
) -> None:
    """Steps of one length, at which some rows lie, and of several, between rows."""
    run = log(CartPole())
    states = run.take(np.cumsum(np.resize(every, (len(run) - 1) // max(every))))
    h = float(run.t[1])
    t = states.t[0] + np.arange(0.0, np.ptp(states.t), h if len(every) == 1 else 0.7 * h)

    def interpolated(x: np.ndarray) -> np.ndarray:
        columns = np.column_stack([np.interp(t, states.t, column) for column in x.T])
        return columns if decimals is None else np.round(columns, decimals)

    forces = {name: interpolated(x) for name, x in states.forces.items()}
    rows = replace(
        states, t=t, q=interpolated(states.q), u=interpolated(states.u), forces=forces,
        udot=None, works={}, integrals={},
    )  # fmt: skip
    made = cleaned(MECHANISM, rows)
    assert [f.kind for f in made.findings] == ["interpolated-rows"]
    # All but the ends, and those that have no two rows on a chord beside them.
    assert len(made.run) > 0.9 * len(states) - 2
    nearest = np.abs(states.t[:, None] - made.run.t).argmin(axis=0)
    exact = 1e-12 if decimals is None else 20.0 * 10.0**-decimals
    # A knot slides along its chord by the digits over the angle of two chords.
    along = (made.run.t - states.t[nearest])[:, None]
    assert np.abs(along).max() < (1e-9 if decimals is None else 1e-3) * h * max(every)
    for own, x in (("q", states.q), ("u", states.u)):
        rate = np.gradient(x, states.t, axis=0)[nearest]
        off = np.abs(getattr(made.run, own) - x[nearest])
        assert np.all(off <= exact + np.abs(along * rate) * 2.0)


def test_rows_on_chords_of_an_adaptive_solver_beside_a_joint_at_rest() -> None:
    """A pendulum that SciPy swung, by `np.interp`; its cart is locked."""
    length, drag = 0.8, 0.2
    mechanism = dc.Mechanism(
        [dc.point_mass("cart", 1.0), dc.point_mass("bob", 1.0)],
        [
            dc.prismatic("rail", "ground", "cart", "z"),
            dc.revolute("pin", "cart", "bob", child_position=(0, length, 0), damping=drag),
        ],
        gravity=(0, -9.81, 0),
    )

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -(drag * y[1] + 9.81 * length * np.sin(y[0])) / length**2]

    made = solve_ivp(rate, (0.0, 4.0), [0.8, 0.0], "RK45", rtol=1e-5)
    t = np.arange(0.0, 4.0, 0.01)
    q, u = (np.column_stack([0.0 * t, np.interp(t, made.t, y)]) for y in made.y)
    names = ("rail", "pin")
    run = cleaned(mechanism, Trajectory(t=t, q=q, u=u, coordinates=names, speeds=names)).run
    nearest = np.abs(made.t[:, None] - run.t).argmin(axis=0)
    assert len(run) >= len(made.t) - 2  # but for the ends
    assert run.t == pytest.approx(made.t[nearest], abs=1e-12)
    assert np.column_stack([run.q[:, 1], run.u[:, 1]]) == pytest.approx(
        made.y.T[nearest], abs=1e-12
    )


@pytest.mark.parametrize("what", ["q", "u"])
def test_columns_one_row_late(what: str) -> None:
    run = log(CartPole())
    x = getattr(run, what)
    assert kinds(replace(run, **{what: np.vstack([x[:1], x[:-1]])})) == ["late-rows"]  # type: ignore[arg-type]


def test_swapped_columns() -> None:
    run = log(CartPole())
    assert kinds(replace(run, u=run.u[:, ::-1])) == ["swapped-columns"]


def test_a_clipped_column() -> None:
    run = log(CartPole())
    limit = 0.6 * np.abs(run.u[:, 1]).max()
    u = np.column_stack([run.u[:, 0], np.clip(run.u[:, 1], -limit, limit)])
    made = cleaned(MECHANISM, replace(run, u=u)).findings
    assert [(f.kind, f.element) for f in made] == [("clipped-column", "hinge")]


@pytest.mark.parametrize("scheme", ["semi-implicit-euler", "rk4"])
def test_spikes_are_left_out(scheme: str) -> None:
    run = log(CartPole(), scheme)
    u = np.array(run.u)
    u[[100, 333], 1] += 4.0
    made = cleaned(MECHANISM, replace(run, u=u))
    assert [f.kind for f in made.findings] == ["spikes"]
    assert len(made.run) == len(run) - 2


def test_a_wrapped_angle_is_made_continuous() -> None:
    run = log(CartPole(drive=30.0), duration=6.0)
    q = np.array(run.q)
    spinning = q[:, 1] + 4.0 * run.t
    u = np.array(run.u) + [0.0, 4.0]
    wrapped = (spinning + np.pi) % (2 * np.pi) - np.pi
    made = cleaned(MECHANISM, replace(run, q=np.column_stack([q[:, 0], wrapped]), u=u))
    assert [f.kind for f in made.findings] == ["wrapped-angle"]
    off = (made.run.q[:, 1] - spinning) / (2 * np.pi)
    assert np.abs(off - np.round(off[0])).max() < 1e-9


def test_a_wrapped_angle_without_speeds_is_made_continuous() -> None:
    """A pendulum that goes round, by its angle alone: the speeds are those of the unwrapped angle."""
    pendulum = dc.Mechanism(
        [dc.point_mass("bob", 1.0, (0, 0, -1))],
        [dc.revolute("hinge", "ground", "bob", axis="y")],
        gravity=(0, 0, -9.81),
    )
    run = dc.simulate(pendulum, pendulum.state(speeds=[8.0]), 3.0, 2e-3, "ode4")
    wrapped = (run.q[:, 0] + np.pi) % (2 * np.pi) - np.pi
    audit = dc.audit(pendulum, {"time": run.t, "q.hinge": wrapped})
    assert "wrapped-angle" in [f.kind for f in audit.findings]
    assert audit.verdict.kind == "consistent"
    assert np.abs(audit.run.q - run.q).max() < 1e-9
    assert np.abs(audit.run.u - run.u).max() < 1e-4  # splines of degree 5


@pytest.mark.parametrize("gaps", [slice(7, None, 20), slice(1, None, 2)])
def test_accelerations_with_gaps_are_left_out(gaps: slice) -> None:
    """Rows with the names of the schema may lack what they need not have."""
    run = log(CartPole(), duration=2.0)
    table = dict(to_columns(run))
    for n in run.speeds:
        table[f"udot.{n}"] = np.array(table[f"udot.{n}"])
        table[f"udot.{n}"][gaps] = np.nan
    audit = dc.audit(MECHANISM, table)
    assert audit.run.udot is None and len(audit.run) == len(run)
    assert "left-out" in [f.kind for f in audit.findings]


def test_a_scheme_that_takes_the_speed_after_is_half_a_row_late() -> None:
    """Semi-implicit Euler moves q by the speed after, and by nothing else."""
    problem = dc.problems.load("double-pendulum")
    mechanism = problem.mechanism
    run = dc.simulate(mechanism, problem.state, 2.0, 5e-3, "semi-implicit-euler")
    run = dc.Trajectory(t=run.t, q=run.q, u=run.u, coordinates=run.coordinates, speeds=run.speeds)
    comparisons = coordinates_against_speeds(mechanism, run)
    assert len(comparisons) == 2
    for column in comparisons.values():
        assert column.late == pytest.approx(0.5, abs=1e-6)
        assert column.ratio == pytest.approx(1.0, abs=1e-8)
        assert column.instant and not column.scaled and not column.outliers.any()
        assert column.departure < HALF_DIGITS


@pytest.mark.parametrize("braked", [0.04, 0.2, 0.5])
@pytest.mark.parametrize("gear", [1.0, 2.0])
def test_a_speed_that_decays_evenly_does_not_show_a_small_factor(
    braked: float, gear: float
) -> None:
    """A slide behind a damper by the classical method: a factor or a delay would do the same to its rows."""
    h, z = 0.01, braked
    u = (1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24) ** np.arange(80)
    q = gear * np.append(0.0, np.cumsum(h * u[:-1] * (1 - z / 2 + z**2 / 6 - z**3 / 24)))
    t, bar = h * np.arange(80), np.full((79, 1), 1e-16)
    (found,) = kinematics.compare(t, np.diff(q)[:, None], u[:, None], bar, [(0, 80)])  # type: ignore[arg-type]
    assert found is not None
    assert found.scaled == (gear != 1.0)


@pytest.mark.parametrize("damping", [0.7, 1.0, 2.0])
def test_a_servo_between_rows_is_no_gear(damping: float) -> None:
    """Held targets, the exact solution: Δq is a combination of both speeds, of another factor than one."""
    h, w = 0.02, 40.0
    step = expm(h * np.array([[0, 1, 0], [-(w**2), -2 * damping * w, w**2], [0, 0, 0]]))
    t, x = h * np.arange(400.0), np.zeros((400, 2))
    for k in range(399):
        x[k + 1] = (step @ [*x[k], 0.5 * np.sin(2 * t[k]) + 0.3 * np.sin(5.3 * t[k] + 0.4)])[:2]
    slider = dc.Mechanism(
        [dc.body("block", 1.0, (0.1, 0.1, 0.1))], [dc.prismatic("s", "ground", "block", axis="x")]
    )
    run = dc.Trajectory(t=t, q=x[:, :1], u=x[:, 1:], coordinates=("s",), speeds=("s",))
    assert cleaned(slider, run).findings == ()
