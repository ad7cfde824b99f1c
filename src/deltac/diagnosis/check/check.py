"""What a check of equations found, in values and in words."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import ROOT_EPS, Array, max_norm
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Parts, Progress, no_progress
from deltac.diagnosis.check.location import (
    Blame,
    Example,
    blame,
    explained,
    simplest_failure,
    without_sums,
)
from deltac.diagnosis.check.whole import causes_of_model, whole_causes
from deltac.diagnosis.inputs.equations import load_equations
from deltac.diagnosis.inputs.logs import in_model_order
from deltac.diagnosis.residuals.at_samples import CLEAR_OF_ROUNDING, MOST_SAMPLES
from deltac.diagnosis.residuals.at_states import EquationTest, Residuals
from deltac.diagnosis.residuals.function import ROUGH, Caller, noise, uncertainty
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import (
    Place,
    States,
    close_states,
    draw,
    from_user_coordinates,
    joined,
    not_sampled,
    places,
    some_rows,
    states_along,
)
from deltac.diagnosis.verdict import Confidence, Finding, Judged, Verdict, VerdictKind
from deltac.errors import InputError, ModelError, SourceError, StateError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import Model, ModelLike, load_model
from deltac.results import SHOWN, Section, Table, fraction
from deltac.simulation.equations import Equations, RightHandSide, as_equations
from deltac.simulation.state_form import PLAIN_FORM, StateForm
from deltac.trajectories import Trajectory

CHECK_LIMITS = (
    "states other than those drawn, such as a branch that is rarely taken",
    "a parameter that is wrong in both the model and the equations",
)

CHECK_MEANINGS: dict[VerdictKind, str] = {
    "consistent": "The equations are the model's.",
    "equation-error": "The equations are not the model's.",
    "unresolved": "The function is too rough, or too often undefined, to decide.",
}


@dataclass(frozen=True)
class Seen:
    """What one test makes of the equations: its largest `relative` residual, and whether it `sees` them fail.

    `test`: "coordinate residual", "constraint <name>", "momentum, <name>", or the name of a testing function.
    """

    test: str
    relative: float
    sees: bool


@dataclass(frozen=True, eq=False, repr=False)
class EquationCheck(
    Judged,
    omit=("udot", "residuals", "test", "coordinates", "states"),
    also=("mechanism", "count", "relative_residual"),
):
    """What a check of equations found.

    Attributes:
        verdict: "consistent", "equation-error" or "unresolved", with evidence and findings.
        blame: the equations that fail, the worst first.
        seen: which of all tests see that they fail.
        example: a simple state at which they fail, and both accelerations; None if they do not.
        states: where they were tested; `udot` (n, B) their accelerations there, `residuals` what is left.
        test: the mechanism's own equations at these states.
        rough: roughness of the function, as a fraction of the terms, by speed.
        tolerance: relative residual that is accepted.
        coordinates: the map to the mechanism's coordinates, None for its own.
        name: what the equations are called.
        rates: by coordinate, how far q̇ is off, relative; empty where the function does not return it.
        form: how the function takes the state.
    """

    verdict: Verdict
    blame: tuple[Blame, ...]
    seen: tuple[Seen, ...]
    example: Example | None
    states: States
    udot: Array
    residuals: Residuals
    test: EquationTest
    rough: Mapping[str, float]
    tolerance: float
    coordinates: CoordinateMap | None
    name: str
    rates: Mapping[str, float] = field(default_factory=dict)
    form: StateForm = PLAIN_FORM

    @property
    def worst(self) -> float:
        """The largest relative residual, of all equations at all states where it is finite."""
        return max_norm(self.residuals.worst)

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.test.kane.mechanism.name

    @property
    def count(self) -> int:
        """How many states were tested."""
        return len(self.states)

    @property
    def relative_residual(self) -> dict[str, float]:
        """The largest relative residual of each equation, by speed."""
        return dict(zip(self.test.speeds, self.residuals.worst.tolist()))

    def summary(self) -> str:
        """Verdict, and the largest residual beside the tolerance."""
        sign = ">" if self.worst > self.tolerance else "≤"
        return (
            f"{self.verdict.kind}: the residual is {fraction(self.worst)} {sign} "
            f"{fraction(self.tolerance)} of an equation's terms{self.verdict.certainty}"
        )

    def sections(self) -> Iterator[Section]:
        """Each test's residual, the verdict, where the equations fail, and an example."""
        failing = {entry.number for entry in self.blame}
        rows: list[tuple[str, ...]] = [
            (f"equation {k} ({speed})", fraction(value), "fails" if k in failing else "")
            for k, (speed, value) in enumerate(self.relative_residual.items(), 1)
        ]
        tests = [
            (result.test, fraction(result.relative), "fails" if result.sees else "")
            for result in self.seen[1:]
        ]
        yield Table(("test", "relative residual", ""), (*rows, (), *tests))
        yield from self.verdict.sections(self._details())

    def _details(self) -> Iterator[str]:
        for k, finding in enumerate(self.blame[:SHOWN]):
            yield f"{'Where' if k == 0 else 'Also'}: {finding}."
        if len(self.blame) > SHOWN:
            yield f"Also: {len(self.blame) - SHOWN} more equations."
        if self.example is not None:
            yield f"Example: {self.example}."


# --- `check_equations` ---------------------------------------------------------------------------

TOLERANCE = ROOT_EPS
"""Relative residual that is accepted: half of a double's digits. Rounding stays far below, and a
constant typed with seven digits shows."""

RATES = "rates as speeds"
"""A map without its own speeds: Euler's rates in place of body rates, for instance."""


CHECK_SHARES = {"function": 0.3, "blame": 0.5, "causes": 0.2}
"""Of the time that each part of a check takes, roughly."""


@checked
@interruptible()
def check_equations(
    model: ModelLike,
    equations: str | Path | RightHandSide | Equations,
    *,
    coordinates: CoordinateMap | str | None = None,
    states: States | Trajectory | None = None,
    count: int = 64,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    progress: Progress | None = None,
) -> EquationCheck:
    """Test equations of motion at random admissible states of a mechanism, without integrating them.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file: what `load_model` takes.
        equations: a function of (t, q, u) that returns u̇, with arrays (n,); a function of (t, y), (y, t), (y)
            or (y, control) that returns the rates of the state y (the order of q and u in y is inferred; a
            control is set to zero); ``"FILE.py:FUNCTION"``; or `Equations`.
            Where q̇ is returned, it is tested.
        coordinates: the function's own coordinates and speeds: a CoordinateMap; "joint" for the
            mechanism's free ones; "absolute" for absolute angles (the problem's own map, where it has
            one). By default the map of the `Equations`, or of the problem's own equations, else "joint".
        states: where to test: `States` in own coordinates, or the states of a run; drawn by `random_states`
            if not given.
        count: number of random states.
        seed: random seed; the same seed gives the same states.
        tolerance: residual that is accepted, as a fraction of each equation's terms.
        progress: called with the fraction done.

    Returns:
        The check: `.verdict`, `.blame`, `.example`, `.explain()`.

    Raises:
        InputError: a function that raises, returns no u̇, or has a memory; a map that does not fit; states
            that the mechanism cannot take.
    """
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"tolerance is {tolerance}; expected a fraction above 0, such as 1e-8")
    loaded = load_model(model)
    if isinstance(equations, str | Path):
        equations = load_equations(str(equations), loaded.mechanism.coordinates.names)
    own = as_equations(equations)
    chosen = loaded.coordinate_map(coordinates, equations)
    kane = Kane(loaded.mechanism, chosen, loaded.first)
    if not kane.speed_names:
        raise ModelError(
            f"all joints of mechanism {loaded.mechanism.name!r} are prescribed or fixed, so it has no "
            f"equations of motion"
        )
    where = places(kane)
    if states is None:
        drawn = _drawn(kane, where, count=count, seed=seed)
    elif isinstance(states, Trajectory):
        states, _ = in_model_order(loaded.mechanism, states)
        drawn = states_along(kane, states, some_rows(states, MOST_SAMPLES))
    else:
        drawn = _fitting(kane, states)
    test = EquationTest(kane, drawn)
    caller = Caller(own.rhs, own.name, kane)
    caller.find_form(test, own)
    parts = Parts(progress, CHECK_SHARES)
    caller.refuse_memory(drawn)
    caller.progress = parts.part("function")
    qdot, udot = caller.whole(drawn)
    caller.progress = no_progress
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(udot).all(axis=0))
    if not finite.any():
        raise SourceError(
            f"{own.name} returned values that are not finite at all {len(drawn)} states, for "
            f"example at {drawn.in_words(0)}: u̇ = {udot[:, 0].tolist()}"
        )
    if not finite.all():  # judge where there is something to judge
        test = EquationTest(kane, drawn.take(finite))
    accelerations = udot[:, finite]
    typical = test.typical(accelerations)
    speeds = np.sqrt(np.mean(drawn.u**2, axis=1))
    ordinary = int(finite[:count].sum()) if states is None else len(test.states)
    rough = noise(caller, test, speeds, ordinary or len(test.states)) / typical
    rough = np.where(np.isfinite(rough), rough, 0.0)
    limit = np.maximum(tolerance, uncertainty(rough, CLEAR_OF_ROUNDING))
    rates = _misses(test, qdot[:, finite])
    judged = _judged(
        test,
        accelerations,
        limit,
        rates,
        name=own.name,
        tolerance=tolerance,
        rough=rough,
        finite=bool(finite.all()),
    )
    wrong = judged.verdict.kind == "equation-error"
    blamed = blame(test, accelerations, limit, caller, parts.part("blame")) if wrong else ()
    findings = _findings(caller, finite, drawn, [m.name for m in loaded.mechanism.motors])
    if wrong and blamed:  # where q̇ alone is wrong, other coordinates explain nothing
        findings += _other_coordinates(loaded, own, chosen, count=count, seed=seed)
        if not any(f.kind == "coordinates" for f in findings):
            parts.part("causes")
            causes = whole_causes(caller, test, explained=explained(blamed))
            findings += causes
            blamed = without_sums(blamed) if causes else blamed
    evidence = judged.verdict.evidence
    if not caller.form.plain:
        form = caller.form.describe(kane.user_names, test.speeds)
        evidence = (*evidence, f"called as {form}")
    if wrong and caller.overwrites:
        # First, because all that follows may come of it: what is overwritten looks like a missing term.
        evidence = (_overwriting(own.name, caller.overwrites), *evidence)
    limits = _limits(loaded, kane, where, test.states)
    return replace(
        judged,
        verdict=replace(judged.verdict, evidence=evidence, findings=findings, limits=limits),
        blame=blamed,
        example=simplest_failure(caller, test, accelerations, limit) if wrong else None,
        form=caller.form,
    )


def check_states(
    test: EquationTest,
    udot: Array,
    qdot: Array,
    *,
    name: str,
    tolerance: float | None = None,
    rounding: float = 0.0,
) -> EquationCheck:
    """`check_equations` of accelerations (n, B), perhaps with q̇ (nq, B), known at some states only.

    `rounding` is what the digits leave open of them, relative.
    """
    accepted = max(TOLERANCE, rounding) if tolerance is None else tolerance
    limit = np.full(len(test.speeds), accepted)
    rates = _misses(test, qdot)
    rough = np.zeros(len(test.speeds))
    judged = _judged(test, udot, limit, rates, name=name, tolerance=accepted, rough=rough)
    limits = (*CHECK_LIMITS, "the function at states that are not in the table")
    if judged.verdict.kind != "equation-error":
        return replace(judged, verdict=replace(judged.verdict, limits=limits))
    blamed = blame(test, udot, limit)
    findings = () if explained(blamed) else causes_of_model(test, udot)
    return replace(
        judged,
        verdict=replace(judged.verdict, limits=limits, findings=findings),
        blame=without_sums(blamed) if findings else blamed,
    )


def _judged(
    test: EquationTest,
    udot: Array,
    limit: Array,
    rates: Mapping[str, float],
    *,
    name: str,
    tolerance: float,
    rough: Array,
    finite: bool = True,
) -> EquationCheck:
    """The verdict on accelerations (n, B), perhaps with errors of q̇; what is wrong is not yet said.

    `limit` (n,) is the residual that passes, `rough` (n,) the roughness of the function, both as fractions of
    the terms. `finite`: the accelerations are, at all states that were drawn.
    """
    residuals = test(udot)
    worst = residuals.worst
    violated = float(residuals.violation.max(initial=0.0))
    most = float(limit.max(initial=tolerance))
    missed = max(rates.values(), default=0.0)
    excess = max(max_norm(worst / limit), violated / most, missed / most)
    kind: VerdictKind = "consistent"
    confidence: Confidence = "high" if most <= tolerance else "medium"
    if excess > 1.0:
        kind, confidence = "equation-error", "high" if excess > 100.0 else "medium"
    elif max(max_norm(worst), violated) > tolerance or not finite:
        kind, confidence = "unresolved", "medium"
    results = _seen(residuals, limit, test.kane.rows.names if len(test.gamma) else ())
    if rates:
        results = (*results, Seen("coordinate rates", missed, missed > tolerance))
    wrong = kind == "equation-error"
    evidence = _evidence(residuals, rough, limit, tolerance, results, test, udot, wrong)
    evidence = (*evidence, *_of_rates(rates, tolerance))
    return EquationCheck(
        verdict=Verdict(kind, confidence, evidence, meaning=CHECK_MEANINGS[kind]),
        blame=(),
        seen=results,
        example=None,
        states=test.states,
        udot=udot,
        residuals=residuals,
        test=test,
        rough=dict(zip(test.speeds, map(float, rough))),
        tolerance=tolerance,
        coordinates=test.kane.coordinates,
        name=name,
        rates=rates,
    )


def _misses(test: EquationTest, rates: Array) -> dict[str, float]:
    """How far rates q̇ (nq, B) are off, by coordinate, relative; empty where none are returned."""
    if not len(rates):
        return {}
    errors = np.abs(rates - test.rates).max(axis=1) / test.rate_sizes
    errors = np.where(np.isfinite(errors), errors, np.inf)
    return dict(zip(test.kane.user_names, map(float, errors)))


def _of_rates(rates: Mapping[str, float], tolerance: float) -> tuple[str, ...]:
    if not rates:
        return ()
    wrong = [name for name, error in rates.items() if error > tolerance]
    worst = max(rates.values())
    if not wrong:
        return (f"q̇ agrees with the speeds to {fraction(worst)} of its size",)
    return (
        f"q̇ of {', '.join(wrong)} does not agree with the speeds: it is off by up to {fraction(worst)} of "
        "its size",
    )


def _drawn(kane: Kane, where: tuple[Place, ...], *, count: int, seed: int) -> States:
    """Random states, then those of slow slip and small overlap where there is friction or contact."""
    random = draw(kane, count=count, seed=seed)
    close = close_states(kane, where, seed)
    return random if close is None else joined([random, close])


def _limits(model: Model, kane: Kane, where: tuple[Place, ...], states: States) -> tuple[str, ...]:
    """What the check cannot see, of this mechanism at these states."""
    events = tuple(event.name for event in model.mechanism.events)
    unseen = (f"what happens at events ({', '.join(events)})",) if events else ()
    if where_from := kane.mode:
        unseen = (*unseen, f"other assemblies of the loops than that of {where_from}")
    return (*CHECK_LIMITS, *not_sampled(where, states), *unseen)


def _fitting(kane: Kane, states: States) -> States:
    names = (states.coordinates, states.speeds)
    if kane.assembled and names == (kane.user_names, kane.speed_names):
        return from_user_coordinates(kane, states)
    if names != (kane.coordinate_names, kane.speed_names):
        raise StateError(
            f"the states are of {', '.join(states.coordinates)}; the equations' coordinates are "
            f"{', '.join(kane.coordinate_names)}. Draw them with the same coordinates="
        )
    return states


def _seen(residuals: Residuals, limit: Array, constraints: tuple[str, ...]) -> tuple[Seen, ...]:
    most = float(limit.max(initial=TOLERANCE))
    results = [
        Seen(
            "coordinate residual", max_norm(residuals.worst), bool((residuals.worst > limit).any())
        )
    ]
    for name in dict.fromkeys(constraints):
        rows = [k for k, owner in enumerate(constraints) if owner == name]
        violated = float(residuals.violation[rows].max(initial=0.0))
        results.append(Seen(f"constraint {name}", violated, violated > most))
    scalars: Mapping[str, Array] = {
        **residuals.power,
        **{f"momentum, {name}": x for name, x in residuals.momentum.items()},
    }
    for name, values in scalars.items():
        largest = float(values.max(initial=0.0))
        results.append(Seen(name, largest, largest > most))
    return tuple(results)


def _evidence(
    residuals: Residuals,
    rough: Array,
    limit: Array,
    tolerance: float,
    results: tuple[Seen, ...],
    test: EquationTest,
    udot: Array,
    wrong: bool,
) -> tuple[str, ...]:
    evidence = [
        f"F_r + F*_r is at most {fraction(max_norm(residuals.worst))} of an equation's terms, at "
        f"{len(test.states)} random states (accepted: {fraction(float(limit.max(initial=tolerance)))})"
    ]
    ties = [s for s in results if s.test.startswith("constraint ")]
    if ties:
        worst_tie = max(ties, key=lambda s: s.relative)
        violated = [s.test.removeprefix("constraint ") for s in ties if s.sees]
        evidence.append(
            f"ψ̇ = G u̇ + γ is at most {fraction(worst_tie.relative)} of its terms"
            + (f": the accelerations violate {', '.join(violated)}" if violated else "")
        )
    wrong_speeds = _wrong_accelerations(test, udot, limit) if wrong else ()
    if 0 < len(wrong_speeds) < len(test.speeds):
        evidence.append(
            f"only the acceleration of {', '.join(wrong_speeds)} differs from the model's"
        )
    if float(rough.max(initial=0.0)) > ROUGH:
        evidence.append(
            f"the function is rough: its values are accurate to {float(rough.max()):.1g} only, as in "
            f"single precision or with finite differences"
        )
    if wrong:
        energy = [s for s in results if s.test in residuals.power]
        sees = ", ".join(s.test for s in energy if s.sees)
        evidence.append(
            f"seen by the testing functions {sees}"
            if sees
            else "no energy test can see it: the error does no work, and a simulation would conserve energy"
        )
        momenta = [s for s in results if s.test.startswith("momentum")]
        if momenta:
            names = ", ".join(s.test.removeprefix("momentum, ") for s in momenta if s.sees)
            evidence.append(
                f"seen by the momentum balance {names}" if names else "no momentum balance sees it"
            )
    return tuple(evidence)


def _overwriting(name: str, written: str) -> str:
    return (
        f"{name} overwrites its arguments ({written}); if it does so before using them, that is the "
        f"error, and the terms named below only follow from it: copy q and u first"
    )


def _wrong_accelerations(test: EquationTest, udot: Array, limit: Array) -> tuple[str, ...]:
    """The speeds whose accelerations differ from the model's."""
    errors = np.abs(udot - test.acceleration).max(axis=1)
    size = np.abs(test.acceleration).max()
    return tuple(n for n, x in zip(test.speeds, errors) if x > float(limit.max()) * size)


def _findings(
    caller: Caller, finite: NDArray[np.bool_], drawn: States, motors: list[str]
) -> tuple[Finding, ...]:
    findings: list[Finding] = []
    if caller.overwrites:
        findings.append(
            Finding(
                "writes-to-input",
                "the function modifies its input arrays",
                f"for example {caller.overwrites}; here it was given copies, but a solver would be disturbed",
                "Copy q and u before changing them",
                "doubt",
            )
        )
    if motors:
        findings.append(
            Finding(
                "motor",
                f"the motors {', '.join(motors)} have no law and were taken as zero",
                "a joint torque whose value a controller or a log supplies",
                "Give the joint torque a law if the equations have one",
            )
        )
    missing = int((~finite).sum())
    if missing:
        k = int(np.argmin(finite))
        findings.append(
            Finding(
                "not-finite",
                f"the accelerations are not finite at {missing} of {len(finite)} states",
                f"for example at {drawn.in_words(k)}",
                "Look for the root of a negative number or a division by zero; those states were left out",
                "doubt",
            )
        )
    return tuple(findings)


def _other_coordinates(
    model: Model, equations: Equations, chosen: CoordinateMap | None, *, count: int, seed: int
) -> tuple[Finding, ...]:
    """A finding if the function is right in other coordinates."""
    others: list[tuple[str, CoordinateMap | None]] = []
    if chosen is not None:
        others.append(("joint", None))
        if chosen.q and chosen.u and len(chosen.coordinates) == len(chosen.speeds):
            others.append((RATES, CoordinateMap(chosen.coordinates, q=chosen.q)))
    with contextlib.suppress(InputError):  # which has no such coordinates
        others.append(("absolute", model.coordinate_map("absolute")))
    for name, coordinates in others:
        if coordinates is chosen or (coordinates and chosen and vars(coordinates) == vars(chosen)):
            continue  # these it was checked in
        try:
            kane = Kane(model.mechanism, coordinates)
            states = _drawn(kane, places(kane), count=min(count, 16), seed=seed)
            test = EquationTest(kane, states)
            caller = Caller(equations.rhs, equations.name, kane)
            caller.find_form(test, equations)
            udot = caller(states)
            relative, residuals = test.relative(udot), test(udot)
        except InputError:
            continue
        # What constraint forces can explain is no residual: the accelerations must keep the constraints, too.
        admissible = float(residuals.violation.max(initial=0.0)) < TOLERANCE
        if admissible and float(relative.max(initial=0.0)) < TOLERANCE:
            names = ", ".join(states.coordinates)
            return (
                Finding(
                    "coordinates",
                    "the function is right if its speeds are the rates of its coordinates"
                    if name is RATES
                    else f"the function is right in {name} coordinates ({names})",
                    f"relative residual {float(relative.max(initial=0.0)):.1g} there",
                    "Leave u= out of the map, or turn them into the map's speeds"
                    if name is RATES
                    else f"Check it with coordinates={name!r}",
                    "cause",
                ),
            )
    return ()
