"""`balance`: from a mechanism and a trajectory, of whatever origin, to a ledger."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np

from deltac.arrays import Array
from deltac.caching import LRUCache
from deltac.dynamics.terms import Energies
from deltac.dynamics.testing_functions import (
    TESTING_FUNCTIONS,
    TestingFunction,
    applicable,
    testing_functions,
)
from deltac.energy.discrete import discrete_work
from deltac.energy.ledger import Ledger
from deltac.energy.prepare import checked_samples, violations
from deltac.energy.sampling.quadrature import Integral
from deltac.energy.sampling.samples import Between, Powers, Samples, at_samples
from deltac.energy.sampling.segments import integrate_pieces, jumps, rows_of
from deltac.energy.terms import (
    LedgerSymbols,
    LoggedForces,
    energies,
    ledger_kernel,
    ledger_symbols,
    powers,
    residual_kernel,
    variants,
)
from deltac.errors import InputError
from deltac.kernels import Kernel
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism, require_mechanism
from deltac.trajectories import Trajectory

WORK = ("in-loop", "samples", "discrete")
EPS = float(np.finfo(np.float64).eps)


def balance(
    mechanism: Mechanism,
    run: Trajectory,
    work: str | None = None,
    testing: Sequence[str] | None = None,
    *,
    speeds: CoordinateMap | None = None,
) -> Ledger:
    """Evaluate the energy testing functions on a trajectory.

    Args:
        mechanism: the model that the motion is tested against.
        run: the motion. Forces that it holds are used in place of the model's own, and channels that the
            model does not have are added.
        work: how the power is integrated. "in-loop": by the integrals that the solver took (the default
            where the run has them). "samples": by quadrature along the samples. "discrete": forces held
            over a step do the work h fᵀ(u_k + u_{k+1})/2, for engines that step so.
        testing: names of testing functions; by default those integrated in the loop, or all.
        speeds: generalized speeds in which the kinetic energy is divided (Kane–Levinson).

    Returns:
        The ledger; works and turnover are always taken along the samples.

    Raises:
        InputError: the run is not one of this mechanism, has too few samples, lacks a motor's force, or
            lacks the integrals asked for.
    """
    require_mechanism(mechanism)
    _require_trajectory(run)
    method = _method(run, work)
    tied = bool(mechanism.constraints)
    functions = testing_functions(_chosen(run, method, testing, tied=tied), constrained=tied)
    rows = rows_of(run)
    log = LoggedForces.of(rows)
    samples, basis = checked_samples(mechanism, rows, log)
    compiled = _compiled(mechanism, log, functions, speeds, _start(samples))
    symbols, kernel, names = compiled.symbols, compiled.between, compiled.powers
    sampled = at_samples(samples, *_evaluation(compiled.at_samples, log))
    energy_at = {n: e[rows.own] for n, e in zip(compiled.energies, sampled)}
    known = sampled[len(compiled.energies) :]
    channel_names = [n.removeprefix("power ") for n in names if n.startswith("power ")]
    channel_powers = {n: p[rows.own] for n, p in zip(channel_names, known)}
    barred = slice(len(channel_names), None)
    evaluate, rated = _evaluation(kernel, log)
    every = integrate_pieces(samples, rows.starts, evaluate, known, rated, barred)
    integral = replace(every, value=every.value[rows.own], bar=every.bar[rows.own])
    jumped = jumps(rows, run.t, symbols.system, symbols.constrained, functions, speeds)
    delta_c: dict[str, Array] = {}
    bars: dict[str, Array] = {}
    potential = {n.removeprefix("V "): e for n, e in energy_at.items() if n.startswith("V ")}
    parts = Energies(*(energy_at[name] for name in ("K2", "K1", "K0", "V")))
    V = parts.V
    # Trapezoids: the turnover is a scale, not a balance.
    flow = np.trapezoid(sampled[compiled.energies.index("flow")], rows.t)
    turnover = float(flow + np.ptp(parts.K) + np.ptp(V)) + jumped.turnover
    scale = sum(float(np.abs(e).max()) for e in (parts.K2, parts.K1, parts.K0, V)) + turnover
    rounding = EPS * scale * (4.0 + np.sqrt(np.arange(len(run))))
    discrete = None
    if method == "discrete":
        discrete = discrete_work(symbols, rows, samples, log).at(rows.own)
    for function in functions:
        E = function.E(parts)
        for name in variants(symbols, function.name):
            if method == "in-loop":
                if name not in run.integrals:
                    continue
                flowed, bar = run.integrals[name], np.zeros(len(run))
            elif discrete is not None:
                flowed, bar = discrete.of(function.name), np.zeros(len(run))
            else:
                flowed = integral.value[:, names.index(f"P {name}")]
                bar = _bar(integral, names, f"P {name}")
                flowed = flowed + _projected(run, potential=function.name != "liu-huston")
            if method != "in-loop":
                flowed = flowed + jumped.functions.get(function.name, 0.0)
            delta_c[name] = E - E[0] - (flowed - flowed[0])
            bars[name] = bar + rounding
    works = {
        n: integral.value[:, names.index(f"power {n}")] if discrete is None else discrete.work[n]
        for n in channel_names
    }
    silent = {f"impact {e.name}": np.zeros(len(run)) for e in mechanism.events if e.impulsive}
    for name, work_of_impulses in (silent | dict(jumped.work)).items():
        works[name] = works.get(name, np.zeros(len(run))) + work_of_impulses
        channel_powers.setdefault(name, np.zeros(len(run)))
        basis.setdefault(name, "measured")
    works.update(_corrections(mechanism, run))
    momentum, momentum_bar = _momenta(energy_at, integral, names, jumped.momentum)
    return Ledger(
        t=run.t,
        method=method,
        K2=parts.K2,
        K1=parts.K1,
        K0=parts.K0,
        potential=potential,
        power=channel_powers,
        work=works,
        delta_c=delta_c,
        error_bar=bars,
        turnover=turnover,
        momentum=momentum,
        momentum_bar=momentum_bar,
        violation=violations(mechanism, run),
        basis={
            **{n: "measured" if n in run.forces else "computed" for n in channel_names},
            **basis,
        },
        rule="discrete" if discrete is not None else integral.rule,
    )


def residuals(
    mechanism: Mechanism,
    run: Trajectory,
    testing: Sequence[str] | None = None,
    *,
    speeds: CoordinateMap | None = None,
) -> dict[str, Array]:
    """The testing functions in rate form, ε = Ė − P (W), at every sample: no integration at all.

    Returns ε (T,) by the function's name, and under ``"coordinates"`` the residual F_r + F*_r (T, n) of
    Kane's equations for the free speeds (N·m or N). Needs the run's accelerations.

    Raises InputError as `balance`, and for a run without u̇.
    """
    if run.udot is None:
        raise InputError("residuals need the accelerations u̇ of the run; it has none")
    log = LoggedForces.of(run)
    samples, _ = checked_samples(mechanism, rows_of(replace(run, events=())), log)
    symbols = ledger_symbols(mechanism, log, speeds, _start(samples))
    tied = bool(mechanism.constraints)
    functions = testing_functions(
        applicable(constrained=tied) if testing is None else testing, constrained=tied
    )
    found = _at_samples(residual_kernel(symbols, functions), samples, log)
    shaped = {n.removeprefix("rate "): value for n, value in found.items()}
    shaped["coordinates"] = shaped["coordinates"].reshape(len(run), -1)
    return shaped


def _require_trajectory(run: object) -> None:
    if isinstance(run, Trajectory):
        return
    remedy = ""
    if isinstance(run, str | PathLike):
        remedy = "; use deltac.read_trajectory(file)"
    elif hasattr(run, "member"):
        remedy = "; use ensemble.member(k)"
    found = repr(run) if isinstance(run, str) else type(run).__name__
    raise InputError(f"run: expected a Trajectory, found {found}{remedy}")


def _method(run: Trajectory, work: str | None) -> str:
    if work is None:
        return "in-loop" if any(n in run.integrals for n in TESTING_FUNCTIONS) else "samples"
    if work not in WORK:
        raise InputError(f"unknown way to take the work, {work!r}; known: {', '.join(WORK)}")
    if work == "in-loop" and not run.integrals:
        raise InputError(
            "the run holds no integrals taken in the loop; use work='samples', or simulate with testing="
        )
    return work


def _chosen(
    run: Trajectory, method: str, testing: Sequence[str] | None, *, tied: bool
) -> Sequence[str]:
    if isinstance(testing, str):
        testing = (testing,)
    if method == "in-loop":
        chosen = (
            [n for n in TESTING_FUNCTIONS if n in run.integrals] if testing is None else testing
        )
        for name in chosen:
            if name in TESTING_FUNCTIONS and name not in run.integrals:
                raise InputError(
                    f"the power of {name!r} was not integrated in the loop (there are: "
                    f"{', '.join(run.integrals)}); simulate with testing=, or use work='samples'"
                )
        return list(chosen)
    if method == "discrete":
        chosen = ("liu-huston", "wang") if testing is None else testing
        for name in chosen:
            if name in TESTING_FUNCTIONS and name not in ("liu-huston", "wang"):
                raise InputError(
                    f"{name!r} has no discrete work: its power is no force times speed; use "
                    "'liu-huston', 'wang', or work='samples'"
                )
        return chosen
    if testing is not None:
        return testing
    return applicable(constrained=tied)


CORRECTIONS = ("correction kinetic", "correction potential")
"""Integrals in which a run books what projections and corrections of the energy did to K and V."""

ENERGY_CORRECTION = "correction energy"
"""The integral that holds the latter's part of both."""


def _corrections(mechanism: Mechanism, run: Trajectory) -> dict[str, Array]:
    """Work (T,) of what a run was corrected by, by channel."""
    works: dict[str, Array] = {}
    if ENERGY_CORRECTION in run.integrals:
        works[ENERGY_CORRECTION] = (
            run.integrals[ENERGY_CORRECTION] - run.integrals[ENERGY_CORRECTION][0]
        )
    if mechanism.constraints and any(name in run.integrals for name in CORRECTIONS):
        works["correction projection"] = _projected(run, potential=True) - works.get(
            ENERGY_CORRECTION, 0.0
        )
    return works


def _projected(run: Trajectory, *, potential: bool) -> Array:
    """Energy that projections and corrections added since the first sample (T,)."""
    total = np.zeros(len(run))
    for name in CORRECTIONS if potential else CORRECTIONS[:1]:
        if name in run.integrals:
            total = total + run.integrals[name] - run.integrals[name][0]
    return total


@dataclass(frozen=True, eq=False)
class _Compiled:
    """The kernels of a ledger: all that is wanted at the samples, and powers alone between them."""

    symbols: LedgerSymbols
    energies: list[str]
    powers: list[str]
    at_samples: Kernel
    between: Kernel


_KEPT: LRUCache[_Compiled] = LRUCache(16)


def _compiled(
    mechanism: Mechanism,
    log: LoggedForces,
    functions: Sequence[TestingFunction],
    speeds: CoordinateMap | None,
    start: tuple[float, Array],
) -> _Compiled:
    """Traced and compiled once for logs of the same mechanism that hold the same forces."""

    def make() -> _Compiled:
        symbols = ledger_symbols(mechanism, log, speeds, start)
        power = powers(symbols, functions)
        energy = energies(symbols, power)
        both = ledger_kernel(symbols, energy | power)
        return _Compiled(symbols, list(energy), list(power), both, ledger_kernel(symbols, power))

    # Where the run starts decides which rows of the constraints are independent.
    where = (start[0], start[1].tobytes()) if mechanism.constraints else None
    forces = tuple((name, tuple(places)) for name, places in log.places.items())
    names = tuple(function.name for function in functions)
    return _KEPT.get((mechanism.digest(), forces, names, speeds, where), make)


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

    A result is to be used before the next call in the same thread, which overwrites it.
    """
    rated = ("u",) if "udot" in kernel.input_names else ()
    buffers = threading.local()

    def evaluate(t: Array, between: Between) -> Array:
        if getattr(buffers, "size", None) != len(t):
            buffers.size = len(t)
            buffers.x, buffers.y = (np.empty((n, len(t))) for n in (kernel.n_in, kernel.n_out))
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


def _bar(integral: Integral, names: Sequence[str], name: str) -> Array:
    """Bars are there for the last columns only."""
    return integral.bar[:, names.index(name) - len(names)]


def _momenta(
    energy: Mapping[str, Array],
    integral: Integral,
    names: Sequence[str],
    impulses: Mapping[str, Array],
) -> tuple[dict[str, Array], dict[str, Array]]:
    """h(t) − h(0) − ∫ force dt of every momentum balance, with its bar."""
    departures: dict[str, Array] = {}
    bars: dict[str, Array] = {}
    for key in names:
        if key.startswith("rate "):
            impulse, bar = integral.value[:, names.index(key)], _bar(integral, names, key)
            name = key.removeprefix("rate ")
            impulse = impulse + impulses.get(name, 0.0)
            h = energy[f"momentum {name}"]
            departures[name] = h - h[0] - impulse
            bars[name] = bar + 8 * EPS * float(np.abs(h).max() + np.abs(impulse).max())
    return departures, bars
