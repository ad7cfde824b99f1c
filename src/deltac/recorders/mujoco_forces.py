"""The generalized forces in MuJoCo's mjData, channel by channel, and the proof that none is missing.

All are taken from one mjData after a forward pass, so they belong to one instant: M q̈ + c = Σ forces
(MuJoCo documentation, "Computation", equation of motion; c holds Coriolis forces and gravity), up to
what the constraint solver leaves, which is a channel of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, SAME, Array, max_norm
from deltac.errors import RecordingError
from deltac.importers.names import (
    actuator_names,
    body_names,
    equality_names,
    geom_names,
    joint_names,
    motor_strengths,
    tendon_names,
)
from deltac.recorders.recorder import simulator

if TYPE_CHECKING:
    from mujoco import mjtIntegrator

Model: TypeAlias = Any
Data: TypeAlias = Any
Forces: TypeAlias = dict[str, Array]


SOLVER_ROUNDING = 64.0 * EPS
"""A residual of the constraint solver below this, relative to the forces, is not recorded."""

SOLVER_FORCE = "correction solver"
"""The force that the constraint solver left unbalanced: M q̈ + c − Σ forces."""


@dataclass(frozen=True)
class Elements:
    """What of a model can exert a force, named, and where it acts; found once for a run.

    `springs` and `dampers` say which joints have one; `tendon_damping` (ntendon, 3) holds b, b₁, b₂ of
    each tendon; `as_actuator` are the dofs on which gravity compensation counts as actuation, `limited`
    those whose actuators are limited together. `grouped` puts all contacts into one channel.
    """

    joints: list[str]
    bodies: list[str]
    geoms: list[str]
    actuators: list[str]
    tendons: list[str]
    equalities: list[str]
    springs: NDArray[np.intp]
    dampers: NDArray[np.intp]
    tendon_springs: NDArray[np.intp]
    tendon_dampers: NDArray[np.intp]
    tendon_damping: Array
    as_actuator: NDArray[np.bool_]
    limited: NDArray[np.bool_]
    grouped: bool

    @staticmethod
    def of(model: Model, *, grouped: bool) -> Elements:
        """The elements of a model."""
        tendon_damping = _tendon_damping(model)
        actuation = not model.opt.disableflags & _mujoco().mjtDisableBit.mjDSBL_ACTUATION
        return Elements(
            joint_names(model),
            body_names(model),
            geom_names(model),
            actuator_names(model),
            tendon_names(model),
            equality_names(model),
            np.flatnonzero((model.jnt_stiffness != 0.0) | model.jnt_stiffnesspoly.any(axis=1)),
            _damped_joints(model),
            np.flatnonzero(
                (model.tendon_stiffness != 0.0) | model.tendon_stiffnesspoly.any(axis=1)
            ),
            np.flatnonzero(tendon_damping.any(axis=1)),
            tendon_damping,
            (model.jnt_actgravcomp[model.dof_jntid] != 0) & actuation,
            model.jnt_actfrclimited[model.dof_jntid] != 0,
            grouped,
        )


@cache
def _mujoco() -> Any:
    return simulator("mujoco", "mujoco")


def _damped_joints(model: Model) -> NDArray[np.intp]:
    """The joints that are damped, by themselves or by the viscosity of an actuator."""
    damped = (model.dof_damping != 0.0) | model.dof_dampingpoly.any(axis=1)
    kinds = _mujoco().mjtTrn
    on_joint = np.isin(model.actuator_trntype, (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT))
    viscous = (model.actuator_damping != 0.0) | model.actuator_dampingpoly.any(axis=1)
    return np.union1d(model.dof_jntid[damped], model.actuator_trnid[on_joint & viscous, 0])


def _tendon_damping(model: Model) -> Array:
    """b, b₁, b₂ of each tendon (ntendon, 3), with what actuators add: their own times gear²."""
    damping = np.column_stack([model.tendon_damping, model.tendon_dampingpoly])
    for k in np.flatnonzero(model.actuator_trntype == _mujoco().mjtTrn.mjTRN_TENDON):
        gear = model.actuator_gear[model.actuator_outadr[k], 0]
        own = np.array([model.actuator_damping[k], *model.actuator_dampingpoly[k]])
        damping[model.actuator_trnid[k, 0]] += gear**2 * own
    return damping


def plastic_state(data: Data) -> Array:
    """A copy of the plastic strains; empty before MuJoCo 4, which has none."""
    return np.array(getattr(data, "plastic", ()), dtype=np.float64)


def generalized_forces(model: Model, data: Data, elements: Elements, plastic: Array) -> Forces:
    """Channel -> generalized force (nv,), N or N·m, of the forward pass that `data` holds.

    `plastic` is `plastic_state` as it was in that pass (stepping moves it on). Gravity and the Coriolis
    forces are not among the channels: a mechanism knows them.

    Raises InputError, naming the group and the joint, when the channels do not add up to what MuJoCo
    itself sums: then a force of this model is of a kind that is not known here.
    """
    lost = _Remainders.of(model, data, elements)
    forces: Forces = {}
    for parts in (
        _actuators(model, data, elements, lost),
        _passive(model, data, elements, plastic, lost),
        _applied(model, data, elements),
        _constraints(model, data, elements, lost),
    ):
        for channel, force in parts:
            # All contacts of a pair of geoms share a channel.
            forces[channel] = forces[channel] + force if channel in forces else force
    total = np.sum([*forces.values(), np.zeros(model.nv)], axis=0)
    summed = data.qfrc_smooth + data.qfrc_constraint + data.qfrc_bias
    lost.check("applied", summed, total[None])
    residual = _solver_residual(model, data, summed - total)
    if residual is not None:
        forces[SOLVER_FORCE] = residual
    return forces


def passive_forces(model: Model, data: Data, elements: Elements, plastic: Array) -> Forces:
    """As `generalized_forces`, the channels of passive forces alone: springs, dampers, fluid, …."""
    return dict(_passive(model, data, elements, plastic, _Remainders.of(model, data, elements)))


def actuator_forces(model: Model, q: Array, u: Array, ctrl: Array) -> Forces | None:
    """Channel -> generalized forces (T, nv), N or N·m, of actuators by their controls (T, nu) at states q, u.

    None where an actuator has a state of its own, or compensates gravity.
    """
    mujoco, elements = _mujoco(), Elements.of(model, grouped=True)
    if not model.nu or model.na or elements.as_actuator.any():
        return None
    data, rows = mujoco.MjData(model), list[Forces]()
    for data.qpos[:], data.qvel[:], data.ctrl[:] in zip(q, u, ctrl, strict=True):
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        data.efc_force[:] = 0.0  # unset until the constraints are solved
        lost = _Remainders.of(model, data, elements)
        rows.append(dict(_actuators(model, data, elements, lost)))
    names = [f"actuator {name}" for name in elements.actuators]
    return {name: np.array([row[name] for row in rows]) for name in names}


def constrained(model: Model, q: Array, u: Array) -> Array:
    """Whether contacts, limits or equalities act at states (T,)."""
    mujoco = _mujoco()
    kinds, data = mujoco.mjtConstraint, mujoco.MjData(model)
    frictions = (kinds.mjCNSTR_FRICTION_DOF, kinds.mjCNSTR_FRICTION_TENDON)
    acts = np.zeros(len(q), dtype=bool)
    for k, (data.qpos[:], data.qvel[:]) in enumerate(zip(q, u, strict=True)):
        mujoco.mj_fwdPosition(model, data)
        acts[k] = np.isin(data.efc_type, [int(x) for x in frictions], invert=True).any()
    return acts


def of_controls_alone(model: Model) -> bool:
    """Whether the forces of all actuators depend on no state: they are motors on joints."""
    on_joints = np.all(model.actuator_trntype == _mujoco().mjtTrn.mjTRN_JOINT)
    return bool(on_joints and len(motor_strengths(model)) == len(actuator_names(model)))


def mass_times(model: Model, data: Data, acceleration: Array) -> Array:
    """M(q) a (nv,), with the mass matrix of the last forward pass."""
    product = np.zeros(model.nv)
    _mujoco().mj_mulM(model, data, product, np.ascontiguousarray(acceleration, dtype=np.float64))
    return product


def discrete(model: Model) -> bool:
    """Whether the integrator solves for the step itself, so that q̈ is (u_{k+1} − u_k)/h."""
    return solver_name(model) == "discrete"


def integrator_names() -> dict[str, mjtIntegrator]:
    """Name -> value of every integrator of the installed MuJoCo: euler, rk4, implicit, …."""
    values = _mujoco().mjtIntegrator.__members__
    return {name.removeprefix("mjINT_").lower(): value for name, value in values.items()}


def solver_name(model: Model) -> str:
    """The name of a model's integrator."""
    return next(n for n, v in integrator_names().items() if v == model.opt.integrator)


# --- actuators and passive forces ----------------------------------------------------------------


def _actuators(
    model: Model, data: Data, elements: Elements, lost: _Remainders
) -> Iterator[tuple[str, Array]]:
    """Moment rows × actuator_force, and gravity compensation, which joints may count as actuation."""
    moments = _dense(
        data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind, model.nv
    )
    parts = np.zeros((model.nactuator + 1, model.nv))
    outputs = np.repeat(np.arange(model.nactuator), model.actuator_outnum)
    np.add.at(parts, outputs, data.actuator_force[:, None] * moments)
    parts[-1, elements.as_actuator] = data.qfrc_gravcomp[elements.as_actuator]
    # A joint may limit the sum of its actuators: then each of them gives its share.
    total = parts.sum(axis=0)
    cut = elements.limited & (total != data.qfrc_actuator) & (total != 0.0)
    parts[:, cut] *= data.qfrc_actuator[cut] / total[cut]
    lost.check("actuator", data.qfrc_actuator, parts)
    for name, part in zip(elements.actuators, parts, strict=False):
        yield f"actuator {name}", part
    gravcomp = np.where(elements.as_actuator, parts[-1], data.qfrc_gravcomp)
    if gravcomp.any():
        yield "applied gravcomp", gravcomp


def _passive(
    model: Model, data: Data, elements: Elements, plastic: Array, lost: _Remainders
) -> Iterator[tuple[str, Array]]:
    """Springs and dampers: those of tendons by their laws, the rest by the joint it acts on."""
    jacobian = _dense(
        data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind, model.nv
    )
    for kind, total, tension, joints, tendons in (
        (
            "spring",
            data.qfrc_spring,
            _tendon_springs(model, data, plastic),
            elements.springs,
            elements.tendon_springs,
        ),
        (
            "damper",
            data.qfrc_damper,
            _tendon_dampers(model, data, elements),
            elements.dampers,
            elements.tendon_dampers,
        ),
    ):
        on_tendons = tension[tendons, None] * jacobian[tendons]
        rest = total - on_tendons.sum(axis=0)
        on_joints = np.where(model.dof_jntid == joints[:, None], rest, 0.0)
        flex = rest - on_joints.sum(axis=0) if model.nflex else np.zeros(model.nv)
        lost.check(kind, total, np.vstack([on_tendons, on_joints, flex]))
        for tendon, part in zip(tendons, on_tendons, strict=True):
            yield f"{kind} {elements.tendons[tendon]}", part
        for joint, part in zip(joints, on_joints, strict=True):
            yield f"{kind} {elements.joints[joint]}", part
        if flex.any():
            yield f"{kind} flex", flex
    if data.qfrc_fluid.any():
        yield "applied fluid", data.qfrc_fluid.copy()
    if data.qfrc_adhesion.any():
        yield "contact adhesion", data.qfrc_adhesion.copy()
    gravcomp = np.where(elements.as_actuator, 0.0, data.qfrc_gravcomp)
    passive_sum = np.array(
        [data.qfrc_spring, data.qfrc_damper, data.qfrc_fluid, data.qfrc_adhesion, gravcomp]
    )
    further = data.qfrc_passive - passive_sum.sum(axis=0)
    if max_norm(further) > SAME * max_norm(passive_sum):
        yield "applied passive", further  # of plugins, and of the callback for passive forces


def _tendon_springs(model: Model, data: Data, plastic: Array) -> Array:
    """Force along each tendon: −(k x + k₁x² + k₂x³), x its length beyond the dead band.

    A plastic spring carries its dead band in the state.
    """
    if model.opt.disableflags & _mujoco().mjtDisableBit.mjDSBL_SPRING:
        return np.zeros(model.ntendon)
    band = np.array(model.tendon_lengthspring)
    for k in np.flatnonzero(model.tendon_plasticadr >= 0):
        band[k] = plastic[model.tendon_plasticadr[k] :][:2]
    length = data.ten_length
    x = length - np.clip(length, band[:, 0], band[:, 1])
    second, third = model.tendon_stiffnesspoly.T
    return np.asarray(-(model.tendon_stiffness + second * x + third * x * x) * x)


def _tendon_dampers(model: Model, data: Data, elements: Elements) -> Array:
    """Force along each tendon: −(b v + b₁v|v| + b₂v³)."""
    if model.opt.disableflags & _mujoco().mjtDisableBit.mjDSBL_DAMPER:
        return np.zeros(model.ntendon)
    v = data.ten_velocity
    first, second, third = elements.tendon_damping.T
    return np.asarray(-(first + second * np.abs(v) + third * v * v) * v)


# --- applied forces and constraints --------------------------------------------------------------


def _applied(model: Model, data: Data, elements: Elements) -> Iterator[tuple[str, Array]]:
    if data.qfrc_applied.any():
        yield "applied qfrc", data.qfrc_applied.copy()
    apply = _mujoco().mj_applyFT
    for k in np.flatnonzero(data.xfrc_applied.any(axis=1)):
        if k == 0:
            continue  # the world does not move
        force = np.zeros(model.nv)
        wrench = data.xfrc_applied[k]
        apply(model, data, wrench[:3], wrench[3:], data.xipos[k], k, force)
        yield f"applied {elements.bodies[k]}", force


def _constraints(
    model: Model, data: Data, elements: Elements, lost: _Remainders
) -> Iterator[tuple[str, Array]]:
    """Jᵀf of the rows of each constraint."""
    rows: dict[tuple[int, int], list[int]] = {}
    for row, key in enumerate(zip(data.efc_type.tolist(), data.efc_id.tolist(), strict=True)):
        rows.setdefault(key, []).append(row)
    total = np.zeros(model.nv)
    for (kind, element), own in rows.items():
        force = data.efc_force[own] @ lost.jacobian[own]
        total += force
        yield _constraint(model, data, elements, kind, element), force
    flex = data.qfrc_constraint - total if model.nflex else np.zeros(model.nv)
    lost.check("constraint", data.qfrc_constraint, np.vstack([total, flex]))
    if flex.any():
        yield "contact flex", flex


def _jacobian(model: Model, data: Data) -> Array:
    """The Jacobian (nefc, nv) of all rows of constraints."""
    if not data.nefc:
        return np.zeros((0, model.nv))
    if _mujoco().mj_isSparse(model):
        return _dense(data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind, model.nv)
    return np.asarray(data.efc_J.reshape(data.nefc, model.nv))


def _constraint(model: Model, data: Data, elements: Elements, kind: int, element: int) -> str:
    """The channel of a constraint row; its element is a dof, joint, tendon, contact or equality."""
    kinds = _mujoco().mjtConstraint
    match kinds(kind):
        case kinds.mjCNSTR_EQUALITY:
            return f"constraint {elements.equalities[element]}"
        case kinds.mjCNSTR_FRICTION_DOF:
            return f"friction {elements.joints[model.dof_jntid[element]]}"
        case kinds.mjCNSTR_FRICTION_TENDON:
            return f"friction {elements.tendons[element]}"
        case kinds.mjCNSTR_LIMIT_JOINT:
            return f"limit {elements.joints[element]}"
        case kinds.mjCNSTR_LIMIT_TENDON:
            return f"limit {elements.tendons[element]}"
    if elements.grouped:
        return "contact all"
    first, second = data.contact.geom[element]
    return f"contact {_geom(elements, first)}:{_geom(elements, second)}"


def _geom(elements: Elements, index: int) -> str:
    return elements.geoms[index] if index >= 0 else "flex"


# --- sums ----------------------------------------------------------------------------------------


def _solver_residual(model: Model, data: Data, rounding: Array) -> Array | None:
    """What the iterative constraint solver left of the equations of motion, if it is not rounding.

    `rounding` is what MuJoCo's sum of forces has beyond that of the channels: much, where forces cancel.

    InputError where there is no constraint to be solved: then the data are not of one instant.
    """
    if discrete(model):
        return None  # its q̈ is that of the step: the implicit terms hold this one too
    summed = data.qfrc_smooth + data.qfrc_constraint
    residual = mass_times(model, data, data.qacc) - summed + rounding
    size = max_norm(residual)
    scale = sum(max_norm(f) for f in (data.qfrc_smooth, data.qfrc_constraint, data.qfrc_bias))
    if data.nefc and size > SOLVER_ROUNDING * scale:
        return np.asarray(residual)
    if size > SAME * scale:
        raise RecordingError(
            f"MuJoCo's accelerations do not belong to its forces at t = {data.time:g} s: {size:.3g} of "
            f"{scale:.3g} N or N·m is left over, without any constraint"
        )
    return None


@dataclass(frozen=True)
class _Remainders:
    """Compares sums of channels with MuJoCo's own.

    jacobian: of the rows of constraints (nefc, nv).
    scale: the largest force of inertia and weight, with those of constraints as if they did not cancel, N
        or N·m. Forces that are nothing beside it, such as what a solver leaves of a constraint that does
        not act, add up to their own rounding only.
    """

    model: Model
    elements: Elements
    jacobian: Array
    scale: float

    @staticmethod
    def of(model: Model, data: Data, elements: Elements) -> _Remainders:
        """Of the forward pass that `data` holds."""
        jacobian = _jacobian(model, data)
        acting = np.abs(data.efc_force) @ np.abs(jacobian)
        scale = max_norm(data.qfrc_bias) + acting.max(initial=0.0)
        return _Remainders(model, elements, jacobian, float(scale))

    def check(self, group: str, total: Array, parts: Array) -> None:
        """InputError where the parts (n, nv) do not add up to MuJoCo's own sum (nv,)."""
        residual = total - parts.sum(axis=0)
        scale = self.scale + np.abs(parts).sum(axis=0).max(initial=0.0)
        scale += max_norm(total)
        if max_norm(residual) <= SAME * scale:
            return
        dof = int(np.abs(residual).argmax())
        joint = self.elements.joints[self.model.dof_jntid[dof]]
        raise RecordingError(
            f"the {group} forces of MuJoCo do not add up: {residual[dof]:.6g} is left over on joint "
            f"{joint!r} (dof {dof}), of {total[dof]:.6g}. Some element of the model acts in a way that "
            "the recorder does not know; record it without (disable flags), or report the model."
        )


def _dense(values: Any, count: Any, start: Any, columns: Any, width: int) -> Array:
    """A row-compressed matrix, dense."""
    count, start = np.asarray(count), np.asarray(start)
    dense = np.zeros((len(count), width))
    rows = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    places = np.repeat(start, count) + within
    dense[rows, np.asarray(columns)[places]] = np.asarray(values)[places]
    return dense
