"""What a log does not tell apart is told as a set, and slips of hand-written equations by their name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc

pytestmark = pytest.mark.case_study("test_a_mass_and_a_damper_of_a_pendulum_are_one_of_two")

G = 9.81


def pendulum(**changes: float) -> dc.Mechanism:
    """A point mass on a rod with a damper."""
    p = {"mass": 1.0, "damping": 0.1} | changes
    return dc.Mechanism(
        bodies=[dc.point_mass("bob", p["mass"], at=(0, -1.0, 0))],
        joints=[dc.revolute("pivot", "ground", "bob")],
        forces=[dc.forces.joint_damper("drag", "pivot", p["damping"])],
        gravity=(0, -G, 0),
    )


def logged(model: dc.Mechanism, **start: float) -> dc.Trajectory:
    """A run as another program would write it: without the works and forces of the model."""
    run = dc.simulate(model, model.state(start), duration=2.0, step=2e-3, solver="rk4")
    return replace(run, forces={}, works={}, integrals={}, provenance=dc.Provenance("other"))


def test_a_mass_and_a_damper_of_a_pendulum_are_one_of_two() -> None:
    """m l² α + m g l sin q + d ω = 0 tells d/m alone."""
    run = logged(pendulum(mass=1.25), pivot=1.0)
    first = dc.audit(pendulum(), run).findings[0]
    told = {(first.kind, first.element), *first.equals}
    assert {"body-mass", "damping"} <= {kind for kind, _ in told}
    assert first.what.startswith("one of these: ")


def test_beside_a_spring_that_is_known_the_damper_is_told() -> None:
    spring = dc.forces.joint_spring("spring", "pivot", 3.0)
    sprung = [
        replace(model, forces=(*model.forces, spring))
        for model in (pendulum(), pendulum(damping=0.2))
    ]
    first = dc.audit(sprung[0], logged(sprung[1], pivot=1.0)).findings[0]
    assert (first.kind, first.equals) == ("damping", ())
    assert first.factor == pytest.approx(0.2, rel=1e-4)


def test_gyroscopic_terms_that_are_missing_have_a_name() -> None:
    """ω is constant without a moment in the equations of whoever forgot ω × Jω."""
    body = dc.body("top", 1.0, inertia=(0.1, 0.2, 0.25))
    model = dc.Mechanism(bodies=[body], joints=[dc.free("root", "top")])
    t = np.linspace(0.0, 2.0, 401)
    w = np.array([0.7, -1.1, 0.9])
    half = 0.5 * np.linalg.norm(w) * t[:, None]
    turned = [np.cos(half), w / np.linalg.norm(w) * np.sin(half)]
    q = {f"root.{c}": x for c, x in zip(("qw", "qx", "qy", "qz"), np.hstack(turned).T)}
    u = {f"root.w{c}": x for c, x in zip("xyz", w)}
    run = dc.Trajectory(
        t=t,
        q=np.column_stack([q.get(n, np.zeros_like(t)) for n in model.coordinates.names]),
        u=np.column_stack([np.full_like(t, u.get(n, 0.0)) for n in model.speeds.names]),
        udot=np.zeros((len(t), 6)),
        coordinates=model.coordinates.names,
        speeds=model.speeds.names,
        provenance=dc.Provenance("by hand"),
    )
    first = dc.audit(model, run).findings[0]
    assert (first.kind, first.element) == ("gyroscopic-terms", "top")
    assert first.factor == pytest.approx(0.0, abs=1e-6)
