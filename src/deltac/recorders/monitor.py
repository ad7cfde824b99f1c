"""`Monitor`: the energy balance of a simulation while it runs, in constant memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arguments import checked
from deltac.arrays import Array
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.energy.live import SUMS, Given, LiveKernels, live_kernels
from deltac.energy.sampling.quadrature import ORDERS
from deltac.errors import (
    ArgumentsError,
    DeltacError,
    InputError,
    RecordingError,
    StateError,
    UnknownName,
)
from deltac.mechanism.channels import ChannelName
from deltac.models import ModelLike, load_model
from deltac.recorders.builder import simulator

if TYPE_CHECKING:
    from deltac.recorders.gymnasium_monitor import MonitoredEnv
    from deltac.recorders.mujoco_monitor import MujocoMonitor

Forces = Mapping[str, Sequence[float] | Array]
"""Channel -> generalized force (nu,), N or N·m; positive power adds energy to the system."""


class BoundExceeded(DeltacError):
    """ΔC of a running simulation left its bound; `monitor` has the numbers."""

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
    ``work="samples"``, taken through two rows at a time; with held forces that of ``work="discrete"``.

    Attributes:
        t: time of the last row, s.
        delta_c: ΔC there (J); error_bar: its numerical uncertainty (quadrature and rounding).
        change: by how much ΔC changed in the last step, J.
        energy_exchanged: ∫Σ|P| dt + range(K) + range(V) so far, J.
        limit: what |ΔC| is compared with: bound + tolerance · energy_exchanged, J.
        inside: whether |ΔC| is within the limit, or may be within its error bar. within: whether in
            addition the last step kept `rate`.
        rows: number of rows so far.
    """

    def __init__(
        self,
        model: ModelLike,
        *,
        bound: float | None = None,
        tolerance: float | None = None,
        rate: float | None = None,
        on_exceed: Callable[[Monitor], object] | None | str = "raise",
        testing: str = "wang",
    ) -> None:
        """A monitor that has not seen any row yet.

        Args:
            model: what the motion is tested against; what `load_model` takes.
            bound: accepted |ΔC|, J; None: any, if there is no tolerance either.
            tolerance: accepted |ΔC| as a fraction of the energy exchanged so far, added to `bound`. Alone
                it is strict at the start of a motion, when hardly any energy was exchanged: a method of first
                order is off by a large part of it in its first steps.
            rate: accepted change of ΔC per second (W), for each step; None: any. For solvers that control
                their step by it.
            on_exceed: what happens beyond. "raise": `BoundExceeded`; a function: it is called with the
                monitor; None: `update` returns False, and that is all.
            testing: the testing function.

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
        self.on_exceed, self._testing = on_exceed, testing
        self._kernels: LiveKernels | None = None
        self.reset()

    def __repr__(self) -> str:
        return (
            f"Monitor({self.mechanism.name}: t = {self.t:g} s, ΔC = {self.delta_c:.3g} ± "
            f"{self.error_bar:.1g} J of {self.energy_exchanged:.4g} J exchanged)"
        )

    def reset(self) -> None:
        """Forget all rows: the next one is the first of a new motion."""
        self.t = float("nan")
        self.delta_c = self.error_bar = self.change = self.energy_exchanged = 0.0
        self.limit, self.inside, self.within, self.rows = self.bound, True, True, 0
        self._pair: _Pair | None = None
        self._pending = False

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
        forces, held, nu = forces or {}, held or {}, len(self.mechanism.speeds)
        if self._kernels is None or not self.rows:
            self._begin(t, q, u, udot, forces, held)
        kernels = self._kernels
        assert kernels is not None
        if (udot is not None) != kernels.given.rated:
            raise RecordingError(
                f"t = {t:g} s: accelerations must be given in every row or in none"
            )
        acting = {name: _sized(name, f, nu) for name, f in (*forces.items(), *held.items())}
        if not acting.keys() <= self._order.keys():
            self._extend(forces, held)
        q, u = _sized("q", q, len(self.mechanism.coordinates)), _sized("u", u, nu)
        udot = None if udot is None else _sized("udot", udot, nu)
        row = self._next_row(t)
        self._fill(row, q, u, udot)
        channels = row[self._places["forces"]]
        channels[:] = 0.0
        for name, force in acting.items():
            k = self._order[name]
            channels[k * nu : (k + 1) * nu] = force
        return self.judge(self._take(t))

    def reject(self) -> None:
        """Take the last row back: the step that led to it is to be taken again, smaller.

        Raises InputError where there is no such row: only the last one can be taken back, and not the first.
        """
        if not self._pending or self._pair is None:
            raise RecordingError("there is no step to be taken back: reject() follows an update()")
        self._pending = False
        self.rows -= 1
        self.t = float(self._x[0])
        self.delta_c, self.error_bar, self.energy_exchanged = self._before
        self.change, self.inside, self.within = 0.0, True, True

    @property
    def work(self) -> dict[ChannelName, float]:
        """The work of each channel so far, J; that of sources with a potential is what it lost."""
        kernels = self._kernels
        if kernels is None or not self.rows:
            return {}
        sums = self._sums if self._pending else self._sums_before
        works = dict(zip(kernels.channels, map(float, sums[len(SUMS) :])))
        potentials = sums[len(SUMS) + len(kernels.channels) :]
        for name, before, now in zip(kernels.sources, self._start, potentials):
            if name not in works:
                works[name] = float(before - now)
                if name in kernels.driven:
                    works[name] += works[ChannelName("prescribed", name.element)]
        return works

    def mujoco(self, model: Any, data: Any) -> MujocoMonitor:
        """This monitor beside a MuJoCo simulation, from its present state on.

        >>> watch = dc.Monitor(model, bound=1e-3).mujoco(model, data)  # doctest: +SKIP
        >>> while data.time < 1.0:  # doctest: +SKIP
        ...     mujoco.mj_step(model, data)
        ...     watch.update()
        """
        from deltac.recorders.mujoco_monitor import MujocoMonitor

        return MujocoMonitor(self, model, data)

    def gymnasium(self, env: Any) -> MonitoredEnv:
        """This monitor in a Gymnasium environment of MuJoCo: ΔC in the info of each step.

        >>> env = gymnasium.make("HalfCheetah-v5")  # doctest: +SKIP
        >>> env = dc.Monitor(env.unwrapped.model, tolerance=0.05).gymnasium(env)  # doctest: +SKIP
        """
        simulator("gymnasium", "models")
        from deltac.recorders.gymnasium_monitor import MonitoredEnv

        return MonitoredEnv(env, self)

    def judge(self, within: bool) -> bool:
        """Do what `on_exceed` says unless the last row is within the bounds; returns whether it is."""
        if not within:
            if self.on_exceed == "raise":
                raise BoundExceeded(self)
            if callable(self.on_exceed):
                self.on_exceed(self)
        return within

    def take(
        self, t: float, q: Array, u: Array, udot: Array | None, forces: Iterable[Array]
    ) -> bool:
        """`update` without its checks and without `on_exceed`, after the first row: for simulators' loops.

        `forces`: those of all channels, in the order of the first row. Returns whether the row is within the
        bounds.
        """
        row = self._next_row(t)
        if self._all_free:
            parts = (q, u, *forces) if udot is None else (q, u, udot, *forces)
            np.concatenate(parts, out=row[1:])
        else:
            self._fill(row, q, u, udot)
            np.concatenate((*forces,), out=row[self._places["forces"]])
        return self._take(t)

    # --- rows ------------------------------------------------------------------------------------

    def _begin(
        self, t: float, q: Any, u: Any, udot: Any, forces: Iterable[str], held: Iterable[str]
    ) -> None:
        """What rows bring, from the first one; kernels and buffers for it."""
        given = Given(
            tuple(map(ChannelName.parse, forces)),
            tuple(map(ChannelName.parse, held)),
            udot is not None,
        )
        both = set(given.forces) & set(given.held)
        if both:
            raise ArgumentsError(f"channels given both as forces and as held: {', '.join(both)}")
        q = _sized("q", q, len(self.mechanism.coordinates))
        self._origin = (float(t), q[self.mechanism.free.q])
        self._set_up(given)

    def _set_up(self, given: Given) -> LiveKernels:
        """Kernels and empty buffers for rows that bring this."""
        mechanism = self.mechanism
        free = self._free = mechanism.free
        kernels = live_kernels(mechanism, given, self._testing, self._origin)
        self._kernels = kernels
        self._order: dict[str, int] = {name: k for k, name in enumerate(given.channels)}
        n = len(free.u)
        sizes = {"t": 1, "q": len(free.q), "u": n, "udot": n if given.rated else 0}
        sizes["forces"] = len(mechanism.speeds) * len(given.channels)
        ends = np.cumsum([0, *sizes.values()])
        self._places = {name: slice(a, b) for name, a, b in zip(sizes, ends, ends[1:])}
        self._x = np.zeros(kernels.step.n_in)
        self._y = np.zeros(kernels.step.n_out)
        self._row_before, self._row = self._x[: kernels.row], self._x[kernels.row :][: kernels.row]
        self._sums_before = self._x[2 * kernels.row :]
        self._sums = self._y[kernels.step.output_slices["sums"]]
        self._at = {name: place.start for name, place in kernels.step.output_slices.items()}
        self._all_free = n == len(mechanism.speeds)
        kernels.step.compile(single=True)
        if kernels.skipped is not None:
            kernels.skipped.compile(single=True)
        return kernels

    def _extend(self, forces: Iterable[str], held: Iterable[str]) -> None:
        """Channels that appear later: kernels with room for them, the sums so far carried over."""
        old, pair = self._kernels, self._pair
        assert old is not None and pair is not None
        added = [
            tuple(c for c in map(ChannelName.parse, names) if c not in old.given.channels)
            for names in (forces, held)
        ]
        own = [part.name for part in equations_of_motion(self.mechanism).channels]
        for name in (*added[0], *added[1]):
            if name in own:
                raise UnknownName(
                    f"channel {name!r} is the model's own, and the first row did not give it; give it there"
                )
        self._commit()
        pair.restart(self._row_before, self._sums_before)
        before, sums, order, start = self._row_before, self._sums_before, self._order, self._places
        given = replace(
            old.given, forces=old.given.forces + added[0], held=old.given.held + added[1]
        )
        kernels = self._set_up(given)
        common, nu = start["forces"].start, len(self.mechanism.speeds)
        self._row_before[:common] = before[:common]
        for channel, k in self._order.items():
            if channel in order:
                here, there = (
                    slice(common + j * nu, common + (j + 1) * nu) for j in (k, order[channel])
                )
                self._row_before[here] = before[there]
        works = dict(zip(old.channels, sums[len(SUMS) :]))
        self._sums_before[: len(SUMS)] = sums[: len(SUMS)]
        last = len(SUMS) + len(kernels.channels)
        self._sums_before[len(SUMS) : last] = [works.get(name, 0.0) for name in kernels.channels]
        self._sums_before[last:] = sums[len(SUMS) + len(old.channels) :]
        self._pair = _Pair(kernels, self._row_before, pair)
        self._pair.restart(self._row_before, self._sums_before)

    def _next_row(self, t: float) -> Array:
        """Where the new row is written: the last one, taken back no more, becomes the row before it."""
        self._commit()
        if not self.rows:
            return self._row_before
        if t < self.t or not isfinite(t):
            raise RecordingError(
                f"t = {t:g} s comes after {self.t:g} s: times must not decrease; call reset() where a new "
                "motion starts"
            )
        return self._row if t > self.t else self._row_before

    def _fill(self, row: Array, q: Array, u: Array, udot: Array | None) -> None:
        places, free = self._places, self._free
        row[places["q"]] = q if self._all_free else q[free.q]
        row[places["u"]] = u if self._all_free else u[free.u]
        if udot is not None:
            row[places["udot"]] = udot if self._all_free else udot[free.u]

    def _take(self, t: float) -> bool:
        """Balance the row that was written, at time t; whether it is within the bounds."""
        kernels, x, y = self._kernels, self._x, self._y
        assert kernels is not None
        if not self.rows:
            return self._first(t)
        if t == self.t:  # a jump: nothing is interpolated across it
            assert self._pair is not None
            self._pair.restart(self._row_before, self._sums_before)
            return self.within
        self._row[0] = t
        kernels.step.single(x, y)
        at = self._at
        self._before = (self.delta_c, self.error_bar, self.energy_exchanged)
        delta_c = y.item(at["delta_c"])
        exchanged = y.item(at["exchanged"])
        bar = y.item(at["rounding"])
        if self._pair is not None and kernels.skipped is not None:
            bar += self._pair.bar(self._row, self._sums)
        self.change = delta_c - self.delta_c
        allowed = None if self.rate is None else self.rate * (t - self.t) + bar - self.error_bar
        self.t, self.delta_c, self.error_bar, self.energy_exchanged = t, delta_c, bar, exchanged
        self.limit = self.bound + self.tolerance * exchanged
        # Written so that NaN is outside.
        self.inside = abs(delta_c) - bar <= self.limit
        self.within = self.inside and (allowed is None or abs(self.change) <= max(allowed, bar))
        self._pending = True
        self.rows += 1
        return self.within

    def _first(self, t: float) -> bool:
        kernels, x, y = self._kernels, self._x, self._y
        assert kernels is not None
        self._row_before[0] = t
        self._row[:] = self._row_before
        self._row[0] = np.nextafter(t, np.inf)  # an interval of no length has no chord
        kernels.step.single(x, y)
        E, K, V = (y.item(self._at[name]) for name in "EKV")
        if not isfinite(E):
            raise StateError(f"t = {t:g} s: the energy of the first row is {E}")
        sources = len(SUMS) + len(kernels.channels)
        self._start = self._sums[sources:].copy()
        self._sums_before[:] = 0.0
        self._sums_before[: len(SUMS)] = E, 0, 0, 0, 0, K, K, V, V, 0
        self._sums_before[sources:] = self._start
        self._pair = _Pair(kernels, self._row_before)
        self.t, self.rows = t, 1
        return True

    def _commit(self) -> None:
        """The last row stands: it becomes the start of the next interval."""
        if not self._pending or self._kernels is None:
            return
        self._sums_before[:] = self._sums
        if self._pair is not None and self._kernels.skipped is not None:
            self._pair.commit(self._row, self._sums)
        self._row_before[:] = self._row
        self._pending = False


class _Pair:
    """Error of the quadrature, by leaving out every second row; and across jumps by the trapezoidal rule.

    As in `balance`, differences are divided by 2^(p/2) − 1, where p is the order of the rule.
    """

    def __init__(self, kernels: LiveKernels, row: Array, before: _Pair | None = None) -> None:
        self._kernel = kernels.skipped
        smooth = kernels.given.rated and not kernels.given.forces  # these are interpolated linearly
        order = ORDERS[2] if smooth else 2
        self._factor: float = 1.0 / (2.0 ** (order / 2) - 1.0)
        self._rows = np.concatenate([row, row])
        self._size = kernels.row
        self._y = np.zeros(1)
        self._open = self._apart = 0.0  # the sums where the pair began
        self._between = False  # whether its first interval is over
        self._off = self._largest = self._jumped = 0.0
        if before is not None:  # it goes on, with more channels
            self._off, self._largest, self._jumped = before._off, before._largest, before._jumped
        self._new = (0.0, 0.0)

    def bar(self, row: Array, sums: Array) -> float:
        """How far the work may be off at a new row."""
        if self._between and self._kernel is not None:
            self._rows[self._size :] = row
            self._kernel.single(self._rows, self._y)
            off = self._off + float(sums[_OPEN]) - self._open - float(self._y[0])
            self._new = off, max(self._largest, abs(off))
            return self._factor * self._new[1] + self._jumped
        return self._factor * self._largest + self._jumped

    def commit(self, row: Array, sums: Array) -> None:
        """The row stands."""
        if not self._between:
            self._between = True
            return
        self._off, self._largest = self._new
        self._start(row, sums)

    def restart(self, row: Array, sums: Array) -> None:
        """A pair begins anew; an interval that was without its second has the other bar."""
        if self._between:
            self._jumped += sums.item(_APART) - self._apart
        self._start(row, sums)

    def _start(self, row: Array, sums: Array) -> None:
        self._rows[: self._size] = row
        self._open, self._apart, self._between = sums.item(_OPEN), sums.item(_APART), False


_OPEN, _APART = SUMS.index("open"), SUMS.index("apart")


def _sized(what: str, values: Any, size: int) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (size,):
        raise InputError(f"{what}: found shape {array.shape}, expected ({size},)")
    return array
