"""Trajectories: what happened, and the versioned log schema that carries it (Parquet, CSV)."""

from __future__ import annotations

from deltac.trajectories.files import read_trajectory, write_trajectory
from deltac.trajectories.schema import SCHEMA_VERSION, from_columns, to_columns, to_metadata
from deltac.trajectories.trajectory import Provenance, Trajectory

__all__ = [
    "SCHEMA_VERSION",
    "Provenance",
    "Trajectory",
    "from_columns",
    "read_trajectory",
    "to_columns",
    "to_metadata",
    "write_trajectory",
]
