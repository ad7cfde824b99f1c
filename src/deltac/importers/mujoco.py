"""From a file or an object to a compiled MuJoCo model; MuJoCo's own parser reads MJCF and URDF."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.calls.arguments import checked
from deltac.constraints import holonomic, loop_spherical, loop_weld
from deltac.errors import FileError, InputError, ModelError, WrongType, requirement, shown
from deltac.foreign.files import read_bytes
from deltac.foreign.isolation import INSIDE, more_memory
from deltac.foreign.limits import Limits, free_memory
from deltac.importers.files import BASE_KINDS, with_base
from deltac.importers.names import (
    actuator_names,
    body_names,
    equality_names,
    geom_names,
    joint_names,
    model_name,
    motor_strengths,
    servo_damping,
    sole_actuators,
    tendon_names,
)
from deltac.importers.passive import disabled, read_passive, total_armature
from deltac.importers.report import Findings, ImportReport, Remark
from deltac.importers.sdf import read_sdf
from deltac.importers.tree import read_tree, turned
from deltac.importers.urdf import Urdf, read_urdf, transmissions
from deltac.laws import q
from deltac.mechanism import (
    GROUND,
    NO_GRAVITY,
    Constraint,
    Mechanism,
    State,
    VisualKind,
    as_rotation,
    vector,
)
from deltac.shapes import Visual

if TYPE_CHECKING:
    from mujoco import MjModel, MjSpec


def require_mujoco() -> Any:
    """The module mujoco; InputError with the remedy where it is not installed."""
    with requirement('reading MJCF and URDF needs MuJoCo: pip install "deltac[mujoco]"'):
        import mujoco
    return mujoco


def load_model(source: Any, base: str = "fixed") -> tuple[Any, str, list[Remark], Urdf | None]:
    """The compiled model of a path, `MjModel` or `MjSpec`, what to call it, and what was assumed.

    Last comes the URDF file, whose links and floating joints take the place of the model's.

    `base` = "free" puts a free joint under the root link of a URDF file, which else stands still; so does a
    path ``FILE.urdf:free``.

    Raises InputError for a file that is missing or of an unknown kind, with MuJoCo's own words for one
    that it cannot compile, and for any other source.
    """
    mujoco = require_mujoco()
    if base not in BASE_KINDS:
        raise InputError(f"base: expected 'fixed' or 'free', found {base!r}")
    if isinstance(source, mujoco.MjModel):
        return source, "an MjModel", [], None
    if isinstance(source, mujoco.MjSpec):
        return _compiled(source.copy(), "the MjSpec"), "an MjSpec", [], None
    if not isinstance(source, str | Path):
        raise WrongType(
            f"model: found {type(source).__name__}, expected the path of an .xml or .urdf file, "
            "a mujoco.MjModel or a mujoco.MjSpec"
        )
    path, root = with_base(source)
    base = root or base
    if not os.path.isfile(path):
        raise FileError(f"model file {str(path)!r} does not exist; check the path")
    if path.suffix.lower() == ".urdf":
        model, assumed, urdf = _urdf(mujoco, path, base)
        return model, path.name, assumed, urdf
    if path.suffix.lower() not in (".xml", ".mjcf"):
        raise ModelError(f"model file {path.name!r}: expected .xml (MJCF) or .urdf")
    _try_apart(path)
    try:
        with quiet(mujoco), more_memory(free_memory() or 2**62) if INSIDE else nullcontext():
            return mujoco.MjModel.from_xml_path(str(path)), path.name, [], None
    except MemoryError:
        raise ModelError(f"model file {path.name!r} does not fit into memory") from None
    except ValueError as error:
        raise ModelError(_refused(path.name, error)) from None


def _urdf(mujoco: Any, path: Path, base: str) -> tuple[Any, list[Remark], Urdf | None]:
    """The compiled tree of a URDF file, what was assumed, and the file itself.

    The model has the file's own inertias where MuJoCo takes them, and placeholders where it does not.
    """
    urdf = read_urdf(path)
    assumed = list(urdf.remarks)
    # Meshes are often out of reach (package://…), and MuJoCo is strict about inertias.
    refused = ""
    for shapes, placeholders in ((True, False), (True, True), (False, False), (False, True)):
        try:
            with quiet(mujoco):
                spec = _tree(mujoco, urdf, placeholders and bool(urdf.links), shapes, path, base)
                model = spec.compile()
            break
        except ValueError as error:
            problem = _refused(path.name, error)
            refused = refused if placeholders else problem
    else:
        raise ModelError(problem)
    if not shapes:
        assumed.append(
            Remark(
                path.name,
                "meshes cannot be opened, so all shapes were left out",
                "contact forces must come from the log",
            )
        )
    if base == "free":
        assumed.append(Remark("base", "the root link floats: a free joint was put under it"))
    else:
        assumed.append(
            Remark(
                "base",
                "the root link stands on the ground",
                f"for a robot that moves about, write {path.name}:free, or base='free' in Python",
            )
        )
    return model, assumed, replace(urdf, refused=refused if placeholders else "")


def _try_apart(path: Path) -> None:
    """Compile a file that may be large in a process of its own first, bounded in time and memory.

    A few lines can ask for millions of bodies (<replicate>), and nothing stops MuJoCo once it compiles.

    In a worker process, which may die, it is compiled at once. Raises LimitError for a file that takes too
    long, ModelError for one that brings MuJoCo down.
    """
    if INSIDE:
        return
    limits = Limits.current()
    text = read_bytes(path, "model").decode("utf-8", "replace")
    for name in _FILES.findall(text):
        named = os.path.join(path.parent, name)
        if os.path.exists(named) and not (os.path.isfile(named) or os.path.isdir(named)):
            raise FileError(
                f"model file {path.name!r} names {shown(name)}, which is not a regular file"
            )
    counts = (float(n) for entry in _COUNTS.findall(text) for n in _COUNTED.findall(entry))
    if len(text) < _PLAIN and max(counts, default=0.0) <= _LARGE_MODEL and "<include" not in text:
        return
    code = (
        "import sys, mujoco\n"
        "try:\n    import resource\n    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)\n"
        "except (ImportError, ValueError, OSError): pass\n"
        "try: mujoco.MjModel.from_xml_path(sys.argv[1])\n"
        "except ValueError: pass\n"  # said in the process of the caller
        "except MemoryError: sys.exit(3)\n"
    )
    memory = free_memory() or 2**62
    try:
        process = subprocess.run(
            # -P: the model's folder is not searched for modules.
            [sys.executable, "-P", "-c", code, str(path.absolute()), str(int(memory))],
            capture_output=True,
            timeout=limits.seconds,
            cwd=path.parent,
            check=False,
        )
    except subprocess.TimeoutExpired:
        limits.refuse(
            "seconds", f"model file {path.name!r} takes {limits.seconds} s to compile and"
        )
    if process.returncode < 0 or process.returncode == 3:
        raise ModelError(
            f"model file {path.name!r} crashes MuJoCo, or does not fit into {memory / 1e9:.1f} GB"
        )


_FILES = re.compile(r"""\bfile\s*=\s*["']([^"']*)["']""")
_COUNTED = re.compile(r"\d+(?:\.\d+)?(?:[eE]\+?\d+)?", re.ASCII)
_PLAIN, _LARGE_MODEL = 2**20, 500.0  # bytes of a file, and of its largest count
_COUNTS = re.compile(r"""\b(?:count|nrow|ncol|width|height|cellcount)\s*=\s*["']([^"']*)["']""")


def simulated_model(path: str | Path, base: str = "fixed") -> Any:
    """The compiled model of an MJCF or URDF file, for MuJoCo to simulate.

    Raises InputError as `load_model`, and for a URDF file whose inertias or joints MuJoCo does not take.
    """
    model, _, _, urdf = load_model(path, base)
    if urdf is not None and urdf.refused:
        raise ModelError(f"{urdf.refused}; `read_mechanism` reads it, MuJoCo does not simulate it")
    if urdf is not None and urdf.floating:
        joint = next(iter(urdf.floating.values()))
        raise ModelError(f"{urdf.name}: MuJoCo does not simulate the floating joint {joint!r}")
    return model


def _tree(mujoco: Any, urdf: Urdf, placeholders: bool, shapes: bool, path: Path, base: str) -> Any:
    """A spec of the file whose links on fixed joints keep their names."""
    spec = mujoco.MjSpec.from_string(urdf.text(placeholders, shapes))
    spec.modelfiledir = str(path.parent)
    spec.compiler.fusestatic = False
    if urdf.links:
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    if base == "free":
        for root in spec.worldbody.bodies:
            if not root.joints:
                root.add_freejoint(name="base")
    return spec


@contextmanager
def quiet(mujoco: Any) -> Iterator[None]:
    """Without MuJoCo's remarks on standard output, and in a file MUJOCO_LOG.TXT where the program runs."""
    if not hasattr(mujoco, "MjLogConfig"):  # of older versions
        yield
        return
    before, quiet = mujoco.MjLogConfig.get(), mujoco.MjLogConfig()
    quiet.logto_console = quiet.logto_file = False
    quiet.set()
    try:
        yield
    finally:
        before.set()


def _compiled(spec: Any, name: str) -> Any:
    try:
        return spec.compile()
    except ValueError as error:
        raise ModelError(_refused(name, error)) from None


def _refused(name: str, error: Exception) -> str:
    return f"MuJoCo cannot compile {name}: {' '.join(str(error).split())}"


# --- what a MuJoCo model has that a mechanism has not --------------------------------------------


def report_unmodelled(model: Any, findings: Findings) -> None:
    """Everything else in the model that moves energy, into `findings`."""
    names, alone = actuator_names(model), sole_actuators(model)
    for name in names:
        # An actuator that is called as another one's joint has that channel.
        joint = alone.get(name, name)
        alias = "" if joint in names else f"actuator {joint}"
        findings.leave_to_log(name, "actuator", f"actuator {name}", alias=alias)
    _of_joints_and_tendons(model, findings)
    _contacts(model, findings)
    if model.opt.density or model.opt.viscosity:
        what = f"fluid of density {model.opt.density:g}, viscosity {model.opt.viscosity:g}"
        findings.leave_to_log("option", what, "applied fluid")
    for k in range(model.nflex):
        name = model.flex(k).name or f"flex{k}"
        findings.leave_to_log(
            name, "deformable; its vertices are read as bodies", f"applied {name}"
        )
    if model.nplugin:
        findings.leave_to_log(
            "plugins", f"{model.nplugin} plugins with forces of their own", "applied plugins"
        )
    for i, name in enumerate(body_names(model)):
        if model.body_mocapid[i] >= 0:
            findings.assume(
                name,
                "mocap body, taken as fixed where the model puts it",
                "if it was moved in the run, what it does through constraints shows in their channels",
            )


def _of_joints_and_tendons(model: Any, findings: Findings) -> None:
    has_friction, has_limits = (not disabled(model, what) for what in ("FRICTIONLOSS", "LIMIT"))
    for j, name in enumerate(joint_names(model)):
        dofs = np.flatnonzero(np.asarray(model.dof_jntid) == j)
        if has_friction and np.asarray(model.dof_frictionloss)[dofs].any():
            findings.leave_to_log(name, "dry friction", f"friction {name}")
        if has_limits and model.jnt_limited[j]:
            low, high = model.jnt_range[j] + (model.jnt_margin[j], -model.jnt_margin[j])
            limits = (float(low), float(high)) if len(dofs) == 1 else None
            findings.leave_to_log(name, "limits", f"limit {name}", limits)
    for k, name in enumerate(tendon_names(model)):
        if has_friction and model.tendon_frictionloss[k]:
            findings.leave_to_log(name, "dry friction", f"friction {name}")
        if has_limits and model.tendon_limited[k]:
            findings.leave_to_log(name, "limits", f"limit {name}")


def _contacts(model: Any, findings: Findings) -> None:
    colliding = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    if not disabled(model, "CONTACT") and (colliding.sum() > 1 or model.npair):
        what = f"contact of {int(colliding.sum())} geoms"
        findings.leave_to_log("geoms", what, "contact <geom1>:<geom2>")


# --- MJCF, URDF and MuJoCo models as mechanisms: `read_mechanism` --------------------------------


@checked
def read_mechanism(
    source: MjModel | MjSpec | str | Path, *, equality: str = "log", base: str = "fixed"
) -> tuple[Mechanism, ImportReport]:
    """The mechanism of an MJCF or URDF file, a `mujoco.MjModel` or a `mujoco.MjSpec`, and a report.

    Coordinates and speeds are MuJoCo's qpos and qvel, in order and convention; nameless elements are
    called ``joint<i>``, ``body<i>``, …; the world is ``"ground"``. Inertias are those that MuJoCo compiled,
    armatures of actuators included. Forces that have no counterpart (contacts, limits, dry friction,
    actuators, fluid) are named in the report with the channel that a log supplies them in.

    Read are

    - bodies, with their inertias as compiled: `body`; `frame` for those without mass
    - hinge, slide, ball and free joints: `revolute`, `prismatic`, `spherical`, `free`; a body without
      joints is `fixed`; several joints on a body become a chain with frames between
    - armature, of joints and of actuators on joints (gear² times): `armature`
    - stiffness and damping of joints, higher coefficients too, and damping of actuators on joints:
      `joint_spring`, `joint_damper`
    - tendons, fixed and spatial over sites and pulleys, with stiffness, damping and a band of rest lengths:
      `tendon`
    - gravcomp: `gravity_compensation`
    - connect, weld and joint equalities, with ``equality="constraints"``: `loop_spherical`, `loop_weld`,
      `holonomic`

    Not read are the following; a log supplies their forces, unless the model switches them off:

    - actuators, contacts, joint and tendon limits, dry friction, fluid, plugins, elasticity of flexes
    - equalities that are not read as constraints: by default all, else those of tendons and flexes
    - springs and dampers of tendons that wrap around geoms; springs that yield; springs of ball and free
      joints with a turned rest position or higher coefficients

    Geoms become shapes by `read_shapes`. Inertias of tendons, and of a body with neither mass nor a massive
    parent that it is fixed to, are left out: K is then too small. Equalities that are not active at the start
    are left out, and mocap bodies are taken as fixed. The report names each of these.

    Args:
        source: path of an ``.xml``, ``.urdf`` or ``.sdf`` file (``"FILE.sdf:NAME"`` for one of several
            models), or a model or spec in memory. Mimic joints of a URDF file are exact constraints.
            SDFormat is read without MuJoCo.
        equality: "log": forces of equality constraints come from the log, because they are soft in
            MuJoCo; "constraints": connect, weld and joint equalities become exact constraints.
        base: "fixed" or "free", for the root link of a URDF file.

    Raises:
        InputError: MuJoCo is not installed, the file is missing or does not compile, or an argument
            is not known.
    """
    if equality not in ("log", "constraints"):
        raise ModelError(f"equality: expected 'log' or 'constraints', found {equality!r}")
    if isinstance(source, str | Path):
        path, model_name = with_base(source)
        if path.suffix.lower() == ".sdf":
            return read_sdf(path, model_name)
    model, name, assumed, urdf = load_model(source, base)
    findings = Findings(assumed=assumed)
    tree = read_tree(model, total_armature(model), urdf)
    findings.ignored.extend(tree.remarks)
    findings.read.insert(0, _counts(len(tree.bodies), tree.joints))
    read_passive(model, findings)
    exact = (
        equality == "constraints" or urdf is not None
    )  # of URDF's mimic joints: gears, not springs
    constraints = read_equalities(model, exact, findings)
    report_unmodelled(model, findings)
    findings.ignored.extend(transmissions(urdf.document) if urdf is not None else ())
    weightless = disabled(model, "GRAVITY")
    if weightless:
        findings.assume("option", "gravity is switched off")
    mechanism = Mechanism(
        tree.bodies,
        tree.joints,
        findings.forces,
        constraints,
        gravity=NO_GRAVITY if weightless else vector(model.opt.gravity, "gravity"),
        name=_model_name(model, name),
        visuals=read_visuals(model),
    )
    starts = _starts(model, mechanism)
    report = findings.report(
        name, starts=starts, strengths=motor_strengths(model), servo_damping=servo_damping(model)
    )
    return mechanism, report


def _starts(model: Any, mechanism: Mechanism) -> dict[str, State]:
    """States at which the model may start: its keyframes, by name or as ``key<i>``, and "qpos0"."""
    if (model.nq, model.nv) != (len(mechanism.coordinates), len(mechanism.speeds)):
        return {}
    keys = {
        model.key(k).name or f"key{k}": (model.key_qpos[k], model.key_qvel[k], model.key_time[k])
        for k in range(model.nkey)
    }
    keys.setdefault("qpos0", (model.qpos0, np.zeros(model.nv), 0.0))
    return {name: mechanism.state(q, u, float(t)) for name, (q, u, t) in keys.items()}


def _counts(bodies: int, joints: Sequence[Any]) -> Remark:
    mobile = sum(bool(joint.speeds) for joint in joints)
    speeds = sum(len(joint.speeds) for joint in joints)
    return Remark("tree", f"{bodies} bodies and frames, {mobile} moving joints, {speeds} speeds")


def _model_name(model: Any, source: str) -> str:
    """The name the model gives itself."""
    text = model_name(model)
    return text if text and text != "MuJoCo Model" else source


# --- geoms of mujoco models as pictures of bodies: `read_visuals` --------------------------------


PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 0, 2, 3, 4, 5, 6, 7
"""Values of `mjtGeom`."""

FIRST_HIDDEN_GROUP = 3
"""Geoms of this group and above are not drawn by MuJoCo's viewer: they are there to collide."""


def read_visuals(model: Any) -> tuple[Visual, ...]:
    """What the bodies of a compiled `mujoco.MjModel` look like: the geoms that MuJoCo's viewer draws.

    Of a body whose geoms are all in the groups for collisions, these. Height fields and flexes are left out.
    """
    bodies, names = body_names(model), geom_names(model)
    visuals: list[Visual] = []
    for k, body in enumerate(bodies):
        own = [int(i) for i in np.flatnonzero(np.asarray(model.geom_bodyid) == k)]
        visible = [i for i in own if model.geom_group[i] < FIRST_HIDDEN_GROUP] or own
        visuals += [v for i in visible if (v := _visual(model, i, body, names[i])) is not None]
    return tuple(visuals)


def _visual(model: Any, i: int, body: str, name: str) -> Visual | None:
    material = int(model.geom_matid[i])
    r, g, b, opacity = (
        float(x) for x in (model.mat_rgba[material] if material >= 0 else model.geom_rgba[i])
    )
    kind = int(model.geom_type[i])
    if kind not in _SIZES or opacity == 0.0 or (kind == PLANE and body != GROUND):
        return None
    x, y, z = (float(v) for v in model.geom_pos[i])
    shape, sizes = _SIZES[kind]
    vertices = faces = None
    if kind == MESH:
        mesh = int(model.geom_dataid[i])
        if mesh < 0:
            return None
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = np.array(model.mesh_face[first : first + count], dtype=np.intp)
    return Visual(
        body,
        shape,
        tuple(factor * float(model.geom_size[i][axis]) for axis, factor in sizes),
        (x, y, z),
        as_rotation([float(v) for v in model.geom_quat[i]], f"geom {name}"),
        (r, g, b, opacity),
        vertices,
        faces,
        name,
    )


_SIZES: dict[int, tuple[VisualKind, tuple[tuple[int, float], ...]]] = {
    PLANE: ("plane", ((0, 2.0), (1, 2.0))),
    SPHERE: ("sphere", ((0, 1.0),)),
    CAPSULE: ("capsule", ((0, 1.0), (1, 2.0))),
    ELLIPSOID: ("ellipsoid", ((0, 1.0), (1, 1.0), (2, 1.0))),
    CYLINDER: ("cylinder", ((0, 1.0), (1, 2.0))),
    BOX: ("box", ((0, 2.0), (1, 2.0), (2, 2.0))),
    MESH: ("mesh", ()),
}
"""Of each kind of geom: what it is called here, and its sizes as (entry, factor) of MuJoCo's."""


# --- equality constraints of a mujoco model as constraints of a mechanism ------------------------
# MuJoCo's are soft: they give way under load and do work. Ours are exact, so that reading them as
# constraints is for models rather than for logs, whose equality forces are channels of their own.


def read_equalities(model: Any, as_constraints: bool, findings: Findings) -> tuple[Constraint, ...]:
    """Constraints for connect, weld and joint equalities if wanted; the others go into `findings`."""
    constraints: list[Constraint] = []
    for e, name in enumerate(equality_names(model)):
        if not model.eq_active0[e] or disabled(model, "EQUALITY"):
            findings.ignored.append(Remark(name, "equality, not active"))
            continue
        constraint = _constraint(model, e, name)
        if constraint is not None and as_constraints:
            constraints.append(constraint)
            findings.note(name, "equality, as an exact constraint")
            findings.assume(
                name, "the equality is exact", "MuJoCo's is soft: a log violates it and does work"
            )
        else:
            findings.equalities += [constraint] if constraint is not None else []
            findings.leave_to_log(name, "equality, soft in MuJoCo", f"constraint {name}")
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
