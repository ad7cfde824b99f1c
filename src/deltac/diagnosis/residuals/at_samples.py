"""The equations of motion at the samples of a log, and its constraints on acceleration level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, TINY, Array
from deltac.diagnosis.measurements.digits import Chosen, digits_of, resolution
from deltac.diagnosis.verdict import Finding
from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import rnea
from deltac.dynamics.spatial import SX
from deltac.energy.terms import LedgerSymbols, LoggedForces, ledger_symbols
from deltac.kernels.rows import Expression
from deltac.mechanism.channels import ByChannel, ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

# --- the equations of motion at the samples of a log ---------------------------------------------
# Kane's equations say F_r + F*_r = 0 for every free speed. What is left of them at the logged
# states, accelerations and forces is a mistake in the model, in a force, or a missing channel;
# not the integrator's, which only moves from one state to the next.

MOST_ROWS = 3000
"""Samples that are looked at, evenly over the log: enough for every statistic that is made of them."""

PERTURBATIONS = 2
CLEAR = 50.0
"""A residual this many times above what digits allow is no rounding: terms are sums of some tens
of products."""

NEGLIGIBLE = 1e-12
"""Share of a momentum that rounding may change over a log."""

IDLE = 1e-3
"""The terms of an equation count as at least this share of the largest, in the mass metric."""

LEAST = 1e-6
"""Relative residuals below this are not called a mistake: constraint solvers stop there."""


@dataclass(frozen=True, eq=False)
class EquationTerms:
    """Terms of F_r + F*_r (T, n) at T samples for the n free speeds, N or N·m.

    Attributes:
        speeds: the names of the free speeds (n).
        rows: which samples of the log.
        forces: F_r of each channel.
        own: the model's own force of channels that the log replaced.
        residual: the sum of forces, inertia forces and constraint forces.
        scale: typical size of the terms that are added up, for each speed (n,).
        precision: residual (n,) that the log's number of digits, or rounding, explains.
    """

    speeds: tuple[str, ...]
    rows: NDArray[np.intp]
    t: Array
    q: Array
    u: Array
    udot: Array
    forces: ByChannel
    own: ByChannel
    residual: Array
    scale: Array
    precision: Array
    evaluator: Evaluator

    @property
    def size(self) -> Array:
        """Root mean square of the residual of each speed (n,)."""
        return np.asarray(np.sqrt(np.mean(self.residual**2, axis=0)))

    @property
    def relative(self) -> Array:
        """`size` as a fraction of `scale` (n,); zero where the terms themselves are no more than rounding."""
        real = self.scale > CLEAR * self.precision
        return np.divide(self.size, self.scale, out=np.zeros_like(self.size), where=real)

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Which speeds have a residual that neither rounding nor digits explain (n,)."""
        return np.asarray((self.size > CLEAR * self.precision) & (self.relative > LEAST))

    def weighted(self, values: Array) -> Array:
        """Divided by the scale of each speed, so that N and N·m may be added up."""
        weight = np.divide(1.0, self.scale, out=np.zeros_like(self.scale), where=self.scale > 0)
        return values * weight


class Evaluator:
    """Kane's equations of a mechanism with a log's forces, as functions of arrays of samples.

    `reach` are the least and the largest values of all coordinates in the log, `spacing` is of its rows (s).
    """

    def __init__(self, mechanism: Mechanism, run: Trajectory) -> None:
        self.mechanism = mechanism
        free = mechanism.free
        self.log = LoggedForces.of(run)
        start = (float(run.t[0]), run.q[0, free.q])
        self.reach = (run.q.min(axis=0), run.q.max(axis=0))
        self.spacing = float(np.median(np.diff(run.t))) if len(run) > 1 else 0.0
        self.symbols: LedgerSymbols = ledger_symbols(mechanism, self.log, None, start)
        self.channels = tuple({part.name for part in self.symbols.parts})
        self.own_names, self._names, self._terms = self.symbols.once("terms", self._written_out)

    def _written_out(self) -> tuple[list[ChannelName], list[str], Expression]:
        """Channels of both the model and the log; the names of all terms, and these as one expression."""
        symbols, s = self.symbols, self.symbols.system
        at = s.free_u
        own = {p.name: p.force for p in channels(s) if p.name in self.log.places and not p.logged}
        bias = rnea(s, ca.SX.zeros(len(self.mechanism.speeds)))
        outputs: dict[str, SX] = {
            "inertia": -(rnea(s, symbols.udot) - bias)[at],
            "bias": -bias[at],
            "constraint": ca.SX.zeros(len(at)),
            **{f"force {p.name}": p.force[at] for p in symbols.parts},
            **{f"own {name}": force[at] for name, force in own.items()},
        }
        if symbols.constrained is not None:
            G = symbols.constrained.rows.G
            outputs["constraint"] = ca.mtimes(G.T, symbols.reactions.multipliers)
        return list(own), list(outputs), self._expression(outputs, often=True)

    def _expression(self, outputs: Mapping[str, SX], *, often: bool = False) -> Expression:
        s = self.symbols.system
        inputs = {"t": s.t, "q": s.q, "u": s.u, "udot": s.udot, "logged": self.symbols.logged}
        return Expression("terms", inputs, *outputs.values(), often=often)

    def __call__(self, samples: Sampled) -> dict[str, Array]:
        """All terms (T, n) by name."""
        return dict(zip(self._names, self._terms(*samples.columns)))

    def evaluate(self, outputs: Mapping[str, SX], samples: Sampled) -> list[Array]:
        """Expressions in the symbols of the system, at the samples (T, n)."""
        return self._expression(outputs)(*samples.columns)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Columns of a log that the equations need: free q, u, u̇, and the logged forces (T, m)."""

    t: Array
    q: Array
    u: Array
    udot: Array
    logged: Array

    @staticmethod
    def of(
        mechanism: Mechanism, run: Trajectory, log: LoggedForces, rows: Chosen = slice(None)
    ) -> Sampled:
        """Samples of a run that has accelerations: all, or those of some rows."""
        assert run.udot is not None
        free, t = mechanism.free, run.t[rows]
        forces = [run.forces[name][rows][:, places] for name, places in log.places.items()]
        logged = np.concatenate(forces, axis=1) if forces else np.zeros((len(t), 0))
        states = (run.q[rows][:, free.q], run.u[rows][:, free.u], run.udot[rows][:, free.u])
        return Sampled(t, *states, logged)

    @property
    def columns(self) -> tuple[Array, ...]:
        """All of them, in the order of `Evaluator`'s inputs."""
        return self.t, self.q, self.u, self.udot, self.logged

    def moved(self, size: Mapping[str, Array], rng: np.random.Generator) -> Sampled:
        """The same with every number of some columns moved at random by its size."""
        there = {n: getattr(self, n) + rng.uniform(-1, 1, x.shape) * x for n, x in size.items()}
        return replace(self, **there)

    def take(self, rows: NDArray[np.intp]) -> Sampled:
        """Some of the samples."""
        return Sampled(self.t[rows], self.q[rows], self.u[rows], self.udot[rows], self.logged[rows])


def equation_terms(mechanism: Mechanism, run: Trajectory) -> EquationTerms:
    """The terms of the equations of motion at (at most `MOST_ROWS`) samples of a run with u̇."""
    evaluator = Evaluator(mechanism, run)
    rows = np.unique(np.linspace(0, len(run) - 1, min(len(run), MOST_ROWS)).astype(np.intp))
    samples = Sampled.of(mechanism, run, evaluator.log, rows)
    found = evaluator(samples)
    forces, own = (
        {ChannelName.parse(n.removeprefix(w)): x for n, x in found.items() if n.startswith(w)}
        for w in ("force ", "own ")
    )
    residual = total(found)
    magnitude = np.sum([np.abs(x) for x in _terms(found)], axis=0)
    scale = np.sqrt(np.mean(magnitude**2, axis=0))
    units = [mechanism.speeds[int(k)].unit for k in mechanism.free.u]
    return EquationTerms(
        speeds=tuple(mechanism.speeds[int(k)].name for k in mechanism.free.u),
        rows=rows,
        t=samples.t,
        q=samples.q,
        u=samples.u,
        udot=samples.udot,
        forces=forces,
        own=own,
        residual=residual,
        scale=np.maximum(_floored(scale, units), IDLE * _beside(evaluator, samples, scale)),
        precision=_precision(evaluator, run, samples, rows, residual, scale)
        + _inertial_rounding(evaluator, samples, units),
        evaluator=evaluator,
    )


def _beside(evaluator: Evaluator, samples: Sampled, scale: Array) -> Array:
    """The size (n,) that the terms of each equation would have for the largest accelerations of any.

    An equation in which nothing happens has terms of rounding only; in the mass metric, |terms|/√M, those of
    all equations can be compared, N and N·m alike.
    """
    few = samples.take(np.linspace(0, len(samples.t) - 1, 8).astype(np.intp))
    inertia = np.empty_like(scale)
    for k in range(len(scale)):
        unit = np.zeros_like(few.udot)
        unit[:, k] = 1.0
        inertia[k] = np.sqrt(np.abs(evaluator(replace(few, udot=unit))["inertia"][:, k]).mean())
    return np.asarray(inertia * (scale / np.maximum(inertia, 1e-300)).max(initial=0.0))


def _inertial_rounding(evaluator: Evaluator, samples: Sampled, units: Sequence[str]) -> Array:
    """Forces (n,) that would change the momenta by no more than rounding in the time of the log.

    The terms of a body that flies freely cancel, and have no size of their own to tell rounding by.
    """
    some = samples.take(np.linspace(0, len(samples.t) - 1, 20).astype(np.intp))
    momentum = np.abs(evaluator(replace(some, udot=some.u))["inertia"]).max(axis=0)
    time = max(float(np.ptp(samples.t)), TINY)
    return _floored(NEGLIGIBLE * momentum / time, units, 1.0)


def total(found: Mapping[str, Array]) -> Array:
    """F_r + F*_r of an evaluator's terms."""
    return np.asarray(np.sum(_terms(found), axis=0))


def _terms(found: Mapping[str, Array]) -> list[Array]:
    return [x for name, x in found.items() if not name.startswith("own ")]


def _floored(scale: Array, units: Sequence[str], share: float = LEAST) -> Array:
    """No scale below a `share` of the largest of its unit: what is zero but for rounding has no size."""
    floored = scale.copy()
    for unit in set(units):
        same = np.array([u == unit for u in units])
        floored[same] = np.maximum(floored[same], share * scale[same].max(initial=0.0))
    return floored


def _precision(
    evaluator: Evaluator,
    run: Trajectory,
    exact: Sampled,
    rows: NDArray[np.intp],
    residual: Array,
    scale: Array,
) -> Array:
    """How much the residual moves when every number of the log moves by half its last digit."""
    of_run, free = digits_of(run), evaluator.mechanism.free
    places = {"q": free.q, "u": free.u, "udot": free.u}
    digits = {name: of_run[name].half(rows)[:, at] for name, at in places.items()}
    forces = (of_run[f"force {name}"].half(rows) for name in run.forces)
    digits["logged"] = np.concatenate([exact.logged[:, :0], *forces], axis=1)
    rng = np.random.default_rng(0)
    moved = [total(evaluator(exact.moved(digits, rng))) - residual for _ in range(PERTURBATIONS)]
    return _rms(np.concatenate(moved)) + 4.0 * EPS * scale


# --- constraints on acceleration level, ψ̇ = G u̇ + γ = 0, at the samples of a log ---------------
# Projections after each step mend what wrong equations do across the constraints: states and
# energies then look right. The accelerations still tell. Kane's equations do not: their
# multipliers take up every error along Gᵀ.

STIFFEST = 3.0
"""Largest rate of decay, times the step, that a stabilisation may have: explicit methods stand no more."""


def constraint_rates(terms: EquationTerms, run: Trajectory) -> dict[str, float]:
    """ψ̇ = G u̇ + γ of each constraint at the samples of a run with u̇, as a share of its terms.

    `terms` are the equations of the run. It is 0 where digits of the log or a stabilisation explain ψ̇.
    Baumgarte's asks for ψ̇ = −2αψ − β²φ in place of zero, and soft constraints likewise. Their α and β are
    not known, but at a step h they are `STIFFEST`/h at most.
    """
    bound = terms.evaluator.symbols.constrained
    if bound is None or len(run) < 2:
        return {}
    rows, evaluator = bound.rows, terms.evaluator
    udot, u = evaluator.symbols.system.udot, evaluator.symbols.system.u
    outputs = {
        "rate": rows.gamma + ca.mtimes(rows.G, udot),
        "terms": ca.fabs(rows.gamma) + ca.mtimes(ca.fabs(rows.G), ca.fabs(udot)),
        "moved": ca.mtimes(ca.fabs(rows.G), ca.fabs(u)),
        "psi": rows.psi,
        "phi": rows.phi,
    }
    logged = np.zeros((len(terms.t), evaluator.log.size))
    samples = Sampled(terms.t, terms.q, terms.u, terms.udot, logged)
    rate, size, moved, psi, phi = evaluator.evaluate(outputs, samples)
    scale = _rms(size) + _rms(moved) / float(np.ptp(run.t))
    # What a row has no terms of, such as the height of a ball on a table, has no size of its own.
    scale = np.maximum(scale, LEAST * scale.max())
    digits = {name: resolution(getattr(samples, name)) for name in ("q", "u", "udot")}
    other = samples.moved(digits, np.random.default_rng(0))
    precision = _rms(evaluator.evaluate({"rate": outputs["rate"]}, other)[0] - rate)
    precision += 4.0 * EPS * scale
    decay = STIFFEST / (run.provenance.step or float(np.median(np.diff(run.t))))
    restoring = _rms(2.0 * decay * np.abs(psi) + decay**2 * np.abs(phi))
    left = _rms(rate)
    clear = (left > CLEAR * precision + restoring) & (left > LEAST * scale)
    shares = np.divide(left, scale, out=np.zeros_like(left), where=clear)
    found = dict.fromkeys(rows.names, 0.0)
    for name, share in zip(rows.names, shares):
        found[name] = max(found[name], float(share))
    return found


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


EXPLAINED = 0.05
"""What other rows' forces or accelerations may leave of a residual that they explain."""


def stale_stage(mechanism: Mechanism, run: Trajectory, terms: EquationTerms) -> list[Finding]:
    """Forces or accelerations that belong to the row before: then shifting them closes the equations."""
    rows = terms.rows[terms.rows < len(run) - 1]
    if not terms.significant.any() or len(rows) < 4:
        return []
    evaluator = terms.evaluator
    everything = Sampled.of(mechanism, run, evaluator.log)
    here, after = everything.take(rows), everything.take(rows + 1)
    # Of the same rows: where a motion runs away, the last one alone outweighs all others.
    size = _size(terms, terms.residual[terms.rows < len(run) - 1])
    for what, udot, logged in (
        ("forces", here.udot, after.logged),
        ("accelerations", after.udot, here.logged),
        ("forces and accelerations", after.udot, after.logged),
    ):
        moved = Sampled(here.t, here.q, here.u, udot, logged)
        left = _size(terms, total(evaluator(moved)))
        if left < EXPLAINED * size:
            return [
                Finding(
                    "stale-stage",
                    f"the log's {what} are one row old: each belongs to the state of the row before",
                    f"shifted by one row, they leave {left / size:.2g} of the residual of the equations",
                    "Log them with the state that they belong to: after a step most engines hold new "
                    "positions beside old forces. deltac.record_mujoco takes care of that",
                    "doubt",
                    what,
                )
            ]
    return []


def _size(terms: EquationTerms, residual: Array) -> float:
    return float(np.sqrt(np.mean(terms.weighted(residual) ** 2)))
