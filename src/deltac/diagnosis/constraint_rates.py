"""Constraints on acceleration level, ψ̇ = G u̇ + γ = 0, at the samples of a log.

Projections after each step mend what wrong equations do across the constraints: states and energies
then look right. The accelerations still tell. Kane's equations do not: their multipliers take up every error
along Gᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equations import CLEAR, LEAST, EquationTerms, Evaluator, Sampled
from deltac.diagnosis.resolution import EPS, resolution
from deltac.dynamics.spatial import SX
from deltac.trajectories import Trajectory

Array: TypeAlias = NDArray[np.float64]


STIFFEST = 3.0
"""Largest rate of decay, times the step, that a stabilisation may have: explicit methods stand no more."""


@dataclass(frozen=True, eq=False)
class ConstraintRates:
    """What accelerations leave of ψ̇ = G u̇ + γ = 0, in m/s² or rad/s²: the n independent rows (n,).

    Attributes:
        names: the constraint of each row.
        size: root mean square of ψ̇ over the samples.
        scale: the same of the sum of its absolute terms.
        precision: what of it the digits of the log explain.
        restoring: what a stabilisation may have asked for.
    """

    names: tuple[str, ...]
    size: Array
    scale: Array
    precision: Array
    restoring: Array

    @property
    def relative(self) -> dict[str, float]:
        """ψ̇ of each constraint as a share of its terms; 0 where digits or a stabilisation explain it."""
        clear = (self.size > CLEAR * self.precision + self.restoring) & (
            self.size > LEAST * self.scale
        )
        share = np.divide(self.size, self.scale, out=np.zeros_like(self.size), where=clear)
        return {
            name: max(float(x) for x, owner in zip(share, self.names) if owner == name)
            for name in dict.fromkeys(self.names)
        }


def constraint_rates(terms: EquationTerms, run: Trajectory) -> ConstraintRates | None:
    """ψ̇ at the samples of a run with u̇, of which `terms` are the equations; None without constraints.

    Baumgarte's stabilisation asks for ψ̇ = −2αψ − β²φ in place of zero, and soft constraints likewise. Their
    α and β are not known, but at a step h they are `STIFFEST`/h at most.
    """
    bound = terms.evaluator.symbols.constrained
    if bound is None or len(run) < 2:
        return None
    rows, evaluator = bound.rows, terms.evaluator
    udot, u = evaluator.symbols.system.udot, evaluator.symbols.system.u
    outputs = {
        "rate": rows.gamma + ca.mtimes(rows.G, udot),
        "terms": ca.fabs(rows.gamma) + ca.mtimes(ca.fabs(rows.G), ca.fabs(udot)),
        "moved": ca.mtimes(ca.fabs(rows.G), ca.fabs(u)),
        "psi": rows.psi,
        "phi": rows.phi,
    }
    logged = np.zeros((len(terms.t), evaluator.log.size))
    samples = Sampled(terms.t, terms.q, terms.u, terms.udot, logged)
    rate, size, moved, psi, phi = evaluator.evaluate(outputs, samples)
    scale = _rms(size) + _rms(moved) / float(np.ptp(run.t))
    # What a row has no terms of, such as the height of a ball on a table, has no size of its own.
    scale = np.maximum(scale, LEAST * scale.max())
    rate_of_decay = STIFFEST / (run.provenance.step or float(np.median(np.diff(run.t))))
    return ConstraintRates(
        rows.names,
        _rms(rate),
        scale,
        _digits(evaluator, outputs["rate"], samples, rate) + 4.0 * EPS * scale,
        _rms(2.0 * rate_of_decay * np.abs(psi) + rate_of_decay**2 * np.abs(phi)),
    )


def _digits(evaluator: Evaluator, rate: SX, samples: Sampled, known: Array) -> Array:
    """How much ψ̇ moves when every number of the log moves by half its last digit."""
    rng = np.random.default_rng(0)
    moved = {}
    for name in ("q", "u", "udot"):
        values = getattr(samples, name)
        moved[name] = values + rng.uniform(-1, 1, values.shape) * resolution(values)
    (other,) = evaluator.evaluate({"rate": rate}, replace(samples, **moved))
    return _rms(other - known)


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
