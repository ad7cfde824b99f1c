"""The triple pendulum in Drake: a continuous MultibodyPlant, steps of one length, a log of every state."""

from __future__ import annotations

from collections.abc import Iterator

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder, TriggerType
from pydrake.systems.primitives import LogVectorOutput

from peers.rival import ALONG, Array, Pendulum, Rival

METHODS = {"runge_kutta3": (3, 3), "runge_kutta5": (5, 7)}
"""Drake's name of a method -> its order, and the accelerations it evaluates in a step."""


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """Its usual method, of third order, and the one of fifth order that is ours too."""
    for method, (order, evaluations) in METHODS.items():
        name = f"Drake {method}"
        run, note = Drake(pendulum, method).run, "VectorLogSink: t, q, u"
        yield Rival(name, run, pendulum.steps, order, evaluations, note)


class Drake:
    """A simulator that is set back to the start before each run."""

    def __init__(self, pendulum: Pendulum, method: str) -> None:
        self.pendulum, self.plant = pendulum, _plant(pendulum)
        builder = DiagramBuilder()
        builder.AddSystem(self.plant)
        self.sink = LogVectorOutput(
            self.plant.get_state_output_port(), builder, publish_triggers={TriggerType.kPerStep}
        )
        self.simulator = Simulator(builder.Build())
        integrator = ResetIntegratorFromFlags(self.simulator, method, pendulum.step)
        integrator.set_fixed_step_mode(True)

    def run(self) -> Array:
        """From the start to the end; the joint angles after every step, (steps, 3)."""
        context = self.simulator.get_mutable_context()
        state = self.plant.GetMyMutableContextFromRoot(context)
        context.SetTime(0.0)
        self.plant.SetPositions(state, self.pendulum.q)
        self.plant.SetVelocities(state, self.pendulum.u)
        log = self.sink.FindMutableLog(context)
        log.Clear()
        self.simulator.Initialize()
        self.simulator.AdvanceTo(self.pendulum.duration)
        # The first column is the start; times add up to a little less than the end, hence one more step.
        return log.data()[:3, 1 : self.pendulum.steps + 1].T


def _plant(pendulum: Pendulum) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    above = plant.world_frame()
    bars = zip(pendulum.masses, pendulum.lengths, pendulum.inertias, pendulum.offsets)
    for n, (m, l, I, offset) in enumerate(bars, 1):
        inertia = SpatialInertia.MakeFromCentralInertia(
            m, [0.0, -l / 2, 0.0], RotationalInertia(I, ALONG, I)
        )
        bar = plant.AddRigidBody(f"bar{n}", inertia).body_frame()
        place = FixedOffsetFrame(f"pin{n}", above, RigidTransform([0.0, -offset, 0.0]))
        pin = plant.AddFrame(place)
        plant.AddJoint(RevoluteJoint(f"joint{n}", pin, bar, [0.0, 0.0, 1.0], 0.0))
        above = bar
    plant.mutable_gravity_field().set_gravity_vector([0.0, -pendulum.gravity, 0.0])
    plant.Finalize()
    return plant
