"""`audit`: a log of whatever simulator against a model: where the energy went, and what is wrong."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.audit import checks
from deltac.diagnosis.audit.checks import withheld_equalities
from deltac.diagnosis.audit.rules import Measures, judge
from deltac.diagnosis.inputs import channels as motors
from deltac.diagnosis.inputs.channels import foreign_channels, foreign_notes
from deltac.diagnosis.inputs.logs import Log, held_between_rows, read_log, stretches
from deltac.diagnosis.inputs.models import load_model
from deltac.diagnosis.residuals.at_samples import EquationTerms, equation_terms
from deltac.diagnosis.verdict import Finding, Verdict, percent
from deltac.energy import Ledger, balance
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.lint import gap_rows

if TYPE_CHECKING:
    from deltac.importers import ImportReport


TOLERANCE = 1e-3
"""Energy error that is accepted by default, as a fraction of the energy turned over."""

EXACT = 1.0 - 1e-6
"""Share of the squared residual that an explanation must reach where the residual comes and goes."""


@dataclass(frozen=True)
class Row:
    """A line of the audit's table: energy (J) at the end of the run, its share of the turnover, origin.

    `energy` is a work for channels, a change for energies; positive into the system.
    """

    name: str
    energy: float
    share: float
    basis: str


@dataclass(frozen=True, eq=False)
class Audit:
    """What an audit found.

    Attributes:
        ledger: where the energy went; `ledger.basis` says "measured", "computed", "assumed zero" or
            "derived" of every term.
        verdict: what it means.
        run: the log that was judged, its columns in the model's order; of a log read in parts, some rows.
        mechanism: the model it was judged against.
        import_report: what the model's file held that the model does not, None for other models.
        function: the testing function that the verdict rests on.
        left_over: ΔC with the work of corrections that the simulator applied (T,), J.
        tolerance: accepted |left_over| as a fraction of the energy turned over.
    """

    ledger: Ledger
    verdict: Verdict
    run: Trajectory
    mechanism: Mechanism
    import_report: ImportReport | None
    function: str
    left_over: Array
    tolerance: float

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed, causes first."""
        return self.verdict.findings

    @property
    def relative(self) -> float:
        """Largest |left_over| as a fraction of the energy turned over."""
        largest = float(np.abs(self.left_over).max())
        return largest / self.ledger.turnover if self.ledger.turnover > 0.0 else 0.0

    @property
    def status(self) -> int:
        """Exit status: 0 the balance holds within the tolerance, 1 it does not, 3 unresolved.

        A mistake in the model that stays within the tolerance is named by the verdict and is status 0,
        unless a channel of the model moved more energy than that otherwise than in the log, or one is
        missing.
        """
        if self.verdict.kind == "unresolved":
            return 3
        differs = any(f.weight == "cause" and f.kind in _BEYOND_TOLERANCE for f in self.findings)
        small = self.ledger.turnover > 0.0 and self.relative <= self.tolerance
        kept = self.verdict.kind == "consistent" or small
        return 0 if kept and not differs else 1

    def rows(self) -> tuple[Row, ...]:
        """The table: works of channels, largest first, then K, V, what flowed in, and what is left."""
        ledger = self.ledger
        unit = ledger.turnover if ledger.turnover > 0.0 else 1.0

        def row(name: str, energy: float, basis: str) -> Row:
            return Row(name, energy, energy / unit, basis)

        channels = sorted(ledger.work.items(), key=lambda item: -_reach(item[1]))
        rows = [row(n, float(w[-1] - w[0]), ledger.basis.get(n, "computed")) for n, w in channels]
        rows += [row(n, 0.0, b) for n, b in ledger.basis.items() if b == "assumed zero"]
        K, V = ledger.kinetic, ledger.potential_energy
        delta_c = ledger.delta_c[self.function]
        change = float(K[-1] - K[0] + V[-1] - V[0])
        rows += [
            row("ΔK", float(K[-1] - K[0]), "computed"),
            row("ΔV", float(V[-1] - V[0]), "computed"),
            row("Q", change - float(delta_c[-1]), "the works, without those of V"),
            row("ΔC = ΔK + ΔV − Q", float(delta_c[-1]), self._bar()),
        ]
        if not np.array_equal(self.left_over, delta_c):
            rows.append(row("ΔC with corrections", float(self.left_over[-1]), self._bar()))
        return tuple(rows)

    def table(self) -> str:
        """The table as text."""
        rows = self.rows()
        width = max(len(row.name) for row in rows)
        lines = [f"{'':{width}}  {'work (J)':>12}  {'share':>8}  basis"]
        lines += [
            f"{row.name:{width}}  {row.energy:12.5g}  {100 * row.share:7.3g}%  {row.basis}"
            for row in rows
        ]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """All but the time histories, for JSON: what is not finite is None."""
        ledger = self.ledger
        held = {
            "verdict": self.verdict.kind,
            "confidence": self.verdict.confidence,
            "evidence": list(self.verdict.evidence),
            "findings": [vars(finding) for finding in self.findings],
            "limits": list(self.verdict.limits),
            "status": self.status,
            "tolerance": self.tolerance,
            "relative": self.relative,
            "turnover": ledger.turnover,
            "method": ledger.method,
            "testing_function": self.function,
            "delta_c": {n: float(np.abs(x).max()) for n, x in ledger.delta_c.items()},
            "error_bar": {n: float(x.max()) for n, x in ledger.error_bar.items()},
            "table": [vars(row) for row in self.rows()],
            "samples": len(self.run),
            "ignored_by_import": [str(r) for r in self.import_report.ignored]
            if self.import_report
            else [],
            "assumed_by_import": [str(r) for r in self.import_report.assumed]
            if self.import_report
            else [],
        }
        plain: dict[str, Any] = _finite(held)
        return plain

    def _bar(self) -> str:
        return f"± {float(self.ledger.error_bar[self.function].max()):.2g} J"

    def __repr__(self) -> str:
        return (
            f"Audit({self.verdict.kind}, confidence {self.verdict.confidence}; max |ΔC| "
            f"{percent(self.relative)} of {self.ledger.turnover:.4g} J turned over; "
            f"{len(self.findings)} findings)"
        )


_BEYOND_TOLERANCE = (
    "channel-differs",
    "channel-not-in-model",
    "prescribed-departs",
    "missing-contact",
    "missing-equality",
    "constraint-violation",
    "constraint-drift",
)


def audit(
    model: Any,
    log: Any,
    *,
    tolerance: float = TOLERANCE,
    work: str | None = None,
    mapping: Any = None,
) -> Audit:
    """Judge a log against a model.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        log: a Trajectory, or the path of a log.
        tolerance: accepted |ΔC| as a fraction of the energy turned over.
        work: as for `balance`: "in-loop", "samples" or "discrete"; by default in the loop where the run
            has that, discrete where it holds every step of an engine that holds its forces over a step.
        mapping: path of a mapping file, for logs whose columns have other names or units.

    Returns:
        The audit: ledger, verdict, findings.

    Raises:
        InputError: model or log cannot be read, or the log is not of this model.
    """
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance is {tolerance!r}; expected a number between 0 and 1")
    loaded = load_model(model)
    mechanism = loaded.mechanism
    log_read = read_log(mechanism, log, work, mapping)
    run, ledger, findings = log_read.run, log_read.ledger, list(log_read.findings)
    function = _function(ledger)
    left_over = ledger.uncorrected(function)
    missing = checks.assumed_zero(run, loaded.import_report)
    basis = {**ledger.basis, **dict.fromkeys(missing, "assumed zero")}
    if _derived(run, "u"):
        basis["u"] = "derived"
    if _derived(run, "udot"):
        basis["u̇"] = "derived"
    ledger = replace(ledger, basis=basis)
    findings += checks.suspicious_conventions(mechanism, log_read.consecutive)
    findings += checks.violations(mechanism, run, ledger, tolerance)
    findings += checks.assumed_zero_finding(missing)
    findings += checks.impacts_not_held(mechanism, run)
    findings += motors.differing_gears(run, ledger, tolerance, loaded.import_report)
    works = foreign_channels(mechanism, log_read.consecutive, loaded.import_report)
    findings += foreign_notes(works, ledger.turnover)
    terms = None
    if basis["u̇"] == "measured" and len(mechanism.free.u):
        terms = equation_terms(mechanism, run)
        findings += _of_equations(
            mechanism, log_read, terms, tolerance, loaded.import_report, findings
        )
    held = held_between_rows(log_read)
    measures = Measures(
        turnover=ledger.turnover,
        scale=float(ledger.kinetic.max() + np.abs(ledger.potential_energy).max()) + ledger.turnover,
        kinetic=float(ledger.kinetic.max()),
        left=float(np.abs(left_over).max()),
        bar=float(ledger.error_bar[function].max()) + held,
        held=held,
        tolerance=tolerance,
        spacing=float(np.median(np.diff(log_read.consecutive.t))),
        step=run.provenance.step,
        method=ledger.method,
        outside_gaps=_outside_gaps(mechanism, log_read, function),
        bar_growth=_bar_growth(mechanism, log_read.consecutive, function),
    )
    ranked = sorted(findings, key=lambda f: ("cause", "doubt", "note").index(f.weight))
    verdict = judge(measures, terms, tuple(ranked))
    return Audit(
        ledger=ledger,
        verdict=replace(
            verdict, limits=(*verdict.limits, *motors.limits(run, loaded.import_report))
        ),
        run=run,
        mechanism=mechanism,
        import_report=loaded.import_report,
        function=function,
        left_over=left_over,
        tolerance=tolerance,
    )


def _of_equations(
    mechanism: Mechanism,
    log: Log,
    terms: EquationTerms,
    tolerance: float,
    import_report: ImportReport | None,
    known: list[Finding],
) -> list[Finding]:
    """Findings of the equations of motion at the samples; a stale or misread log explains nothing."""
    if any(f.weight == "doubt" for f in known):
        return checks.blame(terms)
    whole = log.consecutive is log.run
    nearby = terms if whole else equation_terms(mechanism, log.consecutive)
    stale = checks.stale_stage(mechanism, log.consecutive, nearby)
    misread = stale or checks.all_in_degrees(mechanism, log.consecutive, nearby)
    if misread:
        return misread + checks.blame(terms)
    found = checks.differing_channels(terms, log.ledger, tolerance, import_report)
    now_and_then = checks.intermittent(terms, log.run, tolerance)
    simple: list[Finding] = []
    if terms.significant.any():
        simple = _explained(mechanism, log.consecutive, now_and_then=bool(now_and_then))
    certain, possible = withheld_equalities(mechanism, log.run, terms, import_report)
    return found + (certain or simple or now_and_then or possible) + checks.blame(terms)


def _explained(mechanism: Mechanism, run: Trajectory, *, now_and_then: bool) -> list[Finding]:
    """The few causes that explain the residual of consecutive samples; none where these are too few.

    What is silent for a while can be fitted roughly by many things: then only an exact fit counts.
    """
    from deltac.diagnosis.explain.explain import EXPLAINS, explanation
    from deltac.diagnosis.explain.regression import LEAST_ROWS
    from deltac.diagnosis.explain.search import MOST

    if len(run) >= LEAST_ROWS:
        least, most = (EXACT, 1) if now_and_then else (EXPLAINS, MOST)
        with contextlib.suppress(InputError):  # gaps leave too few rows in a row
            return explanation(mechanism, run, "samples", least, most=most).findings()
    return []


def _function(ledger: Ledger) -> str:
    """Wang's testing function where it is there: exact for all systems, and it sees energy made of V."""
    for name in ("wang", "liu-huston", "kane-levinson-1990"):
        if name in ledger.delta_c:
            return name
    return next(iter(ledger.delta_c))


def _finite(value: Any) -> Any:
    """Nested lists and dicts with None for what no JSON can hold."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _derived(run: Trajectory, what: str) -> bool:
    return what in run.provenance.notes.get("derived", "").split(";")


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
