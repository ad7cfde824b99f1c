"""What each result draws of itself: the pictures behind `result.plot()` and ``--figure``.

One function for each kind of result, in `DRAWN`. All of them are of one width; legends stand beside the
axes, where they cover nothing.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import EPS, TINY, Array
from deltac.diagnosis.study.convergence import Convergence, order_text
from deltac.errors import InputError, UnknownName, WrongType, closest
from deltac.report.style import (
    BESIDE,
    BLACK,
    BLUE,
    COLOURS,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    ORANGE,
    PINK,
    SMALL,
    VERMILION,
    WIDTH,
    align_labels,
    blank,
    entitle,
    fitted,
    legend_beside,
    shades,
    stacked,
    styled,
    thinned,
)
from deltac.results import number, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltac.analysis.linearise import Linearisation
    from deltac.diagnosis.audit.audit import Audit
    from deltac.diagnosis.check.check import EquationCheck
    from deltac.diagnosis.check.localise import Localisation
    from deltac.diagnosis.explain.result import Explanation
    from deltac.diagnosis.recommend.result import Recommendation
    from deltac.diagnosis.recommend.work_precision import Trial
    from deltac.diagnosis.study.study import Study
    from deltac.energy import Ledger
    from deltac.mechanism.mechanism import Mechanism
    from deltac.procedure import Examination
    from deltac.repair.mutate.report import MutationReport
    from deltac.trajectories import Trajectory

MANY = (BLUE, VERMILION, GREEN, ORANGE, PINK, BLACK)
"""Colours of curves of one panel; those that follow are grey."""


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
    taken = list(inspect.signature(draw).parameters)[1:]
    for option in options:
        if option not in taken:
            raise UnknownName(
                f"plot of {type(result).__name__}: there is no option {option!r}"
                f"{closest(option, taken)}"
            )
    with styled():
        drawn = draw(result, **options)
    if title is not None:
        entitle(drawn, title)
    return drawn


# --- a motion ------------------------------------------------------------------------------------


def _trajectory(run: Trajectory, names: Sequence[str] | str | None = None) -> Figure:
    """Coordinates and speeds over time; `names` chooses among both, else those that move most."""
    chosen = [names] if isinstance(names, str) else names
    known = {*run.coordinates, *run.speeds}
    for name in chosen or ():
        if name not in known:
            raise UnknownName(
                f"plot: no coordinate or speed is called {name!r}{closest(name, known)}"
            )
    made = blank(6.4, run.provenance.model or run.provenance.simulator, beside=BESIDE)
    panels = stacked(made, [1.0, 1.0], [0.16])
    told = (
        ("Coordinates", "q (m, rad)", run.coordinates, run.q),
        ("Speeds", "u (m/s, rad/s)", run.speeds, run.u),
    )
    for panel, (title, label, entries, values) in zip(panels, told):
        _columns(panel, run.t, entries, values, chosen)
        panel.set_title(title)
        panel.set_ylabel(label)
        _instants(panel, run)
        legend_beside(panel)
    panels[-1].set_xlabel("time t (s)")
    align_labels(made)
    return made


def _columns(
    panel: Axes, t: Array, names: Sequence[str], values: Array, chosen: Sequence[str] | None
) -> None:
    """The chosen columns; without a choice those with the largest ranges, and the others in grey."""
    order = [int(k) for k in np.argsort(-np.ptp(values, axis=0), kind="stable")]
    if chosen is not None:
        order = [names.index(name) for name in chosen if name in names]
    shown = sorted(order[: len(MANY)])
    for k, colour in zip(shown, MANY):
        panel.plot(*thinned(t, values[:, k]), color=colour, linewidth=1.3, label=names[k])
    rest = order[len(MANY) :]
    for j, k in enumerate(rest):
        label = f"{len(rest)} that move less" if chosen is None else f"{len(rest)} more"
        look: dict[str, Any] = {"color": "#bbbbbb", "linewidth": 0.7, "zorder": 1.5}
        panel.plot(*thinned(t, values[:, k]), label="_" if j else label, **look)
    panel.margins(x=0)


def _instants(panel: Axes, run: Trajectory) -> None:
    """Impacts and switches as hair lines."""
    for k, event in enumerate(run.events):
        label = "_" if k else "impacts, switches, events"
        panel.axvline(event.t, color=GREY, linewidth=0.5, linestyle=DOTTED, label=label, zorder=1)


# --- where the energy went -----------------------------------------------------------------------

MOST_CHANNELS = 5
"""Channels drawn one by one; all smaller ones are drawn as one line."""

MOST_BARS = 12

NOTHING = 1e-6
"""Share of the energy exchanged below which a work is not drawn by itself: it could not be seen."""

GAP = 0.72
"""Between two panels that each have a title and a label (inches)."""


def _ledger(ledger: Ledger) -> Figure:
    curves = {name: (d, ledger.error_bar[name]) for name, d in ledger.delta_c.items()}
    return _energy_figure("Energy ledger", ledger, curves, None)


def _audit(audit: Audit) -> Figure:
    run = audit.run.provenance
    made = " ".join(filter(None, (run.simulator, run.solver)))
    curves = {audit.function: (audit.energy_error, audit.ledger.error_bar[audit.function])}
    title = f"{audit.mechanism.name}, by {made}: {audit.verdict.kind}"
    return _energy_figure(title, audit.ledger, curves, audit.tolerance * audit.beside)


def _energy_figure(
    title: str, ledger: Ledger, curves: Mapping[str, tuple[Array, Array]], allowed: float | None
) -> Figure:
    """K, V and works over time; |ΔC| beside its error bar and the energy exchanged; works at the end."""
    bars = _final(ledger)
    heights = [2.0, GAP, 1.5, GAP, 0.2 * len(bars) + 0.1]
    made = blank(sum(heights) + 1.12, title, beside=BESIDE)
    grid = made.add_gridspec(5, 1, height_ratios=heights, hspace=0.0)
    flows, left, ends = (made.add_subplot(grid[row, 0]) for row in (0, 2, 4))
    _flows(flows, ledger)
    _size_of_errors(left, ledger, curves, allowed)
    for panel in (flows, left):
        panel.margins(x=0)
        panel.set_xlabel("time t (s)")
        legend_beside(panel)
    align_labels(made)
    _ends(ends, bars)
    return made


def _flows(panel: Axes, ledger: Ledger) -> None:
    K, V = ledger.kinetic, ledger.potential_energy
    panel.plot(*thinned(ledger.t, K - K[0]), color=BLACK, linewidth=1.8, label="K − K(0)")
    if ledger.potential:
        look: dict[str, Any] = {"color": BLACK, "linewidth": 1.2, "linestyle": DASHED}
        panel.plot(*thinned(ledger.t, V - V[0]), label="V − V(0)", **look)
    flowing = _flowing(ledger)
    ranked = sorted(flowing.items(), key=lambda item: -float(np.ptp(item[1])))
    shown, rest = ranked[:MOST_CHANNELS], ranked[MOST_CHANNELS:]
    for (name, work), colour in zip(shown, MANY):
        panel.plot(*thinned(ledger.t, work), color=colour, linewidth=1.3, label=str(name))
    if rest:
        others = np.sum([work for _, work in rest], axis=0)
        panel.plot(*thinned(ledger.t, others), color="#999999", label=f"{len(rest)} smaller works")
    panel.set_title("Energies, and works of what is not in V" if flowing else "Energies")
    panel.set_ylabel("energy (J)")


def _flowing(ledger: Ledger) -> dict[str, Array]:
    """Works (T,) of what is not in V and can be seen."""
    seen = NOTHING * ledger.energy_exchanged
    works = {str(n): w - w[0] for n, w in ledger.work.items() if n not in ledger.potential}
    return {name: work for name, work in works.items() if float(np.ptp(work)) > seen}


def _size_of_errors(
    panel: Axes,
    ledger: Ledger,
    curves: Mapping[str, tuple[Array, Array]],
    allowed: float | None,
) -> None:
    """|ΔC| on a log axis, from rounding to the energy exchanged; below its error bar the band is grey."""
    scale = ledger.energy_exchanged
    floor = max(0.1 * EPS * scale, TINY)
    for (name, (delta_c, _)), colour in zip(curves.items(), MANY):
        t, size = thinned(ledger.t, np.abs(delta_c))
        panel.semilogy(
            t, np.maximum(size, floor), color=colour, linewidth=1.2, label=f"|ΔC| {name}"
        )
    bars = np.max([bar for _, bar in curves.values()], axis=0, initial=floor)
    t, bar = thinned(ledger.t, np.maximum(bars, floor))
    panel.set_yscale("log")
    panel.fill_between(
        t, np.full(len(t), floor), bar, color=GREY, alpha=0.25, linewidth=0, label="its error bar"
    )
    if allowed is not None and allowed > 0.0:
        label = f"accepted, {number(allowed, 'J', 2)}"
        panel.axhline(allowed, color=GREEN, linewidth=1.1, linestyle=DASHED, label=label)
    if scale > 0.0:
        label = f"energy exchanged, {number(scale, 'J', 3)}"
        panel.axhline(scale, color=GREY, linewidth=1.1, linestyle=DASHED, label=label)
        panel.set_ylim(floor, 10.0 * scale)
    panel.set_title("What is left: |ΔC|, which an exact motion keeps at zero")
    panel.set_ylabel("|ΔC| (J)")


def _final(ledger: Ledger) -> list[tuple[str, float, str]]:
    """Name, energy (J) and colour of each bar: where energy came from, and where it is now."""
    flowing = _flowing(ledger)
    works = {str(n): w["work"] for n, w in ledger.works().items() if str(n) in flowing}
    rest = list(works)[MOST_BARS:]
    if rest:
        works[f"{len(rest)} smaller works"] = sum(works.pop(name) for name in rest)
    bars = [(name, work, VERMILION) for name, work in works.items()]
    return bars + [(f"Δ{name}", change, BLUE) for name, change in ledger.energies().items()]


def _ends(panel: Axes, bars: Sequence[tuple[str, float, str]]) -> None:
    """Works that went in, against the energies that they changed."""
    places = np.arange(len(bars))
    panel.barh(places, [b[1] for b in bars], color=[b[2] for b in bars], height=0.66)
    panel.set_yticks(places, [""] * len(bars))
    panel.tick_params(axis="y", length=0)
    for place, (name, value, colour) in zip(places, bars):
        look: dict[str, Any] = {"va": "center", "fontsize": SMALL, "annotation_clip": False}
        panel.annotate(
            f"{fitted(name, 22).splitlines()[0]}  {number(value, 'J', 3)}".replace("-", "−"),
            (1.01, place),
            xycoords=panel.get_yaxis_transform(),
            color=colour,
            **look,
        )
    panel.invert_yaxis()
    panel.axvline(0.0, color=GREY, linewidth=0.8)
    panel.grid(visible=False, axis="y")
    panel.set_title("Over the whole time: works, and the changes of energy that they add up to")
    panel.set_xlabel("energy (J)")


# --- a study -------------------------------------------------------------------------------------

DECADES = 1e-6
"""What is smaller than this share of the finest run's largest |ΔC| is drawn there."""

SEEN = 0.02
"""Points of one step that differ by more than this are drawn as two."""


def _study(study: Study) -> Figure:
    """Largest |ΔC| (J) and state difference (of the range) over the step, log-log; |ΔC|(t) at each step.

    The line has the observed order; where ΔC tends to a limit, the limit is drawn with its uncertainty.
    """
    title = f"{study.mechanism.name}, by {study.solver}: {study.verdict.kind}"
    made = blank(7.2, title, beside=BESIDE)
    grid = made.add_gridspec(2, 1, height_ratios=[1.15, 1.0], hspace=0.38)
    for row, draw in enumerate((_over_steps, _over_time)):
        panel = made.add_subplot(grid[row, 0])
        draw(panel, study)
        legend_beside(panel)
    align_labels(made)
    return made


def _over_steps(panel: Axes, study: Study) -> None:
    m = study.measures
    h, left, bars = (np.asarray(x) for x in (m.steps, m.left, m.bars))
    panel.loglog(h, np.maximum(left, TINY), "o", color=BLUE, markersize=6, label="largest |ΔC| (J)")
    energy, state = study.observed_order[study.function], study.observed_order["state"]
    fitted_to = np.asarray(energy.sizes)
    common = h[len(h) - len(fitted_to) :]
    if (np.abs(fitted_to - left[len(h) - len(fitted_to) :]) > SEEN * fitted_to).any():
        panel.loglog(
            common,
            np.maximum(fitted_to, TINY),
            "o",
            color=BLUE,
            markerfacecolor="none",
            markersize=9,
            label="the same, before the motions part"
            if study.horizon < study.comparison.t[-1]
            else "the same, at times that all steps share",
        )
    _line(panel, common, fitted_to, energy, BLUE, limited=energy.trend == "tends to a limit")
    sizes = np.asarray(state.sizes)
    if len(sizes) and (sizes > 0.0).any():
        shown = h[len(h) - len(sizes) - 1 : -1]
        label = "state, difference to the next (of its range)"
        panel.loglog(shown, sizes, "s", color=VERMILION, markersize=5, label=label)
        _line(panel, shown, sizes, state, VERMILION)
    panel.loglog(
        *(h, np.maximum(bars, TINY)),
        color=GREY,
        linestyle=DOTTED,
        label="rounding and quadrature (J)",
    )
    if m.allowed > 0.0:
        label = f"accepted, {number(m.allowed, 'J', 2)}"
        panel.axhline(m.allowed, color=GREEN, linewidth=1.1, linestyle=DASHED, label=label)
    if energy.trend == "tends to a limit":
        label = f"limit of |ΔC|, {number(energy.limit, 'J', 3)}"
        panel.axhline(energy.limit, color=BLUE, linewidth=1.2, linestyle=DASHED, label=label)
    panel.set_title("What is left, over the step" if m.unit else "What is left, over the tolerance")
    panel.set_xlabel("step h (s)" if m.unit else "tolerance")
    panel.set_ylabel("error")
    panel.set_xlim(h[-1] / 1.5, h[0] * 1.5)
    panel.set_xticks(h, [f"{x:g}" for x in h])
    panel.minorticks_off()


def _line(
    panel: Axes, h: Array, sizes: Array, found: Convergence, colour: str, *, limited: bool = False
) -> None:
    """The observed order through the finest of the points that gave it; `sizes` are what it was fitted to."""
    if found.order is None or not found.steps or found.trend == "does not settle" or limited:
        return
    near = [int(np.argmin(np.abs(h - step))) for step in found.steps]
    through = near[-1]
    if sizes[through] <= 0.0:
        return
    line = sizes[through] * (h / h[through]) ** found.order
    label = f"order {order_text(found)}"
    panel.loglog(h, line, color=colour, linewidth=1.0, alpha=0.7, label=label)


def _over_time(panel: Axes, study: Study) -> None:
    runs = [r for r in study.runs if r.step in study.measures.steps and r.run is not None]
    m = study.measures
    floor = max(EPS * m.energy_exchanged, DECADES * m.left[-1], TINY)
    colours = [MANY[k % len(MANY)] for k in range(len(runs))]
    for k, (entry, colour) in enumerate(zip(runs, colours)):
        assert entry.run is not None and entry.energy_error is not None
        t, size = thinned(entry.run.t, np.abs(entry.energy_error[study.function]))
        name = "h" if study.measures.unit else "tolerance"
        panel.semilogy(
            *(t, np.maximum(size, floor)),
            color=colour,
            linewidth=max(2.0 - 0.5 * k, 0.8),
            label=f"{name} = {entry.step:g}" + (" s" if study.measures.unit else ""),
        )
    if study.horizon < float(study.comparison.t[-1]):
        look: dict[str, Any] = {"color": GREY, "linewidth": 1.0, "linestyle": DASHED}
        panel.axvline(study.horizon, label="motions part", **look)
    panel.set_title("|ΔC| over time")
    panel.set_xlabel("time t (s)")
    panel.set_ylabel("|ΔC| (J)")
    panel.margins(x=0)


# --- equations at random states ------------------------------------------------------------------

MOST_ROWS = 30
"""Equations, or speeds, drawn one by one; the worst ones."""


def _check(check: EquationCheck) -> Figure:
    """The relative residual of every equation at every state, a point each, beside what is accepted."""
    values = np.where(np.isfinite(check.residuals.relative), check.residuals.relative, np.nan)
    speeds, failing = check.test.speeds, {blame.number - 1 for blame in check.blame}
    worst = np.nan_to_num(np.nanmax(np.where(np.isnan(values), 0.0, values), axis=1, initial=0.0))
    shown = sorted(int(k) for k in np.argsort(-worst, kind="stable")[:MOST_ROWS])
    title = f"{check.name}: {check.verdict.kind}"
    made = blank(1.4 + 0.3 * max(len(shown), 3), title, beside=BESIDE)
    panel = made.subplots()
    floor = EPS / 4.0
    jitter = np.linspace(-0.28, 0.28, values.shape[1])
    first: set[str] = set()
    for row, k in enumerate(shown):
        wrong = k in failing
        label = "at a state, of an equation that fails" if wrong else "at a state"
        panel.plot(
            *(np.fmax(values[k], floor), row + jitter),
            "o",
            color=VERMILION if wrong else BLUE,
            markersize=2.6,
            alpha=0.6,
            markeredgewidth=0,
            label="_" if label in first else label,
        )
        first.add(label)
        rough = max(float(check.roughness[k]), floor)
        label = "_" if row else "rounding of the function"
        panel.plot([rough] * 2, [row - 0.36, row + 0.36], color=BLACK, linewidth=1.2, label=label)
    label = f"accepted, {number(check.tolerance, digits=2)}"
    panel.axvline(check.tolerance, color=GREEN, linewidth=1.1, linestyle=DASHED, label=label)
    panel.set_xscale("log")
    panel.set_xlim(floor / 2.0, max(10.0 * worst.max(initial=0.0), 1.0))
    names = [fitted(speeds[k], 18).splitlines()[0] for k in shown]
    panel.set_yticks(range(len(shown)), names)
    panel.set_ylim(len(shown) - 0.4, -0.6)
    letters = max(map(len, names), default=0)
    made.subplots_adjust(left=(0.5 + 0.08 * letters) / made.get_figwidth())
    most = f", the {MOST_ROWS} worst of {len(speeds)}" if len(shown) < len(speeds) else ""
    panel.set_title(f"What the equations leave of their terms at {check.count} states{most}")
    panel.set_xlabel("relative residual")
    legend_beside(panel)
    return made


def _localisation(found: Localisation) -> Figure:
    """What is left of each equation over time, and the power that each joint takes beyond the model's."""
    made = blank(6.0, "Where the motion departs from the model", beside=BESIDE)
    panels = stacked(made, [1.0, 1.0], [0.18])
    _columns(panels[0], found.t, found.speeds, found.residual, None)
    panels[0].set_title("Residual of each equation")
    panels[0].set_ylabel("F + F* (N, N·m)")
    joints = list(found.joints)
    powers = np.array([found.joints[name] for name in joints]).T.reshape(len(found.t), len(joints))
    _columns(panels[1], found.t, joints, powers, None)
    panels[1].set_title("Power beyond what the model supplies, by joint")
    panels[1].set_ylabel("power (W)")
    panels[1].set_xlabel("time t (s)")
    for panel in panels:
        legend_beside(panel)
    align_labels(made)
    return made


def _explanation(found: Explanation) -> Figure:
    """What each cause explains of the residual of the equations."""
    causes = found.causes
    made = blank(1.6 + 0.34 * max(len(causes), 2), f"Causes: {found.kind}", beside=BESIDE)
    panel = made.subplots()
    places = np.arange(len(causes))
    panel.barh(places, [100.0 * c.share for c in causes], color=BLUE, height=0.6)
    panel.set_yticks(places, [str(k + 1) for k in places])
    panel.set_ylim(max(len(causes), 2) - 0.4, -0.6)
    panel.set_xlim(0.0, 100.0)
    for place, cause in zip(places, causes):
        panel.annotate(
            fitted(f"{cause.kind} {cause.element}"),
            (1.01, place),
            xycoords=panel.get_yaxis_transform(),
            va="center",
            fontsize=SMALL,
            annotation_clip=False,
        )
    panel.set_title(f"Together they explain {percent(found.explained)} of the squared residual")
    panel.set_xlabel("share that the cause alone explains of what the others leave (%)")
    panel.set_ylabel("cause")
    align_labels(made)
    return made


def _mutants(found: MutationReport) -> Figure:
    """Of the mistakes made on purpose, the share that each test sees, by kind."""
    counts = found.counts()
    kinds = list(counts)
    made = blank(
        1.4 + 0.34 * max(len(kinds), 3), f"{found.function}: who sees a mistake?", beside=0.9
    )
    panel = made.subplots()
    mistakes = [row["mutants"] - row["equivalent"] for row in counts.values()]
    share = np.array(
        [
            [row[test] / most if most else math.nan for test in found.tests]
            for row, most in zip(counts.values(), mistakes)
        ]
    ).reshape(len(kinds), len(found.tests))
    made.subplots_adjust(left=1.5 / made.get_figwidth(), top=1.0 - 0.95 / made.get_figheight())
    panel.imshow(share, cmap="viridis", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(share):
        text = "–" if math.isnan(value) else f"{100 * value:.0f} %"
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": SMALL}
        panel.text(column, row, text, color="black" if value > 0.55 else "white", **look)
    panel.set_xticks(range(len(found.tests)), [fitted(t, 14) for t in found.tests], fontsize=SMALL)
    panel.set_yticks(range(len(kinds)), [f"{k} ({m})" for k, m in zip(kinds, mistakes)])
    panel.xaxis.tick_top()
    panel.grid(visible=False)
    panel.tick_params(length=0)
    for side in panel.spines.values():
        side.set_visible(False)
    return made


# --- a recommendation: time against error, a curve for each solver --------------------------------

MARKS = "osD^vPX*<>ph"


def _recommendation(advice: Recommendation) -> Figure:
    """Every trial by the time it takes, against the largest |ΔC| and, below, the error of the motion."""
    made = blank(7.2, f"Work and precision: {advice.summary()}", beside=BESIDE)
    energy, motion = stacked(made, [1.0, 1.0], [0.2])
    _scatter(energy, advice, "energy", advice.tolerance)
    _scatter(motion, advice, "motion", advice.motion_tolerance)
    energy.set_title("Largest |ΔC| of a run")
    energy.set_ylabel("share of the energy exchanged")
    motion.set_title("Error of the motion (where the energy is kept)")
    motion.set_ylabel("share of the ranges of q, u")
    motion.set_xlabel("time of a run (s)")
    legend_beside(energy)
    align_labels(made)
    return made


def _scatter(panel: Axes, advice: Recommendation, what: str, tolerance: float) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    solvers = sorted({t.solver for t in advice.trials})
    marks = MARKS * (1 + len(solvers) // len(MARKS))
    for solver, colour, mark in zip(solvers, shades(len(solvers)), marks):
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
        look: dict[str, Any] = {"color": GREEN, "linewidth": 1.1, "linestyle": DASHED}
        panel.axhline(tolerance, label=f"asked for, {number(tolerance)}", **look)
    if advice.best is not None and _drawn(advice.best, what):
        panel.plot(
            advice.best.seconds,
            getattr(advice.best, what),
            marker="o",
            markersize=12,
            markerfacecolor="none",
            markeredgecolor=VERMILION,
            linestyle="none",
            label="recommended",
        )
    panel.set_xscale("log")
    panel.set_yscale("log")
    low, high = panel.get_xlim()
    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
    panel.xaxis.set_major_formatter(lambda x, _: number(x))
    panel.xaxis.set_minor_formatter(NullFormatter())


def _drawn(trial: Trial, what: str) -> bool:
    value = getattr(trial, what)
    return math.isfinite(value) and value > 0.0 and math.isfinite(trial.seconds)


# --- other results -------------------------------------------------------------------------------


def _examination(found: Examination) -> Figure:
    """The picture of the part that decides: the last of those with the exit code of the whole."""
    deciding = [part for part in found.results.values() if part.exit_code == found.exit_code]
    if not deciding:
        raise InputError("nothing was examined, so there is nothing to draw")
    made = figure(deciding[-1])
    entitle(made, found.summary())
    return made


def _linearisation(found: Linearisation) -> Figure:
    """The eigenvalues in the complex plane; what grows is right of the line."""
    made = blank(4.4, "Eigenvalues", beside=BESIDE)
    panel = made.subplots()
    values = found.eigenvalues
    size = 1e-9 * float(np.abs(values).max(initial=0.0))
    for label, colour, kept in (
        ("decaying", BLUE, values.real < -size),
        ("neither", BLACK, np.abs(values.real) <= size),
        ("growing", VERMILION, values.real > size),
    ):
        if kept.any():
            panel.plot(values.real[kept], values.imag[kept], "o", color=colour, label=label)
    panel.axvline(0.0, color=GREY, linewidth=0.8)
    panel.axhline(0.0, color=GREY, linewidth=0.8)
    reach = 1.15 * float(np.abs(values).max(initial=0.0)) or 1.0
    panel.set_xlim(-reach, reach)
    panel.set_ylim(-reach, reach)
    panel.set_title(f"About the state at t = {found.state.t:g} s")
    panel.set_xlabel("Re λ (1/s)")
    panel.set_ylabel("Im λ (1/s)")
    legend_beside(panel)
    align_labels(made)
    return made


def _mechanism(mechanism: Mechanism, state: Any = None) -> Figure:
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
