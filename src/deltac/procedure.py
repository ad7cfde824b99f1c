"""`examine`: the whole procedure for a model, equations written by hand, or a log.

The conclusion of the thesis (l. 5274-5280) asks for a procedure that tells whether a simulation can be
trusted, with which step and which solver, and where careless mistakes are. Each step of it is a verb of its
own; `examine` runs those that apply, hands the results on, and ends with one verdict.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from deltac.analysis.classify import Classification, classify
from deltac.calls.arguments import checked
from deltac.calls.progress import TIME_LIMIT, Parts, Progress
from deltac.diagnosis.audit.audit import Audit, audit
from deltac.diagnosis.check.check import EquationCheck, check_equations
from deltac.diagnosis.inputs.logs import LogLike
from deltac.diagnosis.recommend.recommend import recommend
from deltac.diagnosis.recommend.result import Recommendation
from deltac.diagnosis.study.result import Study
from deltac.diagnosis.study.simulators import SimulationOptions, handed_on
from deltac.diagnosis.study.study import study
from deltac.diagnosis.verdict import REFINED_TOLERANCE
from deltac.errors import ArgumentsError
from deltac.models import Model, ModelLike, StateLike, load_model
from deltac.results import Finding, Report, Section, Table, findings_in_words
from deltac.simulation.solvers import find_solver
from deltac.trajectories.formats.mapping import MappingLike

CANDIDATES = ("ode5", "ode4", "ode8", "generalized-alpha")
"""Solvers that are tried, explicit ones first; `recommend` tries all."""

PART_SHARES = {"check": 0.1, "recommend": 0.5, "study": 0.3, "audit": 0.1}
"""Of the time that each part takes, roughly; for the bar of progress."""


@dataclass(frozen=True, eq=False, repr=False)
class Examination(
    Report, omit=("classification", "check", "recommendation", "study", "audit"), also=("parts",)
):
    """The results of the procedure; parts that did not apply are None.

    Attributes:
        model: its name, or what was given.
        classification: what kind of system it is.
        check: equations written by hand against the model.
        recommendation: the cheapest solver and step that keep the tolerance.
        study: the motion at four, two and one times that step.
        audit: the log against the model.
        skipped: what was left out, and why.
    """

    model: str
    classification: Classification
    check: EquationCheck | None
    recommendation: Recommendation | None
    study: Study | None
    audit: Audit | None
    skipped: tuple[str, ...]
    missing: tuple[Finding, ...] = ()

    @property
    def results(self) -> dict[str, Report]:
        """The parts that were done, by name, in the order in which they were done."""
        every = {
            "check": self.check,
            "recommend": self.recommendation,
            "study": self.study,
            "audit": self.audit,
        }
        return {name: part for name, part in every.items() if part is not None}

    def parts(self) -> dict[str, dict[str, Any]]:
        """The parts that were done, as JSON has them."""
        return {name: part.contents() for name, part in self.results.items()}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed: what is not simulated, then part by part."""
        return (*self.missing, *(f for part in self.results.values() for f in part.findings))

    @property
    def exit_code(self) -> int:
        """1 where a part found something wrong, else 3 where one could not tell, else 0.

        That no step keeps the tolerance is nothing wrong with the model: nothing can be told then.
        """
        codes = list(self._codes.values())
        return 1 if 1 in codes else 3 if 3 in codes or self.missing or not codes else 0

    @property
    def _codes(self) -> dict[str, int]:
        codes = {name: part.exit_code for name, part in self.results.items()}
        return codes | ({"recommend": 3} if codes.get("recommend") else {})

    def summary(self) -> str:
        """The outcome in one line."""
        outcome = {0: "can be trusted", 1: "something is wrong", 3: "cannot be told"}[
            self.exit_code
        ]
        wrong = [name for name, code in self._codes.items() if code == self.exit_code]
        where = f" ({', '.join(wrong)})" if self.exit_code and wrong else ""
        return f"{self.model}: {outcome}{where}"

    def sections(self) -> Iterator[Section]:
        """The model, one line a part, then what to do, the evidence, and what was not seen."""
        yield f"{self.classification.summary()}."
        yield f"constant: {', '.join(self.classification.constant) or 'nothing'}."
        rows = [(TITLES[name], part.summary()) for name, part in self.results.items()]
        yield Table(("question", "answer"), tuple(rows))
        yield from (f"Not done: {reason}." for reason in self.skipped)
        if self.check is not None and self.check.exit_code:
            where = (part for part in self.check.sections() if isinstance(part, str))
            yield from (part for part in where if part.startswith(("Where", "Example")))
        yield f"Altogether: {self.summary()}."
        yield from findings_in_words(self.findings)
        if self.recommendation is not None and self.recommendation.best is not None:
            yield f"To do: use {self.recommendation.summary()}."
        judged = (self.study, self.audit, self.check)
        all_limits = [part.verdict.limits for part in judged if part is not None]
        if self.recommendation is not None:
            all_limits.append(self.recommendation.limits)
        limits = dict.fromkeys(limit for each in all_limits for limit in each)
        if limits:
            yield f"Not seen: {'; '.join(limits)}."


TITLES = {
    "check": "are the equations the model's?",
    "recommend": "which solver, which step?",
    "study": "is the error the integrator's?",
    "audit": "can the log be trusted?",
}


@checked
def examine(
    model: ModelLike,
    state: StateLike = None,
    duration: float | None = None,
    *,
    log: LogLike | None = None,
    mapping: MappingLike = None,
    tolerance: float = REFINED_TOLERANCE,
    solvers: Sequence[str] = CANDIDATES,
    progress: Progress | None = None,
    **simulation: Unpack[SimulationOptions],
) -> Examination:
    """Run the whole procedure: check the equations, choose solver and step, study, audit the log.

    Args:
        model: a Mechanism, a Problem or its name, an ``.xml`` or ``.urdf`` file, a MuJoCo model, or
            ``file.py:callable``.
        state: where the motion starts; by default the model's own start, or all zeros.
        duration: how long the motion is, s; by default the problem's. Without it nothing is simulated.
        log: a Trajectory or the path of a log of this model.
        mapping: of the log's columns, as for `audit`.
        tolerance: accepted |ΔC|, and error of the motion, as `recommend` and `audit` measure them.
        solvers: names of the solvers with fixed steps that compete for the recommendation.
        progress: called with the fraction done.
        **simulation: `equations`, `controller` and `constraints`, as for `simulate`. The equations written by
            hand are checked, and integrated in the study; solver and step are chosen by the model's own.

    Raises:
        InputError: as the verbs that are run; and where there is nothing to examine.
    """
    loaded = load_model(model)
    options = handed_on(examine, simulation, own=("record",))
    equations, of_model = options.get("equations"), options.copy()
    of_model.pop("equations", None)
    if duration is None and loaded.problem is not None:
        duration = loaded.problem.duration
    if duration is None and equations is None and log is None:
        raise ArgumentsError(
            "examine: the model has no duration, and there are neither equations nor a log; give duration= "
            "in seconds, equations= or log="
        )
    skipped: list[str] = []
    parts = Parts(progress, PART_SHARES)
    check = None
    if equations is not None:
        check = check_equations(model, equations, progress=parts.part("check"))
    recommendation = study_result = None
    if duration is None:
        skipped.append("solver, step and study, since no duration is given")
    else:
        recommendation = recommend(
            loaded,
            state,
            duration,
            tolerance,
            solvers=solvers,
            time_limit=TIME_LIMIT / 3,  # by itself it may take more
            progress=parts.part("recommend"),
            **of_model,
        )
        parts.part("study")
        if recommendation.best is None:
            skipped.append(
                f"the study, since there is no step to begin with: {recommendation.summary()}"
            )
        else:
            study_result = _study(loaded, state, duration, tolerance, recommendation, options)
    judged = None
    if log is not None:
        judged = audit(
            model, log, tolerance=tolerance, mapping=mapping, progress=parts.part("audit")
        )
    parts(1.0)
    return Examination(
        model=loaded.mechanism.name or str(model),
        classification=classify(loaded, state),
        check=check,
        recommendation=recommendation,
        study=study_result,
        audit=judged,
        skipped=tuple(skipped),
        missing=tuple(_not_simulated(loaded)) if log is None else (),
    )


def _study(
    loaded: Model,
    state: StateLike,
    duration: float,
    tolerance: float,
    chosen: Recommendation,
    options: SimulationOptions,
) -> Study:
    """The motion at 4, 2 and 1 times the recommended step, by the equations under examination."""
    assert chosen.best is not None
    solver, step = chosen.best.solver, chosen.best.setting
    steps = tuple(duration / round(duration / (k * step)) for k in (1.0, 0.5, 0.25))
    assert find_solver(solver).takes_steps
    return study(
        loaded,
        state,
        duration,
        steps=steps,
        solver=solver,
        tolerance=tolerance,
        **options,
    )


def _not_simulated(loaded: Model) -> Iterator[Finding]:
    """What an import left out and a simulation therefore lacks."""
    report = loaded.import_report
    for remark in () if report is None else report.ignored:
        yield Finding(
            "not-simulated",
            f"{remark.element} of the model is not simulated",
            remark.what,
            "Let MuJoCo simulate it (`deltac recommend`, `deltac study --solver mujoco:rk4`), or audit a log",
            weight="doubt",
            element=remark.element,
        )
