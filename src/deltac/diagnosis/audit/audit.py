"""`audit`: a log of whatever simulator against a model: where the energy went, and what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.deprecation import RenamedAttribute
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Deadline, Parts, Progress, untold
from deltac.diagnosis.audit import checks
from deltac.diagnosis.audit.evidence import Known, first_tests, gather
from deltac.diagnosis.audit.noise import energy_of_noise
from deltac.diagnosis.audit.rules import Measures, judge, small_but_real
from deltac.diagnosis.inputs import channels as motors
from deltac.diagnosis.inputs.channels import foreign_channels, foreign_notes, told
from deltac.diagnosis.inputs.logs import Log, held_between_rows, read_log, stretches
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.verdict import Finding, Judged, Verdict
from deltac.energy import Ledger, balance
from deltac.energy.streaming import KEPT
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.models import Model, ModelLike, load_model
from deltac.results import Section, Table, number, percent
from deltac.trajectories import Trajectory
from deltac.trajectories.lint import gap_rows

if TYPE_CHECKING:
    from deltac.importers import ImportReport


TOLERANCE = 1e-3
"""Energy error that is accepted by default, as a fraction of the energy exchanged."""


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
        tolerance: accepted |energy_error| as a fraction of the energy exchanged, or of the energy that the
            system has, where that is less.
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

    left_over = RenamedAttribute("energy_error")
    turnover = RenamedAttribute("energy_exchanged")

    @property
    def one_step(self) -> dict[str, Any] | None:
        """What the one-step test says: the integrator, and what is left of each equation."""
        return None if self.step is None else self.step.to_dict()

    @property
    def relative(self) -> float:
        """Largest |energy_error| as a fraction of the energy exchanged, or that the system has, if less."""
        return float(np.abs(self.energy_error).max()) / self.beside if self.beside > 0.0 else 0.0

    @property
    def beside(self) -> float:
        """The energy that the error is judged beside: exchanged, or that the system has, if less; J."""
        return min(self.ledger.energy_exchanged, _held_energy(self.ledger))

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
            for n, w in sorted(ledger.work.items(), key=lambda item: -_reach(item[1]))
        ]
        rows += [row(n, 0.0, b) for n, b in ledger.basis.items() if b == "assumed zero"]
        K, V = ledger.kinetic, ledger.potential_energy
        delta_c = ledger.delta_c[self.function]
        bar = float(ledger.error_bar[self.function].max())
        change = float(K[-1] - K[0] + V[-1] - V[0])
        rows += [
            row("ΔK", float(K[-1] - K[0]), "computed"),
            row("ΔV", float(V[-1] - V[0]), "computed"),
            row("Q", change - float(delta_c[-1]), "the works, without those of V"),
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
        return told(self.import_report)

    def summary(self) -> str:
        """Verdict, and the energy error beside the tolerance."""
        sign = ">" if self.relative > self.tolerance else "≤"
        what = "exchanged" if self.beside == self.energy_exchanged else "that the system has"
        return (
            f"{self.verdict.kind}: |ΔC| {percent(self.relative)} {sign} {percent(self.tolerance)} of the "
            f"{self.beside:.4g} J {what} "
            f"(confidence {self.verdict.confidence})"
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
    tolerance: float = TOLERANCE,
    work: str | None = None,
    mapping: Any = None,
    strict: bool = False,
    replay: bool = False,
    progress: Progress | None = None,
) -> Audit:
    """Judge a log against a model.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        log: a Trajectory; the path of a log; a table (a dictionary of arrays, a DataFrame,
            an xarray Dataset, an array (T, n)); or what SciPy returned (see `Trajectory.from_scipy`).
        tolerance: accepted |ΔC| as a fraction of the energy exchanged.
        work: rule for works, as for `balance`: "in-loop", "samples" or "discrete"; by default in the loop
            where the run has that, discrete where it holds every step of an engine that holds its forces over
            a step.
        mapping: path of a mapping file, for logs whose columns have other names or units.
        strict: whether a mistake that is real, though it stays within the tolerance, sets the exit code.
        replay: step MuJoCo's model between the rows of a log of states and controls, which need not have
            every step: tells whether the log is this model's, and audits every step.
        progress: called with the fraction done.

    Returns:
        The audit: ledger, verdict, findings.

    Raises:
        InputError: model or log cannot be read, or the log is not of this model.
    """
    _check_tolerance(tolerance)
    loaded = load_model(model)
    deadline, parts = Deadline(SECONDS), Parts(progress, SHARES)
    of_replay: list[Finding] = []
    if replay:
        from deltac.diagnosis.audit.replayed import replayed

        log, of_replay = replayed(model, loaded.mechanism, log, mapping)
        mapping = None
    known = _known(loaded, log, tolerance, work, mapping, of_replay, parts.part("read"))
    (step,) = first_tests(loaded.mechanism, [known])
    options = (tolerance, work, strict)
    return _judged(loaded, known, step, *options, deadline, parts.part("evidence"))


def audit_together(
    model: ModelLike,
    runs: Sequence[Trajectory],
    *,
    tolerance: float = TOLERANCE,
    work: str | None = None,
    strict: bool = False,
) -> list[Audit | InputError]:
    """`audit` of several runs, or why one cannot be judged; the one-step test sees all of them at once."""
    _check_tolerance(tolerance)
    loaded = load_model(model)
    found: list[Audit | InputError] = []
    known: list[Known | InputError] = []
    for run in runs:
        try:
            known.append(_known(loaded, run, tolerance, work))
        except InputError as error:
            known.append(error)
    steps = iter(first_tests(loaded.mechanism, [k for k in known if not isinstance(k, InputError)]))
    for one in known:
        if isinstance(one, InputError):
            found.append(one)
            continue
        try:
            deadline = Deadline(SECONDS)
            found.append(_judged(loaded, one, next(steps), tolerance, work, strict, deadline))
        except InputError as error:
            found.append(error)
    return found


def _check_tolerance(tolerance: float) -> None:
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance is {tolerance!r}; expected a number between 0 and 1")


def _known(
    loaded: Model,
    log: Any,
    tolerance: float,
    work: str | None,
    mapping: Any = None,
    findings: Sequence[Finding] = (),
    progress: Progress | None = None,
) -> Known:
    """A log that was read and balanced, with what its columns say before the equations are looked at."""
    mechanism = loaded.mechanism
    log_read = read_log(mechanism, log, work, mapping, keep=KEPT, progress=progress or untold)
    found = [*findings, *log_read.findings]
    found += checks.suspicious_conventions(mechanism, log_read.consecutive, found)
    found += checks.violations(mechanism, log_read.run, log_read.ledger, tolerance)
    found += checks.impacts_not_held(mechanism, log_read.run)
    measured = log_read.run.udot is not None and not _derived(log_read.run, "udot")
    return Known(log_read, tuple(found), measured)


def _judged(
    loaded: Model,
    known: Known,
    step: OneStep | None,
    tolerance: float,
    work: str | None,
    strict: bool,
    deadline: Deadline,
    progress: Progress = untold,
) -> Audit:
    """The audit of a log with the one-step test of its rows."""
    mechanism, import_report = loaded.mechanism, loaded.import_report
    evidence = gather(
        mechanism,
        known,
        step,
        work,
        tolerance,
        import_report,
        deadline=deadline,
        progress=progress,
    )
    log_read = evidence.log
    run, ledger = log_read.run, log_read.ledger
    findings = [*known.findings, *evidence.findings]
    function = _function(ledger)
    energy_error = ledger.uncorrected(function)
    missing = checks.assumed_zero(run, import_report)
    basis = {**ledger.basis, **dict.fromkeys(missing, "assumed zero")}
    basis |= {n: "derived" for n, c in (("u", "u"), ("u̇", "udot")) if _derived(run, c)}
    ledger = replace(ledger, basis=basis)
    findings += checks.assumed_zero_finding(missing)
    findings += checks.unresolved_works(ledger)
    findings += motors.differing_gears(run, ledger, tolerance, import_report)
    works = foreign_channels(mechanism, log_read.consecutive, import_report)
    findings += foreign_notes(works, ledger.energy_exchanged)
    held = held_between_rows(log_read)
    noise = energy_of_noise(mechanism, log_read, work, function, evidence.step)
    measures = Measures(
        energy_exchanged=ledger.energy_exchanged,
        held_energy=_held_energy(ledger),
        scale=float(ledger.kinetic.max() + np.abs(ledger.potential_energy).max())
        + ledger.energy_exchanged,
        kinetic=float(ledger.kinetic.max()),
        left=float(np.abs(energy_error).max()),
        bar=float(ledger.error_bar[function].max()) + held + noise,
        noise=noise,
        held=held,
        tolerance=tolerance,
        spacing=float(np.median(np.diff(log_read.consecutive.t))),
        step=known.log.run.provenance.step,  # of the log, not of how forces were held
        method=ledger.method,
        outside_gaps=_outside_gaps(mechanism, log_read, function),
        bar_growth=_bar_growth(mechanism, log_read.consecutive, function),
    )
    findings += small_but_real(measures, evidence)
    # A motion drifts off its constraints by whatever else is wrong, too.
    ranked = sorted(
        findings,
        key=lambda f: (("cause", "doubt", "note").index(f.weight), f.kind == "constraint-drift"),
    )
    verdict = judge(measures, evidence, tuple(ranked))
    return Audit(
        ledger=ledger,
        verdict=replace(verdict, limits=(*verdict.limits, *motors.limits(run, import_report))),
        run=run,
        mechanism=mechanism,
        import_report=import_report,
        function=function,
        energy_error=energy_error,
        tolerance=tolerance,
        step=evidence.step,
        strict=strict,
    )


def _held_energy(ledger: Ledger) -> float:
    """The energy that the system has at a time, as far as it changes: max K and the range of V, J."""
    return float(ledger.kinetic.max() + np.ptp(ledger.potential_energy))


def _function(ledger: Ledger) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    for name in ("wang", "liu-huston", "kane-levinson-1990"):
        if name in ledger.delta_c:
            return name
    return next(iter(ledger.delta_c))


def _derived(run: Trajectory, what: str) -> bool:
    return what in run.provenance.derived


def _reach(work: Array) -> float:
    return float(np.ptp(work))


def _outside_gaps(
    mechanism: Mechanism, log: Log, function: str
) -> Callable[[], tuple[float, float]] | None:
    """Largest |ΔC| of the parts of a log between its gaps, and its bar; None without gaps."""
    run = log.consecutive
    if log.ledger.method == "in-loop" or not len(gap_rows(run.t)):
        return None

    def outside() -> tuple[float, float]:
        parts = stretches(mechanism, run)
        found = [(float(np.abs(p.uncorrected(function)).max()), p) for p in parts]
        left, worst = max(found, key=lambda item: item[0], default=(0.0, None))
        return left, float(worst.error_bar[function].max()) if worst else 0.0

    return outside


def _bar_growth(mechanism: Mechanism, run: Trajectory, function: str) -> Callable[[], float]:
    """How many times larger the error bar is on every second sample, if it is asked for."""

    def growth() -> float:
        bars = [
            balance(mechanism, rows, "samples", testing=(function,)).error_bar[function].max()
            for rows in (run, run.every(2))
        ]
        return float(bars[1] / bars[0]) if bars[0] > 0.0 else 1.0

    return growth
