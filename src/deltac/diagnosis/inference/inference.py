"""What a log says: its integrator, the causes of what its rows do not follow from each other, ΔC in joules.

The prediction errors of a log, whitened, are regressed on the fields of an unknown integrator or compared
with the maps of known ones, and on the columns of every cause. All hypotheses are factorisations of one Gram
matrix.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.calls.progress import TimeLimit
from deltac.diagnosis.causes.causes import Candidate, candidates
from deltac.diagnosis.causes.columns import ColumnKernels, LogEquations, column_kernels
from deltac.diagnosis.causes.geometry import geometry_columns
from deltac.diagnosis.inference.attribution import Share, joules
from deltac.diagnosis.inference.fields import (
    FIELDS,
    FIRST_ORDER,
    PRIOR,
    elementary_differentials,
    first_order_jacobian,
    next_order,
)
from deltac.diagnosis.inference.flow import Prediction, predict, transitions, transported
from deltac.diagnosis.inference.forces import (
    FORCES,
    HELD,
    ForceBetween,
    LoggedForce,
    impulse,
    likeliest,
)
from deltac.diagnosis.inference.hypotheses import (
    BESIDE,
    CERTAIN,
    MANY,
    TOGETHER,
    Block,
    Fit,
    Posterior,
    autocorrelation_time,
    fitted,
    nothing,
    refitted,
    search,
)
from deltac.diagnosis.inference.integrators import (
    EXACT,
    INTEGRATORS,
    MOST_SPEEDS,
    Integrator,
    Map,
    by_causes,
    estimate,
    identified,
    maps,
    numbers_of,
    parted,
    step_of,
    steps_between,
    transition,
)
from deltac.diagnosis.inference.methods import FAR, Methods, alike, log_evidence
from deltac.diagnosis.inference.model import Intervals, Model, Rows
from deltac.diagnosis.inference.observations import (
    Observations,
    observations,
    rates,
    remainder,
    unit_responses,
    unknown,
)
from deltac.diagnosis.inference.reduced import reductions
from deltac.diagnosis.inference.result import (
    KNOWN,
    OF_THE_LOG,
    SLIGHT,
    Generic,
    Inference,
    deviation,
)
from deltac.diagnosis.inference.whitening import robust_weights
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.measurements.kinematics import trusted
from deltac.kernels.rows import compiled
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

WORK = 3e8
"""Instructions that the columns of causes may take, about: some tenths of a second."""

PRODUCT = 0.02
"""Time of a product of two numbers in one of matrices beside that of an instruction that is interpreted."""

FEW = 60
"""Rows that tell how well the numbers of causes are known where no cause can have odds."""

MOST_ROWS, LEAST_ROWS = 8000, 150

MOST_COST = 100_000
"""Instructions of the columns at a row up to which the geometry is asked as well."""

UNEVEN = 1e-3
"""Differences of intervals, as a share of the step, that are rounding of a clock."""

EVERY_STEP = 1.01
"""Rows further apart than so many steps of the integrator are not all of its steps."""

SHARES = (0.0, 0.01, 0.1, 1.0)
"""Shares of what forces may have done between the rows of a thinned log that are compared by likelihood."""

NEGLIGIBLE = 1e-5
"""Share of the energy exchanged below which a cause is told only if it is all that is left of the rows:
iterations of constraint solvers stop there."""

RELINEARISATIONS = 3
"""Times at most that flow and columns are taken anew with the causes in the equations (Gauss–Newton)."""

SMOOTHINGS = 2
"""Times that the likeliest states are taken anew: twice the digits of the speeds each."""

ALIKE = 3
"""Methods of which the causes are looked for, where several close the rows alike beside all causes."""

HALF = 0.6
"""Standard deviation of what forces do between rows that a method does not see, in units of the difference
between held and ramped ones: the latter are those of one in four."""

WHITE = 3.0
"""Autocorrelation time, intervals, up to which what is left is of each interval on its own."""

SAME = 1e-5
"""Share of what a mistake does to the rows that the integrator's fields leave where they do the same."""

FORCED = 0.5
"""Square of what coordinates depart by beyond what their speeds do to them, in units of both squares, that no
force makes: a smooth one makes none, what is of each on its own is one."""

SQUARES = 1e-4
"""Share of what a method leaves that causes leave of it where that may be their squares: of a per cent."""

SOME = 0.1
"""Share of it up to which it may be that causes do otherwise in a method's own steps."""

LESS = 2.0
"""Ratio of standard deviations from which on noise is known better than before."""

STILL = 1e-6
"""Share of the errors of the rows below which states that move by it are the likeliest."""

ENOUGH = 300
"""Intervals of which the energy that a cause exchanges is summed."""

LOST = 0.3
"""Share of the intervals that may be lost where the model has no finite motion."""

DELAYS, SPREADS = (-8, -4, -2, 0, 2, 4, 8), (0.5, 1, 2, 4)
"""Delays and deviations, in rows, of filters of forces that are compared: enough to linearise at."""

WITHIN_A_ROW = 1.0
"""Delays and deviations, in rows, up to which forces are held or ramped from row to row."""

PARTS = (2, 3, 4, 5, 8, 10)
"""Steps between neighbouring rows of a log that does not say its step."""

NARROW = 0.3
"""Least deviation of such a filter, steps."""

COLUMNS_OF_THE_LOG = ("delay", "law", "offset")
"""Columns of these."""


class FlowError(ArithmeticError):
    """The equations of motion have no finite solution from some rows of a log on."""


def infer(
    mechanism: Mechanism, run: Trajectory, energy: float = 0.0, limit: TimeLimit | None = None
) -> Inference | None:
    """The inference for a run whose columns are in the mechanism's order; None for too few rows.

    `energy` is what the run exchanges (J): causes that exchange less than `NEGLIGIBLE` of it must be all.
    Where the time `limit` has passed, places and axes are no causes, and causes count to first order.
    """
    if not len(mechanism.free.u) or len(run) < 3:
        return None
    model = Model(mechanism, run)
    equations = LogEquations(mechanism, run)
    kernels = column_kernels(equations)
    with np.errstate(all="ignore"), compiled():
        begun = list[_Inferring]()
        for one in (*reductions(model, run), model):
            alone = _closed(one, run, equations, kernels, energy)
            # The fields of an integrator are many in all coordinates; a method of a few is sure.
            if isinstance(alone, Inference) and (alone.methods or one is model):
                return alone
            if isinstance(alone, _Inferring):
                begun.append(alone)
        # What looks like a mistake in all coordinates may be what an integrator of a few of them does.
        result: Inference | None = None
        for inferring in begun:
            own = _with_places(inferring, kernels, limit)
            if own is not None and (own.closes or not own.finds_something):
                return own
            if own is not None and (result is None or own.flow < result.flow):
                result = own
        return result


def infer_alone(mechanism: Mechanism, run: Trajectory) -> Inference | None:
    """The inference without causes: what an integrator and noise leave; None as for `infer`."""
    model = Model(mechanism, run)
    log = observations(model, run, MOST_ROWS)
    if log is None:
        return None
    try:
        with np.errstate(all="ignore"), compiled():
            return _Inferring(model, run, log, LogEquations(mechanism, run), 0.0).result()
    except (FlowError, np.linalg.LinAlgError):
        return None


def _closed(
    model: Model,
    run: Trajectory,
    equations: LogEquations,
    kernels: ColumnKernels,
    energy: float,
) -> Inference | _Inferring | None:
    """The result of rows that follow from each other without a cause; else what is inferred with; or None."""
    products = 2 * model.n * len(kernels.columns) ** 2
    cost = kernels.cost + PRODUCT * products
    log = observations(model, run, int(np.clip(WORK / cost, LEAST_ROWS, MOST_ROWS)))
    few = observations(model, run, FEW)
    if log is None or few is None:
        return None
    try:
        inferring = _Inferring(model, run, log, equations, energy)
        alone = inferring.closed()
        # What comes and goes within the noise of the rows is nothing.
        if alone is not None and (alone.excess <= 1.0 or not alone.finds_something):
            if inferring.by_rates is not None:
                return _with_causes(alone, inferring.undetected(alone, kernels))
            sample = _Inferring(model, run, few, equations, energy)
            sample.add(kernels)
            known = sample.result()
            nothing_more = known.excess <= 1.0 or not known.finds_something
            if nothing_more and not known.posterior.best.chosen:
                return _with_causes(alone, known)
    except (FlowError, np.linalg.LinAlgError):
        return None
    return inferring


def _with_places(
    inferring: _Inferring, kernels: ColumnKernels, limit: TimeLimit | None
) -> Inference | None:
    """The result with causes, and with places and axes where something is found."""
    try:
        inferring.add(kernels)
        result = inferring.result()
        if (
            result.finds_something
            and kernels.cost < MOST_COST
            and not (limit is not None and limit.passed("places and axes as causes"))
        ):
            # Only then is it asked for places and axes: their columns are as many again.
            inferring.add(geometry_columns(inferring.equations))
            result = inferring.result()
        if result.posterior.best.chosen and not (
            limit is not None and limit.passed("causes linearised at themselves")
        ):
            result = inferring.refined()
        return inferring.of_steps(result)
    except (FlowError, np.linalg.LinAlgError):
        return None


def _with_causes(alone: Inference, known: Inference) -> Inference:
    """The result of a log that closes, with what a sample of its rows tells of the causes excluded."""
    share = np.sqrt(len(known.w) / len(alone.w))
    return replace(
        alone,
        kernels=known.kernels,
        blocks=known.blocks,
        posterior=known.posterior,
        candidates=known.candidates,
        generic=known.generic,
        unseen={name: float(share) * joules for name, joules in known.unseen.items()},
    )


class _Inferring:
    """One inference: the flow and its columns, then hypotheses one after the other."""

    def __init__(
        self,
        model: Model,
        run: Trajectory,
        log: Observations,
        equations: LogEquations,
        energy: float,
    ) -> None:
        self.model, self.run, self.equations, self.energy = model, run, equations, energy
        self.plant = model
        self.filter: tuple[float, float] | None = None
        self.kernels: tuple[ColumnKernels, ...] = ()
        self.candidates: tuple[Candidate, ...] = ()
        self.of_log, self.coefficients = np.zeros(0, dtype=np.bool_), np.zeros(0)
        self.late: tuple[str, ...] = ()
        intervals = log.intervals
        h = float(np.median(intervals.h))
        self.step = min(run.provenance.step or step_of(intervals.h), h)
        self.counts = steps_between(intervals.h, run.provenance.step and self.step)
        self.thinned = intervals.h[:, 0] > EVERY_STEP * self.step
        self.whole = float(run.t[-1] - run.t[0]) / float(intervals.h.sum())
        self.force = LoggedForce.of(intervals, log.pieces, self.counts)
        # Forces that were held over each of several steps between rows are not those of the rows.
        held = set(map(str, run.provenance.held or ())) if not self._several else set[str]()
        names = [str(n) for n, at in model.log.columns.items() for _ in range(at.start, at.stop)]
        self.declared = ["start" if name in held else "" for name in names]
        self.kinds = tuple(kind or "smooth" for kind in self.declared)
        self.says_what_was_held = run.provenance.held is not None
        self.steps, self.log = 0, log
        self.nominal_of: tuple[Observations, tuple[str, ...], int] | None = None
        self.shortlist: tuple[Integrator, ...] = ()
        self.by_rates: tuple[Block, Posterior] | None = None
        self.mapped: tuple[Prediction, list[Map]] | None = None
        self.alike: list[tuple[Map, Observations]] = []
        self.refining = False
        self._predict()
        self._linearise()
        lost = ~np.all(
            [
                np.isfinite(x).reshape(len(x), -1).all(axis=1)
                for x in (self.w, *self.J, *self.fields)
            ],
            axis=0,
        )
        if any(event.impulsive for event in model.mechanism.events) and not run.events:
            lost |= _jumps(self.w)
        if lost.any():  # the flow leaves all bounds there, as in singular positions
            if lost.mean() > LOST:
                raise FlowError("the flow of the model leaves all bounds between many rows")
            self.log = log.without(lost)
            self.counts = None if self.counts is None else self.counts[~lost]
            self.force = LoggedForce.of(self.log.intervals, self.log.pieces, self.counts)
            self.thinned = self.thinned[~lost]
            self.whole = float(run.t[-1] - run.t[0]) / float(self.log.intervals.h.sum())
            self._predict()
            self._linearise()
        self.log = self.log.with_noise(self.w)
        self.noise = self.log.noise
        self.Phi = np.zeros_like(
            self.J[0]
        )  # until columns are compared: the flow starts at the rows
        count = self.fields[0].shape[2] - len(FIELDS)
        self.prior = np.array([PRIOR[f.order] for f in FIELDS] + [PRIOR[3]] * count)
        self.Q = self._unknown()

    def add(self, kernels: ColumnKernels) -> None:
        """Columns more, and the causes that they allow."""
        # All is compared anew, from the model itself and the noise that its flow shows.
        start, end = (
            np.where(self.log.unknown, now, first)
            for now, first in zip(self.log.noise, self.noise, strict=True)
        )
        self.log = replace(self.log, noise=(start, end))
        if self.plant is not self.model:
            self.plant = self.model
            self._predict()
            self._linearise()
        self.kernels = (*self.kernels, kernels)
        columns = tuple(c for k in self.kernels for c in k.columns)
        self.candidates = candidates(self.equations, columns)
        self.of_log = np.array([c.what in COLUMNS_OF_THE_LOG for c in columns])
        self.coefficients = self._of_filter(np.zeros(len(columns)))
        # The delay of a motor that is the only one is that of all forces.
        single = sum(c.what == "delay" and c.index == 0 for c in columns) == 1
        self.late = ("late-forces", "actuator-delay") if single else ("late-forces",)

    @property
    def _several(self) -> bool:
        """Whether several steps of a known length lie between some rows."""
        return bool(self.force.counts.max() > 1)

    @property
    def _parts(self) -> NDArray[np.intp] | None:
        """Equal parts (N,) of the intervals over which forces are held."""
        return self.force.counts if "step" in self.kinds else None

    # --- the flow and its columns ---

    def _predict(self) -> None:
        """The flow from each row of the plant, of the model, and of that by forces as they were logged.

        The plant is the model with the causes so far.
        """
        intervals, force = self.log.intervals, self.force(self.kinds)

        def prediction(of: Model, force: ForceBetween) -> Prediction:
            return predict(of, intervals, force, self.log.noise[1], self.steps, self._parts)

        self.flow = prediction(self.plant, force)
        self.steps = len(self.flow.nodes) - 1
        as_before = self.log, self.kinds, self.steps
        if self.plant is self.model:
            self.nominal = self.flow
        elif self.nominal_of != as_before:
            self.nominal = prediction(self.model, force)
        self.nominal_of = as_before
        self.as_logged = (
            prediction(self.model, self.unfiltered) if self.filter is not None else self.nominal
        )
        self.w = self.model.difference(self.flow.end, intervals.end)

    def _of_filter(self, coefficients: Array) -> Array:
        """The same with those of the delays that the forces were filtered by."""
        delay, spread = self.filter or (0.0, 0.0)
        numbers = (delay, delay**2 + spread**2)
        for k, c in enumerate(column for of in self.kernels for column in of.columns):
            if c.what == "delay":
                coefficients[k] = numbers[c.index]
        return coefficients

    def _filtered(self, delay: float, spread: float) -> None:
        """Forces as filters of the states make them: late, and weighed over a time, s."""
        if self.filter is None:
            self.unfiltered, self.intervals = self.force(self.kinds), self.log.intervals
        self.filter = delay, spread
        late = LoggedForce.filtered(self.intervals, self.log.pieces, self.unfiltered, delay, spread)
        start, end = self.log.intervals.start, self.log.intervals.end
        intervals = Intervals(replace(start, F=late.start.F), replace(end, F=late.end.F))
        self.log = replace(self.log, intervals=intervals)
        self.force = LoggedForce.of(intervals, self.log.pieces)
        self.kinds = ("smooth",) * len(self.kinds)
        self.coefficients = self._of_filter(self.coefficients)
        # The kernel is not that of the filter: what it lacks is unknown.
        self.thinned = np.ones_like(self.thinned)

    def _linearised_at(self, coefficients: Array) -> None:
        """Flow and columns of the model with causes of these coefficients in its equations."""
        of_equations = np.where(self.of_log, 0.0, coefficients)
        self.plant = self.model.changed(self.kernels, of_equations)
        self.coefficients = self._of_filter(of_equations)
        self._predict()
        self._linearise()
        columns = (self.w, *self.J, *self.fields)
        if not all(np.isfinite(x).all() for x in columns):
            raise FlowError("the flow of the model with the causes found leaves all bounds")
        self.causes = self._cause_columns()

    def _at_nodes(self, columns: list[Array], last: Array) -> list[Array]:
        """Columns at all nodes: those at the end of an interval are those of the next one's start."""
        shifted = np.empty_like(columns[0])
        for (a, b), end in zip(self.log.pieces, last, strict=True):
            shifted[a : b - 1], shifted[b - 1] = columns[0][a + 1 : b], end
        return [*columns, shifted]

    @property
    def _ends(self) -> Rows:
        """The predicted ends of the pieces."""
        return self.flow.nodes[-1].take(
            np.array([b - 1 for _, b in self.log.pieces], dtype=np.intp)
        )

    def _linearise(self) -> None:
        """The integrator's fields and ∂f/∂x at the nodes of the flow, and Φ between them."""
        self.fields, self.J = self._integrator_columns()
        self.transitions = transitions(self.log.intervals.h, self.J)

    def _integrator_columns(self) -> tuple[list[Array], list[Array]]:
        h = self._h
        fields, J = list[Array](), list[Array]()
        for at in self.flow.nodes[:-1]:
            J.append(self.plant.jacobian(at))
            own = elementary_differentials(self.plant, at, h)
            parts = [
                next_order(J[-1][a:b], own[a:b], at.t[a:b], h[a:b]) for a, b in self.log.pieces
            ]
            fields.append(np.concatenate([own, np.concatenate(parts)], axis=2))
        last = np.array([b - 1 for _, b in self.log.pieces], dtype=np.intp)
        own = elementary_differentials(self.plant, self._ends, h[last])
        further = fields[0][last][:, :, own.shape[2] :]
        fields = self._at_nodes(fields, np.concatenate([own, further], axis=2))
        return fields, self._at_nodes(J, self.plant.jacobian(self._ends))

    def _cause_columns(self) -> list[Array]:
        """G_j = M⁻¹x_j (N, 2n, P) at the nodes."""
        intervals = self.log.intervals
        rate = (intervals.end.F - intervals.start.F) / intervals.h
        curve = np.zeros_like(rate)
        for a, b in self.log.pieces:
            if b - a > 2:
                curve[a:b] = np.gradient(rate[a:b], intervals.start.t[a:b], axis=0)

        def columns(at: Rows, rate: Array, curve: Array) -> Array:
            u = self._responses(self.plant, at, self.plant.every(at), rate, curve)
            return np.concatenate([np.zeros_like(u), u], axis=1)

        last = np.array([b - 1 for _, b in self.log.pieces], dtype=np.intp)
        own = [columns(at, rate, curve) for at in self.flow.nodes[:-1]]
        return self._at_nodes(own, columns(self._ends, rate[last], curve[last]))

    def _responses(self, model: Model, at: Rows, a: Array, rate: Array, curve: Array) -> Array:
        """What all causes do to the accelerations (N, n, P), by force or by geometry."""
        if not self.kernels:
            return np.zeros((len(a), model.n, 0))
        full = model.completed(at)
        samples = (full.t, full.q, full.u, a, full.F, rate, curve)
        forces, *geometry = (kernels(*samples)[:, :, 1:] for kernels in self.kernels)
        parts = [model.response(at.t, at.q, forces)]
        parts += [model.of_geometry(at.t, at.q, x) for x in geometry]
        return np.concatenate(parts, axis=2)

    @property
    def _h(self) -> Array:
        """The integrator's step (N, 1) in each interval."""
        h = self.log.intervals.h
        if self.counts is None or np.ptp(h) <= UNEVEN * self.step:
            return np.asarray(np.minimum(self.step, h))
        return np.asarray(h / self.counts[:, None])

    def _unknown(self) -> Array:
        """The covariance of what the flow does not know, of forces between rows by likelihood."""
        Q, between, across = unknown(
            self.plant,
            self.log,
            self.flow,
            self.force,
            self.kinds,
            self.w,
            self.thinned,
        )
        h = self.log.intervals.h
        beyond = remainder(self.J[0], self.fields[0][:, :, :FIRST_ORDER], h, self._h)
        self.beyond = beyond
        if between.any():
            Phi, B = transported(self.log.intervals.h, self.transitions, self.fields)
            columns = np.concatenate([self._errors(self.flow.end, Phi)[:, :, None], B], axis=2)

            def likelihood(share: float) -> float:
                innovations = self.log.innovations(Phi, Q + share**2 * between + across)
                white, spread = innovations(columns)
                r, D = white[:, :, 0].ravel(), white[:, :, 1:].reshape(-1, B.shape[2])
                r = r - D @ np.linalg.lstsq(D, r, rcond=1e-12)[0]
                return float(-spread - 0.5 * r.size * np.log(float(r @ r) / r.size + 1e-300))

            between = max(SHARES, key=likelihood) ** 2 * between
        # What is left tells how large the unknown is; splines of forces have a doubt of their own.
        lost = self.thinned[:, None, None]
        self.uncertain = Q + np.where(lost, between, 0.0), np.where(lost, 0.0, between)
        Q = Q + between
        diagonal = np.arange(beyond.shape[1])
        across[:, diagonal, diagonal] += beyond**2
        return Q + across

    # --- hypotheses ---

    def closed(self) -> Inference | None:
        """The result where rows or accelerations hold to their digits without a cause: none has odds then."""
        result = self.result()
        block = self.blocks[0]
        if block.projected.left(np.zeros(0)) <= block.least:
            return result
        if not self._accelerations_agree() or not self._of_no_force(result.residual):
            return None
        # What departs between rows of which the accelerations are the model's is of the steps.
        made = self._made(self.posterior, scattered=True, agreed=True)
        return replace(made, integrator=result.integrator)

    def _accelerations_agree(self) -> bool:
        """Whether accelerations of a log whose origin is not known are those of the model to their digits.

        Rows of other equations would not have them; others may be differences, and tell nothing.
        """
        run, free = self.run, self.model.mechanism.free.u
        if run.udot is None or "udot" in run.provenance.derived or self.model.n < len(free):
            return False
        rows = np.concatenate([np.arange(a, b - 1) for a, b in self.log.rows])
        some = np.flatnonzero(np.isfinite(run.udot[rows][:, free]).all(axis=1))
        if len(some) < FEW:
            return False
        block, _ = self._measured(some)
        agree = block.projected.left(np.zeros(0)) <= block.least
        if agree:
            self.by_rates = block, Posterior(nothing(0), (), ())
        return agree

    def _of_no_force(self, left: Array) -> bool:
        """Whether most of what is left (N, 2n) is of no force: one moves coordinates by h/2 of the speeds."""
        n, half, log = self.model.n, 0.5 * self.log.intervals.h, self.log
        start = log.intervals.start
        inertia = np.einsum("kii->ki", self.model.matrices(start.t, start.q)[0])

        def squares(x: Array) -> Array:
            return np.asarray((inertia * x**2).sum(axis=1))

        of_q, of_u = left[:, :n], half * left[:, n:]
        alone = squares(of_q) + squares(of_u)
        noise = sum(squares(x[:, :n]) + squares(half * x[:, n:]) for x in log.noise)
        # In most intervals: blows are of a few, and leave the others.
        ratio = np.where(alone > KNOWN * noise, squares(of_q - of_u) / (alone + 1e-300), 0.0)
        return bool(np.median(ratio) > FORCED)

    def undetected(self, alone: Inference, kernels: ColumnKernels) -> Inference:
        """The result of a log whose accelerations close, with how large the mistakes are that some rows hide.

        A unit of a cause moves the accelerations by its column, and does the work of that.
        """
        self.add(kernels)
        some = np.unique(np.linspace(0, len(self.w) - 1, FEW).astype(np.intp))
        block, columns = self._measured(some)
        power = np.einsum("kn,knp->kp", self.gradient[some, self.model.n :], columns)
        duration = self.whole * float(self.log.intervals.h.sum())
        curves = np.cumsum(power, axis=0) * (duration / len(some))
        best = nothing(len(self.coefficients))
        return replace(
            alone,
            kernels=self.kernels,
            blocks=(block,),
            posterior=Posterior(best, (), ()),
            candidates=self.candidates,
            unseen=self._unseen((block,), best, alone.tau, curves),
            w=self.w[some],
        )

    def result(self) -> Inference:
        """The posterior of the causes that there are columns of."""
        self.causes = self._cause_columns()
        self._act(nothing(len(self.coefficients)))
        posterior = self._compare()
        # What mistakes do looks like filters and those like mistakes: filters are asked for beside causes.
        # Where a method closes the rows, forces act as they do in it.
        posterior = self._otherwise(posterior)
        if not self._closing(posterior) and self._act(
            self._of_equations(posterior.best), filters=True
        ):
            posterior = self._compare()
        if (
            self.methods
            and self.methods[0].order == 1
            and not self.says_what_was_held
            and self._held()
        ):
            posterior = self._compare()
        self.posterior = posterior
        return self._made(posterior)

    def _closing(self, posterior: Posterior) -> bool:
        left = self.of_rows.projected.left(posterior.best.coefficients)
        return bool(self.methods) and left <= self.of_rows.count

    def _evidence(self, posterior: Posterior) -> float:
        """Log evidence of the rows, as likely as their noise is small."""
        rows, best = self.of_rows, posterior.best
        tau = autocorrelation_time(rows.residual(best.coefficients))
        return rows.evidence(best, tau) - rows.spread

    def _otherwise(self, posterior: Posterior) -> Posterior:
        """The posterior of forces that are held, or straight between rows, if a method closes the rows then.

        With a mistake in the rows the likelihood without its cause does not tell how forces act: what it does
        is smooth, and kinks of forces are noise.
        """
        told = all(self.declared) or self.log.intervals.stages or self.filter is not None
        first = dict(self.__dict__)
        best = self._evidence(posterior), first
        for kind in () if told or not self.kinds else ("start", "ramp"):
            self.__dict__.update(first)
            self.kinds = tuple(own or kind for own in self.declared)
            if self.kinds == first["kinds"]:
                continue
            self._predict()
            self.log = self.log.with_noise(self._errors(self.flow.end, self.Phi))
            if np.any(LESS * self.log.noise[1] < first["log"].noise[1]):
                self.Q = self._unknown()
                other = self._compare()
                evidence = self._evidence(other)
                if self._closing(other) and evidence > best[0]:
                    posterior, best = other, (evidence, dict(self.__dict__))
        self.__dict__.update(best[1])
        return posterior

    def _held(self) -> bool:
        """Hold forces of which the method takes the row's own; whether that is otherwise than before.

        Between rows they are not seen then; whoever computes them once a step holds them. Who takes those
        of the next row does not: they are functions of time.
        """
        later = self.methods[0].later
        held = "step" if self.between.max() > 1 else "start"

        def acting(kind: str) -> str:
            if later:
                return "ramp" if kind == "end" else kind
            return held if FORCES[kind][0] == 0.0 and kind not in HELD else kind

        kinds = tuple(
            own or acting(kind) for own, kind in zip(self.declared, self.kinds, strict=True)
        )
        another = kinds != self.kinds and self.filter is None
        if another:
            if "step" not in self.kinds:
                self.force = replace(self.force, counts=self.between)
            self.kinds = kinds
            self._predict()
        return another

    def _of_equations(self, best: Fit) -> Fit:
        """The causes of a fit that are of the equations, alone: what forces do is asked anew."""
        chosen = [c for c in best.chosen if c.kind not in OF_THE_LOG]
        fit = fitted(self.blocks, chosen) if chosen else None
        return fit or nothing(len(self.coefficients))

    def _act(self, best: Fit, filters: bool = False) -> bool:
        """Let forces act as is likeliest beside causes; whether that is otherwise than before."""
        told = all(self.declared) or self.log.intervals.stages
        if self.filter is not None or not self.kinds or told:
            return False
        another = False
        # Without causes they were asked already. How often they were held is told by a delay, step by step.
        for _ in range(RELINEARISATIONS if best.chosen or not filters else 0):
            before, kinds = self.force, self._kinds_of_forces(best)
            if kinds == self.kinds and np.array_equal(before.counts, self.force.counts):
                break
            another, self.kinds = True, kinds
            self._predict()
            # What forces do otherwise between rows looked like noise of the rows.
            self.log = self.log.with_noise(self._errors(self.flow.end, self.Phi))
            self.Q = self._unknown()
        filtering = self._filter_of_forces(best) if filters else None
        if filtering is not None:
            self._filtered(*filtering)
            self._predict()
            self.causes = self._cause_columns()
            self.Q = self._unknown()
        return another or filtering is not None

    def refined(self) -> Inference:
        """The posterior of causes linearised at themselves: what they do is not linear in their size.

        Where the model with the causes in it has no motion between the rows, the one without.
        """
        state = dict(self.__dict__)
        self.refining = True
        try:
            for turn in range(RELINEARISATIONS):
                before = self.posterior.best
                self.shortlist = self.methods if turn else ()
                late = [
                    (theta[0], theta[-1] if len(theta) > 1 else theta[0] ** 2)
                    for c, theta in zip(before.chosen, before.theta, strict=True)
                    if c.kind in self.late
                ]
                if not late and not np.any(np.where(self.of_log, 0.0, before.coefficients)):
                    break
                for delay, smoothing in late:
                    if abs(delay) <= WITHIN_A_ROW * self.step and self.filter is None:
                        continue
                    variance = max(smoothing - delay**2, (NARROW * self.step) ** 2)
                    self._filtered(float(delay), float(np.sqrt(variance)))
                self._linearised_at(before.coefficients)
                if self.filter is not None:
                    self.Q = self._unknown()
                self.posterior = self._compare()
                if self.posterior.best.chosen == before.chosen and before.repeats(
                    self.posterior.best
                ):
                    break
        except (FlowError, np.linalg.LinAlgError):
            self.__dict__.update(state)
        return self._made(self.posterior)

    def of_steps(self, result: Inference) -> Inference:
        """The result, with what is left as errors of steps where most of it is of no force and of no term.

        A force moves coordinates by what it moves speeds, times half the interval. Errors of a step that an
        adaptive method chose, or of the polynomial in it, move each on its own.
        """
        rows, best = self.of_rows, result.posterior.best.coefficients
        whole, rest = (rows.projected.left(x) for x in (0.0 * best, best))
        named = rest - rows.count < SLIGHT * whole or result.generic.share > 0.0
        if named or self.log.unknown.any() or self.blocks[0] is not rows:
            return result
        if not self._of_no_force(result.residual):
            return result
        none = nothing(len(self.coefficients))
        made = self._made(replace(result.posterior, best=none, alternatives=()), scattered=True)
        if result.tau > WHITE:  # what steps do in several rows, causes imitate
            return made
        parts, of_causes = made.attribution, result.attribution.equations.curve
        integrator = parts.integrator
        integrator = replace(integrator, curve_error=np.hypot(integrator.curve_error, of_causes))
        disputed = max(made.disputed, float(np.abs(of_causes).max()))
        return replace(made, attribution=replace(parts, integrator=integrator), disputed=disputed)

    def _errors(self, end: Rows, Phi: Array, log: Observations | None = None) -> Array:
        """Prediction errors (N, 2n) of the rows, of the flow or of a method's map with its derivatives."""
        log = log or self.log
        return self.model.difference(end, log.intervals.end) + log.shift(Phi)

    def _compare(self) -> Posterior:
        """The posterior of causes, linearised at the likeliest states where the log has no speeds.

        The iterated smoother is the method of Gauss and Newton for states and numbers together (Bell, The
        iterated Kalman smoother as a Gauss–Newton method, SIAM J. Optim. 1994).
        """
        posterior = self._tried(self._compare_once())
        for _ in range(SMOOTHINGS if self.log.unknown.any() else 0):
            before, self.log = self.log.beyond[1], self._states(posterior.best)
            moved = np.linalg.norm(self.log.beyond[1] - before)
            if moved <= STILL * np.linalg.norm(before):
                break
            self._predict()
            self._linearise()
            self.causes = self._cause_columns()
            posterior = self._compare_once()
        return posterior

    def _tried(self, posterior: Posterior) -> Posterior:
        """The posterior, or one linearised at causes beside which a method leaves but their squares.

        The fields of an unknown integrator explain much: by the squares alone it would be preferred.
        """
        state = dict(self.__dict__)
        rounded = self.of_rows.misfit(posterior.best.coefficients) <= self.of_rows.least
        for _ in range(RELINEARISATIONS):
            if self.promising is None or self.methods or self.refining:
                break
            places = self.fields[0].shape[2] + np.arange(len(self.coefficients))
            other = self._search(self._of_method(self.promising, places))
            if not other.best.chosen:
                break
            try:
                self._linearised_at(other.best.coefficients)
                other = self._compare_once()
            except (FlowError, np.linalg.LinAlgError):
                break
            # What was fitted to rounding tells nothing of causes but where it is linearised at them.
            if self.methods or (rounded and other.best.chosen):
                return other
        self.__dict__.update(state)
        return posterior

    def _states(self, best: Fit) -> Observations:
        """The log at the likeliest states beside causes, of a method or of the integrator's fields."""
        ni, rows = self.fields[0].shape[2], self.of_rows
        causes = self._moved_by(self.numbers, self._h) @ (best.coefficients - self.coefficients)

        def at(left: Array) -> Observations:
            return self.log.at(self.model, self.innovations.errors(left - causes))

        Phi = self.innovations.Phi
        w = self._errors(self.flow.end, Phi)
        # Each method has states of its own, at which it closes the rows or does not.
        own = [(of, self.log) for of in self._maps() if of.method is not EXACT]
        for _ in range(2 * SMOOTHINGS):
            own = [self._moved(of, at(self._errors(of.end, Phi, log))) for of, log in own]
            closest = self._closest(own)
            if closest is not None:
                digits = max(self.log.rounding * rows.r.size, closest.floor)
                pairs, floors = own, closest.floors
                near = floors <= FAR * digits
                own = [pair for pair, close in zip(own, near, strict=True) if close]
        if closest is not None and closest.may_close(rows, best):
            # The last step that each took is of its own size: what is below the digits is alike.
            low = min(digits, FAR * closest.floor)
            self.alike = [pair for pair, x in zip(pairs, floors, strict=True) if x <= low]
            return self.alike[0][1]
        if self.methods:
            return at(w - self.defects[0])
        return at(w - self.B[:, :, :ni] @ rows.projected.nuisance_at(best.coefficients)[:ni])

    def _moved(self, of: Map, log: Observations) -> tuple[Map, Observations]:
        """A method's map at other states."""
        force = self.force(self.kinds)
        return next(maps(self.plant, log.intervals, force, self.counts, 1, [of.method])), log

    def _compare_once(self) -> Posterior:
        """The posterior of causes, beside an unknown integrator or one whose map closes the rows."""
        log, model = self.log, self.plant
        both = [
            np.concatenate([a, b], axis=2) for a, b in zip(self.fields, self.causes, strict=True)
        ]
        self.Phi, self.B = transported(log.intervals.h, self.transitions, both)
        ni, P = self.fields[0].shape[2], self.causes[0].shape[2]
        places = ni + np.arange(P)
        Phi, w = self.Phi, self._errors(self.flow.end, self.Phi)
        self.bent = self._between_rows()
        columns = np.concatenate([w[:, :, None], self.B, self.bent], axis=2)
        # The integrator moves the noise of a row and what causes do otherwise than the flow does, by its
        # fields of first order.
        white, _ = log.innovations(Phi, self.Q)(columns[:, :, : 1 + ni])
        alone = self._block(white[:, :, 0], white[:, :, 1:], ni, places[:0])
        c = np.clip(alone.projected.nuisance[:FIRST_ORDER], -1.0, 1.0)
        self.numbers = c
        columns[:, :, places + 1] = self._moved_by(c, self._h)
        if log.rounding < 1.0:
            change = first_order_jacobian(model, log.intervals.start, self._h, c)
            Phi = Phi + log.intervals.h[:, :, None] * change @ Phi
            columns[:, :, 0] = self._errors(self.flow.end, Phi)
        self.innovations = log.innovations(Phi, self.Q)
        white, spread = self.innovations(columns)
        series = self._block(white[:, :, 0], white[:, :, 1:], ni, places, spread)
        self.D = np.ascontiguousarray(white[:, :, ni + 1 :])
        self.gradient, self.slack = self._weights()
        self.works, self.of_methods = self._works(), dict[Map, Block]()
        self.bias, self.omitted = self._attenuation(), self._remainder(series)
        measured = self._of_rates() if self._knows_accelerations else None
        posterior, series = (measured[1], series) if measured else self._of_series(series)
        self.methods: tuple[Integrator, ...] = ()
        self.promising: Map | None = None
        self.defects = list[Array]()
        self.series, self.of_rows = series, series
        for ends in (self._maps(), self._maps_by_parts(series, posterior.best)):
            methods = self._closest([(of, self.log) for of in ends])
            if methods is None:
                continue
            methods = self._by_own_steps(methods, places)
            first = methods.ends[0] if methods.floor < SQUARES * methods.alone else None
            if not methods.may_close(series, posterior.best):
                self.promising = self.promising or first
                continue
            ends, closing, other = self._best_of(methods, places, measured)
            gain = log_evidence(closing, other.best, series, posterior.best)
            if gain - np.log(len(INTEGRATORS)) > CERTAIN:
                posterior, self.of_rows = other, closing
                self.methods = tuple(of.method for of in ends)
                self.between = ends[0].counts
                self.defects = [model.difference(self.flow.end, of.end) for of in ends]
                if measured is None:
                    posterior = self._with_noise_left(posterior, ends[0], places)
                break
            self.promising = self.promising or first
        self.blocks: tuple[Block, ...] = (measured[0] if measured else self.of_rows,)
        return posterior

    def _between_rows(self) -> Array:
        """What forces do that are otherwise between rows, by a unit of that (N, 2n, k).

        Splines of two orders differ by what the lower one lacks, and that by what the higher one lacks; it
        goes with the motion, as what a cause does.
        """
        force, h = self.force, self.log.intervals.h
        other = {"ramp": (force.bends[0] - force.bends[1]) / 12.0}
        other |= {"smooth": force.gap, "step": force.gap}
        columns = [np.zeros((*self.w.shape, 0))]
        doubted = [k for k, kind in enumerate(self.kinds) if kind in other and not self.declared[k]]
        for k, response in enumerate(self._force_responses if doubted else ()):
            if k in doubted and np.any(size := other[self.kinds[k]][:, k : k + 1]):
                du = response * h * size
                columns.append(np.concatenate([0.5 * h * du, du], axis=1)[:, :, None])
        return np.concatenate(columns, axis=2)

    def _by_own_steps(self, methods: Methods, places: NDArray[np.intp]) -> Methods:
        """The methods, with the floor that causes leave in their own steps where the series' leave some."""
        low, high = SQUARES * methods.alone, SOME * methods.alone
        if not len(places) or not low < methods.floor < high:
            return methods
        blocks = [self._of_method(of, places) for of in [*methods.ends, *methods.others][:ALIKE]]
        return replace(methods, floor=min(block.floor * block.count for block in blocks))

    def _best_of(
        self,
        methods: Methods,
        places: NDArray[np.intp],
        measured: tuple[Block, Posterior] | None,
    ) -> tuple[list[Map], Block, Posterior]:
        """The best of methods that are alike beside all causes, and those that are so beside its own.

        All causes together imitate a method that is near the right one, few do not: where none explains what
        all do, those near are tried as well.
        """
        trials, ends = list[tuple[Block, Posterior]](), methods.ends
        for of in [*ends, *methods.others][:ALIKE]:
            block = self._of_method(of, places)
            trials.append((block, measured[1] if measured else self._search(block)))
            left = block.misfit(trials[-1][1].best.coefficients)
            explained = left <= max(FAR * methods.floor, block.least)
            if explained and (len(trials) >= len(ends) or not trials[-1][1].best.chosen):
                break
        ends = [*ends, *methods.others][: max(len(ends), len(trials))]
        k = self._likeliest_of(trials)
        best, own = trials[k]
        moved = self._moved_by(self.numbers, self._h) @ (own.best.coefficients - self.coefficients)
        Phi = self.innovations.Phi
        white, _ = self.innovations(
            np.stack([self._errors(of.end, Phi) - moved for of in ends], axis=2)
        )
        likely = alike(white, k, self.log.rounding)
        return [ends[k], *(ends[i] for i in likely if i != k)], best, own

    def _likeliest_of(self, trials: Sequence[tuple[Block, Posterior]]) -> int:
        """Which of several methods, each with the causes beside it, is the likeliest.

        Odds of a cause are those against all methods without it. What another method makes of it as likely,
        and much smaller, is what that does otherwise.
        """
        k = 0
        for i, (block, posterior) in enumerate(trials):
            best, own = trials[k]
            more = np.sign(len(posterior.best.chosen) - len(own.best.chosen))
            if log_evidence(block, posterior.best, best, own.best) > more * CERTAIN:
                k = i
        best, own = trials[k]
        energy = self._exchanged(own.best)[0].max(initial=0.0)
        for i, (block, _) in enumerate(trials):
            fit = fitted((block,), own.best.chosen) if i != k and own.best.chosen else None
            if fit is None or log_evidence(block, fit, best, own.best) < -CERTAIN:
                continue
            if self._exchanged(fit)[0].max() < SLIGHT * energy:
                return i
        return k

    def _moved_by(self, c: Array, step: Array) -> Array:
        """What causes do to the rows (N, 2n, P) by an integrator of numbers c of first order, steps (N, 1).

        Its fields are those of the field with the causes in it: (G, 0), (0, G_q u) and (0, G_u a + a_u G).
        """
        n, h = self.model.n, self.log.intervals.h
        moves = self.B[:, :, self.fields[0].shape[2] :].copy()
        first, last = self.causes[0][:, n:], self.causes[-1][:, n:]
        mean, size = 0.5 * (first + last), step[:, :, None]
        moves[:, :n] += c[0] * size * h[:, :, None] * mean
        moves[:, n:] += 0.5 * (c[1] + c[2]) * size * (last - first)
        moves[:, n:] += c[2] * size * h[:, :, None] * (self.J[0][:, n:, n:] @ mean)
        return moves

    def _moved_in(self, of: Map) -> Array:
        """What causes do to the rows (N, 2n, P) by the steps of a method, or else by its numbers."""
        intervals = self.log.intervals
        G = [x[:, self.model.n :] for x in self.causes]
        own = by_causes(of, self.J, G, intervals)
        step = intervals.h / of.counts[:, None]
        return self._moved_by(numbers_of(of.method), step) if own is None else own

    def _with_noise_left(
        self, posterior: Posterior, of: Map, places: NDArray[np.intp]
    ) -> Posterior:
        """The posterior with the noise that a method that closes the rows leaves of them, if that is less.

        What another integrator does looked like noise.
        """
        log, optimum = self.log, self.of_rows.optimum - self.coefficients
        w = self._errors(of.end, self.innovations.Phi) - self._moved_in(of) @ optimum
        known, noise = ~log.unknown, log.with_noise(w)
        if not np.any(LESS * noise.noise[1][:, known] < log.noise[1][:, known]):
            return posterior
        self.log, self.of_methods = noise, {}
        self.of_rows = self._of_method(of, places)
        return self._search(self.of_rows)

    def _maps(self) -> Sequence[Map]:
        """Maps of methods by which rows may follow from each other: the same until the flow is another."""
        log, force = self.log, self.force(self.kinds)
        if self.mapped is None or self.mapped[0] is not self.flow:
            own = maps(self.plant, log.intervals, force, self.counts, 1, self.shortlist)
            exact = Map(EXACT, np.ones(len(log.intervals), dtype=np.intp), self.flow.end)
            self.mapped = self.flow, [*own, exact]
        return self.mapped[1]

    def _maps_by_parts(self, series: Block, best: Fit) -> Iterator[Map]:
        """The same where several steps of unknown length lie between rows, as the series' numbers say."""
        if self.run.provenance.step is not None or self.plant.n > MOST_SPEEDS:
            return
        (c, covariance), force = self._numbers(series, best), self.force(self.kinds)
        for method, k in parted(c, covariance, PARTS, self.plant.damped):
            yield from maps(self.plant, self.log.intervals, force, self.counts, k, [method])

    def _numbers(self, series: Block, best: Fit) -> tuple[Array, Array]:
        """The integrator's numbers beside causes, and their covariance, of the fields of the series."""
        p, some = series.projected, slice(0, len(FIELDS))
        variance = series.misfit(best.coefficients) / series.count
        tau = autocorrelation_time(series.residual(best.coefficients))
        return p.nuisance_at(best.coefficients)[some], (p.inverse * variance * tau)[some, some]

    def _closest(self, ends: Sequence[tuple[Map, Observations]]) -> Methods | None:
        """Those by which rows follow most closely beside causes, each at states of its own."""
        if not ends:
            return None
        Phi = self.innovations.Phi
        white, _ = self.innovations(
            np.stack([self._errors(of.end, Phi, log) for of, log in ends], axis=2)
        )
        rounding = self.log.rounding
        return Methods.of([of for of, _ in ends], white, self.D, rounding)

    def _weights(self) -> tuple[Array, Array]:
        """What a defect of an interval adds to ΔC, (N, 2n): ∂E/∂x at its end and, by the flow, at its start.

        Weighed at either end alone the sum is off by a share of the step. The second array is half of the
        difference. Where the motion is stiff, what is at the end no longer tells of the start.
        """
        intervals, gradient = self.log.intervals, self.model.energy_gradient
        mild = (rates(self.J[0]) * intervals.h)[:, 0] < 1.0
        end = gradient(self.flow.end)
        start = np.array(end)
        transposed = self.Phi[mild].transpose(0, 2, 1)
        before = gradient(intervals.start)[mild][:, :, None]
        start[mild] = np.linalg.solve(transposed, before)[:, :, 0]
        # The mean of the gradients at prediction and row makes of a quadratic energy what it changes by. It
        # is of both weights: noise squared adds nothing to their difference.
        half = 0.5 * (gradient(intervals.end) - end)
        return 0.5 * (start + end) + half, 0.5 * (end - start)

    def _of_rates(self) -> tuple[Block, Posterior]:
        """The equations by known accelerations, and their posterior; the same wherever it is linearised."""
        if self.by_rates is None or len(self.by_rates[0].causes) != len(self.coefficients):
            block, _ = self._measured(np.arange(len(self.w)))
            posterior = self._search(block)
            if any(c.kind == "body-centre" and c.size > 1 for c in posterior.best.chosen):
                # The centre may have moved along fewer axes.
                posterior = refitted((block,), posterior, self.candidates)
            self.by_rates = block, posterior
        return self.by_rates

    def _of_series(self, series: Block) -> tuple[Posterior, Block]:
        """The posterior beside an unknown integrator, and the block with the noise that there is."""
        posterior = self._search(series)
        variance = series.projected.left(posterior.best.coefficients) / series.count
        if variance > 2.0 * series.variance:
            # The numbers of an integrator are of the size of their prior beside the noise that there is.
            series = series.beside(variance)
            posterior = self._search(series)
        return posterior, series

    @property
    def _knows_accelerations(self) -> bool:
        run = self.run
        derived = "udot" in run.provenance.derived or self.model.n < len(
            self.model.mechanism.free.u
        )
        return trusted(run) and run.udot is not None and not derived

    def _search(self, block: Block) -> Posterior:
        if self.refining:
            return refitted((block,), self.posterior, self.candidates)
        # Known accelerations are linear in almost all causes: small ones beside large ones are real.
        many = (MANY, 0.0, True) if self._knows_accelerations else (TOGETHER, BESIDE)
        # What the series leaves out is no matter of known accelerations, nor of a method's own map.
        series = len(block.nuisance) > self.bent.shape[2]
        least = max(self.bias, self.omitted if series else 0.0)
        joules, negligible = lambda fit: self._exchanged(fit)[0], NEGLIGIBLE * self.energy
        return search((block,), self.candidates, joules, least, negligible, *many)

    def _of_method(self, of: Map, places: NDArray[np.intp]) -> Block:
        """Prediction errors of a method's map, whitened with the map's own derivatives."""
        if of in self.of_methods:
            return self.of_methods[of]
        log = self.log
        own = transition(self.plant, of, log.intervals, self.force(self.kinds))
        Phi = self.Phi if own is None else own
        errors = self._errors(of.end, Phi)[:, :, None]
        columns = np.concatenate([errors, self.B, self.bent], axis=2)
        columns[:, :, places + 1] = self._moved_in(of)
        white, spread = log.innovations(Phi, self.Q)(columns)
        block = self._block(white[:, :, 0], white[:, :, 1:], 0, places, spread)
        self.of_methods[of] = block
        return block

    def _block(
        self, r: Array, D: Array, nuisance: int, places: NDArray[np.intp], spread: float = 0.0
    ) -> Block:
        weight = np.sqrt(robust_weights(r))[:, None]
        bent = np.arange(self.fields[0].shape[2] + len(places), D.shape[2])
        prior = np.concatenate([self.prior[:nuisance], np.ones(len(bent))])
        return Block(
            r * weight, D * weight[:, :, None], np.append(np.arange(nuisance), bent), prior, places,
            self.log.rounding, spread, origin=self.coefficients[: len(places)],
        )  # fmt: skip

    def _exchanged(self, fit: Fit) -> tuple[Array, Array, Array]:
        """Energy (J) that each cause of a fit exchanges, its standard error, and what it adds to ΔC.

        Of some of the intervals: these are sums that need two digits.
        """
        scale, exchanged, errors, energies = self.whole * len(self.w), [], [], []
        for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta, strict=True)):
            work = (fit.of(k) @ self.works[list(c.columns)]) * scale
            exchanged.append(float(np.abs(work).sum()))
            energies.append(float(work.sum()))
            relative = fit.deviation(k) / np.maximum(np.abs(theta), 1e-300)
            errors.append(exchanged[-1] * min(float(relative.min()), 1.0))
        return np.array(exchanged), np.array(errors), np.array(energies)

    def _works(self) -> Array:
        """What a unit of each cause works on average (P, …), in the directions of some of the intervals."""
        every = max(1, len(self.w) // ENOUGH)
        B = self.B[::every, :, self.fields[0].shape[2] :]
        works = self.gradient[::every, :, None] * B / len(B)
        return np.ascontiguousarray(np.concatenate(works).T)

    def _attenuation(self) -> float:
        """Joules by which noise in the columns themselves may bias a cause.

        Columns are evaluated at the rows, and share their noise with the prediction errors. The bias of
        errors in variables is the ratio of the variances of noise and motion (Fuller, Measurement Error
        Models, 1987, §1.1), here of the energies that flow by either.
        """
        intervals = self.log.intervals
        displacement = self.model.difference(intervals.start, intervals.end)
        motion = np.concatenate(
            [np.cumsum(displacement[a:b], axis=0) for a, b in self.log.pieces], axis=0
        )
        noise = np.mean(self.log.noise[1] ** 2, axis=0)
        ratio = np.minimum(noise / np.maximum(np.var(motion, axis=0), 1e-300), 1.0)
        return self.whole * float((ratio * np.abs(self.gradient * displacement)).sum())

    def _remainder(self, series: Block) -> float:
        """Joules that the first order beyond the series may exchange.

        A term of the next order is ρ times as large, ρ the step times the spectral radius of ∂f/∂x. What is
        below this is no evidence of a mistake.
        """
        some = np.unique(np.linspace(0, len(self.J[0]) - 1, 32).astype(np.intp))
        radius = np.abs(np.linalg.eigvals(self.J[0][some])).max(axis=1)
        rho = self.step * float(np.median(radius))
        x, size = series.projected.nuisance, np.abs(self.gradient)
        parts = [
            self.whole * float((size * np.abs(self.B[:, :, k] @ x[k])).sum())
            for k in ([i for i, f in enumerate(FIELDS) if f.order == order] for order in (1, 2))
        ]
        return max(parts[0] * rho**3, parts[1] * rho**2)

    def _measured(self, some: NDArray[np.intp]) -> tuple[Block, Array]:
        """The equations at the starts of some intervals, by accelerations that are known to be theirs.

        Nothing is integrated. The second value is what a unit of each column adds to the accelerations.
        """
        run, model, log = self.run, self.model, self.log
        assert run.udot is not None
        rows = np.concatenate([np.arange(a, b - 1) for a, b in log.rows])[some]
        free, at = model.mechanism.free.u, log.intervals.start.take(some)
        udot, half = run.udot[rows][:, free], digits_of(run)["udot"].half()[rows][:, free]
        a, rest = model.at(at), np.zeros_like(at.F)
        columns = self._responses(model, at, udot, rest, rest)
        slopes = np.abs(self.J[0][some, model.n :])
        of_rows = np.einsum("kij,kj->ki", slopes, log.digits[0][some])
        sigma = np.sqrt(half**2 + of_rows**2) + 1e-12 * (1.0 + np.abs(a).max())
        sigma = np.sqrt(np.mean(sigma**2, axis=0))
        none = np.zeros(0, dtype=np.intp)
        block = Block(
            (udot - a) / sigma,
            columns / sigma[:, None],
            none,
            np.zeros(0),
            np.arange(columns.shape[2]),
            1.0,
        )
        return block, columns

    def _kinds_of_forces(self, best: Fit) -> tuple[str, ...]:
        """How each logged force acts between two rows, by the likelihood beside the best causes."""
        held, force = self._times_held(), self.force
        if held and "step" not in self.kinds:
            force = replace(force, counts=held[0])
        kinds = [kind for kind in FORCES if kind != "step"]
        parts = [force.parts(s) for s in np.linspace(0.0, 1.0, 5)]
        columns = [
            impulse(response, np.array([part[which][:, k] for part in parts]), self.log.intervals.h)
            for k, response in enumerate(self._force_responses)
            for which in range(4)
        ]
        trial = self._beside(best, columns)
        p = trial.projected
        gram = np.block([[np.array([[p.rss]]), p.b[None]], [p.b[:, None], p.A]])
        tau = autocorrelation_time(trial.residual(np.linalg.pinv(p.A, rcond=1e-10) @ p.b))
        current = np.array([FORCES[kind] for kind in self.kinds])
        laws = [FORCES[kind] for kind in kinds]
        laws += [(0.0, 1.0, 1.0, float(np.mean(force.counts / counts))) for counts in held]
        own = [kinds.index(kind) if kind else -1 for kind in self.declared]
        chosen = likeliest(gram, trial.count / tau, own, current, np.array(laws), len(kinds))
        steps = [k - len(kinds) for k in chosen if k >= len(kinds)]
        if steps:
            self.force = replace(self.force, counts=held[steps[0]])
        return tuple("step" if k >= len(kinds) else kinds[k] for k in chosen)

    def _times_held(self) -> list[NDArray[np.intp]]:
        """How often (N,) forces may have been held in each interval, where rows are not all steps.

        A controller may be asked in every step, or in every few.
        """
        ones, counts = np.ones(len(self.w), dtype=np.intp), self.counts
        if counts is not None and counts.max() > 1:
            n = int(counts[0])
            return [counts] + [
                n // k * ones for k in PARTS if np.all(counts == n) and not n % k and n > k
            ]
        return [k * ones for k in PARTS] if self.run.provenance.step is None else []

    def _filter_of_forces(self, best: Fit) -> tuple[float, float] | None:
        """Delay and deviation (s) of a filter of all forces that has odds; of states that were filtered."""
        if not any(c.kind == "late-forces" for c in self.candidates):
            return None
        intervals, pieces = self.log.intervals, self.log.pieces
        acting, h = self.force(self.kinds), float(np.median(intervals.h))
        nodes = np.linspace(0.0, 1.0, 5)
        now = np.stack([acting(s) for s in nodes])
        hypotheses = [
            (d * h, s * h) for d in DELAYS for s in SPREADS if max(abs(d), s) > WITHIN_A_ROW
        ]
        columns = [np.zeros_like(self.w) for _ in hypotheses]
        responses = list(self._force_responses)
        for column, (delay, spread) in zip(columns, hypotheses, strict=True):
            other = LoggedForce.filtered(intervals, pieces, acting, delay, spread)
            smooth = LoggedForce.of(other, pieces)(("smooth",) * len(self.kinds))
            change = np.stack([smooth(s) for s in nodes]) - now
            for k, response in enumerate(responses):
                column += impulse(response, change[:, :, k], self.log.intervals.h)
        trial = self._beside(best, columns)
        p = trial.projected
        left = np.maximum(p.rss - 2.0 * p.b + np.diag(p.A), 1e-300)
        k = int(np.argmin(left))
        tau = autocorrelation_time(trial.residual(np.eye(len(left))[k]))
        odds = 0.5 * trial.count / tau * np.log(p.rss / left[k]) - np.log(len(left))
        return hypotheses[k] if odds > CERTAIN else None

    @property
    def _force_responses(self) -> Iterator[Array]:
        start = self.log.intervals.start
        return unit_responses(self.plant, Rows(start.t, start.q, start.u, self.force.first))

    def _beside(self, best: Fit, columns: list[Array]) -> Block:
        """Whitened prediction errors with columns (N, 2n), beside the integrator's fields and causes."""
        h = self.log.intervals.h
        tangent = np.column_stack([best.tangent, self.coefficients])
        own = [
            np.concatenate([a, b @ tangent], axis=2)
            for a, b in zip(self.fields, self.causes, strict=True)
        ]
        Phi, B = transported(h, self.transitions, own)
        w = self._errors(self.flow.end, Phi)[:, :, None]
        w, B = w + B[:, :, -1:], B[:, :, :-1]
        everything = [w, B, np.stack(columns, axis=2)]
        white, _ = self.log.innovations(Phi, self.Q)(np.concatenate(everything, axis=2))
        count = B.shape[2]
        prior = np.concatenate([self.prior, np.full(count - len(self.prior), 1e6)])
        places = count + np.arange(len(columns))
        return Block(white[:, :, 0], white[:, :, 1:], np.arange(count), prior, places)

    # --- the result ---

    def _made(
        self, posterior: Posterior, scattered: bool = False, agreed: bool = False
    ) -> Inference:
        log, best, ni = self.log, posterior.best, self.fields[0].shape[2]
        rows = self.of_rows
        residual = rows.residual(best.coefficients)
        tau = autocorrelation_time(residual)
        p, variance = rows.projected, rows.misfit(best.coefficients) / rows.count
        c = p.nuisance_at(best.coefficients)[:ni]
        covariance = (p.inverse * variance * tau)[:ni, :ni]
        power = np.einsum("km,kmp->kp", self.gradient, self.B)
        gradient, ends = self.model.energy_gradient, (self.as_logged.end, log.intervals.end)
        slope, w = 0.5 * sum(map(gradient, ends)), self.model.difference(*ends)
        jump, between = np.einsum("km,km->k", slope - self.slack, w), 0.0
        causes = self.B[:, :, ni:] @ (best.coefficients - self.coefficients)
        if self.methods:
            work = [np.einsum("km,km->k", self.gradient, x) for x in self.defects]
            work += [np.einsum("km,km->k", self.gradient, x) for x in self._other_defects()]
            curves = log.running(np.stack(work, axis=1)).T
            # Methods that close the rows alike do not make the same joules; nor do forces between rows of
            # which a method takes one alone.
            forces = [curves[0] + x for x in self._other_forces()]
            between = float(np.abs(forces - curves[0]).max(initial=0.0)) if forces else 0.0
            others = np.stack([*curves, *forces])
            left = self.w - self.defects[0] - causes
            # Where they leave more than the rows' noise, the rest may be the integrator's, or lost forces'.
            known = np.where(log.unknown | (self.between > 1)[:, None], 0.0, self.gradient)
            # Noise of rows does not add up: what the one adds the next takes away.
            rest = np.maximum.accumulate(np.abs(np.cumsum(np.einsum("km,km->k", known, left))))
            beyond = np.sqrt(max(1.0 - 1.0 / max(variance, 1.0), 0.0)) * rest
            if self.methods[0] is EXACT:
                # Errors that are not seen may be of any size that the fields of an integrator may have.
                _, C = self._numbers(self.series, best)
                T = log.running(power[:, : len(C)])
                beyond = np.hypot(beyond, np.sqrt(np.einsum("ki,ij,kj->k", T, C, T)))
            integrator = Share(curves[0], np.hypot(np.abs(others - curves[0]).max(axis=0), beyond))
        else:
            # What the series leaves out is the integrator's too: as much of what is left as is likely.
            left = self.w - self.B[:, :, :ni] @ c - causes
            noise = log.noise[0] ** 2 + log.noise[1] ** 2
            noise += np.einsum("kii->ki", sum(self.uncertain))
            own = self.beyond**2 / (self.beyond**2 + noise + 1e-300) / max(variance, 1.0)
            if log.unknown.any():
                own = np.zeros_like(own)
            partly = self.gradient * (1.0 - own)
            curves = log.running(np.einsum("km,kmp->kp", partly, self.B[:, :, :ni]))
            curve = log.running(power[:, :ni]) @ c
            late = np.einsum("km,km->k", self.gradient, own * left)
            curve += log.running(late)
            # Or it is of something else that the series hides.
            either = np.cumsum(np.abs(late))
            if log.unknown.any():
                rate = self._of_rates_of_q(log)
                curves[:, 0] += rate
                curve += rate * c[0]
            spread = np.maximum(np.einsum("ki,ij,kj->k", curves, covariance, curves), 0.0)
            # The order beyond the series is no noise: its joules grow with the motion, hidden in noise.
            most = np.cumsum(np.einsum("km,km->k", np.abs(self.gradient), np.sqrt(noise)))
            beyond = np.minimum(self._remainder(rows) * np.linspace(0.0, 1.0, len(self.w)), most)
            rest = np.cumsum(np.einsum("km,km->k", partly**2, self.beyond**2))
            error = np.sqrt(spread + beyond**2 + rest * tau + either**2)
            integrator = Share(curve, error)
            left = (1.0 - own) * left
        integrator = self._on_path(integrator, self.w - left - causes, left)
        gaps = log.in_gaps(np.einsum("km,km->k", self.gradient, self.w - left - causes))
        # Of two flows of order 8 the finer is off by 2⁻⁸ of their difference.
        of_flow = 2.0**-8 * np.cumsum(np.einsum("km,km->k", np.abs(self.gradient), self.flow.error))
        unseen = self._unseen(self.blocks, best, tau, log.running(power[:, ni:]))
        if self.methods:
            step = float(np.median(log.intervals.h[:, 0] / self.between))
            estimated = identified((*self.methods, *(of.method for of, _ in self._others)), step)
        else:
            some = slice(0, len(FIELDS))
            estimated = estimate(c[some], covariance[some, some], self.plant.damped, self.step)
        # Where numbers are of no method, a mistake that does the same to the rows may do what is beside one.
        instead = np.zeros(len(self.w))
        if not self.methods:
            first = slice(0, FIRST_ORDER)
            near = [numbers_of(m)[first] for m in INTEGRATORS if m.name in estimated.names]
            rest = min((c[first] - own for own in near), key=np.linalg.norm, default=c[first])
            beside = log.running(power[:, first]) @ rest
            instead = np.minimum(np.abs(beside), self._imitated(unseen))
        each = np.stack([integrator.curve_error, gaps, of_flow, instead])
        integrator = replace(integrator, curve_error=np.linalg.norm(each, axis=0))
        moved = causes + self.model.difference(self.nominal.end, self.flow.end)
        mistake = self._on_path(self._share(best, power[:, ni:], tau), moved, left)
        # Sets of causes that explain as much do other joules, and one that is not seen may do some.
        sets = [self._share(fit, power[:, ni:], tau).curve for fit in posterior.alternatives]
        spread = np.abs([x - mistake.curve for x in (mistake.curve, *sets)]).max(axis=0)
        sizes = np.minimum(list(unseen.values()), self.energy)
        hidden = float(np.sqrt(np.mean(sizes**2))) if len(sizes) else 0.0
        grown = np.linspace(0.0, hidden, len(spread))
        gaps = log.in_gaps(np.einsum("km,km->k", self.gradient, moved))
        mistake = replace(
            mistake, curve_error=np.sqrt(mistake.curve_error**2 + spread**2 + grown**2 + gaps**2)
        )
        of_log = self._share(best, power[:, ni:], tau, of_log=True).curve
        own, doubt = self.uncertain
        attribution, unexplained = joules(
            log,
            own * max(variance, 1.0) + doubt,
            self.gradient,
            jump,
            integrator,
            mistake,
            of_log,
            tau,
        )
        if scattered:
            # The joules of blows, if there are any, may be of something that the model lacks.
            work = np.einsum("km,km->k", self.gradient, left)
            large = (work**2 > FAR * np.median(work**2)) & (not agreed)
            blows = np.where(large, work, 0.0)
            of_log = of_log + np.cumsum(blows)
            curve = integrator.curve + attribution.log.curve - of_log
            each = np.sqrt(2.0 * np.mean((work - blows) ** 2))
            of_blows = np.cumsum(np.abs(blows))
            doubts = integrator.curve_error, attribution.log.curve_error, each + instead, of_blows
            error = np.linalg.norm(doubts, axis=0)
            attribution = replace(
                attribution,
                integrator=Share(curve, error),
                log=Share(of_log, attribution.log.curve_error),
            )
            unexplained = float(np.abs(blows).sum())
        intermittent = self._intermittent(rows, best, left)
        if scattered:
            intermittent = intermittent[0], intermittent[1] & (blows != 0.0)
        exchanged, errors, energy = self._exchanged(best)
        odds, explained, coefficients = _generic(self.blocks[0], best)
        unnamed = np.abs(self.gradient * (self.B[:, :, ni:] @ coefficients)).sum() * self.whole
        if scattered or unnamed < max(NEGLIGIBLE * self.energy, self.bias, self.omitted):
            odds = -np.inf
        shift = 0.0
        if not self.methods:
            other = p.nuisance_at(best.coefficients + coefficients)[:ni]
            shift = float(np.abs(log.running(power[:, :ni] @ (other - c))).max())
        if scattered:
            estimated = replace(estimated, names=("adaptive",))
        return Inference(
            model=self.model,
            log=log,
            kernels=self.kernels,
            forces=self.kinds,
            filter=self.filter,
            methods=self.methods,
            blocks=self.blocks,
            measured=self.blocks[0] is not rows,
            posterior=posterior,
            candidates=self.candidates,
            integrator=estimated,
            attribution=attribution,
            tau=tau,
            excess=variance,
            whole=self.whole,
            exchanged=exchanged,
            exchanged_error=errors * np.sqrt(tau),
            energy=energy,
            generic=Generic(odds, float(unnamed), explained, shift),
            unexplained=unexplained,
            intermittent=intermittent,
            disputed=float(np.abs(instead).max()),
            unseen=unseen,
            between=between,
            lost=bool(self.thinned.any()) and any(kind != "start" for kind in self.kinds),
            scattered=scattered,
            residual=left,
            acceleration=self.model.at(self.nominal.nodes[0]),
            w=w,
            gradient=self.gradient,
        )

    def _share(self, best: Fit, power: Array, tau: float, of_log: bool = False) -> Share:
        """ΔC's share of the causes that are of the equations, or of the log: delays and zeros."""
        own = [(c.kind in OF_THE_LOG) == of_log for c in best.chosen]
        if not any(own) and not (of_log and self.filter is not None):
            return Share(np.zeros(len(self.w)), np.zeros(len(self.w)))
        some = np.repeat(own, [c.size for c in best.chosen]).astype(bool)
        T = self.log.running(power @ best.tangent)[:, some]
        C = best.covariance[np.ix_(some, some)] * tau
        spread = np.maximum(np.einsum("ki,ij,kj->k", T, C, T), 0.0)
        coefficients = np.zeros_like(best.coefficients)
        for k, c in enumerate(best.chosen):
            if own[k]:
                np.add.at(coefficients, list(c.columns), best.of(k))
        known = np.where(self.of_log == of_log, self.coefficients, 0.0)
        ends = (self.as_logged, self.nominal) if of_log else (self.nominal, self.flow)
        # What the causes do that the flow has is known however large it is, the rest to first order.
        moved = self.model.difference(ends[0].end, ends[1].end)
        work = power @ (coefficients - known) + np.einsum("km,km->k", self.gradient, moved)
        curve = self.log.running(work)
        return Share(curve, np.sqrt(spread))

    def _other_forces(self) -> Iterator[Array]:
        """What forces that the closing method cannot tell from those assumed add to its joules, running.

        By those it arrives at the same rows as far as their noise tells, and the flow does not. Who asks for
        forces at several instants of a step takes them as functions of time.
        """
        method, h = self.methods[0], self.log.intervals.h
        if method.order > 1 or not self.kinds or self.says_what_was_held:
            return
        force, arrival = self.force(self.kinds), None
        for kind in ("step", "smooth") if self._several else ("start", "ramp", "smooth"):
            other = self.force(tuple(own or kind for own in self.declared))
            change = np.stack([other(s) - force(s) for s in np.linspace(0.0, 1.0, 5)])
            if not change.any():
                continue
            if arrival is None:
                arrival = self._arrival(method, force)
            apart = self.model.difference(arrival, self._arrival(method, other))
            if 0.5 * np.sum((apart / self.log.noise[1]) ** 2) < CERTAIN:
                moved = np.zeros_like(self.w)
                for k, response in enumerate(self._force_responses):
                    moved += impulse(response, change[:, :, k], h)
                yield -HALF * self.log.running(np.einsum("km,km->k", self.gradient, moved))

    def _arrival(self, method: Integrator, force: ForceBetween) -> Rows:
        """The rows that a method makes of those before."""
        start, end = self.log.intervals.start, self.log.intervals.end
        own = Intervals(replace(start, F=force(0.0)), replace(end, F=force(1.0)))
        return next(maps(self.plant, own, force, self.between, 1, [method])).end

    def _intermittent(self, rows: Block, best: Fit, left: Array) -> tuple[float, NDArray[np.bool_]]:
        """Log odds that something acts from time to time, and when; none where logged forces may be that.

        Forces that were not declared to be held may do otherwise between two rows, as those of contacts at
        the stages of a step: by as much as they change, at most. Where steps are lost, those that come and go
        may have been anything.
        """
        odds, active = _intermittent(rows, best, self.thinned)
        if odds > CERTAIN:
            h, speeds = self.log.intervals.h, self.gradient[:, self.model.n :]
            force, possible, lost = self.force, np.zeros(len(left)), list[Array]()
            acts = force.first != 0.0
            comes_and_goes = acts.any(axis=0) & ~acts.all(axis=0)
            for k, response in enumerate(self._force_responses):
                free = self.thinned | (not self.declared[k])
                moved = response * h * force.change[:, k : k + 1]
                possible += free * np.abs(speeds * moved).sum(axis=1)
                if comes_and_goes[k]:
                    unit = response * self.thinned[:, None]
                    none = np.zeros_like(unit)
                    lost += [np.hstack([none, unit]), np.hstack([unit, none])]
            if lost:
                left = _unmade(left, np.stack(lost, axis=2))
            if possible[active].sum() > np.abs(self.gradient * left)[active].sum():
                odds = -np.inf
        return odds, active

    def _of_rates_of_q(self, log: Observations) -> Array:
        """What a unit of the field (a, 0) of first order adds to ΔC of the rates of the coordinates (N,), J.

        Methods that are one method of the coordinates alone have speeds of other instants. Where the log has
        none, the energy is that of the coordinates' own rates, q̇ = u + c h a: it is the same for all of them.
        """
        n, h, (first, _) = self.model.n, self._h, log.pieces[0]

        def shift(at: Rows, h: Array) -> Array:
            gradient = self.model.energy_gradient(at)[:, n:]
            return np.asarray(np.einsum("km,km->k", gradient, h * self.plant.at(at)))

        start = log.intervals.start.take(np.array([first]))
        return shift(log.intervals.end, h) - shift(start, h[first : first + 1])

    @property
    def _others(self) -> Sequence[tuple[Map, Observations]]:
        """Methods that close coordinates alone as well as the one found, each with speeds of its own."""
        found = self.methods and self.alike and self.alike[0][0].method in self.methods
        return self.alike[1:] if found else []

    def _other_defects(self) -> Iterator[Array]:
        """What these do in each interval beside the flow."""
        for of, log in self._others:
            force, noise = self.force(self.kinds), log.noise[1]
            flow = predict(self.plant, log.intervals, force, noise, self.steps, self._parts)
            yield self.model.difference(flow.end, of.end)

    def _on_path(self, share: Share, defects: Array, left: Array) -> Share:
        """The integrator's share with the errors of its weights, and of the path.

        As much of the share as of the motion is not known: a defect on another path is another one.
        """
        intervals = self.log.intervals
        motion = self.model.difference(intervals.start, intervals.end)
        unknown, known = (np.sum(np.abs(self.gradient * x)) for x in (left, motion))
        doubt = min(float(unknown / max(known, 1e-300)), 1.0)
        slack = self.log.running(np.einsum("km,km->k", self.slack, defects))
        error = np.sqrt(share.curve_error**2 + (doubt * share.curve) ** 2 + slack**2)
        return Share(share.curve, error)

    def _imitated(self, unseen: dict[str, float]) -> float:
        """Most energy (J) of a mistake of one number that the integrator's fields do as well."""
        p = self.of_rows.projected
        same = [
            unseen.get(f"{c.kind} {c.element}".strip(), 0.0)
            for c in self.candidates
            for columns in [list(c.columns)]
            for L in [c.linear[:, 0]]
            if L @ p.A[np.ix_(columns, columns)] @ L < SAME * float(L**2 @ p.raw[columns])
        ]
        return max(same, default=0.0)

    def _unseen(
        self, blocks: Sequence[Block], best: Fit, tau: float, curves: Array
    ) -> dict[str, float]:
        """Energy (J) that a mistake of one number may add to ΔC at one standard error, by its name.

        `curves` (N, P) are what a unit of each column adds to ΔC.
        """
        joules = dict[str, float]()
        for c in self.candidates:
            linear = c.size == 1 and c.quadratic is None and c.kind not in OF_THE_LOG
            if not linear or any(c is x or c.excludes(x) for x in best.chosen):
                continue
            sigma = deviation(blocks, c, best, tau)
            name = f"{c.kind} {c.element}".strip()
            most = float(np.abs(curves[:, list(c.columns)] @ c.linear[:, 0]).max())
            if most > 0.0 and np.isfinite(sigma):  # else it is one of those found
                joules[name] = max(joules.get(name, 0.0), sigma * most)
        return joules


def _generic(block: Block, best: Fit) -> tuple[float, float, Array]:
    """Log odds and share of what all columns explain beyond the best set, and their coefficients so far."""
    coefficients = block.optimum
    rows = block.count / autocorrelation_time(block.residual(coefficients))
    before, after = block.misfit(best.coefficients), block.misfit(coefficients)
    odds = 0.5 * rows * float(np.log(before / after))
    price = 0.5 * block.rank * float(np.log(max(rows, 2.0)))
    return odds - price, 1.0 - after / before, coefficients - best.coefficients


def _jumps(w: Array) -> NDArray[np.bool_]:
    """Intervals (N,) in which a state jumps by far more than in most, as in impacts that a log leaves out."""
    size = np.mean((w / (np.median(np.abs(w), axis=0) + 1e-300)) ** 2, axis=1)
    return np.asarray(size > ACTIVE * np.median(size))


def _intermittent(
    block: Block, best: Fit, thinned: NDArray[np.bool_]
) -> tuple[float, NDArray[np.bool_]]:
    """Log odds that what is left comes in intervals of their own, and these intervals (N,).

    Two variances, of quiet and of active intervals, against the one of the best causes; each spell of
    activity costs its two ends. What logged forces did in intervals of which steps are lost is not known:
    beside others that are whole, these tell nothing.
    """
    none = np.zeros(len(block.r), dtype=np.bool_)
    whole = np.flatnonzero(~thinned) if not thinned.all() else np.arange(len(block.r))
    r = block.residual(np.zeros(len(block.causes)))[whole]
    n, d = r.shape
    size = np.mean(r**2, axis=1) + 1e-300
    ordered = np.sort(size)
    quiet = float(np.median(ordered[: max(4, n // 2)])) + 1e-300
    active = size > ACTIVE * quiet
    if not 2 < active.sum() < 0.7 * n:
        return -np.inf, none
    # What acts begins and ends from one interval to the next: a remainder of the series comes and goes
    # smoothly.
    edges = np.flatnonzero(np.diff(active.astype(int)))
    ratio = np.abs(np.log(size[edges + 1] / size[edges]))
    if not np.median(ratio) > np.log(ACTIVE):
        return -np.inf, none
    if len(block.nuisance):
        # Nuisance columns of quiet intervals alone: what acts now and then must not bend them.
        D, y = block.D[whole][:, :, block.nuisance], block.r[whole]
        ridge = np.diag(np.sqrt(block.floor) / block.prior)
        A = np.concatenate([D[~active].reshape(-1, D.shape[2]), ridge])
        b = np.concatenate([y[~active].ravel(), np.zeros(len(ridge))])
        r = y - D @ np.linalg.lstsq(A, b, rcond=1e-13)[0]
    low, high = float(np.mean(r[~active] ** 2)), float(np.mean(r[active] ** 2))
    share = active.mean()
    one = float(np.mean(block.residual(best.coefficients)[whole] ** 2))
    tau = autocorrelation_time(r[~active])
    spells = int(np.count_nonzero(np.diff(active.astype(int)) == 1)) + 1
    two = (1 - share) * np.log(low + 1e-300) + share * np.log(high + 1e-300)
    odds = 0.5 * n * d / tau * (np.log(one + 1e-300) - two)
    none[whole] = active
    return float(odds - 2.0 * spells * np.log(n)), none


ACTIVE = 100.0
"""Variance of an interval beside that of quiet ones from which on something acts in it that does not in
those."""


def _unmade(x: Array, columns: Array) -> Array:
    """What columns (N, m, k) cannot make of x (N, m)."""
    return np.asarray(x - (columns @ (np.linalg.pinv(columns) @ x[:, :, None]))[:, :, 0])
