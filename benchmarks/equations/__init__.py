"""Right equations of motion, written by hand, and the models that they belong to."""

from __future__ import annotations

from typing import Any

CASES = (
    "triple_pendulum",
    "double_pendulum",
    "elastic_pendulum",
    "spherical_pendulum",
    "heavy_top",
    "chaplygin_sleigh",
)

DAMPING = (0.1, 0.08, 0.05)


def load(case: str) -> tuple[Any, Any]:
    """A case's mechanism and the coordinates of its equations (None: the mechanism's own)."""
    from deltac import problems
    from deltac.mechanism.absolute import absolute_angles
    from deltac.problems import triple_pendulum

    if case == "triple_pendulum":
        mechanism = triple_pendulum.problem(damping=DAMPING).mechanism
    else:
        mechanism = problems.load(case.replace("_", "-")).mechanism
    pendulum = case in ("triple_pendulum", "double_pendulum")
    return mechanism, absolute_angles(mechanism) if pendulum else None
