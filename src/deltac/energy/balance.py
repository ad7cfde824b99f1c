"""`balance`: from a mechanism and a trajectory, of whatever origin, to a ledger."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike

import numpy as np

from deltac.arrays import EPS, Array
from deltac.dynamics.coordinates import check_split
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.dynamics.independence import dependent_speeds
from deltac.dynamics.terms import Energies
from deltac.dynamics.testing_functions import (
    TESTING_FUNCTIONS,
    TestingFunction,
    applicable,
    testing_functions,
)
from deltac.energy.discrete import discrete_work
from deltac.energy.ledger import Ledger, worst_rows
from deltac.energy.one_pass import in_one_pass
from deltac.energy.prepare import checked_samples, violations
from deltac.energy.sampling.samples import Between, Powers, Samples, at_samples
from deltac.energy.sampling.segments import integrate_pieces, jumps, rows_of
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
    keep: int | None = None,
) -> Ledger:
    """Evaluate the energy testing functions on a trajectory: the core of `deltac.balance`."""
    _require_trajectory(run)
    method = _method(run, work)
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
    functions = testing_functions(
        _chosen(run, method, testing, tied=tied, integrated=integrated), constrained=tied
    )
    if integrated and any(f.name.startswith("kane-levinson") for f in functions):
        _require_same_division(run, coordinates)
    recorded = _recorded(run) if method == "in-loop" and not integrated else frozenset()
    symbols, kernels = _compiled(mechanism, log, functions, coordinates, _start(samples), recorded)
    _check_division(symbols, samples)
    passed = None
    if method == "samples" and not run.integrals.keys() & BOOKED:
        passed = in_one_pass(samples, log, symbols, kernels, functions, keep)
    t = run.t
    if passed is None:
        sampled = at_samples(samples, *_evaluation(kernels.at_samples, log))
        known = sampled[-kernels.between.n_out :]
        evaluate, rated = _evaluation(kernels.between, log)
        leading = slice(len(kernels.channels), None)
        found = integrate_pieces(samples, rows.starts, evaluate, known, rated, leading)
        own, places = rows.own, np.arange(len(t))
    else:
        sampled, found, own, places = passed.known, passed.integral, slice(None), passed.rows
        t = t[places]
    here = {
        name: sampled[where][:, own] for name, where in kernels.at_samples.output_slices.items()
    }
    power = dict(zip(kernels.powers, (*here["conservative"], *here["channels"])))
    sums = {
        name: [Work(found.value[own, k], found.bar[own, k]) for k in _range(where)]
        for name, where in kernels.between.output_slices.items()
    }
    parts = Energies(*here["energies"])
    jumped = jumps(rows, run.t, symbols.system, symbols.constrained, functions, coordinates)
    discrete = None
    if method == "discrete":
        discrete = discrete_work(symbols, rows, samples, log).at(rows.own)

    # The testing functions.
    integrals = dict(zip(kernels.functions, sums["functions"]))
    potential = dict(zip(kernels.potential, here["potential"]))
    quadrature = dict(zip(kernels.channels, sums["channels"]))
    growth = growth_of_rounding(places)
    in_time = {n: ChannelName("prescribed", n.element) for n in symbols.driven}

    def lost(name: ChannelName, works: Mapping[ChannelName, Work]) -> Work:
        """The work of a channel with a potential; `works` has that of ∂V/∂t."""
        explicit = works[in_time[name]] if name in in_time else None
        return of_potential(potential[name], explicit, growth)

    taken = {n: run.works[n] - run.works[n][0] for n in run.works if method == "in-loop"}
    delta_c: dict[str, Array] = {}
    bars: dict[str, Array] = {}
    for function in functions:
        E = function.E(parts)
        entering = [
            lost(name, quadrature)
            if name in kernels.conservative
            else Work.exact(taken[name], "in-loop")
            for name in sorted(kernels.entering(function.name))
        ]
        for name in variants(symbols, function.name):
            if integrated:
                if name not in run.integrals:
                    continue
                flowed, bar = run.integrals[name], np.zeros(len(run))
            elif discrete is not None:
                flowed, bar = discrete.of(function.name), np.zeros(len(run))
            else:
                flow = sum(entering, start=integrals[name])
                flowed, bar = flow.value, flow.bar
                if passed is None:
                    flowed = flowed + _projected(run, potential=function.name != "liu-huston")
            if not integrated:
                flowed = flowed + jumped.functions.get(function.name, 0.0)
            delta_c[name] = E - E[0] - (flowed - flowed[0])
            bars[name] = bar

    # The works: those of forces, of impulses, and of corrections.
    corrected = _corrections(mechanism, run)
    if discrete is not None:
        nothing = np.zeros(len(run))
        works = {n: Work.exact(discrete.work.get(n, nothing), "discrete") for n in kernels.powers}
    else:
        works = dict(quadrature)
        if taken:
            left = [d + sum(corrected.values()) for d in delta_c.values()]
            unaccounted = np.maximum.accumulate(np.abs(left).max(axis=0))
            for name in works.keys() & taken.keys():
                works[name] = in_loop(taken[name], quadrature[name], unaccounted)
        works |= {name: lost(name, works) for name in kernels.conservative}
        works = {name: works[name] for name in kernels.powers}
    if passed is None:
        flows = [exchanged(w, power[name], t) for name, w in works.items()]
        energies = np.vstack([here["energies"], parts.K])
        least, largest = energies.min(axis=1), energies.max(axis=1)
    else:
        flows = [certain(passed.flow[name], w) for name, w in works.items()]
        least, largest = passed.least, passed.largest
    energy_exchanged = (
        sum(flows) + jumped.exchanged + float((largest - least)[-2:].sum())
    )  # V and K
    scale = energy_exchanged + float(np.maximum(np.abs(least), np.abs(largest))[:-1].sum())
    rounding = EPS * scale * growth
    bars = {name: bar + rounding for name, bar in bars.items()}
    impulsive = {ChannelName("impact", e.name) for e in mechanism.events if e.impulsive}
    for name in dict.fromkeys((*impulsive, *jumped.work)):
        added = Work.exact(jumped.work.get(name, np.zeros(len(t))), "events")
        works[name] = works[name] + added if name in works else added
        power.setdefault(name, np.zeros(len(t)))
        basis.setdefault(name, "measured")
    works |= {name: Work(value, rounding, "booked") for name, value in corrected.items()}
    if method == "in-loop" and "wang" in delta_c:
        free = {n: w for n, w in works.items() if n not in potential}
        E = parts.K + parts.V
        missing = np.abs(E - E[0] - sum(w.value for w in free.values()) - delta_c["wang"])
        works |= widened(free, missing)
    momentum, momentum_bar = _momenta(kernels, here["momentum"], sums["force"], jumped.momentum)
    violation = violations(mechanism, run)
    ledger = Ledger(
        t=t,
        method=method,
        K2=parts.K2,
        K1=parts.K1,
        K0=parts.K0,
        potential=potential,
        power=power,
        work={name: w.value for name, w in works.items()},
        work_error={name: w.bar for name, w in works.items()},
        work_from={name: w.way for name, w in works.items()},
        delta_c=delta_c,
        error_bar=bars,
        energy_exchanged=energy_exchanged,
        momentum=momentum,
        momentum_bar=momentum_bar,
        violation=violation if passed is None else {},
        basis={
            **{n: "measured" if n in run.forces else "computed" for n in kernels.powers},
            **basis,
        },
        rule="discrete" if discrete is not None else found.rule,
    )
    if keep is None:
        return ledger
    if passed is None:
        places = worst_rows(ledger, np.arange(len(run)), len(run), keep)
        ledger = ledger.at(places)
    violation = {n: np.maximum.reduceat(v, places) for n, v in violation.items()}
    return replace(ledger, violation=violation)


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
    functions = testing_functions(
        applicable(constrained=tied) if testing is None else testing, constrained=tied
    )
    found = _at_samples(residual_kernel(symbols, functions), samples, log)
    found["coordinates"] = found["coordinates"].reshape(len(run), -1)
    return found


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
    if integrated:
        chosen = (
            [n for n in TESTING_FUNCTIONS if n in run.integrals] if testing is None else testing
        )
        for name in chosen:
            if name in TESTING_FUNCTIONS and name not in run.integrals:
                raise LogError(
                    f"the power of {name!r} was not integrated in the loop (available: "
                    f"{', '.join(run.integrals)}); simulate with record=, or use work='samples'"
                )
        return list(chosen)
    if method == "discrete":
        chosen = ("liu-huston", "wang") if testing is None else testing
        for name in chosen:
            if name in TESTING_FUNCTIONS and name not in ("liu-huston", "wang"):
                raise ArgumentsError(
                    f"{name!r} has no discrete work: its power is no force times speed; use "
                    "'liu-huston', 'wang', or work='samples'"
                )
        return chosen
    if testing is not None:
        return testing
    return applicable(constrained=tied)


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
    start: tuple[float, Array],
    recorded: frozenset[ChannelName],
) -> tuple[LedgerSymbols, LedgerKernels]:
    """Traced and compiled once for logs of the same mechanism that hold the same forces and works."""
    symbols = ledger_symbols(mechanism, log, speeds, start)
    recorded = recorded.intersection(part.name for part in symbols.parts)
    key = ("ledger", tuple(function.name for function in functions), recorded)
    return symbols, symbols.once(
        key, lambda: ledger_kernels(symbols, functions, log.places.keys(), recorded)
    )


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


def _range(where: slice) -> range:
    return range(where.start, where.stop)


def _momenta(
    kernels: LedgerKernels,
    momentum: Array,
    sums: Sequence[Work],
    impulses: Mapping[str, Array],
) -> tuple[dict[str, Array], dict[str, Array]]:
    """h(t) − h(0) − ∫ force dt of every momentum balance (T,), with its bar."""
    departures: dict[str, Array] = {}
    bars: dict[str, Array] = {}
    for name, h, force in zip(kernels.momenta, momentum, sums):
        impulse = force.value + impulses[name] if name in impulses else force.value
        departures[name] = h - h[0]
        departures[name] -= impulse
        bars[name] = force.bar + 8 * EPS * (largest(h) + largest(impulse))
    return departures, bars
