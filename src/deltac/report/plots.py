"""What each result draws of itself: the pictures behind `result.plot()` and ``--figure``.

One function for each kind of result, in `DRAWN`. Most draw the panels that the page of the result shows too.
All are of one width; legends stand beside the axes, where they cover nothing.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import EPS, TINY, Array, max_norm
from deltac.errors import InputError, WrongType, check_names
from deltac.report.panels import (
    MOST_DRAWN,
    Bars,
    Flows,
    Guide,
    LogPlot,
    Panel,
    TimePlot,
    all_functions,
    audit_errors,
    by_name,
    energy_plots,
    flows_of,
    fronts,
    lowest,
    momentum_functions,
    orders,
    residuals,
    study_errors,
)
from deltac.report.picture import blank
from deltac.report.style import (
    BAD,
    COLOURS,
    DASHED,
    DOTTED,
    DOUBT,
    GOOD,
    GREY,
    INK,
    LEGEND_WIDTH,
    SHADES,
    SMALL_TEXT,
    WIDTH,
    align_labels,
    entitle,
    fitted,
    legend_beside,
    styled,
    thinned,
)
from deltac.results import number, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltac.analysis.linearise import Linearisation
    from deltac.diagnosis import (
        Audit,
        EquationCheck,
        Explanation,
        Localisation,
        Recommendation,
        Study,
    )
    from deltac.energy import Ledger
    from deltac.mechanism import Mechanism
    from deltac.models import StateLike
    from deltac.procedure import Examination
    from deltac.repair.mutate.report import MutationReport
    from deltac.trajectories import Trajectory


def figure(result: Any, *, title: str | None = None, **options: Any) -> Figure:
    """The figure of a result; InputError for one that has no picture, or options that it does not take."""
    for kind in type(result).__mro__:
        if kind.__name__ in DRAWN:
            draw = DRAWN[kind.__name__]
            break
    else:
        raise WrongType(
            f"{type(result).__name__} has no picture; those of {', '.join(sorted(DRAWN))} have one. "
            "explain() tells it in words"
        )
    parameters = list(inspect.signature(draw).parameters)[1:]
    check_names(options, parameters, f"plot of {type(result).__name__}: there is no option")
    with styled():
        drawn = draw(result, **options)
    if title is not None:
        entitle(drawn, title)
    return drawn


# --- a motion ------------------------------------------------------------------------------------


def _trajectory(run: Trajectory, names: Sequence[str] | str | None = None) -> Figure:
    """Coordinates and speeds over time; `names` chooses among both, else those that move most."""
    chosen = [names] if isinstance(names, str) else names
    names_of_run = (*run.coordinates, *run.speeds)
    check_names(chosen or (), names_of_run, "plot: no coordinate or speed is called")

    def columns(entries: Sequence[str], values: Array) -> list[tuple[str, Array]]:
        return [(n, values[:, k]) for k, n in enumerate(entries) if chosen is None or n in chosen]

    drawing = _drawn(
        run.provenance.model or run.provenance.simulator,
        by_name("Coordinates", run.t, columns(run.coordinates, run.q), "m, rad"),
        by_name("Speeds", run.t, columns(run.speeds, run.u), "m/s, rad/s"),
    )
    for panel in drawing.axes:
        for k, event in enumerate(run.events):
            label = "_" if k else "impacts, switches, events"
            panel.axvline(
                event.t, color=GREY, linewidth=0.5, linestyle=DOTTED, label=label, zorder=1
            )
        legend_beside(panel)
    return drawing


# --- panels ----------------------------------------------------------------------------------------


def _colour(colour: int | str | None, k: int) -> str:
    """The colour of a curve, by default that of its place."""
    return (
        SHADES[colour]
        if isinstance(colour, str)
        else COLOURS[(k if colour is None else colour) % len(COLOURS)]
    )


MARKS = "osD^vPX*<>ph"

PANEL_GAP = 0.72
"""Between two panels that each have a title and a label (inches)."""


def _drawn(title: str, *panels: Panel) -> Figure:
    """A figure of those panels below one another that have something to show."""
    shown = [panel for panel in panels if not isinstance(panel, TimePlot) or panel.lines]
    heights = [_HEIGHTS[type(panel)](panel) for panel in shown]
    ratios = [heights[0]]
    for height in heights[1:]:
        ratios += [PANEL_GAP, height]
    drawing = blank(sum(ratios) + 1.12, title, right=LEGEND_WIDTH)
    grid = drawing.add_gridspec(len(ratios), 1, height_ratios=ratios, hspace=0.0)
    for k, panel in enumerate(shown):
        _DRAWERS[type(panel)](drawing.add_subplot(grid[2 * k, 0]), panel)
    align_labels(drawing)
    for panel in shown:
        if isinstance(panel, Bars):  # names stand where the label would
            letters = max(len(fitted(name, 18).splitlines()[0]) for name, *_ in panel.bars)
            drawing.subplots_adjust(left=(0.5 + 0.08 * letters) / drawing.get_figwidth())
    return drawing


def _time(panel: Axes, plot: TimePlot) -> None:
    """Curves over time; what a page shows on demand only is grey here. On a log axis bars are a band."""
    shown = [line for line in plot.lines if line.shown][: len(COLOURS)]
    rest = [line for line in plot.lines if line not in shown]
    guides = [guide.value for guide in plot.guides]
    sizes = [float(np.nanmax(np.abs(line.y), initial=0.0)) for line in plot.lines]
    floor = max(0.1 * EPS * max([*sizes, *guides], default=0.0), TINY)

    def values(y: Array) -> Array:
        return np.fmax(np.abs(y), floor) if plot.log else y

    for k, line in enumerate(shown):
        colour = _colour(line.colour, k)
        look: dict[str, Any] = {"color": colour, "linewidth": 1.3}
        if line.dashed:
            look |= {"linestyle": DASHED, "linewidth": 1.1}
        panel.plot(*thinned(plot.t, values(line.y)), label=line.name, **look)
        if line.bar is not None:
            low, high = (floor, line.bar) if plot.log else (line.y - line.bar, line.y + line.bar)
            t, top = thinned(plot.t, np.fmax(high, floor) if plot.log else high)
            below = np.full(len(t), floor) if plot.log else np.interp(t, plot.t, low)
            label = "its error bar" if len(shown) == 1 else None
            band: dict[str, Any] = {"color": GREY, "alpha": 0.25, "linewidth": 0, "label": label}
            panel.fill_between(t, below, top, **band)
    for k, line in enumerate(rest):
        look = {"color": "#bbbbbb", "linewidth": 0.7, "zorder": 1.5}
        panel.plot(
            *thinned(plot.t, values(line.y)), label="_" if k else f"{len(rest)} more", **look
        )
    if plot.log:
        panel.set_yscale("log")
    _guides(panel, plot.guides, plot.unit)
    if plot.log:
        least = min([lowest(line.y for line in shown), *guides, 1e300])
        panel.set_ylim(bottom=max(floor, 0.5 * least))
    panel.margins(x=0)
    panel.set_title(plot.title)
    panel.set_xlabel("time t (s)")
    panel.set_ylabel(plot.unit)
    legend_beside(panel)


def _points(panel: Axes, plot: LogPlot) -> None:
    """Points on two log axes, with the lines through them."""
    from matplotlib.ticker import LogLocator, NullFormatter

    for k, cloud in enumerate(plot.clouds):
        colour, mark = _colour(cloud.colour, k), MARKS[k % len(MARKS)]
        look: dict[str, Any] = {"color": colour, "marker": mark, "markersize": 4.5}
        style = "solid" if cloud.joined and cloud.fit is None else "none"
        panel.plot(cloud.x, cloud.y, label=cloud.name, linewidth=0.9, linestyle=style, **look)
        if cloud.fit is not None:
            panel.plot(*zip(*cloud.fit), color=colour, linewidth=1.0, label=cloud.fit_name)
        if cloud.mark is not None:
            ring: dict[str, Any] = {"marker": "o", "markersize": 12, "markerfacecolor": "none"}
            ring |= {"markeredgecolor": colour, "linestyle": "none", "label": "recommended"}
            panel.plot(cloud.x[cloud.mark], cloud.y[cloud.mark], **ring)
    panel.set_xscale("log")
    panel.set_yscale("log")
    _guides(panel, plot.guides, "")
    low, high = panel.get_xlim()
    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
    panel.xaxis.set_major_formatter(lambda x, _: number(x))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_title(f"{plot.title}: {plot.y}")
    panel.set_xlabel(plot.x)
    legend_beside(panel)


def _bars(panel: Axes, plot: Bars) -> None:
    """Sizes on a log axis; the largest ones, in their order."""
    ranked = sorted(range(len(plot.bars)), key=lambda k: -plot.bars[k][1])[:MOST_DRAWN]
    shown = [plot.bars[k] for k in sorted(ranked)]
    floor = 0.25 * EPS
    for row, (_, size, large) in enumerate(shown):
        size = size if math.isfinite(size) else 1.0 / EPS
        colour = BAD if large else DOUBT if size > plot.limit else GOOD
        panel.plot([floor, max(size, floor)], [row, row], color=colour, linewidth=5.0)
    panel.set_xscale("log")
    panel.set_xlim(left=0.5 * floor)
    _guides(panel, (Guide("accepted", plot.limit),), "", upright=True)
    panel.set_yticks(range(len(shown)), [fitted(name, 18).splitlines()[0] for name, *_ in shown])
    panel.set_ylim(max(len(shown), 3) - 0.4, -0.6)
    panel.set_title(plot.title)
    panel.set_xlabel("relative residual")
    legend_beside(panel)


def _flows(panel: Axes, plot: Flows) -> None:
    """Works that went in, the energies that they changed, and what is left."""
    words = [
        f"{fitted(f.name, 22).splitlines()[0]}  {number(f.energy, 'J', 3)}".replace("-", "−")
        for f in plot.flows
    ]
    colours = [_colour(f.colour, 0) for f in plot.flows]
    _lying_bars(panel, [f.energy for f in plot.flows], colours, words, colours)
    panel.set_yticks(range(len(words)), [""] * len(words))
    panel.tick_params(axis="y", length=0)
    panel.invert_yaxis()
    panel.axvline(0.0, color=GREY, linewidth=0.8)
    panel.grid(visible=False, axis="y")
    panel.set_title(plot.title)
    panel.set_xlabel("energy (J)")


def _lying_bars(
    panel: Axes,
    sizes: Sequence[float],
    colours: Sequence[str],
    words: Sequence[str],
    inks: Sequence[str],
) -> None:
    """A bar for each size, one below the other, its words beside the axes."""
    panel.barh(range(len(sizes)), sizes, color=colours, height=0.66)
    look: dict[str, Any] = {"va": "center", "fontsize": SMALL_TEXT, "annotation_clip": False}
    across = panel.get_yaxis_transform()
    for place, (text, ink) in enumerate(zip(words, inks)):
        panel.annotate(text, (1.01, place), xycoords=across, color=ink, **look)


def _guides(panel: Axes, guides: Sequence[Guide], unit: str, *, upright: bool = False) -> None:
    """Levels that curves are compared with; what is accepted is green."""
    for guide in guides:
        line = panel.axvline if upright else panel.axhline
        colour = GREY if guide.name == "energy of the system" else GOOD
        label = f"{guide.name}, {number(guide.value, unit, 3)}"
        line(guide.value, color=colour, linewidth=1.1, linestyle=DASHED, label=label)


_DRAWERS: dict[type, Callable[[Axes, Any], None]] = {
    TimePlot: _time, LogPlot: _points, Bars: _bars, Flows: _flows,
}  # fmt: skip

_HEIGHTS: dict[type, Callable[[Any], float]] = {
    TimePlot: lambda plot: 2.0 if plot.tall else 1.6,
    LogPlot: lambda plot: 2.5,
    Bars: lambda plot: 0.3 * max(min(len(plot.bars), MOST_DRAWN), 3),
    Flows: lambda plot: 0.2 * len(plot.flows) + 0.1,
}
"""Of panels, inches."""


def _ledger(ledger: Ledger) -> Figure:
    function = next((n for n in ("wang", "liu-huston") if n in ledger.delta_c), None)
    flows = () if function is None else (flows_of(ledger, function),)
    momenta = (momentum_functions(ledger),) if ledger.delta_p else ()
    tests = (all_functions(ledger), *momenta)
    return _drawn("Energy ledger", *energy_plots(ledger), *tests, *flows)


def _audit(audit: Audit) -> Figure:
    run = audit.run.provenance
    source = " ".join(filter(None, (run.simulator, run.solver)))
    return _drawn(
        f"{audit.mechanism.name}, by {source}: {audit.verdict.kind}",
        *energy_plots(audit.ledger),
        audit_errors(audit),
        flows_of(audit.ledger, audit.function, audit.energy_error),
    )


def _study(study: Study) -> Figure:
    title = f"{study.mechanism.name}, by {study.solver}: {study.verdict.kind}"
    return _drawn(title, orders(study), study_errors(study))


def _check(check: EquationCheck) -> Figure:
    return _drawn(f"{check.name}: {check.verdict.kind}", residuals(check))


def _recommendation(advice: Recommendation) -> Figure:
    title = f"Work and precision: {advice.summary()}"
    return _drawn(title, *fronts(advice))


def _localisation(report: Localisation) -> Figure:
    """The residual of each equation over time, and the power that each joint takes beyond the model's."""
    residuals = [(name, report.residual[:, k]) for k, name in enumerate(report.speeds)]
    return _drawn(
        "Where the motion departs from the model",
        by_name("Residual of each equation, F + F*", report.t, residuals, "N, N·m"),
        by_name(
            "Power beyond what the model supplies, by joint",
            report.t,
            [*report.joints.items()],
            "W",
        ),
    )


def _explanation(report: Explanation) -> Figure:
    """What each cause explains of the residual of the equations."""
    causes = report.causes
    drawing = blank(1.6 + 0.34 * max(len(causes), 2), f"Causes: {report.kind}", right=LEGEND_WIDTH)
    panel = drawing.subplots()
    words, count = [fitted(f"{c.kind} {c.element}") for c in causes], len(causes)
    _lying_bars(panel, [100.0 * c.share for c in causes], [BAD] * count, words, [INK] * count)
    panel.set_yticks(range(count), [str(k + 1) for k in range(count)])
    panel.set_ylim(max(len(causes), 2) - 0.4, -0.6)
    panel.set_xlim(0.0, 100.0)
    panel.set_title(f"Together they explain {percent(report.explained)} of the squared residual")
    panel.set_xlabel("share that the cause alone explains of what the others leave (%)")
    panel.set_ylabel("cause")
    align_labels(drawing)
    return drawing


def _mutants(report: MutationReport) -> Figure:
    """Of the mistakes made on purpose, the share that each test sees, by kind."""
    counts = report.counts()
    kinds = list(counts)
    drawing = blank(
        1.4 + 0.34 * max(len(kinds), 3), f"{report.function}: who sees a mistake?", right=0.9
    )
    panel = drawing.subplots()
    mistakes = [row["mutants"] - row["equivalent"] for row in counts.values()]
    share = np.array(
        [
            [row[test] / most if most else math.nan for test in report.tests]
            for row, most in zip(counts.values(), mistakes)
        ]
    ).reshape(len(kinds), len(report.tests))
    drawing.subplots_adjust(
        left=1.5 / drawing.get_figwidth(), top=1.0 - 0.95 / drawing.get_figheight()
    )
    panel.imshow(share, cmap="viridis", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(share):
        text = "–" if math.isnan(value) else f"{100 * value:.0f} %"
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": SMALL_TEXT}
        panel.text(column, row, text, color="black" if value > 0.55 else "white", **look)
    panel.set_xticks(
        range(len(report.tests)), [fitted(t, 14) for t in report.tests], fontsize=SMALL_TEXT
    )
    panel.set_yticks(range(len(kinds)), [f"{k} ({m})" for k, m in zip(kinds, mistakes)])
    panel.xaxis.tick_top()
    panel.grid(visible=False)
    panel.tick_params(length=0)
    for side in panel.spines.values():
        side.set_visible(False)
    return drawing


# --- other results -------------------------------------------------------------------------------


def _examination(report: Examination) -> Figure:
    """The picture of the part that decides: the last of those with the exit code of the whole."""
    deciding = [part for part in report.results.values() if part.exit_code == report.exit_code]
    if not deciding:
        raise InputError("nothing was examined, so there is nothing to draw")
    drawing = figure(deciding[-1])
    entitle(drawing, report.summary())
    return drawing


def _linearisation(report: Linearisation) -> Figure:
    """The eigenvalues in the complex plane; what grows is right of the line."""
    drawing = blank(4.4, "Eigenvalues", right=LEGEND_WIDTH)
    panel = drawing.subplots()
    values = report.eigenvalues
    size = 1e-9 * max_norm(values)
    for label, colour, subset in (
        ("decaying", GOOD, values.real < -size),
        ("neither", INK, np.abs(values.real) <= size),
        ("growing", BAD, values.real > size),
    ):
        if subset.any():
            panel.plot(values.real[subset], values.imag[subset], "o", color=colour, label=label)
    panel.axvline(0.0, color=GREY, linewidth=0.8)
    panel.axhline(0.0, color=GREY, linewidth=0.8)
    reach = 1.15 * max_norm(values) or 1.0
    panel.set_xlim(-reach, reach)
    panel.set_ylim(-reach, reach)
    panel.set_title(f"About the state at t = {report.state.t:g} s")
    panel.set_xlabel("Re λ (1/s)")
    panel.set_ylabel("Im λ (1/s)")
    legend_beside(panel)
    align_labels(drawing)
    return drawing


def _mechanism(mechanism: Mechanism, state: StateLike | Trajectory | None = None) -> Figure:
    """The mechanism at a state, or along a run; by default with all coordinates zero."""
    from deltac.models import load_model
    from deltac.report.still import still
    from deltac.trajectories import Trajectory

    if isinstance(state, Trajectory):
        return still(mechanism, state, places=6, title=mechanism.name, size=(WIDTH, 5.0))
    at = None if state is None else load_model(mechanism).start(state)
    return still(mechanism, at, title=mechanism.name, size=(WIDTH, 5.0))


DRAWN: dict[str, Callable[..., Figure]] = {
    "Mechanism": _mechanism,
    "Trajectory": _trajectory,
    "Ledger": _ledger,
    "Audit": _audit,
    "Study": _study,
    "EquationCheck": _check,
    "Localisation": _localisation,
    "Explanation": _explanation,
    "MutationReport": _mutants,
    "Recommendation": _recommendation,
    "Examination": _examination,
    "Linearisation": _linearisation,
}
"""The results that have a picture, by class, so that none is loaded that is not there."""

__all__ = ["COLOURS", "DRAWN", "figure"]
