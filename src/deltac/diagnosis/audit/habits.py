"""Habits of a log that are undone before it is judged: filters, late or limited forces, zeros of coordinates.

What went into a digital filter is x + a Dx + b D²x + … of what came out, x, D a derivative in units of rows:
the backward difference in recursive averages, and 2 (1 − z⁻¹)/(1 + z⁻¹) in filters that the trapezoid rule
makes of analogue ones, as Butterworth's (Oppenheim & Schafer, Discrete-Time Signal Processing, §7.1). Forward
and backward, as filters of zero phase are run, it is x + p X x + r X²x + …, where X = −D² is of both
directions. What went in follows from row to row by the equations and an integrator: the numbers are those of
the least prediction errors, by the method of Gauss and Newton.

With s = sin²(ω/2) the trapezoid's X is 4 s/(1 − s): what alternates from row to row does not pass. It is
taken out of states and forces alike, by 1 − sᵐ, beside which 1/(1 − s) is a sum of m powers of s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, product
from typing import TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import qr

from deltac.arrays import NEWTON_STEPS, ROUGHLY, SAME, SMALL_SHARE, Array
from deltac.diagnosis.causes.causes import KINDS
from deltac.diagnosis.causes.columns import ColumnKernels
from deltac.diagnosis.explain.result import sentence
from deltac.diagnosis.inference.attribution import squares
from deltac.diagnosis.inference.forces import impulse
from deltac.diagnosis.inference.hypotheses import CERTAIN, Fit, price
from deltac.diagnosis.inference.inference import FEW, LEAST_ROWS, Unclosed, closed
from deltac.diagnosis.inference.integrators import (
    EXACT,
    INTEGRATORS,
    Integrator,
    Map,
    maps,
    transition,
)
from deltac.diagnosis.inference.interpolation import MOST_LATE
from deltac.diagnosis.inference.linearisation import (
    COLUMNS_OF_THE_LOG,
    NO_MOTION,
    RELINEARISATIONS,
    Flow,
    FlowError,
    Point,
    Tangent,
    cause_columns,
    flow_of,
)
from deltac.diagnosis.inference.methods import SQUARES
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import Observations, observations
from deltac.diagnosis.inference.result import KNOWN, Inference
from deltac.diagnosis.inference.whitening import inverse_sizes
from deltac.diagnosis.measurements.kinematics import stretches
from deltac.diagnosis.verdict import Finding
from deltac.energy.terms import LoggedForces
from deltac.kernels.rows import compiled_rows
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.results import percent
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import RateNames

ORDERS = (2, 4)
"""Orders of the filters that are tried, one after the other."""

LEFT_OF_INPUT = 0.3
"""Share of the prediction errors of a log that may be left of what went into its filter, beside all causes
and beside the few that explain most."""

NOTHING = 0.01
"""The same where the filter is all that is wrong with a log."""

SLOWEST = 1e-5
"""Lowest frequency at which gains are compared, as a fraction of the Nyquist frequency."""

NOTCH = 6
"""The power m of the notch 1 − sᵐ at the Nyquist frequency: flat to order 2m for slow motions."""

OF_S = np.array([-0.25, 0.5, -0.25])
"""s as weights of three neighbouring rows."""


@dataclass(frozen=True, eq=False)
class LowPass:
    """A filter of even order by the numbers of its inverse: a, b, …, or p, r, … if it is run both ways.

    trapezoid  whether D is that of the trapezoid rule
    both_ways  whether it is run forward and backward, which makes its phase zero
    forces     whether logged forces went through it as well
    """

    numbers: tuple[float, ...]
    trapezoid: bool
    both_ways: bool
    forces: bool

    @property
    def low_pass(self) -> bool:
        """Whether it is late or of zero phase, attenuates some frequency by a tenth, and amplifies none.

        The inverse of an amplifier could cancel a motion of a single mode. What attenuates next to nothing,
        or only near the Nyquist frequency, imitates errors of steps.
        """
        frequencies = np.pi * np.geomspace(SLOWEST, 0.99, 400)
        own, rest = (
            np.abs(np.exp(-1j * frequencies[:, None] * np.arange(len(w))) @ w)
            for w in self._weights
        )
        late = self.both_ways or self.numbers[0] > 0.0
        attenuates = np.any(((1.0 - ROUGHLY) * own >= rest)[frequencies <= (1.0 - ROUGHLY) * np.pi])
        return bool(late and attenuates and np.all(own >= (1.0 - SMALL_SHARE) * rest))

    @property
    def delay(self) -> float:
        """How late it is where motions are slow, rows."""
        return 0.0 if self.both_ways else self.numbers[0]

    @property
    def _weights(self) -> tuple[Array, Array]:
        """Weights of neighbouring rows, the earliest first: of the inverse, and of the notch alone."""
        order, trapezoid = len(self.numbers), self.trapezoid
        numbers = np.array([1.0, *self.numbers])
        # 1/(1 − s) and 1 − sᵐ, as often as 1 − s is in the denominator.
        often = (order if self.both_ways else order // 2) if trapezoid else 0
        powers = _power([1.0] * NOTCH, often)
        notch = _power([1.0, *[0.0] * (NOTCH - 1), -1.0], often)
        if self.both_ways:
            own = _combined(numbers, [0.0, 4.0], [1.0, -1.0] if trapezoid else [1.0])
            return _weights_of(np.convolve(own, powers)), _weights_of(notch)
        if trapezoid:
            numbers = numbers * 2.0 ** (np.arange(order + 1) - order)
        own = _combined(numbers, [1.0, -1.0], [1.0, 1.0] if trapezoid else [1.0])[::-1]
        own = own if trapezoid else np.append(own, np.zeros(order))
        return np.convolve(own, _weights_of(powers)), _weights_of(notch)

    def before(self, run: Trajectory) -> Trajectory:
        """What went in: all but some rows at both ends."""
        states, passing = self._weights
        reach = max(len(states), len(passing)) // 2
        some = run.take(slice(reach, len(run) - reach))

        def weighed(x: Array, weights: Array) -> Array:
            cut = reach - len(weights) // 2
            windows = sliding_window_view(x[cut : len(x) - cut], len(weights), axis=0)
            return np.asarray(windows @ weights)

        of_forces = states if self.forces else passing
        forces = {name: weighed(f, of_forces) for name, f in run.forces.items()}
        q, u = weighed(run.q, states), weighed(run.u, states)
        return replace(some, q=q, u=u, udot=None, forces=forces, integrals={}, works={}, events=())


def _power(polynomial: Sequence[float], k: int) -> Array:
    """Coefficients of the power of a polynomial."""
    power = np.ones(1)
    for _ in range(k):
        power = np.convolve(power, polynomial)
    return np.asarray(power)


def _combined(numbers: Array, x: Sequence[float], y: Sequence[float]) -> Array:
    """Coefficients of Σ numbers_k xᵏ yⁿ⁻ᵏ of two polynomials."""
    n = len(numbers) - 1
    each = [np.convolve(_power(x, k), _power(y, n - k)) for k in range(n + 1)]
    size = max(map(len, each))
    return np.asarray(numbers @ [np.pad(p, (0, size - len(p))) for p in each])


def _weights_of(powers: Array) -> Array:
    """Weights of neighbouring rows by those of the powers of s."""
    weights = np.zeros(1)
    for c in powers[::-1]:
        weights = np.convolve(weights, OF_S)
        weights[len(weights) // 2] += c
    return weights[1:-1]


BETWEEN_ROWS = ("smooth", "start")
"""How forces act between rows of a fit."""

Step: TypeAlias = tuple[str, Integrator]
"""How forces act between rows, and by which method these follow from each other."""

METHODS = (*(m for m in INTEGRATORS if m.memory is None), EXACT)
"""Methods by which rows may follow from each other: a memory is a filter as well."""

COLUMNS = 6
"""Columns of the few causes that are looked for beside a filter, at most."""

NEAR = 10.0
"""Ratio of what is left up to which steps and filters are looked at again: all are linear in numbers."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """A filter with what it leaves of prediction errors, in units of those of the log.

    steps  those by which it leaves about as little, the best first
    """

    filter: LowPass
    left: float
    steps: tuple[Step, ...]


@dataclass(frozen=True, eq=False)
class _FilteredRows:
    """Rows of a log that went through a filter, perhaps beside causes of these columns.

    coefficients  of the columns that the equations have already
    acting        columns that causes have, where these are known
    """

    model: LogModel
    run: Trajectory
    kernels: tuple[ColumnKernels, ...]
    coefficients: Array | None = None
    acting: tuple[int, ...] = ()

    @cached_property
    def plant(self) -> LogModel:
        """The model with these causes in it."""
        own = self.coefficients
        return self.model if own is None else self.model.changed(self.kernels, own)

    @cached_property
    def unit(self) -> Array:
        """Prediction errors (2n,) of most rows as they are, by the exact flow; rounding at least."""
        intervals = self._as_logged.log.intervals
        change = self.model.difference(intervals.start, intervals.end)
        most, size = (np.sqrt(np.median(x**2, axis=0)) for x in (self._as_logged.flow.w, change))
        return np.asarray(most + SAME * size + 1e-300)

    @property
    def exact(self) -> bool:
        """Whether most rows follow from each other to their digits."""
        digits = np.sqrt(np.median(self._as_logged.log.digits[1] ** 2, axis=0))
        return bool(np.all(self.whole * self.unit <= KNOWN * digits))

    @cached_property
    def whole(self) -> float:
        """What the likeliest method leaves of them beside the causes, in these units."""
        T, m = len(self.run), self.model.rows(self.run).F.shape[1]
        none = np.zeros((T, 2 * self.model.n, 0)), np.zeros((T, m, 0))
        own = replace(self._as_logged, steps=self.steps)
        return own.beside(*none, SMALL_SHARE)[0][0]

    @property
    def steps(self) -> tuple[Step, ...]:
        """Steps that may lie between rows."""
        kinds = BETWEEN_ROWS[: 2 if self.run.forces else 1]
        return tuple(product(kinds, METHODS))

    @cached_property
    def _as_logged(self) -> _Departures:
        return self._departures(self.run, ())

    def improved(self, fit: _Fit) -> _Fit:
        """A fit after a step of Gauss and Newton, by the likeliest of its methods.

        Raises:
            FlowError: the equations have no finite motion between rows of what went in.
        """
        departures = self._departures(fit.filter.before(self.run), fit.steps)
        return departures.improved(fit, *self._changes(fit.filter))

    def first(self, order: int) -> list[_Fit]:
        """Filters of an order after one such step from none, by all methods, where these are finite.

        Before it what goes in is the same but for what alternates: one flow is for several filters.
        """
        fits, kinds = list[_Fit](), (False, True)
        for trapezoid, ways in ((False, kinds), (True, kinds[:1]), (True, kinds[1:])):
            filters = [
                LowPass((0.0,) * order, trapezoid, both_ways, forces)
                for both_ways, forces in product(ways, kinds if self.run.forces else (False,))
            ]
            with suppress(*NO_MOTION):
                departures = self._departures(filters[0].before(self.run), self.steps)
                for own in filters:
                    fit = _Fit(own, np.inf, self.steps)
                    fits.append(departures.improved(fit, *self._changes(own)))
        return fits

    def _changes(self, own: LowPass) -> tuple[Array, Array]:
        """What units of its numbers do to states (T, 2n, p) and forces (T, m, p) before a filter."""
        model, half = self.model, 1e-4
        states, forces = list[Array](), list[Array]()
        for d in half * np.eye(len(own.numbers)):
            first, last = (
                model.rows(replace(own, numbers=tuple(own.numbers + s * d)).before(self.run))
                for s in (-1.0, 1.0)
            )
            states.append(model.difference(first, last) / (2.0 * half))
            forces.append((last.F - first.F) / (2.0 * half))
        return np.stack(states, axis=-1), np.stack(forces, axis=-1)

    def again(self, fit: _Fit) -> _Fit:
        """A fit after as many Gauss–Newton steps as leave a tenth each, by few kinds of steps.

        Rotations and long delays are not linear in the numbers of a filter.
        """
        with suppress(*NO_MOTION):
            return self._by_few(fit, 1.0 / NEAR)
        return fit

    def settled(self, fit: _Fit) -> _Fit:
        """A fit whose numbers have settled; where it is a low-pass, by the likeliest of its kinds of steps.

        Raises as `improved`.
        """
        for _ in range(NEWTON_STEPS):
            few = self._by_few(fit, 1.0 - ROUGHLY)
            if not few.filter.low_pass:
                return few
            fit = self.improved(few)
            if fit.steps[0] == few.steps[0]:
                break
        return fit

    def _by_few(self, fit: _Fit, rest: float) -> _Fit:
        """A fit after steps of Gauss and Newton, as long as each leaves less than a share `rest`.

        By the likeliest of its kinds of steps, and by the flow; the others are kept. Raises as `improved`.
        """
        few = tuple(dict.fromkeys([fit.steps[0], (fit.steps[0][0], EXACT)]))
        own = replace(fit, left=np.inf, steps=few)
        for _ in range(NEWTON_STEPS):
            before, own = own, self.improved(own)
            if own.left > rest * before.left:
                break
        return replace(own, steps=tuple(dict.fromkeys([*own.steps, *fit.steps])))

    def _departures(self, run: Trajectory, steps: Sequence[Step]) -> _Departures:
        """What rows of a run depart by from these steps.

        Raises:
            FlowError: the equations have no finite motion between the rows.
        """
        log = observations(self.model, run, len(run))
        if log is None or LoggedForces.of(run).places != self.model.log.places:
            raise FlowError(
                "too few rows are left of what went into the filter, or forces act in others"
            )
        flow = flow_of(self.plant, run, log)
        if not (len(log.intervals) == len(run) - 1 and np.isfinite(flow.w).all()):
            raise FlowError("the flow of what went into the filter leaves all bounds")
        return _Departures(self, log, flow, Tangent.of(flow, log), steps)

    def with_causes(self, fit: _Fit) -> _FilteredRows:
        """The same rows by equations with the few columns of causes in them that explain most beside a fit.

        All columns together do what a filter does, and causes are not linear in their size.
        """
        departures = self._departures(fit.filter.before(self.run), fit.steps[:1])
        if not departures.each:
            raise FlowError("no step is finite between the rows of what went into the filter")
        [step] = departures.each
        B, r = departures.causes, departures.of(step)
        D = departures.moved(step, *self._changes(fit.filter))
        d = inverse_sizes(np.sum(B**2, axis=0))
        X, some, start = B * d, list(self.acting), 0.0
        while not self.acting and len(some) < COLUMNS:
            basis = _basis(np.column_stack([D, X[:, some]]))
            rest, left = (x - basis @ (basis.T @ x) for x in (r, X))
            start = start if some else float(rest @ rest)
            if float(rest @ rest) <= SQUARES * start:  # these may be of squares
                break
            sizes = np.sum(left**2, axis=0)
            gain = np.where(sizes > SAME, (rest @ left) ** 2 * inverse_sizes(sizes) ** 2, 0.0)
            some.append(int(np.argmax(gain)))
        change = np.zeros(len(d))
        both = np.column_stack([X[:, some], D])
        change[some] = (np.linalg.lstsq(both, r, rcond=SAME)[0])[: len(some)]
        own = np.zeros(len(d)) if self.coefficients is None else self.coefficients
        return replace(self, coefficients=own + d * change, acting=tuple(some))


@dataclass(frozen=True, eq=False)
class _Departures:
    """What rows depart by from those that steps make of the rows before, beside what causes do."""

    rows: _FilteredRows
    log: Observations
    flow: Flow
    tangent: Tangent
    steps: Sequence[Step]

    @cached_property
    def each(self) -> dict[Step, tuple[Array, Map]]:
        """Prediction errors (N, 2n) by each kind of step, and its map, where these are finite."""
        each, intervals = dict[Step, tuple[Array, Map]](), self.log.intervals
        for kind in dict.fromkeys(kind for kind, _ in self.steps):
            methods = tuple(m for k, m in self.steps if k == kind)
            forces, counts = self.flow.forces.alike(kind), self.log.counts
            own = list(maps(self.rows.plant, intervals, forces.between, counts, 1, methods))
            if EXACT in methods:
                alike = forces.kinds == self.flow.forces.kinds
                flow = self.flow if alike else self.flow.at(self.log, forces=forces)
                own.append(flow.exact)
            for of in own:
                w = self.rows.model.difference(of.end, intervals.end)
                if np.isfinite(w).all():
                    each[kind, of.method] = w, of
        return each

    def alike(self, least: float) -> dict[Step, list[Step]]:
        """Kinds of steps in groups, by their first: within a group rows differ by less than `least`."""
        if least not in self._alike:
            kinds = dict[Step, list[Step]]()
            for step, (w, _) in self.each.items():
                gaps = np.reshape([self.each[k][0] - w for k in kinds], (-1, *w.shape))
                near = [k for k, gap in zip(kinds, self._typical(gaps)) if gap < least]
                kinds.setdefault(near[0] if near else step, []).append(step)
            self._alike[least] = kinds
        return self._alike[least]

    @cached_property
    def _alike(self) -> dict[float, dict[Step, list[Step]]]:
        return {}

    def _typical(self, w: Array) -> Array:
        """Typical size (…) of prediction errors (…, N, 2n), by the median interval: impacts are in few."""
        squares = np.mean((w / self.rows.unit) ** 2, axis=-1)
        return np.asarray(np.sqrt(np.median(squares, axis=-1)))

    def transition(self, step: Step) -> Array:
        """Derivatives (N, 2n, 2n) of a map; those of the exact flow for an implicit one.

        What a delay does to a motion hardly departs from it: to the first order in the step it is nothing.
        """
        if step not in self._transitions:
            between = self.flow.forces.alike(step[0]).between
            own = transition(self.rows.plant, self.each[step][1], self.log.intervals, between)
            self._transitions[step] = self.tangent.Phi if own is None else own
        return self._transitions[step]

    @cached_property
    def _transitions(self) -> dict[Step, Array]:
        return {}

    @cached_property
    def causes(self) -> Array:
        """What the columns of causes in the equations do to the rows (N · 2n, P), zero for others.

        Raises:
            FlowError: that is not finite.
        """
        kernels, acting = self.rows.kernels, self.rows.acting
        columns = cause_columns(self.flow, self.log, kernels, None)
        whats = [column.what for own in kernels for column in own.columns]
        # What is late in the log does what a filter does.
        some = ~np.isin(whats, COLUMNS_OF_THE_LOG)
        if acting:
            some &= np.isin(np.arange(len(whats)), acting)
        effects = self._flat(np.where(some, self.tangent.transported(columns), 0.0))
        if not np.isfinite(effects).all():
            raise FlowError("causes have no finite effect on what went into the filter")
        return effects

    @cached_property
    def _of_causes(self) -> Array:
        """Orthonormal columns (N · 2n, k) of what causes do."""
        return _basis(self.causes * inverse_sizes(np.sum(self.causes**2, axis=0)))

    def _flat(self, x: Array) -> Array:
        """Columns (N, 2n, p) in units of the prediction errors of the log (N · 2n, p)."""
        return (x / self.rows.unit[:, None]).reshape(x.shape[0] * x.shape[1], x.shape[2])

    def of(self, step: Step) -> Array:
        """Those of a step (N · 2n,) in these units."""
        return self._flat(self.each[step][0][:, :, None])[:, 0]

    def moved(self, step: Step, change: Array, of_forces: Array) -> Array:
        """What changes of states (T, 2n, p) and of logged forces (T, m, p) do to them (N · 2n, p)."""
        if not change.size:
            return self._flat(change[1:])
        first, last = of_forces[:-1], of_forces[1:] if step[0] == "smooth" else of_forces[:-1]
        within = first + np.linspace(0.0, 1.0, 5)[:, None, None, None] * (last - first)
        by_forces = impulse(self.flow.force_responses, within, self.log.intervals.h)
        return self._flat(change[1:] - self.transition(step) @ change[:-1] - by_forces)

    def beside(
        self, change: Array, of_forces: Array, least: float
    ) -> list[tuple[float, Array, list[Step]]]:
        """What each group of kinds of steps leaves beside such changes and causes, the best first.

        With the numbers of the changes and the kinds in the group; `least` as of `alike`.
        """
        fits, of_causes = list[tuple[float, Array, list[Step]]](), self._of_causes
        for step, others in self.alike(least).items():
            r, D = self.of(step), self.moved(step, change, of_forces)
            if not np.isfinite(D).all():
                continue
            r, D = (x - of_causes @ (of_causes.T @ x) for x in (r, D))
            numbers = np.asarray(-np.linalg.lstsq(D, r)[0], dtype=float)
            left = (r + D @ numbers).reshape(self.flow.w.shape) * self.rows.unit
            fits.append((float(self._typical(left)), numbers, others))
        return sorted(fits, key=lambda item: item[0])

    def improved(self, fit: _Fit, change: Array, of_forces: Array) -> _Fit:
        """A fit by the likeliest step, where units of its numbers make these changes.

        Raises:
            FlowError: no step is finite.
        """
        fits = self.beside(change, of_forces, SMALL_SHARE * min(fit.left, 1.0))
        if not fits:
            raise FlowError("no step is finite between the rows of what went into the filter")
        left, step, _ = fits[0]
        numbers = tuple(x + float(d) for x, d in zip(fit.filter.numbers, step, strict=True))
        near = (alike for x, _, alike in fits if x <= NEAR * left)
        return _Fit(replace(fit.filter, numbers=numbers), left, tuple(chain.from_iterable(near)))


def _basis(columns: Array) -> Array:
    """Orthonormal columns (N, k) of the space of others (N, p)."""
    if not columns.size:
        return columns[:, :0]
    Q, R, _ = qr(columns, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(R))
    return np.asarray(Q[:, : np.count_nonzero(sizes > SAME * sizes[0])])


def _likely(rows: _FilteredRows) -> Iterator[_Fit]:
    """Filters by which prediction errors are a small share of those of a log, the likeliest first."""
    share = LEFT_OF_INPUT if rows.kernels else NOTHING
    for order in ORDERS:
        few, settled = LEFT_OF_INPUT * rows.whole, list[_Fit]()
        first = [fit if fit.left <= few else rows.again(fit) for fit in rows.first(order)]
        least = min((fit.left for fit in first), default=np.inf)
        if least > few:
            return  # one of higher order looks like one of lower order
        for fit in first:
            if fit.left <= min(few, NEAR * least):
                with suppress(*NO_MOTION):
                    settled.append(rows.settled(fit))
        right = [fit for fit in settled if fit.filter.low_pass and fit.left < share * rows.whole]
        yield from sorted(right, key=lambda fit: fit.left)


def unfiltered(
    model: LogModel, run: Trajectory, kernels: tuple[ColumnKernels, ...] = ()
) -> tuple[Trajectory, Finding] | None:
    """What went into the filter of a log, if it follows itself; None for no filter.

    All states went through it, or all columns, at even times. With the columns of causes it is looked for
    beside these.
    """
    a, b = max(stretches(run), key=lambda piece: piece[1] - piece[0], default=(0, 0))
    h = np.diff(run.t[a:b])
    derived = "u" in run.provenance.derived or run.works or run.integrals
    if derived or b - a < FEW or np.ptp(h) > ROUGHLY * h.mean():
        return None
    acting = LoggedForces.of(run).places
    run = run.take(slice(a, b))
    if LoggedForces.of(run).places != acting:
        return None  # what acts elsewhere only has no column here
    part = run.take(slice(0, LEAST_ROWS))
    part = part if LoggedForces.of(part).places == acting else run
    with np.errstate(all="ignore"), compiled_rows(), suppress(*NO_MOTION):
        if _FilteredRows(model, part, ()).exact:
            return None
        for fit in _likely(_FilteredRows(model, part, kernels)):
            rows = _FilteredRows(model, part if kernels else run, kernels)
            settled = rows.settled(fit)
            for _ in range(RELINEARISATIONS if kernels else 0):
                rows = rows.with_causes(settled)
                settled = rows.settled(settled)
            own = settled.filter
            # In all rows, and beside few causes, the numbers may settle elsewhere, or explain nothing.
            if own.low_pass and settled.left <= LEFT_OF_INPUT * rows.whole:
                return own.before(run), _told(own, float(h.mean()), fit.left)
    return None


def share_of_a_filter(model: LogModel, run: Trajectory) -> float:
    """Share (of squares) of what rows depart by that a filter of all of them explains, 0 to 1.

    It need not be one that is known, nor be undone: what a filter does looks like a force, or an integrator.
    """
    a, b = max(stretches(run), key=lambda piece: piece[1] - piece[0], default=(0, 0))
    h = np.diff(run.t[a:b])
    if b - a < FEW or np.ptp(h) > ROUGHLY * h.mean():
        return 0.0
    rows = _FilteredRows(model, run.take(slice(a, min(b, a + TELLING))), ())
    with np.errstate(all="ignore"), compiled_rows(), suppress(*NO_MOTION):
        fits = [fit for order in ORDERS for fit in rows.first(order)]
        if rows.whole == 0.0 or not fits:
            return 0.0
        best = rows.again(min(fits, key=lambda fit: fit.left))
        return 1.0 - min(best.left / rows.whole, 1.0) ** 2
    return 1.0


TELLING = 600
"""Rows that tell a filter from a force: some cycles of a motion in which neither is linear."""


def _told(own: LowPass, h: float, left: float) -> Finding:
    what = "all columns" if own.forces else "coordinates and speeds"
    kind = "zero-phase filter"
    if own.delay:
        kind = f"filter that is {own.delay * h:.3g} s late"
    return Finding(
        "filtered",
        f"{what} of the log went through a {kind}",
        f"of what went in, the equations leave {percent(left)} of what they leave of the log",
        "Log what goes into the filter; it is what is judged",
        "note",
        factor=own.delay * h,
    )


# --- forces of other rows ---

SHARE_OF_SHIFT = 0.1
"""Share of the variance of a log's prediction errors that forces of other rows may leave, to be tried."""


def realigned(
    mechanism: Mechanism, run: Trajectory, begun: Unclosed, beside_causes: bool
) -> tuple[Trajectory, Finding] | None:
    """A run with its forces moved by some rows, if the rows follow from each other then; None if not.

    Perhaps beside causes, with the finding that says so.
    """
    left = begun.left_by_shifts(beside_causes)
    if not beside_causes and begun.points and any(begun.points[-1].forces.stairs):
        # A stair logged some rows late looks like one that changes between rows: the flow tells them apart by
        # less than what a method of low order departs from it. The maps of methods decide.
        for late in sorted(left.keys() - {0}, key=lambda m: left[m])[:MOST_LATE]:
            shifted = _shifted(run, late)
            begun_so = closed(mechanism, shifted)
            alone = begun_so.alone if isinstance(begun_so, Unclosed) else begun_so
            if alone is not None and alone.closes:
                return shifted, _told_late(run, late)
    late = min(left, key=lambda m: left[m], default=0)
    if not late or left[late] > SHARE_OF_SHIFT * left[0]:
        return None
    shifted = _shifted(run, late)
    again: Inference | Unclosed | None = closed(mechanism, shifted)
    if isinstance(again, Unclosed) and beside_causes:
        again = again.with_causes()
        right = again is not None and again.closes and not again.late
    elif isinstance(again, Unclosed):  # noise alone may look like a cause
        right = again.left_by_shifts(False).get(0, np.inf) <= KNOWN
    else:
        right = again is not None
    return (shifted, _told_late(run, late)) if right else None


def _shifted(run: Trajectory, late: int) -> Trajectory:
    """A run with forces as many rows later."""
    count, first = len(run) - abs(late), max(late, 0)
    forces = {n: f[first - late : first - late + count] for n, f in run.forces.items()}
    some = run.take(slice(first, first + count))
    return replace(some, forces=forces, stages=None, integrals={}, works={})


def _told_late(run: Trajectory, late: int) -> Finding:
    rows = f"{abs(late)} row{'s' if abs(late) > 1 else ''}"
    return Finding(
        "late-forces",
        f"forces act {rows} {'later' if late > 0 else 'earlier'} than they were logged",
        "by the forces moved so, each row follows from the one before",
        "Log each force in the row from which on it acts; the verdict is of the log with its forces moved",
        "note",
        factor=late * float(np.median(np.diff(run.t))),
    )


# --- forces beyond the limits of a motor ---


def limited(
    mechanism: Mechanism, run: Trajectory, begun: Unclosed
) -> tuple[Trajectory, Finding] | None:
    """A run with the force of one motor clipped to its limits, if each row follows from the one before then.

    With the finding that says so; None if they do not. The prediction errors tell which force acted in each
    interval: where the motor saturates, it is the same. The limits are refined by Gauss–Newton steps.
    """
    with np.errstate(all="ignore"), compiled_rows(), suppress(*NO_MOTION):
        limits = _Limits.of(begun.points[-1]) if begun.points else None
        for _ in range(NEWTON_STEPS if limits else 0):
            assert limits is not None
            clipped = limits.clipped(run)
            again = closed(mechanism, clipped)
            if isinstance(again, Inference):
                return clipped, limits.told
            if again is None or not again.points:
                return None
            refined = limits.refined(again.points[-1])
            if np.allclose(refined.ends, limits.ends, rtol=SAME, atol=0.0):
                # Rows with noise follow within it: noise alone may look like a cause.
                right = again.left_by_shifts(False).get(0, np.inf) <= KNOWN
                return (clipped, limits.told) if right else None
            limits = refined
    return None


@dataclass(frozen=True, eq=False)
class _Limits:
    """The lowest and the highest force (`ends`) of a motor that saturates.

    name    the motor's channel
    speed   its column in the channel, `place` that among all logged forces
    logged  its force at the starts of the intervals (N,), without limits
    """

    name: ChannelName
    speed: int
    place: int
    logged: Array
    ends: tuple[float, float]

    @staticmethod
    def of(point: Point) -> _Limits | None:
        """Those that explain most of the prediction errors; None where they leave more than a share."""
        first, acted, flow = point.forces.logged.first, _acting_forces(point), point.flow
        least, best = SHARE_OF_SHIFT * float(squares(point, flow.w).sum()), None
        for name, speeds in point.model.log.places.items():
            at = point.model.log.columns[name].start
            for place, speed in enumerate(speeds, at) if name.kind == "actuator" else ():
                x, y = first[:, place], acted[:, place]
                low, high = -np.inf, np.inf
                for _ in range(2):  # each end is told by the rows that the other leaves alone
                    below, above = x < high, x > low
                    low, high = -_highest(-x[below], -y[below]), _highest(x[above], y[above])
                change = np.zeros((5, *first.shape))
                change[:, :, place] = np.clip(x, low, high) - x
                rest = float(squares(point, flow.w - flow.moved_by_forces(change)).sum())
                if rest < least:
                    least, best = rest, _Limits(name, speed, place, x, (low, high))
        return best

    def clipped(self, run: Trajectory) -> Trajectory:
        """The run with the force between these limits."""
        force = np.array(run.forces[self.name])
        force[:, self.speed] = np.clip(force[:, self.speed], *self.ends)
        return replace(run, forces={**run.forces, self.name: force}, works={}, integrals={})

    def refined(self, point: Point) -> _Limits:
        """The limits after a Gauss–Newton step, by the prediction errors of the clipped run."""
        error = (_acting_forces(point) - point.forces.logged.first)[:, self.place]
        low, high = self.ends
        if len(error) != len(self.logged):
            return self
        if np.any(lowest := self.logged < low):
            low += float(np.mean(error[lowest]))
        if np.any(highest := self.logged > high):
            high += float(np.mean(error[highest]))
        return replace(self, ends=(low, high))

    @property
    def told(self) -> Finding:
        """The finding that says so."""
        low, high = self.ends
        ends = f"stayed between {low:.6g} and {high:.6g}"
        if not np.isfinite(low):
            ends = f"did not exceed {high:.6g}"
        elif not np.isfinite(high):
            ends = f"did not fall below {low:.6g}"
        return Finding(
            "limited-forces",
            f"the force of `{self.name}` {ends}, but was logged without this limit",
            "with the force limited, each row follows from the one before",
            "Log the force that acted, not the one that was commanded; the verdict is of the log with "
            "its force limited",
            "note",
            str(self.name),
        )


def _acting_forces(point: Point) -> Array:
    """The mean forces (N, m) that make the speeds of each interval follow, by least squares."""
    h, responses = point.log.intervals.h, point.flow.force_responses
    assumed = np.mean([point.forces.between(s) for s in (0.25, 0.5, 0.75)], axis=0)
    rates = point.flow.w[:, point.model.n :, None] / h[:, :, None]
    return np.asarray(assumed + (np.linalg.pinv(responses.transpose(1, 2, 0)) @ rates)[:, :, 0])


def _highest(x: Array, y: Array) -> float:
    """The limit c for which min(x, c) fits y best; infinite where no limit has odds."""
    if not len(x):
        return np.inf
    order = np.argsort(x)[::-1]
    saturated, errors = y[order], ((y - x)[order]) ** 2
    count = np.arange(1.0, len(x) + 1.0)
    scatter = np.cumsum(saturated**2) - np.cumsum(saturated) ** 2 / count
    rest = np.maximum(scatter + errors.sum() - np.cumsum(errors), SAME**2 * np.sum(y**2) + 1e-300)
    few = int(np.argmin(rest))
    odds = 0.5 * len(x) * float(np.log((errors.sum() + 1e-300) / rest[few]))
    limit = float(np.mean(saturated[: few + 1]))
    # A motor that always saturates may have another gear as well.
    sometimes = few + 1 < len(x) and limit < x[order[few]]
    certain = odds > CERTAIN + price(1, len(x), len(x))
    return limit if sometimes and certain else np.inf


# --- coordinates of another zero ---


def rezeroed(
    run: Trajectory, inference: Inference, zeros: Fit, known: Sequence[Finding]
) -> tuple[Trajectory, tuple[Finding, ...]] | None:
    """A run with the zeros of its coordinates put right that a fit says are off; None for none.

    With findings that say so, in the place of those `known` of the same coordinates: zeros are found to
    second order, and what is left of them is found again: a tenth at most, or it is none of them.
    """
    q, told = np.array(run.q), dict[str, Finding]()
    places = {run.speeds[j]: i for i, j in RateNames.of(run.coordinates, run.speeds).rates}
    before = {f.element: f.factor or 0.0 for f in known if f.kind == "zero-offset"}
    for k, (c, theta) in enumerate(zip(zeros.chosen, zeros.theta, strict=True)):
        whole = theta + before.get(c.element, 0.0)
        most = ROUGHLY if c.element in before else 1.0
        if c.kind == "zero-offset" and SAME * abs(whole[0]) < abs(theta[0]) <= most * abs(whole[0]):
            q[:, places[c.element]] -= theta[0]
            error = zeros.deviation(k) * np.sqrt(inference.tau)
            told[c.element] = Finding(
                c.kind,
                sentence(inference.model.mechanism, c, whole, error),
                "by how each row follows from the one before",
                f"{KINDS[c.kind].remedy}, unless the zero of the model's joint is off, which does the same; "
                "the verdict is of the log with its zero put right",
                "note",
                c.element,
                float(whole[0]),
                float(error[0]),
            )
    if not told:
        return None
    others = (f for f in known if f.kind != "zero-offset" or f.element not in told)
    return replace(run, q=q), (*others, *told.values())
