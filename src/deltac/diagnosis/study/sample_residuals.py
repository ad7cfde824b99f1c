"""Whether the equations of motion close at the states of a study's runs: no integration is involved.

A run that went astray still obeys, state by state, the equations that it was made with. So what is left of
F_r + F*_r, and of the constraints on acceleration level, at its own states and accelerations does not depend
on the step, and speaks at steps at which nothing converges.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.measurements.cleaning import are_quotients
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.residuals.at_samples import RunResidual, run_residual, stale_stage
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.study.convergence import FEWEST_TIMES, order_of
from deltac.diagnosis.verdict import LEAST_ORDER, Finding, percent
from deltac.errors import InputError
from deltac.mechanism import CoordinateMap, Mechanism
from deltac.results import Serialisable
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class SampleResiduals(Serialisable, omit=("findings",)):
    """Residuals of Kane's equations at the states of the runs.

    Attributes:
        names: of the coordinates that the equations belong to: the user's own, where given.
        relative: of the finest run, root mean square of each residual as a share of its terms (n,).
        constraints: likewise what accelerations leave of each constraint, ψ̇ = G u̇ + γ.
        by_step: the largest of both that is no rounding, for each run, coarsest first; 0 where all close.
        order: at which that falls with the step; 0 where it stays, NaN where the runs part too early to tell.
        findings: what else they betray: forces one row old, degrees.
    """

    names: tuple[str, ...]
    relative: Array
    constraints: Mapping[str, float]
    by_step: tuple[float, ...]
    order: float
    findings: tuple[Finding, ...] = ()

    @property
    def closes(self) -> bool:
        """Whether the equations close at the finest step."""
        return self.by_step[-1] == 0.0

    @property
    def stays(self) -> bool:
        """Whether they do not close, at any step."""
        return not self.closes and self.order < LEAST_ORDER

    @property
    def blamed(self) -> tuple[int, ...]:
        """Places of the equations that do not close, worst first."""
        return tuple(int(k) for k in np.argsort(-self.relative) if self.relative[k] > 0.0)

    def finding(self) -> Finding:
        """Which equations to look at."""
        if not self.blamed:
            return self._across_constraints()
        shown = ", ".join(f"{self.names[k]} {percent(self.relative[k])}" for k in self.blamed[:4])
        first = self.names[self.blamed[0]]
        return Finding(
            "coordinate-residual",
            f"the equation of motion of {first!r} does not hold at the run's own states and accelerations"
            if len(self.blamed) == 1
            else f"{len(self.blamed)} of {len(self.names)} equations of motion do not hold at the run's "
            f"own states and accelerations",
            f"F_r + F*_r, as a share of its terms: {shown}; the same at every step",
            f"Look for the error in the equation of {first!r}: a sign, a factor, a term, a force",
            "cause",
            first,
        )

    def _across_constraints(self) -> Finding:
        name, share = max(self.constraints.items(), key=lambda item: item[1])
        return Finding(
            "constraint-acceleration",
            f"the accelerations violate constraint {name!r}, though the states do",
            f"G u̇ + γ leaves {percent(share)} of its terms; the same at every step",
            "Look for an error in the constraint's force, or in what was eliminated with it: the "
            "projection after each step hides it from the energy",
            "cause",
            name,
        )


def residuals_of(
    mechanism: Mechanism,
    runs: Sequence[tuple[float, Trajectory]],
    own: CoordinateMap | None = None,
    *,
    until: float,
    trusted: bool,
) -> SampleResiduals | None:
    """Residuals of runs (step, run), coarsest first; None where no accelerations were measured.

    `own` are coordinates to express them in; `until` is when the runs part. `trusted`: the runs are our own
    solvers', and their u̇ is what the equations gave.
    """
    measured = [(h, r) for h, r in runs if _measured(r, trusted=trusted)]
    if not measured or not len(mechanism.free.u):
        return None
    finest, kane = measured[-1][1], Kane(mechanism)
    of_finest = run_residual(kane, finest)
    blamed = _in_own(mechanism, finest, of_finest, own)
    worst = [of_finest.largest]
    findings: list[Finding] = []
    if worst[0] > 0.0:
        coarser = [run_residual(kane, run).largest for _, run in measured[:-1]]
        worst = [*coarser, worst[0]]
        if not trusted:
            from deltac.diagnosis.audit import conventions

            findings += stale_stage(of_finest)
            if not findings and of_finest.relative.any():
                findings = conventions.units(of_finest)
    else:
        worst = [0.0] * len(measured)
    order = 0.0
    if len(measured) > 1 and not trusted and min(worst) > 0.0:
        order = _falling(kane, measured[-2:], until)
    constraints = of_finest.constraints
    names, relative = blamed.test.speeds, blamed.relative
    return SampleResiduals(names, relative, constraints, tuple(worst), order, tuple(findings))


def _falling(kane: Kane, runs: Sequence[tuple[float, Trajectory]], until: float) -> float:
    """Order at which residuals fall while two runs are in the same states; NaN where that is no time.

    Those of other states are larger or smaller for that reason alone.
    """
    parts = [(h, run.between(run.t[0], max(until, run.t[0]))) for h, run in runs]
    if min(len(part) for _, part in parts) < FEWEST_TIMES:
        return math.nan
    (h0, coarse), (h1, fine) = ((h, run_residual(kane, part).largest) for h, part in parts)
    if not (coarse > 0.0 and fine > 0.0):
        return math.nan
    return order_of((h0, h1), coarse, fine)


def _measured(run: Trajectory, *, trusted: bool) -> bool:
    """Whether a run's u̇ were not made from its u afterwards.

    Those of an engine that steps so (semi-implicit Euler: u₊ = u + h u̇) are measured all the same.
    """
    if run.udot is None or len(run) < 4:
        return False
    if trusted:
        return True
    if "udot" in run.provenance.derived:
        return False
    stepped = run.provenance.step is not None and run.provenance.simulator.startswith("MuJoCo")
    half = digits_of(run)["udot"].half()
    return stepped or not (run.udot.any() and any(are_quotients(run.t, run.u, run.udot, half)))


def _in_own(
    mechanism: Mechanism, run: Trajectory, residual: RunResidual, own: CoordinateMap | None
) -> RunResidual:
    """The residual in the user's coordinates; in the mechanism's for a map without inverse."""
    if own is None or not residual.relative.any():
        return residual
    with suppress(InputError):
        return run_residual(Kane(mechanism, own), run)
    return residual
