"""`kinematics`: where the bodies of a run are and how they move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deltac.analysis.model import Instants, instants
from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.dynamics.equations_of_motion import equations_of_motion, evaluate_at
from deltac.dynamics.scene import TracedScene
from deltac.dynamics.spatial import SX
from deltac.errors import check_names
from deltac.mechanism.constraints import Rolling
from deltac.mechanism.laws import VectorLike
from deltac.mechanism.quantities import vector
from deltac.models import ModelLike, StateLike
from deltac.trajectories import Trajectory

ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Places and velocities of a model's bodies at a state, (3,), or along a run, (T, 3).

    World components unless said otherwise; points are given in the body's frame.
    """

    instants: Instants

    def position(self, body: str, point: VectorLike = ORIGIN) -> Array:
        """Where a point of a body is, m."""
        return self._of(("position", body, *self._point(point)), lambda s: _place(s, body, point))

    def velocity(self, body: str, point: VectorLike = ORIGIN) -> Array:
        """Velocity of a body's material point, m/s."""
        key = ("velocity", body, *self._point(point))
        return self._of(key, lambda s: s.velocity(body, _place(s, body, point)))

    def orientation(self, body: str) -> Array:
        """Rotation matrices (…, 3, 3): columns are the body's axes in the world."""
        flat = self._of(("orientation", body), lambda s: ca.vec(s.rotation(body).T))
        return flat.reshape(*flat.shape[:-1], 3, 3)

    def angular_velocity(self, body: str) -> Array:
        """Angular velocity, rad/s."""
        return self._of(("angular velocity", body), lambda s: s.angular_velocity(body))

    def contact_point(self, constraint: str) -> Array:
        """Where a wheel, disc or sphere that rolls (`rolling`) touches its plane, m."""
        rolling = {c.name: c for c in self.instants.mechanism.constraints if isinstance(c, Rolling)}
        check_names([constraint], rolling, "contact_point: no rolling constraint is called")
        return self._of(("contact", constraint), rolling[constraint].contact_point)

    def _point(self, point: VectorLike) -> tuple[str, ...]:
        return tuple(map(repr, vector(point, "point")))

    def _of(self, key: tuple[Any, ...], write: Callable[[TracedScene], SX]) -> Array:
        at, mechanism = self.instants, self.instants.mechanism
        if key[0] != "contact" and key[1] != "ground":
            mechanism.body(key[1])
        system = equations_of_motion(mechanism).system

        def function() -> Any:
            scene = system.once("scene", lambda: TracedScene(system))
            arguments = [system.t, system.q, system.u]
            return ca.Function("kinematics", arguments, [ca.densify(ca.SX(write(scene)))])

        free = mechanism.free
        f = system.once(("kinematics", *key), function)
        (values,) = evaluate_at(f, at.t[None, :], at.q[:, free.q].T, at.u[:, free.u].T)
        return np.ascontiguousarray(values.T[0] if at.single else values.T)


@checked
def kinematics(model: ModelLike, state: StateLike | Trajectory = None) -> Kinematics:
    """Positions, velocities and orientations of a model's bodies at a state or along a run.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        state: a State or a Trajectory, also one of another simulator; by default the model's own start.

    ``kinematics(mechanism, run).position("bar", [0, -0.5, 0])`` is (T, 3), m.
    """
    return Kinematics(instants(model, state))


def _place(scene: TracedScene, body: str, point: VectorLike) -> SX:
    return scene.place(body, vector(point, "point"))
