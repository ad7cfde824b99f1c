"""Recorded MuJoCo runs in the ledger: the bookkeeping closes, and K + V − Q shows the integrator."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import deltac as dc
from deltac.importers import read_mechanism
from deltac.recorders import integrator_names, run_mujoco
from deltac.trajectories import Trajectory
from tests.recorders import models
from tests.support.slow import repeated

pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")

Array = NDArray[Any]
ONE_STEP = [name for name in integrator_names() if name != "rk4"]
ROUNDING = 1e-13  # of the energy, for sums over a few hundred steps


@cache
def model_and_mechanism(name: str) -> tuple[Any, dc.Mechanism]:
    model = models.compiled(getattr(models, name))
    return model, read_mechanism(model)[0]


def recorded(name: str, integrator: str, duration: float, **options: Any) -> Trajectory:
    model, _ = model_and_mechanism(name)
    start = models.started(model, 10.0 if name == "TUMBLER" else 0.5)
    return run_mujoco(model, duration, data=start, integrator=integrator, **options)


def change_of_mass_matrix(name: str, run: Trajectory) -> Array:
    """Σ ½ u_{k+1}ᵀ (M_{k+1} − M_k) u_{k+1}, with MuJoCo's own mass matrix: all that may be left."""
    M = [models.mass_matrix(model_and_mechanism(name)[0], q) for q in run.q]
    parts = [0.5 * u @ (after - before) @ u for before, after, u in zip(M, M[1:], run.u[1:])]
    return np.concatenate([[0.0], np.cumsum(parts)])


def bookkeeping(name: str, run: Trajectory) -> tuple[float, float]:
    """What is left of K − work once the change of M is taken off, and the energy that was there."""
    ledger = dc.balance(model_and_mechanism(name)[1], run, work="discrete")
    left = ledger.delta_c["liu-huston"] - change_of_mass_matrix(name, run)
    return float(np.abs(left).max()), max(ledger.energy_exchanged, float(ledger.kinetic.max()))


@pytest.mark.parametrize(
    "case",
    repeated(
        [
            (n, i)
            for n in ("TUMBLER", "CARTS", "SWINGER", "ARM", "WALKER", "MOST")
            for i in ONE_STEP
        ],
        *[("MOST", i) for i in ONE_STEP],
        *[(n, "implicitfast") for n in ("TUMBLER", "CARTS", "SWINGER", "ARM", "WALKER")],
    ),
)
def test_the_bookkeeping_closes(case: tuple[str, str]) -> None:
    name, integrator = case
    run = recorded(name, integrator, 0.3, controller=models.sine)
    left, energy = bookkeeping(name, run)
    assert left <= ROUNDING * energy


@pytest.mark.parametrize("integrator", repeated(["euler", "implicitfast"], "implicitfast"))
def test_the_bookkeeping_of_a_passive_humanoid_in_contact(integrator: str) -> None:
    run = recorded("HUMANOID", integrator, 0.4)
    touching = sum(np.abs(f).sum() for name, f in run.forces.items() if name.startswith("contact"))
    assert touching > 0.0
    left, energy = bookkeeping("HUMANOID", run)
    assert left <= ROUNDING * energy


def test_what_the_runs_are_about() -> None:
    walker = recorded("WALKER", "implicitfast", 0.3, controller=models.sine)
    assert any(name.startswith("contact floor:") for name in walker.forces)
    assert any(name.startswith("limit") for name in walker.forces)
    arm = recorded("ARM", "implicitfast", 0.3, controller=models.sine)
    needed = {"constraint tip", "actuator pull", "spring biceps", "damper biceps", "friction crank"}
    assert needed <= {*arm.forces}


@pytest.mark.parametrize("integrator", ONE_STEP)
def test_with_a_constant_mass_matrix_it_closes_by_itself(integrator: str) -> None:
    run = recorded("CARTS", integrator, 0.5, controller=models.sine)
    ledger = dc.balance(model_and_mechanism("CARTS")[1], run, work="discrete")
    assert np.abs(ledger.delta_c["liu-huston"]).max() <= ROUNDING * ledger.energy_exchanged
    # An identity of the scheme says nothing of its accuracy; K + V − Q does.
    assert ledger.relative("wang") > 1e-4


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("ARM", "constraint tip"),
        ("ARM", "actuator pull"),
        ("ARM", "friction crank"),
        ("WALKER", "correction implicit"),
        ("WALKER", "contact floor:left_foot"),
    ],
)
def test_a_channel_withheld_shows_at_once(name: str, channel: str) -> None:
    run = recorded(name, "implicitfast", 0.3, controller=models.sine)
    less = replace(run, forces={n: f for n, f in run.forces.items() if n != channel})
    if channel.startswith("actuator"):  # the mechanism has no motor law to fall back on
        less = replace(less, forces={**less.forces, channel: 0.0 * run.forces[channel]})
    left, energy = bookkeeping(name, less)
    assert left > 1e-6 * energy


ORDERS = {"rk4": (3.8, 5.2)}
"""Everything else is of first order. For a linear system RK4's energy error is one order higher."""


@pytest.mark.long
@pytest.mark.parametrize(
    "case",
    repeated(
        [(name, by) for name in ("TUMBLER", "CARTS", "SWINGER") for by in integrator_names()],
        *[("TUMBLER", by) for by in integrator_names()],
        *[("CARTS", "rk4"), ("SWINGER", "euler")],
    ),
)
def test_the_energy_error_falls_with_the_order_of_the_integrator(case: tuple[str, str]) -> None:
    """Smooth, without contact: K + V − Q by quadrature along the samples, two halvings."""
    name, integrator = case
    mechanism = model_and_mechanism(name)[1]
    control = None if name == "TUMBLER" else lambda model, data: data.ctrl.fill(0.3)
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        run = recorded(name, integrator, 0.4, controller=control, step=step)
        ledger = dc.balance(mechanism, run, work="samples", testing=("wang",))
        errors.append(float(np.abs(ledger.delta_c["wang"]).max()))
        assert float(ledger.error_bar["wang"].max()) < errors[-1]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    least, most = ORDERS.get(integrator, (0.9, 1.2))
    assert ((slopes > least) & (slopes < most)).all(), (errors, slopes)


@pytest.mark.parametrize("integrator", [*integrator_names()])
def test_rows_satisfy_the_equations_of_motion(integrator: str) -> None:
    """F_r + F*_r = 0 at every sample, with u̇ and the forces as recorded."""
    run = recorded("WALKER", integrator, 0.2, controller=models.sine)
    left = dc.residuals(model_and_mechanism("WALKER")[1], run)["coordinates"]
    assert run.udot is not None
    # Speeds' differences lose digits: eps |u| / h, times the mass.
    assert np.abs(left).max() <= 1e-9 * max(np.abs(f).max() for f in run.forces.values())
