"""What happened: the samples of a motion, of whoever's simulator, and where they come from."""

from __future__ import annotations

import functools
import math
import operator
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from deltac.arrays import Array, max_norm
from deltac.calls.arguments import checked
from deltac.calls.caching import Once
from deltac.calls.services import service
from deltac.errors import (
    InputError,
    LogError,
    StateError,
    WrongType,
    check_names,
    number_or_nan,
    shown,
)
from deltac.mechanism.channels import ByChannel, ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.laws import VectorLike
from deltac.mechanism.mechanism import Mechanism
from deltac.results import Section, Shown, Table, number
from deltac.trajectories.numbers import as_numbers
from deltac.trajectories.occurrences import Occurrence

if TYPE_CHECKING:
    import polars


class OdeResult(Protocol):
    """What SciPy's `solve_ivp` returns: times t (T,), states y (n, T)."""

    t: Any
    y: Any


class Solution(Protocol):
    """What diffrax returns: times ts (T,), states ys (T, n)."""

    ts: Any
    ys: Any


SolverResult: TypeAlias = OdeResult | Solution | tuple[npt.ArrayLike, npt.ArrayLike]
"""What an ODE solver returns; a pair are times (T,) and states (T, n)."""

ROWS, INTERPOLATED = "rows", "interpolated"
"""The note of a provenance that rows lie between the steps of the solver, on its interpolant."""

LEFT_OUT = "left out"
"""The note of provenance that says which rows, or columns, were left out."""

FRAMES = "frames"
"""The note of provenance that says in which components velocities are that were turned."""

BY_LAW = "by the laws of prescribed joints"
"""The note of provenance that names the columns which the log lacks and the mechanism tells."""

MAPPINGS = ("coordinates", "strengths", "servo_damping", "derived", "notes")
"""Fields of a provenance that are mappings."""

_TEXTS = (
    *("solver", "model", "model_hash", "message", "ended", "equations", "corrected", "singular"),
    *("inputs", "stage", "reading"),
)
"""Fields of a provenance that are texts."""


ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Provenance:
    """Who made a trajectory, and how.

    simulator  "deltac", or the name of the program that wrote the log
    solver     the solver's name, if known
    step       fixed step of the solver, s (not the spacing of the samples, which may be wider)
    order      nominal order of the solver in the state, for smooth forces
    tolerance  relative tolerance of an adaptive solver
    model      name of the model
    model_hash fingerprint of the model, to tell whether a ledger uses the same one
    completed  False when the run stopped before its end; `message` then says why
    ended      the event of the user's that ended it, in words
    equations  name of equations by hand that were integrated in place of the model's
    coordinates  own generalized speeds in which the integrals of Kane–Levinson's functions were taken, as
               `CoordinateMap(**…)` takes them; empty for the joints' own
    corrected  what the solver corrected after each step: "energy"
    energy_error  largest |ΔC| of a run's own testing functions, with what corrections undid, J; None where
               none was integrated with the motion
    singular   where the constraints were dependent, in words
    held       channels whose forces were constant over each step, empty if all were functions of time; None
               where nobody said
    inputs     "held" where controls and applied forces were set before each step and kept over it, so that
               what they act through may jump from row to row
    stage      of which instant accelerations and forces are, in words of a recorder
    looked_for kinds of channels that a recorder logs where they act; `acted`: channels that did
    strengths  channel of an actuator -> its generalized force at unit control, by speed
    servo_damping  speed -> damping that is in the force of its servo, N·s/m or N·m·s/rad
    derived    "u", "udot": what was derived from the other columns -> largest error by speed
    converted  columns that a reader converted, with their units; `ignored`: those it did not use
    reading    what columns of a foreign log were read as, and because of what, in one line
    guessed    what of that the log does not declare, and the motion decided; an audit is less sure of it
    repairs    slips of the log that were undone, such as "degrees"
    notes      anything else worth keeping, text by text

    Raises InputError for a value of the wrong type or an impossible step or tolerance.
    """

    simulator: str
    solver: str | None = None
    step: float | None = None
    order: int | None = None
    tolerance: float | None = None
    model: str | None = None
    model_hash: str | None = None
    completed: bool = True
    message: str = ""
    ended: str = ""
    equations: str = ""
    coordinates: Mapping[str, Any] = field(default_factory=dict, hash=False)
    corrected: str = ""
    energy_error: float | None = None
    singular: str = ""
    held: tuple[str, ...] | None = None
    inputs: str = ""
    stage: str = ""
    looked_for: tuple[str, ...] = ()
    acted: tuple[str, ...] = ()
    strengths: Mapping[str, Sequence[float]] = field(default_factory=dict, hash=False)
    servo_damping: Mapping[str, float] = field(default_factory=dict, hash=False)
    derived: Mapping[str, Mapping[str, float]] = field(default_factory=dict, hash=False)
    converted: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    reading: str = ""
    guessed: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    notes: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not isinstance(self.simulator, str) or not self.simulator:
            raise _unfit("simulator", self.simulator, "a name")
        if not isinstance(self.completed, bool | np.bool_):
            raise _unfit("completed", self.completed, "True or False")
        if not isinstance(self.notes, Mapping) or not all(
            isinstance(text, str) for item in self.notes.items() for text in item
        ):
            raise _unfit("notes", self.notes, "a mapping of text to text")
        _set(self, "completed", bool(self.completed))
        _set(self, "step", _positive("step", self.step, zero=False))
        if self.order is not None and not (isinstance(self.order, int) and self.order >= 1):
            raise _unfit("order", self.order, "a whole number, 1 or more, or None")
        _set(self, "tolerance", _positive("tolerance", self.tolerance, zero=True))
        _set(self, "energy_error", _positive("energy_error", self.energy_error, zero=True))
        for name in _TEXTS:
            value, default = getattr(self, name), getattr(Provenance, name)
            if not isinstance(value, str) and (value is not None or default is not None):
                raise _unfit(name, value, "text or None" if default is None else "text")
        for name in ("held", "looked_for", "acted", "converted", "ignored", "guessed", "repairs"):
            values = getattr(self, name)
            if values is None and name == "held":
                continue
            if not isinstance(values, list | tuple) or not all(isinstance(v, str) for v in values):
                raise _unfit(name, values, "a list of names")
            _set(self, name, tuple(values))
        for name in MAPPINGS:
            if not isinstance(getattr(self, name), Mapping):
                raise _unfit(name, getattr(self, name), "a mapping")
            _set(self, name, MappingProxyType(dict(getattr(self, name))))
        for speed, size in self.servo_damping.items():
            if not isinstance(size, int | float) or not np.isfinite(size):
                raise _unfit("servo_damping", size, f"a finite number (speed {speed!r})")

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild(self, **{name: dict(getattr(self, name)) for name in MAPPINGS})


@checked
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Trajectory(Shown, Once):
    """Samples of a motion; immutable, validated, rows in time order.

    t           (T,) time, s, strictly increasing
    q           (T, nq) coordinates of all joints, prescribed ones too (m, rad; quaternions 1)
    u           (T, nu) speeds of all joints (m/s, rad/s)
    coordinates nq names, `<joint>` or `<joint>.<part>`
    speeds      nu names, likewise
    udot        (T, nu) time derivatives of the speeds, or None when not known
    forces      channel -> (T, nu) generalized force (N, N·m); its power, the product with u, is
                positive when it adds energy to the system
    works       channel -> (T,) work that it did on the system, J, integrated in the loop by the solver, or
                by a recorder at the stages of the solver, from the first row on; that of impulses is told
                by `events`
    stages      (T, s, nu) generalized forces, all but those of springs and dampers together, at the s later
                stages of the step that the solver made from each row; or None when not known
    integrals   testing function -> (T,) integral over time of its power P, J, taken in the loop
                by the solver, from the first row on
    provenance  who made it
    events      what happened between the rows, in time order: impacts (where speeds jump), switches,
                events; a row at the time of one holds the state after it
    mechanism   what moved, where the run was simulated here: `position`, `velocity` and the like need no
                model then. It is no part of a log: of one that was read, say
                `dc.kinematics(model, run).position("bar")`

    The arrays are copied to float64 and made read-only. Raises InputError for a wrong shape or
    type, no rows, time that does not increase, a value that is not finite, an unusable name.
    """

    t: Array
    q: Array
    u: Array
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    udot: Array | None = None
    forces: ByChannel = field(default_factory=dict)
    works: ByChannel = field(default_factory=dict)
    stages: Array | None = None
    integrals: Mapping[str, Array] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=lambda: Provenance("unknown"))
    events: tuple[Occurrence, ...] = ()
    mechanism: Mechanism | None = field(default=None, metadata={"json": False})

    def __post_init__(self) -> None:
        _set(self, "coordinates", _names("coordinates", self.coordinates))
        _set(self, "speeds", _names("speeds", self.speeds))
        for name in ("forces", "works", "integrals"):
            value = getattr(self, name)
            if not isinstance(value, Mapping):
                raise WrongType(
                    f"{name}: found {shown(value)}, expected a mapping of names to values"
                )
        for name in ("forces", "works"):
            value = getattr(self, name)
            _names(name, value)
            _set(self, name, {ChannelName.parse(channel): value[channel] for channel in value})
        _names("integrals", self.integrals)
        if not isinstance(self.provenance, Provenance):
            raise _unfit("provenance", self.provenance, "a Provenance")

        _set(self, "t", _times(self.t))
        _set(self, "q", self._samples("q", self.q, self.coordinates))
        _set(self, "u", self._samples("u", self.u, self.speeds))
        if self.udot is not None:
            _set(self, "udot", self._samples("udot", self.udot, self.speeds))
        forces = {
            channel: self._samples(f"force.{channel}", values, self.speeds)
            for channel, values in self.forces.items()
        }
        _set(self, "forces", MappingProxyType(forces))
        if self.stages is not None:
            _set(self, "stages", self._at_stages(np.asarray(self.stages)))
        for name, prefix in (("works", "work"), ("integrals", "integral")):
            sums = {
                key: self._samples(f"{prefix}.{key}", values, None)
                for key, values in getattr(self, name).items()
            }
            _set(self, name, MappingProxyType(sums))
        _set(self, "events", tuple(self.events))
        self._check_events()

    def _check_events(self) -> None:
        before = -math.inf
        for event in self.events:
            if not isinstance(event, Occurrence):
                raise LogError(f"events: found {event!r}, expected an Occurrence")
            if not max(before, self.t[0]) <= event.t <= self.t[-1]:
                raise LogError(
                    f"events: {event!r} is out of order, or outside the rows from {self.t[0]} to "
                    f"{self.t[-1]} s"
                )
            sizes = (len(event.q), len(event.u_before), len(event.u_after))
            if sizes != (len(self.coordinates), len(self.speeds), len(self.speeds)):
                raise LogError(
                    f"events: {event!r} has {sizes[0]} coordinates and {sizes[1]} speeds, the rows have "
                    f"{len(self.coordinates)} and {len(self.speeds)}"
                )
            if (event.udot_before is None) != (self.udot is None):
                raise LogError(f"events: {event!r} and the rows must both have udot, or neither")
            before = event.t

    def _at_stages(self, values: Array) -> Array:
        if values.ndim != 3:
            raise LogError(f"stages: found shape {values.shape}, expected (T, s, nu)")
        each = [
            self._samples(f"stage{k + 2}", values[:, k], self.speeds)
            for k in range(values.shape[1])
        ]
        stages = np.stack(each, axis=1) if each else np.zeros(values.shape)
        stages.flags.writeable = False
        return stages

    def _samples(self, label: str, values: Any, names: tuple[str, ...] | None) -> Array:
        """`values` as a finite (T, len(names)) array, or (T,) when there are no names."""
        array = as_numbers(label, values)
        shape = (len(self.t),) if names is None else (len(self.t), len(names))
        if array.shape != shape:
            turned = array.ndim == 2 and array.shape[::-1] == shape
            remedy = "Time comes first: transpose it." if turned else _shape_meaning(names)
            raise LogError(f"{label}: found shape {array.shape}, expected {shape}. {remedy}")
        finite = np.isfinite(array)
        if not finite.all():
            row, *column = np.argwhere(~finite)[0]
            name = label if names is None else f"{label}.{names[column[0]]}"
            raise LogError(
                f"column {name!r}, {row_name(row, len(array))}, t = {self.t[row]} s: found "
                f"{array[(row, *column)]}, expected a finite number. "
                f"{'Keep only the rows before it' if row else 'Drop the row'}, or repair the source."
            )
        return array

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return f"Trajectory({self.summary()})"

    def summary(self) -> str:
        """Who made it, how long it is and what it holds, in one line."""
        p = self.provenance
        what = [p.simulator if p.solver is None else f"{p.simulator} {p.solver}"]
        if p.model:
            what.append(p.model)
        what.append(f"{len(self)} rows, {self.t[0]:g} … {self.t[-1]:g} s")
        what.append(f"{len(self.coordinates)} coordinates, {len(self.speeds)} speeds")
        if self.udot is not None:
            what.append("udot")
        if self.forces:
            what.append(f"{len(self.forces)} channels")
        if self.integrals:
            what.append("integrals of " + ", ".join(self.integrals))
        if self.events:
            what.append(f"{len(self.events)} events")
        if "duration" in p.notes:
            what.append(p.notes["duration"])
        if not p.completed:
            what.append("stopped early" + (f": {p.message}" if p.message else ""))
        return "; ".join(what)

    def sections(self) -> Iterator[Section]:
        """Tables of coordinates and speeds with their ranges, of channels, and of what happened."""

        def row(name: str, values: Array) -> tuple[str, ...]:
            statistics = (values[0], values[-1], values.min(), values.max())
            return (name, *(number(float(x)) for x in statistics))

        rows = [row(f"q {name}", values) for name, values in zip(self.coordinates, self.q.T)]
        rows += [row(f"u {name}", values) for name, values in zip(self.speeds, self.u.T)]
        yield Table(("", "first", "last", "least", "largest"), tuple(rows))
        channels = tuple((str(name), number(max_norm(f))) for name, f in self.forces.items())
        yield Table(("channel", "largest |force| (N, N·m)"), channels)
        events = tuple((f"{event.t:.6g}", ", ".join(event.names)) for event in self.events)
        yield Table(("time (s)", "what happened"), events)
        if self.provenance.message:
            yield self.provenance.message

    def __reduce__(self) -> tuple[Any, ...]:
        mappings = ("forces", "works", "integrals")
        changes = {name: dict(getattr(self, name)) for name in mappings}
        return _rebuild(self, **changes, mechanism=None)

    # --- kinematics, of a run that knows its mechanism ---------------------------------------------

    def position(self, body: str, point: VectorLike = ORIGIN) -> Array:
        """Where a point of a body, in the body's frame, is (T, 3), m, world components."""
        place: Array = self._kinematics().position(body, point)
        return place

    def velocity(self, body: str, point: VectorLike = ORIGIN) -> Array:
        """Velocity of a body's material point (T, 3), m/s, world components."""
        vector: Array = self._kinematics().velocity(body, point)
        return vector

    def orientation(self, body: str) -> Array:
        """Rotation matrices (T, 3, 3): columns are the body's axes in the world."""
        matrix: Array = self._kinematics().orientation(body)
        return matrix

    def angular_velocity(self, body: str) -> Array:
        """Angular velocity of a body (T, 3), rad/s, world components."""
        vector: Array = self._kinematics().angular_velocity(body)
        return vector

    def contact_point(self, constraint: str) -> Array:
        """Where a wheel, disc or sphere that rolls touches its plane (T, 3), m."""
        place: Array = self._kinematics().contact_point(constraint)
        return place

    @functools.cached_property
    def multipliers(self) -> Mapping[str, Array]:
        """λ of each constraint (T, rows), N and N·m, by the mechanism's equations at the rows of the run.

        The sign is that of M u̇ + h = f + Gᵀλ; rows that follow from others have none. Gᵀλ itself is in
        `forces`, as ``constraint <name>``.
        """
        evaluation = service("evaluate")(self._known("multipliers"), self)
        names = dict.fromkeys(evaluation.rows)
        return MappingProxyType(
            {
                name: evaluation.multipliers[
                    :, [k for k, row in enumerate(evaluation.rows) if row == name]
                ]
                for name in names
            }
        )

    def _kinematics(self) -> Any:
        mechanism = self._known("kinematics")
        return service("kinematics")(mechanism, self)

    def _known(self, what: str) -> Mechanism:
        if self.mechanism is None:
            verb = "kinematics(model, run)"
            if what == "multipliers":
                verb = "evaluate(model, run).multipliers"
            raise StateError(
                f"{what}: this trajectory was read from a log and does not know its mechanism; use "
                f"deltac.{verb}"
            )
        return self.mechanism

    @property
    def duration(self) -> float:
        """Time between the first and the last row, s."""
        return float(self.t[-1] - self.t[0])

    def coordinate(self, name: str) -> Array:
        """Samples (T,) of one coordinate; InputError for an unknown name."""
        return _pick(self.q, "coordinate", name, self.coordinates)

    def speed(self, name: str) -> Array:
        """Samples (T,) of one speed; InputError for an unknown name."""
        return _pick(self.u, "speed", name, self.speeds)

    def every(self, n: int) -> Trajectory:
        """The rows 0, n, 2n, …; works and integrals keep their values, for the solver took them in between.

        The last row stays only when n divides `len(run) - 1`.
        """
        try:
            stride = operator.index(n)
        except TypeError:
            stride = 0
        if stride < 1:
            raise InputError(f"every({n!r}): expected a whole number of rows, 1 or more")
        return self.take(slice(None, None, stride))

    def between(self, t0: float, t1: float) -> Trajectory:
        """The rows with t0 <= t <= t1 (s); works and integrals start anew, from zero at the first of them.

        Raises InputError when no row lies there.
        """
        rows = slice(
            int(np.searchsorted(self.t, t0, "left")), int(np.searchsorted(self.t, t1, "right"))
        )
        if math.isnan(t0) or math.isnan(t1) or rows.start >= rows.stop:
            raise InputError(
                f"between({t0!r}, {t1!r}): there is no row in between; "
                f"the rows go from {self.t[0]} to {self.t[-1]} s"
            )
        part = self.take(rows)
        works = {name: values - values[0] for name, values in part.works.items()}
        integrals = {name: values - values[0] for name, values in part.integrals.items()}
        return replace(part, works=works, integrals=integrals)

    def take(self, rows: slice | npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> Trajectory:
        """Some of the rows, at least one: a slice, places in ascending order, or a mask (T,).

        Works and integrals keep their values; of the events those between the first and the last row stay.

        Raises:
            InputError: no rows, rows that the trajectory does not have, or not in ascending order.
        """
        try:
            places = np.arange(len(self))[rows]
        except IndexError as error:
            raise InputError(
                f"rows: {error}; expected a slice, places from 0 to {len(self) - 1} or a mask ({len(self)},)"
            ) from None
        if not len(places) or (np.diff(places) <= 0).any():
            interpolated = (
                "none"
                if not len(places)
                else f"row {places[np.diff(places).argmin() + 1]} twice or late"
            )
            raise InputError(
                f"rows: found {interpolated}; expected at least one, in ascending order"
            )
        part = column_by_column([self], lambda columns: columns[0][rows])
        first, last = part.t[0], part.t[-1]
        return replace(part, events=tuple(e for e in self.events if first <= e.t <= last))

    @classmethod
    def from_scipy(
        cls,
        result: SolverResult,
        model: object,
        *,
        order: str | Sequence[str] | None = None,
        coordinates: CoordinateMap | str | None = None,
        equations: object = None,
        provenance: Provenance | None = None,
    ) -> Trajectory:
        """The trajectory of what an ODE solver returned, for a model.

        A result of `solve_ivp` has the solver's own steps as rows, or with ``t_eval`` values in between,
        which obey the equations less exactly; with ``dense_output=True`` the own steps are taken in any case.

        Args:
            result: of SciPy's `solve_ivp`; of diffrax; or a pair (t, y) of times (T,) and states (T, n), as
                `odeint` gives them.
            model: what moved: a Mechanism, a Problem, or what else `load_model` takes.
            order: what the entries of y are, such as ``("a", "u.a", "b", "u.b")``, or "interleaved" for just
                that. By default it is found out: coordinates and then speeds, the reverse, or interleaved.
            coordinates: the coordinates and speeds of y, as for `check_equations`: a CoordinateMap, "joint"
                or "absolute".
            equations: the function (or `Equations`) that was integrated; with it the trajectory has
                accelerations, and an audit tests the equations as well.
            provenance: what is known of the solver, such as ``Provenance("SciPy", solver="RK45")``.

        Raises:
            InputError: states of another size, or of which no usual order makes sense; the message has the
                names for `order`.
        """
        run: Trajectory = service("trajectory_of_states")(
            result,
            model,
            order=order,
            coordinates=coordinates,
            equations=equations,
            provenance=provenance,
        )
        return run

    def to_frame(self) -> polars.DataFrame:
        """A polars DataFrame with the columns of the log schema (see `schema`)."""
        import polars

        return polars.DataFrame(service("to_columns")(self))

    def write(self, path: str | Path) -> None:
        """Write a `.parquet` or `.csv` log; see `deltac.write_trajectory`."""
        service("write_trajectory")(self, path)


def row_name(row: int, rows: int) -> str:
    """How messages name a row, so that it is clear from where rows are counted."""
    return f"row {row} (of 0 to {rows - 1})"


def _times(values: Any) -> Array:
    t = as_numbers("time", values)
    if t.ndim != 1:
        raise LogError(f"time: found shape {t.shape}, expected (T,): one time for each row")
    if not len(t):
        raise LogError("time: found no rows, expected at least one")
    check_times(t)
    return t


def check_times(t: Array) -> None:
    """LogError, unless times (T,) are finite and strictly increase."""
    finite, forward = np.isfinite(t), t[1:] > t[:-1]
    if not finite.all():
        row = int(np.argmin(finite))
        raise LogError(
            f"column 'time', {row_name(row, len(t))}: found {t[row]}, "
            "expected a finite time in seconds. Drop the row, or repair the source."
        )
    if not forward.all():
        row = int(np.argmin(forward)) + 1
        again = t[0] <= t[row] <= t[0] + np.abs(np.diff(t)).min() and t[row] < t[row - 1]
        remedy = (
            "The clock starts again there: give each episode a log of its own."
            if again
            else "Sort the rows, or drop the repeated ones."
        )
        raise LogError(
            f"column 'time', {row_name(row, len(t))}: found {t[row]} after {t[row - 1]}, "
            f"expected times that strictly increase. {rounded_clock(t) or remedy}"
        )


def rounded_clock(t: Array) -> str:
    """What to do with times (T,) that are those of an even clock, rounded to more than a row; else nothing.

    The clock is the straight line through the ends: each time is within a unit of its last digit of it. Most
    times are there twice or more; where few are, rows may be copies.
    """
    steps = np.diff(t)
    unit = float(steps[steps > 0.0].min(initial=np.inf))
    even, exact = np.linspace(t[0], t[-1], len(t)), float(t[-1] - t[0]) / (len(t) - 1)
    near = np.abs(t - even).max() <= unit * (1.0 + 1e-6)
    if (steps < 0.0).any() or not 0.0 < 2.0 * exact <= unit or not near:
        return ""
    uncertain = 2.0 * unit / (len(t) - 1)
    shortest = (float(f"{exact:.{digits}g}") for digits in range(1, 18))
    step = next(value for value in shortest if abs(value - exact) <= uncertain)
    return (
        f"The times are those of rows {step:g} s apart, rounded to {unit:.3g} s. If so, read them by --step "
        f"{step:g}, or in a mapping by [log] time = {{ step = {step:g} }}. If whole rows repeat, drop the "
        "copies."
    )


def _names(what: str, names: Iterable[str]) -> tuple[str, ...]:
    """`names` as a tuple of distinct names that every log format can hold."""
    if isinstance(names, str):
        raise WrongType(f"{what}: found the text {names!r}, expected several names; use a tuple")
    names = tuple(names)
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise LogError(f"{what}: found {name!r}, expected a name that is not blank")
        # Control characters, lone surrogates and line separators do not survive a text file.
        lost = ("Cc", "Cs", "Zl", "Zp")
        if not name.isprintable() and any(unicodedata.category(c) in lost for c in name):
            raise LogError(f"{what}: {name!r} has a control character or a line break; rename it")
    if len(set(names)) < len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise LogError(f"{what}: {twice!r} appears twice; names must be distinct")
    return names


def _pick(values: Array, what: str, name: str, names: Sequence[str]) -> Array:
    check_names([name], names, f"unknown {what}")
    column: Array = values[:, names.index(name)]
    return column


def _shape_meaning(names: tuple[str, ...] | None) -> str:
    if names is None:
        return "One value for each time."
    return f"One row for each time, one column for each of {', '.join(names) or 'no names'}."


def _positive(name: str, value: Any, *, zero: bool) -> float | None:
    """`value` as a finite float above zero (or at zero, where allowed); None passes."""
    if value is None:
        return None
    size = math.nan if isinstance(value, bool | str) else number_or_nan(value)
    if not (0.0 < size < math.inf or (zero and size == 0.0)):
        raise _unfit(name, value, "a finite number, " + ("0 or more" if zero else "above 0"))
    return size


def _unfit(name: str, value: Any, expected: str) -> InputError:
    return LogError(f"provenance: {name} is {shown(value)}, expected {expected}")


def _set(instance: Any, name: str, value: Any) -> None:
    object.__setattr__(instance, name, value)


def _rebuild(instance: Provenance | Trajectory, **changes: Any) -> tuple[Any, ...]:
    """For `__reduce__`: read-only mappings do not pickle, and arrays come back writeable."""
    values = {f.name: getattr(instance, f.name) for f in fields(instance)} | changes
    make: Callable[..., Any] = type(instance)
    return functools.partial(make, **values), ()


def column_by_column(
    runs: Sequence[Trajectory], operation: Callable[[list[Array]], Array]
) -> Trajectory:
    """A trajectory each of whose columns is an `operation` on those of several runs that all have it.

    Events stay out; what else there is of a run is the first one's.
    """
    columns: dict[str, Any] = {
        n: operation([getattr(run, n) for run in runs]) for n in ("t", "q", "u")
    }
    for name in ("udot", "stages"):
        some = [getattr(run, name) for run in runs if getattr(run, name) is not None]
        columns[name] = operation(some) if len(some) == len(runs) else None
    for group in ("forces", "works", "integrals"):
        members = [getattr(run, group) for run in runs]
        names = [name for name in members[-1] if all(name in one for one in members)]
        columns[group] = {name: operation([one[name] for one in members]) for name in names}
    return replace(runs[0], events=(), **columns)
