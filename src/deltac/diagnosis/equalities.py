"""Equality constraints whose force the log does not hold: does what is missing point along their rows?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equations import EquationTerms
from deltac.diagnosis.findings import Finding
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.mechanism.constraints import Constraint
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.importers import ImportReport

Array: TypeAlias = NDArray[np.float64]

LEFT = 1e-6
"""Share of the squared residual that forces along the rows may leave."""

RANK = 1e-9


def withheld_equalities(
    mechanism: Mechanism, run: Trajectory, terms: EquationTerms, import_report: ImportReport | None
) -> tuple[list[Finding], list[Finding]]:
    """Findings (certain, possible) of equalities left to the log that would explain the residual.

    A force of constraint is Gᵀλ. Where the rows G span all speeds anything is such a force, and the
    finding is a mere possibility.
    """
    if import_report is None or not terms.significant.any():
        return [], []
    absent = [c for c in import_report.equalities if f"constraint {c.name}" not in run.forces]
    groups = [[c] for c in absent] + ([absent] if len(absent) > 1 else [])
    for group in groups:
        G = _jacobians(mechanism, group, terms)
        if G is None:
            continue
        left, rank = _unexplained(G, terms)
        if left <= LEFT:
            found = [_finding(c, left, len(group)) for c in group]
            return (found, []) if rank < len(terms.speeds) else ([], found)
    return [], []


def _jacobians(
    mechanism: Mechanism, constraints: Sequence[Constraint], terms: EquationTerms
) -> Array | None:
    """G (T, rows, n) at the samples; None where the model cannot have these constraints."""
    try:
        tied = replace(mechanism, constraints=(*mechanism.constraints, *constraints))
    except InputError:
        return None
    motion = equations_of_motion(tied)
    system, rows = motion.system, motion.rows
    names = {c.name for c in constraints}
    G = rows.G[[k for k, name in enumerate(rows.names) if name in names], :]
    function = ca.Function("G", [system.t, system.q], [ca.densify(ca.vec(G.T))])
    values = np.array(function.map(len(terms.t))(terms.t[None, :], terms.q.T)).T
    return values.reshape(len(terms.t), G.shape[0], G.shape[1])


def _unexplained(G: Array, terms: EquationTerms) -> tuple[float, int]:
    """Share of the squared residual that no forces along G explain, and the rank of G."""
    weight = np.divide(1.0, terms.scale, out=np.zeros_like(terms.scale), where=terms.scale > 0)
    r = terms.weighted(terms.residual)
    U, singular, _ = np.linalg.svd(np.swapaxes(G * weight, 1, 2), full_matrices=False)
    real = singular > RANK * singular.max(initial=0.0)
    U = U * real[:, None, :]
    along = np.einsum("tij,tj->ti", U, np.einsum("tij,ti->tj", U, r))
    share = float(np.sum((r - along) ** 2) / np.sum(r**2))
    return share, int(real.sum(axis=1).max(initial=0))


def _finding(constraint: Constraint, left: float, together: int) -> Finding:
    name = constraint.name
    return Finding(
        "missing-equality",
        f"the force of equality constraint {name!r} is missing: the model's file has it, the log does not",
        f"forces along its Jacobian{' and the others' if together > 1 else ''} explain all but {left:.1g} "
        "of the squared residual of the equations of motion",
        f"Log its force in channel 'constraint {name}', or read the model with equality=\"constraints\"",
        "cause",
        f"constraint {name}",
    )
