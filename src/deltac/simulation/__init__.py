"""From a mechanism and a state to a trajectory."""

from __future__ import annotations

from deltac.simulation.assembly import Assembly, assemble
from deltac.simulation.correction import EnergyLeft
from deltac.simulation.ensemble import Ensemble, simulate_ensemble
from deltac.simulation.equations import Controller, Equations
from deltac.simulation.simulate import SimulationStopped, simulate
from deltac.simulation.solvers import solver_names
from deltac.simulation.stiffness import StiffStep
from deltac.simulation.time_scales import TimeScale, time_scales

__all__ = [
    "Assembly",
    "Controller",
    "EnergyLeft",
    "Ensemble",
    "Equations",
    "SimulationStopped",
    "StiffStep",
    "TimeScale",
    "assemble",
    "simulate",
    "simulate_ensemble",
    "solver_names",
    "time_scales",
]
