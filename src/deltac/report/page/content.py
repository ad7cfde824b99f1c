"""What the page of each kind of result shows: `page_of`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.audit.audit import Audit
from deltac.diagnosis.study.convergence import order_text
from deltac.diagnosis.study.runs import StudyRun
from deltac.diagnosis.study.study import Study
from deltac.diagnosis.verdict import MEANINGS, Judged
from deltac.energy import Ledger
from deltac.mechanism.mechanism import Mechanism
from deltac.report.page.parts import (
    Chapter,
    Cloud,
    Code,
    Flow,
    Flows,
    Grid,
    Guide,
    Line,
    LogPlot,
    Page,
    Part,
    TimePlot,
    Told,
    Tone,
    Words,
)
from deltac.report.page.scene import Scene, scene
from deltac.results import Finding, Report, Section, Table, Verbatim, number, percent
from deltac.trajectories import Trajectory

EPS = float(np.finfo(np.float64).eps)

MOST_LINES = 8
"""Channels whose curves are shown at first; the others are there to be switched on."""

TONES: dict[int, Tone] = {0: "good", 1: "bad", 3: "doubt"}
"""By exit code."""

WORDS = {
    "consistent": "Consistent",
    "integration-error": "Integration error",
    "equation-error": "Equation error",
    "unresolved": "Unresolved",
}


@dataclass(frozen=True, eq=False)
class Beside:
    """What a page is made from besides the report: a model and a run of it, where the report has none.

    `more`: further reports of the same thing.
    """

    mechanism: Mechanism | None = None
    run: Trajectory | None = None
    more: tuple[Report, ...] = ()


@singledispatch
def page_of(report: Report, beside: Beside) -> Page:
    """The page of a report; of one that has no page of its own, its text and its tables."""
    chapters = [*_motion(beside), *_told(report)]
    return Page(
        title=type(report).__name__,
        asked=_first_line(report),
        tone=TONES.get(report.exit_code, "bad"),
        word=_sentence(report.summary()),
        sentence="",
        chapters=tuple(chapters),
        scene=_scene(beside.mechanism, [("run", beside.run)]),
        made=_made(beside.run),
        data=report.to_dict(),
    )


@page_of.register
def _(report: Audit, beside: Beside) -> Page:
    ledger, run, mechanism = report.ledger, report.run, report.mechanism
    v = report.verdict
    bar = float(ledger.error_bar[report.function].max())
    left = float(np.abs(report.energy_error).max())
    chapters = [
        Chapter("The evidence", (_error_plot(report),)),
        _findings(report.findings, ledger, run, report.energy_error),
        Chapter(
            "Where the energy went",
            (_flows(ledger, report.function, report.energy_error), *_energy(ledger)),
        ),
        *_coordinates(run, mechanism),
        Chapter(
            "In numbers",
            (
                Words("What the verdict rests on", tuple(f"{e}." for e in v.evidence)),
                *_tables(report.sections()),
            ),
        ),
    ]
    if report.import_report is not None:
        words = tuple(report.import_report.sections())
        chapters.append(Chapter("The model", (Words("What was read from its file", words),)))
    return Page(
        title=mechanism.name,
        asked="Can this log be trusted: does its motion obey the model, and was its energy kept?",
        **_verdict(report),
        numbers=(
            ("largest |ΔC|", f"{number(left, 'J', 3)} ± {number(bar, '', 2)}"),
            (
                "of the energy exchanged"
                if report.beside == report.energy_exchanged
                else "of the energy held",
                f"{percent(report.relative)} of {number(report.beside, 'J')}",
            ),
            ("accepted", percent(report.tolerance)),
            ("confidence", v.confidence),
            ("samples", f"{len(run):,} over {number(run.duration, 's')}"),
        ),
        chapters=tuple(chapters),
        scene=_scene(mechanism, [("log", run)]),
        limits=v.limits,
        made=_made(run, mechanism),
        data=report.to_dict(),
    )


@page_of.register
def _(report: Study, beside: Beside) -> Page:
    usable = [entry for entry in report.runs if entry.ledger is not None]
    finest = usable[-1]
    assert finest.ledger is not None and finest.run is not None
    state = report.observed_order["state"]
    knob = "step" if report.measures.unit else "tolerance"
    runs = [(_of(e, report.measures.unit), e.run) for e in dict.fromkeys((finest, usable[0]))]
    order = () if state.order is None else (("observed order of the motion", order_text(state)),)
    nominal = () if report.nominal is None else (("the solver's order", str(report.nominal)),)
    return Page(
        title=report.mechanism.name,
        asked=f"Is what is left of the energy the integrator's error, or the equations'? "
        f"{report.solver} at {len(report.runs)} {knob}s.",
        **_verdict(report),
        numbers=(
            (f"|ΔC| at the finest {knob}", number(report.measures.left[-1], "J", 3)),
            (
                "of the energy exchanged",
                f"{percent(report.relative)} of {number(report.energy_exchanged, 'J')}",
            ),
            ("accepted", percent(report.tolerance)),
            *order,
            *nominal,
            ("confidence", report.verdict.confidence),
        ),
        chapters=(
            Chapter("The evidence", (_errors(report, usable), _orders(report))),
            _findings(report.findings, finest.ledger, finest.run),
            Chapter(
                "Where the energy went",
                (
                    _flows(finest.ledger, report.function),
                    *_energy(finest.ledger),
                ),
            ),
            *_coordinates(finest.run, report.mechanism, usable),
            Chapter(
                "In numbers",
                (
                    Words(
                        "What the verdict rests on",
                        tuple(f"{e}." for e in report.verdict.evidence),
                    ),
                    *_tables(report.sections()),
                ),
            ),
        ),
        scene=_scene(report.mechanism, runs),
        limits=report.verdict.limits,
        made=_made(finest.run, report.mechanism),
        data=report.to_dict(),
    )


@page_of.register
def _(report: Ledger, beside: Beside) -> Page:
    worst = next((n for n in ("wang", "liu-huston") if n in report.delta_c), None)
    plots: list[Part] = [] if worst is None else [_all_functions(report)]
    flows = () if worst is None else (_flows(report, worst),)
    return Page(
        title="Ledger" if beside.mechanism is None else beside.mechanism.name,
        asked="Where did the energy go?",
        tone="plain",
        word="Balance",
        sentence=_sentence(report.summary()),
        chapters=(
            Chapter("The testing functions", tuple(plots)),
            Chapter("Where the energy went", (*flows, *_energy(report))),
            *_motion(beside),
            Chapter("In numbers", tuple(_tables(report.sections()))),
        ),
        scene=_scene(beside.mechanism, [("run", beside.run)]),
        made=_made(beside.run, beside.mechanism),
        data=report.to_dict(),
    )


# --- verdicts and findings -----------------------------------------------------------------------


def _verdict(report: Judged) -> dict[str, Any]:
    v = report.verdict
    tone: Tone = TONES.get(report.exit_code, "bad")
    if v.kind not in ("consistent", "unresolved") and report.exit_code == 0:
        tone = "doubt"  # a mistake that stays within the tolerance
    return {
        "tone": tone,
        "word": WORDS[v.kind],
        "sentence": v.meaning or MEANINGS[v.kind],
    }


_INSTANT = re.compile(
    r"\b(?:at|from|until|since|near|t =)\s+(?:t\s*=\s*)?([-+]?\d[\d.]*(?:e[-+]?\d+)?)\s*s\b"
)


def _findings(
    findings: Iterable[Finding],
    ledger: Ledger | None,
    run: Trajectory | None,
    energy_error: Array | None = None,
) -> Chapter:
    """What to do: every finding with its instant and its element."""
    told = [Told(f, _instant(f, ledger, run), _element(f)) for f in findings]
    return Chapter("What was found, and what to do", (), tuple(told))


def _instant(finding: Finding, ledger: Ledger | None, run: Trajectory | None) -> float | None:
    """The instant that a finding names, else that at which its channel does most."""
    if run is None:
        return None
    found = _INSTANT.search(f"{finding.what} {finding.evidence}")
    if found is not None:
        t = float(found.group(1))
        if run.t[0] <= t <= run.t[-1]:
            return t
    if ledger is not None and finding.element in ledger.power:
        power = np.abs(ledger.power[finding.element])
        if power.any():
            return float(ledger.t[int(power.argmax())])
    return None


def _element(finding: Finding) -> str:
    """The joint, body or element of a finding: of a channel, its element."""
    kind, space, element = finding.element.partition(" ")
    return element if space and kind in _KINDS else finding.element


_KINDS = {
    *("spring", "damper", "friction", "actuator", "applied", "prescribed", "constraint", "contact"),
    *("limit", "impact", "correction", "gravity"),
}


# --- plots ---------------------------------------------------------------------------------------


def _error_plot(report: Audit) -> TimePlot:
    """|ΔC| with its error bar, beside what is accepted and what was exchanged."""
    ledger = report.ledger
    lines = [
        Line(
            "|ΔC|",
            _floored(report.energy_error, ledger),
            ledger.error_bar[report.function],
            colour=0,
        )
    ]
    if report.function in ledger.delta_c and not np.array_equal(
        report.energy_error, ledger.delta_c[report.function]
    ):
        own = _floored(ledger.delta_c[report.function], ledger)
        lines.append(Line("|ΔC| without corrections", own, dashed=True, shown=False))
    lines += [
        Line(f"|ΔC| {name}", _floored(values, ledger), shown=False)
        for name, values in ledger.delta_c.items()
        if name != report.function
    ]
    return TimePlot(
        "What is left of the energy balance, |ΔC|",
        ledger.t,
        tuple(lines),
        "J",
        log=True,
        guides=_scales(report.tolerance * report.beside, ledger.energy_exchanged),
        note="Shaded: how far |ΔC| may be off numerically. A right log stays inside it, or far below "
        "the dashed line.",
        tall=True,
    )


def _scales(accepted: float, exchanged: float) -> tuple[Guide, ...]:
    guides = [("accepted", accepted), ("energy exchanged", exchanged)]
    return tuple(Guide(name, value) for name, value in guides if value > 0.0)


def _floored(values: Array, ledger: Ledger) -> Array:
    """Sizes, those below rounding of the energy exchanged at rounding: a log axis has no zero."""
    floor = EPS * ledger.energy_exchanged if ledger.energy_exchanged > 0.0 else EPS
    sized: Array = np.maximum(np.abs(values), floor)
    return sized


def _all_functions(ledger: Ledger) -> TimePlot:
    return TimePlot(
        "What is left of the energy balance, |ΔC|",
        ledger.t,
        tuple(
            Line(name, _floored(values, ledger), ledger.error_bar[name])
            for name, values in ledger.delta_c.items()
        ),
        "J",
        log=True,
        guides=_scales(0.0, ledger.energy_exchanged),
        tall=True,
    )


def _energy(ledger: Ledger) -> Iterator[TimePlot]:
    """Kinetic and potential energies, then the work of every channel that is not in V."""
    K = ledger.kinetic
    V = ledger.potential_energy
    sources = [Line(f"V {name}", v - v[0], colour=None) for name, v in ledger.potential.items()]
    several = len(sources) > 1
    yield TimePlot(
        "Energies, from their values at the start",
        ledger.t,
        (
            Line("K", K - K[0], colour="ink"),
            *((Line("V", V - V[0], colour=1),) if several else ()),
            *(
                Line(s.name, s.y, shown=k < MOST_LINES and several or not several)
                for k, s in enumerate(sources)
            ),
            Line("K + V", K + V - K[0] - V[0], dashed=True, colour="grey"),
        ),
        "J",
    )
    flowing = {n: w - w[0] for n, w in ledger.work.items() if n not in ledger.potential}
    ranked = sorted(flowing.items(), key=lambda item: -float(np.ptp(item[1])))
    if any(np.ptp(work) > 0.0 for _, work in ranked):
        yield TimePlot(
            "Work of every channel, from the start",
            ledger.t,
            tuple(
                Line(
                    name,
                    work,
                    ledger.work_error[name]
                    if float(ledger.work_error[name].max()) > 1e-3 * float(np.ptp(work))
                    else None,
                    shown=k < MOST_LINES,
                )
                for k, (name, work) in enumerate(ranked)
            ),
            "J",
            note="Positive: it gave energy to the system.",
        )


def _flows(ledger: Ledger, function: str, energy_error: Array | None = None) -> Flows:
    """Works into and out of the system over the whole run, what it stored, and what is left."""
    flows = [
        Flow(name, float(w[-1] - w[0]), float(ledger.work_error[name].max()))
        for name, w in sorted(ledger.work.items(), key=lambda i: -abs(float(i[1][-1] - i[1][0])))
        if name not in ledger.potential
    ]
    shown, rest = flows[:12], flows[12:]
    if rest:
        more = f"{len(rest)} smaller channels"
        shown.append(Flow(more, sum(f.energy for f in rest), sum(f.error for f in rest)))
    K = ledger.kinetic
    stored = [Flow("ΔK", float(K[-1] - K[0]), group="store")]
    stored += [
        Flow(f"ΔV {name}", float(v[-1] - v[0]), group="store")
        for name, v in ledger.potential.items()
    ]
    error = ledger.delta_c[function] if energy_error is None else energy_error
    bar = float(ledger.error_bar[function].max())
    left = Flow("ΔC, what is left", float(error[-1]), bar, "left")
    return Flows(
        "Energy from the start to the end of the run",
        (*shown, *stored, left),
        "Works that flowed in, what is stored of it, and what the balance cannot place.",
    )


def _of(entry: StudyRun, unit: str) -> str:
    return f"h = {number(entry.step, 's')}" if unit else f"tolerance {number(entry.step)}"


def _errors(report: Study, usable: Sequence[StudyRun]) -> TimePlot:
    """|ΔC| of every run, on the times of the finest."""
    name = report.function
    finest = usable[-1]
    assert finest.ledger is not None
    t = finest.ledger.t
    lines = []
    for k, entry in enumerate(usable):
        assert entry.ledger is not None and entry.energy_error is not None
        y = _floored(entry.energy_error[name], entry.ledger)
        last = entry is finest
        bar = None if entry.bar is None else entry.bar[name]
        at = _resampled(entry.ledger.t, y, t)
        lines.append(Line(_of(entry, report.measures.unit), at, bar if last else None, colour=k))
    return TimePlot(
        f"What is left of the energy balance, |ΔC| ({name})",
        t,
        tuple(lines),
        "J",
        log=True,
        guides=_scales(report.tolerance * report.energy_exchanged, report.energy_exchanged),
        note="An integrator's error falls with the step; an error of the equations stays where it is.",
        tall=True,
    )


def _resampled(t: Array, y: Array, at: Array) -> Array:
    """A curve at other times: as it is where they are its own, else between its rows; none beyond its end."""
    if len(t) == len(at) and np.array_equal(t, at):
        return y
    found: Array = np.interp(at, t, y, right=np.nan)
    return found


def _orders(report: Study) -> LogPlot:
    """Largest |ΔC| and state difference over the step, with the fitted slopes."""
    exchanged = report.energy_exchanged or 1.0
    clouds = []
    steps, left = report.measures.steps, report.measures.left
    order = report.observed_order
    for name, sizes, at in (
        (f"|ΔC| {report.function}", [x / exchanged for x in left], steps),
        ("motion, to the next finer run", order["state"].sizes, steps),
    ):
        points = [(h, s) for h, s in zip(at, sizes) if s > 0.0 and np.isfinite(s)]
        if not points:
            continue
        converged = order["state"] if name.startswith("motion") else order[report.function]
        fit = None
        if converged.order is not None and len(points) > 1:
            h0, s0 = points[-1]
            h1 = points[0][0]
            fit = ((h0, s0), (h1, s0 * (h1 / h0) ** converged.order))
        clouds.append(
            Cloud(
                name,
                tuple(p[0] for p in points),
                tuple(p[1] for p in points),
                joined=fit is None,
                fit=fit,
                fit_name="" if converged.order is None else f"slope {order_text(converged)}",
            )
        )
    knob = "step h (s)" if report.measures.unit else "tolerance"
    return LogPlot(
        "How the errors fall with the step",
        knob,
        "share of the energy exchanged, or of the ranges",
        tuple(clouds),
        (Guide("accepted", report.tolerance),),
        note="" if report.nominal is None else f"The solver's own order is {report.nominal}.",
    )


def _coordinates(
    run: Trajectory, mechanism: Mechanism | None, others: Sequence[StudyRun] = ()
) -> Iterator[Chapter]:
    """The coordinates by unit, then the speeds."""
    if mechanism is None:
        return
    yield Chapter(
        "The motion",
        tuple(
            part
            for what, values, entries in (
                ("Coordinates", run.q, mechanism.coordinates),
                ("Speeds", run.u, mechanism.speeds),
            )
            for part in _by_unit(what, run.t, values, entries)
        ),
    )


def _by_unit(what: str, t: Array, values: Array, entries: Any) -> Iterator[TimePlot]:
    units: dict[str, list[int]] = {}
    for k, entry in enumerate(entries):
        units.setdefault(entry.unit, []).append(k)
    for unit, places in units.items():
        said = "quaternions" if unit == "1" else unit
        yield TimePlot(
            f"{what} ({said})",
            t,
            tuple(
                Line(entries[k].name, values[:, k], shown=n < MOST_LINES)
                for n, k in enumerate(places)
            ),
            "" if unit == "1" else unit,
        )


def _motion(beside: Beside) -> Iterator[Chapter]:
    if beside.run is not None:
        yield from _coordinates(beside.run, beside.mechanism)


# --- scene, words, provenance --------------------------------------------------------------------


def _scene(
    mechanism: Mechanism | None,
    runs: Sequence[tuple[str, Trajectory | None]],
    side_by_side: bool = False,
) -> Scene | None:
    moving = [(name, run) for name, run in runs if run is not None and len(run) > 1]
    return None if mechanism is None else scene(mechanism, moving, side_by_side)


def _tables(sections: Iterable[Section]) -> Iterator[Part]:
    tables = [part for part in sections if isinstance(part, Table)]
    for k, table in enumerate(tables):
        yield Grid.of("Totals" if k == 0 else "", table)


def _told(report: Report) -> Iterator[Chapter]:
    """The report's own text, in order."""
    parts: list[Part] = []
    words: list[str] = []
    for section in report.sections():
        if isinstance(section, str):
            words.append(section)
            continue
        if words:
            parts.append(Words("", tuple(words)))
            words = []
        if isinstance(section, Table):
            parts.append(Grid.of("", section))
        elif isinstance(section, Verbatim):
            parts.append(Code("", section.text, diff=section.text.startswith(("---", "@@"))))
    if words:
        parts.append(Words("", tuple(words)))
    yield Chapter("The report", tuple(parts))


def _first_line(report: Report) -> str:
    lines = (type(report).__doc__ or "").strip().splitlines()
    return lines[0] if lines else ""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _made(
    run: Trajectory | None, mechanism: Mechanism | None = None
) -> tuple[tuple[str, str], ...]:
    """Where a motion comes from."""
    told: list[tuple[str, str]] = []
    if mechanism is not None:
        told += [("model", mechanism.name), ("hash of the model", mechanism.hash)]
    if run is not None:
        p = run.provenance
        told.append(("simulator", p.simulator))
        if p.solver:
            told.append(("solver", p.solver))
        if p.step:
            told.append(("step", number(p.step, "s")))
        if p.tolerance:
            told.append(("tolerance", number(p.tolerance)))
        told.append(("rows", f"{len(run):,} from {run.t[0]:g} to {run.t[-1]:g} s"))
        if not p.completed:
            told.append(("stopped early", p.message or "no reason was given"))
        told += list(p.notes.items())
    return tuple(told)
