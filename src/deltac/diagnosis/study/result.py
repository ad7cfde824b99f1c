"""What a study found: `Study`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import max_norm
from deltac.diagnosis.inputs.channels import import_remarks
from deltac.diagnosis.study.convergence import Convergence, order_text
from deltac.diagnosis.study.curves import ComparedRuns
from deltac.diagnosis.study.runs import BalancedRun, StudyRun
from deltac.diagnosis.study.sample_residuals import SampleResiduals
from deltac.diagnosis.verdict import Judged, Verdict
from deltac.energy import Ledger
from deltac.mechanism import Mechanism
from deltac.results import Section, Table, number, percent

if TYPE_CHECKING:
    from deltac.diagnosis.explain.result import Explanation
    from deltac.importers.report import ImportReport


@dataclass(frozen=True, eq=False, repr=False)
class Study(
    Judged,
    omit=("mechanism", "runs", "comparison", "trusted", "unit", "import_report"),
    also=("relative", "energy_exchanged", "reference_energy", "horizon", "rows", "imported"),
):
    """What a study of a motion at several steps found.

    Attributes:
        mechanism: the model that the runs were tested against.
        solver: what made the runs.
        nominal: its order, if known.
        runs: one entry for each step, coarsest first, failures included.
        observed_order: how each testing function's ΔC converges, by name, and the motion under "state";
            `str()` of an entry is "order 5.0 ± 0.1".
        momentum: how the departure of each momentum balance converges.
        residuals: of the equations of motion at the runs' own states; None without accelerations.
        comparison: the runs of one motion at their common times, and the horizon up to which they stay
            together.
        function: the testing function that the verdict rests on.
        verdict: what it means.
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).
        trusted: the motion was made with the model's own dynamics, which are those of the test.
        unit: of what was varied: "s", or "" for tolerances.
        import_report: what the model's file held that the model does not, None for other models.
    """

    mechanism: Mechanism
    solver: str
    nominal: int | None
    runs: tuple[StudyRun, ...]
    observed_order: Mapping[str, Convergence]
    momentum: Mapping[str, Convergence]
    residuals: SampleResiduals | None
    comparison: ComparedRuns
    function: str
    verdict: Verdict
    tolerance: float
    trusted: bool
    unit: str
    import_report: ImportReport | None = None

    # --- the runs of one motion ----------------------------------------------------------------

    @property
    def steps(self) -> tuple[float, ...]:
        """The step (s) of each run that was compared, or its tolerance."""
        return tuple(entry.step for entry in self.comparison.runs)

    @property
    def errors(self) -> tuple[float, ...]:
        """Largest |ΔC| of each of them, corrections included, J."""
        curves = (entry.energy_error[self.function] for entry in self.comparison.runs)
        return tuple(max_norm(curve) for curve in curves)

    @property
    def bars(self) -> tuple[float, ...]:
        """What else than the motion explains of it, J."""
        return tuple(float(entry.bar[self.function].max()) for entry in self.comparison.runs)

    @property
    def ledger(self) -> Ledger:
        """Where the energy of the finest run went."""
        return self.comparison.runs[-1].ledger

    @property
    def blown_up(self) -> bool:
        """Whether the finest run became unstable."""
        return self.comparison.runs[-1].blown_up

    @property
    def horizon(self) -> float:
        """The time (s) up to which motions at successive steps stay together."""
        return self.comparison.horizon

    @property
    def until(self) -> float | None:
        """The time (s) up to which `energy` was judged, where motions part before the end; else None."""
        whole = self.comparison.apart or self.horizon >= self.comparison.t[-1]
        return None if whole else self.horizon

    # --- what the verdict rests on -------------------------------------------------------------

    @property
    def energy(self) -> Convergence:
        """How ΔC of the testing function converges."""
        return self.observed_order[self.function]

    @property
    def state(self) -> Convergence:
        """How the motion converges."""
        return self.observed_order["state"]

    @property
    def energy_exchanged(self) -> float:
        """The energy exchanged at the finest step, J."""
        return self.ledger.energy_exchanged

    @property
    def reference_energy(self) -> float:
        """The energy that the error is compared with, J: largest K plus range of V, at the finest step."""
        return self.ledger.reference_energy

    @property
    def allowed(self) -> float:
        """The energy error that is accepted, J."""
        return self.tolerance * self.reference_energy

    @property
    def relative(self) -> float:
        """Largest |ΔC| at the finest step, as a fraction of `reference_energy`."""
        return self.errors[-1] / (self.reference_energy or np.inf)

    @property
    def equations_right(self) -> bool:
        """Whether the equations are known to be those of the model, whatever the integration did."""
        return self.trusted or (self.residuals is not None and self.residuals.closes)

    @property
    def resolved(self) -> bool:
        """Whether three runs or more are of one motion: differences of successive ones fall."""
        unsettled = len(self.state.sizes) > 1 and self.state.trend == "does not settle"
        return len(self.steps) > 2 and not unsettled

    def has(self, *kinds: str) -> bool:
        """Whether one of these was found."""
        return any(f.kind in kinds for f in self.findings)

    # --- in words ------------------------------------------------------------------------------

    @property
    def knob(self) -> str:
        """What was varied from run to run: "step" or "tolerance"."""
        return "step" if self.unit else "tolerance"

    @property
    def imported(self) -> dict[str, tuple[str, ...]]:
        """What the import of the model left out, and what it assumed."""
        return import_remarks(self.import_report)

    def explanation(self) -> Explanation:
        """What is wrong with the equations of the runs: the causes that all steps share, with their odds.

        Each step has an integrator's error of its own, and the same mistake; their Gram matrices are added.
        It takes about as long as an audit of each run. Raises InputError for runs of too few rows.
        """
        # Here, since a study alone must not load SciPy.
        from deltac.diagnosis.audit.audit import explain_residual

        return explain_residual(
            self.mechanism, [entry.run for entry in self.runs if isinstance(entry, BalancedRun)]
        )

    def rows(self) -> tuple[dict[str, Any], ...]:
        """A line for each step: largest |ΔC| of each function (J), difference of the state to the next."""
        state = dict(zip(self.steps, self.state.sizes))
        return tuple(
            {
                "step": entry.step,
                "delta_c": {n: max_norm(c) for n, c in entry.energy_error.items()},
                "error_bar": {n: float(b.max()) for n, b in entry.bar.items()},
                "energy_exchanged": entry.ledger.energy_exchanged if entry.ledger else None,
                "state_difference": state.get(entry.step),
                "failure": entry.failure,
            }
            for entry in self.runs
        )

    def summary(self) -> str:
        """Verdict, and the energy error at the finest step beside the tolerance."""
        runs = f"{len(self.runs)} {self.knob}s"
        sign = ">" if self.relative > self.tolerance else "≤"
        order = "" if self.state.order is None else f", order {order_text(self.state)}"
        return (
            f"{self.verdict.kind}: |ΔC| {percent(self.relative)} {sign} {percent(self.tolerance)} of the "
            f"{self.reference_energy:.4g} J that the system has, at the finest of {runs} of "
            f"{self.solver}{order}{self.verdict.certainty}"
        )

    def sections(self) -> Iterator[Section]:
        """|ΔC| and the motion at each step, then the verdict."""
        names = [n for n in self.observed_order if n != "state"]
        knob = "step (s)" if self.unit else "tolerance"
        rows: list[tuple[str, ...]] = []
        for row in self.rows():
            sizes = (
                number(row["delta_c"][n], digits=3) if n in row["delta_c"] else "" for n in names
            )
            difference = row["state_difference"]
            state = "no run" if row["failure"] else ""
            state = state if difference is None else number(difference, digits=3)
            rows.append((number(row["step"]), *sizes, state))
        orders = (str(self.observed_order[n]) for n in (*names, "state"))
        heads = (knob, *(f"|ΔC| {name} (J)" for name in names), "state, to the next")
        yield Table(heads, (*rows, (), ("", *orders)))
        yield from self.verdict.sections()
        if self.import_report is not None:
            yield from self.import_report.sections()
