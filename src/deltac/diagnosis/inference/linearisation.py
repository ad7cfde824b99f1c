"""A log linearised at a point: a flow between its rows, and what errors, integrators and causes do along it.

Fields and causes are columns at the nodes of the flow; the variational equation takes them to the end of each
interval. What the flow does not know is process noise: its own error, digits and noise of logged forces, what
these do between the rows, what a solver does across constraints, and what a series in the step leaves out.

A point is a value. Other states or noise of the rows, forces that act otherwise between them, and causes in
the equations give another one. What these hardly change it shares with the one before, such as the tangent
where only forces between the rows are others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson

from deltac.arrays import Array
from deltac.diagnosis.causes.causes import Candidate, alike, bends, candidates, candidates_at
from deltac.diagnosis.causes.columns import (
    Column,
    ColumnKernels,
    Elements,
    LogEquations,
    column_kernels,
)
from deltac.diagnosis.causes.geometry import geometry_columns
from deltac.diagnosis.inference.fields import (
    FIELDS,
    FIRST_ORDER,
    PRIOR,
    elementary_differentials,
    next_order,
    taken_by_projections,
)
from deltac.diagnosis.inference.flow import (
    Prediction,
    composed,
    predict,
    transitions,
    transported,
)
from deltac.diagnosis.inference.forces import (
    FORCES,
    HELD,
    InterpolatedForces,
    LoggedForce,
    impulse,
)
from deltac.diagnosis.inference.hypotheses import ACTIVE, Block, Fit, Posterior
from deltac.diagnosis.inference.integrators import (
    EXACT,
    INTEGRATORS,
    MOST_SPEEDS,
    Integrator,
    Map,
    maps,
    transition,
)
from deltac.diagnosis.inference.model import Intervals, LogModel, Rows
from deltac.diagnosis.inference.observations import LONG_STRETCHES, Observations
from deltac.diagnosis.inference.whitening import left_by
from deltac.diagnosis.measurements.kinematics import trusted
from deltac.diagnosis.residuals.at_samples import STIFFEST
from deltac.errors import InputError
from deltac.trajectories import Trajectory

SHARES = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Shares of what forces may have done between the rows of a thinned log that are compared by likelihood."""

ACROSS = 1e3
"""How much more than the prediction errors a solver may do across the constraints: nothing is told by
these."""

RELINEARISATIONS = 3
"""Times at most that a log is linearised anew: by forces that are likelier between the rows, and with causes
in the equations (Gauss–Newton)."""

LOST = 0.3
"""Share of the intervals that may be lost where the model has no finite motion."""

COLUMNS_OF_THE_LOG = ("delay", "law", "offset")
"""Columns of causes that leave the equations as they are."""


class FlowError(ArithmeticError):
    """The equations of motion have no finite solution from some rows of a log on."""


NO_MOTION = (FlowError, np.linalg.LinAlgError)
"""Errors of a log between whose rows the equations have no finite motion."""


@dataclass(frozen=True, eq=False)
class Flow:
    """How each row follows from the one before: by the exact flow, and by the maps of methods.

    plant      the model, perhaps with causes in its equations
    intervals  between the rows, or between the states at these
    forces     logged ones between them
    noise      standard deviations (N, 2n) of the rows at the ends: the flow is more exact than that
    counts     steps (N,) of the integrator in each interval; None where these are not whole
    steps      of the flow in each interval; 0: as many as it needs
    methods    whose maps are compared; all where empty
    """

    plant: LogModel
    intervals: Intervals
    forces: InterpolatedForces
    noise: Array
    counts: NDArray[np.intp] | None
    steps: int = 0
    methods: tuple[Integrator, ...] = ()

    @cached_property
    def prediction(self) -> Prediction:
        """The exact flow of the plant."""
        forces = self.forces
        return predict(
            self.plant, self.intervals, forces.between, self.noise, self.steps, forces.parts
        )

    @property
    def nodes(self) -> tuple[Rows, ...]:
        """States at equal fractions of each interval."""
        return self.prediction.nodes

    @property
    def end(self) -> Rows:
        """The predictions of the next rows."""
        return self.prediction.end

    @cached_property
    def w(self) -> Array:
        """What the next rows, or the states at these, are beyond the predictions (N, 2n)."""
        return self.plant.difference(self.end, self.intervals.end)

    @cached_property
    def maps(self) -> list[Map]:
        """Maps of methods by which the rows may follow from each other; the last is that of the flow."""
        force, put_back = self.forces.between, self.projected
        own = maps(
            self.plant, self.intervals, force, self.counts, 1, self.methods, projected=put_back
        )
        return [*own, self.exact]

    @cached_property
    def projected(self) -> Callable[[Rows], Iterator[Rows]] | None:
        """What puts ends of intervals where the flow keeps the constraints; None if there are none."""
        return self.plant.projections(self.end, self.noise) if self.plant.rows_of_G else None

    @property
    def exact(self) -> Map:
        """The flow itself as the map of a method."""
        return Map(EXACT, np.ones(len(self.intervals), dtype=np.intp), self.end)

    def at(self, log: Observations, **changes: Any) -> Flow:
        """The flow between the states of a log, in as many steps; of another plant, or by other forces."""
        return replace(
            self,
            intervals=log.intervals,
            noise=log.noise[1],
            counts=log.counts,
            steps=self.steps or len(self.nodes) - 1,
            **changes,
        )

    def transition(self, of: Map) -> Array | None:
        """Derivatives (N, 2n, 2n) of one of the maps, taken once; None where they are not told."""
        if of not in self._transitions:
            self._transitions[of] = transition(self.plant, of, self.intervals, self.forces.between)
        return self._transitions[of]

    @cached_property
    def _transitions(self) -> dict[Map, Array | None]:
        return {}

    @cached_property
    def force_responses(self) -> Array:
        """What a unit of each logged force adds to the accelerations at the rows (m, N, n)."""
        at, first = self.intervals.start, self.forces.logged.first
        here = self.plant.acceleration(at.t, at.q, at.u, first)
        responses = np.empty((first.shape[1], *here.shape))
        for k in range(len(responses)):
            d = 1e-3 * (1.0 + np.abs(first[:, k]).max())
            F = first + d * (np.arange(len(responses)) == k)
            responses[k] = (self.plant.acceleration(at.t, at.q, at.u, F) - here) / d
        return responses

    def moved_by_forces(self, change: Array) -> Array:
        """What other forces between the rows, by changes (5, N, m), move the ends by (N, 2n)."""
        return impulse(self.force_responses, change[:, :, :, None], self.intervals.h)[:, :, 0]


@dataclass(frozen=True, eq=False)
class Tangent:
    """What small errors and the fields of an integrator do along a flow.

    flow, log    the flow, and the log whose pieces it joins
    J            ∂f/∂x (N, 2n, 2n) at each node
    transitions  Φ (N, 2n, 2n) from each node to the next
    """

    flow: Flow
    log: Observations
    J: list[Array]
    transitions: list[Array]

    @staticmethod
    def of(flow: Flow, log: Observations) -> Tangent:
        """The tangent at the nodes of a flow."""
        ends = flow.end.take(_last(log.pieces))
        own = [flow.plant.jacobian(at) for at in flow.nodes[:-1]]
        J = _at_nodes(log.pieces, own, flow.plant.jacobian(ends))
        return Tangent(flow, log, J, transitions(log.intervals.h, J))

    @property
    def h(self) -> Array:
        """Lengths (N, 1) of the intervals, s."""
        return self.log.intervals.h

    @cached_property
    def fields(self) -> list[Array]:
        """The integrator's (N, 2n, fields) at each node, times their powers of the step."""
        plant, pieces, step = self.flow.plant, self.log.pieces, self.log.steps
        fields = list[Array]()
        for at, J in zip(self.flow.nodes[:-1], self.J, strict=False):
            own = elementary_differentials(plant, at, step)
            further = [next_order(J[a:b], own[a:b], at.t[a:b], step[a:b]) for a, b in pieces]
            taken = [taken_by_projections(plant, at, own)] if plant.rows_of_G else []
            fields.append(np.concatenate([own, np.concatenate(further), *taken], axis=2))
        last = _last(pieces)
        own = elementary_differentials(plant, self.flow.end.take(last), step[last])
        end = np.concatenate([own, fields[0][last][:, :, own.shape[2] :]], axis=2)
        return _at_nodes(pieces, fields, end)

    @cached_property
    def Phi(self) -> Array:
        """Φ (N, 2n, 2n) over whole intervals."""
        return composed(self.transitions)

    @cached_property
    def rates(self) -> Array:
        """About the spectral radii (N, 1) of ∂f/∂x at the starts of the intervals, 1/s."""
        J2 = self.J[0] @ self.J[0]
        return np.asarray(np.linalg.norm(J2 @ J2, axis=(1, 2))[:, None] ** 0.25)

    def transported(self, columns: list[Array]) -> Array:
        """What columns of ẋ, or of accelerations, at the nodes add to the intervals' ends (N, 2n, p)."""
        return transported(self.h, self.transitions, columns)

    @cached_property
    def effects(self) -> Array:
        """What the fields add to the ends of the intervals (N, 2n, fields).

        Where steps are longer than what the motion forgets in, their series has no limit. No step is further
        off than the rates of the states go in it.
        """
        effects, plant = self.transported(self.fields), self.flow.plant
        stiff = np.flatnonzero((self.rates * self.h)[:, 0] > 1.0)
        if len(stiff):
            nodes = [at.take(stiff) for at in self.flow.nodes]
            rates = [np.abs(np.concatenate([at.u, plant.at(at)], axis=1)) for at in nodes]
            most = (self.h[stiff] * np.max(rates, axis=0))[:, :, None]
            effects[stiff] = np.clip(effects[stiff], -most, most)
        return effects

    @property
    def count(self) -> int:
        """Fields of the integrator."""
        return int(self.fields[0].shape[2])

    @property
    def prior(self) -> Array:
        """Standard deviations of the numbers of the fields before the log is seen."""
        taken = [1] * FIRST_ORDER if self.flow.plant.rows_of_G else []
        orders = [f.order for f in FIELDS]
        orders += [3] * (self.count - len(orders) - len(taken)) + taken
        return np.array([PRIOR[order] for order in orders])

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Intervals (N,) in which all of this is finite."""
        each = [np.isfinite(x).reshape(len(x), -1).all(axis=1) for x in (*self.J, *self.fields)]
        return np.asarray(np.all(each, axis=0))


# --- causes ---


@dataclass(frozen=True, eq=False)
class Built:
    """Causes of the geometry that are built into a model, with a column each of what is not linear in them.

    With θ built, the equations at s θ are those at θ with (s − 1) G θ + (s − 1)² b, which is exact at s = 0,
    the model without the cause.

    causes, theta  as of the model itself
    model          built anew with all of them, `others` with all but each
    kernels        of the columns of causes there
    candidates     all causes there, which count from the model itself
    coefficients   of the columns (P,) of these causes
    """

    causes: tuple[Candidate, ...]
    theta: tuple[Array, ...]
    model: LogModel
    others: tuple[LogModel, ...]
    kernels: tuple[ColumnKernels, ...]
    candidates: tuple[Candidate, ...]
    coefficients: Array

    @staticmethod
    def of(
        model: LogModel,
        run: Trajectory,
        own: Sequence[Candidate],
        causes: Sequence[Candidate],
        theta: Sequence[Array],
        some: Elements = None,
    ) -> Built:
        """Causes, of all its `own`, built into a model; with the columns there of some elements only.

        Raises:
            FlowError: there is no such mechanism.
        """

        def built(some: Sequence[int]) -> LogModel:
            mechanism = model.mechanism
            if not some:
                return model
            for k in some:
                edit = causes[k].edit
                assert edit is not None
                mechanism = edit.mechanism(mechanism, theta[k])
            return model.of_mechanism(mechanism, run)

        every = range(len(causes))
        try:
            whole = built(every)
            others = tuple(built([j for j in every if j != k]) for k in every)
        except InputError as error:
            raise FlowError(str(error)) from None
        equations = LogEquations(whole.mechanism, run)
        kernels = column_kernels(equations, some), geometry_columns(equations, some)
        columns = kernels[0].columns + kernels[1].columns + bends(len(causes))
        every_cause = candidates_at(equations, columns, own, causes, theta)
        coefficients = np.zeros(len(columns))
        for c, x in zip(alike(every_cause, causes), theta, strict=True):
            if c is None:
                raise FlowError("a cause does nothing where it is built")
            np.add.at(coefficients, list(c.columns), c.coefficients(x))
        return Built(tuple(causes), tuple(theta), whole, others, kernels, every_cause, coefficients)

    def responses(self, at: Rows, of_columns: Array) -> Array:
        """The columns b (N, n, causes), by those of the kernels (N, n, P) there."""
        here, result = self.model.at(at), list[Array]()
        for c, x, other in zip(
            alike(self.candidates, self.causes), self.theta, self.others, strict=True
        ):
            assert c is not None
            some = [k for k in c.columns if k < of_columns.shape[2]]
            along = of_columns[:, :, some] @ (c.linear[: len(some)] @ x)
            result.append(other.at(at) - here + along)
        return np.stack(result, axis=2)


def cause_columns(
    flow: Flow,
    log: Observations,
    kernels: Sequence[ColumnKernels],
    built: Built | None,
    beyond: Array | None = None,
) -> list[Array]:
    """What a unit of each cause adds to the accelerations, M⁻¹x_j (N, n, P), at the nodes of a flow.

    `beyond` (N, n) is added to the accelerations of the flow, at which the columns are evaluated.
    """
    intervals, pieces, plant = log.intervals, log.pieces, flow.plant
    rate = (intervals.end.F - intervals.start.F) / intervals.h
    curve = np.zeros_like(rate)
    for a, b in pieces:
        if b - a > 2:
            curve[a:b] = np.gradient(rate[a:b], intervals.start.t[a:b], axis=0)

    beyond = np.zeros((len(log.intervals), 1)) if beyond is None else beyond

    def columns(at: Rows, rate: Array, curve: Array, beyond: Array) -> Array:
        return cause_responses(plant, kernels, built, at, plant.every(at) + beyond, rate, curve)

    last = _last(pieces)
    own = [columns(at, rate, curve, beyond) for at in flow.nodes[:-1]]
    if not flow.forces.continuous:  # the next interval starts with other accelerations
        return [*own, columns(flow.end, rate, curve, beyond)]
    end = columns(flow.end.take(last), rate[last], curve[last], beyond[last])
    return _at_nodes(pieces, own, end)


def cause_responses(
    model: LogModel,
    kernels: Sequence[ColumnKernels],
    built: Built | None,
    at: Rows,
    a: Array,
    rate: Array,
    curve: Array,
) -> Array:
    """What a unit of each cause adds to the accelerations (N, n, P), by force or by geometry.

    `a` are those of all free speeds, `rate` and `curve` derivatives of the logged forces.
    """
    if not kernels:
        return np.zeros((len(a), model.n, 0))
    full = model.completed(at)
    samples = (full.t, full.q, full.u, a, full.F, rate, curve)
    forces, *geometry = (columns(*samples)[:, :, 1:] for columns in kernels)
    parts = [model.response(at.t, at.q, forces)]
    parts += [model.of_geometry(at.t, at.q, x) for x in geometry]
    columns = np.concatenate(parts, axis=2)
    return columns if built is None else np.append(columns, built.responses(at, columns), axis=2)


def _last(pieces: Sequence[tuple[int, int]]) -> NDArray[np.intp]:
    """The last intervals of the pieces."""
    return np.array([b - 1 for _, b in pieces], dtype=np.intp)


def _at_nodes(pieces: Sequence[tuple[int, int]], columns: list[Array], last: Array) -> list[Array]:
    """Columns at all nodes: those at the end of an interval are those of the next one's start."""
    shifted = np.empty_like(columns[0])
    for (a, b), end in zip(pieces, last, strict=True):
        shifted[a : b - 1], shifted[b - 1] = columns[0][a + 1 : b], end
    return [*columns, shifted]


# --- what the flow does not know ---


@dataclass(frozen=True, eq=False)
class ProcessNoise:
    """Covariances (N, 2n, 2n) of what the flow adds to prediction errors that it does not know.

    flow     its own error, with digits of forces, and what these did in intervals of which steps are lost
    forces   noise of logged ones, and what erratic ones did in such intervals
    doubt    what forces that are smooth do otherwise than a spline
    across   what a solver does to keep constraints
    beyond   standard deviations (N, 2n) of what the series in the step leaves out
    share    of the standard deviations of noise of forces that is likely, and is in `forces`
    """

    flow: Array
    forces: Array
    doubt: Array
    across: Array
    beyond: Array
    share: float

    @property
    def own(self) -> Array:
        """Of the flow by the forces that were logged."""
        return self.flow + self.forces

    @cached_property
    def total(self) -> Array:
        """All of it."""
        diagonal, total = np.arange(self.beyond.shape[1]), self.own + self.doubt + self.across
        total[:, diagonal, diagonal] += self.beyond**2
        return total

    def with_shares(self, forces: float = 1.0, beyond: float = 1.0) -> ProcessNoise:
        """The same with shares of the noise of forces, and of what the series leaves out."""
        return replace(
            self,
            forces=forces**2 * self.forces,
            beyond=beyond * self.beyond,
            share=forces * self.share,
        )


def process_noise(
    log: Observations, flow: Flow, tangent: Tangent, lost: NDArray[np.bool_]
) -> ProcessNoise:
    """The process noise: what may be on forces, and what they may do between the rows, by likelihood.

    In intervals in which they are `lost` (N,), the latter is anything.
    """
    Q, white, between, across = _unknown(log, flow, lost)
    beyond, Phi = _beyond_series(tangent, log.steps), tangent.Phi

    def likeliest(part: Array, others: Array) -> float:
        """The share of a part that is likely."""
        if not part.any():
            return 0.0
        w = log.errors(flow.plant, flow.end, Phi)
        share, likelihood = 0.0, -np.inf
        for x in SHARES:  # it has one maximum
            now = likelihood_of(log, Phi, x**2 * part + others, w, tangent.effects)
            if now <= likelihood:
                break
            share, likelihood = x, now
        return share

    share = likeliest(white, Q + between + across)
    white = share**2 * white
    between = likeliest(between, Q + white + across) ** 2 * between
    # What is left tells how large the own is; splines of forces have a doubt of their own.
    in_lost = lost[:, None, None]
    own, doubt = Q + np.where(in_lost, between, 0.0), np.where(in_lost, 0.0, between)
    return ProcessNoise(own, white, doubt, across, beyond, share)


def likelihood_of(
    log: Observations, Phi: Array, Q: Array, w: Array, fields: Array, causes: Array | None = None
) -> float:
    """Log likelihood of process noise Q by prediction errors w (N, 2n), beside columns (N, 2n, p).

    Fields of an integrator are nearly alike: what they leave of all else is found without a Gram matrix.
    """
    others = [w[:, :, None]] if causes is None else [w[:, :, None], causes]
    white, spread = log.innovations(Phi, Q)(np.concatenate([fields, *others], axis=2))
    D, rest = np.split(white.reshape(-1, white.shape[2]), [fields.shape[2]], axis=1)
    rest = rest - D @ np.linalg.lstsq(D, rest, rcond=1e-12)[0]
    r = rest[:, 0] if causes is None else left_by(rest[:, 1:], rest[:, 0])
    return float(-spread - 0.5 * r.size * np.log(float(r @ r) / r.size + 1e-300))


def _unknown(
    log: Observations, flow: Flow, lost: NDArray[np.bool_]
) -> tuple[Array, Array, Array, Array]:
    """Covariances (N, 2n, 2n): the flow's own error, noise of forces, forces between rows, constraints.

    Its own error, with digits of logged forces; across constraints, what a solver does to keep them. In
    intervals of which a step is `lost` a force may have taken any way from one row to the next: by its
    change, uniformly, or at random where it is erratic. In others, one that is smooth may differ from its
    spline, and one that is held may change at any instant.
    """
    model, h, at = flow.plant, log.intervals.h, flow.nodes[0]
    n, force, kinds = model.n, flow.forces.logged, flow.forces.kinds
    Q = np.zeros((len(h), 2 * n, 2 * n))
    diagonal = np.arange(2 * n)
    Q[:, diagonal, diagonal] = flow.prediction.error**2
    digits, noise = log.of_forces
    coarse = np.any(digits > 1e-12 * np.abs(at.F).max(axis=0, initial=1e-300), axis=0)
    smooth = np.array([FORCES[kind][2] > 0.0 for kind in kinds], dtype=bool)
    doubt, ends = (np.where(smooth, x, 0.0) for x in (force.doubt, force.ends))
    ends = np.where(flow.forces.switching, np.abs(force.change) / np.sqrt(12.0), ends)
    some = coarse.any() or noise.any() or lost.any() or doubt.any() or ends.any()
    own, white, moves = list[Array](), list[Array](), list[Array]()
    for k, response in enumerate(flow.force_responses if some else []):
        for columns, size in ((own, digits), (white, noise)):
            du = response * h * size[:, k : k + 1]
            columns.append(np.concatenate([0.5 * h * du, du], axis=1))
        bends = np.abs(force.bends[0][:, k]) + np.abs(force.bends[1][:, k])
        anything = np.hypot(force.change[:, k] / np.sqrt(12.0), bends / 6.0)
        course, random = np.where(lost, anything, doubt[:, k]), np.zeros_like(anything)
        if force.erratic[k]:  # the mean of many values, in place of that of two
            random = 0.5 * np.sqrt(np.mean(force.change[:, k] ** 2)) * lost
            course = np.where(lost, 0.0, course)
        for columns, size in ((own, ends[:, k]), (moves, course), (white, random)):
            if size.any():
                du = response * (h[:, 0] * size)[:, None]
                columns.append(np.concatenate([0.5 * h * du, du], axis=1))
                columns.append(np.concatenate([h * du / np.sqrt(12.0), np.zeros_like(du)], axis=1))
    Q, of_noise, between = Q + _outer(own, Q), _outer(white, Q), _outer(moves, Q)
    across = np.zeros_like(Q)
    if model.rows_of_G:
        end = flow.end  # where solvers project
        directions, _ = np.linalg.qr(model.impulses(end.t, end.q))
        size = (
            ACROSS * np.sqrt(np.mean(flow.w**2, axis=0) + np.mean(log.noise[0] ** 2, axis=0)).max()
        )
        across[:, :n, :n] = across[:, n:, n:] = size**2 * directions @ directions.transpose(0, 2, 1)
    return Q, of_noise, between, across


def _outer(columns: Sequence[Array], like: Array) -> Array:
    """Σ x xᵀ (N, 2n, 2n) of columns x (N, 2n)."""
    if not columns:
        return np.zeros_like(like)
    X = np.stack(columns, axis=2)
    return np.asarray(X @ X.transpose(0, 2, 1))


def _beyond_series(tangent: Tangent, step: Array) -> Array:
    """Standard deviations (N, 2n) of what the series in the step leaves out, interval by interval.

    Along a field of first order terms beyond third order are to it as those of e^ρ − 1 are to ρ, ρ the step
    times the spectral radius of ∂f/∂x, and at most as large: an onset of friction or contact tells little.
    """
    rho, first = np.minimum(step * tangent.rates, STIFFEST), tangent.fields[0][:, :, :FIRST_ORDER]
    beyond = sum(rho**k / factorial(k + 1) for k in range(3, 12))
    return np.asarray(np.minimum(beyond, 1.0) * tangent.h * np.abs(first).max(axis=2))


# --- all of it ---


@dataclass(frozen=True, eq=False)
class Point:
    """A log linearised about the flow of a model between its rows.

    model         as it is given; `flow.plant` has causes in its equations
    run           the log, of which `log` has some stretches
    energy        that the run exchanges, J
    tangent       perhaps at a flow by other forces between the rows
    noise         what the flow does not know
    own           kernels of the columns of causes, and the causes themselves, of the model
    built         causes that are built into the model, if any: `kernels` and `candidates` are those there
    some          elements of which there are columns, if not of all
    columns       what a unit of each column adds to the accelerations (N, n, P), at the nodes
    coefficients  of the columns (P,) of causes that are in the plant, or in a filter of the forces
    accelerations equations by known accelerations and their posterior, if these were compared
    states        methods that close coordinates alone alike, each with the log at its own states
    siblings      methods that may do so beside causes
    """

    model: LogModel
    run: Trajectory
    energy: float
    log: Observations
    flow: Flow
    tangent: Tangent
    noise: ProcessNoise
    columns: list[Array]
    coefficients: Array
    own: tuple[tuple[ColumnKernels, ...], tuple[Candidate, ...]] = ((), ())
    built: Built | None = None
    some: Elements = None
    accelerations: tuple[Block, Posterior] | None = None
    states: tuple[tuple[Map, Observations], ...] = ()
    siblings: tuple[Integrator, ...] = ()

    # --- what it consists of ---

    @property
    def forces(self) -> InterpolatedForces:
        """Logged forces between the rows."""
        return self.flow.forces

    @cached_property
    def nominal(self) -> Flow:
        """The flow of the model without causes."""
        plain = self.flow.plant is self.model
        return self.flow if plain else replace(self.flow, plant=self.model)

    @cached_property
    def as_logged(self) -> Prediction:
        """The same by forces as they were logged, whatever filtered them."""
        unfiltered = self.forces.unfiltered
        flow = self.nominal if unfiltered is None else replace(self.nominal, forces=unfiltered)
        return flow.prediction

    @cached_property
    def work_of_causes(self) -> tuple[Array, Array]:
        """Work of the causes that are in the plant, ∫∂E/∂u·δu̇ dt along its flow (N,), and its error, J.

        What a step ends beyond the model's is squared in an energy, its power is not. By Simpson's rule at as
        many nodes and at twice as many, extrapolated.
        """
        model, plant, h = self.model, self.flow.plant, self.log.intervals.h[:, 0]
        if plant is model:
            return np.zeros(len(h)), np.zeros(len(h))

        def by(nodes: Sequence[Rows]) -> Array:
            power = [
                np.sum(model.energy_gradient(x)[:, model.n :] * (plant.at(x) - model.at(x)), axis=1)
                for x in nodes
            ]
            return np.asarray(h * simpson(power, dx=1.0 / (len(nodes) - 1), axis=0))

        coarse = by(self.flow.nodes)
        fine = by(replace(self.flow, steps=2 * (len(self.flow.nodes) - 1)).nodes)
        return fine + (fine - coarse) / 15.0, (fine - coarse) / 15.0

    @cached_property
    def w(self) -> Array:
        """Prediction errors of the model itself, by forces as they were logged (N, 2n)."""
        return self.model.difference(self.as_logged.end, self.log.intervals.end)

    @cached_property
    def maps(self) -> list[Map]:
        """Those of the flow; where there are causes, methods with a parameter have it beside these."""
        flow = self.flow
        if not len(self.coefficients) or self.model.n > MOST_SPEEDS:
            return flow.maps
        fitted = [method for method in flow.methods or INTEGRATORS if method.memory is not None]
        if not fitted:
            return flow.maps
        causes = 0.5 * (self.columns[0] + self.columns[-1])
        force, counts = flow.forces.between, flow.counts
        anew = maps(flow.plant, flow.intervals, force, counts, 1, fitted, causes)
        return [*anew, *(of for of in flow.maps if of.method.memory is None)]

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Intervals (N,) in which forces did what no row tells."""
        # The kernel is not that of the filter: what it lacks is unknown.
        return self.log.thinned | (self.forces.filter is not None)

    @property
    def forces_known(self) -> bool:
        """Whether the log tells what its forces do between the rows, or has none."""
        held = all(kind in HELD for kind in self.forces.declared)
        return held or bool(self.log.intervals.stages)

    @property
    def accelerations_known(self) -> bool:
        """Whether the log has accelerations of its own that belong to its rows."""
        run, free = self.run, self.model.mechanism.free.u
        derived = "udot" in run.provenance.derived or self.model.n < len(free)
        return trusted(run) and run.udot is not None and not derived

    @property
    def kernels(self) -> tuple[ColumnKernels, ...]:
        """Of the columns of causes."""
        return self.own[0] if self.built is None else self.built.kernels

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All causes."""
        return self.own[1] if self.built is None else self.built.candidates

    @property
    def base(self) -> LogModel:
        """The model, with causes that are built into it."""
        return self.model if self.built is None else self.built.model

    @cached_property
    def whats(self) -> tuple[Column, ...]:
        """What the columns of causes are of."""
        more = () if self.built is None else bends(len(self.built.causes))
        return (*(column for kernels in self.kernels for column in kernels.columns), *more)

    @property
    def of_equations(self) -> NDArray[np.bool_]:
        """Columns (P,) that are of the equations, not of the log."""
        return np.array([c.what not in COLUMNS_OF_THE_LOG for c in self.whats], dtype=np.bool_)

    def errors(self, end: Rows, Phi: Array, log: Observations | None = None) -> Array:
        """Prediction errors (N, 2n), of the flow or of a method's map with its derivatives."""
        return (log or self.log).errors(self.model, end, Phi)

    # --- others ---

    def among(self, methods: tuple[Integrator, ...]) -> Point:
        """The same where the rows are of one of some methods."""
        flow = replace(self.flow, methods=tuple(dict.fromkeys((*methods, *self.siblings))))
        flow.__dict__.update(prediction=self.flow.prediction)
        return replace(self, flow=flow)

    def with_flow(self, **changes: Any) -> Point:
        """The same with the flow between the states of the log, of another plant or by other forces."""
        return replace(self, flow=self.flow.at(self.log, **changes))

    def with_noise_of_rows(self) -> Point:
        """With the noise of the rows that the flow shows: what it knows better was no noise."""
        w = self.errors(self.flow.end, self.tangent.Phi)
        quiet = np.flatnonzero(~self.forces.switching.any(axis=1))
        if 0 < len(quiet) < len(w):  # in the others it is that of the nearest
            w = w[quiet[np.searchsorted(quiet, np.arange(len(w))).clip(max=len(quiet) - 1)]]
        return replace(self, log=self.log.with_noise(w))

    def with_process_noise(self) -> Point:
        """With what the flow does not know, as its prediction errors tell."""
        noise = process_noise(self.log, self.flow, self.tangent, self.lost)
        return replace(self, noise=noise)

    def with_columns(self) -> Point:
        """With the columns of causes at the flow."""
        columns = cause_columns(self.flow, self.log, self.kernels, self.built)
        return replace(self, columns=columns)

    def with_measured_columns(self) -> Point:
        """With the columns of causes evaluated at the accelerations of the log, Δu/h.

        The equations are then linear in inertia, however large its error. Noise and filters enter as well.
        """
        beyond = self.flow.w[:, self.model.n :] / self.log.intervals.h
        columns = cause_columns(self.flow, self.log, self.kernels, self.built, beyond)
        return replace(self, columns=columns)

    def with_tangent(self) -> Point:
        """With the tangent at the flow."""
        return replace(self, tangent=Tangent.of(self.flow, self.log))

    def filtered(self, delay: float, spread: float) -> Point:
        """The same by forces that went through a filter as late and as wide as that, s."""
        forces, intervals = self.forces.filtered(self.log.intervals, self.log.pieces, delay, spread)
        moved = replace(self, log=replace(self.log, intervals=intervals)).with_flow(forces=forces)
        return replace(moved, coefficients=moved._of_filter(self.coefficients))

    def with_causes(self, fit: Fit, methods: tuple[Integrator, ...] = ()) -> Point:
        """Linearised at the model with the causes of a fit in it: those of the geometry are built.

        Raises:
            FlowError: it has no finite motion between the rows.
        """
        each = list(zip(fit.chosen, fit.theta, strict=True))
        # Those of the geometry count from the model itself, wherever they were found.
        found = alike(self.own[1], fit.chosen)
        pairs = [(c, x) for c, (_, x) in zip(found, each, strict=True) if c is not None and c.edit]
        base = replace(self, built=None)
        if pairs:
            causes, theta = zip(*pairs, strict=True)
            built = Built.of(self.model, self.run, self.own[1], causes, theta, self.some)
            base = replace(self, built=built, accelerations=None)
        elif self.built is not None:
            base = replace(base, accelerations=None)
        own = np.zeros(len(base.whats))
        for k, c in enumerate(alike(base.candidates, fit.chosen)):
            if c is not None and c.edit is None:
                factor = fit.factors[k] if fit.factors else 1.0
                np.add.at(own, list(c.columns), factor * c.coefficients(fit.theta[k]))
        own = np.where(base.of_equations, own, 0.0)
        plant = base.base.changed(base.kernels, own)
        coefficients = own if base.built is None else own + base.built.coefficients
        moved = replace(base, coefficients=base._of_filter(coefficients))
        methods = methods or self.flow.methods
        moved = moved.with_flow(plant=plant, methods=methods).with_tangent()
        if not (np.isfinite(moved.flow.w).all() and moved.tangent.finite.all()):
            raise FlowError("the flow of the model with the causes found leaves all bounds")
        return moved.with_columns()

    def sampled(self, count: int) -> Point:
        """The same at some stretches of so many intervals in all; itself where there are no more."""
        N, log, of = len(self.log.intervals), self.log, self.forces
        if count >= N:
            return self
        size = count // LONG_STRETCHES
        starts = np.linspace(0, N - size, LONG_STRETCHES).astype(np.intp)
        some = np.unique(np.add.outer(starts, np.arange(size)))
        log = log.without(~np.isin(np.arange(N), some))
        logged = LoggedForce.of(log.intervals, log.pieces, of.logged.counts[some])
        moved = replace(self, log=log, accelerations=None, states=())
        moved = moved.with_flow(forces=replace(of, logged=logged)).with_tangent()
        return moved.with_process_noise().with_columns()

    def narrowed(self, found: Posterior) -> Point:
        """The same with the columns of some causes only: those that are built anew are compared by these."""
        of = self.whats
        causes = [c for fit in (found.best, *found.alternatives) for c in fit.chosen]
        own = alike(self.own[1], [*causes, *(c for _, c, _ in found.scores)])
        acting = np.flatnonzero(self.coefficients)
        some = {of[k].of for c in own if c is not None for k in c.columns}
        some |= {of[k].of for k in acting}
        places = {k: i for i, k in enumerate(k for k, c in enumerate(of) if c.of in some)}
        return replace(
            self,
            own=(
                tuple(kernels.only(some) for kernels in self.own[0]),
                tuple(
                    replace(c, columns=tuple(places[k] for k in c.columns))
                    for c in self.own[1]
                    if places.keys() >= set(c.columns)
                ),
            ),
            some=some,
            columns=[x[:, :, list(places)] for x in self.columns],
            coefficients=self.coefficients[list(places)],
            accelerations=None,
        )

    def named(self, before: Posterior) -> Posterior:
        """Causes that were found at another point, as they are called at this one."""

        def there(fit: Fit) -> Fit:
            same = alike(self.candidates, fit.chosen)
            known = [(c, x) for c, x in zip(same, fit.theta, strict=True) if c is not None]
            chosen, theta = tuple(c for c, _ in known), tuple(x for _, x in known)
            P, d = len(self.coefficients), sum(c.size for c in chosen)
            return Fit(
                chosen, theta, np.zeros(P), 0.0, np.zeros((d, d)), np.zeros((P, d)), factors=()
            )

        likely = alike(self.candidates, [c for _, c, _ in before.scores])
        scores = [
            (odds, c, joules)
            for c, (odds, _, joules) in zip(likely, before.scores, strict=True)
            if c is not None
        ]
        others = tuple(map(there, before.alternatives))
        return Posterior(there(before.best), others, tuple(scores))

    def with_candidates(self, equations: LogEquations, kernels: ColumnKernels) -> Point:
        """With further columns, and the causes that they allow.

        All is compared anew, from the model itself and the noise that its flow shows, by forces as they act.
        """
        moved = self
        if self.flow.plant is not self.model:
            moved = moved.with_flow(plant=self.model).with_tangent()
        log = moved.with_noise_of_rows().log
        start, end = (
            np.where(log.unknown, now, anew)
            for now, anew in zip(self.log.noise, log.noise, strict=True)
        )
        moved = replace(moved, log=replace(log, noise=(start, end)))
        every = (*self.own[0], kernels)
        columns = tuple(column for one in every for column in one.columns)
        moved = replace(moved, own=(every, candidates(equations, columns)), built=None)
        return replace(moved, coefficients=moved._of_filter(np.zeros(len(columns))))

    def _of_filter(self, coefficients: Array) -> Array:
        """Coefficients with those of the delays that the forces were filtered by."""
        delay, spread = self.forces.filter or (0.0, 0.0)
        numbers = (delay, delay**2 + spread**2)
        own = [numbers[c.index] if c.what == "delay" else None for c in self.whats]
        return np.array([c if x is None else x for c, x in zip(coefficients, own, strict=True)])


def flow_of(model: LogModel, run: Trajectory, log: Observations) -> Flow:
    """The flow of a model between the rows of a log, by forces as these say."""
    intervals = log.intervals
    logged = LoggedForce.of(intervals, log.pieces, log.counts)
    # Forces that were held over each of several steps between rows are not those of the rows.
    several = bool(logged.counts.max() > 1)
    held = set() if several else set(map(str, run.provenance.held or ()))
    other = "smooth" if run.provenance.held == () else ""  # all are functions of time
    names = [str(n) for n, at in model.log.columns.items() for _ in range(at.start, at.stop)]
    declared = tuple("start" if name in held else other for name in names)
    kinds = tuple(kind or "smooth" for kind in declared)
    forces = InterpolatedForces(logged, kinds, declared)
    return Flow(model, intervals, forces, log.noise[1], log.counts)


def start(model: LogModel, run: Trajectory, log: Observations, energy: float = 0.0) -> Point:
    """The point at the rows of a log and the model itself, without columns of causes.

    Intervals in which the flow leaves all bounds, as in singular positions, are left out.

    Raises:
        FlowError: these are too many.
    """
    flow = flow_of(model, run, log)
    tangent = Tangent.of(flow, log)
    lost = ~(np.isfinite(flow.w).all(axis=1) & tangent.finite)
    if any(event.impulsive for event in model.mechanism.events) and not run.events:
        lost |= _jumps(flow.w)
    if lost.any():
        if lost.mean() > LOST:
            raise FlowError("the flow of the model leaves all bounds between many rows")
        log = log.without(lost)
        logged = LoggedForce.of(log.intervals, log.pieces, log.counts)
        flow = flow.at(log, forces=replace(flow.forces, logged=logged))
        tangent = Tangent.of(flow, log)
    log = log.with_noise(flow.w)
    noise = process_noise(log, flow, tangent, log.thinned)
    return Point(model, run, energy, log, flow, tangent, noise, [], np.zeros(0))


def _jumps(w: Array) -> NDArray[np.bool_]:
    """Intervals (N,) in which a state jumps by far more than in most, as in impacts that a log leaves out."""
    size = np.mean((w / (np.median(np.abs(w), axis=0) + 1e-300)) ** 2, axis=1)
    return np.asarray(size > ACTIVE * np.median(size))
