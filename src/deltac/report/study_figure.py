"""The figure of a study: errors over the step with the fitted line; below, |ΔC| over time for each step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deltac.diagnosis.study.convergence import Convergence, order_text
from deltac.report.figures import COLOURS, EPS, POINTS, _figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltac.diagnosis.study import Study

ENERGY, MOTION, GREY = "#0072b2", "#d55e00", "#888888"

DECADES = 1e-6
"""What is smaller than this share of the finest run's largest |ΔC| is drawn there."""


SEEN = 0.02
"""Points of one step that differ by more than this are drawn as two."""


def study_figure(title: str, study: Study) -> Figure:
    """Largest |ΔC| (J) and state difference (of the range) over the step, log-log; |ΔC|(t) at each step.

    The line has the observed order; where ΔC tends to a limit, the limit is drawn with its uncertainty.
    """
    with styled():
        figure = _figure(9.6, 7.4, title)
        grid = figure.add_gridspec(2, 1, height_ratios=[1.15, 1.0], hspace=0.38, right=0.7)
        _over_steps(figure.add_subplot(grid[0]), study)
        _over_time(figure.add_subplot(grid[1]), study)
        for panel in figure.axes:
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
    return figure


def _over_steps(panel: Axes, study: Study) -> None:
    m = study.measures
    h, left, bars = (np.asarray(x) for x in (m.steps, m.left, m.bars))
    tiny = np.finfo(np.float64).tiny
    panel.loglog(
        h, np.maximum(left, tiny), "o", color=ENERGY, markersize=6, label="largest |ΔC| (J)"
    )
    energy, state = study.observed_order[study.function], study.observed_order["state"]
    fitted = np.asarray(energy.sizes)
    common = h[len(h) - len(fitted) :]
    if (np.abs(fitted - left[len(h) - len(fitted) :]) > SEEN * fitted).any():
        panel.loglog(
            common,
            np.maximum(fitted, tiny),
            "o",
            color=ENERGY,
            markerfacecolor="none",
            markersize=9,
            label="the same, before the motions part"
            if study.horizon < study.comparison.t[-1]
            else "the same, at times that all steps share",
        )
    _line(panel, common, fitted, energy, ENERGY)
    sizes = np.asarray(state.sizes)
    if len(sizes) and (sizes > 0.0).any():
        shown = h[len(h) - len(sizes) - 1 : -1]
        panel.loglog(
            shown,
            sizes,
            "s",
            color=MOTION,
            markersize=5,
            label="state, difference to the next (of its range)",
        )
        _line(panel, shown, sizes, state, MOTION)
    panel.loglog(
        h, np.maximum(bars, tiny), color=GREY, linestyle=":", label="rounding and quadrature (J)"
    )
    if m.allowed > 0.0:
        panel.axhline(
            m.allowed, color="#009e73", linewidth=1.0, label=f"accepted, {m.allowed:.1g} J"
        )
    if energy.trend == "tends to a limit":
        panel.axhline(
            energy.limit,
            color=ENERGY,
            linewidth=1.2,
            linestyle=(0, (5, 2)),
            label=f"limit of |ΔC|, {energy.limit:.3g} J",
        )
    panel.set_title("What is left, over the step" if m.unit else "What is left, over the tolerance")
    panel.set_xlabel("step h (s)" if m.unit else "tolerance")
    panel.set_ylabel("error")
    panel.set_xlim(h[-1] / 1.5, h[0] * 1.5)
    panel.set_xticks(h, [f"{x:g}" for x in h])
    panel.minorticks_off()
    # Beside the axes: nothing there can be covered.
    panel.legend(
        loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=7.5, frameon=False, borderaxespad=0.0
    )


def _line(panel: Axes, h: np.ndarray, sizes: np.ndarray, found: Convergence, colour: str) -> None:
    """The observed order through the finest of the points that gave it; `sizes` are what it was fitted to."""
    if found.order is None or not found.steps or found.trend == "does not settle":
        return
    near = [int(np.argmin(np.abs(h - step))) for step in found.steps]
    through = near[-1]
    if sizes[through] <= 0.0 or (found.trend == "tends to a limit" and colour == ENERGY):
        return
    line = sizes[through] * (h / h[through]) ** found.order
    panel.loglog(
        h, line, color=colour, linewidth=1.0, alpha=0.7, label=f"order {order_text(found)}"
    )


def _over_time(panel: Axes, study: Study) -> None:
    runs = [r for r in study.runs if r.step in study.measures.steps and r.run is not None]
    m = study.measures
    floor = max(EPS * m.turnover, DECADES * m.left[-1], float(np.finfo(np.float64).tiny))
    palette = (*COLOURS[:2], *COLOURS[3:], COLOURS[2])
    for k, (entry, colour) in enumerate(zip(runs, (palette[i % 5] for i in range(len(runs))))):
        assert entry.run is not None and entry.left_over is not None
        stride = max(1, len(entry.run) // POINTS)
        size = np.maximum(np.abs(entry.left_over[study.function]), floor)
        name = "h" if study.measures.unit else "tolerance"
        panel.semilogy(
            entry.run.t[::stride],
            size[::stride],
            color=colour,
            linewidth=max(2.0 - 0.5 * k, 0.8),
            label=f"{name} = {entry.step:g}",
        )
    end = float(study.comparison.t[-1])
    if study.horizon < end:
        panel.axvline(study.horizon, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        panel.annotate(
            "motions part",
            (study.horizon, 0.02),
            xycoords=panel.get_xaxis_transform(),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=7.5,
            color="#555555",
        )
    panel.set_title("|ΔC| over time")
    panel.set_xlabel("time t (s)")
    panel.set_ylabel("|ΔC| (J)")
    panel.margins(x=0)
    panel.legend(loc="best", fontsize=7.5, ncols=3, frameon=True, framealpha=0.85, edgecolor="none")
