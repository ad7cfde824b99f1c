"""What a run leaves out: forces of channels, rows that resolve works, events of impacts."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import ROUGHLY, SAME, SAME_STEP, Array, max_norm
from deltac.diagnosis.verdict import Finding
from deltac.energy import Ledger
from deltac.errors import InputError, listed
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.results import number, percent
from deltac.simulation.constraints.assembly import assemble
from deltac.simulation.simulate import SimulationStoppedWarning, simulate
from deltac.trajectories import Occurrence, Trajectory

if TYPE_CHECKING:
    from deltac.importers import ImportReport


def assumed_zero(run: Trajectory, import_report: ImportReport | None) -> list[str]:
    """Channels that the importer left to the log and the log does not have.

    A recorder that tells which kinds of forces it looked for, and which of them acted, is believed.
    """
    if import_report is None:
        return []
    remarks = " ".join(str(r) for r in import_report.ignored)
    channels = dict(re.findall(r"channel '([^']+)'(?: or '([^']+)')?", remarks))
    looked_for, acted = run.provenance.looked_for, run.provenance.acted
    missing: list[str] = []
    for name, alias in channels.items():
        generic, all_of_kind = name.partition("<")[0], "<" in name
        kind = ChannelName.parse(name).kind
        at_rest = kind in looked_for and not any(a.startswith(generic) for a in acted)
        on_each_speed = all(f"{kind} {speed}" in run.forces for speed in run.speeds)
        in_log = {name, alias} & set(run.forces) or (
            all_of_kind and any(f.startswith(generic) for f in run.forces)
        )
        if not (at_rest or on_each_speed or in_log):
            missing.append("contact all" if name.startswith("contact <") else name)
    return missing


def limits_reached(run: Trajectory, import_report: ImportReport | None) -> list[str]:
    """Channels of limits of joints that the rows reach."""
    ranges = (
        {r.element: r.limits for r in import_report.ignored if r.limits} if import_report else {}
    )
    return [
        f"limit {name}"
        for name, q in zip(run.coordinates, run.q.T, strict=True)
        if name in ranges and (q.min() <= ranges[name][0] or q.max() >= ranges[name][1])
    ]


def assumed_zero_finding(missing: Sequence[str], reached: Sequence[str] = ()) -> list[Finding]:
    """One finding for all, of the first actuator or equality, if there is one; the others are its equals.

    Contacts, limits and friction that never acted need not be logged; limits that rows reach (`reached`) act.
    """
    if not missing:
        return []
    motors, equalities = (
        [name for name in missing if ChannelName.parse(name).kind == kind]
        for kind in ("actuator", "constraint")
    )
    acting = [*motors, *equalities, *(name for name in missing if name in reached)]
    number = "1 channel" if len(missing) == 1 else f"{len(missing)} channels"
    return [
        Finding(
            "assumed-zero",
            f"the log has no force for {number} of the model's file; it is assumed to be zero",
            listed(map(repr, missing)),
            "If one of them acted, log its force"
            + ("; for a MuJoCo model, `replay` computes it from the controls" if motors else ""),
            "note",
            next(iter(acting), ""),
            equals=tuple(("assumed-zero", name) for name in acting[1:]),
        )
    ]


def unresolved_works(run: Trajectory, ledger: Ledger) -> list[Finding]:
    """One finding for all channels whose work is hardly known, with the error of the largest."""
    unknown = ledger.unresolved
    if not unknown:
        return []
    errors = {name: float(ledger.work_error[name].max()) for name in unknown}
    worst = max(unknown, key=lambda name: errors[name])
    number = "1 channel" if len(unknown) == 1 else f"{len(unknown)} channels"
    step = run.provenance.step
    whole = step and len(run) > 1 and float(np.median(np.diff(run.t))) < (1.0 + SAME_STEP) * step
    remedy = (
        "Log more rows; deltac's own runs integrate works together with the testing functions that they "
        "record (simulate(..., record=...))"
    )
    if whole:
        remedy = "Every step is there already: a smaller step of the simulator resolves them"
    if ledger.method == "in-loop":
        remedy += ". ΔC does not rest on them: it was taken in the loop"
    return [
        Finding(
            "work-unresolved",
            f"the work of {number} is not resolved by the samples",
            f"{worst!r} ± {errors[worst]:.2g} J, the others less; see the table",
            remedy,
            "note",
            element=worst,
            error=errors[worst],
        )
    ]


def impacts_not_held(mechanism: Mechanism, run: Trajectory) -> list[Finding]:
    """A run of another program without events, of a model in which things hit each other."""
    names = [event.name for event in mechanism.events if event.impulsive]
    recorded = run.events or any(name.kind == "impact" for name in (*run.forces, *run.works))
    if not names or recorded or run.provenance.simulator == "deltac":
        return []
    return [
        Finding(
            "impacts",
            "the model has impacts, and the run does not say whether there were any",
            f"{', '.join(map(repr, names))} in the model; no events, no channel 'impact …' in the run",
            "Hand over the run with its events, or leave the impacts out of the model if nothing was hit",
            element=names[0],
        )
    ]


MOST_JUMPS = 200
"""Intervals in which a speed may have jumped that are simulated at most."""

STEADY_RATIO = 5.0
"""Ratio of mean and scatter of departures, as shares of the jumps, from which on they are of the restitution:
what a method does to the place of an impact is anything up to what one of its steps does."""

FEW_IMPACTS = 3
"""Impacts that tell a restitution from that."""


def with_impacts(mechanism: Mechanism, run: Trajectory) -> tuple[Trajectory, Finding] | None:
    """The run with the impacts by which the model goes from row to row; None where it does not, or has none.

    Where speeds may have jumped the model is simulated from the row before, with its impacts and no other
    force than its own. Rows that depart from it by equal shares of the jumps are of another restitution.
    """
    # Forces that a step takes in between rows are not known; a change of rates takes three rows.
    if run.forces or len(run) < 3:
        return None
    h = np.diff(run.t)
    change = np.abs(np.diff(np.diff(run.u, axis=0) / h[:, None], axis=0))
    usual = np.median(change, axis=0) + SAME * change.max(axis=0)
    most = (ROUGHLY * change > usual).any(axis=1)
    jumps = np.flatnonzero(np.r_[most, False] | np.r_[False, most])
    if not 0 < len(jumps) <= MOST_JUMPS:
        return None
    events, hits = list[Occurrence](), list[tuple[Array, Array]]()
    free = [SAME * np.abs(run.u).max()]
    for k in jumps:
        start = State(float(run.t[k]), run.q[k], run.u[k])
        try:
            if mechanism.constraints:
                start = assemble(mechanism, start).state
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SimulationStoppedWarning)
                own = simulate(mechanism, start, float(h[k]), float(h[k]))
        except InputError:
            return None
        if not own.provenance.completed:  # impacts accumulate, and the contact lasts
            return None
        departs = run.u[k + 1] - own.u[-1]
        jump = sum((e.u_after - e.u_before for e in own.events), np.zeros_like(departs))
        if np.any(jump):
            hits.append((departs, jump))
            events += [_of_rows(e, run, SAME * float(h[k])) for e in own.events]
        else:
            free.append(np.abs(departs).max())
    if not hits:
        return None
    of_a_step = np.median(np.abs(np.diff(run.u, axis=0)).max(axis=1))
    finding = _impacts_told(events, hits, float(np.median(free)), float(of_a_step))
    rows = replace(run, udot=None, works={}, integrals={}, events=tuple(events))
    return None if finding is None else (rows, finding)


def _of_rows(event: Occurrence, run: Trajectory, instant: float) -> Occurrence:
    """A simulated event among rows that have neither its accelerations nor its forces.

    A row within an `instant` (s) of it is before or after it, as its speeds tell, whatever rounding does.
    """
    t, k = event.t, int(np.argmin(np.abs(run.t - event.t)))
    if abs(run.t[k] - t) <= instant:
        before, after = (np.abs(run.u[k] - u).max() for u in (event.u_before, event.u_after))
        t = float(run.t[k] if after <= before else np.nextafter(run.t[k], np.inf))
    return Occurrence(
        t=t, names=event.names, q=event.q, u_before=event.u_before, u_after=event.u_after,
        impulses=event.impulses,
    )  # fmt: skip


def _impacts_told(
    events: Sequence[Occurrence], hits: Sequence[tuple[Array, Array]], usual: float, step: float
) -> Finding | None:
    """What rows after impacts say of the model's law, by departures from it and jumps; None: nothing.

    `usual`: departures without an impact; `step`: changes of the speeds by a step without one.
    """
    names = listed(dict.fromkeys(name for e in events for name in e.names))
    shares = np.array([departs @ jump / (jump @ jump) for departs, jump in hits])
    share, scatter = float(shares.mean()), float(shares.std())
    sizes = [max_norm(departs) for departs, _ in hits]
    if (
        len(hits) >= FEW_IMPACTS
        and abs(share) > STEADY_RATIO * scatter
        and min(sizes) > STEADY_RATIO * usual
    ):
        return Finding(
            "restitution",
            f"{len(hits)} impacts of the run ({names}) change the speeds by {percent(abs(share))} "
            f"{'more' if share > 0.0 else 'less'} than those of the model",
            f"alike in all of them to {percent(scatter)}; other rows depart by {number(usual)} rad/s or m/s",
            "Give the model's impacts the restitution of the run",
            "cause",
            names,
            factor=1.0 + share,
        )
    if max(sizes) > max(STEADY_RATIO * usual, step):
        return None
    return Finding(
        "impacts-by-law",
        f"the log lacks its {len(hits)} impacts ({names}); those of the model are taken",
        "with them the model arrives at the next rows",
        "Hand over the run with its events",
        "note",
    )


OF_RATES = ("clock-scale", "gear-between-q-and-u", "speed-not-rate", "late-rows")
"""Findings of the kinematic test that a wrong unit or order makes too."""

OF_UNITS = ("degrees", "turns", "rpm")
"""Doubts of units: rows that follow from each other by a known step contradict them too."""
