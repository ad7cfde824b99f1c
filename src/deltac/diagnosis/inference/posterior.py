"""What a log says: the integrator's numbers, causes with their odds, and ΔC in joules of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson

from deltac.arrays import EPS, Array
from deltac.diagnosis.explain.causes import Candidate, candidates
from deltac.diagnosis.explain.columns import ColumnKernels, column_kernels
from deltac.diagnosis.explain.result import sentence
from deltac.diagnosis.inference.fields import FIELDS, PRIOR, elementary_differentials, next_order
from deltac.diagnosis.inference.flow import (
    FORCES,
    Intervals,
    LoggedForce,
    Predicted,
    difference,
    jacobians,
    predicted,
    transported,
)
from deltac.diagnosis.inference.innovations import (
    Innovations,
    innovations,
    likelihood,
    robust_weights,
)
from deltac.diagnosis.inference.odds import (
    CERTAIN,
    Block,
    Fit,
    Posterior,
    autocorrelation_time,
    fitted,
    search,
)
from deltac.diagnosis.measurements.digits import digits_of, white_noise
from deltac.diagnosis.measurements.kinematics import stretches, trusted
from deltac.diagnosis.residuals.at_samples import Evaluator
from deltac.diagnosis.residuals.rows import Model, Rows
from deltac.kernels.rows import Expression, compiled
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

WORK = 3e8
"""Instructions that the columns of causes may take, about: some tenths of a second."""

MOST_ROWS, LEAST_ROWS = 5000, 150

EXACT = 1e-10
"""Share of a column's size below which its noise has no memory worth keeping beyond `SHORT` rows."""

SHORT = 64


@dataclass(frozen=True, eq=False)
class Stretches:
    """Rows of a log in stretches of consecutive ones: free q, u and logged F.

    pieces       intervals (first, last + 1) of each stretch; `rows` the same of the log
    noise        standard deviations (N, 2n) of the rows at both ends of each interval
    digits       what of that comes from their digits
    force_noise  of the forces (N, m)
    """

    intervals: Intervals
    pieces: list[tuple[int, int]]
    rows: list[tuple[int, int]]
    noise: tuple[Array, Array]
    digits: tuple[Array, Array]
    force_noise: Array


def stretches_of(model: Model, run: Trajectory, most: int) -> Stretches | None:
    """Stretches of at most so many rows, evenly over the log."""
    free = model.mechanism.free
    edges = stretches(run)
    total = sum(b - a for a, b in edges)
    if total > most:
        edges = [(a, a + max(12, int(most * (b - a) / total))) for a, b in edges]
        while sum(b - a for a, b in edges) > 1.2 * most and len(edges) > 1:
            edges = edges[::2]
    if not edges:
        return None
    q, u = run.q[:, free.q], run.u[:, free.u]
    forces = list(model.log.values(run).values())
    F = np.concatenate([np.zeros((len(run), 0)), *forces], axis=1)
    digits = digits_of(run)

    def deviations(of: str) -> Array:
        size = np.abs(run.q if of == "q" else run.u).max(axis=0, initial=0.0)
        return np.asarray(np.sqrt(digits[of].half() ** 2 / 3.0 + (4.0 * EPS * (1.0 + size)) ** 2))

    sq, su = deviations("q")[:, free.q], deviations("u")[:, free.u]
    of_q = np.zeros_like(su)
    for i, j in model.rates:
        of_q[:, j] = sq[:, i]
    for i, j in model.quaternions:
        of_q[:, j : j + 3] = 2.0 * sq[:, i : i + 4].mean(axis=1, keepdims=True)
    noise = np.concatenate([of_q, su], axis=1)
    of_F = [
        np.sqrt(digits[f"force {n}"].half() ** 2 / 3.0 + digits[f"force {n}"].noise ** 2)
        for n in model.log.values(run)
    ]
    sF = np.concatenate([np.zeros((len(run), 0)), *of_F], axis=1)
    start = np.concatenate([np.arange(a, b - 1) for a, b in edges])
    pieces, at = [], 0
    for a, b in edges:
        pieces.append((at, at + b - a - 1))
        at += b - a - 1
    first, last = (
        Rows(run.t[start], q[start], u[start], F[start]),
        Rows(run.t[start + 1], q[start + 1], u[start + 1], F[start + 1]),
    )
    return Stretches(
        Intervals(first, last),
        pieces,
        edges,
        (noise[start], noise[start + 1]),
        (noise[start], noise[start + 1]),
        sF[start],
    )


@dataclass(frozen=True, eq=False)
class Share:
    """A part of ΔC, J: `energy` at the end with its standard `error`; `curve`s along the rows."""

    curve: Array
    curve_error: Array

    @property
    def energy(self) -> float:
        """At the end, J."""
        return float(self.curve[-1])

    @property
    def error(self) -> float:
        """Standard error at the end, J."""
        return float(self.curve_error[-1])


@dataclass(frozen=True, eq=False)
class Attribution:
    """ΔC in joules of the integrator, of mistakes in the equations, and of the log.

    Their sum is ΔC of the rows. `t` (T,) are the times of the curves.
    """

    t: Array
    integrator: Share
    equations: Share
    log: Share


@dataclass(frozen=True, eq=False)
class Effect:
    """A set of causes with their joules: the energy that each exchanges, and adds to ΔC."""

    fit: Fit
    exchanged: Array
    exchanged_error: Array
    energy: Array


@dataclass(frozen=True, eq=False)
class Inference:
    """What was inferred of a log.

    Attributes:
        model, log: the equations and the rows.
        forces: how each logged force acts between rows, see `flow.FORCES`.
        blocks: the whitened equations: prediction errors, and measured accelerations where these are known.
        posterior: causes with their odds.
        candidates: all causes that were compared.
        coefficients, covariance: the integrator's numbers c of `FIELDS`.
        attribution: ΔC in joules.
        tau: autocorrelation time of what is left, intervals.
        excess: variance of what is left, in units of what digits, noise and the flow's error explain.
        whole: time of the log over that of the intervals.
        step: of the integrator, s.
        hidden: energy (J) that a mistake of a single number may add to ΔC without being seen, and its name.
        intermittent: odds of a force that acts from time to time, and the intervals in which it does.
        share: of what forces may have done between thinned rows.
        residual: what is left, whitened (N, d).
        jumps: energy (N,) that the prediction errors exchange, J.
        columns: G (N, 2n, P) of all causes at the nodes of the flow.
        w, acceleration: prediction errors (N, 2n), and u̇ (N, n) of the model at the starts of the intervals.
        unknown: energy (J) that no integrator, no cause and no noise of the rows explains; negative if none.
        stiffness: largest h‖∂f/∂x‖ of each interval: where it is not small no series in h converges.
    """

    model: Model
    log: Stretches
    forces: tuple[str, ...]
    blocks: tuple[Block, ...]
    posterior: Posterior
    candidates: tuple[Candidate, ...]
    coefficients: Array
    covariance: Array
    attribution: Attribution
    tau: float
    excess: float
    whole: float
    step: float
    hidden: tuple[float, str]
    intermittent: tuple[float, Array]
    stiffness: Array
    effect: Callable[[Fit], Effect]
    share: float
    residual: Array
    unknown: float
    w: Array
    acceleration: Array
    columns: list[Array]
    jumps: Array

    @property
    def relative(self) -> tuple[float, float]:
        """Largest prediction error of a speed, as a share of its change; and what noise accounts for."""
        n, h = self.model.n, self.log.intervals.h
        change = (
            np.abs(self.acceleration)
            + np.abs(self.log.intervals.end.u - self.log.intervals.start.u) / h
        )
        size = np.sqrt(np.mean(change**2, axis=0)) + 1e-300
        error = np.sqrt(np.mean((self.w[:, n:] / h) ** 2, axis=0))
        noise = np.sqrt(np.mean((self.log.noise[1][:, n:] / h) ** 2, axis=0)) * np.sqrt(2.0)
        return float((error / size).max()), float((noise / size).max())

    def deviation(self, c: Candidate) -> float:
        """Standard error of the number of a cause of one, beside the best causes."""
        return _deviation(self.blocks, c, self.posterior.best, self.tau)


def infer(mechanism: Mechanism, run: Trajectory, energy: float = 0.0) -> Inference | None:
    """The inference for a run whose columns are in the mechanism's order; None for too few rows.

    `energy` is what the run exchanges (J): causes that exchange less than `NEGLIGIBLE` of it are not told.
    """
    if not len(mechanism.free.u):
        return None
    model = Model(mechanism, run)
    evaluator = Evaluator(mechanism, run)
    kernels = column_kernels(evaluator)
    log = stretches_of(model, run, int(np.clip(WORK / kernels.cost, LEAST_ROWS, MOST_ROWS)))
    if log is None or len(log.intervals) < 4:
        return None
    some = tuple(c for c in candidates(evaluator, kernels.columns) if c.kind != "late-rows")
    try:
        with np.errstate(all="ignore"):
            return _inferred(_Filter(model, run, log), kernels, some, run, energy)
    except (FlowError, np.linalg.LinAlgError):
        return None


def _inferred(
    filtered: _Filter,
    kernels: ColumnKernels,
    some: tuple[Candidate, ...],
    run: Trajectory,
    energy: float,
) -> Inference:
    kinds = filtered.kinds_of_forces()
    for _ in range(REVISIONS):
        made = _with_forces(filtered, kernels, some, run, kinds, energy)
        revised = filtered.kinds_of_forces(made.posterior.best, made)
        if revised == kinds:
            break
        kinds = revised
    if made.posterior.best.chosen and len(made.blocks) == 1:
        # Columns are linear in θ with the accelerations that the motion has, those of the causes included.
        for _ in range(RELINEARISATIONS):
            made = _with_forces(filtered, kernels, some, run, kinds, energy, made)
    return made


UNEXPLAINED = 4.0
"""Standard errors beyond which joules are more than the noise of two rows."""

RELINEARISATIONS = 1
"""Times that columns are taken anew with the accelerations that the causes make."""

REVISIONS = 2
"""Times that it is asked how forces act between rows: without causes, and with those that are found."""


class FlowError(ArithmeticError):
    """The equations of motion have no finite solution from some rows of a log on."""


class _Filter:
    """The log with what does not depend on causes: the flow, the integrator's columns, what is unknown."""

    def __init__(self, model: Model, run: Trajectory, log: Stretches) -> None:
        self.model, self.run, self.log = model, run, log
        intervals, n = log.intervals, model.n
        h = float(np.median(intervals.h))
        self.step = min(run.provenance.step or h, h)
        self.logged = LoggedForce.of(intervals, log.pieces)
        held = {str(name) for name in run.provenance.held or ()}
        names = [
            str(name) for name, at in model.log.columns.items() for _ in range(at.start, at.stop)
        ]
        self.fixed = ["start" if name in held else "" for name in names]
        self.observed = np.arange(n if "u" in run.provenance.derived else 2 * n)
        self.steps = 0
        self.flow, self.w = self.flow_with(tuple(f or "smooth" for f in self.fixed))
        self.log = log = _with_noise(log, self.w)
        speed = 1.0 + np.abs(intervals.start.u).max(initial=0.0)
        exact = bool(np.all(np.median(log.noise[1], axis=0) < EXACT * speed))
        self.chunk = SHORT if exact else len(intervals)
        lost = ~np.isfinite(self.w).all(axis=1)
        with compiled():
            self.integrator, self.J = _columns_of_integrator(model, log, self.flow, self.step)
            thinned = h > EVERY_STEP * self.step
            Q, between = _unknown(model, log, self.flow, self.logged, self.w, thinned)
        self.fields = self.integrator[0].shape[2]
        more = self.fields - len(FIELDS)
        self.prior = np.array([PRIOR[f.order] for f in FIELDS] + [PRIOR[3]] * more)
        self.share = 0.0
        if between.any():
            Phi, B = transported(intervals.h, self.J, self.integrator)
            likely = {
                s: likelihood(self.whitened(self.w, Phi, B, Q + s**2 * between)) for s in SHARES
            }
            self.share = max(SHARES, key=lambda s: likely[s])
        self.Q = Q + self.share**2 * between
        if not all(np.isfinite(x).all() for x in (*self.J, *self.integrator, self.Q)) or lost.any():
            raise FlowError("the flow of the model leaves all bounds between some rows")

    def flow_with(self, kinds: tuple[str, ...]) -> tuple[Predicted, Array]:
        """The flow, and the prediction errors (N, 2n)."""
        intervals = self.log.intervals
        with compiled():
            flow = predicted(
                self.model, intervals, self.logged(kinds), self.log.noise[1], self.steps
            )
        self.steps = len(flow.nodes) - 1
        return flow, difference(self.model, flow.end, intervals.end)

    def whitened(self, w: Array, Phi: Array, B: Array, Q: Array) -> Innovations:
        """Innovations with the columns B."""
        none = np.zeros((len(w), w.shape[1], 0))
        size = np.sqrt(np.mean(w**2, axis=0)) + 1e-300
        return innovations(
            self.log.pieces,
            w,
            Phi,
            B,
            self.log.noise,
            Q,
            (none, none),
            self.observed,
            size,
            self.chunk,
        )

    def kinds_of_forces(
        self, best: Fit | None = None, made: Inference | None = None
    ) -> tuple[str, ...]:
        """How each logged force acts between two rows, by the likelihood, beside known causes."""
        default = tuple(f or "smooth" for f in self.fixed)
        if all(self.fixed) or (made is not None and not (best and best.chosen)):
            return default if made is None else made.forces
        with compiled():
            C = _force_columns(self.model, self.log, self.logged)
        integrator = self.integrator
        causes = 0
        w = self.w
        if made is not None and best is not None:
            own = [x @ best.tangent for x in made.columns]
            causes = own[0].shape[2]
            integrator = [np.concatenate([a, b], axis=2) for a, b in zip(integrator, own)]
        Phi, B = transported(self.log.intervals.h, self.J, integrator)
        white = self.whitened(w, Phi, np.concatenate([B, C], axis=2), self.Q)
        nuisance = self.fields + causes
        prior = np.concatenate([self.prior, np.full(causes, 1e6)])
        trial = Block(
            white.r, white.D, np.arange(nuisance), prior, nuisance + np.arange(C.shape[2])
        )
        p = trial.projected
        gram = np.block([[np.array([[p.rss]]), p.b[None]], [p.b[:, None], p.A]])
        tau = autocorrelation_time(trial.residual(np.linalg.pinv(p.A, rcond=1e-10) @ p.b))
        return _likeliest(gram, trial.count / tau, self.fixed)


FINEST = 1e-6
"""Least noise of a column, as a share of its prediction errors: what is finer is not needed, and
covariances keep
their digits."""


def _with_noise(log: Stretches, w: Array) -> Stretches:
    """The rows with the noise that their prediction errors show.

    Summed up they are the noise of the rows beside what is smooth, w_k ≈ e_{k+1} − e_k, however unevenly or
    coarsely the motion is sampled.
    """
    first, last = max(log.pieces, key=lambda piece: piece[1] - piece[0])
    noise = white_noise(np.cumsum(w[first:last], axis=0))
    noise = np.maximum(noise, FINEST * np.sqrt(np.mean(w**2, axis=0)))
    return replace(log, noise=tuple(np.maximum(d, noise) for d in log.digits))


def _with_forces(
    f: _Filter,
    kernels: ColumnKernels,
    some: tuple[Candidate, ...],
    run: Trajectory,
    kinds: tuple[str, ...],
    energy: float,
    before: Inference | None = None,
) -> Inference:
    """The inference with forces that act between rows in known ways; `before` tells causes already."""
    model, log, intervals = f.model, f.log, f.log.intervals
    flow, w = f.flow_with(kinds)
    with compiled():
        slope, jump = _energies(model, flow, intervals)
        acceleration = model.at(flow.nodes[0])
    own = _columns_of_causes(model, kernels, log, flow, before)
    Phi, B = transported(
        intervals.h, f.J, [np.concatenate([a, b], axis=2) for a, b in zip(f.integrator, own)]
    )
    ni, nc = f.fields, own[0].shape[2]
    white = f.whitened(w, Phi, B, f.Q)
    weight = np.sqrt(robust_weights(white.r))[:, None]
    block = Block(
        white.r * weight, white.D * weight[:, :, None], np.arange(ni), f.prior, ni + np.arange(nc)
    )
    blocks = [block]
    if trusted(run) and run.udot is not None and "udot" not in run.provenance.derived:
        blocks = [_measured(model, kernels, log, run, f.J[0])]
    whole = float(run.t[-1] - run.t[0]) / float(intervals.h.sum())
    power = np.einsum("km,kmp->kp", slope, B)
    size = np.abs(slope)

    def effect(fit: Fit) -> Effect:
        joules, errors, energies = [], [], []
        for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta)):
            columns = ni + np.array(c.columns)
            moved = B[:, :, columns] @ c.coefficients(theta)
            joules.append(whole * float((size * np.abs(moved)).sum()))
            energies.append(whole * float((power[:, columns] @ c.coefficients(theta)).sum()))
            relative = fit.deviation(k) / np.maximum(np.abs(theta), 1e-300)
            errors.append(joules[-1] * min(float(relative.min()), 1.0))
        return Effect(fit, np.array(joules), np.array(errors), np.array(energies))

    least = max(NEGLIGIBLE * energy, _remainder(f, block, B, size, whole))
    if before is None:
        posterior = search(blocks, some, lambda fit: effect(fit).exchanged, least)
    else:
        posterior = before.posterior
        refitted = fitted(blocks, posterior.best.chosen, posterior.best.theta)
        if refitted is not None:
            last = posterior.best
            posterior = replace(
                posterior, best=replace(refitted, log_odds=last.log_odds, each=last.each)
            )
    best = posterior.best
    left = block.residual(best.coefficients)
    tau = autocorrelation_time(left)
    p = block.projected
    variance = p.left(best.coefficients) / block.count
    x = p.nuisance - p.to @ best.coefficients
    C = p.inverse * variance * tau
    # --- ΔC in joules ---
    total = np.cumsum(jump)
    of_fields = np.cumsum(power[:, :ni], axis=0)
    # The order beyond the series is no noise: its joules grow with the motion.
    beyond_series = _remainder(f, block, B, size, 1.0) * np.linspace(0.0, 1.0, len(w))
    spread = np.maximum(np.einsum("ki,ij,kj->k", of_fields, C, of_fields), 0.0)
    integrator = Share(of_fields @ x, np.sqrt(spread + beyond_series**2))
    T = np.cumsum(power[:, ni:] @ best.tangent, axis=0)
    mistake = Share(
        np.cumsum(power[:, ni:] @ best.coefficients),
        np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", T, best.covariance * tau, T), 0.0)),
    )
    of_rows = np.einsum("km,km->k", slope**2, log.noise[1] ** 2)
    odd = np.zeros(len(w))
    if len(f.observed) == w.shape[1]:
        states = np.einsum("kij,kj->ki", white.factor, left / weight)
        odd[white.which] = np.einsum("km,km->k", slope[white.which], states) ** 2
    beyond = max(0.0, 1.0 - 1.0 / max(variance, 1e-300))
    unknown = np.einsum("km,kmn,kn->k", slope, f.Q, slope) * max(variance, 1.0)
    wandering = np.cumsum(np.maximum(beyond * odd, unknown)) * tau
    rest = Share(
        total - integrator.curve - mistake.curve, np.sqrt(of_rows + of_rows[0] + wandering)
    )
    stiffness = intervals.h[:, 0] * np.linalg.norm(f.J[0], axis=(1, 2)) / np.sqrt(len(x))
    made = Inference(
        model=model,
        log=log,
        forces=kinds,
        blocks=tuple(blocks),
        posterior=posterior,
        candidates=some,
        coefficients=x[: len(FIELDS)],
        covariance=C[: len(FIELDS), : len(FIELDS)],
        attribution=Attribution(intervals.end.t, integrator, mistake, rest),
        tau=tau,
        excess=variance,
        whole=whole,
        step=f.step,
        hidden=_hidden(blocks, some, power[:, ni:], whole, best, tau),
        intermittent=_intermittent(blocks[0], best),
        w=w,
        acceleration=acceleration,
        columns=own,
        jumps=np.abs(slope * w).sum(axis=1),
        stiffness=stiffness,
        effect=effect,
        share=f.share,
        residual=left,
        unknown=whole
        * float(np.max(np.abs(rest.curve) - UNEXPLAINED * np.sqrt(of_rows + of_rows[0]))),
    )
    return made


def _remainder(f: _Filter, block: Block, B: Array, size: Array, whole: float) -> float:
    """Joules that the first order beyond the series may exchange.

    A term of the next order is ρ times as large, ρ the step times the spectral radius of ∂f/∂x. What is below
    this is no evidence of a mistake.
    """
    some = np.unique(np.linspace(0, len(f.J[0]) - 1, 32).astype(np.intp))
    radius = np.abs(np.linalg.eigvals(f.J[0][some])).max(axis=1)
    rho = f.step * float(np.median(radius))
    x = block.projected.nuisance
    joules = [0.0, 0.0]
    for order in (1, 2):
        of_order = [k for k, field in enumerate(FIELDS) if field.order == order]
        joules[order - 1] = whole * float((size * np.abs(B[:, :, of_order] @ x[of_order])).sum())
    return max(joules[0] * rho**3, joules[1] * rho**2)


def _hidden(
    blocks: Sequence[Block],
    some: Sequence[Candidate],
    power: Array,
    whole: float,
    best: Fit,
    tau: float,
) -> tuple[float, str]:
    """Energy (J) that a single number may add to ΔC unseen, at two standard errors; and which it is."""
    curves = np.cumsum(power, axis=0)
    most, name = 0.0, ""
    for c in some:
        if (
            c.size != 1
            or c.quadratic is not None
            or any(c is x or c.excludes(x) for x in best.chosen)
        ):
            continue
        deviation = _deviation(blocks, c, best, tau)
        if not np.isfinite(deviation):
            continue
        columns, theta = list(c.columns), np.array([2.0 * deviation])
        joules = whole * float(np.abs(curves[:, columns] @ c.coefficients(theta)).max())
        if joules > most and c.plausible(theta):
            most, name = joules, f"{c.kind} {c.element}".strip()
    return most, name


def _deviation(blocks: Sequence[Block], c: Candidate, best: Fit, tau: float) -> float:
    columns, L = list(c.columns), c.linear[:, 0]
    information = 0.0
    for b in blocks:
        p = b.projected
        variance = p.left(best.coefficients) / b.count
        information += float(L @ p.A[np.ix_(columns, columns)] @ L) / variance
    return float(np.sqrt(tau / information)) if information > 0.0 else np.inf


def _intermittent(block: Block, best: Fit) -> tuple[float, Array]:
    """Log odds that what is left comes in intervals of their own, and these intervals (bool, N).

    Two variances, of quiet and of active intervals, against the one of the best causes; each spell of
    activity
    costs its two ends.
    """
    r = block.residual(np.zeros(len(block.causes)))
    n, d = r.shape
    size = np.mean(r**2, axis=1) + 1e-300
    none = np.zeros(n, dtype=bool)
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
        D, y = block.D[~active][:, :, block.nuisance], block.r[~active]
        ridge = np.diag(np.sqrt(block.floor) / block.prior)
        A = np.concatenate([D.reshape(-1, D.shape[2]), ridge])
        x = np.linalg.lstsq(A, np.concatenate([y.ravel(), np.zeros(len(ridge))]), rcond=1e-13)[0]
        r = block.r - block.D[:, :, block.nuisance] @ x
    low, high = float(np.mean(r[~active] ** 2)), float(np.mean(r[active] ** 2))
    share = active.mean()
    one = block.projected.left(best.coefficients) / block.r.size
    tau = autocorrelation_time(r[~active])
    spells = int(np.count_nonzero(np.diff(active.astype(int)) == 1)) + 1
    odds = (
        0.5
        * n
        * d
        / tau
        * (
            np.log(one + 1e-300)
            - (1 - share) * np.log(low + 1e-300)
            - share * np.log(high + 1e-300)
        )
    )
    return float(odds - 2.0 * spells * np.log(n)), active


ACTIVE = 100.0
"""Variance of an interval beside that of quiet ones from which on something acts in it that does not in
those."""


NEGLIGIBLE = 1e-6
"""Share of the energy exchanged below which a cause is not told: iterations of constraint solvers stop
there."""


def _measured(
    model: Model, kernels: ColumnKernels, log: Stretches, run: Trajectory, J: Array
) -> Block:
    """The equations at the rows, by accelerations that are known to be theirs: no integration is involved."""
    assert run.udot is not None
    rows = np.concatenate([np.arange(a, b - 1) for a, b in log.rows])
    free, n, at = model.mechanism.free.u, model.n, log.intervals.start
    udot, digits = run.udot[rows][:, free], digits_of(run)["udot"].half()[rows][:, free]
    with compiled():
        a = model.at(at)
        M, G = model.matrices(at.t, at.q)
    still = np.zeros_like(at.F)
    x = kernels(at.t, at.q, at.u, udot, at.F, still, still)[:, :, 1:]
    columns = model.compliance(M, G) @ x if model.rows_of_G else np.linalg.solve(M, x)
    of_rows = np.einsum("kij,kj->ki", np.abs(J[:, n:]), log.digits[0])
    sigma = np.sqrt(digits**2 + of_rows**2) + 1e-12 * (1.0 + np.abs(a).max())
    sigma = np.sqrt(np.mean(sigma**2, axis=0))
    none = np.zeros(0, dtype=np.intp)
    return Block(
        (udot - a) / sigma, columns / sigma[:, None], none, np.zeros(0), np.arange(x.shape[2])
    )


def _columns_of_integrator(
    model: Model,
    log: Stretches,
    flow: Predicted,
    step: float,
) -> tuple[list[Array], list[Array]]:
    intervals = log.intervals
    h = np.minimum(step, intervals.h)

    def at_node(at: Rows, where: slice | NDArray[np.intp]) -> tuple[Array, Array]:
        J = jacobians(model, at)
        own = elementary_differentials(model, at, h[where])
        return J, own

    def with_next(J: Array, own: Array, at: Rows) -> Array:
        more = [next_order(J[a:b], own[a:b], at.t[a:b], h[a:b]) for a, b in log.pieces]
        return np.concatenate([own, np.concatenate(more)], axis=2)

    fields, J = list[Array](), list[Array]()
    for at in flow.nodes[:-1]:
        here, own = at_node(at, slice(None))
        J.append(here)
        fields.append(with_next(here, own, at))
    ends = at_ends(log.pieces)
    last, own = at_node(flow.nodes[-1].taken(ends), ends)
    J.append(shifted(J[0], last, log.pieces))
    more = np.concatenate(
        [own, np.repeat(fields[0][ends][:, :, own.shape[2] :], 1, axis=0)], axis=2
    )
    fields.append(shifted(fields[0], more, log.pieces))
    return fields, J


def at_ends(pieces: list[tuple[int, int]]) -> NDArray[np.intp]:
    """The last interval of each piece."""
    return np.array([b - 1 for _, b in pieces], dtype=np.intp)


def shifted(values: Array, last: Array, pieces: list[tuple[int, int]]) -> Array:
    """Values at the ends of intervals by those at the starts of the next, and the `last` of each piece."""
    made = np.empty_like(values)
    for (a, b), end in zip(pieces, last):
        made[a : b - 1], made[b - 1] = values[a + 1 : b], end
    return made


def _columns_of_causes(
    model: Model,
    kernels: ColumnKernels,
    log: Stretches,
    flow: Predicted,
    before: Inference | None = None,
) -> list[Array]:
    """G_j = M⁻¹ x_j (N, 2n, P) at the nodes of the flow; at its end those of the next row.

    With the accelerations that the causes known `before` make.
    """
    intervals = log.intervals
    rate = (intervals.end.F - intervals.start.F) / intervals.h

    def columns(at: Rows, rate: Array, more: Array | float) -> Array:
        with compiled():
            a = model.at(at) + more
            M, G = model.matrices(at.t, at.q)
        x = kernels(at.t, at.q, at.u, a, at.F, rate, np.zeros_like(rate))[:, :, 1:]
        u = model.compliance(M, G) @ x if model.rows_of_G else np.linalg.solve(M, x)
        return np.concatenate([np.zeros_like(u), u], axis=1)

    more: list[Array | float] = [0.0] * len(flow.nodes)
    if before is not None:
        c = before.posterior.best.coefficients
        more = [x[:, model.n :] @ c for x in before.columns]
    made = [columns(at, rate, a) for at, a in zip(flow.nodes[:-1], more)]
    ends = at_ends(log.pieces)
    last = more[-1][ends] if isinstance(more[-1], np.ndarray) else more[-1]
    end = columns(flow.nodes[-1].taken(ends), rate[ends], last)
    return [*made, shifted(made[0], end, log.pieces)]


def _per_force(model: Model, at: Rows) -> Iterator[Array]:
    """What a unit of each logged force adds to the accelerations (N, n)."""
    base = model.at(at)
    for k in range(at.F.shape[1]):
        d = 1e-3 * (1.0 + np.abs(at.F[:, k]).max())
        F = at.F.copy()
        F[:, k] += d
        yield (model.acceleration(at.t, at.q, at.u, F) - base) / d


EVERY_STEP = 1.01
"""Rows further apart than so many steps of the integrator are not all of its steps."""

SHARES = (0.0, 0.01, 0.1, 1.0)
"""Shares of what forces may have done between the rows of a thinned log that are compared by likelihood."""


def _unknown(
    model: Model, log: Stretches, flow: Predicted, logged: LoggedForce, w: Array, thinned: bool
) -> tuple[Array, Array]:
    """Covariance (N, 2n, 2n) of what the flow does not know, and of forces between `thinned` rows.

    Of its own error; digits and noise of logged forces; along constraints, what a solver does to keep
    them. Where
    steps were not all logged a force may have taken any way from one row to the next: by its change,
    uniformly.
    """
    n, h, at = model.n, log.intervals.h, flow.nodes[0]
    Q = np.zeros((len(h), 2 * n, 2 * n))
    diagonal = np.arange(2 * n)
    Q[:, diagonal, diagonal] = flow.error**2
    coarse = np.any(log.force_noise > 1e-12 * np.abs(at.F).max(axis=0, initial=1e-300), axis=0)
    if coarse.any():
        for k, response in enumerate(_per_force(model, at)):
            du = response * h * log.force_noise[:, k : k + 1]
            both = np.concatenate([0.5 * h * du, du], axis=1)
            Q += both[:, :, None] * both[:, None, :]
    between = np.zeros_like(Q)
    if thinned:
        for k, response in enumerate(_per_force(model, at)):
            bends = np.abs(logged.bends[0][:, k]) + np.abs(logged.bends[1][:, k])
            du = (
                response
                * (h[:, 0] * np.hypot(logged.change[:, k] / np.sqrt(12.0), bends / 6.0))[:, None]
            )
            both = np.concatenate([0.5 * h * du, du], axis=1)
            early = np.concatenate([h * du / np.sqrt(12.0), np.zeros_like(du)], axis=1)
            between += both[:, :, None] * both[:, None, :] + early[:, :, None] * early[:, None, :]
    if model.rows_of_G:
        M, G = model.matrices(at.t, at.q)
        across = np.linalg.solve(M, G.transpose(0, 2, 1))
        across, _ = np.linalg.qr(across)
        size = ACROSS * np.sqrt(np.mean(w**2, axis=0) + np.mean(log.noise[0] ** 2, axis=0)).max()
        normal = size**2 * across @ across.transpose(0, 2, 1)
        Q[:, :n, :n] += normal
        Q[:, n:, n:] += normal
    return Q, between


ACROSS = 1e3
"""How much more than the prediction errors a solver may do across the constraints: nothing is told by
these."""


def _force_columns(model: Model, log: Stretches, logged: LoggedForce) -> Array:
    """What each way of a logged force between rows adds to the prediction, to first order (N, 2n, 3m)."""
    start, h = log.intervals.start, log.intervals.h
    nodes = np.linspace(0.0, 1.0, 5)
    parts = [logged.parts(s) for s in nodes]
    columns = []
    for k, response in enumerate(_per_force(model, Rows(start.t, start.q, start.u, logged.first))):
        for which in range(3):
            f = np.array([part[which][:, k] for part in parts])
            mean = simpson(f, x=nodes, axis=0)[:, None]
            moment = simpson((1.0 - nodes)[:, None] * f, x=nodes, axis=0)[:, None]
            columns.append(np.concatenate([response * h**2 * moment, response * h * mean], axis=1))
    return np.stack(columns, axis=2)


def _likeliest(gram: Array, rows: float, fixed: list[str]) -> tuple[str, ...]:
    """How each logged force acts between rows, by the Gram matrix of innovations and force columns.

    All in the same way, which the likelihood chooses; one in another way where that has odds of its own.
    """

    def left(kinds: list[str]) -> float:
        x = np.concatenate([[1.0], *(-(np.array(FORCES[k]) - FORCES["smooth"]) for k in kinds)])
        return max(float(x @ gram @ x), 1e-14 * float(gram[0, 0]) + 1e-300)

    default = [d or "smooth" for d in fixed]
    best = min(([d or kind for d in fixed] for kind in FORCES), key=left)
    if 0.5 * rows * np.log(left(default) / left(best)) < CERTAIN:
        best = default
    for k in range(len(fixed) if len(fixed) <= SINGLY else 0):
        if not fixed[k]:
            other = min(([*best[:k], kind, *best[k + 1 :]] for kind in FORCES), key=left)
            if 0.5 * rows * np.log(left(best) / left(other)) > CERTAIN + np.log(
                len(FORCES) * len(fixed)
            ):
                best = other
    return tuple(best)


SINGLY = 12
"""Columns of logged forces up to which each is asked on its own."""


def _energies(model: Model, flow: Predicted, intervals: Intervals) -> tuple[Array, Array]:
    """∂E/∂x (N, 2n) at the ends of intervals, and the jump of energy E(row) − E(prediction) (N,)."""
    s, k = model.symbols.system, model.symbols.computed
    energy = Expression("energy", {"t": s.t, "q": s.q, "u": s.u}, k.K2 + k.K1 + k.K0 + k.V)

    def E(t: Array, q: Array, u: Array) -> Array:
        return energy(t, q, u)[0][:, 0]

    end, told = intervals.end, flow.end
    jump = E(end.t, end.q, end.u) - E(told.t, told.q, told.u)
    n, here = model.n, E(told.t, told.q, told.u)
    slope = np.empty((len(here), 2 * n))
    for j in range(n):
        e = np.zeros((1, n))
        e[0, j] = 1.0
        d = 1e-6
        moved = model.moved(told.q, np.broadcast_to(e, told.u.shape), np.full((len(here), 1), d))
        slope[:, j] = (E(told.t, moved, told.u) - here) / d
        slope[:, n + j] = (E(told.t, told.q, told.u + d * e) - here) / d
    return slope, jump


@dataclass(frozen=True)
class CauseEstimate:
    """A cause that was found in a log.

    Attributes:
        kind, element: what, and of which body, joint or channel: "body-mass", "damping", …
        log_odds: against the log without it, natural logarithm; `odds` themselves.
        size, size_error: its (first) number in the run, with its standard error; `unit` is its unit.
        energy: what it adds to ΔC by the end of the log, J.
        exchanged: the energy that flows through the mistake, without sign, J.
        sentence: all of it in words.
    """

    kind: str
    element: str
    log_odds: float
    size: float
    size_error: float
    unit: str
    energy: float
    exchanged: float
    sentence: str

    @property
    def odds(self) -> float:
        """Odds against the log without it; at most 1e300."""
        return float(np.exp(min(self.log_odds, 690.0)))


def causes_of(mechanism: Mechanism, inference: Inference) -> tuple[CauseEstimate, ...]:
    """The causes of the best set, those with the most joules first."""
    best = inference.posterior.best
    effect = inference.effect(best)
    estimates = []
    for k, (c, theta) in enumerate(zip(best.chosen, best.theta)):
        error = best.deviation(k) * np.sqrt(inference.tau)
        estimates.append(
            CauseEstimate(
                c.kind,
                c.element,
                best.each[k],
                float(c.base[0] + theta[0]),
                float(error[0]),
                c.units[0],
                float(effect.energy[k]),
                float(effect.exchanged[k]),
                sentence(mechanism, c, theta, error),
            )
        )
    return tuple(sorted(estimates, key=lambda cause: -cause.exchanged))


def works_between_rows(inference: Inference, run: Trajectory) -> dict[ChannelName, Array]:
    """The work (T,) of every logged channel, J, where all forces were held: F Δq, known without quadrature.

    Empty where a force is not held, or acts on what no force between the rows tells.
    """
    if not inference.forces or any(FORCES[kind][1] for kind in inference.forces):
        return {}
    if run.works or run.integrals or set(run.forces) != set(inference.model.log.places):
        return {}
    model = inference.model
    free = model.mechanism.free
    rows = Rows(run.t, run.q[:, free.q], run.u[:, free.u], np.zeros((len(run), 0)))
    first, last = rows.taken(slice(0, -1)), rows.taken(slice(1, None))
    moved = difference(model, first, last)[:, : model.n]
    place = {int(k): row for row, k in enumerate(free.u)}
    works: dict[ChannelName, Array] = {}
    for name, speeds in model.log.places.items():
        if any(k not in place for k in speeds):
            return {}
        a = np.array([FORCES[inference.forces[c]][0] for c in _range(model.log.columns[name])])
        F = run.forces[name][:, speeds]
        acting = F[:-1] + a * np.diff(F, axis=0)
        power = np.einsum("km,km->k", acting, moved[:, [place[k] for k in speeds]])
        works[name] = np.concatenate([[0.0], np.cumsum(power)])
    return works


def _range(places: slice) -> range:
    return range(places.start, places.stop)
