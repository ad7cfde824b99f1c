"""Equality constraints of a MuJoCo model as constraints of a mechanism.

MuJoCo's are soft: they give way under load and do work. Ours are exact, so that reading them as
constraints is for models rather than for logs, whose equality forces are channels of their own.
"""

from __future__ import annotations

from typing import Any

from deltac.constraints import holonomic, loop_spherical, loop_weld
from deltac.importers.names import body_names, equality_names, joint_names
from deltac.importers.passive import Findings
from deltac.importers.report import Remark
from deltac.importers.tree import turned
from deltac.laws import q
from deltac.mechanism.scene import Constraint


def read_equalities(model: Any, as_constraints: bool, findings: Findings) -> tuple[Constraint, ...]:
    """Constraints for connect, weld and joint equalities if wanted; the others go into `findings`."""
    constraints: list[Constraint] = []
    for e, name in enumerate(equality_names(model)):
        if not model.eq_active0[e]:
            findings.ignored.append(Remark(name, "equality, not active at the start"))
            continue
        constraint = _constraint(model, e, name)
        if constraint is not None and as_constraints:
            constraints.append(constraint)
            findings.read.append(Remark(name, "equality, as an exact constraint"))
            findings.assumed.append(
                Remark(
                    name,
                    "the equality is exact",
                    "MuJoCo's is soft: a log violates it and does work",
                )
            )
        else:
            findings.equalities += [constraint] if constraint is not None else []
            findings.ignored.append(
                Remark.logged(name, "equality, soft in MuJoCo", f"constraint {name}")
            )
    return tuple(constraints)


def _constraint(model: Any, e: int, name: str) -> Constraint | None:
    import mujoco

    kinds, data = mujoco.mjtEq, [float(x) for x in model.eq_data[e]]
    match int(model.eq_type[e]):
        case kinds.mjEQ_CONNECT:
            if int(model.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
                return loop_spherical(name, **_sites(model, e)[0])
            return loop_spherical(name, **_bodies(model, e), point1=data[:3], point2=data[3:6])
        case kinds.mjEQ_WELD:
            if int(model.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
                placed, relative = _sites(model, e)
                return loop_weld(name, **placed, rotation=relative)
            return loop_weld(
                name,
                **_bodies(model, e),
                point1=data[3:6],
                point2=data[:3],
                rotation=turned(data[6:10]),
            )
        case kinds.mjEQ_JOINT:
            return holonomic(name, _polynomial_of_joints(model, e, data))
    return None


def _bodies(model: Any, e: int) -> dict[str, Any]:
    names = body_names(model)
    return {"body1": names[model.eq_obj1id[e]], "body2": names[model.eq_obj2id[e]]}


def _sites(model: Any, e: int) -> tuple[dict[str, Any], Any]:
    """Bodies and points of two sites, and the second body's axes in the first when the sites align."""
    one, other = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
    names = body_names(model)
    placed = {
        "body1": names[model.site_bodyid[one]],
        "body2": names[model.site_bodyid[other]],
        "point1": model.site_pos[one],
        "point2": model.site_pos[other],
    }
    return placed, turned(model.site_quat[one]) @ turned(model.site_quat[other]).T


def _polynomial_of_joints(model: Any, e: int, a: Any) -> Any:
    """(y − y0) − Σ aₙ (x − x0)ⁿ, or y − y0 − a₀ without a second joint."""
    names = joint_names(model)
    one, other = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])

    def moved(joint: int) -> Any:
        return q(names[joint]) - float(model.qpos0[model.jnt_qposadr[joint]])

    if other < 0:
        return moved(one) - float(a[0])
    return moved(one) - sum(float(c) * moved(other) ** n for n, c in enumerate(a[:5]))
