"""Channels of a log that the model does not have: their forces are taken as logged, which must be said."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from deltac.diagnosis.findings import Finding, percent
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.importers import ImportReport

OF_MODELS = ("friction", "limit", "actuator")
"""Kinds that a simulator takes from its model: others come of what it meets, or are judged elsewhere."""


def foreign_channels(
    mechanism: Mechanism, run: Trajectory, import_report: ImportReport | None
) -> dict[str, float]:
    """The work (J) of channels of these kinds that neither the model nor its file has, by trapezoids.

    What the importer left to the log, for the file has it, is not foreign; nor is what never acted.
    """
    told = " ".join(str(r) for r in import_report.ignored) if import_report else ""
    asked = [
        n
        for n, f in run.forces.items()
        if n.partition(" ")[0] in OF_MODELS and f"'{n}'" not in told and f.any()
    ]
    if not asked:
        return {}
    ours = {channel.name for channel in equations_of_motion(mechanism).channels}
    return {
        n: float(np.trapezoid(np.einsum("ij,ij->i", run.u, run.forces[n]), run.t))
        for n in asked
        if n not in ours
    }


def foreign_notes(works: dict[str, float], turnover: float) -> list[Finding]:
    """A note on each: it hides in a balance that holds, since its force is that of the log."""
    return [
        Finding(
            "channel-not-in-model",
            foreign_words(name, work),
            f"{percent(abs(work) / turnover) if turnover > 0.0 else 'nothing'} of the turnover",
            "Add it to the model if the model shall move so by itself",
            "note",
            name,
        )
        for name, work in works.items()
    ]


def foreign_words(name: str, work: float) -> str:
    """What such a channel is, and did."""
    return (
        f"the log has a channel {name!r} that the model does not have; its force is taken as logged, and did "
        f"{work:.3g} J of work"
    )
