"""Other parameters of MuJoCo's model by which it reproduces a log that it misses; the truth is in the XML."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.codes import finding_code
from tests.support.slow import repeated

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")

HOPPER = """<mujoco><option timestep="0.002" integrator="{integrator}"/><worldbody>
  <geom name="floor" type="plane" size="9 9 .1" pos="0 0 {floor}" friction="{friction} .005 .0001"/>
  <body name="trunk" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/>
    <joint name="z" type="slide" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".05" mass="{trunk}"/>
    <body name="leg"><joint name="hip" axis="0 1 0" damping="{damping}" range="-60 60" limited="true"/>
      <geom name="shank" type="capsule" fromto="0 0 0 0 0 -.5" size=".04" mass="1"/>
      <geom name="foot" type="capsule" fromto="-.06 0 -.5 .14 0 -.5" size=".05" mass=".4"/></body></body>
</worldbody><actuator><motor name="drive" joint="hip" gear="{gear}"/></actuator></mujoco>"""
TRUE = {"floor": 0.0, "friction": 1.5, "trunk": 3.0, "damping": 0.8, "gear": 20.0}


def hopper(integrator: str = "Euler", **other: float) -> Any:
    """A leg that falls on a floor, with some numbers of its own."""
    return mujoco.MjModel.from_xml_string(HOPPER.format(integrator=integrator, **TRUE | other))


def hops(model: Any, every: int = 4, push: float = 0.0, rows: int = 100) -> dict[str, Any]:
    """Rows with the controls that are held until the next, as of a Gymnasium environment."""
    data, log = mujoco.MjData(model), []
    data.qpos[:] = 0.0, -0.4, 0.1, -0.3
    rng = np.random.default_rng(1)
    for k in range(rows):
        data.ctrl[:] = np.sin(0.15 * k)
        log.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
        data.xfrc_applied[1, 0] = push * rng.standard_normal()
        mujoco.mj_step(model, data, every)
    return dict(zip(("time", "qpos", "qvel", "ctrl"), map(np.array, zip(*log)), strict=True))


def codes(found: Any) -> set[str]:
    return {f.code for f in found.verdict.findings}


@pytest.mark.parametrize("integrator", repeated(("RK4", "Euler", "implicitfast"), "RK4"))
def test_a_wrong_mass_is_named_between_contacts_and_limits(integrator: str) -> None:
    found = dc.audit(hopper(integrator, trunk=2.85), hops(hopper(integrator)))
    assert found.verdict.kind == "equation-error"
    assert finding_code("identified") in codes(found)
    (cause,) = found.causes
    assert cause.kind in ("body-inertia", "body-mass") and cause.element == "trunk"
    assert cause.size == pytest.approx(3.0 / 2.85, abs=1e-4)
    # By the same forces, ΔC of two models differs by the energy of the mass that one of them lacks.
    right = dc.audit(hopper(integrator), hops(hopper(integrator)))
    lacking = energy(hopper(), found.run) - energy(hopper(trunk=2.85), found.run)
    assert found.attribution is not None and right.attribution is not None
    told = found.attribution.equations.energy + found.attribution.integrator.energy
    beyond = told - right.attribution.integrator.energy
    assert beyond == pytest.approx(lacking[0] - lacking[-1], rel=1e-9)


def energy(model: Any, run: dc.Trajectory) -> Any:
    """MuJoCo's own K + V (T,) of the rows of a run, J."""
    data, joules = mujoco.MjData(model), []
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    for data.qpos[:], data.qvel[:] in zip(run.q, run.u, strict=True):
        mujoco.mj_forward(model, data)
        joules.append(data.energy.sum())
    return np.array(joules)


@pytest.mark.parametrize(
    ("name", "wrong", "what", "element"),
    [
        pytest.param("damping", 1.0, "damping", "hip", marks=pytest.mark.slow),
        ("floor", 0.003, "place (z)", "floor"),
        pytest.param("friction", 1.2, "friction", "floor|foot", marks=pytest.mark.slow),
        ("gear", 21.0, "gear", "drive"),
    ],
)
def test_parameters_by_which_the_simulator_reproduces_the_log(
    name: str, wrong: float, what: str, element: str
) -> None:
    """Each is what the run had; contacts and gears are of no mechanism, and are told all the same."""
    found = dc.audit(hopper("Euler", **{name: wrong}), hops(hopper()))
    (told,) = (f for f in found.verdict.findings if f.kind == "identified")
    # Where one geom touches the floor, friction is of either.
    assert re.match(element, told.element)
    number = float(told.what.split(f"{what} of {told.element!r}: ")[1].split(",")[0])
    assert number == pytest.approx(TRUE[name], abs=1e-4)
    assert found.verdict.kind == "equation-error"


def test_a_right_log_of_contacts_is_decided() -> None:
    """Where nothing is lost between rows a variance was less than zero, and the odds were no numbers."""
    found = dc.audit(hopper(), hops(hopper()))
    assert found.verdict.kind == "integration-error" and finding_code("replayed") in codes(found)
    assert sum(found.odds.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("trunk", repeated((3.0, 2.85), 2.85))
def test_no_parameters_reproduce_what_pushes_did(trunk: float) -> None:
    """Pushes at random reach all rows: nothing is identified, and nobody accused."""
    found = dc.audit(hopper(trunk=trunk), hops(hopper(), push=5.0))
    assert finding_code("identified") not in codes(found)
    assert found.verdict.kind != "equation-error"


def test_controls_that_may_be_scaled_accuse_no_gear() -> None:
    log = hops(hopper())
    log["action"] = log.pop("ctrl") * 20.0 / 21.0
    found = dc.audit(hopper(), log)
    assert finding_code("identified") not in codes(found)
    assert found.verdict.kind != "equation-error"


@pytest.mark.parametrize(
    ("integrator", "step"), [("RK4", 0.002), pytest.param("Euler", 0.004, marks=pytest.mark.slow)]
)
def test_a_log_of_another_integrator_or_step_is_judged_as_it_was_run(
    integrator: str, step: float
) -> None:
    """Options of a solver are no equations."""
    ran = hopper(integrator)
    ran.opt.timestep = step
    found = dc.audit(hopper(), hops(ran, every=round(0.008 / step)))
    assert finding_code("identified") in codes(found)
    assert found.verdict.kind in ("consistent", "integration-error") and not found.causes
    assert found.run.t[1] - found.run.t[0] == pytest.approx(step)


@pytest.mark.parametrize("decimals", [4, 6])
def test_contacts_spread_what_the_digits_of_rows_leave_open(decimals: int) -> None:
    """Rows are missed by more than their digits, and not by more than states within these."""
    log = hops(hopper())
    rounded = {name: np.round(values, decimals) for name, values in log.items()}
    found = dc.audit(hopper(), rounded | {"time": log["time"], "ctrl": log["ctrl"]})
    assert finding_code("replayed") in codes(found)
    assert found.verdict.kind != "equation-error"


def test_rows_of_five_decimals_identify_to_their_digits() -> None:
    """What the digits leave of the rows is more than a thousandth of what the mistake does."""
    log = hops(hopper())
    rounded = {name: np.round(log[name], 5) for name in ("qpos", "qvel")}
    found = dc.audit(hopper(trunk=2.85), log | rounded)
    assert finding_code("identified") in codes(found)
    (told,) = (f for f in found.verdict.findings if f.kind == "identified")
    assert told.element == "trunk"
