"""Figures of runs: angles and testing functions over time. Matplotlib without pyplot, so no state.

One function for each kind of figure; what they look like is defined here once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array: TypeAlias = NDArray[np.float64]

EPS = float(np.finfo(np.float64).eps)
DPI = 150

COLOURS = ("#d55e00", "#0072b2", "#111111", "#009e73", "#cc79a7")
"""Of Okabe and Ito, which people of any colour vision can tell apart."""

WIDTHS = (2.0, 1.4, 0.8, 0.8, 0.8)
"""Earlier runs are drawn wider, so that they show behind later ones that coincide with them."""

POINTS = 2500
"""As many as an angle is drawn with, at most; more cannot be told apart."""

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.solid_capstyle": "round",
    "path.simplify_threshold": 0.5,
    "savefig.dpi": DPI,
}

NAMES = {"liu-huston": "Liu–Huston", "wang": "Wang"}


@dataclass(frozen=True, eq=False)
class Curve:
    """A run as it is drawn.

    label      its name in the legend
    t          (T,) times (s)
    angles     name -> (T,) degrees
    delta_c    testing function -> (T,) ΔC (J)
    turnover   energy turned over (J): its rounding is the floor of |ΔC|
    """

    label: str
    t: Array
    angles: Mapping[str, Array]
    delta_c: Mapping[str, Array] = field(default_factory=dict)
    turnover: float = 0.0


def styled() -> AbstractContextManager[None]:
    """The style of all figures, for drawing and for writing them."""
    import matplotlib

    default = {k: v for k, v in matplotlib.rcParamsDefault.items() if k != "backend"}
    settings: Any = {**default, **STYLE}  # whatever a matplotlibrc says
    return matplotlib.rc_context(settings)


def testing_figure(title: str, curves: Sequence[Curve]) -> Figure:
    """The panels of the thesis: the angles, |ΔC| of Liu-Huston, |ΔC| of Wang (log axes).

    The panel of the angles has a strip for each of them. Colours name the runs throughout.
    """
    names = list(curves[0].angles)
    with styled():
        figure = _figure(7.6, 9.0, title, below=0.85)
        heights = [*(1.3 / len(names) for _ in names), 1.0, 1.0]
        gaps = [*(0.07 for _ in names[1:]), 0.26, 0.26]
        panels = _stacked(figure, heights, gaps)
        strips, tests = panels[: len(names)], panels[len(names) :]
        strips[0].set_title("Angles from the vertical (where runs coincide, the last one shows)")
        for strip, name in zip(strips, names, strict=True):
            for curve, colour, width in zip(curves, COLOURS, WIDTHS, strict=False):
                _angle(strip, curve, name, color=colour, linewidth=width)
            strip.set_ylabel(f"{name} (deg)")
        floor = EPS * max(curve.turnover for curve in curves)
        for panel, (function, name) in zip(tests, NAMES.items(), strict=True):
            _delta_c(panel, curves, function, floor)
            panel.set_title(f"|ΔC| of {name}'s function")
        _same_decades(tests, floor)
        _legend(figure, curves)
        panels[-1].set_xlabel("time t (s)")
        for panel in panels:
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
    return figure


def angles_figure(title: str, curves: Sequence[Curve]) -> Figure:
    """The angles of each run in a panel of its own, on the same axes."""
    with styled():
        figure = _figure(7.6, 1.2 + 3.0 * len(curves), title)
        panels = _stacked(figure, [1.0] * len(curves), [0.16] * (len(curves) - 1))
        for panel in panels[1:]:
            panel.sharey(panels[0])
        for panel, curve in zip(panels, curves, strict=True):
            for name, colour in zip(curve.angles, COLOURS, strict=False):
                _angle(panel, curve, name, color=colour, linewidth=1.0, label=name)
            panel.set_title(curve.label)
            panel.set_ylabel("angle (deg)")
        columns = len(curves[0].angles)
        panels[0].legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.1
        )
        panels[-1].set_xlabel("time t (s)")
    return figure


def torque_figure(title: str, name: str, t: Array, torque: Array) -> Figure:
    """A driving torque (N·m) over time, its extremes marked."""
    with styled():
        figure = _figure(7.6, 4.2, title)
        panel = figure.subplots()
        panel.plot(t, torque, color=COLOURS[1], linewidth=1.4)
        panel.axhline(0.0, color="#888888", linewidth=0.6)
        for row, above in ((int(torque.argmax()), True), (int(torque.argmin()), False)):
            panel.plot(t[row], torque[row], "o", color=COLOURS[0], markersize=4)
            late = t[row] > 0.85 * t[-1]
            panel.annotate(
                f"{torque[row]:.2f} N·m at {t[row]:.2f} s".replace("-", "−"),
                (t[row], torque[row]),
                xytext=(0, 5 if above else -5),
                textcoords="offset points",
                ha="right" if late else "center",
                va="bottom" if above else "top",
            )
        panel.margins(x=0, y=0.12)
        panel.set_xlabel("time t (s)")
        panel.set_ylabel(f"{name} (N·m)")
    return figure


# --- parts of figures -----------------------------------------------------------------------------


def _figure(width: float, height: float, title: str, below: float = 0.5) -> Figure:
    """An empty figure (inches) with its title, and room `below` the panels.

    Margins are set by hand: matplotlib's automatic layout takes longer than all the drawing.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    figure.subplots_adjust(
        left=0.72 / width,
        right=1 - 0.14 / width,
        bottom=below / height,
        top=1 - 0.62 / height,
    )
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.12 / width, ha="left")
    figure.texts[-1].set_y(1 - 0.1 / height)
    return figure


def _stacked(figure: Figure, heights: Sequence[float], gaps: Sequence[float]) -> list[Axes]:
    """Panels below one another on the same time axis, with relative heights and gaps."""
    ratios = [heights[0]]
    for gap, height in zip(gaps, heights[1:], strict=True):
        ratios += [gap, height]
    grid = figure.add_gridspec(len(ratios), 1, height_ratios=ratios, hspace=0.0)
    panels = [figure.add_subplot(grid[0])]
    panels += [figure.add_subplot(grid[row], sharex=panels[0]) for row in range(2, len(ratios), 2)]
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    return panels


def _angle(panel: Axes, curve: Curve, name: str, **look: Any) -> None:
    stride = max(1, len(curve.t) // POINTS)
    panel.plot(curve.t[::stride], curve.angles[name][::stride], **look)
    panel.margins(x=0)


def _delta_c(panel: Axes, curves: Sequence[Curve], function: str, floor: float) -> None:
    """|ΔC| on a log axis; what is below rounding, zero above all, is drawn at rounding."""
    for curve, colour, width in zip(curves, COLOURS, WIDTHS, strict=False):
        size = np.maximum(np.abs(curve.delta_c[function]), floor)
        panel.semilogy(curve.t, size, color=colour, linewidth=width)
    panel.axhline(floor, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)))
    panel.annotate(
        f"rounding of the energy turned over, {floor:.0e} J: what is smaller is drawn here",
        (0.995, floor),
        xycoords=panel.get_yaxis_transform(),
        xytext=(0, -2),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=7.5,
        color="#555555",
    )
    panel.set_ylabel("|ΔC| (J)")
    panel.margins(x=0)


def _same_decades(panels: Sequence[Axes], floor: float) -> None:
    """The same limits for all, at whole decades, with room for the note below the floor."""
    from matplotlib.ticker import LogLocator, NullLocator

    highest = max(panel.get_ylim()[1] for panel in panels)
    top = int(np.ceil(np.log10(highest)))
    bottom = int(np.floor(np.log10(floor) - 0.08 * (top - np.log10(floor))))
    stride = max(1, int(np.ceil((top - bottom) / 9)))
    for panel in panels:
        panel.set_ylim(10.0**bottom, 10.0**top)
        panel.yaxis.set_major_locator(LogLocator(base=10.0**stride, numticks=20))
        panel.yaxis.set_minor_locator(NullLocator())


def _legend(figure: Figure, curves: Sequence[Curve]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, linewidth=2.4, label=curve.label)
        for curve, colour in zip(curves, COLOURS, strict=False)
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles))
