"""Andrews' squeezer in Exudyn: seven rigid bodies in the plane, ten pins, a spring and a torque.

Exudyn's explicit methods take no joints between bodies. Of its implicit ones the trapezoidal rule with
constraints on speeds needs the fewest steps; planar bodies with absolute coordinates take a sixth of the
time of its kinematic tree with closed loops.
"""

from __future__ import annotations

from typing import Any

import exudyn
import numpy as np
from exudyn.itemInterface import (
    LoadCoordinate,
    MarkerBodyPosition,
    MarkerNodeCoordinate,
    NodeRigidBody2D,
    ObjectConnectorSpringDamper,
    ObjectGround,
    ObjectJointRevolute2D,
    ObjectRigidBody2D,
)
from numpy.typing import NDArray

import deltac as dc
from deltac.mechanism.laws import evaluate

Array = NDArray[np.float64]
ORDER = 2

RELATIVE_TOLERANCE = 1e-12
"""Of Newton's method. At the default of 1e-8 the error stays above 5e-6 rad at any step."""
CONTRACTIVITY = 0.1
"""A new Jacobian where Newton's method contracts by less: a quarter faster than the default, 0.5."""


class Squeezer:
    """The problem's mechanism as objects of Exudyn; a run of any number of steps."""

    def __init__(self, problem: dc.problems.Problem) -> None:
        """Build it at its start."""
        self.problem = problem
        self.mbs = exudyn.SystemContainer().AddSystem()
        self.bodies = {"ground": self.mbs.AddObject(ObjectGround())}
        self.nodes: dict[str, int] = {}
        self.centres = {"ground": np.zeros(2)}
        self.places = self._start()
        mechanism = problem.mechanism
        for body in mechanism.bodies:
            self._add_body(body)
        for joint in mechanism.joints:
            self._pin(joint.parent, joint.position, joint.child, joint.child_position)
        for loop in mechanism.constraints:
            self._pin(loop.body1, loop.point1, loop.body2, loop.point2)
        motor, spring = mechanism.forces
        self._drive(motor)
        self._hang(spring)
        self.mbs.Assemble()

    def run(self, steps: int) -> Array:
        """From start to end in steps of one length; the seven joint angles at the end (rad)."""
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.numberOfSteps = steps
        settings.timeIntegration.endTime = self.problem.duration
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.newton.relativeTolerance = RELATIVE_TOLERANCE
        settings.timeIntegration.newton.modifiedNewtonContractivity = CONTRACTIVITY
        settings.solution.file.write = False
        # It starts anew each time: the initial values stay as they are.
        self.mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
        return self._angles()

    def _angles(self) -> Array:
        """The joint angles, in the order of the mechanism's joints (rad)."""
        turned = {"ground": 0.0}
        for name, node in self.nodes.items():
            since = self.mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates)[2]
            turned[name] = self.places[name][1] + since
        joints = self.problem.mechanism.joints
        return np.array([turned[j.child] - turned[j.parent] for j in joints])

    def _start(self) -> dict[str, tuple[Array, float]]:
        """Where each body's frame is, and how far it is turned."""
        places = {"ground": (np.zeros(2), 0.0)}
        for joint, angle in zip(self.problem.mechanism.joints, self.problem.state.q):
            origin, turned = places[joint.parent]
            pin = origin + _turn(turned) @ self._numbers(joint.position)[:2]
            places[joint.child] = (pin, turned + angle)
        return places

    def _add_body(self, body: dc.bodies.Body) -> None:
        """Its node is at its mass centre, which spares Exudyn the terms of an offset."""
        centre = self._numbers(body.mass_centre)[:2]
        origin, turned = self.places[body.name]
        start = [*(origin + _turn(turned) @ centre), turned]
        node = self.mbs.AddNode(NodeRigidBody2D(referenceCoordinates=start))
        mass, inertia = self._numbers((body.mass, body.inertia[2][2]))
        self.bodies[body.name] = self.mbs.AddObject(
            ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)
        )
        self.nodes[body.name], self.centres[body.name] = node, centre

    def _drive(self, motor: Any) -> None:
        """A torque on a joint at the ground: on the angle of the body it turns."""
        joints = self.problem.mechanism.joints
        turned = next(joint.child for joint in joints if joint.name == motor.joint)
        angle = self.mbs.AddMarker(
            MarkerNodeCoordinate(nodeNumber=self.nodes[turned], coordinate=2)
        )
        (torque,) = self._numbers(motor.torque)
        self.mbs.AddLoad(LoadCoordinate(markerNumber=angle, load=torque))

    def _hang(self, spring: Any) -> None:
        stiffness, length = self._numbers((spring.stiffness, spring.length))
        markers = [
            self._marker(spring.body1, spring.point1),
            self._marker(spring.body2, spring.point2),
        ]
        self.mbs.AddObject(
            ObjectConnectorSpringDamper(
                markerNumbers=markers, stiffness=stiffness, damping=0.0, referenceLength=length
            )
        )

    def _pin(self, body1: str, point1: Any, body2: str, point2: Any) -> None:
        markers = [self._marker(body1, point1), self._marker(body2, point2)]
        self.mbs.AddObject(ObjectJointRevolute2D(markerNumbers=markers))

    def _marker(self, body: str, point: Any) -> int:
        """A point given from the body's frame, for Exudyn from the mass centre."""
        place = [*(self._numbers(point)[:2] - self.centres[body]), 0.0]
        number: int = self.mbs.AddMarker(
            MarkerBodyPosition(bodyNumber=self.bodies[body], localPosition=place)
        )
        return number

    def _numbers(self, laws: Any) -> Array:
        values = self.problem.mechanism.parameters
        return np.array([float(evaluate(law, values)) for law in laws])


def _turn(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
