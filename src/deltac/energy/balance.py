"""`balance`: from a mechanism and a trajectory, of whatever origin, to a ledger."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
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
from deltac.energy.discrete import DiscreteWork, discrete_work
from deltac.energy.ledger import Ledger, worst_rows
from deltac.energy.one_pass import OnePass, in_one_pass
from deltac.energy.prepare import checked_samples, violations
from deltac.energy.sampling.quadrature import Integral
from deltac.energy.sampling.samples import Between, Powers, Samples, at_samples
from deltac.energy.sampling.segments import Jumps, Rows, integrate_pieces, jumps, rows_of
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
from deltac.errors import ArgumentsError, LogError, ModelError, UnknownName, WrongType
from deltac.kernels import Kernel
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.laws import Law
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

WORK = ("in-loop", "samples", "discrete")
DIVISIONS = 64
"""Samples at which own speeds are held against the constraints."""


def balance(
    mechanism: Mechanism,
    run: Trajectory,
    work: str | None = None,
    testing: Sequence[str] | None = None,
    *,
    coordinates: CoordinateMap | None = None,
    potential: Law | str | None = None,
    keep: int | None = None,
) -> Ledger:
    """Evaluate the energy testing functions on a trajectory: the core of `deltac.balance`."""
    _require_trajectory(run)
    if potential is not None and work not in (None, "samples"):
        raise ArgumentsError(
            f"potential: ΔC with a V of your own is taken along the samples, not {work!r}; leave work out"
        )
    method = _method(run, work if potential is None else "samples")
    if keep is not None and keep < 1:
        raise ArgumentsError(
            f"keep={keep}: expected how many rows the ledger is to keep, 1 or more"
        )
    noted = run.provenance.coordinates
    if coordinates is None and noted and method == "in-loop":
        coordinates = CoordinateMap(**noted)
    rows = rows_of(run)
    log = LoggedForces.of(rows if rows.starts else run)
    samples, basis = checked_samples(mechanism, rows, log)
    tied = coordinates is None and dependent_speeds(
        equations_of_motion(mechanism), *_start(samples)
    )
    integrated = method == "in-loop" and any(n in run.integrals for n in TESTING_FUNCTIONS)
    names = _chosen(run, method, testing, tied=tied, integrated=integrated)
    functions = testing_functions(names, constrained=tied)
    if integrated and any(f.name.startswith("kane-levinson") for f in functions):
        _require_same_division(run, coordinates)
    recorded = _recorded(run) if method == "in-loop" and not integrated else frozenset()
    momenta, start = MOMENTUM in names, _start(samples)
    symbols, kernels = _compiled(
        mechanism, log, functions, coordinates, potential, start, recorded, momenta=momenta
    )
    _check_division(symbols, samples)
    one_pass = None
    if method == "samples" and not run.integrals.keys() & BOOKED:
        one_pass = in_one_pass(samples, log, symbols, kernels, functions, keep)
    if one_pass is None:
        columns = _Columns.of_all_rows(samples, rows, log, kernels)
    else:
        columns = _Columns.of_pass(one_pass, kernels)
    jumped = jumps(rows, run.t, symbols.system, symbols.constrained, functions, coordinates)
    discrete = None
    if method == "discrete":
        discrete = discrete_work(symbols, rows, samples, log).at(rows.own)
    taken = {n: run.works[n] - run.works[n][0] for n in run.works if method == "in-loop"}
    if integrated:
        delta_c, bars = _integrated(functions, symbols, columns, run)
    else:
        delta_c, bars = _sampled(functions, symbols, kernels, columns, run, jumped, taken, discrete)

    # The works: those of forces, of impulses, and of corrections.
    t, parts = run.t[columns.rows], columns.energies
    growth = growth_of_rounding(columns.rows)
    corrected = _corrections(mechanism, run)
    power = dict(
        zip(kernels.powers, (*columns.outputs["conservative"], *columns.outputs["channels"]))
    )
    potentials = dict(zip(kernels.potential, columns.outputs["potential"]))
    if discrete is not None:
        nothing = np.zeros(len(run))
        works = {n: Work.exact(discrete.work.get(n, nothing), "discrete") for n in kernels.powers}
    else:
        left = [d + sum(corrected.values()) for d in delta_c.values()]
        works = _works(symbols, kernels, columns, taken, left)
    flow = sum(columns.exchanged(name, w, power[name], t) for name, w in works.items())
    # Of K2, K1, K0, V and K; the range of the last two is exchanged.
    energy_exchanged = flow + jumped.exchanged + float((columns.largest - columns.least)[-2:].sum())
    sizes = np.maximum(np.abs(columns.least), np.abs(columns.largest))[:-1]
    rounding = EPS * (energy_exchanged + float(sizes.sum())) * growth
    impulsive = {ChannelName("impact", e.name) for e in mechanism.events if e.impulsive}
    for name in dict.fromkeys((*impulsive, *jumped.work)):
        added = Work.exact(jumped.work.get(name, np.zeros(len(t))), "events")
        works[name] = works[name] + added if name in works else added
        power.setdefault(name, np.zeros(len(t)))
        basis.setdefault(name, "measured")
    works |= {name: Work(value, rounding, "booked") for name, value in corrected.items()}
    if method == "in-loop" and "wang" in delta_c:
        free = {n: w for n, w in works.items() if n not in potentials}
        E = parts.K + parts.V
        missing = np.abs(E - E[0] - sum(w.value for w in free.values()) - delta_c["wang"])
        works |= widened(free, missing)
    momentum, delta_p = _momenta(kernels, columns, run, jumped, growth, in_loop=method == "in-loop")
    violation = violations(mechanism, run)
    ledger = Ledger(
        t=t,
        method=method,
        K2=parts.K2,
        K1=parts.K1,
        K0=parts.K0,
        potential=potentials,
        power=power,
        work={name: w.value for name, w in works.items()},
        work_error={name: w.bar for name, w in works.items()},
        work_from={name: w.way for name, w in works.items()},
        delta_c=delta_c,
        error_bar={name: bar + rounding for name, bar in bars.items()},
        energy_exchanged=energy_exchanged,
        momentum={name: departure.value for name, departure in momentum.items()},
        momentum_bar={name: departure.bar for name, departure in momentum.items()},
        violation=violation if one_pass is None else {},
        basis={
            **{n: "measured" if n in run.forces else "computed" for n in kernels.powers},
            **basis,
        },
        rule="discrete" if discrete is not None else columns.rule,
        delta_p={name: departure.value for name, departure in delta_p.items()},
        delta_p_bar={name: departure.bar for name, departure in delta_p.items()},
        momentum_exchanged=dict(zip(kernels.speeds, map(float, columns.momentum_exchanged))),
    )
    if keep is None:
        return ledger
    places = columns.rows
    if one_pass is None:
        places = worst_rows(ledger, places, len(run), keep)
        ledger = ledger.at(places)
    violation = {n: np.maximum.reduceat(v, places) for n, v in violation.items()}
    return replace(ledger, violation=violation)


@dataclass(frozen=True, eq=False)
class _Columns:
    """What kernels and quadrature say of the rows of a ledger, whichever way they were taken.

    `rows` are their places in the run, `outputs` the kernel's values there, each (n, rows), `sums` the
    integrals of those of `between`, by `rule`. Over all rows of the run were taken: the `least` and `largest`
    K2, K1, K0, V and K; ∫|ṗ_r| dt, `momentum_exchanged`; and `flow`, ∫|P| dt by channel, where the rows are
    only some of the run's.
    """

    rows: NDArray[np.intp]
    outputs: dict[str, Array]
    sums: dict[str, list[Work]]
    rule: str
    least: Array
    largest: Array
    momentum_exchanged: Array
    flow: Mapping[ChannelName, float] | None

    @staticmethod
    def of_all_rows(
        samples: Samples, rows: Rows, log: LoggedForces, kernels: LedgerKernels
    ) -> _Columns:
        """By quadrature over the smooth pieces of a run."""
        values = at_samples(samples, *_evaluation(kernels.at_samples, log))
        between = values[-kernels.between.n_out :]
        evaluate, rated = _evaluation(kernels.between, log)
        leading = slice(len(kernels.channels), None)
        integral = integrate_pieces(samples, rows.starts, evaluate, between, rated, leading)
        outputs, sums = _by_name(kernels, values[:, rows.own], integral, rows.own)
        energies = np.vstack([outputs["energies"], Energies(*outputs["energies"]).K])
        rates = np.abs(outputs["force"][len(kernels.momenta) :])
        t = samples.t[rows.own]
        return _Columns(
            np.arange(len(t)),
            outputs,
            sums,
            integral.rule,
            energies.min(axis=1),
            energies.max(axis=1),
            0.5 * ((rates[:, 1:] + rates[:, :-1]) * np.diff(t)).sum(axis=1),
            None,
        )

    @staticmethod
    def of_pass(one_pass: OnePass, kernels: LedgerKernels) -> _Columns:
        """What one pass kept."""
        outputs, sums = _by_name(kernels, one_pass.known, one_pass.integral, slice(None))
        size = one_pass.size[kernels.between.output_slices["force"]][len(kernels.momenta) :]
        rule, extremes = one_pass.integral.rule, (one_pass.least, one_pass.largest)
        return _Columns(one_pass.rows, outputs, sums, rule, *extremes, size, one_pass.flow)

    @property
    def energies(self) -> Energies:
        """K2, K1, K0 and V (rows,)."""
        return Energies(*self.outputs["energies"])

    def lost(
        self, symbols: LedgerSymbols, kernels: LedgerKernels, works: Mapping[ChannelName, Work]
    ) -> dict[ChannelName, Work]:
        """Works of channels with a potential: what it lost; `works` has that of ∂V/∂t."""
        potential = dict(zip(kernels.potential, self.outputs["potential"]))
        in_time = {n: ChannelName("prescribed", n.element) for n in symbols.driven}
        growth = growth_of_rounding(self.rows)
        return {
            name: of_potential(
                potential[name], works[in_time[name]] if name in in_time else None, growth
            )
            for name in kernels.conservative
        }

    def exchanged(self, name: ChannelName, work: Work, power: Array, t: Array) -> float:
        """∫|P| dt of a channel over all rows of the run, as far as it is certain (J)."""
        return exchanged(work, power, t) if self.flow is None else certain(self.flow[name], work)


def _by_name(
    kernels: LedgerKernels, values: Array, integral: Integral, own: NDArray[np.intp] | slice
) -> tuple[dict[str, Array], dict[str, list[Work]]]:
    """Outputs of a ledger's kernel and their integrals, by name."""
    outputs = {name: values[where] for name, where in kernels.at_samples.output_slices.items()}
    sums = {
        name: [
            Work(integral.value[own, k], integral.bar[own, k])
            for k in range(where.start, where.stop)
        ]
        for name, where in kernels.between.output_slices.items()
    }
    return outputs, sums


def _integrated(
    functions: Sequence[TestingFunction], symbols: LedgerSymbols, columns: _Columns, run: Trajectory
) -> tuple[dict[str, Array], dict[str, Array]]:
    """ΔC of each testing function (T,) by the solver's integrals, which have no error of quadrature."""
    parts, delta_c = columns.energies, dict[str, Array]()
    for function in functions:
        E = function.E(parts)
        for name in variants(symbols, function.name):
            if name in run.integrals:
                flowed = run.integrals[name]
                delta_c[name] = E - E[0] - (flowed - flowed[0])
    return delta_c, {name: np.zeros(len(run)) for name in delta_c}


def _sampled(
    functions: Sequence[TestingFunction],
    symbols: LedgerSymbols,
    kernels: LedgerKernels,
    columns: _Columns,
    run: Trajectory,
    jumped: Jumps,
    taken: Mapping[ChannelName, Array],
    discrete: DiscreteWork | None,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """ΔC of each testing function (T,) by quadrature or by `discrete` work, and the bar of that.

    `taken` are works that a recorder took, of channels whose powers the kernels lack.
    """
    integrals, parts = dict(zip(kernels.functions, columns.sums["functions"])), columns.energies
    potential = columns.lost(
        symbols, kernels, dict(zip(kernels.channels, columns.sums["channels"]))
    )
    delta_c: dict[str, Array] = {}
    bars: dict[str, Array] = {}
    for function in functions:
        E = function.E(parts)
        entering = [
            potential[name] if name in potential else Work.exact(taken[name], "in-loop")
            for name in sorted(kernels.entering(function.name))
        ]
        for name in variants(symbols, function.name):
            if discrete is not None:
                flowed, bar = discrete.of(function.name), np.zeros(len(run))
            else:
                flow = sum(entering, start=integrals[name])
                flowed, bar = flow.value, flow.bar
                if run.integrals.keys() & BOOKED:
                    flowed = flowed + _projected(run, potential=function.name != "liu-huston")
            flowed = flowed + jumped.functions.get(function.name, 0.0)
            delta_c[name] = E - E[0] - (flowed - flowed[0])
            bars[name] = bar
    return delta_c, bars


def _works(
    symbols: LedgerSymbols,
    kernels: LedgerKernels,
    columns: _Columns,
    taken: Mapping[ChannelName, Array],
    left: Sequence[Array],
) -> dict[ChannelName, Work]:
    """Works of all channels of forces; those `taken` are bounded by what the functions `left`."""
    works = dict(zip(kernels.channels, columns.sums["channels"]))
    if taken:
        unaccounted = np.maximum.accumulate(np.abs(left).max(axis=0))
        for name in works.keys() & taken.keys():
            works[name] = in_loop(taken[name], works[name], unaccounted)
    works |= columns.lost(symbols, kernels, works)
    return {name: works[name] for name in kernels.powers}


def _momenta(
    kernels: LedgerKernels,
    columns: _Columns,
    run: Trajectory,
    jumped: Jumps,
    growth: Array,
    *,
    in_loop: bool,
) -> tuple[dict[str, Work], dict[str, Work]]:
    """p(t) − p(0) − ∫ṗ dt (T,) with its bar: of every momentum balance, and of every speed."""
    names = (*kernels.momenta, *kernels.speeds)
    impulses = [jumped.momentum.get(name) for name in kernels.momenta]
    impulses += [*jumped.speeds.T] or [None] * len(kernels.speeds)
    departures: list[Work] = []
    own = len(kernels.momenta)
    for k, (p, rate, impulse) in enumerate(
        zip(columns.outputs["momentum"], columns.sums["force"], impulses)
    ):
        flowed, bar = rate.value, rate.bar
        integral = run.integrals.get(f"{MOMENTUM} {names[k]}")
        if in_loop and k >= own and integral is not None:
            flowed, bar = integral - integral[0], np.zeros(len(p))
        if impulse is not None:
            flowed = flowed + impulse
        rounding = growth * EPS * (largest(p) + largest(flowed))
        departures.append(Work(p - p[0] - flowed, bar + rounding))
    return dict(zip(names[:own], departures)), dict(zip(names[own:], departures[own:]))


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
    found = repr(run) if isinstance(run, str) else type(run).__name__
    raise WrongType(f"run: expected a Trajectory, found {found}{remedy}")


def _method(run: Trajectory, work: str | None) -> str:
    if work is None:
        in_loop = any(n in run.integrals for n in TESTING_FUNCTIONS) or _recorded(run)
        return "in-loop" if in_loop else "samples"
    if work not in WORK:
        raise UnknownName(f"unknown way to take the work, {work!r}; known: {', '.join(WORK)}")
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
    taken, _, names = run.provenance.notes.get("coordinates", "").partition(
        " "
    )  # schema 3, before 0.3
    if noted:
        known = CoordinateMap(**noted)
        taken, names = known.digest, ", ".join(known.speeds)
    if taken != ("" if coordinates is None else coordinates.digest):
        of = f"in the own speeds {names}" if taken else "in the mechanism's speeds"
        raise ModelError(
            f"coordinates: the integrals of Kane–Levinson's functions in this run were taken {of}; give "
            "balance none, so that it takes the same, or work='samples'"
        )


def _check_division(symbols: LedgerSymbols, samples: Samples) -> None:
    """Own speeds must satisfy the constraints wherever they divide the motion."""
    if symbols.split is None or symbols.constrained is None:
        return
    rows = np.unique(np.linspace(0, len(samples.t) - 1, DIVISIONS).astype(np.intp))
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


CORRECTIONS = ("correction kinetic", "correction potential")
"""Integrals in which a run books what projections and corrections of the energy did to K and V."""

ENERGY_CORRECTION = ChannelName("correction", "energy")
"""The integral that holds the latter's part of both, and the channel of that work."""

PROJECTION = ChannelName("correction", "projection")

BOOKED = {ENERGY_CORRECTION, *CORRECTIONS}


def _corrections(mechanism: Mechanism, run: Trajectory) -> dict[ChannelName, Array]:
    """Work (T,) of what a run was corrected by, by channel."""
    works: dict[ChannelName, Array] = {}
    if ENERGY_CORRECTION in run.integrals:
        works[ENERGY_CORRECTION] = (
            run.integrals[ENERGY_CORRECTION] - run.integrals[ENERGY_CORRECTION][0]
        )
    if mechanism.constraints and any(name in run.integrals for name in CORRECTIONS):
        works[PROJECTION] = _projected(run, potential=True) - works.get(ENERGY_CORRECTION, 0.0)
    return works


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
    found = at_samples(samples, *_evaluation(kernel, log))
    places = kernel.output_slices.items()
    return {name: found[p][0] if p.stop - p.start == 1 else found[p].T for name, p in places}


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
