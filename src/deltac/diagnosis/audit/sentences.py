"""The evidence of a verdict in sentences."""

from __future__ import annotations

import math

import numpy as np

from deltac.diagnosis.audit.facts import HALF, Facts
from deltac.diagnosis.audit.measures import Measures
from deltac.diagnosis.residuals.at_samples import EquationTerms
from deltac.diagnosis.residuals.one_step import OneStep
from deltac.diagnosis.verdict import percent

FEW = 6
"""Methods that are named at most where several close, and times at most that are listed."""


# --- the numbers that every verdict rests on ---


def numbers(f: Facts) -> tuple[str, ...]:
    """The balance and the equations."""
    return (_balance(f), *_equations(f))


def _balance(f: Facts) -> str:
    m = f.energy
    share = m.left / m.beside if m.beside > 0.0 else 0.0
    what = f"{m.beside:.4g} J that the system has ({m.energy_exchanged:.4g} J exchanged)"
    part = f"; {_error(f.judged)} in one part between gaps" if m.gaps else ""
    return (
        f"Largest |ΔC| {_error(m)} ({m.method}), {percent(share)} of the {what}; the tolerance is "
        f"{100 * m.tolerance:g} %{part}"
    )


def _error(m: Measures) -> str:
    return f"{m.left:.3g} J ± {m.bar:.2g} J"


def _equations(f: Facts) -> tuple[str, ...]:
    told = () if f.step is None else (_by_steps(f.step),)
    if f.terms is not None:
        return (*told, _at_samples(f.terms))
    return told or (
        "The equations of motion were not tested: there are no measured accelerations, and the one-step "
        "test does not apply",
    )


def _by_steps(step: OneStep) -> str:
    """What the one-step test says."""
    scheme = step.scheme
    by = "a step of an integrator"
    if scheme is not None and (scheme.name or scheme.among):
        several = f"one step of several methods ({', '.join(scheme.among[:FEW])})"
        by = f"a step of {scheme.name}" if scheme.name else several
    if step.closes and scheme is not None:
        left = step.by_scheme()
        out = 0 if left is None else int(left.unclosed.sum())
        return (
            f"Each of {step.rows} rows{f' but {out}' if out else ''} follows from the previous one by {by}, "
            f"to {max(scheme.defect, 1e-16):.1g} of the accelerations: the motion obeys the model's equations"
        )
    r = step.residual
    if not step.significant.any():
        k = int(np.argmax(r.bar / r.scale))
        return (
            f"Over {step.rows} rows, each follows from the previous one as far as an unknown integrator, the "
            f"digits of the log and the unknown motion between rows permit: {percent(r.bar[k] / r.scale[k])} "
            f"of the terms ({step.speeds[k]})"
        )
    k = int(np.argmax(np.where(step.significant, r.relative, 0.0)))
    terms = f"{percent(r.relative[k])} of the terms of {step.speeds[k]!r}"
    if step.known_but_for_causes:
        return (
            f"Each of {len(r.t)} rows follows from the previous one by {by}, except for {terms}; one cause "
            f"explains all but {percent(1.0 / r.ratio[k])} of that"
        )
    return (
        f"Over {step.rows} rows, the next does not follow from the previous one by the model's equations: "
        f"{terms} remain, {r.ratio[k]:.2g} times what any integrator, the digits and the noise can explain"
    )


def _at_samples(terms: EquationTerms) -> str:
    """What the equations leave at the samples."""
    at, largest = f"At {len(terms.t)} samples", float(terms.relative.max(initial=0.0))
    if not terms.significant.any():
        to = f"{largest:.1g} of their terms" if largest else "rounding"
        return f"{at} the equations of motion hold to {to}"
    k = int(np.argmax(np.where(terms.significant, terms.relative, 0.0)))
    return (
        f"{at} the equations of motion have a residual of up to {percent(terms.relative[k])} of their terms "
        f"({terms.speeds[k]}), {terms.size[k] / terms.precision[k]:.2g} times what the log's precision "
        "explains"
    )


# --- what each rule adds ---


def contradiction(f: Facts) -> str:
    """Doubts."""
    named = ", ".join(dict.fromkeys(x.kind for x in f.doubts))
    return f"The log contradicts itself ({named}); correct it first"


def impacts(f: Facts) -> str:
    """Impacts that the run does not tell of."""
    return str(f.impacts)


def may_be_unlogged(f: Facts) -> str:
    """A cause, or a force that the log lacks."""
    alike = "; ".join(x.what for x in f.findings if x.weight == "cause")
    return f"It may be {alike}; or a force that the log lacks: {_lacking(f)}"


def unlogged(f: Facts) -> str:
    """No cause, and a force that the log lacks."""
    return f"What is missing may be forces that the log lacks: {_lacking(f)}"


def _lacking(f: Facts) -> str:
    return f.lacking.evidence if f.lacking else ""


def named(f: Facts) -> tuple[str, ...]:
    """The numbers beside a cause; equations closed by forces as logged do not speak for the model."""
    if f.closed_at_samples:
        return (_balance(f),)
    slight = ("The resulting energy error is within the tolerance",) if f.energy.within else ()
    return (*numbers(f), *slight)


def accounted(f: Facts) -> str:
    """The energy of the residual."""
    return f"The residual of the equations accounts for {f.accounted:.3g} J of the energy error"


def no_known_cause(_: Facts) -> str:
    """A residual without a name."""
    return (
        "No known cause explains the residual from row to row, and the integrator is unknown: log every "
        "step, with more digits"
    )


def smaller_step(f: Facts) -> str:
    """The integrator's remedy."""
    step = f.energy.step
    if step is None:
        return "Use a smaller step, or a method of higher order"
    return f"The step was {step:g} s: use a smaller one, or a method of higher order"


def idle(f: Facts) -> tuple[str, ...]:
    """The kinetic energy as the scale."""
    m = f.energy
    return (
        f"Hardly any energy is exchanged ({m.energy_exchanged:.3g} J), so the kinetic energy is the scale: "
        f"largest |ΔC| {_error(m)} ({m.method}) of {m.kinetic:.4g} J; the tolerance is "
        f"{100 * m.tolerance:g} %",
        *_equations(f),
    )


def nothing_moves(f: Facts) -> str:
    """Rounding."""
    return (
        f"Almost nothing moves: the energy exchanged, {f.energy.energy_exchanged:.3g} J, is at rounding "
        "level. Use a run in which energy flows"
    )


def missing_rows(f: Facts) -> str:
    """Gaps."""
    return (
        "Rows are missing (see the gap below), and what happened there is unknown; between gaps, the energy "
        f"error is at most {_error(f.judged)}"
    )


def by_steps(f: Facts) -> str:
    """Rows that tell more than the balance."""
    m = f.judged
    because = f"At {1.0 / m.spacing:.4g} Hz"
    if m.noise > HALF * m.bar:
        because = "With the digits of the log and the noise on it,"
    return f"{because} the energy is known only to ± {m.bar:.2g} J; the verdict rests on the one-step test"


def sampling(f: Facts) -> str:
    """Which sampling rate, or how much less noise, would bring the error bar to where it decides."""
    m = f.judged
    if m.noise > HALF * m.bar:
        return (
            "The digits of the log and the noise on it leave the energy uncertain by ± "
            f"{m.bar:.2g} J, {m.bar / m.allowed:.2g} times the tolerance: log with more digits, or less noise"
        )
    order = min(max(m.order, 1.0), 8.0)
    if m.bar > m.allowed:
        wanted = m.allowed
        now = f"The error bar of the samples dominates at {1.0 / m.spacing:.4g} Hz"
    else:
        wanted = max(m.left - m.allowed, 0.1 * m.bar)
        now = f"The energy error exceeds the tolerance by less than its error bar at {1.0 / m.spacing:.4g} Hz"
    # What was held does not fall with the spacing; a whole order is counted on.
    excess = max(m.bar - m.held, 0.0) / max(wanted - m.held, 0.01 * wanted)
    rate = max(excess, 1.0) ** (1.0 / math.floor(order)) / m.spacing
    rate = float(f"{rate:.2g}") if rate < 1e4 else float(f"{rate:.1g}")
    if m.step is None:
        advice = f"sample at about {rate:g} Hz or more"
    elif m.spacing <= 1.5 * m.step:
        advice = "every step is logged already, so take a smaller step"
        advice += ", or check the bookkeeping with work='discrete'" if m.method == "samples" else ""
    elif rate >= 0.9 / m.step or 2.0 * m.held > m.bar:
        advice = f"log every step of the simulator ({1.0 / m.step:.4g} Hz)"
    else:
        advice = f"sample at about {rate:g} Hz or more"
    return f"{now} (it falls with order {order:.1f}): {advice}"


def untested(_: Facts) -> str:
    """No accelerations."""
    return (
        "The log has no accelerations of its own, and the one-step test cannot rule out that wrong equations "
        "cause the energy error: log udot.<speed> at the same instants (MuJoCo: qacc; SciPy: "
        "Trajectory.from_scipy(result, model, equations=f)), or log every step. If the simulator has no "
        "accelerations, run the same motion with half the step as well: deltac study MODEL --logs COARSE "
        "--logs FINE"
    )


def single_steps(f: Facts) -> str:
    """When an integrator does not close."""
    left = f.single_steps
    when = "" if left is None else ", ".join(f"{t:.4g}" for t in left.t[left.unclosed][:FEW])
    return f"The energy error comes from single steps, near t = {when} s: log what acted there"


def other_rows(_: Facts) -> str:
    """Forces of other rows."""
    return "The energy error may come from the logged forces, which belong to other rows"
