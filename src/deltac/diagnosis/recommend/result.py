"""`Recommendation`: a recommended solver and step, and what it rests on, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from deltac.diagnosis.inputs.channels import import_remarks
from deltac.diagnosis.recommend.work_precision import SAME_TIME, Trial
from deltac.results import Report, Section, Table, number, percent

if TYPE_CHECKING:
    from deltac.importers.report import ImportReport

RECOMMENDATION_LIMITS = (
    "errors of the model: the recommendation concerns the integration only",
    "other motions: a different start or drive may need a smaller step",
    "other machines: the times were measured on this one, though their ratios vary little",
)


@dataclass(frozen=True)
class Prospect:
    """What the trials of a solver let expect of one of its settings.

    Attributes:
        solver: its name; `knob` is "step" (s) or "tolerance", `setting` its value.
        seconds: of a run; `evaluations`: of ẋ, 0 where they are not known beforehand.
    """

    solver: str
    knob: str
    setting: float
    seconds: float
    evaluations: int


@dataclass(frozen=True, repr=False)
class Recommendation(
    Report,
    omit=("import_report",),
    also=("solver", "step", "setting_tolerance", "verified", "imported"),
):
    """A recommended solver and its step or tolerance, with what it rests on.

    Attributes:
        solver, step: what to use; `step` is None for a solver that takes a `setting` as its tolerance.
        best: the verified trial of the advice, None if nothing tried keeps the tolerance.
        coarser: the trial of the next coarser setting of that solver, which fails; None for the coarsest.
        prospects: the setting at which each solver is expected to keep the tolerance, the best first, the
            others by their time.
        trials: all that was tried.
        tolerance, motion_tolerance: what was asked for; duration: how long the motion was, s.
        reference_energy: the energy that the system has, J; `still`: none, so that nothing moves.
        notes: why some solvers were left out.
        import_report: what the model's file held that the model does not, None for other models.
    """

    best: Trial | None
    coarser: Trial | None
    prospects: tuple[Prospect, ...]
    trials: tuple[Trial, ...]
    tolerance: float
    motion_tolerance: float
    duration: float
    reference_energy: float
    still: bool = False
    notes: tuple[str, ...] = ()
    limits: tuple[str, ...] = RECOMMENDATION_LIMITS
    import_report: ImportReport | None = None

    @property
    def imported(self) -> dict[str, tuple[str, ...]]:
        """What the import of the model left out, and what it assumed."""
        return import_remarks(self.import_report)

    @property
    def solver(self) -> str | None:
        """The recommended solver."""
        return None if self.best is None else self.best.solver

    @property
    def step(self) -> float | None:
        """The recommended step, s; None for an adaptive solver."""
        return self.best.setting if self.best and self.best.knob == "step" else None

    @property
    def setting_tolerance(self) -> float | None:
        """The recommended relative tolerance of an adaptive solver, else None."""
        return self.best.setting if self.best and self.best.knob == "tolerance" else None

    @property
    def runner_up(self) -> Prospect | None:
        """The solver that is expected to be the next best, at its own best setting."""
        return self.prospects[1] if len(self.prospects) > 1 else None

    @property
    def verified(self) -> bool:
        """Whether the run was found to keep the tolerances at all of its rows."""
        return (
            self.best is not None
            and self.best.verified
            and self.best.passes(self.tolerance, self.motion_tolerance)
        )

    @property
    def exit_code(self) -> int:
        """Exit code: 0 verified, 1 nothing that was tried keeps the tolerance, 3 nothing moves."""
        return 3 if self.still else 0 if self.verified else 1

    def summary(self) -> str:
        """What to use, or that nothing keeps the tolerance."""
        if self.still:
            return "unresolved: hardly anything moves"
        if self.best is None:
            return f"nothing that was tried keeps a tolerance of {self.tolerance:g}"
        return f"{self.best.solver} with {setting_of(self.best)}" + (
            "" if self.verified else ", not verified"
        )

    def sections(self) -> Iterator[Section]:
        """All trials, what is expected of every solver; what to use and why, and what is not covered."""
        yield Table(
            ("solver", "step or tolerance", "|ΔC|", "motion", "time (ms)", "evaluations", ""),
            tuple(_rows(self)),
        )
        if self.prospects:
            heads = ("solver", "should keep it with", "time (ms)", "evaluations")
            yield Table(heads, tuple(map(_prospect, self.prospects)))
        yield from _explained(self)
        yield from (f"Note: {note}." for note in self.notes)
        yield f"Not covered: {'; '.join(self.limits)}."
        if self.import_report is not None:
            yield from self.import_report.sections()


def _rows(advice: Recommendation) -> Iterator[tuple[str, ...]]:
    """The trials by solver, coarse to fine."""
    asked = (advice.tolerance, advice.motion_tolerance)
    last = ""
    for trial in sorted(advice.trials, key=lambda t: (t.solver, -t.setting)):
        if last and trial.solver != last:
            yield ()
        status = "within" if trial.passes(*asked) else "breaks down" if trial.message else ""
        yield (
            trial.solver if trial.solver != last else "",
            number(trial.setting, "s" if trial.knob == "step" else ""),
            f"{trial.energy:.1e}" if math.isfinite(trial.energy) else "",
            f"{trial.motion:.1e}" if math.isfinite(trial.motion) else "",
            number(1e3 * trial.seconds, digits=3) if math.isfinite(trial.seconds) else "",
            str(trial.evaluations or ""),
            "recommended" if trial is advice.best else status,
        )
        last = trial.solver


def _prospect(prospect: Prospect) -> tuple[str, ...]:
    time = number(1e3 * prospect.seconds, digits=2)
    return prospect.solver, setting_of(prospect), time, str(prospect.evaluations or "")


def _explained(advice: Recommendation) -> list[str]:
    best, asked = advice.best, (advice.tolerance, advice.motion_tolerance)
    if advice.still:
        return [
            f"Unresolved: the system has {advice.reference_energy:.2g} J in {advice.duration:g} s, which "
            f"is at rounding level. "
            "Almost nothing moves, so any solver and step would do. Give a start, a drive or a duration "
            "in which energy flows."
        ]
    if best is None:
        finite = [t for t in advice.trials if math.isfinite(t.energy)]
        line = f"Nothing that was tried keeps a tolerance of {advice.tolerance:g}"
        if finite:
            nearest = min(finite, key=lambda t: t.excess(*asked))
            line += f"; {nearest.solver} at {setting_of(nearest)}, which "
            line += failing(nearest, *asked)
        return [
            line
            + ". Ask for less accuracy, or for a shorter motion (a chaotic one loses all accuracy)."
        ]
    lines = [
        f"Use {best.solver} with {best.knob} {_value(best)}: |ΔC| stays within {_share(best.energy)} of the "
        f"{advice.reference_energy:.4g} J that the system has, in {advice.duration:g} s"
        + (
            ""
            if math.isinf(asked[1])
            else f", q and u within {_share(best.motion)} of their ranges{_everywhere(best)}"
        )
        + f" (asked for: {advice.tolerance:g}). It takes {_seconds(best.seconds)}"
        + (f", {best.evaluations} evaluations of the accelerations." if best.evaluations else ".")
    ]
    if advice.coarser is not None:
        lines.append(
            f"- The next coarser {best.knob}, {_value(advice.coarser)}, {failing(advice.coarser, *asked)}."
        )
    if (second := advice.runner_up) is not None:
        line = (
            f"- Runner-up, not run to the end: {second.solver} with {setting_of(second)}, which is "
            f"expected to take {_longer(second.seconds / best.seconds)}"
        )
        if second.evaluations and best.evaluations:
            line += f" ({second.evaluations} evaluations against {best.evaluations})"
        lines.append(line + ".")
    return lines


def _everywhere(best: Trial) -> str:
    if not best.verified:
        return ""
    return " at every step" if best.knob == "step" else ", the first instants included"


def _longer(ratio: float) -> str:
    return f"{ratio:.2g} times as long" if ratio > SAME_TIME else "as long"


def failing(trial: Trial, tolerance: float, motion: float) -> str:
    """In words, what a trial misses."""
    if trial.message:
        return f"breaks down ({trial.message})"
    if trial.energy > tolerance:
        return f"leaves |ΔC| at {_share(trial.energy)} of that energy"
    return f"leaves q and u {_share(trial.motion)} of their ranges from the converged motion"


def setting_of(trial: Trial | Prospect) -> str:
    """How a setting is named: "step 0.001 s"."""
    return f"{trial.knob} {_value(trial)}"


def _value(trial: Trial | Prospect) -> str:
    return f"{trial.setting:.6g}{' s' if trial.knob == 'step' else ''}"


def _share(value: float) -> str:
    return percent(value) if value >= 1e-4 else f"{value:.1e}"


def _seconds(value: float) -> str:
    return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"
