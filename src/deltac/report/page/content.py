"""What the page of each kind of result shows: `page_of`."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np

from deltac.arrays import LONG_LOG, Array, max_norm
from deltac.diagnosis import (
    MEANINGS,
    Audit,
    EquationCheck,
    Explanation,
    Judged,
    Recommendation,
    Study,
    Trial,
    Verdict,
    before_blow_up,
    order_text,
    setting_of,
)
from deltac.energy import Ledger
from deltac.errors import DeltacError
from deltac.mechanism import CHANNEL_KINDS, Mechanism
from deltac.models import Model
from deltac.procedure import TITLES, Examination
from deltac.repair.outcome import Fix, Repair
from deltac.report.page.parts import (
    Chapter,
    CodeListing,
    Grid,
    Page,
    Part,
    Told,
    Tone,
    Words,
)
from deltac.report.page.scene import Drawing, scene
from deltac.report.panels import (
    Line,
    TimePlot,
    all_functions,
    audit_errors,
    energy_plots,
    flows_of,
    fronts,
    momentum_functions,
    motions,
    named,
    orders,
    resampled,
    residuals,
    study_errors,
)
from deltac.results import (
    SHOWN,
    Finding,
    Report,
    Section,
    Table,
    Verbatim,
    fraction,
    number,
    percent,
)
from deltac.simulation import Equations
from deltac.trajectories import Trajectory
from deltac.verbs import simulate

TONES: dict[int, Tone] = {0: "good", 1: "bad", 3: "doubt"}
"""By exit code."""

UNDECIDED = {
    "unresolved": "The log does not decide whether the balance holds, the step is too coarse, or the "
    "model is another one."
}
"""The meaning of a kind where the others do not stand beside it."""

VERDICT_WORDS = {
    "consistent": "Consistent",
    "integration-error": "Integration error",
    "equation-error": "Equation error",
    "unresolved": "Unresolved",
}


@dataclass(frozen=True, eq=False)
class Beside:
    """What a page is made from besides the report: a model and a run of it, where the report has none.

    `model` is whose motion is shown, with its start where it says one; `equations` are those by hand that a
    check tested; `more`: further reports of the same thing.
    """

    model: Model | None = None
    run: Trajectory | None = None
    equations: Equations | None = None
    more: tuple[Report, ...] = ()

    @property
    def mechanism(self) -> Mechanism | None:
        """The mechanism of the model."""
        return None if self.model is None else self.model.mechanism


def _share(report: Audit | Study) -> tuple[tuple[str, str], ...]:
    """The energy error beside the energy that the system has, what is accepted, and how sure it is."""
    return (
        (
            "of the energy that the system has",
            f"{percent(report.relative)} of {number(report.reference_energy, 'J')}",
        ),
        ("accepted", percent(report.tolerance)),
        *_confidence(report.verdict),
    )


def _confidence(verdict: Verdict) -> tuple[tuple[str, str], ...]:
    """How sure a verdict is; of what is not decided nothing is."""
    return () if verdict.kind == "unresolved" else (("confidence", verdict.confidence),)


@singledispatch
def page_of(report: Report, context: Beside) -> Page:
    """The page of a report; of one that has no page of its own, its text and its tables."""
    chapters = [*_motion(context.run, context.mechanism), *_report_chapters(report)]
    return Page(
        title=re.sub("(?<=[a-z])(?=[A-Z])", " ", type(report).__name__).capitalize(),
        asked=_first_line(report),
        tone=TONES.get(report.exit_code, "bad"),
        word=_sentence(report.summary()),
        sentence="",
        chapters=tuple(chapters),
        scene=moving(context.mechanism, [("run", context.run)]),
        made=made(context.run),
        data=report.to_dict(),
    )


@page_of.register
def _(report: Audit, context: Beside) -> Page:
    ledger, run, mechanism = report.ledger, report.run, report.mechanism
    v = report.verdict
    bar = float(ledger.error_bar[report.function].max())
    largest = max_norm(report.energy_error)
    chapters = [
        Chapter("The evidence", (audit_errors(report), _rests_on(report))),
        _findings(report.findings, ledger, run, report.energy_error),
        Chapter(
            "Where the energy went",
            (flows_of(ledger, report.function, report.energy_error), *energy_plots(ledger)),
        ),
        *_motion(run, mechanism),
        Chapter("In numbers", tuple(_tables(report.sections()))),
        *(c for other in context.more for c in _report_chapters(other, "What would explain it")),
    ]
    if report.import_report is not None:
        words = tuple(report.import_report.sections())
        chapters.append(Chapter("The model", (Words("What was read from its file", words),)))
    return Page(
        title=mechanism.name,
        asked="Can this log be trusted: does its motion obey the model, and was its energy kept?",
        **_verdict(report),
        numbers=(
            ("largest |ΔC|", f"{number(largest, 'J', 3)} ± {number(bar, '', 2)}"),
            *_share(report),
            ("samples", f"{len(run):,} over {number(run.duration, 's')}"),
        ),
        chapters=tuple(chapters),
        scene=moving(mechanism, [("log", run)]),
        limits=v.limits,
        made=made(run, mechanism),
        data=report.to_dict(),
    )


@page_of.register
def _(report: Study, context: Beside) -> Page:
    usable = [entry for entry in report.runs if entry.ledger is not None]
    finest = usable[-1]
    assert finest.ledger is not None and finest.run is not None
    state = report.observed_order["state"]
    knob = report.knob
    runs = [(named(e, report.unit), e.run) for e in dict.fromkeys((finest, usable[0]))]
    order = () if state.order is None else (("observed order of the motion", order_text(state)),)
    nominal = () if report.nominal is None else (("the solver's order", str(report.nominal)),)
    return Page(
        title=report.mechanism.name,
        asked=f"Is what is left of the energy the integrator's error, or the equations'? "
        f"{report.solver} at {len(report.runs)} {knob}s.",
        **_verdict(report),
        numbers=(
            (f"|ΔC| at the finest {knob}", number(report.errors[-1], "J", 3)),
            *_share(report),
            *order,
            *nominal,
        ),
        chapters=(
            Chapter("The evidence", (study_errors(report), orders(report), _rests_on(report))),
            _findings(report.findings, finest.ledger, finest.run),
            Chapter(
                "Where the energy went",
                (
                    flows_of(finest.ledger, report.function),
                    *energy_plots(finest.ledger),
                ),
            ),
            *_motion(finest.run, report.mechanism),
            Chapter("In numbers", tuple(_tables(report.sections()))),
        ),
        scene=moving(report.mechanism, runs),
        limits=report.verdict.limits,
        made=made(finest.run, report.mechanism),
        data=report.to_dict(),
    )


@page_of.register
def _(report: Ledger, context: Beside) -> Page:
    worst = next((n for n in ("wang", "liu-huston") if n in report.delta_c), None)
    plots: list[Part] = [] if worst is None else [all_functions(report)]
    plots += [momentum_functions(report)] if report.delta_p else []
    flows = () if worst is None else (flows_of(report, worst),)
    return Page(
        title="Ledger" if context.mechanism is None else context.mechanism.name,
        asked="Where did the energy go?",
        tone="plain",
        word="Balance",
        sentence=_sentence(report.summary()),
        chapters=(
            Chapter("The testing functions", tuple(plots)),
            Chapter("Where the energy went", (*flows, *energy_plots(report))),
            *_motion(context.run, context.mechanism),
            Chapter("In numbers", tuple(_tables(report.sections()))),
        ),
        scene=moving(context.mechanism, [("run", context.run)]),
        made=made(context.run, context.mechanism),
        data=report.to_dict(),
    )


@page_of.register
def _(report: EquationCheck, context: Beside) -> Page:
    repairs = [other for other in context.more if isinstance(other, Repair)]
    fixed = [fix for repair in repairs for fix in repair.fixes]
    evidence: list[Part] = [_rests_on(report), residuals(report)]
    where = [_sentence(f"{blame}.") for blame in report.blame[:SHOWN]]
    if report.example is not None:
        where.append(f"{report.example}.")
    chapters = [Chapter("The evidence", (*_two(report, context), *evidence))]
    if fixed:
        edit = fixed[0]
        sentences = [
            part for repair in repairs for part in repair.sections() if isinstance(part, str)
        ]
        words = Words("The edit that makes it right", tuple(map(_sentence, sentences)))
        diff = CodeListing(
            f"{edit.file}, line {', '.join(map(str, edit.lines))}", edit.diff, diff=True
        )
        chapters.append(Chapter("What is wrong, and the correction", (words, diff)))
    if where:
        chapters.append(Chapter("Where the equations fail", (Words("", tuple(where)),)))
    chapters.append(_findings(report.findings, None, None))
    chapters.append(Chapter("In numbers", tuple(_tables(report.sections()))))
    if not fixed:
        chapters += [c for other in context.more for c in _report_chapters(other, _REPAIRED)]
    return Page(
        title=f"{report.name}, against {report.mechanism}",
        asked="Are these equations of motion the model's, and if not, where do they differ?",
        **_checked(report, fixed),
        numbers=(
            ("largest residual", f"{fraction(report.worst)} of an equation's terms"),
            ("accepted", fraction(report.tolerance)),
            ("equations that fail", f"{len(report.blame)} of {len(report.relative_residual)}"),
            ("states", str(report.count)),
            *_confidence(report.verdict),
        ),
        chapters=tuple(chapters),
        scene=_right_and_wrong(report, context),
        limits=report.verdict.limits,
        made=(("model", report.mechanism), ("equations", report.name)),
        data=report.to_dict(),
    )


def _checked(report: EquationCheck, fixed: Sequence[Fix]) -> dict[str, Any]:
    """The verdict; of equations that are wrong, which, and what is to be changed."""
    verdict = {**_verdict(report), "word": _CHECKED[report.verdict.kind]}
    if report.blame:
        which = ", ".join(report.test.speeds[blame.number - 1] for blame in report.blame)
        sentence = f"They fail for {which}."
        if fixed:
            lines = ", ".join(map(str, fixed[0].lines))
            sentence = f"Line {lines}: {'; '.join(fixed[0].words)}."
        verdict["sentence"] = sentence
    return verdict


_REPAIRED = "The search for the mistake"
_CHECKED = {
    **VERDICT_WORDS,
    "consistent": "The equations are right",
    "equation-error": "The equations are wrong",
}


_EXPLAINED = {
    "nothing": "Nothing to explain",
    "explained": "Explained",
    "ambiguous": "Several explanations",
    "unexplained": "Unexplained",
    "doubtful": "The log is in doubt",
}


@page_of.register
def _(report: Explanation, context: Beside) -> Page:
    numbers: tuple[tuple[str, str], ...] = (("samples", f"{report.samples:,}"),)
    if report.causes:
        numbers = (("explained", percent(report.explained)), *numbers)
    grids = tuple(_tables(report.sections()))
    return Page(
        title="Explanation" if context.mechanism is None else context.mechanism.name,
        asked="Which few changes of the model explain what its equations leave of the log?",
        tone=TONES[report.exit_code],
        word=_EXPLAINED[report.kind],
        sentence=_sentence(f"{report.sentence}."),
        numbers=numbers,
        chapters=(
            _findings((*report.findings, *report.reasons), None, None),
            Chapter("In numbers", grids),
            *_motion(context.run, context.mechanism),
        ),
        scene=moving(context.mechanism, [("run", context.run)]),
        made=made(context.run, context.mechanism),
        data=report.to_dict(),
    )


def _motion_of(model: Model, equations: Equations | None = None) -> Trajectory | None:
    """The motion that a problem has, by the model's equations or others; None where there is none."""
    problem = model.problem
    if problem is None:
        return None
    duration = min(problem.duration, LONG_LOG * problem.step)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a motion that breaks off is shown up to there
            run = simulate(
                model.mechanism, problem.state, duration, problem.step, equations=equations
            )
        return before_blow_up(run)
    except DeltacError:
        return None


def _pair(report: EquationCheck, context: Beside) -> tuple[Trajectory, Trajectory] | None:
    """The motions by the model's equations and by those tested, where there is a start."""
    if context.model is None or context.equations is None:
        return None
    right = _motion_of(context.model)
    wrong = _motion_of(context.model, context.equations)
    return None if right is None or wrong is None else (right, wrong)


def _right_and_wrong(report: EquationCheck, context: Beside) -> Drawing | None:
    both = _pair(report, context)
    if both is None or context.mechanism is None:
        return None
    names = ("the model", report.name)
    return moving(context.mechanism, tuple(zip(names, both)), side_by_side=True)


def _two(report: EquationCheck, context: Beside) -> Iterator[TimePlot]:
    """The coordinates of both motions."""
    both = _pair(report, context)
    if both is None or context.mechanism is None:
        return
    right, wrong = both
    names = context.mechanism.coordinates.names
    ranked = np.argsort(-np.ptp(right.q, axis=0), kind="stable")[:3]
    yield TimePlot(
        "The motion by the model, and by these equations (dashed)",
        right.t,
        tuple(
            line
            for n, k in enumerate(ranked)
            for line in (
                Line(f"{names[k]}, model", right.q[:, k], colour=n),
                Line(
                    f"{names[k]}, these equations",
                    resampled(wrong.t, wrong.q[:, k], right.t),
                    colour=n,
                    dashed=True,
                ),
            )
        ),
        ", ".join(dict.fromkeys(context.mechanism.coordinates[int(k)].unit for k in ranked)),
        tall=True,
    )


@page_of.register
def _(report: Recommendation, context: Beside) -> Page:
    best = report.best
    word = report.summary() if best is None else f"Use {best.solver}, {setting_of(best)}"
    words = [part for part in report.sections() if isinstance(part, str)][:-1]  # less the limits
    notes = [part for part in words if part.startswith("Note: ")]
    numbers: list[tuple[str, str]] = []
    if best is not None:
        numbers = [
            ("|ΔC| of the energy that the system has", percent(best.energy)),
            *(
                []
                if not np.isfinite(best.motion)
                else [("error of the motion", percent(best.motion))]
            ),
            ("asked for", percent(report.tolerance)),
            ("time of a run", number(1e3 * best.seconds, "ms", 3)),
            ("evaluations", f"{best.evaluations:,}" if best.evaluations else "not counted"),
        ]
    energy, *motion = fronts(report)
    run = context.run
    if run is None and best is not None and context.model is not None:
        run = _recommended(context.model, best, report.duration)
    return Page(
        title="Solver and step" if context.mechanism is None else context.mechanism.name,
        asked="Which solver, with which step, keeps a tolerance of "
        f"{fraction(report.tolerance)} at the least cost?",
        tone=TONES.get(report.exit_code, "bad"),
        word=_sentence(word),
        sentence=_RECOMMENDED[report.exit_code] if best is not None else "",
        numbers=tuple(numbers),
        chapters=(
            Chapter(
                "The evidence",
                (energy,),
            ),
            Chapter(
                "Why this one",
                (
                    Words("", tuple(w.removeprefix("- ") for w in words if w not in notes)),
                    *([Words("What was left out", tuple(notes), folded=True)] if notes else []),
                ),
            ),
            Chapter("The error of the motion", tuple(motion)),
            *_motion(run, context.mechanism),
            Chapter("In numbers", tuple(_tables(report.sections()))),
        ),
        scene=moving(context.mechanism, [("as recommended", run)]),
        limits=report.limits,
        made=made(run, context.mechanism),
        data=report.to_dict(),
    )


_RECOMMENDED = {
    0: "The cheapest setting that keeps the tolerance, verified at every row.",
    1: "The best that was tried; it is not confirmed.",
    3: "",
}


def _recommended(model: Model, best: Trial, duration: float) -> Trajectory | None:
    """The motion by the setting that is recommended, if a solver of ours made it."""
    if best.knob != "step" or ":" in best.solver or not model.starts:
        return None
    lasting = min(duration, LONG_LOG * best.setting)
    try:
        return simulate(model.mechanism, model.start(), lasting, best.setting, best.solver)
    except DeltacError:
        return None


@page_of.register
def _(report: Examination, context: Beside) -> Page:
    pages = {name: page_of(part, context) for name, part in report.results.items()}
    chapters = [
        Chapter(
            f"{_sentence(TITLES[name])} {page.word}.",
            page.chapters[0].parts,
            tuple(words for chapter in page.chapters for words in chapter.findings),
            page.sentence,
        )
        for name, page in pages.items()
    ]
    shown = next((name for name, page in reversed(pages.items()) if page.scene is not None), None)
    if shown is not None:  # what moves stands beside the first chapter
        chapters.insert(0, chapters.pop(list(pages).index(shown)))
    about = (f"{report.classification.summary()}.", *(f"Not done: {s}." for s in report.skipped))
    return Page(
        title=report.model,
        asked="Can its simulation be trusted, with which solver and step, and where are mistakes?",
        tone=TONES[report.exit_code],
        word={0: "Can be trusted", 1: "Something is wrong", 3: "Cannot be told"}[report.exit_code],
        sentence="" if report.exit_code == 0 else _sentence(report.summary()),
        numbers=tuple((TITLES[name], page.word) for name, page in pages.items()),
        chapters=(*chapters, Chapter("What it is", (Words("", about),))),
        scene=None if shown is None else pages[shown].scene,
        limits=tuple(dict.fromkeys(limit for page in pages.values() for limit in page.limits)),
        made=() if shown is None else pages[shown].made,
        data=report.to_dict(),
    )


# --- verdicts and findings -----------------------------------------------------------------------


def _verdict(report: Judged) -> dict[str, Any]:
    v = report.verdict
    tone: Tone = TONES.get(report.exit_code, "bad")
    if v.kind not in ("consistent", "unresolved") and report.exit_code == 0:
        tone = "doubt"  # a mistake that stays within the tolerance
    cause = next((_sentence(f"{f.what}.") for f in v.findings if f.weight == "cause"), "")
    reason = next((f"{e}." for e in v.evidence if e.startswith("Unresolved ")), "")
    meaning = v.meaning or reason or UNDECIDED.get(v.kind) or MEANINGS[v.kind]
    return {"tone": tone, "word": VERDICT_WORDS[v.kind], "sentence": f"{meaning} {cause}".strip()}


def _rests_on(report: Judged) -> Words:
    evidence = tuple(_sentence(f"{e}.") for e in report.verdict.evidence)
    return Words("What the verdict rests on", evidence)


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
    entries = [Told(f, _instant(f, ledger, run), _element(f)) for f in findings]
    return Chapter("What was found, and what to do", (), tuple(entries))


def _instant(finding: Finding, ledger: Ledger | None, run: Trajectory | None) -> float | None:
    """The instant that a finding names, else that at which its channel does most."""
    if run is None:
        return None
    match = _INSTANT.search(f"{finding.what} {finding.evidence}")
    if match is not None:
        t = float(match.group(1))
        if run.t[0] <= t <= run.t[-1]:
            return t
    if ledger is not None and finding.element in ledger.power:
        power = np.abs(ledger.power[finding.element])
        if power.any():
            return float(ledger.t[int(power.argmax())])
    return None


def _element(finding: Finding) -> str:
    """The joint, body or element of a finding: of a channel, its element."""
    kind, _, element = finding.element.partition(" ")
    return element if element and kind in CHANNEL_KINDS else finding.element


def _motion(run: Trajectory | None, mechanism: Mechanism | None) -> Iterator[Chapter]:
    if run is not None and mechanism is not None:
        yield Chapter("The motion", tuple(motions(run, mechanism)))


# --- scene, words, provenance --------------------------------------------------------------------


def moving(
    mechanism: Mechanism | None,
    runs: Sequence[tuple[str, Trajectory | None]],
    side_by_side: bool = False,
) -> Drawing | None:
    """The scene of those runs that are there; None without a mechanism."""
    shown_runs = [(name, run) for name, run in runs if run is not None and len(run) > 1]
    return None if mechanism is None else scene(mechanism, shown_runs, side_by_side)


def _tables(sections: Iterable[Section]) -> Iterator[Part]:
    tables = [part for part in sections if isinstance(part, Table)]
    for k, table in enumerate(tables):
        yield Grid.of("Totals" if k == 0 else "", table)


def _report_chapters(report: Report, heading: str = "The report") -> Iterator[Chapter]:
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
            parts.append(CodeListing("", section.text, diff=section.text.startswith(("---", "@@"))))
    if words:
        parts.append(Words("", tuple(words)))
    yield Chapter(heading, tuple(parts))


def _first_line(report: Report) -> str:
    lines = (type(report).__doc__ or "").strip().splitlines()
    return lines[0] if lines else ""


def _sentence(text: str) -> str:
    """The text with a capital letter, unless it begins with a name or a symbol."""
    first = text.partition(" ")[0].rstrip(",:.")
    return text[:1].upper() + text[1:] if re.fullmatch("[a-z]+", first) else text


def made(run: Trajectory | None, mechanism: Mechanism | None = None) -> tuple[tuple[str, str], ...]:
    """Where a motion comes from."""
    facts: list[tuple[str, str]] = []
    if mechanism is not None:
        facts += [("model", mechanism.name), ("hash of the model", mechanism.hash)]
    if run is not None:
        p = run.provenance
        facts.append(("simulator", p.simulator))
        if p.solver:
            facts.append(("solver", p.solver))
        if p.step:
            facts.append(("step", number(p.step, "s")))
        if p.tolerance:
            facts.append(("tolerance", number(p.tolerance)))
        facts.append(("rows", f"{len(run):,} from {run.t[0]:g} to {run.t[-1]:g} s"))
        if not p.completed:
            facts.append(("stopped early", p.message or "no reason was given"))
        facts += list(p.notes.items())
    return tuple(facts)
