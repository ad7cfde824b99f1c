"""Accelerations and closing forces of loop mechanisms against Pinocchio's constraint dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import deltac as dc
from deltac.dynamics.forces import channels
from deltac.dynamics.terms import forward
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from tests.systems.constrained_mechanisms import Tied
from tests.systems.linkages import linkage
from tests.systems.random_mechanisms import Sample, assert_close

pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed on this platform")

Array = NDArray[Any]


def spatial_loop() -> tuple[Mechanism, State]:
    """Six bodies on skew hinges and slides; the last is held to the ground by a ball joint."""
    rng = np.random.default_rng(4)
    bodies = [
        dc.body(f"b{k}", float(rng.uniform(0.5, 2)), tuple(rng.uniform(0.1, 0.15, 3)),
                rng.normal(0, 0.1, 3))
        for k in range(6)
    ]  # fmt: skip
    joints = [
        (dc.prismatic if k == 3 else dc.revolute)(
            f"j{k}",
            "ground" if k == 0 else f"b{k - 1}",
            f"b{k}",
            tuple(rng.normal(size=3)),
            position=rng.normal(0, 0.5, 3),
        )
        for k in range(6)
    ]
    closure = dc.constraints.loop_spherical(
        "closure", "ground", "b5", point1=[0.6, 0.2, 0.4], point2=[0.3, -0.2, 0.1]
    )
    mechanism = Mechanism(bodies, joints, constraints=[closure], gravity=[0.5, 0, -9.81])
    names = mechanism.coordinates.names
    guess = mechanism.state(
        dict(zip(names, rng.normal(size=6))), dict(zip(names, rng.normal(size=6)))
    )
    return mechanism, dc.assemble(mechanism, guess).state


def in_pinocchio(mechanism: Mechanism) -> tuple[Any, dict[str, int]]:
    """A tree of hinges and slides; our body frames are its joint frames."""
    model, places = pin.Model(), {"ground": 0}
    model.gravity.linear = np.array(mechanism.gravity)
    for joint in mechanism.joints:
        made = {
            "revolute": pin.JointModelRevoluteUnaligned,
            "prismatic": pin.JointModelPrismaticUnaligned,
        }[joint.kind](np.array(joint.axes[0]))
        at = pin.SE3(np.array(joint.rotation), np.array(joint.position, dtype=float))
        index = model.addJoint(places[joint.parent], made, at, joint.name)
        body = mechanism.body(joint.child)
        inertia = pin.Inertia(
            body.mass, np.array(body.mass_centre, dtype=float), np.array(body.inertia)
        )
        model.appendBodyToJoint(index, inertia, pin.SE3.Identity())
        places[joint.child] = index
    return model, places


@pytest.mark.parametrize("make", [linkage, spatial_loop])
def test_constraint_dynamics(make: Any) -> None:
    """The same loop closed by Pinocchio's point constraint: u̇ and the closure's generalized force.

    Its proximal iteration stops at 1e-10, hence 1e-9.
    """
    mechanism, state = make()
    tied = Tied(Sample(mechanism, 0.0, state.q, state.u, np.zeros(len(state.u))))
    motion = forward(tied.system, channels(tied.system), tied.bound)
    udot, lam = (v[:, 0] for v in tied.evaluate(motion.udot, motion.multipliers))
    (closure,) = mechanism.constraints
    model, places = in_pinocchio(mechanism)
    one = np.eye(3)
    loop = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_3D,
        model,
        places[closure.body1],
        pin.SE3(one, np.array(closure.point1)),
        places[closure.body2],
        pin.SE3(one, np.array(closure.point2)),
        pin.ReferenceFrame.LOCAL,
    )
    data, closed = model.createData(), loop.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    models.append(loop)
    datas.append(closed)
    pin.initConstraintDynamics(model, data, models, datas)
    # μ regularises the planar loop's third row, which vanishes; iterations take its effect away.
    settings = pin.ProximalSettings(1e-14, 1e-10, 100)
    expected = pin.constraintDynamics(
        model, data, state.q, state.u, np.zeros(len(udot)), models, datas, settings
    )
    assert_close(udot, expected, 1e-9)
    # What Pinocchio's inverse dynamics says the closure must do, against Gᵀλ.
    needed = np.array(pin.rnea(model, data, state.q, state.u, np.array(expected)))
    force = tied.evaluate(tied.bound.rows.G)[0].T @ lam
    assert_close(force, needed, 1e-9)
