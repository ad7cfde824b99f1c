"""A second simulator by the recorder protocol: Exudyn's kinematic trees."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.recorders import record_exudyn
from deltac.trajectories import Trajectory

exudyn = pytest.importorskip("exudyn", reason="Exudyn (deltac[exudyn]) is not installed")

DAMPING = (0.1, 0.2)
MECHANISM = dc.Mechanism(
    bodies=[
        dc.body("upper", mass=1.0, inertia=(0.01, 0.1, 0.1), mass_centre=(0.5, 0, 0)),
        dc.body("lower", mass=2.0, inertia=(0.01, 0.2, 0.2), mass_centre=(0.5, 0, 0)),
    ],
    joints=[
        dc.revolute("shoulder", "ground", "upper", "z", damping=DAMPING[0]),
        dc.revolute("elbow", "upper", "lower", "z", position=(1, 0, 0), damping=DAMPING[1]),
    ],
    gravity=(0, -9.81, 0),
    name="double pendulum",
)


def double_pendulum(dampers: tuple[float, float] = DAMPING) -> tuple[Any, int]:
    """The same in Exudyn: a kinematic tree with two hinges about z."""
    from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree

    mbs = exudyn.SystemContainer().AddSystem()
    node = mbs.AddNode(
        NodeGenericODE2(
            referenceCoordinates=[0.2, 0.0],
            initialCoordinates=[0.8, 0.5],
            initialCoordinates_t=[0.0, 0.0],
            numberOfODE2Coordinates=2,
        )
    )
    mbs.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[exudyn.JointType.RevoluteZ] * 2,
            linkParents=[-1, 0],
            jointTransformations=exudyn.Matrix3DList([np.eye(3)] * 2),
            jointOffsets=exudyn.Vector3DList([[0, 0, 0], [1, 0, 0]]),
            linkInertiasCOM=exudyn.Matrix3DList(
                [np.diag([0.01, 0.1, 0.1]), np.diag([0.01, 0.2, 0.2])]
            ),
            linkCOMs=exudyn.Vector3DList([[0.5, 0, 0]] * 2),
            linkMasses=[1.0, 2.0],
            gravity=[0, -9.81, 0],
            jointPControlVector=[0.0, 0.0],
            jointDControlVector=list(dampers),
            jointPositionOffsetVector=[0.0, 0.0],
            jointVelocityOffsetVector=[0.0, 0.0],
        )
    )
    mbs.Assemble()
    return mbs, node


def recorded(solver: str, step: float, *, dampers: tuple[float, float] = DAMPING) -> Trajectory:
    mbs, node = double_pendulum(dampers)
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(1.0 / step)
    settings.timeIntegration.endTime = 1.0
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    with record_exudyn(mbs, node, ("shoulder", "elbow")) as rec:
        mbs.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, solver))
    return rec.trajectory(solver=solver, step=step, model="double pendulum")


@pytest.mark.parametrize(
    ("solver", "order"),
    [
        ("ExplicitEuler", 1),
        ("ExplicitMidpoint", 2),
        ("TrapezoidalIndex2", 2),
        ("RK33", 3),
        ("RK44", 4),
    ],
)
def test_the_energy_error_shows_the_order_of_its_solvers(solver: str, order: int) -> None:
    errors = []
    for step in (4e-3, 2e-3):
        run = recorded(solver, step)
        assert len(run) == round(1.0 / step) + 1
        ledger = dc.balance(MECHANISM, run, work="samples", testing=("wang",))
        errors.append(float(np.abs(ledger.delta_c["wang"]).max()))
        assert float(ledger.error_bar["wang"].max()) < 0.5 * errors[-1]
    assert order - 0.3 < np.log2(errors[0] / errors[1]) < order + 1.3, errors


def test_the_motion_is_ours() -> None:
    run = recorded("DOPRI5", 1e-3)
    ours = dc.simulate(
        MECHANISM,
        MECHANISM.state({"shoulder": 1.0, "elbow": 0.5}),
        duration=1.0,
        step=1e-3,
        solver="ode5",
    )
    assert np.abs(run.q - ours.q).max() < 1e-9  # both of order 5: h⁵ = 1e-15, times growth
    assert run.provenance.simulator.startswith("Exudyn")


def test_a_wrong_damper_is_seen() -> None:
    right, wrong = (
        dc.balance(MECHANISM, recorded("RK44", 1e-3, dampers=dampers), work="samples")
        for dampers in (DAMPING, (0.1, 0.25))
    )
    assert right.relative("wang") < 1e-7
    assert wrong.relative("wang") > 1e-4


def test_logged_forces_take_the_place_of_the_models() -> None:
    mbs, node = double_pendulum((0.1, 0.25))
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = 1000
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    forces = {"damper elbow": lambda t, q, u: [0.0, -0.25 * u[1]]}
    with record_exudyn(mbs, node, ("shoulder", "elbow"), forces=forces) as rec:
        mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44)
    ledger = dc.balance(MECHANISM, rec.trajectory(), work="samples")
    assert ledger.basis["damper elbow"] == "measured"
    assert ledger.relative("wang") < 1e-7


def test_names_must_fit() -> None:
    mbs, node = double_pendulum()
    with pytest.raises(InputError, match="has 2 coordinates, for 1 joints: shoulder"):
        record_exudyn(mbs, node, ("shoulder",))


def test_without_exudyn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "exudyn", None)
    with pytest.raises(InputError, match=r'pip install "deltac\[exudyn\]"'):
        record_exudyn(None, 0, ())


def geared(step: float, solver: str, **options: Any) -> tuple[Any, Any]:
    """The elbow geared to the shoulder by a coordinate constraint: θ₂ = −½ (θ₁ − 0.2)."""
    from exudyn.itemInterface import CoordinateConstraint, MarkerNodeCoordinate

    mbs, node = double_pendulum()
    mbs.SetNodeParameter(node, "initialCoordinates", [0.8, -0.4])
    markers = [mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=k)) for k in (1, 0)]
    gear = mbs.AddObject(CoordinateConstraint(markerNumbers=markers, factor1=-0.5))
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(0.5 / step)
    settings.timeIntegration.endTime = 0.5
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.solutionSettings.writeSolutionToFile = False
    options = {"constraints": {"gear": gear}, **options}
    with record_exudyn(mbs, node, ("shoulder", "elbow"), accelerations=True, **options) as rec:
        mbs.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, solver))
    return rec, rec.trajectory(solver, step) if rec.monitor is None else None


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("solver", ["TrapezoidalIndex2", "GeneralizedAlpha"])
def test_forces_of_constraints(solver: str) -> None:
    _, run = geared(1e-3, solver)
    force = run.forces["constraint gear"]
    assert np.abs(force).max() > 1.0
    # The gear's force is along its gradient, and the equations hold with it but not without.
    assert np.abs(force[:, 0] - 0.5 * force[:, 1]).max() < 1e-9 * np.abs(force).max()
    left = np.abs(dc.residuals(MECHANISM, run)["coordinates"])[1:].max()
    assert left < 1e-6 * np.abs(force).max()
    ledger = dc.balance(MECHANISM, run, work="samples", testing=("wang",))
    assert abs(ledger.work["constraint gear"][-1]) < 1e-5 * ledger.energy_exchanged
    assert ledger.relative("wang") < 1e-4


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_monitor_takes_the_rows() -> None:
    mbs, node = double_pendulum()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = 1000
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    monitor = dc.Monitor(MECHANISM, tolerance=1e-3)
    with record_exudyn(mbs, node, ("shoulder", "elbow"), accelerations=True, monitor=monitor):
        mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    assert monitor.rows == 1001 and monitor.error_bar < 1e-3 * monitor.energy_exchanged


def test_an_object_without_equations() -> None:
    mbs, node = double_pendulum()
    with pytest.raises(InputError, match="no algebraic equations"):
        record_exudyn(mbs, node, ("shoulder", "elbow"), constraints={"tree": 0})
