"""Pictures of results, and files that appear complete or not at all."""

from __future__ import annotations

from deltac.report.figures import (
    Curve,
    angles_figure,
    chain_figure,
    testing_figure,
    torque_figure,
)
from deltac.report.files import check_figure, output_folder, write_figure, write_json

__all__ = [
    "Curve",
    "angles_figure",
    "chain_figure",
    "check_figure",
    "output_folder",
    "testing_figure",
    "torque_figure",
    "write_figure",
    "write_json",
]
