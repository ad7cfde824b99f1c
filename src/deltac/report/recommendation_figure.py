"""The figure of a recommendation: time against error, a curve for each solver."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from deltac.report.figures import _figure, _stacked, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltac.diagnosis.advice import Advice
    from deltac.diagnosis.work_precision import Trial

MARKS = "osD^vPX*<>ph"


def recommendation_figure(title: str, advice: Advice) -> Figure:
    """Every trial by the time it takes, against the largest |ΔC| and, below, the error of the motion."""
    with styled():
        figure = _figure(7.6, 7.4, title)
        energy, motion = _stacked(figure, [1.0, 1.0], [0.3])
        _scatter(energy, advice, "energy", advice.tolerance)
        _scatter(motion, advice, "motion", advice.motion_tolerance)
        energy.set_title("largest |ΔC|, share of the energy turned over")
        motion.set_title("error of q and u, share of their ranges (where the energy is kept)")
        motion.set_xlabel("time of a run (s)")
        energy.legend(loc="upper right", fontsize=7.5, ncols=2)
    return figure


def _scatter(panel: Axes, advice: Advice, what: str, tolerance: float) -> None:
    solvers = sorted({t.solver for t in advice.trials})
    colours = _colours(len(solvers))
    for solver, colour, mark in zip(solvers, colours, MARKS * (1 + len(solvers) // len(MARKS))):
        shown = [t for t in advice.trials if t.solver == solver and _drawn(t, what)]
        shown.sort(key=lambda t: -t.setting)
        panel.plot(
            [t.seconds for t in shown],
            [getattr(t, what) for t in shown],
            color=colour,
            marker=mark,
            markersize=4.5,
            linewidth=0.9,
            label=solver,
        )
    if math.isfinite(tolerance):
        dashed = (0, (5, 2))
        panel.axhline(
            tolerance, color="#009e73", linewidth=1.0, linestyle=dashed, label="asked for"
        )
    if advice.best is not None and _drawn(advice.best, what):
        panel.plot(
            advice.best.seconds,
            getattr(advice.best, what),
            marker="o",
            markersize=13,
            markerfacecolor="none",
            markeredgecolor="#d55e00",
            linestyle="none",
        )
    panel.set_xscale("log")
    panel.set_yscale("log")


def _drawn(trial: Trial, what: str) -> bool:
    value = getattr(trial, what)
    return math.isfinite(value) and value > 0.0 and math.isfinite(trial.seconds)


def _colours(count: int) -> list[tuple[float, float, float, float]]:
    from matplotlib import colormaps

    shades = colormaps["viridis"]
    return [shades(0.92 * k / max(1, count - 1)) for k in range(count)]
