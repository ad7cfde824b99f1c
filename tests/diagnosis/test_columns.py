"""The columns of an explanation against mechanisms that are really changed.

The residual of a changed mechanism, less that of the first, must be the columns' sum: inertial
parameters enter linearly, so that equality is to rounding, however large the change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.causes.causes import Candidate, candidates
from deltac.diagnosis.causes.columns import LogEquations, column_kernels
from deltac.diagnosis.inference.hypotheses import fitted
from deltac.diagnosis.inference.inference import infer, likeliest
from deltac.diagnosis.inference.linearisation import start
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import observations
from deltac.diagnosis.measurements.digits import white_noise
from tests.support.rate_forms import without_forces

INERTIA = ((0.05, 0.01, -0.004), (0.01, 0.08, 0.002), (-0.004, 0.002, 0.06))


def machine(
    mass: float = 1.3,
    centre: tuple[float, float, float] = (0.1, -0.05, 0.2),
    scale: float = 1.0,
    gravity: float = 9.81,
    damping: float = 0.0,
    armature: float = 0.0,
) -> dc.Mechanism:
    """A floating body with a limb on a turned hinge; the limb has the properties given."""
    inertia = [[scale * x for x in row] for row in INERTIA]
    return dc.Mechanism(
        bodies=[dc.bodies.box("hull", 2.0, (0.3, 0.2, 0.1)), dc.body("limb", mass, inertia, centre)],
        joints=[
            dc.free("root", "hull"),
            dc.revolute(
                "hip", "hull", "limb", axis=(1, 2, 2), position=(0.1, 0.1, 0),
                damping=damping, armature=armature,
            ),
        ],
        gravity=(0, 0, -gravity),
    )  # fmt: skip


def states(mechanism: dc.Mechanism) -> dc.Trajectory:
    rng = np.random.default_rng(3)
    q = rng.standard_normal((30, 8))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    return dc.Trajectory(
        t=np.arange(30.0), q=q, u=rng.standard_normal((30, 7)), udot=rng.standard_normal((30, 7)),
        coordinates=mechanism.coordinates.names, speeds=mechanism.speeds.names,
        provenance=dc.Provenance("random states"),
    )  # fmt: skip


def residual(mechanism: dc.Mechanism) -> np.ndarray:
    return dc.residuals(mechanism, states(mechanism), ["wang"])["coordinates"]


CHANGES: dict[str, tuple[Callable[[], dc.Mechanism], str, tuple[float, ...]]] = {
    "mass": (lambda: machine(mass=2.6), "body-mass", (1.0,)),
    "centre": (lambda: machine(centre=(0.4, -0.25, 0.1)), "body-centre", (0.3, -0.2, -0.1)),
    "moments": (lambda: machine(scale=1.7), "body-moments", (0.7,)),
    "both": (lambda: machine(mass=1.95, scale=1.5), "body-inertia", (0.5,)),
    "gravity": (lambda: machine(gravity=4.905), "gravity", (-0.5,)),
    "damper": (lambda: machine(damping=0.4), "missing-damper", (0.4,)),
    "rotor": (lambda: machine(armature=0.3), "missing-rotor-inertia", (0.3,)),
}


@pytest.mark.parametrize("what", CHANGES)
def test_columns_are_what_a_change_does(what: str) -> None:
    changed, kind, theta = CHANGES[what]
    first = machine()
    run = states(first)
    equations = LogEquations(first, run)
    kernels = column_kernels(equations)
    found = candidates(equations, kernels.columns)

    def fits(c: Candidate) -> bool:
        return c.kind == kind and c.size == len(theta) and c.element in ("limb", "hip", "gravity")

    (cause,) = (c for c in found if fits(c))
    X = kernels(*without_forces(first, run))
    effect = X[..., [1 + k for k in cause.columns]] @ cause.coefficients(np.array(theta))
    np.testing.assert_allclose(X[..., 0], residual(first), rtol=0, atol=1e-12)
    difference = residual(changed()) - residual(first)
    assert np.abs(difference).max() > 0.1
    np.testing.assert_allclose(effect, difference, rtol=0, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    ("own", "rel"), [(True, 1e-8), pytest.param(False, 3e-3, marks=pytest.mark.slow)]
)
def test_steps_tell_what_the_samples_tell(own: bool, rel: float) -> None:
    """Along an exact motion, a cause has the same number from row to row, to what θ² leaves, as by u̇."""
    mechanism = machine(damping=0.1)
    state = mechanism.state(speeds={"root": [0, 0, 3, 0.5, 1.0, 2.0], "hip": 3.0})
    run = replace(dc.simulate(mechanism, state, 0.2, 2e-3, solver="ode8"), forces={})
    if not own:
        run = replace(run, udot=None, works={}, integrals={}, provenance=dc.Provenance("other"))
    other = replace(machine(mass=2.0), name="other")
    if own:  # u̇ is linear in both: no point but the first is needed
        model, equations = LogModel(other, run), LogEquations(other, run)
        rows = observations(model, run, len(run))
        assert rows is not None
        point = start(model, run, rows).with_candidates(equations, column_kernels(equations))
        comparison = likeliest(point)
        blocks, causes = comparison.blocks, comparison.point.candidates
    else:
        inference = infer(other, run)
        assert inference is not None
        blocks, causes = inference.blocks, inference.candidates
    kinds = [(c.kind, c.element, c.size) for c in causes]
    planted = {("body-mass", "limb", 1): 1.3 / 2.0 - 1.0, ("missing-damper", "hip", 1): 0.1}
    fit = fitted(blocks, [causes[kinds.index(k)] for k in planted])
    assert fit is not None
    np.testing.assert_allclose(np.concatenate(fit.theta), list(planted.values()), rtol=rel)


@pytest.mark.parametrize("size", [1e-8, 1e-3])
def test_noise_is_told_from_signal(size: float) -> None:
    """The deviation of 2000 numbers by the median of differences is known to a few per cent."""
    t = np.linspace(0.0, 4.0, 2000)
    signal = np.sin(7.0 * t) + 0.3 * np.cos(19.0 * t)
    rng = np.random.default_rng(5)
    noisy = signal + size * rng.standard_normal(2000)
    clean, found = white_noise(np.column_stack([signal, noisy]))
    assert clean < 1e-12
    assert found == pytest.approx(size, rel=0.15)
    coarse = np.sin(20.0 * np.linspace(0.0, 4.0, 100))
    assert white_noise(coarse[:, None]) == [0.0]  # and not noisy
    held = np.repeat(rng.standard_normal(400), 5)  # of a policy's actions, each for five steps
    assert white_noise(held[:, None]) == [0.0]
