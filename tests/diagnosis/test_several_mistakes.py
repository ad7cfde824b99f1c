"""Several mistakes: dampers and rotors that files leave out of all joints, a damper that acts elsewhere.

Sliders in series with springs are linear in relative coordinates, M = TᵀmT + rotors: rows are those of the
matrix exponential, works are closed forms of the speeds. Nothing in the logs is of deltac.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.linalg import expm

import deltac as dc
from deltac.arrays import Array

pytestmark = pytest.mark.case_study

H, STEPS, FINER = 0.01, 400, 8
MASSES, STIFFNESS = np.array([1.2, 0.8, 1.7, 0.6]), np.array([60.0, 35.0, 50.0, 25.0])
ROTORS, DAMPING = np.array([0.26, 0.11, 0.33, 0.21]), np.array([0.2, 0.33, 0.19, 0.24])
NAMES = ("s0", "s1", "s2", "s3")

MECHANISM = dc.Mechanism(
    [dc.body(f"b{k}", m, (0.1, 0.1, 0.1)) for k, m in enumerate(MASSES)],
    [
        dc.prismatic(s, f"b{k - 1}" if k else "ground", f"b{k}", axis="x", stiffness=STIFFNESS[k])
        for k, s in enumerate(NAMES)
    ],
    gravity=(0, 0, 0),
)


T = np.tril(np.ones((len(MASSES),) * 2))
"""Velocities of the bodies by those of the sliders."""


def motion(rotors: Array, damping: Array) -> tuple[dc.Trajectory, float]:
    """Rows of the machine with rotors and a matrix of dampers, and what a model without them lacks, J."""
    n = len(MASSES)
    M = T.T @ np.diag(MASSES) @ T + np.diag(rotors)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:] = -np.linalg.solve(M, np.hstack([np.diag(STIFFNESS), damping]))
    step, x = expm(A * H / FINER), np.zeros((FINER * STEPS + 1, 2 * n))
    x[0, :n] = 0.1, -0.15, 0.05, 0.2
    for k in range(FINER * STEPS):
        x[k + 1] = step @ x[k]
    u = x[:, n:]
    of_dampers = -float(simpson(np.einsum("ki,ij,kj->k", u, damping, u), dx=H / FINER))
    of_rotors = -0.5 * float(rotors @ (u[-1] ** 2 - u[0] ** 2))
    rows = x[::FINER]
    log = dc.Trajectory(
        t=H * np.arange(STEPS + 1.0), q=rows[:, :n], u=rows[:, n:], coordinates=NAMES, speeds=NAMES
    )
    return log, of_dampers + of_rotors


@pytest.mark.parametrize(
    ("rotors", "damping"), [(ROTORS, 0.0 * DAMPING), (0.0 * ROTORS, DAMPING), (ROTORS, DAMPING)]
)
def test_what_is_missing_in_every_joint_is_named_in_each(rotors: Array, damping: Array) -> None:
    log, joules = motion(rotors, np.diag(damping))
    audit = dc.audit(MECHANISM, log)
    assert audit.verdict.kind == "equation-error" and audit.attribution is not None
    kinds = {"missing-rotor-inertia": rotors, "missing-damper": damping}
    true = {(k, s): x for k, all_ in kinds.items() for s, x in zip(NAMES, all_) if x}
    told = {(c.kind, c.element): c.size for c in audit.causes}
    assert told.keys() == true.keys()
    assert told == pytest.approx(true, rel=1e-4)
    assert audit.attribution.equations.energy == pytest.approx(joules, rel=1e-4)
    assert abs(audit.attribution.integrator.energy) < 1e-6


def test_one_of_them_is_one() -> None:
    """A single damper is no mistake of all joints."""
    log, joules = motion(0.0 * ROTORS, np.diag(DAMPING * [0, 1, 0, 0]))
    audit = dc.audit(MECHANISM, log)
    assert [(c.kind, c.element) for c in audit.causes] == [("missing-damper", "s1")]
    assert audit.attribution is not None
    assert audit.attribution.equations.energy == pytest.approx(joules, rel=1e-6)


@pytest.mark.parametrize(("body", "c"), [(1, 0.4), pytest.param(3, 0.25, marks=pytest.mark.slow)])
def test_a_damper_against_the_ground(body: int, c: float) -> None:
    log, joules = motion(0.0 * ROTORS, c * np.outer(T[body], T[body]))
    audit = dc.audit(MECHANISM, log)
    assert [(x.kind, x.element) for x in audit.causes] == [("body-damping", f"b{body}")]
    assert audit.causes[0].size == pytest.approx(c, rel=1e-6) and audit.attribution is not None
    assert audit.attribution.equations.energy == pytest.approx(joules, rel=1e-6)


def test_a_damper_against_the_ground_instead_of_the_neighbour() -> None:
    """Alone, no damper explains both; drag explains most."""
    joints = [replace(j, damping=(0.3,)) if j.name == "s2" else j for j in MECHANISM.joints]
    model = replace(MECHANISM, joints=joints)
    log, joules = motion(0.0 * ROTORS, 0.3 * np.outer(T[2], T[2]))
    audit = dc.audit(model, log)
    told = {(x.kind, x.element): x.size for x in audit.causes}
    assert told == pytest.approx({("body-damping", "b2"): 0.3, ("damping", "s2"): 0.0}, abs=1e-6)
    own = -float(simpson(0.3 * log.u[:, 2] ** 2, dx=H))
    assert audit.attribution is not None
    assert audit.attribution.equations.energy == pytest.approx(joules - own, rel=1e-3)


def test_damping_of_all_bodies() -> None:
    """Engines that multiply velocities by 1 − k h take momentum in proportion to masses."""
    log, joules = motion(0.0 * ROTORS, 0.05 * T.T @ np.diag(MASSES) @ T)
    audit = dc.audit(MECHANISM, log)
    (cause,) = audit.causes
    assert (cause.kind, cause.element) == ("velocity-decay", "all bodies")
    assert cause.size == pytest.approx(0.05, rel=1e-6)
    assert "a linear damping of velocities" in str(cause) and audit.attribution is not None
    assert audit.attribution.equations.energy == pytest.approx(joules, rel=1e-6)
