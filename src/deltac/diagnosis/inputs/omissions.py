"""What a run leaves out: forces of channels, rows that resolve works, events of impacts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import SAME_STEP
from deltac.diagnosis.verdict import Finding
from deltac.energy import Ledger
from deltac.errors import listed
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.importers import ImportReport


def assumed_zero(run: Trajectory, import_report: ImportReport | None) -> list[str]:
    """Channels that the importer left to the log and the log does not have.

    A recorder that tells which kinds of forces it looked for, and which of them acted, is believed.
    """
    if import_report is None:
        return []
    channels = re.findall(r"channel '([^']+)'", " ".join(str(r) for r in import_report.ignored))
    looked_for, acted = run.provenance.looked_for, run.provenance.acted
    missing: list[str] = []
    for name in dict.fromkeys(channels):
        generic, all_of_kind = name.partition("<")[0], "<" in name
        kind = ChannelName.parse(name).kind
        at_rest = kind in looked_for and not any(a.startswith(generic) for a in acted)
        on_each_speed = all(f"{kind} {speed}" in run.forces for speed in run.speeds)
        in_log = name in run.forces or (
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


OF_RATES = ("clock-scale", "gear-between-q-and-u", "speed-not-rate", "late-rows")
"""Findings of the kinematic test that a wrong unit or order makes too."""

OF_UNITS = ("degrees", "turns", "rpm")
"""Doubts of units: rows that follow from each other by a known step contradict them too."""
