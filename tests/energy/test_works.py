"""Works of channels: against closed forms and energies, in the loop and on samples, and their error bars."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import deltac as dc
from deltac.energy.works import Work, exchanged, widened
from deltac.errors import InputError
from deltac.mechanism.channels import ChannelName
from deltac.problems import load
from tests.support.processes import printed

EPS = float(np.finfo(float).eps)


@lru_cache
def governor(step: float) -> tuple[dc.Mechanism, dc.Trajectory]:
    """The stiff governor by Radau, sampled far more coarsely than its couplers' dampers act (0.12 ms)."""
    problem = load("stiff-governor")
    run = dc.simulate(problem.mechanism, problem.state, 3.0, step, dc.solvers.Scipy("Radau", 1e-9))
    return problem.mechanism, run


def oscillator() -> tuple[dc.Mechanism, dc.State]:
    """m ẍ = −k x − c ẋ with m = 1 kg, k = 100 N/m, c = 0.4 N·s/m."""
    mechanism = dc.Mechanism(
        [dc.point_mass("mass", 1.0)],
        [dc.prismatic("slide", "ground", "mass", "x", stiffness=100.0, damping=0.4)],
    )
    return mechanism, mechanism.state({"slide": 0.1})


def heat(t: np.ndarray) -> np.ndarray:
    """What the oscillator's damper took (J), from x(t) in closed form: E(0) − E(t)."""
    x0, delta, omega = 0.1, 0.2, np.sqrt(100.0 - 0.2**2)
    decay = x0 * np.exp(-delta * t)
    x = decay * (np.cos(omega * t) + delta / omega * np.sin(omega * t))
    v = -decay * (omega + delta**2 / omega) * np.sin(omega * t)
    return np.asarray(0.5 * 100.0 * x0**2 - 0.5 * v**2 - 0.5 * 100.0 * x**2)


@pytest.mark.parametrize("step", [1.0, 0.01])
def test_works_in_the_loop_do_not_depend_on_samples(step: float) -> None:
    mechanism, run = governor(step)
    ledger = dc.balance(mechanism, run)
    dampers = [n for n in ledger.work if n.kind == "damper"]
    assert len(dampers) == 2 and {ledger.work_from[n] for n in dampers} == {"in-loop"}
    E = ledger.kinetic + ledger.potential_energy
    missing = E - E[0] - sum(ledger.work[n] for n in dampers)
    bars = sum(ledger.work_error[n] for n in dampers)
    rounding = 100 * EPS * np.abs(ledger.potential_energy).max()
    assert (np.abs(missing) <= bars + rounding).all()
    assert np.max(bars) < 1e-6 and ledger.unresolved == ()
    assert np.ptp(E) > 1e-3  # there is a loss to be told


@pytest.mark.parametrize("step", [1.0, 0.01])
def test_works_on_sparse_samples_are_unresolved(step: float) -> None:
    mechanism, run = governor(step)
    ledger = dc.balance(mechanism, replace(run, works={}, integrals={}))
    exact = dc.balance(mechanism, run)
    assert {n.kind for n in ledger.unresolved} == {"damper"}
    for name in ledger.unresolved:
        off = np.abs(ledger.work[name] - exact.work[name])[-1]
        assert off <= ledger.work_error[name][-1]
    # What the dampers seem to do is no part of the scale.
    assert ledger.energy_exchanged < 1.5 * exact.energy_exchanged


def test_a_log_with_integrals_but_no_works_has_bars_that_hold() -> None:
    """ΔC is known from the loop; works on samples must allow for all that they miss of it."""
    mechanism, run = governor(1.0)
    ledger = dc.balance(mechanism, replace(run, works={}))
    E = ledger.kinetic + ledger.potential_energy
    dampers = [n for n in ledger.work if n.kind == "damper"]
    missing = E - E[0] - sum(ledger.work[n] for n in dampers) - ledger.delta_c["wang"]
    assert (np.abs(missing) <= sum(ledger.work_error[n] for n in dampers) + 1e-9).all()
    assert set(ledger.unresolved) == set(dampers)


def test_unresolved_works_are_a_finding_of_an_audit() -> None:
    mechanism, run = governor(1.0)
    bare = replace(run, works={}, integrals={}, provenance=dc.Provenance("other"))
    found = dc.audit(mechanism, bare)
    assert "F-WORK-UNRESOLVED" in [f.code for f in found.findings]
    rows = {row.name: row for row in found.rows()}
    assert not rows["damper coupler1"].resolved and rows["gravity"].resolved
    assert "F-WORK-UNRESOLVED" not in [f.code for f in dc.audit(mechanism, run).findings]


def test_rounding_of_energies_at_rest_is_resolved() -> None:
    """Works are zero then, and no smaller step makes them better known."""
    problem = load("double-pendulum")
    run = dc.simulate(problem.mechanism, problem.mechanism.state(), 1.0, 1e-2, "ode4", ("wang",))
    found = dc.audit(problem.mechanism, run)
    assert found.ledger.at_rest and not found.ledger.unresolved
    assert found.verdict.kind == "unresolved"
    assert [f.code for f in found.findings] == ["F-UNDECIDED"]
    assert "predicted" not in found.explain()


@pytest.mark.long
def test_a_body_that_has_settled_tells_nothing_of_an_integrator() -> None:
    """It sinks by roundings of its height; weight and floor exchange more than it has, and no step helps."""
    ball = dc.Mechanism(
        [dc.point_mass("ball", 2.0)],
        [dc.prismatic("z", "ground", "ball", "z")],
        gravity=(0, 0, -9.80665),
    )
    t = np.linspace(0.0, 0.8, 401)
    sink = 1e-13 * np.exp(-t / 0.2)[:, None]
    log = dc.Trajectory(
        t=t,
        q=0.3 + sink,
        u=-1.1 * sink / 0.2,
        udot=sink / 0.2**2,
        forces={"contact floor": 2.0 * (9.80665 + sink / 0.2**2)},
        coordinates=("z",),
        speeds=("z",),
    )
    found = dc.audit(ball, log)
    assert found.ledger.energy_exchanged > found.ledger.reference_energy
    assert found.verdict.kind == "unresolved"
    assert "almost nothing moves" in [f.what for f in found.findings]
    assert "predicted" not in found.explain() and "smaller" not in found.explain()
    heavy = replace(
        ball, bodies=(dc.point_mass("ball", 2.5),)
    )  # its weight is not what the floor bears
    assert dc.audit(heavy, log).verdict.kind == "equation-error"


@pytest.mark.parametrize(
    "solver", ["ode4", "ode5", "DOP853", "implicit-midpoint", "CVODES", "IDAS"]
)
def test_the_heat_of_a_damped_oscillator(solver: str) -> None:
    mechanism, state = oscillator()
    step = 0.1 if solver in ("DOP853", "CVODES", "IDAS") else 1e-3
    run = dc.simulate(mechanism, state, 2.0, step, solver, ("wang",))
    ledger = dc.balance(mechanism, run)
    off = np.abs(ledger.work["damper slide"] + heat(run.t)).max()
    # The midpoint rule is of second order, (ω h)² of the energy; 1e-9 is tolerated in each of many steps.
    assert off < (1e-4 if solver == "implicit-midpoint" else 2e-6) * heat(run.t)[-1]
    assert ledger.work_from["damper slide"] == "in-loop"


@pytest.mark.parametrize("every", [1, 2, 4])
def test_bars_of_works_on_samples_hold(every: int) -> None:
    """Samples of the exact motion: all that is off is the quadrature's."""
    mechanism, state = oscillator()
    run = dc.simulate(mechanism, state, 2.0, 0.02, "taylor", ("wang",)).every(every)
    ledger = dc.balance(mechanism, run, "samples")
    off = np.abs(ledger.work["damper slide"] + heat(run.t))
    assert (off <= ledger.work_error["damper slide"] + 1e-15).all()
    assert ledger.work_error["damper slide"].max() < 1e-3 * heat(run.t)[-1]


def test_the_motor_of_the_bead_on_a_hoop() -> None:
    """The drive of the hoop did 3.708642163 J in the first second."""
    problem = load("bead-on-hoop")
    run = dc.simulate(problem.mechanism, problem.state, problem.duration, 0.5, "taylor")
    ledger = dc.balance(problem.mechanism, run)
    drive = next(n for n in ledger.work if n.kind == "prescribed")
    # The energy at 1 s less that at the start, which the problem has from a calculation to 1e-12.
    at = np.isclose(run.t, 1.0)
    assert ledger.work_from[drive] == "in-loop"
    assert ledger.work[drive][at] == pytest.approx(3.708642163, abs=1e-9)
    assert ledger.work_error[drive][-1] < 1e-9


def test_works_of_every_kind_add_up() -> None:
    """A constraint that moves, a damper, projections: what they did is ΔE, but for ΔC."""
    mechanism = dc.Mechanism(
        [dc.bodies.frame("cart"), dc.point_mass("bob", 1.0)],
        [
            dc.prismatic("x", "ground", "cart", "x", damping=0.1),
            dc.prismatic("z", "cart", "bob", "z"),
        ],
        constraints=[dc.constraints.distance("rope", "ground", "bob", "1 + 0.1*sin(3*t)")],
        gravity=[0, 0, -9.81],
    )
    start = dc.assemble(mechanism, mechanism.state({"x": 0.6, "z": -0.8})).state
    run = dc.simulate(mechanism, start, 2.0, 2e-3, "ode4")
    ledger = dc.balance(mechanism, run)
    E = ledger.kinetic + ledger.potential_energy
    done = sum(w for n, w in ledger.work.items() if n not in ledger.potential)
    np.testing.assert_allclose(E - E[0] - done, ledger.delta_c["wang"], atol=1e-12)
    assert ledger.work_from["constraint rope"] == "in-loop"
    assert ledger.work_from["correction projection"] == "booked"


def test_cuts_of_a_run_keep_its_works() -> None:
    mechanism, state = oscillator()
    run = dc.simulate(mechanism, state, 2.0, 0.01)
    whole = run.works["damper slide"]
    np.testing.assert_array_equal(run.every(5).works["damper slide"], whole[::5])
    part = run.between(0.5, 1.5)
    np.testing.assert_allclose(part.works["damper slide"], whole[50:151] - whole[50], atol=1e-16)
    assert pickle.loads(pickle.dumps(run)).works.keys() == run.works.keys()


def test_without_testing_functions_nothing_is_integrated() -> None:
    mechanism, state = oscillator()
    assert not dc.simulate(mechanism, state, 0.1, 0.01, record=()).works


def test_bars_that_are_too_small_are_widened() -> None:
    a, b = ChannelName("damper", "a"), ChannelName("damper", "b")
    value, bar = np.array([0.0, 1.0]), np.array([0.0, 0.1])
    works = {a: Work(value, bar), b: Work(value, bar, "in-loop")}
    kept = widened(works, np.array([0.0, 0.15]))
    assert all(np.array_equal(kept[n].bar, bar) for n in works)
    wide = widened(works, np.array([0.0, 3.0]))
    assert wide[a].bar[-1] == 3.0 and wide[b].bar[-1] == 0.1


def test_the_energy_exchanged_counts_only_what_is_certain() -> None:
    t, power = np.array([0.0, 1.0]), np.array([-100.0, -100.0])
    sure = Work(np.array([0.0, -1.0]), np.zeros(2), "in-loop")
    assert exchanged(sure, power, t) == 2.0  # not the 100 J of the trapezoid
    unsure = Work(np.array([0.0, -100.0]), np.array([0.0, 400.0]))
    assert exchanged(unsure, power, t) == 0.0
    assert exchanged(Work(np.array([0.0, -100.0]), np.array([0.0, 1.0])), power, t) == 99.0


def test_channel_names_are_values_and_text() -> None:
    name = ChannelName("damper", "left hip")
    texts: dict[str, int] = {name: 1}
    assert name == "damper left hip" and texts["damper left hip"] == 1
    assert ChannelName.parse("damper left hip").element == "left hip"
    assert ChannelName.parse("gravity") == ChannelName("gravity") == "gravity"
    with pytest.raises(AttributeError):
        name.kind = "spring"
    with pytest.raises(InputError, match="'damper'"):
        ChannelName.parse("dampr hip")
    again = pickle.loads(pickle.dumps(name))
    assert again == name and (again.kind, again.element) == ("damper", "left hip")


def test_a_wrong_name_of_a_channel_is_told_with_the_right_one() -> None:
    mechanism, state = oscillator()
    ledger = dc.balance(mechanism, dc.simulate(mechanism, state, 0.1, 0.01))
    with pytest.raises(KeyError, match="did you mean 'damper slide'"):
        ledger.work["damper slid"]


@pytest.mark.long
def test_kernels_are_the_same_in_every_process() -> None:
    """They are kept on disk by their text: it must not depend on the hash seed of a process."""
    code = (
        "import deltac as dc\n"
        "from dataclasses import replace\n"
        "from deltac.dynamics.testing_functions import testing_functions\n"
        "from deltac.energy.terms import LoggedForces, ledger_kernels, ledger_symbols\n"
        "names = 'abcdef'\n"
        "m = dc.Mechanism([dc.rod(n, 1, 1) for n in names], [dc.revolute(n, p, n, damping=1)"
        " for p, n in zip(['ground', *names], names)])\n"
        "run = dc.simulate(m, m.state({'a': 1}), 0.2, 0.1)\n"
        "log = LoggedForces.of(replace(run, forces={f'damper {n}': 1 + run.u for n in names}))\n"
        "symbols = ledger_symbols(m, log, None, (0.0, run.q[0]))\n"
        "kernels = ledger_kernels(symbols, testing_functions(('wang', 'liu-huston')), log.places,"
        " frozenset(log.places))\n"
        "print(kernels.between.function.serialize())"
    )
    assert len(printed(code)) == 1
