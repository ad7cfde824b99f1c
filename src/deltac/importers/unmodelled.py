"""What a MuJoCo model has that a mechanism has not: named, with the channel its force must come from."""

from __future__ import annotations

from typing import Any

import numpy as np

from deltac.importers.names import (
    actuator_names,
    body_names,
    joint_names,
    tendon_names,
)
from deltac.importers.passive import Findings, disabled
from deltac.importers.report import Remark


def report_unmodelled(model: Any, found: Findings) -> None:
    """Everything else in the model that moves energy, into `found`."""
    for name in actuator_names(model):
        found.ignored.append(_logged(name, "actuator", f"actuator {name}"))
    _of_joints_and_tendons(model, found)
    _contacts(model, found)
    if model.opt.density or model.opt.viscosity:
        what = f"fluid of density {model.opt.density:g}, viscosity {model.opt.viscosity:g}"
        found.ignored.append(_logged("option", what, "applied fluid"))
    for k in range(model.nflex):
        name = model.flex(k).name or f"flex{k}"
        found.ignored.append(
            _logged(name, "deformable; its vertices are read as bodies", f"applied {name}")
        )
    if model.nplugin:
        found.ignored.append(
            _logged(
                "plugins", f"{model.nplugin} plugins with forces of their own", "applied plugins"
            )
        )
    for i, name in enumerate(body_names(model)):
        if model.body_mocapid[i] >= 0:
            found.assumed.append(
                Remark(
                    name,
                    "mocap body, taken as fixed where the model puts it",
                    "if it was moved in the run, what it does through constraints shows in their channels",
                )
            )


def _of_joints_and_tendons(model: Any, found: Findings) -> None:
    for j, name in enumerate(joint_names(model)):
        dofs = np.flatnonzero(np.asarray(model.dof_jntid) == j)
        if np.asarray(model.dof_frictionloss)[dofs].any():
            found.ignored.append(_logged(name, "dry friction", f"friction {name}"))
        if model.jnt_limited[j]:
            found.ignored.append(_logged(name, "limits", f"limit {name}"))
    for k, name in enumerate(tendon_names(model)):
        if model.tendon_frictionloss[k]:
            found.ignored.append(_logged(name, "dry friction", f"friction {name}"))
        if model.tendon_limited[k]:
            found.ignored.append(_logged(name, "limits", f"limit {name}"))


def _contacts(model: Any, found: Findings) -> None:
    off = disabled(model, "CONTACT") or disabled(model, "CONSTRAINT")
    colliding = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    if not off and (colliding.sum() > 1 or model.npair):
        what = f"contact of {int(colliding.sum())} geoms"
        found.ignored.append(_logged("geoms", what, "contact <geom1>:<geom2>"))


def _logged(element: str, what: str, channel: str) -> Remark:
    return Remark(element, what, f"its force must come from the log: channel '{channel}'")
