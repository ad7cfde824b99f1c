"""Figures of runs: angles and testing functions over time. Matplotlib without pyplot, so no state.

One function for each kind of figure; what they look like is defined here once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.study.convergence import Convergence, order_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltac.diagnosis.recommend.result import Recommendation
    from deltac.diagnosis.recommend.work_precision import Trial
    from deltac.diagnosis.study.study import Study
    from deltac.energy import Ledger


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
    energy_exchanged   (J): its rounding is the floor of |ΔC|
    """

    label: str
    t: Array
    angles: Mapping[str, Array]
    delta_c: Mapping[str, Array] = field(default_factory=dict)
    energy_exchanged: float = 0.0


def styled() -> AbstractContextManager[None]:
    """The style of all figures, for drawing and for writing them."""
    import matplotlib

    default = {k: v for k, v in matplotlib.rcParamsDefault.items() if k != "backend"}
    settings: Any = {**default, **STYLE}  # whatever a matplotlibrc says
    return matplotlib.rc_context(settings)


def testing_figure(
    title: str, curves: Sequence[Curve], *, decades: int | None = None, last_angles: bool = False
) -> Figure:
    """The panels of the thesis: the angles, |ΔC| of Liu-Huston, |ΔC| of Wang (log axes).

    The panel of the angles has a strip for each of them; with `last_angles` it shows the last run
    alone. `decades` are the powers of ten between two ticks of |ΔC|; without it as many as fit.
    Colours name the runs throughout.
    """
    names = list(curves[0].angles)
    with styled():
        figure = _figure(7.6, 9.0, title, below=0.85)
        heights = [*(1.3 / len(names) for _ in names), 1.0, 1.0]
        gaps = [*(0.07 for _ in names[1:]), 0.26, 0.26]
        panels = _stacked(figure, heights, gaps)
        strips, tests = panels[: len(names)], panels[len(names) :]
        shown = list(zip(curves, COLOURS, WIDTHS, strict=False))
        last = (
            f"of the last run, {curves[-1].label}"
            if last_angles
            else "(where runs coincide, the last shows)"
        )
        strips[0].set_title(f"Angles from the vertical {last}")
        for strip, name in zip(strips, names, strict=True):
            for curve, colour, width in shown[-1:] if last_angles else shown:
                _angle(strip, curve, name, color=colour, linewidth=width)
            strip.set_ylabel(f"{name} (deg)")
        floor = EPS * max(curve.energy_exchanged for curve in curves)
        for panel, (function, name) in zip(tests, NAMES.items(), strict=True):
            _delta_c(panel, curves, function, floor)
            panel.set_title(f"|ΔC| of {name}'s function")
        _same_decades(tests, floor, decades)
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


def chain_figure(title: str, x: Array, y: Array, theta: Array) -> Figure:
    """A pinned chain of bars: joints at x, y (m), each bar's angle from the downward vertical (rad)."""
    with styled():
        figure = _figure(4.6, 5.6, title)
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


def _same_decades(panels: Sequence[Axes], floor: float, every: int | None) -> None:
    """The same limits for all, at whole decades, with room for the note below the floor."""
    from matplotlib.ticker import LogLocator, NullLocator

    highest = max(panel.get_ylim()[1] for panel in panels)
    top = int(np.ceil(np.log10(highest)))
    bottom = int(np.floor(np.log10(floor) - 0.08 * (top - np.log10(floor))))
    stride = every or max(1, int(np.ceil((top - bottom) / 9)))
    if every:
        bottom, top = every * math.floor(bottom / every), every * math.ceil(top / every)
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


# --- the figure of an audit: energies and works over time, and below them what is left -----------

MOST_CHANNELS = 5
"""Channels drawn one by one; all smaller ones are drawn as one line."""


def audit_figure(
    title: str, ledger: Ledger, energy_error: Array, function: str, allowed: float
) -> Figure:
    """K, V and the works of the largest channels (J); below, `energy_error` with its error bar.

    `function` names the testing function that the bar belongs to; `allowed` (J) is drawn as a band.
    """
    with styled():
        figure = _figure(7.6, 6.0, title)
        flows, left = _stacked(figure, [2.2, 1.0], [0.2])
        stride = max(1, len(ledger.t) // POINTS)
        _flows(flows, ledger, stride)
        _energy_error(left, ledger, energy_error, function, allowed, stride)
        left.set_xlabel("time t (s)")
        for panel in (flows, left):
            panel.yaxis.set_label_coords(-0.52 / 6.74, 0.5)
            panel.margins(x=0)
    return figure


def _flows(panel: Axes, ledger: Ledger, stride: int) -> None:
    t = ledger.t[::stride]
    K, V = ledger.kinetic, ledger.potential_energy
    panel.plot(t, (K - K[0])[::stride], color="#111111", linewidth=1.8, label="K − K(0)")
    panel.plot(
        t,
        (V - V[0])[::stride],
        color="#111111",
        linewidth=1.2,
        linestyle=(0, (5, 2)),
        label="V − V(0)",
    )
    flowing = {n: w - w[0] for n, w in ledger.work.items() if n not in ledger.potential}
    ranked = sorted(flowing.items(), key=lambda item: -float(np.ptp(item[1])))
    shown, rest = ranked[:MOST_CHANNELS], ranked[MOST_CHANNELS:]
    for (name, work), colour in zip(shown, (*COLOURS[:2], *COLOURS[3:], "#e69f00")):
        panel.plot(t, work[::stride], color=colour, linewidth=1.3, label=name)
    if rest:
        others = np.sum([work for _, work in rest], axis=0)
        panel.plot(t, others[::stride], color="#999999", label=f"{len(rest)} smaller channels")
    panel.set_title("Energies, and works of what is not in V")
    panel.set_ylabel("energy (J)")
    panel.legend(loc="best", fontsize=7.5, ncols=2, frameon=True, framealpha=0.8, edgecolor="none")


def _energy_error(
    panel: Axes, ledger: Ledger, energy_error: Array, function: str, allowed: float, stride: int
) -> None:
    t, left = ledger.t[::stride], energy_error[::stride]
    bar = ledger.error_bar[function][::stride]
    panel.axhspan(-allowed, allowed, color="#009e73", alpha=0.10, linewidth=0, label="accepted")
    panel.fill_between(t, left - bar, left + bar, color="#0072b2", alpha=0.25, linewidth=0)
    panel.plot(t, left, color="#0072b2", linewidth=1.2, label="ΔC with its error bar")
    panel.set_title("What is left")
    panel.set_ylabel("ΔC (J)")
    panel.legend(loc="best", fontsize=7.5, ncols=2, frameon=True, framealpha=0.8, edgecolor="none")


# --- the figure of a study -----------------------------------------------------------------------

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
    floor = max(EPS * m.energy_exchanged, DECADES * m.left[-1], float(np.finfo(np.float64).tiny))
    palette = (*COLOURS[:2], *COLOURS[3:], COLOURS[2])
    for k, (entry, colour) in enumerate(zip(runs, (palette[i % 5] for i in range(len(runs))))):
        assert entry.run is not None and entry.energy_error is not None
        stride = max(1, len(entry.run) // POINTS)
        size = np.maximum(np.abs(entry.energy_error[study.function]), floor)
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


# --- the figure of a recommendation: time against error, a curve for each solver -----------------

MARKS = "osD^vPX*<>ph"


def recommendation_figure(title: str, advice: Recommendation) -> Figure:
    """Every trial by the time it takes, against the largest |ΔC| and, below, the error of the motion."""
    with styled():
        figure = _figure(7.6, 7.4, title)
        energy, motion = _stacked(figure, [1.0, 1.0], [0.3])
        _scatter(energy, advice, "energy", advice.tolerance)
        _scatter(motion, advice, "motion", advice.motion_tolerance)
        energy.set_title("largest |ΔC|, share of the energy exchanged")
        motion.set_title("error of q and u, share of their ranges (where the energy is kept)")
        motion.set_xlabel("time of a run (s)")
        energy.legend(loc="upper right", fontsize=7.5, ncols=2)
    return figure


def _scatter(panel: Axes, advice: Recommendation, what: str, tolerance: float) -> None:
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
