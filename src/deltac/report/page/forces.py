"""Forces as arrows: of constraints, contacts and applied ones, from what they do to the speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from deltac.analysis.evaluate import Evaluation, evaluated
from deltac.analysis.model import Instants
from deltac.arrays import Array, max_norm
from deltac.dynamics import TracedScene as Places
from deltac.dynamics import equations_of, evaluate_at, trace
from deltac.mechanism import (
    GROUND,
    ChannelName,
    Contact,
    Distance,
    Loop,
    Mechanism,
    PointForce,
    PointOn,
    is_zero,
)
from deltac.report.page.geometry import constant
from deltac.report.page.parts import Numbers
from deltac.report.panels import MOST_DRAWN
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class Arrow:
    """A force: of what, where it acts (frames, 3), m, and how large it is (frames, 3), N."""

    name: str
    kind: Literal["contact", "constraint", "applied"]
    at: Numbers
    force: Numbers


def arrows(mechanism: Mechanism, run: Trajectory, at: Instants) -> Iterator[Arrow]:
    """Forces of constraints, contacts and applied ones, the largest of them."""
    acting = _Acted(mechanism, run, at)
    arrows = [arrow for part in _acting(mechanism, run) if (arrow := part.arrow(acting))]
    arrows.sort(key=lambda arrow: -max_norm(arrow.force.values))
    yield from arrows[:MOST_DRAWN]


@dataclass(frozen=True, eq=False)
class _Acted:
    """Generalized forces of a run at the instants that are shown."""

    mechanism: Mechanism
    run: Trajectory
    at: Instants

    @cached_property
    def evaluation(self) -> Evaluation:
        """What the model says of these instants."""
        return evaluated(equations_of(trace(self.mechanism)), self.at)

    def force(self, channels: Sequence[str]) -> Array:
        """The sum (frames, free speeds) over some channels: as logged, else as the model has it."""
        free = self.mechanism.free.u
        total = np.zeros((len(self.at.t), len(free)))
        rows = np.searchsorted(self.run.t, self.at.t)
        logged = [self.run.forces[c] for c in channels if c in self.run.forces]
        for values in logged:
            total += values[rows][:, free]
        for channel in () if logged else channels:
            name = ChannelName.parse(channel)
            evaluation = self.evaluation
            if name.kind == "constraint":
                own = [k for k, row in enumerate(evaluation.rows) if row == name.element]
                total += np.einsum(
                    "tcp,tc->tp", evaluation.G[:, own], evaluation.multipliers[:, own]
                )
            elif name in evaluation.forces:
                total += evaluation.forces[name][:, free]
        return total


@dataclass(frozen=True)
class _Acting:
    """Channels whose force acts on `body`, and in reverse on `other`, at `point` of the body.

    If it `slides`, it acts somewhere near that point: where its moment about the place vanishes.
    """

    name: str
    kind: Literal["contact", "constraint", "applied"]
    channels: tuple[str, ...]
    body: str
    other: str
    point: tuple[Any, ...]
    slides: bool = False

    def arrow(self, acted: _Acted) -> Arrow | None:
        """The force that has this generalized force, least where several have; None without any."""
        generalized = acted.force(self.channels)
        if not np.any(generalized):
            return None
        place, jacobian = _jacobian(acted.mechanism, acted.at, self.body, self.other, self.point)
        power = np.linalg.pinv(jacobian[:, :3].transpose(0, 2, 1), rcond=1e-9)
        force = np.einsum("tij,tj->ti", power, generalized)
        rest = generalized - np.einsum("tij,ti->tj", jacobian[:, :3], force)
        if np.abs(rest).max() > 1e-6 * np.abs(generalized).max() and self.slides:
            inverse = np.linalg.pinv(jacobian.transpose(0, 2, 1), rcond=1e-9)
            wrench = np.einsum("tij,tj->ti", inverse, generalized)
            force, moment = wrench[:, :3], wrench[:, 3:]
            square = np.maximum(np.einsum("ti,ti->t", force, force), 1e-300)
            place = place + np.cross(force, moment) / square[:, None]
        return Arrow(self.name, self.kind, Numbers(place), Numbers(force))


def _acting(mechanism: Mechanism, run: Trajectory) -> Iterator[_Acting]:
    for c in mechanism.constraints:
        channels = (f"constraint {c.name}",)
        if isinstance(c, Distance | Loop) and constant(mechanism, c.point2):
            yield _Acting(c.name, "constraint", channels, c.body2, c.body1, tuple(c.point2))
        elif isinstance(c, PointOn) and constant(mechanism, c.point):
            yield _Acting(c.name, "constraint", channels, c.body, c.on, tuple(c.point))
    for e in mechanism.elements:
        if isinstance(e, Contact):
            three = tuple(f"{kind} {e.name}" for kind in ("spring", "contact", "friction"))
            body, other = (e.first, e.second) if e.second.body == GROUND else (e.second, e.first)
            yield _Acting(
                e.name, "contact", three, body.body, other.body, tuple(body.position), True
            )
        elif isinstance(e, PointForce) and not all(is_zero(x) for x in e.force):
            yield _Acting(e.name, "applied", (f"applied {e.name}",), e.body, GROUND, tuple(e.point))
    looks = {v.name: v for v in mechanism.visuals}
    for channel in run.forces:
        first, colon, second = channel.element.partition(":")
        if channel.kind == "contact" and colon and {first, second} <= looks.keys():
            one, two = looks[first], looks[second]
            if one.body != GROUND:
                one, two = two, one
            yield _Acting(
                channel.element, "contact", (channel,), two.body, one.body, two.position, True
            )


def _jacobian(
    mechanism: Mechanism, at: Instants, body: str, other: str, point: Sequence[Any]
) -> tuple[Array, Array]:
    """Where a point of a body is (frames, 3), and its Jacobian (frames, 6, free), translation first.

    Of the velocity beside that of the point of `other` in the same place.
    """
    system = equations_of(trace(mechanism)).system

    def function() -> Any:
        places = system.once("scene", lambda: Places(system))
        x = places.place(body, point)
        moves = places.velocity(body, x) - places.velocity(other, x)
        turns = places.angular_velocity(body) - places.angular_velocity(other)
        rates = ca.jacobian(ca.vertcat(moves, turns), system.u)
        arguments = [system.t, system.q, system.u]
        return ca.Function("arrow", arguments, [ca.densify(x), ca.densify(ca.vec(rates))])

    f = system.once(("arrow", body, other, *map(repr, point)), function)
    free = mechanism.free
    x, rates = evaluate_at(f, at.t[None, :], at.q[:, free.q].T, at.u[:, free.u].T)
    return x.T, rates.T.reshape(len(at.t), len(free.u), 6).transpose(0, 2, 1)
