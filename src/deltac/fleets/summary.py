"""The page of a fleet: counts, heat maps, work and precision, recommended settings, the worst cases."""

from __future__ import annotations

import html
import io
from collections.abc import Callable, Mapping
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from deltac.errors import InputError, UnknownName, closest
from deltac.fleets.result import WORST_FIRST, Fleet, shown_cell
from deltac.fleets.rows import FAILED
from deltac.report.files import check_page, write_text
from deltac.results import Table, number, percent

if TYPE_CHECKING:
    import polars
    from matplotlib.figure import Figure

MAPS = 6
"""Heat maps on a page, at most: one a setting."""

CASES = 3
"""Worst cases that get a page of their own."""

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1f24; margin: 2rem auto }
body { max-width: 62rem; padding: 0 1rem }
h1 { font-size: 1.5rem } h2 { font-size: 1.15rem; margin-top: 2.2rem }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 14px }
th, td { text-align: left; padding: .25rem .8rem .25rem 0; border-bottom: 1px solid #d8dde3 }
.verdict { font-size: 1.1rem; padding: .6rem 1rem; border-left: 5px solid; background: #f4f6f8 }
.c0 { border-color: #2a7f4f } .c1, .c2 { border-color: #b3261e } .c3 { border-color: #a66a00 }
figure { margin: 1rem 0; overflow-x: auto } svg { max-width: 100%; height: auto } code { font-size: 13px }
"""


def write_summary(
    fleet: Fleet,
    path: str | PurePath,
    *,
    x: str | None = None,
    y: str | None = None,
    case: Callable[[str, Path], None] | None = None,
) -> None:
    """Write the page of a fleet, without scripts and with all of its pictures inside; see `Fleet.report`."""
    target = check_page(path)
    write_text(page(fleet, x=x, y=y, links=_cases(fleet, target, case)), target)


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
        if len(links) == CASES:
            break
    return links


def page(fleet: Fleet, *, x: str | None = None, y: str | None = None, links: Any = None) -> str:
    """The page as HTML."""
    frame = fleet.frame
    title = html.escape(f"{fleet.name}: {fleet.kind}")
    parts = [
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>',
        f"<style>{STYLE}</style><h1>{title}</h1>",
        f'<p class="verdict c{fleet.exit_code}">{html.escape(fleet.summary())}</p>',
    ]
    groups = fleet.groups()
    if fleet.kind == "sweep" and groups:
        rows = tuple((g.name, *(str(g.verdicts.get(v, 0)) for v in WORST_FIRST)) for g in groups)
        parts += ["<h2>Settings</h2>", Table(("setting", *WORST_FIRST), rows).html()]
    if advice := recommended(frame):
        heads = (
            "model",
            "solver",
            "step (s) or tolerance",
            "runs",
            "within",
            "largest error",
            "evaluations a run",
        )
        parts += [
            "<h2>Recommended settings</h2><p>Of the settings in which every run stays within the tolerance, "
            "the cheapest of each model.</p>",
            Table(heads, advice).html(),
        ]
    for heading, figures in (
        ("Energy error over two axes", heat_maps(frame, x, y)),
        ("Work and precision", work_precision(frame)),
    ):
        if figures:
            parts.append(f"<h2>{heading}</h2>")
            parts += [f"<figure>{_svg(figure)}</figure>" for figure in figures]
    if fleet.worst:
        parts.append("<h2>Worst cases</h2>" + _worst_table(fleet, links or {}))
    parts.append(
        f"<p>Table: <code>{html.escape(str(fleet.folder / 'results.parquet'))}</code></p></html>"
    )
    return "\n".join(parts)


def _worst_table(fleet: Fleet, links: dict[str, str]) -> str:
    names = [n for n in fleet.worst[0] if n != "address"]
    lines = ["".join(f"<th>{html.escape(n)}</th>" for n in (*names, "run"))]
    for row in fleet.worst:
        cells = [f"<td>{html.escape(shown_cell(row.get(n), n)[:200])}</td>" for n in names]
        address = f"<code>{row['address']}</code>"
        link = links.get(row["address"])
        cells.append(f'<td><a href="{link}">{address}</a></td>' if link else f"<td>{address}</td>")
        lines.append("".join(cells))
    return "<table>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"


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
    groups = ("parameter", "q", "u")
    varied = [
        n
        for n in frame.columns
        if (n.split(".")[0] in groups or n in ("step", "solver_tolerance"))
        and frame[n].n_unique() > 1
    ]
    return sorted(varied, key=lambda n: -frame[n].n_unique())


def heat_maps(frame: polars.DataFrame, x: str | None, y: str | None) -> list[Figure]:
    """The largest relative energy error over two axes, a map for each model and solver."""
    known = axes_of(frame)
    for name in (x, y):
        if name is not None and name not in frame.columns:
            raise UnknownName(f"axis {name!r}: the table has none{closest(name, known)}")
    if not {"model", "solver", "relative"} <= set(frame.columns):
        return []
    drawn = []
    for part in frame.partition_by("model", "solver", maintain_order=True):
        # Not all axes are of every solver: some have a step, others a tolerance.
        free = [n for n in axes_of(part) if n not in (x, y)]
        right, up = (name or (free.pop(0) if free else "") for name in (x, y))
        if not (right and up and part["relative"].count()):
            continue
        if part[right].null_count() or part[up].null_count():
            continue
        drawn.append(_heat_map(part, right, up))
        if len(drawn) == MAPS:
            break
    return drawn


BINS = 40
"""Cells of a heat map along an axis with more values than that."""


def _heat_map(frame: polars.DataFrame, x: str, y: str) -> Figure:
    import numpy as np
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure as Drawn

    from deltac.report.style import styled

    def cells(name: str) -> tuple[Any, Any]:
        values = frame[name].to_numpy()
        own = np.unique(values)
        if len(own) <= BINS:
            return own, np.searchsorted(own, values)
        edges = np.linspace(own[0], own[-1], BINS + 1)
        places = np.clip(np.searchsorted(edges, values, "right") - 1, 0, BINS - 1)
        return 0.5 * (edges[1:] + edges[:-1]), places

    (at_x, i), (at_y, j) = cells(x), cells(y)
    error = frame["relative"].to_numpy().astype(float)
    worst = np.full((len(at_y), len(at_x)), np.nan)
    good = np.isfinite(error)
    np.fmax.at(worst, (j[good], i[good]), np.maximum(error[good], 1e-17))
    bad = np.zeros_like(worst, dtype=bool)
    np.logical_or.at(bad, (j, i), np.array([v != "consistent" for v in frame["verdict"]]))
    with styled():
        drawn = Drawn(figsize=(7.6, 4.2), layout="constrained")
        panel = drawn.add_subplot()
        low, high = np.nanmin(worst), np.nanmax(worst)
        mesh = panel.pcolormesh(
            np.arange(len(at_x) + 1), np.arange(len(at_y) + 1), worst, cmap="viridis",
            norm=LogNorm(low, max(high, 1.001 * low)), rasterized=worst.size > 2000,
        )  # fmt: skip
        rows, columns = np.nonzero(bad)
        panel.plot(columns + 0.5, rows + 0.5, "x", color="white", markersize=4, linestyle="none")
        for axis, values, name in ((panel.xaxis, at_x, x), (panel.yaxis, at_y, y)):
            some = np.unique(np.linspace(0, len(values) - 1, min(6, len(values))).astype(int))
            axis.set_ticks(some + 0.5, [f"{values[k]:.3g}" for k in some])
            axis.set_label_text(name)
        drawn.colorbar(mesh, ax=panel, label="largest |ΔC| as a fraction of the energy")
        row = frame.row(0, named=True)
        panel.set_title(f"{row['model']}, {row['solver']}; ×: not consistent", fontsize=9)
    return drawn


def work_precision(frame: polars.DataFrame) -> list[Figure]:
    """Energy errors over cost: medians and largest, a curve for each solver, a panel a model.

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
    from matplotlib.figure import Figure as Drawn

    from deltac.report.style import styled

    made = []
    for part in usable.partition_by("model", maintain_order=True)[:MAPS]:
        with styled():
            drawn = Drawn(figsize=(7.6, 4.0), layout="constrained")
            panel = drawn.add_subplot()
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
                name, cost = str(own["solver"][0]), points["cost"]
                (line,) = panel.loglog(cost, points["median"], "o-", label=f"{name}, median")
                panel.loglog(
                    cost, points["largest"], "v:", color=line.get_color(), label=f"{name}, largest"
                )
            panel.set_xlabel(label)
            panel.set_ylabel("|ΔC| as a fraction of the energy")
            panel.set_title(str(part["model"][0]), fontsize=9)
            panel.legend(fontsize=8)
        made.append(drawn)
    return made


def _svg(figure: Figure) -> str:
    """A figure as a fragment of HTML."""
    target = io.StringIO()
    figure.savefig(target, format="svg", metadata={"Date": None})
    text = target.getvalue()
    return text[text.index("<svg") :]
