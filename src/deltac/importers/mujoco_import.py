"""MJCF, URDF and MuJoCo models as mechanisms: `read_mechanism`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from deltac.errors import InputError
from deltac.importers.equalities import read_equalities
from deltac.importers.motors import motor_strengths
from deltac.importers.mujoco_model import load_model
from deltac.importers.passive import Findings, disabled, read_passive, total_armature
from deltac.importers.report import ImportReport, Remark
from deltac.importers.tree import read_tree
from deltac.importers.unmodelled import report_unmodelled
from deltac.mechanism.mechanism import NO_GRAVITY, Mechanism
from deltac.mechanism.quantities import vector


def read_mechanism(
    source: Any, *, equality: str = "log", base: str = "fixed"
) -> tuple[Mechanism, ImportReport]:
    """The mechanism of an MJCF or URDF file, a `mujoco.MjModel` or a `mujoco.MjSpec`, and a report.

    Coordinates and speeds are MuJoCo's qpos and qvel, in order and convention; nameless elements are
    called ``joint<i>``, ``body<i>``, …; the world is ``"ground"``. Inertias are those that MuJoCo compiled,
    armatures of actuators included. Forces that have no counterpart (contacts, limits, dry friction,
    actuators, fluid) are named in the report with the channel that a log supplies them in.

    Args:
        source: path of an ``.xml`` or ``.urdf`` file, or a model or spec in memory.
        equality: "log": forces of equality constraints come from the log, because they are soft in
            MuJoCo; "constraints": connect, weld and joint equalities become exact constraints.
        base: "fixed" or "free", for the root link of a URDF file.

    Raises:
        InputError: MuJoCo is not installed, the file is missing or does not compile, or an argument
            is not known.
    """
    if equality not in ("log", "constraints"):
        raise InputError(f"equality: expected 'log' or 'constraints', found {equality!r}")
    model, name, assumed = load_model(source, base)
    found = Findings(assumed=assumed)
    tree = read_tree(model, total_armature(model))
    found.ignored.extend(tree.remarks)
    found.read.insert(0, _counts(len(tree.bodies), tree.joints))
    read_passive(model, found)
    constraints = read_equalities(model, equality == "constraints", found)
    report_unmodelled(model, found)
    weightless = disabled(model, "GRAVITY")
    if weightless:
        found.assumed.append(Remark("option", "gravity is switched off"))
    mechanism = Mechanism(
        tree.bodies,
        tree.joints,
        found.forces,
        constraints,
        gravity=NO_GRAVITY if weightless else vector(model.opt.gravity, "gravity"),
        name=_model_name(model, name),
    )
    report = ImportReport(
        name,
        tuple(found.read),
        tuple(found.ignored),
        tuple(found.assumed),
        tuple(found.equalities),
        motor_strengths(model),
    )
    return mechanism, report


def _counts(bodies: int, joints: Sequence[Any]) -> Remark:
    moving = sum(bool(joint.speeds) for joint in joints)
    speeds = sum(len(joint.speeds) for joint in joints)
    return Remark("tree", f"{bodies} bodies and frames, {moving} moving joints, {speeds} speeds")


def _model_name(model: Any, source: str) -> str:
    """The name the model gives itself, the first of its names."""
    given = bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace")
    return given if given and given != "MuJoCo Model" else source
