"""Trajectories: what happened, and the versioned log schema that carries it, in several formats."""

from __future__ import annotations

from deltac.trajectories.columns import MechanismNames
from deltac.trajectories.formats.files import (
    FORMATS,
    draft_mapping,
    explain,
    read_trajectory,
    write_trajectory,
)
from deltac.trajectories.formats.mapping import LogMapping, read_mapping
from deltac.trajectories.formats.reading import ColumnReading
from deltac.trajectories.formats.schema import SCHEMA_VERSION, from_columns, to_columns, to_metadata
from deltac.trajectories.formats.streaming import Chunk, scan_trajectory
from deltac.trajectories.lint import Suspicion, corrected, suspicions
from deltac.trajectories.occurrences import Occurrence
from deltac.trajectories.rates import derived_error, with_accelerations
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
    "draft_mapping",
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
