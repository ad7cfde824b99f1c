"""Mass, mass centre and central inertia of a body in its link frame."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.causes.columns import UNIT_MOMENTS
from deltac.dynamics.system import Link


@dataclass(frozen=True, eq=False)
class BodyMass:
    """Numbers of a body: mass, mass centre and central inertia in the link frame, E: link to body."""

    name: str
    mass: float
    centre: Array
    central: Array
    E: Array

    @staticmethod
    def of(link: Link) -> BodyMass:
        """Those of a link."""
        mass = float(ca.evalf(ca.SX(link.mass)))
        centre = np.array(ca.evalf(link.centre)).ravel()
        J = np.array(ca.evalf(ca.densify(ca.SX(link.inertia.J))))
        central = J - mass * steiner(centre)
        E = np.array(ca.evalf(ca.densify(link.to_body.E)))
        return BodyMass(link.joint.child, mass, centre, central, E)


def steiner(c: Array) -> Array:
    """|c|² 1 − c cᵀ: the moments of inertia of a unit mass at c."""
    return np.asarray(float(c @ c) * np.eye(3) - np.outer(c, c))


def six(J: Array) -> list[float]:
    """Moments and products of inertia, in the order of a body's columns."""
    return [float(J[i, j]) for i, j in UNIT_MOMENTS]
