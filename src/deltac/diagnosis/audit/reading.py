"""A log as it is read: its rows and ledger, and what its columns say before the equations are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from deltac.calls.progress import Progress, untold
from deltac.diagnosis.audit import checks
from deltac.diagnosis.inputs.logs import Log, read_log
from deltac.diagnosis.measurements.kinematics import trusted
from deltac.diagnosis.verdict import Finding
from deltac.energy.streaming import KEPT
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories.trajectory import INTERPOLATED, ROWS

if TYPE_CHECKING:
    from deltac.importers import ImportReport


@dataclass(frozen=True, eq=False)
class Reference:
    """What a log is judged against, and how.

    Attributes:
        mechanism: the model.
        import_report: what its file held that the model does not, None for other models.
        tolerance: accepted |ΔC| as a fraction of the energy that the system has.
        work: how works are taken, as for `balance`; None: as the log's engine took them.
    """

    mechanism: Mechanism
    import_report: ImportReport | None
    tolerance: float
    work: str | None


@dataclass(frozen=True, eq=False)
class Known:
    """A log and what its columns say before the equations are looked at.

    log       the log with its ledger
    findings  of kinematics, conventions, violations
    """

    log: Log
    findings: tuple[Finding, ...]

    @property
    def doubted(self) -> bool:
        """Whether the log contradicts itself."""
        return any(f.weight == "doubt" for f in self.findings)

    @property
    def measured(self) -> bool:
        """Whether it has accelerations of its own."""
        run = self.log.run
        return run.udot is not None and "udot" not in run.provenance.derived

    @property
    def given(self) -> bool:
        """Whether its accelerations are known to be those of the rows."""
        return self.measured and trusted(self.log.run)

    @property
    def between(self) -> bool:
        """Whether its rows lie between the solver's steps."""
        return self.log.run.provenance.notes.get(ROWS) == INTERPOLATED


def read(
    reference: Reference,
    source: Any,
    mapping: Any = None,
    findings: Sequence[Finding] = (),
    progress: Progress = untold,
) -> Known:
    """Read and balance a log, and check its columns; `findings` are known already."""
    mechanism = reference.mechanism
    log = read_log(mechanism, source, reference.work, mapping, keep=KEPT, progress=progress)
    found = checks.with_conventions(mechanism, log.consecutive, [*findings, *log.findings])
    found += checks.violations(mechanism, log.run, log.ledger, reference.tolerance)
    found += checks.impacts_not_held(mechanism, log.run)
    return Known(log, tuple(found))
