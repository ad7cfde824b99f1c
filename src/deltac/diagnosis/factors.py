"""Simple explanations of what is left of the equations of motion, by least squares.

Each candidate is one number: a factor on a channel's force, on the masses, a damper that nobody
mentioned. The residual is linear in all of them, so one projection tells how much each explains.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equations import CLEAR, EquationTerms, Sampled
from deltac.diagnosis.findings import Finding
from deltac.mechanism.mechanism import Mechanism

Array: TypeAlias = NDArray[np.float64]

EXPLAINS = 0.9
"""A candidate is reported if it explains more than this share of the squared residual."""

PREFERENCE = (
    "gravity",
    "mass-scale",
    "actuator-gear",
    "channel-factor",
    "body-inertia",
    "body-mass",
)
"""Of candidates that explain the same, the one that comes first is named first."""

MASSES = ("mass-scale", "body-inertia", "body-mass")
"""Kinds whose factors are believed within a decade only: masses do not vanish."""


@dataclass(frozen=True)
class Fit:
    """One candidate: residual + coefficient · x ≈ 0; `unexplained` is a share of the squared residual.

    kind         what it would be, a finding's kind; element: of which channel, body or joint
    coefficient  with its standard `error`
    """

    kind: str
    element: str
    coefficient: float
    error: float
    unexplained: float


def explanations(
    mechanism: Mechanism, terms: EquationTerms, least: float = EXPLAINS
) -> list[Finding]:
    """Findings that explain the residual of `terms`: one for all speeds, or one for each of them.

    They explain more than the share `least` of the squared residual, or all but the log's precision.
    """
    significant = terms.significant
    if not significant.any():
        return []
    r = terms.weighted(terms.residual)
    floor = _floor(terms)
    most = max(1.0 - least, min(floor, 1.0 - EXPLAINS))
    overall = sorted(_overall(terms, r), key=lambda fit: fit.unexplained)
    local = [
        min(_of_speed(mechanism, terms, int(k)), key=lambda fit: fit.unexplained, default=None)
        for k in np.flatnonzero(significant)
    ]
    left = _left_by(local, r, np.flatnonzero(significant))
    best = overall[0].unexplained if overall else 1.0
    if best < most and best <= max(4.0 * left, floor):
        ties = [f for f in overall if f.unexplained <= max(4.0 * best, floor)]
        ties.sort(key=lambda fit: PREFERENCE.index(fit.kind))
        return [_finding(ties[0], ties[1:], terms)]
    return [_finding(f, [], terms) for f in local if f and f.unexplained < most]


def _floor(terms: EquationTerms) -> float:
    """The share of the squared residual that precision alone leaves, with room."""
    precision = terms.weighted(CLEAR * terms.precision)
    size = terms.weighted(terms.size)
    return float(np.sum(precision**2) / np.sum(size**2))


def _left_by(local: Sequence[Fit | None], r: Array, places: NDArray[np.intp]) -> float:
    """The share of the squared residual that the best candidates of each speed leave together."""
    squares = np.sum(r**2, axis=0)
    for fit, k in zip(local, places):
        if fit is not None:
            squares[k] *= fit.unexplained
    return float(squares.sum() / np.sum(r**2))


def _fit(kind: str, element: str, x: Array, r: Array) -> Fit | None:
    """Least squares of r + c x ≈ 0; None where x vanishes."""
    xx = float(np.sum(x * x))
    if xx <= 1e-24 * max(1.0, float(np.sum(r * r))):
        return None
    c = -float(np.sum(x * r)) / xx
    rest = float(np.sum((r + c * x) ** 2))
    error = float(np.sqrt(rest / max(1, r.shape[0] - 1) / xx))
    return Fit(kind, element, c, error, rest / float(np.sum(r * r)))


# --- candidates for all speeds --------------------------------------------------------------------


def _overall(terms: EquationTerms, r: Array) -> Iterable[Fit]:
    evaluator = terms.evaluator
    samples = Sampled(terms.t, terms.q, terms.u, terms.udot, _logged(terms))
    names = list(terms.forces)
    bodies = evaluator.body_terms(samples)
    whole = np.sum([x for (what, _), x in bodies.items() if what == "all"], axis=0)
    candidates = [
        *((_channel_kind(n), n, terms.forces[n]) for n in names),
        ("mass-scale", "all bodies", whole),
        *(
            (f"body-{'inertia' if what == 'all' else 'mass'}", body, x)
            for (what, body), x in bodies.items()
        ),
    ]
    projected = evaluator.projected(samples, [x for _, _, x in candidates])
    for (kind, element, _), x in zip(candidates, projected):
        fit = _fit(kind, element, terms.weighted(x), r)
        if fit is not None and (kind not in MASSES or 0.1 < 1.0 + fit.coefficient < 10.0):
            yield fit


def _logged(terms: EquationTerms) -> Array:
    log = terms.evaluator.log
    return np.zeros((len(terms.t), log.size))  # body terms do not depend on logged forces


def _channel_kind(name: str) -> str:
    kind = name.partition(" ")[0]
    return {"gravity": "gravity", "actuator": "actuator-gear"}.get(kind, "channel-factor")


# --- candidates for one speed ---------------------------------------------------------------------


def _of_speed(mechanism: Mechanism, terms: EquationTerms, k: int) -> Iterable[Fit]:
    """What may be missing on one joint with a single speed: damper, dry friction, spring, rotor."""
    entry = mechanism.speeds[terms.speeds[k]]
    if len(mechanism.joint(entry.joint).speeds) != 1:
        return
    r = terms.residual[:, k : k + 1]
    u, udot = terms.u[:, k : k + 1], terms.udot[:, k : k + 1]
    free = [int(i) for i in mechanism.free.q]
    q = terms.q[:, free.index(mechanism.coordinates.of(entry.joint).start), None]
    for kind, x in (
        ("missing-damper", -u),
        ("missing-friction", -np.sign(u)),
        ("missing-rotor-inertia", -udot),
        ("missing-spring", -q),
        ("constant-force", np.ones_like(u)),
    ):
        fit = _fit(kind, entry.joint, x, r)
        if fit is not None and (fit.coefficient > 0.0 or kind == "constant-force"):
            yield fit


# --- words ----------------------------------------------------------------------------------------

_UNITS = {
    "missing-damper": "N·m·s/rad (or N·s/m)",
    "missing-friction": "N·m (or N)",
    "missing-rotor-inertia": "kg·m² (or kg)",
    "missing-spring": "N·m/rad (or N/m)",
    "constant-force": "N·m (or N)",
}


def _finding(fit: Fit, ties: Sequence[Fit], terms: EquationTerms) -> Finding:
    what, value = _words(fit, terms)
    evidence = (
        f"explains {_percent(1.0 - fit.unexplained)} of what is left of the equations of motion"
    )
    if ties:
        evidence += "; explained as well by: " + "; ".join(_words(t, terms)[0] for t in ties[:3])
    return Finding(fit.kind, what, evidence, _remedy(fit), "cause", fit.element, value, fit.error)


def _words(fit: Fit, terms: EquationTerms) -> tuple[str, float]:
    """The finding's sentence and number: a factor for what exists, a coefficient for what is missing."""
    factor = 1.0 + fit.coefficient
    shown = f"{factor:.6g} ± {fit.error:.1g}"
    if fit.kind == "gravity":
        g = float(np.linalg.norm([float(x) for x in _gravity(terms)]))
        return (
            f"the motion is one under {shown} times the model's gravity: {g * factor:.6g} m/s² "
            f"instead of {g:.6g} m/s²",
            factor,
        )
    if fit.kind in ("actuator-gear", "channel-factor"):
        origin = "logged" if fit.element in terms.evaluator.log.places else "computed"
        gear = " (gear, unit or scale of the actuator)" if fit.kind == "actuator-gear" else ""
        return f"the {origin} force of {fit.element!r} must be {shown} times as large{gear}", factor
    if fit.kind == "mass-scale":
        return f"all masses and inertias must be {shown} times those of the model", factor
    if fit.kind == "body-inertia":
        return f"mass and inertia of body {fit.element!r} must be {shown} times the model's", factor
    if fit.kind == "body-mass":
        return f"the mass of body {fit.element!r} must be {shown} times the model's", factor
    thing = {
        "missing-damper": "a damper acts",
        "missing-friction": "dry friction acts",
        "missing-rotor-inertia": "a rotor inertia acts",
        "missing-spring": "a spring acts",
        "constant-force": "a constant force acts",
    }[fit.kind]
    return (
        f"{thing} on joint {fit.element!r} that is neither in the model nor in the log: "
        f"{fit.coefficient:.5g} ± {fit.error:.1g} {_UNITS[fit.kind]}",
        fit.coefficient,
    )


def _gravity(terms: EquationTerms) -> Sequence[float]:
    mechanism = terms.evaluator.mechanism
    return [mechanism.number(x) for x in mechanism.gravity]


def _remedy(fit: Fit) -> str:
    if fit.kind == "gravity":
        return "Give model and simulator the same gravity"
    if fit.kind == "actuator-gear":
        return "Check the gear ratio and the unit of this actuator's logged force"
    if fit.kind == "channel-factor":
        return "Check this element's parameters in the model, or the unit of its logged force"
    if fit.kind in MASSES:
        return "Check masses and inertias of the model against those that the simulator used"
    return "Add it to the model, or log its force"


def _percent(share: float) -> str:
    return "all but 1e-6" if share > 1 - 1e-6 else f"{100 * share:.4g} %"
