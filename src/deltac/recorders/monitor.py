"""`Monitor`: the energy balance of a simulation while it runs, in constant memory."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.services import service
from deltac.dynamics import MOMENTUM, equations_of, trace
from deltac.energy import (
    CARRIED,
    MOMENTA,
    QUADRATURE,
    RESULTS,
    SETTINGS,
    Given,
    LiveKernels,
    live_kernels,
)
from deltac.errors import (
    ArgumentsError,
    DeltacError,
    InputError,
    RecordingError,
    StateError,
    UnknownName,
    WrongType,
)
from deltac.mechanism import ChannelName
from deltac.models import ModelLike, load_model
from deltac.recorders.recorder import simulator, sized

if TYPE_CHECKING:
    from mujoco import MjData, MjModel

    from deltac.recorders.gymnasium_monitor import MonitoredEnv
    from deltac.recorders.mujoco_monitor import MujocoMonitor

Forces = Mapping[str, Sequence[float] | Array]
"""Channel -> generalized force (nu,), N or N·m; positive power adds energy to the system."""


class BoundExceeded(DeltacError):
    """ΔC of a running simulation exceeded its bound; `monitor` has the numbers."""

    def __init__(self, monitor: Monitor) -> None:
        """With the numbers of the monitor's last row."""
        self.monitor = monitor
        super().__init__(
            f"t = {monitor.t:g} s: ΔC = {monitor.delta_c:.3g} ± {monitor.error_bar:.1g} J, beyond "
            f"{monitor.limit:.3g} J; take a smaller step, or look for the cause with audit"
            if not monitor.inside
            else f"t = {monitor.t:g} s: ΔC changed by {monitor.change:.3g} J in the last step, beyond "
            f"{monitor.rate:.3g} W; take a smaller step"
        )


@checked
class Monitor:
    """ΔC of a running simulation, with its error bar and the works of the channels, row by row.

    >>> monitor = dc.Monitor(mechanism, bound=1e-3)  # doctest: +SKIP
    >>> while t < end:  # doctest: +SKIP
    ...     t, q, u, udot = step(t, q, u)
    ...     monitor.update(t, q, u, udot, forces={"actuator motor": torque})

    Memory and time per row do not depend on the length of the run. ΔC is that of `balance` with
    ``work="samples"``, by quadrature over two rows at a time; with held forces that of ``work="discrete"``.

    Attributes:
        t: time of the last row, s.
    """

    _kernels: LiveKernels
    _even: _Side
    _here: _Side

    def __init__(
        self,
        model: ModelLike,
        *,
        bound: float | None = None,
        tolerance: float | None = None,
        rate: float | None = None,
        on_exceed: Callable[[Monitor], object] | None | str = "raise",
        testing: str | Sequence[str] = "wang",
    ) -> None:
        """A monitor that has not seen any row yet.

        Args:
            model: what the motion is tested against; what `load_model` takes.
            bound: accepted |ΔC|, J; None: any, if there is no tolerance either.
            tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of
                V so far), added to `bound`. Alone it is strict at the start of a motion from rest, when the
                system hardly has any: a method of first order is off by much of it in its first steps.
            rate: accepted change of ΔC per second (W), for each step; None: any. For solvers that control
                their step by it.
            on_exceed: what happens beyond. "raise": `BoundExceeded`; a function: it is called with the
                monitor; None: `update` returns False, and that is all.
            testing: the testing function; with "momentum" beside it, those of the speeds as well
                (`delta_p`), which cost about as much again.

        Raises:
            InputError: there is no such model, or a number is not usable.
        """
        self._model = load_model(model)
        self.mechanism = self._model.mechanism
        for name, value in (("bound", bound), ("tolerance", tolerance), ("rate", rate)):
            if value is not None and not (isfinite(value) and value >= 0.0):
                raise InputError(f"{name}={value!r}: expected a number that is not negative")
        if not (on_exceed is None or on_exceed == "raise" or callable(on_exceed)):
            raise InputError(f"on_exceed={on_exceed!r}: expected 'raise', None or a function")
        if bound is None:
            bound = inf if tolerance is None else 0.0
        self.bound, self.tolerance, self.rate = float(bound), float(tolerance or 0.0), rate
        names = (testing,) if isinstance(testing, str) else tuple(testing)
        energy = [name for name in names if name != MOMENTUM] or ["wang"]
        if len(energy) > 1:
            raise ArgumentsError(
                f"testing: found {', '.join(map(repr, energy))}; expected one energy function, and "
                f"{MOMENTUM!r} for those of the speeds"
            )
        self._testing = (*energy, MOMENTUM) if MOMENTUM in names else (*energy,)
        self.on_exceed = on_exceed
        self.reset()

    def __repr__(self) -> str:
        return (
            f"Monitor({self.mechanism.name}: t = {self.t:g} s, ΔC = {self.delta_c:.3g} ± "
            f"{self.error_bar:.1g} J of {self.energy_exchanged:.4g} J exchanged)"
        )

    def reset(self) -> None:
        """Forget all rows: the next one is the first of a new motion."""
        self.t = float("nan")
        self._begun = self._pending = False

    @property
    def delta_c(self) -> float:
        """ΔC at the last row, J."""
        return self._result("delta_c", 0.0)

    @property
    def error_bar(self) -> float:
        """Numerical uncertainty of ΔC (quadrature and rounding), J."""
        return self._result("error_bar", 0.0)

    @property
    def change(self) -> float:
        """By how much ΔC changed in the last step, J."""
        return self._result("change", 0.0)

    @property
    def energy_exchanged(self) -> float:
        """∫Σ|P| dt + range(K) + range(V) so far, J."""
        return self._result("energy_exchanged", 0.0)

    @property
    def delta_p(self) -> dict[str, float]:
        """ΔP_r = p_r − p_r(0) − ∫ṗ_r dt of each speed at the last row, kg·m/s or kg·m²/s.

        Empty unless "momentum" is among the functions asked for. What leaves its bar tells which equation of
        the simulation differs from the model's.
        """
        return self._momenta("delta_p")

    @property
    def delta_p_bar(self) -> dict[str, float]:
        """Numerical uncertainty of each ΔP (quadrature and rounding), kg·m/s or kg·m²/s."""
        return self._momenta("delta_p_bar")

    @property
    def momentum_exchanged(self) -> dict[str, float]:
        """∫|ṗ_r| dt so far: what ΔP_r is to be compared with, kg·m/s or kg·m²/s."""
        return self._momenta("exchanged")

    def _momenta(self, name: str) -> dict[str, float]:
        side = self._standing
        values = () if side is None else map(float, side.momenta[MOMENTA.index(name)])
        return {} if side is None else dict(zip(self._kernels.speeds, values))

    @property
    def limit(self) -> float:
        """What |ΔC| is compared with: bound + tolerance · (max K + range of V), J."""
        return self._result("limit", self.bound)

    @property
    def inside(self) -> bool:
        """Whether |ΔC| is within the limit, or may be within its error bar."""
        return self._result("inside", 1.0) == 1.0

    @property
    def within(self) -> bool:
        """Whether the row is `inside`, and the step that led to it kept the `rate`."""
        return self._result("within", 1.0) == 1.0

    @property
    def rows(self) -> int:
        """Number of rows so far; one that took the place of another is not counted again."""
        side = self._standing
        return 0 if side is None else 1 + int(side.sums[_STEPS])

    @checked
    def update(
        self,
        t: float,
        q: Sequence[float] | Array,
        u: Sequence[float] | Array,
        udot: Sequence[float] | Array | None = None,
        forces: Forces | None = None,
        held: Forces | None = None,
    ) -> bool:
        """Take the next row.

        The first row decides whether there are accelerations, and which of the model's own forces are given.
        A channel that is missing did not act; one that appears later acts from then on (once, it costs what
        the first row does). A row at the same time as the one before takes its place as the start
        of what follows: say so when a force jumps.

        Args:
            t: time, s.
            q: coordinates (nq,) in the order and units of the mechanism; the array is copied.
            u: speeds (nu,).
            udot: accelerations (nu,); without them speeds are interpolated linearly.
            forces: forces at this instant, by channel; one of the model's own takes its place.
            held: forces that were constant over the step that led to this row, as in engines of first
                order. In the first row they only name the channels.

        Returns:
            Whether the row is within the bounds.

        Raises:
            BoundExceeded: it is not, and `on_exceed` is "raise".
            InputError: the row does not fit the mechanism or the rows before.
        """
        forces, held = forces or {}, held or {}
        for name, entries in (("forces", forces), ("held", held)):
            if not isinstance(entries, Mapping):
                raise WrongType(
                    f"{name}: found {type(entries).__name__}, expected a dictionary: channel -> force (nu,)"
                )
        mechanism, rated = self.mechanism, udot is not None
        nu = len(mechanism.speeds)
        parts = [sized("q", q, len(mechanism.coordinates)), sized("u", u, nu)]
        parts += [sized("udot", udot, nu)] if udot is not None else []
        acting = {name: sized(name, f, nu) for name, f in (*forces.items(), *held.items())}
        first = not self._begun
        if not isfinite(t) or (not first and t < self.t):
            raise RecordingError(
                f"t = {t:g} s comes after {self.t:g} s: times must not decrease; call reset() where a new "
                "motion starts"
            )
        if first:
            named = [tuple(map(ChannelName.parse, names)) for names in (forces, held)]
            rows = Given(named[0], named[1], rated)
            both = set(rows.forces) & set(rows.step_forces)
            if both:
                raise ArgumentsError(
                    f"channels given both as forces and as held: {', '.join(both)}"
                )
            self._origin = (float(t), parts[0][mechanism.free.q])
            self._set_up(rows, None)
        elif rated != self._kernels.inputs.rated:
            raise RecordingError(
                f"t = {t:g} s: accelerations must be given in every row or in none"
            )
        elif not set(acting) <= set(self._kernels.inputs.channels):
            self._extend(forces, held)
        self._commit()
        none = np.zeros(nu)
        parts += [acting.get(name, none) for name in self._kernels.inputs.channels]
        np.concatenate(parts, out=self._new)
        if first:
            self._first(t)
            return True
        return self.judge(self.take(t) if t > self.t else self._again(t))

    def reject(self) -> None:
        """Take the last row back: the step that led to it is to be taken again, smaller.

        Raises InputError where there is no such row: only the last one can be taken back, and not the first.
        """
        if not self._pending:
            raise RecordingError("there is no step to be taken back: reject() follows an update()")
        self._pending = False
        self.t = self._here.row.item(0)

    @property
    def work(self) -> dict[str, float]:
        """The work of each channel so far, J: the decrease of the potential where there is one."""
        side = self._standing
        if side is None:
            return {}
        kernels, sums = self._kernels, side.sums
        works: dict[str, float] = dict(zip(kernels.channels, map(float, sums[len(CARRIED) :])))
        potentials = sums[len(CARRIED) + len(kernels.channels) :]
        for name, before, now in zip(kernels.sources, self._start, potentials):
            if name not in works:
                works[name] = float(before - now)
                if name in kernels.driven:
                    works[name] += works[ChannelName("prescribed", name.element)]
        return works

    def mujoco(self, model: MjModel, data: MjData) -> MujocoMonitor:
        """This monitor beside a MuJoCo simulation, from its present state on.

        >>> watch = dc.Monitor(model, bound=1e-3).mujoco(model, data)  # doctest: +SKIP
        >>> while data.time < 1.0:  # doctest: +SKIP
        ...     mujoco.mj_step(model, data)
        ...     watch.update()
        """
        watched: MujocoMonitor = service("MujocoMonitor")(self, model, data)
        return watched

    def gymnasium(self, env: object) -> MonitoredEnv:
        """This monitor in a Gymnasium environment of MuJoCo: ΔC in the info of each step.

        >>> env = gymnasium.make("HalfCheetah-v5")  # doctest: +SKIP
        >>> env = dc.Monitor(env.unwrapped.model, tolerance=0.05).gymnasium(env)  # doctest: +SKIP
        """
        simulator("gymnasium", "models")
        watched: MonitoredEnv = service("MonitoredEnv")(env, self)
        return watched

    def judge(self, within: bool) -> bool:
        """Do what `on_exceed` says unless the last row is within the bounds; returns whether it is."""
        if not within:
            if self.on_exceed == "raise":
                raise BoundExceeded(self)
            if callable(self.on_exceed):
                self.on_exceed(self)
        return within

    # --- rows, for simulators' loops ------------------------------------------------------------------

    def follow(self, t: float, inputs: Given, memory: Array) -> None:
        """Begin a motion whose rows are found in `memory`, laid out as `given` says, from the present one on.

        It is read at each `take`; nothing is checked there.
        """
        nq, nu = len(self.mechanism.coordinates), len(self.mechanism.speeds)
        q = memory[inputs.place(nq, nu).q :][:nq]
        self._origin = (float(t), q[self.mechanism.free.q])
        self._set_up(inputs, memory)
        self._first(t)

    def take(self, t: float) -> bool:
        """The next row, at a later time t; whether it is within the bounds. `on_exceed` is not asked."""
        side = self._here
        if self._pending:
            self._here = side = side.other
        side.t.value = self.t = t
        if side.skipped is not None:
            side.skipped()
        side.step()
        self._pending = True
        return side.other.within.value == 1.0

    def jump(self) -> None:
        """The row in memory takes the place of the last one, as the start of what follows."""
        self._commit()
        self._again(self.t)

    # --- the two sides ---------------------------------------------------------------------------

    @property
    def _standing(self) -> _Side | None:
        """The side that holds the last row."""
        if not self._begun:
            return None
        return self._here.other if self._pending else self._here

    def _result(self, name: str, before: float) -> float:
        """What was found at the last row; `before` there is one."""
        side = self._standing
        return before if side is None else side.results.item(RESULTS.index(name))

    def _set_up(self, inputs: Given, memory: Array | None) -> None:
        """Kernels and empty sides for rows that bring this."""
        self._kernels = kernels = live_kernels(self.mechanism, inputs, self._testing, self._origin)
        self._new = np.zeros(kernels.step.n_parameters) if memory is None else memory
        even, odd = _Side(kernels), _Side(kernels)
        even.bind(kernels, odd, self._new)
        odd.bind(kernels, even, self._new)
        if kernels.skipped is not None:
            odd.skipped = kernels.skipped.bound(odd.x, odd.skipped_integrals, self._new)
        rate = inf if self.rate is None else self.rate
        even.settings[1:] = self.bound, self.tolerance, rate, 0.0
        odd.settings[1:] = self.bound, self.tolerance, rate, 1.0
        self._even = self._here = even
        self._begun, self._pending = True, False

    def _first(self, t: float) -> None:
        """The first row: nothing was done yet."""
        side, kernels = self._even, self._kernels
        self._again(t)
        self.take(np.nextafter(t, np.inf))  # an interval of no length has no chord
        other_side = side.other
        E, K, V = other_side.results[RESULTS.index("E") :]
        if not (isfinite(t) and isfinite(E)):
            self.reset()
            raise StateError(f"t = {t:g} s: the energy of the first row is {E}")
        sources = len(CARRIED) + len(kernels.channels)
        side.sums[sources:] = other_side.sums[sources:]
        self._start = side.sums[sources:].copy()
        side.sums[: len(CARRIED)] = E, 0, 0, K, K, V, V, 0
        side.momenta[:2] = other_side.momenta[MOMENTA.index("momentum")]
        side.results[:] = 0.0, 0.0, 0.0, 0.0, self.bound, 1.0, 1.0, E, K, V
        self._pending, self.t = False, t

    def _again(self, t: float) -> bool:
        """The new row takes the place of the last one: nothing is interpolated across the two."""
        self._begin_pair()
        even = self._even
        even.t.value = t
        even.step()
        even.row[:] = even.other.row
        return even.within.value == 1.0

    def _commit(self) -> None:
        """The last row stands: it becomes the start of the next interval."""
        if self._pending:
            self._here, self._pending = self._here.other, False

    def _begin_pair(self) -> None:
        """A pair of intervals begins at the last row; one that was without its second has the other bar."""
        side, even = self._here, self._even
        if side is not even:
            side.pair[_JUMPED] += side.pair[_APART] - side.pair[_APART_BEFORE]
            even.memory[:] = side.memory
            self._here = even

    def _extend(self, forces: Iterable[str], step_forces: Iterable[str]) -> None:
        """Channels that appear later: kernels with room for them, the sums so far carried over."""
        old = self._kernels
        added = [
            tuple(c for c in map(ChannelName.parse, names) if c not in old.inputs.channels)
            for names in (forces, step_forces)
        ]
        own = [part.name for part in equations_of(trace(self.mechanism)).channels]
        for name in (*added[0], *added[1]):
            if name in own:
                raise UnknownName(
                    f"channel {name!r} is the model's own, and the first row did not give it; give it there"
                )
        self._commit()
        self._begin_pair()
        inputs = replace(
            old.inputs,
            forces=old.inputs.forces + added[0],
            step_forces=old.inputs.step_forces + added[1],
        )
        before, nu = self._even, len(self.mechanism.speeds)
        self._set_up(inputs, None)
        side, kernels = self._even, self._kernels
        side.pair[:], side.momenta[:] = before.pair, before.momenta
        side.results[:] = before.results
        common = len(before.row) - nu * len(old.inputs.channels)
        side.row[:common] = before.row[:common]
        acted = dict(zip(old.inputs.channels, before.row[common:].reshape(-1, nu)))
        for name, place in zip(inputs.channels, side.row[common:].reshape(-1, nu)):
            place[:] = acted.get(name, 0.0)
        works = dict(zip(old.channels, before.sums[len(CARRIED) :]))
        last = len(CARRIED) + len(kernels.channels)
        side.sums[: len(CARRIED)] = before.sums[: len(CARRIED)]
        side.sums[len(CARRIED) : last] = [works.get(name, 0.0) for name in kernels.channels]
        side.sums[last:] = before.sums[len(CARRIED) + len(old.channels) :]


class _Side:
    """One of two memories. A step reads one and writes the other one, so that it can be taken back.

    A pair of intervals, by which the error of the quadrature is found, begins at the even side: so only the
    odd one takes two intervals as one.
    """

    def __init__(self, kernels: LiveKernels) -> None:
        self.x = np.zeros(kernels.step.n_in)
        (
            self.settings,
            self.skipped_integrals,
            self.row,
            _,
            self.sums,
            pair,
            momenta,
            self.results,
        ) = (self.x[where] for where in kernels.step.input_slices.values())
        self.pair = pair.reshape(len(QUADRATURE), -1)
        self.momenta = momenta.reshape(len(MOMENTA), len(kernels.speeds))
        self.memory = self.x[len(SETTINGS) + len(self.skipped_integrals) :]
        self.t = ctypes.c_double.from_buffer(self.x.data)
        at = kernels.step.input_slices["results"].start + RESULTS.index("within")
        self.within = ctypes.c_double.from_buffer(self.x.data, 8 * at)
        self.skipped: Callable[[], object] | None = None

    def bind(self, kernels: LiveKernels, other: _Side, row: Array) -> None:
        """What a step of this side reads and writes."""
        self.other = other
        self.step = kernels.step.bound(self.x, other.memory, row)


_STEPS = CARRIED.index("steps")
_APART, _JUMPED, _APART_BEFORE = map(QUADRATURE.index, ("apart", "jumped", "apart before"))
