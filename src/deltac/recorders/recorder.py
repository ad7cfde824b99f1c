"""What recorders share: rows for a trajectory or a monitor, and columns in a mechanism's conventions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np

from deltac.arrays import Array
from deltac.errors import LogError, RecordingError, UnknownName, closest
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.joints import KINDS
from deltac.models import ModelLike, load_model
from deltac.recorders.builder import TrajectoryBuilder
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from deltac.recorders.monitor import Monitor

Forces = dict[str, Array]

OCCASIONAL = ("applied", "contact", "limit", "friction", "constraint")
"""Kinds of channels that are there only if they acted; all others are always recorded."""

HELD = (
    "state before each step, with the forces that the step used, which were held over it, and udot the "
    "step's (u_{k+1} - u_k)/h; the last state, from which no step was made, is not a row"
)
INSTANT = "state, accelerations and forces of the same instant"


@dataclass(frozen=True)
class JointColumns:
    """A joint of a simulator: its name and kind in the mechanism, its places in the simulator's q and v."""

    name: str
    kind: str
    q: slice
    v: slice


@dataclass(frozen=True)
class Columns:
    """The columns of a mechanism, joint by joint, out of a simulator's."""

    joints: tuple[JointColumns, ...]

    @staticmethod
    def of(
        joints: Sequence[JointColumns], model: ModelLike | None, names: Mapping[str, str] | None
    ) -> Columns:
        """Renamed by `names` (the simulator's -> the mechanism's), in the order of the model if it is given.

        Raises InputError where the two have other joints, naming both.
        """
        names = names or {}
        for name in names:
            if name not in {joint.name for joint in joints}:
                raise UnknownName(
                    f"names: the simulator has no joint {name!r}"
                    f"{closest(name, [joint.name for joint in joints])}"
                )
        renamed = {
            names.get(j.name, j.name): JointColumns(names.get(j.name, j.name), j.kind, j.q, j.v)
            for j in joints
        }
        if model is None:
            return Columns(tuple(renamed.values()))
        mechanism = load_model(model).mechanism
        wanted = {joint.name: joint.kind for joint in mechanism.joints if joint.speeds}
        found = {joint.name: joint.kind for joint in renamed.values()}
        if wanted != found:
            ours, theirs = (", ".join(f"{n} ({k})" for n, k in s.items()) for s in (wanted, found))
            raise LogError(
                f"the joints of mechanism {mechanism.name!r} are {ours}; the simulator has {theirs}: give "
                "names={their name: your name}"
            )
        return Columns(tuple(renamed[name] for name in wanted))

    def joined(self, part: Callable[[JointColumns], Array]) -> Array:
        """What each joint contributes, one after the other."""
        return np.concatenate([np.zeros(0), *map(part, self.joints)])

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(_full(j.name, s) for j in self.joints for s, _ in KINDS[j.kind].coordinates)

    @property
    def speeds(self) -> tuple[str, ...]:
        """Names of the speeds."""
        return tuple(_full(j.name, s) for j in self.joints for s, _ in KINDS[j.kind].speeds)


def _full(joint: str, part: str) -> str:
    return f"{joint}.{part}" if part else joint


class Recorder:
    """A recorder of one running simulation: a context manager that `sample`s, then gives a trajectory.

    It keeps the rows, or feeds them to a monitor, if it has one.
    """

    def __init__(
        self, coordinates: Sequence[str], speeds: Sequence[str], monitor: Monitor | None = None
    ) -> None:
        self.monitor = monitor
        self._builder = TrajectoryBuilder(coordinates, speeds)
        if monitor is not None:
            mechanism = monitor.mechanism
            if (tuple(coordinates), tuple(speeds)) != (
                mechanism.coordinates.names,
                mechanism.speeds.names,
            ):
                raise LogError(
                    f"the monitor's mechanism {mechanism.name!r} has the speeds "
                    f"{', '.join(mechanism.speeds.names)}, the recorder {', '.join(speeds)}; give the "
                    "recorder the monitor's model, and names= where joints are called otherwise"
                )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """The trajectory stays available."""

    def __len__(self) -> int:
        return len(self._builder)

    def _instant(self, t: float, q: Array, u: Array, udot: Array | None, forces: Forces) -> None:
        """A row whose accelerations and forces are of the state's own instant."""
        if self.monitor is not None:
            self.monitor.update(t, q, u, udot, forces)
        else:
            self._builder.add(t, q, u, udot, forces)

    def _step(
        self,
        before: tuple[float, Array, Array],
        after: tuple[float, Array, Array],
        forces: Forces,
        udot: Array | None = None,
    ) -> None:
        """A step between two states, with forces held over it; u̇ is that of the speeds by default."""
        if self.monitor is not None:
            # What corrected the step is the integrator's, and is not excused.
            acted = {n: f for n, f in forces.items() if ChannelName.parse(n).kind != "correction"}
            if not self.monitor.rows:
                self.monitor.update(*before, held=acted)
            self.monitor.update(*after, held=acted)
        else:
            if udot is None:
                udot = (after[2] - before[2]) / (after[0] - before[0])
            self._builder.add(*before, udot, forces)

    def _trajectory(self, provenance: Provenance) -> Trajectory:
        if self.monitor is not None:
            raise RecordingError("the rows went to the monitor; record without one to keep them")
        return self._builder.trajectory(provenance)

    @property
    def _acted(self) -> tuple[str, ...]:
        """Channels of occasional kinds that are in the log."""
        names = map(ChannelName.parse, self._builder.channels)
        return tuple(name for name in names if name.kind in OCCASIONAL)
