"""Studies of MuJoCo: the order of each of its integrators, contacts, models that were not simulated."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from deltac.recorders import integrator_names  # noqa: E402
from deltac.recorders.mujoco_recorder import MUJOCO_ORDERS  # noqa: E402
from tests.support.slow import repeated  # noqa: E402
from tests.systems.mujoco_models import ARM, HOPPER, model_of  # noqa: E402


def start(model: Any) -> Any:
    data = mujoco.MjData(model)
    data.qpos[:2] = [0.3, 0.2]
    return data


@pytest.mark.long
@pytest.mark.parametrize("name", repeated(integrator_names(), "euler", "rk4"))
def test_every_integrator_shows_its_order(name: str) -> None:
    """In the state to ± 0.15, of ΔC between p and p + 1: smooth forces, no controls."""
    model, order = model_of(ARM), MUJOCO_ORDERS[name]
    h = 1e-2 if order > 1 else 2e-3
    found = dc.study(model, start(model), 0.4, (h, h / 2, h / 4), f"mujoco:{name}")
    assert found.nominal == order
    assert found.observed_order["state"].order == pytest.approx(order, abs=0.15)
    energy = found.observed_order["wang"]
    assert energy.trend == "falls to zero"
    assert energy.order is not None
    assert order - 0.15 <= energy.order <= order + 1.15
    assert found.verdict.kind == ("consistent" if order > 1 else "integration-error")
    assert found.residuals is not None and found.residuals.closes


def test_a_state_of_the_imported_mechanism_will_do() -> None:
    mechanism, _ = dc.read_mechanism(model_of(ARM))
    state = mechanism.state(dict(zip(mechanism.coordinates.names, (0.3, 0.2))))
    simulator = dc.mujoco_simulator(model_of(ARM), 0.4, integrator="RK4", state=state)
    run = simulator(0.01)
    np.testing.assert_array_equal(run.q[0], [0.3, 0.2])
    assert (simulator.solver, simulator.order) == ("mujoco:rk4", 4)
    found = dc.study(mechanism, runs=simulator, steps=(0.01, 0.005))
    assert found.solver == "mujoco:rk4"
    assert found.verdict.kind == "consistent"


@pytest.mark.long
def test_controls_are_held_over_a_step() -> None:
    model = model_of(ARM)

    def control(_: Any, data: Any) -> None:
        data.ctrl[:] = [0.3 * np.sin(3 * data.time), 0.1 * np.cos(5 * data.time)]

    found = dc.study(model, start(model), 0.4, (8e-3, 4e-3, 2e-3), "mujoco:rk4", controller=control)
    assert found.observed_order["state"].order == pytest.approx(1.0, abs=0.15)
    assert "order-below-nominal" in {f.kind for f in found.findings}
    assert found.verdict.kind in ("consistent", "integration-error", "unresolved")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["euler", "implicitfast"])
def test_contacts_accuse_nobody(name: str) -> None:
    found = dc.study(model_of(HOPPER), None, 0.6, (4e-3, 2e-3, 1e-3), f"mujoco:{name}")
    assert found.verdict.kind in ("integration-error", "unresolved", "consistent")


LOOP = """<mujoco><option gravity="0 0 -9.81"><flag contact="disable"/></option><worldbody>
 <body><joint name="crank" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/>
  <body name="coupler" pos="0 0 0.2"><joint name="pin" axis="0 1 0"/>
   <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02"/></body></body>
 <body name="rocker" pos="0.4 0 0"><joint name="rocker" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/></body></worldbody>
 <equality><connect name="tip" body1="coupler" body2="rocker" anchor="0.4 0 0"/></equality></mujoco>"""


@pytest.mark.long
def test_a_soft_constraint_that_the_model_lacks_is_a_force_of_the_log() -> None:
    model = model_of(LOOP)
    data = mujoco.MjData(model)
    data.qvel[:] = 3.0, -3.0, 3.0
    simulator = dc.mujoco_simulator(model, 0.5, integrator="rk4", state=data)
    found = dc.study(model, runs=simulator, steps=(4e-3, 2e-3, 1e-3))
    assert found.residuals is not None and found.residuals.closes
    assert found.verdict.kind != "equation-error"


def test_another_model_than_the_simulated_one() -> None:
    heavier = copy.copy(model_of(ARM))
    heavier.body_mass[2] *= 1.02
    simulator = dc.mujoco_simulator(model_of(ARM), 0.4, state=start(model_of(ARM)))
    found = dc.study(heavier, runs=simulator, steps=(0.01, 0.005, 0.0025))
    assert found.verdict.kind == "equation-error"
    assert "tends to" in found.verdict.meaning


def test_unusable_arguments() -> None:
    mechanism, _ = dc.read_mechanism(model_of(ARM))
    with pytest.raises(InputError, match="did you mean 'rk4'"):
        dc.mujoco_simulator(model_of(ARM), 1.0, integrator="rk5")
    with pytest.raises(InputError, match="found Mechanism, expected an mjModel"):
        dc.study(mechanism, None, 1.0, (0.01,), "mujoco:rk4")
    other = dc.Mechanism([dc.point_mass("b", 1.0)], [dc.prismatic("x", "ground", "b", "x")])
    with pytest.raises(InputError, match="give state= as an mjData"):
        dc.mujoco_simulator(model_of(ARM), 1.0, state=other.state())
    with pytest.raises(InputError, match="its own equations"):
        dc.study(model_of(ARM), None, 1.0, (0.01,), "mujoco:rk4", equations=lambda t, q, u: u)
