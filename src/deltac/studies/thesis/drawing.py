"""The ten figures and results.json of a reproduction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deltac.report import (
    Curve,
    angles_figure,
    output_folder,
    testing_figure,
    torque_figure,
    write_figure,
    write_json,
)
from deltac.studies.thesis.experiments import Experiment
from deltac.studies.thesis.reproduction import Reproduction
from deltac.studies.thesis.runs import PRESCRIBED, Outcome, absolute_angles

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Written:
    """Where the figures and the results are."""

    figures: tuple[Path, ...]
    results: Path


def write(
    reproduction: Reproduction,
    folder: Path,
    progress: Callable[[float, str], None] | None = None,
) -> Written:
    """Write figure_4_1.png … and results.json into a folder, which is made if need be.

    Raises InputError when the folder cannot be made or written to.
    """
    output_folder(folder)
    paths = []
    for k, experiment in enumerate(reproduction.experiments):
        if progress is not None:
            progress(k / len(reproduction.experiments), f"drawing fig. {experiment.figure}")
        path = folder / f"figure_{experiment.figure.replace('.', '_')}.png"
        write_figure(draw(reproduction, experiment), path)
        paths.append(path)
    results = folder / "results.json"
    write_json([row.to_dict() for row in reproduction.results], results)
    return Written(tuple(paths), results)


def draw(reproduction: Reproduction, experiment: Experiment) -> Figure:
    """The figure of an experiment."""
    outcomes = reproduction.of(experiment)
    title = f"Fig. {experiment.figure}  {experiment.title}"
    if experiment.shows == "torque":
        (outcome,) = outcomes.values()
        torque = outcome.trajectory.forces[PRESCRIBED][:, 0]
        return torque_figure(title, "driving torque M1", outcome.trajectory.t, torque)
    curves = [_curve(label, outcome) for label, outcome in outcomes.items()]
    return (testing_figure if experiment.shows == "testing functions" else angles_figure)(
        title, curves
    )


def _curve(label: str, outcome: Outcome) -> Curve:
    angles = np.degrees(absolute_angles(outcome.trajectory)).T
    return Curve(
        label,
        outcome.trajectory.t,
        {f"θ{bar}": angle for bar, angle in enumerate(angles, 1)},
        outcome.ledger.delta_c,
        outcome.ledger.turnover,
    )
