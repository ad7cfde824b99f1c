"""`mutate_equations`: how well do the tests protect these equations?"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltac.diagnosis.check.check import chosen_map
from deltac.diagnosis.inputs.models import load_model
from deltac.errors import InputError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.repair.mutate.operators import KINDS, Mutant, mutants
from deltac.repair.tracing.program import at, named_parameters, read
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source, read_source
from deltac.simulation.equations import Equations

RESIDUAL, MOMENTUM, CONSTRAINTS = "coordinate residual", "momentum", "constraints"

REASONS = {
    "equivalent": "the same equations, written otherwise",
    "coincidence": "the same at the parameters' own values, not at others",
    "workless": "wrong by forces that do no work: no balance of energy sees them",
}
"""Why a mutant is not seen."""


@dataclass(frozen=True)
class Trial:
    """A mutant and the size of what each test sees of it: relative, 0 being right.

    `reason` says why some test, or every test, does not see it (see `REASONS`); empty if all do.
    """

    mutant: Mutant
    seen: Mapping[str, float]
    reason: str = ""

    def detected(self, test: str) -> bool:
        """Whether a test sees it."""
        return not self.seen[test] < RIGHT

    @property
    def missed(self) -> tuple[str, ...]:
        """The tests that do not see it."""
        return tuple(test for test in self.seen if not self.detected(test))


@dataclass(frozen=True)
class MutationReport:
    """What tests see of mutants of a function.

    file, function  what was mutated
    tests           names of the tests
    trials          one for each mutant
    residual        of the function as it is; mutants of wrong equations tell little
    varied          parameters that were varied to tell equivalent mutants from coincidences
    """

    file: str
    function: str
    tests: tuple[str, ...]
    trials: tuple[Trial, ...]
    residual: float
    varied: tuple[str, ...]

    @property
    def survivors(self) -> tuple[Trial, ...]:
        """Mutants that no test sees."""
        return tuple(t for t in self.trials if len(t.missed) == len(t.seen))

    @property
    def status(self) -> int:
        """Exit status of the command line: 1 if a mistake escapes every test, or the function is wrong."""
        escaped = any(t.reason == "coincidence" for t in self.trials)
        return int(escaped or self.residual >= RIGHT)

    def table(self) -> dict[str, dict[str, int]]:
        """For each kind of mutant: how many, how many are no mistakes, and how many each test sees."""
        rows: dict[str, dict[str, int]] = {}
        for kind in (*KINDS, "all"):
            some = [t for t in self.trials if kind in (t.mutant.kind, "all")]
            if some:
                wrong = [t for t in some if t.reason != "equivalent"]
                rows[kind] = {"mutants": len(some), "equivalent": len(some) - len(wrong)}
                rows[kind] |= {test: sum(t.detected(test) for t in wrong) for test in self.tests}
        return rows

    def explain(self, width: int = 96) -> str:
        """The outcome in words, and the survivors."""
        total = self.table()["all"] if self.trials else {"mutants": 0, "equivalent": 0}
        wrong = total["mutants"] - total["equivalent"]
        lines = [
            f"{self.file}:{self.function}: {total['mutants']} mutants, of which "
            f"{total['equivalent']} are no mistakes (they give the same accelerations everywhere)."
        ]
        if self.residual >= RIGHT:
            lines.append(
                f"The function itself is wrong (residual {self.residual:.2g} of the terms): repair it first."
            )
        for test in self.tests:
            if wrong:
                lines.append(f"- {test} sees {total[test]} of {wrong} ({total[test] / wrong:.1%}).")
        for reason in ("coincidence", "workless"):
            some = [t for t in self.trials if t.reason == reason]
            if some:
                first = some[0].mutant
                lines.append(
                    f"{len(some)} {reason}: {REASONS[reason]}; such as line {first.line}, {first.before} "
                    f"→ {first.after}."
                )
        return "\n".join(textwrap.fill(line, width, subsequent_indent="  ") for line in lines)

    def to_dict(self) -> dict[str, Any]:
        """Everything, for JSON; a residual that is not finite is null."""
        return {
            "file": self.file,
            "function": self.function,
            "residual": self.residual if np.isfinite(self.residual) else None,
            "varied": list(self.varied),
            "table": self.table(),
            "mutants": [
                {
                    "kind": t.mutant.kind,
                    "line": t.mutant.line,
                    "before": t.mutant.before,
                    "after": t.mutant.after,
                    "seen": {k: (v if np.isfinite(v) else None) for k, v in t.seen.items()},
                    "missed": list(t.missed),
                    "reason": t.reason,
                }
                for t in self.trials
            ],
        }


def mutate_equations(
    model: Any,
    rhs: str | Path | Callable[..., Any] | Equations,
    *,
    coordinates: CoordinateMap | str | None = None,
    names: int = 2,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
) -> MutationReport:
    """Change equations of motion in every small way, and see which tests notice.

    The tests are the testing functions in rate form, the momentum balances, and the coordinate residual
    F_r + F*_r, at random states of the model. A mutant with no coordinate residual is equivalent. The
    function is read, not run.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        rhs: ``"FILE.py:FUNCTION"``, a function of (t, q, u) that returns u̇, or `dc.Equations`.
        coordinates: the function's own coordinates, as for `check_equations`.
        names: how many other names take the place of each use of a name.
        seed: of the states and of the names drawn.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: no source, or one that is not understood, as for `repair_equations`.
    """
    found = load_model(model)
    if isinstance(rhs, Equations):
        chosen = rhs.coordinates if coordinates is None else chosen_map(found, coordinates)
        rhs = rhs.rhs
    else:
        chosen = chosen_map(found, coordinates)
    target = Target(found.mechanism, chosen, seed)
    source = read_source(rhs)
    program = read(source, target)
    varied = program.varied
    source = program.source
    definition = source.definition
    if definition is None or "." in source.qualified:
        raise InputError(
            f"{source.name}: {source.qualified} is a method or a function within another; mutants are made "
            "of functions of the module"
        )
    made = mutants(source.text, definition.name, names, seed)
    trials = []
    for k, mutant in enumerate(made):
        if progress is not None:
            progress(k / len(made), f"mutant {k + 1} of {len(made)}")
        trials.append(_tried(source, mutant, target, varied))
    tests = tuple(_blank(target))
    return MutationReport(
        source.name, source.qualified, tests, tuple(trials), program.wrong, varied
    )


def _blank(target: Target) -> dict[str, float]:
    """Each test that applies, with what it sees of something that cannot be evaluated."""
    test = target.test()
    found = dict.fromkeys(test.powers(test.acceleration), np.inf)
    if test.momenta(test.acceleration):
        found[MOMENTUM] = np.inf
    if len(test.gamma):
        found[CONSTRAINTS] = np.inf
    found[RESIDUAL] = np.inf
    return found


def _tried(source: Source, mutant: Mutant, target: Target, varied: tuple[str, ...]) -> Trial:
    """What the tests see of one mutant."""
    changed = source.replaced(mutant.text)
    samples, test = target.samples(), target.test()
    seen = _blank(target)
    try:
        again = read(changed, target, vary=False)
    except InputError:
        return Trial(mutant, seen)  # it cannot even be evaluated
    found = again.run()
    udot = found[: len(samples.acceleration)]
    if not np.isfinite(udot).all():
        return Trial(mutant, seen)
    residuals = test(udot)
    seen |= {name: float(x.max()) for name, x in residuals.relative_power.items()}
    if MOMENTUM in seen:
        seen[MOMENTUM] = max(float(x.max()) for x in residuals.relative_momentum.values())
    if CONSTRAINTS in seen:
        seen[CONSTRAINTS] = float(residuals.relative_violation.max(initial=0.0))
    seen[RESIDUAL] = samples.wrong(found)
    return Trial(
        mutant, seen, _reason(changed, seen, target, varied, named_parameters(again, target))
    )


def _reason(
    changed: Source,
    seen: Mapping[str, float],
    target: Target,
    varied: tuple[str, ...],
    named: Mapping[str, str],
) -> str:
    if seen[RESIDUAL] < RIGHT:
        common = tuple(name for name in varied if name in named.values())
        try:
            same = set(common) == set(varied) and at(changed, target, common).wrong < RIGHT
        except InputError:
            same = False
        return "equivalent" if same else "coincidence"
    powers = [v for k, v in seen.items() if k not in (RESIDUAL, MOMENTUM, CONSTRAINTS)]
    return "workless" if max(powers, default=np.inf) < RIGHT else ""
