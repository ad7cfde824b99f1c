"""From a mechanism and rows of a trajectory, of whatever origin, to a ledger."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, SOME_ROWS, Array
from deltac.dynamics.coordinates import check_split
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.dynamics.independence import dependent_speeds
from deltac.dynamics.terms import Energies
from deltac.dynamics.testing_functions import (
    MOMENTUM,
    TESTING_FUNCTIONS,
    TestingFunction,
    applicable,
    testing_functions,
)
from deltac.energy.ledger import Ledger
from deltac.energy.one_pass import RowValues, in_one_pass
from deltac.energy.prepare import checked_samples
from deltac.energy.sampling.samples import Between, Powers, Samples, at_samples
from deltac.energy.sampling.segments import Jumps, LogRows, integrate_pieces, jumps, rows_of
from deltac.energy.terms import (
    LedgerKernels,
    LedgerSymbols,
    LoggedForces,
    ledger_kernels,
    ledger_symbols,
    residual_kernel,
    variants,
)
from deltac.energy.works import (
    Work,
    certain,
    exchanged,
    growth_of_rounding,
    in_loop,
    largest,
    of_potential,
    widened,
)
from deltac.errors import ArgumentsError, LogError, ModelError, WrongType, check_names
from deltac.kernels import Kernel
from deltac.mechanism.channels import BOOKED, CORRECTIONS, ENERGY_CORRECTION, ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.expressions import Law
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.energy.discrete import DiscreteWork

WORK_METHODS = ("in-loop", "samples", "discrete")


def balance_of_rows(
    mechanism: Mechanism,
    run: Trajectory,
    work: str | None,
    testing: Sequence[str] | None,
    coordinates: CoordinateMap | None,
    potential: Law | str | None,
    keep: int | None,
) -> RowBalance:
    """What the rows of a run come to, by the arguments of `balance`.

    Where one pass suffices and `keep` is given, at about so many rows; else at all.
    """
    _require_trajectory(run)
    if keep is not None and keep < 1:
        raise ArgumentsError(
            f"keep={keep}: expected how many rows the ledger is to keep, 1 or more"
        )
    if potential is not None and work not in (None, "samples"):
        raise ArgumentsError(
            f"potential: ΔC with a V of your own is taken along the samples, not {work!r}; leave work out"
        )
    method = _method(run, work if potential is None else "samples")
    noted = run.provenance.coordinates
    if coordinates is None and noted and method == "in-loop":
        coordinates = CoordinateMap(**noted)
    rows = rows_of(run)
    log = LoggedForces.of(rows if rows.starts else run)
    samples, basis = checked_samples(mechanism, rows, log)
    start = _start(samples)
    tied = coordinates is None and dependent_speeds(equations_of_motion(mechanism), *start)
    integrated = method == "in-loop" and any(n in run.integrals for n in TESTING_FUNCTIONS)
    names = _chosen(run, method, testing, tied=tied, integrated=integrated)
    functions = testing_functions(names, constrained=tied)
    if integrated and any(f.name.startswith("kane-levinson") for f in functions):
        _require_same_division(run, coordinates)
    recorded = _recorded(run) if method == "in-loop" and not integrated else frozenset()
    symbols, kernels = _compiled(
        mechanism,
        log,
        functions,
        coordinates,
        potential,
        start,
        recorded,
        momenta=MOMENTUM in names,
    )
    _check_division(symbols, samples)
    columns = None
    if method == "samples" and not run.integrals.keys() & BOOKED:
        columns = in_one_pass(samples, log, symbols, kernels, functions, keep)
    if columns is None:
        columns = _of_all_rows(samples, rows, log, kernels)
    discrete = None
    if method == "discrete":
        from deltac.energy.discrete import discrete_work

        discrete = discrete_work(symbols, rows, samples, log)
    return RowBalance(
        mechanism,
        run,
        method,
        functions,
        symbols,
        kernels,
        columns,
        jumps(rows, run.t, symbols.system, symbols.constrained, functions, coordinates),
        None if discrete is None else discrete.at(rows.own),
        integrated,
        basis,
    )


def _of_all_rows(
    samples: Samples, rows: LogRows, log: LoggedForces, kernels: LedgerKernels
) -> RowValues:
    """By quadrature over the smooth pieces of a run."""
    values = at_samples(samples, *_evaluation(kernels.at_samples, log))
    between = values[-kernels.between.n_out :]
    evaluate, rated = _evaluation(kernels.between, log)
    leading = slice(len(kernels.channels), None)
    integral = integrate_pieces(samples, rows.starts, evaluate, between, rated, leading)
    values = values[:, rows.own]
    energies = values[kernels.at_samples.output_slices["energies"]]
    energies = np.vstack([energies, Energies(*energies).K])
    return RowValues(
        np.arange(energies.shape[1]),
        values,
        replace(integral, value=integral.value[rows.own], bar=integral.bar[rows.own]),
        energies.min(axis=1),
        energies.max(axis=1),
    )


@dataclass(frozen=True, eq=False)
class RowBalance:
    """A balance of some rows part by part: from what these come to (`columns`), works, ΔC and the ledger.

    `integrated`: the powers of the testing functions were integrated in the loop; `discrete`: the works of a
    scheme, where these are asked for; `jumped`: what impacts and other jumps did; `basis`: where
    accelerations and logged forces are from.
    """

    mechanism: Mechanism
    run: Trajectory
    method: str
    functions: Sequence[TestingFunction]
    symbols: LedgerSymbols
    kernels: LedgerKernels
    columns: RowValues
    jumped: Jumps
    discrete: DiscreteWork | None
    integrated: bool
    basis: Mapping[str, str]

    @property
    def rows(self) -> NDArray[np.intp]:
        """Places in the run of the ledger's rows."""
        return self.columns.rows

    @cached_property
    def outputs(self) -> dict[str, Array]:
        """Outputs of the kernel at the rows, by name."""
        places = self.kernels.at_samples.output_slices.items()
        return {name: self.columns.outputs[where] for name, where in places}

    @cached_property
    def energies(self) -> Energies:
        """K2, K1, K0 and V (rows,)."""
        return Energies(*self.outputs["energies"])

    def sums(self, name: str) -> list[Work]:
        """The integrals of an output of `between`."""
        where, integral = self.kernels.between.output_slices[name], self.columns.integral
        places = range(where.start, where.stop)
        return [Work(integral.value[:, k], integral.bar[:, k]) for k in places]

    @cached_property
    def growth(self) -> Array:
        """Of rounding, at the rows."""
        return growth_of_rounding(self.columns.rows)

    @cached_property
    def potential(self) -> dict[ChannelName, Array]:
        """V of each source (rows,), J."""
        return dict(zip(self.kernels.potential, self.outputs["potential"]))

    @cached_property
    def power(self) -> dict[ChannelName, Array]:
        """Of each channel of forces (rows,), W."""
        powers = (*self.outputs["conservative"], *self.outputs["channels"])
        return dict(zip(self.kernels.powers, powers))

    @cached_property
    def recorded(self) -> dict[ChannelName, Array]:
        """Works that a solver or a recorder took in the loop (T,), J."""
        works = self.run.works.items() if self.method == "in-loop" else ()
        return {name: work - work[0] for name, work in works}

    @cached_property
    def corrections(self) -> dict[ChannelName, Array]:
        """Work (T,) of what the run was corrected by, by channel, J."""
        integrals, works = self.run.integrals, dict[ChannelName, Array]()
        if ENERGY_CORRECTION in integrals:
            works[ENERGY_CORRECTION] = (
                integrals[ENERGY_CORRECTION] - integrals[ENERGY_CORRECTION][0]
            )
        if self.mechanism.constraints and any(name in integrals for name in CORRECTIONS):
            works[PROJECTION] = _projected(self.run, potential=True)
            works[PROJECTION] = works[PROJECTION] - works.get(ENERGY_CORRECTION, 0.0)
        return works

    @cached_property
    def sampled(self) -> dict[ChannelName, Work]:
        """Works by quadrature, of channels without a potential."""
        return dict(zip(self.kernels.channels, self.sums("channels")))

    @cached_property
    def lost_by_samples(self) -> dict[ChannelName, Work]:
        """Works of channels with a potential, with that of ∂V/∂t by quadrature."""
        return self.lost(self.sampled)

    def lost(self, works: Mapping[ChannelName, Work]) -> dict[ChannelName, Work]:
        """Works of channels with a potential: what it lost; `works` has that of ∂V/∂t."""
        in_time = {n: ChannelName("prescribed", n.element) for n in self.symbols.driven}
        names = self.kernels.conservative
        return {
            name: of_potential(
                self.potential[name],
                works[in_time[name]] if name in in_time else None,
                self.growth,
            )
            for name in names
        }

    @cached_property
    def delta_c(self) -> dict[str, Work]:
        """ΔC of each testing function, with the bar of its quadrature."""
        delta_c: dict[str, Work] = {}
        for function in self.functions:
            E = function.E(self.energies)
            for name, flowed in self._flowed(function):
                delta_c[name] = Work(E - E[0] - (flowed.value - flowed.value[0]), flowed.bar)
        return delta_c

    def _flowed(self, function: TestingFunction) -> Iterator[tuple[str, Work]]:
        """What flowed in by each variant of a testing function: by the solver, a scheme, or quadrature."""
        names, run, nothing = (
            variants(self.symbols, function.name),
            self.run,
            np.zeros(len(self.run)),
        )
        if self.integrated:
            yield from ((n, Work(run.integrals[n], nothing)) for n in names if n in run.integrals)
            return
        jump = self.jumped.functions.get(function.name, 0.0)
        if self.discrete is not None:
            flowed = self.discrete.of(function.name) + jump
            yield from ((name, Work(flowed, nothing)) for name in names)
            return
        potential = self.lost_by_samples
        entering = [
            potential[n] if n in potential else Work.exact(self.recorded[n], "in-loop")
            for n in sorted(self.kernels.entering(function.name))
        ]
        if run.integrals.keys() & BOOKED:
            jump = jump + _projected(run, potential=function.name != "liu-huston")
        integrals = dict(zip(self.kernels.functions, self.sums("functions")))
        for name in names:
            flow = sum(entering, start=integrals[name])
            yield name, Work(flow.value + jump, flow.bar)

    @cached_property
    def of_forces(self) -> dict[ChannelName, Work]:
        """Works of all channels of forces; those recorded are bounded by what the functions leave."""
        if self.discrete is not None:
            nothing, done = np.zeros(len(self.run)), self.discrete.work
            return {n: Work.exact(done.get(n, nothing), "discrete") for n in self.kernels.powers}
        works = dict(self.sampled)
        if self.recorded:
            correction = sum(self.corrections.values())
            errors = [np.abs(d.value + correction) for d in self.delta_c.values()]
            unaccounted = np.maximum.accumulate(np.max(errors, axis=0))
            for name in works.keys() & self.recorded.keys():
                works[name] = in_loop(self.recorded[name], works[name], unaccounted)
        works |= self.lost(works) if self.recorded else self.lost_by_samples
        return {name: works[name] for name in self.kernels.powers}

    def flow(self, rows: slice) -> float:
        """∫Σ|P| dt over some rows as far as it is certain, the sizes of impulses' works added, J."""
        whole = self.columns.flow if rows == slice(0, len(self.rows)) else None
        t, jumped = self.run.t[self.rows][rows], self.jumped.exchanged[self.rows[rows]]
        flow = sum(
            exchanged(work.at(rows), self.power[name][rows], t)
            if whole is None
            else certain(whole[name], work)
            for name, work in self.of_forces.items()
        )
        return flow + float(jumped[-1] - jumped[0])

    def momentum_flow(self, rows: slice) -> dict[str, float]:
        """∫|ṗ_r| dt over some rows, by speed."""
        kernels, columns = self.kernels, self.columns
        if columns.size is not None and rows == slice(0, len(self.rows)):
            sizes = columns.size[kernels.between.output_slices["force"]][len(kernels.momenta) :]
        else:
            rates = np.abs(self.outputs["force"][len(kernels.momenta) :, rows])
            h = np.diff(self.run.t[self.rows[rows]])
            sizes = 0.5 * ((rates[:, 1:] + rates[:, :-1]) * h).sum(axis=1)
        return dict(zip(kernels.speeds, map(float, sizes)))

    @cached_property
    def energy_exchanged(self) -> float:
        """∫Σ|P| dt + range(K) + range(V), as far as it is certain, J."""
        # Of K2, K1, K0, V and K the range of the last two.
        ranges = (self.columns.largest - self.columns.least)[-2:]
        return self.flow(slice(0, len(self.rows))) + float(ranges.sum())

    @cached_property
    def rounding(self) -> Array:
        """Of a balance, at the rows, J."""
        sizes = np.maximum(np.abs(self.columns.least), np.abs(self.columns.largest))[:-1]
        return np.asarray(EPS * (self.energy_exchanged + float(sizes.sum())) * self.growth)

    @cached_property
    def impulsive(self) -> tuple[ChannelName, ...]:
        """Channels of impulses."""
        events = {ChannelName("impact", e.name) for e in self.mechanism.events if e.impulsive}
        return tuple(dict.fromkeys((*events, *self.jumped.work)))

    @cached_property
    def works(self) -> dict[ChannelName, Work]:
        """Those of forces, of impulses, and of corrections."""
        works, nothing = dict(self.of_forces), np.zeros(len(self.columns.rows))
        for name in self.impulsive:
            added = Work.exact(self.jumped.work.get(name, nothing), "events")
            works[name] = works[name] + added if name in works else added
        works |= {n: Work(value, self.rounding, "booked") for n, value in self.corrections.items()}
        if self.method == "in-loop" and "wang" in self.delta_c:
            free = {n: w for n, w in works.items() if n not in self.potential}
            E = self.energies.K + self.energies.V
            flowed = sum(w.value for w in free.values())
            works |= widened(free, np.abs(E - E[0] - flowed - self.delta_c["wang"].value))
        return works

    @cached_property
    def momenta(self) -> tuple[dict[str, Work], dict[str, Work]]:
        """p(t) − p(0) − ∫ṗ dt with its bar: of every momentum balance, and of every speed."""
        kernels, run = self.kernels, self.run
        names, own = (*kernels.momenta, *kernels.speeds), len(kernels.momenta)
        impulses = [self.jumped.momentum.get(name) for name in kernels.momenta]
        impulses += [*self.jumped.speeds.T] or [None] * len(kernels.speeds)
        departures = list[Work]()
        for k, (p, rate, impulse) in enumerate(
            zip(self.outputs["momentum"], self.sums("force"), impulses)
        ):
            flowed, bar = rate.value, rate.bar
            integral = run.integrals.get(f"{MOMENTUM} {names[k]}")
            if self.method == "in-loop" and k >= own and integral is not None:
                flowed, bar = integral - integral[0], np.zeros(len(p))
            if impulse is not None:
                flowed = flowed + impulse
            rounding = self.growth * (EPS * (largest(p) + largest(flowed)))
            departures.append(Work(p - p[0] - flowed, rounding + bar))
        return dict(zip(names[:own], departures)), dict(zip(names[own:], departures[own:]))

    @cached_property
    def ledger(self) -> Ledger:
        """All of it, but for violations."""
        columns, kernels, works = self.columns, self.kernels, self.works
        momentum, delta_p = self.momenta
        nothing = np.zeros(len(columns.rows))
        computed = {n: "measured" if n in self.run.forces else "computed" for n in kernels.powers}
        return Ledger(
            t=self.run.t[columns.rows],
            method=self.method,
            K2=self.energies.K2,
            K1=self.energies.K1,
            K0=self.energies.K0,
            potential=self.potential,
            power=dict.fromkeys(self.impulsive, nothing) | self.power,
            work={name: w.value for name, w in works.items()},
            work_error={name: w.bar for name, w in works.items()},
            work_from={name: w.way for name, w in works.items()},
            delta_c={name: d.value for name, d in self.delta_c.items()},
            error_bar={name: d.bar + self.rounding for name, d in self.delta_c.items()},
            energy_exchanged=self.energy_exchanged,
            momentum={name: departure.value for name, departure in momentum.items()},
            momentum_bar={name: departure.bar for name, departure in momentum.items()},
            violation={},
            basis=computed | dict.fromkeys(self.impulsive, "measured") | dict(self.basis),
            rule="discrete" if self.discrete is not None else columns.integral.rule,
            delta_p={name: departure.value for name, departure in delta_p.items()},
            delta_p_bar={name: departure.bar for name, departure in delta_p.items()},
            momentum_exchanged=self.momentum_flow(slice(0, len(self.rows))),
        )


def residuals(
    mechanism: Mechanism,
    run: Trajectory,
    testing: Sequence[str] | None = None,
    *,
    coordinates: CoordinateMap | None = None,
) -> dict[str, Array]:
    """The testing functions in rate form at every sample: the core of `deltac.residuals`."""
    _require_trajectory(run)
    if run.udot is None:
        raise LogError("residuals need the accelerations u̇ of the run; it has none")
    log = LoggedForces.of(run)
    samples, _ = checked_samples(mechanism, rows_of(replace(run, events=())), log)
    symbols = ledger_symbols(mechanism, log, coordinates, _start(samples))
    _check_division(symbols, samples)
    tied = coordinates is None and dependent_speeds(
        equations_of_motion(mechanism), *_start(samples)
    )
    if isinstance(testing, str):
        testing = (testing,)
    names = (*applicable(constrained=tied), MOMENTUM) if testing is None else testing
    functions = testing_functions(names, constrained=tied)
    kernel = residual_kernel(symbols, functions, momenta=MOMENTUM in names)
    residual = _at_samples(kernel, samples, log)
    columns = residual.keys() & {"coordinates", MOMENTUM}
    return residual | {name: residual[name].reshape(len(run), -1) for name in columns}


def _require_trajectory(run: object) -> None:
    if isinstance(run, Trajectory):
        return
    remedy = ""
    if isinstance(run, str | PathLike):
        remedy = "; use deltac.read_trajectory(file)"
    elif hasattr(run, "member"):
        remedy = "; use ensemble.member(k)"
    kind = repr(run) if isinstance(run, str) else type(run).__name__
    raise WrongType(f"run: expected a Trajectory, found {kind}{remedy}")


def _method(run: Trajectory, work: str | None) -> str:
    if work is None:
        in_loop = any(n in run.integrals for n in TESTING_FUNCTIONS) or _recorded(run)
        return "in-loop" if in_loop else "samples"
    check_names([work], WORK_METHODS, "unknown way to take the work,")
    if work == "in-loop" and not run.integrals and not run.works:
        raise LogError(
            "the run holds no integrals and no works taken in the loop; use work='samples', or simulate with "
            "record=dc.Record(testing=...)"
        )
    return work


def _recorded(run: Trajectory) -> frozenset[ChannelName]:
    """Channels of which the run holds both forces and works: what acted, and what that did."""
    return frozenset(run.works.keys() & run.forces.keys())


def _require_same_division(run: Trajectory, coordinates: CoordinateMap | None) -> None:
    """Kane–Levinson's E = K2 − K0 + V and its P must be divided by the same generalized speeds."""
    noted = run.provenance.coordinates
    map_of_run = CoordinateMap(**noted) if noted else None
    if (map_of_run and map_of_run.digest) != (coordinates and coordinates.digest):
        own = f"in the own speeds {', '.join(map_of_run.speeds)}" if map_of_run else ""
        of = own or "in the mechanism's speeds"
        raise ModelError(
            f"coordinates: the integrals of Kane–Levinson's functions in this run were taken {of}; give "
            "balance none, so that it takes the same, or work='samples'"
        )


def _check_division(symbols: LedgerSymbols, samples: Samples) -> None:
    """Own speeds must satisfy the constraints wherever they divide the motion."""
    if symbols.split is None or symbols.constrained is None:
        return
    rows = np.unique(np.linspace(0, len(samples.t) - 1, SOME_ROWS).astype(np.intp))
    t, q = samples.t[rows], samples.smooth["q"].values[rows].T
    check_split(symbols.system, symbols.split, symbols.constrained.rows, t, q, np.empty(0))


def _chosen(
    run: Trajectory, method: str, testing: Sequence[str] | None, *, tied: bool, integrated: bool
) -> Sequence[str]:
    if isinstance(testing, str):
        testing = (testing,)
    if testing is not None and not len(testing):
        raise ArgumentsError("testing: no function is named; leave it out to have all of them")
    if testing is not None and not {*testing} - {MOMENTUM}:
        testing = ("wang", MOMENTUM)
    if integrated:
        chosen = (
            [*(n for n in TESTING_FUNCTIONS if n in run.integrals), MOMENTUM]
            if testing is None
            else testing
        )
        for name in chosen:
            if name in TESTING_FUNCTIONS and name not in run.integrals:
                raise LogError(
                    f"the power of {name!r} was not integrated in the loop (available: "
                    f"{', '.join(run.integrals)}); simulate with record=, or use work='samples'"
                )
        return list(chosen)
    if method == "discrete":
        chosen = ("liu-huston", "wang", MOMENTUM) if testing is None else testing
        for name in chosen:
            if name in TESTING_FUNCTIONS and name not in ("liu-huston", "wang"):
                raise ArgumentsError(
                    f"{name!r} has no discrete work: its power is no force times speed; use "
                    "'liu-huston', 'wang', or work='samples'"
                )
        return chosen
    if testing is not None:
        return testing
    return (*applicable(constrained=tied), MOMENTUM)


PROJECTION = ChannelName("correction", "projection")
"""The channel of what projections alone did."""


def _projected(run: Trajectory, *, potential: bool) -> Array:
    """Energy that projections and corrections added since the first sample (T,)."""
    total = np.zeros(len(run))
    for name in CORRECTIONS if potential else CORRECTIONS[:1]:
        if name in run.integrals:
            total = total + run.integrals[name] - run.integrals[name][0]
    return total


def _compiled(
    mechanism: Mechanism,
    log: LoggedForces,
    functions: Sequence[TestingFunction],
    speeds: CoordinateMap | None,
    potential: Law | str | None,
    start: tuple[float, Array],
    recorded: frozenset[ChannelName],
    *,
    momenta: bool,
) -> tuple[LedgerSymbols, LedgerKernels]:
    """Traced and compiled once for logs of the same mechanism that hold the same forces and works."""
    symbols = ledger_symbols(mechanism, log, speeds, start)
    if potential is not None:
        symbols = symbols.with_potential(potential)
    recorded = recorded.intersection(part.name for part in symbols.parts)
    key = ("ledger", tuple(function.name for function in functions), recorded, momenta)
    logged = log.places.keys()
    make = partial(ledger_kernels, symbols, functions, logged, recorded, momenta=momenta)
    return symbols, symbols.once(key, make)


def _start(samples: Samples) -> tuple[float, Array]:
    """Time and free coordinates of the first sample."""
    return float(samples.t[0]), samples.smooth["q"].values[0]


def _at_samples(kernel: Kernel, samples: Samples, log: LoggedForces) -> dict[str, Array]:
    """The outputs of a kernel at the samples, (T,) for each scalar and (T, n) for a column."""
    values = at_samples(samples, *_evaluation(kernel, log))
    places = kernel.output_slices.items()
    return {name: values[p][0] if p.stop - p.start == 1 else values[p].T for name, p in places}


def _evaluation(kernel: Kernel, log: LoggedForces) -> tuple[Powers, tuple[str, ...]]:
    """A kernel as a function of times and quantities there, (rows, m), and what it needs rates of.

    A result is overwritten by the next call in the same thread.
    """
    rated = ("u",) if "udot" in kernel.input_names else ()
    buffers = threading.local()

    def evaluate(t: Array, between: Between) -> Array:
        if getattr(buffers, "size", None) != len(t):
            buffers.size = len(t)
            buffers.x = np.empty((kernel.n_in, len(t)))
            buffers.y = np.empty((kernel.n_out, len(t)))
        x = buffers.x
        for name, where in kernel.input_slices.items():
            if name == "t":
                x[where] = t
            elif name == "udot":
                x[where] = between.rates["u"].T
            elif name == "logged":
                for channel, place in log.columns.items():
                    x[where][place] = between.values[f"force {channel}"].T
            else:
                x[where] = between.values[name].T
        return kernel.flat(x, out=buffers.y).T

    kernel.compile()
    return evaluate, rated
