"""The numbers that the verdict of a study rests on."""

from __future__ import annotations

from dataclasses import dataclass, field

from deltac.diagnosis.findings import Finding
from deltac.diagnosis.study.convergence import Convergence
from deltac.diagnosis.study.residuals import Residuals


@dataclass(frozen=True)
class StudyMeasures:
    """Numbers (J) that the verdict of a study rests on.

    steps      of the runs compared, coarsest first; `unit` is "s", or "" for tolerances
    left       largest |ΔC| of each, corrections included; bars: what else than the motion explains of it
    turnover   of the finest; scale: that and the energies themselves; kinetic: the largest K
    energy     how ΔC converges; state: how the motion does; momentum: of each momentum balance
    residuals  of the equations of motion at the runs' own states, if they have accelerations
    trusted    the motion was made with the model's own dynamics, which are those of the test
    nominal    order of the solver, if known
    tolerance  accepted share of the turnover
    quadrature the error bar comes of samples, and not of rounding alone
    constrained  the model has constraints; blown_up: the finest run became unstable
    until      the time (s) up to which `energy` was judged, where motions part before the end; else None
    """

    steps: tuple[float, ...]
    left: tuple[float, ...]
    bars: tuple[float, ...]
    turnover: float
    scale: float
    kinetic: float
    energy: Convergence
    state: Convergence
    momentum: dict[str, Convergence]
    residuals: Residuals | None
    trusted: bool
    nominal: int | None
    tolerance: float
    quadrature: bool
    unit: str = "s"
    constrained: bool = False
    blown_up: bool = False
    until: float | None = None
    findings: tuple[Finding, ...] = field(default=())

    @property
    def allowed(self) -> float:
        """The energy error that is accepted, J."""
        return self.tolerance * self.turnover

    @property
    def below_rounding(self) -> bool:
        """Whether so little energy is turned over that the tolerance asks for less than rounding."""
        return self.bars[-1] > self.allowed and not self.quadrature

    @property
    def equations_right(self) -> bool:
        """Whether the equations are known to be those of the model, whatever the integration did."""
        return self.trusted or (self.residuals is not None and self.residuals.closes)

    @property
    def resolved(self) -> bool:
        """Whether three runs or more are of one motion: differences of successive ones fall."""
        seen = len(self.state.sizes) > 1 and self.state.trend == "does not settle"
        return len(self.steps) > 2 and not seen

    def has(self, *kinds: str) -> bool:
        """Whether one of these was found."""
        return any(f.kind in kinds for f in self.findings)
