"""Batches of MJX as episodes. JAX is too large for the test extra: run where it happens to be installed."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.importers import read_mechanism
from deltac.recorders import record_batch, run_mujoco
from tests.recorders import models

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")


class Batch:
    """What a batch looks like from outside: MuJoCo itself, world by world."""

    def __init__(self, model: Any, worlds: list[Any]) -> None:
        for name in (
            *("time", "qpos", "qvel", "qfrc_smooth", "qfrc_bias", "qfrc_passive", "qfrc_actuator"),
            *("qfrc_constraint", "qfrc_fluid", "qfrc_gravcomp"),
        ):
            setattr(self, name, np.array([getattr(data, name) for data in worlds]))


def started(model: Any) -> list[Any]:
    return [models.started(model, speed) for speed in (0.2, 0.5, 1.0)]


@pytest.mark.parametrize("integrator", ["euler", "implicitfast"])
def test_episodes_are_what_the_recorder_of_single_runs_says(integrator: str) -> None:
    model = models.compiled(models.WALKER)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    worlds = started(model)
    rec = record_batch(model, Batch(model, worlds), worlds=[0, 2])
    for _ in range(200):
        for data in worlds:
            mujoco.mj_step(model, data)
        rec.sample(Batch(model, worlds))
    runs = rec.episodes()
    mechanism = read_mechanism(model)[0]
    assert len(runs) == 2 and len(runs[0]) == 200
    for run, start in zip(runs, (0.2, 1.0)):
        single = run_mujoco(model, 0.4, data=models.started(model, start))
        assert np.array_equal(run.q, single.q[:-1])
        assert np.abs(dc.residuals(mechanism, run)["coordinates"]).max() < 1e-8
        ours, theirs = (
            dc.balance(mechanism, r, work="discrete", testing=("wang",)).uncorrected("wang")
            for r in (run, single)
        )
        # The single run logs dampers; the difference is their work at the start of a step.
        assert np.abs(ours - theirs[:-1]).max() < 0.02 * np.abs(theirs).max() + 1e-3


def test_a_reset_begins_an_episode() -> None:
    model = models.compiled(models.CARTS)
    worlds = started(model)
    rec = record_batch(model, Batch(model, worlds))
    for k in range(30):
        if k == 12:
            mujoco.mj_resetData(model, worlds[1])
            rec.sample(Batch(model, worlds))
        for data in worlds:
            mujoco.mj_step(model, data)
        rec.sample(Batch(model, worlds))
    assert [len(run) for run in rec.episodes()] == [30, 12, 18, 30]


def test_what_cannot_be_recorded() -> None:
    model = models.compiled(models.CARTS)
    worlds = started(model)
    with pytest.raises(InputError, match="batch"):
        record_batch(model, worlds[0])
    with pytest.raises(InputError, match="no world 3"):
        record_batch(model, Batch(model, worlds), worlds=[3])
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(InputError, match="RK4"):
        record_batch(model, Batch(model, worlds))


@cache
def recorded(step: float) -> Any:
    """A driven swinger in three worlds, by MJX in double precision."""
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    mjx = pytest.importorskip("mujoco.mjx", reason="mujoco-mjx is not installed")
    jax.config.update("jax_enable_x64", True)
    model = models.compiled(models.SWINGER)
    model.opt.timestep = step
    device = mjx.put_model(model)
    speeds = jax.numpy.array([data.qvel for data in started(model)])
    start = mjx.make_data(device)
    batch = jax.vmap(lambda v: start.replace(qvel=v, ctrl=jax.numpy.array([0.3])))(speeds)
    advance = jax.jit(jax.vmap(mjx.step, in_axes=(None, 0)))
    rec = record_batch(model, batch)
    for _ in range(round(0.4 / step)):
        batch = advance(device, batch)
        rec.sample(batch)
    return model, rec.episodes()


def test_mjx_closes_at_the_order_of_its_integrator() -> None:
    errors = []
    for step in (4e-3, 2e-3):
        model, runs = recorded(step)
        mechanism = read_mechanism(model)[0]
        assert len(runs) == 3
        ledgers = [dc.balance(mechanism, run, work="discrete", testing=("wang",)) for run in runs]
        errors.append([float(np.abs(ledger.uncorrected("wang")).max()) for ledger in ledgers])
        for run in runs:
            assert np.abs(dc.residuals(mechanism, run)["coordinates"]).max() < 1e-8
    slopes = np.log2(np.array(errors[0]) / errors[1])
    assert ((slopes > 0.8) & (slopes < 1.3)).all(), errors


def test_a_planted_fault_in_mjx_is_named() -> None:
    model, runs = recorded(2e-3)
    heavier = models.compiled(models.SWINGER.replace('mass="0.7"', 'mass="0.8"'))
    assert dc.audit(read_mechanism(heavier)[0], runs[2]).verdict.kind == "equation-error"
    assert dc.audit(read_mechanism(model)[0], runs[2]).verdict.kind != "equation-error"
