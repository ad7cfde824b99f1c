"""Trajectories: what happened, and the versioned log schema that carries it, in several formats."""

from __future__ import annotations

from deltac.trajectories.derive import derived_error, with_accelerations
from deltac.trajectories.files import FORMATS, explain, read_trajectory, write_trajectory
from deltac.trajectories.mapping import LogMapping, read_mapping
from deltac.trajectories.names import MechanismNames
from deltac.trajectories.occurrences import Occurrence
from deltac.trajectories.reading import ColumnReading
from deltac.trajectories.schema import SCHEMA_VERSION, from_columns, to_columns, to_metadata
from deltac.trajectories.stream import Chunk, scan_trajectory
from deltac.trajectories.suspicions import Suspicion, corrected, suspicions
from deltac.trajectories.trajectory import Provenance, Trajectory

__all__ = [
    "FORMATS",
    "SCHEMA_VERSION",
    "Chunk",
    "ColumnReading",
    "LogMapping",
    "MechanismNames",
    "Occurrence",
    "Provenance",
    "Suspicion",
    "Trajectory",
    "corrected",
    "derived_error",
    "explain",
    "from_columns",
    "read_mapping",
    "read_trajectory",
    "scan_trajectory",
    "suspicions",
    "to_columns",
    "to_metadata",
    "with_accelerations",
    "write_trajectory",
]
