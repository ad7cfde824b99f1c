"""The page of a fleet: counts, heat maps, work and precision, recommended settings, the worst cases."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from deltac.errors import InputError, UnknownName, closest
from deltac.fleets.result import WORST_FIRST, Fleet, shown_cell
from deltac.fleets.rows import AXIS_GROUPS, FAILED
from deltac.report.files import check_page
from deltac.report.page.document import write_page
from deltac.report.page.parts import Chapter, Grid, Page, Part, Tone
from deltac.report.panels import MOST_DRAWN, Cloud, HeatMap, LogPlot
from deltac.results import SHOWN, Table, number, percent

if TYPE_CHECKING:
    import polars


def write_summary(
    fleet: Fleet,
    path: str | PurePath,
    *,
    x: str | None = None,
    y: str | None = None,
    case: Callable[[str, Path], None] | None = None,
) -> None:
    """Write the page of a fleet, with all that it shows inside; see `Fleet.report`."""
    target = check_page(path)
    write_page(page_of_fleet(fleet, x=x, y=y, links=_cases(fleet, target, case)), target)


def _cases(fleet: Fleet, target: Path, case: Callable[[str, Path], None] | None) -> dict[str, str]:
    """Pages of the worst cases that can be shown, by address; relative to the page."""
    links: dict[str, str] = {}
    folder = target.parent / f"{target.stem}-cases"
    for row in fleet.worst if case is not None else ():
        if row["verdict"] == FAILED:  # it has no motion to show
            continue
        own = folder / f"{row['address']}.html"
        folder.mkdir(exist_ok=True)
        try:
            assert case is not None
            case(row["address"], own)
        except InputError:
            continue
        links[row["address"]] = f"{folder.name}/{own.name}"
        if len(links) == SHOWN:
            break
    return links


def page_of_fleet(
    fleet: Fleet,
    *,
    x: str | None = None,
    y: str | None = None,
    links: Mapping[str, str] = MappingProxyType({}),
) -> Page:
    """The page: `links` are those of runs that have a page of their own, by address."""
    frame, verdicts = fleet.frame, fleet.verdicts
    counts = tuple((name, f"{verdicts[name]:,}") for name in WORST_FIRST if verdicts.get(name))
    parts: list[tuple[str, list[Part]]] = [("Energy error over two axes", heat_maps(frame, x, y))]
    parts.append(("Work and precision", work_precision(frame)))
    if advice := recommended(frame):
        lead = "Of the settings in which every run stays within the tolerance, the cheapest of each model"
        parts.append(("Recommended settings", [Grid.of(lead, Table(ADVICE, advice))]))
    groups = fleet.groups()
    if fleet.kind != "audit" and groups:
        rows = tuple((g.name, *(str(g.verdicts.get(v, 0)) for v in WORST_FIRST)) for g in groups)
        parts.append(("Settings", [Grid.of("", Table(("setting", *WORST_FIRST), rows))]))
    if fleet.worst:
        parts.append(("Worst cases", [_worst_table(fleet, links)]))
    return Page(
        title=fleet.name,
        asked=f"Which runs of the {fleet.kind} can be trusted, and at which settings?",
        tone=TONES.get(fleet.exit_code, "bad"),
        word=EXIT_WORDS.get(fleet.exit_code, "Some have failed"),
        sentence=f"{fleet.summary().partition(': ')[2]}.",
        numbers=counts,
        chapters=tuple(Chapter(heading, tuple(own)) for heading, own in parts if own),
        made=(("table", str(fleet.folder / "results.parquet")),),
        data=fleet.to_dict(),
    )


TONES: Mapping[int, Tone] = {0: "good", 1: "bad", 3: "doubt"}
EXIT_WORDS = {
    0: "All are consistent",
    1: "Not all can be trusted",
    3: "Some are unresolved",
}
"""By exit code."""

ADVICE = (
    "model", "solver", "step (s) or tolerance", "runs", "within", "largest error", "evaluations a run",
)  # fmt: skip


def _worst_table(fleet: Fleet, links: Mapping[str, str]) -> Grid:
    names = [n for n in fleet.worst[0] if n != "address"]
    rows = tuple(
        (*(shown_cell(row.get(n), n)[:200] for n in names), row["address"]) for row in fleet.worst
    )
    own = tuple(links.get(row["address"], "") for row in fleet.worst)
    return replace(Grid.of("", Table((*names, "run"), rows)), links=own)


# --- settings ----------------------------------------------------------------------------------


def recommended(frame: polars.DataFrame) -> tuple[tuple[str, ...], ...]:
    """For each model the cheapest setting in which all runs are consistent, as cells; () without solvers."""
    import polars

    if not {"model", "solver", "step", "verdict"} <= set(frame.columns) or not len(frame):
        return ()
    by = frame.group_by("model", *_own_setting(frame), maintain_order=True).agg(
        polars.len().alias("runs"),
        (polars.col("verdict") == "consistent").sum().alias("good"),
        polars.col("relative").max(),
        polars.col("evaluations").mean(),
        polars.col("seconds").mean(),
    )
    if by.select(_own_setting(frame)).n_unique() < 2:
        return ()
    rows: list[tuple[str, ...]] = []
    for (model,), part in by.group_by("model", maintain_order=True):
        fit = part.filter(polars.col("good") == polars.col("runs"))
        cost = "evaluations" if not part["evaluations"].null_count() else "seconds"
        if not len(fit):
            rows.append((str(model), "none of them", "", "", "", "", ""))
            continue
        best = fit.sort(cost).row(0, named=True)
        rows.append((
            str(model), best["solver"], _knob(best), str(best["runs"]),
            percent(best["good"] / best["runs"]), percent(best["relative"] or 0.0),
            number(best["evaluations"]) if best["evaluations"] else "–",
        ))  # fmt: skip
    return tuple(rows)


def _own_setting(frame: polars.DataFrame) -> list[str]:
    """What of a setting a designer chooses: solver, and step or tolerance."""
    return [n for n in ("solver", "step", "solver_tolerance") if n in frame.columns]


def _knob(row: Mapping[str, Any]) -> str:
    """The tolerance of a solver that has one, else the step."""
    value = row.get("solver_tolerance") or row["step"]
    return number(value) if value else "–"


# --- pictures --------------------------------------------------------------------------------------


def axes_of(frame: polars.DataFrame) -> list[str]:
    """The axes that vary, those with most values first."""
    varied = [
        n
        for n in frame.columns
        if (n.split(".")[0] in AXIS_GROUPS or n in ("step", "solver_tolerance"))
        and frame[n].n_unique() > 1
    ]
    return sorted(varied, key=lambda n: -frame[n].n_unique())


def heat_maps(frame: polars.DataFrame, x: str | None, y: str | None) -> list[Part]:
    """The largest relative energy error over two axes, a map for each model and solver, on one scale."""
    axes = axes_of(frame)
    for name in (x, y):
        if name is not None and name not in frame.columns:
            raise UnknownName(f"axis {name!r}: the table has none{closest(name, axes)}")
    if not {"model", "solver", "relative"} <= set(frame.columns):
        return []
    drawn: list[HeatMap] = []
    for part in frame.partition_by("model", "solver", maintain_order=True):
        # Not all axes are of every solver: some have a step, others a tolerance.
        free = [n for n in axes_of(part) if n not in (x, y)]
        right, up = (name or (free.pop(0) if free else "") for name in (x, y))
        if not (right and up and part["relative"].count()):
            continue
        if part[right].null_count() or part[up].null_count():
            continue
        drawn.append(_heat_map(part, right, up))
        if len(drawn) == SHOWN:
            break
    sizes = [v for one in drawn for row in one.values for v in row if v is not None]
    return [replace(one, low=min(sizes), high=max(sizes)) for one in drawn]


def _heat_map(frame: polars.DataFrame, x: str, y: str) -> HeatMap:
    import numpy as np

    def cells(name: str) -> tuple[Any, Any]:
        values = frame[name].to_numpy()
        own = np.unique(values)
        if len(own) <= MOST_DRAWN:
            return own, np.searchsorted(own, values)
        edges = np.linspace(own[0], own[-1], MOST_DRAWN + 1)
        places = np.clip(np.searchsorted(edges, values, "right") - 1, 0, MOST_DRAWN - 1)
        return 0.5 * (edges[1:] + edges[:-1]), places

    (at_x, i), (at_y, j) = cells(x), cells(y)
    error = frame["relative"].to_numpy().astype(float)
    worst = np.full((len(at_y), len(at_x)), np.nan)
    good = np.isfinite(error)
    np.fmax.at(worst, (j[good], i[good]), np.maximum(error[good], 1e-17))
    bad = np.zeros_like(worst, dtype=bool)
    np.logical_or.at(bad, (j, i), np.array([v != "consistent" for v in frame["verdict"]]))
    row = frame.row(0, named=True)
    return HeatMap(
        f"{row['model']}, {row['solver']}",
        x,
        y,
        tuple(map(float, at_x)),
        tuple(map(float, at_y)),
        tuple(tuple(None if np.isnan(v) else float(v) for v in line) for line in worst),
        tuple(tuple(map(bool, line)) for line in bad),
        note="Largest |ΔC| as a fraction of the energy that the system has; × marks what is not consistent.",
    )


def work_precision(frame: polars.DataFrame) -> list[Part]:
    """Energy errors over cost: medians and largest, points of each solver, a plot a model.

    Cost is in evaluations of ẋ, or in processor time where solvers do not count these.
    """
    import polars

    if not {"evaluations", "seconds", "relative", "solver"} <= set(frame.columns):
        return []
    usable = frame.filter(polars.col("relative") > 0.0)
    if len(usable.select("model", *_own_setting(usable)).unique()) < 2:
        return []
    counted = not usable["evaluations"].null_count()
    measure, label = (
        ("evaluations", "evaluations of ẋ for a run")
        if counted
        else ("seconds", "processor time of a run (s)")
    )
    plots: list[Part] = []
    solvers = usable["solver"].unique(maintain_order=True).to_list()
    for part in usable.partition_by("model", maintain_order=True)[:SHOWN]:
        clouds = []
        for own in part.partition_by("solver", maintain_order=True):
            points = (
                own.group_by(_own_setting(own))
                .agg(
                    polars.col(measure).mean().alias("cost"),
                    polars.col("relative").median().alias("median"),
                    polars.col("relative").max().alias("largest"),
                )
                .sort("cost")
            )
            for k, size in enumerate(("median", "largest")):
                name = f"{own['solver'][0]}, {size}"
                colour = 2 * solvers.index(own["solver"][0]) + k
                sizes = tuple(points[size])
                clouds.append(Cloud(name, tuple(points["cost"]), sizes, colour=colour))
        y = "|ΔC| as a fraction of the energy"
        plots.append(LogPlot(str(part["model"][0]), label, y, tuple(clouds)))
    return plots
