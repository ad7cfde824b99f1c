"""One suite over the registry: every testing function closes on exact motion, in rate and in integral."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.energy import TESTING_FUNCTIONS, residuals
from deltac.simulation.solvers import SOLVERS
from tests.support.slow import ONE_OF_A_KIND, repeated
from tests.systems.machines import pendulum, robot, workshop

NAMES = tuple(TESTING_FUNCTIONS)
STEPPING = [s.name for s in SOLVERS.values() if s.takes_steps]
MACHINES = {"robot": robot, "workshop": workshop}


def exact(machine: str) -> tuple[dc.Mechanism, dc.Trajectory]:
    """A motion to the accuracy of ode8 at a small step: some 1e-13."""
    mechanism, state = MACHINES[machine]()
    return mechanism, dc.simulate(
        mechanism, state, 1.0, 1 / 400, "ode8", dc.Record(testing=NAMES, every=4)
    )


@pytest.fixture(scope="module", params=MACHINES)
def motion(request: pytest.FixtureRequest) -> tuple[dc.Mechanism, dc.Trajectory]:
    return exact(request.param)


def test_the_machines_hold_what_they_should(motion: Any) -> None:
    """Else closing would prove little: energy flows through every channel."""
    mechanism, run = motion
    ledger = dc.balance(mechanism, run, testing=NAMES)
    for name, work in ledger.work.items():
        assert np.abs(work).max() > 1e-5 * ledger.energy_exchanged, name
    kinds = {name.split()[0] for name in ledger.work}
    assert {"gravity", "damper", "actuator", "prescribed"} <= kinds


@pytest.mark.parametrize("name", NAMES)
def test_rate_form_closes_to_rounding(name: str, motion: Any) -> None:
    """ε = Ė − P at the run's own accelerations, whatever the state's error."""
    mechanism, run = motion
    ledger = dc.balance(mechanism, run, work="samples", testing=(name,))
    size = max(np.abs(power).max() for power in ledger.power.values())
    epsilon = residuals(mechanism, run, (name,))
    assert np.abs(epsilon[name]).max() < 1e-12 * max(size, 1.0)
    assert np.abs(epsilon["coordinates"]).max() < 1e-12 * max(size, 1.0)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("work", ["in-loop", "samples"])
def test_integral_form_closes(name: str, work: str, motion: Any) -> None:
    """In the loop to the error of ode8; on samples to the error bar as well."""
    mechanism, run = motion
    ledger = dc.balance(mechanism, run, work, (name,))
    floor = 1e-11 * ledger.energy_exchanged
    assert (np.abs(ledger.delta_c[name]) < ledger.error_bar[name] + floor).all()
    assert ledger.error_bar[name].max() < 1e-7 * ledger.energy_exchanged


@pytest.mark.parametrize("name", NAMES)
def test_wrong_accelerations_show(name: str, motion: Any) -> None:
    """ε = −Σ u_r (F_r + F*_r): every function sees the same power, by the run's own residual."""
    from dataclasses import replace

    mechanism, run = motion
    assert run.udot is not None
    free = mechanism.free.u
    wrong = run.udot.copy()
    wrong[:, free] += np.linspace(0.1, 0.5, len(free))
    off = replace(run, udot=wrong, forces={})
    epsilon = residuals(mechanism, off, (name,))
    power = -np.einsum("ij,ij->i", run.u[:, free], epsilon["coordinates"])
    assert np.abs(power).max() > 1e-3
    np.testing.assert_allclose(epsilon[name], power, atol=1e-11 * max(1.0, np.abs(power).max()))


@pytest.mark.parametrize("solver", repeated(STEPPING, *ONE_OF_A_KIND))
def test_delta_c_falls_at_the_order_of_the_solver(solver: str) -> None:
    """Between p and p + 1 in every function: ΔC is the solver's own error of the energy."""
    conservative = solver == "discrete-gradient"  # refuses drives, and closes Wang's function
    drive = {} if conservative else {"motion": "0.4*sin(1.3*t)"}
    mechanism = dc.Mechanism(
        [
            dc.bodies.box("hub", 1.2, [0.3, 0.2, 0.4]),
            dc.bodies.box("arm", 0.5, [0.1, 0.2, 0.6], [0, 0, -0.3]),
        ],
        [
            dc.revolute("drive", "ground", "hub", "z", **drive),  # type: ignore[arg-type]
            dc.joints.spherical("ball", "hub", "arm", position=[0.3, 0, 0], damping=0.02),
        ],
        gravity=[0, 0, -9.81],
    )
    state = mechanism.state(speeds={"ball": [1.0, -1.5, 2.4]})
    order = SOLVERS[solver].order
    assert order is not None
    names = tuple(
        n for n in NAMES if n != "kane-levinson-1988"
    )  # as 1990 here, and slow to compile
    if conservative:
        names = ("liu-huston",)
    first = {1: 512, 2: 2048, 3: 128, 4: 64, 5: 64, 8: 10}[order]
    sizes = []
    for steps in (first, 2 * first):
        run = dc.simulate(mechanism, state, 1.0, 1.0 / steps, solver, names)
        ledger = dc.balance(mechanism, run)
        sizes.append([np.abs(ledger.delta_c[name]).max() for name in names])
        assert min(sizes[-1]) > 1e-14 * ledger.energy_exchanged, "at rounding: choose larger steps"
    slopes = np.log2(np.array(sizes[0]) / np.array(sizes[1]))
    for name, slope in zip(names, slopes, strict=True):
        assert order - 0.3 < slope < order + 1.5, (name, slopes)


def test_solvers_cost_what_the_thesis_says_in_free_swing() -> None:
    """Euler on a pendulum: Liu–Huston's ΔC and Wang's differ (theory, figure 4.2), both of order h."""
    mechanism = pendulum()
    run = dc.simulate(mechanism, mechanism.state({"hinge": 1.0}), 2.0, 1e-3, "ode1")
    ledger = dc.balance(mechanism, run)
    wang, liu = (np.abs(ledger.delta_c[n]).max() for n in ("wang", "liu-huston"))
    assert wang > 1.2 * liu > 0.0


OWN = dc.CoordinateMap(speeds=("x", "y"), u={"i": "u.x + 2", "j": "u.y - u.x"})


def _chain(*constraints: Any) -> dc.Mechanism:
    return dc.Mechanism(
        [dc.rod("a", 1.0, 1.0), dc.rod("b", 1.0, 1.2)],
        [dc.revolute("i", "ground", "a"), dc.revolute("j", "a", "b", position=(1, 0, 0))],
        gravity=(0, -9.81, 0),
        constraints=constraints,
    )


@pytest.mark.parametrize(("simulated", "balanced"), [(None, OWN), (OWN, None)])
def test_both_sides_of_kane_levinson_are_divided_alike(simulated: Any, balanced: Any) -> None:
    """Mixed, they gave joules of a right motion; the run says which speeds its integrals are of."""
    mechanism = _chain()
    functions = ("wang", "kane-levinson-1990")
    run = dc.simulate(
        mechanism,
        mechanism.state({"i": 0.5, "j": -1.0}),
        0.2,
        1e-3,
        record=dc.Record(functions, coordinates=simulated),
    )
    if balanced is None:  # the run says which speeds its integrals are of
        assert np.abs(dc.balance(mechanism, run).delta_c["kane-levinson-1990"]).max() < 1e-9
    else:
        with pytest.raises(dc.InputError, match="coordinates: the integrals of Kane–Levinson's"):
            dc.balance(mechanism, run, coordinates=balanced)
    # Wang's function does not divide the energy, and quadrature takes both sides itself.
    others = [
        dc.balance(mechanism, run, testing=("wang",), coordinates=balanced),
        dc.balance(mechanism, run, work="samples", coordinates=balanced),
        dc.balance(mechanism, run, coordinates=simulated),
    ]
    for ledger in others:
        for delta_c in ledger.delta_c.values():
            assert np.abs(delta_c).max() < 1e-9  # ode5 at h = 1e-3, 20 J exchanged
