"""Recording PyBullet: the state before each step, and what forces the step came to.

Bullet steps by semi-implicit Euler: u_{k+1} = u_k + h a with a of the state k, so a, and by inverse dynamics
the sum of all forces, are known to rounding. Dampers and motors are told apart; what is left over are
contacts, joint limits, or whatever else acted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from deltac import rotations
from deltac.arrays import SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.errors import ModelError, RecordingError, check_names
from deltac.models import ModelLike
from deltac.recorders.monitor import Monitor
from deltac.recorders.recorder import (
    HELD_FORCES,
    OCCASIONAL,
    Columns,
    Forces,
    JointColumns,
    Recorder,
    simulator,
)
from deltac.trajectories import Provenance, Trajectory

PYBULLET_JOINTS = {0: "revolute", 1: "prismatic", 4: "fixed"}
"""PyBullet's kind of a joint -> ours; those that are fixed have no coordinate."""


class PybulletRecorder(Recorder):
    """Record a body of PyBullet: call `sample` after each ``stepSimulation``.

    Pass `sample` the torques that you applied by torque control; PyBullet reports only those of its own
    motors. A row is the state before a step. Bullet's inverse dynamics gives the sum of all forces, of which
    ``actuator <joint>`` and ``damper <joint>`` are known. The remainder is ``contact all`` while the body
    touches something, else ``limit <joint>`` where a joint has limits, else ``applied external``. The latter
    includes the damping of links that PyBullet has by default (0.04); switch it off by
    ``changeDynamics(linearDamping=0, angularDamping=0)``.

    >>> with record_pybullet(robot, mechanism) as rec:  # doctest: +SKIP
    ...     for k in range(1000):
    ...         p.setJointMotorControl2(robot, 0, p.TORQUE_CONTROL, force=torque)
    ...         p.stepSimulation()
    ...         rec.sample({"shoulder": torque})
    >>> run = rec.trajectory()  # doctest: +SKIP

    Args:
        body: unique number of the body, in the state of the first row.
        model: the mechanism, for the order of its joints; by default the order is Bullet's.
        names: Bullet's name of a joint -> the mechanism's, where they differ. The joint of a body whose base
            is free is called after its base link.
        monitor: a monitor that takes the rows, which are then not kept.
        client: number of the physics client.

    Raises:
        InputError: PyBullet is missing, it makes several substeps a step, a joint is spherical or planar, or
            the mechanism has other joints.
    """

    def __init__(
        self,
        body: int,
        model: ModelLike | None = None,
        *,
        names: Mapping[str, str] | None = None,
        monitor: Monitor | None = None,
        client: int = 0,
    ) -> None:
        p = self._p = simulator("pybullet", "pybullet")
        self._body, self._of = body, {"physicsClientId": client}
        engine = p.getPhysicsEngineParameters(**self._of)
        if engine["numSubSteps"] > 1:
            raise RecordingError(
                f"PyBullet makes {engine['numSubSteps']} substeps a step, of which it shows only the last; "
                "set numSubSteps=0 and a smaller time step"
            )
        self._gravity = np.array(
            [
                engine["gravityAccelerationX"],
                engine["gravityAccelerationY"],
                engine["gravityAccelerationZ"],
            ]
        )
        base = p.getDynamicsInfo(body, -1, **self._of)
        self._centre, self._axes = np.array(base[3]), rotations.matrices(np.roll(base[4], 1))
        self._places: list[int] = []
        joints: list[JointColumns] = []
        self._free = 6 if base[0] > 0.0 else 0
        if self._free:
            name = p.getBodyInfo(body, **self._of)[0].decode()
            joints.append(JointColumns(name, "free", slice(0, 7), slice(0, 6)))
        self._damping: dict[str, float] = {}
        self._limited = [False] * self._free
        own = names or {}
        for j in range(p.getNumJoints(body, **self._of)):
            info = p.getJointInfo(body, j, **self._of)
            if PYBULLET_JOINTS.get(info[2]) == "fixed":
                continue
            name = info[1].decode()
            if info[2] not in PYBULLET_JOINTS:
                raise ModelError(
                    f"joint {name!r} of the body is neither revolute nor prismatic: PyBullet does not show "
                    "what is needed of it"
                )
            place = self._free + len(self._places)
            joints.append(
                JointColumns(
                    name,
                    PYBULLET_JOINTS[info[2]],
                    slice(place + bool(self._free), place + bool(self._free) + 1),
                    slice(place, place + 1),
                )
            )
            self._places.append(j)
            if info[6]:
                self._damping[own.get(name, name)] = float(info[6])
            self._limited.append(info[8] <= info[9])
        self._columns = Columns.of(joints, model if monitor is None else monitor.mechanism, names)
        self._at = {joint.name: joint.v for joint in self._columns.joints}
        self._t = 0.0
        super().__init__(self._columns.coordinates, self._columns.speeds, monitor)
        self._before = self._state()

    def sample(self, torques: Mapping[str, float] | None = None) -> None:
        """Record the step that was just made.

        Args:
            torques: what you applied to joints by torque control in this step, N·m or N, by the mechanism's
                names: PyBullet does not report it. Torques of its own motors are found.

        Raises:
            InputError: an unknown joint.
        """
        h = float(self._p.getPhysicsEngineParameters(**self._of)["fixedTimeStep"])
        before, after = self._before, self._state()
        a = (after.v - before.v) / h
        total, size = self._total(before, a)
        forces: Forces = {}
        check_names(torques or {}, self._at, "torques: the body has no joint")
        for name, place in self._at.items():
            if place.stop - place.start > 1:
                continue
            motor = float((torques or {}).get(name, 0.0)) + after.motors[place.start - self._free]
            for kind, value in (
                ("actuator", motor),
                ("damper", -self._damping.get(name, 0.0) * before.v[place.start]),
            ):
                if value or (kind == "damper" and name in self._damping):
                    forces[f"{kind} {name}"] = np.zeros(len(total))
                    forces[f"{kind} {name}"][place] = value
        rest = total - np.sum([*forces.values(), np.zeros(len(total))], axis=0)
        size += max((max_norm(f) for f in forces.values()), default=0.0)
        self._name(rest, SAME * size, forces)
        t, self._t = self._t, self._t + h
        self._before = after
        ours = {name: self._force(f, before) for name, f in forces.items()}
        self._step(
            (t, *self._row(before)),
            (self._t, *self._row(after)),
            ours,
            self._acceleration(a, before),
        )

    def trajectory(self) -> Trajectory:
        """The rows so far; the state after the last step, from which none was made, is not a row."""
        h = float(self._p.getPhysicsEngineParameters(**self._of)["fixedTimeStep"])
        return self._trajectory(
            Provenance(
                simulator=f"PyBullet {self._p.getAPIVersion()}",
                solver="semi-implicit euler",
                step=h,
                order=1,
                stage=HELD_FORCES,
                held=self._builder.channels,
                inputs="held",
                looked_for=OCCASIONAL,
                acted=self._acted,
            )
        )

    # --- what Bullet says ------------------------------------------------------------------------

    def _state(self) -> _BulletState:
        """The present state; of the base its centre's motion and its principal axes, in world components."""
        p, body = self._p, self._body
        joints = p.getJointStates(body, self._places, **self._of) if self._places else []
        q = np.array([state[0] for state in joints])
        v = np.array([state[1] for state in joints])
        motors = np.array([state[3] for state in joints])
        if not self._free:
            return _BulletState(q, v, motors, np.zeros(3), np.eye(3))
        centre, turn = p.getBasePositionAndOrientation(body, **self._of)
        linear, angular = p.getBaseVelocity(body, **self._of)
        return _BulletState(
            q,
            np.concatenate([linear, angular, v]),
            motors,
            np.array(centre),
            rotations.matrices(np.roll(turn, 1)),
        )

    def _total(self, state: _BulletState, a: Array) -> tuple[Array, float]:
        """M a + c less gravity: all other forces, on the base's centre in world components; their size."""
        p, body, n = self._p, self._body, self._free
        q = list(state.q)
        if not n:
            total = np.array(
                p.calculateInverseDynamics(body, q, list(state.v), list(a), **self._of)
            )
            weight = np.array(
                p.calculateInverseDynamics(body, q, [0.0] * len(q), [0.0] * len(q), **self._of)
            )
            return total, max_norm(weight) + max_norm(total)
        # Of a free base Bullet turns gravity the wrong way. So its weight is taken away again, and gravity
        # comes in as an acceleration. The base's columns are angular, then linear, along its axes; the
        # forces come out linear first.
        R = state.axes
        where = [*state.centre, *np.roll(rotations.quaternion(R), -1), *q]
        along = [*(R.T @ state.v[3:6]), *(R.T @ state.v[:3]), *state.v[6:]]
        rates = [*(R.T @ a[3:6]), *(R.T @ (a[:3] - self._gravity)), *a[6:]]
        nothing = [0.0] * (6 + len(q))
        flags = {"flags": 0, **self._of}
        forces = np.array(p.calculateInverseDynamics(body, where, along, rates, **flags))
        weight = np.array(p.calculateInverseDynamics(body, where, nothing, nothing, **flags))
        forces = forces - weight
        size = float(np.abs(weight).max() + np.abs(forces).max())
        return np.concatenate([R @ forces[:3], R @ forces[3:6], forces[6:]]), size

    def _name(self, rest: Array, least: float, forces: Forces) -> None:
        """Give what is left over the name of what it can be."""
        if max_norm(rest) <= least:
            return
        if self._p.getContactPoints(bodyA=self._body, **self._of):
            forces["contact all"] = rest
            return
        limits = self._columns.of_limits(rest, np.array(self._limited), least)
        forces |= limits
        external = rest - sum(limits.values())
        if max_norm(external) > least:
            forces["applied external"] = external

    # --- conventions: the centre's motion in world components, to the link frame's ------------------

    def _arm(self, state: _BulletState) -> tuple[Array, Array]:
        """The link frame's axes, and the way from its origin to the centre, in world components."""
        R = state.axes @ self._axes.T
        return R, R @ self._centre

    def _row(self, state: _BulletState) -> tuple[Array, Array]:
        def placed(joint: JointColumns) -> Array:
            if joint.kind != "free":
                return state.q[joint.v.start - self._free : joint.v.stop - self._free]
            R, r = self._arm(state)
            return np.concatenate([state.centre - r, rotations.quaternion(R)])

        def moved(own: Array, _: JointColumns) -> Array:
            R, r = self._arm(state)
            return np.concatenate([own[:3] - np.cross(own[3:], r), R.T @ own[3:]])

        return self._columns.joined(placed), self._columns.turned(state.v, moved)

    def _acceleration(self, a: Array, state: _BulletState) -> Array:
        def moved(own: Array, _: JointColumns) -> Array:
            R, r = self._arm(state)
            omega, alpha = state.v[3:6], own[3:6]
            origin = own[:3] - np.cross(alpha, r) - np.cross(omega, np.cross(omega, r))
            return np.concatenate([origin, R.T @ alpha])

        return self._columns.turned(a, moved)

    def _force(self, f: Array, state: _BulletState) -> Array:
        def moved(own: Array, _: JointColumns) -> Array:
            R, r = self._arm(state)
            return np.concatenate([own[:3], R.T @ (own[3:6] + np.cross(r, own[:3]))])

        return self._columns.turned(f, moved)


@dataclass(frozen=True)
class _BulletState:
    """Joints' q, all speeds v (the base's first), motor torques; the base's centre and principal axes."""

    q: Array
    v: Array
    motors: Array
    centre: Array
    axes: Array


record_pybullet = checked(PybulletRecorder, name="record_pybullet")
