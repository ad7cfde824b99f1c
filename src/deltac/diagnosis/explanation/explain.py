"""`explain_residual`: which few changes of the model would make the motion of a log obey it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.explanation.equations import Form, Prepared, prepare
from deltac.diagnosis.explanation.regression import Fit
from deltac.diagnosis.explanation.search import Found, search
from deltac.diagnosis.explanation.separate import advice
from deltac.diagnosis.explanation.words import remedy, sentence
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.names import in_model_order
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

Array: TypeAlias = NDArray[np.float64]
Kind = Literal["nothing", "explained", "ambiguous", "unexplained"]

EXPLAINS = 0.9
"""Share of what is no noise that causes must explain of the squared residual to be named."""

CLEAR = 4.0
"""A residual whose squares are so many times those of noise and rounding is there."""

NOISE = 1.2
"""What is left counts as noise up to so many times its estimate."""

SURE = 6.0
"""Standard errors by which a cause must stand out where the residual is little more than noise."""

PASSIVE = ("spring", "damper")
"""Kinds of which the model's own forces are tested, where it is asked to explain a run by itself."""

UNSEEN = 0.3
"""Standard error of a factor from which on a log is said not to show it."""


@dataclass(frozen=True)
class Cause:
    """A change of the model that would explain the residual.

    kind, element   what, and of which body, joint or channel; "gravity", "body-mass", "missing-damper", …
    values, errors  its numbers with their standard errors: what the run has
    names, units    of these
    model           what the model has in their place
    share           of the squared residual that this cause alone explains of what the others leave
    sentence        all of it in words
    """

    kind: str
    element: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    model: tuple[float, ...]
    share: float
    sentence: str

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class Explanation:
    """What explains the residual F_r + F*_r of a log.

    Attributes:
        kind: "nothing" to explain; "explained"; "ambiguous", where other causes do as well; or
            "unexplained" by the causes that are known.
        causes: the fewest that explain it, largest first.
        explained: share of the squared residual that they explain, what is noise left out.
        alternatives: other sets of causes that the log does not tell from these.
        separating: the motion that would tell them apart, or that none does.
        unseen: elements whose masses, inertias or channels the log hardly shows.
        form: "samples", with measured accelerations; "weak", from speeds over windows.
        residual: largest root mean square of an equation's residual, as a share of its terms.
        noise: what of that the noise of the log accounts for.
        samples: how many were looked at.
    """

    kind: Kind
    causes: tuple[Cause, ...]
    explained: float
    alternatives: tuple[tuple[Cause, ...], ...]
    separating: str
    unseen: tuple[str, ...]
    form: Form
    residual: float
    noise: float
    samples: int

    @property
    def sentence(self) -> str:
        """The outcome in a sentence or two."""
        if self.kind == "nothing":
            return (
                f"There is nothing to explain: the equations of motion hold to {self.residual:.1g} of their "
                f"terms, and noise accounts for {self.noise:.1g}"
            )
        if self.kind == "unexplained":
            nearest = f"; the nearest is {self.causes[0]}" if self.causes else ""
            return (
                f"No few causes of those known explain the residual ({self.residual:.2g} of the terms)"
                f"{nearest}, which explains {percent(self.explained)}"
            )
        told = "; and ".join(c.sentence for c in self.causes)
        told = f"{told[:1].upper()}{told[1:]}"
        verb = "explain" if len(self.causes) > 1 else "explains"
        said = f"{told}: {verb} {percent(self.explained)} of the residual"
        if self.kind == "ambiguous":
            others = "; or ".join(" and ".join(map(str, other)) for other in self.alternatives[:4])
            more = len(self.alternatives) - 4
            said += f". The log explains as well: {others}"
            said += f"; or {more} more" if more > 0 else ""
            said += f". {self.separating}" if self.separating else ""
        return said

    def table(self) -> str:
        """Causes with their numbers, a line each."""
        rows = [("cause", "of", "in the run", "±", "in the model", "unit", "share")]
        for c in self.causes:
            for k, name in enumerate(c.names):
                rows.append(
                    (
                        c.kind if k == 0 else "",
                        c.element if k == 0 else "",
                        f"{name} {c.values[k]:.6g}",
                        f"{c.errors[k]:.2g}",
                        f"{c.model[k]:.6g}",
                        c.units[k],
                        percent(c.share) if k == 0 else "",
                    )
                )
        widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
        lines = ["  ".join(x.ljust(w) for x, w in zip(row, widths)).rstrip() for row in rows]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        held = {k: v for k, v in vars(self).items() if k not in ("causes", "alternatives")}
        return {
            **held,
            "sentence": self.sentence,
            "causes": [vars(c) for c in self.causes],
            "alternatives": [[vars(c) for c in other] for other in self.alternatives],
        }

    def findings(self) -> list[Finding]:
        """The causes as findings of an audit; none where the residual is not explained."""
        if self.kind not in ("explained", "ambiguous"):
            return []
        evidence = f"explains {percent(self.explained)} of what is left of the equations of motion"
        if len(self.causes) > 1:
            evidence = f"together these explain {percent(self.explained)} of what is left of the equations"
        if self.alternatives:
            others = (" and ".join(map(str, other)) for other in self.alternatives[:3])
            evidence += f"; explained as well by: {'; '.join(others)}"
            evidence += f". {self.separating}" if self.separating else ""
        return [
            Finding(
                c.kind, c.sentence, evidence, remedy(c.kind), "cause", c.element, c.values[0], c.errors[0]
            )
            for c in self.causes
        ]

    def __str__(self) -> str:
        return self.sentence


def explain_residual(model: Any, log: Any, *, mapping: Any = None) -> Explanation:
    """Name the few changes of a model that explain what a log leaves of its equations of motion.

    Springs and dampers are taken from the model, also where the log holds them, so that what model
    and run have differently is found; all other logged forces are taken as they are. Without measured
    accelerations the equations are integrated over short windows (the weak form).

    Args:
        model: as for `audit`.
        log: a Trajectory, or the path of a log.
        mapping: path of a mapping file, for logs whose columns have other names or units.

    Returns:
        The explanation; `str()` of it is the outcome in words, `table()` the numbers.

    Raises:
        InputError: model or log cannot be read, the log is not of this model, or it is too short.
    """
    from deltac.diagnosis.models import load_model
    from deltac.trajectories import read_trajectory

    loaded = load_model(model)
    mechanism = loaded.mechanism
    if not isinstance(log, Trajectory):
        log = read_trajectory(log, mapping, mechanism)
    elif mapping is not None:
        raise InputError("mapping= is for log files; this log is a Trajectory already")
    run, _ = in_model_order(mechanism, log)
    if not len(mechanism.free.u):
        raise InputError("every joint of the model is prescribed: no equation of motion is left to explain")
    told = " ".join(str(r) for r in loaded.import_report.ignored) if loaded.import_report else ""
    own = [
        n for n in run.forces if n.partition(" ")[0] in PASSIVE and f"'{n}'" not in told
    ]
    run = replace(run, forces={n: f for n, f in run.forces.items() if n not in own})
    derived = "udot" in run.provenance.notes.get("derived", "").split(";")
    return explanation(mechanism, run, "weak" if run.udot is None or derived else "samples")


def explanation(
    mechanism: Mechanism,
    run: Trajectory,
    form: Form,
    least: float = EXPLAINS,
    *,
    sliding: bool = False,
) -> Explanation:
    """The explanation of a run whose columns are in the mechanism's order, with its forces as logged.

    `least` is the share of the squared residual that causes must explain. `sliding` leaves out what
    joints do that hardly move: dry friction has no law there. It is tried where nothing else fits.
    """
    prepared = prepare(mechanism, run, form, sliding=sliding)
    regression = prepared.regression
    relative = float(np.max(prepared.residual / np.maximum(prepared.scale, 1e-300), initial=0.0))
    noise = float(np.max(prepared.noise / np.maximum(prepared.scale, 1e-300), initial=0.0))

    def made(kind: Kind, found: Found | None = None, explained: float = 0.0, told: str = "") -> Explanation:
        return Explanation(
            kind,
            _causes(mechanism, prepared, found.best) if found else (),
            explained,
            tuple(_causes(mechanism, prepared, f) for f in found.alternatives) if found else (),
            told,
            _unseen(prepared),
            prepared.form,
            relative,
            noise,
            prepared.samples,
        )

    if regression.total <= regression.precision:
        return made("nothing")
    found = search(regression)
    explained = _explained(prepared, found.best)
    floor = regression.floor(regression.nothing)
    if regression.total <= CLEAR * floor and not _stands_out(prepared, found.best):
        return made("nothing")
    if not prepared.sliding and found.best.left > CLEAR * regression.floor(found.best):
        slid = explanation(mechanism, run, form, least, sliding=True)
        if any("friction" in f"{c.kind} {c.element}" for c in slid.causes) and slid.explained > explained:
            return slid
    if not found.best.chosen or explained < least:
        return made("unexplained", Found(found.best, ()), explained)
    if not found.alternatives:
        return made("explained", found, explained)
    return made("ambiguous", found, explained, advice(mechanism, run, prepared, found))


def _explained(prepared: Prepared, fit: Fit) -> float:
    """Share of the squared residual beyond noise that a fit explains."""
    regression = prepared.regression
    if fit.left <= NOISE * regression.floor(fit):
        return 1.0
    there = max(regression.total - regression.noise(regression.nothing), 1e-300)
    left = max(fit.left - regression.noise(fit), 0.0)
    return float(np.clip(1.0 - left / there, 0.0, 1.0))


def _stands_out(prepared: Prepared, fit: Fit) -> bool:
    """Whether each number of a fit is many times its standard error."""
    if not fit.chosen:
        return False
    errors = np.sqrt(np.diag(prepared.regression.covariance(fit)))
    return bool(np.all(np.abs(np.concatenate(fit.theta)) > SURE * errors))


def _causes(mechanism: Mechanism, prepared: Prepared, fit: Fit) -> tuple[Cause, ...]:
    regression = prepared.regression
    if not fit.chosen:
        return ()
    errors = np.sqrt(np.diag(regression.covariance(fit)))
    found, start = [], 0
    for n, (k, theta) in enumerate(zip(fit.chosen, fit.theta)):
        c = regression.candidates[k]
        error = errors[start : start + c.size]
        start += c.size
        others = regression.fit([j for m, j in enumerate(fit.chosen) if m != n]) if len(fit.chosen) > 1 else None
        without = others.left if others else regression.total
        share = (without - fit.left) / regression.total
        found.append(
            Cause(
                c.kind,
                c.element,
                tuple(float(x) for x in c.base + theta),
                tuple(float(x) for x in error),
                c.names,
                c.units,
                tuple(float(x) for x in c.base),
                float(min(share, 1.0)),
                sentence(mechanism, c, theta, error),
            )
        )
    held = [c for c in found if c.kind == "actuator-delay" and abs(c.values[0]) <= prepared.spacing]
    kept = [c for c in found if c not in held] or found  # a force held over a step is no fault
    return tuple(sorted(kept, key=lambda cause: -cause.share))


def _unseen(prepared: Prepared) -> tuple[str, ...]:
    """Bodies and channels of which a change by a third would not stand out."""
    regression = prepared.regression
    sizes = regression.sizes
    largest = float(sizes.max(initial=0.0))
    deviation = float(np.sqrt(regression.floor(regression.nothing) / max(1, regression.rows)))
    found = []
    for c, size in zip(regression.candidates, sizes):
        if c.kind in ("body-mass", "body-moments", "actuator-gear", "channel-factor") and (
            size <= 1e-9 * largest or deviation > UNSEEN * size
        ):
            what = {"body-mass": "mass of ", "body-moments": "inertia of "}.get(c.kind, "")
            found.append(f"{what}{c.element}")
    return tuple(found)


def percent(share: float) -> str:
    """A share near one, with as many nines as it has."""
    return "all but 1e-6" if share > 1 - 1e-6 else f"{100 * share:.4g} %"
