"""Recording Pinocchio: a dynamics library, around which users write the integrator themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from deltac import rotations
from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.errors import InputError, ModelError
from deltac.models import ModelLike
from deltac.recorders.monitor import Monitor
from deltac.recorders.recorder import (
    INSTANT,
    Columns,
    Forces,
    JointColumns,
    Recorder,
    simulator,
    sized,
)
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from pinocchio import Force

Model: TypeAlias = Any

PINOCCHIO_JOINTS = {
    **{f"JointModelR{axis}": "revolute" for axis in "XYZ"},
    **{f"JointModelRUB{axis}": "continuous" for axis in "XYZ"},
    **{f"JointModelP{axis}": "prismatic" for axis in "XYZ"},
    "JointModelRevoluteUnaligned": "revolute",
    "JointModelRevoluteUnboundedUnaligned": "continuous",
    "JointModelPrismaticUnaligned": "prismatic",
    "JointModelSpherical": "spherical",
    "JointModelFreeFlyer": "free",
}
"""Pinocchio's kind of a joint -> ours; "continuous" has the cosine and sine of its angle in q."""


class PinocchioRecorder(Recorder):
    """Record a loop of your own around Pinocchio.

    Accelerations are those that you pass, or those of ``pinocchio.aba``. Then the rows close by construction,
    and only the integrator is tested. `tau` becomes ``actuator <joint>``, `fext` becomes
    ``applied external``. For works, call ``rec.stage(weight * h, q, v, tau=…, fext=…, forces=…)`` at each
    stage of your integrator. Free flyers and continuous joints are converted.

    >>> with record_pinocchio(pin_model, mechanism) as rec:  # doctest: +SKIP
    ...     for k in range(1000):
    ...         rec.sample(k * h, q, v, tau=tau)
    ...         q, v = step(q, v, tau)
    >>> run = rec.trajectory(solver="rk4", step=h)  # doctest: +SKIP

    Args:
        pin_model: the pinocchio.Model.
        model: the mechanism, for the order of its joints; by default the order is Pinocchio's.
        names: Pinocchio's name of a joint -> the mechanism's, where they differ ("root_joint" is a free
            flyer's usual one).
        monitor: a monitor that takes the rows, which are then not kept.

    Raises:
        InputError: Pinocchio is missing, a joint is of a kind that is not known here, or the mechanism has
            other joints.
    """

    def __init__(
        self,
        pin_model: Model,
        model: ModelLike | None = None,
        *,
        names: Mapping[str, str] | None = None,
        monitor: Monitor | None = None,
    ) -> None:
        self._pin = simulator("pinocchio", "pin")
        self._model, self._data = pin_model, pin_model.createData()
        joints, continuous = [], set()
        for name, joint in zip(pin_model.names[1:], pin_model.joints[1:]):
            kind = PINOCCHIO_JOINTS.get(joint.shortname())
            if kind is None:
                raise ModelError(
                    f"joint {name!r} of the Pinocchio model is a {joint.shortname()}; known: "
                    f"{', '.join(PINOCCHIO_JOINTS)}"
                )
            if kind == "continuous":
                continuous.add((names or {}).get(name, name))
                kind = "revolute"
            q, v = (
                slice(joint.idx_q, joint.idx_q + joint.nq),
                slice(joint.idx_v, joint.idx_v + joint.nv),
            )
            joints.append(JointColumns(name, kind, q, v))
        self._continuous = frozenset(continuous)
        self._angles: dict[str, float] = {}
        self._columns = Columns.of(joints, model if monitor is None else monitor.mechanism, names)
        super().__init__(self._columns.coordinates, self._columns.speeds, monitor)

    def sample(
        self,
        t: float,
        q: Array,
        v: Array,
        a: Array | None = None,
        tau: Array | None = None,
        fext: Sequence[Force] | None = None,
        forces: Mapping[str, Array] | None = None,
    ) -> None:
        """Record a state of the loop and what acted there.

        Args:
            t: time, s.
            q: Pinocchio's configuration (model.nq).
            v: Pinocchio's velocity (model.nv).
            a: accelerations of this instant (model.nv); by default those of `pinocchio.aba` under the forces
                given here.
            tau: joint torques (model.nv), N or N·m: channels ``actuator <joint>``.
            fext: external forces as for `pinocchio.aba`, a pinocchio.Force for each joint in its frame:
                channel ``applied external``.
            forces: further generalized forces (model.nv) in Pinocchio's conventions, by channel, such as
                ``damper elbow`` or ``contact foot``. They are part of the accelerations that are found here.

        Raises:
            InputError: an array of the wrong size.
        """
        pin, model, data = self._pin, self._model, self._data
        q, v, acting = self._acting(q, v, tau, fext, forces)
        if a is None:
            total = np.sum([*acting.values(), np.zeros(model.nv)], axis=0)
            a = np.array(pin.aba(model, data, q, v, total))
        a = sized("a", a, model.nv)
        ours: Forces = {name: self._turned(f, q) for name, f in acting.items()}
        self._instant(t, self._coordinates(q), self._turned(v, q), self._rates(a, v, q), ours)

    def stage(
        self,
        duration: float,
        q: Array,
        v: Array,
        tau: Array | None = None,
        fext: Sequence[Force] | None = None,
        forces: Mapping[str, Array] | None = None,
    ) -> None:
        """Record a stage of the step from the last sample, for the works of all channels.

        A Runge–Kutta method of weights b has stages of duration b h: with the classical one h/6, h/3, h/3,
        h/6, the first at the sample itself. See `TrajectoryBuilder.stage`. A monitor has no use for it.

        Args:
            duration: weight of the stage, s.
            q: Pinocchio's configuration (model.nq) of the stage.
            v: Pinocchio's velocity (model.nv) there.
            tau: as for `sample`.
            fext: as for `sample`.
            forces: as for `sample`.

        Raises:
            InputError: an array of the wrong size, or no sample yet.
        """
        q, v, acting = self._acting(q, v, tau, fext, forces)
        ours = {name: self._turned(f, q) for name, f in acting.items()}
        self._builder.stage(duration, self._turned(v, q), ours)

    def _acting(
        self,
        q: Array,
        v: Array,
        tau: Array | None,
        fext: Sequence[Any] | None,
        forces: Mapping[str, Array] | None,
    ) -> tuple[Array, Array, Forces]:
        """The state as arrays, and all forces by channel, in Pinocchio's conventions."""
        model = self._model
        q, v = sized("q", q, model.nq), sized("v", v, model.nv)
        acting = {name: sized(name, f, model.nv) for name, f in (forces or {}).items()}
        if tau is not None:
            tau = sized("tau", tau, model.nv)
            for joint in self._columns.joints:
                part = np.zeros(model.nv)
                part[joint.v] = tau[joint.v]
                name = f"actuator {joint.name}"
                acting[name] = acting[name] + part if name in acting else part
        if fext is not None:
            acting["applied external"] = self._external(q, fext)
        return q, v, acting

    def trajectory(
        self,
        solver: str | None = None,
        step: float | None = None,
        held: Sequence[str] | None = None,
        order: int | None = None,
    ) -> Trajectory:
        """The samples so far, with the integrator's name, step and order, and the channels that it held.

        `held` is empty where all forces are functions of time or state at every instant, None where nobody
        says.
        """
        return self._trajectory(
            Provenance(
                simulator=f"Pinocchio {self._pin.__version__}",
                solver=solver,
                step=step,
                order=order,
                model=self._model.name or None,
                stage=INSTANT,
                held=None if held is None else tuple(held),
                acted=self._acted,
            )
        )

    def _external(self, q: Array, fext: Sequence[Any]) -> Array:
        """Σ Jᵀ f, as what inverse dynamics at rest lacks without them."""
        pin, model, data = self._pin, self._model, self._data
        rest = np.zeros(model.nv)
        forces = pin.StdVec_Force()
        for force in fext:
            forces.append(force)
        if len(forces) != model.njoints:
            raise InputError(
                f"fext: found {len(forces)} forces, expected {model.njoints}: one for each joint, the "
                "universe first"
            )
        without = np.array(pin.rnea(model, data, q, rest, rest))
        return np.asarray(without - np.array(pin.rnea(model, data, q, rest, rest, forces)))

    # --- conventions: free flyers have body components and quaternions x, y, z, w ------------------

    def _coordinates(self, q: Array) -> Array:
        def placed(joint: JointColumns) -> Array:
            own = q[joint.q]
            if joint.name in self._continuous:
                angle = float(np.arctan2(own[1], own[0]))
                before = self._angles.get(joint.name, angle)
                angle = before + np.remainder(angle - before + np.pi, 2 * np.pi) - np.pi
                self._angles[joint.name] = angle
                return np.array([angle])
            if joint.kind in ("spherical", "free"):
                return np.concatenate([own[:-4], own[-1:], own[-4:-1]])
            return own

        return self._columns.joined(placed)

    def _turned(self, values: Array, q: Array) -> Array:
        """Velocities or forces; linear components of free joints in the world. Turning is orthogonal."""

        def in_world(own: Array, joint: JointColumns) -> Array:
            R = rotations.matrices(np.roll(q[joint.q][3:], 1))
            return np.concatenate([R @ own[:3], own[3:]])

        return self._columns.turned(values, in_world)

    def _rates(self, a: Array, v: Array, q: Array) -> Array:
        """d/dt (R v_B) = R (v̇_B + ω × v_B) of free flyers."""
        inertial = a.copy()
        for joint in self._columns.joints:
            if joint.kind == "free":
                inertial[joint.v][:3] += np.cross(v[joint.v][3:], v[joint.v][:3])
        return self._turned(inertial, q)


record_pinocchio = checked(PinocchioRecorder, name="record_pinocchio")
