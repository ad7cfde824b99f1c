"""The triple pendulum in Exudyn: its kinematic tree (minimal coordinates) with explicit Runge–Kutta methods.

No files are written and no Python function is called on the way; sensors keep q and u in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import exudyn
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree, SensorNode

from peers.rival import ALONG, Array, Pendulum, Rival

METHODS = {"RK44": (4, 4), "DOPRI5": (5, 7)}
"""Exudyn's name of a method -> its order, and the accelerations it evaluates in a step."""


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """Its cheapest method of fourth order, and the one of fifth order that is ours too."""
    note = "kinematic tree; sensors keep t, q, u"
    for method, (order, evaluations) in METHODS.items():
        run = _runner(pendulum, method)
        yield Rival(f"Exudyn {method}", run, pendulum.steps, order, evaluations, note)


def _runner(pendulum: Pendulum, method: str) -> Callable[[], Array]:
    """Each run starts anew: SolveDynamic leaves the initial values as they are."""
    mbs, angles = _system(pendulum)
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = pendulum.steps
    settings.timeIntegration.endTime = pendulum.duration
    settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.adaptiveStep = False
    # Even so DOPRI5 refuses a step beyond its tolerances: these let all pass.
    settings.timeIntegration.absoluteTolerance = settings.timeIntegration.relativeTolerance = 1e3
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.explicit.computeEndOfStepAccelerations = False
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = pendulum.step

    def run() -> Array:
        mbs.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, method))
        return np.asarray(mbs.GetSensorStoredData(angles))[1:, 1:]

    return run


def _system(pendulum: Pendulum) -> tuple[Any, int]:
    """The system, and the number of the sensor that keeps its angles."""
    mbs = exudyn.SystemContainer().AddSystem()
    node = mbs.AddNode(
        NodeGenericODE2(
            numberOfODE2Coordinates=3,
            referenceCoordinates=[0.0] * 3,
            initialCoordinates=pendulum.q.tolist(),
            initialCoordinates_t=pendulum.u.tolist(),
        )
    )
    mbs.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            gravity=[0.0, -pendulum.gravity, 0.0],
            jointTypes=[exudyn.JointType.RevoluteZ] * 3,
            linkParents=[-1, 0, 1],
            jointTransformations=exudyn.Matrix3DList([np.eye(3)] * 3),
            jointOffsets=exudyn.Vector3DList([[0.0, -a, 0.0] for a in pendulum.offsets]),
            linkInertiasCOM=exudyn.Matrix3DList(
                [np.diag([I, ALONG, I]) for I in pendulum.inertias]
            ),
            linkCOMs=exudyn.Vector3DList([[0.0, -l / 2, 0.0] for l in pendulum.lengths]),
            linkMasses=list(pendulum.masses),
        )
    )
    kinds = (exudyn.OutputVariableType.Coordinates, exudyn.OutputVariableType.Coordinates_t)
    angles, _ = (
        mbs.AddSensor(
            SensorNode(
                nodeNumber=node, storeInternal=True, writeToFile=False, outputVariableType=kind
            )
        )
        for kind in kinds
    )
    mbs.Assemble()
    return mbs, angles
