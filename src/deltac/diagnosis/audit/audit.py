"""`audit`: a log of whatever simulator against a model: where the energy went, and what is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import LONG_LOG, ROUGHLY, SAME, SMALL_SHARE, Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.linear_algebra import one_thread_per_matrix
from deltac.calls.progress import Parts, Progress, TimeLimit, counted, no_progress
from deltac.diagnosis.audit import checks
from deltac.diagnosis.audit.conventions import Conventions
from deltac.diagnosis.audit.habits import (
    ORDERS,
    limited,
    realigned,
    rezeroed,
    share_of_a_filter,
    unfiltered,
)
from deltac.diagnosis.audit.prediction import LONGEST, step_with
from deltac.diagnosis.audit.verdict import Judgement, parts_of, unattributable
from deltac.diagnosis.causes.causes import KINDS
from deltac.diagnosis.explain.explain import joint_explanation, with_gears
from deltac.diagnosis.explain.result import Cause, Explanation
from deltac.diagnosis.inference.attribution import with_unexplained
from deltac.diagnosis.inference.forces import FORCES
from deltac.diagnosis.inference.hypotheses import SIGNIFICANT
from deltac.diagnosis.inference.inference import Unclosed, closed, infer
from deltac.diagnosis.inference.integrators import NEAR, IntegratorEstimate
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.result import (
    KNOWN,
    OF_THE_LOG,
    UNNAMED,
    Attribution,
    Inference,
    Share,
)
from deltac.diagnosis.inputs import channels as motors
from deltac.diagnosis.inputs import omissions
from deltac.diagnosis.inputs.logs import Log, LogLike, balanced, in_model_order, read_log, read_run
from deltac.diagnosis.measurements.cleaning import differences
from deltac.diagnosis.verdict import (
    RUN_TOLERANCE,
    Finding,
    Judged,
    Verdict,
    VerdictKind,
    check_tolerance,
    function_of,
)
from deltac.energy import Ledger, balance
from deltac.errors import InputError, LogError, ModelError, SolverError
from deltac.mechanism import Element
from deltac.mechanism.channels import PASSIVE, ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, load_model
from deltac.results import SHOWN, Section, Table, number, percent
from deltac.trajectories import Trajectory
from deltac.trajectories.formats.mapping import MappingLike

if TYPE_CHECKING:
    from deltac.importers import ImportReport


@dataclass(frozen=True)
class Row:
    """A line of the audit's table: energy (J) at the end of the run, its share of that exchanged, origin.

    `energy` is a work for channels, a change for energies; positive into the system. `error`: how far it may
    be off, J; `resolved`: whether that leaves a digit of it.
    """

    name: str
    energy: float
    share: float
    basis: str
    error: float = 0.0
    resolved: bool = True


@dataclass(frozen=True, eq=False, repr=False)
class Audit(
    Judged,
    omit=(
        "ledger",
        "run",
        "mechanism",
        "import_report",
        "energy_error",
        "inference",
        "explanation",
    ),
    also=(
        "relative",
        "energy_exchanged",
        "reference_energy",
        "method",
        "delta_c",
        "error_bar",
        "momenta",
        "rows",
        "samples",
        "imported",
        "integrator",
    ),  # fmt: skip
):
    """What an audit found.

    Attributes:
        ledger: where the energy went; `ledger.basis` says "measured", "computed", "assumed zero" or
            "derived" of every term.
        verdict: what it means.
        run: the log that was judged, its columns in the model's order; of a log read in parts, some rows.
        mechanism: the model it was judged against.
        import_report: what the model's file held that the model does not, None for other models.
        function: the testing function that the verdict rests on.
        energy_error: ΔC with the work of corrections that the simulator applied (T,), J.
        tolerance: accepted |energy_error| as a fraction of the energy that the system has.
        inference: what the rows say of integrator and equations; None where nothing is free to move, or too
            few rows follow each other.
        attribution: ΔC in joules of `integrator`, `equations` and `log`: each has its `energy` with a
            standard `error` at the end, and `curve` and `curve_error` along `t`, J. None where there is no
            inference, or the log is in doubt.
        condition: the assumption on which the joules of `equations` rest, such as that forces missing from
            the log did not act; empty if there is none.
        explanation: the causes, or what stands in their place, with the same verdict behind it.
        causes: what is wrong with the equations or the log, by odds, each with its size and joules.
        odds: probabilities of the four verdicts.
        strict: whether a mistake within the tolerance sets the exit code.
    """

    ledger: Ledger
    verdict: Verdict
    run: Trajectory
    mechanism: Mechanism
    import_report: ImportReport | None
    function: str
    energy_error: Array
    tolerance: float
    inference: Inference | None = None
    attribution: Attribution | None = None
    condition: str = ""
    explanation: Explanation | None = None
    causes: tuple[Cause, ...] = ()
    odds: dict[VerdictKind, float] = field(default_factory=dict)
    strict: bool = False

    @property
    def integrator(self) -> IntegratorEstimate | None:
        """The integrator as its error tells it: `names`, `coefficients` and their `errors`."""
        return None if self.inference is None else self.inference.integrator

    @property
    def relative(self) -> float:
        """Largest |energy_error| as a fraction of `reference_energy`."""
        error, energy = float(np.abs(self.energy_error).max()), self.reference_energy
        return error / energy if energy > 0.0 else 0.0

    def step_for(self, tolerance: float) -> float:
        """The step (s) that would keep |ΔC| of the integrator within a fraction of `reference_energy`.

        Predicted from this log, not run: a known one-step method is tried at other steps from rows of the
        log; for others the joules are scaled by the step to the power of the order. At most ten times the
        log's step, with `tolerance` capped at 0.1: the rows do not tell what longer steps, or a motion that
        differs by more, would do.

        Raises InputError (E-SOLVER) where that is not known: wrong equations, constraints or impacts, whose
        errors have no such order, an integrator that is not identified, joules within their own error or
        beside others that nothing explains.
        """
        accepted = min(check_tolerance(tolerance), ROUGHLY) * self.reference_energy
        if self._unpredictable or self.inference is None or self.attribution is None:
            raise SolverError(
                f"step_for: {self._unpredictable}. `deltac.recommend` finds a step by running the model"
            )
        return step_with(self.inference, self.attribution.integrator.largest[0], accepted)

    @cached_property
    def _predicted(self) -> str:
        """The step for the tolerance, or why none can be predicted; empty where that says nothing.

        Of wrong equations it would say nothing, nor where nothing moves.
        """
        wrong = self.verdict.kind == "equation-error"
        moving = not (self.ledger.at_rest or self.ledger.still)
        if wrong or self.inference is None or not moving:
            return ""
        if self._unpredictable:
            return f"No step can be predicted for the tolerance: {self._unpredictable}."
        step = self.step_for(self.tolerance)
        longest = step >= 0.999 * LONGEST * self.inference.integrator.step
        return (
            f"Steps of {1e3 * step:.2g} ms {'or more ' if longest else ''}would keep ΔC below "
            f"{100 * self.tolerance:g} %: predicted, not run."
        )

    @property
    def _unpredictable(self) -> str:
        """Why no step can be predicted; empty where one can."""
        if self.attribution is None or self.integrator is None:
            doubts = ", ".join(f.kind for f in self.findings if f.weight == "doubt")
            if doubts:
                return f"the log contradicts itself ({doubts}), so that its integrator is not known"
            return "the rows allow no estimate of the integrator"
        if self.verdict.kind == "equation-error":
            return "the equations of the model are not those of the log"
        if self.mechanism.constraints or self.run.events:
            return "errors at constraints and impacts have no order that could predict"
        if not self.integrator.names or {"higher-order", "adaptive"} & set(self.integrator.names):
            return f"{self.integrator.sentence}, and its joules cannot be told from those of others"
        energy, error = self.attribution.integrator.largest
        if energy <= NEAR * error:
            return f"its joules, {energy:.2g} J, are within their error"
        others = float(np.hypot(*self.attribution.log.largest))
        if energy <= NEAR * others:
            return f"beside its {energy:.2g} J, up to {others:.2g} J of ΔC are of the log"
        return ""

    @property
    def reference_energy(self) -> float:
        """The energy that the error is compared with, J: largest K plus range of V."""
        return self.ledger.reference_energy

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 the balance holds within the tolerance, 1 not, 3 unresolved.

        A mistake in the model that stays within the tolerance is named by the verdict and is 0, unless a
        channel of the model moved more energy than that otherwise than in the log, or one is missing. If
        `strict`, a mistake that is real counts however small it is.
        """
        if self.verdict.kind == "unresolved":
            return 3
        differs = any(f.weight == "cause" and f.kind in _BEYOND_TOLERANCE for f in self.findings)
        small = self.ledger.energy_exchanged > 0.0 and self.relative <= self.tolerance
        within_tolerance = self.verdict.kind == "consistent" or small
        if self.strict and any(f.kind == "small-but-real" for f in self.findings):
            return 1
        return 0 if within_tolerance and not differs else 1

    def rows(self) -> tuple[Row, ...]:
        """The table: works of channels, largest first, then K, V, what flowed in, and what is left."""
        ledger = self.ledger
        unit = ledger.energy_exchanged if ledger.energy_exchanged > 0.0 else 1.0

        def row(name: str, energy: float, basis: str, error: float = 0.0) -> Row:
            return Row(name, energy, energy / unit, basis, error)

        unknown = ledger.unresolved
        rows = [
            replace(
                row(n, float(w[-1] - w[0]), ledger.basis.get(n, "computed")),
                error=float(ledger.work_error[n].max()),
                resolved=n not in unknown,
            )
            for n, w in sorted(ledger.work.items(), key=lambda item: -float(np.ptp(item[1])))
        ]
        rows += [row(n, 0.0, b) for n, b in ledger.basis.items() if b == "assumed zero"]
        K, V = ledger.kinetic, ledger.potential_energy
        delta_c = ledger.delta_c[self.function]
        bar = float(ledger.error_bar[self.function].max())
        change = float(K[-1] - K[0] + V[-1] - V[0])
        rows += [
            row("ΔK", float(K[-1] - K[0]), "computed"),
            row("ΔV", float(V[-1] - V[0]), "computed"),
            row("Q", change - float(delta_c[-1]), "work of the non-potential forces"),
            row("ΔC = ΔK + ΔV − Q", float(delta_c[-1]), ledger.method, bar),
        ]
        if not np.array_equal(self.energy_error, delta_c):
            drift = float(self.energy_error[-1])
            rows.append(row("ΔC with corrections", drift, ledger.method, bar))
        return tuple(rows)

    @property
    def energy_exchanged(self) -> float:
        """The energy exchanged, J."""
        return self.ledger.energy_exchanged

    @property
    def method(self) -> str:
        """How ΔC was integrated: "in-loop", "samples" or "discrete"."""
        return self.ledger.method

    @property
    def delta_c(self) -> dict[str, float]:
        """Largest |ΔC| of each testing function, J."""
        return {name: float(np.abs(x).max()) for name, x in self.ledger.delta_c.items()}

    @property
    def error_bar(self) -> dict[str, float]:
        """Largest error bar of each testing function, J."""
        return {name: float(x.max()) for name, x in self.ledger.error_bar.items()}

    def momenta(self) -> dict[str, dict[str, float]]:
        """Of each speed: largest |ΔP_r|, its error bar (kg·m/s, kg·m²/s), its share of p_r's changes."""
        return self.ledger.momenta()

    @property
    def samples(self) -> int:
        """How many samples were judged."""
        return len(self.run)

    @property
    def imported(self) -> dict[str, tuple[str, ...]]:
        """What the import of the model left out, and what it assumed."""
        return motors.import_remarks(self.import_report)

    def summary(self) -> str:
        """Verdict, and the energy error beside the tolerance; of the log where that is no one else's."""
        sign, parts = ">" if self.relative > self.tolerance else "≤", self.attribution
        of_log = self.verdict.kind == "consistent" and sign == ">"
        if parts is not None:
            of_log &= parts.log.largest[0] > parts.integrator.largest[0]
        return (
            f"{self.verdict.kind}: |ΔC| {percent(self.relative)} {sign} {percent(self.tolerance)} of the "
            f"{self.reference_energy:.4g} J that the system has{', by the log' if of_log else ''}"
            f"{self.verdict.certainty}"
        )

    def sections(self) -> Iterator[Section]:
        """Where the energy went, the verdict, what the model's import left out."""
        rows: list[tuple[str, ...]] = []
        for row in self.rows():
            if row.name == "ΔK":
                rows.append(())
            energy, share = number(row.energy), f"{100 * row.share:.3g} %"
            shown = (energy, share) if row.resolved else ("unresolved", "")
            error = number(row.error, digits=2) if row.error else ""
            rows.append((row.name, shown[0], error, shown[1], row.basis))
        yield Table(("channel", "energy (J)", "± (J)", "share", "basis"), tuple(rows))
        if self.attribution is not None:
            yield Table(
                ("ΔC by", "energy (J)", "± (J)"),
                tuple(
                    (name, number(share.energy), number(share.error, digits=2))
                    for name, share in parts_of(self.attribution, self.condition)
                ),
            )
        yield from self.verdict.sections()
        if self._predicted:
            yield self._predicted
        if ignored := self.run.provenance.ignored:
            more = ", …" if len(ignored) > SHOWN else ""
            yield f"Columns of the log that were not read: {', '.join(ignored[:SHOWN])}{more}."
        if self.import_report is not None:
            yield from self.import_report.sections()


_BEYOND_TOLERANCE = (
    "channel-differs",
    "channel-not-in-model",
    "prescribed-departs",
    "missing-contact",
    "missing-equality",
    "constraint-violation",
    "constraint-drift",
)
"""Causes that set the exit code although the balance holds: their forces are those of the log."""

AUDIT_SHARES = {"read": 0.4, "evidence": 0.6}
"""Of the time that each part of an audit takes, roughly."""


@checked
@interruptible()
@one_thread_per_matrix()
def audit(
    model: ModelLike,
    log: LogLike,
    *,
    tolerance: float = RUN_TOLERANCE,
    work: str | None = None,
    mapping: MappingLike = None,
    coordinates: CoordinateMap | str | None = None,
    strict: bool = False,
    replay: bool | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Audit:
    """Judge a log against a model.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        log: a Trajectory; the path of a log; a table (a dictionary of arrays, a DataFrame,
            an xarray Dataset, an array (T, n)); or what SciPy returned (see `Trajectory.from_scipy`).
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).
        work: rule for works, as for `balance`: "in-loop", "samples" or "discrete". By default in-loop where
            the run has works or integrals, discrete for a log with every step of an engine that keeps its
            forces constant over a step, else samples.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        coordinates: those of the log's columns, where they are not the joints': "absolute" for angles against
            the ground, or a CoordinateMap. Forces are those of joints and bodies in any case.
        strict: whether a mistake that is real, though it stays within the tolerance, sets the exit code.
        replay: let MuJoCo step the model from each row to the next, for logs of states and controls that
            need not hold every step. If it arrives at the next rows, the log is this model's, and every
            step is audited. By default tried where the log has controls but lacks forces of the model's
            file; the findings say whether it succeeded.
        time_limit: seconds after which no optional work begins: an automatic replay, other conventions
            of the log, places and axes as causes. What was left out is a finding. By default there is no
            limit.
        progress: called with the fraction done.

    Returns:
        The audit: ledger, verdict, findings.

    Raises:
        InputError: model or log cannot be read, or the log is not of this model.
    """
    reference = _reference(model, tolerance, work)
    source = _Source(log, mapping, coordinates, replay)
    judged = _judged(model, reference, source, TimeLimit(time_limit), Parts(progress, AUDIT_SHARES))
    return _audit(reference, judged, strict)


@checked
@interruptible()
@one_thread_per_matrix()
def explain_residual(
    model: ModelLike,
    log: LogLike | Sequence[LogLike],
    *,
    mapping: MappingLike = None,
    coordinates: CoordinateMap | str | None = None,
    replay: bool | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Find the few changes of a model that explain the residual of its equations along a log.

    The log is judged as by `audit`, but springs and dampers are taken from the model even where the log
    holds them, so that they are tested too. All other logged forces are taken as they are; channels that
    the model does not have are noted. A motor whose strength in the
    recorded run differs from the model's is a cause too, although its logged forces close the equations.

    Several logs of one machine share its causes, each with an integrator and noise of its own: together
    they may show what none shows alone.

    Args:
        model: as for `audit`.
        log: as for `audit`; or a list of several.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        coordinates: those of the log's columns, as for `audit`.
        replay: as for `audit`.
        time_limit: as for `audit`, for each log.
        progress: called with the fraction done.

    Returns:
        The explanation; `str()` of it is the outcome in words, `table()` the numbers.

    Raises:
        InputError: model or log cannot be read, the log is not of this model, or it is too short.
    """
    reference = _reference(model, RUN_TOLERANCE, None)
    report = reference.import_report
    if not len(reference.mechanism.free.u):
        raise ModelError(
            "every joint of the model is prescribed: no equation of motion is left to explain"
        )
    logs = log if isinstance(log, list) else [log]
    if not logs:
        raise LogError("the list of logs is empty; give one log, or several of the same machine")
    judgements = list[Judgement]()
    for one in counted(logs, progress or no_progress):
        source = _Source(one, mapping, coordinates, replay, passive=False)
        judged = _judged(model, reference, source, TimeLimit(time_limit), Parts(None, AUDIT_SHARES))
        if judged.inference is None and not judged.explanation.reasons:
            raise LogError(
                f"the log has {len(judged.rows)} rows, or the model's motion leaves all bounds between them: "
                "too few follow each other to explain anything. Log more of the motion, or a smaller step"
            )
        judgements.append(judged)
    each = [judged.explanation for judged in judgements]
    explanation = next((one for one in each if one.kind == "doubtful"), each[0])
    inferences = [j.inference for j in judgements if j.inference is not None]
    if len(logs) > 1 and len(inferences) == len(logs) and explanation.kind != "doubtful":
        explanation = joint_explanation(inferences, each)
    gears: dict[str, motors.Gear] = {}
    notes: dict[str, None] = {}
    for judged in judgements:
        gears |= {gear.channel: gear for gear in motors.other_gears(judged.rows, report)}
        works = motors.foreign_channels(reference.mechanism, judged.rows, report)
        notes |= dict.fromkeys(words for _, words in motors.foreign_words(works))
    return replace(with_gears(explanation, list(gears.values())), notes=tuple(notes))


@dataclass(frozen=True, eq=False)
class _Source:
    """A log as a user names it, and how to read it; `passive`: whether its springs and dampers count."""

    log: LogLike
    mapping: MappingLike = None
    coordinates: CoordinateMap | str | None = None
    replay: bool | None = None
    passive: bool = True


def _judged(
    model: ModelLike, reference: AuditReference, source: _Source, limit: TimeLimit, parts: Parts
) -> Judgement:
    """A log, read, perhaps stepped again, and judged."""
    log, mapping = source.log, source.mapping
    mechanism, report = reference.mechanism, reference.import_report
    findings: tuple[Finding, ...] = ()
    departures: Array | None = None
    if source.coordinates is not None:
        own = load_model(model).coordinate_map(source.coordinates)
        log, mapping = read_run(mechanism, log, mapping, own), None
    if source.replay is not False and (source.replay or report is not None):
        from deltac.diagnosis.audit import replayed

        again = replayed.replayed(
            model, reference, log, mapping, required=bool(source.replay), limit=limit
        )
        findings, departures = again.findings, again.departures
        by_actuators: Judgement | None = None
        if again.with_actuators is not None and source.passive:
            run, laws = again.with_actuators
            judged = _by_laws(reference, run, laws, limit)
            named = _says_why(judged)
            if source.replay and named:
                return replace(judged, noticed=(*judged.noticed, *findings))
            # A push or a reset is in the replay alone.
            if _is_explained(judged, again.scaled) and (named or not again.occasional):
                departs = (
                    [f for f in findings if f.kind == "replay-departs"] if source.replay else []
                )
                noticed = (*judged.noticed, *map(replayed.as_note, departs))
                by_actuators = replace(judged, noticed=noticed)
        decided = by_actuators is not None and by_actuators.kind != "unresolved"
        other = None
        if again.with_other_parameters and not decided:
            other = again.with_other_parameters()
        if other and source.replay:
            # Asked for are the model's own steps, and the joules by which they miss.
            findings = (*findings, *(f for f in other.findings if f.kind == "identified"))
            other = None
        elif other:
            findings, departures = other.findings, None
        elif by_actuators is not None:
            return by_actuators
        if (stepped := (other or again).run) is not None:
            log, mapping = stepped, None
    if not source.passive:
        run, order = in_model_order(mechanism, read_run(mechanism, log, mapping))
        to_log = " ".join(map(str, report.ignored)) if report else ""
        active = {
            n: f for n, f in run.forces.items() if n.kind not in PASSIVE or f"'{n}'" in to_log
        }
        if len(active) < len(run.forces):  # integrals and works are of all forces
            run = replace(run, forces=active, integrals={}, works={})
        log, mapping, findings = run, None, (*findings, *order)
    progress = parts.part("read")
    read = read_log(mechanism, log, reference.work, mapping, keep=LONG_LOG, progress=progress)
    return _judgement(reference, read, findings, limit, parts.part("evidence"), departures)


def _by_laws(
    reference: AuditReference, run: Trajectory, laws: Sequence[Element], limit: TimeLimit
) -> Judgement:
    """The judgement of a log whose actuators act by the state as some elements do."""
    mechanism, report = reference.mechanism, reference.import_report
    if laws:
        mechanism = replace(mechanism, forces=(*mechanism.forces, *laws))
        report = report and replace(report, servo_damping={})
        reference = replace(reference, mechanism=mechanism, import_report=report)
    read = read_log(mechanism, run, reference.work, None, keep=LONG_LOG)
    return _judgement(reference, read, (), limit)


def audit_together(
    model: ModelLike,
    runs: Sequence[Trajectory],
    *,
    tolerance: float = RUN_TOLERANCE,
    work: str | None = None,
    strict: bool = False,
) -> list[Audit | InputError]:
    """`audit` of several runs of one model, or why one cannot be judged."""
    reference = _reference(model, tolerance, work)
    results = list[Audit | InputError]()
    for run in runs:
        try:
            source = read_log(reference.mechanism, run, work, None, keep=LONG_LOG)
            results.append(
                _audit(reference, _judgement(reference, source, [], TimeLimit()), strict)
            )
        except InputError as error:
            results.append(error)
    return results


@dataclass(frozen=True, eq=False)
class AuditReference:
    """What a log is judged against, and how."""

    mechanism: Mechanism
    import_report: ImportReport | None
    tolerance: float
    work: str | None


def _reference(model: ModelLike, tolerance: float, work: str | None) -> AuditReference:
    check_tolerance(tolerance)
    loaded = load_model(model)
    return AuditReference(loaded.mechanism, loaded.import_report, tolerance, work)


def _judgement(
    reference: AuditReference,
    log: Log,
    known: Sequence[Finding],
    limit: TimeLimit,
    progress: Progress = no_progress,
    departures: Array | None = None,
) -> Judgement:
    """What a log's columns say, the inference of its rows, and what follows.

    `departures` (T,): energy (J) of each row of a replay beyond that of the state at which the step before
    it arrived.
    """
    mechanism, run = reference.mechanism, log.run
    impacts = omissions.impacts_not_held(mechanism, run)
    told = omissions.with_impacts(mechanism, run) if impacts and log.consecutive is run else None
    if told is not None:
        with_them = balanced(mechanism, told[0], reference.work, (*log.findings, told[1]))
        return _judgement(reference, with_them, known, limit, progress)
    missing = omissions.assumed_zero(log.run, reference.import_report)
    findings = _findings_of_columns(reference, log, known, impacts, missing)
    progress(0.2)
    result = _inference_of_rows(reference, log, known, findings, limit, progress)
    if isinstance(result, Judgement):
        return result
    inference, conventions, reading = result
    doubts, certain = {f.kind for f in findings if f.weight == "doubt"}, _names_a_cause(findings)
    if doubts and (inference is None or not _refutes(inference, log, doubts, reference.tolerance)):
        inference = None
    elif inference is not None:
        refuted = doubts | (set(omissions.OF_UNITS) if inference.closes else set())
        findings = [f for f in findings if f.kind not in refuted]
    progress(0.7)
    acted = _imitated(missing, inference)
    if acted and not any(f.kind == "assumed-zero" and f.element for f in findings):
        findings = [f for f in findings if f.kind != "assumed-zero"]
        findings += omissions.assumed_zero_finding(missing, acted)
    if inference is not None and not certain:
        # Rows that follow from each other by a known step are not of another convention.
        explained = inference.closes and not inference.finds_something
        if conventions is not None and reading is None and not explained:
            reading = conventions.rather_than(inference)
        if reading is not None:  # in which forces of the log's states are others, too
            findings = [*(f for f in findings if f.kind != "channel-differs"), reading]
        findings += checks.missing_equalities(mechanism, reference.import_report, run, inference)
    findings += checks.left_out(limit)
    judgement = _in_joules(reference, log, inference, findings, departures)
    progress(1.0)
    return judgement


def _findings_of_columns(
    reference: AuditReference,
    log: Log,
    known: Sequence[Finding],
    impacts: Sequence[Finding],
    missing: Sequence[str],
) -> list[Finding]:
    """What the columns say before anything is inferred; `missing` are channels of the model's file."""
    mechanism, report, tolerance = reference.mechanism, reference.import_report, reference.tolerance
    findings = checks.with_conventions(mechanism, log.consecutive, [*known, *log.findings])
    findings += checks.violations(mechanism, log.run, log.ledger, tolerance)
    findings += impacts
    findings += checks.differing_channels(mechanism, log, report, tolerance)
    findings += checks.stale_rows(mechanism, log.consecutive)
    limits = omissions.limits_reached(log.run, report)
    return findings + omissions.assumed_zero_finding(missing, limits)


def _imitated(missing: Sequence[str], inference: Inference | None) -> list[str]:
    """Channels of the model's file that the log lacks, and that do what causes do."""
    causes = inference.posterior.best.chosen if inference is not None else ()
    places = [(kind, c.element) for c in causes for kind in KINDS[c.kind].like]
    return [name for name in missing if any(name in (f"{k} {at}", f"{k} all") for k, at in places)]


def _names_a_cause(findings: Sequence[Finding]) -> bool:
    """Whether the columns alone show what is wrong: no convention is tried then."""
    return any(f.weight == "cause" and f.kind != "channel-differs" for f in findings)


def _inference_of_rows(
    reference: AuditReference,
    log: Log,
    known: Sequence[Finding],
    findings: Sequence[Finding],
    limit: TimeLimit,
    progress: Progress,
) -> Judgement | tuple[Inference | None, Conventions | None, Finding | None]:
    """The inference of the rows, the conventions that may be tried, and the one by which the rows follow.

    Or the judgement of another log in its place: of the filter's input, with forces shifted by some rows, or
    with the zeros of its coordinates corrected.
    """
    mechanism, ledger = reference.mechanism, log.ledger
    rows = _without_own_laws(mechanism, log.consecutive)
    if reference.import_report is not None:
        servos = reference.import_report.servo_damping
        rows = replace(rows, provenance=replace(rows.provenance, servo_damping=servos))
    doubts = {f.kind for f in findings if f.weight == "doubt"}
    begun = None
    if doubts <= {*omissions.OF_RATES, *omissions.OF_UNITS}:
        if log.consecutive is log.run and _has_speeds_of_its_method(mechanism, rows):
            own = balanced(mechanism, _with_logged_speeds(log.run), reference.work, log.findings)
            return _judgement(reference, own, known, limit, progress)
        begun = closed(mechanism, rows, ledger.energy_exchanged)
    if begun is None:
        return None, None, None
    as_logged, conventions = begun.alone if isinstance(begun, Unclosed) else begun, None
    if (
        as_logged
        and not _names_a_cause(findings)
        and not limit.passed("other conventions of the log")
    ):
        conventions = Conventions(mechanism, rows, as_logged)
    if conventions is not None and isinstance(begun, Unclosed):
        # They are few and far from each other: no cause and no filter resembles one.
        reading = conventions.without_causes()
        if reading is not None:
            return as_logged, conventions, reading
    lacking = any(f.kind == "assumed-zero" and f.element for f in findings)
    inference, before = _inferred(reference, log, rows, begun, limit, lacking)
    if before is not None:
        other = _judgement(reference, before, known, limit, progress)
        # Where neither follows, a filter is likelier than causes that leave what is no noise.
        if not _follows(inference) or _follows(other.inference):
            return other
    if inference is not None:
        # One in the place of a cause needs no other.
        zeros = inference.zero or inference.posterior.best
        if right := rezeroed(rows, inference, zeros, log.findings):
            zeroed = balanced(mechanism, right[0], reference.work, right[1])
            other = _judgement(reference, zeroed, known, limit, progress)
            suffices = inference.zero is None or not other.causes
            if suffices and _follows(other.inference, max(KNOWN, inference.excess)):
                return other
    alone = differences(rows, one_sided=True)
    if inference is not None and alone is not None and _speeds_are_shifted(inference):
        # Speeds that no method makes so are of the coordinates alone.
        of_coordinates = infer(mechanism, alone, ledger.energy_exchanged, limit)
        if of_coordinates is not None and of_coordinates.methods:
            inference = of_coordinates
    return inference, conventions, None


def _with_logged_speeds(run: Trajectory) -> Trajectory:
    """The run with its speeds taken as they were logged, not as derived from the coordinates."""
    derived = {name: of for name, of in run.provenance.derived.items() if name != "u"}
    return replace(run, provenance=replace(run.provenance, derived=derived))


def _has_speeds_of_its_method(mechanism: Mechanism, run: Trajectory) -> bool:
    """Whether speeds that are central differences of the coordinates are a method's own (velocity Verlet).

    Its map makes each row from the one before, perhaps except for the first. Where the differences were taken
    afterwards, the last one is one-sided, and no map makes it.
    """
    if "u" not in run.provenance.derived or differences(run) is None:
        return False
    own = closed(mechanism, _with_logged_speeds(run))
    if not isinstance(own, Inference) or not own.closes:
        return False
    noise = np.hypot(*own.log.noise)
    return bool(np.all(np.abs(own.residual[-1]) <= SIGNIFICANT * noise[-1]))


def _refutes(inference: Inference, log: Log, doubts: set[str], tolerance: float) -> bool:
    """Whether an inference refutes doubts of the rates: rows that follow by a known step are at most coarse.

    Works integrated in the loop that balance the energies of these coordinates and speeds refute them, too.
    """
    ledger = log.ledger
    error = np.abs(ledger.uncorrected(function_of(ledger))).max()
    in_balance = ledger.method == "in-loop" and error <= tolerance * ledger.reference_energy
    return inference.closes or bool(in_balance and doubts <= set(omissions.OF_RATES))


def _in_joules(
    reference: AuditReference,
    log: Log,
    inference: Inference | None,
    findings: list[Finding],
    departures: Array | None,
) -> Judgement:
    """The judgement: ΔC split by the inference, with the findings about works."""
    mechanism, report, tolerance = reference.mechanism, reference.import_report, reference.tolerance
    function = function_of(log.ledger)
    in_loop = log.ledger.method == "in-loop" and bool(log.run.integrals or log.run.works)
    log = _as_stepped(reference, log, inference)
    run, ledger = log.run, log.ledger
    attribution = None
    if inference is not None and not unattributable(findings):
        steps = _Departures.of(run, departures, findings, ledger.t)
        attribution = _attributed(inference, ledger, function, in_loop, steps)
    if attribution is not None and any(f.kind == "restitution" for f in findings):
        attribution = _of_impacts(attribution, ledger, function)
    if attribution is not None and not in_loop and len(attribution.t) == len(ledger.t):
        bar = NORMAL_95 * attribution.log.curve_error
        ledger = replace(ledger, error_bar={**ledger.error_bar, function: bar})
    findings += omissions.unresolved_works(run, ledger)
    findings += motors.differing_gears(run, ledger, tolerance, report)
    foreign = motors.foreign_channels(mechanism, log.consecutive, report)
    findings += motors.foreign_notes(foreign, ledger.energy_exchanged)
    return Judgement(
        run,
        ledger,
        function,
        log.consecutive,
        inference,
        attribution,
        tuple(findings),
        tolerance,
        in_loop,
    )


def _inferred(
    reference: AuditReference,
    log: Log,
    rows: Trajectory,
    begun: Inference | Unclosed,
    limit: TimeLimit,
    lacking: bool,
) -> tuple[Inference | None, Log | None]:
    """The inference of the rows of a log, and the log that is judged in its place if its rows close.

    That is what went into a filter, or the same states with the forces of other rows. The inference is None
    where such a log closes without a cause, or nothing is inferred.
    """
    mechanism = reference.mechanism
    known = {f.kind for f in log.findings}
    model, inference = LogModel(mechanism, rows), None
    allowed = reference.tolerance * log.ledger.reference_energy
    if not isinstance(begun, Unclosed):
        return _in_doubt(begun, model, rows, allowed), None
    asked = "filtered" not in known and not limit.passed("a filter of the log")
    shifted = "late-forces" in known
    # What closes rows without a cause is asked first.
    through = None if shifted else realigned(mechanism, rows, begun, False)
    if through is None and "limited-forces" not in known:
        through = limited(mechanism, rows, begun)
    if through is None and asked:
        through = unfiltered(model, rows)
    if through is None:
        inference = begun.with_causes(limit, lacking, "filtered" in known)
        forced = inference is not None and inference.force is not None
        # A filter is likelier that leaves no more than causes may.
        if forced and share_of_a_filter(model, rows) >= 1.0 - UNNAMED:
            inference = begun.with_causes(limit, lacking, True)
    # Beside a mistake, neither forces of other rows nor a filter may close the rows; beside causes they do.
    # Zeros of coordinates are put right before. Causes that have no more numbers than a filter, and explain
    # all but a thousandth, are likelier.
    if (
        inference is not None
        and "zero-offset" not in inference.kinds
        and 1.0 - inference.explained > SMALL_SHARE**2
        and (
            inference.late
            or inference.excess > KNOWN
            or (
                inference.finds_something
                and not inference.closes
                and (inference.numbers > ORDERS[0] or 1.0 - inference.explained > SMALL_SHARE)
            )
        )
    ):
        through = None if shifted else realigned(mechanism, rows, begun, True)
        if through is None and asked:
            through = unfiltered(model, rows, (begun.kernels,))
    if through is None:
        return _in_doubt(inference, model, rows, allowed), None
    before, told = through
    return inference, balanced(mechanism, before, reference.work, (*log.findings, told))


def _in_doubt(
    inference: Inference | None, model: LogModel, rows: Trajectory, allowed: float
) -> Inference | None:
    """The inference; joules that may be those of a filter of the rows are in doubt.

    As much of them is as nothing explains of the rows, or as a filter does where no cause and no fixed method
    is found; all of them where states are late or smooth beside the forces, and do not follow even so. A
    filter is asked for where it may decide: some of what is `allowed` (J) is exceeded, or causes leave more
    than noise.
    """
    if inference is None:
        return None
    unknown = inference.late and inference.excess > KNOWN
    parts, share = inference.attribution, 1.0 if unknown else float(np.sqrt(inference.misfit))
    joules = np.abs(parts.integrator.curve)
    nameless = inference.scattered or not inference.integrator.names
    by_filter = 0.0
    if inference.finds_something:
        habits = set(OF_THE_LOG) & set(inference.kinds)  # delays are a filter's already
        if inference.misfit > 0.0 and inference.explained < 1.0 - SMALL_SHARE and not habits:
            by_filter = share_of_a_filter(model, rows)
    elif nameless and joules.max() > ROUGHLY * allowed:
        share = max(share, share_of_a_filter(model, rows))
    parts = with_unexplained(parts, share * joules)
    return replace(inference, attribution=parts, by_filter=by_filter)


def _follows(inference: Inference | None, most: float = KNOWN) -> bool:
    """Whether rows follow from each other but for noise, or `most` of it, perhaps beside causes."""
    return inference is not None and (inference.closes or inference.excess <= most)


def _is_explained(judged: Judgement, scaled: bool) -> bool:
    """Whether each row follows from the one before, or causes explain most of what they depart by.

    Where the controls may be a policy's outputs, which are `scaled` before they act, they must explain all
    but a millionth, and a gear or a scale of all masses explains nothing.
    """
    scales = {c.kind for c in judged.causes} & {"actuator-gear", "mass-scale"}
    inference, most = judged.inference, SMALL_SHARE**2 if scaled else ROUGHLY
    named = inference and _names_causes(judged) and 1.0 - inference.explained <= most
    explained = _follows(inference) or bool(named)
    return _turns_axes(judged) or (explained and not (scaled and scales))


def _turns_axes(judged: Judgement) -> bool:
    """Whether rows follow by other axes of joints."""
    return any(f.kind in ("joint-axis", "axis-sign") for f in judged.noticed)


def _says_why(judged: Judgement) -> bool:
    """Whether a judgement names what keeps a replay from reproducing the rows."""
    late = any(f.kind == "late-forces" for f in judged.noticed)
    named = _follows(judged.inference) and (late or _names_causes(judged))
    return _turns_axes(judged) or named


def _names_causes(judged: Judgement) -> bool:
    """Whether causes are named that forces which the log lacks do not do."""
    return bool(judged.causes) and judged.lacking is None


def _speeds_are_shifted(inference: Inference) -> bool:
    """Whether the integrator's numbers are those of no method but of speeds half a step early or late.

    With u + c h a for u: δq̇ = −c h a, δu̇ = c h ∂a/∂q u.
    """
    c = inference.integrator.coefficients
    of_q, of_u = c.get("q: a", 0.0), c.get("u: a_q u", 0.0)
    return not inference.methods and bool(np.allclose((abs(of_q), of_u), (0.5, -of_q), atol=0.05))


def _without_own_laws(mechanism: Mechanism, run: Trajectory) -> Trajectory:
    """A run without the forces that are the model's own at its rows: they are so between rows.

    A spline through their rows would only repeat them with an error. What is held over a step is not the
    model's there.
    """
    held, step = set(map(str, run.provenance.held or ())), run.provenance.step
    thinned = step is not None and len(run) > 1 and np.median(np.diff(run.t)) >= 1.01 * step
    if not len(mechanism.free.u) or thinned or set(map(str, run.forces)) <= held:
        return run
    rows, laws = checks.own_laws(mechanism, run)
    own = set[ChannelName]()
    for name, law in laws.items():
        if name in run.forces and str(name) not in held:
            difference = run.forces[name][np.ix_(rows, mechanism.free.u)] - law
            if np.abs(difference).max() <= SAME * np.abs(law).max():
                own.add(name)
    if not own:
        return run
    forces = {name: values for name, values in run.forces.items() if name not in own}
    # The sums of forces at stages lack those of springs and dampers alone.
    stages = run.stages if all(name.kind in PASSIVE for name in own) else None
    return replace(run, forces=forces, integrals={}, works={}, stages=stages)


def _audit(reference: AuditReference, judged: Judgement, strict: bool) -> Audit:
    """A judgement as users see it."""
    run, ledger, report = judged.run, judged.ledger, reference.import_report
    verdict, explanation = judged.verdict, judged.explanation
    basis = {**ledger.basis, **dict.fromkeys(omissions.assumed_zero(run, report), "assumed zero")}
    basis |= {n: "derived" for n, c in (("u", "u"), ("u̇", "udot")) if c in run.provenance.derived}
    return Audit(
        ledger=replace(ledger, basis=basis),
        verdict=replace(verdict, limits=(*verdict.limits, *motors.limits(run, report))),
        run=run,
        mechanism=reference.mechanism,
        import_report=report,
        function=judged.function,
        energy_error=ledger.uncorrected(judged.function),
        tolerance=judged.tolerance,
        inference=judged.inference,
        attribution=judged.attribution,
        condition=judged.condition,
        explanation=explanation,
        causes=explanation.causes,
        odds=judged.odds,
        strict=strict,
    )


NORMAL_95 = 1.96
"""Standard errors of a bar that holds the truth in 95 of 100 cases."""


@dataclass(frozen=True, eq=False)
class _Departures:
    """Energy that rows of a replay have beyond the states at which it arrives, J, at the ledger's times.

    It is of the equations where the model does not arrive, else of the digits of the log.
    """

    equations: Array
    log: Array

    @staticmethod
    def of(
        run: Trajectory, joules: Array | None, findings: Sequence[Finding], t: Array
    ) -> _Departures:
        none = np.zeros(len(t))
        if joules is None or len(joules) != len(run):
            return _Departures(none, none)
        curve = np.interp(t, run.t, np.cumsum(joules))
        departs = any(f.kind == "replay-departs" for f in findings)
        return _Departures(curve, none) if departs else _Departures(none, curve)


def _attributed(
    inference: Inference, ledger: Ledger, function: str, in_loop: bool, departures: _Departures
) -> Attribution:
    """ΔC of the ledger by its causes, at the ledger's times; of a log in stretches by their rates.

    What integrator and mistakes do not make of it is the log's. ΔC in the loop has no error of sampling: what
    mistakes and departures of a replay did not do of it is the integrator's.
    """
    own, t = inference.attribution, ledger.t
    delta_c, bar = ledger.uncorrected(function), ledger.error_bar[function]

    def along(curve: Array, error: bool = False) -> Array:
        start = curve[0] if error else 0.0
        at = np.interp(t, np.r_[t[0], own.t], np.r_[start, curve])
        return np.asarray(at)

    equations = Share(along(own.equations.curve), along(own.equations.curve_error, True))
    if in_loop:
        if departures.equations.any():  # they are all that mistakes did
            equations = Share(departures.equations, np.zeros_like(bar))
        rest = delta_c - equations.curve - departures.log
        error = np.hypot(bar, equations.curve_error)
        whole = len(own.t) == len(t) - 1
        varying = inference.knows_stages and any(kind != "start" for kind in inference.forces)
        if inference.methods and whole and not varying:
            # A step's own works and those of the flow from its row differ where forces depend on the state.
            # Through forces that vary at its stages, as those of contacts, there is no such flow.
            error = np.hypot(error, np.abs(rest - along(own.integrator.curve)))
        return Attribution(t, Share(rest, error), equations, Share(departures.log, bar))
    integrator = Share(along(own.integrator.curve), along(own.integrator.curve_error, True))
    driven = len(inference.model.mechanism.free.u) < len(inference.model.mechanism.speeds)
    between = inference.switching or "step" in inference.forces
    if len(own.t) < len(t) - 1 and not between and not driven:
        # Of the larger share a balance of all rows may tell more than the stretches that were looked at, if
        # its works are of forces, and of drives, as in the flow.
        if integrator.error < equations.error and equations.curve.any():
            balance = Share(delta_c - integrator.curve, np.hypot(bar, integrator.curve_error))
            equations = _pooled(equations, balance)
        else:
            balance = Share(delta_c - equations.curve, np.hypot(bar, equations.curve_error))
            integrator = _pooled(integrator, balance)
    rest = delta_c - integrator.curve - equations.curve
    # Works of the ledger are quadratures of the rows, the flow's are not: each bounds the other's error.
    quadrature = np.abs(rest - along(own.log.curve))
    error = np.hypot(along(own.log.curve_error, True), quadrature)
    return Attribution(t, integrator, equations, Share(rest, error))


def _of_impacts(own: Attribution, ledger: Ledger, function: str) -> Attribution:
    """ΔC where impacts of the model are wrong: what no integrator does is of the equations."""
    rest, bar = ledger.uncorrected(function) - own.integrator.curve, ledger.error_bar[function]
    equations = Share(rest, np.hypot(bar, own.integrator.curve_error))
    return replace(own, equations=equations, log=Share(np.zeros_like(rest), bar))


def _pooled(share: Share, balance: Share) -> Share:
    """The better known of two measurements of a share; where they contradict each other, neither is sure."""
    gap = np.abs(share.curve - balance.curve)
    if np.any(gap > NORMAL_95 * np.hypot(share.curve_error, balance.curve_error)):
        return Share(share.curve, np.hypot(share.curve_error, gap))
    return min(balance, share, key=lambda one: one.error)


def _as_stepped(reference: AuditReference, log: Log, inference: Inference | None) -> Log:
    """The log with what its steps tell: speeds that it lacks, works of forces held over each."""
    run = log.run
    if inference is None or log.consecutive is not run or reference.work is not None:
        return log
    run = _with_speeds(inference, run)
    held = _held_between_rows(inference, run)
    if held is None and run is log.run:
        return log
    return replace(log, run=run, ledger=balance(reference.mechanism, run if held is None else held))


def _with_speeds(inference: Inference, run: Trajectory) -> Trajectory:
    """The run with the speeds by which a known method makes its coordinates, where it has none at all.

    Differences of coordinates may be a method's own speeds, as they are of velocity Verlet.
    """
    model, at = inference.model, inference.log.intervals
    lacking = "u" in run.provenance.derived and differences(run) is None
    whole = model.n == len(run.speeds) and len(at.h) == len(run) - 1
    if not (inference.speeds_known and lacking and whole):
        return run
    u = np.array(run.u)
    u[:, model.of_u] = np.concatenate([at.start.u[:1], at.end.u])
    error = np.zeros(len(run.speeds))
    error[model.of_u] = inference.log.noise_of_steps[:, model.n :].max(axis=0)
    errors = dict(zip(run.speeds, error.tolist(), strict=True))
    derived = {**run.provenance.derived, "u": errors}
    return replace(run, u=u, provenance=replace(run.provenance, derived=derived))


def _held_between_rows(inference: Inference, run: Trajectory) -> Trajectory | None:
    """The run with each force that which acts until the next row, and its work (T,), J.

    None where one is not constant there, or acts on prescribed speeds.
    """
    if (
        not inference.forces
        or inference.switching
        or any(FORCES[kind][1] for kind in inference.forces)
    ):
        return None
    model = inference.model
    if run.works or run.integrals or set(run.forces) != set(model.log.places):
        return None
    rows = model.rows(run)
    moved = model.difference(rows.take(slice(0, -1)), rows.take(slice(1, None)))[:, : model.n]
    steps = inference.steps if inference.methods else inference.w
    if len(steps) == len(moved):
        # The work along the motion: what the integrator does besides is its error, and in ΔC. An unknown one
        # may do all that rows depart by.
        moved = moved - steps[:, : model.n]
    place = {int(k): row for row, k in enumerate(model.of_u)}
    works, forces = dict[ChannelName, Array](), dict[ChannelName, Array]()
    for name, speeds in model.log.places.items():
        if any(k not in place for k in speeds):
            return None
        columns = model.log.columns[name]
        a = np.array([FORCES[inference.forces[c]][0] for c in range(columns.start, columns.stop)])
        F = run.forces[name][:, speeds]
        acting = F[:-1] + a * np.diff(F, axis=0)
        power = np.einsum("km,km->k", acting, moved[:, [place[k] for k in speeds]])
        works[name] = np.concatenate([[0.0], np.cumsum(power)])
        forces[name] = np.array(run.forces[name])
        forces[name][: len(acting), speeds] = acting
    provenance = replace(
        run.provenance, step=float(np.median(np.diff(run.t))), held=tuple(map(str, works))
    )
    return replace(run, works=works, forces=forces, provenance=provenance)
