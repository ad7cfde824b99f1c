"""What a study says of what it measured: what it notices, one function a check, and its verdict by rules."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from deltac.arrays import ROUGHLY, SAME, SMALL_SHARE, TINY, max_norm
from deltac.diagnosis.inputs.omissions import impacts_not_held
from deltac.diagnosis.study.convergence import (
    CLEAR,
    FEWEST_TIMES,
    Convergence,
    order_of,
    order_text,
)
from deltac.diagnosis.study.curves import ComparedRuns, by_unit
from deltac.diagnosis.study.result import Study
from deltac.diagnosis.study.runs import corrections
from deltac.diagnosis.verdict import LEAST_ORDER, Confidence, Finding, Verdict, VerdictKind, percent
from deltac.energy import Ledger
from deltac.mechanism import Mechanism
from deltac.trajectories import Trajectory

# --- what is noticed besides the verdict ---------------------------------------------------------


def of_comparison(compared: ComparedRuns, knob: str) -> Iterator[Finding]:
    """Few common times; runs of different length; a horizon before the end."""
    runs = compared.runs
    spans = [(float(r.run.t[0]), float(r.run.t[-1])) for r in runs]
    ends = [end for _, end in spans]
    span = max(end - start for start, end in spans)
    if max(ends) - min(ends) > 1e-6 * span:
        yield Finding(
            "other-times",
            "the runs do not cover the same time; they are compared where all of them have rows",
            ", ".join(f"{knob} {r.step:g}: to {e:.6g} s" for r, e in zip(runs, ends)),
            "End all runs at the same time",
        )
    if len(compared.t) < FEWEST_TIMES:
        yield Finding(
            "few-common-times",
            f"the runs have only {len(compared.t)} times in common, so the motions cannot be compared well",
            f"rows that agree within {SAME:g} of the duration",
            "Choose steps that divide each other (0.01, 0.005, 0.0025), or sample all runs at the same times",
        )
    elif compared.horizon < compared.t[-1] - SAME * span:
        fine, coarse = runs[-1].step, runs[max(-len(runs), -3)].step
        yield Finding(
            "horizon",
            f"the motions at {knob}s {coarse:g} to {fine:g} diverge at t = {compared.horizon:.4g} s, and "
            "convergence is judged up to there",
            f"from there on their states differ by more than a tenth of their ranges: coarse {knob}s, or a "
            "chaotic motion, in which every error grows exponentially",
            f"If smaller {knob}s diverge hardly later, the motion is chaotic: no {knob} predicts it for "
            "longer",
        )


def of_order(state: Convergence, nominal: int | None, solver: str) -> Iterator[Finding]:
    """An observed order that is not the solver's own."""
    if nominal is None:
        return
    if state.order is not None and state.trend == "tends to a limit":
        error = state.order_error or 0.0
        if state.order + error < nominal - LEAST_ORDER:
            yield Finding(
                "order-below-nominal",
                f"the motion converges at order {order_text(state)}, below the {nominal} of {solver}",
                f"by differences of the states at steps {', '.join(f'{h:g}' for h in state.steps)}",
                "Either a force is not smooth (dry friction, contact, a table of values, a controller held "
                "over the step), or the start violates the constraints, or the solver has a bug",
            )


def of_corrections(ledger: Ledger, function: str, allowed: float) -> Iterator[Finding]:
    """A run that was stabilised: one of the two ways to count its corrections is blind."""
    work = corrections(ledger)
    if not work:
        return
    name, largest = max(work.items(), key=lambda item: max_norm(item[1]))
    done = max_norm(largest)
    ways = [max_norm(x) for x in (ledger.delta_c[function], ledger.uncorrected(function))]
    if done <= allowed or 2.0 * min(ways) > max(ways):  # within a factor of two none is blind
        return
    yield Finding(
        "stabilised",
        f"the run is corrected as it goes ({name}), so one way of computing ΔC is blind to the error",
        f"corrections did up to {done:.2g} J of work, {percent(done / ledger.energy_exchanged)} of the "
        "energy exchanged; "
        f"|ΔC| is {ways[0]:.2g} J with it and {ways[1]:.2g} J without",
        "The larger one is taken as the error; use a method that needs no corrections to see its own",
        element=name,
    )


def of_constraints(compared: ComparedRuns, tolerance: float, *, trusted: bool) -> Iterator[Finding]:
    """Constraints, driven joints or quaternions that are violated though energy may be kept.

    A violation that stays, however small the step, is none of the integrator: the model's constraint is
    another than the motion's. Motions that have parted say nothing of that.
    """
    runs = compared.runs
    finest = runs[-1]
    for name, values in finest.ledger.violation.items():
        what, _, element = name.partition(" ")
        column = finest.run.u if what in ("velocity", "speed") else finest.run.q
        span = float(np.ptp(column, axis=0).max(initial=0.0))
        worst = float(values.max(initial=0.0))
        if worst <= max(1e-6, tolerance * span):
            continue
        sizes = [float(r.ledger.violation[name].max()) for r in runs]
        together = [
            float(r.ledger.violation[name][rows[: compared.within]].max(initial=0.0))
            for r, rows in zip(runs, compared.rows)
        ]
        stays = (
            len(together) > 1
            and compared.within >= FEWEST_TIMES
            and together[-1] > max(1e-6, tolerance * span)
            and order_of(compared.steps[[0, -1]], together[0], together[-1]) < LEAST_ORDER
        )
        blamed = stays and not trusted and what != "quaternion"
        yield Finding(
            "constraint-violation",
            f"{what} {element!r} is violated, even if the energy balance holds"
            + (
                ", at every step alike"
                if stays
                else "; less so at smaller steps" * (len(sizes) > 1)
            ),
            f"by up to {', '.join(f'{s:.2g}' for s in sizes)}",
            "Check the geometry or the motion of that constraint in the model, and where the motion starts"
            if stays
            else "Use a projection, or a smaller step",
            "cause" if blamed else "note",
            element,
        )


def of_momentum(momentum: Mapping[str, Convergence], finest: Ledger) -> Iterator[Finding]:
    """Momentum balances that do not close, however small the step."""
    for name, convergence in momentum.items():
        if convergence.trend == "tends to a limit":
            yield Finding(
                "momentum",
                f"the balance of {name} does not hold: it is off by {convergence.limit:.3g}, however small "
                "the step",
                f"± {convergence.limit_error:.1g}",
                "A force or a gyroscopic term is wrong or missing; energy reveals it only if it does work",
                element=name,
            )


def of_impacts(mechanism: Mechanism, run: Trajectory) -> Iterator[Finding]:
    """Impacts whose work the run does not hold: seen in its speeds, or else to be feared of its model."""
    jumps = list(_jumps(mechanism, run))
    yield from jumps or impacts_not_held(mechanism, run)


def _jumps(mechanism: Mechanism, run: Trajectory) -> Iterator[Finding]:
    """Speeds that jump between two rows, as in an impact that no channel holds."""
    if len(run) < 5 or any(n.kind in ("impact", "contact") for n in run.forces):
        return
    change = np.abs(np.diff(run.u, axis=0))
    top = by_unit(np.abs(run.u).max(axis=0), [entry.unit for entry in mechanism.speeds])
    around = np.maximum(change[:-2], change[2:])
    # A constant speed that begins to change is no jump: compare with the changes that are usual.
    usual = np.median(change, axis=0)
    sudden = (ROUGHLY * change[1:-1] > np.maximum(around, usual)) & (
        change[1:-1] > SMALL_SHARE * np.maximum(top, TINY)
    )
    if not sudden.any():
        return
    row, k = np.argwhere(sudden)[0]
    yield Finding(
        "impacts",
        "speeds jump between rows, as in impacts",
        f"{int(sudden.any(axis=1).sum())} times, first {run.speeds[k]!r} at t = {run.t[row + 1]:.4g} s",
        "Log the work or the force of impacts (channel 'impact …'), or compare up to the first of them",
        element=run.speeds[k],
    )


# --- the verdict, by rules in the order in which they apply -----------------------------------------

STUDY_LIMITS: tuple[str, ...] = (
    "an error shared by motion and model, such as the same wrong mass in both",
    "a wrong force that does no work, where the runs have no accelerations",
    "the inaccuracy of an energy-conserving method; see the order of the state",
)

BLOCKING = ("impacts", "few-common-times", "assumed-zero")
"""Findings that explain why ΔC may stay at a value though the equations are right."""


def judge_study(m: Study) -> Verdict:
    """The verdict on a study that has none yet, with the findings that it has.

    What was misread cannot be judged. Wrong equations show at the states of the runs, where no integration
    enters, in constraints, in momenta, or in what ΔC tends to. Of right ones an error is the integrator's.
    Where neither is known, it is that if ΔC falls with the step and nothing tells why a mistake might too.
    """
    base = (_energy(m), _state(m), _equations(m))

    def verdict(kind: VerdictKind, confidence: Confidence, meaning: str, *more: str) -> Verdict:
        return Verdict(kind, confidence, (*base, *more), m.findings, _limits(m), meaning)

    def unresolved(why: str, *more: str) -> Verdict:
        return verdict("unresolved", "high", f"The runs do not decide: {why}.", *more)

    error, bar = m.errors[-1], m.bars[-1]
    doubts = dict.fromkeys(f.what for f in m.findings if f.weight == "doubt")
    if doubts:
        return unresolved("; ".join(doubts))
    if mistake := _mistake(m):
        return verdict("equation-error", *mistake)
    if m.blown_up and not m.equations_right:
        return unresolved("even the finest run blows up", _advice(m))
    if m.ledger.still:
        return unresolved("hardly anything moves; use a run in which energy is exchanged")
    if bar > m.allowed and error <= CLEAR * bar and not m.blown_up:
        return unresolved(
            f"the uncertainty of the work, {bar:.2g} J, is as large as the energy error; log at a higher "
            "rate, or with more digits"
        )
    if error <= m.allowed and not m.blown_up:
        return verdict("consistent", _sure(m), _small(m))
    if reasons := _hiding(m):
        return unresolved(*reasons)
    if m.energy.trend == "falls to zero":
        return verdict("integration-error", _sure(m), _falling(m), *_hidden(m))
    return verdict("integration-error", "high" if m.blown_up else "medium", _coarse(m))


def _mistake(m: Study) -> tuple[Confidence, str] | None:
    """What shows that the equations are wrong, and how surely; None for nothing."""
    if m.residuals is not None and m.residuals.stays and max(m.residuals.by_step) > m.tolerance:
        return "high", _wrong_equations(m)
    violated = [
        f.what for f in m.findings if f.kind == "constraint-violation" and f.weight == "cause"
    ]
    if violated:
        return "medium", f"The motion is not a motion of this model: {'; '.join(violated)}."
    if m.equations_right or m.has(*BLOCKING):
        return None
    if _wrong_limit(m) and m.residuals is None:
        return "medium", _wrong_equations(m)
    momenta = [
        name
        for name, convergence in m.momentum.items()
        if convergence.trend == "tends to a limit"
        and convergence.limit > CLEAR * max(convergence.floors)
    ]
    # While ΔC still falls with the step, what the steps leave of the momenta may look like a limit.
    falling = m.errors[-1] > m.allowed and m.energy.trend == "falls to zero"
    if not momenta or m.blown_up or falling:
        return None
    return "medium", (
        f"The balance of momentum ({', '.join(momenta)}) does not close, however small the step: a force is "
        "wrong or missing, possibly one that does no work."
    )


def _hiding(m: Study) -> tuple[str, ...]:
    """Why the error may hide a mistake, with advice; empty for equations that are known to be right."""
    limit = f"ΔC tends to {m.energy.limit:.3g} J, "
    if m.energy.trend == "falls to zero":
        if m.equations_right:
            return ()
        if m.mechanism.constraints and m.has("order-below-nominal"):
            return _mended(m), _advice(m)
        unsettled = m.state.trend == "does not settle" and len(m.steps) > 2
        return (_unsettled(m), _advice(m)) if unsettled else ()
    if impacts := [f.what for f in m.findings if f.kind == "impacts"]:
        return (f"{impacts[0]}: the runs do not hold the energy that impacts dissipate",)
    if m.trusted or (m.equations_right and not _wrong_limit(m)):
        return ()
    if not _wrong_limit(m):
        return _why(m), _advice(m)
    if blocked := [f.what for f in m.findings if f.kind in BLOCKING]:
        return (f"{limit}but {blocked[0]}",)
    return (
        f"{limit}yet the equations of motion hold at the samples: something happens between them that is in "
        "no channel, or the model's constraints are not those of the motion",
    )


def _wrong_limit(m: Study) -> bool:
    """Whether ΔC tends to a limit that is not zero, and no floor of the data explains it."""
    c = m.energy
    return c.trend == "tends to a limit" and c.limit > max(m.allowed, CLEAR * max(m.bars))


def _sure(m: Study) -> Confidence:
    return "high" if m.equations_right and m.resolved else "medium"


def _limits(m: Study) -> tuple[str, ...]:
    """What this study does not see; more where steps are few, or energy is kept whatever they are."""
    more = []
    if len(m.steps) < 3:
        more.append(f"what a third {m.knob} would show: {_few(m)}")
    floor = m.energy.trend == "at its floor" and m.ledger.method == "in-loop"
    if floor and m.state.trend == "tends to a limit":
        order = "" if m.state.order is None else f", which falls at order {order_text(m.state)}"
        more.append(
            "the inaccuracy of this motion, because this method conserves energy by construction: the "
            f"finest two {m.knob}s differ by {m.state.sizes[-1]:.1g} of the range of the motion{order}"
        )
    return (*STUDY_LIMITS, *more)


# --- words ----------------------------------------------------------------------------------------


def at_step(m: Study) -> str:
    """How the finest step is named: "h = 0.001 s", or "tolerance 1e-08"."""
    return f"h = {m.steps[-1]:g} s" if m.unit else f"tolerance {m.steps[-1]:g}"


def _amount(m: Study) -> str:
    energy = m.ledger.reference_energy
    return f"at {at_step(m)} it is {m.errors[-1]:.2g} J of {energy:.3g} J that the system has"


def _falling(m: Study) -> str:
    order = (
        " without a clear order" if m.energy.order is None else f" at order {order_text(m.energy)}"
    )
    if m.until is None:
        amount = _amount(m)
    else:
        order += f" up to t = {m.until:.4g} s, where the runs diverge"
        amount = (
            f"at {at_step(m)} it is {m.energy.sizes[-1]:.2g} J by then, and at most {m.errors[-1]:.2g} J of "
            f"{m.ledger.reference_energy:.3g} J that the system has in the whole run"
        )
    return f"The error is the integrator's; it falls{order}; {amount}.{_unresolved_motion(m)}"


def _unresolved_motion(m: Study) -> str:
    if m.resolved or len(m.steps) < 3:
        return ""
    return (
        f" The {m.knob}s do not resolve the motion: the runs do not converge as they are refined."
    )


def _hidden(m: Study) -> tuple[str, ...]:
    """What could still hide behind the error of the steps, where the equations were not tested."""
    bound = max(m.energy.limit, m.energy.limit_error)
    if m.equations_right or not math.isfinite(bound):
        return ()
    return (f"A mistake whose ΔC is less than {bound:.2g} J would not show at these {m.knob}s",)


def _small(m: Study) -> str:
    if m.energy.trend == "falls to zero" and m.energy.order is not None:
        return f"The energy balance holds. {_falling(m)}"
    return f"The energy balance holds: {_amount(m)}."


def _mended(m: Study) -> str:
    assert m.nominal is not None
    return (
        f"ΔC falls with the {m.knob}, yet the motion converges at order {order_text(m.state)} where the "
        f"method should have {m.nominal}: non-smooth forces cause this, and so do wrong forces that the "
        f"projection onto the constraints hides"
    )


def _unsettled(m: Study) -> str:
    return (
        f"ΔC falls with the {m.knob} ({_amount(m)}), but the motion does not converge at these {m.knob}s, "
        "and an error of the equations could hide behind theirs"
    )


def _coarse(m: Study) -> str:
    if len(m.steps) < 3 and not m.blown_up:
        return (
            f"The error is the integrator's, since the equations are right; {_amount(m)}. {_few(m)}: study "
            f"three {m.knob}s, each {'half' if m.unit else 'a tenth'} of the previous one."
        )
    what = "even the finest run blows up" if m.blown_up else "nothing converges"
    return (
        f"The error is the integrator's: the equations are right, yet {what} at these {m.knob}s; "
        f"{_amount(m)}. Take smaller ones, or an implicit method."
    )


def _wrong_equations(m: Study) -> str:
    limit = m.energy.limit
    if m.energy.trend == "tends to a limit":
        return (
            f"The error does not vanish as the {m.knob} is refined: it tends to {limit:.2g} J. The "
            "equations, the forces or the model are wrong."
        )
    return (
        "The motion does not obey the model's equations, at any step; the equations, the forces or the "
        f"model are wrong. |ΔC|: {_amount(m)}."
    )


def _energy(m: Study) -> str:
    sizes = ", ".join(f"{x:.2g}" for x in m.errors)
    text = (
        f"Largest |ΔC| {sizes} J at {'h' if m.unit else 'tolerance'} = "
        f"{', '.join(f'{h:g}' for h in m.steps)}{' s' if m.unit else ''}; the last is {percent(m.relative)} "
        f"of {m.ledger.reference_energy:.3g} J that the system has, tolerance {100 * m.tolerance:g} %"
    )
    if m.energy.order is not None and m.energy.trend != "tends to a limit":
        text += f"; order {order_text(m.energy)}"
    if m.energy.trend == "tends to a limit":
        text += f"; limit {m.energy.limit:.3g} ± {m.energy.limit_error:.1g} J"
    return text


def _few(m: Study) -> str:
    """Why fewer than three steps say little."""
    if len(m.steps) == 1:
        return f"One {m.knob} gives no order"
    return f"Two {m.knob}s cannot confirm an order"


def _state(m: Study) -> str:
    nominal = "" if m.nominal is None else f" (nominal order {m.nominal})"
    if m.state.order is not None:
        return f"The motion converges at order {order_text(m.state)}{nominal}"
    if m.state.trend == "at its floor":
        return f"The motions at all {m.knob}s agree to rounding"
    if len(m.steps) < 3:
        return f"{_few(m)}{nominal}"
    return f"The motion does not converge at these {m.knob}s{nominal}"


def _equations(m: Study) -> str:
    if m.trusted:
        return "The motion was computed from the model's own equations"
    if m.residuals is None:
        return "The equations of motion were not tested at the samples: there are no measured accelerations"
    if m.residuals.closes:
        return "The equations of motion hold at the samples"
    worst = percent(max(m.residuals.relative.max(initial=0.0), m.residuals.by_step[-1]))
    how = (
        f"; that falls with the {m.knob} at order {m.residuals.order:.1f}"
        if m.residuals.order > 0.0 and not m.residuals.stays
        else ""
    )
    return f"The equations of motion have a residual of up to {worst} of their terms at the samples{how}"


def _why(m: Study) -> str:
    if len(m.steps) < 3:
        return f"{_few(m)}: what ΔC tends to shows from three on"
    if m.energy.trend == "at its floor":
        return (
            f"what is left of ΔC, {m.errors[-1]:.2g} J, is hardly above the error bar of the work, "
            f"{m.bars[-1]:.2g} J"
        )
    if m.energy.trend == "tends to a limit":
        return (
            f"ΔC seems to tend to {m.energy.limit:.2g} J, which is no more than the tolerance or than the "
            "uncertainty of the work"
        )
    return f"ΔC neither falls nor tends to a limit at these {m.knob}s"


def _advice(m: Study) -> str:
    accelerations = (
        "" if m.residuals is not None else ", and log the accelerations u̇ of the same instants"
    )
    if m.unit:
        smaller = [f"{m.steps[-1] / part:g}" for part in (2, 4, 8)]
        return f"Study smaller steps, such as {smaller[0]}, {smaller[1]} and {smaller[2]} s{accelerations}"
    return f"Study tighter tolerances{accelerations}"
