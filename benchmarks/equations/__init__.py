"""Right equations of motion, written by hand, and the models that they belong to."""

from __future__ import annotations

from typing import Any

CASES = (
    "triple_pendulum",
    "double_pendulum",
    "two_link_arm",
    "elastic_pendulum",
    "spherical_pendulum",
    "heavy_top",
    "chaplygin_sleigh",
)

DAMPING = (0.1, 0.08, 0.05)


def load(case: str) -> tuple[Any, Any]:
    """A case's mechanism and the coordinates of its equations (None: the mechanism's own)."""
    from deltac import problems
    from deltac.mechanism.coordinate_map import absolute_angles
    from deltac.problems import triple_pendulum

    if case == "triple_pendulum":
        mechanism = triple_pendulum.problem(damping=DAMPING).mechanism
    elif case == "heavy_top":
        mechanism = _top()
    elif case == "two_link_arm":
        return _arm()
    else:
        mechanism = problems.load(case.replace("_", "-")).mechanism
    pendulum = case in ("triple_pendulum", "double_pendulum")
    return mechanism, absolute_angles(mechanism) if pendulum else None


def _top() -> Any:
    """A heavy body on a fixed tip, without symmetry: one with two equal moments hides mistakes."""
    import deltac as dc

    return dc.Mechanism(
        bodies=[dc.body("top", "m", ("Jx", "Jy", "Jz"), (0.0, "h", 0.0))],
        joints=[dc.joints.spherical("tip", "ground", "top")],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": 15.0, "g": 9.81, "h": 0.8, "Jx": 0.3, "Jy": 0.47, "Jz": 0.39},
        name="heavy body on a tip",
    )


def _arm() -> Any:
    """Two rods with dampers, a spring at the elbow; angles from the vertical."""
    import deltac as dc

    arm = dc.Mechanism(
        bodies=[dc.rod("upper", "m1", "l1", along="-y"), dc.rod("lower", "m2", "l2", along="-y")],
        joints=[
            dc.revolute("a", "ground", "upper", damping="c1"),
            dc.revolute("b", "upper", "lower", position=(0, "-l1", 0), damping="c2", stiffness="k"),
        ],
        gravity=(0, "-g", 0),
        parameters=dict(m1=1.3, m2=0.7, l1=0.6, l2=0.45, g=9.81, c1=0.11, c2=0.07, k=2.3),
        name="two-link arm",
    )
    return arm, dc.CoordinateMap(("a", "b"), q={"a": "q.a", "b": "q.b - q.a"})
