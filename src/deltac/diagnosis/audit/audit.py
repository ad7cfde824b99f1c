"""`audit`: a log of whatever simulator against a model: where the energy went, and what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Deadline, Parts, Progress, untold
from deltac.diagnosis.audit import checks
from deltac.diagnosis.audit.evidence import gather
from deltac.diagnosis.audit.facts import facts_of
from deltac.diagnosis.audit.measures import measures_of
from deltac.diagnosis.audit.reading import Known, Reference, read
from deltac.diagnosis.audit.rules import judge
from deltac.diagnosis.audit.steps import first_tests
from deltac.diagnosis.inference.integrators import IntegratorEstimate
from deltac.diagnosis.inference.posterior import (
    Attribution,
    CauseEstimate,
    Inference,
    Share,
    causes_of,
    infer,
)
from deltac.diagnosis.inputs import channels as motors
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.verdict import RUN_TOLERANCE, Finding, Judged, Verdict, check_tolerance
from deltac.energy import Ledger
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, load_model
from deltac.results import Section, Table, number, percent
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.importers import ImportReport


P = ParamSpec("P")
T = TypeVar("T")


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
    omit=("ledger", "run", "mechanism", "import_report", "energy_error", "step"),
    also=(
        "relative",
        "energy_exchanged",
        "reference_energy",
        "method",
        "delta_c",
        "error_bar",
        "rows",
        "samples",
        "imported",
        "one_step",
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
        step: the one-step test of the rows, where it was made.
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
    step: OneStep | None = None
    strict: bool = False

    @cached_property
    def inference(self) -> Inference | None:
        """What the prediction errors of the rows say, inferred when it is first asked for."""
        return infer(self.mechanism, self.run, self.ledger.energy_exchanged)

    @property
    def attribution(self) -> Attribution | None:
        """ΔC in joules of `integrator`, `equations` and `log`.

        Each has its `energy` with a standard `error` at the end, `curve` and `curve_error` along `t`, J.

        None where rows are too few, nothing is free to move, or not all rows of the log were looked at.
        """
        own = self.inference
        if own is None or own.whole > WHOLE:
            return None
        parts, t = own.attribution, self.ledger.t
        if self.method != "in-loop" or len(t) != len(parts.t) + 1:
            return parts
        # ΔC in the loop has no error of sampling: what mistakes did not do of it is the integrator's.
        bar = self.ledger.error_bar[self.function][1:]
        curve = self.energy_error[1:] - parts.equations.curve
        integrator = Share(curve, np.hypot(bar, parts.equations.curve_error))
        return replace(parts, integrator=integrator, log=Share(np.zeros_like(bar), bar))

    @property
    def integrator(self) -> IntegratorEstimate | None:
        """The integrator as its error tells it: `names`, `coefficients` and their `errors`."""
        return None if self.inference is None else IntegratorEstimate.of(self.inference)

    @property
    def causes(self) -> tuple[CauseEstimate, ...]:
        """Causes by the odds of the prediction errors, each with its size and joules."""
        return () if self.inference is None else causes_of(self.mechanism, self.inference)

    @property
    def one_step(self) -> dict[str, Any] | None:
        """What the one-step test says: the integrator, and what is left of each equation."""
        return None if self.step is None else self.step.to_dict()

    @property
    def relative(self) -> float:
        """Largest |energy_error| as a fraction of `reference_energy`."""
        error, energy = float(np.abs(self.energy_error).max()), self.reference_energy
        return error / energy if energy > 0.0 else 0.0

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
        kept = self.verdict.kind == "consistent" or small
        if self.strict and any(f.kind == "small-but-real" for f in self.findings):
            return 1
        return 0 if kept and not differs else 1

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
            left = float(self.energy_error[-1])
            rows.append(row("ΔC with corrections", left, ledger.method, bar))
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

    @property
    def samples(self) -> int:
        """How many samples were judged."""
        return len(self.run)

    @property
    def imported(self) -> dict[str, tuple[str, ...]]:
        """What the import of the model left out, and what it assumed."""
        return motors.told(self.import_report)

    def summary(self) -> str:
        """Verdict, and the energy error beside the tolerance."""
        sign = ">" if self.relative > self.tolerance else "≤"
        return (
            f"{self.verdict.kind}: |ΔC| {percent(self.relative)} {sign} {percent(self.tolerance)} of the "
            f"{self.reference_energy:.4g} J that the system has{self.verdict.certainty}"
        )

    def sections(self) -> Iterator[Section]:
        """Where the energy went, the verdict, what the model's import left out."""
        rows: list[tuple[str, ...]] = []
        for row in self.rows():
            if row.name == "ΔK":
                rows.append(())
            energy, share = number(row.energy), f"{100 * row.share:.3g} %"
            told = (energy, share) if row.resolved else ("unresolved", "")
            error = number(row.error, digits=2) if row.error else ""
            rows.append((row.name, told[0], error, told[1], row.basis))
        yield Table(("channel", "energy (J)", "± (J)", "share", "basis"), tuple(rows))
        yield from self.verdict.sections()
        if self.import_report is not None:
            yield from self.import_report.sections()


WHOLE = 1.02
"""Time of a log over that of the rows that were looked at, up to which these are the whole log."""

_BEYOND_TOLERANCE = (
    "channel-differs",
    "channel-not-in-model",
    "prescribed-departs",
    "missing-contact",
    "missing-equality",
    "constraint-violation",
    "constraint-drift",
)


SECONDS = 40.0
"""Time (s) after which an audit ends its search for causes with what it has."""

SHARES = {"read": 0.4, "evidence": 0.6}
"""Of the time that each part of an audit takes, roughly."""


@checked
@interruptible()
def audit(
    model: ModelLike,
    log: Any,
    *,
    tolerance: float = RUN_TOLERANCE,
    work: str | None = None,
    mapping: Any = None,
    strict: bool = False,
    replay: bool | None = None,
    progress: Progress | None = None,
) -> Audit:
    """Judge a log against a model.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        log: a Trajectory; the path of a log; a table (a dictionary of arrays, a DataFrame,
            an xarray Dataset, an array (T, n)); or what SciPy returned (see `Trajectory.from_scipy`).
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).
        work: rule for works, as for `balance`: "in-loop", "samples" or "discrete"; by default in the loop
            where the run has that, discrete where it holds every step of an engine that holds its forces over
            a step.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        strict: whether a mistake that is real, though it stays within the tolerance, sets the exit code.
        replay: step MuJoCo's model between the rows of a log of states and controls, which need not have
            every step: tells whether the log is this model's, and audits every step. By default where the log
            has controls, lacks forces that the model's file has, and is reproduced; the findings say so.
        progress: called with the fraction done.

    Returns:
        The audit: ledger, verdict, findings.

    Raises:
        InputError: model or log cannot be read, or the log is not of this model.
    """
    reference = _reference(model, tolerance, work)
    deadline, parts = Deadline(SECONDS), Parts(progress, SHARES)
    of_replay: tuple[Finding, ...] = ()
    if replay is not False and (replay or reference.import_report is not None):
        from deltac.diagnosis.audit import replayed

        again = replayed.replayed(model, reference, log, mapping, required=bool(replay))
        of_replay = again.findings
        if again.run is not None:
            log, mapping = again.run, None
    known = read(reference, log, mapping, of_replay, parts.part("read"))
    (step,) = first_tests(reference.mechanism, [known])
    return _judged(reference, known, step, strict, deadline, parts.part("evidence"))


def audit_together(
    model: ModelLike,
    runs: Sequence[Trajectory],
    *,
    tolerance: float = RUN_TOLERANCE,
    work: str | None = None,
    strict: bool = False,
) -> list[Audit | InputError]:
    """`audit` of several runs, or why one cannot be judged; the one-step test sees all of them at once."""
    reference = _reference(model, tolerance, work)
    known = [_or_error(read, reference, run) for run in runs]
    good = [k for k in known if isinstance(k, Known)]
    steps = iter(first_tests(reference.mechanism, good))
    return [
        _or_error(_judged, reference, k, next(steps), strict, Deadline(SECONDS))
        if isinstance(k, Known)
        else k
        for k in known
    ]


def _or_error(make: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | InputError:
    try:
        return make(*args, **kwargs)
    except InputError as error:
        return error


def _reference(model: ModelLike, tolerance: float, work: str | None) -> Reference:
    check_tolerance(tolerance)
    loaded = load_model(model)
    return Reference(loaded.mechanism, loaded.import_report, tolerance, work)


def _judged(
    reference: Reference,
    known: Known,
    step: OneStep | None,
    strict: bool,
    deadline: Deadline,
    progress: Progress = untold,
) -> Audit:
    """The audit of a log with the first one-step test of its rows: evidence, measures, verdict."""
    mechanism, report = reference.mechanism, reference.import_report
    evidence = gather(reference, known, step, deadline=deadline, progress=progress)
    log = evidence.log
    run, ledger = log.run, log.ledger
    missing = checks.assumed_zero(run, report)
    basis = {**ledger.basis, **dict.fromkeys(missing, "assumed zero")}
    basis |= {n: "derived" for n, c in (("u", "u"), ("u̇", "udot")) if c in run.provenance.derived}
    ledger = replace(ledger, basis=basis)
    findings = [
        *known.findings,
        *evidence.findings,
        *checks.assumed_zero_finding(missing),
        *checks.unresolved_works(ledger),
        *motors.differing_gears(run, ledger, reference.tolerance, report),
        *motors.foreign_notes(
            motors.foreign_channels(mechanism, log.consecutive, report), ledger.energy_exchanged
        ),
    ]
    # The step is that of the log, and not how forces were found to be held.
    energy = measures_of(reference, log, evidence.step, known.log.run.provenance.step)
    verdict = judge(facts_of(energy, evidence, findings))
    return Audit(
        ledger=ledger,
        verdict=replace(verdict, limits=(*verdict.limits, *motors.limits(run, report))),
        run=run,
        mechanism=mechanism,
        import_report=report,
        function=energy.function,
        energy_error=ledger.uncorrected(energy.function),
        tolerance=reference.tolerance,
        step=evidence.step,
        strict=strict,
    )
