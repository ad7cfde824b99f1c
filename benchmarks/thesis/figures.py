"""Figures of the thesis: angles, testing functions and a torque over time, and the pendulum itself.

An axis of the thesis is (from, to, every): its limits and the distance of its ticks. What lies beyond is cut.
What every result draws of itself is in `plots`, and what all figures look like in `style`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import EPS, Array
from deltac.report.panels import CURVE_POINTS
from deltac.report.picture import blank
from deltac.report.style import COLOURS, DASHED, DOTTED, INK, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTHS = (2.0, 1.4, 0.8, 0.8, 0.8)
"""Earlier runs are drawn wider, so that they show behind later ones that coincide with them."""

NAMES = {"liu-huston": "Liu–Huston", "wang": "Wang"}


@dataclass(frozen=True, eq=False)
class Curve:
    """A run as it is drawn.

    label      its name in the legend
    t          (T,) times (s)
    angles     name -> (T,) degrees
    delta_c    testing function -> (T,) ΔC (J)
    rate       (T,) K̇ + V̇ − Q̇ (W)
    energy_exchanged   (J): its rounding is the floor of |ΔC|
    """

    label: str
    t: Array
    angles: Mapping[str, Array]
    delta_c: Mapping[str, Array]
    energy_exchanged: float
    rate: Array | None = None


def testing_figure(title: str, curves: Sequence[Curve]) -> Figure:
    """The angles of all runs, a strip for each; |ΔC| of Liu-Huston, |ΔC| of Wang (log axes).

    Colours name the runs throughout.
    """
    names = list(curves[0].angles)
    with styled():
        figure = blank(9.0, title, below=0.85)
        heights = [*(1.3 / len(names) for _ in names), 1.0, 1.0]
        gaps = [*(0.07 for _ in names[1:]), 0.26, 0.26]
        panels = stacked(figure, heights, gaps)
        strips, tests = panels[: len(names)], panels[len(names) :]
        styles = list(zip(curves, COLOURS, WIDTHS, strict=False))
        strips[0].set_title("Angles from the vertical (where runs coincide, the last shows)")
        for strip, name in zip(strips, names, strict=True):
            for curve, colour, width in styles:
                _angle(strip, curve, name, color=colour, linewidth=width)
            strip.set_ylabel(f"{name} (deg)")
        floor = EPS * max(curve.energy_exchanged for curve in curves)
        for panel, (function, name) in zip(tests, NAMES.items(), strict=True):
            _delta_c(panel, curves, function, floor)
            panel.set_title(f"|ΔC| of {name}'s function")
        _same_decades(tests, floor)
        _legend(figure, curves)
        panels[-1].set_xlabel("time t (s)")
        for panel in panels:
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
    return figure


def thesis_figure(
    title: str,
    curves: Sequence[Curve],
    angles: Sequence[Sequence[float]],
    delta_c: Sequence[Sequence[float]],
) -> Figure:
    """The panels of the thesis on its axes: the angles of the last run, |ΔC| of Liu-Huston, |ΔC| of Wang.

    Without `angles` there is no panel of them. Zeros of |ΔC| are left out.
    """
    with styled():
        heights = [*(1.3 for _ in angles), 1.0, 1.0]
        figure = blank(9.0 if angles else 6.4, title, below=0.85)
        panels = stacked(figure, heights, [0.26] * (len(heights) - 1))
        tests = panels[len(angles) :]
        for panel, axis in zip(panels, angles, strict=False):
            last = curves[-1]
            for name, style in zip(last.angles, ("-", DASHED, DOTTED), strict=True):
                _angle(panel, last, name, color=INK, linestyle=style, linewidth=1.0, label=name)
            panel.set_title(f"Angles from the vertical: {last.label}")
            panel.set_ylabel("angle (deg)")
            panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
            _ticks(panel, *axis)
        for panel, (function, name), axis in zip(tests, NAMES.items(), delta_c, strict=True):
            for curve, colour, width in zip(curves, COLOURS, WIDTHS, strict=False):
                size = np.abs(curve.delta_c[function])
                panel.semilogy(
                    curve.t, np.where(size > 0.0, size, np.nan), color=colour, linewidth=width
                )
            panel.set_title(f"|ΔC| of {name}'s function")
            panel.set_ylabel("|ΔC| (J)")
            panel.set_xlim(curves[0].t[0], curves[0].t[-1])
            _decades(panel, *axis)
        _legend(figure, curves)
        panels[-1].set_xlabel("time t (s)")
        for panel in panels:
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
    return figure


def rates_figure(title: str, curves: Sequence[Curve]) -> Figure:
    """K̇ + V̇ − Q̇ of the runs (W), and its magnitude on a log axis."""
    with styled():
        figure = blank(6.4, title, below=0.85)
        panels = stacked(figure, [1.0, 1.0], [0.26])
        for curve, colour, width in zip(curves, COLOURS, WIDTHS, strict=False):
            assert curve.rate is not None
            size = np.abs(curve.rate)
            panels[0].plot(curve.t, curve.rate, color=colour, linewidth=width)
            panels[1].semilogy(
                curve.t, np.where(size > 0.0, size, np.nan), color=colour, linewidth=width
            )
        for panel, name in zip(panels, ("K̇ + V̇ − Q̇", "|K̇ + V̇ − Q̇|"), strict=True):
            panel.set_ylabel(f"{name} (W)")
            panel.margins(x=0)
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
        _legend(figure, curves)
        panels[-1].set_xlabel("time t (s)")
    return figure


def angles_figure(
    title: str, curves: Sequence[Curve], axes: Sequence[Sequence[float]] = ()
) -> Figure:
    """The angles of each run in a panel of its own, on the same axes or on those given."""
    with styled():
        figure = blank(1.2 + 3.0 * len(curves), title)
        panels = stacked(figure, [1.0] * len(curves), [0.16] * (len(curves) - 1))
        for panel in panels[1:]:
            if not axes:
                panel.sharey(panels[0])
        for panel, curve in zip(panels, curves, strict=True):
            for name, colour in zip(curve.angles, COLOURS, strict=False):
                _angle(panel, curve, name, color=colour, linewidth=1.0, label=name)
            panel.set_title(curve.label)
            panel.set_ylabel("angle (deg)")
        for panel, axis in zip(panels, axes, strict=False):
            _ticks(panel, *axis)
        columns = len(curves[0].angles)
        panels[0].legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.1
        )
        panels[-1].set_xlabel("time t (s)")
    return figure


def torque_figure(
    title: str, name: str, t: Array, torque: Array, axes: Sequence[Sequence[float]] = ()
) -> Figure:
    """A driving torque (N·m) over time, its extremes marked."""
    with styled():
        figure = blank(4.2, title)
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
        for axis in axes:
            _ticks(panel, *axis)
    return figure


def chain_figure(title: str, x: Array, y: Array, theta: Array) -> Figure:
    """A pinned chain of bars: joints at x, y (m), each bar's angle from the downward vertical (rad)."""
    with styled():
        figure = blank(5.6, title, width=4.6)
        panel = figure.subplots()
        panel.plot(x, y, "-o", color=COLOURS[1], linewidth=5, markersize=8, markerfacecolor="white")
        for k, angle in enumerate(theta):
            length = 0.55 * math.hypot(x[k + 1] - x[k], y[k + 1] - y[k])
            panel.plot([x[k], x[k]], [y[k], y[k] - length], color="#888888", linestyle=(0, (4, 3)))
            turn = np.linspace(0.0, angle, 40)
            arc = (x[k] + 0.8 * length * np.sin(turn), y[k] - 0.8 * length * np.cos(turn))
            panel.plot(*arc, color=COLOURS[0], linewidth=1.2)
            panel.annotate(
                f"θ{k + 1} = {math.degrees(angle):g}°",
                (arc[0][-1], arc[1][-1]),
                xytext=(8, -4),
                textcoords="offset points",
            )
            panel.annotate(
                f"M{k + 1}",
                (x[k], y[k]),
                xytext=(-10, 0),
                textcoords="offset points",
                ha="right",
                va="center",
            )
        panel.set_aspect("equal")
        panel.margins(0.3)
        panel.set_xlabel("x (m)")
        panel.set_ylabel("y (m)")
    return figure


# --- parts of figures -----------------------------------------------------------------------------


def stacked(figure: Figure, heights: Sequence[float], gaps: Sequence[float]) -> list[Axes]:
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
    stride = max(1, len(curve.t) // CURVE_POINTS)
    panel.plot(curve.t[::stride], curve.angles[name][::stride], **look)
    panel.margins(x=0)


def _delta_c(panel: Axes, curves: Sequence[Curve], function: str, floor: float) -> None:
    """|ΔC| on a log axis; what is below rounding, zero above all, is drawn at rounding."""
    for curve, colour, width in zip(curves, COLOURS, WIDTHS, strict=False):
        size = np.maximum(np.abs(curve.delta_c[function]), floor)
        panel.semilogy(curve.t, size, color=colour, linewidth=width)
    panel.axhline(floor, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)))
    panel.annotate(
        f"rounding of the energy exchanged, {floor:.0e} J: what is smaller is drawn here",
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
    highest = max(panel.get_ylim()[1] for panel in panels)
    top = int(np.ceil(np.log10(highest)))
    bottom = int(np.floor(np.log10(floor) - 0.08 * (top - np.log10(floor))))
    for panel in panels:
        _decades(panel, bottom, top, max(1, math.ceil((top - bottom) / 9)))


def _decades(panel: Axes, bottom: float, top: float, every: float) -> None:
    """A log axis between two powers of ten, with a tick every so many."""
    from matplotlib.ticker import LogLocator, NullLocator

    panel.set_ylim(10.0**bottom, 10.0**top)
    panel.yaxis.set_major_locator(LogLocator(base=10.0**every, numticks=20))
    panel.yaxis.set_minor_locator(NullLocator())


def _ticks(panel: Axes, bottom: float, top: float, every: float) -> None:
    from matplotlib.ticker import MultipleLocator

    panel.set_ylim(bottom, top)
    panel.yaxis.set_major_locator(MultipleLocator(every))


def _legend(figure: Figure, curves: Sequence[Curve]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, linewidth=2.4, label=curve.label)
        for curve, colour in zip(curves, COLOURS, strict=False)
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles))
