"""What recorders share: simulators, rows of a log or for a monitor, columns in our conventions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import PHYSICAL, SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.errors import InputError, LogError, RecordingError, check_names, requirement
from deltac.mechanism import JOINT_KINDS, PASSIVE, ChannelName
from deltac.models import ModelLike, load_model
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from deltac.recorders.monitor import Monitor

Forces = dict[str, Array]

ENGINE = 1e-4
"""What the constraint solvers of engines leave of a step, relative."""

OCCASIONAL = ("applied", "contact", "limit", "friction", "constraint")
"""Kinds of channels that are there only if they acted; all others are always recorded."""

HELD_FORCES = (
    "state before each step, with the forces that the step used, which were held over it, and udot the "
    "step's (u_{k+1} - u_k)/h; the last state, from which no step was made, is not a row"
)
INSTANT = "state, accelerations and forces of the same instant"


def simulator(module: str, extra: str) -> Any:
    """Import a simulator's module; InputError with the remedy where it is missing."""
    with requirement(
        f'recording {extra} runs needs the Python module {module!r}: pip install "deltac[{extra}]"'
    ):
        return import_module(module)


def sized(what: str, values: Any, size: int, entries: str = "") -> Array:
    """A copy of the values as floats; InputError unless there are so many."""
    array = np.array(values, dtype=np.float64)
    if array.shape != (size,):
        raise InputError(f"{what}: found shape {array.shape}, expected ({size},){entries}")
    return array


@checked
class StepSums:
    """What is kept of the stages of a step.

    Attributes:
        works: by channel, J.
        forces: of each stage, the sum of all but those of springs and dampers (nu,).
        varying: channels whose forces were not those of the first stage at all others.
    """

    def __init__(self) -> None:
        self.works: dict[str, float] = {}
        self.forces: list[Array] = []
        self.varying: set[str] = set()
        self._first: Mapping[str, Array] | None = None

    def add(self, duration: float, u: Array, forces: Mapping[str, Array]) -> None:
        """A stage, as `TrajectoryBuilder.stage` takes it."""
        self.book({channel: duration * float(f @ u) for channel, f in forces.items()})
        nothing = np.zeros(len(u))
        others = (f for channel, f in forces.items() if not _passive(channel))
        self.forces.append(np.asarray(sum(others, nothing)))
        first = self._first = forces if self._first is None else self._first
        for channel in (first.keys() | forces.keys()) - self.varying if first is not forces else ():
            start, now = first.get(channel, nothing), forces.get(channel, nothing)
            if np.abs(now - start).max() > SAME * np.abs(start).max():
                self.varying.add(channel)

    def book(self, works: Mapping[str, float]) -> None:
        """Work of the step, J."""
        for channel, work in works.items():
            self.works[channel] = self.works.get(channel, 0.0) + float(work)


def _passive(channel: str) -> bool:
    return channel.partition(" ")[0] in PASSIVE


class TrajectoryBuilder:
    """Rows of a log, one `add` a sample: the state and, of the same instant, accelerations and forces.

    `coordinates` and `speeds` name the entries of q and u in the conventions of a mechanism: SI
    units, radians, quaternions scalar first; a free joint's speeds are its velocity in world
    components, then its angular velocity in body components.
    """

    def __init__(self, coordinates: Iterable[str], speeds: Iterable[str]) -> None:
        self._coordinates = tuple(coordinates)
        self._speeds = tuple(speeds)
        self._rows: list[tuple[float, Array, Array, Array | None]] = []
        self._forces: dict[str, dict[int, Array]] = {}
        self._steps: dict[int, StepSums] = {}

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that acted so far."""
        return tuple(self._forces)

    def add(
        self,
        t: float,
        q: Sequence[float] | Array,
        u: Sequence[float] | Array,
        udot: Sequence[float] | Array | None = None,
        forces: Mapping[str, Sequence[float] | Array] | None = None,
    ) -> None:
        """Add a sample. The arrays are copied: a simulator may go on and overwrite its own.

        Args:
            t: time, s.
            q: coordinates (nq,).
            u: speeds (nu,).
            udot: their rates at the same instant (nu,), or None; given always or never.
            forces: channel ``"<kind> <element>"`` -> generalized force (nu,) at the same instant, N
                or N·m; its product with u is positive when it adds energy. A channel that is left
                out of a row did not act then.

        Raises:
            InputError: an array of the wrong size, or accelerations in some rows only.
        """
        if self._rows and (udot is None) != (self._rows[0][3] is None):
            raise RecordingError(
                f"row {len(self)}, t = {t:g} s: accelerations must be given in every row or in none"
            )
        row = len(self._rows)
        self._rows.append(
            (
                float(t),
                self._sized("q", q, t),
                self._sized("u", u, t),
                None if udot is None else self._sized("udot", udot, t),
            )
        )
        for channel, force in (forces or {}).items():
            self._forces.setdefault(channel, {})[row] = self._sized(channel, force, t)

    def stage(
        self,
        duration: float,
        u: Sequence[float] | Array,
        forces: Mapping[str, Sequence[float] | Array],
    ) -> None:
        """Add a stage of the step that the integrator makes from the last row, the first one first.

        The works of the trajectory are the sums of duration × force · u: what the integrator itself
        would find if it integrated the power. A Runge–Kutta method of weights b has stages of duration
        b h; a force that is held over a step in which u is linear has one stage, of duration h, at the
        mean of the speeds at both ends.

        Args:
            duration: weight of the stage, s.
            u: speeds (nu,) of the stage.
            forces: as for `add`, of the stage.

        Raises:
            InputError: an array of the wrong size, or no row yet.
        """
        acting = {channel: self._sized(channel, f, duration) for channel, f in forces.items()}
        self._step().add(duration, self._sized("u", u, duration), acting)
        self._with_channels(acting)

    def work(self, works: Mapping[str, float]) -> None:
        """Add work (J), by channel, of the step that the integrator makes from the last row."""
        self._step().book(works)
        self._with_channels(works)

    def step(self, sums: StepSums) -> None:
        """The stages of the step that the integrator makes from the last row, summed up already."""
        self._step()
        self._steps[len(self._rows) - 1] = sums
        self._with_channels(sums.works)

    def _step(self) -> StepSums:
        if not self._rows:
            raise RecordingError(
                "a stage or work belongs to the step from a row: add the row first"
            )
        return self._steps.setdefault(len(self._rows) - 1, StepSums())

    def _with_channels(self, channels: Iterable[str]) -> None:
        for channel in channels:
            self._forces.setdefault(channel, {})

    @property
    def varying(self) -> frozenset[str]:
        """Channels whose forces were not constant in some step."""
        return frozenset[str]().union(*(step.varying for step in self._steps.values()))

    def end(self) -> float | None:
        """Forget the first row with numbers that are not physical and all after it.

        Its time, s, or None without one.
        """
        row = next((k for k in range(len(self._rows)) if not self._is_physical(k)), None)
        if row is None:
            return None
        t = self._rows[row][0]
        del self._rows[row:]
        tables: list[dict[int, Any]] = [*self._forces.values(), self._steps]
        for of_rows in tables:
            for place in [k for k in of_rows if k >= row]:
                del of_rows[place]
        return t

    def _is_physical(self, row: int) -> bool:
        _, q, u, udot = self._rows[row]
        columns = [q, u, np.zeros(0) if udot is None else udot]
        columns += [rows[row] for rows in self._forces.values() if row in rows]
        return bool((np.abs(np.concatenate(columns)) <= PHYSICAL).all())

    def trajectory(self, provenance: Provenance) -> Trajectory:
        """The samples so far.

        Raises InputError for what a Trajectory refuses, and where only some of the steps have stages.
        """
        t, q, u, udot = zip(*self._rows) if self._rows else ((), (), (), ())
        steps = range(len(t) - 1)
        works: dict[str, Array] = {}
        if self._steps:
            missing = next((k for k in steps if k not in self._steps), None)
            if missing is not None:
                raise RecordingError(
                    f"the step from row {missing}, t = {t[missing]:g} s, has neither stage() nor work(), "
                    "others have; give them for every step or for none"
                )
            for channel in self._forces:
                of_steps = (self._steps[k].works.get(channel, 0.0) for k in steps)
                works[channel] = np.cumsum([0.0, *of_steps])
        forces = {}
        for channel, rows in self._forces.items():
            forces[channel] = np.zeros((len(t), len(self._speeds)))
            if rows:  # else it acted in stages alone
                forces[channel][list(rows)] = list(rows.values())
        return Trajectory(
            t=np.array(t),
            q=np.array(q),
            u=np.array(u),
            udot=None if not udot or udot[0] is None else np.array(udot),
            coordinates=self._coordinates,
            speeds=self._speeds,
            forces=forces,
            works=works,
            stages=self._stages(len(t)),
            provenance=provenance,
        )

    def _stages(self, rows: int) -> Array | None:
        """Sums of forces (T, s, nu) at later stages; None for steps of one, or that begin otherwise."""
        steps = [self._steps.get(k, StepSums()).forces for k in range(rows - 1)]
        count = len(steps[0]) if steps else 0
        if count < 2 or any(len(step) != count for step in steps):
            return None
        first = np.zeros((rows, len(self._speeds)))
        for channel, of_rows in self._forces.items():
            if of_rows and not _passive(channel):
                first[list(of_rows)] += list(of_rows.values())
        stages = np.array(steps)
        allowed = SAME * max_norm(first)
        if max_norm(stages[:, 0] - first[:-1]) > allowed:
            return None
        return np.concatenate([stages[:, 1:], np.repeat(first[-1:, None], count - 1, axis=1)])

    def _sized(self, what: str, values: Any, t: float) -> Array:
        names = self._coordinates if what == "q" else self._speeds
        entries = f": one entry for each of {', '.join(names) or 'no names'}"
        return sized(f"{what} at t = {t:g} s", values, len(names), entries)


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
        check_names(names, [joint.name for joint in joints], "names: the simulator has no joint")
        renamed = {
            names.get(j.name, j.name): JointColumns(names.get(j.name, j.name), j.kind, j.q, j.v)
            for j in joints
        }
        if model is None:
            return Columns(tuple(renamed.values()))
        mechanism = load_model(model).mechanism
        model_kinds = {joint.name: joint.kind for joint in mechanism.joints if joint.speeds}
        kinds = {joint.name: joint.kind for joint in renamed.values()}
        if model_kinds != kinds:
            ours, theirs = (
                ", ".join(f"{n} ({k})" for n, k in s.items()) for s in (model_kinds, kinds)
            )
            raise LogError(
                f"the joints of mechanism {mechanism.name!r} are {ours}; the simulator has {theirs}: give "
                "names={their name: your name}"
            )
        return Columns(tuple(renamed[name] for name in model_kinds))

    def joined(self, part: Callable[[JointColumns], Array]) -> Array:
        """What each joint contributes, one after the other."""
        return np.concatenate([np.zeros(0), *map(part, self.joints)])

    def turned(self, v: Array, free: Callable[[Array, JointColumns], Array]) -> Array:
        """Velocities, accelerations or forces in our conventions; `free` turns those of free joints."""
        return self.joined(lambda j: free(v[j.v], j) if j.kind == "free" else v[j.v])

    def of_limits(self, forces: Array, limited: NDArray[np.bool_], least: float) -> Forces:
        """The forces along `limited` speeds, by joint, as ``limit <joint>``; none that is below `least`."""
        parts: Forces = {}
        for joint in self.joints:
            part = np.zeros_like(forces)
            part[joint.v] = np.where(limited[joint.v], forces[joint.v], 0.0)
            if max_norm(part) > least:
                parts[f"limit {joint.name}"] = part
        return parts

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(
            _full(j.name, s) for j in self.joints for s, _ in JOINT_KINDS[j.kind].coordinates
        )

    @property
    def speeds(self) -> tuple[str, ...]:
        """Names of the speeds."""
        return tuple(_full(j.name, s) for j in self.joints for s, _ in JOINT_KINDS[j.kind].speeds)


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

    def __exit__(self, *_: object) -> None:
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
        """A step between two states, with forces held over it; u̇ is that of the speeds by default.

        Accelerations are held as well, so speeds are linear in time, and the work of a force is that at
        their mean.
        """
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
            self._builder.stage(after[0] - before[0], 0.5 * (before[2] + after[2]), forces)

    def _trajectory(self, provenance: Provenance) -> Trajectory:
        if self.monitor is not None:
            raise RecordingError("the rows went to the monitor; record without one to keep them")
        t = self._builder.end()
        if t is not None:
            message = f"the run blew up: numbers at t = {t:g} s are beyond any physical quantity"
            if len(self._builder) < 2:
                raise RecordingError(f"{message}, and fewer than two rows were before it")
            provenance = replace(provenance, message=message)
        return self._builder.trajectory(provenance)

    @property
    def _acted(self) -> tuple[str, ...]:
        """Channels of occasional kinds that are in the log."""
        names = map(ChannelName.parse, self._builder.channels)
        return tuple(name for name in names if name.kind in OCCASIONAL)
