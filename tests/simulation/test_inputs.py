"""What cannot be simulated is refused before anything is computed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.mechanism.state import State
from tests.systems.machines import pendulum, robot

PENDULUM = pendulum()
NAN = float("nan")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration": 0.0}, ["duration is 0.0", "positive"]),
        ({"duration": -1.0}, ["duration is -1.0"]),
        ({"duration": NAN}, ["duration is nan"]),
        ({"duration": "long"}, ["duration is 'long'", "number"]),
        ({"step": 0.0}, ["step is 0.0"]),
        ({"step": -0.1}, ["step is -0.1"]),
        ({"step": NAN}, ["step is nan"]),
        ({"step": None}, ["'ode5'", "fixed steps", "step="]),
        ({"step": 0.3}, ["step 0.3", "duration 1", "3.33333 times", "0.25"]),
        ({"step": 2.0}, ["step 2", "duration 1", "does not divide"]),
        ({"step": 0.1 * (1 + 1e-8)}, ["does not divide"]),
        ({"record": 0}, ["record: every is 0", "whole number"]),
        ({"record": dc.Record(every=2.5)}, ["record: every is 2.5", "whole number"]),  # type: ignore[arg-type]
        ({"record": 3}, ["every = 3", "number of steps, 10"]),
        ({"record": "wang"}, ["record is 'wang'", "deltac.Record"]),
        ({"record": 2.5}, ["record is 2.5", "deltac.Record"]),
        ({"solver": "ode6"}, ["'ode6'", "ode1 (euler)", "taylor-quad"]),
        ({"solver": dc.Record()}, ["solver is Record", "deltac.solvers.Scipy"]),
        ({"constraints": "none"}, ["constraints is 'none'", "deltac.Baumgarte"]),
        ({"record": ("wnag",)}, ["testing function 'wnag'", "did you mean 'wang'"]),
    ],
)
def test_options(options: dict[str, Any], words: list[str]) -> None:
    given = {"duration": 1.0, "step": 0.1, **options}
    with pytest.raises(InputError) as caught:
        dc.simulate(PENDULUM, PENDULUM.state(), **given)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: dc.solvers.by_name("ode5", 1e-6), ["'ode5'", "no tolerance", "Scipy('DOP853'"]),
        (lambda: dc.solvers.Scipy("RK45", 0.0), ["tolerance is 0.0"]),
        (lambda: dc.solvers.Scipy("CVODES"), ["'CVODES'", "Sundials(...)", "name, tolerance"]),
        (lambda: dc.solvers.FixedStep("radua"), ["'radua'", "did you mean 'Radau'"]),
        (lambda: dc.solvers.FixedStep("Radau"), ["'Radau'", "Scipy(...)"]),
        (lambda: dc.solvers.Sundials("ode4"), ["'ode4'", "FixedStep(...)"]),
        (lambda: dc.solvers.Taylor("tight"), ["tolerance is 'tight'"]),  # type: ignore[arg-type]
        (lambda: dc.solvers.GeneralizedAlpha(1.2), ["spectral_radius is 1.2"]),
    ],
)
def test_option_objects_name_the_solver_that_takes_what_was_given(
    make: Any, words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        make()
    for word in words:
        assert word in str(caught.value)


def test_capitals_count_where_two_solvers_differ_by_them_alone() -> None:
    """DOP853 is adaptive, dop853 of fixed steps; elsewhere they are a matter of taste."""
    assert dc.solvers.by_name("DOP853") == dc.solvers.Scipy("DOP853")
    assert dc.solvers.by_name("dop853") == dc.solvers.FixedStep("ode8")
    assert dc.solvers.by_name("radau") == dc.solvers.Scipy("Radau")
    with pytest.raises(InputError, match="unknown solver 'Dop853'"):
        dc.solvers.by_name("Dop853")


def test_what_varies_is_a_parameter_or_a_number() -> None:
    with pytest.raises(InputError, match="'lenght'.*known: m, l, g"):
        PENDULUM.varying("lenght")
    assert PENDULUM.varying("m").varying("l", "m").varied == ("m", "l")


def test_equations_may_be_a_bare_function() -> None:
    state = PENDULUM.state({"hinge": 0.5})

    def swings(t: float, q: Any, u: Any) -> Any:
        return -9.81 / 0.5 * np.sin(q)

    run = dc.simulate(PENDULUM, state, 0.5, 0.01, equations=swings)
    same = dc.simulate(PENDULUM, state, 0.5, 0.01, equations=dc.Equations(swings))
    np.testing.assert_array_equal(run.q, same.q)
    assert run.provenance.equations == "swings"


def test_a_step_may_divide_the_duration_but_for_rounding() -> None:
    run = dc.simulate(PENDULUM, PENDULUM.state(), 1.0, 0.1 * (1 + 1e-12), "ode1")
    assert len(run) == 11 and run.t[-1] == 1.0


def test_a_state_of_another_mechanism() -> None:
    _, state = robot()
    with pytest.raises(InputError, match=r"has 8 coordinates and 7 speeds.*'pendulum' has 1"):
        dc.simulate(PENDULUM, state, 1.0, 0.1)
    with pytest.raises(InputError, match="mechanism.state"):
        dc.simulate(PENDULUM, State(0.0, np.zeros(2), np.zeros(1)), 1.0, 0.1)


def test_a_singular_mass_matrix_names_the_speeds() -> None:
    spinner = dc.Mechanism(
        [dc.point_mass("bead", 1.0)], [dc.revolute("spin", "ground", "bead", "z")]
    )
    with pytest.raises(InputError, match="'spin'.*'bead'"):
        dc.simulate(spinner, spinner.state(), 1.0, 0.1)


def test_a_law_that_is_not_defined_at_the_start() -> None:
    root = dc.Mechanism(
        PENDULUM.bodies,
        PENDULUM.joints,
        [dc.forces.joint_torque("motor", "hinge", "sqrt(q.hinge - 1)")],
        parameters=PENDULUM.parameters,
    )
    with pytest.raises(InputError, match="not finite at the start .* a law is not defined"):
        dc.simulate(root, root.state(), 1.0, 0.1)


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("force", "joint", "blamed"),
    [
        (dc.forces.joint_torque("motor", "hinge", "sign(u.hinge)"), {}, "channel 'actuator motor'"),
        (None, {"motion": "abs(sin(t))"}, "motion of joint 'hinge'"),
        (None, {"damping": "Max(0, u.hinge)"}, "channel 'damper hinge'"),
    ],
)
def test_taylor_refuses_kinks_and_says_where(
    force: Any, joint: dict[str, Any], blamed: str
) -> None:
    machine = dc.Mechanism(
        [dc.bodies.box("arm", 1, [1, 1, 1]), dc.bodies.box("tip", 1, [1, 1, 1])],
        [dc.revolute("hinge", "ground", "arm", **joint), dc.revolute("end", "arm", "tip")],
        [force] if force is not None else [],
    )
    with pytest.raises(InputError, match=f"smooth.*{blamed}.*'ode5' or 'DOP853'"):
        dc.simulate(machine, machine.state(), 1.0, 0.1, "taylor")
    dc.simulate(machine, machine.state(), 0.1, 0.1, "ode1", ())


def test_provenance_says_who_made_it() -> None:
    run = dc.simulate(PENDULUM, PENDULUM.state(), 1.0, 0.1, "dormand-prince")
    p = run.provenance
    assert (p.simulator, p.solver, p.step, p.model) == ("deltac", "ode5", 0.1, "pendulum")
    assert p.model_hash == PENDULUM.hash and p.completed and not p.message
    assert dc.simulate(PENDULUM, PENDULUM.state(), 1.0, 0.1, "RK45").provenance.step is None


def test_warnings_of_a_run_blame_the_line_that_called_it() -> None:
    with pytest.warns(dc.SimulationStoppedWarning) as warned:
        dc.simulate("stiff-governor", None, 1.0, 0.1, "ode4")
    source = Path(__file__).read_text().splitlines()
    lines = {source[w.lineno - 1].strip() for w in warned if w.filename == __file__}
    assert lines == {'dc.simulate("stiff-governor", None, 1.0, 0.1, "ode4")'}
