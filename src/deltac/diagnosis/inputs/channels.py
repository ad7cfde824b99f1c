"""Channels of a log that the model does not have: their forces are taken as logged, which must be said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import SAME, Array
from deltac.diagnosis.verdict import Finding, percent
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.energy import Ledger
from deltac.energy.terms import LoggedForces
from deltac.errors import listed
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.importers import ImportReport


def not_simulated(import_report: ImportReport | None) -> list[Finding]:
    """A finding on what an import left out, for runs of deltac's own solvers, which lack it."""
    acting = import_report.acting if import_report is not None else ()
    if not acting:
        return []
    kinds = Counter(remark.what.partition(",")[0] for remark in acting)
    shown = ", ".join(f"{count} {what}" for what, count in kinds.items())
    return [
        Finding(
            "not-simulated",
            f"parts of the model's file are not simulated here: {shown}",
            listed(repr(remark.element) for remark in acting),
            "Let MuJoCo simulate it, --solver mujoco:rk4, or audit a log of the simulator that has them",
            "note",
            acting[0].element,
        )
    ]


def import_remarks(report: ImportReport | None) -> dict[str, tuple[str, ...]]:
    """What an import left out and assumed, as texts; empty without an import."""
    return {
        "ignored": tuple(map(str, report.ignored)) if report else (),
        "assumed": tuple(map(str, report.assumed)) if report else (),
    }


OF_MODELS = ("friction", "limit", "actuator")
"""Kinds that a simulator takes from its model: others come of what it meets, or are judged elsewhere."""


def foreign_channels(
    mechanism: Mechanism, run: Trajectory, import_report: ImportReport | None
) -> dict[ChannelName, float]:
    """The work (J) of channels of these kinds that neither the model nor its file has, by trapezoids.

    What the importer left to the log, for the file has it, is not foreign; nor is what never acted.
    """
    remarks = " ".join(str(r) for r in import_report.ignored) if import_report else ""
    acting = LoggedForces.of(run).places
    asked = [n for n in run.forces if n.kind in OF_MODELS and f"'{n}'" not in remarks and acting[n]]
    if not asked:
        return {}
    ours = {channel.name for channel in equations_of_motion(mechanism).channels}
    return {
        n: float(np.trapezoid(np.einsum("ij,ij->i", run.u, run.forces[n]), run.t))
        for n in asked
        if n not in ours
    }


def foreign_notes(works: Mapping[ChannelName, float], energy_exchanged: float) -> list[Finding]:
    """A note on those of each kind: they hide in a balance that holds, since their forces are the log's."""
    return [
        Finding(
            "channel-not-in-model",
            words,
            _share(sum(abs(works[name]) for name in names), energy_exchanged),
            "Add to the model what is to act when it is simulated on its own",
            "note",
            listed(names),
        )
        for names, words in foreign_words(works)
    ]


def _share(energy: float, energy_exchanged: float) -> str:
    if not energy_exchanged > 0.0:
        return "where no energy is exchanged"
    return f"{percent(energy / energy_exchanged)} of the energy exchanged"


def intolerable(power: Array, t: Array, ledger: Ledger, tolerance: float) -> bool:
    """Whether a power (T,) that should not be is more than the tolerance, as of mistakes in the equations.

    That is what flows either way, as a share of what is exchanged, or what it adds to ΔC, of what the system
    has.
    """
    net = np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))
    flow = float(np.trapezoid(np.abs(power), t))
    return (
        flow > tolerance * ledger.energy_exchanged
        or float(np.abs(net).max(initial=0.0)) > tolerance * ledger.reference_energy
    )


def through_difference(energy: float, energy_exchanged: float) -> str:
    """How much energy (J) flowed through the difference of two forces, in words."""
    return f"{energy:.3g} J flowed through the difference, {_share(energy, energy_exchanged)}"


def foreign_words(
    works: Mapping[ChannelName, float],
) -> Iterator[tuple[tuple[ChannelName, ...], str]]:
    """The channels of each kind, and what they are and did."""
    for kind, group in groupby(sorted(works, key=lambda name: name.kind), lambda name: name.kind):
        names = tuple(group)
        work = f"{sum(works[name] for name in names):.3g} J of work"
        what, force = f"a channel {names[0]!r}", "its force is"
        if len(names) > 1:
            what, force = (
                f"{len(names)} {kind} channels ({listed(map(repr, names))})",
                "their forces are",
            )
        yield (
            names,
            f"the log has {what} that the model does not have; {force} taken as logged, and did {work}",
        )


# --- motors of the model against those of the simulator ------------------------------------------


def differing_gears(
    run: Trajectory, ledger: Ledger, tolerance: float, import_report: ImportReport | None
) -> list[Finding]:
    """Motors whose force per unit of control was another in the simulator than it is in the model.

    A recorded run tells the strengths of its simple motors. A difference is a cause where it moved more
    energy than the tolerance.
    """
    findings: list[Finding] = []
    for gear in other_gears(run, import_report):
        power = ledger.power.get(gear.channel, np.zeros(len(ledger.t)))
        power = (1.0 - (1.0 / gear.factor if gear.factor else 0.0)) * power
        energy = float(np.trapezoid(np.abs(power), ledger.t))
        findings.append(
            Finding(
                "channel-differs",
                str(gear),
                f"force per unit of control: log {_shown(gear.logged)}, model {_shown(gear.model)}; "
                + through_difference(energy, ledger.energy_exchanged),
                "Give the model the gear that the simulator used",
                "cause" if intolerable(power, ledger.t, ledger, tolerance) else "note",
                gear.channel,
                gear.factor,
            )
        )
    return findings


@dataclass(frozen=True, eq=False)
class Gear:
    """A motor with another force per unit of control in the log than in the model, and their ratio.

    `factor` is None where no single number turns one into the other.
    """

    channel: str
    logged: np.ndarray
    model: np.ndarray
    factor: float | None

    def __str__(self) -> str:
        ratio = f"{self.factor:.5g} times the model's" if self.factor else "not the model's"
        return (
            f"the logged force of {self.channel!r} is {ratio} at the same control: the simulator had another "
            "gear or gain"
        )


def other_gears(run: Trajectory, import_report: ImportReport | None) -> list[Gear]:
    """Motors of which run and model tell different strengths."""
    gears: list[Gear] = []
    theirs, ours = run.provenance.strengths, import_report.strengths if import_report else {}
    for name in sorted(theirs.keys() & ours.keys()):
        logged, model = np.array(theirs[name]), np.array(ours[name])
        if logged.shape != model.shape or not np.allclose(logged, model, rtol=SAME, atol=0.0):
            gears.append(Gear(f"actuator {name}", logged, model, _factor(logged, model)))
    return gears


def limits(run: Trajectory, import_report: ImportReport | None) -> tuple[str, ...]:
    """What an audit does not see of actuators whose control law was not compared."""
    compared = run.provenance.strengths.keys() & (import_report.strengths if import_report else {})
    unknown = [n for n in run.forces if n.kind == "actuator" and n.element not in compared]
    if not unknown or import_report is None:
        return ()
    return (
        f"a wrong gear, gain or control in the model: forces of {listed(map(repr, unknown))} are taken from "
        "the log",
    )


def _factor(logged: np.ndarray, model: np.ndarray) -> float | None:
    """The number that turns the model's strengths into the log's, if one does."""
    if logged.shape != model.shape or not model.any():
        return None
    factor = float(model @ logged / (model @ model))
    fits = np.allclose(logged, factor * model, rtol=1e-6, atol=1e-9 * np.abs(logged).max())
    return factor if fits and factor else None


def _shown(strengths: np.ndarray) -> str:
    return " ".join(f"{x:.5g}" for x in np.trim_zeros(strengths, "b")) or "0"
