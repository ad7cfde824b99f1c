"""What a study found: `Study`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.diagnosis.findings import Finding
from deltac.diagnosis.study.convergence import Convergence, order_text
from deltac.diagnosis.study.curves import Comparison
from deltac.diagnosis.study.measures import StudyMeasures
from deltac.diagnosis.study.residuals import Residuals
from deltac.diagnosis.study.runs import StudyRun
from deltac.diagnosis.verdict import Verdict
from deltac.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class Study:
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
        comparison: the runs at their common times, and the horizon up to which they stay together.
        function: the testing function that the verdict rests on.
        measures: the numbers that the verdict rests on.
        verdict: what it means.
        tolerance: accepted |ΔC| as a fraction of the energy turned over.
    """

    mechanism: Mechanism
    solver: str
    nominal: int | None
    runs: tuple[StudyRun, ...]
    observed_order: Mapping[str, Convergence]
    momentum: Mapping[str, Convergence]
    residuals: Residuals | None
    comparison: Comparison
    function: str
    measures: StudyMeasures
    verdict: Verdict
    tolerance: float

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed, causes first."""
        return self.verdict.findings

    @property
    def horizon(self) -> float:
        """The time (s) up to which motions at successive steps stay together."""
        return self.comparison.horizon

    @property
    def relative(self) -> float:
        """Largest |ΔC| at the finest step, as a fraction of the energy turned over."""
        turnover = self.measures.turnover
        return self.measures.left[-1] / turnover if turnover > 0.0 else 0.0

    @property
    def status(self) -> int:
        """Exit status: 0 consistent, or |ΔC| within the tolerance; 1 not; 3 unresolved."""
        return {"consistent": 0, "unresolved": 3}.get(self.verdict.kind, 1)

    def rows(self) -> tuple[dict[str, Any], ...]:
        """A line for each step: largest |ΔC| of each function (J), difference of the state to the next."""
        state = dict(zip(self.measures.steps, self.observed_order["state"].sizes))
        return tuple(
            {
                "step": entry.step,
                "delta_c": {n: float(np.abs(c).max()) for n, c in (entry.left_over or {}).items()},
                "error_bar": {n: float(b.max()) for n, b in (entry.bar or {}).items()},
                "turnover": entry.ledger.energy_exchanged if entry.ledger else None,
                "state_difference": state.get(entry.step),
                "failure": entry.failure,
            }
            for entry in self.runs
        )

    def to_dict(self) -> dict[str, Any]:
        """All but the time histories, for JSON: what is not finite is None."""
        m = self.measures
        plain: dict[str, Any] = _finite(
            {
                "verdict": self.verdict.kind,
                "confidence": self.verdict.confidence,
                "meaning": self.verdict.meaning,
                "evidence": list(self.verdict.evidence),
                "findings": [vars(finding) for finding in self.findings],
                "limits": list(self.verdict.limits),
                "status": self.status,
                "tolerance": self.tolerance,
                "relative": self.relative,
                "turnover": m.turnover,
                "solver": self.solver,
                "nominal_order": self.nominal,
                "testing_function": self.function,
                "horizon": self.horizon,
                "observed_order": {n: vars(c) for n, c in self.observed_order.items()},
                "momentum": {n: vars(c) for n, c in self.momentum.items()},
                "residuals": None
                if self.residuals is None
                else {
                    "names": list(self.residuals.names),
                    "relative": self.residuals.relative.tolist(),
                    "constraints": dict(self.residuals.constraints),
                    "by_step": list(self.residuals.by_step),
                },
                "runs": list(self.rows()),
            }
        )
        return plain

    def __repr__(self) -> str:
        orders = ", ".join(
            f"{n} {order_text(c)}" for n, c in self.observed_order.items() if c.order is not None
        )
        return (
            f"Study({self.verdict.kind}, confidence {self.verdict.confidence}; {self.solver}, "
            f"{len(self.runs)} steps; orders: {orders or 'none'})"
        )


def _finite(value: Any) -> Any:
    """Nested containers with None for what no JSON can hold."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
