"""The ten figures and results.json of a reproduction."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deltac.calls.progress import Progress
from deltac.errors import FileError
from deltac.problems.triple_pendulum import LENGTHS, START
from deltac.report.files import write_figure, write_json
from thesis.experiments import PublishedExperiment
from thesis.figures import (
    Curve,
    angles_figure,
    chain_figure,
    rates_figure,
    testing_figure,
    thesis_figure,
    torque_figure,
)
from thesis.reproduction import Reproduction
from thesis.runs import PRESCRIBED, Outcome, absolute_angles

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Written:
    """Where the figures and the results are."""

    figures: tuple[Path, ...]
    results: Path


def output_folder(path: Path) -> Path:
    """Make a folder for results; InputError if it cannot be made or written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{path} cannot be a folder for results: {error.strerror}") from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise FileError(f"the folder {path} cannot be written to; choose another one")
    return path


def write(
    reproduction: Reproduction,
    folder: Path,
    progress: Progress | None = None,
    *,
    thesis_axes: bool = False,
) -> Written:
    """Write figure_4_1.png … and results.json into a folder, which is made if need be.

    With `thesis_axes` the figures have the panels and axes of the thesis: the three angles of the last run in
    one panel (that of the right equations in 4.7 and 4.10; none in 4.9), and |ΔC| with the ticks that it
    labels. Figure 3.1, the pendulum itself, comes first.

    Raises InputError when the folder cannot be made or written to.
    """
    output_folder(folder)
    paths = []
    if thesis_axes:
        paths.append(folder / "figure_3_1.png")
        write_figure(_pendulum(), paths[0])
    experiments = [e for e in reproduction.experiments if e.shows != "numbers"]
    for k, experiment in enumerate(experiments):
        if progress is not None:
            progress(k / len(experiments))
        path = folder / f"figure_{experiment.figure.replace('.', '_')}.png"
        write_figure(draw(reproduction, experiment, thesis_axes), path)
        paths.append(path)
    results = folder / "results.json"
    write_json([row.to_dict() for row in reproduction.results], results)
    return Written(tuple(paths), results)


def draw(
    reproduction: Reproduction, experiment: PublishedExperiment, thesis_axes: bool = False
) -> Figure:
    """The figure of an experiment."""
    outcomes = reproduction.of(experiment)
    title = experiment.heading
    axes = experiment.axes if thesis_axes else {}
    if experiment.shows == "torque":
        outcome = next(iter(outcomes.values()))
        torque = outcome.trajectory.forces[PRESCRIBED][:, 0]
        t = outcome.trajectory.t
        return torque_figure(title, "driving torque M1", t, torque, axes.get("torque", ()))
    curves = [_curve(label, outcome) for label, outcome in outcomes.items()]
    if experiment.shows == "angles":
        return angles_figure(title, curves, axes.get("angles", ()))
    if experiment.shows == "rates":
        rates = [outcome.rates["wang"] for outcome in outcomes.values()]
        return rates_figure(title, [replace(c, rate=r) for c, r in zip(curves, rates, strict=True)])
    if axes:
        return thesis_figure(title, curves, axes.get("angles", ()), axes["delta_c"])
    return testing_figure(title, curves)


def _pendulum() -> Figure:
    """Figure 3.1: the three bars, their angles from the vertical, and the torques at the joints."""
    theta = np.array(START)
    x = np.concatenate([[0.0], np.cumsum(np.array(LENGTHS) * np.sin(theta))])
    y = np.concatenate([[0.0], np.cumsum(-np.array(LENGTHS) * np.cos(theta))])
    return chain_figure("Fig. 3.1  The triple pendulum", x, y, theta)


def _curve(label: str, outcome: Outcome) -> Curve:
    angles = np.degrees(absolute_angles(outcome.trajectory)).T
    return Curve(
        label,
        outcome.trajectory.t,
        {f"θ{bar}": angle for bar, angle in enumerate(angles, 1)},
        outcome.ledger.delta_c,
        outcome.ledger.energy_exchanged,
    )
